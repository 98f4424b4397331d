//! Parts of the files of a Zarr: values of JSON, and frames of Zstandard.

use std::io::{self, Read};

use serde_json::Value;

use crate::error::Damage;

/// A list of whole numbers; empty if it is none.
pub(super) fn numbers(value: &Value) -> Vec<u64> {
    let numbers = value.as_array().and_then(|list| list.iter().map(Value::as_u64).collect());
    numbers.unwrap_or_default()
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
