//! The arguments of the program, and its help.

use std::path::PathBuf;

use clap::builder::NonEmptyStringValueParser;
use clap::{Parser, Subcommand, ValueEnum};
use glam::DVec3;
use voxsplat::clip::Clip;
use voxsplat::film::Format;
use voxsplat::formats::{LoadOptions, PyramidLevel};
use voxsplat::image::{Background, Region};
use voxsplat::kernel::{Kernel, Normalization};
use voxsplat::reconstruction::Signal;
use voxsplat::settings::{Accumulation, Interslice, Level, Model, Precision, Resolution, Response, Shading, Sheets};
use voxsplat::transfer::Window;
use voxsplat::volume::{Endian, SampleType};

use super::Failure;
use super::channels::{ChannelArg, channel};
use super::clip::{self, ClipArg, Voxels};
use super::layers::{LabelArg, label};
use super::parse::{self, GradientFloor, GradientOpacity, LightArg, Occlusion, TimeArg, one_of};
use super::preview::Preview;

/// Renders voxel volumes by splatting on the GPU.
#[derive(Debug, Parser)]
#[command(version, max_term_width = 100, after_help = MAIN_EXAMPLES, disable_help_subcommand = true)]
#[command(subcommand_required = true, arg_required_else_help = false)]
pub(super) struct Args {
    #[command(subcommand)]
    pub(super) command: Command,
    /// Print results and errors alone: no notes, no progress
    #[arg(short, long, global = true)]
    pub(super) quiet: bool,
}

const MAIN_EXAMPLES: &str = "\
Examples:
  voxsplat render demo:shepp-logan -o head.png
  voxsplat info scan.nii.gz
  voxsplat render scan.nii.gz -o scan.png --transfer ct-bone --azimuth 30
  voxsplat pareto scan.nii.gz -o speed-against-error

Exit codes: 0 done, 1 failed (compare: the pictures differ; --max-error: broken), 2 wrong arguments;
128 and its number if a signal ends it. Output has no colours, with NO_COLOR and without.";

#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Render a volume to a picture
    Render(Box<RenderArgs>),
    /// Turn a volume: a picture or a frame of a film for each view
    Turntable(Box<TurntableArgs>),
    /// Draw a volume in many ways, and report their speed against their error
    Pareto(Box<ParetoArgs>),
    /// Show what a volume file holds and how to render it
    Info(InfoArgs),
    /// Show how well kernels reconstruct a known signal
    Kernels(KernelsArgs),
    /// Compare two pictures
    Compare(CompareArgs),
    /// List the graphics adapters, best first
    Devices,
    /// Print completions for a shell: bash, elvish, fish, powershell or zsh
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
    /// Print the manual page of the program or of a command, for man -l
    Man {
        /// A command, such as render
        command: Option<String>,
    },
}

/// The volume, and what its file does not state.
#[derive(Debug, clap::Args)]
pub(super) struct InputArgs {
    /// A volume: a file (NRRD, NIfTI, MetaImage, NumPy, MRC, VTK, TIFF, DICOM, raw; HDF5 or NetCDF, also as
    /// FILE:/SET), a folder of DICOM or TIFF files or of Zarr, - for standard input, or a built-in volume,
    /// demo:NAME[:SIZE]; for render also a scene, FILE.json
    #[arg(value_name = "VOLUME")]
    pub(super) source: PathBuf,
    /// Raw files: samples along x (fastest), y and z
    #[arg(long, value_name = "X,Y,Z", value_parser = parse::dims, allow_hyphen_values = true, help_heading = "Input")]
    pub(super) dims: Option<[u32; 3]>,
    /// Raw files: type of the samples: u8, i8, u16, i16, u32, i32, u64, i64, f32 or f64
    #[arg(long = "type", value_name = "TYPE", value_parser = parse::library::<SampleType>, help_heading = "Input")]
    pub(super) sample_type: Option<SampleType>,
    /// Raw files: byte order, little or big [default: little]
    #[arg(long, value_name = "ORDER", value_parser = parse::library::<Endian>, help_heading = "Input")]
    pub(super) endian: Option<Endian>,
    /// Raw files: bytes to skip before the samples
    #[arg(long, value_name = "BYTES", default_value_t = 0, help_heading = "Input")]
    pub(super) offset: u64,
    /// World distance between samples; replaces the spacing of the file
    #[arg(long, value_name = "X,Y,Z", value_parser = parse::spacing, allow_hyphen_values = true,
        help_heading = "Input")]
    pub(super) spacing: Option<[f64; 3]>,
    /// Replace NaN and infinite samples by VALUE; without this option they are refused. They are transparent if the
    /// transfer function gives VALUE no opacity
    #[arg(long, value_name = "VALUE", value_parser = parse::number, allow_hyphen_values = true, help_heading = "Input")]
    pub(super) replace_nan: Option<f64>,
    /// Files of several channels: draw channel N, counted from 0. Repeat the option to draw several together, each in a
    /// colour [default: all, in the colours of the file or green, magenta, cyan ..; red, green and blue as colours]
    #[arg(long, value_name = "N[:COLOUR]", value_parser = channel, help_heading = "Input")]
    pub(super) channel: Vec<ChannelArg>,
    /// Files of several points in time: which of them, counted from 0; for turntable also a range or all of them, one
    /// after the other, by the transfer function of the first and framed for all [default: 0]
    #[arg(long, value_name = "N|FIRST-LAST|all", value_parser = parse::time, help_heading = "Input")]
    pub(super) time: Option<TimeArg>,
    /// Folders of DICOM files, or of OME-Zarr by Bio-Formats: which of several series, counted from 1; without this
    /// option those of DICOM are listed
    #[arg(long, value_name = "N", help_heading = "Input")]
    pub(super) series: Option<u32>,
    /// OME-Zarr: which level of the pyramid of resolutions, 0 is the finest [default: the coarsest whose samples are no
    /// coarser than pixels]
    #[arg(long, value_name = "N", help_heading = "Input")]
    pub(super) pyramid: Option<u32>,
    /// Read a volume of more than MIB MiB piece by piece from its file, if that is uncompressed
    #[arg(long, value_name = "MIB", default_value_t = 4, help_heading = "Input")]
    pub(super) stream_over: u64,
}

impl InputArgs {
    /// The options for a picture: of a pyramid, the level that its pixels need.
    pub(super) fn options_for(&self, view: &ViewArgs, size: [u32; 2]) -> LoadOptions {
        let options = self.options();
        let level = match (self.pyramid, view.view_height) {
            (Some(_), _) => options.level,
            (None, Some(height)) => PyramidLevel::PixelSize(height / view.zoom / f64::from(size[1])),
            (None, None) => PyramidLevel::Pixels(f64::from(size[0].max(size[1])) * view.zoom),
        };
        LoadOptions { level, ..options }
    }

    /// Refuses several points in time.
    pub(super) fn check_one_time(&self) -> Result<(), Failure> {
        match self.time {
            None | Some(TimeArg::One(_)) => Ok(()),
            Some(several) => Err(Failure::Usage(format!("--time {several}: several points in time are for turntable"))),
        }
    }

    pub(super) fn options(&self) -> LoadOptions {
        LoadOptions {
            dims: self.dims,
            sample_type: self.sample_type,
            spacing: self.spacing,
            endian: self.endian,
            offset: self.offset,
            replace_nan: self.replace_nan,
            time: self.time.map(TimeArg::first),
            channel: self.channel.first().map(|channel| channel.number),
            series: self.series,
            level: self.pyramid.map_or(LoadOptions::default().level, PyramidLevel::At),
            stream_over: self.stream_over.saturating_mul(1 << 20),
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum ProjectionArg {
    Orthographic,
    Perspective,
}

/// What a picture is fitted to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum FrameArg {
    Visible,
    View,
    Volume,
}

/// What draws the splats.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum PainterArg {
    Auto,
    Quads,
    Tiles,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum SwitchArg {
    On,
    Off,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum StatsFormat {
    Table,
    Json,
}

/// Where the eye is.
#[derive(Debug, clap::Args)]
pub(super) struct ViewArgs {
    /// Rotate the eye about the up direction by DEG degrees, from the front of the volume [default: 0; `render` takes
    /// 30 for a file without orientation if no side is asked for]
    #[arg(long, alias = "camera-azimuth-angle", value_name = "DEG", value_parser = parse::number,
        allow_hyphen_values = true, help_heading = "View")]
    pub(super) azimuth: Option<f64>,
    /// Raise the eye towards the up direction by DEG degrees [default: 0; 20 where the azimuth is 30 by default]
    #[arg(long, alias = "camera-elevation-angle", value_name = "DEG", value_parser = parse::number,
        allow_hyphen_values = true, help_heading = "View")]
    pub(super) elevation: Option<f64>,
    /// Rotate the camera about its viewing direction by DEG degrees, counter-clockwise
    #[arg(long, value_name = "DEG", default_value_t = 0.0, value_parser = parse::number, allow_hyphen_values = true,
        help_heading = "View")]
    pub(super) roll: f64,
    /// World direction that is up in the picture [default: 0,0,1]
    #[arg(long, alias = "camera-view-up", value_name = "X,Y,Z", value_parser = parse::vector,
        allow_hyphen_values = true, help_heading = "View")]
    pub(super) up: Option<DVec3>,
    /// World direction from the eye to the target; replaces azimuth and elevation
    #[arg(long, alias = "camera-direction", value_name = "X,Y,Z", value_parser = parse::vector,
        allow_hyphen_values = true,
        conflicts_with_all = ["azimuth", "elevation"], help_heading = "View")]
    pub(super) direction: Option<DVec3>,
    /// World point at the centre of the picture [default: the centre of what is framed]
    #[arg(long, alias = "camera-focal-point", value_name = "X,Y,Z", value_parser = parse::vector,
        allow_hyphen_values = true, help_heading = "View")]
    pub(super) target: Option<DVec3>,
    /// Parallel rays, or rays through one eye
    #[arg(long, value_name = "KIND", default_value = "orthographic", help_heading = "View")]
    pub(super) projection: ProjectionArg,
    /// Perspective: vertical field of view in degrees, over 0 and under 180 [default: 30]
    #[arg(long, alias = "camera-view-angle", value_name = "DEG", value_parser = parse::positive,
        allow_hyphen_values = true, help_heading = "View")]
    pub(super) fov: Option<f64>,
    /// Magnify by F
    #[arg(long, alias = "camera-zoom-factor", value_name = "F", default_value_t = 1.0, value_parser = parse::positive,
        allow_hyphen_values = true,
        help_heading = "View")]
    pub(super) zoom: f64,
    /// What the picture is fitted to: visible (all that the transfer function shows, in one size at every azimuth),
    /// view (the same, as large as this view of it can be) or volume (the box of the lattice, as it is seen from this
    /// side) [default: visible, or volume if --target, --view-height or --distance is given]
    #[arg(long, value_name = "WHAT", help_heading = "View")]
    pub(super) frame: Option<FrameArg>,
    /// Space around what is fitted: a fraction of the picture on each side, 0 to under 0.5 [default: 0.02 beside
    /// colour bar, title and caption; over them with --zoom or --frame, then 0.1 with a title or a caption]
    #[arg(long, value_name = "FRACTION", value_parser = parse::tolerance, allow_hyphen_values = true,
        help_heading = "View")]
    pub(super) margin: Option<f64>,
    /// World height that the picture spans at the target [default: what is framed just fits]
    #[arg(long, value_name = "LENGTH", value_parser = parse::positive, allow_hyphen_values = true,
        help_heading = "View")]
    pub(super) view_height: Option<f64>,
    /// Perspective: world distance from the eye to the target [default: what is framed just fits]
    #[arg(long, value_name = "LENGTH", value_parser = parse::positive, allow_hyphen_values = true,
        help_heading = "View")]
    pub(super) distance: Option<f64>,
}

impl ViewArgs {
    /// Whether no option says what the picture frames, or how large.
    pub(super) fn fits_by_default(&self) -> bool {
        let Self { target, zoom, frame, margin, view_height, distance, .. } = self;
        let given = [margin, view_height, distance].into_iter().any(Option::is_some);
        !given && target.is_none() && frame.is_none() && *zoom == 1.0
    }

    /// Whether no option says from which side to look, or what is up.
    pub(super) fn says_no_side(&self) -> bool {
        let Self { azimuth, elevation, roll, up, direction, .. } = self;
        azimuth.is_none() && elevation.is_none() && *roll == 0.0 && up.is_none() && direction.is_none()
    }
}

/// What a picture shows.
#[derive(Debug, clap::Args)]
pub(super) struct ModelArgs {
    /// Transfer function: a preset that adapts to the data (ct-bone, ct-skin, ct-muscle, ct-soft-tissue, ct-lung,
    /// angiography, mri, mr-brain, pet, activation, fluorescence, field, grayscale, gray, viridis or inferno), or a
    /// file: this program's JSON, ParaView's JSON or XML, Slicer's .vp, .vp.json or presets.xml, niivue's or napari's
    /// JSON; #NAME chooses from a file of several; or labels: values are labels [default: suggested by the
    /// data, labels too; see `voxsplat info`]
    #[arg(long, value_name = "FILE[#NAME]|PRESET", help_heading = "Model")]
    pub(super) transfer: Option<PathBuf>,
    /// The colours of a map over --window, with a gentle ramp of opacity: gray, viridis, inferno, magma, plasma,
    /// cividis or turbo; of Crameri batlow, batlowK, devon, oslo, lajolla, lipari, navia, hawaii, acton, tokyo, davos,
    /// vik, roma, berlin or cork; of cmocean thermal, haline, solar, ice, deep, dense, matter, amp, balance or curl; or
    /// of a file as for --transfer
    #[arg(long, alias = "color-map", value_name = "NAME|FILE", conflicts_with = "transfer", help_heading = "Model")]
    pub(super) colour_map: Option<PathBuf>,
    /// Values from LEVEL - WIDTH/2 to LEVEL + WIDTH/2: there begins and ends the transfer function or the colour map
    /// [default: as the file states; of colour maps, the values of the foreground]
    #[arg(long, value_name = "LEVEL,WIDTH", value_parser = parse::window, allow_hyphen_values = true,
        help_heading = "Model")]
    pub(super) window: Option<Window>,
    /// Gradient opacity: opacities are multiplied by O, 0 to 1, where the value changes by M per world unit; linear
    /// between the points, and constant beyond them. So flat insides become clear and surfaces stay. Or off
    /// [default: what the transfer function has]
    #[arg(long, value_name = "M:O,M:O,..|off", value_parser = parse::gradient_opacity, help_heading = "Model")]
    pub(super) gradient_opacity: Option<GradientOpacity>,
    /// A floor under which a gradient is noise, value per world unit: a colour whose gradient is g long is lit as a
    /// surface with the weight g^2 / (g^2 + F^2), and with the rest shown as one without a surface, so that flat noisy
    /// matter does not sparkle. auto is twice the gradient that noise makes, as far as the data tell; 0 is none
    /// [default: what the transfer function has]
    #[arg(long, value_name = "F|auto", value_parser = parse::gradient_floor, help_heading = "Model")]
    pub(super) gradient_floor: Option<GradientFloor>,
    /// What a pixel is: composite (emission and absorption), xray (absorption only, white), mip (the largest value of
    /// its ray, coloured by the transfer function), minip (the smallest) or average (the mean)
    #[arg(long, value_name = "MODEL", default_value = "composite", value_parser = one_of(Model::ALL, Model::name),
        help_heading = "Model")]
    pub(super) model: Model,
    /// X-ray: what a pixel shows of the optical depth of its ray: absorption (white of alpha 1 - exp(-depth)), window
    /// (grey, linear from black at depth LOW to white at HIGH: 0,4), film (radiographic film on a light box: its
    /// exposure, over that of half its density, and its contrast: 4,3), or depth (the depth itself, for an .exr)
    #[arg(long, value_name = "absorption|window[:LOW,HIGH]|film[:EXPOSURE,GAMMA]|depth", default_value = "absorption",
        value_parser = parse::response, help_heading = "Model")]
    pub(super) response: Response,
    /// Projections mip and minip: colours tell how deep the value lies, from red (nearest) to violet (farthest); the
    /// transfer function tells how bright they are
    #[arg(long, help_heading = "Model")]
    pub(super) depth_coded: bool,
    /// Projection mip: what is farther away counts less, down to exp(-A) of itself at the far end of the box, 0 to 20
    #[arg(long, value_name = "A", default_value_t = 0.0, value_parser = parse::number, help_heading = "Model")]
    pub(super) attenuation: f64,
    /// Classify and light voxels before reconstruction (pre: fast) or pixels after it (post: sharp)
    #[arg(long, value_name = "WHEN", default_value = "pre", value_parser = one_of(Shading::ALL, Shading::name),
        help_heading = "Model")]
    pub(super) shading: Shading,
    /// Light surfaces: off, headlight (from the eye), AZ,EL (from the position of an eye at that azimuth and elevation,
    /// degrees), @X,Y,Z (at a place in the world, as bright at any distance), or studio (key, fill and rim light around
    /// the view, soft shadows, occlusion; in a turntable it stands still, and studio:eye comes along with the eye).
    /// Repeat the option for up to 4 lights; :INTENSITY or :#RRGGBB behind all but the last changes them [default:
    /// studio for `render` by a preset that shows surfaces; otherwise off]
    #[arg(long, value_name = "LIGHT", value_parser = parse::light, allow_hyphen_values = true, help_heading = "Model")]
    pub(super) light: Vec<LightArg>,
    /// Material of lit surfaces: ambient, diffuse and specular share, 0 to 1, and shininess, 1 to 1000
    /// [default: 0.3,0.7,0.2,24; studio 0.4,0.7,0.2,24; `render` takes that of a preset that shows surfaces]
    #[arg(long, value_name = "A,D,S,N", value_parser = parse::material, help_heading = "Model")]
    pub(super) material: Option<[f64; 4]>,
    /// Cut away what lies beyond a plane. What lies in the world direction NX,NY,NZ stays: of a plane through the
    /// middle of the volume, at the distance D from the origin of the world, or through the point X,Y,Z. Or the side
    /// of the patient that stays: L, R, A, P, S or I. Repeat the option for more planes, 8 with those of boxes
    #[arg(long, alias = "clip-plane", value_name = "NX,NY,NZ[,D|,X,Y,Z]|SIDE", value_parser = clip::clip,
        allow_hyphen_values = true, help_heading = "Model")]
    pub(super) clip: Vec<ClipArg>,
    /// Cut away what lies outside of a box of the world; -inf and inf leave a side open
    #[arg(long, value_name = "X0,X1,Y0,Y1,Z0,Z1", value_parser = clip::clip_box, allow_hyphen_values = true,
        help_heading = "Model")]
    pub(super) clip_box: Option<Clip>,
    /// Cut away what lies outside of the cells of some voxels: from I0 to before I1 along the first axis of the
    /// lattice, counted from 0, and so on. Without a number a range reaches to the face of the volume: 10:20,:,40:
    #[arg(long, value_name = "I0:I1,J0:J1,K0:K1", value_parser = clip::crop, help_heading = "Model")]
    pub(super) crop: Option<[Voxels; 3]>,
    /// Shadows of the first three lights given by AZ,EL or @X,Y,Z: on, off, or their strength, 0 to 1 [default: off;
    /// studio 0.85]
    #[arg(long, value_name = "on|off|STRENGTH", value_parser = parse::strength, help_heading = "Model")]
    pub(super) shadows: Option<f64>,
    /// How far from a voxel shadows and occlusion begin, voxels, 0 to 16. Nearer matter keeps no light from it, so
    /// opaque surfaces that face a light are lit; at 0 they lie in their own shadow [default: 1.5]
    #[arg(long, value_name = "VOXELS", value_parser = parse::number, help_heading = "Model")]
    pub(super) shadow_bias: Option<f64>,
    /// How large lights given by AZ,EL appear, across, degrees, 0 to 90: shadows become soft [default: 0; studio 10]
    #[arg(long, value_name = "DEGREES", value_parser = parse::number, help_heading = "Model")]
    pub(super) light_size: Option<f64>,
    /// Ambient occlusion: voxels take the ambient light from each other within so many voxels, or off
    /// [default: off; studio 8]
    #[arg(long, value_name = "RADIUS|off", value_parser = parse::occlusion, help_heading = "Model")]
    pub(super) occlusion: Option<Occlusion>,
    /// Reconstruction kernel, lengths in voxels: gaussian[:SIGMA,RADIUS] (1,2) or kaiser-bessel[:RADIUS,ALPHA] (2,10.4)
    /// [default: gaussian]
    #[arg(long, value_name = "KERNEL", value_parser = parse::kernel, help_heading = "Model")]
    pub(super) kernel: Option<Kernel>,
    /// Take the blur of the kernel back: 0 (not at all) to 1. A Gaussian gives way to a narrower Kaiser-Bessel blob;
    /// with --shading post, --model mip, minip or average samples are filtered besides, so that the field passes
    /// through them. Noise grows [default: 0; `render` takes 0.5 for a preset that shows surfaces, pre-shaded, if no
    /// kernel is asked for]
    #[arg(long, value_name = "S", value_parser = parse::number, allow_hyphen_values = true, help_heading = "Model")]
    pub(super) sharpness: Option<f64>,
    /// Divisor of sums of kernels: the kernel's integral (unit), or its peak of 1 (historical, denser)
    #[arg(long, value_name = "HOW", default_value = "unit",
        value_parser = one_of(Normalization::ALL, Normalization::name), help_heading = "Model")]
    pub(super) normalization: Normalization,
    /// Post-shading: classify a sheet by the parabola through it and its neighbours, or (historical) by its mean
    #[arg(long, value_name = "HOW", default_value = "parabola",
        value_parser = one_of(Interslice::ALL, Interslice::name), help_heading = "Model")]
    pub(super) interslice: Interslice,
    /// Early termination: skip splats that at most this fraction of the light reaches, 0 (off) to under 1; no channel
    /// changes by more than that fraction
    #[arg(long, value_name = "FRACTION", default_value_t = 1e-3, value_parser = parse::tolerance,
        allow_hyphen_values = true, help_heading = "Model")]
    pub(super) termination: f64,
    /// Enlarge the kernels of voxels that are closer together than pixels
    #[arg(long, value_name = "WHETHER", default_value = "on", help_heading = "Model")]
    pub(super) antialiasing: SwitchArg,
    /// Cells of 2^N voxels along each axis in place of voxels, N 0 to 12; auto takes cells that are still finer than
    /// the picture
    #[arg(long, value_name = "N|auto", default_value = "auto", value_parser = parse::level, help_heading = "Model")]
    pub(super) level: Level,
}

/// Labels, and what of the volume shows.
#[derive(Debug, clap::Args)]
pub(super) struct LayerArgs {
    /// Draw the labels of a volume too; extinctions add. On another lattice, the nearest voxel counts. (A volume of
    /// labels alone: --transfer labels.) Label 0 is clear. Pre-shaded
    #[arg(long, value_name = "FILE", help_heading = "Labels")]
    pub(super) labels: Option<PathBuf>,
    /// Names, colours and opacities of labels: an ITK-SNAP label description, a 3D Slicer colour table (.ctbl, .csv), a
    /// FreeSurfer lookup table or a BIDS .tsv [default: those of a .seg.nrrd, otherwise distinct colours]
    #[arg(long, value_name = "FILE", help_heading = "Labels")]
    pub(super) label_table: Option<PathBuf>,
    /// What labels look like: WHICH is all, numbers (1,4,7-9) or a name of the table, LOOK an opacity from 0 to 1, on,
    /// off or a colour. Repeat the option; later ones win: --label all:0.2 --label 3:on
    #[arg(long, value_name = "WHICH:LOOK", value_parser = label, allow_hyphen_values = true, help_heading = "Labels")]
    pub(super) label: Vec<LabelArg>,
    /// Multiply the opacities of all labels by F, 0 to 1
    #[arg(long, value_name = "F", value_parser = parse::number, help_heading = "Labels")]
    pub(super) label_opacity: Option<f64>,
    /// Show the volume only where another one has a label other than 0, or one of LABELS (1,4,7-9); on another lattice,
    /// the nearest voxel counts
    #[arg(long, value_name = "FILE[:LABELS]", help_heading = "Labels")]
    pub(super) mask: Option<PathBuf>,
}

/// What draws it.
#[derive(Debug, clap::Args)]
pub(super) struct PainterArgs {
    /// What draws the splats: quads draws every picture, tiles is faster and refuses some, auto takes tiles
    /// unless it refuses, on GPUs with --resolution full. An option of a painter (below) chooses that painter
    #[arg(long, value_name = "PAINTER", default_value = "auto", help_heading = "Device")]
    pub(super) painter: PainterArg,
    /// Thickness of a sheet in voxels, 0.05 to 64: thinner is more exact and slower [default: 1]
    #[arg(long, value_name = "VOXELS", value_parser = parse::positive, allow_hyphen_values = true,
        help_heading = "Painter quads")]
    pub(super) sheet_thickness: Option<f64>,
    /// Sheets parallel to the image, or (historical, pops) the voxel planes most parallel to it [default: image]
    #[arg(long, value_name = "ALIGNMENT", value_parser = one_of(Sheets::ALL, Sheets::name),
        help_heading = "Painter quads")]
    pub(super) sheets: Option<Sheets>,
    /// What a sheet adds up: optical depth, or (historical, inexact) opacities clamped at 1 [default: optical-depth]
    #[arg(long, value_name = "WHAT", value_parser = one_of(Accumulation::ALL, Accumulation::name),
        help_heading = "Painter quads")]
    pub(super) accumulate: Option<Accumulation>,
    /// Format of the sheets [default: f32 where the adapter blends it, otherwise f16]. With f16 alpha errs by 3e-4 to
    /// 4e-3, by up to 6e-2 if kernels grow, and scalars by 5e-4 of their range
    #[arg(long, value_name = "FORMAT", value_parser = one_of(Precision::ALL, Precision::name),
        help_heading = "Painter quads")]
    pub(super) precision: Option<Precision>,
    /// Largest error of the footprint table, 1e-7 to 0.1 of its peak [default: 1e-4 for f16, 1e-5 for f32]
    #[arg(long, value_name = "E", value_parser = parse::positive, allow_hyphen_values = true,
        help_heading = "Painter quads")]
    pub(super) table_error: Option<f64>,
    /// Rows and coefficients a row of the footprint table, 2 to 4096 and 4, 8, 12 or 16, in place of --table-error
    #[arg(long, value_name = "ROWSxTERMS", value_parser = parse::table, conflicts_with = "table_error",
        help_heading = "Painter quads")]
    pub(super) footprint_table: Option<[u32; 2]>,
    /// Sheets that one pass feeds: 1, 4 or 8 [default: what the adapter does best]
    #[arg(long, value_name = "N", help_heading = "Painter quads")]
    pub(super) sheets_per_pass: Option<u32>,

    /// How finely rays are spaced: capped (pre-shaded, 1 to 4 rays per voxel and axis, resampled to the picture, and
    /// own rays for pixels that would err) or full (a ray per pixel) [default: capped]
    #[arg(long, value_name = "HOW", value_parser = one_of(Resolution::ALL, Resolution::name),
        help_heading = "Painter tiles")]
    pub(super) resolution: Option<Resolution>,
}

/// What is drawn on the finished picture. A PNG has it, an EXR keeps the values of the volume's picture.
#[derive(Debug, clap::Args)]
pub(super) struct FigureArgs {
    /// Draw a bar of a round length; in perspective it is true at the depth of the target
    #[arg(long, help_heading = "Figure")]
    pub(super) scale_bar: bool,
    /// Draw the axes, with the letters of the patient (R/L, A/P, S/I) if the file states the orientation
    #[arg(long, help_heading = "Figure")]
    pub(super) axes: bool,
    /// Draw the colours of the transfer function over values, with a curve of its opacity
    #[arg(long, alias = "color-bar", help_heading = "Figure")]
    pub(super) colour_bar: bool,
    /// Draw a patch of colour and the name of each label that shows, or of each channel
    #[arg(long, help_heading = "Figure")]
    pub(super) legend: bool,
    /// Write TEXT above
    #[arg(long, value_name = "TEXT", help_heading = "Figure")]
    pub(super) title: Option<String>,
    /// Write TEXT below
    #[arg(long, value_name = "TEXT", help_heading = "Figure")]
    pub(super) caption: Option<String>,
    /// Unit of world lengths, such as mm [default: that of the file]
    #[arg(long, value_name = "UNIT", value_parser = NonEmptyStringValueParser::new(), requires = "scale_bar",
        help_heading = "Figure")]
    pub(super) length_unit: Option<String>,
    /// Unit of values, such as HU [default: that of the file]
    #[arg(long, value_name = "UNIT", value_parser = NonEmptyStringValueParser::new(), requires = "colour_bar",
        help_heading = "Figure")]
    pub(super) value_unit: Option<String>,
}

const RENDER_EXAMPLES: &str = "\
Examples:
  voxsplat render demo:marschner-lobb -o ml.png --kernel kaiser-bessel
  voxsplat render head.nii.gz -o head.png --azimuth -30 --elevation 15 --size 1920x1080
  voxsplat render ct.nrrd -o skull.png --transfer ct-bone --projection perspective --fov 40
  voxsplat render engine.raw -o engine.png --dims 256,256,128 --type u8 --transfer viridis
  voxsplat render ct.nrrd -o lit.png --transfer ct-bone --shading post --light headlight
  voxsplat render head.nii.gz -o half.png --clip R --light studio
  voxsplat render ct.nrrd -o film.png --model xray --response film --azimuth 90
  voxsplat render head.nii.gz -o truth.exr --reference --size 256
  voxsplat render ct.nrrd -o organs.png --labels organs.nrrd --label-table organs.ctbl --label all:0.5
  voxsplat render ct.nrrd -o figure.png --scale-bar --axes --colour-bar --value-unit HU --title 'A skull'";

/// Render a volume to a picture.
///
/// Angles are in degrees; world lengths are in the unit of the file, millimetres for most scans.
#[derive(Debug, clap::Args)]
#[command(after_help = RENDER_EXAMPLES)]
pub(super) struct RenderArgs {
    #[command(flatten)]
    pub(super) input: InputArgs,

    /// Picture to write: .png, 8 bits per channel, or .exr, 32-bit float with premultiplied alpha; - is a PNG on
    /// standard output. Needed, unless there is a --preview or a scene has outputs of its own
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    pub(super) output: Option<PathBuf>,
    /// Show the picture in the terminal: by kitty's or iTerm2's protocol if it is known to take either, otherwise in
    /// half blocks; put it after VOLUME
    #[arg(long, value_name = "HOW", num_args = 0..=1, default_missing_value = "auto", help_heading = "Output")]
    pub(super) preview: Option<Preview>,
    /// Pixels across and down, or one number for both; 1 to 32768
    #[arg(long, value_name = "WxH", default_value = "1024x1024", value_parser = parse::size, help_heading = "Output")]
    pub(super) size: [u32; 2],
    /// Render only a part of the picture of --size: W x H pixels, X and Y from its top left. The bytes are those of the
    /// whole picture there
    #[arg(long, value_name = "X,Y,W,H", value_parser = parse::region, conflicts_with_all = ["max_error", "verify"],
        help_heading = "Output")]
    pub(super) region: Option<Region>,
    /// Background of a PNG: #rrggbb, a name such as white, r,g,b in 0..1, or transparent
    #[arg(long, aliases = ["background-color", "bg-color"], value_name = "COLOUR", default_value = "black",
        value_parser = parse::library::<Background>,
        help_heading = "Output")]
    pub(super) background: Background,
    /// Write all options as a scene, FILE.json: `voxsplat render FILE.json -o PICTURE` makes the same picture
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub(super) save_scene: Option<PathBuf>,
    /// Write the transfer function too: .json for this program, .vp.json or .vp for 3D Slicer
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub(super) save_transfer: Option<PathBuf>,
    /// Print statistics and the time of each stage, as a table or as one JSON object; put it after VOLUME
    #[arg(long, value_name = "FORMAT", num_args = 0..=1, default_missing_value = "table", help_heading = "Output")]
    pub(super) stats: Option<StatsFormat>,

    #[command(flatten)]
    pub(super) figure: FigureArgs,
    #[command(flatten)]
    pub(super) view: ViewArgs,
    #[command(flatten)]
    pub(super) model: ModelArgs,
    #[command(flatten)]
    pub(super) layers: LayerArgs,
    #[command(flatten)]
    pub(super) painter: PainterArgs,

    /// Part of the name of the adapter to use; see `voxsplat devices` [default: the best]
    #[arg(long, value_name = "NAME", value_parser = NonEmptyStringValueParser::new(), help_heading = "Device")]
    pub(super) adapter: Option<String>,
    /// Choose the cheapest way to draw whose error is at most E, 0 to 1: no channel of 99.9 % of the covered pixels is
    /// off by more, as pixels traced by the f64 reference tell. Says on stderr what was chosen
    #[arg(long, value_name = "E", value_parser = parse::positive, allow_hyphen_values = true,
        conflicts_with = "reference", help_heading = "Accuracy")]
    pub(super) max_error: Option<f64>,
    /// Trace other pixels of the finished picture and print its error; the exit code is 1 if --max-error is broken
    #[arg(long, conflicts_with = "reference", help_heading = "Accuracy")]
    pub(super) verify: bool,
    /// Covered pixels that --max-error and --verify trace, spread evenly; all, if there are no more
    #[arg(long, value_name = "N", default_value_t = 4096, value_parser = clap::value_parser!(u32).range(64..),
        help_heading = "Accuracy")]
    pub(super) sample: u32,
    /// Integrate every ray in f64 on the CPU instead: slow, and exact to 1e-5 of a channel; options of painters and
    /// devices have no effect
    #[arg(long, help_heading = "Device")]
    pub(super) reference: bool,
}

const TURNTABLE_EXAMPLES: &str = "\
-o is DIR/{frame}.png or .exr (a file for each frame), FILE.gif (256 colours for all frames), FILE.apng, FILE.y4m,
FILE.html (a page that turns when it is dragged), or - for standard output. All options of render hold, and a scene is
taken in place of a volume.

Examples:
  voxsplat turntable head.nii.gz --frames 72 -o head.gif --size 512 --elevation 15
  voxsplat turntable ct.nrrd --frames 72 -o ct.html --size 512 --scale-bar
  voxsplat turntable ct.nrrd --frames 360 -o frames/{frame}.png --part 2/8 --resume
  voxsplat turntable ct.nrrd --frames 100 -o - --key-frames path.json | ffmpeg -i - ct.mp4
  voxsplat turntable heart.nii.gz --time all --turn 0 --rate 10 -o heart.gif";

/// Turn a volume: a picture or a frame of a film for each view.
#[derive(Debug, clap::Args)]
#[command(after_help = TURNTABLE_EXAMPLES)]
pub(super) struct TurntableArgs {
    #[command(flatten)]
    pub(super) render: RenderArgs,
    /// Frames of the whole turn. With a --time of several points in time they are spread over the frames [default: 36,
    /// or one for each point in time]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000),
        help_heading = "Turntable")]
    pub(super) frames: Option<u32>,
    /// Degrees that the eye goes around, from --azimuth on; the last frame is one step before the end. At 0 it stands
    /// still
    #[arg(long, value_name = "DEG", default_value_t = 360.0, value_parser = parse::number, allow_hyphen_values = true,
        help_heading = "Turntable")]
    pub(super) turn: f64,
    /// Views to go through in place of a turn: a JSON list of objects with frame (from 0) and any of azimuth,
    /// elevation, roll and zoom
    #[arg(long, value_name = "FILE", conflicts_with = "turn", help_heading = "Turntable")]
    pub(super) key_frames: Option<PathBuf>,
    /// Frames a second of a film, 0.1 to 1000
    #[arg(long, value_name = "N", default_value_t = 25.0, value_parser = parse::positive, allow_hyphen_values = true,
        help_heading = "Turntable")]
    pub(super) rate: f64,
    /// Format of a film, gif, apng, y4m or html [default: by the name of the file; y4m for -]
    #[arg(long, value_name = "FORMAT", value_parser = one_of(Format::ALL, Format::name), help_heading = "Turntable")]
    pub(super) format: Option<Format>,
    /// Make the I-th of N parts of the frames, for batch systems
    #[arg(long, value_name = "I/N", value_parser = parse::part, help_heading = "Turntable")]
    pub(super) part: Option<[u32; 2]>,
    /// Leave out frames whose files are there
    #[arg(long, help_heading = "Turntable")]
    pub(super) resume: bool,
}

const PARETO_EXAMPLES: &str = "\
Examples:
  voxsplat pareto demo:vessels:128 -o vessels
  voxsplat pareto ct.nrrd -o ct --transfer ct-bone --light headlight --projection perspective
  voxsplat pareto ct.nrrd -o ct --transfer ct-bone --light headlight --projection perspective --resume";

/// Draw a volume in many ways, time each, measure its error against the f64 reference, and report which are worth it.
///
/// Painters, density of rays, level of the lattice, sheets, footprint tables, termination, shading and kernels are
/// varied. DIR gets report.html with the plots, the front as command lines to copy, and pictures of differences; the
/// plots as .svg; all numbers as pareto.csv and pareto.json.
#[derive(Debug, clap::Args)]
#[command(after_help = PARETO_EXAMPLES)]
pub(super) struct ParetoArgs {
    #[command(flatten)]
    pub(super) input: InputArgs,

    /// Directory of the report; it is made if there is none
    #[arg(short, long, value_name = "DIR", help_heading = "Output")]
    pub(super) output: PathBuf,
    /// Pixels across and down, or one number for both; 1 to 32768
    #[arg(long, value_name = "WxH", default_value = "512x512", value_parser = parse::size, help_heading = "Output")]
    pub(super) size: [u32; 2],
    /// Views: the one asked for, and others from around the volume; 1 to 16
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=16),
        help_heading = "Measurement")]
    pub(super) views: u32,
    /// Timed frames of each view, each after a frame that is not timed; 1 to 100
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=100),
        help_heading = "Measurement")]
    pub(super) repeats: u32,
    /// Pixels of each view that the reference traces, spread evenly; more than the picture has: all
    #[arg(long, value_name = "N", default_value_t = 4096, value_parser = clap::value_parser!(u32).range(16..),
        help_heading = "Measurement")]
    pub(super) sample: u32,
    /// Seconds of a frame beyond which a way to draw is not timed again
    #[arg(long, value_name = "SECONDS", default_value_t = 5.0, value_parser = parse::positive,
        allow_hyphen_values = true, help_heading = "Measurement")]
    pub(super) patience: f64,
    /// Go on with what an interrupted run of the same command has measured
    #[arg(long, help_heading = "Measurement")]
    pub(super) resume: bool,
    /// Show other renderers in the plot: a JSON array of objects with name, seconds (of a frame) and rms (error against
    /// their own truth)
    #[arg(long, value_name = "FILE", help_heading = "Measurement")]
    pub(super) rivals: Option<PathBuf>,
    #[command(flatten)]
    pub(super) figure: FigureArgs,
    #[command(flatten)]
    pub(super) view: ViewArgs,
    #[command(flatten)]
    pub(super) model: ModelArgs,
    /// Part of the name of the adapter to use; see `voxsplat devices` [default: the best]
    #[arg(long, value_name = "NAME", value_parser = NonEmptyStringValueParser::new(), help_heading = "Device")]
    pub(super) adapter: Option<String>,
}

/// Show the properties of a volume file, its histogram, and the command line that renders it.
#[derive(Debug, clap::Args)]
pub(super) struct InfoArgs {
    #[command(flatten)]
    pub(super) input: InputArgs,
    /// List labels with their colours, voxels and volumes in place of the rest
    #[arg(long, help_heading = "Labels")]
    pub(super) labels: bool,
    /// Names, colours and opacities of labels, as for render
    #[arg(long, value_name = "FILE", requires = "labels", help_heading = "Labels")]
    pub(super) label_table: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long, help_heading = "Output")]
    pub(super) json: bool,
}

const KERNELS_EXAMPLES: &str = "\
Examples:
  voxsplat kernels
  voxsplat kernels --signal shepp-logan --size 64
  voxsplat kernels --kernel gaussian:0.7,2 --sharpness 0.5 --json";

/// Show how well kernels reconstruct a signal that is known everywhere, with the usual interpolations beside them.
///
/// Errors of the field are at points at least a voxel inside the outermost samples; errors of rays are of its mean
/// along rays through that box. Ripple is the largest less the least value of a field of samples that are all 1. Blur
/// is a variance along an axis, in voxels^2. Half Nyquist is what is left of waves that are four samples long. Noise
/// is that of the field over that of the samples.
#[derive(Debug, clap::Args)]
#[command(after_help = KERNELS_EXAMPLES)]
pub(super) struct KernelsArgs {
    /// The signal: marschner-lobb, gaussians or shepp-logan
    #[arg(long, value_name = "SIGNAL", default_value = "marschner-lobb",
        value_parser = one_of(Signal::ALL, Signal::name))]
    pub(super) signal: Signal,
    /// Samples along each axis, 8 to 256
    #[arg(long, value_name = "N", default_value_t = 40)]
    pub(super) size: u32,
    /// The kernel, as for render [default: gaussian and kaiser-bessel]
    #[arg(long, value_name = "KERNEL", value_parser = parse::kernel)]
    pub(super) kernel: Option<Kernel>,
    /// The sharpness, 0 to 1 [default: 0, 0.5 and 1]
    #[arg(long, value_name = "S", value_parser = parse::number, allow_hyphen_values = true)]
    pub(super) sharpness: Option<f64>,
    /// Print a JSON array of objects
    #[arg(long)]
    pub(super) json: bool,
}

/// Compare two pictures. The exit code is 1 if a pixel differs by more than the tolerance.
#[derive(Debug, clap::Args)]
pub(super) struct CompareArgs {
    /// A picture, .png or .exr
    pub(super) a: PathBuf,
    /// A picture of the same size
    pub(super) b: PathBuf,
    /// Largest tolerated difference of a channel; channels run from 0 to 1, so an 8-bit step is 0.00392
    #[arg(long, value_name = "T", default_value_t = 0.0, value_parser = parse::tolerance, allow_hyphen_values = true)]
    pub(super) tolerance: f64,
    /// Write the difference, multiplied by ten, as a picture
    #[arg(long, value_name = "FILE")]
    pub(super) difference: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    pub(super) json: bool,
}
