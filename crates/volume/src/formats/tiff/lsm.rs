//! Zeiss LSM 5: TIFF with a private tag, which states sizes and the lengths of a voxel in metres. A thumbnail follows
//! each page. The layout is the structure CZ_LSMINFO of Zeiss' "LSM file format" (2005).

use super::described::Described;
use crate::formats::fields::Fields;
use crate::formats::selection::Role;
use crate::volume::Endian;

/// The private tag of Zeiss.
pub(super) const TAG: u16 = 34412;

/// The first four bytes of the structure, of LSM 1.3 and of later versions.
const MAGICS: [u64; 2] = [0x0300_494C, 0x0400_494C];

/// The length of a micrometre in metres.
const MICROMETRE: f64 = 1e-6;

/// Describes the series of all `pages` of a file with this content of the tag, of pixels with that many samples. `None`
/// if the tag is of another kind.
pub(super) fn described(info: &[u8], pages: usize, samples: u16) -> Option<Described> {
    let fields = Fields { bytes: info, endian: Endian::Little };
    if !MAGICS.contains(&fields.uint(0, 4)) {
        return None;
    }
    let size = |at: usize| fields.int(at, 4).max(1);
    let (sections, channels, times) = (size(16), size(20), size(24));
    // Channels are samples of a pixel, or pages of their own.
    let channels = if samples > 1 { 1 } else { channels };
    let stated = [sections, channels, times].into_iter().fold(1, i64::saturating_mul);
    let described = Described::sections((0..pages).collect());
    let axes = match stated == pages as i64 {
        true => vec![(Role::Channel, channels), (Role::Space, sections), (Role::Time, times)],
        // A recording that was stopped has fewer pages than its header states.
        false => described.axes,
    };
    let lengths = [40, 48, 56].map(|at| fields.float(at, 8) / MICROMETRE);
    let spacing = lengths.iter().all(|length| length.is_finite() && *length > 0.0).then_some(lengths);
    let unit = spacing.map(|_| "µm".to_owned());
    Some(Described { axes, spacing, unit, is_microscopy: true, pages: described.pages, ..Described::default() })
}
