//! Transfer functions fitted to volumes.

use std::path::Path;

use voxsplat::appearance::Meaning;
use voxsplat::transfer::presets::{self, Preset};
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
    /// Whether there is none, as values are labels.
    pub(crate) labels: bool,
    /// For the user: why it was suggested, if it was.
    pub(crate) suggested: Option<String>,
    /// For the user: what was found out.
    pub(crate) notes: Vec<String>,
}

impl Fitted {
    fn new(transfer: TransferFunction) -> Self {
        Self { transfer, preset: None, labels: false, suggested: None, notes: Vec::new() }
    }

    /// What stands for none, where layers say what shows.
    pub(crate) fn clear() -> Result<Self, Failure> {
        let clear = ControlPoint { value: 0.0, color: [0.0; 3], opacity: 0.0 };
        Ok(Self::new(TransferFunction::new(vec![clear], None)?))
    }

    /// All that the user should know of it.
    pub(crate) fn notes(&self) -> impl Iterator<Item = &String> {
        self.suggested.iter().chain(&self.notes)
    }
}

/// The transfer function of a job, or none if its values may be labels and are.
pub(crate) fn transfer(
    source: &Path,
    asked: &Transfer,
    volume: &Volume,
    may_be_labels: bool,
    stages: &mut Stages,
) -> Result<Fitted, Failure> {
    let mut fitted = fitted(source, asked, volume, may_be_labels, stages)?;
    if let Some(GradientOpacity(points)) = &asked.gradient {
        fitted.transfer = fitted.transfer.with_gradient_opacity(points.clone())?;
    }
    Ok(fitted)
}

/// The same with the gradient opacity that it has.
fn fitted(
    source: &Path,
    asked: &Transfer,
    volume: &Volume,
    may_be_labels: bool,
    stages: &mut Stages,
) -> Result<Fitted, Failure> {
    let mut statistics = || stages.time("statistics", || Statistics::of(volume));
    let fitted = match &asked.choice {
        // There is none: layers have the labels.
        TransferChoice::Labels => return Ok(Fitted { labels: true, ..Fitted::clear()? }),
        TransferChoice::Given(imported) => {
            let window = match asked.window {
                None if imported.fits => Window::of(&statistics()?),
                given => given,
            };
            let transfer = imported.placed(volume.grid(), window.as_ref())?;
            let notes = notes_on(imported, &transfer, asked.window.is_some(), volume);
            return Ok(Fitted { notes, ..Fitted::new(transfer) });
        }
        TransferChoice::Preset(preset) => {
            let transfer = presets::preset(preset.name, volume, &statistics()?)?;
            Fitted { preset: Some(preset), ..Fitted::new(transfer) }
        }
        TransferChoice::Suggested => match Meaning::of(source, volume, may_be_labels, || Ok(statistics()?))? {
            Meaning::Values { transfer, preset, reason } => {
                let name = preset.name;
                let suggested = format!("note: using --transfer {name} because {reason} (choose another: --transfer)");
                Fitted { preset: Some(preset), suggested: Some(suggested), ..Fitted::new(transfer) }
            }
            Meaning::BuiltIn(transfer) => return Ok(Fitted::new(transfer)),
            Meaning::Labels { reason } => {
                let note =
                    format!("note: using --transfer labels because {reason} (show values: --transfer grayscale)");
                return Ok(Fitted { labels: true, suggested: Some(note), ..Fitted::clear()? });
            }
        },
    };
    Ok(match &asked.window {
        Some(window) => Fitted { transfer: fitted.transfer.stretched(window)?, ..fitted },
        None => fitted,
    })
}

/// What a transfer function from a file leaves open, and how it was filled.
fn notes_on(imported: &Imported, transfer: &TransferFunction, windowed: bool, volume: &Volume) -> Vec<String> {
    let mut notes: Vec<String> = imported.notes.iter().map(|note| format!("note: transfer function: {note}")).collect();
    if let (true, Some(unit)) = (imported.mean_spacing, transfer.unit_distance()) {
        let length = volume.length_unit().unwrap_or("world units");
        let thickness = format!("slabs {} {length} thick, the mean spacing", readable(unit));
        notes.push(format!("note: transfer function: its opacities are taken for {thickness}, as none is stated"));
    }
    if imported.fits && !windowed {
        let [low, high] = transfer.range().map(readable);
        notes.push(format!("note: colours run from {low} to {high}, the foreground; --window LEVEL,WIDTH places them"));
    }
    notes
}
