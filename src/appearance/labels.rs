//! The looks of labels and the mask that a user requests.

use std::path::Path;
use std::str::FromStr;

use crate::error::{Error, Result};
use crate::layers::{LabelChange, LabelSelection, Labels, Layer, Layers};
use crate::transfer::color;
use crate::volume::Volume;

/// A change of the looks of some labels.
#[derive(Debug, Clone, PartialEq)]
pub struct LabelSpec {
    /// The labels whose looks change.
    pub which: LabelSelection,
    /// The change of these labels' looks.
    pub change: LabelChange,
}

impl FromStr for LabelSpec {
    type Err = Error;

    /// Parses `WHICH:OPACITY`, `WHICH:xFACTOR`, `WHICH:on`, `WHICH:off` or `WHICH:COLOUR`.
    fn from_str(text: &str) -> Result<Self> {
        let parsed = || {
            let (which, look) = text.rsplit_once(':')?;
            let share = |text: &str| text.parse().ok().filter(|share| (0.0..=1.0).contains(share));
            let factor = look.strip_prefix('x').and_then(share);
            let change = match (look, factor, look.parse::<f64>()) {
                ("on", ..) => LabelChange::Opacity(1.0),
                ("off", ..) => LabelChange::Opacity(0.0),
                (_, Some(factor), _) => LabelChange::Factor(factor),
                (_, None, Ok(_)) => LabelChange::Opacity(share(look)?),
                (_, None, Err(_)) => LabelChange::Color(color::parse(look)?),
            };
            Some(Self { which: which.parse().ok()?, change })
        };
        parsed().ok_or_else(|| {
            let expected = "expected WHICH:LOOK; WHICH is all, numbers such as 1,4,7-9, or a name, and LOOK an opacity \
                            from 0 to 1, xF (a factor of the opacity from 0 to 1), on, off or a colour";
            let tip = text.rsplit_once(':').map(|(_, look)| color::tip(look)).unwrap_or_default();
            Error::setting("label", format!("{expected}{tip}"))
        })
    }
}

/// The looks of labels: of a table or of their file, with changes.
#[derive(Debug, Clone, Default)]
pub struct LabelLooks {
    table: Option<Labels>,
    changes: Vec<LabelSpec>,
}

impl LabelLooks {
    /// Loads the table, if there is one. Later changes apply to the result of earlier ones.
    ///
    /// # Errors
    /// The errors of [`Labels::load`], and of [`Labels::changed`].
    pub fn new(table: Option<&Path>, changes: &[LabelSpec]) -> Result<Self> {
        let looks = Self { table: table.map(Labels::load).transpose()?, changes: changes.to_vec() };
        // Whether changes are valid does not depend on the labels.
        looks.changed(Labels::default())?;
        Ok(looks)
    }

    fn changed(&self, labels: Labels) -> Result<Labels> {
        self.changes
            .iter()
            .try_fold(labels, |labels, LabelSpec { which, change }| labels.changed(which.clone(), *change))
    }

    /// Returns the labels of a volume: of the table, or else of the volume's file.
    ///
    /// # Errors
    /// The errors of [`Labels::changed`].
    pub fn of(&self, volume: &Volume) -> Result<Labels> {
        self.changed(self.table.clone().unwrap_or_else(|| Labels::stated(volume)))
    }

    /// Returns why layers are [hidden](Layers::hidden), and why changes of looks have no effect: because no voxel of
    /// the layers has such a label.
    #[must_use]
    pub fn notes_on(&self, layers: &Layers) -> Vec<String> {
        let labels: Vec<(i64, &str)> = layers.labels().collect();
        let misses = |change: &&LabelSpec| !labels.iter().any(|&(label, name)| change.which.has(label, name));
        let changes = self.changes.iter().filter(|_| !labels.is_empty()).filter(misses);
        let without_effect = changes.map(|LabelSpec { which, .. }| match which {
            LabelSelection::Name(name) => format!("the look of {name:?} has no effect because no label has this name"),
            _ => format!("the look of {which} has no effect because no voxel has such a label"),
        });
        layers.hidden().into_iter().map(str::to_owned).chain(without_effect).collect()
    }

    /// Returns the layer of a volume of labels.
    ///
    /// # Errors
    /// The errors of [`Layer::labels`], of a setting `option`.
    pub fn layer(&self, volume: &Volume, option: &'static str) -> Result<Layer> {
        Layer::labels(volume, &self.of(volume)?).map_err(|error| named(error, option))
    }

    /// Masks layers, and adds volumes of labels on their lattice.
    ///
    /// # Errors
    /// The errors of [`Layer::masked`], [`Layer::labels`] and [`Layers::with`]; [`Error::Image`] if there is no layer.
    pub fn over(
        &self,
        mut base: Vec<Layer>,
        mask: Option<(&Volume, &LabelSelection)>,
        labels: &[Volume],
    ) -> Result<Layers> {
        if let Some((mask, which)) = mask {
            let masked = |layer: Layer| layer.masked(mask, which).map_err(|error| named(error, "mask"));
            base = base.into_iter().map(masked).collect::<Result<_>>()?;
        }
        for volume in labels {
            base.push(self.layer(volume, "labels")?);
        }
        let mut layers = base.into_iter();
        let first = layers.next().map(Layers::new).ok_or_else(|| Error::Image("nothing to draw".to_owned()))?;
        layers.try_fold(first, Layers::with)
    }
}

/// Returns an error of a setting with the name of the option that was given.
fn named(error: Error, option: &'static str) -> Error {
    match error {
        Error::Setting { reason, .. } => Error::Setting { name: option, reason },
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_told_by_number_range_and_name() {
        let numbers = |ranges: &[[i64; 2]]| LabelSelection::Numbers(ranges.to_vec());
        let name = |name: &str| LabelSelection::Name(name.to_owned());
        for (text, which, change) in [
            ("3:0.5", numbers(&[[3, 3]]), LabelChange::Opacity(0.5)),
            ("-4--2,7:off", numbers(&[[-4, -2], [7, 7]]), LabelChange::Opacity(0.0)),
            ("all:on", LabelSelection::All, LabelChange::Opacity(1.0)),
            ("Left kidney:#ff0000", name("Left kidney"), LabelChange::Color([1.0, 0.0, 0.0])),
            ("2-3:x0.25", numbers(&[[2, 3]]), LabelChange::Factor(0.25)),
            ("2:Gold", numbers(&[[2, 2]]), LabelChange::Color([1.0, 215.0 / 255.0, 0.0])),
            ("a:b:red", name("a:b"), LabelChange::Color([1.0, 0.0, 0.0])),
        ] {
            assert_eq!(text.parse::<LabelSpec>().unwrap(), LabelSpec { which, change }, "{text}");
        }
        for bad in ["3", "3:2", ":0.5", "3:-1", "3:transparent", "3:x2", "all:x", "all:xred"] {
            let error = bad.parse::<LabelSpec>().unwrap_err().to_string();
            assert!(error.contains("expected WHICH:LOOK"), "{bad}: {error}");
        }
        let misspelt = "3:rebecapurple".parse::<LabelSpec>().unwrap_err().to_string();
        assert!(misspelt.ends_with("; a similar colour exists: rebeccapurple"), "{misspelt}");
    }
}
