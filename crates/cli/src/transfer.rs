//! The transfer function that arguments choose, before the volume is known.

use std::path::Path;

use voxsplat::appearance::Values;
use voxsplat::transfer::maps::{self, ColorMap};
use voxsplat::transfer::presets::{self, Preset, PresetValues};
use voxsplat::transfer::{Imported, Window};

use super::args::ModelArgs;
use super::destination::STREAM;
use super::failure::{Failure, refuse};
use super::given::{LABELS, MAP};
use super::parse::{GradientOpacity, reason};

/// The choice of a transfer function.
#[derive(Debug, Clone)]
pub(crate) enum TransferChoice {
    /// The transfer function of a built-in volume, otherwise the preset that suits the values.
    Suggested,
    /// A preset.
    Preset(&'static Preset),
    /// From a file, or a colour map.
    Given(Box<Imported>),
    /// None: values are labels.
    Labels,
}

/// A transfer function to be fitted to a volume.
#[derive(Debug, Clone)]
pub(crate) struct Transfer {
    pub(crate) choice: TransferChoice,
    /// The values at which it begins and ends.
    pub(crate) window: Option<Window>,
    /// The values of a preset.
    pub(crate) values: PresetValues,
    /// Whether only the window was requested.
    by_window: bool,
    /// A replacement for its gradient opacity.
    pub(crate) gradient: Option<GradientOpacity>,
}

impl Transfer {
    /// Returns the request for the values of a file.
    pub(crate) fn values(&self) -> Values {
        match (&self.choice, self.window.filter(|_| self.by_window)) {
            (_, Some(window)) => Values::Window(window),
            (TransferChoice::Suggested, None) => Values::Open,
            (TransferChoice::Labels, None) => Values::Labels,
            (TransferChoice::Preset(_) | TransferChoice::Given(_), None) => Values::Transfer,
        }
    }

    pub(crate) fn new(args: &ModelArgs) -> Result<Self, Failure> {
        let window = args.window;
        let given = |imported| TransferChoice::Given(Box::new(imported));
        let choice = match &args.transfer {
            Some(name) if name == Path::new(LABELS) => TransferChoice::Labels,
            Some(name) => match (presets::PRESETS.iter().find(|preset| name == Path::new(preset.name)), of_map(name)) {
                (Some(preset), _) => TransferChoice::Preset(preset),
                (None, Some(map)) if is_file_name(map) => given(Imported::of_map(&ColorMap::load(map)?)?),
                (None, Some(map)) => {
                    let map = maps::find(&map.to_string_lossy());
                    let usage = |error| Failure::usage(format!("--transfer: {}", reason(error)));
                    given(Imported::of_map(&map.map_err(usage)?)?)
                }
                (None, None) if is_file_name(name) => given(Imported::load(name)?),
                (None, None) if name.to_string_lossy().starts_with('{') => {
                    given(Imported::parse(&name.to_string_lossy(), None)?)
                }
                (None, None) => return refuse(no_transfer(name)),
            },
            // A window alone is the window of a radiologist: grey values.
            None if window.is_some() => given(Imported::of_map(&maps::find("gray")?)?),
            None => TransferChoice::Suggested,
        };
        let values = args.transfer_values;
        if values != PresetValues::Auto && !matches!(choice, TransferChoice::Suggested | TransferChoice::Preset(_)) {
            return refuse("--transfer-values is for presets: files have values of their own, --window places maps");
        }
        let by_window = window.is_some() && args.transfer.is_none();
        Ok(Self { choice, window, values, by_window, gradient: args.gradient_opacity.clone() })
    }
}

/// Returns the error of a name that is no transfer function.
fn no_transfer(name: &Path) -> String {
    let text = name.to_string_lossy();
    if maps::find(&text).is_ok() {
        return format!("--transfer: {name:?} is a colour map, give map:{text}");
    }
    let known: Vec<&str> = presets::PRESETS.iter().map(|preset| preset.name).collect();
    format!("--transfer: {name:?}, expected a file, map:NAME, labels or one of {}", known.join(", "))
}

/// Returns the name or the file of a colour map.
fn of_map(transfer: &Path) -> Option<&Path> {
    transfer.to_str()?.strip_prefix(MAP).map(Path::new)
}

/// Whether the text must mean a file. Then a missing file is reported, instead of an unknown name.
fn is_file_name(text: &Path) -> bool {
    let lossy = text.to_string_lossy();
    if lossy == STREAM {
        return true;
    }
    if lossy.starts_with('{') {
        return false;
    }
    let file = lossy.split('#').next().unwrap_or_default().to_lowercase();
    let endings = [".json", ".vp", ".xml"];
    endings.iter().any(|ending| file.ends_with(ending)) || lossy.contains(['/', '\\', '#']) || text.is_file()
}
