//! The ranges of samples in small cells, which tell where along a ray nothing can be visible.

use glam::DVec3;
use rayon::prelude::*;

use super::ray::LatticeRay;

/// The number of voxels along the edge of a cell.
const EDGE: usize = 4;
/// The distance in voxels between the places of a ray at which cells are looked up.
const STEP: f64 = 1.0;
/// The largest number of lookups of a ray: a longer ray is walked without lookups.
const MAX_LOOKUPS: f64 = 16_384.0;

/// The least and the largest value of each cell of a volume, x fastest.
#[derive(Debug)]
pub(super) struct Cells {
    counts: [usize; 3],
    ranges: Vec<[f64; 2]>,
}

/// The empty range of values.
const NOTHING: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];

fn union(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

impl Cells {
    pub(super) fn new(dims: [usize; 3], value: impl Fn(usize) -> f64 + Sync) -> Self {
        let counts = dims.map(|d| d.div_ceil(EDGE));
        let [nx, ny, nz] = dims;
        let row = |row: usize| {
            let (y, z) = (row % counts[1] * EDGE, row / counts[1] * EDGE);
            let mut ranges = vec![NOTHING; counts[0]];
            for k in z..nz.min(z + EDGE) {
                for j in y..ny.min(y + EDGE) {
                    for i in 0..nx {
                        let v = value((k * ny + j) * nx + i);
                        ranges[i / EDGE] = union(ranges[i / EDGE], [v, v]);
                    }
                }
            }
            ranges
        };
        let ranges = (0..counts[1] * counts[2]).into_par_iter().flat_map_iter(row).collect();
        Self { counts, ranges }
    }

    /// Returns the range of all values.
    pub(super) fn range(&self) -> [f64; 2] {
        self.ranges.iter().fold(NOTHING, |a, b| union(a, *b))
    }

    /// Returns the range of `edge`^3 values from lattice point `first` on, and maybe of some values around them.
    pub(super) fn range_of(&self, first: [usize; 3], edge: usize) -> [f64; 2] {
        let [x, y, z] = std::array::from_fn(|a| first[a] / EDGE..self.counts[a].min((first[a] + edge).div_ceil(EDGE)));
        let rows = z.flat_map(|k| y.clone().map(move |j| (k * self.counts[1] + j) * self.counts[0]));
        rows.flat_map(|row| &self.ranges[row + x.start..row + x.end]).fold(NOTHING, |a, b| union(a, *b))
    }

    /// Returns the lattice box of the cells whose range `counts` accepts, both ends included; `None` if there are none.
    pub(super) fn bounds(&self, dims: [usize; 3], counts: impl Fn([f64; 2]) -> bool) -> Option<[[i64; 2]; 3]> {
        let [nx, ny, _] = self.counts;
        let (mut low, mut high) = ([usize::MAX; 3], [0; 3]);
        for (index, _) in self.ranges.iter().enumerate().filter(|(_, range)| counts(**range)) {
            let cell = [index % nx, index / nx % ny, index / (nx * ny)];
            low = std::array::from_fn(|a| low[a].min(cell[a] * EDGE));
            high = std::array::from_fn(|a| high[a].max(dims[a].min((cell[a] + 1) * EDGE) - 1));
        }
        (low[0] <= high[0]).then(|| std::array::from_fn(|a| [low[a] as i64, high[a] as i64]))
    }

    /// Returns a bound for each place: `bound` of the range of the values whose kernels, of support radius `reach`,
    /// cover the place.
    pub(super) fn map(&self, reach: f64, bound: impl Fn([f64; 2]) -> f64 + Sync) -> BoundMap {
        // A place is up to half a step from the place of its lookup.
        let around = ((reach + 0.5 * STEP + 0.5).floor() / EDGE as f64).ceil() as usize;
        let mut ranges = self.ranges.clone();
        let mut stride = 1;
        for count in self.counts {
            let before = ranges;
            ranges = (0..before.len())
                .into_par_iter()
                .map(|index| {
                    let at = index / stride % count;
                    let (first, last) = (at.saturating_sub(around), (at + around).min(count - 1));
                    (first..=last).map(|i| before[index - at * stride + i * stride]).fold(NOTHING, union)
                })
                .collect();
            stride *= count;
        }
        BoundMap { counts: self.counts, bounds: ranges.into_par_iter().map(&bound).collect() }
    }
}

/// A bound of the visible field in each cell of places.
#[derive(Debug)]
pub(super) struct BoundMap {
    counts: [usize; 3],
    bounds: Vec<f64>,
}

impl BoundMap {
    fn at(&self, point: DVec3) -> f64 {
        // Only kernels that cover the edge cover places beyond it.
        let cell = |axis: usize| {
            // A float to integer cast saturates.
            (((point[axis] + 0.5) * (1.0 / EDGE as f64)) as usize).min(self.counts[axis] - 1)
        };
        self.bounds[(cell(2) * self.counts[1] + cell(1)) * self.counts[0] + cell(0)]
    }

    /// Returns the parts of a ray, one lookup long, and their bounds; `None` if there are too many.
    fn lookups(&self, ray: LatticeRay) -> Option<impl Iterator<Item = (LatticeRay, f64)>> {
        let count = ((ray.end - ray.start) / STEP).ceil().max(1.0);
        let step = (ray.end - ray.start) / count;
        let place = move |i: f64| if i == count { ray.end } else { ray.start + i * step };
        let lookup = move |i: u32| {
            let start = place(f64::from(i));
            let most = self.at(ray.origin + ray.direction * (start + 0.5 * step));
            (LatticeRay { start, end: place(f64::from(i) + 1.0), ..ray }, most)
        };
        (count <= MAX_LOOKUPS).then(|| (0..count as u32).map(lookup))
    }

    /// Returns the parts of a ray where bounds exceed `enough`, front to back, at least `apart` voxels apart.
    pub(super) fn parts(&self, ray: LatticeRay, enough: f64, apart: f64) -> Vec<LatticeRay> {
        let Some(lookups) = self.lookups(ray) else { return vec![ray] };
        let mut parts: Vec<LatticeRay> = Vec::new();
        for (next, _) in lookups.filter(|(_, most)| *most > enough) {
            match parts.last_mut() {
                Some(last) if next.start - last.end < apart => last.end = next.end,
                _ => parts.push(next),
            }
        }
        parts
    }

    /// Returns the part of a ray, one lookup long, with the largest bound.
    pub(super) fn best(&self, ray: LatticeRay) -> Option<LatticeRay> {
        self.lookups(ray)?.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(part, _)| part)
    }
}
