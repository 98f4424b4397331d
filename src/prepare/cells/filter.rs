//! The weights by which voxels are shared among cells.

use std::ops::Range;

use super::CellSize;

/// The number of cells, to either side of a voxel, that share it.
pub(super) const REACH: usize = 3;

/// The weights by which voxels are shared among cells along an axis.
pub(crate) struct Filter {
    /// Voxels along a cell, as a fraction in lowest terms.
    size: [usize; 2],
    /// The first voxel with a weight in the first cell; negative because that cell lies beyond the face.
    first: i64,
    /// The weights of the voxels from `first` on, for as many cells as lie differently between voxels: the divisor of
    /// `size`. The first voxel of cell c is that number of whole voxels behind that c cells are.
    weights: Vec<Vec<f32>>,
}

impl Filter {
    /// Makes the filter of cells. `beyond` cells lie before the face, and `before` voxels between the end of these
    /// cells and the face. Cells are blurred by the weights `blur`, from the middle one on.
    pub(crate) fn new(size: CellSize, before: f64, blur: &[f64], beyond: usize) -> Self {
        let fraction = size.fraction().map(|n| n as usize);
        let size = size.voxels();
        let reach = blur.len() as i64 - 1;
        let blur = || blur.iter().skip(1).rev().chain(blur).zip(-reach..);
        let weight = |cell: usize, voxel: i64| {
            let x = (voxel as f64 + before + 0.5) / size - 0.5 + beyond as f64 - cell as f64;
            (blur().map(|(weight, node)| weight * lagrange(x - node as f64)).sum::<f64>() / size) as f32
        };
        let ahead = |cell: usize| (cell * fraction[0] / fraction[1]) as i64;
        // More voxels than have weights in the first cell; both ends are cut below.
        let middle = -(before + beyond as f64 * size).floor() as i64;
        let most = ((reach + REACH as i64 + 2) as f64 * size).ceil() as i64;
        let cells = 0..fraction[1];
        let counts = |voxel: &i64| cells.clone().any(|cell| weight(cell, voxel + ahead(cell)) != 0.0);
        let mut found = (middle - most..middle + most).filter(counts);
        let first = found.next().unwrap_or(0);
        let last = found.next_back().unwrap_or(first);
        let of_cell = |cell| (first..=last).map(|voxel| weight(cell, voxel + ahead(cell))).collect();
        let weights: Vec<Vec<f32>> = cells.clone().map(of_cell).collect();
        Self { size: fraction, first, weights }
    }

    /// Returns the voxels along a cell as a fraction, the first voxel with a weight in the first cell, and the weights
    /// of the voxels from there on, for each cell that lies differently between voxels.
    pub(crate) fn parts(&self) -> ([usize; 2], i64, &[Vec<f32>]) {
        (self.size, self.first, &self.weights)
    }

    /// Returns the first voxel with a weight in a cell.
    fn first(&self, cell: i64) -> i64 {
        let [over, under] = self.size.map(|n| n as i64);
        self.first + (cell * over).div_euclid(under)
    }

    /// Returns the weights of voxels in a cell, from the first voxel with a weight on.
    fn weights(&self, cell: i64) -> &[f32] {
        &self.weights[cell.rem_euclid(self.weights.len() as i64) as usize]
    }

    /// Returns the voxels with weights in the cells from `cell` to before `end`.
    pub(crate) fn voxels(&self, cell: i64, end: i64) -> Range<i64> {
        self.first(cell)..self.first(end - 1) + self.weights[0].len() as i64
    }

    /// Returns for each cell the first voxel with a weight in it and the weights from there on. The axis has `count`
    /// voxels, which go on beyond the faces as copies.
    pub(crate) fn taken(&self, cells: Range<i64>, count: usize) -> Vec<(usize, Vec<f32>)> {
        let of_cell = |cell: i64| {
            let voxels = self.voxels(cell, cell + 1);
            let inside = |voxel: i64| voxel.clamp(0, count as i64 - 1) as usize;
            let first = inside(voxels.start);
            let mut taken = vec![0.0; inside(voxels.end - 1) + 1 - first];
            voxels.zip(self.weights(cell)).for_each(|(voxel, weight)| taken[inside(voxel) - first] += weight);
            (first, taken)
        };
        cells.map(of_cell).collect()
    }

    /// Returns the voxels that each cell stands for and `more` to either side, of an axis of `count` voxels; the
    /// outermost voxel if they lie beyond a face.
    pub(crate) fn blocks(&self, cells: Range<i64>, more: i64, count: usize) -> Vec<Range<usize>> {
        let inside = |voxel: i64| voxel.clamp(0, count as i64 - 1) as usize;
        let block = |cell: i64| {
            // In the middle of the voxels with weights; one more if a voxel lies in two cells.
            let Range { start, end } = self.voxels(cell, cell + 1);
            let beside = (end - start - self.size[0] as i64) / 2 - more;
            inside(start + beside)..inside(end - beside - 1) + 1
        };
        cells.map(block).collect()
    }

    /// Returns the cells in which any of these voxels have weights.
    pub(crate) fn around(&self, voxels: Range<i64>) -> Range<i64> {
        let [over, under] = self.size.map(|n| n as i64);
        // The first cell that begins at this voxel or behind it.
        let from = |voxel: i64| -(-(voxel - self.first) * under).div_euclid(over);
        let taps = self.weights[0].len() as i64;
        from(voxels.start - taps + 1)..from(voxels.end)
    }
}

/// Returns the weight of the node at distance `x` in the polynomial through the six nodes around a point.
fn lagrange(x: f64) -> f64 {
    let node = x.ceil();
    let at = node - x;
    if !(-2.0..=3.0).contains(&node) {
        return 0.0;
    }
    (-2..=3).map(f64::from).filter(|&other| other != node).map(|other| (at - other) / (node - other)).product()
}

/// Returns the share of a wave along an axis that cells keep, given its frequency in radians per cell.
pub(crate) fn response(cells: CellSize, frequency: f64) -> f64 {
    // More voxels to a cell change nothing.
    let cells = cells.min(CellSize::of_level(3));
    let (size, under) = (cells.voxels(), cells.fraction()[1]);
    let reach = (f64::from(under + REACH as u32 + 1) * size).ceil() as i64;
    // The cells that lie differently between voxels.
    let of_cell = |cell: u32| {
        let places = (-reach..=reach).map(|voxel| (voxel as f64 + 0.5) / size - 0.5 - f64::from(cell));
        places.map(|place| lagrange(place) * libm::cos(frequency * place)).sum::<f64>()
    };
    (0..under).map(of_cell).sum::<f64>() / (size * f64::from(under))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_workgroup_of_the_device_holds_the_voxels_of_its_sums() {
        use crate::gpu::cells::{NODES, OPEN, SUMS};
        let mut size = CellSize::VOXEL.next();
        for _ in 1..CellSize::COUNT {
            let filter = Filter::new(size, 0.0, &[1.0], REACH);
            let ([over, under], taps) = (filter.size, filter.weights[0].len());
            if over.is_power_of_two() {
                assert_eq!(taps, NODES * over, "{size:?}");
            }
            // The cells with a weight in a voxel: of `under` cells one begins behind every voxel.
            assert!((taps * under).div_ceil(over) < OPEN, "{size:?}");
            let voxels = ((SUMS - 1) * over).div_ceil(under) + taps;
            assert!(voxels <= crate::gpu::scan::WORKGROUP as usize * taps.div_ceil(NODES), "{size:?}: {voxels}");
            size = size.next();
        }
    }
}
