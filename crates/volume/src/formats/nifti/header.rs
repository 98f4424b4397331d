//! The fixed layout of the two NIfTI headers.

use crate::error::{Result, refuse};
use crate::formats::fields::Fields;
use crate::formats::input::Input;
use crate::volume::Endian;

/// The number of bytes of a file that [`is_nifti`] and [`is_analyze`] need: the longer header, NIfTI-2's.
pub(in crate::formats) const HEADER_SIZE: usize = NIFTI2_SIZE;

const NIFTI1_SIZE: usize = 348;
const NIFTI2_SIZE: usize = 540;

/// Bytes 7 to 11 of NIfTI-2: line ends, which a transfer in text mode changes.
const NIFTI2_TAIL: &[u8] = b"\0\r\n\x1a\n";

/// The fields that a scalar volume needs; names are those of `nifti1.h`.
pub(super) struct NiftiHeader {
    pub(super) is_nifti2: bool,
    pub(super) endian: Endian,
    /// The number of bytes of the header itself.
    pub(super) size: usize,
    /// Whether the samples are in the same file ("n+1") or in a second one ("ni1").
    pub(super) single_file: bool,
    pub(super) dim: [i64; 8],
    pub(super) datatype: i16,
    pub(super) pixdim: [f64; 8],
    pub(super) vox_offset: f64,
    pub(super) scl_slope: f64,
    pub(super) scl_inter: f64,
    /// The units of lengths, in the lowest three bits.
    pub(super) xyzt_units: u8,
    /// The code of the meaning of values.
    pub(super) intent_code: i32,
    /// The fields `intent_p1` to `intent_p3`: parameters of the distribution of a statistic.
    pub(super) intent_p: [f64; 3],
    pub(super) intent_name: String,
    pub(super) descrip: String,
    /// The axes of frequency, phase and slices of MRI, in two bits each.
    pub(super) dim_info: u8,
    pub(super) qform_code: i32,
    pub(super) sform_code: i32,
    /// The fields `quatern_b`, `quatern_c`, `quatern_d`.
    pub(super) quatern: [f64; 3],
    pub(super) qoffset: [f64; 3],
    /// The fields `srow_x`, `srow_y`, `srow_z`.
    pub(super) srow: [[f64; 4]; 3],
}

/// Returns version, byte order and whether the samples are in the same file, from the first bytes of a file.
fn recognise(head: &[u8]) -> Option<(bool, Endian, bool)> {
    [Endian::Little, Endian::Big].into_iter().find_map(|endian| {
        let is_nifti2 = match endian.number(head.get(..4)?) as usize {
            NIFTI1_SIZE => false,
            NIFTI2_SIZE => true,
            _ => return None,
        };
        let magic = if is_nifti2 { head.get(4..8)? } else { head.get(344..348)? };
        match (is_nifti2, magic) {
            (false, b"n+1\0") | (true, b"n+2\0") => Some((is_nifti2, endian, true)),
            (false, b"ni1\0") | (true, b"ni2\0") => Some((is_nifti2, endian, false)),
            _ => None,
        }
    })
}

/// Returns whether these are the first bytes of a NIfTI header.
pub(in crate::formats) fn is_nifti(head: &[u8]) -> bool {
    recognise(head).is_some()
}

/// Returns whether these are the first bytes of an ANALYZE 7.5 header: NIfTI-1's layout without its magic.
pub(in crate::formats) fn is_analyze(head: &[u8]) -> bool {
    let is_size = |endian: Endian| endian.number(&head[..4]) as usize == NIFTI1_SIZE;
    head.len() >= NIFTI1_SIZE && (is_size(Endian::Little) || is_size(Endian::Big))
}

impl NiftiHeader {
    /// Reads exactly the header's bytes.
    pub(super) fn read(input: &mut Input) -> Result<Self> {
        let head = input.peek(NIFTI2_SIZE)?;
        let Some((is_nifti2, endian, single_file)) = recognise(&head) else {
            refuse!(input, "is not a NIfTI file: its header size or its magic is wrong");
        };
        let size = if is_nifti2 { NIFTI2_SIZE } else { NIFTI1_SIZE };
        let bytes = input.bytes(size)?;
        if is_nifti2 && bytes.get(7..12) != Some(NIFTI2_TAIL) {
            refuse!(input, "its magic was changed, as a transfer in text mode does: fetch it again as binary");
        }
        let fields = Fields { bytes: &bytes, endian };
        // Numbers of the two versions have other places and other sizes, and some stand in a row.
        let version = usize::from(is_nifti2);
        let int =
            |at: [usize; 2], size: [usize; 2], i: usize| fields.int(at[version] + i * size[version], size[version]);
        let float = |at: [usize; 2], i: usize| fields.float(at[version] + i * [4, 8][version], [4, 8][version]);
        Ok(Self {
            is_nifti2,
            endian,
            size,
            single_file,
            dim: std::array::from_fn(|i| int([40, 16], [2, 8], i)),
            datatype: int([70, 12], [2, 2], 0) as i16,
            pixdim: std::array::from_fn(|i| float([76, 104], i)),
            // f64 holds every offset below 2^53, and no file is larger.
            vox_offset: if is_nifti2 { fields.int(168, 8) as f64 } else { fields.float(108, 4) },
            scl_slope: float([112, 176], 0),
            scl_inter: float([116, 184], 0),
            xyzt_units: int([123, 500], [1, 4], 0) as u8,
            intent_code: int([68, 504], [2, 4], 0) as i32,
            intent_p: std::array::from_fn(|i| float([56, 80], i)),
            intent_name: fields.text([328, 508][version], 16),
            descrip: fields.text([148, 240][version], 80),
            dim_info: int([39, 524], [1, 1], 0) as u8,
            qform_code: int([252, 344], [2, 4], 0) as i32,
            sform_code: int([254, 348], [2, 4], 0) as i32,
            quatern: std::array::from_fn(|i| float([256, 352], i)),
            qoffset: std::array::from_fn(|i| float([268, 376], i)),
            srow: std::array::from_fn(|r| std::array::from_fn(|c| float([280, 400], 4 * r + c))),
        })
    }

    /// Returns the world distance between samples. The sform has its own, all other placements use this.
    pub(super) fn spacing(&self) -> [f64; 3] {
        [self.pixdim[1], self.pixdim[2], self.pixdim[3]]
    }
}
