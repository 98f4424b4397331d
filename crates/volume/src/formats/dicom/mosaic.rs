//! Mosaics of Siemens: a picture whose tiles are the slices of a volume, row by row.

use glam::DVec3;

use super::dataset::{Dataset, trimmed};
use super::{FRAMES, IMAGE_TYPE};
use crate::error::{Result, refuse_if};
use crate::volume::Endian;

/// The makers of the private groups that hold the number of tiles and the CSA header, and the elements.
const NUMBERS: (u32, &str, u32) = (0x0019, "SIEMENS MR HEADER", 0x0a);
const CSA: (u32, &str, u32) = (0x0029, "SIEMENS CSA HEADER", 0x10);

/// The number of bytes of the description of an element of a CSA header, and of an item.
const CSA_ELEMENT: usize = 84;
const CSA_ITEM: usize = 16;

/// The tiles of a picture that is a mosaic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Mosaic {
    /// The number of tiles that are slices.
    pub(super) tiles: u16,
    /// The number of tiles along each edge of the picture.
    pub(super) across: u16,
    /// Whether slices follow one another against the normal of the picture.
    pub(super) is_reversed: bool,
}

impl Mosaic {
    /// Returns the mosaic of a picture of this many columns and rows; `None` if it is no mosaic.
    pub(super) fn of(set: &Dataset, [columns, rows]: [u16; 2], normal: DVec3) -> Result<Option<Self>> {
        let (group, maker, element) = NUMBERS;
        let stated = set.private(group, maker, element).and_then(|bytes| set.words_of(bytes).next());
        if stated.is_none() && !is_named(set) {
            return Ok(None);
        }
        let csa = |name: &str| {
            let (group, maker, element) = CSA;
            csa_values(set.private(group, maker, element)?, name)
        };
        let in_csa = || csa("NumberOfImagesInMosaic")?.first()?.parse::<u16>().ok();
        let Some(tiles) = stated.or_else(in_csa).filter(|tiles| *tiles > 1) else { return Ok(None) };
        let across = f64::from(tiles).sqrt().ceil() as u16;
        let is_cut = !columns.is_multiple_of(across) || !rows.is_multiple_of(across);
        refuse_if!(is_cut, set, "is a mosaic of {tiles} tiles, which {columns} x {rows} pixels do not hold");
        let frames = set.numbers(0, FRAMES).map_or(1.0, |[frames]| frames);
        refuse_if!(frames != 1.0, set, "is a mosaic of {frames} frames, expected one");
        let vector = csa("SliceNormalVector").unwrap_or_default();
        let numbers: Vec<f64> = vector.iter().filter_map(|word| word.parse().ok()).collect();
        let is_reversed = <[f64; 3]>::try_from(numbers).is_ok_and(|along| DVec3::from(along).dot(normal) < 0.0);
        Ok(Some(Self { tiles, across, is_reversed }))
    }

    /// Returns the place of the first tile from the position of the picture. Siemens states the corner that a picture
    /// of the size of the mosaic would have around the middle of a slice.
    pub(super) fn first_tile([columns, rows]: [u16; 2], across: u16, steps: [DVec3; 2]) -> DVec3 {
        let beyond = |size: u16| f64::from(size - size / across) / 2.0;
        steps[0] * beyond(columns) + steps[1] * beyond(rows)
    }

    /// Returns the samples of a tile of a picture with this many columns.
    pub(super) fn cut(self, picture: &[i64], columns: usize, tile: usize) -> Vec<i64> {
        let across = usize::from(self.across);
        let (width, height) = (columns / across, picture.len() / columns / across);
        let (left, top) = (tile % across * width, tile / across * height);
        let rows = picture.chunks_exact(columns).skip(top).take(height);
        rows.flat_map(|row| &row[left..left + width]).copied().collect()
    }
}

/// Returns whether a file states that it is a mosaic.
pub(super) fn is_named(set: &Dataset) -> bool {
    set.text(IMAGE_TYPE).split('\\').any(|word| word.trim() == "MOSAIC")
}

/// Returns the values of an element of a CSA header, which is binary and little-endian
/// (<https://nipy.org/nibabel/dicom/siemens_csa.html>); `None` if it is not there or the header is damaged.
fn csa_values(bytes: &[u8], name: &str) -> Option<Vec<String>> {
    let word = |at: usize| Some(Endian::Little.number(bytes.get(at..at.checked_add(4)?)?) as usize);
    let is_second = bytes.starts_with(b"SV10");
    let start = if is_second { 8 } else { 0 };
    let (mut at, count, mut first_items) = (start + 8, word(start)?, None);
    for _ in 0..count {
        let found = bytes.get(at..at + 64)?.split(|byte| *byte == 0).next().map(trimmed);
        let items = word(at + 76)?;
        at += CSA_ELEMENT;
        // In the older kind of header the stated lengths are too large by this number.
        let excess = *first_items.get_or_insert(items);
        let mut values = Vec::new();
        for _ in 0..items {
            let length = if is_second { word(at + 4)? } else { word(at)?.wrapping_sub(excess) };
            at += CSA_ITEM;
            let Some(value) = at.checked_add(length).and_then(|end| bytes.get(at..end)) else { break };
            values.extend(value.split(|byte| *byte == 0).next().map(trimmed).filter(|text| !text.is_empty()));
            at = (at + length).next_multiple_of(4);
        }
        if found.as_deref() == Some(name) {
            return Some(values);
        }
    }
    None
}
