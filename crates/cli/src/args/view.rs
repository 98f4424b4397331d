//! The view.

use clap::ValueEnum;
use glam::DVec3;
use voxsplat::appearance::Framing;

use crate::parse::{self, one_of};

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ProjectionArg {
    Orthographic,
    Perspective,
}

/// The view.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "View")]
pub(crate) struct ViewArgs {
    /// Turn the eye about the up direction by DEG degrees from the front of the volume
    ///
    /// [default: 0; render uses 30 for a file without orientation, unless an option sets the view]
    #[arg(long, alias = "camera-azimuth-angle", value_name = "DEG", value_parser = parse::number)]
    pub(crate) azimuth: Option<f64>,
    /// Raise the eye towards the up direction by DEG degrees
    ///
    /// [default: 0; 20 if the azimuth is 30 by default]
    #[arg(long, alias = "camera-elevation-angle", value_name = "DEG", value_parser = parse::number)]
    pub(crate) elevation: Option<f64>,
    /// Rotate the camera about its viewing direction by DEG degrees, counter-clockwise
    #[arg(long, value_name = "DEG", default_value_t = 0.0, value_parser = parse::number)]
    pub(crate) roll: f64,
    /// World direction that points up in the picture [default: 0,0,1]
    #[arg(long, alias = "camera-view-up", value_name = "X,Y,Z", value_parser = parse::vector)]
    pub(crate) up: Option<DVec3>,
    /// World direction from the eye to the target, in place of azimuth and elevation
    #[arg(long, alias = "camera-direction", value_name = "X,Y,Z", value_parser = parse::vector,
        conflicts_with_all = ["azimuth", "elevation"])]
    pub(crate) direction: Option<DVec3>,
    /// World point at the centre of the picture [default: the centre of the framed region]
    #[arg(long, alias = "camera-focal-point", value_name = "X,Y,Z", value_parser = parse::vector)]
    pub(crate) target: Option<DVec3>,
    /// Parallel rays (orthographic), or rays through one eye (perspective)
    #[arg(long, value_name = "KIND", default_value = "orthographic", hide_possible_values = true)]
    pub(crate) projection: ProjectionArg,
    /// Perspective: vertical field of view in degrees, over 0 and under 180 [default: 30]
    #[arg(long, alias = "camera-view-angle", value_name = "DEG", value_parser = parse::positive)]
    pub(crate) fov: Option<f64>,
    /// Magnify by F, over 0
    #[arg(long, alias = "camera-zoom-factor", value_name = "F", default_value_t = 1.0, value_parser = parse::positive)]
    pub(crate) zoom: f64,
    /// Fit the picture to the visible voxels as large as this view permits (view), to the visible voxels at one size
    /// for every azimuth (visible), or to the box of the lattice (volume). A colour bar, a title and a caption then lie
    /// over the picture, and change no pixel beside them
    ///
    /// [default: view for one picture, visible for a series (turntable, pareto, plan, a scene with several outputs),
    /// both beside these parts of a figure; volume with --target, --view-height or --distance]
    #[arg(long, value_name = "WHAT", value_parser = one_of(Framing::ALL, Framing::name))]
    pub(crate) frame: Option<Framing>,
    /// Margin around the framed region: a fraction of the picture on each side, 0 to under 0.5 [default: 0.02]
    #[arg(long, value_name = "FRACTION", value_parser = parse::tolerance)]
    pub(crate) margin: Option<f64>,
    /// World height that the picture spans at the target [default: the framed region just fits]
    #[arg(long, value_name = "LENGTH", value_parser = parse::positive)]
    pub(crate) view_height: Option<f64>,
    /// Perspective: world distance from the eye to the target [default: the framed region just fits]
    #[arg(long, value_name = "LENGTH", value_parser = parse::positive)]
    pub(crate) distance: Option<f64>,
    /// Whether the view is one of a series, as a command decides.
    #[arg(skip)]
    pub(crate) in_series: bool,
}

impl ViewArgs {
    /// Returns whether no option sets the framed region or its size.
    pub(crate) fn fits_by_default(&self) -> bool {
        let Self { target, zoom, frame, margin, view_height, distance, .. } = self;
        let given = [margin, view_height, distance].into_iter().any(Option::is_some);
        !given && target.is_none() && frame.is_none() && *zoom == 1.0
    }

    /// Returns whether no option sets the viewing direction or the up direction.
    pub(crate) fn says_no_side(&self) -> bool {
        let Self { azimuth, elevation, roll, up, direction, .. } = self;
        azimuth.is_none() && elevation.is_none() && *roll == 0.0 && up.is_none() && direction.is_none()
    }
}
