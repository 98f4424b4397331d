//! The fixed layout of the two NIfTI headers.

use crate::error::Result;
use crate::formats::fields::Fields;
use crate::formats::input::Input;
use crate::volume::Endian;

/// Bytes of a file that [`is_nifti`] and [`is_analyze`] need: the longer header, NIfTI-2's.
pub(in crate::formats) const HEADER_SIZE: usize = NIFTI2_SIZE;

const NIFTI1_SIZE: usize = 348;
const NIFTI2_SIZE: usize = 540;

/// Bytes 7 to 11 of NIfTI-2: line ends, which a transfer in text mode changes.
const NIFTI2_TAIL: &[u8] = b"\0\r\n\x1a\n";

/// The fields that a scalar volume needs; names are those of `nifti1.h`.
pub(super) struct Header {
    pub(super) is_nifti2: bool,
    pub(super) endian: Endian,
    /// Bytes of the header itself.
    pub(super) size: usize,
    /// Whether the samples are in the same file ("n+1") or in a second one ("ni1").
    pub(super) single_file: bool,
    pub(super) dim: [i64; 8],
    pub(super) datatype: i16,
    pub(super) pixdim: [f64; 8],
    pub(super) vox_offset: f64,
    pub(super) scl_slope: f64,
    pub(super) scl_inter: f64,
    /// What lengths are in: its lowest three bits.
    pub(super) xyzt_units: u8,
    /// What values are.
    pub(super) intent_code: i32,
    pub(super) qform_code: i32,
    pub(super) sform_code: i32,
    /// `quatern_b`, `quatern_c`, `quatern_d`.
    pub(super) quatern: [f64; 3],
    pub(super) qoffset: [f64; 3],
    /// `srow_x`, `srow_y`, `srow_z`.
    pub(super) srow: [[f64; 4]; 3],
}

/// Version, byte order and whether the samples are in the same file, from the first bytes of a file.
fn recognise(head: &[u8]) -> Option<(bool, Endian, bool)> {
    let size = head.first_chunk::<4>()?;
    for endian in [Endian::Little, Endian::Big] {
        let size = match endian {
            Endian::Little => u32::from_le_bytes(*size),
            Endian::Big => u32::from_be_bytes(*size),
        } as usize;
        let magic = match size {
            NIFTI1_SIZE => head.get(344..348)?,
            NIFTI2_SIZE => head.get(4..8)?,
            _ => continue,
        };
        return match (size, magic) {
            (NIFTI1_SIZE, b"n+1\0") => Some((false, endian, true)),
            (NIFTI1_SIZE, b"ni1\0") => Some((false, endian, false)),
            (NIFTI2_SIZE, b"n+2\0") => Some((true, endian, true)),
            (NIFTI2_SIZE, b"ni2\0") => Some((true, endian, false)),
            _ => None,
        };
    }
    None
}

/// Whether these are the first bytes of a NIfTI header.
pub(in crate::formats) fn is_nifti(head: &[u8]) -> bool {
    recognise(head).is_some()
}

/// Whether these are the first bytes of an ANALYZE 7.5 header: NIfTI-1's layout without its magic.
pub(in crate::formats) fn is_analyze(head: &[u8]) -> bool {
    let size = NIFTI1_SIZE as u32;
    head.len() >= NIFTI1_SIZE
        && head.first_chunk().is_some_and(|s| u32::from_le_bytes(*s) == size || u32::from_be_bytes(*s) == size)
}

impl Header {
    /// Reads exactly the header's bytes.
    pub(super) fn read(input: &mut Input) -> Result<Self> {
        let head = input.peek(NIFTI2_SIZE)?;
        let Some((is_nifti2, endian, single_file)) = recognise(&head) else {
            return Err(input.error("is not a NIfTI file: its header size or its magic is wrong"));
        };
        let size = if is_nifti2 { NIFTI2_SIZE } else { NIFTI1_SIZE };
        let bytes = input.bytes(size)?;
        if is_nifti2 && bytes.get(7..12) != Some(NIFTI2_TAIL) {
            return Err(input.error("its magic was changed, as a transfer in text mode does: fetch it again as binary"));
        }
        let f = Fields { bytes: &bytes, endian };
        Ok(if is_nifti2 {
            Self {
                is_nifti2,
                endian,
                size,
                single_file,
                dim: std::array::from_fn(|i| f.i64(16 + 8 * i)),
                datatype: f.i16(12),
                pixdim: std::array::from_fn(|i| f.f64(104 + 8 * i)),
                // f64 holds every offset below 2^53, and no file is larger.
                vox_offset: f.i64(168) as f64,
                scl_slope: f.f64(176),
                scl_inter: f.f64(184),
                xyzt_units: f.i32(500) as u8,
                intent_code: f.i32(504),
                qform_code: f.i32(344),
                sform_code: f.i32(348),
                quatern: std::array::from_fn(|i| f.f64(352 + 8 * i)),
                qoffset: std::array::from_fn(|i| f.f64(376 + 8 * i)),
                srow: std::array::from_fn(|r| std::array::from_fn(|c| f.f64(400 + 32 * r + 8 * c))),
            }
        } else {
            Self {
                is_nifti2,
                endian,
                size,
                single_file,
                dim: std::array::from_fn(|i| f.i16(40 + 2 * i).into()),
                datatype: f.i16(70),
                pixdim: std::array::from_fn(|i| f.f32(76 + 4 * i)),
                vox_offset: f.f32(108),
                scl_slope: f.f32(112),
                scl_inter: f.f32(116),
                xyzt_units: f.u8(123),
                intent_code: f.i16(68).into(),
                qform_code: f.i16(252).into(),
                sform_code: f.i16(254).into(),
                quatern: std::array::from_fn(|i| f.f32(256 + 4 * i)),
                qoffset: std::array::from_fn(|i| f.f32(268 + 4 * i)),
                srow: std::array::from_fn(|r| std::array::from_fn(|c| f.f32(280 + 16 * r + 4 * c))),
            }
        })
    }

    /// World distance between samples. The sform has its own, all other placements use this.
    pub(super) fn spacing(&self) -> [f64; 3] {
        [self.pixdim[1], self.pixdim[2], self.pixdim[3]]
    }
}
