//! Pictures of the f64 reference, integrated once and cached under `target/truth`.
//!
//! The key of a cached picture is a hash of all its inputs: the reference's sources, the samples, the transfer
//! function, the camera and the settings that the reference uses. `target/truth` can be deleted at any time.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use voxsplat::camera::Camera;
use voxsplat::image::Image;
use voxsplat::reference::Reference;
use voxsplat::settings::Settings;
use voxsplat::transfer::TransferFunction;
use voxsplat::volume::Volume;

use crate::root;

/// Files or folders of `src/` on which the reference's pictures depend, without their extensions.
const SOURCES: [&str; 9] = [
    "src/camera",
    "src/kernel",
    "src/layers",
    "src/lighting",
    "src/reference",
    "src/settings/response",
    "src/transfer/mod",
    "src/transfer/gradient",
    "crates/volume/src/volume",
];

/// The picture that the reference integrates.
pub(crate) fn truth(volume: &Volume, transfer: &TransferFunction, camera: &Camera, settings: &Settings) -> Image {
    kept(&folder(), key(volume, transfer, camera, settings), camera.size, || {
        Reference::new(volume, transfer, settings).and_then(|reference| reference.render(camera)).unwrap()
    })
}

/// The hash of Fowler, Noll and Vo (FNV-1a) of 128 bits: the same on every machine and with every compiler.
#[derive(Clone, Copy)]
struct Hash(u128);

impl Hash {
    const NEW: Self = Self(0x6c62_272e_07bb_0142_62b8_2175_6295_c58d);

    fn add(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u128::from(*byte)).wrapping_mul(0x0100_0000_0000_0000_0000_013b);
        }
    }
}

/// The hash of the reference's sources.
static SOURCES_HASH: LazyLock<Hash> = LazyLock::new(|| {
    let root = root();
    let mut hash = Hash::NEW;
    for source in SOURCES {
        let file = root.join(source).with_extension("rs");
        let mut files = if file.exists() { vec![file] } else { rust_files(&root.join(source)) };
        assert!(!files.is_empty(), "there is neither {source}.rs nor a folder {source}: correct SOURCES");
        files.sort();
        for file in files {
            hash.add(&fs::read(file).unwrap());
        }
    }
    hash
});

/// The Rust files in a folder, except tests.
fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let paths = entries.map(|entry| entry.unwrap().path()).filter(|path| !path.ends_with("tests"));
    paths
        .flat_map(|path| match path {
            folder if folder.is_dir() => rust_files(&folder),
            file if file.extension().is_some_and(|e| e == "rs") => vec![file],
            _ => Vec::new(),
        })
        .collect()
}

fn key(volume: &Volume, transfer: &TransferFunction, camera: &Camera, settings: &Settings) -> u128 {
    let mut hash = *SOURCES_HASH;
    let memory = volume.in_memory().unwrap();
    for index in 0..volume.grid().len() as usize {
        hash.add(&memory.value(index).to_bits().to_le_bytes());
    }
    // Numbers are written with enough digits to distinguish them.
    let Settings {
        model,
        response,
        depth_coded,
        attenuation,
        shading,
        lighting,
        antialiasing,
        kernel,
        normalization,
        sharpness,
        clip,
        ..
    } = settings;
    let model =
        (model, response, depth_coded, attenuation, shading, lighting, antialiasing, kernel, normalization, sharpness);
    hash.add(format!("{:?} {transfer:?} {camera:?} {model:?} {clip:?}", volume.grid()).as_bytes());
    hash.0
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("truth")
}

/// The picture cached in `folder` as `key`; made and cached now if it is missing, truncated or damaged.
fn kept(folder: &Path, key: u128, [width, height]: [u32; 2], make: impl FnOnce() -> Image) -> Image {
    let path = folder.join(format!("{key:032x}"));
    let pixels = fs::read(&path).ok().and_then(|bytes| decode(&bytes));
    if let Some(image) = pixels.and_then(|pixels| Image::new(width, height, pixels).ok()) {
        return image;
    }
    let image = make();
    fs::create_dir_all(folder).unwrap();
    // Renamed when it is complete, because tests in other threads and processes may read it.
    let mut file = tempfile::NamedTempFile::new_in(folder).unwrap();
    file.write_all(&encode(image.pixels())).unwrap();
    file.persist(path).unwrap();
    image
}

/// Values as f32, the lowest byte first, and their hash.
fn encode(pixels: &[[f32; 4]]) -> Vec<u8> {
    let mut bytes: Vec<u8> = pixels.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
    let mut hash = Hash::NEW;
    hash.add(&bytes);
    bytes.extend(hash.0.to_le_bytes());
    bytes
}

fn decode(bytes: &[u8]) -> Option<Vec<[f32; 4]>> {
    let (bytes, expected) = bytes.split_last_chunk::<16>()?;
    let mut hash = Hash::NEW;
    hash.add(bytes);
    if hash.0.to_le_bytes() != *expected {
        return None;
    }
    let value = |pixel: &[u8], c: usize| f32::from_le_bytes([0, 1, 2, 3].map(|byte| pixel[4 * c + byte]));
    Some(bytes.chunks_exact(16).map(|pixel| [0, 1, 2, 3].map(|c| value(pixel, c))).collect())
}

#[cfg(test)]
mod tests {
    use voxsplat::camera::ProjectionKind;
    use voxsplat::clip::{Clip, Plane};
    use voxsplat::kernel::Kernel;
    use voxsplat::settings::{Model, Response};

    use super::*;
    use crate::support::{camera, demo, exact_quads, thick};

    #[test]
    fn a_damaged_file_is_made_anew() {
        let folder = tempfile::tempdir().unwrap();
        let image = Image::new(2, 1, vec![[0.5, 1e-9, -3.0, 1.0], [f32::MAX, 0.0, 0.25, 0.75]]).unwrap();
        let other = Image::transparent(2, 1).unwrap();
        let ask = |make: &Image| kept(folder.path(), 7, [2, 1], || make.clone());
        let path = folder.path().join(format!("{:032x}", 7));
        assert_eq!(ask(&image), image);
        assert_eq!(ask(&other), image, "kept");
        let whole = fs::read(&path).unwrap();
        let mut changed = whole.clone();
        changed[3] ^= 1;
        for damaged in [&[][..], &whole[..whole.len() - 1], &whole[..16], &changed] {
            fs::write(&path, damaged).unwrap();
            assert_eq!(ask(&other), other);
            assert_eq!(ask(&image), other, "kept");
        }
        assert_eq!(kept(folder.path(), 7, [1, 1], || Image::transparent(1, 1).unwrap()).pixels().len(), 1);
    }

    #[test]
    fn what_decides_a_picture_decides_its_key() {
        let (volume, transfer) = demo("sphere", 8);
        let settings = exact_quads();
        let seen = camera(10.0, ProjectionKind::Orthographic, &volume, 8);
        let expected = key(&volume, &transfer, &seen, &settings);
        // The reference has no sheets.
        assert_eq!(key(&volume, &transfer, &seen, &thick(&settings, 3.0)), expected);
        let (other, other_transfer) = demo("vessels", 8);
        let plane = Plane::new(glam::DVec3::X, 0.5).unwrap();
        let turned = camera(10.0 + 1e-12, ProjectionKind::Orthographic, &volume, 8);
        let keys = [
            key(&other, &transfer, &seen, &settings),
            key(&volume, &other_transfer, &seen, &settings),
            key(&volume, &transfer, &turned, &settings),
            key(&volume, &transfer, &Camera { size: [8, 9], ..seen }, &settings),
            key(&volume, &transfer, &seen, &Settings { model: Model::Xray, ..settings.clone() }),
            key(&volume, &transfer, &seen, &Settings { response: Response::FILM, ..settings.clone() }),
            key(&volume, &transfer, &seen, &Settings { kernel: Kernel::KAISER_BESSEL, ..settings.clone() }),
            key(&volume, &transfer, &seen, &Settings { sharpness: 0.5, ..settings.clone() }),
            key(&volume, &transfer, &seen, &Settings { antialiasing: false, ..settings.clone() }),
            key(&volume, &transfer, &seen, &Settings { clip: Clip::new(vec![plane]).unwrap(), ..settings }),
        ];
        assert!(keys.iter().all(|k| *k != expected));
    }
}
