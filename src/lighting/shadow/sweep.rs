//! Sheared accumulation: the optical depths of all voxels towards a light, plane after plane away from the light.
//!
//! A buffer holds, for rays of the light through the places of a lattice of its own, the extinctions that they have
//! passed. It is sheared along the direction of the light, or scaled about the place of the light, so a ray stays at
//! its place in the buffer: each plane of the volume is read into the buffer once, and the buffer is read at the voxels
//! of a plane once. Nothing diffuses from plane to plane, as in sweeps that resample the sum (Kniss et al. 2003). The
//! depth of a voxel is the sum of the planes beyond the nearest few, and an exact sum over its neighbours less the
//! response of the sweep to them ([`Response`]). A voxel costs 15 multiply-adds and those of its neighbours, wherever
//! it lies.

use std::ops::Range;
use std::sync::atomic::{AtomicU16, Ordering};

use glam::{DMat3, DVec3};
use pulp::Arch;
use rayon::prelude::*;

use super::field::{Field, LANES, Planes, hull};
use super::lanes::Lanes;
use super::response::{Response, StencilRow, catmull_rom, spline_weights};
use crate::error::Result;

/// Rows of the buffer that are swept together, so that they stay in a cache.
const BAND: usize = 32;

/// The optical depth beyond which the neighbours of a voxel do not count: less than 1 of 255 of the light arrives.
const FAINT: f32 = 5.5;

/// Places of the buffer beyond those that are read.
const MARGIN: f64 = 4.0;

/// The extinctions of a box, ready for sweeps across an axis.
pub(super) struct Swept<'a> {
    pub(super) field: &'a Field,
    pub(super) planes: Planes,
    filtered: Field,
    response: &'a Response,
}

/// The places of a plane's rows, or columns, in the buffer, and of the buffer's in the plane: factor and summand.
#[derive(Clone, Copy)]
struct Map {
    into: [f64; 2],
    back: [f64; 2],
}

/// The rays of a light.
struct Rays {
    /// Whether the light lies at the end of the last plane.
    ahead: bool,
    /// Whether they are parallel: columns are then only shifted in the buffer, by shifts of whole 65536ths.
    is_sheared: bool,
    /// Places of the buffer.
    size: [usize; 2],
    /// For each plane, the nearest to the light first.
    maps: Vec<[Map; 2]>,
    /// The weight of each plane.
    weights: Vec<f32>,
    /// The nearest planes, which are not taken from the sweep.
    near: usize,
}

/// The light of a sweep.
enum Course<'a> {
    Along(Along<'a>),
    To(To<'a>),
}

/// The sums of the neighbours of voxels.
pub(super) struct Near {
    ahead: bool,
    /// The nearest planes, which are not taken from sweeps.
    planes: usize,
    stencil: Vec<StencilRow>,
    /// The sums, if several directions share them.
    sums: Option<Field>,
}

/// Parallel rays.
struct Along<'a> {
    near: &'a Near,
    /// The factor of sums of planes, and of all.
    factors: [f32; 2],
    /// The light that an unshadowed voxel gets.
    share: f32,
}

/// Rays to a place.
struct To<'a> {
    rays: &'a Converging<'a>,
    ahead: bool,
}

/// The rays of a light at a place that run mainly along an axis.
pub(super) struct Converging<'a> {
    /// The place, in planes, rows and columns from the first voxel.
    pub(super) place: DVec3,
    /// The world vectors of a step to the next plane, row and column, in the unit that extinctions are per.
    pub(super) to_world: DMat3,
    /// Whether rays that run as much along rows, or columns, as along planes are left to another axis.
    pub(super) strict: [bool; 2],
    pub(super) near: &'a NearPlace,
}

/// The stencils of rays to a place, for slopes of rows 0 to 1 and of columns -1 to 1.
pub(super) struct NearPlace {
    /// Slopes from 0 to 1.
    steps: usize,
    stencils: Vec<Vec<StencilRow>>,
    bias: f64,
    /// Voxels fewer planes than this from the place are summed without a sweep.
    direct: f64,
}

impl NearPlace {
    pub(super) fn new(response: &Response, bias: f64) -> Self {
        let near = Response::planes(bias, 1.0);
        // 32 for the default kernel; wider kernels change less.
        let steps = (64.0 / response.radius()).clamp(4.0, 32.0) as usize;
        let stencils = (0..(steps + 1) * (2 * steps + 1)).into_par_iter().map(|number| {
            let [row, column] = [number / (2 * steps + 1), number % (2 * steps + 1)].map(|n| n as f64 / steps as f64);
            response.stencil([row, column - 1.0], [bias, f64::INFINITY], Some(near))
        });
        Self { steps, stencils: stencils.collect(), bias, direct: response.reach(bias) as f64 }
    }

    /// The stencil of the nearest slopes.
    fn stencil(&self, [row, column]: [f64; 2]) -> &[StencilRow] {
        let number = |slope: f64, from: f64| ((slope - from) * self.steps as f64).round() as usize;
        &self.stencils[number(row.abs(), 0.0) * (2 * self.steps + 1) + number(column, -1.0)]
    }
}

/// The length of a unit direction between two planes, and the rows and the columns that it passes.
fn slopes(along: DVec3) -> (f64, [f64; 2]) {
    let length = 1.0 / along.x.abs();
    (length, [along.y * length, along.z * length])
}

impl<'a> Swept<'a> {
    pub(super) fn new(field: &'a Field, planes: Planes, response: &'a Response) -> Result<Self> {
        let weights = [&response.across, &response.within].map(|w| w.iter().map(|&w| w as f32).collect::<Vec<_>>());
        let filtered = field.filtered(planes, [&weights[0], &weights[1]])?;
        Ok(Self { field, planes, filtered, response })
    }

    /// The sums of the neighbours of voxels towards a direction (planes, rows, columns; unit length): at once, if they
    /// are `shared` by the sweeps of several directions.
    pub(super) fn near(&self, along: DVec3, bias: f64, shared: bool) -> Result<Near> {
        let (length, slopes) = slopes(along);
        let planes = Response::planes(bias, length);
        let stencil = self.response.stencil(slopes, [bias, f64::INFINITY], Some(planes));
        let mut near = Near { ahead: along.x > 0.0, planes, stencil, sums: None };
        if shared {
            let arch = Arch::new();
            near.sums = Some(self.field.of_rows(self.planes, |at, out| {
                arch.dispatch(NearRow { near: &near, swept: self, at, out });
            })?);
        }
        Ok(near)
    }

    /// Adds the light from a direction (planes, rows, columns; unit length) to each voxel, given the sums of neighbours
    /// towards about that direction: `share` if all of it arrives. `scale` is the length of a voxel along the
    /// direction, per unit of extinction.
    pub(super) fn add_parallel(&self, near: &Near, along: DVec3, scale: f64, share: u16, out: &[AtomicU16]) {
        let (length, slopes) = slopes(along);
        let count = self.planes.planes;
        let shifts = slopes.map(|slope| MARGIN + (-slope * (count - 1) as f64).max(0.0));
        let size = [(self.planes.rows, slopes[0]), (self.planes.columns, slopes[1])]
            .map(|(n, slope)| n + (slope.abs() * (count - 1) as f64).ceil() as usize + 2 * MARGIN as usize);
        let maps = (0..count).map(|i| {
            [0, 1].map(|k| {
                // Whole parts stay whole: sums with whole numbers are exact.
                let at = ((shifts[k] + slopes[k] * i as f64) * 65_536.0).round() / 65_536.0;
                Map { into: [1.0, at], back: [1.0, -at] }
            })
        });
        let weights = vec![1.0; count];
        let rays =
            Rays { ahead: along.x > 0.0, is_sheared: true, size, maps: maps.collect(), weights, near: near.planes };
        let factors = [(length * self.response.integral) as f32, scale as f32];
        let along = Along { near, factors, share: f32::from(share) };
        self.sweep(&rays, &Course::Along(along), out);
    }

    /// Sets the light from a place at the voxels from which it lies mainly across planes, ahead of them or behind.
    pub(super) fn set_converging(&self, rays: &Converging<'_>, ahead: bool, out: &[AtomicU16]) {
        let Converging { place, near, .. } = rays;
        let count = self.planes.planes;
        // Planes less than half a plane behind the place count by their part before it.
        let first = if ahead { count as f64 - 1.0 - place.x } else { place.x };
        let skipped = (0.5 + first).floor().max(0.0) as usize;
        if skipped >= count {
            return;
        }
        // Distances from the place in planes, the nearest first.
        let distances: Vec<f64> = (skipped..count).map(|i| i as f64 - first).collect();
        let farthest = distances[distances.len() - 1];
        if farthest <= 0.0 {
            return;
        }
        let nearest = distances[0].max(1e-3);
        let ranges = [(place.y, self.planes.rows), (place.z, self.planes.columns)].map(|(at, count)| {
            let ends = [-at, (count - 1) as f64 - at];
            let least = (ends[0] / nearest).min(ends[0] / farthest).max(-1.0);
            (at, least, (ends[1] / nearest).max(ends[1] / farthest).min(1.0))
        });
        if ranges.iter().any(|(_, least, most)| least > most) {
            return;
        }
        let size = ranges.map(|(_, least, most)| ((most - least) * farthest).ceil() as usize + 2 * MARGIN as usize + 1);
        let maps = distances.iter().map(|&distance| {
            ranges.map(|(at, least, _)| {
                let (along, factor) = (distance.max(0.0), farthest / distance.max(1e-3));
                Map {
                    into: [factor, MARGIN - least * farthest - at * factor],
                    back: [along / farthest, at + (least - MARGIN / farthest) * along],
                }
            })
        });
        let weights = distances.iter().map(|distance| (distance + 0.5).clamp(0.0, 1.0) as f32).collect();
        let near_planes = Response::planes(near.bias, 1.0);
        let course = Course::To(To { rays, ahead });
        self.sweep(
            &Rays { ahead, is_sheared: false, size, maps: maps.collect(), weights, near: near_planes },
            &course,
            out,
        );
    }

    /// Sweeps all bands of the buffer.
    fn sweep(&self, rays: &Rays, course: &Course<'_>, out: &[AtomicU16]) {
        let arch = Arch::new();
        (0..rays.size[0].div_ceil(BAND)).into_par_iter().for_each_init(Buffer::default, |buffer, band| {
            arch.dispatch(Band { swept: self, rays, course, first: band * BAND, buffer, out });
        });
    }

    /// The plane of a number, counted from the light.
    fn plane(&self, rays: &Rays, number: usize) -> usize {
        let skipped = self.planes.planes - rays.maps.len();
        if rays.ahead { self.planes.planes - 1 - skipped - number } else { skipped + number }
    }
}

/// Rows of the buffer that are swept together, as a type so that the sweep is compiled for the widest vectors of the
/// machine.
struct Band<'a> {
    swept: &'a Swept<'a>,
    rays: &'a Rays,
    course: &'a Course<'a>,
    first: usize,
    buffer: &'a mut Buffer,
    /// The light of each voxel. No two bands write to the same voxel: it is atomic because their rows lie mixed.
    out: &'a [AtomicU16],
}

/// The buffer of a band.
#[derive(Default)]
struct Buffer {
    /// The row before the band, those of the band and the two after.
    sums: Vec<f32>,
    /// For each row, the places that are not 0.
    filled: Vec<Range<usize>>,
    width: usize,
    /// A row of the plane that is added, or of the buffer that is read.
    line: Vec<f32>,
}

/// Zeros at either end of a line.
const ENDS: usize = 8;

impl pulp::WithSimd for Band<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let Self { swept, rays, course, first, buffer, out } = self;
        let Planes { rows, columns, .. } = swept.planes;
        buffer.clear(rays.size[1], columns);
        let mut depths = [0.0_f32; LANES];
        let mut table: Vec<([f32; 3], i32)> = Vec::new();
        let mut added = 0;
        // The places of the band that have a row before them and two after them.
        let places = [first.max(1), (first + BAND).min(rays.size[0] - 2)].map(|n| n as f64);
        for (number, [rows_map, _]) in rays.maps.iter().enumerate() {
            let [low, high] =
                places.map(|place| ((place - rows_map.into[1]) / rows_map.into[0]).ceil().max(0.0) as usize);
            let plane = swept.plane(rays, number);
            for row in low..high.min(rows) {
                let source = swept.planes.row(plane, row);
                let mut wanted = swept.field.filled(source);
                if let Course::To(to) = course {
                    wanted = to.within(wanted, plane, row);
                }
                if wanted.is_empty() {
                    continue;
                }
                while added + rays.near < number {
                    buffer.add(swept, rays, added, first, &mut table);
                    added += 1;
                }
                let out = &out[source * columns..][..columns];
                for start in wanted.clone().step_by(Lanes::<S>::COUNT) {
                    if !swept.field.shows(source, start, Lanes::<S>::COUNT) {
                        continue;
                    }
                    let columns = start..wanted.end.min(start + Lanes::<S>::COUNT);
                    depths[columns.len()..].fill(0.0);
                    buffer.read(rays, number, first, row, columns.clone(), &mut depths);
                    match course {
                        Course::Along(along) => along.light(simd, swept, [plane, row], columns, &depths, out),
                        Course::To(to) => to.light(swept, plane, row, columns, &depths, out),
                    }
                }
            }
        }
    }
}

impl Buffer {
    /// Makes a buffer of 0 for rows of `width` places and lines of `columns`.
    fn clear(&mut self, width: usize, columns: usize) {
        self.width = width;
        self.sums.clear();
        self.sums.resize((BAND + 3) * width, 0.0);
        self.filled.clear();
        self.filled.resize(BAND + 3, 0..0);
        self.line.resize(columns.max(width) + 2 * ENDS, 0.0);
    }

    /// Adds a plane.
    #[inline(always)]
    fn add(&mut self, swept: &Swept<'_>, rays: &Rays, number: usize, first: usize, table: &mut Vec<([f32; 3], i32)>) {
        let Planes { rows, .. } = swept.planes;
        let plane = swept.plane(rays, number);
        let [rows_map, columns_map] = rays.maps[number];
        let weight = rays.weights[number];
        let width = self.width;
        if !rays.is_sheared {
            table.clear();
            table.extend((0..width).map(|n| {
                let at = columns_map.back[0] * n as f64 + columns_map.back[1];
                (spline_weights((at - at.round()) as f32), at.round() as i32)
            }));
        }
        for index in 0..BAND + 3 {
            let Some(n) = (first + index).checked_sub(1) else { continue };
            let at = rows_map.back[0] * n as f64 + rows_map.back[1];
            let nearest = at.round();
            if nearest < -1.0 || nearest > rows as f64 {
                continue;
            }
            let weights = spline_weights((at - nearest) as f32).map(|w| w * weight);
            let row = |o: i64| usize::try_from(nearest as i64 + o).ok().filter(|&row| row < rows);
            let sources = [-1, 0, 1].map(|o| row(o).map(|row| swept.planes.row(plane, row)));
            let Some(any) = sources.iter().flatten().next().copied() else { continue };
            for range in swept.filtered.runs(sources.iter().flatten().copied()) {
                let line = &mut self.line;
                let middle = ENDS + range.start..ENDS + range.end;
                line[middle.start - 3..middle.start].fill(0.0);
                line[middle.end..middle.end + 3].fill(0.0);
                // In place of rows that do not exist, another one without weight.
                let weights: [f32; 3] = std::array::from_fn(|i| if sources[i].is_some() { weights[i] } else { 0.0 });
                let [first, second, third] = sources
                    .map(|source| &swept.filtered.from(source.unwrap_or(any), range.start as isize)[..range.len()]);
                let line_of_run = &mut line[middle.clone()];
                for i in 0..line_of_run.len() {
                    line_of_run[i] = weights[0] * first[i] + weights[1] * second[i] + weights[2] * third[i];
                }
                let sums = &mut self.sums[index * width..][..width];
                let reached = if rays.is_sheared {
                    let shift = columns_map.back[1].round();
                    let [a, b, c] = spline_weights((columns_map.back[1] - shift) as f32);
                    // The buffer is wide enough for all places of a shifted plane.
                    let start = (range.start as f64 - 1.0 - shift) as usize;
                    let end = (range.end as f64 + 1.0 - shift) as usize;
                    let sums = &mut sums[start..end];
                    let [from, second, third] = [0, 1, 2].map(|o| &line[middle.start - 2 + o..][..sums.len()]);
                    for i in 0..sums.len() {
                        sums[i] += a * from[i] + b * second[i] + c * third[i];
                    }
                    start..end
                } else {
                    let place =
                        |column: f64| (columns_map.into[0] * column + columns_map.into[1]).clamp(0.0, width as f64);
                    let (start, end) = (place(range.start as f64 - 2.0), place(range.end as f64 + 1.0));
                    let places = start.floor() as usize..end.ceil() as usize;
                    for (sum, ([a, b, c], nearest)) in sums[places.clone()].iter_mut().zip(&table[places.clone()]) {
                        let nearest = (*nearest).clamp(range.start as i32 - 2, range.end as i32 + 1);
                        let from = &line[(ENDS as i32 + nearest - 1) as usize..][..3];
                        *sum += a * from[0] + b * from[1] + c * from[2];
                    }
                    places
                };
                self.filled[index] = hull(self.filled[index].clone(), reached);
            }
        }
    }

    /// Reads the sums at the wanted columns of a row.
    #[inline(always)]
    fn read(&mut self, rays: &Rays, number: usize, first: usize, row: usize, wanted: Range<usize>, depths: &mut [f32]) {
        let [rows, columns] = rays.maps[number];
        let at = rows.into[0] * row as f64 + rows.into[1];
        // Rows belong to the band but for rounding.
        let below = at.floor().clamp(first as f64, (first + BAND - 1) as f64);
        let weights = catmull_rom((at - below) as f32);
        // The first row of the buffer is the one before the band.
        let index = below as usize - first;
        let range = self.filled[index..index + 4].iter().fold(0..0, |range, filled| hull(range, filled.clone()));
        let depths = &mut depths[..wanted.len()];
        if range.is_empty() {
            depths.fill(0.0);
            return;
        }
        let place = |column: usize| columns.into[0] * column as f64 + columns.into[1];
        let needed = place(wanted.start).floor() as usize - 1..place(wanted.end - 1).floor() as usize + 3;
        let line = &mut self.line[..needed.len()];
        let [a, b, c, d] = weights;
        let [first, second, third, fourth] =
            [0, 1, 2, 3].map(|i| &self.sums[(index + i) * self.width + needed.start..][..line.len()]);
        for i in 0..line.len() {
            line[i] = a * first[i] + b * second[i] + c * third[i] + d * fourth[i];
        }
        if rays.is_sheared {
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

/// The whole number nearest to a number of 0 to 65535.
#[inline(always)]
pub(super) fn nearest(value: f32) -> u16 {
    (value + 8_388_608.0).to_bits() as u16
}

impl Along<'_> {
    /// Adds the light that arrives at the wanted voxels of a row, given their sums of planes.
    #[inline(always)]
    fn light<S: pulp::Simd>(
        &self,
        simd: S,
        swept: &Swept<'_>,
        [plane, row]: [usize; 2],
        columns: Range<usize>,
        far: &[f32],
        out: &[AtomicU16],
    ) {
        let Self { near, factors: [planes, all], share } = self;
        let source = swept.planes.row(plane, row);
        let mut sums = Lanes::load(far).times(simd, *planes);
        if let Some(near) = &near.sums {
            sums = sums.plus(simd, 1.0, Lanes::load(near.from(source, columns.start as isize)));
        } else {
            // Where hardly any light is left, the neighbours do not matter.
            let own = swept.field.from(source, columns.start as isize);
            let is_lit = own.iter().zip(far).map(|(own, far)| u32::from((*own > 0.0) & (far * planes * all < FAINT)));
            if is_lit.sum::<u32>() > 0 {
                sums = near.add(simd, swept, [plane, row], columns.start, sums);
            }
        }
        let mut light = [0.0; LANES];
        sums.times(simd, *all).transmitted(simd).times(simd, *share).store(&mut light);
        for (out, light) in out[columns].iter().zip(&light) {
            out.store(out.load(Ordering::Relaxed) + nearest(*light), Ordering::Relaxed);
        }
    }
}

impl Near {
    /// Adds the neighbours of the voxels of a row from a column on.
    #[inline(always)]
    fn add<S: pulp::Simd>(
        &self,
        simd: S,
        swept: &Swept<'_>,
        at: [usize; 2],
        start: usize,
        mut sums: Lanes<S>,
    ) -> Lanes<S> {
        let (field, of) = (swept.field, swept.planes);
        for StencilRow { offset: [ahead, down], column, weights } in &self.stencil {
            let planes = if self.ahead { *ahead } else { -*ahead };
            let Some(source) = of.beside(at, [planes, *down]) else { continue };
            let filled = field.filled(source);
            let first = start as isize + *column as isize;
            if filled.is_empty()
                || filled.end as isize <= first
                || filled.start as isize >= first + (Lanes::<S>::COUNT + weights.len()) as isize
            {
                continue;
            }
            let values = field.from(source, first);
            for (i, &weight) in weights.iter().enumerate() {
                sums = sums.plus(simd, weight, Lanes::load(&values[i..]));
            }
        }
        sums
    }
}

/// The sums of neighbours of a row, as a type so that they are compiled for the widest vectors of the machine.
struct NearRow<'a> {
    near: &'a Near,
    swept: &'a Swept<'a>,
    at: [usize; 2],
    out: &'a mut [f32],
}

impl pulp::WithSimd for NearRow<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let Self { near, swept, at, out } = self;
        let source = swept.planes.row(at[0], at[1]);
        let wanted = swept.field.filled(source);
        for start in wanted.step_by(Lanes::<S>::COUNT) {
            if swept.field.shows(source, start, Lanes::<S>::COUNT) {
                near.add(simd, swept, at, start, Lanes::new(simd, 0.0)).store(&mut out[start..]);
            }
        }
    }
}

impl To<'_> {
    /// From a voxel to the place: planes, rows and columns.
    fn path(&self, [plane, row, column]: [usize; 3]) -> DVec3 {
        let path = self.rays.place - DVec3::new(plane as f64, row as f64, column as f64);
        if self.ahead { path } else { DVec3::new(-path.x, path.y, path.z) }
    }

    /// The columns of a row from which the place lies mainly across planes.
    fn within(&self, columns: Range<usize>, plane: usize, row: usize) -> Range<usize> {
        let path = self.path([plane, row, 0]);
        let [strict_rows, strict_columns] = self.rays.strict;
        if path.x <= 0.0 || path.y.abs() > path.x || (strict_rows && path.y.abs() >= path.x) {
            return 0..0;
        }
        let [mut first, mut last] = [(path.z - path.x).ceil(), (path.z + path.x).floor()];
        if strict_columns {
            first += if first == path.z - path.x { 1.0 } else { 0.0 };
            last -= if last == path.z + path.x { 1.0 } else { 0.0 };
        }
        columns.start.max(first.max(0.0) as usize)..columns.end.min((last + 1.0).max(0.0) as usize)
    }

    /// Sets the light that arrives at the wanted voxels of a row, given their sums of planes.
    #[inline(always)]
    fn light(
        &self,
        swept: &Swept<'_>,
        plane: usize,
        row: usize,
        wanted: Range<usize>,
        depths: &[f32],
        out: &[AtomicU16],
    ) {
        let (of, near, response) = (swept.planes, self.rays.near, swept.response);
        let integral = response.integral;
        let own = swept.field.from(of.row(plane, row), 0);
        for (column, &planes) in wanted.zip(depths) {
            if own[column] <= 0.0 {
                continue;
            }
            let path = self.path([plane, row, column]);
            let slopes = [path.y / path.x, path.z / path.x];
            let length = DVec3::new(1.0, slopes[0], slopes[1]).length();
            let towards = DVec3::new(if self.ahead { 1.0 } else { -1.0 }, slopes[0], slopes[1]);
            let scale = (self.rays.to_world * towards).length() / length;
            let sum = |stencil: &[StencilRow], down: i32| {
                let mut sum = 0.0_f32;
                for StencilRow { offset: [ahead, rows], column: first, weights } in stencil {
                    let planes = if self.ahead { *ahead } else { -*ahead };
                    let Some(source) = of.beside([plane, row], [planes, down * rows]) else { continue };
                    let values = swept.field.from(source, column as isize + *first as isize);
                    sum += weights.iter().zip(values).map(|(weight, value)| weight * value).sum::<f32>();
                }
                f64::from(sum)
            };
            let depth = if path.x < near.direct {
                let distance = path.x * length;
                if distance <= near.bias {
                    0.0
                } else {
                    scale * sum(&response.stencil(slopes, [near.bias, distance], None), 1)
                }
            } else {
                let far = scale * length * integral * f64::from(planes);
                if far >= f64::from(FAINT) {
                    far
                } else {
                    far + scale * sum(near.stencil(slopes), if slopes[0] < 0.0 { -1 } else { 1 })
                }
            };
            out[column].store(nearest(65_535.0 * (-depth).exp() as f32), Ordering::Relaxed);
        }
    }
}
