//! The view and the settings that Python requests, and the appearance that the library makes of them.

use std::path::{Path, PathBuf};

use pyo3::prelude::*;
use voxsplat::appearance::{Choice, Framing, demos, pyramid_level};
use voxsplat::camera::{Camera, ProjectionKind, View};
use voxsplat::error::{Error, Result};
use voxsplat::glam::DVec3;
use voxsplat::image::Ground;
use voxsplat::layers::{LabelSelection, Layer, Layers};
use voxsplat::program::{
    ChoiceContext, ClipSpec, IsosurfaceSpec, LabelLooks, LightRequest, Loaded, OpenChoices, Overlay, OverlaySpec,
    Overlays, TransferRequest, UsedColors, place_studio,
};
use voxsplat::settings::{Painter, QuadsSettings, Settings};
use voxsplat::transfer::Window;
use voxsplat::volume::{Counts, Grid, Statistics, Volume};

use crate::error::raised;
use crate::volume::Source;

/// The attributes of `voxsplat.View`.
#[derive(FromPyObject)]
pub(crate) struct ViewFields {
    azimuth: Option<f64>,
    elevation: Option<f64>,
    roll: f64,
    up: Option<[f64; 3]>,
    direction: Option<[f64; 3]>,
    target: Option<[f64; 3]>,
    projection: String,
    fov: Option<f64>,
    zoom: f64,
    frame: Option<String>,
    margin: Option<f64>,
    view_height: Option<f64>,
    distance: Option<f64>,
}

/// The attributes of `voxsplat.Settings`, as texts if the command line has texts.
#[derive(FromPyObject)]
pub(crate) struct SettingsFields {
    transfer: Option<PathBuf>,
    window: Option<[f64; 2]>,
    transfer_values: String,
    gradient_opacity: Option<String>,
    iso: Vec<String>,
    classification: Option<String>,
    normals: Option<String>,
    model: String,
    response: String,
    depth_coded: bool,
    attenuation: f64,
    shading: String,
    light: Vec<String>,
    material: Option<[f64; 4]>,
    shadows: Option<String>,
    light_size: Option<f64>,
    occlusion: Option<String>,
    shadow_bias: Option<f64>,
    clip: Vec<String>,
    kernel: Option<String>,
    sharpness: Option<f64>,
    level: String,
    painter: String,
    sheet_thickness: Option<f64>,
    termination: f64,
    antialiasing: bool,
    label: Vec<String>,
    label_table: Option<PathBuf>,
}

/// A requested view, with the choices that it leaves open.
#[derive(Debug, Clone)]
pub(crate) struct ViewRequest {
    pub(crate) view: View,
    pub(crate) frame: Framing,
    /// Whether the side of the volume is open.
    pub(crate) is_open: bool,
}

/// Requested settings, with the choices that they leave open.
pub(crate) struct Request {
    transfer: TransferRequest,
    settings: Settings,
    light: LightRequest,
    clip: Vec<ClipSpec>,
    looks: LabelLooks,
    open: OpenChoices,
}

/// Volumes and facts beside the volume of a request.
#[derive(Default)]
pub(crate) struct Beside {
    /// Labels over the volume.
    pub(crate) labels: Option<Source>,
    /// The mask, whose labels other than 0 show the volume.
    pub(crate) mask: Option<Source>,
    /// Volumes over the volume, with their looks.
    pub(crate) overlays: Vec<(Source, OverlaySpec)>,
    /// Facts about a volume of which only an overview is at hand.
    pub(crate) whole: Option<Whole>,
}

/// Facts about all samples of a volume.
pub(crate) struct Whole {
    pub(crate) grid: Grid,
    /// The counts of all samples; `None`: the values of the overview decide.
    pub(crate) counts: Option<Counts>,
}

/// The look of a volume.
pub(crate) struct VolumeLook {
    pub(crate) layers: Layers,
    /// The view that the request or the library chose.
    pub(crate) view: ViewRequest,
    pub(crate) settings: Settings,
    /// Whether light follows the eye.
    pub(crate) follows: bool,
    /// The volume, which sections cut.
    pub(crate) volume: Volume,
    /// The requested transfer function and the number of channels, by which sections have a look.
    ground: (TransferRequest, usize),
    /// The choices of the library in words.
    pub(crate) choices: Vec<String>,
    /// The reasons why layers are invisible and looks of labels have no effect.
    pub(crate) hidden: Vec<String>,
}

/// Refuses a view and settings that no volume can be drawn with.
#[pyfunction]
pub(crate) fn check(view: Option<ViewFields>, settings: Option<SettingsFields>, size: [u32; 2]) -> PyResult<()> {
    let view = view.map_or(Ok(View::default()), |view| Ok(view.request(size)?.view));
    let view = view.map_err(|fault| raised(&fault))?;
    settings.map_or(Ok(()), |settings| settings.request(&view).map(drop)).map_err(|fault| raised(&fault))
}

impl ViewFields {
    /// Returns the view of a picture of some size.
    pub(crate) fn request(&self, size: [u32; 2]) -> Result<ViewRequest> {
        let default = View::default();
        let setting = |name, reason: String| Err(Error::Setting { name, reason });
        let projection = match self.projection.as_str() {
            "orthographic" if self.fov.is_none() => ProjectionKind::Orthographic,
            "orthographic" => return setting("fov", "it is for projection=\"perspective\"".to_owned()),
            "perspective" => self.fov.map_or(ProjectionKind::PERSPECTIVE, |fov| ProjectionKind::Perspective { fov }),
            other => return setting("projection", format!("{other:?}, expected orthographic or perspective")),
        };
        if self.direction.is_some() && (self.azimuth.is_some() || self.elevation.is_some()) {
            return setting("direction", "it replaces azimuth and elevation, give one of them".to_owned());
        }
        let view = View {
            azimuth: self.azimuth.unwrap_or_default(),
            elevation: self.elevation.unwrap_or_default(),
            roll: self.roll,
            up: self.up.map_or(default.up, DVec3::from_array),
            direction: self.direction.map(DVec3::from_array),
            target: self.target.map(DVec3::from_array),
            margin: self.margin.unwrap_or(default.margin),
            projection,
            zoom: self.zoom,
            view_height: self.view_height,
            distance: self.distance,
            ..default
        };
        // The validity of a view does not depend on the volume: one voxel is enough.
        Camera::new(&view, &Grid::axis_parallel([1; 3], [1.0; 3])?, size)?;
        let frame = self.frame.as_deref().map(str::parse).transpose()?;
        let turned = [self.azimuth, self.elevation].iter().any(Option::is_some) || self.roll != 0.0;
        Ok(ViewRequest {
            frame: frame.unwrap_or_else(|| Framing::suited_to(&view, true)),
            view,
            is_open: !turned && self.up.is_none() && self.direction.is_none(),
        })
    }
}

impl SettingsFields {
    /// Returns the request for pictures; lights stand around a view.
    pub(crate) fn request(&self, view: &View) -> Result<Request> {
        let parsed = |texts: &[String]| texts.iter().map(|text| text.parse()).collect::<Result<Vec<_>>>();
        let light = LightRequest {
            lights: parsed(&self.light)?,
            material: self.material,
            shadows: self.shadows.as_deref().map(str::parse).transpose()?,
            light_size: self.light_size,
            occlusion: self.occlusion.as_deref().map(str::parse).transpose()?,
            shadow_bias: self.shadow_bias,
            normals: self.normals.as_deref().map(str::parse).transpose()?,
        };
        let kernel = self.kernel.as_deref().map(str::parse).transpose()?;
        let mut settings = Settings {
            model: self.model.parse()?,
            response: self.response.parse()?,
            depth_coded: self.depth_coded,
            attenuation: self.attenuation,
            shading: self.shading.parse()?,
            lighting: light.lighting(view)?,
            termination: self.termination,
            antialiasing: self.antialiasing,
            level: self.level.parse()?,
            kernel: kernel.unwrap_or_default(),
            sharpness: self.sharpness.unwrap_or_default(),
            painter: self.painter()?,
            ..Settings::default()
        };
        let isosurfaces = self.iso.iter().map(|text| text.parse()).collect::<Result<Vec<IsosurfaceSpec>>>()?;
        IsosurfaceSpec::settle(&isosurfaces, &mut settings)?;
        settings.validate()?;
        let window = self.window.map(|[level, width]| Window { level, width });
        window.map(|window| window.ends()).transpose()?;
        let gradient = self.gradient_opacity.as_deref().map(str::parse).transpose()?;
        let mut transfer =
            TransferRequest::new(self.transfer.as_deref(), window, self.transfer_values.parse()?, gradient)?;
        transfer.isosurfaces = IsosurfaceSpec::points(&isosurfaces);
        transfer.classification = self.classification.as_deref().map(str::parse).transpose()?;
        Ok(Request {
            transfer,
            open: OpenChoices {
                side: false,
                light: light.lights.is_empty(),
                material: self.material.is_none(),
                sharpness: kernel.is_none() && self.sharpness.is_none(),
            },
            clip: self.clip.iter().map(|text| text.parse()).collect::<Result<_>>()?,
            looks: LabelLooks::new(
                self.label_table.as_deref(),
                &self.label.iter().map(|text| text.parse()).collect::<Result<Vec<_>>>()?,
            )?,
            settings,
            light,
        })
    }

    /// Returns the painter; a knob of a painter chooses its painter.
    fn painter(&self) -> Result<Painter> {
        let default = QuadsSettings::default();
        let sheet_thickness = self.sheet_thickness.unwrap_or(default.sheet_thickness);
        let quads = Painter::Quads(QuadsSettings { sheet_thickness, ..default });
        match (self.painter.as_str(), self.sheet_thickness.is_some()) {
            ("auto", false) => Ok(Painter::Auto),
            ("tiles", false) => Ok(Painter::Tiles),
            ("auto" | "quads", _) => Ok(quads),
            ("cpu", false) => Ok(Painter::Cpu),
            ("tiles" | "cpu", true) => {
                let reason = "sheet_thickness is for quads".to_owned();
                Err(Error::Setting { name: "painter", reason })
            }
            (other, ..) => Err(Error::Setting {
                name: "painter",
                reason: format!("{other:?}, expected auto, tiles, quads or cpu"),
            }),
        }
    }
}

impl VolumeLook {
    /// Returns the look of the volume in sections.
    pub(crate) fn ground(&self) -> Result<Ground> {
        let (transfer, channels) = &self.ground;
        transfer.ground(&self.volume, *channels)
    }
}

impl Request {
    /// Returns whether the library chooses the light.
    pub(crate) fn has_open_light(&self) -> bool {
        self.open.light
    }

    /// Returns whether the values of all samples decide on the transfer function.
    pub(crate) fn needs_statistics(&self) -> bool {
        self.transfer.needs_statistics()
    }

    /// Loads a volume and makes the choices that the request leaves open, as `voxsplat render` does.
    pub(crate) fn look(
        mut self,
        source: &Source,
        beside: &Beside,
        mut view: ViewRequest,
        size: [u32; 2],
    ) -> Result<VolumeLook> {
        let path = source.path();
        let Beside { labels: over, mask, overlays, whole } = beside;
        let plain = over.is_none() && mask.is_none() && overlays.is_empty();
        if !plain {
            self.transfer.settle_layers(&mut self.settings)?;
        }
        let Loaded { volume, layers: channels, labels, channels: looks } =
            source.load(self.transfer.values(), pyramid_level(&view.view, size))?;
        let mut choices: Vec<String> = looks.iter().map(|look| format!("channel {look}")).collect();
        let mut used = looks.len();
        let (base, material, is_labels) = if channels.is_empty() {
            let may_be_labels = over.is_none() && self.transfer.may_be_labels(&self.settings);
            // The overview with the steps of the whole volume.
            let stepped = |whole: &Whole| {
                volume.clone().with_grid(Grid::new(volume.grid().dims(), whole.grid.to_world())?).map_err(Error::from)
            };
            let described = whole.as_ref().map_or_else(|| Ok(volume.clone()), stepped)?;
            let statistics = || match whole.as_ref().and_then(|whole| whole.counts.as_ref()) {
                Some(counts) => Ok(Statistics::of_counts(counts, volume.rescale())),
                None => Ok(Statistics::of(&volume)?),
            };
            let fitted = self.transfer.fit(Path::new(&path), &described, may_be_labels, statistics)?;
            choices.extend(fitted.choice.iter().map(Choice::to_string));
            let fitted = if overlays.is_empty() {
                fitted
            } else {
                let (fitted, choice) =
                    fitted.under_overlays(&self.transfer, &volume, &Statistics::of(&volume)?, overlays.len())?;
                used = usize::from(choice == Some(Choice::Channel));
                choices.extend(choice.iter().map(Choice::to_string));
                fitted
            };
            let layers = match fitted.labels {
                true => {
                    let all = std::iter::once(&volume).chain(&labels);
                    all.map(|volume| self.looks.layer(volume, "transfer")).collect::<Result<_>>()?
                }
                false => vec![Layer::scalars(&volume, &fitted.transfer)],
            };
            (layers, fitted.material, fitted.labels)
        } else {
            (channels, None, false)
        };
        let several = if is_labels { 1 } else { base.len() };
        let channels = base.iter().any(|layer| layer.entry().is_some());
        let placed = |source: &Option<Source>, option| -> Result<Option<Volume>> {
            source.as_ref().map(|source| source.on_lattice(&volume, option)).transpose()
        };
        let (mask, over) = (placed(mask, "mask")?, placed(over, "labels")?);
        let mask = mask.as_ref().map(|mask| (mask, &LabelSelection::All));
        let mut layers = self.looks.over(base, mask, over.as_slice())?;
        let hidden = self.looks.notes_on(&layers);
        if !overlays.is_empty() {
            let mut used = UsedColors::new(used, overlays.len());
            let overlay = |(source, spec): &(Source, OverlaySpec)| {
                Overlay::new(spec, source.load(spec.values(), pyramid_level(&view.view, size))?, &mut used)
            };
            let own = overlays.iter().map(overlay).collect::<Result<_>>()?;
            let overlays = Overlays::new(&volume, own)?;
            let chosen = overlays.all.iter().filter_map(|overlay| {
                overlay.look.reason.as_ref().map(|reason| format!("overlay {} because {reason}", overlay.look))
            });
            choices.extend(chosen);
            layers = overlays.over(layers)?;
        }
        self.settings.clip = ClipSpec::intersection(&self.clip, &volume)?;
        let context = ChoiceContext {
            volume: &volume,
            view: demos::own_look(&path).map(|look| look.view),
            material,
            channels,
            labels: is_labels || over.is_some(),
            overlays: !overlays.is_empty(),
            plain: plain || !self.transfer.isosurfaces.is_empty(),
        };
        let open = OpenChoices { side: view.is_open, ..self.open };
        let made = context.make_choices(open, &mut view.view, &mut self.settings)?;
        if let Some(lighting) = self.settings.lighting.as_mut().filter(|_| self.light.is_studio()) {
            place_studio(lighting, &view.view)?;
        }
        choices.extend(made.iter().map(Choice::to_string));
        let follows = self.light.follows();
        let ground = (self.transfer, several);
        Ok(VolumeLook { layers, view, settings: self.settings, follows, volume, ground, choices, hidden })
    }
}
