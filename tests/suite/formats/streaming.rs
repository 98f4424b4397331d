//! Volumes that stay in their files.

use std::path::Path;

use glam::DVec3;
use voxsplat::camera::View;
use voxsplat::error::{Error, InputError};
use voxsplat::formats::{LoadOptions, load};
use voxsplat::image::Image;
use voxsplat::settings::{Model, Settings, Shading};
use voxsplat::stats::Stats;
use voxsplat::transfer::{Classification, TransferFunction};
use voxsplat::volume::{Endian, SampleType, Statistics, Volume};

use crate::support::{self, exact_quads, headlight, look, prepare_on, renderer};

/// Dimensions whose last bricks are incomplete.
const DIMS: [u32; 3] = [70, 45, 67];

/// An encoding of samples.
type Case = (SampleType, Endian, fn(i16) -> Vec<u8>);

/// Two balls far apart, 0 to 100.
fn value(x: u32, y: u32, z: u32) -> i16 {
    let ball = |center: DVec3| 1.0 - DVec3::new(x.into(), y.into(), z.into()).distance(center) / 14.0;
    (100.0 * ball(DVec3::new(15.0, 20.0, 14.0)).max(ball(DVec3::new(56.0, 25.0, 52.0))).max(0.0)) as i16
}

fn values() -> impl Iterator<Item = i16> {
    (0..DIMS[2]).flat_map(|z| (0..DIMS[1]).flat_map(move |y| (0..DIMS[0]).map(move |x| value(x, y, z))))
}

fn transfer(from: f64) -> TransferFunction {
    let points = [(from, [0.9, 0.5, 0.2], 0.0), (from + 40.0, [0.9, 0.5, 0.2], 0.3)];
    support::transfer(&points, None).with_classification(Classification::Point)
}

fn open(path: &Path, sample_type: SampleType, endian: Endian, stream_over: u64) -> Result<Volume, InputError> {
    let options = LoadOptions {
        dims: Some(DIMS),
        sample_type: Some(sample_type),
        endian: Some(endian),
        offset: 5,
        stream_over,
        ..LoadOptions::default()
    };
    load(path.to_str().unwrap(), &options)
}

/// Writes the values behind five bytes of header.
fn write(path: &Path, bytes: impl Fn(i16) -> Vec<u8>) {
    let samples = values().flat_map(bytes);
    std::fs::write(path, [1, 2, 3, 4, 5].into_iter().chain(samples).collect::<Vec<u8>>()).unwrap();
}

fn picture(volume: &Volume, settings: &Settings, size: u32) -> (Image, Stats) {
    let view = View { azimuth: 30.0, elevation: 20.0, ..View::default() };
    let rendered = support::picture(volume, &transfer(20.0), &look(&view, volume, [size; 2]), settings);
    (rendered.image, rendered.stats)
}

#[test]
fn a_streamed_volume_gives_the_same_bytes() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("v.raw");
    let cases: [Case; 4] = [
        (SampleType::U8, Endian::Little, |v| vec![v as u8]),
        (SampleType::I16, Endian::Big, |v| v.to_be_bytes().to_vec()),
        (SampleType::F32, Endian::Little, |v| f32::from(v).to_le_bytes().to_vec()),
        (SampleType::U64, Endian::Big, |v| (v as u64).to_be_bytes().to_vec()),
    ];
    let lit = Settings { lighting: headlight(), ..exact_quads() };
    let xray = Settings { model: Model::Xray, ..exact_quads() };
    // Grown kernels reach many more scalars.
    let post = Settings { shading: Shading::Post, antialiasing: false, ..exact_quads() };
    for (number, (sample_type, endian, bytes)) in cases.into_iter().enumerate() {
        write(&path, bytes);
        let [whole, streamed] = [u64::MAX, 0].map(|over| open(&path, sample_type, endian, over).unwrap());
        assert_eq!((whole.is_streamed(), streamed.is_streamed()), (false, true));
        assert_eq!(whole.in_memory().unwrap().samples(), streamed.in_memory().unwrap().samples());
        assert_eq!(Statistics::of(&whole).unwrap(), Statistics::of(&streamed).unwrap());
        // Light and X-rays do not depend on the type of the samples.
        let count = if number == 0 { 4 } else { 2 };
        for settings in &[exact_quads(), post.clone(), lit.clone(), xray.clone()][..count] {
            let (a, b) = (picture(&whole, settings, 32), picture(&streamed, settings, 32));
            assert!(a.0.pixels() == b.0.pixels(), "{sample_type} {endian:?}");
            assert!(a.0.pixels().iter().any(|p| p[3] > 0.3));
            assert_eq!((a.1.bricks, a.1.bricks_uploaded), (b.1.bricks, b.1.bricks_uploaded));
        }
    }
}

#[test]
fn bricks_that_show_nothing_are_not_uploaded() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("v.raw");
    write(&path, |v| vec![v as u8]);
    let volume = open(&path, SampleType::U8, Endian::Little, 0).unwrap();
    let (_, stats) = picture(&volume, &exact_quads(), 16);
    // 3 x 2 x 3 bricks of 32 KiB; each ball lies in a few of them.
    assert_eq!(stats.bricks, 18);
    assert!((2..=10).contains(&stats.bricks_uploaded), "{}", stats.bricks_uploaded);
    assert_eq!(stats.bytes_uploaded, u64::from(stats.bricks_uploaded) << 15);
    let visible = values().filter(|v| *v > 20).count() as u64;
    assert_eq!(stats.splats_kept, visible);
    // 16 bytes per listed splat, and 16 for the place of each brick; samples, and 8 bytes for each of their rows. Some
    // words more for all bricks of the volume.
    let bricks = u64::from(stats.bricks_uploaded);
    let bytes = 16 * (visible + bricks) + (bricks << 15) + 8 * 1024 * bricks;
    assert!((bytes..bytes + 256).contains(&stats.scene_bytes), "{} of {bytes}", stats.scene_bytes);
}

#[test]
fn another_transfer_function_reads_only_what_it_shows() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("v.raw");
    write(&path, |v| vec![v as u8]);
    let volume = open(&path, SampleType::U8, Endian::Little, 0).unwrap();
    let prepare = |from| prepare_on(&renderer(), &volume, &transfer(from), &exact_quads());
    prepare(20.0).unwrap();
    let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
    file.set_len(5).unwrap();
    assert!(prepare(200.0).is_ok(), "nothing shows, so nothing is read");
    match prepare(20.0) {
        Err(Error::Input(InputError::Read { path: named, .. })) => assert_eq!(named, path),
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("read a file that is gone"),
    }
}

#[test]
fn streamed_samples_that_are_not_finite_are_left_out_or_replaced() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("v.raw");
    write(&path, |v| (if v == 50 { f32::NAN } else { f32::from(v) }).to_le_bytes().to_vec());
    let volume = open(&path, SampleType::F32, Endian::Little, 0).unwrap();
    let (gaps, all) = (values().filter(|v| *v == 50).count(), volume.grid().len());
    let note = format!("nothing is drawn of {gaps} of {all} samples because they are NaN or infinite");
    assert_eq!((volume.is_streamed(), &volume.contents().notes), (true, &vec![note]));
    let counted = Statistics::of(&volume).unwrap();
    assert_eq!((counted.non_finite, volume.value_range().unwrap()), (gaps as u64, [counted.min, counted.max]));
    let filled = volume.clone().with_non_finite_replaced(20.0).unwrap();
    let drawn = |volume: &Volume| picture(volume, &exact_quads(), 24).0;
    assert!(drawn(&volume) == drawn(&filled), "20 is the base of the transfer function");
    let options = LoadOptions {
        dims: Some(DIMS),
        sample_type: Some(SampleType::F32),
        offset: 5,
        replace_nan: Some(7.0),
        stream_over: 0,
        ..LoadOptions::default()
    };
    let volume = load(path.to_str().unwrap(), &options).unwrap();
    let index = values().position(|v| v == 50).unwrap();
    assert_eq!(volume.in_memory().unwrap().value(index), 7.0);
}
