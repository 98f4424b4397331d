//! Jobs: arguments that have been checked against each other and by the library, before any file is read.

use std::path::{Path, PathBuf};

use glam::DVec3;
use voxsplat::camera::{Camera, ProjectionKind, View};
use voxsplat::figure::{Figure, LegendEntry};
use voxsplat::formats::LoadOptions;
use voxsplat::image::{Background, Image, Region};
use voxsplat::layers::Layers;
use voxsplat::lighting::{Light, Lighting, Source};
use voxsplat::report::check_file;
use voxsplat::settings::{Model, Painter, QuadsSettings, Response, Settings, TilesSettings};
use voxsplat::transfer::maps::{self, ColorMap};
use voxsplat::transfer::presets::{self, Preset};
use voxsplat::transfer::{Imported, TransferFunction, Window};
use voxsplat::volume::{Grid, Units};

use super::Failure;
use super::args::{
    CompareArgs, FigureArgs, FrameArg, ModelArgs, PainterArg, PainterArgs, ParetoArgs, ProjectionArg, RenderArgs,
    StatsFormat, SwitchArg, ViewArgs,
};
use super::channels::ChannelArg;
use super::clip::ClipChoice;
use super::destination::{Destination, STREAM};
use super::layers::{LABELS, LayersJob};
use super::parse::{GradientFloor, GradientOpacity, LightArg, Occlusion, PlaceArg, reason};
use super::preview::Preview;
use super::scene::SceneFile;

/// The default space around what is fitted if there are texts above or below and a frame or zoom is asked for.
const FIGURE_MARGIN: f64 = 0.1;

/// The default vertical field of view, degrees.
const DEFAULT_FOV: f64 = 30.0;

/// The choice of a transfer function.
#[derive(Debug, Clone)]
pub(super) enum TransferChoice {
    /// That of a built-in volume, otherwise the preset suggested by the values.
    Suggested,
    /// A preset.
    Preset(&'static Preset),
    /// From a file, or a colour map.
    Given(Box<Imported>),
    /// None: values are labels.
    Labels,
}

/// A transfer function to be fitted to a volume.
#[derive(Debug, Clone)]
pub(super) struct Transfer {
    pub(super) choice: TransferChoice,
    /// The values that it begins and ends at.
    pub(super) window: Option<Window>,
    /// Whether there is nothing but that window.
    by_window: bool,
    /// What replaces its gradient opacity.
    pub(super) gradient: Option<GradientOpacity>,
    /// What replaces its floor under gradients.
    pub(super) floor: Option<GradientFloor>,
    /// What gradients are reconstructed by.
    pub(super) settings: Settings,
}

impl Transfer {
    /// Whether it is only a window.
    pub(super) fn is_window(&self) -> bool {
        self.by_window
    }

    fn new(args: &ModelArgs, settings: &Settings) -> Result<Self, Failure> {
        let window = args.window;
        let given = |imported| TransferChoice::Given(Box::new(imported));
        let choice = match (&args.transfer, &args.colour_map) {
            (Some(name), _) if name == Path::new(LABELS) => TransferChoice::Labels,
            (Some(name), _) => match presets::PRESETS.iter().find(|preset| name == Path::new(preset.name)) {
                Some(preset) => TransferChoice::Preset(preset),
                None if is_file_name(name) => given(Imported::load(name)?),
                None if name.to_string_lossy().starts_with('{') => {
                    given(Imported::parse(&name.to_string_lossy(), None)?)
                }
                None => {
                    let known: Vec<&str> = presets::PRESETS.iter().map(|p| p.name).collect();
                    let known = known.join(", ");
                    return Err(Failure::Usage(format!("--transfer: {name:?}, expected a file or one of {known}")));
                }
            },
            (None, Some(name)) if is_file_name(name) => given(Imported::of_map(&ColorMap::load(name)?)?),
            (None, Some(name)) => {
                let map = maps::find(&name.to_string_lossy());
                given(Imported::of_map(&map.map_err(|e| Failure::Usage(format!("--colour-map: {}", reason(e))))?)?)
            }
            // A window alone is that of a radiologist: grey values.
            (None, None) if window.is_some() => given(Imported::of_map(&maps::find("gray")?)?),
            (None, None) => TransferChoice::Suggested,
        };
        let by_window = window.is_some() && args.transfer.is_none() && args.colour_map.is_none();
        let (gradient, floor, settings) = (args.gradient_opacity.clone(), args.gradient_floor, settings.clone());
        Ok(Self { choice, window, by_window, gradient, floor, settings })
    }
}

/// The way to make the picture.
#[derive(Debug, Clone)]
pub(super) enum Engine {
    /// Splatting on a graphics adapter.
    Device { adapter: Option<String> },
    /// The f64 reference on the CPU.
    Reference,
}

/// A picture to render.
#[derive(Debug, Clone)]
pub(super) struct RenderJob {
    pub(super) source: PathBuf,
    pub(super) load: LoadOptions,
    pub(super) transfer: Transfer,
    pub(super) layers: LayersJob,
    pub(super) channels: Vec<ChannelArg>,
    pub(super) view: View,
    pub(super) frame: FrameArg,
    /// Width and height of the picture, pixels.
    pub(super) size: [u32; 2],
    /// The part of it that is wanted.
    pub(super) region: Region,
    pub(super) settings: Settings,
    /// What is cut away, in the settings once the volume is known.
    pub(super) clip: ClipChoice,
    /// Whether there is studio light if the transfer function shows surfaces.
    pub(super) chooses_light: bool,
    /// Whether the picture is sharper than with the kernel itself if the transfer function shows surfaces.
    pub(super) chooses_sharpness: bool,
    /// Whether the transfer function's preset chooses the material.
    pub(super) chooses_material: bool,
    /// Whether studio light was asked for.
    pub(super) studio: bool,
    /// Whether studio light comes along with the eye, in a turntable.
    pub(super) light_follows: bool,
    /// Whether the view is oblique if the file states no orientation.
    pub(super) chooses_view: bool,
    /// Whether what shows is framed beside what the figure is drawn on.
    pub(super) makes_room: bool,
    pub(super) engine: Engine,
    pub(super) output: Destination,
    /// How it is shown in the terminal too.
    pub(super) preview: Option<Preview>,
    pub(super) background: Background,
    pub(super) figure: Figure,
    /// Whether the figure names labels or channels, once they are known.
    pub(super) legend: bool,
    /// What replaces the units of the file.
    pub(super) units: Units,
    pub(super) save_transfer: Option<PathBuf>,
    pub(super) save_scene: Option<SceneFile>,
    pub(super) stats: Option<StatsFormat>,
    pub(super) max_error: Option<f64>,
    pub(super) verify: bool,
    /// Pixels to trace for either.
    pub(super) sample: u32,
}

impl RenderJob {
    /// A picture that goes where its arguments say.
    pub(super) fn new(mut args: RenderArgs) -> Result<Self, Failure> {
        args.input.check_one_time()?;
        let output = match (args.output.take(), args.preview) {
            (Some(output), _) => Destination::checked(output)?,
            (None, Some(_)) => Destination::Preview,
            (None, None) => {
                let missing = "--output FILE is missing: where the picture goes (see --help)";
                return Err(Failure::Usage(missing.to_owned()));
            }
        };
        if output == Destination::Stdout && args.stats.is_some() {
            return Err(Failure::Usage("--stats: standard output takes the picture".to_owned()));
        }
        if output == Destination::Stdout && args.preview.is_some() {
            return Err(Failure::Usage("--preview: standard output takes the picture".to_owned()));
        }
        if args.preview.is_some() && args.stats == Some(StatsFormat::Json) {
            return Err(Failure::Usage("--preview: standard output takes --stats json".to_owned()));
        }
        Self::with_output(args, output)
    }

    /// A picture that goes to `output`.
    pub(super) fn with_output(args: RenderArgs, output: Destination) -> Result<Self, Failure> {
        let mut view = view(&args.view)?;
        let makes_room = args.view.fits_by_default();
        let texts = args.figure.title.is_some() || args.figure.caption.is_some();
        if args.view.margin.is_none() && texts && !makes_room {
            view.margin = FIGURE_MARGIN;
        }
        let settings = settings(&args.model, painter(&args.painter), &view)?;
        // Whether a view is valid does not depend on the volume: one voxel tells before a long read.
        Camera::new(&view, &Grid::axis_parallel([1; 3], [1.0; 3])?, args.size)?;
        if settings.response == Response::Depth && !output.keeps_values() {
            return Err(Failure::Usage(
                "--response depth is for an .exr: a .png holds 0 to 1, window shows it".to_owned(),
            ));
        }
        if let Some(path) = &args.save_transfer {
            TransferFunction::check_output(path)
                .and_then(|()| check_file(path))
                .map_err(|e| Failure::Usage(format!("--save-transfer: {e:#}")))?;
        }
        let [width, height] = args.size;
        let region = args.region.unwrap_or(Region { x: 0, y: 0, width, height });
        region.check_within(args.size)?;
        let legend = args.figure.legend;
        let (figure, units) = figure(args.figure, args.size, &settings)?;
        let composite = settings.model == Model::Composite;
        let chooses_light = args.model.light.is_empty() && composite;
        // Post-shaded, samples would be filtered: noise is left as it is unless that is asked for.
        let chooses_sharpness =
            args.model.kernel.is_none() && args.model.sharpness.is_none() && composite && !settings.is_post_shaded();
        let transfer = Transfer::new(&args.model, &settings)?;
        let alone = matches!(transfer.choice, TransferChoice::Labels);
        let layers = LayersJob::new(&args.layers, alone)?;
        let is_one = !matches!(transfer.choice, TransferChoice::Suggested) && !transfer.is_window();
        if legend && is_one && !layers.has_labels() {
            return Err(Failure::Usage(NO_LEGEND.to_owned()));
        }
        if !layers.is_plain() {
            Layers::check_settings(&settings)?;
        }
        let engine = match args.reference {
            true => Engine::Reference,
            false => Engine::Device { adapter: args.adapter },
        };
        Ok(Self {
            load: args.input.options_for(&args.view, args.size),
            source: args.input.source,
            transfer,
            layers,
            channels: args.input.channel,
            view,
            frame: frame(&args.view),
            size: args.size,
            region,
            settings,
            clip: clip_choice(&args.model),
            chooses_light,
            chooses_sharpness,
            chooses_material: args.model.material.is_none(),
            studio: args.model.light.iter().any(|light| matches!(light, LightArg::Studio(_))),
            light_follows: args.model.light.contains(&LightArg::Studio(true)),
            chooses_view: args.view.says_no_side(),
            makes_room,
            engine,
            output,
            preview: args.preview.map(Preview::resolved).transpose()?,
            background: args.background,
            figure,
            legend,
            units,
            save_transfer: args.save_transfer,
            save_scene: None,
            stats: args.stats,
            max_error: args.max_error,
            verify: args.verify,
            sample: args.sample,
        })
    }
}

/// Why there is no legend.
pub(super) const NO_LEGEND: &str = "--legend names labels and channels, and there are none: \
    --transfer labels takes values as labels, --colour-bar shows values";

/// What is drawn on a picture, and the units of what it shows.
fn figure(args: FigureArgs, size: [u32; 2], settings: &Settings) -> Result<(Figure, Units), Failure> {
    let FigureArgs { scale_bar, axes, colour_bar: color_bar, legend: names, title, caption, length_unit, value_unit } =
        args;
    let figure = Figure { scale_bar, axes, color_bar, legend: Vec::new(), title, caption };
    figure.validate(size, settings.model)?;
    if names {
        // Of which size the picture must be, one name tells before the others are known.
        let legend = vec![LegendEntry { name: String::new(), color: [0; 3] }];
        Figure { legend, ..figure.clone() }.validate(size, settings.model)?;
    }
    Ok((figure, Units { length: length_unit, value: value_unit }))
}

/// The settings of a picture.
fn settings(model: &ModelArgs, painter: Painter, view: &View) -> Result<Settings, Failure> {
    let settings = Settings {
        model: model.model,
        response: model.response,
        depth_coded: model.depth_coded,
        attenuation: model.attenuation,
        shading: model.shading,
        lighting: lighting(model, view)?,
        interslice: model.interslice,
        termination: model.termination,
        antialiasing: model.antialiasing == SwitchArg::On,
        level: model.level,
        kernel: model.kernel.unwrap_or_default(),
        normalization: model.normalization,
        sharpness: model.sharpness.unwrap_or_default(),
        painter,
        ..Settings::default()
    };
    settings.validate()?;
    Ok(settings)
}

fn clip_choice(args: &ModelArgs) -> ClipChoice {
    ClipChoice { planes: args.clip.clone(), inside: args.clip_box.clone(), voxels: args.crop }
}

/// Whether the text must mean a file. Then a missing file is reported, instead of an unknown name.
fn is_file_name(text: &Path) -> bool {
    let lossy = text.to_string_lossy();
    if lossy == STREAM {
        return true;
    }
    if lossy.starts_with('{') {
        return false;
    }
    let file = lossy.split('#').next().unwrap_or_default().to_lowercase();
    let endings = [".json", ".vp", ".xml"];
    endings.iter().any(|ending| file.ends_with(ending)) || lossy.contains(['/', '\\', '#']) || text.is_file()
}

/// The painter asked for, with its options. An option of a painter chooses that painter.
fn painter(args: &PainterArgs) -> Painter {
    // The other options of quads are none in the default settings.
    let for_quads = args.sheet_thickness.is_some() || args.sheets.is_some() || args.accumulate.is_some();
    let quads = QuadsSettings {
        sheets: args.sheets.unwrap_or_default(),
        accumulation: args.accumulate.unwrap_or_default(),
        sheet_thickness: args.sheet_thickness.unwrap_or(QuadsSettings::default().sheet_thickness),
        precision: args.precision,
        table_error: args.table_error,
        footprint_table: args.footprint_table,
        sheets_per_pass: args.sheets_per_pass,
    };
    let tiles = TilesSettings { resolution: args.resolution.unwrap_or_default() };
    match args.painter {
        PainterArg::Quads => Painter::Quads(quads),
        PainterArg::Tiles => Painter::Tiles(tiles),
        PainterArg::Auto if args.resolution.is_some() => Painter::Tiles(tiles),
        PainterArg::Auto if quads != QuadsSettings::default() || for_quads => Painter::Quads(quads),
        PainterArg::Auto => Painter::Auto,
    }
}

/// The lights and their material; `None` if there is no light.
fn lighting(args: &ModelArgs, view: &View) -> Result<Option<Lighting>, Failure> {
    let usage = |message: String| Err(Failure::Usage(message));
    let lit: Vec<LightArg> = args.light.iter().copied().filter(|l| *l != LightArg::Off).collect();
    if lit.is_empty() {
        return Ok(None);
    }
    if lit.len() < args.light.len() {
        return usage("--light: off does not go with other lights".to_owned());
    }
    let mut lighting = if lit.iter().any(|light| matches!(light, LightArg::Studio(_))) {
        if lit.len() > 1 {
            return usage("--light: studio is all of the lights, no other goes with it".to_owned());
        }
        Lighting::studio(view.forward()?, view.up)
    } else {
        let mut lights = Vec::new();
        for light in lit {
            let LightArg::One(place, color) = light else { continue };
            let light = match place {
                PlaceArg::Eye => Light::HEADLIGHT,
                PlaceArg::From(azimuth, elevation) => {
                    let towards = -View { azimuth, elevation, up: view.up, ..View::default() }.forward()?;
                    Light::directional(towards)
                }
                PlaceArg::At(place) => Light::at(DVec3::from_array(place)),
            };
            lights.push(Light { color, ..light });
        }
        Lighting { lights, ..Lighting::default() }
    };
    if let Some([ambient, diffuse, specular, shininess]) = args.material {
        lighting = Lighting { ambient, diffuse, specular, shininess, ..lighting };
    }
    lighting.shadows = args.shadows.unwrap_or(lighting.shadows);
    if let Some(size) = args.light_size {
        let is_far = |light: &&mut Light| matches!(light.source, Source::Direction(_));
        lighting.lights.iter_mut().filter(is_far).for_each(|light| light.size = size);
    }
    if let Some(Occlusion(radius)) = args.occlusion {
        lighting.occlusion = radius;
    }
    lighting.shadow_bias = args.shadow_bias.unwrap_or(lighting.shadow_bias);
    Ok(Some(lighting))
}

/// What a picture is fitted to.
fn frame(args: &ViewArgs) -> FrameArg {
    let placed = args.target.is_some() || args.view_height.is_some() || args.distance.is_some();
    args.frame.unwrap_or(if placed { FrameArg::Volume } else { FrameArg::Visible })
}

fn view(args: &ViewArgs) -> Result<View, Failure> {
    let projection = match args.projection {
        ProjectionArg::Perspective => ProjectionKind::Perspective { fov: args.fov.unwrap_or(DEFAULT_FOV) },
        ProjectionArg::Orthographic => ProjectionKind::Orthographic,
    };
    if args.up == Some(DVec3::ZERO) || args.direction == Some(DVec3::ZERO) {
        return Err(Failure::Usage("--up and --direction need a length over 0".to_owned()));
    }
    Ok(View {
        azimuth: args.azimuth.unwrap_or_default(),
        elevation: args.elevation.unwrap_or_default(),
        roll: args.roll,
        up: args.up.unwrap_or(View::default().up),
        direction: args.direction,
        target: args.target,
        around: None,
        margin: args.margin.unwrap_or(View::default().margin),
        reserved: View::default().reserved,
        projection,
        zoom: args.zoom,
        view_height: args.view_height,
        distance: args.distance,
    })
}

/// A volume to be drawn in many ways.
#[derive(Debug)]
pub(super) struct ParetoJob {
    pub(super) source: PathBuf,
    pub(super) load: LoadOptions,
    pub(super) transfer: Transfer,
    /// The view asked for, and others.
    pub(super) views: Vec<View>,
    pub(super) frame: FrameArg,
    /// Width and height of the pictures, pixels.
    pub(super) size: [u32; 2],
    pub(super) settings: Settings,
    pub(super) clip: ClipChoice,
    pub(super) adapter: Option<String>,
    pub(super) directory: PathBuf,
    pub(super) repeats: u32,
    pub(super) sample: u32,
    pub(super) patience: f64,
    pub(super) resume: bool,
    pub(super) rivals: Option<PathBuf>,
    /// What is drawn on the pictures of the page.
    pub(super) figure: Figure,
    pub(super) units: Units,
}

/// The golden angle, degrees: steps of it spread any number of views evenly.
const GOLDEN_ANGLE: f64 = 137.507_764_050_037_85;

impl ParetoJob {
    pub(super) fn new(args: ParetoArgs) -> Result<Self, Failure> {
        args.input.check_one_time()?;
        let first = view(&args.view)?;
        let settings = settings(&args.model, Painter::Auto, &first)?;
        if settings.response == Response::Depth {
            return Err(Failure::Usage("--response depth is no picture for a report: window shows it".to_owned()));
        }
        Camera::new(&first, &Grid::axis_parallel([1; 3], [1.0; 3])?, args.size)?;
        let (figure, units) = figure(args.figure, args.size, &settings)?;
        let turned = |i: u32| {
            let elevations = [0.0, 25.0, -35.0, 55.0, -15.0];
            View {
                direction: None,
                azimuth: first.azimuth + f64::from(i) * GOLDEN_ANGLE,
                elevation: elevations[i as usize % elevations.len()],
                ..first.clone()
            }
        };
        let views = std::iter::once(first.clone()).chain((1..args.views).map(turned)).collect();
        let transfer = Transfer::new(&args.model, &settings)?;
        if args.input.channel.len() > 1 {
            return Err(Failure::Usage("--channel: a study is of one channel".to_owned()));
        }
        if matches!(transfer.choice, TransferChoice::Labels) {
            return Err(Failure::Usage("--transfer labels is for render and turntable".to_owned()));
        }
        check_folder(&args.output)?;
        Ok(Self {
            load: args.input.options_for(&args.view, args.size),
            source: args.input.source,
            transfer,
            views,
            frame: frame(&args.view),
            size: args.size,
            settings,
            clip: clip_choice(&args.model),
            adapter: args.adapter,
            directory: args.output,
            repeats: args.repeats,
            sample: args.sample,
            figure,
            units,
            patience: args.patience,
            resume: args.resume,
            rivals: args.rivals,
        })
    }
}

/// Refuses a folder that cannot be made or written to. It is made after the volume has been read.
fn check_folder(folder: &Path) -> Result<(), Failure> {
    let usage = |reason: String| Err(Failure::Usage(format!("--output: {}: {reason}", folder.display())));
    let mut first = folder.join("report.html");
    while let Some(above) = first.parent().filter(|above| !above.as_os_str().is_empty() && !above.is_dir()) {
        if above.exists() {
            return usage(format!("{} is no directory", above.display()));
        }
        first = above.to_owned();
    }
    check_file(&first).or_else(|error| usage(format!("{error:#}")))
}

/// Two pictures to compare.
#[derive(Debug)]
pub(super) struct CompareJob {
    pub(super) a: PathBuf,
    pub(super) b: PathBuf,
    pub(super) tolerance: f64,
    pub(super) difference: Option<PathBuf>,
    pub(super) json: bool,
}

impl CompareJob {
    pub(super) fn new(args: CompareArgs) -> Result<Self, Failure> {
        if let Some(path) = &args.difference {
            Image::check_output(path).map_err(|e| Failure::Usage(format!("{e:#}")))?;
        }
        let CompareArgs { a, b, tolerance, difference, json } = args;
        Ok(Self { a, b, tolerance, difference, json })
    }
}
