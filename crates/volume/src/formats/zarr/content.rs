//! What files of a Zarr hold, or what is wrong with it: fields of JSON and frames of Zstandard.

use std::io::{self, Read};

use serde_json::Value;

/// What is wrong with the content of a file.
pub(super) struct Damage(pub(super) String);

pub(super) fn damaged(what: impl Into<String>) -> Damage {
    Damage(what.into())
}

impl From<io::Error> for Damage {
    fn from(error: io::Error) -> Self {
        Self(error.to_string())
    }
}

/// A list of whole numbers.
pub(super) fn numbers(value: &Value) -> Option<Vec<u64>> {
    value.as_array()?.iter().map(Value::as_u64).collect()
}

/// The text of a key.
pub(super) fn text<'a>(value: &'a Value, key: &str) -> Result<&'a str, Damage> {
    value[key].as_str().ok_or_else(|| damaged(format!("a codec without {key}")))
}

/// The content of frames of Zstandard, of at most `most` bytes.
pub(super) fn zstd(mut bytes: &[u8], most: usize) -> Result<Vec<u8>, Damage> {
    let mut content = Vec::new();
    while !bytes.is_empty() && content.len() < most {
        let frame = ruzstd::decoding::StreamingDecoder::new(&mut bytes);
        let frame = frame.map_err(|error| damaged(format!("Zstandard: {error}")))?;
        frame.take((most - content.len()) as u64).read_to_end(&mut content)?;
    }
    Ok(content)
}
