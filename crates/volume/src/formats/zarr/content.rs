//! Readers of parts of the files of a Zarr: values of JSON, and frames of Zstandard.

use std::io::{self, Read};

use serde_json::Value;

use crate::error::Damage;

/// Returns the whole numbers of a list; none if the value is no such list.
pub(super) fn numbers(value: &Value) -> Vec<u64> {
    let numbers = value.as_array().and_then(|list| list.iter().map(Value::as_u64).collect());
    numbers.unwrap_or_default()
}

/// Decompresses frames of Zstandard, to at most `most` bytes.
pub(super) fn zstd(mut bytes: &[u8], most: usize) -> io::Result<Vec<u8>> {
    let mut content = Vec::new();
    while !bytes.is_empty() && content.len() < most {
        let frame = ruzstd::decoding::StreamingDecoder::new(&mut bytes);
        let frame = frame.map_err(|error| Damage.error(format!("Zstandard: {error}")))?;
        frame.take((most - content.len()) as u64).read_to_end(&mut content)?;
    }
    Ok(content)
}
