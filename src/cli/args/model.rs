//! What a picture shows, and how it is made.

use std::path::PathBuf;

use clap::ValueEnum;
use voxsplat::clip::Clip;
use voxsplat::kernel::{Kernel, Normalization};
use voxsplat::settings::{Interslice, Level, Model, Response, Shading};
use voxsplat::transfer::Window;

use crate::cli::clip::{self, ClipArg, Voxels};
use crate::cli::layers::{LabelArg, label};
use crate::cli::parse::{self, GradientFloor, GradientOpacity, LightArg, Occlusion, one_of};

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum SwitchArg {
    On,
    Off,
}

/// What a picture shows.
#[derive(Debug, clap::Args)]
pub(in crate::cli) struct ModelArgs {
    /// Transfer function: a preset that adapts to the data (ct-bone, ct-skin, ct-muscle, ct-soft-tissue, ct-lung,
    /// angiography, mri, mr-brain, pet, activation, fluorescence, field, grayscale, gray, viridis or inferno), or a
    /// file: this program's JSON, ParaView's JSON or XML, Slicer's .vp, .vp.json or presets.xml, niivue's or napari's
    /// JSON; #NAME chooses from a file of several; or labels: values are labels [default: suggested by the
    /// data, labels too; see `voxsplat info`]
    #[arg(long, value_name = "FILE[#NAME]|PRESET", help_heading = "Model")]
    pub(in crate::cli) transfer: Option<PathBuf>,
    /// The colours of a map over --window, with a gentle ramp of opacity: gray, viridis, inferno, magma, plasma,
    /// cividis or turbo; of Crameri batlow, batlowK, devon, oslo, lajolla, lipari, navia, hawaii, acton, tokyo, davos,
    /// vik, roma, berlin or cork; of cmocean thermal, haline, solar, ice, deep, dense, matter, amp, balance or curl; or
    /// of a file as for --transfer
    #[arg(long, alias = "color-map", value_name = "NAME|FILE", conflicts_with = "transfer", help_heading = "Model")]
    pub(in crate::cli) colour_map: Option<PathBuf>,
    /// Values from LEVEL - WIDTH/2 to LEVEL + WIDTH/2: there begins and ends the transfer function or the colour map
    /// [default: as the file states; of colour maps, the values of the foreground]
    #[arg(long, value_name = "LEVEL,WIDTH", value_parser = parse::window, allow_hyphen_values = true,
        help_heading = "Model")]
    pub(in crate::cli) window: Option<Window>,
    /// Gradient opacity: opacities are multiplied by O, 0 to 1, where the value changes by M per world unit; linear
    /// between the points, and constant beyond them. So flat insides become clear and surfaces stay. Or off
    /// [default: what the transfer function has]
    #[arg(long, value_name = "M:O,M:O,..|off", value_parser = parse::gradient_opacity, help_heading = "Model")]
    pub(in crate::cli) gradient_opacity: Option<GradientOpacity>,
    /// A floor under which a gradient is noise, value per world unit: a colour whose gradient is g long is lit as a
    /// surface with the weight g^2 / (g^2 + F^2), and with the rest shown as one without a surface, so that flat noisy
    /// matter does not sparkle. auto is twice the gradient that noise makes, as far as the data tell; 0 is none
    /// [default: what the transfer function has]
    #[arg(long, value_name = "F|auto", value_parser = parse::gradient_floor, help_heading = "Model")]
    pub(in crate::cli) gradient_floor: Option<GradientFloor>,
    /// What a pixel is: composite (emission and absorption), xray (absorption only, white), mip (the largest value of
    /// its ray, coloured by the transfer function), minip (the smallest) or average (the mean)
    #[arg(long, value_name = "MODEL", default_value = "composite", value_parser = one_of(Model::ALL, Model::name),
        help_heading = "Model")]
    pub(in crate::cli) model: Model,
    /// X-ray: what a pixel shows of the optical depth of its ray: absorption (white of alpha 1 - exp(-depth)), window
    /// (grey, linear from black at depth LOW to white at HIGH: 0,4), film (radiographic film on a light box: its
    /// exposure, over that of half its density, and its contrast: 4,3), or depth (the depth itself, for an .exr)
    #[arg(long, value_name = "absorption|window[:LOW,HIGH]|film[:EXPOSURE,GAMMA]|depth", default_value = "absorption",
        value_parser = parse::response, help_heading = "Model")]
    pub(in crate::cli) response: Response,
    /// Projections mip and minip: colours tell how deep the value lies, from red (nearest) to violet (farthest); the
    /// transfer function tells how bright they are
    #[arg(long, help_heading = "Model")]
    pub(in crate::cli) depth_coded: bool,
    /// Projection mip: what is farther away counts less, down to exp(-A) of itself at the far end of the box, 0 to 20
    #[arg(long, value_name = "A", default_value_t = 0.0, value_parser = parse::number, help_heading = "Model")]
    pub(in crate::cli) attenuation: f64,
    /// Classify and light voxels before reconstruction (pre: fast) or pixels after it (post: sharp)
    #[arg(long, value_name = "WHEN", default_value = "pre", value_parser = one_of(Shading::ALL, Shading::name),
        help_heading = "Model")]
    pub(in crate::cli) shading: Shading,
    /// Light surfaces: off, headlight (from the eye), AZ,EL (from the position of an eye at that azimuth and elevation,
    /// degrees), @X,Y,Z (at a place in the world, as bright at any distance), or studio (key, fill and rim light around
    /// the view, soft shadows, occlusion; in a turntable it stands still, and studio:eye comes along with the eye).
    /// Repeat the option for up to 4 lights; :INTENSITY or :#RRGGBB behind all but the last changes them [default:
    /// studio for `render` by a preset that shows surfaces; otherwise off]
    #[arg(long, value_name = "LIGHT", value_parser = parse::light, allow_hyphen_values = true, help_heading = "Model")]
    pub(in crate::cli) light: Vec<LightArg>,
    /// Material of lit surfaces: ambient, diffuse and specular share, 0 to 1, and shininess, 1 to 1000
    /// [default: 0.3,0.7,0.2,24; studio 0.4,0.7,0.2,24; `render` takes that of a preset that shows surfaces]
    #[arg(long, value_name = "A,D,S,N", value_parser = parse::material, help_heading = "Model")]
    pub(in crate::cli) material: Option<[f64; 4]>,
    /// Cut away what lies beyond a plane. What lies in the world direction NX,NY,NZ stays: of a plane through the
    /// middle of the volume, at the distance D from the origin of the world, or through the point X,Y,Z. Or the side
    /// of the patient that stays: L, R, A, P, S or I. Repeat the option for more planes, 8 with those of boxes
    #[arg(long, alias = "clip-plane", value_name = "NX,NY,NZ[,D|,X,Y,Z]|SIDE", value_parser = clip::clip,
        allow_hyphen_values = true, help_heading = "Model")]
    pub(in crate::cli) clip: Vec<ClipArg>,
    /// Cut away what lies outside of a box of the world; -inf and inf leave a side open
    #[arg(long, value_name = "X0,X1,Y0,Y1,Z0,Z1", value_parser = clip::clip_box, allow_hyphen_values = true,
        help_heading = "Model")]
    pub(in crate::cli) clip_box: Option<Clip>,
    /// Cut away what lies outside of the cells of some voxels: from I0 to before I1 along the first axis of the
    /// lattice, counted from 0, and so on. Without a number a range reaches to the face of the volume: 10:20,:,40:
    #[arg(long, value_name = "I0:I1,J0:J1,K0:K1", value_parser = clip::crop, help_heading = "Model")]
    pub(in crate::cli) crop: Option<[Voxels; 3]>,
    /// Shadows of the first three lights given by AZ,EL or @X,Y,Z: on, off, or their strength, 0 to 1 [default: off;
    /// studio 0.85]
    #[arg(long, value_name = "on|off|STRENGTH", value_parser = parse::strength, help_heading = "Model")]
    pub(in crate::cli) shadows: Option<f64>,
    /// How far from a voxel shadows and occlusion begin, voxels, 0 to 16. Nearer matter keeps no light from it, so
    /// opaque surfaces that face a light are lit; at 0 they lie in their own shadow [default: 1.5]
    #[arg(long, value_name = "VOXELS", value_parser = parse::number, help_heading = "Model")]
    pub(in crate::cli) shadow_bias: Option<f64>,
    /// How large lights given by AZ,EL appear, across, degrees, 0 to 90: shadows become soft [default: 0; studio 10]
    #[arg(long, value_name = "DEGREES", value_parser = parse::number, help_heading = "Model")]
    pub(in crate::cli) light_size: Option<f64>,
    /// Ambient occlusion: voxels take the ambient light from each other within so many voxels, or off
    /// [default: off; studio 8]
    #[arg(long, value_name = "RADIUS|off", value_parser = parse::occlusion, help_heading = "Model")]
    pub(in crate::cli) occlusion: Option<Occlusion>,
    /// Reconstruction kernel, lengths in voxels: gaussian[:SIGMA,RADIUS] (1,2) or kaiser-bessel[:RADIUS,ALPHA] (2,10.4)
    /// [default: gaussian]
    #[arg(long, value_name = "KERNEL", value_parser = parse::kernel, help_heading = "Model")]
    pub(in crate::cli) kernel: Option<Kernel>,
    /// Take the blur of the kernel back: 0 (not at all) to 1. A Gaussian gives way to a narrower Kaiser-Bessel blob;
    /// with --shading post, --model mip, minip or average samples are filtered besides, so that the field passes
    /// through them. Noise grows [default: 0; `render` takes 0.5 for a preset that shows surfaces, pre-shaded, if no
    /// kernel is asked for]
    #[arg(long, value_name = "S", value_parser = parse::number, allow_hyphen_values = true, help_heading = "Model")]
    pub(in crate::cli) sharpness: Option<f64>,
    /// Divisor of sums of kernels: the kernel's integral (unit), or its peak of 1 (historical, denser)
    #[arg(long, value_name = "HOW", default_value = "unit",
        value_parser = one_of(Normalization::ALL, Normalization::name), help_heading = "Model")]
    pub(in crate::cli) normalization: Normalization,
    /// Post-shading: classify a sheet by the parabola through it and its neighbours, or (historical) by its mean
    #[arg(long, value_name = "HOW", default_value = "parabola",
        value_parser = one_of(Interslice::ALL, Interslice::name), help_heading = "Model")]
    pub(in crate::cli) interslice: Interslice,
    /// Early termination: skip splats that at most this fraction of the light reaches, 0 (off) to under 1; no channel
    /// changes by more than that fraction
    #[arg(long, value_name = "FRACTION", default_value_t = 1e-3, value_parser = parse::tolerance,
        allow_hyphen_values = true, help_heading = "Model")]
    pub(in crate::cli) termination: f64,
    /// Enlarge the kernels of voxels that are closer together than pixels
    #[arg(long, value_name = "WHETHER", default_value = "on", help_heading = "Model")]
    pub(in crate::cli) antialiasing: SwitchArg,
    /// Cells of 2^N voxels along each axis in place of voxels, N 0 to 12; auto takes the coarsest that change a
    /// pre-shaded picture by at most 2 of 255 (rms), and post-shaded mostly as little
    #[arg(long, value_name = "N|auto", default_value = "auto", value_parser = parse::level, help_heading = "Model")]
    pub(in crate::cli) level: Level,
}

/// Labels, and what of the volume shows.
#[derive(Debug, clap::Args)]
pub(in crate::cli) struct LayerArgs {
    /// Draw the labels of a volume too; extinctions add. On another lattice, the nearest voxel counts. (A volume of
    /// labels alone: --transfer labels.) Label 0 is clear. Pre-shaded
    #[arg(long, value_name = "FILE", help_heading = "Labels")]
    pub(in crate::cli) labels: Option<PathBuf>,
    /// Names, colours and opacities of labels: an ITK-SNAP label description, a 3D Slicer colour table (.ctbl, .csv), a
    /// FreeSurfer lookup table or a BIDS .tsv [default: those of a .seg.nrrd, otherwise distinct colours]
    #[arg(long, value_name = "FILE", help_heading = "Labels")]
    pub(in crate::cli) label_table: Option<PathBuf>,
    /// What labels look like: WHICH is all, numbers (1,4,7-9) or a name of the table, LOOK an opacity from 0 to 1, on,
    /// off or a colour. Repeat the option; later ones win: --label all:0.2 --label 3:on
    #[arg(long, value_name = "WHICH:LOOK", value_parser = label, allow_hyphen_values = true, help_heading = "Labels")]
    pub(in crate::cli) label: Vec<LabelArg>,
    /// Multiply the opacities of all labels by F, 0 to 1
    #[arg(long, value_name = "F", value_parser = parse::number, help_heading = "Labels")]
    pub(in crate::cli) label_opacity: Option<f64>,
    /// Show the volume only where another one has a label other than 0, or one of LABELS (1,4,7-9); on another lattice,
    /// the nearest voxel counts
    #[arg(long, value_name = "FILE[:LABELS]", help_heading = "Labels")]
    pub(in crate::cli) mask: Option<PathBuf>,
}
