//! Compressed pixels: a sequence of fragments; each frame has one or more of them (PS3.5, A.4).

use std::io::{self, Read, Seek, SeekFrom};

use jpeg_decoder::{ColorTransform, PixelFormat};

use super::dataset::Dataset;
use crate::error::{Damage, Error, Result, refuse, refuse_if};
use crate::memory::{self, reserved, samples_in};
use crate::names::counted;
use crate::volume::Endian;

/// The codec of compressed pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Codec {
    Rle,
    Jpeg,
    JpegLs,
    Jpeg2000,
}

/// The transfer syntaxes of compressed pixels by name; those without a codec are not read.
const SYNTAXES: [(&str, &str, Option<Codec>); 12] = [
    ("1.2.840.10008.1.2.4.50", "JPEG baseline", Some(Codec::Jpeg)),
    ("1.2.840.10008.1.2.4.51", "JPEG extended", Some(Codec::Jpeg)),
    ("1.2.840.10008.1.2.4.57", "JPEG lossless", Some(Codec::Jpeg)),
    ("1.2.840.10008.1.2.4.70", "JPEG lossless", Some(Codec::Jpeg)),
    ("1.2.840.10008.1.2.4.80", "JPEG-LS", Some(Codec::JpegLs)),
    ("1.2.840.10008.1.2.4.81", "JPEG-LS", Some(Codec::JpegLs)),
    ("1.2.840.10008.1.2.4.90", "JPEG 2000", Some(Codec::Jpeg2000)),
    ("1.2.840.10008.1.2.4.91", "JPEG 2000", Some(Codec::Jpeg2000)),
    ("1.2.840.10008.1.2.4.201", "high-throughput JPEG 2000", None),
    ("1.2.840.10008.1.2.4.202", "high-throughput JPEG 2000", None),
    ("1.2.840.10008.1.2.4.203", "high-throughput JPEG 2000", None),
    ("1.2.840.10008.1.2.5", "RLE", Some(Codec::Rle)),
];

/// The remedy for compressed pixels that are not read.
pub(super) const DECOMPRESS: &str = "decompress it first, by gdcmconv --raw or by decompress of pydicom";

/// Returns the name of a transfer syntax of compressed pixels, and the codec that reads it.
pub(super) fn syntax_of(uid: &str) -> Option<(&'static str, Option<Codec>)> {
    SYNTAXES.iter().find(|(known, ..)| *known == uid).map(|(_, name, codec)| (*name, *codec))
}

/// The frames of a file: each has one or more fragments.
pub(super) struct Frames {
    pub(super) codec: Codec,
    /// The first fragment of each frame.
    firsts: Vec<usize>,
}

/// The size of a compressed frame.
#[derive(Clone, Copy)]
pub(super) struct Size {
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// The number of samples of a pixel.
    pub(super) samples: usize,
    /// The number of bytes of a sample.
    pub(super) bytes: usize,
    /// Whether three samples are red, green and blue as they are stored, not luma and chroma.
    pub(super) is_rgb: bool,
}

impl Size {
    /// Refuses a picture of another size.
    fn check(self, width: u32, height: u32) -> io::Result<()> {
        let is_same = (width as usize, height as usize) == (self.columns, self.rows);
        refuse_if!(!is_same, Damage, "a picture of {width} x {height}");
        Ok(())
    }
}

impl Frames {
    /// Distributes the fragments of a file over `frames` frames.
    pub(super) fn find(set: &Dataset, frames: usize, codec: Codec) -> Result<Self> {
        // The table counts from the mark of the first fragment.
        let after = |next: &mut u64, [_, length]: &[u64; 2]| {
            *next += 8 + length;
            Some(*next - 8 - length)
        };
        let places: Vec<u64> = set.fragments.iter().scan(0, after).collect();
        let (offsets, _) = set.frame_table.as_chunks::<4>();
        let starting = |offset: &[u8; 4]| places.binary_search(&u32::from_le_bytes(*offset).into()).ok();
        let firsts = match () {
            () if frames == 1 && !places.is_empty() => Some(vec![0]),
            () if frames == places.len() => Some((0..frames).collect()),
            () if offsets.len() == frames => offsets.iter().map(starting).collect(),
            () => None,
        };
        match firsts.filter(|firsts: &Vec<usize>| firsts.is_sorted()) {
            Some(firsts) => Ok(Self { codec, firsts }),
            None => {
                let (frames, found) = (counted(frames as u64, "frame"), counted(places.len() as u64, "fragment"));
                refuse!(set, "has {frames} in {found}, and no table tells them apart")
            }
        }
    }

    /// Returns the samples of a frame as stored, without signs; the samples of a pixel are neighbours.
    pub(super) fn pixels(&self, set: &Dataset, frame: usize, size: Size) -> Result<Vec<u64>> {
        let first = |frame: usize| self.firsts.get(frame).copied().unwrap_or(set.fragments.len());
        let fragments = set.fragments.get(first(frame)..first(frame + 1)).unwrap_or_default();
        let mut file = set.open().map_err(Error::read(&set.path))?;
        let mut packed = Vec::new();
        for &[offset, length] in fragments {
            file.seek(SeekFrom::Start(offset)).map_err(Error::read(&set.path))?;
            (&mut file).take(length).read_to_end(&mut packed).map_err(Error::read(&set.path))?;
        }
        let count = size.columns.saturating_mul(size.rows).saturating_mul(size.samples) as u64;
        let what = || samples_in(&set.path);
        // Codecs of other crates cannot be refused memory without an abort.
        memory::check(count.saturating_mul(if self.codec == Codec::Jpeg2000 { 24 } else { 12 }), what)?;
        let mut pixels = reserved(count, what)?;
        let unpacked = match self.codec {
            Codec::Rle => unpack_rle(&packed, size, &mut pixels),
            Codec::Jpeg => unpack_jpeg(&packed, size, &mut pixels),
            Codec::JpegLs => unpack_jpeg_ls(&packed, size, &mut pixels),
            Codec::Jpeg2000 => unpack_jpeg_2000(&packed, size, &mut pixels),
        };
        let reason = match unpacked {
            Ok(()) if pixels.len() as u64 == count => return Ok(pixels),
            Ok(()) => format!("{} samples, expected {count}", pixels.len()),
            Err(reason) => reason.to_string(),
        };
        let name = syntax_of(&set.syntax).map(|(name, _)| name).unwrap_or_default();
        refuse!(set, "frame {}: {name}: {reason}", frame + 1)
    }
}

/// Decompresses run lengths as in PackBits, of the highest bytes of the first sample of all pixels, then of the next
/// ones, then of the next sample (PS3.5, G).
fn unpack_rle(packed: &[u8], size: Size, pixels: &mut Vec<u64>) -> io::Result<()> {
    let word = |n: usize| {
        let bytes = packed.get(4 * n..4 * n + 4).ok_or_else(|| Damage.error("its header is cut short"))?;
        Ok::<_, io::Error>(Endian::Little.number(bytes) as usize)
    };
    let segments = word(0)?;
    let are_bytes = segments == size.bytes * size.samples;
    refuse_if!(!are_bytes, Damage, "it has another number of segments than a pixel has bytes");
    let (count, cut) = (size.columns * size.rows, || Damage.error("a segment is cut short"));
    pixels.resize(count * size.samples, 0);
    for segment in 0..segments {
        let start = word(1 + segment)?;
        let end = if segment + 1 < segments { word(2 + segment)? } else { packed.len() };
        let mut bytes =
            packed.get(start..end).ok_or_else(|| Damage.error("a segment ends behind the frame"))?.iter().copied();
        let mut to = pixels.iter_mut().skip(segment / size.bytes).step_by(size.samples);
        let mut put = |byte: u8| to.next().map(|pixel| *pixel = *pixel << 8 | u64::from(byte)).is_some();
        let mut done = 0;
        while done < count {
            let length = bytes.next().ok_or_else(cut)?;
            let (run, repeated) = match length {
                0..=127 => (usize::from(length) + 1, None),
                128 => continue,
                _ => (257 - usize::from(length), Some(bytes.next().ok_or_else(cut)?)),
            };
            for _ in 0..run {
                let byte = repeated.or_else(|| bytes.next()).ok_or_else(cut)?;
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

fn unpack_jpeg(packed: &[u8], size: Size, pixels: &mut Vec<u64>) -> io::Result<()> {
    let mut decoder = jpeg_decoder::Decoder::new(packed);
    let most = size.columns.saturating_mul(size.rows).saturating_mul(2).saturating_mul(size.samples);
    decoder.set_max_decoding_buffer_size(most);
    if size.is_rgb {
        decoder.set_color_transform(ColorTransform::RGB);
    }
    decoder.read_info().map_err(|error| match error {
        jpeg_decoder::Error::Unsupported(what) => Damage.error(format!("{what:?} is not read: {DECOMPRESS}")),
        other => io::Error::other(other),
    })?;
    let info = decoder.info().ok_or_else(|| Damage.error("no header"))?;
    size.check(info.width.into(), info.height.into())?;
    let bytes = match (info.pixel_format, size.samples) {
        (PixelFormat::L8, 1) | (PixelFormat::RGB24, 3) => 1,
        (PixelFormat::L16, 1) => 2,
        (PixelFormat::L8 | PixelFormat::L16, _) => refuse!(Damage, "grey values, expected colours"),
        (PixelFormat::RGB24 | PixelFormat::CMYK32, _) => refuse!(Damage, "colours, expected grey values"),
    };
    refuse_if!(bytes > size.bytes, Damage, "{bytes} bytes a pixel, expected {}", size.bytes);
    let content = decoder.decode().map_err(io::Error::other)?;
    pixels.extend(content.chunks_exact(bytes).map(|sample| Endian::NATIVE.number(sample)));
    Ok(())
}

fn unpack_jpeg_ls(packed: &[u8], size: Size, pixels: &mut Vec<u64>) -> io::Result<()> {
    refuse_if!(size.samples != 1, Damage, "colours, which are not read: {DECOMPRESS}");
    // The decoder reserves no memory before it has compared the sizes. Where arithmetic is checked for overflow, as in
    // builds for debugging, it panics on some damaged pictures.
    let decode = || jpegls::decode(packed, size.columns as u32, size.rows as u32);
    let decoded = std::panic::catch_unwind(decode).map_err(|_| Damage.error("its samples are out of range"))?;
    let (samples, ..) = decoded.map_err(io::Error::other)?;
    pixels.extend(samples.into_iter().map(u64::from));
    Ok(())
}

#[cfg(not(feature = "jpeg2000"))]
fn unpack_jpeg_2000(_: &[u8], _: Size, _: &mut Vec<u64>) -> io::Result<()> {
    refuse!(Damage, "this build has no decoder of it: build it with --features jpeg2000")
}

#[cfg(feature = "jpeg2000")]
fn unpack_jpeg_2000(packed: &[u8], size: Size, pixels: &mut Vec<u64>) -> io::Result<()> {
    use hayro_jpeg2000::{DecodeSettings, DecoderContext, Image};

    let settings = DecodeSettings { resolve_palette_indices: false, strict: true, target_resolution: None };
    // The standard wants the code stream alone. Some files have boxes around it, which repeat what DICOM says.
    let start = packed.windows(4).position(|four| four == [0xff, 0x4f, 0xff, 0x51]).unwrap_or(0);
    let packed = packed.get(start..).unwrap_or_default();
    let image = Image::new(packed, &settings).map_err(io::Error::other)?;
    size.check(image.width(), image.height())?;
    let depth = u32::from(image.original_bit_depth());
    let most = (8 * size.bytes as u32).min(24);
    refuse_if!(!(1..=most).contains(&depth), Damage, "{depth} bits a pixel, expected at most {most}");
    let mut context = DecoderContext::default();
    let decoded = image.decode(&mut context).map_err(io::Error::other)?;
    let components = decoded.components();
    let found = components.len();
    refuse_if!(found != size.samples, Damage, "{found} components, expected {}", size.samples);
    // The crate adds half of the range to signed samples too.
    let is_signed = packed.get(42).is_some_and(|precision| precision & 0x80 != 0);
    let moved = if is_signed { 1_i64 << (depth - 1) } else { 0 };
    // Lossy samples can lie just outside of the range.
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
    fn damaged_pictures_in_jpeg_ls_are_refused() {
        let size = Size { columns: 64, rows: 64, samples: 1, bytes: 2, is_rgb: false };
        let mut seed = 1_u64;
        for precision in [8, 12, 16] {
            let header = [0xff, 0xd8, 0xff, 0xf7, 0, 11, precision, 0, 64, 0, 64, 1, 1, 0x11, 0];
            let scan = [0xff, 0xda, 0, 8, 1, 1, 0, 0, 0, 0];
            // Few bits that are set are large numbers.
            let sparse = (0..9000).map(|_| {
                seed ^= seed << 13;
                seed ^= seed >> 7;
                seed ^= seed << 17;
                seed as u8 & (seed >> 8) as u8 & 0x7f
            });
            let packed: Vec<u8> = header.into_iter().chain(scan).chain(sparse).chain([0xff, 0xd9]).collect();
            let mut pixels = Vec::new();
            assert!(unpack_jpeg_ls(&packed, size, &mut pixels).is_err());
            let other = Size { rows: 65, ..size };
            assert!(unpack_jpeg_ls(&packed, other, &mut pixels).is_err());
        }
    }

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
