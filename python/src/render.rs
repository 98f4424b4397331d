//! Renderers and scenes.

use std::ops::Range;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use voxsplat::Frame;

use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use voxsplat::appearance::Framing;
use voxsplat::camera::{Camera, Hull};
use voxsplat::engine::EngineScene;
use voxsplat::error::{Error, Result};
use voxsplat::figure::{Figure, Shown, Slices};
use voxsplat::glam::DVec3;
use voxsplat::image::{Background, Ground, Region, SectionPlane};
use voxsplat::program::{FittedTransfer, OverlaySpec, PlaneSpec, place_studio};
use voxsplat::settings::Settings;
use voxsplat::solids::Solids;
use voxsplat::stats::Rendered;

use crate::bricks::{BrickLight, Partial, Plan, voxels};
use crate::error::{internal, raised};
use crate::image::Image;
use crate::request::{Beside, SettingsFields, ViewFields, ViewRequest, VolumeLook};
use crate::solids::{Mesh, Requested, planes_of};
use crate::volume::Volume;
use crate::worker::{Device, Engines, discard};

/// An overlay: its volume, its name, its look and its range.
type OverlayFields<'a> = (PyRef<'a, Volume>, String, Option<String>, Option<String>);

/// A graphics device, opened for the first scene.
#[pyclass(frozen, module = "voxsplat")]
pub(crate) struct Renderer {
    device: Arc<Device>,
}

/// A volume prepared for pictures.
#[pyclass(frozen, module = "voxsplat")]
pub(crate) struct Scene {
    /// The prepared volume; `None` in a forked process that drops it.
    prepared: Option<Arc<PreparedVolume>>,
    #[pyo3(get)]
    choices: Vec<String>,
    /// The reasons why layers are invisible.
    #[pyo3(get)]
    hidden: Vec<String>,
}

struct PreparedVolume {
    look: VolumeLook,
    scene: EngineScene,
    /// The hulls to which pictures were fitted.
    hulls: Mutex<Vec<(Framing, Option<Hull>)>>,
    /// The look of sections, once there was one.
    ground: Mutex<Option<Ground>>,
}

impl PreparedVolume {
    fn ground(&self) -> Result<Ground> {
        let mut ground = self.ground.lock().unwrap_or_else(PoisonError::into_inner);
        let found = ground.map_or_else(|| self.look.ground(), Ok)?;
        Ok(*ground.insert(found))
    }

    fn hull(&self, frame: Framing) -> Result<Option<Hull>> {
        let mut hulls = self.hulls.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, hull)) = hulls.iter().find(|(of, _)| *of == frame) {
            return Ok(hull.clone());
        }
        let hull = frame.hull(&self.look.layers, &self.look.settings.clip)?;
        hulls.push((frame, hull.clone()));
        Ok(hull)
    }
}

/// A part of a picture of a scene.
struct Shot {
    prepared: Arc<PreparedVolume>,
    view: Option<ViewRequest>,
    size: [u32; 2],
    region: Region,
}

impl Shot {
    fn new(scene: &Scene, view: Option<ViewFields>, size: [u32; 2], region: Option<[u32; 4]>) -> PyResult<Self> {
        let view = view.map(|view| view.request(size)).transpose().map_err(|fault| raised(&fault))?;
        let [x, y, width, height] = region.unwrap_or([0, 0, size[0], size[1]]);
        let region = Region { x, y, width, height };
        let Some(prepared) = scene.prepared.clone() else { return Err(internal("a scene is gone")) };
        Ok(Self { prepared, view, size, region })
    }

    /// Returns the camera and the settings of the picture, which is fitted to its solids too.
    fn seen(&self, solids: &Requested, planes: &[SectionPlane]) -> Result<(Camera, Settings)> {
        let VolumeLook { layers, view: chosen, settings, follows, volume, .. } = &self.prepared.look;
        let ViewRequest { mut view, frame, is_open } = self.view.clone().unwrap_or_else(|| chosen.clone());
        if is_open {
            (view.azimuth, view.elevation) = (chosen.view.azimuth, chosen.view.elevation);
        }
        let mut settings = settings.clone();
        if let Some(lighting) = settings.lighting.as_mut().filter(|_| *follows) {
            place_studio(lighting, &view)?;
        }
        view.around = self.prepared.hull(frame)?.map(|hull| solids.around(hull, planes, volume));
        Ok((Camera::new(&view, layers.grid(), self.size)?, settings))
    }

    /// Renders the picture with its solids. Returns its camera and settings too.
    fn drawn(&self, engines: &mut Engines<'_>, solids: Requested) -> Result<(Rendered, Camera, Settings)> {
        let VolumeLook { layers, volume, .. } = &self.prepared.look;
        let planes = solids.planes(volume)?;
        let (camera, settings) = self.seen(&solids, &planes)?;
        let cuts = match planes.is_empty() {
            true => None,
            false => Solids::of_planes(&planes, layers, self.prepared.ground()?, &camera)?,
        };
        let solids = solids.seen(cuts, &camera, settings.lighting.as_ref())?;
        let frame = Frame::new(&camera, &settings).region(self.region).solids(solids.as_ref());
        let rendered = engines.suited(&settings)?.render(&self.prepared.scene, &frame)?;
        Ok((rendered, camera, settings))
    }
}

#[pymethods]
impl Renderer {
    #[new]
    fn new(adapter: Option<String>) -> Self {
        Self { device: Device::new(adapter) }
    }

    /// Prepares a volume, maybe with labels over it and a mask. Lights stand around the view; its size chooses the
    /// level of a pyramid.
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn prepare(
        &self,
        py: Python<'_>,
        volume: &Volume,
        labels: Option<&Volume>,
        mask: Option<&Volume>,
        overlays: Vec<OverlayFields<'_>>,
        settings: SettingsFields,
        view: ViewFields,
        size: [u32; 2],
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Scene> {
        let view = view.request(size).map_err(|fault| raised(&fault))?;
        let request = settings.request(&view.view).map_err(|fault| raised(&fault))?;
        let source = volume.source();
        let spec = |(volume, name, look, range): &OverlayFields<'_>| {
            let spec = OverlaySpec::with_look(PathBuf::from(name), look.as_deref(), range.as_deref());
            Ok((volume.source(), spec.map_err(|fault| raised(&fault))?))
        };
        let overlays = overlays.iter().map(spec).collect::<PyResult<_>>()?;
        let (labels, mask) = (labels.map(Volume::source), mask.map(Volume::source));
        let beside = Beside { labels, mask, overlays, whole: None };
        let (prepared, choices, hidden) = self.device.run(py, progress, move |engines| {
            let mut look = request.look(&source, &beside, view, size)?;
            let scene = engines.suited(&look.settings)?.prepare_layers(&look.layers, &look.settings)?;
            let (choices, hidden) = (std::mem::take(&mut look.choices), std::mem::take(&mut look.hidden));
            Ok((PreparedVolume { look, scene, hulls: Mutex::default(), ground: Mutex::default() }, choices, hidden))
        })?;
        Ok(Scene { prepared: Some(Arc::new(prepared)), choices, hidden })
    }

    /// Renders a scene of this renderer.
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn render(
        &self,
        py: Python<'_>,
        scene: &Scene,
        view: Option<ViewFields>,
        size: [u32; 2],
        region: Option<[u32; 4]>,
        background: &str,
        meshes: Vec<PyRef<'_, Mesh>>,
        depth: Option<PyReadonlyArray2<'_, f32>>,
        planes: Vec<String>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Image> {
        let background: Background = background.parse().map_err(|fault| raised(&fault))?;
        let choices = scene.choices.clone();
        let (shot, solids) = (Shot::new(scene, view, size, region)?, Requested::new(&meshes, depth, &planes)?);
        let (rendered, settings) = self.device.run(py, progress, move |engines| {
            let (rendered, _, settings) = shot.drawn(engines, solids)?;
            Ok((rendered, settings))
        })?;
        Image::new(rendered, &settings, background, choices)
    }

    /// Draws a figure of sections beside a picture of a scene; `size` is of the figure.
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn slices(
        &self,
        py: Python<'_>,
        scene: &Scene,
        size: [u32; 2],
        planes: Vec<String>,
        at: Option<[f64; 3]>,
        background: &str,
        title: Option<String>,
        caption: Option<String>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Image> {
        let background: Background = background.parse().map_err(|fault| raised(&fault))?;
        let choices = scene.choices.clone();
        let (specs, at) = (planes_of(&planes)?, at.map(DVec3::from_array));
        let texts = Figure { title, caption, ..Figure::default() };
        let panels = Slices::panels(size, specs.len(), &texts).map_err(|fault| raised(&fault))?;
        let panel = panels.last().map_or(size, |panel| [panel.width, panel.height]);
        let shot = Shot::new(scene, None, panel, None)?;
        let (rendered, settings) = self.device.run(py, progress, move |engines| {
            let VolumeLook { layers, volume, .. } = &shot.prepared.look;
            let planes = PlaneSpec::planes(&specs, volume, at)?;
            let (mut rendered, camera, settings) = shot.drawn(engines, Requested::default())?;
            let ground = shot.prepared.ground()?;
            let slices = Slices { layers, ground, planes: &planes, size, texts: &texts };
            // Sections have no colour bar.
            let transfer = &FittedTransfer::clear()?.transfer;
            let shown = Shown { volume, transfer, values: None, camera: &camera, model: settings.model };
            rendered.image = slices.draw(&rendered.image, background, &shown)?;
            Ok((rendered, settings))
        })?;
        Image::new(rendered, &settings, background, choices)
    }

    /// Returns the depths at which rays have lost half of their light, height x width.
    fn depths<'py>(
        &self,
        py: Python<'py>,
        scene: &Scene,
        view: Option<ViewFields>,
        size: [u32; 2],
        region: Option<[u32; 4]>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let shot = Shot::new(scene, view, size, region)?;
        let depths = self.device.run(py, progress, move |engines| {
            let (camera, settings) = shot.seen(&Requested::default(), &[])?;
            engines.suited(&settings)?.depths(&shot.prepared.scene, &Frame::new(&camera, &settings).region(shot.region))
        })?;
        let [width, height] = depths.size().map(|side| side as usize);
        let array = Array2::from_shape_vec((height, width), depths.depths().to_vec());
        Ok(array.map_err(|fault| internal(&fault.to_string()))?.into_pyarray(py))
    }

    /// Draws a brick of a plan, given the slice of the samples that it needs, and the light that enters it.
    fn brick(
        &self,
        py: Python<'_>,
        plan: &Plan,
        number: usize,
        slice: &Volume,
        light: Option<&BrickLight>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Partial> {
        let (plan, source, light) = (Arc::clone(&plan.plan), slice.source(), light.map(|light| light.light.clone()));
        let part = self.device.run(py, progress, move |engines| {
            let layers = Plan::slice(&plan, &source.samples()?)?;
            let engine = engines.suited(plan.settings())?;
            Ok(voxsplat::bricks::brick(engine, &plan, number, &layers, light.as_ref())?.0)
        })?;
        Ok(Partial::new(part))
    }

    /// Sweeps the light of a plan through the whole volume; returns the light that enters each brick, or an empty list.
    /// `slice` gets the voxels of a slice along z, y and x, and returns its samples.
    fn sweep_light(
        &self,
        py: Python<'_>,
        plan: &Plan,
        slice: Py<PyAny>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Vec<BrickLight>> {
        let (plan, failed) = (Arc::clone(&plan.plan), Arc::new(Mutex::new(None::<PyErr>)));
        let raising = Arc::clone(&failed);
        let swept = self.device.run(py, progress, move |engines| {
            let slice_of = |held: &[Range<u32>; 3]| {
                let source = Python::attach(|py| {
                    let volume = slice.bind(py).call1((voxels(held),))?;
                    Ok(volume.cast::<Volume>()?.get().source())
                });
                // An exception of Python ends the sweep, and is raised then.
                let source = source.map_err(|error| {
                    *raising.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
                    Error::Cancelled
                });
                Plan::slice(&plan, &source?.samples()?)
            };
            voxsplat::bricks::sweep_light(&plan, slice_of, engines.progress())
        });
        match failed.lock().unwrap_or_else(PoisonError::into_inner).take() {
            Some(error) => Err(error),
            None => Ok(swept?.into_iter().map(|light| BrickLight { light }).collect()),
        }
    }

    fn close(&self) {
        self.device.close();
    }
}

impl Drop for Scene {
    fn drop(&mut self) {
        discard(self.prepared.take());
    }
}
