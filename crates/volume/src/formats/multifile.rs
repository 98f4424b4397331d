//! Volumes in several files, as NRRD and MetaImage headers name them.

use std::path::{Path, PathBuf};

use super::decode::{Layout, read_samples};
use super::input::Input;
use super::selection::Pick;
use super::text_header::TextHeader;
use crate::error::{Result, Subject, refuse, refuse_if};
use crate::volume::{MAX_DIM, SampleType, Stored};

/// The largest number of data files of a volume: files hold slices, and no axis has more samples.
const MAX_FILES: usize = MAX_DIM as usize;

/// The longest name of a data file, in bytes: no path is longer on macOS, and a message can show it.
const MAX_NAME: usize = 1024;

/// Returns whether the field that names data files announces a list of them behind the header.
pub(super) fn announces_list(text: &str) -> bool {
    text.split_ascii_whitespace().next() == Some("LIST")
}

/// Returns the data files that a header names in a field of this text: files listed on the lines behind the header,
/// files of a pattern `PATTERN FIRST LAST STEP` such as `slice%03d.raw 1 60 1`, or the one file of any other text.
///
/// Up to `max_numbers` numbers at the end of the text belong to the pattern; all after the third are ignored.
pub(super) fn data_files(header: &Path, text: &str, max_numbers: usize, input: &mut Input) -> Result<Vec<PathBuf>> {
    let mut names = Vec::new();
    // The number after LIST is the dimension of each file. It does not matter: all files hold equal shares.
    if announces_list(text) {
        while let Some(line) = input.line()? {
            refuse_if!(names.len() == MAX_FILES, header, "lists over {MAX_FILES} data files");
            let name = line.trim();
            check_name(header, name)?;
            names.extend((!name.is_empty()).then(|| name.to_owned()));
        }
        refuse_if!(names.is_empty(), header, "lists no data files: expected one name per line after LIST");
    } else {
        check_name(header, text)?;
        names = numbered(header, text, max_numbers)?.unwrap_or_else(|| vec![text.to_owned()]);
    }
    // `join` keeps an absolute name as it is.
    let folder = header.parent().unwrap_or(Path::new(""));
    Ok(names.into_iter().map(|name| folder.join(name)).collect())
}

/// Reads the samples behind a header, or of its data files, which hold equal shares of them. `at_samples` moves to the
/// first sample of a file.
pub(super) fn read_shares(
    header: &TextHeader,
    input: Input,
    files: Option<Vec<PathBuf>>,
    (pick, sample_type, layout): (&Pick, SampleType, Layout),
    at_samples: impl Fn(Input) -> Result<Input>,
) -> Result<Stored> {
    let Some(files) = files else {
        return read_samples(&mut std::iter::once(at_samples(input)), 1, pick, sample_type, layout);
    };
    let (n, count) = (files.len(), pick.all);
    refuse_if!(!count.is_multiple_of(n as u64), header, "{n} data files cannot share {count} samples equally");
    // Of many files each would be kept open.
    let unpacked = input.unpacked().filter(|_| n == 1);
    let mut parts = files.iter().map(|file| at_samples(Input::open_data(file, unpacked.clone())?));
    read_samples(&mut parts, n, pick, sample_type, layout)
}

/// Refuses a name that no file has, or that could steer the terminal in a message.
fn check_name(header: &Path, name: &str) -> Result<()> {
    let reason = match () {
        () if name.len() > MAX_NAME => format!("of {} bytes, expected at most {MAX_NAME}", name.len()),
        () if name.contains(|c: char| c.is_control()) => format!("{name:?}, which has control characters"),
        () => return Ok(()),
    };
    refuse!(header, "names the data file {reason}")
}

/// Returns the names of a pattern; `None` if the text is a plain file name.
fn numbered(header: &Path, text: &str, max_numbers: usize) -> Result<Option<Vec<String>>> {
    let words: Vec<&str> = text.split_ascii_whitespace().collect();
    // The pattern may contain blanks, so the numbers are read from the end.
    let mut numbers: Vec<i64> = words.iter().rev().map_while(|word| word.parse().ok()).take(max_numbers).collect();
    numbers.reverse();
    let [first, last, step, ..] = numbers[..] else { return Ok(None) };
    if !text.contains('%') || words.len() == numbers.len() {
        return Ok(None);
    }
    let pattern = words[..words.len() - numbers.len()].join(" ");
    let [from, to, by] = [first, last, step].map(i128::from);
    let leads_back = by == 0 || (to - from) * by < 0;
    refuse_if!(leads_back, header, "data files {text:?}: the step does not lead from the first number to the last");
    refuse_if!((to - from) / by >= MAX_FILES as i128, header, "data files {text:?}: too many files");
    let numbers = (0..=(to - from) / by).map(|n| from + n * by);
    match numbers.map(|number| with_number(&pattern, number)).collect() {
        Some(names) => Ok(Some(names)),
        None => refuse!(header, "data files {text:?}: expected one number such as %d or %03d in the name"),
    }
}

/// Formats one integer as `printf` does: %d, %i or %u with an optional width up to 32, zero-padded or not.
fn with_number(pattern: &str, number: i128) -> Option<String> {
    let (before, rest) = pattern.split_once('%')?;
    let kind = rest.find(['d', 'i', 'u'])?;
    let (format, after) = (&rest[..kind], &rest[kind + 1..]);
    if after.contains('%') {
        return None;
    }
    let width: usize = if format.is_empty() { 0 } else { format.parse().ok().filter(|w| *w <= 32)? };
    let digits = if format.starts_with('0') { format!("{number:0width$}") } else { format!("{number:width$}") };
    Some(format!("{before}{digits}{after}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(text: &str) -> Option<Vec<String>> {
        numbered(Path::new("h"), text, 4).unwrap()
    }

    #[test]
    fn patterns_expand_as_printf_does() {
        assert_eq!(names("a b%03d.raw 8 12 2").unwrap(), ["a b008.raw", "a b010.raw", "a b012.raw"]);
        assert_eq!(names("s%d 2 1 -1").unwrap(), ["s2", "s1"]);
        assert_eq!(names("s%2i.x 9 10 1 2").unwrap(), ["s 9.x", "s10.x"]);
        assert_eq!(names("plain.raw"), None);
        assert_eq!(names("100% 1.raw"), None);
    }

    #[test]
    fn patterns_that_lead_nowhere_are_refused() {
        for (text, expected) in [
            ("s%d 1 2 0", "the step does not lead"),
            ("s%d 1 2 -1", "the step does not lead"),
            ("s%d 1 9223372036854775807 1", "too many files"),
            ("s%s 1 2 1", "expected one number such as %d"),
            ("s%d%d 1 2 1", "expected one number such as %d"),
            ("s%99d 1 2 1", "expected one number such as %d"),
        ] {
            let error = numbered(Path::new("h"), text, 4).err().unwrap().to_string();
            assert!(error.contains(expected), "{text}: {error}");
        }
    }
}
