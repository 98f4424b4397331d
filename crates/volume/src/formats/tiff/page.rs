//! The pages of a file of TIFF: the statements of their directories, and their samples.

use std::path::Path;

use tiff::decoder::Decoder;
use tiff::tags::Tag;
use tiff::{TiffError, TiffUnsupportedError};

use super::view::PatchedFile;
use crate::error::{Error, Result, Subject, refuse, refuse_if};
use crate::formats::decode::Kind;
use crate::formats::input;
use crate::formats::placement::lattice;
use crate::memory::{samples_in, zeroed};
use crate::volume::Number;

/// The largest number of bytes that a codec makes of one: LZW makes at most 4096 bytes of 12 bits.
pub(super) const MAX_EXPANSION: u64 = 2731;

/// The order of the bits of a byte, a tag that the crate has no name for.
const FILL_ORDER: Tag = Tag::Unknown(266);

/// Returns the largest number of bytes that a codec makes of one. A page that claims more is refused.
fn expansion(compression: u32) -> u64 {
    match compression {
        1 => 1,
        8 | 32946 => input::MAX_EXPANSION,
        // PackBits repeats a byte up to 128 times.
        32773 => 64,
        _ => MAX_EXPANSION,
    }
}

/// The properties of a page of TIFF.
pub(super) struct TiffPage {
    pub(super) size: [u32; 2],
    /// The number of sections of a page that is a volume; 1 for other pages.
    pub(super) depth: u32,
    pub(super) kind: Kind,
    /// The number of samples of a pixel.
    pub(super) samples: u16,
    /// Whether the samples of a pixel are in planes behind one another.
    pub(super) planar: bool,
    /// Whether the samples of a pixel are colours.
    pub(super) coloured: bool,
    /// Whether samples are numbers of a palette.
    pub(super) indexed: bool,
    /// Whether pairs of samples are complex numbers.
    pub(super) complex: bool,
    /// The first byte of the samples and the byte after the last, if they are uncompressed and in one piece.
    pub(super) plain: Option<[u64; 2]>,
    /// The largest number of bytes that the codec of the page makes of one.
    pub(super) expansion: u64,
    /// The number of strips or tiles of the page.
    pub(super) chunks: u64,
    /// The number of bits of a sample, if it has less than a byte, and whether the first sample is in the lowest bits.
    packed: Option<(u32, bool)>,
    /// The size of tiles and their number along each axis, if they have several sections.
    tiles: Option<[[usize; 3]; 2]>,
}

impl TiffPage {
    /// Returns the number of pixels of a section of the page.
    pub(super) fn area(&self) -> u64 {
        u64::from(self.size[0]) * u64::from(self.size[1])
    }

    /// Returns the number of samples of the page.
    pub(super) fn len(&self) -> u64 {
        self.area().saturating_mul(self.samples.into()).saturating_mul(self.depth.into())
    }

    /// Returns the number of bytes of the page without compression.
    fn bytes(&self) -> u64 {
        match self.packed {
            None => self.len().saturating_mul(self.kind.size() as u64),
            Some((bits, _)) => self.packed_row(bits).saturating_mul((self.size[1] * self.depth).into()),
        }
    }

    /// Returns the number of bytes of a row of samples of less than a byte.
    fn packed_row(&self, bits: u32) -> u64 {
        (u64::from(self.size[0]) * u64::from(self.samples) * u64::from(bits)).div_ceil(8)
    }

    /// Describes the size and the type of the page, which all pages of a series share.
    pub(super) fn described(&self) -> String {
        let ([x, y], kind) = (self.size, self.kind.name());
        let size = if self.depth == 1 { format!("{x} x {y}") } else { format!("{x} x {y} x {}", self.depth) };
        match (self.samples, self.planar) {
            (1, _) => format!("{size} {kind}"),
            (n, false) => format!("{size} pixels of {n} {kind}"),
            (n, true) => format!("{n} planes of {size} {kind}"),
        }
    }

    /// Refuses pages that need more bytes than an expansion can make of those `held` in the file.
    pub(super) fn check_length(&self, path: &Path, pages: u64, held: u64, expansion: u64) -> Result<()> {
        let needed = self.bytes().saturating_mul(pages);
        if needed <= held.saturating_mul(expansion) {
            return Ok(());
        }
        let ([x, y], sections) = (self.size, pages * u64::from(self.depth));
        let size = if sections == 1 { format!("{x} x {y}") } else { format!("{x} x {y} x {sections}") };
        let there = match expansion {
            1 => format!("{held} are there"),
            _ => format!("and {held} compressed bytes cannot hold that many"),
        };
        refuse!(path, "is cut short, or its header claims too much: {size} samples need {needed} bytes, {there}")
    }

    /// Reads the properties of the page whose directory the decoder is at, in a file of `length` bytes. Where the crate
    /// could not decode the page, or would change its samples, the directory gets other entries.
    pub(super) fn of(decoder: &mut Decoder<PatchedFile>, path: &Path, length: u64) -> Result<Self> {
        let failed = |error| failed(path, error);
        let place = decoder.ifd_pointer().map_or(0, |pointer| pointer.0);
        let folded = decoder.inner().folded(place);
        let (width, height) = decoder.dimensions().map_err(failed)?;
        let [width, height, depth] = folded.map_or([width, height, 1], |folded| folded.size);
        let mut number = |tag: Tag, default: u32| -> Result<u32> {
            // Some tags have a number for each channel; all of them are alike.
            let value = decoder.find_tag_unsigned_vec::<u32>(tag).map_err(failed)?;
            Ok(value.and_then(|numbers| numbers.first().copied()).unwrap_or(default))
        };
        let samples = number(Tag::SamplesPerPixel, 1)?;
        let samples = u16::try_from(samples).ok().filter(|samples| *samples > 0);
        let samples = samples.ok_or_else(|| Error::format(path, "has pixels without samples"))?;
        let mut replaced: Vec<(u16, u32)> = Vec::new();
        let photometric = number(Tag::PhotometricInterpretation, 1)?;
        match photometric {
            1 | 2 => {}
            // Samples are read as stored, whether 0 is black, white, or the first colour of a palette.
            0 | 3 | 4 => replaced.push((Tag::PhotometricInterpretation.to_u16(), 1)),
            other => {
                let reason = format!("its samples have the photometric interpretation {other}");
                refuse!(path, "{reason}; save it in grey or in RGB");
            }
        }
        let planar = samples > 1 && number(Tag::PlanarConfiguration, 1)? == 2;
        let (bits, format) = (number(Tag::BitsPerSample, 1)?, number(Tag::SampleFormat, 1)?);
        let packed = match (bits, format) {
            (1 | 2 | 4, 1) => Some((bits, number(FILL_ORDER, 1)? == 2)),
            _ => None,
        };
        // Two floats for a complex number.
        let complex = format == 6;
        let (letter, width_of) = match format {
            1 if packed.is_some() => ("u", 8),
            6 => ("f", bits / 2),
            format => (["", "u", "i", "f"].get(format as usize).copied().unwrap_or_default(), bits),
        };
        let kind = Kind::of_numpy(&format!("{letter}{}", width_of / 8)).filter(|_| width_of % 8 == 0);
        let Some(kind) = kind.filter(|kind| !complex || (*kind != Kind::Half && samples == 1)) else {
            refuse!(path, "has samples of {bits} bits in format {format}, which is not read");
        };
        let samples = if complex { samples.saturating_mul(2) } else { samples };
        let expansion = expansion(number(Tag::Compression, 1)?);
        let compressed = expansion != 1 || number(Tag::Predictor, 1)? != 1;
        let mut table =
            |tag: Tag| decoder.find_tag_unsigned_vec::<u64>(tag).map_err(failed).map(Option::unwrap_or_default);
        let mut offsets = table(Tag::StripOffsets)?;
        let in_strips = !offsets.is_empty();
        if !in_strips {
            offsets = table(Tag::TileOffsets)?;
        }
        let counts = table(if in_strips { Tag::StripByteCounts } else { Tag::TileByteCounts })?;
        lattice(path, &[width.into(), height.into(), depth.into()])?;
        let whole = counts.len() == offsets.len();
        // Of a strip that ends behind the end of the file only its beginning is there.
        let there = |(offset, count): (&u64, &u64)| length.saturating_sub(*offset).min(*count);
        let held = if whole { offsets.iter().zip(&counts).map(there).fold(0, u64::saturating_add) } else { length };
        let mut page = Self {
            size: [width, height],
            depth,
            kind,
            samples,
            planar,
            coloured: photometric == 2,
            indexed: photometric == 3,
            complex,
            plain: None,
            expansion,
            chunks: offsets.len() as u64,
            packed,
            tiles: folded.and_then(|folded| folded.tiles).map(|of| of.map(|size| size.map(|n| n as usize))),
        };
        page.check_length(path, 1, held.min(length), expansion)?;
        if !compressed && in_strips && packed.is_none() {
            let bytes = page.bytes();
            let next = |(pair, count): (&[u64], &u64)| pair[0].checked_add(*count) == Some(pair[1]);
            let follow = offsets.windows(2).zip(&counts).all(next);
            let total = counts.iter().fold(0, |sum: u64, n| sum.saturating_add(*n));
            let is_plain = follow && whole && total == bytes;
            page.plain = is_plain.then(|| [offsets[0], offsets[0].saturating_add(bytes)]);
        }
        // The crate swaps the bytes of a complex number as a whole.
        refuse_if!(complex && page.plain.is_none(), path, "has compressed complex numbers, which are not read");
        refuse_if!(
            depth > 1 && (planar || packed.is_some()),
            path,
            "has volumes of planes or bits, which are not read"
        );
        if !replaced.is_empty() {
            decoder.inner().replace(place, &replaced).map_err(Error::read(path))?;
        }
        Ok(page)
    }

    /// Reads all samples of the page in the directory of this number: by section, row, pixel and channel, or plane
    /// after plane.
    pub(super) fn read<T: Number>(
        &self,
        decoder: &mut Decoder<PatchedFile>,
        directory: usize,
        path: &Path,
        samples: &mut [T],
    ) -> Result<()> {
        let failed = |error| failed(path, error);
        decoder.seek_to_image(directory).map_err(failed)?;
        let needed = decoder.image_buffer_layout().map_err(failed)?.complete_len;
        let mut read = |bytes: &mut [u8]| {
            if needed != bytes.len() {
                // The crate leaves out samples beyond the colours.
                let error = TiffUnsupportedError::UnsupportedDataType;
                return Err(failed(TiffError::UnsupportedError(error)));
            }
            decoder.read_image_bytes(bytes).map_err(failed)
        };
        if let Some((bits, reversed)) = self.packed {
            let mut bytes: Vec<u8> = zeroed(self.bytes(), || samples_in(path))?;
            read(&mut bytes)?;
            let (row, in_row) = (self.packed_row(bits) as usize, self.size[0] as usize * usize::from(self.samples));
            let out: &mut [u8] = bytemuck::cast_slice_mut(samples);
            for (out, packed) in out.chunks_exact_mut(in_row).zip(bytes.chunks_exact(row)) {
                for (n, sample) in out.iter_mut().enumerate() {
                    let (at, shift) = (n * bits as usize / 8, n * bits as usize % 8);
                    let byte = if reversed { packed[at].reverse_bits() } else { packed[at] };
                    *sample = byte << shift >> (8 - bits);
                }
            }
            return Ok(());
        }
        let Some([tile, counts]) = self.tiles else { return read(bytemuck::cast_slice_mut(samples)) };
        let pixel = usize::from(self.samples);
        let all = (tile.iter().product::<usize>() as u64).saturating_mul(counts.iter().product::<usize>() as u64);
        let mut unfolded: Vec<T> = zeroed(all.saturating_mul(pixel as u64), || samples_in(path))?;
        read(bytemuck::cast_slice_mut(&mut unfolded))?;
        let ([width, height], [of_x, of_y, of_z]) = (self.size.map(|n| n as usize), tile);
        for (n, row) in samples.chunks_exact_mut(width * pixel).enumerate() {
            let (y, z) = (n % height, n / height);
            // The tiles of a row of tiles lie beside each other, and the rows below each other, z slowest.
            let at = ((z / of_z * counts[1] + y / of_y) * of_z + z % of_z) * of_y + y % of_y;
            let start = at * of_x * counts[0] * pixel;
            row.copy_from_slice(&unfolded[start..start + row.len()]);
        }
        Ok(())
    }
}

/// Returns an error of the crate `tiff` as one of ours: of the file, or of the content.
pub(super) fn failed(path: &Path, error: TiffError) -> Error {
    match error {
        TiffError::IoError(source) if source.kind() == std::io::ErrorKind::UnexpectedEof => {
            path.error("is cut short: a directory or a page ends behind the end of the file")
        }
        TiffError::IoError(source) => Error::of_content(path, source),
        other => path.error(format!("is damaged, or TIFF of a kind that is not read: {other}")),
    }
}
