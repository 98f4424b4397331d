//! Volumes in several files: how NRRD and MetaImage headers name them.

use std::path::{Path, PathBuf};

use super::input::Input;
use crate::error::{Error, Result};
use crate::volume::MAX_DIM;

/// The most data files of a volume: files hold slices, and no axis has more samples.
const MAX_FILES: usize = MAX_DIM as usize;

/// The longest name of a data file, in bytes: no path is longer on macOS, and a message can show it.
const MAX_NAME: usize = 1024;

/// The data files of a volume, in order.
#[derive(Debug)]
pub(super) struct DataFiles {
    /// The header's, which names are relative to.
    folder: PathBuf,
    names: Names,
}

#[derive(Debug)]
enum Names {
    Listed(Vec<String>),
    /// Names are made one at a time: a header of few bytes can stand for many.
    Numbered {
        pattern: String,
        first: i64,
        step: i64,
        count: usize,
    },
}

impl DataFiles {
    /// The names listed on the lines after the header.
    pub(super) fn listed(input: &mut Input) -> Result<Self> {
        let mut names = Vec::new();
        while let Some(line) = input.line()? {
            let name = line.trim();
            if name.is_empty() {
                continue;
            }
            if names.len() == MAX_FILES {
                return Err(input.error(format!("lists over {MAX_FILES} data files")));
            }
            check_name(input.path(), name)?;
            names.push(name.to_owned());
        }
        if names.is_empty() {
            return Err(input.error("lists no data files: expected one name per line after LIST"));
        }
        Ok(Self::of(input.path(), Names::Listed(names)))
    }

    /// The files of `PATTERN FIRST LAST STEP`, as in `slice%03d.raw 1 60 1`, or the one file of any other text.
    ///
    /// Up to `max_numbers` numbers at the end of the text belong to the pattern; all after the third are ignored.
    pub(super) fn named(header: &Path, text: &str, max_numbers: usize) -> Result<Self> {
        check_name(header, text)?;
        let names = numbered(header, text, max_numbers)?;
        Ok(Self::of(header, names.unwrap_or_else(|| Names::Listed(vec![text.to_owned()]))))
    }

    fn of(header: &Path, names: Names) -> Self {
        Self { folder: header.parent().unwrap_or(Path::new("")).to_owned(), names }
    }

    /// The number of files, at least one.
    pub(super) fn len(&self) -> usize {
        match &self.names {
            Names::Listed(names) => names.len(),
            Names::Numbered { count, .. } => *count,
        }
    }

    /// The paths of the files.
    pub(super) fn paths(&self) -> impl Iterator<Item = PathBuf> {
        (0..self.len()).map(|i| match &self.names {
            // `join` keeps an absolute name as it is.
            Names::Listed(names) => self.folder.join(&names[i]),
            Names::Numbered { pattern, first, step, .. } => {
                // All numbers lie between the first and the last, so they fit.
                let number = first.wrapping_add(step.wrapping_mul(i as i64));
                self.folder.join(with_number(pattern, number).unwrap_or_default())
            }
        })
    }
}

/// Refuses a name that no file has, or that could steer the terminal in a message.
fn check_name(header: &Path, name: &str) -> Result<()> {
    let reason = match () {
        () if name.len() > MAX_NAME => format!("of {} bytes, expected at most {MAX_NAME}", name.len()),
        () if name.contains(|c: char| c.is_control()) => format!("{name:?}, which has control characters"),
        () => return Ok(()),
    };
    Err(Error::format(header, format!("names the data file {reason}")))
}

/// The names of a pattern; `None` if the text is a plain file name.
fn numbered(header: &Path, text: &str, max_numbers: usize) -> Result<Option<Names>> {
    let words: Vec<&str> = text.split_ascii_whitespace().collect();
    // The pattern may contain blanks, so the numbers are taken from the end.
    let mut numbers: Vec<i64> = words.iter().rev().map_while(|word| word.parse().ok()).take(max_numbers).collect();
    numbers.reverse();
    let [first, last, step, ..] = numbers[..] else { return Ok(None) };
    if !text.contains('%') || words.len() == numbers.len() {
        return Ok(None);
    }
    let pattern = words[..words.len() - numbers.len()].join(" ");
    let error = |reason: &str| Err(Error::format(header, format!("data files {text:?}: {reason}")));
    let span = i128::from(last) - i128::from(first);
    if step == 0 || span * i128::from(step) < 0 {
        return error("the step does not lead from the first number to the last");
    }
    match usize::try_from(span / i128::from(step) + 1) {
        Ok(count) if count <= MAX_FILES => match with_number(&pattern, first) {
            Some(_) => Ok(Some(Names::Numbered { pattern, first, step, count })),
            None => error("expected one number such as %d or %03d in the name"),
        },
        _ => error("too many files"),
    }
}

/// `printf` with one integer: %d, %i or %u with an optional width up to 32, zero-padded or not.
fn with_number(pattern: &str, number: i64) -> Option<String> {
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
        let names = numbered(Path::new("h"), text, 4).unwrap()?;
        Some(DataFiles::of(Path::new("h"), names).paths().map(|path| path.to_str().unwrap().to_owned()).collect())
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
