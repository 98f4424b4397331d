//! NumPy's .npz: an archive of arrays, as `numpy.savez` and `numpy.savez_compressed` write it
//! (<https://numpy.org/doc/stable/reference/generated/numpy.savez.html>).

use super::LoadOptions;
use super::input::Input;
use super::npy::{self, NpyHeader};
use super::placement::plain_name;
use super::zip::{Archive, MAGIC, Member};
use crate::error::{Hint, Result, refuse};
use crate::volume::Volume;

/// The largest number of arrays whose headers are read.
const MAX_ARRAYS: usize = 4096;

/// The largest number of arrays that an error lists.
const MAX_LISTED: usize = 12;

/// The ending of the names of arrays in an archive.
const ENDING: &str = ".npy";

/// Returns whether a file with these first bytes is an archive whose first member is an array.
pub(super) fn is_npz(head: &[u8]) -> bool {
    let Some(length) = head.get(26..28).filter(|_| head.starts_with(MAGIC)) else { return false };
    let name = head.get(30..30 + usize::from(length[0]) + 256 * usize::from(length[1]));
    name.is_some_and(|name| name.ends_with(ENDING.as_bytes()))
}

/// An array of an archive.
struct ArchiveArray<'a> {
    member: &'a Member,
    /// The header of the array; `None` if it is not read, as of Python's objects.
    header: Option<NpyHeader>,
}

impl ArchiveArray<'_> {
    fn name(&self) -> &str {
        self.member.name.strip_suffix(ENDING).unwrap_or(&self.member.name)
    }

    /// Returns the number of axes of several samples; 0 if the samples are no numbers.
    fn axes(&self) -> usize {
        let header = self.header.as_ref().filter(|header| header.kind().is_some());
        header.map_or(0, |header| header.shape.iter().filter(|&&size| size > 1).count())
    }

    fn text(&self) -> String {
        let name = plain_name(self.name()).unwrap_or_default();
        self.header.as_ref().map_or(name.clone(), |header| format!("{name} of {}", header.shape_text()))
    }
}

/// Reads the array with the name `inside`; without a name the only volume of the archive, or else the only plane.
pub(super) fn read(input: Input, inside: Option<&str>, options: &LoadOptions) -> Result<Volume> {
    let archive = Archive::open(&input)?;
    let members = archive.members.iter().filter(|member| member.name.ends_with(ENDING)).take(MAX_ARRAYS);
    let unpacked = input.unpacked();
    let open = |member: &Member| archive.member(member, unpacked.clone());
    if let Some(name) = inside {
        let asked = name.trim_start_matches('/');
        let is_asked =
            |member: &&Member| [member.name.as_str(), &member.name[..member.name.len() - 4]].contains(&asked);
        if let Some(member) = members.clone().find(is_asked) {
            return npy::read(open(member)?, options);
        }
    }
    // Of headers nothing is kept: to keep a member is to decompress all of it.
    let array = |member| Ok(ArchiveArray { member, header: npy::header(archive.member(member, None)?)? });
    let arrays = members.map(array).collect::<Result<Vec<ArchiveArray<'_>>>>()?;
    let of = |least: usize| arrays.iter().filter(|array| array.axes() >= least).collect::<Vec<_>>();
    let listed = |arrays: &[&ArchiveArray<'_>]| {
        let mut texts: Vec<String> = arrays.iter().take(MAX_LISTED).map(|array| array.text()).collect();
        texts.extend((arrays.len() > MAX_LISTED).then(|| format!("{} more", arrays.len() - MAX_LISTED)));
        texts.join(", ")
    };
    if let Some(name) = inside {
        refuse!(input, "has no array {name:?}: there are {}", listed(&of(0)));
    }
    match [3, 2].into_iter().map(of).find(|arrays| !arrays.is_empty()).unwrap_or_default()[..] {
        [array] => npy::read(open(array.member)?, options),
        [] if arrays.is_empty() => refuse!(input, "is an archive without arrays of NumPy"),
        [] => refuse!(input, "has no array of numbers with two axes or three: there are {}", listed(&of(0))),
        ref found => {
            let reason = format!("holds {} arrays: {}", found.len(), listed(found));
            Err(input.error(reason).hinted(Hint::ChooseDataset))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::write::DeflateEncoder;
    use flate2::{Compression, Crc};

    use super::*;
    use crate::error::Error;
    use crate::formats::{AxisOrder, TimeSeries, load};
    use crate::volume::Samples;

    /// Makes an array of bytes: 0, 1, 2 ..
    fn array(shape: &str, count: u8, fortran: &str) -> Vec<u8> {
        let header = format!("{{'descr': '|u1', 'fortran_order': {fortran}, 'shape': {shape}, }}");
        let length = (header.len() as u16).to_le_bytes();
        [b"\x93NUMPY\x01\0", &length[..], header.as_bytes(), &(0..count).collect::<Vec<u8>>()].concat()
    }

    /// Makes an archive of members, deflated or stored. Their headers have the sizes of ZIP64, as NumPy writes them;
    /// the directory too, if `wide`.
    fn archive(members: &[(&str, Vec<u8>, bool)], wide: bool) -> Vec<u8> {
        let (mut file, mut directory) = (Vec::new(), Vec::new());
        for (name, content, is_deflated) in members {
            let mut sum = Crc::new();
            sum.update(content);
            let mut deflated = DeflateEncoder::new(Vec::new(), Compression::default());
            deflated.write_all(content).unwrap();
            let packed = if *is_deflated { deflated.finish().unwrap() } else { content.clone() };
            let (at, sizes) = (file.len() as u64, [content.len() as u64, packed.len() as u64]);
            let method = if *is_deflated { 8_u16 } else { 0 }.to_le_bytes();
            let extra = [&[1, 0, 16, 0], &sizes.map(u64::to_le_bytes).concat()[..]].concat();
            file.extend([MAGIC, &[45, 0, 0, 0], &method, &[0; 4], &sum.sum().to_le_bytes(), &[255; 8]].concat());
            file.extend([name.len() as u16, extra.len() as u16].map(u16::to_le_bytes).concat());
            file.extend([name.as_bytes(), &extra, &packed].concat());
            let far =
                [&[9, 0, 1, 0, 7, 1, 0, 24, 0], &[sizes[0], sizes[1], at].map(u64::to_le_bytes).concat()[..]].concat();
            let (low, far) = match wide {
                true => ([u32::MAX; 3], far),
                false => ([sizes[1] as u32, sizes[0] as u32, at as u32], Vec::new()),
            };
            directory.extend(
                [b"PK\x01\x02", &[45, 3, 45, 0, 0, 0][..], &method, &[0; 4], &sum.sum().to_le_bytes()].concat(),
            );
            directory.extend([low[0].to_le_bytes(), low[1].to_le_bytes()].concat());
            directory.extend([name.len() as u16, far.len() as u16, 0, 0, 0, 0, 0].map(u16::to_le_bytes).concat());
            directory.extend([&low[2].to_le_bytes(), name.as_bytes(), &far].concat());
        }
        let (at, size, count) = (file.len() as u64, directory.len() as u64, members.len() as u64);
        file.extend(directory);
        let mut ends = (at as u32, size as u32, count as u16);
        if wide {
            let record = file.len() as u64;
            file.extend([b"PK\x06\x06", &[0; 28][..], &[count, size, at].map(u64::to_le_bytes).concat()].concat());
            file.extend([b"PK\x06\x07", &[0; 4][..], &record.to_le_bytes(), &[1, 0, 0, 0]].concat());
            ends = (u32::MAX, u32::MAX, u16::MAX);
        }
        let end = [ends.2, ends.2].map(u16::to_le_bytes).concat();
        file.extend([b"PK\x05\x06", &[0; 4][..], &end, &ends.1.to_le_bytes(), &ends.0.to_le_bytes(), &[0; 2]].concat());
        file
    }

    /// Writes a file, and loads it or an array of it.
    fn loaded(bytes: &[u8], inside: &str, options: &LoadOptions) -> Result<Volume> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npz");
        std::fs::write(&path, bytes).unwrap();
        load(format!("{}{inside}", path.display()), options)
    }

    fn bytes_of(volume: Result<Volume>) -> Vec<u8> {
        match volume.unwrap().in_memory().unwrap().samples() {
            Samples::U8(samples) => samples.clone(),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn arrays_are_found_by_name_or_as_the_only_volume() {
        let members = |is_deflated| {
            [
                ("spacing.npy", array("(3,)", 3, "False"), is_deflated),
                ("ct.npy", array("(2, 3, 4)", 24, "False"), is_deflated),
                ("notes.txt", b"notes".to_vec(), is_deflated),
            ]
        };
        let whole: Vec<u8> = (0..24).collect();
        for (is_deflated, wide) in [(false, false), (true, false), (false, true), (true, true)] {
            let file = archive(&members(is_deflated), wide);
            for inside in ["", ":ct", ":ct.npy", ":/ct"] {
                for stream_over in [0, 1 << 20] {
                    let options = LoadOptions { stream_over, ..LoadOptions::default() };
                    let volume = loaded(&file, inside, &options).unwrap();
                    assert_eq!(
                        (volume.grid().dims(), volume.is_streamed()),
                        ([4, 3, 2], !is_deflated && stream_over == 0)
                    );
                    assert_eq!(bytes_of(Ok(volume)), whole, "{inside} {is_deflated} {wide}");
                }
            }
            let error = loaded(&file, ":mr", &LoadOptions::default()).unwrap_err().to_string();
            assert!(error.ends_with("has no array \"mr\": there are spacing of (3,), ct of (2, 3, 4)"), "{error}");
        }
    }

    #[test]
    fn several_volumes_without_a_name_are_listed() {
        let two = [("a.npy", array("(2, 2, 2)", 8, "False"), true), ("b.npy", array("(2, 5, 2)", 20, "False"), true)];
        let error = format!("{:#}", loaded(&archive(&two, false), "", &LoadOptions::default()).unwrap_err());
        assert!(error.contains("holds 2 arrays"), "{error}");
        assert!(
            error.ends_with("a of (2, 2, 2), b of (2, 5, 4): load FILE:NAME") || error.contains("a.npz"),
            "{error}"
        );
    }

    #[test]
    fn the_order_of_axes_is_an_option() {
        let read = |fortran: &str, order: Option<AxisOrder>| {
            let file = archive(&[("a.npy", array("(2, 3, 4)", 24, fortran), true)], false);
            let volume = loaded(&file, "", &LoadOptions { axis_order: order, ..LoadOptions::default() }).unwrap();
            let (dims, notes) = (volume.grid().dims(), volume.contents().notes.join(";"));
            (dims, bytes_of(Ok(volume)), notes)
        };
        let whole: Vec<u8> = (0..24).collect();
        // z is the fastest of these.
        let turned =
            |[x, y, z]: [u8; 3]| -> Vec<u8> { (0..24).map(|n| (n % x * y + n / x % y) * z + n / (x * y)).collect() };
        let (zyx, xyz) = (Some(AxisOrder::Zyx), Some(AxisOrder::Xyz));
        assert_eq!(read("False", None), ([4, 3, 2], whole.clone(), String::new()));
        assert_eq!(read("False", zyx), ([4, 3, 2], whole.clone(), String::new()));
        assert_eq!(read("False", xyz), ([2, 3, 4], turned([2, 3, 4]), String::new()));
        assert_eq!(read("True", zyx), ([4, 3, 2], turned([4, 3, 2]), String::new()));
        assert_eq!(read("True", xyz), ([2, 3, 4], whole.clone(), String::new()));
        let (dims, _, note) = read("True", None);
        assert_eq!(dims, [4, 3, 2]);
        assert!(
            note.starts_with("using axis order zyx for the array of shape (2, 3, 4), but it is in Fortran order"),
            "{note}"
        );
    }

    #[test]
    fn short_last_axes_are_noted() {
        let note = |shape: &str| {
            let file = archive(&[("a.npy", array(shape, 200, "False"), true)], false);
            loaded(&file, "", &LoadOptions::default()).unwrap().contents().notes.join(";")
        };
        assert!(
            note("(10, 10, 2)").contains("its last axis is short, as slices are (the other choice: axis order xyz)")
        );
        assert_eq!(note("(2, 10, 10)"), "");
        assert_eq!(note("(5, 4, 10)"), "");
        assert_eq!(note("(5, 5, 8)"), "");
    }

    #[test]
    fn a_series_is_decompressed_once() {
        let file = archive(&[("a.npy", array("(5, 2, 2, 3)", 60, "False"), true)], false);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npz");
        std::fs::write(&path, &file).unwrap();
        let mut series = TimeSeries::new(&path, &LoadOptions::default());
        for time in [3, 0, 4] {
            let first = 12 * time as u8;
            assert_eq!(bytes_of(series.volume(time)), (first..first + 12).collect::<Vec<u8>>());
        }
    }

    #[test]
    fn broken_archives_say_what_is_wrong() {
        let options = LoadOptions::default();
        let whole = archive(&[("a.npy", array("(2, 3, 4)", 24, "False"), true)], false);
        let refused = |bytes: &[u8], words: &str| {
            let error = loaded(bytes, "", &options).unwrap_err().to_string();
            assert!(error.contains(words), "{words}: {error}");
        };
        for end in 5..whole.len() {
            refused(&whole[..end], "");
        }
        refused(&whole[..whole.len() - 1], "is cut short, or no archive of ZIP");
        let changed = |at: usize, value: &[u8]| {
            let mut bytes = whole.clone();
            bytes[at..at + value.len()].copy_from_slice(value);
            bytes
        };
        let entry = whole.windows(4).position(|four| four == b"PK\x01\x02").unwrap();
        let end = whole.len() - 22;
        refused(&changed(entry + 8, &[1]), "a.npz:a: is encrypted");
        refused(&changed(entry + 10, &[93]), "is compressed by method 93 of ZIP");
        refused(&changed(entry + 10, &[0]), "stored bytes cannot be");
        refused(&changed(entry + 16, &[1, 2, 3, 4]), "is damaged: the checksum is wrong");
        refused(&changed(entry + 20, &[255, 255, 255, 127]), "is cut short: it should end at byte");
        refused(&changed(entry + 24, &[90, 0, 0, 0]), "is damaged: the checksum is wrong");
        refused(&changed(entry + 24, &[20, 0, 0, 0]), "is damaged: the checksum is wrong");
        refused(&changed(entry + 24, &[255, 0, 0, 0]), "is damaged: the checksum is wrong");
        refused(&changed(entry + 42, &[1]), "the directory leads to no member at byte 1");
        refused(&changed(entry + 28, &[255]), "its directory does not list its members");
        refused(&changed(end + 10, &[2]), "its directory does not list its members");
        refused(&changed(end + 12, &[255, 255, 255]), "does not precede its end");
        let escape = archive(&[("\x1b[2J\na.npy", array("(2, 3, 40)", 24, "False"), true)], false);
        refused(&escape, "a.npz:[2Ja: is cut short");
        let claims = archive(&[("a.npy", array("(60000, 60000, 60000)", 24, "False"), true)], false);
        refused(&claims, "216000000000000 bytes");
        let none = archive(&[("a.npy", array("(3,)", 3, "False"), true)], false);
        refused(&none, "has no array of numbers with two axes or three: there are a of (3,)");
        let error = loaded(&archive(&[("a.txt", b"a".to_vec(), true)], false), "", &options).unwrap_err();
        assert!(matches!(error, Error::Format { .. }) && error.to_string().contains("without arrays"), "{error}");
    }
}
