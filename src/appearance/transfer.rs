//! The transfer function that a user requests, before the volume is known, and its fit to the volume.

use std::path::Path;
use std::str::FromStr;

use super::channels::Values;
use super::choice::{Choice, LABELS, ValueMeaning};
use super::{demos, isosurface};
use crate::error::{Error, Result};
use crate::layers::Layers;
use crate::settings::parse::{expect, finite};
use crate::settings::{Painter, Settings, Shading};
use crate::transfer::maps::{self, ColorMap};
use crate::transfer::presets::{self, Material, PRESETS, Preset, PresetValues};
use crate::transfer::{Classification, ControlPoint, GradientPoint, Imported, TransferFunction, Window};
use crate::volume::{Statistics, Volume};

/// The prefix of colour maps in the name of a transfer function.
pub const MAP: &str = "map:";

/// The choice of a transfer function.
#[derive(Debug, Clone)]
pub enum TransferChoice {
    /// The transfer function of a built-in volume, otherwise the preset that suits the values.
    Suggested,
    /// A preset.
    Preset(&'static Preset),
    /// A transfer function from a file, or a colour map.
    Given(Box<Imported>),
    /// No transfer function, because values are labels.
    Labels,
}

/// The points of a gradient opacity; none: no gradient opacity.
#[derive(Debug, Clone, PartialEq)]
pub struct GradientSpec(pub Vec<GradientPoint>);

impl FromStr for GradientSpec {
    type Err = Error;

    /// Parses `off`, or pairs `MAGNITUDE:OPACITY` parted by commas.
    fn from_str(text: &str) -> Result<Self> {
        if text == "off" {
            return Ok(Self(Vec::new()));
        }
        let point = |pair: &str| {
            let (magnitude, opacity) = pair.split_once(':')?;
            let ([magnitude], [opacity]) = (finite(magnitude)?, finite(opacity)?);
            Some(GradientPoint { magnitude, opacity })
        };
        let points: Option<Vec<GradientPoint>> = text.split(',').map(point).collect();
        let expected = "off, or MAGNITUDE:OPACITY pairs such as 10:0,50:1, magnitudes in values per world unit";
        let points = expect("gradient_opacity", points, expected)?;
        // The validity of the points does not depend on the rest of the transfer function.
        let any = ControlPoint { value: 0.0, color: [1.0; 3], opacity: 1.0 };
        let transfer = TransferFunction::new(vec![any], None)?.with_gradient_opacity(points)?;
        Ok(Self(transfer.gradient_opacity().to_vec()))
    }
}

/// A transfer function to be fitted to a volume.
#[derive(Debug, Clone)]
pub struct TransferRequest {
    /// The choice of the transfer function.
    pub choice: TransferChoice,
    /// The values at which the transfer function begins and ends.
    pub window: Option<Window>,
    /// The values by which a preset places its points.
    pub values: PresetValues,
    /// Whether only the window was requested.
    by_window: bool,
    /// A replacement for the transfer function's gradient opacity.
    pub gradient: Option<GradientSpec>,
    /// A replacement for the transfer function's classification of voxels in pre-shading.
    pub classification: Option<Classification>,
    /// Isosurfaces beside the transfer function, or alone if no other is requested.
    pub isosurfaces: Vec<ControlPoint>,
}

/// A transfer function fitted to a volume.
#[derive(Debug, Clone)]
pub struct FittedTransfer {
    /// The transfer function; clear if values are labels.
    pub transfer: TransferFunction,
    /// The preset of the transfer function, if it has one.
    pub preset: Option<&'static Preset>,
    /// The material of the surfaces that the transfer function shows, by its preset or its built-in volume.
    pub material: Option<Material>,
    /// Whether values are labels, which have no transfer function.
    pub labels: bool,
    /// The choice of the library, if the request left it open.
    pub choice: Option<Choice>,
    /// Whether the requested values of the preset make a difference.
    pub values_matter: bool,
}

impl FittedTransfer {
    fn new(transfer: TransferFunction, preset: Option<&'static Preset>) -> Self {
        let material = preset.and_then(|preset| preset.material);
        Self { transfer, preset, material, labels: false, choice: None, values_matter: true }
    }

    /// Returns a clear transfer function, for layers that have their own.
    ///
    /// # Errors
    /// The errors of [`TransferFunction::new`].
    pub fn clear() -> Result<Self> {
        let clear = ControlPoint { value: 0.0, color: [0.0; 3], opacity: 0.0 };
        Ok(Self::new(TransferFunction::new(vec![clear], None)?, None))
    }
}

impl TransferRequest {
    /// Returns the request for a transfer function by its name: a preset, `map:NAME` or `map:FILE`, `labels`, a file of
    /// [`Imported::load`] or its text, which begins with a brace. Without a name, a window shows grey values; without
    /// both, the transfer function is open.
    ///
    /// # Errors
    /// [`Error::Setting`] if there is no such transfer function, or `values` are requested of another one than a
    /// preset; the errors of [`Imported::load`].
    pub fn new(
        name: Option<&Path>,
        window: Option<Window>,
        values: PresetValues,
        gradient: Option<GradientSpec>,
    ) -> Result<Self> {
        let given = |imported| TransferChoice::Given(Box::new(imported));
        let choice = match name {
            Some(name) if name == Path::new(LABELS) => TransferChoice::Labels,
            Some(name) => match (PRESETS.iter().find(|preset| name == Path::new(preset.name)), of_map(name)) {
                (Some(preset), _) => TransferChoice::Preset(preset),
                (None, Some(map)) if is_file_name(map) => given(Imported::of_map(&ColorMap::load(map)?)?),
                (None, Some(map)) => {
                    let map = maps::find(&map.to_string_lossy()).map_err(|error| match error {
                        Error::Transfer(reason) => Error::setting("transfer", reason),
                        other => other,
                    });
                    given(Imported::of_map(&map?)?)
                }
                (None, None) if is_file_name(name) => given(Imported::load(name)?),
                (None, None) if name.to_string_lossy().starts_with('{') => {
                    given(Imported::parse(&name.to_string_lossy(), None)?)
                }
                (None, None) => return Err(Error::setting("transfer", no_transfer(name))),
            },
            // A window alone is the window of a radiologist: grey values.
            None if window.is_some() => given(Imported::of_map(&maps::find("gray")?)?),
            None => TransferChoice::Suggested,
        };
        if values != PresetValues::Auto && !matches!(choice, TransferChoice::Suggested | TransferChoice::Preset(_)) {
            let reason = "it is for presets: files have values of their own, a window places maps";
            return Err(Error::setting("transfer_values", reason));
        }
        Ok(Self {
            choice,
            window,
            values,
            by_window: window.is_some() && name.is_none(),
            gradient,
            classification: None,
            isosurfaces: Vec::new(),
        })
    }

    /// Returns the request for the values of a file.
    #[must_use]
    pub fn values(&self) -> Values {
        match (&self.choice, self.window.filter(|_| self.by_window)) {
            (_, Some(window)) => Values::Window(window),
            (TransferChoice::Suggested, None) if self.isosurfaces.is_empty() => Values::Open,
            (TransferChoice::Labels, None) => Values::Labels,
            (TransferChoice::Suggested | TransferChoice::Preset(_) | TransferChoice::Given(_), None) => {
                Values::Transfer
            }
        }
    }

    /// Makes settings of pictures of several layers: the layers are classified voxel by voxel, and isosurfaces in them
    /// stay surfaces, which the processor draws.
    ///
    /// # Errors
    /// [`Error::Setting`] if the settings are for one volume alone.
    pub fn settle_layers(&self, settings: &mut Settings) -> Result<()> {
        if !self.isosurfaces.is_empty() {
            settings.shading = Shading::Pre;
            if settings.painter == Painter::Auto {
                settings.painter = Painter::Cpu;
            }
        }
        Layers::check_settings(settings)
    }

    /// Returns whether values may be taken for labels: nothing is requested that labels lack.
    #[must_use]
    pub fn may_be_labels(&self, settings: &Settings) -> bool {
        let asks = self.gradient.is_some() || self.classification.is_some() || !self.isosurfaces.is_empty();
        !asks && Layers::check_settings(settings).is_ok()
    }

    /// Returns whether [`Self::fit`] may need statistics: of presets, and of files that are stretched over the values.
    #[must_use]
    pub fn needs_statistics(&self) -> bool {
        match &self.choice {
            TransferChoice::Suggested => self.isosurfaces.is_empty(),
            TransferChoice::Preset(_) => true,
            TransferChoice::Given(imported) => imported.fits && self.window.is_none(),
            TransferChoice::Labels => false,
        }
    }

    /// Fits the transfer function to a volume from `source`: a file, or `demo:NAME`. Finds that values are labels only
    /// if they may be. Calls `statistics` only if it needs them.
    ///
    /// # Errors
    /// The errors of [`ValueMeaning::find`], [`Imported::placed`], [`TransferFunction::stretched`] and `statistics`.
    pub fn fit(
        &self,
        source: &Path,
        volume: &Volume,
        may_be_labels: bool,
        statistics: impl FnOnce() -> Result<Statistics>,
    ) -> Result<FittedTransfer> {
        let labels = |choice| Ok(FittedTransfer { labels: true, choice, ..FittedTransfer::clear()? });
        let mut window = self.window;
        let mut fitted = match &self.choice {
            TransferChoice::Labels => return labels(None),
            TransferChoice::Given(imported) => {
                // The window places the points of a file, it does not stretch them.
                let place = match window.take() {
                    None if imported.fits => Window::of_foreground(&statistics()?),
                    given => given,
                };
                FittedTransfer::new(imported.placed(volume.grid(), place.as_ref())?, None)
            }
            TransferChoice::Preset(preset) => {
                let statistics = statistics()?;
                let fitted = |values| presets::preset(preset.name, volume, &statistics, values);
                let values_matter = self.values == PresetValues::Auto
                    || fitted(PresetValues::Absolute)? != fitted(PresetValues::Fitted)?;
                FittedTransfer { values_matter, ..FittedTransfer::new(fitted(self.values)?, Some(preset)) }
            }
            TransferChoice::Suggested if !self.isosurfaces.is_empty() => {
                let transfer = TransferFunction::of_isosurfaces(&self.isosurfaces)?;
                return Ok(FittedTransfer {
                    material: Some(isosurface::MATERIAL),
                    ..FittedTransfer::new(transfer, None)
                });
            }
            TransferChoice::Suggested => {
                match ValueMeaning::find(source, volume, may_be_labels, self.values, statistics)? {
                    ValueMeaning::Values { transfer, preset, reason, is_guess } => {
                        let choice = Some(Choice::Preset { name: preset.name, reason, is_guess });
                        FittedTransfer { choice, ..FittedTransfer::new(transfer, Some(preset)) }
                    }
                    ValueMeaning::BuiltIn(transfer) => {
                        let material = demos::own_look(source).and_then(|look| look.material);
                        FittedTransfer { material, ..FittedTransfer::new(transfer, None) }
                    }
                    ValueMeaning::Labels { reason } => return labels(Some(Choice::Labels { reason })),
                }
            }
        };
        if let Some(window) = &window {
            fitted.transfer = fitted.transfer.stretched(window)?;
        }
        if let Some(GradientSpec(points)) = &self.gradient {
            fitted.transfer = fitted.transfer.with_gradient_opacity(points.clone())?;
        }
        if let Some(classification) = self.classification {
            fitted.transfer = fitted.transfer.with_classification(classification);
        }
        if !self.isosurfaces.is_empty() {
            fitted.transfer = fitted.transfer.with_isosurfaces(&self.isosurfaces)?;
            fitted.material = fitted.material.or(Some(isosurface::MATERIAL));
        }
        Ok(fitted)
    }
}

/// Returns the error of a name that is no transfer function.
fn no_transfer(name: &Path) -> String {
    let text = name.to_string_lossy();
    if maps::find(&text).is_ok() {
        return format!("{name:?} is a colour map, give map:{text}");
    }
    let known: Vec<&str> = PRESETS.iter().map(|preset| preset.name).collect();
    format!("{name:?}, expected a file, map:NAME, labels or one of {}", known.join(", "))
}

/// Returns the name or the file of a colour map.
fn of_map(transfer: &Path) -> Option<&Path> {
    transfer.to_str()?.strip_prefix(MAP).map(Path::new)
}

/// Returns whether the text must mean a file. Then a missing file is reported, instead of an unknown name.
fn is_file_name(text: &Path) -> bool {
    let lossy = text.to_string_lossy();
    if lossy == "-" {
        return true;
    }
    if lossy.starts_with('{') {
        return false;
    }
    let file = lossy.split('#').next().unwrap_or_default().to_lowercase();
    let endings = [".json", ".vp", ".xml"];
    endings.iter().any(|ending| file.ends_with(ending)) || lossy.contains(['/', '\\', '#']) || text.is_file()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradient_opacities() {
        let gradient = |text: &str| text.parse::<GradientSpec>();
        let point = |magnitude, opacity| GradientPoint { magnitude, opacity };
        assert_eq!(gradient("1:0, 2.5:1").unwrap(), GradientSpec(vec![point(1.0, 0.0), point(2.5, 1.0)]));
        assert_eq!(gradient("off").unwrap(), GradientSpec(vec![]));
        for (bad, expected) in [
            ("", "expected off, or"),
            ("1", "expected off, or"),
            ("1:2", "opacity"),
            ("2:0,1:1", "magnitude"),
            ("a:1", "expected off, or"),
            ("-1:0", "magnitude"),
        ] {
            let error = gradient(bad).unwrap_err().to_string();
            assert!(error.contains(expected), "{bad}: {error}");
        }
    }
}
