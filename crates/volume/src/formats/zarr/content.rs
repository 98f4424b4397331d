//! Parts of the files of a Zarr: values of JSON, and frames of Zstandard.

use std::io::{self, Read};
use std::path::Path;

use serde_json::Value;

use crate::error::{Damage, Result, Subject, refuse};
use crate::names::listed;

/// A list of whole numbers; empty if it is none.
pub(super) fn numbers(value: &Value) -> Vec<u64> {
    let numbers = value.as_array().and_then(|list| list.iter().map(Value::as_u64).collect());
    numbers.unwrap_or_default()
}

/// What a text of metadata stands for among some choices, of which the first is the default.
pub(super) fn chosen<T: Copy, const N: usize>(
    file: &Path,
    name: &str,
    value: &Value,
    choices: [(&str, T); N],
) -> Result<T> {
    let text = value.as_str().unwrap_or(choices[0].0);
    match choices.iter().find(|(choice, _)| *choice == text) {
        Some((_, choice)) => Ok(*choice),
        None => refuse!(file, "{name} {text:?}, expected {}", listed(&choices.map(|(choice, _)| choice))),
    }
}

/// The content of frames of Zstandard, of at most `most` bytes.
pub(super) fn zstd(mut bytes: &[u8], most: usize) -> io::Result<Vec<u8>> {
    let mut content = Vec::new();
    while !bytes.is_empty() && content.len() < most {
        let frame = ruzstd::decoding::StreamingDecoder::new(&mut bytes);
        let frame = frame.map_err(|error| Damage.error(format!("Zstandard: {error}")))?;
        frame.take((most - content.len()) as u64).read_to_end(&mut content)?;
    }
    Ok(content)
}
