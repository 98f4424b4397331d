//! Segmentations of DICOM, and slices in JPEG-LS. tests/data/volumes/make_seg.py writes the fixtures.

use serde::Deserialize;
use voxsplat::formats::{LoadOptions, load};
use voxsplat::volume::{SampleType, Volume};

use crate::formats::dicom::{EXPLICIT, Elements, IMPLICIT, values, written};
use crate::formats::fixtures::{affine, path};

/// The contents of a file, according to highdicom and CharLS.
#[derive(Deserialize)]
struct Expected {
    file: String,
    dims: [u32; 3],
    #[serde(default)]
    affine: Option<[[f64; 4]; 3]>,
    /// Channel, number, name and colour of each segment.
    #[serde(default)]
    segments: Vec<String>,
    /// A digit for each voxel, by channel.
    #[serde(default)]
    labels: Vec<String>,
    /// The samples of a slice.
    #[serde(default)]
    values: Vec<f64>,
}

fn expected() -> Vec<Expected> {
    serde_json::from_str(&std::fs::read_to_string(path("expected-seg.json")).unwrap()).unwrap()
}

fn values_of(volume: &Volume) -> Vec<f64> {
    let in_memory = volume.in_memory().unwrap();
    (0..in_memory.samples().len()).map(|n| in_memory.value(n)).collect()
}

fn at(channel: usize) -> LoadOptions {
    LoadOptions { channel: Some(channel as u32), ..LoadOptions::default() }
}

#[test]
fn segmentations_hold_what_highdicom_reads() {
    let all: Vec<Expected> = expected().into_iter().filter(|e| !e.labels.is_empty()).collect();
    assert_eq!(all.len(), 6);
    for e in all {
        for (channel, labels) in e.labels.iter().enumerate() {
            let volume = load(path(&e.file), &at(channel)).unwrap();
            assert_eq!((volume.grid().dims(), volume.sample_type()), (e.dims, SampleType::U8), "{}", e.file);
            let digits: Vec<f64> = labels.bytes().map(|digit| f64::from(digit - b'0')).collect();
            assert_eq!(values_of(&volume), digits, "{}, channel {channel}", e.file);
            for (found, expected) in affine(&volume).iter().flatten().zip(e.affine.unwrap().iter().flatten()) {
                // Directions are written in 16 digits, positions in 16 characters.
                assert!((found - expected).abs() < 1e-9, "{}: {:?}", e.file, affine(&volume));
            }
            assert!(volume.is_oriented(), "{}", e.file);
            let contents = volume.contents();
            assert_eq!(contents.channels as usize, e.labels.len(), "{}", e.file);
            let segments = contents.segments.iter().flatten().map(|segment| {
                let [r, g, b] = segment.color.unwrap();
                let name = segment.name.as_deref().unwrap();
                format!("{} {} {name} #{r:02x}{g:02x}{b:02x}", segment.channel, segment.label)
            });
            assert_eq!(segments.collect::<Vec<_>>(), e.segments, "{}", e.file);
            let is_fractional = e.file.contains("fractional");
            let note = "voxels belong to a fractional segment from half of its maximum on, 128";
            assert_eq!(contents.notes, if is_fractional { vec![note] } else { Vec::new() }, "{}", e.file);
        }
    }
}

#[test]
fn slices_in_jpeg_ls_hold_what_charls_reads() {
    let all: Vec<Expected> = expected().into_iter().filter(|e| !e.values.is_empty()).collect();
    assert_eq!(all.len(), 6);
    for e in all {
        let bytes = std::fs::read(path(&e.file)).unwrap();
        assert_eq!(values(&bytes, None).unwrap(), e.values, "{}", e.file);
        // Damaged and truncated copies are read or refused in one line.
        for at in 132..bytes.len() {
            for change in [0xff, 0x80, 0x01] {
                let mut damaged = bytes.clone();
                damaged[at] ^= change;
                let error = values(&damaged, None).err().unwrap_or_default();
                assert!(error.lines().count() <= 1, "{} byte {at}: {error}", e.file);
            }
            let refused = values(&bytes[..at], None);
            assert!(at > bytes.len() - 12 || refused.is_err(), "{} of {at} bytes", e.file);
        }
    }
}

fn item(elements: &Elements) -> Vec<u8> {
    [&[0xfe, 0xff, 0x00, 0xe0][..], &(elements.bytes.len() as u32).to_le_bytes(), &elements.bytes].concat()
}

fn new(typed: bool) -> Elements {
    Elements::new(false, typed)
}

/// A frame of a segment at a height.
fn frame(typed: bool, segment: u16, z: &str) -> Vec<u8> {
    let place = new(typed).text(0x0020_0032, "DS", &format!("1\\2\\{z}"));
    let of = new(typed).words(0x0062_000b, &[segment]);
    item(&new(typed).with(0x0020_9113, "SQ", &item(&place)).with(0x0062_000a, "SQ", &item(&of)))
}

/// A segmentation of frames of four pixels: the segment, the height and the bits of each.
fn segmentation(typed: bool, frames: &[(u16, &str, u8)]) -> Elements {
    let described = |number: u16| item(&new(typed).words(0x0062_0004, &[number]).text(0x0062_0005, "LO", "a"));
    let mut bits = vec![0; frames.len().div_ceil(4) * 2];
    frames.iter().enumerate().for_each(|(n, (.., four))| bits[n / 2] |= four << (n % 2 * 4));
    new(typed)
        .text(0x0008_0016, "UI", "1.2.840.10008.5.1.4.1.1.66.4\0")
        .picture([2, 2, frames.len() as u16], "MONOCHROME2", 1, 1)
        .text(0x0062_0001, "CS", "BINARY")
        .with(0x0062_0002, "SQ", &[1, 2].map(described).concat())
        .with(0x5200_9230, "SQ", &frames.iter().flat_map(|(n, z, _)| frame(typed, *n, z)).collect::<Vec<_>>())
        .with(0x7fe0_0010, "OB", &bits)
}

#[test]
fn slices_without_frames_are_empty() {
    // Gaps of 4 and 6: slices are 2 apart.
    let frames = [(2, "4", 0b0011), (1, "0", 0b0001), (2, "10", 0b1000)];
    let expected = [[1, 0, 0, 0], [0; 4], [2, 2, 0, 0], [0; 4], [0; 4], [0, 0, 0, 2]].concat();
    for (typed, syntax) in [(true, EXPLICIT), (false, IMPLICIT)] {
        let file = written(&segmentation(typed, &frames).file(syntax));
        let volume = load(file.path(), &LoadOptions::default()).unwrap();
        assert_eq!(values_of(&volume), expected.iter().map(|label| f64::from(*label)).collect::<Vec<_>>());
        let expected = [[3.0, 0.0, 0.0, 1.0], [0.0, 2.0, 0.0, 2.0], [0.0, 0.0, 2.0, 0.0]];
        assert_eq!(affine(&volume), expected);
    }
    // A segment of 300 needs samples of 16 bits.
    let file = written(&segmentation(true, &[(300, "4", 0b0110)]).file(EXPLICIT));
    assert_eq!(load(file.path(), &LoadOptions::default()).unwrap().sample_type(), SampleType::U16);
}

#[test]
fn broken_segmentations_say_what_is_wrong() {
    let plain = [(1, "0", 0b0001), (2, "2", 0b0011), (2, "4", 0b0100)];
    let refused = |elements: &Elements, words: &str| {
        let error = values(&elements.file(EXPLICIT), None).unwrap_err();
        assert!(error.contains(words), "{words}: {error}");
    };
    let with = |n: usize, frame: (u16, &'static str, u8)| {
        let mut frames = plain;
        frames[n] = frame;
        segmentation(true, &frames)
    };
    refused(&with(1, (0, "2", 1)), "frame 2 of 3 states no segment");
    refused(&with(1, (2, "x", 1)), "frame 2 of 3 has no position");
    refused(&with(2, (2, "2", 1)), "has two frames of segment 2 at one position: 2 and 3");
    refused(&with(2, (2, "5.07", 1)), "frames are unequally spaced: no distance of slices fits their positions");
    refused(&with(2, (2, "200000", 1)), "claims 100000 slices, expected at most 65535");
    let fixed = |from: &[u8], to: &[u8]| {
        let mut elements = segmentation(true, &plain);
        let at = elements.bytes.windows(from.len()).position(|window| window == from).unwrap();
        elements.bytes.splice(at..at + from.len(), to.iter().copied());
        elements
    };
    refused(&fixed(b"BINARY", b"UNARY "), "is a segmentation of the kind \"UNARY\"");
    refused(&fixed(b"IS\x02\x003 ", b"IS\x02\x004 "), "frame 4 of 4 has no position");
    refused(&fixed(b"IS\x02\x003 ", b"IS\x06\x00900000"), "frame 4 of 900000 has no position");
    refused(&fixed(b"IS\x02\x003 ", b"IS\x08\x0099999999"), "has 99999999 frames");
    refused(&fixed(b"1\\2\\4 ", b"9\\2\\4 "), "is not in a row with the others");
    // Two pictures of 65 535 x 65 535, 30 000 slices apart.
    let rows = fixed(b"\x10\0US\x02\0\x02\0", b"\x10\0US\x02\0\xff\xff");
    refused(&rows, "is cut short: 3 frames need");
    let far = new(true)
        .text(0x0008_0016, "UI", "1.2.840.10008.5.1.4.1.1.66.4\0")
        .picture([1024, 1024, 2], "MONOCHROME2", 1, 1)
        .text(0x0062_0001, "CS", "BINARY")
        .text(0x0018_0088, "DS", "1 ")
        .with(0x5200_9230, "SQ", &[frame(true, 1, "0"), frame(true, 1, "30000")].concat())
        .with(0x7fe0_0010, "OB", &[0; 1 << 18]);
    refused(&far, "claims 30001 slices, and has only 2 frames in them");
    // Damage ends in a volume or in one line.
    let whole = segmentation(true, &plain);
    for at in 0..whole.bytes.len() {
        for change in [0xff, 0x80, 0x01] {
            let mut damaged = whole.clone();
            damaged.bytes[at] ^= change;
            let error = values(&damaged.file(EXPLICIT), None).err().unwrap_or_default();
            assert!(error.lines().count() <= 1, "byte {at} by {change}: {error}");
        }
    }
}
