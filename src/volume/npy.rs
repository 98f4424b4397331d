//! NumPy .npy: an array of shape (z, y, x), or (y, x) for a single slice.

use std::io::BufReader;
use std::path::Path;

use npyz::{DType, Endianness, NpyHeader, Order, TypeChar};

use super::source::{Endian, Packing, SampleType, Source, malformed, open, sample_count};
use super::{Grid, Samples, Volume};
use crate::error::Result;

/// Whether a file begins like an .npy file.
pub(super) fn looks_like(head: &[u8]) -> bool {
    head.starts_with(b"\x93NUMPY")
}

/// Reads an .npy file; the spacing is 1 and x is the last axis of a C-ordered array.
pub(super) fn read(path: &Path) -> Result<Volume> {
    let mut file = BufReader::new(open(path)?);
    let header = NpyHeader::from_reader(&mut file).map_err(|e| {
        // A syntax error draws the place over several lines; the first says what it is.
        let reason = e.to_string();
        malformed(path, format!("the .npy header is damaged: {}", reason.lines().next().unwrap_or("unreadable")))
    })?;
    let DType::Plain(ty) = header.dtype() else {
        return Err(malformed(path, "a structured array: save one plain number per voxel"));
    };
    let sample_type = match (ty.type_char(), ty.size_field()) {
        (TypeChar::Uint | TypeChar::Bool, 1) => SampleType::U8,
        (TypeChar::Int, 1) => SampleType::I8,
        (TypeChar::Uint, 2) => SampleType::U16,
        (TypeChar::Int, 2) => SampleType::I16,
        (TypeChar::Uint, 4) => SampleType::U32,
        (TypeChar::Int, 4) => SampleType::I32,
        (TypeChar::Uint, 8) => SampleType::U64,
        (TypeChar::Int, 8) => SampleType::I64,
        (TypeChar::Float, 4) => SampleType::F32,
        (TypeChar::Float, 8) => SampleType::F64,
        _ => {
            return Err(malformed(
                path,
                format!("samples of type {ty}: convert them to an integer, float32 or float64"),
            ));
        }
    };
    let dims = match *header.shape() {
        [z, y, x] => [x, y, z],
        [y, x] => [x, y, 1],
        ref shape => return Err(malformed(path, format!("an array of shape {shape:?}, expected (z, y, x)"))),
    };
    let dims: Vec<u32> = dims.iter().filter_map(|&d| u32::try_from(d).ok().filter(|&d| d > 0)).collect();
    let dims = <[u32; 3]>::try_from(dims)
        .map_err(|_| malformed(path, format!("an array of shape {:?} cannot be a volume", header.shape())))?;
    // The header is text padded to a multiple of 64: the samples are the end of the file.
    let source = Source {
        path: path.to_owned(),
        offset: None,
        packing: Packing::Raw,
        skip_unpacked: 0,
        sample_type,
        endian: if ty.endianness() == Endianness::Big { Endian::Big } else { Endian::Little },
    };
    let grid = Grid::axis_parallel(dims, [1.0; 3]).map_err(|e| malformed(path, e.to_string()))?;
    let samples = source.read(sample_count(path, dims)?)?;
    Volume::new(grid, if header.order() == Order::Fortran { transposed(samples, dims) } else { samples })
}

/// Samples with z fastest to samples with x fastest.
fn transposed(samples: Samples, [nx, ny, nz]: [u32; 3]) -> Samples {
    fn turn<T: Copy>(s: &[T], nx: usize, ny: usize, nz: usize) -> Vec<T> {
        (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| s[(x * ny + y) * nz + z]))).collect()
    }
    macro_rules! each {
        ($($variant:ident),*) => {
            match &samples {
                $(Samples::$variant(s) => Samples::$variant(turn(s, nx as usize, ny as usize, nz as usize)),)*
            }
        };
    }
    each!(U8, I8, U16, I16, U32, I32, U64, I64, F32, F64)
}
