//! The contents of a picture, and its light.

use std::path::PathBuf;

use voxsplat::kernel::Kernel;
use voxsplat::lighting::Normals;
use voxsplat::program::{ClipSpec, GradientSpec, IsosurfaceSpec, LabelSpec, LightSpec, OcclusionSpec, ShadowSpec};
use voxsplat::settings::{Level, Model, Response, Shading};
use voxsplat::transfer::maps;
use voxsplat::transfer::presets::{PRESETS, PresetValues};
use voxsplat::transfer::{Classification, Window};

use crate::parse::{self, Spelled, one_of};
use crate::tune::{TuneArg, tune};

/// Returns the help of `--transfer`: presets and colour maps as the library lists them.
fn transfer_help() -> String {
    let presets: Vec<&str> = PRESETS.iter().map(|preset| preset.name).collect();
    format!(
        "Transfer function: a preset, a file, a colour map or labels [default: the preset that suits the data, labels \
         too; see `voxsplat info`]\n\n\
         Presets, which adapt to the data: {}.\n\n\
         Files: this program's JSON, ParaView's JSON or XML, Slicer's .vp, .vp.json or presets.xml, niivue's or \
         napari's JSON; #NAME chooses from a file of several.\n\n\
         map:NAME or map:FILE: the colours of a map over --window, with a gentle ramp of opacity. Maps: {}.\n\n\
         labels: the values are labels.",
        presets.join(", "),
        maps::names().join(", ")
    )
}

/// The contents of a picture, and its light.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Model")]
pub(crate) struct ModelArgs {
    /// Transfer function: a preset such as ct-bone, a file, map:NAME or labels
    #[arg(long, value_name = "PRESET|FILE[#NAME]|map:NAME", long_help = transfer_help())]
    pub(crate) transfer: Option<PathBuf>,
    /// Map the transfer function to the values LEVEL - WIDTH/2 to LEVEL + WIDTH/2
    ///
    /// [default: the values that the file states; for colour maps, the values of the foreground]
    #[arg(long, value_name = "LEVEL,WIDTH", value_parser = parse::window)]
    pub(crate) window: Option<Window>,
    /// Place the points of a preset at absolute values (Hounsfield units for CT and angiography, scores for
    /// activation), or fit them to the histogram (fitted)
    ///
    /// auto: absolute if the file states these units, or if the values look like Hounsfield units; otherwise fitted. A
    /// unit of --units is a label, and changes no value.
    #[arg(long, value_name = "auto|absolute|fitted", default_value = "auto", hide_possible_values = true,
        value_parser = one_of(PresetValues::ALL, PresetValues::name))]
    pub(crate) transfer_values: PresetValues,
    /// Gradient opacity: multiply opacities by O, 0 to 1, if the value changes by M per world unit; linear between the
    /// points, constant beyond them. Flat interiors become clear and surfaces stay. Or off [default: the transfer
    /// function's]
    #[arg(long, value_name = "M:O,M:O,..|off", value_parser = parse::library::<GradientSpec>)]
    pub(crate) gradient_opacity: Option<GradientSpec>,
    /// Show the isosurface of a value, in a colour and with an opacity over 0 to 1: alone, or within what --transfer
    /// shows; repeatable
    ///
    /// The surface has no thickness, and its opacity is the same from all directions. The picture is post-shaded, but
    /// with --overlay and --labels pre-shaded, by the processor. [default: a colour of the library, opacity 1]
    #[arg(long, value_name = "VALUE[:COLOUR[:OPACITY]]", value_parser = parse::library::<IsosurfaceSpec>,
        allow_hyphen_values = true)]
    pub(crate) iso: Vec<IsosurfaceSpec>,
    /// How pre-shading classifies the values of a volume: at each voxel (point), or as the mean over the values around
    /// it (band-limited), by which smooth surfaces have no rings
    ///
    /// auto: point for a transfer function with steps, otherwise band-limited. Further channels and overlays are auto.
    /// [default: the transfer function's, auto if it says nothing]
    #[arg(long, value_name = "auto|point|band-limited", hide_possible_values = true,
        value_parser = one_of(Classification::ALL, Classification::name))]
    pub(crate) classification: Option<Classification>,
    /// Model of a pixel: composite, xray, mip, minip or average
    ///
    /// composite is emission and absorption, xray absorption only (white), mip the largest value of the ray, minip the
    /// smallest, average the mean; the transfer function colours the last three.
    #[arg(long, value_name = "MODEL", default_value = "composite", value_parser = one_of(Model::ALL, Model::name),
        hide_possible_values = true)]
    pub(crate) model: Model,
    /// X-ray: show the optical depth of a ray as absorption (white of alpha 1 - exp(-depth)), window (grey, linear from
    /// black at depth LOW to white at HIGH: 0,4), film (radiographic film on a light box: exposure relative to half
    /// density, and contrast: 4,3) or depth (the optical depth itself, for an .exr)
    #[arg(long, value_name = "absorption|window[:LOW,HIGH]|film[:EXPOSURE,GAMMA]|depth", default_value = "absorption",
        value_parser = parse::library::<Response>)]
    pub(crate) response: Response,
    /// Projections mip and minip: colour values by depth, from red (nearest) to violet (farthest); the transfer
    /// function sets the brightness
    #[arg(long)]
    pub(crate) depth_coded: bool,
    /// Projection mip: dim distant values by up to exp(-A) at the far end of the box; A from 0 to 20
    #[arg(long, value_name = "A", default_value_t = 0.0, value_parser = parse::number)]
    pub(crate) attenuation: f64,
    /// Classify and light voxels before reconstruction (pre: fast) or pixels after it (post: sharp)
    #[arg(long, value_name = "WHEN", default_value = "pre", value_parser = one_of(Shading::ALL, Shading::name),
        hide_possible_values = true)]
    pub(crate) shading: Shading,
    /// Light surfaces: off, headlight, studio, AZ,EL in degrees, or @X,Y,Z in the world
    ///
    /// headlight shines from the eye, AZ,EL from the position of an eye at that azimuth and elevation, @X,Y,Z from a
    /// point, equally bright at any distance. studio is a key, a fill and a rim light around the view, with soft
    /// shadows and ambient occlusion; in a turntable it stands still, and studio:eye follows the eye. Repeat the option
    /// for up to 4 lights. All but studio and off take :INTENSITY or :COLOUR.
    ///
    /// [default: studio if render uses a preset or a built-in volume that shows surfaces, otherwise off]
    #[arg(long, value_name = "LIGHT", value_parser = parse::spelled::<LightSpec>)]
    pub(crate) light: Vec<Spelled<LightSpec>>,
    /// Material of lit surfaces: ambient, diffuse and specular reflection, 0 to 1, and shininess, 1 to 1000
    /// [default: 0.3,0.7,0.2,24; studio 0.4,0.7,0.2,24; render uses the material of the preset or built-in volume]
    #[arg(long, value_name = "A,D,S,N", value_parser = parse::material)]
    pub(crate) material: Option<[f64; 4]>,
    /// Clip the volume: keep one side of a plane, a box or some voxels
    ///
    /// NX,NY,NZ keeps the half in that world direction, of a plane through the middle of the volume; NX,NY,NZ,D puts
    /// the plane at the distance D from the origin of the world, NX,NY,NZ,X,Y,Z through the point X,Y,Z. L, R, A, P, S
    /// or I keeps that half of the patient. box:X0,X1,Y0,Y1,Z0,Z1 keeps a box of the world; -inf and inf leave a side
    /// open. voxels:I0:I1,J0:J1,K0:K1 keeps the cells of voxels I0 to I1 - 1 along the first axis of the lattice,
    /// counted from 0, and so on; a missing number is the end of the volume (voxels:10:20,:,40:). Repeat the option to
    /// keep what all leave; up to 8 planes, 6 of them for a box.
    #[arg(long, alias = "clip-plane", value_name = "PLANE|SIDE|box:..|voxels:..",
        value_parser = parse::library::<ClipSpec>)]
    pub(crate) clip: Vec<ClipSpec>,
    /// Shadows of the first three lights at AZ,EL or @X,Y,Z: on, off, or their strength, 0 to 1 [default: off; studio
    /// 0.85]. exact or exact:STRENGTH sums all kernels on each ray to a light, and for occlusion: about ten times
    /// slower
    #[arg(long, value_name = "on|off|STRENGTH|exact", value_parser = parse::library::<ShadowSpec>)]
    pub(crate) shadows: Option<ShadowSpec>,
    /// Angular size of lights at AZ,EL, degrees, 0 to 90: larger lights cast softer shadows [default: 0; studio 10]
    #[arg(long, value_name = "DEGREES", value_parser = parse::number)]
    pub(crate) light_size: Option<f64>,
    /// Ambient occlusion: voxels within RADIUS voxels dim each other's ambient light, or off [default: off; studio 8]
    #[arg(long, value_name = "RADIUS|off", value_parser = parse::library::<OcclusionSpec>)]
    pub(crate) occlusion: Option<OcclusionSpec>,
    /// Normals of voxels in pre-shaded light: gradient, or tensor, the dominant axis of gradients around a voxel, which
    /// has no specks on thin layers in noise [default: tensor]
    #[arg(long, value_name = "gradient|tensor", hide_possible_values = true,
        value_parser = one_of(Normals::ALL, Normals::name))]
    pub(crate) normals: Option<Normals>,
    /// Reconstruction kernel, lengths in voxels: gaussian[:SIGMA,RADIUS] (1,2) or kaiser-bessel[:RADIUS,ALPHA] (2,10.4)
    /// [default: gaussian]
    #[arg(long, value_name = "KERNEL", value_parser = parse::library::<Kernel>)]
    pub(crate) kernel: Option<Kernel>,
    /// Undo the blur of the kernel: 0 (not at all) to 1; noise grows. A Gaussian becomes a narrower Kaiser-Bessel blob.
    /// Post-shaded pictures, mip, minip and average also filter the samples so that the field interpolates them
    /// [default: 0; render uses 0.5 for surfaces of a preset or a built-in volume, unless --kernel is given]
    #[arg(long, value_name = "S", value_parser = parse::number)]
    pub(crate) sharpness: Option<f64>,
    /// Level of detail: cells of 2^N voxels along each axis in place of voxels, N 0 to 12; auto uses the coarsest cells
    /// (also between two levels, of 3 * 2^N / 2 voxels) that change a pre-shaded picture by at most 2 of 255 (rms), and
    /// a post-shaded one about as little
    #[arg(long, value_name = "N|auto", default_value = "auto", value_parser = parse::library::<Level>)]
    pub(crate) level: Level,
    /// Knobs of painters, sheets, footprint tables, shadows and readers; --tune help lists them
    #[arg(long, value_name = "KEY=VALUE,..", value_parser = tune, help_heading = "Tuning")]
    pub(crate) tune: Vec<TuneArg>,
}

/// Labels, a mask and overlays.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Labels and overlays")]
pub(crate) struct LayerArgs {
    /// Draw the labels of another volume too
    ///
    /// Extinctions add. On another lattice each voxel gets the label of the nearest voxel. Label 0 is clear. Labels are
    /// pre-shaded. (For a volume of labels alone: --transfer labels.)
    #[arg(long, value_name = "FILE")]
    pub(crate) labels: Option<PathBuf>,
    /// Names, colours and opacities of labels: an ITK-SNAP label description, a 3D Slicer colour table (.ctbl, .csv), a
    /// FreeSurfer lookup table or a BIDS .tsv [default: the table of a .seg.nrrd, otherwise distinct colours]
    #[arg(long, value_name = "FILE")]
    pub(crate) label_table: Option<PathBuf>,
    /// Change the looks of labels, such as all:0.2, 3:on or 1,4,7-9:red
    ///
    /// WHICH is all, numbers (1,4,7-9) or a name of the table. LOOK is an opacity from 0 to 1, xF (multiply the opacity
    /// by F, 0 to 1), on, off or a colour. Repeat the option; later changes apply to the result of earlier ones:
    /// --label all:0.2 --label 3:on.
    #[arg(long, value_name = "WHICH:LOOK", value_parser = parse::library::<LabelSpec>)]
    pub(crate) label: Vec<LabelSpec>,
    /// Show the volume only inside another volume's labels other than 0, or inside LABELS (1,4,7-9); on another lattice
    /// the nearest voxel counts
    #[arg(long, value_name = "FILE[:LABELS]")]
    pub(crate) mask: Option<PathBuf>,
    /// Draw another volume over the volume, such as an activation map over a brain or PET over CT; repeat the option
    /// for more
    ///
    /// Each file lies in its own place and lattice: the finest one is drawn, and values are interpolated onto it.
    /// TRANSFER is two-sided (values over LO hot, under -LO cold), hot, a colour, labels or what --transfer takes; HI
    /// has the brightest colour. Without --transfer the volume below is grey and translucent.
    ///
    /// [default: two-sided for statistics, hot for PET and other positive maps, labels for segmentations, otherwise a
    /// colour for each]
    #[arg(long, value_name = "FILE[:TRANSFER][@LO..HI]")]
    pub(crate) overlay: Vec<PathBuf>,
}
