//! Files of several channels, drawn together: each in a colour, or all as the colours of voxels.

use std::fmt;
use std::path::Path;
use std::str::FromStr;

use crate::error::{Error, Result};
use crate::formats::{self, LoadOptions};
use crate::layers::{Layer, LegendEntry};
use crate::transfer::{ControlPoint, TransferFunction, Window, color};
use crate::volume::{Channel, SampleType, Statistics, Volume};
use voxsplat_volume::names::readable;

/// Colours of channels without one: pairs that red-green colour-blind people tell apart, as microscopists use them.
const COLORS: [[f64; 3]; 6] =
    [[0.15, 0.9, 0.3], [0.95, 0.2, 0.85], [0.1, 0.8, 0.95], [0.95, 0.85, 0.15], [0.95, 0.4, 0.2], [0.4, 0.45, 0.95]];

/// The largest number of channels that are drawn unless they are requested.
const MOST_CHANNELS: u32 = 6;
/// The largest opacity of a channel at the upper end of its window, per voxel.
const CHANNEL_OPACITY: f64 = 0.4;
/// The optical depth of all channels along a mean ray through their foreground: matter behind shows through.
const CHANNEL_DEPTH: f64 = 4.5;
/// The brightness of a channel at the lower end of its window, as a share of its colour: edges and depth show.
const DARKEST: f64 = 0.4;
/// The opacity of the colours of voxels at the upper end of their window, per voxel.
const COLOR_OPACITY: f64 = 0.4;
/// Steps of the ramp of opacity, which is the square of the place in the window.
const STEPS: u32 = 16;

/// A channel to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChannelChoice {
    /// The number of the channel, from 0.
    pub number: u32,
    /// The colour of the channel, red, green and blue, 0 to 1; `None` for the colour of the file, or one that differs
    /// from other channels.
    pub color: Option<[f64; 3]>,
}

impl FromStr for ChannelChoice {
    type Err = Error;

    /// Parses `N` or `N:COLOUR`.
    fn from_str(text: &str) -> Result<Self> {
        let (number, name) = text.split_once(':').map_or((text, None), |(number, name)| (number, Some(name)));
        let parsed = || {
            let color = match name {
                Some(name) => Some(color::parse(name)?),
                None => None,
            };
            Some(Self { number: number.parse().ok()?, color })
        };
        parsed().ok_or_else(|| {
            let tip = name.map(color::tip).unwrap_or_default();
            Error::setting("channel", format!("expected N or N:COLOUR, channels counted from 0{tip}"))
        })
    }
}

/// The requested display of a file's values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Values {
    /// The display that suits the values.
    Open,
    /// A window of values.
    Window(Window),
    /// Values shown as labels.
    Labels,
    /// A transfer function.
    Transfer,
}

/// The width of the blocks of a small picture, in pixels: kernels are wider than voxels, so means are not seen.
const BLOCK: f64 = 1.4;

/// The contents of a file that are drawn.
#[derive(Debug, Clone)]
pub struct Loaded {
    /// The volume, or the first of its channels.
    pub volume: Volume,
    /// Layers in place of the volume's values, if several channels are drawn.
    pub layers: Vec<Layer>,
    /// Further volumes of labels on the same lattice, which may overlap with the first.
    pub labels: Vec<Volume>,
    /// The channels that are drawn in a colour each.
    pub channels: Vec<ChannelLook>,
}

impl From<Volume> for Loaded {
    fn from(volume: Volume) -> Self {
        Self { volume, layers: Vec::new(), labels: Vec::new(), channels: Vec::new() }
    }
}

impl Loaded {
    /// Returns the contents for a small picture of `size` pixels, width and height: the means of blocks of voxels about
    /// as wide as a pixel of a picture that the volume fills.
    ///
    /// # Errors
    /// The errors of [`Volume::reduced`].
    pub fn reduced(self, size: [u32; 2]) -> Result<Self> {
        let grid = self.volume.grid();
        let extents = [0, 1, 2].map(|axis| grid.spacing()[axis] * f64::from(grid.dims()[axis]));
        let block = BLOCK * extents.into_iter().fold(0.0, f64::max) / f64::from(size[0].max(size[1]));
        let factors = grid.spacing().map(|spacing| (block / spacing).round().max(1.0) as u32);
        if factors == [1; 3] || !self.labels.is_empty() {
            return Ok(self);
        }
        let layers = self.layers.iter().map(|layer| layer.reduced(factors)).collect::<Result<_>>()?;
        Ok(Self { volume: self.volume.reduced(factors)?, layers, ..self })
    }
}

/// The look of a channel. `Display` writes it as `NUMBER:#RRGGBB NAME from LOW to HIGH`.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelLook {
    /// The number of the channel, from 0.
    pub number: u32,
    /// Red, green and blue of the channel, 0 to 255.
    pub color: [u8; 3],
    /// The name of the channel, if the file states one.
    pub name: Option<String>,
    /// The values at which the channel's opacity begins and ends to rise.
    pub range: [f64; 2],
}

impl fmt::Display for ChannelLook {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([r, g, b], [low, high]) = (self.color, self.range.map(readable));
        let name = self.name.as_ref().map(|name| format!(" {name}")).unwrap_or_default();
        write!(f, "{}:#{r:02x}{g:02x}{b:02x}{name} from {low} to {high}", self.number)
    }
}

/// Loads a file and chooses what is drawn of its channels: the requested ones, the only one, labels, the colours of
/// voxels if channels are called red, green and blue, and otherwise up to 6 channels, in a colour each.
///
/// # Errors
/// The errors of [`formats::load`], also if the file has more channels than are drawn by default, or several for labels
/// or one transfer function; [`Error::Setting`] if one transfer function is requested for several channels.
pub fn load_channels(
    source: impl AsRef<Path>,
    options: &LoadOptions,
    requested: &[ChannelChoice],
    values: Values,
) -> Result<Loaded> {
    let source = source.as_ref();
    let one = |number: u32| formats::load(source, &LoadOptions { channel: Some(number), ..*options });
    // Of a file of several channels this is an error that lists them.
    let whole = || Ok(formats::load(source, options)?.into());
    let has_colors = matches!(values, Values::Open | Values::Window(_));
    let first = match (requested, values) {
        ([only], _) if only.color.is_none() || !has_colors => return Ok(one(only.number)?.into()),
        ([], Values::Transfer) => return whole(),
        ([], _) => one(0)?,
        ([first, ..], _) if has_colors => one(first.number)?,
        _ => {
            let reason = "it is for one channel, and several have a colour each".to_owned();
            return Err(Error::Setting { name: "transfer", reason });
        }
    };
    let contents = first.contents().clone();
    let all: Vec<ChannelChoice> = match requested {
        [] if contents.channels == 1 => return Ok(first.into()),
        [] if contents.segments.is_some() && !matches!(values, Values::Window(_)) => {
            let labels = (1..contents.channels).map(one).collect::<Result<_, _>>()?;
            return Ok(Loaded { labels, ..first.into() });
        }
        _ if values == Values::Labels => return whole(),
        [] if are_colors(&contents.labels) => {
            let alpha = (contents.channels == 4).then(|| one(3)).transpose()?;
            let layer = colors([&first, &one(1)?, &one(2)?], alpha.as_ref(), values)?;
            return Ok(Loaded { layers: vec![layer], ..first.into() });
        }
        [] if contents.channels > MOST_CHANNELS => return whole(),
        [] => (0..contents.channels).map(|number| ChannelChoice { number, color: None }).collect(),
        _ => requested.to_vec(),
    };
    let count = all.len();
    let (mut layers, mut channels) = (Vec::new(), Vec::new());
    for (at, ChannelChoice { number, color }) in all.into_iter().enumerate() {
        let volume = if number == contents.channel { first.clone() } else { one(number)? };
        let label = contents.labels.get(number as usize).cloned().unwrap_or_default();
        let of_file = label.color.map(|color| color.map(|c| f64::from(c) / 255.0)).filter(|c| *c != [0.0; 3]);
        let float = color.or(of_file).unwrap_or(nth_color(at));
        let statistics = Statistics::of(&volume)?;
        let Some(window) = window(&statistics, &label, values) else { continue };
        let color = bytes(float);
        let name = label.name.clone().unwrap_or_else(|| format!("channel {number}"));
        let layer = Layer::scalars(&volume, &glow(&volume, &statistics, &window, float, count)?);
        layers.push(layer.named(LegendEntry { name, color }));
        channels.push(ChannelLook { number, color, name: label.name, range: window.ends()? });
    }
    if layers.is_empty() {
        return Err(Error::volume("all values of every channel are the same"));
    }
    Ok(Loaded { layers, channels, ..first.into() })
}

/// Returns the colour of a channel for which neither the user nor the file states one.
pub(super) fn nth_color(at: usize) -> [f64; 3] {
    COLORS[at % COLORS.len()]
}

/// Returns a colour as bytes.
pub(super) fn bytes(color: [f64; 3]) -> [u8; 3] {
    color.map(|channel| (255.0 * channel).round() as u8)
}

/// Returns the transfer function of one of several channels over a window: a colour, denser and brighter with value.
pub(super) fn glow(
    volume: &Volume,
    statistics: &Statistics,
    window: &Window,
    color: [f64; 3],
    count: usize,
) -> Result<TransferFunction> {
    let opacity = opacity(volume, statistics, window, CHANNEL_DEPTH / count as f64)?;
    ramp([DARKEST, 1.0].map(|share| color.map(|c| share * c)), opacity, window)
}

/// Returns whether the first channels are called red, green and blue.
fn are_colors(channels: &[Channel]) -> bool {
    let names: Vec<Option<&str>> = channels.iter().map(|channel| channel.name.as_deref()).collect();
    names.starts_with(&["red", "green", "blue"].map(Some))
}

/// Returns the window of a channel: as requested, of its file, or of its foreground; `None` if all values are the same.
fn window(statistics: &Statistics, label: &Channel, values: Values) -> Option<Window> {
    if let Values::Window(window) = values {
        return Some(window);
    }
    let of_file = label.window.map(|[low, high]| Window { level: f64::midpoint(low, high), width: high - low });
    match of_file.filter(|window| window.ends().is_ok()) {
        None => Window::of_foreground(statistics),
        window => window,
    }
}

/// Returns the opacity of a channel at the upper end of its window: a mean ray through the visible voxels has an
/// optical depth of at most `depth`. The ray is as long as the edge of a cube of these voxels.
fn opacity(volume: &Volume, statistics: &Statistics, window: &Window, depth: f64) -> Result<f64> {
    let [low, high] = window.ends()?;
    let share = |step: u32| {
        let value = statistics.quantile_above(low, (f64::from(step) + 0.5) / f64::from(STEPS));
        ((value - low) / (high - low)).clamp(0.0, 1.0)
    };
    let mean = (0..STEPS).map(|step| share(step).powi(2)).sum::<f64>() / f64::from(STEPS);
    let length = libm::cbrt(statistics.fraction_above(low) * volume.grid().len() as f64);
    Ok(CHANNEL_OPACITY.min(depth / (mean * length).max(f64::MIN_POSITIVE)))
}

/// Returns a transfer function with colours between two, and opacities that rise over a window.
fn ramp([dark, bright]: [[f64; 3]; 2], opacity: f64, window: &Window) -> Result<TransferFunction> {
    let point = |i: u32| {
        let share = f64::from(i) / f64::from(STEPS);
        let color = std::array::from_fn(|c| dark[c] + share * (bright[c] - dark[c]));
        ControlPoint { value: share, color, opacity: opacity * share * share }
    };
    TransferFunction::new((0..=STEPS).map(point).collect(), None)?.stretched(window)
}

/// Makes a layer of voxels in the colours of a file.
fn colors(channels: [&Volume; 3], alpha: Option<&Volume>, values: Values) -> Result<Layer> {
    let mut white = 255.0_f64;
    if channels[0].sample_type() != SampleType::U8 {
        white = 0.0;
        for channel in channels {
            white = white.max(Statistics::of(channel)?.max);
        }
    }
    let window = match values {
        Values::Window(window) => window,
        _ => Window { level: white / 2.0, width: white },
    };
    Layer::colors(channels, alpha, white, &ramp([[1.0; 3]; 2], COLOR_OPACITY, &window)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_have_a_number_and_maybe_a_colour() {
        let channel = |text: &str| text.parse::<ChannelChoice>();
        assert_eq!(channel("2").unwrap(), ChannelChoice { number: 2, color: None });
        for red in ["0:#ff0000", "0:Red", "0:#f00", "0:1,0,0"] {
            assert_eq!(channel(red).unwrap(), ChannelChoice { number: 0, color: Some([1.0, 0.0, 0.0]) });
        }
        for bad in ["", "-1", "a", "1:", "1:transparent", "1.5"] {
            let error = channel(bad).unwrap_err().to_string();
            assert_eq!(error, "channel: expected N or N:COLOUR, channels counted from 0", "{bad}");
        }
        let misspelt = channel("1:fuschia").unwrap_err().to_string();
        assert!(misspelt.ends_with("; a similar colour exists: fuchsia"), "{misspelt}");
    }
}
