//! From scalars to splats: which voxels extinguish and emit, and how much.

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::transfer::TransferFunction;
use crate::volume::Volume;

/// Extinction per world unit, then emission per world unit in red, green and blue (colour times extinction).
pub(super) type Weights = [f64; 4];

/// Voxels in one word of the occupancy mask.
const WORD: usize = 64;

/// The voxels of a volume that are not clear, found by lattice index.
///
/// A bit per voxel and a running count per 64 voxels lead to a dense list of weights, so clear voxels cost a quarter
/// of a byte each and the others 32 bytes.
#[derive(Debug)]
pub(super) struct Splats {
    dims: [usize; 3],
    /// Per 64 voxels: which are not clear, and how many of those come before.
    words: Vec<(u64, usize)>,
    weights: Vec<Weights>,
    /// The lattice box that holds every splat, both ends included; `None` where there are none.
    bounds: Option<[[i64; 2]; 3]>,
}

impl Splats {
    /// Classifies every voxel once.
    ///
    /// # Errors
    /// [`Error::Transfer`] where an extinction is too large to be a number.
    pub(super) fn new(volume: &Volume, transfer: &TransferFunction) -> Result<Self> {
        let unit = transfer.unit_or(volume.grid().min_spacing());
        let dims = volume.grid().dims().map(|d| d as usize);
        let count = volume.samples().len();
        let classify = |index: usize| -> Weights {
            let (color, opacity) = transfer.sample(volume.value(index));
            let tau = TransferFunction::extinction(opacity, unit);
            [tau, tau * color[0], tau * color[1], tau * color[2]]
        };
        // Whole words per task, so that the pieces join without shifting bits.
        let pieces: Vec<(Vec<u64>, Vec<Weights>)> = (0..count.div_ceil(WORD))
            .into_par_iter()
            .fold_chunks(1024, Default::default, |(mut masks, mut weights): (Vec<u64>, Vec<Weights>), word| {
                let mut mask = 0;
                for (bit, index) in (word * WORD..count.min((word + 1) * WORD)).enumerate() {
                    let splat = classify(index);
                    if splat[0] > 0.0 {
                        mask |= 1 << bit;
                        weights.push(splat);
                    }
                }
                masks.push(mask);
                (masks, weights)
            })
            .collect();
        let mut words = Vec::with_capacity(count.div_ceil(WORD));
        let mut weights = Vec::with_capacity(pieces.iter().map(|(_, w)| w.len()).sum());
        for (masks, piece) in pieces {
            let mut before = weights.len();
            for mask in masks {
                words.push((mask, before));
                before += mask.count_ones() as usize;
            }
            weights.extend(piece);
        }
        if weights.iter().any(|w: &Weights| !w[0].is_finite()) {
            return Err(Error::Transfer(format!("opacity per {unit} is more extinction than a number can hold")));
        }
        let mut splats = Self { dims, words, weights, bounds: None };
        splats.bounds = splats.find_bounds();
        Ok(splats)
    }

    /// The weights of the voxel at a lattice point inside the lattice, unless it is clear.
    pub(super) fn get(&self, [i, j, k]: [usize; 3]) -> Option<&Weights> {
        let index = i + self.dims[0] * (j + self.dims[1] * k);
        let (mask, before) = *self.words.get(index / WORD)?;
        let bit = 1_u64 << (index % WORD);
        if mask & bit == 0 {
            return None;
        }
        self.weights.get(before + (mask & (bit - 1)).count_ones() as usize)
    }

    /// The lattice box that holds every splat, both ends included; `None` where every voxel is clear.
    pub(super) fn bounds(&self) -> Option<[[i64; 2]; 3]> {
        self.bounds
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
        let splats = Splats::new(&volume, &transfer).unwrap();
        assert_eq!(splats.bounds(), Some([[0, 6], [0, 10], [0, 12]]));
        for (index, &value) in values.iter().enumerate() {
            let found = splats.get([index % 7, index / 7 % 11, index / 77]);
            let opacity = 0.9 * f64::from(value);
            assert_eq!(found.is_some(), value > 0.0, "voxel {index}");
            if let Some(weights) = found {
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
        assert_eq!(Splats::new(&volume, &transfer).unwrap().bounds(), None);
    }
}
