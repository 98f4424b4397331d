//! The buffer of a band: the extinctions that rays have passed.

use std::ops::Range;

use super::{BAND, RaySet, Swept};
use crate::lighting::shadow::field::{RowPlanes, hull};
use crate::lighting::shadow::incoming::common;
use crate::lighting::shadow::response::{catmull_rom, spline_weights};

/// Returns the rows of a band that are read at a plane and at the planes after it: for a place its own row, one row
/// before it and two after it.
fn rows_of(band: usize, rays: &RaySet<'_>, number: usize) -> Range<i64> {
    let [own, last] = [rays.drifts[number], rays.drifts[rays.drifts.len() - 1]];
    let start = (band as f64 + own.min(last)).floor() as i64 - 1;
    start..((band + BAND) as f64 + own.max(last)).ceil() as i64 + 2
}

/// The number of zeros at either end of a line.
const ENDS: usize = 8;

/// The sums of extinctions at the places of some rows of the buffer.
#[derive(Default)]
pub(super) struct Buffer {
    /// The first place of the band.
    band: usize,
    /// The number of the first row of `sums`.
    first: i64,
    sums: Vec<f32>,
    /// The places of each row that are not 0.
    filled: Vec<Range<usize>>,
    width: usize,
    scratch: RowScratch,
}

/// The memory for adding a row of a plane, and for reading a row of a buffer.
#[derive(Default)]
pub(in crate::lighting::shadow) struct RowScratch {
    /// A row of the plane that is added, or of the buffer that is read.
    line: Vec<f32>,
    /// The weights and the nearest column of a plane for each place of a row whose rays converge.
    table: Vec<([f32; 3], i32)>,
}

impl Buffer {
    /// Makes a buffer of 0 for a band, and lines of `columns`.
    pub(super) fn clear(&mut self, rays: &RaySet<'_>, band: usize, columns: usize) {
        self.band = band;
        self.width = rays.width;
        let rows = rows_of(band, rays, 0);
        self.first = rows.start;
        let count = rows.count();
        self.sums.clear();
        self.sums.resize(count * self.width, 0.0);
        self.filled.clear();
        self.filled.resize(count, 0..0);
        if let (Some(incoming), Some([row, column])) = (rays.incoming, rays.origin) {
            for (index, filled) in self.filled.iter_mut().enumerate() {
                let sums = &mut self.sums[index * self.width..][..self.width];
                *filled = incoming.put([self.first + index as i64 + row, column], sums);
            }
        }
        self.scratch.resize(columns, self.width);
    }

    /// Adds plane number `plane`, which has `number` counted from the light.
    #[inline(always)]
    pub(super) fn add(&mut self, swept: &Swept<'_>, rays: &RaySet<'_>, number: usize, plane: usize) {
        let width = self.width;
        let scratch = &mut self.scratch;
        scratch.begin(rays, number);
        for n in rows_of(self.band, rays, number) {
            let index = (n - self.first) as usize;
            let sums = &mut self.sums[index * width..][..width];
            let reached = scratch.add(swept, rays, [number, plane], n, sums);
            self.filled[index] = hull(self.filled[index].clone(), reached);
        }
    }

    /// Reads the sums at the wanted columns of a row.
    #[inline(always)]
    pub(super) fn read(
        &mut self,
        rays: &RaySet<'_>,
        number: usize,
        row: usize,
        wanted: Range<usize>,
        depths: &mut [f32],
    ) {
        let [rows, columns] = rays.maps[number];
        let at = rows.into[0] * row as f64 + rows.into[1];
        // Rows belong to the band but for rounding.
        let held = rows_of(self.band, rays, number);
        let below = (at.floor() as i64).clamp(held.start + 1, held.end - 3);
        let weights = catmull_rom((at - below as f64) as f32);
        let index = (below - 1 - self.first) as usize;
        let range = self.filled[index..index + 4].iter().fold(0..0, |range, filled| hull(range, filled.clone()));
        if range.is_empty() {
            depths.fill(0.0);
            return;
        }
        let place = |column: usize| columns.into[0] * column as f64 + columns.into[1];
        let needed = place(wanted.start).floor() as usize - 1..place(wanted.end - 1).floor() as usize + 3;
        let line = &mut self.scratch.line[..needed.len()];
        let [a, b, c, d] = weights;
        let [first, second, third, fourth] =
            [0, 1, 2, 3].map(|i| &self.sums[(index + i) * self.width + needed.start..][..line.len()]);
        for i in 0..line.len() {
            line[i] = a * first[i] + b * second[i] + c * third[i] + d * fourth[i];
        }
        if rays.origin.is_some() {
            let [a, b, c, d] = catmull_rom(columns.into[1].rem_euclid(1.0) as f32);
            let [first, second, third, fourth] = [0, 1, 2, 3].map(|o| &line[o..][..depths.len()]);
            for i in 0..depths.len() {
                depths[i] = (a * first[i] + b * second[i] + c * third[i] + d * fourth[i]).max(0.0);
            }
        } else {
            for (depth, column) in depths.iter_mut().zip(wanted) {
                let at = place(column);
                let below = at.floor();
                let [a, b, c, d] = catmull_rom((at - below) as f32);
                let from = &line[below as usize - 1 - needed.start..][..4];
                *depth = (a * from[0] + b * from[1] + c * from[2] + d * from[3]).max(0.0);
            }
        }
    }
}

/// Returns the nearest whole place, of two the second: parts of a lattice find the same one.
pub(in crate::lighting::shadow) fn nearest_place(place: f64) -> f64 {
    (place + 0.5).floor()
}

impl RowScratch {
    /// Allocates lines of `columns` and of `width` places.
    pub(in crate::lighting::shadow) fn resize(&mut self, columns: usize, width: usize) {
        self.line.resize(columns.max(width) + 2 * ENDS, 0.0);
    }

    /// Prepares for a plane, given its number counted from the light.
    #[inline(always)]
    fn begin(&mut self, rays: &RaySet<'_>, number: usize) {
        if rays.origin.is_none() {
            let [_, columns] = rays.maps[number];
            self.table.clear();
            self.table.extend((0..rays.width).map(|n| {
                let at = columns.back[0] * n as f64 + columns.back[1];
                (spline_weights((at - at.round()) as f32), at.round() as i32)
            }));
        }
    }

    /// Adds a plane, given its number counted from the light and its place in the box, to row `n` of sums. Returns the
    /// places that it reaches.
    #[inline(always)]
    pub(in crate::lighting::shadow) fn add(
        &mut self,
        swept: &Swept<'_>,
        rays: &RaySet<'_>,
        [number, plane]: [usize; 2],
        n: i64,
        sums: &mut [f32],
    ) -> Range<usize> {
        let RowPlanes { rows, .. } = swept.planes;
        let [rows_map, columns_map] = rays.maps[number];
        let at = rows_map.back[0] * n as f64 + rows_map.back[1];
        let nearest = nearest_place(at);
        let is_within = nearest >= -1.0 && nearest <= rows as f64;
        let window = rays.window.as_ref();
        let is_known = window.is_none_or(|of| of[0].contains(&(plane as i64)) && of[1].contains(&(nearest as i64)));
        if !is_within || !is_known {
            return 0..0;
        }
        let weight = rays.weights[number];
        let weights = spline_weights((at - nearest) as f32).map(|w| w * weight);
        let row = |o: i64| usize::try_from(nearest as i64 + o).ok().filter(|&row| row < rows);
        let sources = [-1, 0, 1].map(|o| row(o).map(|row| swept.planes.row(plane, row)));
        let Some(any) = sources.iter().flatten().next().copied() else { return 0..0 };
        let mut all = 0..0;
        for range in swept.filtered.runs(sources.iter().flatten().copied()) {
            let line = &mut self.line;
            let middle = ENDS + range.start..ENDS + range.end;
            line[middle.start - 3..middle.start].fill(0.0);
            line[middle.end..middle.end + 3].fill(0.0);
            // In place of rows that do not exist, another one without weight.
            let weights: [f32; 3] = std::array::from_fn(|i| if sources[i].is_some() { weights[i] } else { 0.0 });
            let [first, second, third] =
                sources.map(|source| &swept.filtered.from(source.unwrap_or(any), range.start as isize)[..range.len()]);
            let line_of_run = &mut line[middle.clone()];
            for i in 0..line_of_run.len() {
                line_of_run[i] = weights[0] * first[i] + weights[1] * second[i] + weights[2] * third[i];
            }
            let reached = if rays.origin.is_some() {
                let shift = nearest_place(columns_map.back[1]);
                let [a, b, c] = spline_weights((columns_map.back[1] - shift) as f32);
                // The buffer is wide enough for all places of a shifted plane.
                let places = |columns: Range<i64>| columns.start - shift as i64..columns.end - shift as i64;
                let reached = places(range.start as i64 - 1..range.end as i64 + 1);
                let within = window.map_or(reached.clone(), |window| common(&reached, &places(window[2].clone())));
                if within.is_empty() {
                    continue;
                }
                let start = (middle.start as i64 - 2 + within.start - reached.start) as usize;
                let within = within.start as usize..within.end as usize;
                let sums = &mut sums[within.clone()];
                let [from, second, third] = [0, 1, 2].map(|o| &line[start + o..][..sums.len()]);
                for i in 0..sums.len() {
                    sums[i] += a * from[i] + b * second[i] + c * third[i];
                }
                within
            } else {
                let width = rays.width as f64;
                let place = |column: f64| (columns_map.into[0] * column + columns_map.into[1]).clamp(0.0, width);
                let (start, end) = (place(range.start as f64 - 2.0), place(range.end as f64 + 1.0));
                let places = start.floor() as usize..end.ceil() as usize;
                for (sum, ([a, b, c], nearest)) in sums[places.clone()].iter_mut().zip(&self.table[places.clone()]) {
                    let nearest = (*nearest).clamp(range.start as i32 - 2, range.end as i32 + 1);
                    let from = &line[(ENDS as i32 + nearest - 1) as usize..][..3];
                    *sum += a * from[0] + b * from[1] + c * from[2];
                }
                places
            };
            all = hull(all, reached);
        }
        all
    }
}
