//! Scans: a lattice of scalar samples, where it lies in the world, and what its numbers mean.

mod decode;
mod grid;
mod input;
mod load;
mod metaimage;
mod multifile;
mod nifti;
mod npy;
mod nrrd;
mod phantom;
mod placement;
mod sample_type;
mod statistics;

pub use grid::{Grid, MAX_DIM};
pub use load::{LoadOptions, load};
pub use phantom::{Demo, demo_transfer, demos};
pub use sample_type::{Endian, SampleType};
pub use statistics::{BackgroundEstimate, Statistics};

use std::sync::Arc;

use rayon::prelude::*;

use crate::error::{Error, Result};

/// The samples of a volume at the width of their file, x fastest, then y, then z.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "each variant is named for the type of its samples")]
pub enum Samples {
    U8(Vec<u8>),
    I8(Vec<i8>),
    U16(Vec<u16>),
    I16(Vec<i16>),
    U32(Vec<u32>),
    I32(Vec<i32>),
    U64(Vec<u64>),
    I64(Vec<i64>),
    F32(Vec<f32>),
    F64(Vec<f64>),
}

/// Runs one expression over the samples whatever their type: `$s` is the `Vec`.
macro_rules! with_samples {
    ($samples:expr, $s:ident => $body:expr) => {
        match $samples {
            $crate::volume::Samples::U8($s) => $body,
            $crate::volume::Samples::I8($s) => $body,
            $crate::volume::Samples::U16($s) => $body,
            $crate::volume::Samples::I16($s) => $body,
            $crate::volume::Samples::U32($s) => $body,
            $crate::volume::Samples::I32($s) => $body,
            $crate::volume::Samples::U64($s) => $body,
            $crate::volume::Samples::I64($s) => $body,
            $crate::volume::Samples::F32($s) => $body,
            $crate::volume::Samples::F64($s) => $body,
        }
    };
}
pub(crate) use with_samples;

impl Samples {
    /// The number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        with_samples!(self, s => s.len())
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The type's name as the command line spells it: u8, i8, ... f64.
    #[must_use]
    pub fn type_name(&self) -> &'static str {
        match self {
            Self::U8(_) => "u8",
            Self::I8(_) => "i8",
            Self::U16(_) => "u16",
            Self::I16(_) => "i16",
            Self::U32(_) => "u32",
            Self::I32(_) => "i32",
            Self::U64(_) => "u64",
            Self::I64(_) => "i64",
            Self::F32(_) => "f32",
            Self::F64(_) => "f64",
        }
    }

    /// Sample `index` as stored, in f64 (64-bit integers beyond 2^53 are rounded). Panics past the end.
    #[must_use]
    pub fn raw(&self, index: usize) -> f64 {
        with_samples!(self, s => s[index].to_f64())
    }
}

/// Conversion to f64 of every sample type; `as` for 64-bit integers, exact otherwise.
pub(crate) trait ToF64: Copy + Send + Sync {
    fn to_f64(self) -> f64;
}

macro_rules! to_f64 {
    ($($t:ty),*) => { $(impl ToF64 for $t {
        fn to_f64(self) -> f64 { self as f64 }
    })* };
}
to_f64!(u8, i8, u16, i16, u32, i32, u64, i64, f32, f64);

/// A scan: samples on a grid, with the linear map from stored numbers to values.
#[derive(Debug, Clone, PartialEq)]
pub struct Volume {
    grid: Grid,
    /// Shared: a clone costs nothing.
    samples: Arc<Samples>,
    slope: f64,
    intercept: f64,
    oriented: bool,
}

impl Volume {
    /// A volume of `samples` on `grid`, whose values are the samples themselves.
    ///
    /// # Errors
    /// [`Error::Volume`] where the number of samples is not that of the grid.
    pub fn new(grid: Grid, samples: Samples) -> Result<Self> {
        if samples.len() as u64 != grid.len() {
            let [x, y, z] = grid.dims();
            return Err(Error::Volume(format!(
                "{} samples for a lattice of {x} x {y} x {z} = {}",
                samples.len(),
                grid.len()
            )));
        }
        Ok(Self { grid, samples: Arc::new(samples), slope: 1.0, intercept: 0.0, oriented: false })
    }

    /// The same samples read as `slope * sample + intercept` (NIfTI's scl_slope and scl_inter, DICOM's rescale).
    ///
    /// # Errors
    /// [`Error::Volume`] where either is not finite or the slope is 0.
    pub fn with_rescale(mut self, slope: f64, intercept: f64) -> Result<Self> {
        if !slope.is_finite() || slope == 0.0 || !intercept.is_finite() {
            return Err(Error::Volume(format!("slope {slope} and intercept {intercept} do not rescale")));
        }
        (self.slope, self.intercept) = (slope, intercept);
        Ok(self)
    }

    /// The same volume, its world declared to be patient space (see [`Grid`]).
    #[must_use]
    pub fn with_orientation_known(mut self) -> Self {
        self.oriented = true;
        self
    }

    /// The same volume on another grid of the same dimensions.
    ///
    /// # Errors
    /// [`Error::Volume`] where the dimensions differ.
    pub fn with_grid(mut self, grid: Grid) -> Result<Self> {
        if grid.dims() != self.grid.dims() {
            return Err(Error::Volume(format!(
                "a grid of {:?} cannot replace one of {:?}",
                grid.dims(),
                self.grid.dims()
            )));
        }
        self.grid = grid;
        Ok(self)
    }

    /// The lattice and its place in the world.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The samples as stored.
    #[must_use]
    pub fn samples(&self) -> &Samples {
        &self.samples
    }

    /// (slope, intercept): value = slope * sample + intercept.
    #[must_use]
    pub fn rescale(&self) -> (f64, f64) {
        (self.slope, self.intercept)
    }

    /// Whether the file stated where its axes point in patient space.
    #[must_use]
    pub fn is_oriented(&self) -> bool {
        self.oriented
    }

    /// The value of sample `index` (x fastest), in f64. Panics past the end.
    #[must_use]
    pub fn value(&self, index: usize) -> f64 {
        self.slope * self.samples.raw(index) + self.intercept
    }

    /// Refuses NaN and infinite samples: a kernel sum over one would spoil every pixel that it touches.
    ///
    /// # Errors
    /// [`Error::Volume`] with the number of such samples and the place of the first.
    pub fn check_finite(&self) -> Result<()> {
        fn bad<T: ToF64>(s: &[T]) -> (usize, Option<usize>) {
            let first = s.par_iter().position_first(|v| !v.to_f64().is_finite());
            match first {
                None => (0, None),
                Some(_) => (s.par_iter().filter(|v| !v.to_f64().is_finite()).count(), first),
            }
        }
        let (count, first) = match self.samples.as_ref() {
            Samples::F32(s) => bad(s),
            Samples::F64(s) => bad(s),
            _ => (0, None),
        };
        match first {
            None => Ok(()),
            Some(index) => {
                let [nx, ny, _] = self.grid.dims().map(|d| d as usize);
                Err(Error::Volume(format!(
                    "{count} samples are NaN or infinite, the first at ({}, {}, {}): replace them with --replace-nan VALUE",
                    index % nx,
                    index / nx % ny,
                    index / (nx * ny)
                )))
            }
        }
    }

    /// Puts `value` in the place of every NaN or infinite value.
    pub fn replace_non_finite(&mut self, value: f64) {
        let raw = (value - self.intercept) / self.slope;
        match Arc::make_mut(&mut self.samples) {
            Samples::F32(s) => s.par_iter_mut().filter(|v| !v.is_finite()).for_each(|v| *v = raw as f32),
            Samples::F64(s) => s.par_iter_mut().filter(|v| !v.is_finite()).for_each(|v| *v = raw),
            _ => {}
        }
    }
}
