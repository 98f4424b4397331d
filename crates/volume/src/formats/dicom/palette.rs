//! Palettes: tables of red, green and blue by pixel, whole or in segments (PS3.3, C.7.6.3.1.5 and C.7.9.2).

use super::dataset::Dataset;
use crate::error::{Result, refuse, refuse_if};
use crate::volume::Endian;

/// The tags of the descriptor, the table and the segmented table of red. Green and blue follow by one and two.
const DESCRIPTOR: u32 = 0x0028_1101;
const TABLE: u32 = 0x0028_1201;
const SEGMENTS: u32 = 0x0028_1221;

/// The colours of a channel by pixel.
pub(super) struct PaletteTable {
    /// The pixel of the first entry.
    first: i64,
    entries: Vec<u16>,
}

impl PaletteTable {
    /// Reads the table of a channel: 0 is red, 1 green, 2 blue.
    pub(super) fn of(set: &Dataset, channel: usize, signed: bool) -> Result<Self> {
        let channel = channel as u32;
        let Some((count, first)) = described(set, channel) else {
            refuse!(set, "is in a palette of colours without a descriptor");
        };
        let first = if signed { i64::from(first.cast_signed()) } else { i64::from(first) };
        let bytes = bytes_of_entries(set)?;
        let mut entries = Vec::new();
        if let Some(table) = set.value(TABLE + channel) {
            entries = words(set, TABLE + channel, table, bytes);
        } else {
            let Some(table) = set.value(SEGMENTS + channel) else {
                refuse!(set, "is in a palette of colours without tables");
            };
            let packed = words(set, SEGMENTS + channel, table, bytes);
            let expanded = expand(&packed, bytes, count, &mut entries);
            expanded.map_err(|reason| set.error(format!("is in a palette of colours whose {reason}")))?;
        }
        let (found, palette) = (entries.len(), "is in a palette of colours whose table is cut short");
        refuse_if!(found < count, set, "{palette}: {count} entries expected, {found} are there");
        entries.truncate(count);
        Ok(Self { first, entries })
    }

    /// Drops the lowest bits of all entries.
    pub(super) fn shift(&mut self, bits: u32) {
        self.entries.iter_mut().for_each(|entry| *entry >>= bits);
    }

    /// Returns the colour of a pixel. Pixels outside of the table have its first or its last entry.
    pub(super) fn at(&self, pixel: i64) -> i64 {
        let last = self.entries.len().saturating_sub(1) as i64;
        let entry = pixel.saturating_sub(self.first).clamp(0, last);
        self.entries.get(entry as usize).copied().unwrap_or(0).into()
    }
}

/// Returns the bytes of an entry, 1 or 2.
pub(super) fn bytes_of_entries(set: &Dataset) -> Result<u32> {
    let Some((count, _)) = described(set, 0) else { refuse!(set, "is in a palette of colours without a descriptor") };
    let stated = set.words(DESCRIPTOR).and_then(|mut words| words.nth(2)).unwrap_or(0);
    match (set.value(TABLE).map(<[u8]>::len), stated) {
        // Entries of 8 bits may stand in 16.
        (Some(length), _) if length >= 2 * count => Ok(2),
        (_, 8) => Ok(1),
        (None, 16) => Ok(2),
        (Some(length), 16) => {
            refuse!(set, "is in a palette of colours whose table is cut short: {length} bytes for {count} entries")
        }
        _ => refuse!(set, "is in a palette of colours of {stated} bits, expected 8 or 16"),
    }
}

/// Returns the number of entries of a channel, and the pixel of the first.
fn described(set: &Dataset, channel: u32) -> Option<(usize, u16)> {
    let mut words = set.words(DESCRIPTOR + channel)?;
    let (count, first) = (words.next()?, words.next()?);
    Some((if count == 0 { 1 << 16 } else { count.into() }, first))
}

/// Returns the entries of a table, or its segments. Entries of 8 bits are pairs in words.
fn words(set: &Dataset, tag: u32, table: &[u8], bytes: u32) -> Vec<u16> {
    match (bytes, set.endian) {
        (1, Endian::Little) => table.iter().map(|byte| u16::from(*byte)).collect(),
        (1, Endian::Big) => table.chunks(2).flat_map(|two| two.iter().rev()).map(|byte| u16::from(*byte)).collect(),
        _ => set.words(tag).map(Iterator::collect).unwrap_or_default(),
    }
}

/// Appends up to `count` entries that segments represent: listed ones, ramps, and repetitions of segments before.
fn expand(packed: &[u16], bytes: u32, count: usize, entries: &mut Vec<u16>) -> Result<(), &'static str> {
    const SHORT: &str = "segments are cut short";
    /// Appends a segment that is no repetition, and returns the place behind it.
    fn plain(packed: &[u16], at: usize, count: usize, entries: &mut Vec<u16>) -> Result<usize, &'static str> {
        let length = usize::from(*packed.get(at + 1).ok_or(SHORT)?);
        let room = count.saturating_sub(entries.len());
        match packed.get(at) {
            Some(0) => {
                let listed = packed.get(at + 2..at + 2 + length).ok_or(SHORT)?;
                entries.extend(listed.iter().take(room));
                Ok(at + 2 + length)
            }
            Some(1) => {
                let to = f64::from(*packed.get(at + 2).ok_or(SHORT)?);
                let from = f64::from(*entries.last().ok_or("segments begin with a ramp")?);
                let entry = |n: usize| (from + (to - from) * n as f64 / length as f64).round_ties_even() as u16;
                entries.extend((1..=length.min(room)).map(entry));
                Ok(at + 3)
            }
            _ => Err("segments are of no known kind"),
        }
    }
    let mut at = 0;
    // A byte may follow that makes the length even.
    while at + 1 < packed.len() && entries.len() < count {
        if packed[at] != 2 {
            at = plain(packed, at, count, entries)?;
            continue;
        }
        // The place is in bytes, the lower half before the upper one.
        let n = usize::from(packed[at + 1]);
        let digits = if bytes == 1 { 4 } else { 2 };
        let place = packed.get(at + 2..at + 2 + digits).ok_or(SHORT)?;
        let shift = 8 * bytes as usize;
        let offset = place.iter().rev().fold(0_usize, |offset, digit| offset << shift | usize::from(*digit));
        let mut from = offset / bytes as usize;
        for _ in 0..n {
            if from >= at || entries.len() >= count {
                break;
            }
            from = plain(packed, from, count, entries)?;
        }
        at += 2 + digits;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn segments_are_those_of_the_standard() {
        let expanded = |packed: &[u16], bytes: u32, count: usize| {
            let mut entries = Vec::new();
            expand(packed, bytes, count, &mut entries).map(|()| entries)
        };
        // Two listed entries, a ramp, and both again.
        let bytes = [0, 2, 7, 9, 1, 3, 15, 2, 2, 0, 0, 0, 0];
        assert_eq!(expanded(&bytes, 1, 10).unwrap(), [7, 9, 11, 13, 15, 7, 9, 11, 13, 15]);
        assert_eq!(expanded(&bytes, 1, 6).unwrap(), [7, 9, 11, 13, 15, 7]);
        // In words a place counts bytes: the ramp alone, downwards.
        let words = [0, 1, 60_000, 1, 2, 65_000, 0, 1, 65_002, 2, 1, 6, 0];
        assert_eq!(expanded(&words, 2, 9).unwrap(), [60_000, 62_500, 65_000, 65_002, 65_001, 65_000]);
        for (damaged, words) in [
            (&[0, 4, 1][..], "cut short"),
            (&[1, 4, 1], "begin with a ramp"),
            (&[0, 1, 1, 3, 1, 1], "no known kind"),
            (&[0, 1, 5, 2, 9, 0], "cut short"),
        ] {
            assert!(expanded(damaged, 1, 9).unwrap_err().contains(words), "{damaged:?}");
        }
        // A repetition of itself, or of what follows, is nothing.
        assert_eq!(expanded(&[0, 1, 5, 2, 9, 3, 0, 0, 0], 1, 9).unwrap(), [5]);
    }
}
