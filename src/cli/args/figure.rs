//! What is drawn on a picture.

use clap::builder::NonEmptyStringValueParser;

/// What is drawn on the finished picture. A PNG has it, an EXR keeps the values of the volume's picture.
#[derive(Debug, clap::Args)]
pub(in crate::cli) struct FigureArgs {
    /// Draw a bar of a round length; in perspective it is true at the depth of the target
    #[arg(long, help_heading = "Figure")]
    pub(in crate::cli) scale_bar: bool,
    /// Draw the axes, with the letters of the patient (R/L, A/P, S/I) if the file states the orientation
    #[arg(long, help_heading = "Figure")]
    pub(in crate::cli) axes: bool,
    /// Draw the colours of the transfer function over values, with a curve of its opacity
    #[arg(long, alias = "color-bar", help_heading = "Figure")]
    pub(in crate::cli) colour_bar: bool,
    /// Draw a patch of colour and the name of each label that shows, or of each channel
    #[arg(long, help_heading = "Figure")]
    pub(in crate::cli) legend: bool,
    /// Write TEXT above
    #[arg(long, value_name = "TEXT", help_heading = "Figure")]
    pub(in crate::cli) title: Option<String>,
    /// Write TEXT below
    #[arg(long, value_name = "TEXT", help_heading = "Figure")]
    pub(in crate::cli) caption: Option<String>,
    /// Unit of world lengths, such as mm [default: that of the file]
    #[arg(long, value_name = "UNIT", value_parser = NonEmptyStringValueParser::new(), requires = "scale_bar",
        help_heading = "Figure")]
    pub(in crate::cli) length_unit: Option<String>,
    /// Unit of values, such as HU [default: that of the file]
    #[arg(long, value_name = "UNIT", value_parser = NonEmptyStringValueParser::new(), requires = "colour_bar",
        help_heading = "Figure")]
    pub(in crate::cli) value_unit: Option<String>,
}
