//! The box of the coefficients of a field, and the parts of it that rays read.

use super::rays::Axes;

/// Lattice points along the edge of a cell.
pub(super) const CELL: usize = 8;

/// The reach of the rays of a tile around their places.
#[derive(Clone, Copy)]
pub(super) struct Reach {
    /// Number of voxels beyond the outermost voxels where rays may find matter.
    pub(super) beyond: f64,
    /// Number of points around the 4 x 4 points of a ray.
    pub(super) around: isize,
}

/// The part of a plane that rays read: first and last points.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlaneArea {
    pub(super) low: [isize; 2],
    pub(super) high: [isize; 2],
}

impl PlaneArea {
    /// Returns the points that rays between four corners read from plane to plane; `None` if they pass the field. Rays
    /// are pairs of the place in plane 0 and the step from plane to plane, along a and b; `ends` are the first and the
    /// last point of the field along a and b.
    pub(super) fn new(
        corners: &[[[f64; 2]; 2]; 4],
        planes: [f64; 2],
        ends: [[f64; 2]; 2],
        reach: Reach,
    ) -> Option<Self> {
        let Reach { beyond, around } = reach;
        let mut area = Self { low: [0; 2], high: [0; 2] };
        for axis in 0..2 {
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for corner in corners {
                let [start, step] = corner[axis];
                for z in planes {
                    let place = start + step * z;
                    low = low.min(place);
                    high = high.max(place);
                }
            }
            let [first, last] = [ends[axis][0] - beyond, ends[axis][1] + beyond];
            if high < first || low > last {
                return None;
            }
            area.low[axis] = low.clamp(first, last).floor() as isize - 1 - around;
            area.high[axis] = high.clamp(first, last).floor() as isize + 2 + around;
        }
        Some(area)
    }

    pub(super) fn size(&self) -> [usize; 2] {
        [0, 1].map(|axis| (self.high[axis] - self.low[axis] + 1) as usize)
    }
}

/// The box of points with coefficients, x fastest: the points of a lattice or of a part of it, and some beyond its
/// faces. Points farther than all of them count as the farthest.
#[derive(Clone, Copy)]
pub(super) struct Padded {
    pub(super) size: [usize; 3],
    /// Number of points beyond each face.
    pub(super) pad: usize,
    /// The point of the lattice at the low corner of the part.
    first: [isize; 3],
}

/// Rows of coefficients along axis a of a tile, at planes one after the other.
pub(super) struct TileRows<const PLANES: usize> {
    /// The first coefficient of the first row in each plane.
    starts: [usize; PLANES],
    /// The distance in memory from coefficient to coefficient along a.
    pub(super) step: usize,
    /// The distance in memory from row to row.
    across: usize,
}

impl<const PLANES: usize> TileRows<PLANES> {
    /// Returns row number `row` of each plane, from its first coefficient on.
    #[inline(always)]
    pub(super) fn of<'a, T>(&self, coefficients: &'a [T], row: usize) -> [&'a [T]; PLANES] {
        let mut rows = [coefficients; PLANES];
        for plane in 0..PLANES {
            rows[plane] = &coefficients[self.starts[plane] + row * self.across..];
        }
        rows
    }
}

impl Padded {
    /// Makes the box of the part of a lattice of `dims` points from point `first` on.
    pub(super) fn new(dims: [usize; 3], pad: usize, first: [isize; 3]) -> Self {
        Self { size: dims.map(|d| d + 2 * pad), pad, first }
    }

    /// Returns the number of a point of the lattice along an axis, counted from the first point of the box.
    fn place(&self, axis: usize, point: isize) -> isize {
        point - self.first[axis] + self.pad as isize
    }

    /// Returns the number of points of a plane across z.
    pub(super) fn area(&self) -> usize {
        self.size[0] * self.size[1]
    }

    /// Returns the number of all points.
    pub(super) fn count(&self) -> usize {
        self.area() * self.size[2]
    }

    /// Returns the number of cells along each axis.
    pub(super) fn cells(&self) -> [usize; 3] {
        self.size.map(|size| size.div_ceil(CELL))
    }

    /// Returns the place of a point of the lattice.
    fn index(&self, point: [isize; 3]) -> usize {
        let steps = [1, self.size[0], self.area()];
        let place = |axis: usize| self.place(axis, point[axis]).clamp(0, self.size[axis] as isize - 1) as usize;
        (0..3).map(|axis| place(axis) * steps[axis]).sum()
    }

    /// Returns the rows of an area in planes from number `first` on.
    pub(super) fn rows<const PLANES: usize>(&self, axes: &Axes, area: &PlaneArea, first: isize) -> TileRows<PLANES> {
        let mut starts = [0; PLANES];
        for (offset, start) in starts.iter_mut().enumerate() {
            let mut point = [0; 3];
            point[axes.axes[0]] = area.low[0];
            point[axes.axes[1]] = area.low[1];
            point[axes.axes[2]] = axes.plane(first + offset as isize);
            *start = self.index(point);
        }
        let steps = [1, self.size[0], self.area()];
        TileRows { starts, step: steps[axes.axes[0]], across: steps[axes.axes[1]] }
    }

    /// Returns whether `holds` accepts the value of any cell that meets a box of the lattice, ends included. `values`
    /// has a value for every cell, x fastest.
    #[inline]
    pub(super) fn any<T>(&self, values: &[T], low: [isize; 3], high: [isize; 3], holds: impl Fn(&T) -> bool) -> bool {
        let cells = self.cells();
        let (mut first, mut last) = ([0; 3], [0; 3]);
        for axis in 0..3 {
            let cell = |point: isize| (self.place(axis, point).max(0) as usize / CELL).min(cells[axis] - 1);
            (first[axis], last[axis]) = (cell(low[axis]), cell(high[axis]));
        }
        for z in first[2]..=last[2] {
            for y in first[1]..=last[1] {
                let row = (z * cells[1] + y) * cells[0];
                if values[row + first[0]..=row + last[0]].iter().any(&holds) {
                    return true;
                }
            }
        }
        false
    }
}
