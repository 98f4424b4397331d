//! NIfTI-1 and NIfTI-2: .nii, .nii.gz, and .hdr with .img.
//!
//! Written here because the crate `nifti` (0.18) reads neither NIfTI-2 nor a pair named by its .img, and hands samples
//! out as bytes to be copied. Field offsets: nifti1.h and nifti2.h of the NIfTI Data Format Working Group.

use std::io::Read;
use std::path::{Path, PathBuf};

use glam::{DAffine3, DMat3, DVec3};

use super::source::{Endian, Packing, SampleType, Source, malformed, open, read_full, sample_count};
use super::{Grid, Volume};
use crate::error::{Error, Result};

/// Bytes of a header, of version 1 and 2.
const SIZES: [usize; 2] = [348, 540];

/// Whether a file begins like a NIfTI header (unpacked, at least 4 bytes).
pub(super) fn looks_like(head: &[u8]) -> bool {
    version(head).is_some()
}

/// Version and byte order, from the first field, the size of the header.
fn version(head: &[u8]) -> Option<(u32, Endian)> {
    let size: [u8; 4] = head.get(..4)?.try_into().ok()?;
    let found = [(u32::from_le_bytes(size), Endian::Little), (u32::from_be_bytes(size), Endian::Big)];
    let (bytes, endian) = found.into_iter().find(|(bytes, _)| SIZES.contains(&(*bytes as usize)))?;
    let version = if bytes as usize == SIZES[0] { 1 } else { 2 };
    let magic = if version == 1 { head.get(344..348)? } else { head.get(4..8)? };
    let expected: [&[u8]; 2] = if version == 1 { [b"n+1", b"ni1"] } else { [b"n+2", b"ni2"] };
    expected.contains(&magic.get(..3)?).then_some((version, endian))
}

/// Typed fields of a header at fixed offsets.
struct Fields {
    bytes: Vec<u8>,
    endian: Endian,
}

impl Fields {
    fn at<const N: usize>(&self, offset: usize) -> [u8; N] {
        let mut field = [0; N];
        if let Some(bytes) = self.bytes.get(offset..offset + N) {
            field.copy_from_slice(bytes);
        }
        // Everything below decodes little-endian fields.
        if self.endian == Endian::Big {
            field.reverse();
        }
        field
    }

    fn i16(&self, offset: usize) -> i16 {
        i16::from_le_bytes(self.at(offset))
    }

    fn i32(&self, offset: usize) -> i32 {
        i32::from_le_bytes(self.at(offset))
    }

    fn i64(&self, offset: usize) -> i64 {
        i64::from_le_bytes(self.at(offset))
    }

    /// A float of version 1 (4 bytes) or 2 (8 bytes).
    fn real(&self, version: u32, offset: usize) -> f64 {
        if version == 1 { f64::from(f32::from_le_bytes(self.at(offset))) } else { f64::from_le_bytes(self.at(offset)) }
    }
}

/// Reads the volume of a NIfTI file; either file of a pair may be named.
pub(super) fn read(path: &Path) -> Result<Volume> {
    let (header_path, image_path) = pair(path);
    let mut head = vec![0; SIZES[1]];
    let file = open(&header_path)?;
    let mut reader: Box<dyn Read> =
        if is_gzip(&header_path) { Box::new(flate2::read::MultiGzDecoder::new(file)) } else { Box::new(file) };
    let got = read_full(&mut *reader, &mut head).map_err(|source| Error::Read { path: header_path.clone(), source })?;
    head.truncate(got);
    let (version, endian) = version(&head)
        .ok_or_else(|| malformed(&header_path, "not a NIfTI header (348 or 540 bytes with its magic)"))?;
    let one = version == 1;
    let bad = |reason: String| malformed(&header_path, reason);
    if head.len() < SIZES[version as usize - 1] {
        return Err(bad(format!("truncated: the header is {} bytes", head.len())));
    }
    let f = Fields { bytes: head, endian };
    let real = |offset_one, step: usize, offset_two, index: usize| {
        if one { f.real(1, offset_one + 4 * index) } else { f.real(2, offset_two + step * index) }
    };

    let dim = |i: usize| if one { i64::from(f.i16(40 + 2 * i)) } else { f.i64(16 + 8 * i) };
    let rank = dim(0);
    if !(1..=7).contains(&rank) {
        return Err(bad(format!("dim[0] is {rank}, expected 1 to 7 dimensions")));
    }
    let mut dims = [1_u32; 3];
    for axis in 1..=rank as usize {
        let size = dim(axis);
        if axis <= 3 {
            dims[axis - 1] = u32::try_from(size)
                .ok()
                .filter(|&d| d > 0)
                .ok_or_else(|| bad(format!("dim[{axis}] is {size}, expected a positive size")))?;
        } else if size > 1 {
            return Err(bad(format!(
                "a {rank}-D series of {size} along dimension {axis}: extract one 3-D volume of it"
            )));
        }
    }
    let code = f.i16(if one { 70 } else { 12 });
    let sample_type = match code {
        2 => SampleType::U8,
        4 => SampleType::I16,
        8 => SampleType::I32,
        16 => SampleType::F32,
        64 => SampleType::F64,
        256 => SampleType::I8,
        512 => SampleType::U16,
        768 => SampleType::U32,
        1024 => SampleType::I64,
        1280 => SampleType::U64,
        _ => return Err(bad(format!("datatype {code} is not a real scalar: convert it to an integer or float type"))),
    };
    let single = f.bytes[if one { 345 } else { 5 }] == b'+';
    let offset = if one { f.real(1, 108) } else { f.i64(168) as f64 };
    let least = if single { SIZES[version as usize - 1] as f64 + 4.0 } else { 0.0 };
    if !(offset.is_finite() && (0.0..9e15).contains(&offset)) {
        return Err(bad(format!("vox_offset is {offset}, expected the byte where samples begin")));
    }
    let offset = offset.max(least) as u64;
    let packed = is_gzip(&image_path);
    let source = Source {
        path: image_path,
        offset: Some(if packed { 0 } else { offset }),
        packing: if packed { Packing::Gzip } else { Packing::Raw },
        skip_unpacked: if packed { offset } else { 0 },
        sample_type,
        endian,
    };
    let (to_world, oriented) = affine(&f, one, dims, real);
    let grid = Grid::new(dims, to_world).map_err(|e| bad(e.to_string()))?;
    let volume = Volume::new(grid, source.read(sample_count(&header_path, dims)?)?)?;
    let (slope, intercept) = (real(112, 8, 176, 0), real(116, 8, 184, 0));
    // A slope of 0 says that there is no rescaling, and so does NaN by custom.
    let volume = if slope == 0.0 || !slope.is_finite() {
        volume
    } else {
        volume.with_rescale(slope, if intercept.is_finite() { intercept } else { 0.0 })?
    };
    Ok(if oriented { volume.with_orientation_known() } else { volume })
}

/// Lattice to patient space (LPS), and whether the file stated it: sform before qform, as nibabel chooses.
fn affine(f: &Fields, one: bool, dims: [u32; 3], real: impl Fn(usize, usize, usize, usize) -> f64) -> (DAffine3, bool) {
    let code = |offset_one, offset_two| if one { i32::from(f.i16(offset_one)) } else { f.i32(offset_two) };
    let pixdim = |i| real(76, 8, 104, i);
    let zoom = |i| match pixdim(i).abs() {
        z if z.is_finite() && z > 0.0 => z,
        _ => 1.0,
    };
    let zooms = DVec3::new(zoom(1), zoom(2), zoom(3));
    let (ras, oriented) = if code(254, 348) > 0 {
        let row = |r: usize| [0, 1, 2, 3].map(|c| real(280 + 16 * r, 8, 400 + 32 * r, c));
        let (x, y, z) = (row(0), row(1), row(2));
        let column = |c: usize| DVec3::new(x[c], y[c], z[c]);
        (DAffine3::from_cols(column(0), column(1), column(2), column(3)), true)
    } else if code(252, 344) > 0 {
        let [b, c, d] = [0, 1, 2].map(|i| real(256, 8, 352, i));
        let a = (1.0 - (b * b + c * c + d * d)).max(0.0).sqrt();
        // nifti1.h, "QUATERNION REPRESENTATION OF ROTATION MATRIX", rows.
        let rotation = DMat3::from_cols_array(&[
            a * a + b * b - c * c - d * d,
            2.0 * (b * c + a * d),
            2.0 * (b * d - a * c),
            2.0 * (b * c - a * d),
            a * a + c * c - b * b - d * d,
            2.0 * (c * d + a * b),
            2.0 * (b * d + a * c),
            2.0 * (c * d - a * b),
            a * a + d * d - c * c - b * b,
        ]);
        let qfac = if pixdim(0) < 0.0 { -1.0 } else { 1.0 };
        let scale = DMat3::from_diagonal(zooms * DVec3::new(1.0, 1.0, qfac));
        let translation = DVec3::new(real(268, 8, 376, 0), real(272, 8, 384, 0), real(276, 8, 392, 0));
        (DAffine3::from_mat3_translation(rotation * scale, translation), true)
    } else {
        // nibabel's get_base_affine: axes of the lattice, x to the left, the middle at the origin.
        let scale = zooms * DVec3::new(-1.0, 1.0, 1.0);
        let middle = DVec3::from_array(dims.map(|d| f64::from(d - 1) / 2.0));
        (DAffine3::from_mat3_translation(DMat3::from_diagonal(scale), -(scale * middle)), false)
    };
    (DAffine3::from_scale(DVec3::new(-1.0, -1.0, 1.0)) * ras, oriented)
}

fn is_gzip(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gz"))
}

/// The files that hold header and samples.
fn pair(path: &Path) -> (PathBuf, PathBuf) {
    let text = path.to_string_lossy();
    let (stem, gz) = match text.strip_suffix(".gz") {
        Some(stem) => (stem, ".gz"),
        None => (&*text, ""),
    };
    let Some(base) = stem.strip_suffix(".hdr").or_else(|| stem.strip_suffix(".img")) else {
        return (path.to_owned(), path.to_owned());
    };
    // Each of the two may be packed or not, whatever the other is.
    let existing = |extension: &str| {
        let other = if gz.is_empty() { ".gz" } else { "" };
        let candidates = [gz, other].map(|gz| PathBuf::from(format!("{base}{extension}{gz}")));
        candidates.iter().find(|c| c.exists()).unwrap_or(&candidates[0]).clone()
    };
    (existing(".hdr"), existing(".img"))
}
