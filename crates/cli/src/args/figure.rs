//! The figure on a picture.

use voxsplat::volume::Units;

use crate::parse;

/// The figure on the finished picture. A PNG has the figure, an EXR keeps the values of the picture.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Figure")]
pub(crate) struct FigureArgs {
    /// Draw a scale bar of a round length
    ///
    /// In perspective the length is true at the depth of the target.
    #[arg(long)]
    pub(crate) scale_bar: bool,
    /// Draw the axes, with the letters of the patient (R/L, A/P, S/I) if the file states the orientation
    #[arg(long)]
    pub(crate) axes: bool,
    /// Draw a colour bar with the opacity curve of the transfer function
    #[arg(long, alias = "color-bar")]
    pub(crate) colour_bar: bool,
    /// Draw a legend: the colour and the name of each visible label, or of each channel
    #[arg(long)]
    pub(crate) legend: bool,
    /// Write TEXT above the picture
    #[arg(long, value_name = "TEXT")]
    pub(crate) title: Option<String>,
    /// Write TEXT below the picture
    #[arg(long, value_name = "TEXT")]
    pub(crate) caption: Option<String>,
    /// Label lengths (scale bar) with a unit such as mm, and values (colour bar) with a unit such as HU; either or both
    /// [default: the units of the file]
    #[arg(long, value_name = "length=U,value=U", value_parser = parse::units)]
    pub(crate) units: Option<Units>,
}
