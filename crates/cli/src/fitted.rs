//! Transfer functions fitted to volumes, with notes.

use std::path::Path;

use voxsplat::appearance::Choice;
use voxsplat::program::{FittedTransfer, GUESS, TransferChoice, TransferRequest};
use voxsplat::transfer::presets::{Material, Preset};
use voxsplat::transfer::{Imported, TransferFunction};
use voxsplat::volume::{Statistics, Volume};
use voxsplat_volume::names::readable;

use super::failure::Failure;
use super::stages::Stages;

/// The transfer function of a job.
pub(crate) struct Fitted {
    pub(crate) transfer: TransferFunction,
    /// The preset of the transfer function, if it has one.
    pub(crate) preset: Option<&'static Preset>,
    /// The material of the surfaces that the transfer function shows, by its preset or its built-in volume.
    pub(crate) material: Option<Material>,
    /// Whether values are labels, which have no transfer function.
    pub(crate) labels: bool,
    /// Whether the volume has the colour of the first channel.
    pub(crate) is_channel: bool,
    /// The notes on the transfer function for the user.
    pub(crate) notes: Vec<String>,
}

impl Fitted {
    fn new(fitted: FittedTransfer, notes: Vec<String>) -> Self {
        let FittedTransfer { transfer, preset, material, labels, .. } = fitted;
        Self { transfer, preset, material, labels, is_channel: false, notes }
    }

    /// Makes a clear transfer function, for layers that have their own.
    pub(crate) fn clear() -> Result<Self, Failure> {
        Ok(Self::new(FittedTransfer::clear()?, Vec::new()))
    }
}

/// Returns the transfer function of a job; `None` if its values may be labels and are.
pub(crate) fn transfer(
    source: &Path,
    requested: &TransferRequest,
    volume: &Volume,
    may_be_labels: bool,
    overlays: usize,
    stages: &mut Stages,
) -> Result<Fitted, Failure> {
    let mut found = None;
    let statistics = || stages.time("statistics", || Ok(found.insert(Statistics::of(volume)?).clone()));
    let fitted = requested.fit(source, volume, may_be_labels, statistics)?;
    let (fitted, under) = match overlays {
        0 => (fitted, None),
        _ => {
            let statistics = found.map_or_else(|| Statistics::of(volume), Ok)?;
            fitted.under_overlays(requested, volume, &statistics, overlays)?
        }
    };
    let mut notes = match &requested.choice {
        TransferChoice::Given(imported) => notes_on(imported, &fitted.transfer, requested.window.is_some(), volume),
        TransferChoice::Preset(preset) if !fitted.values_matter => {
            let reason = format!("because preset {} has no absolute values", preset.name);
            vec![format!("note: --transfer-values has no effect {reason}")]
        }
        _ => Vec::new(),
    };
    notes.extend(fitted.choice.as_ref().map(|choice| match choice {
        Choice::Preset { name, reason, is_guess } => {
            let guess = if *is_guess { GUESS } else { "" };
            format!("note: using --transfer {name}{guess} because {reason} (choose another: --transfer)")
        }
        Choice::Labels { reason } => {
            format!("note: using --transfer labels because {reason} (show values: --transfer grayscale)")
        }
        other => format!("note: using {other}"),
    }));
    notes.extend(under.as_ref().map(|choice| format!("note: using {choice} (as it is: --transfer)")));
    Ok(Fitted { is_channel: under == Some(Choice::Channel), ..Fitted::new(fitted, notes) })
}

/// Returns notes on the properties that the file of a transfer function leaves open.
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
