//! NIfTI-1 and NIfTI-2, single files and pairs, of either byte order
//! (<https://nifti.nimh.nih.gov/pub/dist/src/niftilib/nifti1.h>, `nifti2.h` beside it).
//!
//! The crate `nifti` 0.18 is not used: it does not read NIfTI-2 (its dimensions are u16), recognises gzip by the file's
//! name, reserves the memory that a header claims before it has seen the data, and needs nalgebra for affines. If a
//! header is ambiguous, this reader does as nibabel does.
//!
//! Lengths stay in the unit of the file: `xyzt_units` names it and is not applied, so a file in metres is not scaled to
//! millimetres.

mod header;
pub(super) mod intent;

use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};

use self::header::NiftiHeader;
pub(super) use self::header::{HEADER_SIZE, is_analyze, is_nifti};
use super::decode::{Layout, read_all};
use super::input::Input;
use super::pair::{existing, has_extension, with_extension};
use super::placement::{Placement, RAS_TO_LPS, lengths};
use super::selection::{Axes, Role, colours, picked, spatial};
use super::{LoadOptions, complex};
use crate::error::{Result, refuse, refuse_if};
use crate::volume::{Origin, SampleType, Units, Volume};

/// Reads the volume of a header at the start of `input`.
pub(super) fn read(mut input: Input, options: &LoadOptions) -> Result<Volume> {
    let header = NiftiHeader::read(&mut input)?;
    let path = input.path().to_owned();
    let (sample_type, in_voxel) = sample_type(&header, &input)?;
    let is_complex = COMPLEX.contains(&header.datatype);
    let mut axes = axes(&header, &input, in_voxel)?;
    let sizes = spatial(&axes);
    let (slope, intercept) = rescale(&header, &input)?;
    let mut notes = Vec::new();
    let placement = placement(&header, &input, &sizes, options.spacing, &mut notes)?;
    let grid = placement.grid(&path, &sizes, options.spacing)?;
    if is_complex {
        axes[0].0 = complex::role(&path, options)?;
    }
    let (pick, mut contents) = picked(&path, &axes, options)?;
    contents.notes = notes;
    if in_voxel > 1 && !is_complex {
        contents.labels = colours(contents.channels);
    }

    contents.segments = intent::are_labels(header.intent_code).then(Vec::new);
    contents.origin = Origin::of(modality(&header), [header.descrip.as_str(), header.intent_name.as_str()]);
    contents.origin.intent = intent::meaning(header.intent_code, &header.intent_p);

    // The offset is a float in NIfTI-1; under 9e15, a little under 2^53, it is exact.
    let offset = header.vox_offset;
    if !(offset >= 0.0 && offset.fract() == 0.0 && offset < 9e15) {
        refuse!(input, "vox_offset is {offset}, expected a whole number of bytes");
    }
    let offset = offset as u64;
    let input = if header.single_file {
        let read = header.size as u64;
        // Four bytes after the header say whether extensions follow, so data begin behind them. 0 means right there.
        let first = if offset == 0 { read + 4 } else { offset };
        refuse_if!(first < read + 4, input, "vox_offset is {offset}, inside the header");
        input.skip(first - read)?;
        input
    } else {
        let mut data = Input::open(&image_file(&path, &input)?, input.unpacked())?;
        data.skip(offset)?;
        data
    };
    let samples = read_all(input, &pick, sample_type, Layout::Binary(header.endian))?;
    let samples = if is_complex { complex::part(samples, &path, options)? } else { samples };
    let length = match header.xyzt_units & 7 {
        1 => Some("m"),
        2 => Some("mm"),
        3 => Some("µm"),
        _ => None,
    };
    // SPM states no intent.
    let value = intent::unit(header.intent_code).or(header.descrip.starts_with("SPM{T").then_some("t"));
    let units = Units { length: length.map(str::to_owned), value: value.map(str::to_owned) };
    Ok(placement.volume(grid, samples)?.with_rescale(slope, intercept)?.with_units(units).with_contents(contents))
}

/// Returns MR if the header has axes of frequency or phase, or an echo time as dcm2niix writes it.
fn modality(header: &NiftiHeader) -> Option<&'static str> {
    let has_echo = header.descrip.split(';').any(|field| field.trim_start().starts_with("TE="));
    (header.dim_info & 0b1111 != 0 || has_echo).then_some("MR")
}

/// Returns the file with the samples of the header at the start of `input`, if it is another file.
pub(super) fn named_files(mut input: Input) -> Result<Vec<PathBuf>> {
    let header = NiftiHeader::read(&mut input)?;
    if header.single_file { Ok(Vec::new()) } else { Ok(vec![image_file(input.path(), &input)?]) }
}

/// The types of samples by their codes, and the number of samples in a voxel.
const DATATYPES: [(i16, SampleType, i64); 14] = [
    (2, SampleType::U8, 1),
    (4, SampleType::I16, 1),
    (8, SampleType::I32, 1),
    (16, SampleType::F32, 1),
    (64, SampleType::F64, 1),
    (256, SampleType::I8, 1),
    (512, SampleType::U16, 1),
    (768, SampleType::U32, 1),
    (1024, SampleType::I64, 1),
    (1280, SampleType::U64, 1),
    // Colours.
    (128, SampleType::U8, 3),
    (2304, SampleType::U8, 4),
    // Complex numbers.
    (32, SampleType::F32, 2),
    (1792, SampleType::F64, 2),
];

/// The codes of complex numbers.
const COMPLEX: [i16; 2] = [32, 1792];

/// Returns the type of the samples, and the number of them in a voxel.
fn sample_type(header: &NiftiHeader, input: &Input) -> Result<(SampleType, i64)> {
    if let Some((_, sample_type, in_voxel)) = DATATYPES.iter().find(|(code, ..)| *code == header.datatype) {
        return Ok((*sample_type, *in_voxel));
    }
    let refused = match header.datatype {
        1 => "bits",
        2048 => "complex numbers of 128-bit floats",
        1536 => "128-bit floats",
        other => refuse!(input, "datatype {other} is unknown"),
    };
    refuse!(input, "its samples are {refused}: convert it to integers or floats, one number per voxel")
}

/// Returns the axes of the samples: colours are beside each other, the fourth axis is time and the fifth has channels.
fn axes(header: &NiftiHeader, input: &Input, colours: i64) -> Result<Axes> {
    let n = header.dim[0];
    refuse_if!(!(1..=7).contains(&n), input, "dim[0] is {n}, expected 1 to 7 axes");
    let mut axes = vec![(Role::Channel, colours)];
    for axis in 1..=n as usize {
        // Unused axes are 1; some writers leave them 0.
        let size = if axis > 3 && header.dim[axis] == 0 { 1 } else { header.dim[axis] };
        let is_extra = axis > 5 && size != 1;
        refuse_if!(is_extra, input, "dim[{axis}] is {size}, expected at most 5 axes: space, time and channels");
        let role = match axis {
            ..=3 => Role::Space,
            4 => Role::Time,
            _ => Role::Channel,
        };
        axes.push((role, size));
    }
    Ok(axes)
}

/// Returns the map from stored numbers to values. A slope that is 0 or not finite means that there is none.
fn rescale(header: &NiftiHeader, input: &Input) -> Result<(f64, f64)> {
    let (slope, intercept) = (header.scl_slope, header.scl_inter);
    if slope == 0.0 || !slope.is_finite() {
        return Ok((1.0, 0.0));
    }
    refuse_if!(!intercept.is_finite(), input, "scl_inter is {intercept}, but scl_slope is {slope}");
    Ok((slope, intercept))
}

/// Returns the position of the lattice: the sform if it has a code, else the qform if it has one. Otherwise the lattice
/// is centred on the origin and its first axis runs from right to left. This is nibabel's order and its fallback. As in
/// ITK, an sform whose columns do not span space counts as none: some programs leave it zero.
fn placement(
    header: &NiftiHeader,
    input: &Input,
    sizes: &[i64],
    given: Option<[f64; 3]>,
    notes: &mut Vec<String>,
) -> Result<Placement> {
    let [x, y, z] = header.srow;
    let column = |c: usize| DVec3::new(x[c], y[c], z[c]);
    let directions = [column(0), column(1), column(2)];
    let unit = directions.map(DVec3::normalize_or_zero);
    let spans = DMat3::from_cols(unit[0], unit[1], unit[2]).determinant().abs() > FLATTEST;
    if header.sform_code != 0 && !spans {
        let used = if header.qform_code != 0 { "the qform" } else { "spacings alone" };
        notes.push(format!("using {used} because the axes of the sform do not span space"));
    } else if header.sform_code != 0 {
        let sform = Placement { directions, spacing: [1.0; 3], origin: column(3), oriented: true };
        return Ok(sform.flipped(RAS_TO_LPS));
    }
    // As in nibabel and ITK. An axis of one sample needs no length.
    let spacing = lengths(header.spacing(), given, notes, |axis, stated| match stated {
        0.0 if sizes.get(axis).is_none_or(|size| *size == 1) => 0.0,
        0.0 => 1.0,
        stated if stated.is_finite() => stated.abs(),
        _ => 1.0,
    });
    let ras = if header.qform_code != 0 {
        let rotation = rotation(header, input)?;
        // Only -1 mirrors. All other values, most often 0, mean 1.
        let qfac = if header.pixdim[0] == -1.0 { -1.0 } else { 1.0 };
        Placement {
            directions: [rotation.x_axis, rotation.y_axis, rotation.z_axis * qfac],
            spacing,
            origin: DVec3::from_array(header.qoffset),
            oriented: true,
        }
    } else {
        let used = given.unwrap_or(spacing);
        let directions = [-DVec3::X, DVec3::Y, DVec3::Z];
        let half = |a: usize| directions[a] * used[a] * (sizes.get(a).map_or(0.0, |size| *size as f64 - 1.0)) / 2.0;
        // The header does not orient the axes, so the volume does not count as oriented.
        Placement { directions, spacing, origin: -(half(0) + half(1) + half(2)), oriented: false }
    };
    Ok(ras.flipped(RAS_TO_LPS))
}

/// The least volume of the unit vectors along the axes of an sform; a smaller volume is an effect of rounding.
const FLATTEST: f64 = 1e-6;

/// Returns the rotation of the unit quaternion (a, b, c, d). The file does not store a, which is not negative.
fn rotation(header: &NiftiHeader, input: &Input) -> Result<DMat3> {
    let [b, c, d] = header.quatern;
    let a2 = 1.0 - (b * b + c * c + d * d);
    // In a half turn a is 0, and rounding of b, c and d can make a^2 negative. nibabel allows three units of rounding.
    let rounding = 3.0 * if header.is_nifti2 { f64::EPSILON } else { f64::from(f32::EPSILON) };
    if a2.is_nan() || a2 <= -rounding {
        refuse!(input, "quaternion ({b}, {c}, {d}) is no rotation: its length is over 1");
    }
    let a = if a2.abs() < rounding { 0.0 } else { a2.sqrt() };
    Ok(DMat3::from_quat(DQuat::from_xyzw(b, c, d, a).normalize()))
}

/// Returns the file with the samples of a pair, from the name of its header.
fn image_file(header: &Path, input: &Input) -> Result<PathBuf> {
    existing(header, &[".img", ".img.gz", ".IMG", ".IMG.GZ"]).ok_or_else(|| {
        let expected = with_extension(header, ".img");
        input.error(format!("its samples belong in {}, which is not there", expected.display()))
    })
}

/// Returns the header of the pair that an image file belongs to, if there is one.
pub(super) fn header_of(image: &Path) -> Option<PathBuf> {
    existing(image, &[".hdr", ".hdr.gz", ".HDR"]).filter(|_| has_extension(image, &["img"]))
}
