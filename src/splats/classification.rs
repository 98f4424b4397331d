//! The emission and absorption of voxels, by a transfer function or by the looks of labels.

use super::words::density;
use crate::layers::{LabelLook, look_of};
use crate::transfer::TransferFunction;
use crate::volume::{Number, Volume};

/// The emission and absorption of a voxel: colour times density, density.
pub(crate) type Emission = [f32; 4];

/// The colour of a voxel and its density.
type Appearance = [f32; 4];

/// The source of the colour and opacity of values.
#[derive(Clone, Copy)]
pub(crate) enum ColorSource<'a> {
    Transfer(&'a TransferFunction),
    Labels(&'a [LabelLook]),
}

impl ColorSource<'_> {
    /// Returns whether any value of a range, both ends included, may be visible.
    pub(crate) fn show(&self, [low, high]: [f64; 2]) -> bool {
        match self {
            Self::Transfer(transfer) => !transfer.is_invisible([low, high]),
            Self::Labels(looks) => {
                let from = looks.partition_point(|look| (look.label as f64) < low);
                looks[from..].iter().take_while(|look| look.label as f64 <= high).any(|look| look.opacity > 0.0)
            }
        }
    }
}

/// A classifier of samples.
pub(crate) struct SampleClassifier<'a> {
    looks: ColorSource<'a>,
    slope: f64,
    intercept: f64,
    /// The unit distance of densities, in unit distances of opacities.
    unit: f32,
    /// The appearance of each sample by its bits, if samples have few bits; otherwise empty.
    table: Vec<Appearance>,
}

impl<'a> SampleClassifier<'a> {
    pub(crate) fn new(volume: &Volume, looks: ColorSource<'a>, unit: f64) -> Self {
        let (slope, intercept) = volume.rescale();
        let mut classification = Self { looks, slope, intercept, unit: unit as f32, table: Vec::new() };
        if let Some([first, last]) = volume.sample_type().few() {
            // The bits of negative numbers follow those of the others.
            let samples = (0..=last).chain(first..0);
            classification.table = samples.map(|sample| classification.classified(f64::from(sample))).collect();
        }
        classification
    }

    /// Makes a classification of values instead of the samples of a volume.
    pub(crate) fn of_values(looks: ColorSource<'a>, unit: f64) -> Self {
        Self { looks, slope: 1.0, intercept: 0.0, unit: unit as f32, table: Vec::new() }
    }

    /// Returns the appearance of a sample.
    pub(crate) fn classified(&self, sample: f64) -> Appearance {
        let value = self.slope * sample + self.intercept;
        let ([r, g, b], opacity) = match self.looks {
            ColorSource::Transfer(transfer) => transfer.sample(value),
            ColorSource::Labels(looks) => {
                look_of(looks, value).map_or(([0.0; 3], 0.0), |look| (look.color, look.opacity))
            }
        };
        let [r, g, b, opacity] = [r, g, b, opacity].map(|value| value as f32);
        [r, g, b, density(opacity) * self.unit]
    }

    /// Returns the appearance of a voxel.
    fn appearance<T: Number>(&self, sample: T) -> Appearance {
        match *bytemuck::bytes_of(&sample) {
            [bits] if !self.table.is_empty() => self.table[usize::from(bits)],
            [a, b] if !self.table.is_empty() => self.table[usize::from(u16::from_ne_bytes([a, b]))],
            _ => self.classified(sample.to_f64()),
        }
    }

    /// Returns the emission of a voxel.
    pub(crate) fn emission<T: Number>(&self, sample: T) -> Emission {
        let [r, g, b, density] = self.appearance(sample);
        [r * density, g * density, b * density, density]
    }
}
