//! Kinds of DICOM that the fixtures lack, in files made here, and damaged copies of them.

use std::io::Write;
use std::path::Path;

use voxsplat::formats::{LoadOptions, load};
use voxsplat::volume::{Samples, Volume};

use crate::formats::fixtures::assert_affine;

pub(super) const EXPLICIT: &str = "1.2.840.10008.1.2.1";
pub(super) const IMPLICIT: &str = "1.2.840.10008.1.2";
const BIG: &str = "1.2.840.10008.1.2.2";
const DEFLATED: &str = "1.2.840.10008.1.2.1.99";

/// Encoded elements: their byte order, and whether they state their types.
#[derive(Clone)]
pub(super) struct Elements {
    pub(super) bytes: Vec<u8>,
    big: bool,
    typed: bool,
}

impl Elements {
    pub(super) fn new(big: bool, typed: bool) -> Self {
        Self { bytes: Vec::new(), big, typed }
    }

    fn number(&mut self, number: u32, bytes: usize) {
        let little = number.to_le_bytes();
        let mut all = little[..bytes].to_vec();
        if self.big {
            all.reverse();
        }
        self.bytes.extend(all);
    }

    /// An element whose stated length may be wrong.
    fn stated(mut self, tag: u32, kind: &str, length: u32, value: &[u8]) -> Self {
        self.number(tag >> 16, 2);
        self.number(tag & 0xffff, 2);
        let long = ["OB", "OW", "SQ", "UN"].contains(&kind);
        if self.typed {
            self.bytes.extend(kind.as_bytes());
            if long {
                self.bytes.extend([0; 2]);
            }
        }
        self.number(length, if long || !self.typed { 4 } else { 2 });
        self.bytes.extend(value);
        self
    }

    pub(super) fn with(self, tag: u32, kind: &str, value: &[u8]) -> Self {
        let mut value = value.to_vec();
        if value.len() % 2 == 1 {
            value.push(if kind.starts_with('O') { 0 } else { b' ' });
        }
        self.stated(tag, kind, value.len() as u32, &value)
    }

    pub(super) fn text(self, tag: u32, kind: &str, text: &str) -> Self {
        self.with(tag, kind, text.as_bytes())
    }

    pub(super) fn words(self, tag: u32, words: &[u16]) -> Self {
        let order = if self.big { u16::to_be_bytes } else { u16::to_le_bytes };
        let bytes: Vec<u8> = words.iter().flat_map(|word| order(*word)).collect();
        self.with(tag, "US", &bytes)
    }

    /// The size of the picture, its kind, and the bits of a sample.
    pub(super) fn picture(self, [columns, rows, frames]: [u16; 3], kind: &str, samples: u16, bits: u16) -> Self {
        self.words(0x0028_0002, &[samples])
            .text(0x0028_0004, "CS", kind)
            .words(0x0028_0006, &[0])
            .text(0x0028_0008, "IS", &frames.to_string())
            .words(0x0028_0010, &[rows])
            .words(0x0028_0011, &[columns])
            .text(0x0028_0030, "DS", "2\\3")
            .words(0x0028_0100, &[bits])
            .words(0x0028_0101, &[bits])
            .words(0x0028_0102, &[bits - 1])
            .words(0x0028_0103, &[0])
    }

    /// The file of a transfer syntax.
    pub(super) fn file(&self, syntax: &str) -> Vec<u8> {
        let syntax = Self::new(false, true).text(0x0002_0010, "UI", &format!("{syntax:\0<24}"));
        let length = (syntax.bytes.len() as u32).to_le_bytes();
        let head = Self::new(false, true).with(0x0002_0000, "UL", &length);
        [vec![0; 128], b"DICM".to_vec(), head.bytes, syntax.bytes, self.bytes.clone()].concat()
    }
}

pub(super) fn written(bytes: &[u8]) -> tempfile::NamedTempFile {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    file
}

fn channel(file: &Path, channel: Option<u32>) -> Result<Volume, String> {
    load(file, &LoadOptions { channel, ..LoadOptions::default() }).map_err(|error| error.to_string())
}

/// The values of a channel, or the error.
pub(super) fn values(bytes: &[u8], number: Option<u32>) -> Result<Vec<f64>, String> {
    let volume = channel(written(bytes).path(), number)?;
    let in_memory = volume.in_memory().unwrap();
    Ok((0..in_memory.samples().len()).map(|n| in_memory.value(n)).collect())
}

/// Elements of a dose of three frames of two pixels, with this number of offsets.
fn dose(orientation: &str, offsets: &str) -> Elements {
    let pixels: Vec<u8> = (1..=6).flat_map(|n: u32| (10 * n).to_le_bytes()).collect();
    Elements::new(false, true)
        .text(0x0008_0060, "CS", "RTDOSE")
        .text(0x0020_0032, "DS", "5\\6\\-70")
        .text(0x0020_0037, "DS", orientation)
        .picture([2, 1, 3], "MONOCHROME2", 1, 32)
        .text(0x3004_0002, "CS", "GY")
        .text(0x3004_000c, "DS", offsets)
        .text(0x3004_000e, "DS", "0.25")
        .with(0x7fe0_0010, "OW", &pixels)
}

#[test]
fn frames_of_doses_lie_at_their_offsets() {
    let (ahead, turned) = ("1\\0\\0\\0\\1\\0", "1\\0\\0\\0\\-1\\0");
    let rising = [2.5, 5.0, 7.5, 10.0, 12.5, 15.0];
    let falling = [12.5, 15.0, 7.5, 10.0, 2.5, 5.0];
    for (orientation, offsets, y, [step, first], expected) in [
        // From the position, along the normal.
        (ahead, "0\\4\\8", 2.0, [4.0, -70.0], rising),
        (ahead, "0\\-4\\-8", 2.0, [4.0, -78.0], falling),
        (turned, "0\\4\\8", -2.0, [-4.0, -70.0], rising),
        ("1\\0\\0\\0\\0\\1", "0\\4\\8", 2.0, [4.0, -70.0], rising),
        // Coordinates along z.
        (ahead, "-70\\-66\\-62", 2.0, [4.0, -70.0], rising),
        (turned, "-70\\-66\\-62", -2.0, [-4.0, -62.0], falling),
    ] {
        let file = written(&dose(orientation, offsets).file(EXPLICIT));
        let volume = channel(file.path(), None).unwrap();
        let in_memory = volume.in_memory().unwrap();
        let found: Vec<f64> = (0..6).map(|n| in_memory.value(n)).collect();
        assert_eq!(found, expected, "{orientation} {offsets}");
        assert_eq!((volume.grid().dims(), volume.value_unit()), ([2, 1, 3], Some("Gy")));
        let affine = if orientation.ends_with("0\\1") {
            // The normal of x and z is -y.
            [[3.0, 0.0, 0.0, 5.0], [0.0, 0.0, -step, 6.0], [0.0, y, 0.0, first]]
        } else {
            [[3.0, 0.0, 0.0, 5.0], [0.0, y, 0.0, 6.0], [0.0, 0.0, step, first]]
        };
        assert_affine(&volume, &affine, offsets);
    }
    for (offsets, words) in [
        ("0\\4\\9", "unequally spaced"),
        ("0\\4", "offsets of 2 frames, expected 3"),
        ("0\\4\\x", "offsets of frames that are no numbers"),
        ("0\\0\\0", "3 slices at one position"),
    ] {
        let error = values(&dose(ahead, offsets).file(EXPLICIT), None).unwrap_err();
        assert!(error.contains(words), "{offsets}: {error}");
    }
}

/// Elements of a picture of six pixels in a palette of three entries from 10 on, with this number of bits.
fn palette(big: bool, bits: u16, packed: bool) -> Elements {
    let mut elements = Elements::new(big, true).picture([6, 1, 1], "PALETTE COLOR", 1, 8);
    for (tag, _) in (0x0028_1101..).zip(0..3) {
        elements = elements.words(tag, &[3, 10, bits]);
    }
    for (tag, base) in (0x0028_1201..).zip([1_u16, 50, 200]) {
        let entries = [base, base + 1, base + 2, 0];
        let word = if big { u16::to_be_bytes } else { u16::to_le_bytes };
        let bytes: Vec<u8> = match packed {
            true => entries.chunks(2).flat_map(|two| word(two[0] | two[1] << 8)).collect(),
            false => entries[..3].iter().flat_map(|entry| word(entry * (bits / 8))).collect(),
        };
        elements = elements.with(tag, "OW", &bytes);
    }
    elements.with(0x7fe0_0010, "OB", &[9, 10, 11, 12, 13, 255])
}

#[test]
fn palettes_become_red_green_and_blue() {
    for (big, bits, packed) in [false, true].into_iter().flat_map(|b| [(b, 8, true), (b, 8, false), (b, 16, false)]) {
        let file = palette(big, bits, packed).file(if big { BIG } else { EXPLICIT });
        for (number, base) in (0..).zip([1.0, 50.0, 200.0]) {
            let scale = if bits == 16 { 2.0 } else { 1.0 };
            let expected = [0.0, 0.0, 1.0, 2.0, 2.0, 2.0].map(|entry| scale * (base + entry));
            assert_eq!(values(&file, Some(number)).unwrap(), expected, "{big} {bits} {packed}");
        }
        let error = values(&file, None).unwrap_err();
        assert!(error.contains("has 3 channels"), "{error}");
        let sample_type = channel(written(&file).path(), Some(0)).unwrap().sample_type();
        assert_eq!(sample_type.size(), if packed { 1 } else { 2 });
    }
    let whole = palette(false, 16, false);
    let bytes = whole.file(EXPLICIT);
    let replaced = |from: &[u8], to: &[u8]| {
        let at = bytes.windows(from.len()).position(|window| window == from).unwrap();
        [&bytes[..at], to, &bytes[at + from.len()..]].concat()
    };
    for (from, to, words) in [
        (&b"\x28\0\x01\x11US\x06\0\x03\0"[..], &b"\x28\0\x01\x11US\x06\0\x04\0"[..], "table is cut short"),
        (b"\x28\0\x01\x11US\x06\0\x03\0", b"\x28\0\x01\x11US\x06\0\0\0", "table is cut short"),
        (b"\x28\0\x01\x11US", b"\x28\0\x04\x11US", "without a descriptor"),
        (b"\x28\0\x02\x11US", b"\x28\0\x04\x11US", "without a descriptor"),
        (b"\x28\0\x02\x12OW", b"\x28\0\x04\x12OW", "without tables"),
    ] {
        let error = values(&replaced(from, to), Some(1)).unwrap_err();
        assert!(error.contains(words), "{words}: {error}");
    }
}

#[test]
fn shared_chroma_becomes_red_green_and_blue() {
    let elements = Elements::new(false, true).picture([4, 1, 1], "YBR_FULL_422", 3, 8);
    let pixels = [100, 150, 128, 128, 60, 70, 128, 228];
    let file = elements.clone().with(0x7fe0_0010, "OB", &pixels).file(EXPLICIT);
    // 100 of red difference are 140.2 of red and -71.4 of green.
    for (number, expected) in
        (0..).zip([[100.0, 150.0, 200.0, 210.0], [100.0, 150.0, 0.0, 0.0], [100.0, 150.0, 60.0, 70.0]])
    {
        assert_eq!(values(&file, Some(number)).unwrap(), expected);
    }
    let short = elements.with(0x7fe0_0010, "OB", &pixels[..6]).file(EXPLICIT);
    assert!(values(&short, Some(0)).unwrap_err().contains("1 frame needs 8 bytes, 6 are there"));
    let odd = Elements::new(false, true).picture([3, 1, 1], "YBR_FULL_422", 3, 8).with(0x7fe0_0010, "OB", &pixels);
    assert!(values(&odd.file(EXPLICIT), Some(0)).unwrap_err().contains("3 columns of YBR_FULL_422"));
}

#[test]
fn bits_follow_one_another_over_the_ends_of_frames() {
    let elements = Elements::new(false, true).picture([5, 1, 3], "MONOCHROME2", 1, 1);
    let file = elements.clone().with(0x7fe0_0010, "OB", &[0b0110_1001, 0b0010_1100]).file(EXPLICIT);
    let bits = [1, 0, 0, 1, 0, 1, 1, 0, 0, 0, 1, 1, 0, 1, 0].map(f64::from);
    assert_eq!(values(&file, None).unwrap(), bits);
    let short = elements.stated(0x7fe0_0010, "OB", 1, &[0b0110_1001]).file(EXPLICIT);
    assert!(values(&short, None).unwrap_err().contains("3 frames need 2 bytes, 1 are there"));
}

#[test]
fn bytes_in_words_of_big_endian_files_are_in_pairs() {
    // Frames of three bytes: pairs of bytes cross their ends.
    let elements = Elements::new(true, true).picture([3, 1, 2], "MONOCHROME2", 1, 8);
    for (kind, expected) in [("OB", [2, 1, 4, 3, 6, 5]), ("OW", [1, 2, 3, 4, 5, 6])] {
        let file = elements.clone().with(0x7fe0_0010, kind, &[2, 1, 4, 3, 6, 5]).file(BIG);
        assert_eq!(values(&file, None).unwrap(), expected.map(f64::from), "{kind}");
    }
}

fn deflated(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn bzip2(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::best());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

#[test]
fn compressed_files_hold_what_plain_ones_do() {
    let plain = dose("1\\0\\0\\0\\1\\0", "0\\4\\8");
    let expected = values(&plain.file(EXPLICIT), None).unwrap();
    let packed = Elements { bytes: deflated(&plain.bytes), ..plain.clone() }.file(DEFLATED);
    for file in [packed.clone(), gzip(&plain.file(EXPLICIT)), bzip2(&plain.file(EXPLICIT)), gzip(&packed)] {
        assert_eq!(values(&file, None).unwrap(), expected);
        // A file truncated anywhere before the end of the samples is refused.
        for end in (0..file.len() - 12).step_by(7) {
            let refused = values(&file[..end], None).err().unwrap_or_default();
            assert_eq!(refused.lines().count(), 1, "{end} of {} bytes: {refused}", file.len());
        }
    }
    // Fragments in gzip.
    let rle = std::fs::read(crate::formats::fixtures::path("rle-i16.dcm")).unwrap();
    assert_eq!(values(&gzip(&rle), None).unwrap(), values(&rle, None).unwrap());
}

#[test]
fn compressed_files_that_claim_too_much_are_refused() {
    let claims = |frames: u16, length: u32, pixels: &[u8]| {
        let elements = Elements::new(false, true).picture([65_535, 65_535, frames], "MONOCHROME2", 1, 8);
        let bytes = elements.stated(0x7fe0_0010, "OW", length, pixels).bytes;
        Elements { bytes: deflated(&bytes), big: false, typed: true }.file(DEFLATED)
    };
    for (file, words) in [
        (claims(1, u32::MAX - 1, &[0; 100]), "cut short"),
        (claims(9, 100, &[0; 100]), "9 frames need 38653526025 bytes, 100 are there"),
        // Half a MiB is far less than the picture needs.
        (claims(1, 1 << 19, &[0; 1 << 19]), "1 frame needs 4294836225 bytes, 524288 are there"),
    ] {
        let error = values(&file, None).unwrap_err();
        assert!(error.contains(words), "{error}");
    }
}

#[test]
fn elements_are_as_the_first_one_is() {
    let picture = |typed: bool| {
        let elements = Elements::new(false, typed).picture([3, 1, 1], "MONOCHROME2", 1, 8);
        elements.with(0x7fe0_0010, "OB", &[7, 8, 9])
    };
    for (typed, syntax) in [(true, EXPLICIT), (false, IMPLICIT), (true, IMPLICIT), (false, EXPLICIT)] {
        assert_eq!(values(&picture(typed).file(syntax), None).unwrap(), [7.0, 8.0, 9.0], "{typed} {syntax}");
    }
}

#[test]
fn positions_in_sequences_of_makers_and_pixels_of_icons_do_not_count() {
    let item = |elements: Elements| {
        let end = [0xfe, 0xff, 0x0d, 0xe0, 0, 0, 0, 0];
        [&[0xfe, 0xff, 0x00, 0xe0, 0xff, 0xff, 0xff, 0xff][..], &elements.bytes, &end].concat()
    };
    let new = || Elements::new(false, true);
    let place = |z: f64| new().text(0x0020_0032, "DS", &format!("1\\2\\{z}"));
    let frame = |z: f64| {
        let own = new().with(0x0020_9113, "SQ", &item(place(z)));
        item(own.with(0x2005_140f, "SQ", &item(place(z * z))))
    };
    // Fragments of an icon whose end begins no element.
    let fragments = [0xfe, 0xff, 0x00, 0xe0, 4, 0, 0, 0, 0xff, 0xd8, 0xff, 0xd9, 0xfe, 0xff, 0xdd, 0xe0, 0, 0, 0, 0];
    let icon = new().stated(0x7fe0_0010, "OB", u32::MAX, &fragments);
    let elements = new()
        .picture([1, 1, 3], "MONOCHROME2", 1, 8)
        .with(0x0088_0200, "SQ", &item(icon))
        .with(0x5200_9230, "SQ", &[frame(1.0), frame(3.0), frame(5.0)].concat())
        .with(0x7fe0_0010, "OB", &[7, 8, 9]);
    let file = written(&elements.file(EXPLICIT));
    let volume = channel(file.path(), None).unwrap();
    assert_affine(&volume, &[[3.0, 0.0, 0.0, 1.0], [0.0, 2.0, 0.0, 2.0], [0.0, 0.0, 2.0, 1.0]], "frames");
    assert_eq!(volume.in_memory().unwrap().samples(), &Samples::U8(vec![7, 8, 9]));
}

#[test]
fn damaged_files_are_read_or_refused() {
    let shared = Elements::new(false, true).picture([4, 1, 1], "YBR_FULL_422", 3, 8);
    let bits = Elements::new(false, true).picture([5, 1, 3], "MONOCHROME2", 1, 1);
    for (elements, number) in [
        (dose("1\\0\\0\\0\\1\\0", "0\\4\\8"), None),
        (palette(false, 16, false), Some(1)),
        (shared.with(0x7fe0_0010, "OB", &[9; 8]), Some(2)),
        (bits.with(0x7fe0_0010, "OB", &[0b0110_1001, 0b0010_1100]), None),
    ] {
        for at in 0..elements.bytes.len() {
            for change in [0xff, 0x80, 0x01] {
                let mut damaged = elements.clone();
                damaged.bytes[at] ^= change;
                let plain = damaged.file(EXPLICIT);
                damaged.bytes = deflated(&damaged.bytes);
                for file in [plain, damaged.file(DEFLATED)] {
                    if let Err(error) = values(&file, number) {
                        assert!(error.lines().count() == 1, "byte {at} by {change}: {error}");
                    }
                }
            }
        }
    }
}

#[test]
fn lossy_samples_beyond_their_bits_are_clipped() {
    let mut frame = std::fs::read(crate::formats::fixtures::path("lossy-u8.j2k")).unwrap();
    // A JP2 file around the code stream, as some writers add it, changes nothing.
    for boxes in [&b""[..], b"\0\0\0\x0cjP  \r\n\x87\n\0\0\0\x14ftypjp2 \0\0\0\0jp2 \0\0\0\0jp2c"] {
        frame = [boxes, &frame].concat();
        if frame.len() % 2 == 1 {
            frame.push(0);
        }
        let item = |bytes: &[u8]| [&[0xfe, 0xff, 0, 0xe0], &(bytes.len() as u32).to_le_bytes()[..], bytes].concat();
        let end = [0xfe, 0xff, 0xdd, 0xe0, 0, 0, 0, 0];
        let fragments = [item(b""), item(&frame), end.to_vec()].concat();
        let elements = Elements::new(false, true).picture([64, 64, 1], "MONOCHROME2", 1, 8);
        let file = elements.stated(0x7fe0_0010, "OB", u32::MAX, &fragments).file("1.2.840.10008.1.2.4.91");
        // Squares in black and white, which OpenJPEG decodes to within 23.
        for (n, value) in values(&file, None).unwrap().into_iter().enumerate() {
            let square = if (n % 64 / 16 + n / 64 / 16) % 2 == 1 { 255.0 } else { 0.0 };
            assert!((value - square).abs() <= 30.0, "sample {n} is {value}, expected about {square}");
        }
    }
}

#[test]
fn a_compression_that_is_not_read_is_named_with_a_way_out() {
    let fragments = [0xfe, 0xff, 0x00, 0xe0, 0, 0, 0, 0, 0xfe, 0xff, 0xdd, 0xe0, 0, 0, 0, 0];
    let elements = Elements::new(false, true).picture([3, 1, 1], "MONOCHROME2", 1, 8);
    let file = elements.stated(0x7fe0_0010, "OB", u32::MAX, &fragments).file("1.2.840.10008.1.2.4.201");
    let error = values(&file, None).unwrap_err();
    assert!(error.contains("by high-throughput JPEG 2000 (1.2.840.10008.1.2.4.201), which is not read"), "{error}");
    assert!(error.ends_with(": decompress it first, by gdcmconv --raw or by decompress of pydicom"), "{error}");
}
