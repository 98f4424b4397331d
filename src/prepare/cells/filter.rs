//! The weights by which voxels are shared among cells.

use std::ops::Range;

use super::classification::Emission;

/// Cells to either side of a voxel that it is shared among.
pub(super) const REACH: usize = 3;

/// The weights by which voxels are shared among cells along an axis.
pub(crate) struct Filter {
    /// Voxels along a cell.
    size: usize,
    /// The first voxel with a weight in the first cell; negative because that cell lies beyond the face.
    first: i64,
    /// The weights of that voxel and of those behind it. The next cell has the same weights, `size` voxels on.
    weights: Vec<f32>,
}

impl Filter {
    /// Voxels along a cell.
    pub(super) fn size(&self) -> usize {
        self.size
    }

    /// The first voxel with a weight in the first cell, and the weights of the voxels from there on.
    pub(super) fn weights(&self) -> (i64, &[f32]) {
        (self.first, &self.weights)
    }

    /// A filter of cells of a level. `beyond` cells lie before the face, and `before` voxels between the end of these
    /// cells and the face. Cells are blurred by the weights `blur`, from the middle one on.
    pub(crate) fn new(level: u32, before: f64, blur: &[f64], beyond: usize) -> Self {
        let size = f64::from(level).exp2();
        let in_cells = |voxel: i64| (voxel as f64 + before + 0.5) / size - 0.5;
        let reach = blur.len() as i64 - 1;
        let blur = || blur.iter().skip(1).rev().chain(blur).zip(-reach..);
        let weight = |x: f64| blur().map(|(weight, node)| weight * lagrange(x - node as f64)).sum::<f64>() / size;
        // More voxels than have weights in a cell 0 that begins at the face; both ends are cut below.
        let most = ((reach + REACH as i64 + 1) as f64 * size + before).ceil() as i64;
        let mut first = -most;
        let mut weights: Vec<f32> = (first..most).map(|voxel| weight(in_cells(voxel)) as f32).collect();
        weights.truncate(weights.iter().rposition(|&weight| weight != 0.0).map_or(0, |last| last + 1));
        let none = weights.iter().position(|&weight| weight != 0.0).unwrap_or(0);
        weights.drain(..none);
        first += none as i64;
        let size = size as usize;
        Self { size, first: first - (beyond * size) as i64, weights }
    }

    /// The voxels with weights in the cells from `cell` to before `end`.
    pub(crate) fn voxels(&self, cell: i64, end: i64) -> Range<i64> {
        let first = |cell: i64| self.first + cell * self.size as i64;
        first(cell)..first(end - 1) + self.weights.len() as i64
    }

    /// For each cell, the first voxel with a weight in it and the weights from there on. The axis has `count` voxels,
    /// which go on beyond the faces as copies.
    pub(crate) fn taken(&self, cells: Range<i64>, count: usize) -> Vec<(usize, Vec<f32>)> {
        let of_cell = |cell: i64| {
            let voxels = self.voxels(cell, cell + 1);
            let inside = |voxel: i64| voxel.clamp(0, count as i64 - 1) as usize;
            let first = inside(voxels.start);
            let mut taken = vec![0.0; inside(voxels.end - 1) + 1 - first];
            voxels.zip(&self.weights).for_each(|(voxel, weight)| taken[inside(voxel) - first] += weight);
            (first, taken)
        };
        cells.map(of_cell).collect()
    }

    /// The voxels that each cell stands for and `more` to either side, of an axis of `count` voxels; the outermost
    /// voxel if they lie beyond a face.
    pub(crate) fn blocks(&self, cells: Range<i64>, more: i64, count: usize) -> Vec<Range<usize>> {
        let inside = |voxel: i64| voxel.clamp(0, count as i64 - 1) as usize;
        let block = |cell: i64| {
            // In the middle of the voxels with weights; one more if a voxel lies in two cells.
            let Range { start, end } = self.voxels(cell, cell + 1);
            let beside = (end - start - self.size as i64) / 2 - more;
            inside(start + beside)..inside(end - beside - 1) + 1
        };
        cells.map(block).collect()
    }

    /// The weight of a voxel in a cell.
    fn weight(&self, voxel: i64, cell: i64) -> Option<f32> {
        let at = voxel - self.first - cell * self.size as i64;
        usize::try_from(at).ok().and_then(|at| self.weights.get(at).copied())
    }

    /// The range of the first `cells` cells in which some of these voxels have weights.
    pub(super) fn reached(&self, voxels: &Range<usize>, cells: usize) -> Range<usize> {
        let size = self.size as i64;
        let first = (voxels.start as i64 - self.first - self.weights.len() as i64).div_euclid(size) + 1;
        let end = (voxels.end as i64 - 1 - self.first).div_euclid(size) + 1;
        let within = |cell: i64| cell.clamp(0, cells as i64) as usize;
        within(first)..within(end)
    }

    /// Replaces cells by weighted sums of voxels. The first voxel is the first with a weight in the first cell.
    pub(super) fn gather(&self, voxels: &[Emission], cells: &mut [Emission]) {
        cells.fill([0.0; 4]);
        // So few taps at a time let the sums of neighbouring cells overlap: each addition waits for the one before.
        const TAPS: usize = 8;
        for (run, weights) in self.weights.chunks(TAPS).enumerate() {
            let taps = voxels[run * TAPS..].windows(weights.len()).step_by(self.size);
            for (cell, taps) in cells.iter_mut().zip(taps) {
                // By value, so that the four channels are one vector.
                *cell = weights.iter().zip(taps).fold(*cell, |sums, (weight, voxel)| {
                    std::array::from_fn(|channel| sums[channel] + weight * voxel[channel])
                });
            }
        }
    }

    /// The cells from `cell` to before `end` in which a voxel has weights.
    pub(super) fn cells(&self, voxel: i64, cell: usize, end: usize) -> impl Iterator<Item = (usize, f32)> {
        (cell..end).filter_map(move |cell| Some((cell, self.weight(voxel, cell as i64)?)))
    }
}

/// The weight of the node at distance `x` in the polynomial through the six nodes around a point.
fn lagrange(x: f64) -> f64 {
    let node = x.ceil();
    let at = node - x;
    if !(-2.0..=3.0).contains(&node) {
        return 0.0;
    }
    (-2..=3).map(f64::from).filter(|&other| other != node).map(|other| (at - other) / (node - other)).product()
}

/// The share of a wave along an axis that cells of a level keep, given its frequency in radians per cell.
pub(crate) fn response(level: u32, frequency: f64) -> f64 {
    // More voxels to a cell change nothing.
    let size = 1_i64 << level.min(3);
    let at = |voxel: i64| (voxel as f64 + 0.5 * ((size - 1) % 2) as f64) / size as f64;
    let reach = REACH as i64 * size;
    (-reach..=reach).map(|voxel| lagrange(at(voxel)) * (frequency * at(voxel)).cos()).sum::<f64>() / size as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn voxels_of_every_level_have_weights_in_six_cells() {
        for level in 1..=crate::settings::MAX_LEVEL {
            let filter = Filter::new(level, 0.0, &[1.0], REACH);
            assert_eq!(filter.weights.len(), crate::gpu::cells::NODES * filter.size, "level {level}");
        }
    }

    #[test]
    fn cells_get_what_voxels_that_show_give() {
        for (level, voxels) in [(0, 20), (1, 37), (2, 64), (4, 50), (7, 100)] {
            let filter = Filter::new(level, 0.0, &[1.0], REACH);
            let cells = (voxels as usize).div_ceil(filter.size) + 2 * REACH;
            let all = filter.voxels(0, cells as i64);
            let begin = (-all.start) as usize;
            for shown in [0..voxels, 0..3, 7..19, voxels - 1..voxels] {
                let mut row = vec![[0.0_f32; 4]; (all.end - all.start) as usize];
                shown.clone().for_each(|voxel| row[begin + voxel as usize][3] = 1.0 + 0.1 * voxel as f32);
                let range = shown.start as usize..shown.end as usize;
                let reached = filter.reached(&range, cells);
                let mut got = vec![[0.0; 4]; cells];
                filter.gather(&row[reached.start * filter.size..], &mut got[reached]);
                for (cell, [.., got]) in got.into_iter().enumerate() {
                    let given = |voxel: i64| Some(filter.weight(voxel, cell as i64)? * row[begin + voxel as usize][3]);
                    let expected: f32 = shown.clone().filter_map(given).sum();
                    assert!(
                        (got - expected).abs() < 1e-6 * voxels as f32,
                        "{level} {shown:?} {cell}: {got} {expected}"
                    );
                }
            }
        }
    }
}
