//! Files of several channels, drawn together: each in a colour, or all as the colours of voxels.

use std::path::Path;

use voxsplat::Background;
use voxsplat::error::InputError;
use voxsplat::figure::LegendEntry;
use voxsplat::formats::{self, LoadOptions};
use voxsplat::layers::Layer;
use voxsplat::transfer::{ControlPoint, TransferFunction, Window};
use voxsplat::volume::{Channel, SampleType, Statistics, Volume};
use voxsplat_volume::names::readable;

use super::failure::{Failure, refuse};

use super::transfer::{Transfer, TransferChoice};

/// A channel to be drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ChannelArg {
    pub(crate) number: u32,
    color: Option<[f64; 3]>,
}

/// `N` or `N:COLOUR`.
pub(crate) fn channel(text: &str) -> Result<ChannelArg, String> {
    let expected = || "expected N or N:COLOUR, channels counted from 0".to_owned();
    let (number, color) = text.split_once(':').map_or((text, None), |(number, color)| (number, Some(color)));
    let color = match color.map(str::parse) {
        None => None,
        Some(Ok(Background::Color(color))) => Some(color),
        Some(_) => return Err(expected()),
    };
    Ok(ChannelArg { number: number.parse().map_err(|_| expected())?, color })
}

/// Colours of channels that neither the file nor the user gives any: pairs that people who see red and green alike tell
/// apart, as microscopists take them.
const COLORS: [[f64; 3]; 6] =
    [[0.0, 1.0, 0.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [1.0, 1.0, 0.0], [1.0, 0.3, 0.2], [0.3, 0.4, 1.0]];

/// The most channels that are drawn unless they are named.
const MOST: u32 = 6;
/// The opacity of a channel at the upper end of its window, per voxel.
const TOP: f64 = 0.2;
/// The same of colours.
const COLOR_TOP: f64 = 0.4;
/// Steps of the ramp of opacity, which is the square of the place in the window.
const STEPS: u32 = 16;

/// What a file holds.
pub(crate) struct Loaded {
    /// The volume, or the first of its channels.
    pub(crate) volume: Volume,
    /// What is drawn in place of its values, if there are several channels.
    pub(crate) layers: Vec<Layer>,
    /// The volumes beyond the first, if it is of labels and the file has several layers of them.
    pub(crate) labels: Vec<Volume>,
    /// For the user: how.
    pub(crate) note: Option<String>,
}

impl From<Volume> for Loaded {
    fn from(volume: Volume) -> Self {
        Self { volume, layers: Vec::new(), labels: Vec::new(), note: None }
    }
}

/// Reads the volume of a job, and of several channels those that it asks for.
pub(crate) fn load(
    source: &Path,
    options: &LoadOptions,
    asked: &[ChannelArg],
    transfer: &Transfer,
) -> Result<Loaded, Failure> {
    let of = |number: u32| formats::load(source, &LoadOptions { channel: Some(number), ..*options });
    let values = matches!(transfer.choice, TransferChoice::Suggested) || transfer.is_window();
    if let [only] = asked
        && (only.color.is_none() || !values)
    {
        return Ok(of(only.number)?.into());
    }
    // What the file holds the first of its channels tells.
    let are_labels = matches!(transfer.choice, TransferChoice::Labels);
    let first = match (asked, values) {
        ([], false) if !are_labels => return Ok(formats::load(source, options)?.into()),
        ([], _) => of(0)?,
        ([first, ..], true) => of(first.number)?,
        (_, false) => {
            let message = "--transfer is for one channel; give several colours by --channel N:COLOUR";
            return refuse(message);
        }
    };
    let contents = first.contents().clone();
    if asked.is_empty() && contents.channels == 1 {
        return Ok(first.into());
    }
    if asked.is_empty() && contents.segments.is_some() && !transfer.is_window() {
        let labels = (1..contents.channels).map(of).collect::<Result<_, _>>()?;
        return Ok(Loaded { labels, ..first.into() });
    }
    if are_labels {
        // Its error says how many there are.
        return Ok(formats::load(source, options)?.into());
    }
    let named = |at: usize, name: &str| contents.labels.get(at).and_then(|l| l.name.as_deref()) == Some(name);
    if asked.is_empty() && ["red", "green", "blue"].into_iter().enumerate().all(|(at, name)| named(at, name)) {
        let alpha = (contents.channels == 4).then(|| of(3)).transpose()?;
        let layer = colors([&first, &of(1)?, &of(2)?], alpha.as_ref(), transfer.window.as_ref())?;
        return Ok(Loaded { layers: vec![layer], ..first.into() });
    }
    if asked.is_empty() && contents.channels > MOST {
        // Its error says how many there are.
        return Ok(formats::load(source, options)?.into());
    }
    let all: Vec<ChannelArg> = match asked {
        [] => (0..contents.channels).map(|number| ChannelArg { number, color: None }).collect(),
        _ => asked.to_vec(),
    };
    let (mut layers, mut said) = (Vec::new(), Vec::new());
    for (at, ChannelArg { number, color }) in all.iter().enumerate() {
        let volume = if *number == contents.channel { first.clone() } else { of(*number)? };
        let label = contents.labels.get(*number as usize).cloned().unwrap_or_default();
        let of_file = label.color.map(|color| color.map(|c| f64::from(c) / 255.0)).filter(|c| *c != [0.0; 3]);
        let color = color.or(of_file).unwrap_or(COLORS[at % COLORS.len()]);
        let Some(window) = window(&volume, &label, transfer.window.as_ref())? else { continue };
        let [r, g, b] = color.map(|channel| (255.0 * channel).round() as u8);
        let entry = label.name.clone().unwrap_or_else(|| format!("channel {number}"));
        let layer = Layer::scalars(&volume, &ramp(color, TOP, &window)?);
        layers.push(layer.named(LegendEntry { name: entry, color: [r, g, b] }));
        let [low, high] = window.ends()?.map(readable);
        let name = label.name.map(|name| format!(" {name}")).unwrap_or_default();
        said.push(format!("{number}:#{r:02x}{g:02x}{b:02x}{name} from {low} to {high}"));
    }
    if layers.is_empty() {
        return Err(InputError::Volume("all values of every channel are the same".to_owned()).into());
    }
    let note = Some(format!("note: --channel {}", said.join(", --channel ")));
    Ok(Loaded { layers, note, ..first.into() })
}

/// The values that a channel is shown from and to: those asked for, those of its file, those of its foreground.
fn window(volume: &Volume, label: &Channel, asked: Option<&Window>) -> Result<Option<Window>, Failure> {
    let of_file = label.window.map(|[low, high]| Window { level: f64::midpoint(low, high), width: high - low });
    match asked.copied().or(of_file.filter(|window| window.ends().is_ok())) {
        None => Ok(Window::of(&Statistics::of(volume)?)),
        window => Ok(window),
    }
}

/// One colour, and opacities that rise over a window.
fn ramp(color: [f64; 3], top: f64, window: &Window) -> Result<TransferFunction, Failure> {
    let point = |i: u32| {
        let share = f64::from(i) / f64::from(STEPS);
        ControlPoint { value: share, color, opacity: top * share * share }
    };
    Ok(TransferFunction::new((0..=STEPS).map(point).collect(), None)?.stretched(window)?)
}

/// Voxels in the colours of a file.
fn colors(channels: [&Volume; 3], alpha: Option<&Volume>, window: Option<&Window>) -> Result<Layer, Failure> {
    let mut white = 255.0_f64;
    if channels[0].sample_type() != SampleType::U8 {
        white = 0.0;
        for channel in channels {
            white = white.max(Statistics::of(channel)?.max);
        }
    }
    let whole = Window { level: white / 2.0, width: white };
    Ok(Layer::colors(channels, alpha, white, &ramp([1.0; 3], COLOR_TOP, window.unwrap_or(&whole))?)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_have_a_number_and_maybe_a_colour() {
        assert_eq!(channel("2"), Ok(ChannelArg { number: 2, color: None }));
        assert_eq!(channel("0:#ff0000"), Ok(ChannelArg { number: 0, color: Some([1.0, 0.0, 0.0]) }));
        for bad in ["", "-1", "a", "1:", "1:transparent", "1.5"] {
            let error = channel(bad).unwrap_err();
            assert!(error.starts_with("expected N or N:COLOUR"), "{bad}: {error}");
        }
    }
}
