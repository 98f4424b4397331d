//! Jobs: arguments that have been checked against each other and by the library, before any file is read.

use std::path::{Path, PathBuf};

use glam::DVec3;
use voxsplat::appearance::Framing;
use voxsplat::camera::{Camera, ProjectionKind, View};
use voxsplat::figure::{Figure, LegendEntry};
use voxsplat::formats::LoadOptions;
use voxsplat::image::{Background, Region, check_writable};
use voxsplat::program::{
    ChannelChoice, ClipSpec, IsosurfaceSpec, LightRequest, OpenChoices, TransferChoice, TransferRequest, Values,
};
use voxsplat::settings::{Painter, Response, Settings};
use voxsplat::transfer::TransferFunction;
use voxsplat::volume::{Grid, Units};

use super::args::{FigureArgs, ModelArgs, ProjectionArg, RenderArgs, StatsFormat, ViewArgs};
use super::destination::Destination;
use super::failure::{Failure, refuse};
use super::layers::LayersJob;
use super::parse::TimeArg;
use super::scene_file::SceneFile;
use super::sections::Sections;
use super::solids::SolidsJob;
use super::transfer::transfer;
use super::tune::Tuning;

/// The maker of a picture.
#[derive(Debug, Clone)]
pub(crate) enum Maker {
    /// A graphics adapter or the processor, by the painter.
    Engine { adapter: Option<String> },
    /// The f64 reference on the CPU.
    Reference,
}

/// A picture to render.
#[derive(Debug, Clone)]
pub(crate) struct RenderJob {
    pub(crate) source: PathBuf,
    pub(crate) load: LoadOptions,
    /// The time points of a turntable.
    pub(crate) times: Option<TimeArg>,
    pub(crate) transfer: TransferRequest,
    pub(crate) layers: LayersJob,
    pub(crate) solids: SolidsJob,
    pub(crate) channels: Vec<ChannelChoice>,
    pub(crate) view: View,
    pub(crate) frame: Framing,
    /// Width and height of the picture, pixels.
    pub(crate) size: [u32; 2],
    /// The part of the picture to render.
    pub(crate) region: Region,
    pub(crate) settings: Settings,
    /// The values of `--clip`, which enter the settings once the volume is known.
    pub(crate) clip: Vec<ClipSpec>,
    pub(crate) choices: Choices,
    pub(crate) studio: Studio,
    /// The values of `--light`.
    pub(crate) lights: Vec<String>,
    pub(crate) maker: Maker,
    pub(crate) output: Outputs,
    pub(crate) figure: FigureJob,
    /// Whether means of blocks of voxels are drawn, blocks about as wide as a pixel.
    pub(crate) reduced: bool,
    /// The sections around the picture.
    pub(crate) sections: Option<Sections>,
    pub(crate) accuracy: ErrorBound,
}

/// Choices that the arguments leave open.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Choices {
    /// The open choices that the library makes.
    pub(crate) open: OpenChoices,
    /// Whether the picture is framed beside the figure's colour bar and texts.
    pub(crate) space: bool,
}

/// Studio light, as requested.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Studio {
    /// Whether an option requests studio light.
    pub(crate) requested: bool,
    /// Whether the light follows the eye in a turntable.
    pub(crate) follows: bool,
}

/// Everything that a job writes.
#[derive(Debug, Clone)]
pub(crate) struct Outputs {
    pub(crate) picture: Destination,
    pub(crate) background: Background,
    pub(crate) transfer: Option<PathBuf>,
    pub(crate) scene: Option<SceneFile>,
    pub(crate) stats: Option<StatsFormat>,
}

impl Outputs {
    /// Returns the paths of all files that the job writes.
    pub(crate) fn files(&self) -> Vec<PathBuf> {
        let picture = match &self.picture {
            Destination::Stdout => None,
            Destination::File(path) => Some(path.as_path()),
        };
        let scene = self.scene.as_ref().map(SceneFile::path);
        [picture, self.transfer.as_deref(), scene].into_iter().flatten().map(Path::to_owned).collect()
    }
}

/// The figure on a picture.
#[derive(Debug, Clone)]
pub(crate) struct FigureJob {
    /// The figure without the names of its legend.
    pub(crate) drawn: Figure,
    /// Whether the figure names labels or channels, once they are known.
    pub(crate) legend: bool,
    /// The units in place of the units of the file.
    pub(crate) units: Units,
}

/// The bound on the error of a picture, and its check.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ErrorBound {
    pub(crate) max_error: Option<f64>,
    pub(crate) verify: bool,
    /// The number of pixels to trace for the bound or its check.
    pub(crate) sample: u32,
}

impl RenderJob {
    /// Makes the job of a picture whose destination the arguments name.
    pub(crate) fn new(mut args: RenderArgs) -> Result<Self, Failure> {
        args.input.check_one_time()?;
        let Some(output) = args.output.take() else {
            return refuse("--output FILE is missing: the destination of the picture (see --help)");
        };
        let output = Destination::checked(output)?;
        if output == Destination::Stdout && args.stats.is_some() {
            return refuse("--stats: standard output takes the picture");
        }
        Self::with_output(args, output)
    }

    /// Makes the job of a picture with the destination `output`.
    pub(crate) fn with_output(args: RenderArgs, output: Destination) -> Result<Self, Failure> {
        let view = view(&args.view, args.size)?;
        let tuning = Tuning::new(&args.model.tune).map_err(Failure::usage)?;
        let mut settings = settings(&args.model, &tuning, tuning.painter(args.painter), &view)?;
        if settings.response == Response::Depth && !output.keeps_values() {
            return refuse("--response depth is for an .exr: a .png holds 0 to 1, window shows it");
        }
        if let Some(path) = &args.save_transfer {
            TransferFunction::check_output(path)
                .and_then(|()| check_writable(path))
                .map_err(|e| Failure::usage(format!("--save-transfer: {e:#}")))?;
        }
        let [width, height] = args.size;
        let region = args.region.unwrap_or(Region { x: 0, y: 0, width, height });
        region.check_within(args.size)?;
        let legend = args.figure.legend;
        let (figure, units) = figure(&args.figure, args.size, &settings)?;
        let transfer = transfer(&args.model)?;
        let alone = matches!(transfer.choice, TransferChoice::Labels);
        let layers = LayersJob::new(&args.layers, alone)?;
        if legend && transfer.values() == Values::Transfer && !layers.has_labels() && layers.overlays.is_empty() {
            return refuse(NO_LEGEND);
        }
        if !layers.is_plain() {
            transfer.settle_layers(&mut settings)?;
        }
        let requested = light(&args.model, &tuning);
        if !args.reference && settings.painter == Painter::Cpu && args.adapter.is_some() {
            return refuse("--adapter: an adapter draws by quads or tiles, not by --painter cpu; leave out either");
        }
        let maker = match args.reference {
            true => Maker::Reference,
            false => Maker::Engine { adapter: args.adapter },
        };
        Ok(Self {
            load: LoadOptions { stream_over: tuning.stream_over, ..args.input.options_for(&view, args.size) },
            source: args.input.source,
            times: args.input.time,
            transfer,
            layers,
            solids: SolidsJob::new(&args.solids)?,
            channels: args.input.channel,
            frame: args.view.frame.unwrap_or_else(|| Framing::suited_to(&view, args.view.in_series)),
            view,
            size: args.size,
            region,
            settings,
            clip: args.model.clip,
            choices: Choices {
                open: OpenChoices {
                    side: args.view.says_no_side(),
                    light: args.model.light.is_empty(),
                    material: args.model.material.is_none(),
                    sharpness: args.model.kernel.is_none() && args.model.sharpness.is_none(),
                },
                space: args.view.fits_by_default(),
            },
            studio: Studio { requested: requested.is_studio(), follows: requested.follows() },
            lights: args.model.light.into_iter().map(|light| light.text).collect(),
            maker,
            output: Outputs {
                picture: output,
                background: args.background,
                transfer: args.save_transfer,
                scene: None,
                stats: args.stats,
            },
            figure: FigureJob { drawn: figure, legend, units },
            reduced: false,
            sections: None,
            accuracy: ErrorBound { max_error: args.max_error, verify: args.verify, sample: tuning.sample },
        })
    }
}

/// The error of a legend without names.
pub(crate) const NO_LEGEND: &str = "--legend names labels and channels, and there are none: \
    --transfer labels takes values as labels, --colour-bar shows values";

/// Returns the figure on a picture, and its units.
pub(crate) fn figure(args: &FigureArgs, size: [u32; 2], settings: &Settings) -> Result<(Figure, Units), Failure> {
    let FigureArgs { scale_bar, axes, colour_bar: color_bar, legend: names, title, caption, units } = args.clone();
    let figure = Figure { scale_bar, axes, color_bar, title, caption, ..Figure::default() };
    figure.validate(size, settings.model)?;
    if names {
        // One name is enough to check the size of the picture, before the others are known.
        let legend = vec![LegendEntry { name: String::new(), color: [0; 3] }];
        Figure { legend, ..figure.clone() }.validate(size, settings.model)?;
    }
    Ok((figure, units.unwrap_or_default()))
}

/// Returns the settings of a picture.
pub(crate) fn settings(model: &ModelArgs, tuning: &Tuning, painter: Painter, view: &View) -> Result<Settings, Failure> {
    let mut settings = Settings {
        model: model.model,
        response: model.response,
        depth_coded: model.depth_coded,
        attenuation: model.attenuation,
        shading: model.shading,
        lighting: light(model, tuning).lighting(view)?,
        interslice: tuning.interslice,
        termination: tuning.termination,
        antialiasing: tuning.antialiasing,
        level: model.level,
        kernel: model.kernel.unwrap_or_default(),
        normalization: tuning.normalization,
        sharpness: model.sharpness.unwrap_or_default(),
        painter,
        ..Settings::default()
    };
    IsosurfaceSpec::settle(&model.iso, &mut settings)?;
    settings.validate()?;
    Ok(settings)
}

/// Returns the requested light.
fn light(args: &ModelArgs, tuning: &Tuning) -> LightRequest {
    LightRequest {
        lights: args.light.iter().map(|light| light.value).collect(),
        material: args.material,
        shadows: args.shadows,
        light_size: args.light_size,
        occlusion: args.occlusion,
        shadow_bias: tuning.shadow_bias,
        normals: args.normals,
    }
}

/// Returns the view of a picture of some size.
pub(crate) fn view(args: &ViewArgs, size: [u32; 2]) -> Result<View, Failure> {
    let projection = match args.projection {
        ProjectionArg::Perspective => {
            args.fov.map_or(ProjectionKind::PERSPECTIVE, |fov| ProjectionKind::Perspective { fov })
        }
        ProjectionArg::Orthographic => ProjectionKind::Orthographic,
    };
    if args.up == Some(DVec3::ZERO) || args.direction == Some(DVec3::ZERO) {
        return refuse("--up and --direction: 0,0,0, expected a length over 0");
    }
    let view = View {
        azimuth: args.azimuth.unwrap_or_default(),
        elevation: args.elevation.unwrap_or_default(),
        roll: args.roll,
        up: args.up.unwrap_or(View::default().up),
        direction: args.direction,
        target: args.target,
        margin: args.margin.unwrap_or(View::default().margin),
        projection,
        zoom: args.zoom,
        view_height: args.view_height,
        distance: args.distance,
        ..View::default()
    };
    // The validity of a view does not depend on the volume: one voxel is enough, before a long read.
    Camera::new(&view, &Grid::axis_parallel([1; 3], [1.0; 3])?, size)?;
    Ok(view)
}
