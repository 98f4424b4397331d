//! Labels: what their numbers mean and look like.

use std::collections::BTreeMap;
use std::path::Path;

use rayon::prelude::*;
use serde::Serialize;

use super::table::{self, Label};
use crate::error::{Error, Result};
use crate::volume::{Segment, ToF64, Volume, with_samples};

/// How many voxels have a label.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct LabelCount {
    /// The label.
    pub label: i64,
    /// Its voxels.
    pub voxels: u64,
}

/// What labels look like: those of a table, and all others in colours of their own. Label 0 is clear unless it is said
/// to show.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Labels {
    table: BTreeMap<i64, Label>,
    changes: Vec<(Which, Change)>,
}

/// Some labels.
#[derive(Debug, Clone, PartialEq)]
pub enum Which {
    /// All but 0.
    All,
    /// Those with numbers in one of these ranges, both ends included.
    Numbers(Vec<[i64; 2]>),
    /// Those of this name, in any case.
    Name(String),
}

/// What becomes of some labels.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Change {
    Opacity(f64),
    /// A factor of the opacity.
    Share(f64),
    Color([f64; 3]),
}

/// What voxels of a label look like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Look {
    pub(crate) label: i64,
    pub(crate) color: [f64; 3],
    pub(crate) opacity: f64,
}

/// The opacity of a label that is opaque: three voxels of it hide all but a hundredth of what is behind, and show fewer
/// of the steps between voxels than denser ones.
const OPAQUE: f64 = 0.8;

/// The golden ratio's fraction: multiples of it are spread evenly around a circle, however many there are.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// The colour of a label that no table has: from red on, hues a golden angle apart, each far from those before it, in
/// three rounds of saturation and brightness.
fn own_color(label: i64) -> [f64; 3] {
    let number = label.unsigned_abs().wrapping_sub(1) as f64;
    let hue = (number * GOLDEN).rem_euclid(1.0);
    let [saturation, brightness] = [[0.75, 0.95], [0.5, 1.0], [0.85, 0.7]][(number % 3.0) as usize];
    // Hue, saturation and value (Smith 1978, "Color gamut transform pairs").
    [5.0, 3.0, 1.0].map(|n: f64| {
        let k = (n + 6.0 * hue) % 6.0;
        brightness * (1.0 - saturation * k.min(4.0 - k).clamp(0.0, 1.0))
    })
}

impl Labels {
    /// A table as programs write them: label descriptions of ITK-SNAP, colour tables of 3D Slicer (.ctbl, .csv) or
    /// lookup tables of `FreeSurfer`, told apart by their content.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if the file cannot be read, is
    /// no such table.
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        Ok(Self { table: table::load(path.as_ref())?, ..Self::default() })
    }

    /// Those that the file of a volume names, such as a segmentation of 3D Slicer (.seg.nrrd).
    #[must_use]
    pub fn stated(volume: &Volume) -> Self {
        let contents = volume.contents();
        let named = contents.segments.iter().flatten().filter(|segment| segment.channel == contents.channel);
        let label = |Segment { label, name, color, .. }: &Segment| {
            let color = color.map_or_else(|| own_color(*label), |color| color.map(|c| f64::from(c) / 255.0));
            (*label, Label { name: name.clone().unwrap_or_default(), color, opacity: 1.0 })
        };
        Self { table: named.map(label).collect(), ..Self::default() }
    }

    /// The same with a label of a table.
    #[must_use]
    pub fn with(mut self, label: i64, look: Label) -> Self {
        self.table.insert(label, look);
        self
    }

    /// The same with another opacity of some labels, 0 to 1.
    ///
    /// # Errors
    /// [`Error::Setting`] if the opacity is outside 0 to 1.
    pub fn with_opacity(mut self, which: Which, opacity: f64) -> Result<Self> {
        checked(opacity)?;
        self.changes.push((which, Change::Opacity(opacity)));
        Ok(self)
    }

    /// The same with another colour of some labels; channels beyond 0 to 1 are cut off.
    #[must_use]
    pub fn with_color(mut self, which: Which, color: [f64; 3]) -> Self {
        self.changes.push((which, Change::Color(color.map(|c| c.clamp(0.0, 1.0)))));
        self
    }

    /// Multiplies the opacities of some labels by a factor from 0 to 1.
    ///
    /// # Errors
    /// [`Error::Setting`] if the factor is outside 0 to 1.
    pub fn thinned(mut self, which: Which, factor: f64) -> Result<Self> {
        self.changes.push((which, Change::Share(checked(factor)?)));
        Ok(self)
    }

    /// What a label looks like, and its name; empty if no table has it.
    #[must_use]
    pub fn label(&self, label: i64) -> Label {
        let own = || {
            let opacity = if label == 0 { 0.0 } else { 1.0 };
            Label { name: String::new(), color: own_color(label), opacity }
        };
        let mut found = self.table.get(&label).cloned().unwrap_or_else(own);
        for (which, change) in &self.changes {
            if which.has(label, &found.name) {
                match *change {
                    Change::Opacity(opacity) => found.opacity = opacity,
                    Change::Share(factor) => found.opacity *= factor,
                    Change::Color(color) => found.color = color,
                }
            }
        }
        found
    }

    /// The looks and the names of labels that are there.
    pub(super) fn looks(&self, counts: &[LabelCount]) -> (Vec<Look>, Vec<String>) {
        let look = |count: &LabelCount| {
            let Label { color, opacity, name } = self.label(count.label);
            (Look { label: count.label, color, opacity: OPAQUE * opacity }, name)
        };
        counts.iter().map(look).unzip()
    }
}

fn checked(opacity: f64) -> Result<f64> {
    if (0.0..=1.0).contains(&opacity) {
        return Ok(opacity);
    }
    Err(Error::Setting { name: "label", reason: format!("opacity {opacity}, expected 0 to 1") })
}

impl Which {
    /// Whether a label of a name is among them.
    pub(super) fn has(&self, label: i64, name: &str) -> bool {
        match self {
            Self::All => label != 0,
            Self::Numbers(ranges) => ranges.iter().any(|[low, high]| (*low..=*high).contains(&label)),
            Self::Name(other) => name.eq_ignore_ascii_case(other),
        }
    }
}

impl std::str::FromStr for Which {
    type Err = Error;

    /// `all`, numbers and ranges of them (1,4,7-9), or a name.
    fn from_str(text: &str) -> Result<Self> {
        let text = text.trim();
        if text.is_empty() {
            return Err(Error::Setting { name: "label", reason: "expected all, 1,4,7-9, or a name".to_owned() });
        }
        if text.eq_ignore_ascii_case("all") {
            return Ok(Self::All);
        }
        let range = |part: &str| -> Option<[i64; 2]> {
            let part = part.trim();
            if let Ok(number) = part.parse() {
                return Some([number, number]);
            }
            // Not the sign of the first.
            let dash = part.char_indices().skip(1).find(|(_, c)| *c == '-')?.0;
            let ends = [part[..dash].trim().parse().ok()?, part[dash + 1..].trim().parse().ok()?];
            (ends[0] <= ends[1]).then_some(ends)
        };
        let ranges: Option<Vec<[i64; 2]>> = text.split(',').map(range).collect();
        Ok(ranges.map_or_else(|| Self::Name(text.to_owned()), Self::Numbers))
    }
}

/// The largest whole number up to which f64 holds all.
const MOST: f64 = 9_007_199_254_740_992.0;

/// What a value looks like, given all labels in ascending order.
pub(crate) fn look_of(looks: &[Look], value: f64) -> Option<&Look> {
    looks.binary_search_by_key(&(value as i64), |look| look.label).ok().map(|at| &looks[at])
}

/// The most labels of a volume.
const MOST_LABELS: usize = 1 << 20;

/// Samples looked at together.
const PIECE: usize = 1 << 18;

/// The labels of a volume in ascending order, with how many voxels have each.
///
/// # Errors
/// [`Error::Setting`] if values are not whole numbers of at most 2^53 or there are over a million of them;
/// [`Error::Input`](crate::Error::Input) if a value is NaN or infinite; [`Error::Input`](crate::Error::Input) and
/// [`Error::Memory`] if samples left in a file cannot be read.
pub fn count_labels(volume: &Volume) -> Result<Vec<LabelCount>> {
    volume.check_finite()?;
    let (slope, intercept) = volume.rescale();
    let wrong = |reason: String| Error::Setting { name: "labels", reason };
    let mut all: BTreeMap<i64, u64> = BTreeMap::new();
    let mut add = |counts: Vec<(f64, u64)>| -> Result<()> {
        for (raw, count) in counts {
            let value = slope * raw + intercept;
            if value.fract() != 0.0 || value.abs() > MOST {
                return Err(wrong(format!("value {value} is no label: expected whole numbers")));
            }
            *all.entry(value as i64).or_default() += count;
        }
        match all.len() > MOST_LABELS {
            true => Err(wrong(format!("over {MOST_LABELS} different values: the volume is none of labels"))),
            false => Ok(()),
        }
    };
    let counted = |counts: Vec<Result<Vec<(f64, u64)>>>| counts.into_iter().collect::<Result<Vec<_>>>();
    let total = volume.grid().len() as usize;
    for start in (0..total).step_by(PIECE * 16) {
        let end = total.min(start + PIECE * 16);
        let pieces: Vec<usize> = (start..end).step_by(PIECE).collect();
        let piece = |&first: &usize| {
            let samples = volume.read(first..end.min(first + PIECE))?;
            Ok(with_samples!(&samples, s => counts(s)))
        };
        counted(pieces.par_iter().map(piece).collect())?.into_iter().try_for_each(&mut add)?;
    }
    Ok(all.into_iter().map(|(label, voxels)| LabelCount { label, voxels }).collect())
}

/// How often samples occur.
fn counts<T: ToF64>(samples: &[T]) -> Vec<(f64, u64)> {
    let mut found: BTreeMap<u64, u64> = BTreeMap::new();
    let mut rest = samples.iter().map(|sample| sample.to_f64().to_bits()).peekable();
    while let Some(bits) = rest.next() {
        // Labels come in runs.
        let mut run = 1;
        while rest.next_if_eq(&bits).is_some() {
            run += 1;
        }
        *found.entry(bits).or_default() += run;
    }
    found.into_iter().map(|(bits, count)| (f64::from_bits(bits), count)).collect()
}
