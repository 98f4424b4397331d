//! Plans of pictures in bricks, and partial pictures.

use std::ops::Range;
use std::sync::Arc;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use voxsplat::bricks::{self, Chunks};
use voxsplat::camera::Camera;
use voxsplat::error::Error;
use voxsplat::image::Background;
use voxsplat::layers::Layers;
use voxsplat::program::notes;
use voxsplat::volume::Grid;

use crate::counts::Counts;
use crate::error::raised;
use crate::image::Image;
use crate::request::{Beside, SettingsFields, ViewFields, Whole};
use crate::volume::{self, Volume};
use crate::worker::check_process;

/// A plan of a picture in bricks.
#[pyclass(frozen, module = "voxsplat._native")]
pub(crate) struct Plan {
    pub(crate) plan: Arc<bricks::Plan>,
    #[pyo3(get)]
    choices: Vec<String>,
}

/// A partial picture: the values of consecutive bricks in each pixel.
#[pyclass(frozen, module = "voxsplat._native")]
pub(crate) struct Partial {
    part: bricks::Partial,
}

/// The light that enters a brick.
#[pyclass(frozen, module = "voxsplat._native", name = "IncomingLight")]
pub(crate) struct BrickLight {
    pub(crate) light: bricks::IncomingLight,
}

/// Returns the sizes of `counts` chunks of `dims` voxels, both along x, y and z.
#[pyfunction]
pub(crate) fn even_chunks(dims: [u32; 3], counts: [i64; 3]) -> PyResult<[Vec<u32>; 3]> {
    let counts = counts.map(|count| count.clamp(0, u32::MAX.into()) as u32);
    Ok(Chunks::even(dims, counts).map_err(|fault| raised(&fault))?.sizes())
}

/// The voxels of a brick or of its slice, along z, y and x: the first, and the one after the last.
pub(crate) type Voxels = [(u32, u32); 3];

pub(crate) fn voxels(ranges: &[Range<u32>; 3]) -> Voxels {
    [2, 1, 0].map(|axis| (ranges[axis].start, ranges[axis].end))
}

#[pymethods]
impl Plan {
    /// Plans a picture of a volume of `dims` (x, y, z) voxels with chunks of these sizes along x, y and z. `overview`
    /// is the volume, or has fewer samples in the same place; `affine` has the world point of the first voxel and the
    /// steps of the volume itself, as columns of 3 x 4 numbers, `None` for the overview's. `counts` are of all samples,
    /// `None` for the samples of the overview.
    #[new]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn new(
        py: Python<'_>,
        overview: &Volume,
        settings: SettingsFields,
        view: ViewFields,
        size: [u32; 2],
        dims: [u32; 3],
        affine: Option<[[f64; 4]; 3]>,
        counts: Option<&Counts>,
        chunks: [Vec<u32>; 3],
    ) -> PyResult<Self> {
        check_process()?;
        let view = view.request(size).map_err(|fault| raised(&fault))?;
        let request = settings.request(&view.view).map_err(|fault| raised(&fault))?;
        let has_open_light = request.has_open_light();
        let source = overview.source();
        let counts = counts.map(|counts| counts.counts.clone());
        let planned = py.detach(move || {
            let grid = affine.map(|rows| Grid::new(dims, volume::affine(&rows))).transpose()?;
            let beside = Beside { whole: grid.map(|grid| Whole { grid, counts }), ..Beside::default() };
            let mut look = request.look(&source, &beside, view, size)?;
            let grid = grid.unwrap_or(*look.layers.grid());
            if has_open_light {
                let (settings, choice) = bricks::Plan::settings_for(&look.settings);
                look.choices.extend(choice.map(str::to_owned));
                look.settings = settings;
            }
            let mut view = look.view.view;
            view.around = look.view.frame.hull(&look.layers, &look.settings.clip)?;
            let camera = Camera::new(&view, &grid, size)?;
            let chunks = Chunks::new(dims, chunks)?;
            let plan = bricks::Plan::new(&look.layers, &grid, &chunks, &camera, &look.settings)?;
            if plan.transfer().is_none() {
                let reason = "labels and channels are drawn in bricks by the command alone (voxsplat plan, brick and \
                              merge): give a preset, such as \"grayscale\", to draw them as values";
                return Err(Error::Setting { name: "transfer", reason: reason.to_owned() });
            }
            Ok((plan, look.choices))
        });
        let (plan, choices) = planned.map_err(|fault| raised(&fault))?;
        Ok(Self { plan: Arc::new(plan), choices })
    }

    /// Reads a plan from its JSON.
    #[staticmethod]
    fn from_json(text: &str, choices: Vec<String>) -> PyResult<Self> {
        let plan = bricks::Plan::from_json(text).map_err(|fault| raised(&fault))?;
        Ok(Self { plan: Arc::new(plan), choices })
    }

    fn to_json(&self) -> PyResult<String> {
        self.plan.to_json().map_err(|fault| raised(&fault))
    }

    /// Returns the bricks, front to back: their voxels, the slices that they need, and the bytes that drawing one
    /// takes.
    #[getter]
    fn bricks(&self) -> Vec<(Voxels, Voxels, u64)> {
        self.plan.bricks().iter().map(|brick| (voxels(&brick.voxels), voxels(&brick.held), brick.bytes)).collect()
    }

    /// Returns width and height of the picture, pixels.
    #[getter]
    fn size(&self) -> (u32, u32) {
        self.plan.camera().size.into()
    }

    /// Returns whether bricks need the light that enters them.
    #[getter]
    fn casts_shadows(&self) -> bool {
        self.plan.casts_shadows()
    }

    /// Merges the partial pictures of all bricks into the picture.
    fn merge(&self, py: Python<'_>, parts: Vec<Py<Partial>>, background: &str) -> PyResult<Image> {
        let background: Background = background.parse().map_err(|fault| raised(&fault))?;
        let merged = || bricks::merge(&self.plan, parts.iter().map(|part| &part.get().part));
        let image = py.detach(merged).map_err(|fault| raised(&fault))?;
        Ok(Image::merged(image, notes(self.plan.settings()), background, self.choices.clone()))
    }
}

impl Plan {
    /// Returns the layers of a slice of the volume.
    pub(crate) fn slice(plan: &bricks::Plan, volume: &voxsplat::Volume) -> voxsplat::error::Result<Layers> {
        let missing = || Error::Setting {
            name: "plan",
            reason: "it is of labels or channels, whose bricks the command draws: voxsplat brick".to_owned(),
        };
        Ok(Layers::of_volume(volume, plan.transfer().ok_or_else(missing)?))
    }
}

#[pymethods]
impl BrickLight {
    /// Reads the light from the bytes of its OpenEXR file.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, bytes: &[u8]) -> PyResult<Self> {
        let light = py.detach(|| bricks::IncomingLight::from_exr(bytes)).map_err(|fault| raised(&fault))?;
        Ok(Self { light })
    }

    /// Returns the bytes of the OpenEXR file of this light.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = py.detach(|| self.light.to_exr()).map_err(|fault| PyValueError::new_err(fault.to_string()))?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// Returns the number of the brick.
    #[getter]
    fn brick(&self) -> usize {
        self.light.brick()
    }
}

impl Partial {
    pub(crate) fn new(part: bricks::Partial) -> Self {
        Self { part }
    }
}

#[pymethods]
impl Partial {
    /// Reads a partial picture from the bytes of its OpenEXR file.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, bytes: &[u8]) -> PyResult<Self> {
        let part = py.detach(|| bricks::Partial::from_exr(bytes)).map_err(|fault| raised(&fault))?;
        Ok(Self { part })
    }

    /// Returns the bytes of the OpenEXR file of this partial picture.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = py.detach(|| self.part.to_exr()).map_err(|fault| PyValueError::new_err(fault.to_string()))?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// Returns the first of the composited bricks, and the one after the last.
    #[getter]
    fn bricks(&self) -> (usize, usize) {
        let Range { start, end } = self.part.bricks();
        (start, end)
    }

    /// Composites this partial picture over the one directly behind.
    fn over(&self, py: Python<'_>, back: &Self) -> PyResult<Self> {
        let part = py.detach(|| self.part.over(&back.part)).map_err(|fault| raised(&fault))?;
        Ok(Self { part })
    }
}
