//! AFNI: .HEAD, whose samples lie in .BRIK, also compressed
//! (<https://afni.nimh.nih.gov/pub/dist/doc/program_help/README.attributes.html>).
//!
//! Sub-bricks count as points in time, each with its type and its factor. The default order of bytes is the order of
//! this machine, as in AFNI.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use glam::DVec3;

use super::LoadOptions;
use super::decode::{Layout, read_all};
use super::input::Input;
use super::nifti::intent;
use super::pair::{existing, has_extension, with_extension};
use super::placement::{Placement, plain_name};
use super::selection::{Role, chosen, colours, picked};
use crate::error::{Result, Subject, refuse, refuse_if};
use crate::volume::{Endian, Origin, SampleType, Segment, Units, Volume};

/// The attributes that are kept; a header has further ones, such as the history of its file.
const KEPT: [&str; 14] = [
    "BRICK_FLOAT_FACS",
    "BRICK_LABS",
    "BRICK_STATAUX",
    "BRICK_TYPES",
    "BYTEORDER_STRING",
    "DATASET_DIMENSIONS",
    "DATASET_RANK",
    "DELTA",
    "IJK_TO_DICOM_REAL",
    "INT_CMAP",
    "ORIENT_SPECIFIC",
    "ORIGIN",
    "STAT_AUX",
    "VALUE_LABEL_DTABLE",
];

/// The largest number of labels that a header may name.
const MAX_LABELS: usize = 1 << 16;

/// The types of samples by their codes, and the number of samples in a voxel.
const TYPES: [(i64, SampleType, i64); 6] = [
    (0, SampleType::U8, 1),
    (1, SampleType::I16, 1),
    (2, SampleType::I32, 1),
    (3, SampleType::F32, 1),
    (4, SampleType::F64, 1),
    // Red, green and blue.
    (6, SampleType::U8, 3),
];

/// The attributes of a header by their names.
struct AfniHeader {
    path: PathBuf,
    attributes: HashMap<String, String>,
}

/// Returns whether these are the first bytes of a header of AFNI.
pub(super) fn is_afni(head: &[u8]) -> bool {
    let text = String::from_utf8_lossy(head.get(..80).unwrap_or(head));
    let Some((name, value)) = text.trim_start().split_once('=') else { return false };
    let kinds = ["string-attribute", "integer-attribute", "float-attribute"];
    name.trim_end() == "type" && kinds.iter().any(|kind| value.trim_start().starts_with(kind))
}

/// Returns the header of a file of samples, if there is one.
pub(super) fn header_of(image: &Path) -> Option<PathBuf> {
    existing(image, &[".HEAD", ".head"]).filter(|_| has_extension(image, &["brik"]))
}

/// Returns the file with the samples of a header.
pub(super) fn named_files(input: Input) -> Result<Vec<PathBuf>> {
    Ok(vec![image_file(input.path())?])
}

fn image_file(header: &Path) -> Result<PathBuf> {
    existing(header, &[".BRIK", ".BRIK.gz", ".BRIK.bz2", ".brik", ".brik.gz"]).ok_or_else(|| {
        let expected = with_extension(header, ".BRIK");
        header.error(format!("its samples belong in {}, which is not there", expected.display()))
    })
}

/// Reads the volume of a header that begins here.
pub(super) fn read(mut input: Input, options: &LoadOptions) -> Result<Volume> {
    let header = AfniHeader::read(&mut input)?;
    let path = &header.path;
    let rank: Vec<i64> = header.numbers("DATASET_RANK", 2)?;
    refuse_if!(rank[0] != 3, path, "DATASET_RANK begins with {}, expected 3 axes", rank[0]);
    let sizes: Vec<i64> = header.numbers("DATASET_DIMENSIONS", 3)?[..3].to_vec();
    let placement = header.placement()?;
    let grid = placement.grid(path, &sizes, options.spacing)?;
    let types = header.types(rank[1])?;
    // The type and the number of channels may differ between sub-bricks.
    let time = options.time.unwrap_or(0) as usize;
    let (sample_type, channels) = types.get(time).copied().unwrap_or(types[0]);
    let mut contents = chosen(path, options, channels as u64, rank[1] as u64)?;
    let space = [(Role::Channel, channels), (Role::Space, sizes[0]), (Role::Space, sizes[1]), (Role::Space, sizes[2])];
    let (pick, _) = picked(path, &space, &LoadOptions { time: None, ..*options })?;
    if channels > 1 {
        contents.labels = colours(contents.channels);
    }
    let (code, parameters) = header.statistic(time)?;
    contents.segments = header.segments();
    let name =
        header.text("BRICK_LABS").and_then(|names| names.split('~').nth(time)).filter(|name| !name.starts_with('#'));
    contents.origin = Origin::of(None, name);
    contents.origin.intent = intent::meaning(code, &parameters);
    let slope = header.slope(time)?;

    let mut data = Input::open(&image_file(path)?, input.unpacked())?;
    let bytes = |(sample_type, channels): &(SampleType, i64)| grid.len() * sample_type.size() as u64 * *channels as u64;
    let before = match types[..] {
        [single] => bytes(&single).saturating_mul(time as u64),
        _ => types.iter().take(time).map(bytes).fold(0, u64::saturating_add),
    };
    data.skip(before)?;
    let samples = read_all(data, &pick, sample_type, Layout::Binary(header.endian()?))?;
    let units = Units { length: Some("mm".to_owned()), value: intent::unit(code).map(str::to_owned) };
    Ok(placement.volume(grid, samples)?.with_rescale(slope, 0.0)?.with_units(units).with_contents(contents))
}

impl AfniHeader {
    fn read(input: &mut Input) -> Result<Self> {
        let is_header = is_afni(&input.peek(80)?);
        refuse_if!(!is_header, input, "is not an AFNI header: it does not begin with the type of an attribute");
        let mut attributes = HashMap::new();
        // The fields of an attribute are its type, its name, its number of values and the values, then a blank line.
        let (mut name, mut fields, mut text) = (String::new(), 0, String::new());
        loop {
            let line = input.line()?;
            let is_end = line.as_ref().is_none_or(|line| line.trim().is_empty());
            if is_end && fields > 0 {
                refuse_if!(fields < 3, input, "is cut short: the attribute {name:?} has no values");
                if KEPT.contains(&name.as_str()) {
                    attributes.insert(std::mem::take(&mut name), std::mem::take(&mut text));
                }
                (fields, text) = (0, String::new());
            }
            let Some(line) = line else { break };
            if is_end {
                continue;
            }
            if fields < 3 {
                let expected = ["type", "name", "count"][fields];
                match line.split_once('=') {
                    Some((field, value)) if field.trim() == expected => {
                        if fields == 1 {
                            value.trim().clone_into(&mut name);
                        }
                    }
                    _ => refuse!(input, "header line {line:?} is not \"{expected} = value\""),
                }
                fields += 1;
            } else if KEPT.contains(&name.as_str()) {
                text += line.as_str();
                text.push(' ');
            }
        }
        Ok(Self { path: input.path().to_owned(), attributes })
    }

    /// Returns the text of an attribute, without its quotation mark and its ending.
    fn text(&self, name: &str) -> Option<&str> {
        let text = self.attributes.get(name)?.trim();
        Some(text.strip_prefix('\'').unwrap_or(text).trim_end_matches('~').trim())
    }

    /// Returns the numbers of an attribute, at least `least`.
    fn numbers<T: FromStr>(&self, name: &str, least: usize) -> Result<Vec<T>> {
        let numbers = self.numbers_if_there(name)?.unwrap_or_default();
        refuse_if!(numbers.len() < least, self.path, "its header has no {name} of {least} numbers");
        Ok(numbers)
    }

    fn numbers_if_there<T: FromStr>(&self, name: &str) -> Result<Option<Vec<T>>> {
        let Some(text) = self.attributes.get(name) else { return Ok(None) };
        let number = |word: &str| {
            let unread = || self.path.error(format!("{name}: {word:?} is not a number that fits"));
            word.parse().map_err(|_| unread())
        };
        text.split_ascii_whitespace().map(number).collect::<Result<Vec<T>>>().map(Some)
    }

    /// Returns the position of the lattice, by its matrix, or else by the axis of the patient that each of its axes
    /// follows.
    fn placement(&self) -> Result<Placement> {
        if let Some(m) = self.numbers_if_there::<f64>("IJK_TO_DICOM_REAL")? {
            refuse_if!(m.len() < 12, self.path, "IJK_TO_DICOM_REAL has {} numbers, expected 12", m.len());
            let column = |c: usize| DVec3::new(m[c], m[4 + c], m[8 + c]);
            let directions = [column(0), column(1), column(2)];
            return Ok(Placement { directions, spacing: [1.0; 3], origin: column(3), oriented: true });
        }
        let (orient, delta) = (self.numbers::<usize>("ORIENT_SPECIFIC", 3)?, self.numbers::<f64>("DELTA", 3)?);
        let starts = self.numbers::<f64>("ORIGIN", 3)?;
        let is_known = orient.iter().take(3).all(|code| *code < 6);
        refuse_if!(!is_known, self.path, "ORIENT_SPECIFIC is {orient:?}, expected three numbers from 0 to 5");
        // Two codes for each axis of DICOM; the sign of the step says which way.
        let axis = |a: usize| DVec3::AXES[orient[a] / 2];
        let directions = std::array::from_fn(|a| axis(a) * delta[a]);
        let origin = axis(0) * starts[0] + axis(1) * starts[1] + axis(2) * starts[2];
        Ok(Placement { directions, spacing: [1.0; 3], origin, oriented: true })
    }

    /// Returns the type of the samples and the number of samples in a voxel, for each sub-brick or once for all.
    fn types(&self, count: i64) -> Result<Vec<(SampleType, i64)>> {
        let codes: Vec<i64> = self.numbers("BRICK_TYPES", 1)?;
        let is_whole = codes.len() == 1 || codes.len() as i64 == count;
        refuse_if!(count < 1, self.path, "DATASET_RANK states {count} sub-bricks");
        refuse_if!(!is_whole, self.path, "BRICK_TYPES has {} numbers for {count} sub-bricks", codes.len());
        let known = |code: &i64| match TYPES.iter().find(|(known, ..)| known == code) {
            Some((_, sample_type, channels)) => Ok((*sample_type, *channels)),
            None if *code == 5 => {
                refuse!(self.path, "its samples are complex numbers: save them as one number per voxel")
            }
            None => refuse!(self.path, "BRICK_TYPES has {code}, expected 0 to 4 or 6"),
        };
        codes.iter().map(known).collect()
    }

    fn endian(&self) -> Result<Endian> {
        match self.text("BYTEORDER_STRING") {
            None => Ok(Endian::NATIVE),
            Some("LSB_FIRST") => Ok(Endian::Little),
            Some("MSB_FIRST") => Ok(Endian::Big),
            Some(other) => refuse!(self.path, "BYTEORDER_STRING is {other:?}, expected LSB_FIRST or MSB_FIRST"),
        }
    }

    /// Returns the factor of a sub-brick; 0 means that there is none.
    fn slope(&self, time: usize) -> Result<f64> {
        let factors: Vec<f64> = self.numbers_if_there("BRICK_FLOAT_FACS")?.unwrap_or_default();
        let factor = factors.get(time).copied().unwrap_or(0.0);
        refuse_if!(!factor.is_finite(), self.path, "BRICK_FLOAT_FACS has {factor} for sub-brick {time}");
        Ok(if factor == 0.0 { 1.0 } else { factor })
    }

    /// Returns the code of a sub-brick's statistic, as in NIfTI's intent, and its parameters; 0 if the sub-brick is no
    /// statistic.
    fn statistic(&self, time: usize) -> Result<(i32, Vec<f64>)> {
        let numbers: Vec<f64> = self.numbers_if_there("BRICK_STATAUX")?.unwrap_or_default();
        // Entries of a number of a sub-brick, a code, the number of parameters and these.
        let mut rest = numbers.as_slice();
        while let [brick, code, count, others @ ..] = rest {
            let (parameters, next) = others.split_at((*count as usize).min(others.len()));
            if *brick == time as f64 && (2.0..=10.0).contains(code) {
                return Ok((*code as i32, parameters.to_vec()));
            }
            rest = next;
        }
        Ok((0, Vec::new()))
    }

    /// Returns the labels that the header names; `None` if the values are no labels.
    fn segments(&self) -> Option<Vec<Segment>> {
        let is_integer = self.attributes.get("INT_CMAP").is_some_and(|text| ["1", "2"].contains(&text.trim()));
        let Some(table) = self.text("VALUE_LABEL_DTABLE") else { return is_integer.then(Vec::new) };
        // A table of XML: in its element, a line has a value and its name in quotation marks.
        let inside = table.split_once('>').map_or("", |(_, inside)| inside);
        let inside = inside.split_once("</").map_or(inside, |(inside, _)| inside);
        let quoted: Vec<&str> = inside.split('"').skip(1).step_by(2).take(2 * MAX_LABELS).collect();
        let segment = |pair: &[&str]| {
            let label = pair[0].trim().parse().ok()?;
            Some(Segment { channel: 0, label, name: plain_name(pair[1]), color: None })
        };
        Some(quoted.chunks_exact(2).filter_map(segment).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::pair::loaded_by_both;
    use crate::volume::Samples;

    /// The attributes of a header of 2 x 3 x 1 samples in two sub-bricks, as kinds, names and values.
    const HEADER: [(&str, &str, &str); 9] = [
        ("integer", "DATASET_RANK", "3 2 0 0"),
        ("integer", "DATASET_DIMENSIONS", "2 3 1 0"),
        ("integer", "BRICK_TYPES", "1 1"),
        ("float", "BRICK_FLOAT_FACS", "0 0.5"),
        ("string", "BYTEORDER_STRING", "'MSB_FIRST~"),
        ("string", "BRICK_LABS", "'#0~pain~"),
        ("float", "BRICK_STATAUX", "1 3 1 12"),
        ("float", "IJK_TO_DICOM_REAL", "-3 0 0 10 0 2 0\n -20 0 0 4 30"),
        ("string", "HISTORY_NOTE", "'a = b\\nc~"),
    ];

    /// Loads a sub-brick of a header with some attributes replaced, or removed if they are empty, and samples.
    fn loaded(changes: &[(&str, &str)], samples: &[u8], time: u32) -> Result<Volume> {
        let mut text = String::new();
        for (kind, name, value) in HEADER.iter().chain(&[("float", "ORIGIN", ""), ("float", "DELTA", "")]).chain(&[
            ("integer", "ORIENT_SPECIFIC", ""),
            ("integer", "INT_CMAP", ""),
            ("string", "VALUE_LABEL_DTABLE", ""),
        ]) {
            let value = changes.iter().find(|(changed, _)| changed == name).map_or(*value, |(_, value)| *value);
            if !value.is_empty() {
                text += &format!("\ntype  = {kind}-attribute\nname  = {name}\ncount = {}\n{value}\n", value.len());
            }
        }
        loaded_by_both([("a+orig.HEAD", text.as_bytes()), ("a+orig.BRIK", samples)], time)
    }

    fn samples() -> Vec<u8> {
        (0..12_i16).flat_map(i16::to_be_bytes).collect()
    }

    #[test]
    fn sub_bricks_are_points_in_time_with_factors_and_statistics() {
        let first = loaded(&[], &samples(), 0).unwrap();
        assert_eq!((first.rescale(), first.value_unit(), first.contents().times), ((1.0, 0.0), None, 2));
        assert_eq!(first.contents().origin, Origin::default());
        let second = loaded(&[], &samples(), 1).unwrap();
        assert_eq!(second.in_memory().unwrap().samples(), &Samples::I16((6..12).collect()));
        assert_eq!((second.rescale(), second.value_unit(), second.is_oriented()), ((0.5, 0.0), Some("t"), true));
        let Origin { description, intent, .. } = &second.contents().origin;
        assert_eq!(description.as_deref(), Some("pain"));
        assert_eq!(intent.as_deref(), Some("t statistic with 12 degrees of freedom"));
        let world = second.grid().to_world();
        assert_eq!(
            (world.translation, world.matrix3.col(0)),
            (DVec3::new(10.0, -20.0, 30.0), DVec3::new(-3.0, 0.0, 0.0))
        );
    }

    #[test]
    fn orientation_codes_place_the_lattice_without_a_matrix() {
        let codes = [("IJK_TO_DICOM_REAL", ""), ("ORIENT_SPECIFIC", "3 4 0"), ("ORIGIN", "1 2 3"), ("DELTA", "-4 5 6")];
        let volume = loaded(&codes, &samples(), 0).unwrap();
        let world = volume.grid().to_world();
        assert_eq!(world.translation, DVec3::new(3.0, 1.0, 2.0));
        assert_eq!(world.matrix3.col(0), DVec3::new(0.0, -4.0, 0.0));
        assert_eq!(world.matrix3.col(1), DVec3::new(0.0, 0.0, 5.0));
        assert_eq!(world.matrix3.col(2), DVec3::new(6.0, 0.0, 0.0));
    }

    #[test]
    fn sub_bricks_may_have_unlike_types() {
        let bytes = [vec![1, 2, 3, 4, 5, 6], (0..6).flat_map(|n| (n as f32).to_be_bytes()).collect()].concat();
        let types = [("BRICK_TYPES", "0 3")];
        let read = |time| loaded(&types, &bytes, time).unwrap().in_memory().unwrap().samples().clone();
        assert_eq!(read(0), Samples::U8(vec![1, 2, 3, 4, 5, 6]));
        assert_eq!(read(1), Samples::F32((0..6).map(|n| n as f32).collect()));
    }

    #[test]
    fn label_tables_name_labels() {
        let table =
            "'<VALUE_LABEL_DTABLE\n ni_dimen=\"2\" >\n\"4\" \"left \"\n\"17\" \"right\"\n</VALUE_LABEL_DTABLE>~";
        let volume = loaded(&[("VALUE_LABEL_DTABLE", table)], &samples(), 0).unwrap();
        let named = |(label, name): (i64, &str)| Segment { label, name: Some(name.to_owned()), ..Segment::default() };
        assert_eq!(volume.contents().segments, Some([(4, "left"), (17, "right")].map(named).to_vec()));
        assert_eq!(loaded(&[("INT_CMAP", "1")], &samples(), 0).unwrap().contents().segments, Some(Vec::new()));
        assert_eq!(loaded(&[("INT_CMAP", "0")], &samples(), 0).unwrap().contents().segments, None);
    }

    #[test]
    fn broken_headers_say_what_is_wrong() {
        for (name, value, words) in [
            ("DATASET_RANK", "", "its header has no DATASET_RANK of 2 numbers"),
            ("DATASET_RANK", "2 2", "begins with 2, expected 3 axes"),
            ("DATASET_RANK", "3 0", "states 0 sub-bricks"),
            ("DATASET_RANK", "3 3", "BRICK_TYPES has 2 numbers for 3 sub-bricks"),
            ("DATASET_DIMENSIONS", "2 3", "no DATASET_DIMENSIONS of 3 numbers"),
            ("DATASET_DIMENSIONS", "2 70000 1", "dimension 2 is 70000"),
            ("DATASET_DIMENSIONS", "65535 65535 65535", "need 562924184010750 bytes, 24 are there"),
            ("BRICK_TYPES", "5", "complex numbers"),
            ("BRICK_TYPES", "7", "BRICK_TYPES has 7, expected 0 to 4 or 6"),
            ("BRICK_TYPES", "one", "BRICK_TYPES: \"one\" is not a number"),
            ("BRICK_FLOAT_FACS", "nan", "BRICK_FLOAT_FACS has NaN for sub-brick 0"),
            ("BYTEORDER_STRING", "'MIDDLE~", "BYTEORDER_STRING is \"MIDDLE\""),
            ("IJK_TO_DICOM_REAL", "1 2 3", "has 3 numbers, expected 12"),
            ("IJK_TO_DICOM_REAL", "nan 0 0 0 0 1 0 0 0 0 1 0", "do not span space"),
            ("IJK_TO_DICOM_REAL", "", "no ORIENT_SPECIFIC of 3 numbers"),
            ("HISTORY_NOTE", "\ntype = string-attribute\nnme = A", "is not \"name = value\""),
        ] {
            let error = loaded(&[(name, value)], &samples(), 0).unwrap_err().to_string();
            assert!(error.contains(words), "{words}: {error}");
        }
        let cut = loaded(&[], &samples()[..20], 1).unwrap_err().to_string();
        assert!(cut.contains("6 samples need 12 bytes, 8 are there"), "{cut}");
        let far = loaded(&[("DATASET_RANK", "3 9000000000"), ("BRICK_TYPES", "1")], &[], 0).unwrap_err().to_string();
        assert!(far.contains("has 9000000000 points in time"), "{far}");
    }
}
