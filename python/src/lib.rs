//! The native module of the Python package `voxsplat`: volumes of arrays and files, renderers, scenes and pictures.
//!
//! `voxsplat/functions.py` and `voxsplat/convert.py` are the interface of the package. This module takes their checked
//! values, calls the library without the interpreter's lock, and turns errors into Python's.

mod bricks;
mod counts;
mod error;
mod image;
mod render;
mod request;
mod solids;
mod volume;
mod worker;

use std::ffi::OsString;

use pyo3::prelude::*;
use voxsplat::program::ForeignWords;
use voxsplat::renderer::{self, silenced};
use voxsplat::transfer::maps;
use voxsplat::transfer::presets::PRESETS;
use voxsplat_volume::names::nearest;

/// Returns name and description of each preset.
#[pyfunction]
fn presets() -> Vec<(&'static str, &'static str)> {
    PRESETS.iter().map(|preset| (preset.name, preset.description)).collect()
}

/// Returns the names of the colour maps.
#[pyfunction]
fn colour_maps() -> Vec<&'static str> {
    maps::names()
}

/// Returns the end of the error of an unknown option: the keyword for a word of another program, if it is one of
/// `names`, otherwise the most similar name; empty if there is none.
#[pyfunction]
fn hint(word: &str, names: Vec<String>) -> String {
    let is_known = |name: &str| names.iter().any(|known| known == name);
    // Texts have `name=`, maybe with a value behind it.
    let named = |text: &'static str| {
        let words = text.split(|c: char| !c.is_alphanumeric() && c != '_' && c != '=');
        words.filter_map(|word| word.split_once('=')).map(|(name, _)| name)
    };
    let own = ForeignWords::of(word).map(|row| row.keyword).filter(|text| !text.is_empty());
    match own.filter(|text| named(text).all(is_known)) {
        Some(text) => format!(": {text}"),
        None => match nearest(&word.to_lowercase(), names.iter().map(String::as_str)) {
            Some(name) => format!("; a similar option exists: {name}"),
            None => String::new(),
        },
    }
}

/// Returns the adapters, best first, as JSON. Opens none of them.
#[pyfunction]
fn adapters(py: Python<'_>) -> PyResult<String> {
    worker::check_process()?;
    let adapters = py.detach(|| silenced(renderer::adapters));
    serde_json::to_string(&adapters).map_err(|fault| error::internal(&fault.to_string()))
}

/// Runs the command line `voxsplat` with these arguments, the name of the program first, and returns its exit code.
#[pyfunction]
fn command(py: Python<'_>, words: Vec<OsString>) -> u8 {
    py.detach(|| voxsplat_cli::command(&words))
}

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("DeviceError", py.get_type::<error::DeviceError>())?;
    module.add_class::<volume::Volume>()?;
    module.add_class::<render::Renderer>()?;
    module.add_class::<render::Scene>()?;
    module.add_class::<image::Image>()?;
    module.add_class::<solids::Mesh>()?;
    module.add_class::<bricks::Plan>()?;
    module.add_class::<bricks::Partial>()?;
    module.add_class::<bricks::BrickLight>()?;
    module.add_class::<counts::Counts>()?;
    for function in [
        wrap_pyfunction!(presets, module)?,
        wrap_pyfunction!(colour_maps, module)?,
        wrap_pyfunction!(adapters, module)?,
        wrap_pyfunction!(command, module)?,
        wrap_pyfunction!(hint, module)?,
        wrap_pyfunction!(request::check, module)?,
        wrap_pyfunction!(volume::data_files, module)?,
        wrap_pyfunction!(volume::format_of, module)?,
        wrap_pyfunction!(counts::needs_counts, module)?,
        wrap_pyfunction!(bricks::even_chunks, module)?,
    ] {
        module.add_function(function)?;
    }
    // A picture that Ctrl-C ended may still run on the device, which must not vanish under it.
    let wait = wrap_pyfunction!(worker::wait_for_abandoned, module)?;
    py.import("atexit")?.call_method1("register", (wait,))?;
    Ok(())
}
