//! Light that enters parts of a lattice: the sums of sweeps along parallel rays at the places where the rays enter.
//!
//! The rays of a direction are the same in all parts of a lattice. A part sweeps the planes within its window, the
//! points at which its filtered field is complete, and needs the sum of all planes before. One sweep through the whole
//! lattice, slab after slab away from the light, finds these sums for all parts: it copies the sum of each ray that
//! enters a window. So the light in a part is the light in the whole to the last bit.

use std::ops::Range;
use std::sync::Arc;

/// Points along x, y and z, or planes, rows and columns, in numbers of a lattice.
pub(crate) type PointRanges = [Range<i64>; 3];

/// The sums of planes along the rays of a direction, in rows of places.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct RayDepths {
    /// The number of the light, and of the direction among those of the light.
    pub(crate) of: [usize; 2],
    /// The first row and the first column of places.
    pub(crate) first: [i64; 2],
    pub(crate) width: usize,
    pub(crate) sums: Vec<f32>,
}

/// The light that enters a part of a lattice.
#[derive(Debug, Clone)]
pub(crate) struct Incoming {
    /// The points of the lattice whose filtered extinctions the part knows.
    pub(crate) window: PointRanges,
    /// The sums along rays that enter; a direction that is not there enters without a loss.
    pub(crate) rays: Arc<Vec<RayDepths>>,
}

/// The light of a bundle of rays that enters a box, in planes, rows and columns of the box.
pub(super) struct Entering<'a> {
    pub(super) incoming: &'a Incoming,
    pub(super) light: usize,
    pub(super) axes: [usize; 3],
}

/// Returns the part that two ranges share.
pub(super) fn common(a: &Range<i64>, b: &Range<i64>) -> Range<i64> {
    a.start.max(b.start)..a.end.min(b.end)
}

impl RayDepths {
    /// Writes a row from a column on. Returns the places of `out` that it reaches.
    pub(super) fn put(&self, [row, column]: [i64; 2], out: &mut [f32]) -> Range<usize> {
        let rows = self.sums.len() / self.width;
        let Some(index) = usize::try_from(row - self.first[0]).ok().filter(|&index| index < rows) else { return 0..0 };
        let own = self.first[1]..self.first[1] + self.width as i64;
        let Range { start, end } = common(&own, &(column..column + out.len() as i64));
        if start >= end {
            return 0..0;
        }
        let places = (start - column) as usize..(end - column) as usize;
        let from = &self.sums[index * self.width..][(start - own.start) as usize..(end - own.start) as usize];
        out[places.clone()].copy_from_slice(from);
        places
    }
}

impl Entering<'_> {
    /// Returns the sums of a direction, given its number among those of the light.
    pub(super) fn depths(&self, direction: usize) -> Option<&RayDepths> {
        self.incoming.rays.iter().find(|rays| rays.of == [self.light, direction])
    }

    /// Returns the window, counted from a plane, a row and a column.
    pub(super) fn window(&self, first: [i64; 3]) -> PointRanges {
        std::array::from_fn(|k| {
            let Range { start, end } = self.incoming.window[self.axes[k]].clone();
            start - first[k]..end - first[k]
        })
    }
}
