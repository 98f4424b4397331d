//! Counts of the samples of a volume that is read in parts.

use pyo3::prelude::*;
use pyo3::types::PyType;
use voxsplat::volume;

use crate::error::{internal, raised};
use crate::request::SettingsFields;
use crate::volume::Volume;

/// Counts of samples by value. Counts of parts add up.
#[pyclass(frozen, module = "voxsplat._native")]
pub(crate) struct Counts {
    pub(crate) counts: volume::Counts,
}

/// Counts samples as they are: values that are not finite are counted too.
fn counted(
    py: Python<'_>,
    volume: &Volume,
    count: impl Fn(&voxsplat::Volume) -> Result<volume::Counts, voxsplat::error::InputError> + Send + Sync,
) -> PyResult<Counts> {
    let source = volume.source();
    let counted = py.detach(|| source.read().and_then(|volume| Ok(count(&volume)?)));
    Ok(Counts { counts: counted.map_err(|fault| raised(&fault))? })
}

#[pymethods]
impl Counts {
    /// Reads counts from their JSON.
    #[new]
    fn new(json: &str) -> PyResult<Self> {
        Ok(Self { counts: serde_json::from_str(json).map_err(|fault| internal(&fault.to_string()))? })
    }

    /// Counts the samples of a part of a volume; of types over 16 bits only their range.
    #[staticmethod]
    fn of(py: Python<'_>, part: &Volume) -> PyResult<Self> {
        counted(py, part, volume::Counts::of)
    }

    /// Counts the samples of a part in bins of the range of these counts.
    fn refined(&self, py: Python<'_>, part: &Volume) -> PyResult<Self> {
        counted(py, part, |volume| self.counts.refined(volume))
    }

    /// Returns the counts of both parts.
    fn plus(&self, other: &Self) -> Self {
        Self { counts: self.counts.clone().plus(other.counts.clone()) }
    }

    /// Returns whether all samples are in bins.
    #[getter]
    fn is_complete(&self) -> bool {
        self.counts.is_complete()
    }

    fn to_json(&self) -> PyResult<String> {
        serde_json::to_string(&self.counts).map_err(|fault| internal(&fault.to_string()))
    }

    /// Pickles the counts as JSON.
    fn __reduce__(&self, py: Python<'_>) -> PyResult<(Py<PyType>, (String,))> {
        Ok((py.get_type::<Self>().unbind(), (self.to_json()?,)))
    }
}

/// Returns whether the values of all samples decide on the transfer function of these settings.
#[pyfunction]
pub(crate) fn needs_counts(settings: SettingsFields) -> PyResult<bool> {
    let request = settings.request(&voxsplat::View::default()).map_err(|fault| raised(&fault))?;
    Ok(request.needs_statistics())
}
