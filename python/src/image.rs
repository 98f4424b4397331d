//! Pictures.

use std::path::PathBuf;

use numpy::ndarray::Array3;
use numpy::{IntoPyArray, PyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyBytes;
use voxsplat::figure::{Figure, Shown};
use voxsplat::image::{Background, Note};
use voxsplat::program::{self, FittedTransfer};
use voxsplat::settings::{Model, Settings};
use voxsplat::{Camera, Rendered, View};

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

    /// Draws a title on a copy of a picture, over its background.
    fn titled(&self, title: &str) -> voxsplat::Result<voxsplat::Image> {
        // A title is in the same place for every volume.
        let volume = voxsplat::Volume::from_slice([1; 3], [1.0; 3], &[0_u8])?;
        let transfer = FittedTransfer::clear()?.transfer;
        let camera = Camera::new(&View::default(), volume.grid(), [self.image.width(), self.image.height()])?;
        let shown =
            Shown { volume: &volume, transfer: &transfer, values: None, camera: &camera, model: Model::Composite };
        let figure = Figure { title: Some(title.to_owned()), ..Figure::default() };
        figure.draw(&self.image, self.background, &shown)
    }

    fn behind(&self, background: Option<&str>) -> PyResult<Background> {
        background.map_or(Ok(self.background), str::parse).map_err(|fault| raised(&fault))
    }
}

#[pymethods]
impl Image {
    /// Makes one picture of pictures of one size, in rows of `columns`, each with a title of its own.
    #[staticmethod]
    fn sheet(pictures: Vec<(PyRef<'_, Self>, String)>, columns: u32) -> PyResult<Self> {
        let same_size =
            |(first, _): &&(PyRef<'_, Self>, String)| pictures.iter().all(|(p, _)| p.size() == first.size());
        let Some((first, _)) = pictures.first().filter(same_size) else {
            return Err(PyValueError::new_err("a sheet needs pictures of one size"));
        };
        let ((width, height), columns) = (first.size(), columns.max(1));
        let rows = (pictures.len() as u32).div_ceil(columns);
        let drawn = || {
            let mut sheet = voxsplat::Image::transparent(width * columns, height * rows)?;
            for ((picture, title), number) in pictures.iter().zip(0..) {
                let titled = picture.titled(title)?;
                let left = (number % columns * width) as usize;
                let top = (number / columns * height) as usize;
                for (line, row) in titled.pixels().chunks_exact(width as usize).zip(top..) {
                    let start = row * (width * columns) as usize + left;
                    sheet.pixels_mut()[start..start + line.len()].copy_from_slice(line);
                }
            }
            Ok(sheet)
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
