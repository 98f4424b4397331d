//! The box of the coefficients of a field, and the parts of it that rays read.

use std::ops::Range;

use glam::DVec3;

use super::rays::Axes;

/// Lattice points along the edge of a cell.
pub(super) const CELL: usize = 8;
/// Lattice points of a cell.
pub(super) const CELL_POINTS: usize = CELL * CELL * CELL;

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

/// The least and the largest place of rays in a few planes, along a and b.
pub(super) type Places = [[f64; 2]; 2];

/// Returns the places between four rays in a plane. Rays are pairs of the place in plane 0 and the step from plane to
/// plane, along a and b.
pub(super) fn places(corners: &[[[f64; 2]; 2]; 4], plane: f64) -> Places {
    let mut places = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
    for corner in corners {
        for axis in 0..2 {
            let [start, step] = corner[axis];
            let place = start + step * plane;
            places[axis] = [places[axis][0].min(place), places[axis][1].max(place)];
        }
    }
    places
}

impl PlaneArea {
    /// Returns the points that rays read at places moved into the reach of the field, and whether all pass the field.
    /// `ends` are the first and the last point of the field along a and b. Places may be off by `margin`.
    pub(super) fn around(places: Places, ends: [[f64; 2]; 2], reach: Reach, margin: f64) -> (Self, bool) {
        let Reach { beyond, around } = reach;
        let (mut area, mut passes) = (Self { low: [0; 2], high: [0; 2] }, false);
        for axis in 0..2 {
            let [low, high] = places[axis];
            let [first, last] = [ends[axis][0] - beyond, ends[axis][1] + beyond];
            passes |= high < first || low > last;
            area.low[axis] = (low - margin).clamp(first, last).floor() as isize - 1 - around;
            area.high[axis] = (high + margin).clamp(first, last).floor() as isize + 2 + around;
        }
        (area, passes)
    }

    pub(super) fn size(&self) -> [usize; 2] {
        [0, 1].map(|axis| (self.high[axis] - self.low[axis] + 1) as usize)
    }
}

/// The points that groups of rays read in a few planes, row by row: from the first to the last in a row.
#[derive(Default)]
pub(super) struct ReadPoints {
    /// The first row.
    first: isize,
    /// The first point of each row, and the last one.
    rows: Vec<[isize; 2]>,
}

impl ReadPoints {
    /// Returns the points of the areas of groups.
    pub(super) fn new(areas: impl Iterator<Item = PlaneArea> + Clone) -> Self {
        let none = [isize::MAX, isize::MIN];
        let [first, last] =
            areas.clone().fold(none, |ends, area| [ends[0].min(area.low[1]), ends[1].max(area.high[1])]);
        if first > last {
            return Self::default();
        }
        let mut rows = vec![none; (last - first + 1) as usize];
        for PlaneArea { low, high } in areas {
            for row in &mut rows[(low[1] - first) as usize..=(high[1] - first) as usize] {
                *row = [row[0].min(low[0]), row[1].max(high[0])];
            }
        }
        Self { first, rows }
    }

    /// Returns the points of a row of an area, counted from the first of the area.
    pub(super) fn of(&self, area: &PlaneArea, row: usize) -> Range<usize> {
        let row = usize::try_from(area.low[1] + row as isize - self.first).ok().and_then(|row| self.rows.get(row));
        let [first, last] = row.map_or([0, -1], |row| [row[0].max(area.low[0]), row[1].min(area.high[0])]);
        if first > last { 0..0 } else { (first - area.low[0]) as usize..(last + 1 - area.low[0]) as usize }
    }
}

/// The box of points with coefficients: the points of a lattice or of a part of it, and some beyond its faces, in whole
/// cells. Points farther than all of them count as the farthest.
///
/// The points of a cell follow each other, x fastest, and so do the cells: all rays find what is near in memory near.
#[derive(Clone, Copy)]
pub(super) struct Padded {
    pub(super) size: [usize; 3],
    /// Number of points before each face.
    pub(super) pad: usize,
    /// The point of the lattice at the low corner of the part.
    first: [isize; 3],
}

/// Rows of coefficients along axis a of a tile, at planes one after the other, in segments: the points of a cell.
pub(super) struct TileRows<const PLANES: usize> {
    /// The places in memory of the planes.
    planes: [usize; PLANES],
    /// The first point along a and b.
    low: [usize; 2],
    /// The distances in memory along a and b: from point to point of a cell, and from cell to cell.
    steps: [[usize; 2]; 2],
    /// Number of points before the area in its first segments.
    pub(super) skipped: usize,
}

impl<const PLANES: usize> TileRows<PLANES> {
    /// Returns the place in memory of a segment, without that of the plane.
    #[inline(always)]
    fn place(&self, row: usize, segment: usize) -> usize {
        let [[_, to_cell], [across, to_row]] = self.steps;
        let row = self.low[1] + row;
        (self.low[0] / CELL + segment) * to_cell + row % CELL * across + row / CELL * to_row
    }

    /// Returns whether the points of a segment follow each other in memory.
    pub(super) fn are_lines(&self) -> bool {
        self.steps[0][0] == 1
    }

    /// Returns segment number `segment` of row number `row` of each plane, where points follow each other in memory.
    #[inline(always)]
    pub(super) fn lines<'a, T>(&self, values: &'a [T], row: usize, segment: usize) -> [&'a [T; CELL]; PLANES] {
        let (lines, _) = values.as_chunks::<CELL>();
        let place = self.place(row, segment);
        let mut of_planes = [&lines[0]; PLANES];
        for plane in 0..PLANES {
            of_planes[plane] = &lines[(self.planes[plane] + place) / CELL];
        }
        of_planes
    }

    /// Returns segment number `segment` of row number `row` of each plane, where points lie a row of a cell apart.
    #[inline(always)]
    pub(super) fn columns<T: Copy>(&self, values: &[T], row: usize, segment: usize) -> [[T; CELL]; PLANES] {
        let (squares, _) = values.as_chunks::<{ CELL * CELL }>();
        let place = self.place(row, segment);
        let mut columns = [[squares[0][0]; CELL]; PLANES];
        for plane in 0..PLANES {
            let at = self.planes[plane] + place;
            let square = &squares[at / (CELL * CELL)];
            for point in 0..CELL {
                columns[plane][point] = square[at % CELL + CELL * point];
            }
        }
        columns
    }

    /// Returns the segments of a row with the given points of it.
    pub(super) fn segments(&self, points: &Range<usize>) -> Range<usize> {
        (self.skipped + points.start) / CELL..(self.skipped + points.end).div_ceil(CELL)
    }
}

impl Padded {
    /// Makes the box of the part of a lattice of `dims` points from point `first` on.
    pub(super) fn new(dims: [usize; 3], pad: usize, first: [isize; 3]) -> Self {
        Self { size: dims.map(|d| (d + 2 * pad).next_multiple_of(CELL)), pad, first }
    }

    /// Returns the number of a point of the lattice along an axis, counted from the first point of the box.
    fn place(&self, axis: usize, point: isize) -> usize {
        (point - self.first[axis] + self.pad as isize).clamp(0, self.size[axis] as isize - 1) as usize
    }

    /// Returns the places of the middles of all cells among the points of the lattice, in their order.
    pub(super) fn middles(&self) -> impl Iterator<Item = DVec3> + use<> {
        let Self { pad, first, .. } = *self;
        let [across, down, deep] = self.cells();
        let middle = move |axis: usize, cell: usize| {
            (CELL * cell) as f64 + (CELL as f64 - 1.0) / 2.0 - pad as f64 + first[axis] as f64
        };
        let rows = (0..deep).flat_map(move |z| (0..down).map(move |y| [y, z]));
        rows.flat_map(move |[y, z]| (0..across).map(move |x| DVec3::new(middle(0, x), middle(1, y), middle(2, z))))
    }

    /// Returns the number of all points.
    pub(super) fn count(&self) -> usize {
        self.size.iter().product()
    }

    /// Returns the number of cells along each axis.
    pub(super) fn cells(&self) -> [usize; 3] {
        self.size.map(|size| size / CELL)
    }

    /// Returns the distances in memory along each axis: from point to point of a cell, and from cell to cell.
    fn steps(&self) -> [[usize; 2]; 3] {
        let [across, down, _] = self.cells();
        let cells = [1, across, across * down];
        [0, 1, 2].map(|axis| [CELL.pow(axis as u32), CELL_POINTS * cells[axis]])
    }

    /// Returns the place in memory of a point of the box.
    #[inline(always)]
    pub(super) fn index(&self, point: [usize; 3]) -> usize {
        let steps = self.steps();
        (0..3).map(|axis| point[axis] % CELL * steps[axis][0] + point[axis] / CELL * steps[axis][1]).sum()
    }

    /// Returns the rows of an area in planes from number `first` on.
    pub(super) fn rows<const PLANES: usize>(&self, axes: &Axes, area: &PlaneArea, first: isize) -> TileRows<PLANES> {
        let steps = self.steps();
        let [a, b, m] = axes.axes;
        let low = [self.place(a, area.low[0]), self.place(b, area.low[1])];
        let mut planes = [0; PLANES];
        for (offset, plane) in planes.iter_mut().enumerate() {
            let place = self.place(m, axes.plane(first + offset as isize));
            *plane = place % CELL * steps[m][0] + place / CELL * steps[m][1];
        }
        TileRows { planes, low, steps: [steps[a], steps[b]], skipped: low[0] % CELL }
    }

    /// Returns whether `holds` accepts the value of any cell that meets a box of the lattice, ends included. `values`
    /// has a value for every cell, x fastest.
    #[inline]
    pub(super) fn any<T>(&self, values: &[T], low: [isize; 3], high: [isize; 3], holds: impl Fn(&T) -> bool) -> bool {
        let cells = self.cells();
        let (mut first, mut last) = ([0; 3], [0; 3]);
        for axis in 0..3 {
            (first[axis], last[axis]) = (self.place(axis, low[axis]) / CELL, self.place(axis, high[axis]) / CELL);
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
