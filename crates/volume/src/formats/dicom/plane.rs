//! The properties that all slices of a volume share: size, type, colours, directions and spacing.

use glam::DVec3;

use super::dataset::Dataset;
use super::encapsulated::{Codec, syntax_of};
use super::mosaic::Mosaic;
use super::{BITS_ALLOCATED, CHANNELS, COLUMNS, ORIENTATION, PHOTOMETRIC, ROWS, palette};
use crate::error::{Result, refuse, refuse_if};

const PLANAR: u32 = 0x0028_0006;
const PIXEL_SPACING: u32 = 0x0028_0030;
const ASPECT: u32 = 0x0028_0034;
const BITS_STORED: u32 = 0x0028_0101;
const HIGH_BIT: u32 = 0x0028_0102;
const SIGNED: u32 = 0x0028_0103;

/// The elements that state distances of pixels if there is no `PixelSpacing`, with notes; the most reliable first.
const OTHER_SPACINGS: [(u32, &str); 3] = [
    (0x0018_1164, "the file states no PixelSpacing: using its ImagerPixelSpacing, as measured at the detector"),
    (0x3002_0011, "the file states no PixelSpacing: using its ImagePlanePixelSpacing"),
    (0x0018_2010, "the file states no PixelSpacing: using its NominalScannedPixelSpacing"),
];
/// The note about pixels whose distances no element states.
const NO_SPACING: &str = "the file states no pixel spacing: pixels are taken to be 1 apart unless a spacing is given";

/// The distances of pixels in the first region of an ultrasound image, along x and y, and their units: 3 is cm (PS3.3,
/// C.8.5.5).
const REGION_DELTAS: [u32; 2] = [0x0018_602c, 0x0018_602e];
const REGION_UNITS: [u32; 2] = [0x0018_6024, 0x0018_6026];

/// The properties that all slices of a volume share.
pub(super) struct Plane {
    pub(super) columns: u16,
    pub(super) rows: u16,
    pub(super) pixels: Pixels,
    pub(super) colors: Colors,
    /// Whether each colour has a plane of its own in a frame.
    pub(super) planar: bool,
    /// The number of bytes of a sample in the volume.
    pub(super) bytes: u32,
    /// The directions of rows and columns.
    pub(super) directions: [DVec3; 2],
    /// The distances between columns and between rows.
    pub(super) spacing: [f64; 2],
    /// The note on the spacing, if `PixelSpacing` does not state it.
    pub(super) spacing_note: Option<&'static str>,
    /// The tiles of a frame that are slices of their own.
    pub(super) mosaic: Option<Mosaic>,
}

/// The bits of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Pixels {
    /// The number of bits of a sample: 1, 8, 16 or 32, and 64 of floating point.
    pub(super) allocated: u32,
    pub(super) stored: u32,
    pub(super) high: u32,
    pub(super) signed: bool,
    pub(super) is_float: bool,
}

/// The meaning of the samples of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Colors {
    Grey,
    /// Red, green and blue.
    Rgb,
    /// Luma and the differences of blue and red, of 8 bits (PS3.3, C.7.6.3.1.2).
    Ybr,
    /// Luma of two pixels, and the differences that both share, of 8 bits.
    Ybr422,
    /// An index into tables of red, green and blue.
    Palette,
}

impl Colors {
    /// Returns the number of samples of a pixel in the file.
    pub(super) fn stored(self) -> usize {
        match self {
            Self::Grey | Self::Palette => 1,
            Self::Ybr422 => 2,
            Self::Rgb | Self::Ybr => 3,
        }
    }

    /// Returns the number of samples of a pixel in the volume.
    pub(super) fn channels(self) -> u32 {
        if self == Self::Grey { 1 } else { 3 }
    }
}

impl Pixels {
    /// Returns the number of a sample as stored: floating point is stored as its bits.
    pub(super) fn number(self, sample: i64) -> f64 {
        match (self.is_float, self.allocated) {
            (false, _) => sample as f64,
            (true, 32) => f32::from_bits(sample as u32).into(),
            (true, _) => f64::from_bits(sample.cast_unsigned()),
        }
    }
}

impl Plane {
    pub(super) fn of(set: &Dataset, frame: usize) -> Result<Self> {
        let required = |tag: u32, name: &str| set.u16(tag).ok_or_else(|| set.error(format!("has no {name}")));
        let (rows, columns) = (required(ROWS, "number of rows")?, required(COLUMNS, "number of columns")?);
        let photometric = set.text(PHOTOMETRIC);
        // Codecs of colours give red, green and blue; run lengths and lossless JPEG are none.
        let is_lossless = ["1.2.840.10008.1.2.4.57", "1.2.840.10008.1.2.4.70"].contains(&set.syntax.as_str());
        let by_codec = !is_lossless && syntax_of(&set.syntax).is_some_and(|(_, codec)| codec != Some(Codec::Rle));
        let colors = match (set.u16(CHANNELS).unwrap_or(1), photometric.as_str()) {
            (1, "PALETTE COLOR") => Colors::Palette,
            (1, _) => Colors::Grey,
            (3, "RGB" | "YBR_ICT" | "YBR_RCT") => Colors::Rgb,
            (3, "YBR_FULL" | "YBR_FULL_422" | "YBR_PARTIAL_420") if by_codec => Colors::Rgb,
            (3, "YBR_FULL_422") if syntax_of(&set.syntax).is_none() => {
                refuse_if!(columns % 2 == 1, set, "has {columns} columns of YBR_FULL_422, expected an even number");
                Colors::Ybr422
            }
            (3, "YBR_FULL" | "YBR_FULL_422") => Colors::Ybr,
            (channels, photometric) => {
                let expected = "grey values, a palette, RGB, YBR_FULL or YBR_FULL_422";
                refuse!(set, "has {channels} samples per pixel of the kind {photometric:?}: expected {expected}")
            }
        };
        let allocated = u32::from(required(BITS_ALLOCATED, "number of bits")?);
        let is_float = set.is_float;
        // Floating point has no bits beside its own.
        let bits = |tag: u32| set.u16(tag).filter(|_| !is_float).map(u32::from);
        let stored = bits(BITS_STORED).unwrap_or(allocated);
        let high = bits(HIGH_BIT).unwrap_or(stored.saturating_sub(1));
        let is_packed = allocated == 1 && (colors != Colors::Grey || syntax_of(&set.syntax).is_some());
        let is_read = if is_float { matches!(allocated, 32 | 64) } else { matches!(allocated, 1 | 8 | 16 | 32) };
        if !is_read || is_packed || stored == 0 || high >= allocated || stored > high + 1 {
            refuse!(set, "has {stored} bits up to bit {high} in {allocated}, which is not read");
        }
        refuse_if!(
            is_float && colors != Colors::Grey,
            set,
            "has floating point of {photometric}, expected grey values"
        );
        let pixels = Pixels { allocated, stored, high, signed: set.u16(SIGNED) == Some(1) && !is_float, is_float };
        let is_chroma = matches!(colors, Colors::Ybr | Colors::Ybr422);
        if is_chroma && (allocated, stored, pixels.signed) != (8, 8, false) {
            refuse!(set, "has {stored} bits of {photometric}, expected 8 without sign");
        }
        let [x, y, z, a, b, c] = set.numbers(frame, ORIENTATION).unwrap_or([1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        let ([between_rows, between_columns], spacing_note) = spacing_of(set, frame);
        let directions = [DVec3::new(x, y, z), DVec3::new(a, b, c)];
        let planar = set.u16(PLANAR) == Some(1) && matches!(colors, Colors::Rgb | Colors::Ybr);
        let bytes = if colors == Colors::Palette { palette::bytes_of_entries(set)? } else { allocated.div_ceil(8) };
        let spacing = [between_columns, between_rows];
        let mosaic = Mosaic::of(set, [columns, rows], directions[0].cross(directions[1]))?;
        Ok(Self { columns, rows, pixels, colors, planar, bytes, directions, spacing, spacing_note, mosaic })
    }

    /// Returns the normal of the plane.
    pub(super) fn normal(&self) -> DVec3 {
        self.directions[0].cross(self.directions[1])
    }

    /// Returns the columns and the rows of a slice: a frame, or a tile of it.
    pub(super) fn size(&self) -> [u16; 2] {
        let across = self.mosaic.map_or(1, |mosaic| mosaic.across);
        [self.columns / across, self.rows / across]
    }

    /// Returns the number of bits of an uncompressed frame.
    pub(super) fn frame_bits(&self) -> u64 {
        let samples = u64::from(self.columns) * u64::from(self.rows) * self.colors.stored() as u64;
        samples * u64::from(self.pixels.allocated)
    }
}

/// Returns the distances of rows and of columns of a frame, with a note if `PixelSpacing` does not state them.
fn spacing_of(set: &Dataset, frame: usize) -> ([f64; 2], Option<&'static str>) {
    if let Some(spacing) = set.numbers(frame, PIXEL_SPACING) {
        return (spacing, None);
    }
    let are_lengths = |pair: &[f64; 2]| pair.iter().all(|length| *length > 0.0);
    let stated = |tag: u32| set.numbers(frame, tag).filter(are_lengths);
    if let Some((spacing, note)) = OTHER_SPACINGS.iter().find_map(|(tag, note)| Some((stated(*tag)?, *note))) {
        return (spacing, Some(note));
    }
    let in_cm = |axis: usize| {
        let delta = set.f64(frame, REGION_DELTAS[axis]).filter(|_| set.u16(REGION_UNITS[axis]) == Some(3));
        delta.map(|delta| 10.0 * delta.abs())
    };
    if let (Some(x), Some(y)) = (in_cm(0), in_cm(1))
        && are_lengths(&[x, y])
    {
        return ([y, x], Some("the file states no PixelSpacing: using the spacing of its first ultrasound region"));
    }
    ([stated(ASPECT).map_or(1.0, |[vertical, horizontal]| vertical / horizontal), 1.0], Some(NO_SPACING))
}
