//! Compressed pixels: a sequence of fragments, of which each frame has one or more (PS3.5, A.4).

use std::io::{Read, Seek, SeekFrom};

use jpeg_decoder::{ColorTransform, PixelFormat};

use super::dataset::Dataset;
use crate::error::{Error, Result, refuse};
use crate::memory::{self, reserved, samples_in};
use crate::names::counted;
use crate::volume::Endian;

/// The most fragments of a file.
const MAX_FRAGMENTS: usize = 1 << 20;

/// How pixels are compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Codec {
    Rle,
    Jpeg,
    Jpeg2000,
}

/// The transfer syntaxes of compressed pixels by name; those without a codec are not read.
const SYNTAXES: [(&str, &str, Option<Codec>); 12] = [
    ("1.2.840.10008.1.2.4.50", "JPEG baseline", Some(Codec::Jpeg)),
    ("1.2.840.10008.1.2.4.51", "JPEG extended", Some(Codec::Jpeg)),
    ("1.2.840.10008.1.2.4.57", "JPEG lossless", Some(Codec::Jpeg)),
    ("1.2.840.10008.1.2.4.70", "JPEG lossless", Some(Codec::Jpeg)),
    ("1.2.840.10008.1.2.4.80", "JPEG-LS", None),
    ("1.2.840.10008.1.2.4.81", "JPEG-LS", None),
    ("1.2.840.10008.1.2.4.90", "JPEG 2000", Some(Codec::Jpeg2000)),
    ("1.2.840.10008.1.2.4.91", "JPEG 2000", Some(Codec::Jpeg2000)),
    ("1.2.840.10008.1.2.4.201", "high-throughput JPEG 2000", None),
    ("1.2.840.10008.1.2.4.202", "high-throughput JPEG 2000", None),
    ("1.2.840.10008.1.2.4.203", "high-throughput JPEG 2000", None),
    ("1.2.840.10008.1.2.5", "RLE", Some(Codec::Rle)),
];

/// The name of a transfer syntax of compressed pixels, and the codec that reads it.
pub(super) fn syntax_of(uid: &str) -> Option<(&'static str, Option<Codec>)> {
    SYNTAXES.iter().find(|(known, ..)| *known == uid).map(|(_, name, codec)| (*name, *codec))
}

/// Where the frames of a file are: the fragments of each, by offset and length.
pub(super) struct Frames {
    pub(super) codec: Codec,
    fragments: Vec<[u64; 2]>,
    /// The first fragment of each frame.
    firsts: Vec<usize>,
}

/// The size of a frame.
#[derive(Clone, Copy)]
pub(super) struct Size {
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// The samples of a pixel.
    pub(super) samples: usize,
    /// Bytes of a sample.
    pub(super) bytes: usize,
    /// Whether three samples are red, green and blue as they are stored, not luma and chroma.
    pub(super) is_rgb: bool,
}

impl Frames {
    /// Finds the fragments of a file with so many frames whose pixels begin at `start`.
    pub(super) fn find(set: &Dataset, start: u64, frames: usize, codec: Codec) -> Result<Self> {
        let read_error = |source| Error::Read { path: set.path.clone(), source };
        let mut file = set.open().map_err(read_error)?;
        let end = file.seek(SeekFrom::End(0)).map_err(read_error)?;
        let (mut at, mut table, mut fragments) = (start, None, Vec::new());
        loop {
            let mut head = [0; 8];
            if end.saturating_sub(at) < 8 {
                break;
            }
            file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(&mut head)).map_err(read_error)?;
            let [tag, length] = [&head[..4], &head[4..]].map(|bytes| Endian::Little.number(bytes));
            let content = at + 8;
            match tag {
                // The mark of the end.
                0xe0dd_fffe => break,
                0xe000_fffe if length > end - content => {
                    refuse!(set, "is cut short: a fragment ends behind the end of the file")
                }
                0xe000_fffe => {}
                _ => refuse!(set, "is damaged: a fragment does not begin where it should"),
            }
            match &table {
                // The first item has the offsets of frames, or nothing.
                None => {
                    let mut offsets = vec![0; length.min(4 * frames as u64) as usize];
                    file.read_exact(&mut offsets).map_err(read_error)?;
                    table = Some(offsets);
                }
                Some(_) if fragments.len() == MAX_FRAGMENTS => refuse!(set, "has too many fragments"),
                Some(_) => fragments.push([content, length]),
            }
            at = content + length;
        }
        let offsets = table.unwrap_or_default();
        let (offsets, _) = offsets.as_chunks::<4>();
        let first = fragments.first().map_or(0, |[content, _]| content - 8);
        let starting = |offset: &[u8; 4]| {
            let content = first + u64::from(u32::from_le_bytes(*offset)) + 8;
            fragments.binary_search_by_key(&content, |[content, _]| *content).ok()
        };
        let firsts = match () {
            () if frames == 1 && !fragments.is_empty() => Some(vec![0]),
            () if frames == fragments.len() => Some((0..frames).collect()),
            () if offsets.len() == frames => offsets.iter().map(starting).collect(),
            () => None,
        };
        let firsts = firsts.filter(|firsts: &Vec<usize>| firsts.is_sorted());
        let Some(firsts) = firsts else {
            let (frames, fragments) = (counted(frames as u64, "frame"), counted(fragments.len() as u64, "fragment"));
            refuse!(set, "has {frames} in {fragments}, and no table tells them apart");
        };
        Ok(Self { codec, fragments, firsts })
    }

    /// The samples of a frame as stored, without signs, those of a pixel beside each other.
    pub(super) fn pixels(&self, set: &Dataset, frame: usize, size: Size) -> Result<Vec<u64>> {
        let read_error = |source| Error::Read { path: set.path.clone(), source };
        let first = self.firsts.get(frame).copied().unwrap_or(self.fragments.len());
        let end = self.firsts.get(frame + 1).copied().unwrap_or(self.fragments.len());
        let fragments = self.fragments.get(first..end).unwrap_or_default();
        let mut file = set.open().map_err(read_error)?;
        let mut packed = Vec::new();
        for &[offset, length] in fragments {
            file.seek(SeekFrom::Start(offset)).map_err(read_error)?;
            (&mut file).take(length).read_to_end(&mut packed).map_err(read_error)?;
        }
        let count = size.columns.saturating_mul(size.rows).saturating_mul(size.samples) as u64;
        let what = || samples_in(&set.path);
        // Codecs of other crates cannot be refused memory without an abort.
        memory::check(count.saturating_mul(if self.codec == Codec::Jpeg2000 { 24 } else { 12 }), what)?;
        let mut pixels = reserved(count, what)?;
        let unpacked = match self.codec {
            Codec::Rle => unpack_rle(&packed, size, &mut pixels),
            Codec::Jpeg => unpack_jpeg(&packed, size, &mut pixels),
            Codec::Jpeg2000 => unpack_jpeg_2000(&packed, size, &mut pixels),
        };
        let reason = match unpacked {
            Ok(()) if pixels.len() as u64 == count => return Ok(pixels),
            Ok(()) => format!("{} samples, expected {count}", pixels.len()),
            Err(reason) => reason,
        };
        let name = syntax_of(&set.syntax).map(|(name, _)| name).unwrap_or_default();
        refuse!(set, "frame {}: {name}: {reason}", frame + 1)
    }
}

/// Run lengths as in PackBits, of the highest bytes of the first sample of all pixels, then of the next ones, then of
/// the next sample (PS3.5, G).
fn unpack_rle(packed: &[u8], size: Size, pixels: &mut Vec<u64>) -> Result<(), String> {
    let word = |n: usize| {
        let bytes = packed.get(4 * n..4 * n + 4).ok_or("its header is cut short")?;
        Ok::<_, String>(Endian::Little.number(bytes) as usize)
    };
    let segments = word(0)?;
    if segments != size.bytes * size.samples {
        return Err("it has another number of segments than a pixel has bytes".to_owned());
    }
    let count = size.columns * size.rows;
    pixels.resize(count * size.samples, 0);
    for segment in 0..segments {
        let start = word(1 + segment)?;
        let end = if segment + 1 < segments { word(2 + segment)? } else { packed.len() };
        let mut bytes = packed.get(start..end).ok_or("a segment ends behind the frame")?.iter().copied();
        let mut to = pixels.iter_mut().skip(segment / size.bytes).step_by(size.samples);
        let mut put = |byte: u8| to.next().map(|pixel| *pixel = *pixel << 8 | u64::from(byte)).is_some();
        let mut done = 0;
        while done < count {
            let length = bytes.next().ok_or("a segment is cut short")?;
            let (run, repeated) = match length {
                0..=127 => (usize::from(length) + 1, None),
                128 => continue,
                _ => (257 - usize::from(length), Some(bytes.next().ok_or("a segment is cut short")?)),
            };
            for _ in 0..run {
                let byte = repeated.or_else(|| bytes.next()).ok_or("a segment is cut short")?;
                // A run may reach behind the last pixel, where the length of a segment was made even.
                if !put(byte) {
                    break;
                }
            }
            done += run;
        }
    }
    Ok(())
}

fn unpack_jpeg(packed: &[u8], size: Size, pixels: &mut Vec<u64>) -> Result<(), String> {
    let mut decoder = jpeg_decoder::Decoder::new(packed);
    let most = size.columns.saturating_mul(size.rows).saturating_mul(2).saturating_mul(size.samples);
    decoder.set_max_decoding_buffer_size(most);
    if size.is_rgb {
        decoder.set_color_transform(ColorTransform::RGB);
    }
    decoder.read_info().map_err(|error| error.to_string())?;
    let info = decoder.info().ok_or("no header")?;
    let found = (usize::from(info.width), usize::from(info.height));
    if found != (size.columns, size.rows) {
        return Err(format!("a picture of {} x {}", found.0, found.1));
    }
    let bytes = match (info.pixel_format, size.samples) {
        (PixelFormat::L8, 1) | (PixelFormat::RGB24, 3) => 1,
        (PixelFormat::L16, 1) => 2,
        (PixelFormat::L8 | PixelFormat::L16, _) => return Err("grey values, expected colours".to_owned()),
        (PixelFormat::RGB24 | PixelFormat::CMYK32, _) => return Err("colours, expected grey values".to_owned()),
    };
    if bytes > size.bytes {
        return Err(format!("{bytes} bytes a pixel, expected {}", size.bytes));
    }
    let content = decoder.decode().map_err(|error| error.to_string())?;
    pixels.extend(content.chunks_exact(bytes).map(|sample| Endian::NATIVE.number(sample)));
    Ok(())
}

#[cfg(not(feature = "jpeg2000"))]
fn unpack_jpeg_2000(_: &[u8], _: Size, _: &mut Vec<u64>) -> Result<(), String> {
    Err("this build has no decoder of it: build it with --features jpeg2000".to_owned())
}

#[cfg(feature = "jpeg2000")]
fn unpack_jpeg_2000(packed: &[u8], size: Size, pixels: &mut Vec<u64>) -> Result<(), String> {
    use hayro_jpeg2000::{DecodeSettings, DecoderContext, Image};

    let settings = DecodeSettings { resolve_palette_indices: false, strict: true, target_resolution: None };
    // The standard wants the code stream alone. Some files have boxes around it, which repeat what DICOM says.
    let start = packed.windows(4).position(|four| four == [0xff, 0x4f, 0xff, 0x51]).unwrap_or(0);
    let packed = packed.get(start..).unwrap_or_default();
    let image = Image::new(packed, &settings).map_err(|error| error.to_string())?;
    if (image.width() as usize, image.height() as usize) != (size.columns, size.rows) {
        return Err(format!("a picture of {} x {}", image.width(), image.height()));
    }
    let depth = u32::from(image.original_bit_depth());
    if depth == 0 || depth > 8 * size.bytes as u32 || depth > 24 {
        return Err(format!("{depth} bits a pixel, expected at most {}", 8 * size.bytes));
    }
    let mut context = DecoderContext::default();
    let decoded = image.decode(&mut context).map_err(|error| error.to_string())?;
    let components = decoded.components();
    if components.len() != size.samples {
        return Err(format!("{} components, expected {}", components.len(), size.samples));
    }
    // The crate moves signed samples up, as it should unsigned ones alone.
    let is_signed = packed.get(42).is_some_and(|precision| precision & 0x80 != 0);
    let moved = if is_signed { 1_i64 << (depth - 1) } else { 0 };
    // What is not lossless can be just outside of what the bits can say.
    let sample = |sample: f32| ((sample.round() as i64).clamp(0, (1 << depth) - 1) - moved).cast_unsigned();
    let all: Vec<&[f32]> = components.iter().map(|component| component.samples()).collect();
    let shortest = all.iter().map(|samples| samples.len()).min().unwrap_or(0);
    for pixel in 0..shortest {
        pixels.extend(all.iter().map(|samples| sample(samples[pixel])));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn run_lengths_are_those_of_the_standard() {
        let size = Size { columns: 3, rows: 2, samples: 1, bytes: 1, is_rgb: false };
        let unpacked = |segment: &[u8], bytes: usize| {
            let mut packed = vec![0; 64];
            packed[0] = bytes as u8;
            packed[4] = 64;
            packed.extend(segment);
            let mut pixels = Vec::new();
            unpack_rle(&packed, size, &mut pixels).map(|()| pixels)
        };
        assert_eq!(unpacked(&[2, 7, 8, 9, 254, 5], 1).unwrap(), [7, 8, 9, 5, 5, 5]);
        assert_eq!(unpacked(&[128, 251, 4, 0], 1).unwrap(), [4; 6]);
        // Behind the last pixel is what makes the length even.
        assert_eq!(unpacked(&[250, 4, 0], 1).unwrap(), [4; 6]);
        assert!(unpacked(&[2, 7, 8], 1).is_err() && unpacked(&[251], 1).is_err() && unpacked(&[251, 1], 2).is_err());
    }
}
