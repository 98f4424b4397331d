//! Volumes: scalar samples on a lattice, its position in the world, and the map from samples to values.

mod bricks;
mod counts;
mod grid;
mod reduce;
mod sample_type;
mod statistics;
mod stored;

pub use bricks::{Brick, EDGE as BRICK_EDGE, RowCoding, Strip};
pub use counts::Counts;
pub use grid::{Grid, MAX_DIM};
pub use sample_type::{Endian, Sample, SampleType};
pub use sample_type::{Number, ToF64, with_type};
pub use statistics::{BackgroundEstimate, Statistics};
pub(crate) use stored::{FileSamples, Stored};

use std::ops::Range;
use std::sync::{Arc, OnceLock};

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

/// Runs one expression over [`Samples`] of any type: `$s` is their `Vec`.
#[macro_export]
macro_rules! with_samples {
    ($samples:expr, $s:ident => $body:expr) => {
        $crate::volume::with_samples!(@ $samples, $s, $body; U8 I8 U16 I16 U32 I32 U64 I64 F32 F64)
    };
    (@ $samples:expr, $s:ident, $body:expr; $($variant:ident)+) => {
        match $samples {
            $($crate::volume::Samples::$variant($s) => $body,)+
        }
    };
}
#[doc(hidden)]
pub use crate::with_samples;

impl Samples {
    /// Returns the number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        with_samples!(self, s => s.len())
    }

    /// Returns whether there are no samples.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// A volume: samples on a grid, and the linear map from samples to values.
///
/// Samples are in memory, or stay in their file and are read as they are needed: see
/// [`LoadOptions::stream_over`](crate::formats::LoadOptions::stream_over). Clones share them.
#[derive(Debug, Clone)]
pub struct Volume {
    grid: Grid,
    data: Arc<Data>,
    slope: f64,
    intercept: f64,
    oriented: bool,
    units: Units,
    contents: Arc<Contents>,
}

/// The units that a file states, as it writes them.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Units {
    /// The unit of world lengths, such as mm.
    pub length: Option<String>,
    /// The unit of values, such as HU.
    pub value: Option<String>,
}

/// The contents of a volume's file: the volume is one of its channels at one point in time.
#[derive(Debug, Clone, PartialEq)]
pub struct Contents {
    /// The channel that the volume is, counted from 0.
    pub channel: u32,
    /// The number of channels.
    pub channels: u32,
    /// The names, colours and windows of the channels, in their order; empty if the file states none.
    pub labels: Vec<Channel>,
    /// The point in time that the volume is of, counted from 0.
    pub time: u32,
    /// The number of points in time.
    pub times: u32,
    /// The level of a pyramid that the volume is; 0 is the finest.
    pub level: u32,
    /// The number of levels.
    pub levels: u32,
    /// The labels of all channels, if the file states that its values are labels; empty if it names none of them.
    pub segments: Option<Vec<Segment>>,
    /// The origin of the values.
    pub origin: Origin,
    /// Facts of the file that the volume cannot express, such as unequally spaced coordinates; each is a sentence
    /// without a full stop.
    pub notes: Vec<String>,
}

impl Default for Contents {
    fn default() -> Self {
        let (labels, notes, origin) = (Vec::new(), Vec::new(), Origin::default());
        Self { channel: 0, channels: 1, labels, time: 0, times: 1, level: 0, levels: 1, segments: None, origin, notes }
    }
}

/// The largest number of characters of a name that a file states.
const LONGEST_NAME: usize = 80;

/// The method that made the values of a file, as the file states it.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[doc(hidden)]
pub struct Origin {
    /// A modality in the terms of DICOM (PS3.3, C.7.3.1.1.1), such as CT, MR, PT, or GM for microscopy.
    pub modality: Option<String>,
    /// The names of the protocol, the sequence or the content.
    pub description: Option<String>,
    /// The meaning of the values, such as "t statistic with 12 degrees of freedom".
    pub intent: Option<String>,
}

impl Origin {
    /// Returns the origin with a modality and descriptions; empty texts state nothing.
    pub(crate) fn of<'a>(modality: Option<&str>, descriptions: impl IntoIterator<Item = &'a str>) -> Self {
        let plain = |text: &str| {
            let plain: String = text.trim().chars().filter(|c| !c.is_control()).take(LONGEST_NAME).collect();
            (!plain.is_empty()).then_some(plain)
        };
        let all: Vec<String> = descriptions.into_iter().filter_map(plain).collect();
        let description = (!all.is_empty()).then(|| all.join("; "));
        Self { modality: modality.and_then(plain), description, intent: None }
    }
}

/// A label that a file describes.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Segment {
    /// The channel that has this label: labels of one channel do not overlap.
    pub channel: u32,
    /// The value of the label.
    pub label: i64,
    /// The name of the labelled structure.
    pub name: Option<String>,
    /// The red, green and blue of the label, sRGB.
    pub color: Option<[u8; 3]>,
}

/// A channel that a file describes.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Channel {
    /// The name of the channel, such as the name of a dye.
    pub name: Option<String>,
    /// The red, green and blue of the channel, sRGB.
    pub color: Option<[u8; 3]>,
    /// The range of values to show.
    pub window: Option<[f64; 2]>,
}

/// The part of a volume that clones share.
#[derive(Debug)]
struct Data {
    stored: Stored,
    /// Whether every sample is finite; empty until it is needed.
    finite: OnceLock<bool>,
    /// The least and the largest stored sample of each brick, x fastest; empty until they are needed.
    ranges: OnceLock<Vec<[f64; 2]>>,
}

impl Data {
    fn new(stored: Stored) -> Self {
        Self { stored, finite: OnceLock::new(), ranges: OnceLock::new() }
    }
}

/// A volume with all its samples in memory.
#[derive(Debug)]
#[doc(hidden)]
pub struct InMemory {
    samples: Arc<Samples>,
    slope: f64,
    intercept: f64,
}

impl InMemory {
    /// Returns the samples as stored.
    #[must_use]
    pub fn samples(&self) -> &Samples {
        &self.samples
    }

    /// Returns the value of sample `index` (x fastest), in f64.
    ///
    /// # Panics
    /// If `index` is not under the number of samples.
    #[must_use]
    pub fn value(&self, index: usize) -> f64 {
        self.slope * self.samples.raw(index) + self.intercept
    }
}

/// Refuses samples that do not fill the lattice.
fn check_count(grid: &Grid, count: usize) -> Result<()> {
    if count as u64 == grid.len() {
        return Ok(());
    }
    let [x, y, z] = grid.dims();
    Err(Error::Volume(format!("{count} samples for a lattice of {x} x {y} x {z} = {}", grid.len())))
}

/// Compares volumes, which are equal if they share the same samples on the same grid, such as clones.
impl PartialEq for Volume {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.data, &other.data) && self.grid == other.grid && self.rescale() == other.rescale()
    }
}

/// The number of samples read at a time by a pass over a whole volume: 4 Mi, at most 32 MiB.
const PASS: usize = 1 << 22;

impl Volume {
    /// Makes a volume of a copy of `samples`, x fastest, then y, then z, on a lattice along the world axes.
    ///
    /// `dims` are the numbers of samples along x, y and z. `spacing` is the world distance between neighbouring samples
    /// along each of them, in any unit of length. The first sample lies at the world's origin; [`Volume::with_grid`]
    /// places the lattice elsewhere. Values are the samples themselves; [`Volume::with_rescale`] maps them.
    ///
    /// ```
    /// use voxsplat_volume::volume::{SampleType, Volume};
    ///
    /// // 4 x 3 x 2 samples of 16 bits, slices twice as far apart as pixels.
    /// let samples: Vec<i16> = (0..24).collect();
    /// let volume = Volume::from_slice([4, 3, 2], [0.5, 0.5, 1.0], &samples)?;
    /// assert_eq!(volume.sample_type(), SampleType::I16);
    /// assert_eq!(volume.grid().spacing(), [0.5, 0.5, 1.0]);
    /// # Ok::<(), voxsplat_volume::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Volume`] if the number of samples is not the product of `dims`, if a dimension is 0 or over
    /// [`MAX_DIM`], or if a spacing is 0 or not finite; [`Error::Memory`] if there is no memory for the copy.
    pub fn from_slice<T: Sample>(dims: [u32; 3], spacing: [f64; 3], samples: &[T]) -> Result<Self> {
        let grid = Grid::axis_parallel(dims, spacing)?;
        check_count(&grid, samples.len())?;
        Self::new(grid, T::collected(stored::copied(samples)?))
    }

    /// Makes a volume of `samples` on `grid`, x fastest, then y, then z. Values are the samples themselves.
    ///
    /// # Errors
    /// [`Error::Volume`] if the grid has another number of samples.
    pub fn new(grid: Grid, samples: Samples) -> Result<Self> {
        Self::of(grid, samples.into())
    }

    pub(crate) fn of(grid: Grid, stored: Stored) -> Result<Self> {
        check_count(&grid, stored.len())?;
        let (data, units, contents) = (Arc::new(Data::new(stored)), Units::default(), Arc::default());
        Ok(Self { grid, data, slope: 1.0, intercept: 0.0, oriented: false, units, contents })
    }

    /// Returns the volume with its samples read as `slope * sample + intercept` (NIfTI's scl_slope and scl_inter,
    /// DICOM's rescale).
    ///
    /// # Errors
    /// [`Error::Volume`] if either number is not finite or the slope is 0.
    pub fn with_rescale(mut self, slope: f64, intercept: f64) -> Result<Self> {
        if !slope.is_finite() || slope == 0.0 || !intercept.is_finite() {
            return Err(Error::Volume(format!("slope {slope} and intercept {intercept} do not rescale")));
        }
        (self.slope, self.intercept) = (slope, intercept);
        Ok(self)
    }

    /// Returns the volume with its world declared to be patient space (see [`Grid`]).
    #[must_use]
    pub fn with_orientation_known(mut self) -> Self {
        self.oriented = true;
        self
    }

    /// Returns the volume with other units.
    #[must_use]
    pub fn with_units(mut self, units: Units) -> Self {
        self.units = units;
        self
    }

    /// Returns the volume with other contents of its file.
    #[must_use]
    pub fn with_contents(mut self, contents: Contents) -> Self {
        self.contents = Arc::new(contents);
        self
    }

    /// Returns the volume on another grid of the same dimensions.
    ///
    /// # Errors
    /// [`Error::Volume`] if the dimensions differ.
    pub fn with_grid(mut self, grid: Grid) -> Result<Self> {
        let (new, old) = (grid.dims(), self.grid.dims());
        if new != old {
            return Err(Error::Volume(format!("a grid of {new:?} cannot replace one of {old:?}")));
        }
        self.grid = grid;
        Ok(self)
    }

    /// Returns the volume with `value` in place of every value that is NaN or infinite.
    ///
    /// # Errors
    /// [`Error::Setting`] if the type of the samples has no finite number for `value`; [`Error::Read`] and
    /// [`Error::Memory`] if samples shared with a clone cannot be copied.
    pub fn with_non_finite_replaced(mut self, value: f64) -> Result<Self> {
        let raw = (value - self.intercept) / self.slope;
        let held = match self.sample_type() {
            SampleType::F32 => (raw as f32).is_finite(),
            SampleType::F64 => raw.is_finite(),
            _ => true,
        };
        if !held {
            let reason = format!("{value:?}, expected a number that samples of type {} hold", self.sample_type());
            return Err(Error::Setting { name: "replace_nan", reason });
        }
        let mut stored = match Arc::try_unwrap(self.data) {
            Ok(data) => data.stored,
            Err(shared) => shared.stored.read(0..shared.stored.len())?.into(),
        };
        stored.replace_non_finite(raw);
        self.data = Arc::new(Data { finite: OnceLock::from(true), ..Data::new(stored) });
        Ok(self)
    }

    /// Returns the lattice and its position in the world.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Returns the type of the samples.
    #[must_use]
    pub fn sample_type(&self) -> SampleType {
        self.data.stored.sample_type()
    }

    /// Returns whether the samples are still in their file.
    #[must_use]
    pub fn is_streamed(&self) -> bool {
        matches!(self.data.stored, Stored::File(_))
    }

    /// Copies the voxels of a box, given by their numbers along x, y and z, on their place in the world. Of samples in
    /// a file only the rows of the box are read.
    ///
    /// # Errors
    /// [`Error::Volume`] if a range is empty or ends beyond the volume; [`Error::Read`] and [`Error::Memory`].
    pub fn part(&self, ranges: [Range<u32>; 3]) -> Result<Self> {
        let [nx, ny, _] = self.grid.dims().map(|d| d as usize);
        if ranges.iter().zip(self.grid.dims()).any(|(range, count)| range.start >= range.end || range.end > count) {
            return Err(Error::Volume(format!("voxels {ranges:?} are no part of {:?}", self.grid.dims())));
        }
        let grid = self.grid.part(&ranges)?;
        let [x, y, z] = ranges.map(|range| range.start as usize..range.end as usize);
        // The rows of a plane are read together, and cropped.
        let rows = |z: usize| self.read(nx * (y.start + ny * z)..nx * (y.end + ny * z));
        let mut samples = rows(z.start)?.cropped(nx, &x, grid.len())?;
        for z in z.skip(1) {
            samples.extend_cropped(&rows(z)?, nx, &x);
        }
        let mut part = Self::new(grid, samples)?;
        (part.slope, part.intercept) = (self.slope, self.intercept);
        (part.oriented, part.units, part.contents) = (self.oriented, self.units.clone(), Arc::clone(&self.contents));
        Ok(part)
    }

    /// Copies a range of the samples, x fastest, as stored.
    pub fn read(&self, range: Range<usize>) -> Result<Samples> {
        self.data.stored.read(range)
    }

    /// Returns the samples, x fastest, if they are in memory; `None` if they are still in their file.
    #[must_use]
    pub fn held(&self) -> Option<&Samples> {
        match &self.data.stored {
            Stored::Memory(samples) => Some(samples),
            Stored::File(_) => None,
        }
    }

    /// Returns the volume with all samples in memory. Samples in a file are read, at every call.
    ///
    /// # Errors
    /// [`Error::Read`] and [`Error::Memory`] if samples in a file cannot be read.
    pub fn in_memory(&self) -> Result<InMemory> {
        Ok(InMemory { samples: self.shared_samples()?, slope: self.slope, intercept: self.intercept })
    }

    /// Returns all samples as stored, shared if they are in memory, or read.
    pub fn shared_samples(&self) -> Result<Arc<Samples>> {
        match &self.data.stored {
            Stored::Memory(samples) => Ok(Arc::clone(samples)),
            Stored::File(file) => Ok(Arc::new(self.read(0..file.count)?)),
        }
    }

    /// Reads the samples into memory, unless they have more than `bytes` bytes, and returns the volume.
    pub(crate) fn loaded(mut self, bytes: u64) -> Result<Self> {
        if self.grid.len().saturating_mul(self.sample_type().size() as u64) <= bytes
            && let Stored::File(_) = &self.data.stored
        {
            let samples = self.read(0..self.data.stored.len())?;
            self.data = Arc::new(Data::new(samples.into()));
        }
        Ok(self)
    }

    /// Returns the ranges of the bricks, x fastest; `None` before the first pass over the samples.
    fn known_ranges(&self) -> Option<&[[f64; 2]]> {
        self.data.ranges.get().map(Vec::as_slice)
    }

    fn keep_ranges(&self, ranges: Vec<[f64; 2]>) {
        self.data.ranges.get_or_init(|| ranges);
    }

    /// Returns the slope and the intercept of values: value = slope * sample + intercept.
    #[must_use]
    pub fn rescale(&self) -> (f64, f64) {
        (self.slope, self.intercept)
    }

    /// Returns whether the file stated the directions of its axes in patient space.
    #[must_use]
    pub fn is_oriented(&self) -> bool {
        self.oriented
    }

    /// Returns the units that the file states.
    #[must_use]
    pub fn units(&self) -> &Units {
        &self.units
    }

    /// Returns the contents of the volume's file.
    #[must_use]
    pub fn contents(&self) -> &Contents {
        &self.contents
    }

    /// Returns the unit of world lengths: the stated unit, or millimetres in patient space, the unit of DICOM.
    #[must_use]
    pub fn length_unit(&self) -> Option<&str> {
        self.units.length.as_deref().or(self.oriented.then_some("mm"))
    }

    /// Returns the unit of values, if it is stated.
    #[must_use]
    pub fn value_unit(&self) -> Option<&str> {
        self.units.value.as_deref()
    }

    /// Returns the number of samples that are NaN or infinite: nothing is drawn of them.
    ///
    /// # Errors
    /// [`Error::NonFinite`] if all samples are; [`Error::Read`] and [`Error::Memory`] for the reasons of
    /// [`Self::check_finite`].
    pub fn gaps(&self) -> Result<u64> {
        match self.check_finite() {
            Err(Error::NonFinite { count, .. }) if count < self.grid.len() => Ok(count),
            checked => checked.map(|()| 0),
        }
    }

    /// Refuses NaN and infinite samples: one such sample would spoil every pixel that its kernel reaches.
    ///
    /// # Errors
    /// [`Error::NonFinite`] if there are such samples; [`Error::Read`] and [`Error::Memory`] if samples left in a file
    /// cannot be read.
    pub fn check_finite(&self) -> Result<()> {
        if !self.sample_type().is_float() || self.data.finite.get() == Some(&true) {
            return Ok(());
        }
        let (mut count, mut first) = (0, None);
        match &self.data.stored {
            Stored::Memory(samples) => (count, first) = samples.non_finite(),
            Stored::File(file) => {
                for start in (0..file.count).step_by(PASS) {
                    let (found, at) = self.read(start..file.count.min(start + PASS))?.non_finite();
                    count += found;
                    first = first.or(at.map(|at| start + at));
                }
            }
        }
        let Some(index) = first else {
            self.data.finite.get_or_init(|| true);
            return Ok(());
        };
        let [nx, ny, _] = self.grid.dims().map(|d| d as usize);
        let first = [index % nx, index / nx % ny, index / (nx * ny)].map(|at| at as u32);
        Err(Error::NonFinite { count: count as u64, first })
    }
}
