//! Every format, encoding and type gives the values of the reference implementations.
//!
//! tests/data/volumes/make.py, make_more.py, make_several.py, make_time.py, make_neuro.py and make_reported.py write
//! the files, and the values that nibabel, pynrrd, SimpleITK, NumPy, mrcfile, VTK, tifffile and pydicom read from them.

use std::path::{Path, PathBuf};

use serde::Deserialize;
use voxsplat::formats::{LoadOptions, TimeSeries, load};
use voxsplat::volume::{Endian, SampleType, Samples, Volume};

/// The contents of a file, according to the reference implementation that read it.
#[derive(Deserialize)]
struct Expected {
    file: String,
    #[serde(rename = "type")]
    sample_type: String,
    /// 3 x 4, from lattice to world.
    affine: [[f64; 4]; 3],
    oriented: bool,
    slope: f64,
    intercept: f64,
    /// The unit of lengths, "" if none is stated; not compared if the table lacks it.
    unit: Option<String>,
}

fn expected() -> Vec<Expected> {
    let table =
        |name: &str| -> Vec<Expected> { serde_json::from_str(&std::fs::read_to_string(path(name)).unwrap()).unwrap() };
    let mut all = table("expected.json");
    all.extend(table("expected-more.json"));
    all.extend(table("expected-neuro.json"));
    all.extend(table("expected-reported.json"));
    all.extend(table("expected-minc.json"));
    all
}

pub(crate) fn path(file: &str) -> String {
    let path: PathBuf = [env!("CARGO_MANIFEST_DIR"), "data", "volumes", file].iter().collect();
    path.to_str().unwrap().to_owned()
}

/// The samples of every file: functions of the index, as in make.py.
fn samples(sample_type: &str) -> Samples {
    fn filled<T>(f: impl Fn(i64) -> T) -> Vec<T> {
        (0..60).map(f).collect()
    }
    match sample_type {
        "u8" => Samples::U8(filled(|n| (3 * n + 5) as u8)),
        "i8" => Samples::I8(filled(|n| (4 * n - 120) as i8)),
        "u16" => Samples::U16(filled(|n| (1000 * n + 257) as u16)),
        "i16" => Samples::I16(filled(|n| (1000 * n - 29_000) as i16)),
        "u32" => Samples::U32(filled(|n| (70_000_000 * n + 1) as u32)),
        "i32" => Samples::I32(filled(|n| (70_000_000 * n - 2_100_000_000) as i32)),
        "u64" => Samples::U64(filled(|n| 300_000_000_000_000_000 * n as u64 + 1)),
        "i64" => Samples::I64(filled(|n| 300_000_000_000_000_000 * (n - 30) + 1)),
        "f32" => Samples::F32(filled(|n| n as f32 * 0.25 - 3.125)),
        "f64" => Samples::F64(filled(|n| n as f64 / 3.0 - 7.1)),
        "nibble" => Samples::U8(filled(|n| (n % 16) as u8)),
        other => panic!("unknown type {other}"),
    }
}

fn read(file: &str) -> Volume {
    load(path(file), &LoadOptions::default()).unwrap()
}

/// The affine of a volume, row by row.
pub(crate) fn affine(volume: &Volume) -> [[f64; 4]; 3] {
    let m = volume.grid().to_world();
    std::array::from_fn(|r| [m.matrix3.x_axis[r], m.matrix3.y_axis[r], m.matrix3.z_axis[r], m.translation[r]])
}

pub(crate) fn assert_affine(volume: &Volume, expected: &[[f64; 4]; 3], what: &str) {
    let found = affine(volume);
    for (f, e) in found.iter().flatten().zip(expected.iter().flatten()) {
        // The reference multiplies in another order: a few roundings of f64.
        assert!((f - e).abs() <= 1e-12 * e.abs().max(1.0), "{what}: {found:?}, expected {expected:?}");
    }
}

#[test]
fn every_file_is_read_as_by_the_reference_implementation() {
    let all = expected();
    assert!(all.len() >= 100, "{} files", all.len());
    for e in &all {
        let volume = read(&e.file);
        assert_eq!(volume.grid().dims(), [3, 4, 5], "{}", e.file);
        assert_eq!(volume.in_memory().unwrap().samples(), &samples(&e.sample_type), "{}", e.file);
        assert_eq!(volume.rescale(), (e.slope, e.intercept), "{}", e.file);
        assert_eq!(volume.is_oriented(), e.oriented, "{}", e.file);
        assert_affine(&volume, &e.affine, &e.file);
        if let Some(unit) = &e.unit {
            assert_eq!(volume.units().length.as_deref().unwrap_or_default(), unit, "{}", e.file);
        }
    }
}

/// The contents of a file of several volumes.
#[derive(Deserialize)]
struct Several {
    file: String,
    #[serde(rename = "type")]
    sample_type: String,
    channels: u32,
    times: u32,
    affine: [[f64; 4]; 3],
    oriented: bool,
    unit: String,
    labels: Vec<String>,
}

/// The samples of a volume among several, as in make_several.py.
fn shifted(sample_type: &str, channel: u32, time: u32) -> Samples {
    let places = (7 * channel + 13 * time) as usize % 60;
    match samples(sample_type) {
        Samples::U8(mut s) => {
            s.rotate_left(places);
            Samples::U8(s)
        }
        Samples::U16(mut s) => {
            s.rotate_left(places);
            Samples::U16(s)
        }
        Samples::I16(mut s) => {
            s.rotate_left(places);
            Samples::I16(s)
        }
        Samples::F32(mut s) => {
            s.rotate_left(places);
            Samples::F32(s)
        }
        _ => panic!("{sample_type}"),
    }
}

#[test]
fn every_channel_at_every_time_is_read_as_by_the_reference_implementation() {
    let table =
        |name: &str| -> Vec<Several> { serde_json::from_str(&std::fs::read_to_string(path(name)).unwrap()).unwrap() };
    let mut all = table("expected-several.json");
    all.extend(table("expected-time.json"));
    all.extend(table("expected-neuro-times.json"));
    all.extend(table("expected-reported-several.json"));
    all.extend(table("expected-hdf5.json"));
    assert!(all.len() >= 20, "{} files", all.len());
    for e in &all {
        let file = path(&e.file);
        let error = load(&file, &LoadOptions::default()).map(drop).map_err(|error| format!("{error:#}"));
        match error {
            Ok(()) => assert_eq!(e.channels, 1, "{}", e.file),
            Err(error) => {
                let says = format!("has {} channels per sample: set LoadOptions::channel", e.channels);
                assert!(error.ends_with(&says), "{error}");
            }
        }
        for (channel, time) in (0..e.channels).flat_map(|c| (0..e.times).map(move |t| (c, t))) {
            for stream_over in [0, 1 << 20] {
                let options =
                    LoadOptions { channel: Some(channel), time: Some(time), stream_over, ..LoadOptions::default() };
                let volume = load(&file, &options).unwrap();
                assert_eq!(volume.grid().dims(), [3, 4, 5], "{}", e.file);
                let what = format!("{}, channel {channel}, time {time}", e.file);
                let expected = shifted(&e.sample_type, channel, time);
                assert_eq!(volume.in_memory().unwrap().samples(), &expected, "{what}");
                let contents = volume.contents();
                assert_eq!((contents.channel, contents.channels), (channel, e.channels), "{what}");
                assert_eq!((contents.time, contents.times), (time, e.times), "{what}");
                let label = |channel: &voxsplat::volume::Channel| {
                    let [r, g, b] = channel.color.unwrap();
                    format!("{} #{r:02x}{g:02x}{b:02x}", channel.name.as_deref().unwrap())
                };
                assert_eq!(contents.labels.iter().map(label).collect::<Vec<_>>(), e.labels, "{what}");
                assert_eq!(volume.is_oriented(), e.oriented, "{what}");
                assert_eq!(volume.units().length.as_deref().unwrap_or_default(), e.unit, "{what}");
                assert_affine(&volume, &e.affine, &what);
            }
        }
        for (name, options) in [
            ("time", LoadOptions { channel: Some(0), time: Some(e.times), ..LoadOptions::default() }),
            ("channel", LoadOptions { channel: Some(e.channels), ..LoadOptions::default() }),
        ] {
            let error = load(&file, &options).unwrap_err().to_string();
            assert!(error.starts_with(&format!("{name}: ")), "{error}");
        }
    }
}

#[test]
fn scales_and_fill_values_of_netcdf_are_applied() {
    let notes = read("packed-i16.nc").contents().notes.join(";");
    assert!(notes.contains("nothing is drawn of 1 of 60 samples because it is NaN or infinite"), "{notes}");
    let options = LoadOptions { replace_nan: Some(0.0), ..LoadOptions::default() };
    let volume = load(path("packed-i16.nc"), &options).unwrap();
    assert_eq!((volume.rescale(), volume.value_unit()), ((0.5, 273.0), Some("K")));
    let Samples::I16(stored) = samples("i16") else { panic!() };
    let values = volume.in_memory().unwrap();
    assert_eq!(values.value(0), 0.0);
    assert!((1..60).all(|n| values.value(n) == f64::from(stored[n]) * 0.5 + 273.0));
}

#[test]
fn sections_of_minc_have_ranges_of_their_own() {
    let volume = read("sections-u8.mnc");
    let Samples::U8(stored) = samples("u8") else { panic!() };
    let value = |(n, sample): (usize, &u8)| {
        let [low, high] = [-(n as f64 / 12.0).floor(), (n as f64 / 12.0).floor() + 1.0];
        let slope = (high - low) / 130.0;
        (slope * f64::from(*sample).clamp(20.0, 150.0) + (low - 20.0 * slope)) as f32
    };
    let expected = stored.iter().enumerate().map(value).collect();
    assert_eq!(volume.in_memory().unwrap().samples(), &Samples::F32(expected));
    assert_eq!(volume.rescale(), (1.0, 0.0));
    // The integers themselves are a data set like any other.
    let integers = load(format!("{}:/image-max", path("sections-u8.mnc")), &LoadOptions::default()).unwrap();
    assert_eq!(integers.grid().dims(), [5, 1, 1]);
}

#[test]
fn broken_minc_files_say_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let whole = std::fs::read(path("minc1-i16.mnc")).unwrap();
    let refused = |from: &[u8], to: &[u8], words: &str| {
        let mut bytes = whole.clone();
        let at = bytes.windows(from.len()).position(|window| window == from).unwrap();
        bytes[at..at + to.len()].copy_from_slice(to);
        let file = folder.path().join("a.mnc");
        std::fs::write(&file, bytes).unwrap();
        let error = load(&file, &LoadOptions::default()).unwrap_err().to_string();
        assert!(error.contains(words), "{words}: {error}");
    };
    refused(b"regular__", b"irregular", "has sections at irregular distances along");
    refused(b"zspace", b"zspice", "has the axis \"zspice\", expected xspace, yspace, zspace");
    refused(b"zspace", b"yspace", "has the axis yspace twice");
    refused(&5.5_f64.to_be_bytes(), &f64::NAN.to_be_bytes(), "image-max has 1 numbers, expected [] that are finite");
    refused(&0.75_f64.to_be_bytes(), &f64::NAN.to_be_bytes(), "spacing of axis 1 is NaN");
}

#[test]
fn a_data_set_is_chosen_by_its_path() {
    let error = format!("{:#}", load(path("two.h5"), &LoadOptions::default()).unwrap_err());
    assert!(error.contains("holds 2 data sets: /raw/first of 5 x 4 x 3, /raw/second of 5 x 4 x 3"), "{error}");
    assert!(error.contains("FILE:NAME"), "{error}");
    let error = load(format!("{}:/third", path("two.h5")), &LoadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("has no data set \"/third\": there are /table of 4, /raw/first"), "{error}");
    let error = load(format!("{}:/a", path("raw-i16.nrrd")), &LoadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("is a NRRD file, which has no data set \"/a\""), "{error}");
}

#[test]
fn flat_frames_of_jpeg_keep_their_values() {
    let volume = read("baseline-u8.dcm");
    let expected = (0..60).map(|n| 50 * (n / 12) as u8 + 3).collect();
    assert_eq!(volume.in_memory().unwrap().samples(), &Samples::U8(expected));
}

#[test]
fn a_group_within_itself_is_refused() {
    let error = load(path("loop.h5"), &LoadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("within themselves by a link"), "{error}");
}

#[test]
fn broken_hdf5_files_say_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let mut refused = 0;
    for file in ["plain-i16.h5", "chunks-f32.h5", "four-i16.nc", "record-f32.nc"] {
        let bytes = std::fs::read(path(file)).unwrap();
        for length in [9, 100, bytes.len() / 2, bytes.len() - 9] {
            let cut = folder.path().join(file);
            std::fs::write(&cut, &bytes[..length]).unwrap();
            match load(&cut, &LoadOptions::default()) {
                // The truncated part may be unnecessary.
                Ok(volume) => {
                    assert_eq!(volume.in_memory().unwrap().samples(), read(file).in_memory().unwrap().samples())
                }
                Err(error) => {
                    refused += 1;
                    crate::hostile::fuzz::targets::assert_one_line(&error);
                }
            }
        }
    }
    assert!(refused >= 12, "{refused} of 16");
}

#[test]
fn an_array_whose_last_axis_is_short_has_channels() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.npy");
    let header = "{'descr': '|u1', 'fortran_order': False, 'shape': (5, 6, 7, 2), }";
    let mut bytes = b"\x93NUMPY\x01\0".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend((0..420).map(|n| if n % 2 == 0 { 1 } else { (n / 2) as u8 }));
    std::fs::write(&file, bytes).unwrap();
    let volume = load(&file, &LoadOptions { channel: Some(1), ..LoadOptions::default() }).unwrap();
    assert_eq!(volume.grid().dims(), [7, 6, 5]);
    assert_eq!(volume.in_memory().unwrap().samples(), &Samples::U8((0..210).map(|n| n as u8).collect()));
}

#[test]
fn the_table_covers_every_type_in_every_format() {
    let all = expected();
    for extension in [".nrrd", ".nii", ".mha", ".npy", ".vti", ".vtk", ".tif"] {
        for sample_type in SampleType::ALL {
            let found = all.iter().any(|e| e.file.ends_with(extension) && e.sample_type == sample_type.name());
            assert!(found, "{sample_type} in {extension}");
        }
    }
}

#[test]
fn numpy_booleans_are_0_and_1() {
    let Samples::U8(samples) = read("bool.npy").in_memory().unwrap().samples().clone() else { panic!("not u8") };
    assert!((0..60).all(|n| samples[n] == (1 - n % 2) as u8));
}

#[test]
fn the_image_of_a_nifti_pair_stands_for_the_pair() {
    for (image, header) in [("pair-i16.img", "pair-i16.hdr"), ("pair-gzip-f32.img.gz", "pair-gzip-f32.hdr.gz")] {
        let (a, b) = (read(image), read(header));
        assert_eq!((a.grid(), a.rescale()), (b.grid(), b.rescale()));
        assert_eq!(a.in_memory().unwrap().samples(), b.in_memory().unwrap().samples());
    }
}

#[test]
fn a_folder_of_sections_is_read_in_natural_order() {
    let folder = tempfile::tempdir().unwrap();
    for z in 8..13 {
        let name = format!("section-{z}.tiff");
        std::fs::copy(path(&name), folder.path().join(&name)).unwrap();
    }
    std::fs::write(folder.path().join("notes.txt"), "notes").unwrap();
    std::fs::write(folder.path().join("empty.tif"), "").unwrap();
    let options = LoadOptions { spacing: Some([0.5, 0.75, 2.0]), ..LoadOptions::default() };
    let volume = load(folder.path(), &options).unwrap();
    assert_eq!((volume.grid().dims(), volume.grid().spacing()), ([3, 4, 5], [0.5, 0.75, 2.0]));
    assert_eq!(volume.in_memory().unwrap().samples(), &samples("i16"));
    std::fs::copy(path("deflate-f32.tif"), folder.path().join("section-13.tif")).unwrap();
    let error = load(folder.path(), &options).unwrap_err().to_string();
    assert!(error.contains("section-13.tif") && error.contains("3 x 4 f32"), "{error}");
}

/// A folder with copies of fixtures.
pub(crate) fn folder_of(files: &[&str]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for file in files {
        std::fs::copy(path(file), folder.path().join(file)).unwrap();
    }
    folder
}

#[test]
fn slices_of_a_tilted_gantry_are_sorted_by_position() {
    let slices = ["ct-a.dcm", "ct-b.dcm", "ct-c.dcm", "ct-d.dcm", "ct-e.dcm", "scout.dcm"];
    let folder = folder_of(&slices);
    std::fs::write(folder.path().join("notes.txt"), "notes").unwrap();
    let check = |options: &LoadOptions| {
        let volume = load(folder.path(), options).unwrap();
        assert_eq!(volume.in_memory().unwrap().samples(), &samples("i16"));
        assert_eq!((volume.rescale(), volume.is_oriented(), volume.value_unit()), ((0.5, -1000.0), true, Some("HU")));
        // The third axis is not normal to the first two.
        assert_affine(&volume, &[[0.5, 0.0, 0.0, 10.0], [0.0, 0.6, 0.0, -20.0], [0.0, 0.45, 2.0, 30.5]], "tilted");
    };
    check(&LoadOptions::default());
    std::fs::copy(path("other.dcm"), folder.path().join("other.dcm")).unwrap();
    check(&LoadOptions { series: Some(1), ..LoadOptions::default() });
    let other = load(folder.path(), &LoadOptions { series: Some(2), ..LoadOptions::default() }).unwrap();
    assert_eq!(other.grid().dims(), [3, 4, 1]);
    let error = format!("{:#}", load(folder.path(), &LoadOptions::default()).unwrap_err());
    assert!(error.contains("1 is CT \"series 1\" of 6 files, 2 is CT \"series 2\" of 1 file"), "{error}");
    assert!(error.contains("set LoadOptions::series"), "{error}");
    let error = load(folder.path(), &LoadOptions { series: Some(3), ..LoadOptions::default() }).unwrap_err();
    assert!(error.to_string().starts_with("series: 3, but "), "{error}");
}

/// Copies a fixture of DICOM under another identifier: a copy with the same one is left out.
pub(crate) fn copy_as_another(from: &str, to: &Path) {
    let mut bytes = std::fs::read(path(from)).unwrap();
    let tag = b"\x08\0\x18\0UI";
    let at = bytes.windows(tag.len()).position(|window| window == tag).unwrap();
    bytes[at + 8] = b'2';
    std::fs::write(to, bytes).unwrap();
}

/// Three time points of five slices each, `time-0.dcm` to `time-14.dcm`.
fn timed() -> tempfile::TempDir {
    let names: Vec<String> = (0..15).map(|n| format!("time-{n}.dcm")).collect();
    folder_of(&names.iter().map(String::as_str).collect::<Vec<_>>())
}

#[test]
fn slices_at_one_position_are_points_in_time() {
    let folder = timed();
    let at = |time: Option<u32>| load(folder.path(), &LoadOptions { time, ..LoadOptions::default() });
    for time in 0..3 {
        let volume = at(Some(time)).unwrap();
        // Sorted by the time of acquisition, which passes midnight.
        assert_eq!(volume.in_memory().unwrap().samples(), &shifted("i16", 0, time));
        assert_eq!((volume.contents().time, volume.contents().times), (time, 3));
        assert_affine(&volume, &[[0.5, 0.0, 0.0, 10.0], [0.0, 0.75, 0.0, -20.0], [0.0, 0.0, 2.0, 30.5]], "timed");
    }
    assert_eq!(at(None).unwrap().contents().time, 0);
    let error = at(Some(3)).unwrap_err().to_string();
    assert!(error.starts_with("time: 3, but ") && error.ends_with("0 to 2"), "{error}");
    // One time point lacks a slice, in names alone: the others keep their number.
    std::fs::remove_file(folder.path().join("time-7.dcm")).unwrap();
    let error = at(None).unwrap_err().to_string();
    assert!(error.contains("has 3 slices at one position, such as time-"), "{error}");
    assert!(error.contains("and 2 at another: time-2.dcm and time-12.dcm"), "{error}");
    // Slices that no tag distinguishes.
    let folder = timed();
    for n in 5..10 {
        copy_as_another(&format!("time-{}.dcm", n - 5), &folder.path().join(format!("time-{n}.dcm")));
    }
    let error = load(folder.path(), &LoadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("3 slices at one position: ") && error.contains("no number, time or kind tells"), "{error}");
}

#[test]
fn a_temporal_position_goes_before_the_time_of_acquisition() {
    let folder = timed();
    // The date of acquisition becomes a temporal position of the same length: 8 digits instead of a date. The last
    // time point is the first.
    for n in 0..15 {
        let file = folder.path().join(format!("time-{n}.dcm"));
        let mut bytes = std::fs::read(&file).unwrap();
        let tag = b"\x08\0\x22\0DA\x08\0";
        let at = bytes.windows(tag.len()).position(|window| window == tag).unwrap();
        let element = bytes.splice(at..at + 16, []).collect::<Vec<u8>>();
        assert!(element.ends_with(b"20260101") || element.ends_with(b"20260102"));
        let position = [b"\x20\0\0\x01IS\x02\0".as_slice(), format!("{:<2}", 3 - n / 5).as_bytes()].concat();
        // Elements are in the order of their tags: it goes before the number of rows.
        let rows = b"\x28\0\x02\0US";
        let at = bytes.windows(rows.len()).position(|window| window == rows).unwrap();
        bytes.splice(at..at, position);
        std::fs::write(&file, bytes).unwrap();
    }
    for time in 0..3 {
        let volume = load(folder.path(), &LoadOptions { time: Some(time), ..LoadOptions::default() }).unwrap();
        assert_eq!(volume.in_memory().unwrap().samples(), &shifted("i16", 0, 2 - time));
    }
}

#[test]
fn captures_without_positions_follow_one_another_by_their_numbers() {
    let folder = folder_of(&["capture-0.dcm", "capture-1.dcm", "capture-2.dcm", "capture-3.dcm", "capture-4.dcm"]);
    for channel in 0..3 {
        let options = LoadOptions { channel: Some(channel), ..LoadOptions::default() };
        let volume = load(folder.path(), &options).unwrap();
        assert_eq!(volume.in_memory().unwrap().samples(), &shifted("u8", channel, 0));
        assert_eq!(
            volume.contents().labels[channel as usize].name.as_deref(),
            Some(["red", "green", "blue"][channel as usize])
        );
    }
    let error = format!("{:#}", load(folder.path(), &LoadOptions::default()).unwrap_err());
    assert!(error.contains("has 3 channels per sample: set LoadOptions::channel"), "{error}");
    std::fs::remove_file(folder.path().join("capture-4.dcm")).unwrap();
    let error =
        load(folder.path(), &LoadOptions { channel: Some(0), ..LoadOptions::default() }).unwrap_err().to_string();
    assert!(error.contains("1 slice is missing between "), "{error}");
}

#[test]
fn luma_and_chroma_become_red_green_and_blue() {
    let expected: Vec<Vec<u8>> = serde_json::from_str(&std::fs::read_to_string(path("ybr.json")).unwrap()).unwrap();
    for (channel, expected) in (0..).zip(expected) {
        let options = LoadOptions { channel: Some(channel), ..LoadOptions::default() };
        let volume = load(path("ybr-u8.dcm"), &options).unwrap();
        let in_memory = volume.in_memory().unwrap();
        let Samples::U8(found) = in_memory.samples() else { panic!() };
        // The reference rounds once more.
        assert!(found.iter().zip(&expected).all(|(a, b)| a.abs_diff(*b) <= 1), "{found:?} {expected:?}");
    }
}

#[test]
fn flat_colours_of_jpeg_keep_their_values() {
    for (file, channel) in
        ["baseline-ybr-u8.dcm", "baseline-rgb-u8.dcm"].into_iter().flat_map(|f| [0, 1, 2].map(|c| (f, c)))
    {
        let volume = load(path(file), &LoadOptions { channel: Some(channel), ..LoadOptions::default() }).unwrap();
        let in_memory = volume.in_memory().unwrap();
        let Samples::U8(found) = in_memory.samples() else { panic!() };
        assert_eq!(found.len(), 60);
        for (n, value) in found.iter().enumerate() {
            let z = n as u8 / 12;
            let expected = [50 * z + 3, 200 - 40 * z, 90][channel as usize];
            assert!(value.abs_diff(expected) <= 2, "{file}, channel {channel}, sample {n}: {value}, not {expected}");
        }
    }
}

#[test]
fn a_series_is_what_its_volumes_are_one_by_one() {
    let dir = tempfile::tempdir().unwrap();
    // Compressed as a whole, after a header, in a separate file, and not at all; one stays in its file.
    let whole = std::fs::read(path("times-i16.nii")).unwrap();
    let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    std::io::Write::write_all(&mut gzip, &whole).unwrap();
    let gzip = gzip.finish().unwrap();
    std::fs::write(dir.path().join("times.nii.gz"), &gzip).unwrap();
    // Its end is lost: the part before is still read.
    std::fs::write(dir.path().join("cut.nii.gz"), &gzip[..gzip.len() - 4]).unwrap();
    let files = [
        dir.path().join("times.nii.gz"),
        dir.path().join("cut.nii.gz"),
        path("sequence.nrrd").into(),
        path("five-f32.nii.gz").into(),
        path("times-f32.mha").into(),
        path("space-time.nrrd").into(),
    ];
    for file in files {
        for stream_over in [0, 1 << 20] {
            let options = LoadOptions { stream_over, channel: Some(0), ..LoadOptions::default() };
            let mut series = TimeSeries::new(&file, &options);
            for time in [1, 2, 0, 1] {
                let single = load(&file, &LoadOptions { time: Some(time), ..options }).unwrap();
                let volume = series.volume(time).unwrap();
                assert_eq!(volume.in_memory().unwrap().samples(), single.in_memory().unwrap().samples(), "{file:?}");
                assert_eq!((volume.grid(), volume.contents()), (single.grid(), single.contents()), "{file:?}");
            }
            let error = series.volume(3).unwrap_err().to_string();
            assert!(error.starts_with("time: 3, but "), "{error}");
            assert_eq!(series.channel(1, 0).unwrap().contents().time, 1);
        }
    }
    // A decompressed volume no longer needs the file, and a prepared scene no longer needs the series.
    let file = dir.path().join("times.nii.gz");
    let mut series = TimeSeries::new(&file, &LoadOptions { stream_over: 0, ..LoadOptions::default() });
    let first = series.volume(0).unwrap();
    assert!(first.is_streamed());
    std::fs::write(&file, [&gzip[..gzip.len() / 2], &[0; 20]].concat()).unwrap();
    assert_eq!(series.volume(2).unwrap().in_memory().unwrap().samples(), &shifted("i16", 0, 2));
    drop(series);
    assert_eq!(first.in_memory().unwrap().samples(), &shifted("i16", 0, 0));
}

#[test]
fn what_hdf5_and_netcdf_state_and_a_volume_cannot_keep_is_said() {
    for options in [LoadOptions::default(), LoadOptions { spacing: Some([1.0; 3]), ..LoadOptions::default() }] {
        let noted = |file: &str| load(path(file), &options).unwrap().contents().notes.join(";");
        let said = |note: &str| if options.spacing.is_none() { note.to_owned() } else { String::new() };
        let taken = "samples are taken to be 1 apart unless a spacing is given";
        assert_eq!(noted("uneven.nc"), said(&format!("coordinates of z are 1.0000 to 4.0000 apart: {taken}")));
        assert_eq!(noted("unlike.nc"), said(&format!("coordinates are x in m, y in m, z in hPa: {taken}")));
        assert_eq!(noted("classic-i16.nc"), "");
        assert_eq!(noted("no-coordinates.nc"), "");
    }
    for file in ["half.h5", "half.h5:/raw/scan"] {
        let error = load(path(file), &LoadOptions::default()).unwrap_err().to_string();
        assert!(
            error.ends_with("half.h5: /raw/scan has 16-bit floats, which are not read: convert it to f32"),
            "{error}"
        );
    }
}

#[test]
fn data_of_hdf5_that_is_not_read_is_refused_in_the_words_of_users() {
    let refused = |file: &str, words: &str| {
        let error = load(path(file), &LoadOptions::default()).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    };
    refused("lzf.h5", "lzf.h5: /samples is compressed by LZF, which is not read: repack it by h5repack");
    refused("virtual.h5", "virtual.h5: holds a virtual data set, a view of samples elsewhere, which is not read");
    // Booleans are an enumeration.
    let samples = read("bool.h5").in_memory().unwrap().samples().clone();
    assert_eq!(samples, Samples::I8((0..60).map(|n| i8::from(n % 3 == 0)).collect()));
    // The active scalars are the default among the arrays of an image of VTK.
    let other = load(path("points-f32.vtkhdf") + ":/VTKHDF/PointData/other", &LoadOptions::default()).unwrap();
    assert_eq!(other.in_memory().unwrap().samples(), &Samples::F32(vec![0.0; 60]));
    assert_eq!(affine(&other), affine(&read("points-f32.vtkhdf")));
}

#[test]
fn slices_with_maps_of_their_own_become_values() {
    let folder = folder_of(&["ct-a.dcm", "ct-b.dcm", "ct-c.dcm", "ct-d.dcm", "ct-e.dcm"]);
    let file = folder.path().join("ct-c.dcm");
    let mut bytes = std::fs::read(&file).unwrap();
    let at = bytes.windows(4).rposition(|window| window == b"0.5 ").unwrap();
    bytes[at..at + 4].copy_from_slice(b"0.25");
    std::fs::write(&file, bytes).unwrap();
    let volume = load(folder.path(), &LoadOptions::default()).unwrap();
    let Samples::I16(stored) = samples("i16") else { panic!() };
    let expected = stored.iter().enumerate().map(|(n, &s)| f32::from(s) * if n < 12 { 0.25 } else { 0.5 } - 1000.0);
    assert_eq!(volume.in_memory().unwrap().samples(), &Samples::F32(expected.collect()));
    assert_eq!(volume.rescale(), (1.0, 0.0));
}

#[test]
fn bits_beside_the_pixels_are_masked() {
    let volume = read("bits-u8.dcm");
    let Samples::U8(bytes) = samples("u8") else { panic!() };
    assert_eq!(volume.in_memory().unwrap().samples(), &Samples::U16(bytes.into_iter().map(u16::from).collect()));
}

#[test]
fn bare_samples_are_read_as_the_options_say() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("samples.raw");
    let name = file.to_str().unwrap();
    let mut options =
        LoadOptions { dims: Some([3, 4, 5]), sample_type: Some(SampleType::I16), ..LoadOptions::default() };

    let Samples::I16(numbers) = samples("i16") else { panic!() };
    std::fs::write(&file, numbers.iter().flat_map(|n| n.to_le_bytes()).collect::<Vec<u8>>()).unwrap();
    let volume = load(name, &options).unwrap();
    assert_eq!(volume.in_memory().unwrap().samples(), &samples("i16"));
    assert!(!volume.is_oriented());
    assert_affine(&volume, &[[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]], "default spacing");

    let big = [b"header!".to_vec(), numbers.iter().flat_map(|n| n.to_be_bytes()).collect()].concat();
    std::fs::write(&file, big).unwrap();
    options = LoadOptions { endian: Some(Endian::Big), offset: 7, spacing: Some([0.5, 0.75, 2.0]), ..options };
    let volume = load(name, &options).unwrap();
    assert_eq!(volume.in_memory().unwrap().samples(), &samples("i16"));
    assert_eq!(volume.grid().spacing(), [0.5, 0.75, 2.0]);
}

#[test]
fn a_given_spacing_replaces_the_headers_and_keeps_its_directions() {
    let options = LoadOptions { spacing: Some([1.0, 10.0, 100.0]), ..LoadOptions::default() };
    for file in ["raw-u8.mha", "raw-u8.nii", "qform.nii", "gzip-i8.nrrd", "raw-u8.nrrd", "raw-u8.npy"] {
        let (before, after) = (read(file), load(path(file), &options).unwrap());
        let spacing = after.grid().spacing();
        for (found, expected) in spacing.iter().zip([1.0, 10.0, 100.0]) {
            assert!((found / expected - 1.0).abs() < 1e-14, "{file}: {spacing:?}");
        }
        let (b, a) = (before.grid().to_world(), after.grid().to_world());
        assert_eq!(a.translation, b.translation, "{file}");
        for axis in 0..3 {
            let turned = a.matrix3.col(axis).normalize().dot(b.matrix3.col(axis).normalize());
            assert!(turned > 1.0 - 1e-12, "{file}: axis {axis}");
        }
    }
    // Without a form, nibabel centres the lattice: it stays centred.
    let volume = load(path("no-form.nii"), &options).unwrap();
    assert!(volume.grid().center().length() < 1e-12);
}

#[test]
fn units_are_those_that_the_header_states() {
    let folder = tempfile::tempdir().unwrap();
    let units = |name: &str, bytes: &[u8]| {
        let file = folder.path().join(name);
        std::fs::write(&file, bytes).unwrap();
        let volume = load(&file, &LoadOptions::default()).unwrap();
        (volume.length_unit().map(str::to_owned), volume.value_unit().map(str::to_owned))
    };
    let some = |unit: &str| Some(unit.to_owned());
    let bytes = |file: &str| std::fs::read(path(file)).unwrap();
    // Codes of NIfTI-1; the higher bits are of time.
    for (code, unit) in [(1, some("m")), (2 | 8, some("mm")), (3, some("µm")), (0, None)] {
        let mut nifti = bytes("no-form.nii");
        nifti[123] = code;
        assert_eq!(units("a.nii", &nifti), (unit, None), "{code}");
    }
    // The intent code of NIfTI-1 and of NIfTI-2: which statistic values are.
    for (code, unit) in [(2, some("r")), (3, some("t")), (4, some("F")), (5, some("z")), (0, None), (1007, None)] {
        for (file, at) in [("no-form.nii", 68), ("nifti2-i16.nii", 504)] {
            let mut nifti = bytes(file);
            nifti[at..at + 2].copy_from_slice(&i16::to_le_bytes(code));
            assert_eq!(units("a.nii", &nifti).1, unit, "{file}, {code}");
        }
    }
    let nrrd = |lines: &str| {
        let text = format!("NRRD0005\ntype: uint8\ndimension: 3\nsizes: 1 2 1\nencoding: raw\n{lines}\n\n");
        units("a.nrrd", &[text.as_bytes(), &[1, 2]].concat())
    };
    assert_eq!(nrrd("spacings: 1 1 1"), (None, None));
    assert_eq!(nrrd("units: \"um\" \"um\" \"um\"\nsample units: \"HU\""), (some("um"), some("HU")));
    assert_eq!(nrrd("units: \"um\" \"um\" \"mm\"\nsample units: ???"), (None, None));
    let space = "space: LPS\nspace directions: (1,0,0) (0,1,0) (0,0,1)\nsample units: g/cm³";
    assert_eq!(nrrd(space), (some("mm"), some("g/cm³")));
    assert_eq!(nrrd(&format!("{space}\nspace units: \"cm\" \"cm\" \"cm\"")).0, some("cm"));
    let mha = String::from_utf8(bytes("text-f32.mha")).unwrap();
    assert_eq!(units("a.mha", mha.replace("NDims", "DistanceUnits = um\nNDims").as_bytes()).0, some("um"));
}

#[test]
fn content_decides_before_the_name_does() {
    let folder = tempfile::tempdir().unwrap();
    for (file, name) in
        [("raw-i16.nrrd", "a.nii"), ("raw-i16.nii", "b"), ("raw-i16.mha", "c.raw"), ("raw-i16.npy", "d.mha")]
    {
        let copy = folder.path().join(name);
        std::fs::copy(path(file), &copy).unwrap();
        let volume = load(copy.to_str().unwrap(), &LoadOptions::default()).unwrap();
        assert_eq!(volume.in_memory().unwrap().samples(), &samples("i16"), "{file} as {name}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_file_name_need_not_be_utf_8() {
    use std::os::unix::ffi::OsStrExt;
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join(std::ffi::OsStr::from_bytes(b"scan-\xff.nii.gz"));
    std::fs::copy(path("raw-i16.nii"), &copy).unwrap();
    let volume = load(&copy, &LoadOptions::default()).unwrap();
    assert_eq!(volume.in_memory().unwrap().samples(), &samples("i16"));
}

#[test]
fn a_volume_is_made_of_a_slice_of_every_type() {
    macro_rules! each {
        ($($variant:ident $t:ty),+) => { $({
            let values: Vec<$t> = (0..24).map(|n| n as $t).collect();
            let volume = Volume::from_slice([4, 3, 2], [1.0, 2.0, 3.0], &values).unwrap();
            assert_eq!(volume.sample_type(), SampleType::$variant);
            assert_eq!(volume.in_memory().unwrap().samples(), &Samples::$variant(values));
            assert_eq!(volume.grid().spacing(), [1.0, 2.0, 3.0]);
        })+ };
    }
    each!(U8 u8, I8 i8, U16 u16, I16 i16, U32 u32, I32 i32, U64 u64, I64 i64, F32 f32, F64 f64);
    let error = Volume::from_slice([4, 3, 2], [1.0; 3], &[0_u8; 23]).unwrap_err().to_string();
    assert_eq!(error, "volume: 23 samples for a lattice of 4 x 3 x 2 = 24");
    for (dims, spacing, expected) in [
        ([0, 1, 1], [1.0; 3], "dimension 1 is 0, expected 1 to 65535"),
        ([1, 1, 65_536], [1.0; 3], "dimension 3 is 65536, expected 1 to 65535"),
        ([1, 1, 1], [1.0, 0.0, 1.0], "do not span space (spacing 1 x 0 x 1)"),
    ] {
        let error = Volume::from_slice(dims, spacing, &[0_u8]).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn non_finite_samples_are_left_out_or_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("nan.raw");
    let name = file.to_str().unwrap();
    let numbers = [1.0_f32, f32::NAN, 2.0, f32::INFINITY, f32::NEG_INFINITY, 3.0, 4.0, 5.0];
    std::fs::write(&file, numbers.iter().flat_map(|n| n.to_le_bytes()).collect::<Vec<u8>>()).unwrap();
    let options = LoadOptions { dims: Some([2; 3]), sample_type: Some(SampleType::F32), ..LoadOptions::default() };
    let volume = load(name, &options).unwrap();
    let note = "nothing is drawn of 3 of 8 samples because they are NaN or infinite";
    assert_eq!(volume.contents().notes, [note]);
    let counted = voxsplat::volume::Statistics::of(&volume).unwrap();
    assert_eq!((counted.count, counted.min, counted.max, counted.mean), (5, 1.0, 5.0, 3.0));
    // Of nothing else there is no picture.
    std::fs::write(&file, [f32::NAN.to_le_bytes(); 8].concat()).unwrap();
    let message = load(name, &options).unwrap_err().to_string();
    assert!(message.contains("8 samples are NaN or infinite, the first at (0, 0, 0)"), "{message}");
    std::fs::write(&file, numbers.iter().flat_map(|n| n.to_le_bytes()).collect::<Vec<u8>>()).unwrap();
    let volume = load(name, &LoadOptions { replace_nan: Some(-1.5), ..options }).unwrap();
    assert_eq!(volume.in_memory().unwrap().samples(), &Samples::F32(vec![1.0, -1.5, 2.0, -1.5, -1.5, 3.0, 4.0, 5.0]));
    let error = load(name, &LoadOptions { replace_nan: Some(f64::NAN), ..options }).unwrap_err().to_string();
    assert_eq!(error, "replace_nan: NaN, expected a finite number");
}

#[test]
fn sample_types_have_the_common_names() {
    let names = [
        ("u8", SampleType::U8),
        ("uint8", SampleType::U8),
        ("unsigned char", SampleType::U8),
        ("uchar", SampleType::U8),
        ("int16_t", SampleType::I16),
        ("short", SampleType::I16),
        ("SHORT INT", SampleType::I16),
        ("uint16", SampleType::U16),
        ("int", SampleType::I32),
        ("unsigned  int", SampleType::U32),
        ("long long", SampleType::I64),
        ("uint64", SampleType::U64),
        ("float", SampleType::F32),
        ("float32", SampleType::F32),
        ("double", SampleType::F64),
    ];
    for (name, expected) in names {
        assert_eq!(name.parse::<SampleType>().unwrap(), expected, "{name}");
    }
    for sample_type in SampleType::ALL {
        assert_eq!(sample_type.to_string().parse::<SampleType>().unwrap(), sample_type);
    }
    for name in ["", "long", "u128", "f16", "complex"] {
        let error = name.parse::<SampleType>().unwrap_err().to_string();
        assert!(error.contains(&format!("{name:?} is not a sample type")), "{error}");
    }
    assert_eq!("MSB".parse::<Endian>().unwrap(), Endian::Big);
    assert_eq!("middle".parse::<Endian>().unwrap_err().to_string(), "endian: \"middle\", expected little or big");
}
