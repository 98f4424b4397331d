//! The samples of a frame.

use std::io::SeekFrom;
use std::path::Path;

use super::dataset::Dataset;
use super::encapsulated::{DECOMPRESS, Frames, Size, syntax_of};
use super::palette::PaletteTable;
use super::plane::{Colors, Plane};
use super::{FRAMES, PHOTOMETRIC, Slice};
use crate::error::{Error, Result, Subject, refuse, refuse_if};
use crate::memory::{reserved, samples_in};
use crate::volume::Endian;

/// Returns the compressed frames of each file; `None` if its frames are uncompressed.
pub(super) fn pixels_in(
    source: &Path,
    sets: &[Dataset],
    slices: &[Slice],
    frame_bits: u64,
) -> Result<Vec<Option<Frames>>> {
    refuse_if!(slices.is_empty(), source, "has no slices");
    let mut is_used = vec![false; sets.len()];
    slices.iter().for_each(|slice| is_used[slice.file] = true);
    let frames = |(set, is_used): (&Dataset, bool)| if is_used { frames_in(set, frame_bits) } else { Ok(None) };
    sets.iter().zip(is_used).map(frames).collect()
}

/// Returns the compressed frames of a file, also of other points in time; `None` if they are uncompressed, and all
/// there.
pub(super) fn frames_in(set: &Dataset, frame_bits: u64) -> Result<Option<Frames>> {
    let frames = set.numbers(0, FRAMES).map_or(1, |[frames]| frames as usize);
    match (syntax_of(&set.syntax), set.pixels) {
        (Some((name, None)), _) => {
            refuse!(set, "is compressed by {name} ({}), which is not read: {DECOMPRESS}", set.syntax)
        }
        (Some((_, Some(codec))), Some((_, None))) => Frames::find(set, frames, codec).map(Some),
        (Some((name, _)), _) => refuse!(set, "is compressed by {name}, but its pixels are in no fragments"),
        // Refused before memory is reserved.
        (None, Some((_, Some(length)))) => {
            let needed = (frames as u64).saturating_mul(frame_bits).div_ceil(8);
            let need = if frames == 1 { "frame needs" } else { "frames need" };
            let is_short = length < needed;
            refuse_if!(is_short, set, "is cut short: {frames} {need} {needed} bytes, {length} are there");
            Ok(None)
        }
        (None, _) => refuse!(set, "is in the transfer syntax {}, which is not read: {DECOMPRESS}", set.syntax),
    }
}

/// Returns the number of bits before the first bit of a frame in its first byte: single bits follow one another over
/// the ends of frames.
pub(super) fn bits_before(frame: usize, plane: &Plane) -> usize {
    (frame as u64 * plane.frame_bits() % 8) as usize
}

/// Returns the bytes of an uncompressed frame.
pub(super) fn bytes_of(set: &Dataset, frame: usize, plane: &Plane) -> Result<Vec<u8>> {
    let first = frame as u64 * plane.frame_bits();
    let (start, end) = (first / 8, (first + plane.frame_bits()).div_ceil(8));
    // Bytes in words are read in pairs, from the highest to the lowest.
    let is_swapped = set.in_words && set.endian == Endian::Big && plane.pixels.allocated <= 8;
    let before = if is_swapped { start % 2 } else { 0 };
    let (from, to) = (start - before, if is_swapped { end.next_multiple_of(2) } else { end });
    let (pixels_at, pixels_end) = match set.pixels {
        Some((at, length)) => (at, length.unwrap_or(u64::MAX)),
        None => (0, u64::MAX),
    };
    let length = to.min(pixels_end).saturating_sub(from);
    let mut bytes: Vec<u8> = reserved(length, || samples_in(&set.path))?;
    bytes.resize(length as usize, 0);
    let mut file = set.open().map_err(Error::read(&set.path))?;
    file.seek(SeekFrom::Start(pixels_at + from))
        .and_then(|_| file.read_exact(&mut bytes))
        .map_err(Error::read(&set.path))?;
    if is_swapped {
        bytes.as_chunks_mut::<2>().0.iter_mut().for_each(|two| two.reverse());
        bytes.drain(..(before as usize).min(bytes.len()));
    }
    Ok(bytes)
}

/// Returns the samples of a channel of a frame as stored: bits beside them are masked, and the sign is extended.
/// [`Pixels::number`](super::plane::Pixels::number) makes numbers of them.
pub(super) fn pixels_of(
    set: &Dataset,
    frames: Option<&Frames>,
    frame: usize,
    plane: &Plane,
    channel: usize,
) -> Result<Vec<i64>> {
    let (pixels, colors) = (plane.pixels, plane.colors);
    let (columns, rows) = (usize::from(plane.columns), usize::from(plane.rows));
    let width = pixels.allocated.div_ceil(8) as usize;
    let (above, below) = (64 - 1 - pixels.high, 64 - pixels.stored);
    let value = |raw: u64| {
        let raised = raw << above;
        if pixels.signed { raised.cast_signed() >> below } else { (raised >> below).cast_signed() }
    };
    let (area, samples) = (columns * rows, colors.stored());
    let count = area * samples;
    let mut all: Vec<u64> = reserved(count as u64, || samples_in(&set.path))?;
    // Codecs give the samples of a pixel beside each other.
    let mut is_planar = false;
    if let Some(frames) = frames {
        let is_rgb = set.text(PHOTOMETRIC) == "RGB";
        all = frames.pixels(set, frame, Size { columns, rows, samples, bytes: width, is_rgb })?;
    } else {
        is_planar = plane.planar;
        let bytes = bytes_of(set, frame, plane)?;
        if pixels.allocated == 1 {
            let bits = bytes.iter().flat_map(|byte| (0..8).map(move |bit| u64::from(byte >> bit & 1)));
            all.extend(bits.skip(bits_before(frame, plane)).take(count));
        } else {
            all.extend(bytes.chunks_exact(width).map(|bytes| set.endian.number(bytes)));
        }
    }
    let sample = |pixel: usize, channel: usize| {
        let place = match colors {
            // Two of luma, then what both pixels share.
            Colors::Ybr422 if channel == 0 => pixel / 2 * 4 + pixel % 2,
            Colors::Ybr422 => pixel / 2 * 4 + channel + 1,
            _ if is_planar => channel * area + pixel,
            _ => pixel * samples + channel,
        };
        value(all[place])
    };
    let mut values = reserved(area as u64, || samples_in(&set.path))?;
    match colors {
        Colors::Ybr | Colors::Ybr422 => values.extend((0..area).map(|pixel| {
            let [y, cb, cr] = [0, 1, 2].map(|channel| sample(pixel, channel) as f64);
            let (blue, red) = (cb - 128.0, cr - 128.0);
            let of = [y + 1.402 * red, y - 0.344_136 * blue - 0.714_136 * red, y + 1.772 * blue];
            of[channel].round().clamp(0.0, 255.0) as i64
        })),
        Colors::Palette => {
            let table = PaletteTable::of(set, channel, pixels.signed)?;
            values.extend((0..area).map(|pixel| table.at(sample(pixel, 0))));
        }
        Colors::Grey | Colors::Rgb => values.extend((0..area).map(|pixel| sample(pixel, channel))),
    }
    Ok(values)
}
