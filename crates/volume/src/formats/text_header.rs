//! Headers of text: a field a line, as in NRRD and MetaImage.

use std::collections::HashMap;
use std::path::PathBuf;
use std::str::FromStr;

use super::input::Input;
use crate::error::{Error, Result, Subject, refuse_if};

/// The fields of a header by name, in lower case.
pub(super) struct TextHeader {
    pub(super) path: PathBuf,
    /// The name of the format, for messages.
    format: &'static str,
    fields: HashMap<String, String>,
}

impl TextHeader {
    /// Makes a header without fields for a text at the beginning of a file.
    pub(super) fn new(input: &Input, format: &'static str) -> Self {
        Self { path: input.path().to_owned(), format, fields: HashMap::new() }
    }

    /// Returns an [`Error::Format`] about this header.
    pub(super) fn error(&self, reason: impl Into<String>) -> Error {
        self.path.error(reason)
    }

    /// Adds a field; fails if the header has it already.
    pub(super) fn insert(&mut self, name: &str, value: &str) -> Result<()> {
        match self.fields.insert(name.to_owned(), value.to_owned()) {
            Some(first) => Err(self.error(format!("field {name:?} is given twice: {first:?} and {value:?}"))),
            None => Ok(()),
        }
    }

    /// Returns the text of the first of these fields that the header has: some fields have several names.
    pub(super) fn get<const N: usize>(&self, names: [&str; N]) -> Option<&str> {
        names.iter().find_map(|name| self.fields.get(&name.to_ascii_lowercase())).map(String::as_str)
    }

    /// Returns the text of a mandatory field.
    pub(super) fn required(&self, name: &str) -> Result<&str> {
        self.get([name]).ok_or_else(|| self.error(format!("the {} header has no field {name:?}", self.format)))
    }

    /// Returns the number of a field, if the header has it.
    pub(super) fn number<T: FromStr>(&self, name: &str) -> Result<Option<T>> {
        self.get([name]).map(|text| self.parsed(name, text)).transpose()
    }

    /// Parses the text of a field as a number.
    pub(super) fn parsed<T: FromStr>(&self, name: &str, text: &str) -> Result<T> {
        text.trim().parse().map_err(|_| self.error(format!("{name}: {text:?} is not a number that fits")))
    }

    /// Parses the text of a field as `n` numbers, separated by blanks.
    pub(super) fn list<T: FromStr>(&self, name: &str, text: &str, n: usize) -> Result<Vec<T>> {
        let list = text.split_ascii_whitespace().map(|word| self.parsed(name, word)).collect::<Result<Vec<T>>>()?;
        refuse_if!(list.len() != n, self, "{name}: {text:?}, expected {n} numbers");
        Ok(list)
    }
}
