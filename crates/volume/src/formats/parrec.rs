//! Philips' .PAR of the versions 4, 4.1 and 4.2, whose samples lie in .REC.
//!
//! The header has a table with a line for each section of each volume. The reader does as nibabel does: sections are in
//! the file in the order of their lines, the n-th line of a section belongs to the n-th volume, volumes are points in
//! time, values are the values of the console (`DV`), and the angles and the centre are of the whole stack. Unlike
//! nibabel the reader accepts a file that is cut short: it reads the volumes that are whole.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use glam::DVec3;

use super::LoadOptions;
use super::decode::{Layout, read_all};
use super::input::Input;
use super::pair::{existing, has_extension, with_extension};
use super::placement::Placement;
use super::selection::{Pick, chosen};
use crate::error::{Error, Result, Subject, refuse, refuse_if};
use crate::memory::{reserved, samples_in, zeroed};
use crate::names::counted;
use crate::vector::rotation;
use crate::volume::{Endian, MAX_DIM, Origin, SampleType, Samples, Stored, Units, Volume};

/// The number of columns of the table that are read; other columns follow.
const COLUMNS: usize = 30;

/// The largest number of lines of the table.
const MAX_LINES: usize = 1 << 22;

/// A header of Philips: the fields of its first part, and the table.
struct ParHeader {
    path: PathBuf,
    fields: HashMap<String, String>,
    sections: Vec<Section>,
}

/// A line of the table, which describes a section of a volume.
#[derive(Clone, Copy)]
struct Section {
    /// The number of the section in the stack, counted from 1.
    number: u32,
    slope: f64,
    intercept: f64,
    stack: SectionStack,
}

/// The properties that all sections share.
#[derive(Clone, Copy, PartialEq)]
struct SectionStack {
    bits: i64,
    size: [i64; 2],
    /// The thickness, the gap, and the distances of samples along x and y.
    lengths: [f64; 4],
    /// The orientation of sections: 1 is transverse, 2 sagittal, 3 coronal.
    orientation: i64,
}

/// Returns whether a file with these first bytes is a header of Philips.
pub(super) fn is_parrec(head: &[u8]) -> bool {
    let text = String::from_utf8_lossy(head.get(..80).unwrap_or(head));
    let title = text.trim_start_matches('\u{feff}').trim_start().strip_prefix('#');
    title.is_some_and(|title| title.trim_start_matches([' ', '=']).starts_with("DATA DESCRIPTION FILE"))
}

/// Returns the header of a file of samples, if there is one.
pub(super) fn header_of(image: &Path) -> Option<PathBuf> {
    existing(image, &[".PAR", ".par"]).filter(|_| has_extension(image, &["rec"]))
}

/// Returns the file with the samples of a header.
pub(super) fn named_files(input: Input) -> Result<Vec<PathBuf>> {
    Ok(vec![image_file(input.path())?])
}

fn image_file(header: &Path) -> Result<PathBuf> {
    existing(header, &[".REC", ".rec", ".REC.gz", ".rec.gz"]).ok_or_else(|| {
        let expected = with_extension(header, ".REC");
        header.error(format!("its samples belong in {}, which is not there", expected.display()))
    })
}

/// Reads the volume of a header at the start of `input`.
pub(super) fn read(mut input: Input, options: &LoadOptions) -> Result<Volume> {
    let header = ParHeader::read(&mut input)?;
    let path = &header.path;
    let stack = header.stack()?;
    let (volumes, left_out) = header.volumes()?;
    let [nx, ny] = stack.size;
    let sizes = [nx, ny, volumes[0].len() as i64];
    let placement = header.placement(&stack, sizes)?;
    let grid = placement.grid(path, &sizes, options.spacing)?;
    let mut contents = chosen(path, options, 1, volumes.len() as u64)?;
    if left_out > 0 {
        let incomplete = counted(left_out as u64, "section");
        contents.notes.push(format!("{incomplete} of volumes that the file does not have whole are left out"));
    }
    contents.origin = Origin::of(Some("MR"), header.fields.get("protocol name").map(String::as_str));
    let sections = &volumes[contents.time as usize];
    let data = Input::open(&image_file(path)?, input.unpacked())?;
    let sample_type = if stack.bits == 8 { SampleType::U8 } else { SampleType::U16 };
    let first = header.sections[sections[0]];
    let in_one_piece = sections.windows(2).all(|pair| pair[1] == pair[0] + 1);
    let has_one_map =
        |at: &usize| (header.sections[*at].slope, header.sections[*at].intercept) == (first.slope, first.intercept);
    let has_one_map = sections.iter().all(has_one_map);
    let section = (nx * ny) as u64;
    let samples = match in_one_piece {
        true => piece(data, sections[0] as u64 * section, grid.len(), sample_type)?,
        false => gathered(data, sections, section, sample_type)?,
    };
    let units = Units { length: Some("mm".to_owned()), value: None };
    let finished = |samples, slope, intercept| {
        let volume = placement.volume(grid, samples)?.with_units(units).with_contents(contents);
        volume.with_rescale(slope, intercept).map_err(|error| path.error(error.to_string()))
    };
    if has_one_map {
        return finished(samples, first.slope, first.intercept);
    }
    // Sections with maps of their own become values.
    let maps = sections.iter().map(|at| (header.sections[*at].slope, header.sections[*at].intercept));
    finished(mapped(&samples.into_samples()?, maps, section as usize, path)?.into(), 1.0, 0.0)
}

/// Returns the samples of a volume whose sections follow one another in the file.
fn piece(mut data: Input, first: u64, count: u64, sample_type: SampleType) -> Result<Stored> {
    data.skip(first.saturating_mul(sample_type.size() as u64))?;
    read_all(data, &Pick::all(count), sample_type, Layout::Binary(Endian::Little))
}

/// Returns the samples of a volume whose sections lie at these places of the file, in any order. `section` is the
/// number of samples in a section.
fn gathered(mut data: Input, places: &[usize], section: u64, sample_type: SampleType) -> Result<Stored> {
    let path = data.path().to_owned();
    let size = section * sample_type.size() as u64;
    let needed = places.iter().max().map_or(0, |last| (*last as u64 + 1).saturating_mul(size));
    let too_short = |there: u64| data_error(&path, needed, there);
    if let Some(there) = data.at_most().filter(|there| *there < needed) {
        return Err(too_short(there));
    }
    let mut bytes: Vec<u8> = zeroed(size * places.len() as u64, || samples_in(&path))?;
    let mut in_file: Vec<usize> = (0..places.len()).collect();
    in_file.sort_by_key(|z| places[*z]);
    let (mut at, size) = (0, size as usize);
    for z in in_file {
        data.skip((places[z] - at) as u64 * size as u64)?;
        let read = data.fill(&mut bytes[z * size..(z + 1) * size])?;
        if read < size {
            return Err(too_short(places[z] as u64 * size as u64 + read as u64));
        }
        at = places[z] + 1;
    }
    if sample_type == SampleType::U8 {
        return Ok(Samples::U8(bytes).into());
    }
    let mut samples = reserved(bytes.len() as u64 / 2, || samples_in(&path))?;
    samples.extend(bytes.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])));
    Ok(Samples::U16(samples).into())
}

fn data_error(path: &Path, needed: u64, there: u64) -> Error {
    path.error(format!("is cut short, or its header claims too much: sections need {needed} bytes, {there} are there"))
}

/// Returns the values of sections of `section` samples by their slopes and intercepts.
fn mapped(samples: &Samples, maps: impl Iterator<Item = (f64, f64)>, section: usize, path: &Path) -> Result<Samples> {
    let mut values = reserved(samples.len() as u64, || samples_in(path))?;
    for (z, (slope, intercept)) in maps.enumerate() {
        let range = z * section..(z + 1) * section;
        let value = |sample: f64| (slope * sample + intercept) as f32;
        match samples {
            Samples::U8(samples) => values.extend(samples[range].iter().map(|sample| value(f64::from(*sample)))),
            Samples::U16(samples) => values.extend(samples[range].iter().map(|sample| value(f64::from(*sample)))),
            _ => {}
        }
    }
    Ok(Samples::F32(values))
}

impl ParHeader {
    fn read(input: &mut Input) -> Result<Self> {
        let is_header = is_parrec(&input.peek(80)?);
        refuse_if!(!is_header, input, "is not a Philips header: it does not begin with DATA DESCRIPTION FILE");
        let (mut fields, mut sections) = (HashMap::new(), Vec::new());
        while let Some(line) = input.line()? {
            let line = line.trim_matches(|c: char| c.is_whitespace() || c == '\u{feff}');
            match line.strip_prefix('.') {
                _ if line.is_empty() => {}
                // The end of the table.
                _ if line.starts_with('#') && !sections.is_empty() => break,
                _ if line.starts_with('#') => check_version(input, line)?,
                Some(field) if sections.is_empty() => {
                    let Some((name, value)) = field.split_once(':') else {
                        refuse!(input, "header line {line:?} is not \". field : value\"");
                    };
                    fields.insert(name.trim().to_ascii_lowercase(), value.trim().to_owned());
                }
                _ => {
                    refuse_if!(sections.len() == MAX_LINES, input, "has over {MAX_LINES} sections");
                    sections.push(Section::parse(line, input, sections.len() + 1)?);
                }
            }
        }
        refuse_if!(sections.is_empty(), input, "is cut short: its header has no table of sections");
        Ok(Self { path: input.path().to_owned(), fields, sections })
    }

    /// Returns the three numbers of a field: along the directions of anterior to posterior, foot to head, right to
    /// left.
    fn triple(&self, name: &str) -> Result<[f64; 3]> {
        let text = self.fields.get(name).map_or("", String::as_str);
        let numbers: Vec<f64> = text.split_ascii_whitespace().map_while(|word| word.parse().ok()).collect();
        let unread = || self.path.error(format!("{name}: {text:?}, expected three numbers"));
        numbers.try_into().map_err(|_| unread())
    }

    /// Returns the properties of all sections.
    fn stack(&self) -> Result<SectionStack> {
        let stack = self.sections[0].stack;
        if let Some(n) = self.sections.iter().position(|section| section.stack != stack) {
            let what = "the size, the spacing or the orientation";
            refuse!(self.path, "section {} differs from the first one in {what}: export one stack at a time", n + 1);
        }
        let bits = stack.bits;
        refuse_if!(![8, 16].contains(&bits), self.path, "its samples have {bits} bits, expected 8 or 16");
        Ok(stack)
    }

    /// Returns the places of the sections of each volume, and the number of sections of volumes that are not whole.
    fn volumes(&self) -> Result<(Vec<Vec<usize>>, usize)> {
        let named = self.fields.get("max. number of slices/locations").and_then(|text| text.parse().ok());
        let most = self.sections.iter().map(|section| section.number).max().unwrap_or(0);
        let count = named.unwrap_or(most);
        let is_count = most <= count && (1..=MAX_DIM).contains(&count);
        refuse_if!(!is_count, self.path, "has a section {most} in stacks of {count} sections");
        // The places of each section, of the first volume, of the second ..
        let mut places = vec![Vec::new(); count as usize];
        for (at, section) in self.sections.iter().enumerate() {
            places[section.number as usize - 1].push(at);
        }
        let whole = places.iter().map(Vec::len).min().unwrap_or(0);
        let missing = || places.iter().position(Vec::is_empty).unwrap_or(0) + 1;
        refuse_if!(whole == 0, self.path, "has no section {} of {count}", missing());
        let volume = |n: usize| places.iter().map(|places| places[n]).collect();
        Ok(((0..whole).map(volume).collect(), self.sections.len() - whole * count as usize))
    }

    /// Returns the position of the stack.
    fn placement(&self, stack: &SectionStack, sizes: [i64; 3]) -> Result<Placement> {
        // Axes to the back, to the head and to the left, as the header has them.
        let [back, up, left] = DVec3::AXES;
        let directions = match stack.orientation {
            1 => [left, back, up],
            2 => [back, -up, -left],
            3 => [left, -up, back],
            other => refuse!(self.path, "slice orientation {other} is unknown, expected 1, 2 or 3"),
        };
        let [angles, center] = ["angulation midslice(ap,fh,rl)[degr]", "off centre midslice(ap,fh,rl) [mm]"];
        let [x, y, z] = self.triple(angles)?.map(f64::to_radians);
        let turn = rotation(DVec3::Z, z) * rotation(DVec3::X, x) * rotation(DVec3::Y, y);
        let center = DVec3::from_array(self.triple(center)?);
        let [thickness, gap, dx, dy] = stack.lengths;
        let spacing = [dx, dy, thickness + gap];
        let directions = directions.map(|direction| turn * direction);
        let half = |a: usize| directions[a] * (spacing[a] * (sizes[a] as f64 - 1.0) / 2.0);
        let origin = center - half(0) - half(1) - half(2);
        // From these axes to those of DICOM.
        let to_lps = |v: DVec3| DVec3::new(v.z, v.x, v.y);
        Ok(Placement { directions: directions.map(to_lps), spacing, origin: to_lps(origin), oriented: true })
    }
}

/// Refuses versions whose table has other columns.
fn check_version(input: &Input, comment: &str) -> Result<()> {
    if comment.contains("image export tool") {
        let version = comment.split_ascii_whitespace().next_back().unwrap_or_default();
        let is_known = ["V4", "V4.1", "V4.2"].contains(&version);
        refuse_if!(!is_known, input, "is of version {version:?}, expected V4, V4.1 or V4.2");
    }
    Ok(())
}

impl Section {
    fn parse(line: &str, input: &Input, number: usize) -> Result<Self> {
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        let found = words.len();
        refuse_if!(found < COLUMNS, input, "section {number} has {found} columns, expected {COLUMNS} at least");
        let column = |at: usize| words.get(at).copied().unwrap_or_default();
        fn parsed<T: FromStr>(input: &Input, number: usize, at: usize, word: &str) -> Result<T> {
            let unread =
                || input.error(format!("section {number}, column {}: {word:?} is not a number that fits", at + 1));
            word.parse().map_err(|_| unread())
        }
        let real = |at: usize| parsed::<f64>(input, number, at, column(at));
        let whole = |at: usize| parsed::<i64>(input, number, at, column(at));
        let index = parsed::<u32>(input, number, 0, column(0))?;
        refuse_if!(index == 0, input, "section {number} has the number 0, expected 1 or more");
        Ok(Self {
            number: index,
            slope: real(12)?,
            intercept: real(11)?,
            stack: SectionStack {
                bits: whole(7)?,
                size: [whole(9)?, whole(10)?],
                lengths: [real(22)?, real(23)?, real(28)?, real(29)?],
                orientation: whole(25)?,
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::load;
    use crate::formats::pair::loaded_by_both;

    const FIELDS: &str = "# === DATA DESCRIPTION FILE ===\n# Research image export tool     V4.2\n\
        .    Protocol name                      :   T1: a test\n\
        .    Max. number of slices/locations    :   2\n\
        .    Angulation midslice(ap,fh,rl)[degr]:   0 90 0\n\
        .    Off Centre midslice(ap,fh,rl) [mm] :   10 20 30\n# === IMAGE INFORMATION\n";

    /// Returns a line of the table.
    fn line(section: &str, slope: &str) -> String {
        let before = format!("{section} 1 1 1 0 2 0 16 62 2 1 -1.5 {slope} 4e-3 1070 1860 0 0 0 0 0 0 4 1 0 2 0 2");
        format!("{before} 0.5 0.25 30 0 0\n")
    }

    /// Loads a volume of a header and of samples of two bytes: 0, 1, 2 ..
    fn loaded(header: &str, samples: u16, time: u32) -> Result<Volume> {
        let bytes: Vec<u8> = (0..samples).flat_map(u16::to_le_bytes).collect();
        loaded_by_both([("a.PAR", header.as_bytes()), ("a.REC", &bytes)], time)
    }

    fn table(sections: &[(&str, &str)]) -> String {
        sections.iter().fold(FIELDS.to_owned(), |text, (section, slope)| text + &line(section, slope)) + "\n# === END\n"
    }

    #[test]
    fn sections_of_one_number_are_points_in_time() {
        // Two volumes, with their sections interleaved, and one that is not whole.
        let header = table(&[("1", "2"), ("1", "2"), ("2", "2"), ("2", "2"), ("1", "2")]);
        let second = loaded(&header, 10, 1).unwrap();
        assert_eq!((second.grid().dims(), second.contents().times, second.rescale()), ([2, 1, 2], 2, (2.0, -1.5)));
        assert_eq!(second.in_memory().unwrap().samples(), &Samples::U16(vec![2, 3, 6, 7]));
        assert_eq!(second.contents().notes, ["1 section of volumes that the file does not have whole are left out"]);
        assert_eq!(second.contents().origin, Origin::of(Some("MR"), ["T1: a test"]));
        // In order they are one piece of the file.
        let header = table(&[("1", "2"), ("2", "2"), ("1", "2"), ("2", "2")]);
        let second = loaded(&header, 8, 1).unwrap();
        assert_eq!(second.in_memory().unwrap().samples(), &Samples::U16(vec![4, 5, 6, 7]));
        assert!(second.contents().notes.is_empty());
    }

    #[test]
    fn sections_with_maps_of_their_own_become_values() {
        let volume = loaded(&table(&[("2", "0.5"), ("1", "3")]), 4, 0).unwrap();
        assert_eq!(volume.in_memory().unwrap().samples(), &Samples::F32(vec![4.5, 7.5, -1.5, -1.0]));
        assert_eq!(volume.rescale(), (1.0, 0.0));
    }

    #[test]
    fn a_stack_is_turned_about_its_centre() {
        let volume = loaded(&table(&[("1", "2"), ("2", "2")]), 4, 0).unwrap();
        let world = volume.grid().to_world();
        // Sagittal, with axes to the back, to the feet and to the right, turned by 90 degrees about the last direction.
        let near = |a: DVec3, b: DVec3| assert!((a - b).length() < 1e-12, "{a} {b}");
        near(world.matrix3.col(0), DVec3::new(-0.5, 0.0, 0.0));
        near(world.matrix3.col(1), DVec3::new(0.0, 0.0, -0.25));
        near(world.matrix3.col(2), DVec3::new(0.0, -5.0, 0.0));
        near(volume.grid().center(), DVec3::new(30.0, 10.0, 20.0));
    }

    #[test]
    fn broken_headers_say_what_is_wrong() {
        let whole = table(&[("1", "2"), ("2", "2")]);
        for (from, to, words) in [
            ("V4.2", "V3", "is of version \"V3\", expected V4, V4.1 or V4.2"),
            ("(ap,fh,rl)[degr]:", "(ap,fh,rl)[degr]", "is not \". field : value\""),
            (":   0 90 0", ":   0 90", "angulation midslice(ap,fh,rl)[degr]: \"0 90\", expected three numbers"),
            (":   0 90 0", ":   0 nan 0", "do not span space"),
            (":   2\n", ":   3\n", "has no section 3 of 3"),
            (":   2\n", ":   1\n", "has a section 2 in stacks of 1 sections"),
            (":   2\n", ":   4000000000\n", "in stacks of 4000000000 sections"),
            ("\n2 1 1", "\n0 1 1", "section 2 has the number 0"),
            ("\n2 1 1", "\nx 1 1", "section 2, column 1: \"x\" is not a number"),
            (" 0.25 30 0 0\n2", "\n2", "section 1 has 29 columns, expected 30 at least"),
            (" 16 62 2 1 ", " 12 62 2 1 ", "samples have 12 bits"),
            (" 16 62 2 1 ", " 16 62 2 0 ", "dimension 2 is 0"),
            (" 16 62 2 1 ", " 16 62 65535 65535 ", "bytes, 8 are there"),
            (" 2 4e-3", " inf 4e-3", "slope inf and intercept -1.5 do not rescale"),
            (" 2 0 2 0.5", " 9 0 2 0.5", "slice orientation 9 is unknown"),
            (" 0.5 0.25", " nan 0.25", "differs from the first one"),
            (" 4 1 0 2", " -4 1 0 2", "spacing of axis 3 is -3"),
        ] {
            assert!(whole.contains(from), "{from}");
            let error = loaded(&whole.replace(from, to), 4, 0).unwrap_err().to_string();
            assert!(error.contains(words), "{words}: {error}");
        }
        let unlike = table(&[("1", "2"), ("2", "2")]).replacen(" 0.5 0.25", " 0.5 0.5", 1);
        assert!(loaded(&unlike, 4, 0).unwrap_err().to_string().contains("section 2 differs from the first one"));
        let other = loaded("PAR2", 4, 0).unwrap_err().to_string();
        assert!(other.ends_with("is not a Philips header: it does not begin with DATA DESCRIPTION FILE"), "{other}");
        assert!(loaded(FIELDS, 4, 0).unwrap_err().to_string().contains("has no table of sections"));
        let short = loaded(&whole, 3, 0).unwrap_err().to_string();
        assert!(short.contains("4 samples need 8 bytes, 6 are there"), "{short}");
        let turned = table(&[("2", "2"), ("1", "2")]);
        let short = loaded(&turned, 3, 0).unwrap_err().to_string();
        assert!(short.contains("sections need 8 bytes, 6 are there"), "{short}");
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.PAR"), &whole).unwrap();
        let lone = load(folder.path().join("a.PAR"), &LoadOptions::default()).unwrap_err().to_string();
        assert!(lone.contains("its samples belong in") && lone.ends_with("a.REC, which is not there"), "{lone}");
    }
}
