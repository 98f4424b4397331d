//! Volumes: arrays of NumPy, and files.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use numpy::ndarray::{ArrayView3, Axis, Slice};
use numpy::{Element, PyArrayDyn, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use rayon::prelude::*;
use voxsplat::error::{Error, Result};
use voxsplat::formats::{self, FetchOptions, LoadOptions, MissingSlices, PyramidLevel, is_url};
use voxsplat::glam::{DAffine3, DMat3, DVec3};
use voxsplat::layers::on_lattice;
use voxsplat::program::{ChannelChoice, Loaded, ValueMeaning, Values, load_channels};
use voxsplat::transfer::presets::PresetValues;
use voxsplat::volume::{Contents, Grid, Origin, Sample, Statistics, Units};
use voxsplat_volume::memory::zeroed;

use crate::error::{from_json, raised};
use crate::worker::check_process;

/// A volume: samples of an array on a lattice, or a file that is read when it is drawn.
#[pyclass(frozen, module = "voxsplat")]
pub(crate) struct Volume {
    source: Source,
}

/// The samples of a volume.
#[derive(Debug, Clone)]
#[expect(clippy::large_enum_variant, reason = "there is one for each volume")]
pub(crate) enum Source {
    Memory(voxsplat::Volume),
    File { path: PathBuf, options: LoadOptions, level: Option<u32> },
}

/// Facts that an array does not state.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct Facts {
    /// The world point of lattice point (0, 0, 0), and the steps along x, y and z, as columns of 3 x 4 numbers.
    affine: [[f64; 4]; 3],
    oriented: bool,
    slope: f64,
    intercept: f64,
    length_unit: Option<String>,
    value_unit: Option<String>,
    modality: Option<String>,
    description: Option<String>,
    replace_nan: Option<f64>,
}

/// Facts that a file does not state.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct FileFacts {
    dims: Option<[u32; 3]>,
    dtype: Option<String>,
    endian: Option<String>,
    offset: u64,
    axis_order: Option<String>,
    spacing: Option<[f64; 3]>,
    replace_nan: Option<f64>,
    time: Option<u32>,
    channel: Option<u32>,
    series: Option<u32>,
    missing_slices: String,
    complex: Option<String>,
    pyramid: Option<u32>,
    fetch_limit: Option<u64>,
}

#[pymethods]
impl Volume {
    /// Copies an array of three axes (z, y, x), aligned and of the machine's byte order, once.
    #[staticmethod]
    fn of_array(py: Python<'_>, array: &Bound<'_, PyUntypedArray>, facts: Facts) -> PyResult<Self> {
        check_process()?;
        let volume = with_facts(copied(py, array)?, &facts).map_err(|fault| raised(&fault))?;
        Ok(Self { source: Source::Memory(volume) })
    }

    /// Makes a volume of a file, a folder of slices or a built-in volume, which is read when it is drawn.
    #[staticmethod]
    fn of_file(path: PathBuf, facts: FileFacts) -> PyResult<Self> {
        let parsed = || {
            let level = facts.pyramid;
            let options = LoadOptions {
                dims: facts.dims,
                sample_type: facts.dtype.as_deref().map(str::parse).transpose()?,
                spacing: facts.spacing,
                endian: facts.endian.as_deref().map(str::parse).transpose()?,
                offset: facts.offset,
                axis_order: facts.axis_order.as_deref().map(str::parse).transpose()?,
                replace_nan: facts.replace_nan,
                time: facts.time,
                channel: facts.channel,
                series: facts.series,
                missing_slices: facts.missing_slices.parse::<MissingSlices>()?,
                complex: facts.complex.as_deref().map(str::parse).transpose()?,
                level: level.map_or(LoadOptions::default().level, PyramidLevel::At),
                fetch: FetchOptions {
                    limit: facts.fetch_limit.unwrap_or(FetchOptions::default().limit),
                    ..FetchOptions::default()
                },
                ..LoadOptions::default()
            };
            Ok::<_, voxsplat::error::InputError>(Source::File { path, options, level })
        };
        Ok(Self { source: parsed().map_err(|fault| raised(&fault.into()))? })
    }

    /// Describes the volume: JSON of its lattice, its values and the transfer function that suits them.
    fn info(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        check_process()?;
        let source = self.source.clone();
        let described = py.detach(move || source.describe()).map_err(|fault| raised(&fault))?;
        from_json(py, &described.to_string())
    }
}

impl Volume {
    pub(crate) fn source(&self) -> Source {
        self.source.clone()
    }
}

impl Source {
    /// Returns the path of a file or the name of a built-in volume; empty for an array.
    pub(crate) fn path(&self) -> PathBuf {
        match self {
            Self::Memory(_) => PathBuf::new(),
            Self::File { path, .. } => path.clone(),
        }
    }

    /// Returns the contents that are drawn by `values`. Of a pyramid the level is read that suits the picture.
    pub(crate) fn load(&self, values: Values, suited: PyramidLevel) -> Result<Loaded> {
        match self {
            Self::Memory(volume) => {
                volume.gaps()?;
                Ok(volume.clone().into())
            }
            Self::File { path, options, level } => {
                let options = LoadOptions { level: level.map_or(suited, PyramidLevel::At), ..*options };
                let requested = options.channel.map(|number| ChannelChoice { number, color: None });
                load_channels(path, &options, requested.as_slice(), values)
            }
        }
    }

    /// Returns the finite samples of an array, or of a file.
    pub(crate) fn samples(&self) -> Result<voxsplat::Volume> {
        let volume = self.read()?;
        volume.check_finite()?;
        Ok(volume)
    }

    /// Returns the samples of an array, or of a file.
    pub(crate) fn read(&self) -> Result<voxsplat::Volume> {
        match self {
            Self::Memory(volume) => Ok(volume.clone()),
            Self::File { path, options, .. } => Ok(formats::load(path, options)?),
        }
    }

    /// Returns the labels of an array or a file on the lattice of a volume, for a setting `option`.
    pub(crate) fn on_lattice(&self, volume: &voxsplat::Volume, option: &'static str) -> Result<voxsplat::Volume> {
        let placed = on_lattice(&self.samples()?, volume).map_err(|error| match error {
            Error::Setting { reason, .. } => Error::Setting { name: option, reason },
            other => other,
        });
        Ok(placed?.0)
    }

    fn describe(&self) -> Result<serde_json::Value> {
        let volume = match self {
            // A level of a pyramid that is fetched quickly.
            Self::File { path, options, level: None } if is_url(path) => {
                formats::load(path, &LoadOptions { level: PyramidLevel::Pixels(256.0), ..*options })?
            }
            _ => self.read()?,
        };
        let statistics = Statistics::of(&volume)?;
        let source = match self {
            Self::Memory(_) => Path::new(""),
            Self::File { path, .. } => path.as_path(),
        };
        let meaning = ValueMeaning::find(source, &volume, true, PresetValues::Auto, || Ok(statistics.clone()));
        let (transfer, reason, is_guess) = match meaning.map(ValueMeaning::look) {
            Ok(look) => look,
            // No preset fits values that are all the same.
            Err(Error::Transfer(reason)) => (None, reason, false),
            Err(fault) => return Err(fault),
        };
        let grid = volume.grid();
        let ([nx, ny, nz], [dx, dy, dz], Contents { channels, times, levels, .. }) =
            (grid.dims(), grid.spacing(), volume.contents());
        let [x, y, z, origin] = [0, 1, 2, 3].map(|column| match column {
            3 => grid.to_world().translation.to_array(),
            column => grid.to_world().matrix3.col(column).to_array(),
        });
        let row = |axis: usize| [x[axis], y[axis], z[axis], origin[axis]];
        Ok(serde_json::json!({
            "shape": [nz, ny, nx],
            "spacing": [dz, dy, dx],
            "affine": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
            "sample_type": volume.sample_type(),
            "oriented": volume.is_oriented(),
            "length_unit": volume.length_unit(),
            "value_unit": volume.value_unit(),
            "channels": channels,
            "times": times,
            "levels": levels,
            "min": statistics.min,
            "max": statistics.max,
            "mean": statistics.mean,
            "std": statistics.std_dev,
            "transfer": transfer,
            "reason": reason,
            "is_guess": is_guess,
        }))
    }
}

/// Returns the files besides `path` from which a volume is read, such as data files that its header names.
#[pyfunction]
pub(crate) fn data_files(py: Python<'_>, path: PathBuf) -> Vec<OsString> {
    py.detach(|| formats::data_files(&path)).into_iter().map(PathBuf::into_os_string).collect()
}

/// Returns the name of the format of a file or a folder that may be a volume, without reading samples.
#[pyfunction]
pub(crate) fn format_of(py: Python<'_>, path: PathBuf) -> Option<&'static str> {
    py.detach(|| formats::format_of(&path))
}

/// Returns the map of three rows of four numbers.
pub(crate) fn affine(rows: &[[f64; 4]; 3]) -> DAffine3 {
    let [x, y, z, origin] = [0, 1, 2, 3].map(|column| DVec3::from_array(rows.map(|row| row[column])));
    DAffine3::from_mat3_translation(DMat3::from_cols(x, y, z), origin)
}

/// Adds the facts that an array does not state to its volume.
fn with_facts(volume: voxsplat::Volume, facts: &Facts) -> Result<voxsplat::Volume> {
    let to_world = affine(&facts.affine);
    let units = Units { length: facts.length_unit.clone(), value: facts.value_unit.clone() };
    let (modality, description) = (facts.modality.clone(), facts.description.clone());
    let origin = Origin { modality, description, intent: None };
    let grid = Grid::new(volume.grid().dims(), to_world)?;
    let mut volume = volume.with_grid(grid)?.with_rescale(facts.slope, facts.intercept)?.with_units(units);
    volume = volume.with_contents(Contents { origin, ..Contents::default() });
    if facts.oriented {
        volume = volume.with_orientation_known();
    }
    match facts.replace_nan {
        Some(value) => Ok(volume.with_non_finite_replaced(value)?),
        None => Ok(volume),
    }
}

/// Copies an array of any supported type.
fn copied(py: Python<'_>, array: &Bound<'_, PyUntypedArray>) -> PyResult<voxsplat::Volume> {
    macro_rules! try_types {
        ($($type:ty)+) => {
            $(if let Ok(array) = array.cast::<PyArrayDyn<$type>>() {
                return copied_as(py, array);
            })+
        };
    }
    try_types!(u8 i8 u16 i16 u32 i32 u64 i64 f32 f64);
    let name = array.dtype().to_string();
    Err(PyTypeError::new_err(format!("an array of {name} cannot be drawn, expected integers or real numbers")))
}

/// Copies an array of three axes (z, y, x).
fn copied_as<T: Sample + Element>(py: Python<'_>, array: &Bound<'_, PyArrayDyn<T>>) -> PyResult<voxsplat::Volume> {
    let readable = array.try_readonly().map_err(|fault| PyValueError::new_err(fault.to_string()))?;
    let view: ArrayView3<'_, T> = readable.as_array().into_dimensionality().map_err(|_| {
        PyValueError::new_err(format!("an array of shape {:?}, expected three axes (z, y, x)", array.shape()))
    })?;
    let (nz, ny, nx) = view.dim();
    let copy = || {
        let dims = [nx, ny, nz].map(|n| u32::try_from(n).unwrap_or(u32::MAX));
        let grid = Grid::axis_parallel(dims, [1.0; 3])?;
        let mut samples = zeroed::<T>(grid.len(), || "the samples of a volume".to_owned())?;
        fill(&mut samples, &view);
        Ok(voxsplat::Volume::new(grid, T::collected(samples))?)
    };
    py.detach(copy).map_err(|fault: Error| raised(&fault))
}

/// The number of voxels along the edge of a block that is copied at a time: its lines fit into the caches in any order
/// of axes.
const BLOCK: usize = 32;

/// Copies an array, x fastest.
fn fill<T: Sample>(samples: &mut [T], view: &ArrayView3<'_, T>) {
    let (_, ny, nx) = view.dim();
    let is_by_rows = view.strides()[2] == 1;
    samples.par_chunks_mut(BLOCK * ny * nx).enumerate().for_each(|(index, slab)| {
        let planes = slab.len() / (ny * nx);
        let from = view.slice_axis(Axis(0), Slice::from(index * BLOCK..index * BLOCK + planes));
        if let Some(from) = from.as_slice() {
            slab.copy_from_slice(from);
            return;
        }
        let wide = if is_by_rows { nx } else { BLOCK };
        for (y0, x0) in (0..ny).step_by(BLOCK).flat_map(|y| (0..nx).step_by(wide).map(move |x| (y, x))) {
            for (z, plane) in from.outer_iter().enumerate() {
                for y in y0..ny.min(y0 + BLOCK) {
                    let row = &mut slab[(z * ny + y) * nx..][..nx];
                    let line = plane.row(y);
                    for x in x0..nx.min(x0 + wide) {
                        row[x] = line[x];
                    }
                }
            }
        }
    });
}
