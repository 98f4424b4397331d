//! FreeSurfer's .mgh, and .mgz in gzip (<https://surfer.nmr.mgh.harvard.edu/fswiki/FsTutorial/MghFormat>).
//!
//! Frames count as points in time. As in nibabel, the centre of the lattice is half of its size from the first sample.

use glam::DVec3;

use super::LoadOptions;
use super::decode::{Layout, read_all};
use super::fields::Fields;
use super::input::Input;
use super::placement::{Placement, RAS_TO_LPS};
use super::selection::{Role, picked};
use crate::error::{Result, refuse, refuse_if};
use crate::volume::{Endian, MAX_DIM, SampleType, Units, Volume};

/// The place of the first sample in a file, bytes.
const HEADER_SIZE: usize = 284;

/// The first and the last code of a sample type.
const TYPES: std::ops::RangeInclusive<i64> = 0..=10;

/// Reads bytes as numbers in big-endian order.
fn fields(bytes: &[u8]) -> Fields<'_> {
    Fields { bytes, endian: Endian::Big }
}

/// Returns whether these are the first bytes of an MGH file. It has no magic but its version 1, so all other numbers
/// have to be plausible. The bytes above the version state an intent since FreeSurfer 7.4.
pub(super) fn is_mgh(head: &[u8]) -> bool {
    let header = fields(head);
    let is_size = |at: usize| (1..=i64::from(MAX_DIM)).contains(&header.int(at, 4));
    head.len() >= HEADER_SIZE
        && head[0] == 0
        && header.int(3, 1) == 1
        && [4, 8, 12].into_iter().all(is_size)
        && header.int(16, 4) > 0
        && TYPES.contains(&header.int(20, 4))
        && (0..=1).contains(&header.int(28, 2))
}

/// Reads the volume of a header that begins here.
pub(super) fn read(mut input: Input, options: &LoadOptions) -> Result<Volume> {
    let bytes = input.bytes(HEADER_SIZE)?;
    let header = fields(&bytes);
    let path = input.path().to_owned();
    let version = header.int(0, 4);
    refuse_if!(version & 0xff != 1, input, "is not an MGH file of version 1: its version is {version}");
    let sizes = [4, 8, 12].map(|at| header.int(at, 4));
    let sample_type = sample_type(&header, &input)?;
    let placement = placement(&header, sizes);
    let grid = placement.grid(&path, &sizes, options.spacing)?;
    let [x, y, z] = sizes;
    let axes = [(Role::Space, x), (Role::Space, y), (Role::Space, z), (Role::Time, header.int(16, 4))];
    let (pick, contents) = picked(&path, &axes, options)?;
    let samples = read_all(input, &pick, sample_type, Layout::Binary(Endian::Big))?;
    let units = Units { length: Some("mm".to_owned()), value: None };
    Ok(placement.volume(grid, samples)?.with_units(units).with_contents(contents))
}

fn sample_type(header: &Fields<'_>, input: &Input) -> Result<SampleType> {
    Ok(match header.int(20, 4) {
        0 => SampleType::U8,
        1 => SampleType::I32,
        3 => SampleType::F32,
        4 => SampleType::I16,
        10 => SampleType::U16,
        other => refuse!(input, "type {other} is not read: expected 0, 1, 3, 4 or 10, one number per sample"),
    })
}

/// Returns the position of the lattice. Without its flag the header states none: then the section is coronal, its first
/// axis runs from right to left, and the centre is the origin. This is FreeSurfer's fallback; nibabel transposes its
/// directions.
fn placement(header: &Fields<'_>, sizes: [i64; 3]) -> Placement {
    let triple = |at: usize| DVec3::from_array(std::array::from_fn(|i| header.float(at + 4 * i, 4)));
    let oriented = header.int(28, 2) != 0;
    let (directions, spacing, center) = match oriented {
        true => ([42, 54, 66].map(triple), triple(30).to_array(), triple(78)),
        false => ([-DVec3::X, -DVec3::Z, DVec3::Y], [1.0; 3], DVec3::ZERO),
    };
    let half = |a: usize| directions[a] * spacing[a] * sizes[a] as f64 / 2.0;
    let origin = center - half(0) - half(1) - half(2);
    Placement { directions, spacing, origin, oriented }.flipped(RAS_TO_LPS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::load;
    use crate::volume::Samples;

    /// Makes a file of two frames of 3 x 2 x 1 samples.
    fn file(kind: i32, samples: &[u8]) -> Vec<u8> {
        let mut bytes = [1, 3, 2, 1, 2, kind, 0].map(i32::to_be_bytes).concat();
        bytes.extend(1_i16.to_be_bytes());
        // Sections from front to back, lines from head to feet.
        for number in [2.0, 3.0, 4.0, -1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0, 10.0, 20.0, 30.0_f32] {
            bytes.extend(number.to_be_bytes());
        }
        bytes.resize(HEADER_SIZE, 0);
        bytes.extend(samples);
        bytes
    }

    fn loaded(bytes: &[u8], time: u32) -> Result<Volume> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mgh");
        std::fs::write(&path, bytes).unwrap();
        load(&path, &LoadOptions { time: Some(time), ..LoadOptions::default() })
    }

    #[test]
    fn frames_are_points_in_time_around_the_stated_centre() {
        let samples: Vec<u8> = (0..12_i16).flat_map(|n| (n - 5).to_be_bytes()).collect();
        let volume = loaded(&file(4, &samples), 1).unwrap();
        assert_eq!((volume.grid().dims(), volume.contents().times), ([3, 2, 1], 2));
        assert_eq!(volume.in_memory().unwrap().samples(), &Samples::I16((1..7).collect()));
        let world = volume.grid().to_world();
        // The centre (10, 20, 30) in RAS, and from it half a lattice back, then turned to LPS.
        assert_eq!(world.translation, DVec3::new(-(10.0 + 3.0), -(20.0 - 2.0), 30.0 + 3.0));
        assert_eq!(world.matrix3.col(0), DVec3::new(2.0, 0.0, 0.0));
        assert_eq!(world.matrix3.col(1), DVec3::new(0.0, 0.0, -3.0));
        assert_eq!(world.matrix3.col(2), DVec3::new(0.0, -4.0, 0.0));
        assert!(volume.is_oriented());
    }

    #[test]
    fn a_file_without_geometry_is_coronal() {
        let mut bytes = file(0, &[7; 12]);
        bytes[29] = 0;
        let volume = loaded(&bytes, 0).unwrap();
        let world = volume.grid().to_world();
        assert_eq!(world.translation, DVec3::new(-1.5, 0.5, 1.0));
        assert_eq!(world.matrix3.col(1), DVec3::new(0.0, 0.0, -1.0));
        assert!(!volume.is_oriented());
    }

    #[test]
    fn broken_files_say_what_is_wrong() {
        let refused = |at: usize, value: &[u8], words: &str| {
            let mut bytes = file(4, &[0; 24]);
            bytes[at..at + value.len()].copy_from_slice(value);
            let error = loaded(&bytes, 0).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        };
        refused(0, &2_i32.to_be_bytes(), "its version is 2");
        refused(4, &70_000_i32.to_be_bytes(), "dimension 1 is 70000");
        refused(8, &(-1_i32).to_be_bytes(), "dimension 2 is -1");
        refused(16, &0_i32.to_be_bytes(), "has 0 points in time");
        refused(4, &[0, 0, 255, 255].repeat(3), "281462092005375 samples need 562924184010750 bytes, 24 are there");
        refused(20, &9_i32.to_be_bytes(), "type 9 is not read");
        refused(30, &f32::NAN.to_be_bytes(), "spacing of axis 1 is NaN");
        refused(42, &f32::INFINITY.to_be_bytes(), "do not span space (spacing NaN x 3 x 4)");
        let cut = file(4, &[0; 11]);
        assert!(loaded(&cut, 0).unwrap_err().to_string().contains("6 samples need 12 bytes, 11 are there"));
        assert!(loaded(&cut[..200], 0).unwrap_err().to_string().contains("its header has 200 of 284 bytes"));
    }
}
