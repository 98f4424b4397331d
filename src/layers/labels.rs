//! Labels: the names, colours and opacities of their numbers.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

use rayon::prelude::*;
use serde::Serialize;

use super::table::{self, Label};
use crate::error::{Error, Result};
use crate::transfer::color;
use crate::volume::{Segment, ToF64, Volume, with_samples};

/// The number of voxels with a label.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct LabelCount {
    /// The number by which voxels carry the label.
    pub label: i64,
    /// The number of voxels with the label.
    pub voxels: u64,
}

/// The looks of labels: a table, and generated colours for labels that the table lacks. Label 0 is clear unless it is
/// made visible.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Labels {
    table: BTreeMap<i64, Label>,
    changes: Vec<(LabelSelection, LabelChange)>,
}

/// A choice of labels.
#[derive(Debug, Clone, PartialEq)]
pub enum LabelSelection {
    /// All labels but 0.
    All,
    /// Labels with numbers in one of these ranges, both ends included.
    Numbers(Vec<[i64; 2]>),
    /// Labels with this name, in upper or lower case.
    Name(String),
}

/// A change of the look of some labels.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum LabelChange {
    /// Another opacity, 0 to 1.
    Opacity(f64),
    /// A factor of the opacity, 0 to 1.
    Factor(f64),
    /// Another colour: red, green and blue; channels are clamped to 0 to 1.
    Color([f64; 3]),
}

/// The look of voxels with a label.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LabelLook {
    pub(crate) label: i64,
    pub(crate) color: [f64; 3],
    pub(crate) opacity: f64,
}

/// The opacity of a voxel of an opaque label: three voxels hide all but a hundredth of the light behind them, and steps
/// between voxels show less than with denser ones.
const OPAQUE: f64 = 0.8;

/// The fraction of the golden ratio, whose multiples are spread evenly around a circle.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// Returns the generated colour of a label that no table has: hues a golden angle apart, beginning with red, each far
/// from the hues before it, in three rounds of saturation and brightness.
fn generated_color(label: i64) -> [f64; 3] {
    let number = label.unsigned_abs().wrapping_sub(1) as f64;
    let hue = (number * GOLDEN).rem_euclid(1.0);
    let [saturation, brightness] = [[0.75, 0.95], [0.5, 1.0], [0.85, 0.7]][(number % 3.0) as usize];
    color::hsv([hue, saturation, brightness])
}

impl Labels {
    /// Loads a table of another program: label descriptions of ITK-SNAP, colour tables of 3D Slicer (.ctbl, .csv) or
    /// lookup tables of `FreeSurfer`, told apart by their content.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the file cannot be read or is no such table.
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        Ok(Self { table: table::load(path.as_ref())?, ..Self::default() })
    }

    /// Returns the labels that the file of a volume names, such as a segmentation of 3D Slicer (.seg.nrrd).
    #[must_use]
    pub fn stated(volume: &Volume) -> Self {
        let contents = volume.contents();
        let named = contents.segments.iter().flatten().filter(|segment| segment.channel == contents.channel);
        let label = |Segment { label, name, color, .. }: &Segment| {
            let color = color.map_or_else(|| generated_color(*label), |color| color.map(|c| f64::from(c) / 255.0));
            (*label, Label { name: name.clone().unwrap_or_default(), color, opacity: 1.0 })
        };
        Self { table: named.map(label).collect(), ..Self::default() }
    }

    /// Adds a label to the table.
    #[must_use]
    pub fn with(mut self, label: i64, look: Label) -> Self {
        self.table.insert(label, look);
        self
    }

    /// Changes the look of some labels.
    ///
    /// # Errors
    /// [`Error::Setting`] if an opacity or a factor is outside 0 to 1.
    pub fn changed(mut self, which: LabelSelection, change: LabelChange) -> Result<Self> {
        if let LabelChange::Opacity(opacity) | LabelChange::Factor(opacity) = change
            && !(0.0..=1.0).contains(&opacity)
        {
            return Err(Error::setting("label", format!("opacity {opacity}, expected 0 to 1")));
        }
        self.changes.push((which, change));
        Ok(self)
    }

    /// Returns the look of a label, and its name, which is empty if no table has the label.
    #[must_use]
    pub fn label(&self, label: i64) -> Label {
        let mut found = self.table.get(&label).cloned().unwrap_or_else(|| Label {
            name: String::new(),
            color: generated_color(label),
            opacity: if label == 0 { 0.0 } else { 1.0 },
        });
        for (which, change) in &self.changes {
            if which.has(label, &found.name) {
                match *change {
                    LabelChange::Opacity(opacity) => found.opacity = opacity,
                    LabelChange::Factor(factor) => found.opacity *= factor,
                    LabelChange::Color(color) => found.color = color.map(|channel| channel.clamp(0.0, 1.0)),
                }
            }
        }
        found
    }

    /// Returns the looks and the names of the labels of a volume.
    pub(super) fn looks(&self, counts: &[LabelCount]) -> (Vec<LabelLook>, Vec<String>) {
        let look = |count: &LabelCount| {
            let Label { color, opacity, name } = self.label(count.label);
            (LabelLook { label: count.label, color, opacity: OPAQUE * opacity }, name)
        };
        counts.iter().map(look).unzip()
    }
}

impl LabelSelection {
    /// Returns whether the labels include a label with a name.
    pub(crate) fn has(&self, label: i64, name: &str) -> bool {
        match self {
            Self::All => label != 0,
            Self::Numbers(ranges) => ranges.iter().any(|[low, high]| (*low..=*high).contains(&label)),
            Self::Name(other) => name.eq_ignore_ascii_case(other),
        }
    }
}

impl fmt::Display for LabelSelection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let range = |[low, high]: &[i64; 2]| if low == high { low.to_string() } else { format!("{low}-{high}") };
        match self {
            Self::All => f.write_str("all"),
            Self::Numbers(ranges) => f.write_str(&ranges.iter().map(range).collect::<Vec<_>>().join(",")),
            Self::Name(name) => f.write_str(name),
        }
    }
}

impl std::str::FromStr for LabelSelection {
    type Err = Error;

    /// Parses `all`, numbers and ranges (1,4,7-9), or a name.
    fn from_str(text: &str) -> Result<Self> {
        let text = text.trim();
        if text.is_empty() {
            return Err(Error::setting("label", "expected all, 1,4,7-9, or a name"));
        }
        if text.eq_ignore_ascii_case("all") {
            return Ok(Self::All);
        }
        let range = |part: &str| -> Option<[i64; 2]> {
            let part = part.trim();
            // A dash at the beginning is a sign.
            let dash = part.char_indices().skip(1).find(|(_, c)| *c == '-');
            let (low, high) = dash.map_or((part, part), |(at, _)| (&part[..at], &part[at + 1..]));
            let ends = [low.trim().parse().ok()?, high.trim().parse().ok()?];
            (ends[0] <= ends[1]).then_some(ends)
        };
        let ranges: Option<Vec<[i64; 2]>> = text.split(',').map(range).collect();
        Ok(ranges.map_or_else(|| Self::Name(text.to_owned()), Self::Numbers))
    }
}

/// The largest whole number up to which f64 holds every whole number.
const LARGEST_LABEL: f64 = 9_007_199_254_740_992.0;

/// Finds the look of a value, given the looks of all labels in ascending order.
pub(crate) fn look_of(looks: &[LabelLook], value: f64) -> Option<&LabelLook> {
    looks.binary_search_by_key(&(value as i64), |look| look.label).ok().map(|at| &looks[at])
}

/// The largest number of different labels of a volume.
const MOST_LABELS: usize = 1 << 20;

/// The number of samples that are counted together, in pieces that are read in parallel.
const PIECE: usize = 1 << 18;
const PIECES: usize = 16;

/// Counts the voxels of each label of a volume; labels ascend.
///
/// # Errors
/// [`Error::Setting`] if values are not whole numbers of at most 2^53 or there are over a million of them;
/// [`Error::Input`](crate::Error::Input) if a value is NaN or infinite; [`Error::Input`](crate::Error::Input) and
/// [`Error::Memory`] if samples left in a file cannot be read.
pub fn count_labels(volume: &Volume) -> Result<Vec<LabelCount>> {
    volume.check_finite()?;
    let (slope, intercept) = volume.rescale();
    let total = volume.grid().len() as usize;
    let piece = |&start: &usize| -> Result<BTreeMap<u64, u64>> {
        let samples = volume.read(start..total.min(start + PIECE))?;
        Ok(with_samples!(&samples, s => counts(s)))
    };
    let mut all: BTreeMap<i64, u64> = BTreeMap::new();
    let starts: Vec<usize> = (0..total).step_by(PIECE).collect();
    for starts in starts.chunks(PIECES) {
        let found = starts.par_iter().map(piece).collect::<Result<Vec<_>>>()?;
        for (raw, count) in found.into_iter().flatten() {
            let value = slope * f64::from_bits(raw) + intercept;
            if value.fract() != 0.0 || value.abs() > LARGEST_LABEL {
                return Err(Error::setting("labels", format!("value {value} is no label: expected whole numbers")));
            }
            *all.entry(value as i64).or_default() += count;
        }
        if all.len() > MOST_LABELS {
            let reason = format!("over {MOST_LABELS} different values: the volume is none of labels");
            return Err(Error::setting("labels", reason));
        }
    }
    Ok(all.into_iter().map(|(label, voxels)| LabelCount { label, voxels }).collect())
}

/// Returns the number of samples of each value, by its bits.
fn counts<T: ToF64 + PartialEq>(samples: &[T]) -> BTreeMap<u64, u64> {
    let mut found = BTreeMap::new();
    // Labels come in runs.
    for (value, length) in runs(samples) {
        *found.entry(value.to_bits()).or_default() += length;
    }
    found
}

/// Splits samples into runs of one value: the value and the length of each.
pub(super) fn runs<T: ToF64 + PartialEq>(samples: &[T]) -> impl Iterator<Item = (f64, u64)> {
    samples.chunk_by(|a, b| a == b).map(|run| (run[0].to_f64(), run.len() as u64))
}
