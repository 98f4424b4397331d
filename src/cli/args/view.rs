//! Where the eye is, and what it sees.

use clap::ValueEnum;
use glam::DVec3;

use crate::cli::parse;

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum ProjectionArg {
    Orthographic,
    Perspective,
}

/// What a picture is fitted to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum FrameArg {
    Visible,
    View,
    Volume,
}

/// Where the eye is.
#[derive(Debug, clap::Args)]
pub(in crate::cli) struct ViewArgs {
    /// Rotate the eye about the up direction by DEG degrees, from the front of the volume [default: 0; `render` takes
    /// 30 for a file without orientation if no side is asked for]
    #[arg(long, alias = "camera-azimuth-angle", value_name = "DEG", value_parser = parse::number,
        allow_hyphen_values = true, help_heading = "View")]
    pub(in crate::cli) azimuth: Option<f64>,
    /// Raise the eye towards the up direction by DEG degrees [default: 0; 20 where the azimuth is 30 by default]
    #[arg(long, alias = "camera-elevation-angle", value_name = "DEG", value_parser = parse::number,
        allow_hyphen_values = true, help_heading = "View")]
    pub(in crate::cli) elevation: Option<f64>,
    /// Rotate the camera about its viewing direction by DEG degrees, counter-clockwise
    #[arg(long, value_name = "DEG", default_value_t = 0.0, value_parser = parse::number, allow_hyphen_values = true,
        help_heading = "View")]
    pub(in crate::cli) roll: f64,
    /// World direction that is up in the picture [default: 0,0,1]
    #[arg(long, alias = "camera-view-up", value_name = "X,Y,Z", value_parser = parse::vector,
        allow_hyphen_values = true, help_heading = "View")]
    pub(in crate::cli) up: Option<DVec3>,
    /// World direction from the eye to the target; replaces azimuth and elevation
    #[arg(long, alias = "camera-direction", value_name = "X,Y,Z", value_parser = parse::vector,
        allow_hyphen_values = true,
        conflicts_with_all = ["azimuth", "elevation"], help_heading = "View")]
    pub(in crate::cli) direction: Option<DVec3>,
    /// World point at the centre of the picture [default: the centre of what is framed]
    #[arg(long, alias = "camera-focal-point", value_name = "X,Y,Z", value_parser = parse::vector,
        allow_hyphen_values = true, help_heading = "View")]
    pub(in crate::cli) target: Option<DVec3>,
    /// Parallel rays, or rays through one eye
    #[arg(long, value_name = "KIND", default_value = "orthographic", help_heading = "View")]
    pub(in crate::cli) projection: ProjectionArg,
    /// Perspective: vertical field of view in degrees, over 0 and under 180 [default: 30]
    #[arg(long, alias = "camera-view-angle", value_name = "DEG", value_parser = parse::positive,
        allow_hyphen_values = true, help_heading = "View")]
    pub(in crate::cli) fov: Option<f64>,
    /// Magnify by F
    #[arg(long, alias = "camera-zoom-factor", value_name = "F", default_value_t = 1.0, value_parser = parse::positive,
        allow_hyphen_values = true,
        help_heading = "View")]
    pub(in crate::cli) zoom: f64,
    /// What the picture is fitted to: visible (all that the transfer function shows, in one size at every azimuth),
    /// view (the same, as large as this view of it can be) or volume (the box of the lattice, as it is seen from this
    /// side) [default: visible, or volume if --target, --view-height or --distance is given]
    #[arg(long, value_name = "WHAT", help_heading = "View")]
    pub(in crate::cli) frame: Option<FrameArg>,
    /// Space around what is fitted: a fraction of the picture on each side, 0 to under 0.5 [default: 0.02 beside
    /// colour bar, title and caption; over them with --zoom or --frame, then 0.1 with a title or a caption]
    #[arg(long, value_name = "FRACTION", value_parser = parse::tolerance, allow_hyphen_values = true,
        help_heading = "View")]
    pub(in crate::cli) margin: Option<f64>,
    /// World height that the picture spans at the target [default: what is framed just fits]
    #[arg(long, value_name = "LENGTH", value_parser = parse::positive, allow_hyphen_values = true,
        help_heading = "View")]
    pub(in crate::cli) view_height: Option<f64>,
    /// Perspective: world distance from the eye to the target [default: what is framed just fits]
    #[arg(long, value_name = "LENGTH", value_parser = parse::positive, allow_hyphen_values = true,
        help_heading = "View")]
    pub(in crate::cli) distance: Option<f64>,
}

impl ViewArgs {
    /// Whether no option says what the picture frames, or how large.
    pub(in crate::cli) fn fits_by_default(&self) -> bool {
        let Self { target, zoom, frame, margin, view_height, distance, .. } = self;
        let given = [margin, view_height, distance].into_iter().any(Option::is_some);
        !given && target.is_none() && frame.is_none() && *zoom == 1.0
    }

    /// Whether no option says from which side to look, or what is up.
    pub(in crate::cli) fn says_no_side(&self) -> bool {
        let Self { azimuth, elevation, roll, up, direction, .. } = self;
        azimuth.is_none() && elevation.is_none() && *roll == 0.0 && up.is_none() && direction.is_none()
    }
}
