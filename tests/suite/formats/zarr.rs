//! Folders of Zarr and OME-Zarr give the values that zarr and ome-zarr read (tests/data/zarr/make.py).

use std::path::{Path, PathBuf};

use serde::Deserialize;
use voxsplat::formats::{LoadOptions, PyramidLevel, load};
use voxsplat::volume::{Segment, Volume};

use crate::formats::fixtures::{assert_affine, path};

#[derive(Deserialize)]
struct Expected {
    path: String,
    #[serde(rename = "type")]
    sample_type: String,
    dims: [u32; 3],
    channels: u32,
    times: u32,
    /// Affines of a pyramid, the finest first.
    levels: Vec<[[f64; 4]; 3]>,
    unit: String,
    labels: Vec<String>,
    /// Missing sections, and the value in their place.
    missing: Option<(u32, u32, f64)>,
}

fn folder(path: &str) -> PathBuf {
    [env!("CARGO_MANIFEST_DIR"), "data", "zarr", path].iter().collect()
}

fn expected() -> Vec<Expected> {
    serde_json::from_str(&std::fs::read_to_string(folder("expected.json")).unwrap()).unwrap()
}

/// The sample at a place, as in make.py.
fn sample(sample_type: &str, [x, y, z]: [u32; 3], (channel, time): (u32, u32)) -> f64 {
    let n = f64::from((7 * x + 13 * y + 29 * z + 101 * channel + 40 * time) % 251);
    match sample_type {
        "u8" => n,
        "i8" => n - 125.0,
        "u16" => 257.0 * n,
        "i16" => 100.0 * n - 12_000.0,
        "u32" => 70_001.0 * n,
        "i32" => 70_001.0 * n - 9_000_000.0,
        "u64" => 3e16 * n,
        "i64" => 3e16 * (n - 100.0),
        "f32" => n * 0.25 - 3.125,
        "f64" => n / 4.0 - 7.125,
        other => panic!("{other}"),
    }
}

fn assert_samples(volume: &Volume, e: &Expected, step: u32, of: (u32, u32), what: &str) {
    let samples = volume.in_memory().unwrap();
    let [nx, ny, nz] = volume.grid().dims();
    for (x, y, z) in (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| (x, y, z)))) {
        let index = ((z * ny + y) * nx + x) as usize;
        let expected = match e.missing {
            Some((from, to, fill)) if (from..to).contains(&z) => fill,
            _ => sample(&e.sample_type, [x * step, y * step, z * step], of),
        };
        assert_eq!(samples.value(index), expected, "{what}: sample {x}, {y}, {z}");
    }
}

#[test]
fn every_folder_is_read_as_by_zarr() {
    let all = expected();
    assert!(all.len() >= 60, "{} folders", all.len());
    for e in &all {
        for (channel, time) in (0..e.channels).flat_map(|c| (0..e.times).map(move |t| (c, t))) {
            for (level, affine) in e.levels.iter().enumerate() {
                let options = LoadOptions {
                    channel: Some(channel),
                    time: Some(time),
                    level: PyramidLevel::At(level as u32),
                    ..LoadOptions::default()
                };
                let volume = load(folder(&e.path), &options).unwrap_or_else(|error| panic!("{error:#}"));
                let what = format!("{} level {level} channel {channel} time {time}", e.path);
                assert_eq!(volume.grid().dims(), e.dims.map(|n| n >> level), "{what}");
                assert_eq!(volume.sample_type().name(), e.sample_type, "{what}");
                assert_samples(&volume, e, 1 << level, (channel, time), &what);
                assert_affine(&volume, affine, &what);
                assert_eq!(volume.units().length.as_deref().unwrap_or_default(), e.unit, "{what}");
                let contents = volume.contents();
                assert_eq!((contents.channels, contents.times), (e.channels, e.times), "{what}");
                assert_eq!((contents.level, contents.levels), (level as u32, e.levels.len() as u32), "{what}");
                let label = |channel: &voxsplat::volume::Channel| {
                    let ([r, g, b], [low, high]) = (channel.color.unwrap(), channel.window.unwrap());
                    format!("{} #{r:02x}{g:02x}{b:02x} {low} {high}", channel.name.as_deref().unwrap())
                };
                assert_eq!(contents.labels.iter().map(label).collect::<Vec<_>>(), e.labels, "{what}");
            }
        }
    }
}

#[test]
fn the_level_is_the_coarsest_that_is_fine_enough() {
    // 4 x 4.5 x 8 µm, in samples of 0.5 x 0.75 x 2 µm, and in samples twice as large.
    let level = |level: PyramidLevel| {
        load(folder("image-0.5.zarr"), &LoadOptions { level, ..LoadOptions::default() }).unwrap().contents().level
    };
    assert_eq!(level(PyramidLevel::Pixels(100.0)), 0);
    // Pixels of 4 µm are as coarse as the sections of the second level.
    assert_eq!(level(PyramidLevel::Pixels(2.0)), 1);
    assert_eq!(level(PyramidLevel::Pixels(2.1)), 0);
    assert_eq!(level(PyramidLevel::PixelSize(4.0)), 1);
    assert_eq!(level(PyramidLevel::PixelSize(3.9)), 0);
    let error = load(folder("image-0.5.zarr"), &LoadOptions { level: PyramidLevel::At(2), ..LoadOptions::default() });
    assert!(error.unwrap_err().to_string().contains("has the levels 0 to 1"));
}

#[test]
fn levels_without_scales_are_told_apart_by_their_sizes() {
    let level = |level: PyramidLevel| {
        load(folder("image-0.1.zarr"), &LoadOptions { level, ..LoadOptions::default() }).unwrap().contents().level
    };
    // 8 samples of 1, and 4 of 2.
    assert_eq!(level(PyramidLevel::Pixels(8.0)), 0);
    assert_eq!(level(PyramidLevel::Pixels(4.1)), 0);
    assert_eq!(level(PyramidLevel::Pixels(4.0)), 1);
    // Some writers state one scale for all levels.
    let same = changed("image-0.5.zarr", "zarr.json", |bytes| {
        let text = String::from_utf8(bytes).unwrap();
        let halved = ["4.0", "1.5", "1.0"].iter().zip(["2.0", "0.75", "0.5"]);
        let (head, tail) = text.rsplit_once("\"scale\": [").unwrap();
        let (scale, rest) = tail.split_once(']').unwrap();
        let scale = halved.fold(scale.to_owned(), |scale, (from, to)| scale.replace(from, to));
        format!("{head}\"scale\": [{scale}]{rest}").into_bytes()
    });
    let coarse = LoadOptions { level: PyramidLevel::At(1), ..LoadOptions::default() };
    assert_eq!(load(same.path(), &coarse).unwrap().grid().spacing(), [1.0, 1.5, 4.0]);
}

#[test]
fn labels_have_the_colours_and_names_of_their_image() {
    let segment =
        |label, name: Option<&str>, color| Segment { channel: 0, label, name: name.map(str::to_owned), color };
    let segments = |path: &str| load(folder(path), &LoadOptions::default()).unwrap().contents().segments.clone();
    let red = segment(7, None, Some([255, 0, 0]));
    assert_eq!(segments("labels-0.4.zarr"), Some(vec![red, segment(13, Some("nucleus"), Some([0, 255, 0]))]));
    assert_eq!(segments("image-0.5.zarr"), None);
}

#[test]
fn archives_are_read_whole_or_by_a_folder_in_them() {
    let inside = |archive: &str, name: &str| load(format!("{}:{name}", path(archive)), &LoadOptions::default());
    let volume = inside("image-0.5.ozx", "s1").unwrap();
    assert_eq!((volume.grid().dims(), volume.grid().spacing()), ([4, 3, 2], [1.0; 3]));
    for name in ["s2", "../zarr", "s0/c"] {
        let error = inside("image-0.5.ozx", name).unwrap_err().to_string();
        assert!(error.contains(&format!("image-0.5.ozx: has no array or group of Zarr named {name:?}")), "{error}");
    }
    let place = tempfile::tempdir().unwrap();
    let file = place.path().join("a.zip");
    std::fs::copy(path("stored-i16.npz"), &file).unwrap();
    assert_eq!(load(&file, &LoadOptions::default()).unwrap().grid().dims(), [3, 4, 5]);
    let mut bytes = std::fs::read(path("image-0.5.ozx")).unwrap();
    let metadata: Vec<usize> = (0..bytes.len() - 9).filter(|&at| &bytes[at..at + 9] == b"zarr.json").collect();
    metadata.into_iter().for_each(|at| bytes[at] = b'c');
    std::fs::write(&file, &bytes).unwrap();
    let error = load(&file, &LoadOptions::default()).unwrap_err().to_string();
    assert!(error.ends_with("a.zip: is a ZIP file without a Zarr: unpack it"), "{error}");
    // A stored chunk has no checksum of its own, but the archive must be whole.
    let bytes = std::fs::read(path("v3-shards.zarr.zip")).unwrap();
    std::fs::write(&file, &bytes[..bytes.len() - 9]).unwrap();
    crate::hostile::fuzz::targets::assert_one_line(&load(&file, &LoadOptions::default()).map(drop).unwrap_err());
}

#[test]
fn a_group_with_several_arrays_lists_them() {
    let group = tempfile::tempdir().unwrap();
    std::fs::write(group.path().join(".zgroup"), "{\"zarr_format\": 2}").unwrap();
    for from in ["v2-i16.zarr", "v2-u8.zarr"] {
        let copy = changed(from, ".zarray", |bytes| bytes);
        std::fs::rename(copy.keep(), group.path().join(from)).unwrap();
    }
    let error = load(group.path(), &LoadOptions::default()).unwrap_err().to_string();
    let listed = "is a group without an image, but with 2 arrays, v2-i16.zarr of 5 x 4 x 3, v2-u8.zarr of 5 x 4 x 3";
    assert!(error.contains(listed), "{error}");
}

/// A copy of a folder with a text of a file replaced.
fn changed(from: &str, file: &str, replace: impl Fn(Vec<u8>) -> Vec<u8>) -> tempfile::TempDir {
    fn copied(from: &Path, to: &Path) {
        std::fs::create_dir_all(to).unwrap();
        for entry in std::fs::read_dir(from).unwrap().map(Result::unwrap) {
            let to = to.join(entry.file_name());
            match entry.path().is_dir() {
                true => copied(&entry.path(), &to),
                false => drop(std::fs::copy(entry.path(), to).unwrap()),
            }
        }
    }
    let copy = tempfile::tempdir().unwrap();
    copied(&folder(from), copy.path());
    let file = copy.path().join(file);
    std::fs::write(&file, replace(std::fs::read(&file).unwrap())).unwrap();
    copy
}

#[test]
fn broken_folders_say_what_is_wrong() {
    let cases = [
        ("v2-i16.zarr", ".zarray", "\"<i2\"", "\"<c8\"", "dtype \"<c8\" is not read"),
        ("v2-i16.zarr", ".zarray", "\"<i2\"", "[[\"a\", \"<i2\"]]", "no simple type"),
        ("v2-i16.zarr", ".zarray", "\"C\"", "\"K\"", "order is \"K\""),
        ("v2-gzip.zarr", ".zarray", "\"gzip\"", "\"bz2\"", "codec \"bz2\" is not read"),
        ("v2-i16.zarr", ".zarray", "{", "[", "expected"),
        ("v2-i16.zarr", ".zarray", "\"shape\"", "\"sharp\"", "an array of []"),
        ("v2-i16.zarr", ".zarray", "[\n    5,", "[\n    70000,", "dimension 3 is 70000"),
        ("v2-i16.zarr", ".zarray", "\"chunks\": [\n    3", "\"chunks\": [\n    0", "in chunks of [0"),
        (
            "v2-i16.zarr",
            ".zarray",
            "\"chunks\": [\n    3",
            "\"chunks\": [\n    300000000",
            "expected at most 1073741824",
        ),
        ("v2-i16.zarr", ".zarray", "\"chunks\": [\n    3", "\"chunks\": [\n    4", "expected 64"),
        ("v3-i16.zarr", "zarr.json", "\"int16\"", "\"complex64\"", "\"complex64\" is not read"),
        ("v3-i16.zarr", "zarr.json", "\"regular\"", "\"rectangular\"", "regular grid"),
        ("v3-i16.zarr", "zarr.json", "\"bytes\"", "\"vlen-utf8\"", "\"vlen-utf8\" is not read"),
        ("v3-i16.zarr", "zarr.json", "\"little\"", "\"middle\"", "\"middle\""),
        ("v3-shards.zarr", "zarr.json", "\"end\"", "\"middle\"", "\"middle\""),
        ("v3-big-transposed.zarr", "zarr.json", "1,\n          2,\n          0", "1,1,0", "transpose"),
        ("image-0.5.zarr", "zarr.json", "\"scale\": [", "\"scales\": [", "no scale of 3 numbers"),
        ("image-0.5.zarr", "zarr.json", "\"scale\": [", "\"scale\": [1.0,", "no scale of 3 numbers"),
        ("image-0.5.zarr", "zarr.json", "multiscales", "singlescale", "without an image"),
        ("image-0.5.zarr", "zarr.json", "\"path\": \"", "\"path\": \"../", "outside of its folder"),
        ("image-0.6.zarr", "zarr.json", "\"sequence\"", "\"affine\"", "a transformation of the type \"affine\""),
        ("v3-fill-f32.zarr", "zarr.json", "0x40a00000", "0x40a0", "which is no number of the type f32"),
        ("image-0.5.zarr", "zarr.json", "\"path\": \"", "\"path\": \"/", "outside of its folder"),
    ];
    for (from, file, text, with, words) in cases {
        let copy = changed(from, file, |bytes| {
            let old = String::from_utf8(bytes).unwrap();
            assert!(old.contains(text), "{from}: {text} in {old}");
            old.replacen(text, with, 1).into_bytes()
        });
        let error = load(copy.path(), &LoadOptions::default()).map(drop).unwrap_err();
        crate::hostile::fuzz::targets::assert_one_line(&error);
        assert!(error.to_string().contains(words), "{from}: {error} does not say {words}");
    }
    let cut = |bytes: Vec<u8>| bytes[..bytes.len() - 1].to_vec();
    let turned = |mut bytes: Vec<u8>| {
        let middle = bytes.len() / 2;
        bytes[middle] ^= 0x40;
        bytes
    };
    for (from, file) in [("v2-i16.zarr", "0.0.0"), ("v2-blosc-lz4-bytes.zarr", "0.0.0"), ("v3-shards.zarr", "c/0/0/0")]
    {
        let error = load(changed(from, file, cut).path(), &LoadOptions::default()).unwrap_err().to_string();
        assert!(error.contains(file), "{error}");
    }
    let error = load(changed("v3-zstd-crc32c.zarr", "c/0/0/0", turned).path(), &LoadOptions::default()).unwrap_err();
    assert!(error.to_string().contains("checksum is wrong"), "{error}");
}
