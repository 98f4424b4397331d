//! Transfer functions fitted to volumes.

use std::path::Path;

use voxsplat::appearance::{GUESS, ValueMeaning};
use voxsplat::demos;
use voxsplat::transfer::presets::{self, Material, Preset, PresetValues};
use voxsplat::transfer::{ControlPoint, Imported, TransferFunction, Window};
use voxsplat::volume::{Statistics, Volume};
use voxsplat_volume::names::readable;

use super::failure::Failure;
use super::parse::GradientOpacity;
use super::stages::Stages;
use super::transfer::{Transfer, TransferChoice};

/// The transfer function of a job.
pub(crate) struct Fitted {
    pub(crate) transfer: TransferFunction,
    /// The preset that it is.
    pub(crate) preset: Option<&'static Preset>,
    /// The material of the surfaces that it shows, by its preset or its built-in volume.
    pub(crate) material: Option<Material>,
    /// Whether there is none, because values are labels.
    pub(crate) labels: bool,
    /// Notes for the user.
    pub(crate) notes: Vec<String>,
}

impl Fitted {
    fn new(transfer: TransferFunction, preset: Option<&'static Preset>, notes: Vec<String>) -> Self {
        Self { transfer, preset, material: preset.and_then(|p| p.material), labels: false, notes }
    }

    /// A clear transfer function, for layers that have their own.
    pub(crate) fn clear() -> Result<Self, Failure> {
        let clear = ControlPoint { value: 0.0, color: [0.0; 3], opacity: 0.0 };
        Ok(Self::new(TransferFunction::new(vec![clear], None)?, None, Vec::new()))
    }
}

/// Returns the transfer function of a job, or none if its values may be labels and are.
pub(crate) fn transfer(
    source: &Path,
    requested: &Transfer,
    volume: &Volume,
    may_be_labels: bool,
    stages: &mut Stages,
) -> Result<Fitted, Failure> {
    let labels = |notes| Ok(Fitted { labels: true, notes, ..Fitted::clear()? });
    let (mut window, values) = (requested.window, requested.values);
    let mut statistics = || stages.time("statistics", || Statistics::of(volume));
    let mut fitted = match &requested.choice {
        TransferChoice::Labels => return labels(Vec::new()),
        TransferChoice::Given(imported) => {
            // The window places the points of a file, it does not stretch them.
            let place = match window.take() {
                None if imported.fits => Window::of_foreground(&statistics()?),
                given => given,
            };
            let transfer = imported.placed(volume.grid(), place.as_ref())?;
            let notes = notes_on(imported, &transfer, requested.window.is_some(), volume);
            Fitted::new(transfer, None, notes)
        }
        TransferChoice::Preset(preset) => {
            let statistics = statistics()?;
            let transfer = presets::preset(preset.name, volume, &statistics, values)?;
            let fitted = |values| presets::preset(preset.name, volume, &statistics, values);
            let mut notes = Vec::new();
            if values != PresetValues::Auto && fitted(PresetValues::Absolute)? == fitted(PresetValues::Fitted)? {
                let reason = format!("because preset {} has no absolute values", preset.name);
                notes.push(format!("note: --transfer-values has no effect {reason}"));
            }
            Fitted::new(transfer, Some(preset), notes)
        }
        TransferChoice::Suggested => {
            match ValueMeaning::find(source, volume, may_be_labels, values, || Ok(statistics()?))? {
                ValueMeaning::Values { transfer, preset, reason, is_guess } => {
                    let guess = if is_guess { GUESS } else { "" };
                    let name = preset.name;
                    let note =
                        format!("note: using --transfer {name}{guess} because {reason} (choose another: --transfer)");
                    Fitted::new(transfer, Some(preset), vec![note])
                }
                ValueMeaning::BuiltIn(transfer) => {
                    let material = demos::own_look(source).and_then(|look| look.material);
                    Fitted { material, ..Fitted::new(transfer, None, Vec::new()) }
                }
                ValueMeaning::Labels { reason } => {
                    let note =
                        format!("note: using --transfer labels because {reason} (show values: --transfer grayscale)");
                    return labels(vec![note]);
                }
            }
        }
    };
    if let Some(window) = &window {
        fitted.transfer = fitted.transfer.stretched(window)?;
    }
    if let Some(GradientOpacity(points)) = &requested.gradient {
        fitted.transfer = fitted.transfer.with_gradient_opacity(points.clone())?;
    }
    Ok(fitted)
}

/// Returns notes on what the file of a transfer function leaves open.
fn notes_on(imported: &Imported, transfer: &TransferFunction, windowed: bool, volume: &Volume) -> Vec<String> {
    let mut notes: Vec<String> = imported.notes.iter().map(|note| format!("note: transfer function: {note}")).collect();
    if let (true, Some(unit)) = (imported.mean_spacing, transfer.unit_distance()) {
        let length = volume.length_unit().unwrap_or("world units");
        let thickness = format!("slabs {} {length} thick, the mean spacing", readable(unit));
        notes.push(format!(
            "note: transfer function: using opacities of {thickness}, because the file states no length"
        ));
    }
    if imported.fits && !windowed {
        let [low, high] = transfer.range().map(readable);
        notes.push(format!("note: using values from {low} to {high}, the foreground (change: --window LEVEL,WIDTH)"));
    }
    notes
}
