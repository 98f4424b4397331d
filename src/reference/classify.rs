//! From scalars to splats: which voxels count, and how much.

use glam::DVec3;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::settings::{Model, Settings};
use crate::transfer::TransferFunction;
use crate::volume::{InMemory, Volume};

/// What a splat adds to a ray where its kernel is 1:
///
/// * pre-shading: extinction per world unit, then emission in red, green and blue (colour times extinction), of which
///   X-ray leaves the emission 0;
/// * lit pre-shading: extinction, then the colour as it is without light;
/// * post-shading and maximum intensity: scalar less base, then the scalar's central differences along the lattice
///   axes, 0 where there is no light.
pub(super) type Weights = [f64; 4];

/// A voxel that counts.
#[derive(Debug, Clone, Copy)]
pub(super) struct Splat {
    pub(super) weights: Weights,
    /// The gradient of the scalar, world coordinates: of lit pre-shading only.
    pub(super) gradient: Option<DVec3>,
}

/// Voxels in one word of the occupancy mask.
const WORD: usize = 64;

/// The voxels of a volume that count, found by lattice index.
///
/// A bit per voxel and a running count per 64 voxels lead to a dense list of weights, so the others cost a quarter of
/// a byte each and these 32 bytes, with gradients 56.
#[derive(Debug)]
pub(super) struct Splats {
    dims: [usize; 3],
    /// Per 64 voxels: which count, and how many of those come before.
    words: Vec<(u64, usize)>,
    weights: Vec<Weights>,
    /// One per weight, or none at all.
    gradients: Vec<DVec3>,
    /// Whether the samples at the edge are repeated beyond it: post-shading and maximum intensity.
    repeats: bool,
    /// The lattice box that holds every splat, both ends included; `None` where there are none.
    bounds: Option<[[i64; 2]; 3]>,
}

/// Half the differences of the neighbours' values along the lattice axes. A neighbour beyond the edge has the value at
/// the edge.
fn central_differences(values: &InMemory<'_>, dims: [u32; 3], index: usize) -> [f64; 3] {
    let mut stride = 1;
    dims.map(|d| {
        let d = d as usize;
        let at = index / stride % d;
        let next = if at + 1 < d { index + stride } else { index };
        let previous = if at > 0 { index - stride } else { index };
        stride *= d;
        // Halved first: no difference of numbers overflows.
        values.value(next) / 2.0 - values.value(previous) / 2.0
    })
}

impl Splats {
    /// Classifies every voxel once, as the model and the light of the settings need it.
    ///
    /// # Errors
    /// [`Error::Transfer`] where an extinction is too large to be a number, [`Error::Volume`] where values are too far
    /// apart.
    pub(super) fn new(volume: &Volume, transfer: &TransferFunction, settings: &Settings) -> Result<Self> {
        let unit = transfer.unit_or(volume.grid().min_spacing());
        if !TransferFunction::extinction(transfer.max_opacity(), unit).is_finite() {
            return Err(Error::Transfer(format!("opacity per {unit} is more extinction than a number can hold")));
        }
        let values = volume.in_memory()?;
        let dims = volume.grid().dims().map(|d| d as usize);
        let count = volume.grid().len() as usize;
        let base = transfer.base();
        let to_world = volume.grid().to_lattice().matrix3.transpose();
        let (repeats, lit) = (settings.is_post_shaded(), settings.lighting.is_some());
        let classify = |index: usize| -> Option<Splat> {
            let value = values.value(index);
            if repeats {
                let [x, y, z] = if lit { central_differences(&values, volume.grid().dims(), index) } else { [0.0; 3] };
                let weights = [value - base, x, y, z];
                return (weights != [0.0; 4]).then_some(Splat { weights, gradient: None });
            }
            let (color, opacity) = transfer.sample(value);
            let tau = TransferFunction::extinction(opacity, unit);
            if tau <= 0.0 {
                return None;
            }
            if lit {
                let [red, green, blue] = color;
                let gradient = to_world * DVec3::from_array(central_differences(&values, volume.grid().dims(), index));
                return Some(Splat { weights: [tau, red, green, blue], gradient: Some(gradient) });
            }
            let [red, green, blue] = if settings.model == Model::Xray { [0.0; 3] } else { color.map(|c| c * tau) };
            Some(Splat { weights: [tau, red, green, blue], gradient: None })
        };
        // Whole words per task, so that the pieces join without shifting bits.
        let pieces: Vec<(Vec<u64>, Vec<Splat>)> = (0..count.div_ceil(WORD))
            .into_par_iter()
            .fold_chunks(1024, Default::default, |(mut masks, mut found): (Vec<u64>, Vec<Splat>), word| {
                let mut mask = 0;
                for (bit, index) in (word * WORD..count.min((word + 1) * WORD)).enumerate() {
                    if let Some(splat) = classify(index) {
                        mask |= 1 << bit;
                        found.push(splat);
                    }
                }
                masks.push(mask);
                (masks, found)
            })
            .collect();
        let mut words = Vec::with_capacity(count.div_ceil(WORD));
        let found = pieces.iter().map(|(_, f)| f.len()).sum();
        let mut weights = Vec::with_capacity(found);
        let mut gradients = Vec::with_capacity(if lit && !repeats { found } else { 0 });
        for (masks, piece) in pieces {
            let mut before = weights.len();
            for mask in masks {
                words.push((mask, before));
                before += mask.count_ones() as usize;
            }
            weights.extend(piece.iter().map(|splat| splat.weights));
            gradients.extend(piece.iter().filter_map(|splat| splat.gradient));
        }
        if weights.iter().flatten().any(|w| !w.is_finite()) {
            return Err(Error::Volume("values are further apart than a number can hold".to_owned()));
        }
        let mut splats = Self { dims, words, weights, gradients, repeats, bounds: None };
        splats.bounds = splats.find_bounds();
        Ok(splats)
    }

    /// The splat at a lattice point, unless it does not count. Outside the lattice that is what the nearest point of
    /// the edge repeats, and nothing where the edge is not repeated.
    pub(super) fn get(&self, point: [i64; 3]) -> Option<Splat> {
        let inside: [i64; 3] = std::array::from_fn(|axis| point[axis].clamp(0, self.dims[axis] as i64 - 1));
        if !self.repeats && inside != point {
            return None;
        }
        let [i, j, k] = inside.map(|p| p as usize);
        let index = i + self.dims[0] * (j + self.dims[1] * k);
        let (mask, before) = *self.words.get(index / WORD)?;
        let bit = 1_u64 << (index % WORD);
        if mask & bit == 0 {
            return None;
        }
        let index = before + (mask & (bit - 1)).count_ones() as usize;
        let mut weights = *self.weights.get(index)?;
        if self.repeats {
            // Beyond an edge all neighbours across it have the same value.
            for axis in 0..3 {
                if inside[axis] != point[axis] {
                    weights[axis + 1] = 0.0;
                }
            }
        }
        Some(Splat { weights, gradient: self.gradients.get(index).copied() })
    }

    /// The lattice box that holds every splat, both ends included, with `layers` repetitions of the edge where it is
    /// repeated; `None` where no voxel counts.
    pub(super) fn bounds(&self, layers: i64) -> Option<[[i64; 2]; 3]> {
        let bounds = self.bounds?;
        if !self.repeats {
            return Some(bounds);
        }
        Some(std::array::from_fn(|axis| {
            let ([low, high], last) = (bounds[axis], self.dims[axis] as i64 - 1);
            [if low == 0 { -layers } else { low }, if high == last { last + layers } else { high }]
        }))
    }

    fn find_bounds(&self) -> Option<[[i64; 2]; 3]> {
        let [nx, ny, _] = self.dims;
        let corners = self
            .words
            .par_iter()
            .enumerate()
            .filter(|(_, (mask, _))| *mask != 0)
            .map(|(word, &(mask, _))| {
                let mut low = [usize::MAX; 3];
                let mut high = [0; 3];
                for bit in (0..WORD).filter(|bit| mask >> bit & 1 == 1) {
                    let index = word * WORD + bit;
                    let point = [index % nx, index / nx % ny, index / (nx * ny)];
                    for axis in 0..3 {
                        low[axis] = low[axis].min(point[axis]);
                        high[axis] = high[axis].max(point[axis]);
                    }
                }
                (low, high)
            })
            .reduce_with(|(a, b), (c, d)| {
                (std::array::from_fn(|i| a[i].min(c[i])), std::array::from_fn(|i| b[i].max(d[i])))
            });
        corners.map(|(low, high)| std::array::from_fn(|axis| [low[axis] as i64, high[axis] as i64]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transfer::ControlPoint;
    use crate::volume::{Grid, Samples};

    #[test]
    fn finds_every_voxel_that_is_not_clear_and_no_other() {
        let dims = [7, 11, 13];
        let values: Vec<f32> = (0..7 * 11 * 13).map(|i| if i % 5 == 3 { i as f32 / 1001.0 } else { 0.0 }).collect();
        let grid = Grid::axis_parallel(dims, [1.0, 2.0, 3.0]).unwrap();
        let volume = Volume::new(grid, Samples::F32(values.clone())).unwrap();
        let point = |value, opacity| ControlPoint { value, color: [1.0, 0.5, 0.25], opacity };
        let transfer = TransferFunction::new(vec![point(0.0, 0.0), point(1.0, 0.9)], Some(0.5)).unwrap();
        let splats = Splats::new(&volume, &transfer, &Settings::default()).unwrap();
        assert_eq!(splats.bounds(2), Some([[0, 6], [0, 10], [0, 12]]));
        for (index, &value) in values.iter().enumerate() {
            let found = splats.get([index % 7, index / 7 % 11, index / 77].map(|p| p as i64));
            let opacity = 0.9 * f64::from(value);
            assert_eq!(found.is_some(), value > 0.0, "voxel {index}");
            if let Some(Splat { weights, .. }) = found {
                let tau = -(1.0 - opacity).ln() / 0.5;
                for (got, color) in weights.iter().zip([1.0, 1.0, 0.5, 0.25]) {
                    assert!((got - color * tau).abs() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn a_clear_volume_has_no_bounds() {
        let grid = Grid::axis_parallel([3, 3, 3], [1.0; 3]).unwrap();
        let volume = Volume::new(grid, Samples::U8(vec![9; 27])).unwrap();
        let clear = ControlPoint { value: 0.0, color: [1.0; 3], opacity: 0.0 };
        let transfer = TransferFunction::new(vec![clear], None).unwrap();
        assert_eq!(Splats::new(&volume, &transfer, &Settings::default()).unwrap().bounds(2), None);
    }
}
