//! The JSON of a folder: an array, or a group with a pyramid.

use std::path::{Path, PathBuf};

use serde_json::Value;

use super::codecs::Chain;
use super::content::numbers;
use super::store::{MAX_METADATA, Store};
use crate::error::{Error, Result, Subject, refuse, refuse_if};
use crate::formats::decode::Kind;
use crate::formats::selection::choice;
use crate::volume::{Endian, Number, SampleType, with_type};

/// The largest number of axes of an array.
const MAX_AXES: usize = 16;

/// The largest number of bytes of a chunk, decompressed.
pub(super) const MAX_CHUNK: u64 = 1 << 30;

/// A folder of Zarr.
pub(super) struct ZarrNode {
    pub(super) folder: PathBuf,
    /// The array that the folder holds; `None` if it is a group.
    pub(super) array: Option<Array>,
    pub(super) attributes: Value,
}

/// An array in chunks.
pub(super) struct Array {
    pub(super) shape: Vec<u64>,
    pub(super) chunks: Vec<u64>,
    pub(super) kind: Kind,
    pub(super) chain: Chain,
    fill: Value,
    /// The text before the numbers of a chunk in the name of its file; `separator` is between them.
    prefix: &'static str,
    separator: char,
    /// The names of the axes, if they are stated.
    pub(super) names: Vec<String>,
}

/// Reads the JSON of a file; `None` if there is no such file.
fn json(store: &Store, path: &Path) -> Result<Option<Value>> {
    let Some(bytes) = store.open(path, MAX_METADATA)? else { return Ok(None) };
    let bytes = bytes.all(MAX_METADATA).map_err(|source| Error::of_content(path, source))?;
    serde_json::from_slice(&bytes).map(Some).map_err(|error| path.error(error.to_string()))
}

impl ZarrNode {
    pub(super) fn read(store: &Store, folder: &Path) -> Result<Self> {
        let folder = folder.to_owned();
        let file = folder.join("zarr.json");
        if let Some(value) = json(store, &file)? {
            let array = match value["node_type"].as_str() {
                Some("array") => Some(Array::of_v3(&file, &value)?),
                Some("group") => None,
                other => refuse!(file, "has the node_type {:?}", other.unwrap_or_default()),
            };
            return Ok(Self { folder, array, attributes: value["attributes"].clone() });
        }
        let file = folder.join(".zarray");
        let mut array = json(store, &file)?.map(|value| Array::of_v2(&file, &value)).transpose()?;
        if array.is_none() && !store.has(&folder.join(".zgroup")) {
            refuse!(folder, "has neither zarr.json nor .zarray nor .zgroup");
        }
        let attributes = json(store, &folder.join(".zattrs"))?.unwrap_or_default();
        if let Some(array) = &mut array {
            // Format 2 has no names of axes; xarray writes them here.
            array.names = names(&attributes["_ARRAY_DIMENSIONS"]);
        }
        Ok(Self { folder, array, attributes })
    }
}

/// Returns the names of axes in a list; an axis without a name has an empty one.
fn names(value: &Value) -> Vec<String> {
    let names = value.as_array().map(Vec::as_slice).unwrap_or_default();
    names.iter().map(|name| name.as_str().unwrap_or_default().to_owned()).collect()
}

impl Array {
    fn of_v2(file: &Path, value: &Value) -> Result<Self> {
        let (shape, chunks) = shapes(file, &value["shape"], &value["chunks"])?;
        let Some(name) = value["dtype"].as_str() else { refuse!(file, "its dtype is no simple type") };
        let (order, letters) = name.split_at_checked(1).unwrap_or_default();
        let endian = match order {
            ">" => Endian::Big,
            "<" | "|" => Endian::Little,
            _ => refuse!(file, "the dtype {name:?} is unknown"),
        };
        let Some(kind) = Kind::of_numpy(letters) else { refuse!(file, "the dtype {name:?} is not read") };
        let is_fortran = choice(file, "order", value["order"].as_str(), [("C", false), ("F", true)])?;
        // What was done last is undone first.
        let compressor = Some(&value["compressor"]).filter(|codec| !codec.is_null());
        let filters = value["filters"].as_array().map(Vec::as_slice).unwrap_or_default();
        refuse_if!(filters.len() > MAX_AXES, file, "{} filters", filters.len());
        let codecs: Vec<&Value> = compressor.into_iter().chain(filters.iter().rev()).collect();
        let separators = [(".", '.'), ("/", '/')];
        let separator = choice(file, "dimension_separator", value["dimension_separator"].as_str(), separators)?;
        let chain = Chain::of_v2(file, shape.len(), is_fortran, endian, &codecs)?;
        let fill = value["fill_value"].clone();
        Self { shape, chunks, kind, chain, fill, prefix: "", separator, names: Vec::new() }.checked(file)
    }

    fn of_v3(file: &Path, value: &Value) -> Result<Self> {
        let is_regular = value["chunk_grid"]["name"].as_str() == Some("regular");
        refuse_if!(!is_regular, file, "its chunks are not those of a regular grid");
        let (shape, chunks) = shapes(file, &value["shape"], &value["chunk_grid"]["configuration"]["chunk_shape"])?;
        let Some(name) = value["data_type"].as_str() else { refuse!(file, "its data_type is no simple type") };
        let kind = match name {
            "float16" => Some(Kind::Half),
            "bool" => Some(Kind::Whole(SampleType::U8)),
            _ => SampleType::from_name(name).map(Kind::Whole),
        };
        let Some(kind) = kind else { refuse!(file, "the data_type {name:?} is not read") };
        let keys = &value["chunk_key_encoding"];
        let (prefix, separators) = match keys["name"].as_str() {
            Some("default") => ("c", [("/", '/'), (".", '.')]),
            Some("v2") => ("", [(".", '.'), ("/", '/')]),
            other => refuse!(file, "chunk_key_encoding {:?}", other.unwrap_or_default()),
        };
        let separator = choice(file, "separator", keys["configuration"]["separator"].as_str(), separators)?;
        let names = names(&value["dimension_names"]);
        let chain = Chain::of_v3(file, &value["codecs"], &chunks, 0)?;
        let fill = value["fill_value"].clone();
        Self { shape, chunks, kind, chain, fill, prefix, separator, names }.checked(file)
    }

    fn checked(self, file: &Path) -> Result<Self> {
        let bytes = self.chunks.iter().fold(self.kind.size() as u64, |bytes, size| bytes.saturating_mul(*size));
        refuse_if!(bytes > MAX_CHUNK, file, "chunks of {bytes} bytes, expected at most {MAX_CHUNK}");
        let is_number = match self.kind {
            Kind::Whole(sample_type) => with_type!(sample_type, T => self.stated_fill::<T>().is_some()),
            Kind::Half => self.stated_fill::<u16>().is_some(),
        };
        if !self.fill.is_null() && !is_number {
            refuse!(file, "its fill_value is {}, which is no number of the type {}", self.fill, self.kind.name());
        }
        Ok(self)
    }

    /// Returns the path of the file of a chunk.
    pub(super) fn file(&self, folder: &Path, chunk: &[u64]) -> PathBuf {
        let numbers: Vec<String> = chunk.iter().map(u64::to_string).collect();
        let separator = self.separator.to_string();
        let numbers = numbers.join(&separator);
        folder.join(if self.prefix.is_empty() { numbers } else { format!("{}{separator}{numbers}", self.prefix) })
    }

    /// Returns the value of chunks that are not there: a number of the array's type; 0 if it is not stated. 16-bit
    /// floating point is read as its bits.
    pub(super) fn fill<T: Number>(&self) -> T {
        self.stated_fill().unwrap_or(T::zeroed())
    }

    /// Returns the stated value of chunks that are not there; `None` if none is stated or it is no number of this type.
    fn stated_fill<T: Number>(&self) -> Option<T> {
        let text = match &self.fill {
            Value::Bool(value) => u8::from(*value).to_string(),
            Value::String(text) => text.clone(),
            value => value.to_string(),
        };
        if let Some(digits) = text.strip_prefix("0x") {
            // The bytes of the number, the most significant one first.
            let bits = u64::from_str_radix(digits, 16).ok().filter(|_| digits.len() == 2 * size_of::<T>())?;
            let bytes = bits.to_be_bytes();
            let number: T = bytemuck::pod_read_unaligned(&bytes[bytes.len() - size_of::<T>()..]);
            return Some(if Endian::NATIVE == Endian::Big { number } else { number.swap() });
        }
        if self.kind == Kind::Half {
            let bits = half::f16::from_f64(text.parse().ok()?).to_bits();
            return T::parse(&bits.to_string());
        }
        T::parse(&text)
    }
}

/// Returns the shape of an array and the shape of its chunks.
fn shapes(file: &Path, shape: &Value, chunks: &Value) -> Result<(Vec<u64>, Vec<u64>)> {
    let (shape, chunks) = (numbers(shape), numbers(chunks));
    let fits = (1..=MAX_AXES).contains(&shape.len()) && shape.len() == chunks.len() && !chunks.contains(&0);
    refuse_if!(!fits, file, "an array of {shape:?} in chunks of {chunks:?}");
    Ok((shape, chunks))
}
