//! Pictures.

use std::path::PathBuf;

use numpy::ndarray::Array3;
use numpy::{IntoPyArray, PyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyBytes;
use voxsplat::Rendered;
use voxsplat::figure::ContactSheet;
use voxsplat::image::{Background, Note};
use voxsplat::program;
use voxsplat::settings::Settings;

use crate::error::{from_json, internal, raised};

/// A picture with its statistics.
#[pyclass(frozen, module = "voxsplat")]
pub(crate) struct Image {
    image: voxsplat::Image,
    stats: String,
    background: Background,
    notes: Vec<Note>,
    #[pyo3(get)]
    choices: Vec<String>,
    /// The pixels as an array, once they have been requested.
    array: PyOnceLock<Py<PyArray3<f32>>>,
}

impl Image {
    pub(crate) fn new(
        Rendered { image, stats }: Rendered,
        settings: &Settings,
        background: Background,
        choices: Vec<String>,
    ) -> PyResult<Self> {
        let stats = serde_json::to_string(&stats).map_err(|fault| internal(&fault.to_string()))?;
        Ok(Self { image, stats, background, notes: program::notes(settings), choices, array: PyOnceLock::new() })
    }

    /// Makes the merged picture of bricks, without statistics.
    pub(crate) fn merged(
        image: voxsplat::Image,
        notes: Vec<Note>,
        background: Background,
        choices: Vec<String>,
    ) -> Self {
        Self { image, stats: "{}".to_owned(), background, notes, choices, array: PyOnceLock::new() }
    }

    fn behind(&self, background: Option<&str>) -> PyResult<Background> {
        background.map_or(Ok(self.background), str::parse).map_err(|fault| raised(&fault))
    }
}

#[pymethods]
impl Image {
    /// Makes a contact sheet of pictures of one size, each with its name.
    #[staticmethod]
    fn sheet(pictures: Vec<(PyRef<'_, Self>, String)>) -> PyResult<Self> {
        let Some((first, _)) = pictures.first() else {
            return Err(PyValueError::new_err("a sheet needs pictures"));
        };
        let drawn = || {
            let mut sheet = ContactSheet::new(pictures.len(), first.size().into())?;
            pictures.iter().try_for_each(|(picture, name)| sheet.add(&picture.image, name))?;
            sheet.finish(first.background)
        };
        let sheet = drawn().map_err(|fault| raised(&fault))?;
        Ok(Self::merged(sheet, Vec::new(), first.background, Vec::new()))
    }

    /// Returns width and height, pixels.
    #[getter]
    fn size(&self) -> (u32, u32) {
        (self.image.width(), self.image.height())
    }

    /// Returns the pixels, f32, height x width x 4, read-only.
    #[getter]
    fn array<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let make = || {
            let (width, height) = self.size();
            let values = py.detach(|| self.image.pixels().as_flattened().to_vec());
            let shape = (height as usize, width as usize, 4);
            let array = Array3::from_shape_vec(shape, values).map_err(|fault| internal(&fault.to_string()))?;
            let array = array.into_pyarray(py);
            array.call_method1("setflags", (false,))?;
            Ok::<_, PyErr>(array.unbind())
        };
        Ok(self.array.get_or_try_init(py, make)?.bind(py).clone())
    }

    /// Returns the picture as 8-bit RGBA, height x width x 4.
    fn rgba8<'py>(&self, py: Python<'py>, background: Option<&str>) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let background = self.behind(background)?;
        let (width, height) = self.size();
        let bytes = py.detach(|| self.image.to_rgba8(background));
        let array = Array3::from_shape_vec((height as usize, width as usize, 4), bytes);
        Ok(array.map_err(|fault| internal(&fault.to_string()))?.into_pyarray(py))
    }

    /// Returns the statistics as a dictionary.
    #[getter]
    fn stats(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        from_json(py, &self.stats)
    }

    /// Returns the bytes of a PNG file.
    fn to_png<'py>(&self, py: Python<'py>, background: Option<&str>) -> PyResult<Bound<'py, PyBytes>> {
        let background = self.behind(background)?;
        let png = py.detach(|| self.image.to_png_with_notes(background, &self.notes));
        Ok(PyBytes::new(py, &png.map_err(|fault| raised(&fault))?))
    }

    /// Writes a .png or an .exr.
    fn save(&self, py: Python<'_>, path: PathBuf, background: Option<&str>) -> PyResult<()> {
        let background = self.behind(background)?;
        let save = || self.image.save_with_notes(path, background, &self.notes);
        py.detach(save).map_err(|fault| raised(&fault))
    }
}
