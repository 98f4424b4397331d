//! Samples and attributes of a data set.

use std::path::Path;

use hdf5_reader::{Datatype, H5Type};
use netcdf_reader::classic::data::NcReadType;
use netcdf_reader::{NcAttribute, NcFile, NcReadable, NcSliceInfo, NcSliceInfoElem, NcType};

use crate::error::{Result, Subject, refuse, refuse_if};
use crate::memory::{reserved, samples_in};
use crate::volume::{Number, Samples};

/// The largest number of bytes that are read at once, unless one index of the slowest axis has more.
pub(super) const SLAB: u64 = 64 << 20;

/// Returns the attribute of a name.
pub(super) fn attribute<'a>(attributes: &'a [NcAttribute], name: &str) -> Option<&'a NcAttribute> {
    attributes.iter().find(|attribute| attribute.name == name)
}

/// Returns the text of an attribute.
pub(super) fn text(attributes: &[NcAttribute], name: &str) -> Option<String> {
    attribute(attributes, name)?.value.as_string()
}

/// A data set whose samples are read slab by slab.
pub(super) struct Slabs<'a> {
    pub(super) file: &'a NcFile,
    /// The path of the data set.
    pub(super) name: &'a str,
    pub(super) kind: &'a NcType,
    pub(super) selections: Vec<NcSliceInfoElem>,
    /// The slowest axis of space.
    pub(super) slowest: Option<usize>,
    pub(super) path: &'a Path,
}

impl Slabs<'_> {
    /// Reads `count` samples. Types of NetCDF-3 have signs unless they are `unsigned`.
    pub(super) fn samples(&self, unsigned: bool, count: u64) -> Result<Samples> {
        let kind = match self.kind {
            NcType::Enum { base, .. } => base,
            kind => kind,
        };
        Ok(match kind {
            NcType::Byte if unsigned => {
                let signed = self.read::<i8>(count)?;
                Samples::U8(signed.into_iter().map(i8::cast_unsigned).collect())
            }
            NcType::Short if unsigned => {
                let signed = self.read::<i16>(count)?;
                Samples::U16(signed.into_iter().map(i16::cast_unsigned).collect())
            }
            NcType::Int if unsigned => {
                let signed = self.read::<i32>(count)?;
                Samples::U32(signed.into_iter().map(i32::cast_unsigned).collect())
            }
            NcType::Byte => Samples::I8(self.read(count)?),
            NcType::UByte => Samples::U8(self.read(count)?),
            NcType::Short => Samples::I16(self.read(count)?),
            NcType::UShort => Samples::U16(self.read(count)?),
            NcType::Int => Samples::I32(self.read(count)?),
            NcType::UInt => Samples::U32(self.read(count)?),
            NcType::Int64 => Samples::I64(self.read(count)?),
            NcType::UInt64 => Samples::U64(self.read(count)?),
            NcType::Float => Samples::F32(self.read(count)?),
            NcType::Double => Samples::F64(self.read(count)?),
            _ => refuse!(self.path, "{} has no numbers: expected integers or floats", self.name),
        })
    }

    fn read<T: Number + NcReadable>(&self, count: u64) -> Result<Vec<T>> {
        let mut samples: Vec<T> = reserved(count, || samples_in(self.path))?;
        let mut selections = self.selections.clone();
        let (slowest, size) = match self.slowest.and_then(|axis| Some((axis, self.selections.get(axis)?))) {
            Some((axis, NcSliceInfoElem::Slice { end, .. })) => (axis, *end),
            _ => refuse!(self.path, "{} has no axes", self.name),
        };
        let thick = (SLAB * size / (count * size_of::<T>() as u64).max(1)).clamp(1, size);
        for start in (0..size).step_by(thick as usize) {
            selections[slowest] = NcSliceInfoElem::Slice { start, end: size.min(start + thick), step: 1 };
            let slab = NcSliceInfo { selections: selections.clone() };
            let read = match self.kind {
                NcType::Enum { .. } => {
                    let read = self.file.read_variable_slice::<OfEnum<T>>(self.name, &slab);
                    read.map(|slab| slab.mapv_into_any(|OfEnum(number)| number))
                }
                _ => self.file.read_variable_slice::<T>(self.name, &slab),
            };
            let read = read.map_err(|error| self.path.error(format!("{} {}", self.name, words(error))))?;
            match read.as_slice() {
                Some(slab) => samples.extend_from_slice(slab),
                None => samples.extend(read.iter().copied()),
            }
        }
        let found = samples.len() as u64;
        refuse_if!(found != count, self.path, "is cut short: {count} samples expected, {found} are there");
        Ok(samples)
    }
}

/// A number of an enumeration: h5py stores booleans this way.
#[derive(Clone, Default)]
struct OfEnum<T>(T);

impl<T: NcReadable> NcReadType for OfEnum<T> {
    fn nc_type() -> NcType {
        T::nc_type()
    }

    fn from_be_bytes(bytes: &[u8]) -> netcdf_reader::Result<Self> {
        T::from_be_bytes(bytes).map(Self)
    }

    fn element_size() -> usize {
        <T as NcReadType>::element_size()
    }
}

impl<T: NcReadable> H5Type for OfEnum<T> {
    fn hdf5_type() -> Datatype {
        T::hdf5_type()
    }

    fn from_bytes(bytes: &[u8], kind: &Datatype) -> hdf5_reader::error::Result<Self> {
        T::from_bytes(bytes, base(kind)).map(Self)
    }

    fn element_size(kind: &Datatype) -> usize {
        <T as H5Type>::element_size(base(kind))
    }
}

/// Returns the type of the numbers of an enumeration; any other type is returned as it is.
fn base(kind: &Datatype) -> &Datatype {
    match kind {
        Datatype::Enum { base, .. } => base,
        kind => kind,
    }
}

/// The filters that HDF5 lists beside its own (<https://github.com/HDFGroup/hdf5_plugins>).
const FILTERS: [(&str, &str); 7] = [
    ("filter id 307", "bzip2"),
    ("filter id 32000", "LZF"),
    ("filter id 32001", "Blosc"),
    ("filter id 32004", "LZ4"),
    ("filter id 32008", "Bitshuffle"),
    ("filter id 32013", "ZFP"),
    ("filter id 32015", "Zstandard"),
];

/// Returns an error of the crates in words that follow the name of a file or a data set.
pub(super) fn words(error: impl Into<netcdf_reader::Error>) -> String {
    let error = error.into();
    let netcdf_reader::Error::Hdf5(cause) = &error else {
        return format!("is damaged, or of a kind that is not read: {error}");
    };
    let mut cause: &hdf5_reader::error::Error = cause;
    while let hdf5_reader::error::Error::Context { source, .. } = cause {
        cause = source;
    }
    match cause {
        hdf5_reader::error::Error::UnsupportedFilter(filter) => {
            let known = FILTERS.iter().find(|(id, _)| *id == filter).map_or(filter.as_str(), |(_, name)| name);
            format!("is compressed by {known}, which is not read: repack it by h5repack -f GZIP=4 FILE NEW")
        }
        hdf5_reader::error::Error::UnsupportedLayoutClass(3) => {
            let way_out = "give the file that has the samples, or copy the data set to a file of its own";
            format!("holds a virtual data set, a view of samples elsewhere, which is not read: {way_out}")
        }
        _ => format!("is damaged, or of a kind that is not read: {error}"),
    }
}
