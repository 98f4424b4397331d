//! The meaning of values, and the choices that the library makes, with reasons.

use std::fmt;
use std::path::Path;

use super::demos;
use super::suggestion::{Suggestion, suggest};
use crate::error::Result;
use crate::layers::recognised;
use crate::transfer::TransferFunction;
use crate::transfer::presets::{self, Preset, PresetValues};
use crate::volume::{Statistics, Volume};

/// The meaning of the values of a volume.
#[derive(Debug, Clone)]
pub enum ValueMeaning {
    /// Values that are labels.
    Labels {
        /// The property of the volume or its file that indicates labels.
        reason: String,
    },
    /// The values of a built-in volume, with its transfer function.
    BuiltIn(TransferFunction),
    /// Values that a preset suits.
    Values {
        /// The preset, fitted to the values.
        transfer: TransferFunction,
        /// The preset that suits the values.
        preset: &'static Preset,
        /// The property of the file or of the values that suits the preset.
        reason: String,
        /// Whether the values decided: see [`Suggestion::is_guess`].
        is_guess: bool,
    },
}

impl ValueMeaning {
    /// Finds the meaning of the values of a volume from `source`: a file, or `demo:NAME`. Without `labels`, values are
    /// never taken for labels. A preset places its points by `values`. Calls `statistics` only if the values decide.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) and [`Error::Memory`](crate::Error::Memory) if samples cannot be read;
    /// [`Error::Transfer`](crate::Error::Transfer) if all values are the same.
    pub fn find(
        source: impl AsRef<Path>,
        volume: &Volume,
        labels: bool,
        values: PresetValues,
        statistics: impl FnOnce() -> Result<Statistics>,
    ) -> Result<Self> {
        if let Some(transfer) = demos::own_transfer(source) {
            return Ok(Self::BuiltIn(transfer));
        }
        if labels && let Some(reason) = recognised(volume)? {
            return Ok(Self::Labels { reason });
        }
        let statistics = statistics()?;
        if labels && !volume.sample_type().is_float() && [statistics.min, statistics.max] == [0.0; 2] {
            return Ok(Self::Labels { reason: "all its values are 0, as in an empty mask".to_owned() });
        }
        let Suggestion { name, reason, is_guess } = suggest(volume, &statistics);
        let transfer = presets::preset(name, volume, &statistics, values)?;
        Ok(Self::Values { transfer, preset: presets::find(name)?, reason, is_guess })
    }
}

impl ValueMeaning {
    /// Returns the name of the look that suits the values ([`LABELS`] or a preset; `None` of a built-in volume, which
    /// has a look of its own), the reason, and whether it is a guess.
    #[must_use]
    pub fn look(self) -> (Option<&'static str>, String, bool) {
        match self {
            Self::BuiltIn(_) => (None, "a built-in volume has its own transfer function".to_owned(), false),
            Self::Labels { reason } => (Some(LABELS), reason, false),
            Self::Values { preset, reason, is_guess, .. } => (Some(preset.name), reason, is_guess),
        }
    }
}

/// The name of the transfer function that takes the values for labels.
pub const LABELS: &str = "labels";

/// The words after a preset that the values decided.
pub const GUESS: &str = ", a guess from the histogram,";

/// A choice with its reason. `Display` prints it in the words of the library.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Choice {
    /// Values are labels.
    Labels {
        /// The reason to take them for labels.
        reason: String,
    },
    /// A preset.
    Preset {
        /// The name of the preset.
        name: &'static str,
        /// The reason why the preset suits.
        reason: String,
        /// Whether the values decided: see [`Suggestion::is_guess`].
        is_guess: bool,
    },
    /// An oblique side, because the file states no orientation, or the side that a built-in volume suggests. Degrees.
    Side {
        /// The azimuth of the view: [`View::azimuth`](crate::View::azimuth).
        azimuth: f64,
        /// The elevation of the view: [`View::elevation`](crate::View::elevation).
        elevation: f64,
        /// The reason to turn the volume.
        reason: &'static str,
    },
    /// Studio light around the view, because a transfer function, channels or labels show surfaces. Labels have a
    /// larger shadow bias.
    Light {
        /// The reason for the light, in words.
        surfaces: &'static str,
        /// The [`Lighting::shadow_bias`](crate::lighting::Lighting::shadow_bias) of labels, in voxels.
        shadow_bias: Option<f64>,
    },
    /// A [`Settings::sharpness`](crate::Settings::sharpness), because the transfer function shows surfaces.
    Sharpness(f64),
    /// A grey and translucent volume, because overlays lie over it.
    Dimmed,
    /// A volume in the colour of a channel, because overlays lie over it.
    Channel,
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Labels { reason } => write!(f, "values are labels because {reason}"),
            Self::Preset { name, reason, is_guess } => {
                let guess = if *is_guess { GUESS } else { "" };
                write!(f, "preset {name}{guess} because {reason}")
            }
            Self::Side { azimuth, elevation, reason } => {
                write!(f, "azimuth {azimuth}, elevation {elevation} because {reason}")
            }
            Self::Light { shadow_bias: None, surfaces } => write!(f, "studio light because {surfaces}"),
            Self::Light { shadow_bias: Some(bias), surfaces } => {
                write!(f, "studio light, shadow bias {bias}, because {surfaces}")
            }
            Self::Dimmed => f.write_str("a grey and translucent volume because overlays lie over it"),
            Self::Channel => f.write_str("a volume in the colour of a channel because overlays lie over it"),
            Self::Sharpness(sharpness) => {
                write!(f, "sharpness {sharpness} because the transfer function shows surfaces")
            }
        }
    }
}
