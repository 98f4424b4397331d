//! Volumes in several files: how NRRD and MetaImage headers name them.

use std::path::{Path, PathBuf};

use super::input::{Input, format_error};
use crate::error::Result;
use crate::volume::MAX_DIM;

/// The most data files of a volume: files hold slices, and no axis has more samples.
const MAX_FILES: usize = MAX_DIM as usize;

/// The paths of the data files, in order. Names are relative to the header's folder.
pub(super) fn resolve(header: &Path, names: &[String]) -> Result<Vec<PathBuf>> {
    let folder = header.parent().unwrap_or(Path::new(""));
    // Names are printed in messages, and control characters could steer the terminal.
    if let Some(name) = names.iter().find(|name| name.contains(|c: char| c.is_control())) {
        return Err(format_error(header, format!("names the data file {name:?}, which has control characters")));
    }
    // `join` keeps an absolute name as it is.
    Ok(names.iter().map(|name| folder.join(name)).collect())
}

/// The names listed on the lines after the header.
pub(super) fn listed(input: &mut Input) -> Result<Vec<String>> {
    let mut names = Vec::new();
    while let Some(line) = input.line()? {
        let name = line.trim();
        if !name.is_empty() {
            names.push(name.to_owned());
        }
        if names.len() > MAX_FILES {
            return Err(input.error(format!("lists over {MAX_FILES} data files")));
        }
    }
    if names.is_empty() {
        return Err(input.error("lists no data files: expected one name per line after LIST"));
    }
    Ok(names)
}

/// The file names of `PATTERN FIRST LAST STEP`, as in `slice%03d.raw 1 60 1`; `None` if the text is a plain file name.
///
/// Up to `max_numbers` numbers at the end of the text belong to the pattern; all after the third are ignored.
pub(super) fn expanded(header: &Path, text: &str, max_numbers: usize) -> Result<Option<Vec<String>>> {
    let words: Vec<&str> = text.split_ascii_whitespace().collect();
    // The pattern may contain blanks, so the numbers are taken from the end.
    let numbers: Vec<i64> = words
        .iter()
        .rev()
        .map_while(|word| word.parse().ok())
        .take(max_numbers)
        .collect::<Vec<_>>()
        .into_iter()
        .rev()
        .collect();
    let [first, last, step, ..] = numbers[..] else { return Ok(None) };
    if !text.contains('%') || words.len() == numbers.len() {
        return Ok(None);
    }
    let pattern = words[..words.len() - numbers.len()].join(" ");
    let error = |reason: &str| Err(format_error(header, format!("data files {text:?}: {reason}")));
    let span = i128::from(last) - i128::from(first);
    if step == 0 || span * i128::from(step) < 0 {
        return error("the step does not lead from the first number to the last");
    }
    let count = span / i128::from(step) + 1;
    if count > MAX_FILES as i128 {
        return error("too many files");
    }
    let mut names = Vec::new();
    for n in 0..count {
        // It lies between `first` and `last`, so it fits.
        let number = (i128::from(first) + n * i128::from(step)) as i64;
        match numbered(&pattern, number) {
            Some(name) => names.push(name),
            None => return error("expected one number such as %d or %03d in the name"),
        }
    }
    Ok(Some(names))
}

/// `printf` with one integer: %d, %i or %u with an optional width up to 32, zero-padded or not.
fn numbered(pattern: &str, number: i64) -> Option<String> {
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
        expanded(Path::new("h"), text, 4).unwrap()
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
        for text in
            ["s%d 1 2 0", "s%d 1 2 -1", "s%d 1 9223372036854775807 1", "s%s 1 2 1", "s%d%d 1 2 1", "s%99d 1 2 1"]
        {
            assert!(expanded(Path::new("h"), text, 4).is_err(), "{text}");
        }
    }
}
