//! Rays through a field of scalars, plane by plane.
//!
//! A tile of rays goes from plane to plane of the lattice, and half way between planes. For each, the coefficients are
//! first summed along the principal axis, which leaves a small picture of scalars and their central differences. Each
//! ray then reads 4 x 4 points of it. Between the samples of a ray the scalar is linear in two pieces for each half
//! plane, along which the transfer function is integrated exactly.

use glam::{DAffine3, DMat3, DVec3};
use pulp::{Simd, WithSimd};

use super::arriving::ArrivingLight;
use super::field::Field;
use super::lanes::{Channels, Lanes, Order, RAYS, added_up, dispatch, three, weighted};
use super::light::{Shader, Shine, Vector};
use super::table::{Classified, Table};
use crate::camera::Camera;
use crate::transfer::scaled_share;

/// Rays along the side of a group, which branches together.
const GROUP: usize = 4;
/// Pixels along the side of the largest tile.
pub(super) const TILE: usize = 32;
/// Half planes for which a group knows whether anything shows.
const BLOCK: usize = 8;
/// The least share of a ray's largest step among the axes of the lattice that its step along the principal axis has.
const LEAST_STEP: f64 = 0.5;

/// A picture of a field.
pub(super) struct Picture<'a> {
    pub(super) field: &'a Field,
    pub(super) table: &'a Table,
    pub(super) shader: Option<&'a Shader>,
    /// The light that arrives; `None`: all of it.
    pub(super) arriving: Option<&'a ArrivingLight>,
    /// Gradient opacity: pairs of the length of a gradient of scalars in the world, and the share of extinction.
    pub(super) gradient_opacity: &'a [[f32; 2]],
    pub(super) camera: &'a Camera,
    /// From the world to the lattice.
    pub(super) to_lattice: DAffine3,
    /// World units of the unit of extinctions.
    pub(super) unit: f64,
    /// From the lattice to places for the shader.
    pub(super) to_places: DAffine3,
    /// The sides of unclipped matter, in the lattice: a gradient, and a value at point 0.
    pub(super) sides: &'a [(DVec3, f64)],
    /// The transmittance at which rays end.
    pub(super) termination: f32,
}

/// Work of a tile.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Work {
    /// Samples of rays.
    pub(super) samples: u64,
    /// Slabs of rays that were classified.
    pub(super) slabs: u64,
}

impl Work {
    pub(super) fn and(self, other: Self) -> Self {
        Self { samples: self.samples + other.samples, slabs: self.slabs + other.slabs }
    }
}

/// A ray over the planes of an axis: the place in a plane is `start + z step` at plane z.
#[derive(Clone, Copy)]
struct Line {
    start: [f64; 2],
    step: [f64; 2],
    /// World units from plane to plane.
    length: f64,
    /// The plane of the eye.
    eye: f64,
    direction: DVec3,
}

/// The lattice as the rays of a tile see it: axes a and b of a plane, and planes front to back along the third.
#[derive(Clone, Copy)]
struct Axes {
    axes: [usize; 3],
    is_flipped: bool,
    size: [usize; 3],
}

impl Axes {
    /// The axes for a direction in the lattice.
    fn new(direction: DVec3, dims: [usize; 3]) -> Self {
        let sizes = direction.abs();
        let principal = if sizes.z >= sizes.x.max(sizes.y) { 2 } else { usize::from(sizes.y >= sizes.x) };
        let axes = [[1, 2, 0], [0, 2, 1], [0, 1, 2]][principal];
        Self { axes, is_flipped: direction[principal] < 0.0, size: axes.map(|axis| dims[axis]) }
    }

    /// The plane of the lattice that is number `plane` from the front.
    fn plane(&self, plane: isize) -> isize {
        if self.is_flipped { self.size[2] as isize - 1 - plane } else { plane }
    }

    /// A vector of the lattice over these axes.
    fn of_vector(&self, vector: DVec3) -> [f64; 3] {
        let [a, b, m] = self.axes.map(|axis| vector[axis]);
        [a, b, if self.is_flipped { -m } else { m }]
    }

    /// A point of the lattice over these axes.
    fn of_point(&self, point: DVec3) -> [f64; 3] {
        let [a, b, m] = self.axes.map(|axis| point[axis]);
        [a, b, if self.is_flipped { (self.size[2] - 1) as f64 - m } else { m }]
    }

    /// The unit vectors of these axes in the lattice, and the point of the lattice at 0, 0, 0.
    fn frame(&self) -> (DMat3, DVec3) {
        let along = |axis: usize, sign: f64| {
            let mut vector = DVec3::ZERO;
            vector[self.axes[axis]] = sign;
            vector
        };
        let sign = if self.is_flipped { -1.0 } else { 1.0 };
        let origin = if self.is_flipped { along(2, (self.size[2] - 1) as f64) } else { DVec3::ZERO };
        (DMat3::from_cols(along(0, 1.0), along(1, 1.0), along(2, sign)), origin)
    }

    /// The box of the lattice of ranges over these axes, ends included.
    fn of_box(&self, low: [isize; 3], high: [isize; 3]) -> [[isize; 3]; 2] {
        let planes = [self.plane(low[2]), self.plane(high[2])];
        let (low, high) = ([low[0], low[1], planes[0].min(planes[1])], [high[0], high[1], planes[0].max(planes[1])]);
        let (mut from, mut to) = ([0; 3], [0; 3]);
        for (number, &axis) in self.axes.iter().enumerate() {
            (from[axis], to[axis]) = (low[number], high[number]);
        }
        [from, to]
    }
}

impl Picture<'_> {
    /// Origin and unit direction of a pixel's ray in the world.
    fn ray(&self, x: f64, y: f64) -> (DVec3, DVec3) {
        let [width, height] = self.camera.size.map(f64::from);
        let sx = (2.0 * (x + 0.5) / width - 1.0) * width / height;
        let sy = 1.0 - 2.0 * (y + 0.5) / height;
        self.camera.ray(sx, sy)
    }

    fn line(&self, axes: &Axes, x: f64, y: f64) -> Line {
        let (origin, direction) = self.ray(x, y);
        let o = axes.of_point(self.to_lattice.transform_point3(origin));
        let d = axes.of_vector(self.to_lattice.matrix3 * direction);
        let step = [d[0] / d[2], d[1] / d[2]];
        let start = [o[0] - step[0] * o[2], o[1] - step[1] * o[2]];
        let eye = if self.camera.eye().is_some() { o[2] } else { f64::NEG_INFINITY };
        Line { start, step, length: 1.0 / d[2], eye, direction }
    }

    /// Paints the pixels of a square tile, row by row, into `out`. Pixels beyond the picture are painted too.
    pub(super) fn tile(&self, [x, y]: [usize; 2], side: usize, out: &mut [[f32; 4]]) -> Work {
        let ends = [0.0, (side - 1) as f64];
        let corners = ends.into_iter().flat_map(|dy| ends.map(|dx| (x as f64 + dx, y as f64 + dy)));
        let corners: Vec<(f64, f64)> = corners.collect();
        let middle = (side as f64 - 1.0) / 2.0;
        let in_lattice = |x: f64, y: f64| self.to_lattice.matrix3 * self.ray(x, y).1;
        let axes = Axes::new(in_lattice(x as f64 + middle, y as f64 + middle), self.field.dims);
        let leans = corners.iter().any(|&(x, y)| {
            let direction = in_lattice(x, y);
            axes.of_vector(direction)[2] < LEAST_STEP * direction.abs().max_element()
        });
        if leans && side > GROUP {
            let half = side / 2;
            let mut part = vec![[0.0; 4]; half * half];
            let mut work = Work::default();
            for [dx, dy] in [[0, 0], [half, 0], [0, half], [half, half]] {
                work = work.and(self.tile([x + dx, y + dy], half, &mut part));
                for (row, part) in part.chunks_exact(half).enumerate() {
                    out[(dy + row) * side + dx..][..half].copy_from_slice(part);
                }
            }
            return work;
        }
        let corners = [0, 1, 2, 3].map(|corner: usize| self.line(&axes, corners[corner].0, corners[corner].1));
        dispatch(Tile { picture: self, axes, place: [x, y], side, corners, out })
    }
}

/// A tile to be painted.
struct Tile<'a> {
    picture: &'a Picture<'a>,
    axes: Axes,
    place: [usize; 2],
    side: usize,
    corners: [Line; 4],
    out: &'a mut [[f32; 4]],
}

/// The part of a plane that is read: first and last points.
#[derive(Debug, Clone, Copy)]
struct Area {
    low: [isize; 2],
    high: [isize; 2],
}

impl Area {
    /// The points that rays read at plane z, and one more on every side; `None` if rays pass the field.
    #[inline(always)]
    fn new(corners: &[Line; 4], z: f64, size: [usize; 3]) -> Option<Self> {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for line in corners {
            for axis in 0..2 {
                let place = line.start[axis] + line.step[axis] * z;
                (low[axis], high[axis]) = (low[axis].min(place), high[axis].max(place));
            }
        }
        // Rays are at most half a voxel beyond the faces.
        if (0..2).any(|axis| high[axis] < -1.0 || low[axis] > size[axis] as f64) {
            return None;
        }
        let within = |place: f64, axis: usize| place.clamp(-1.5, size[axis] as f64 + 0.5);
        Some(Self {
            low: [0, 1].map(|axis| within(low[axis], axis).floor() as isize - 2),
            high: [0, 1].map(|axis| within(high[axis], axis).floor() as isize + 3),
        })
    }

    fn size(&self) -> [usize; 2] {
        [0, 1].map(|axis| (self.high[axis] - self.low[axis] + 1) as usize)
    }
}

/// Memory of a plane: scalars and their differences along the axis, and the channels side by side.
#[derive(Default)]
struct Plane {
    scalars: Vec<f32>,
    along: Vec<f32>,
    channels: Vec<f32>,
}

/// Points that rows are rounded up to.
const ROUND: usize = 8;

/// The rays of a group.
#[derive(Clone, Copy)]
struct Rays<S: Simd> {
    start: [Lanes<S>; 2],
    step: [Lanes<S>; 2],
    /// The length from plane to plane in the unit of extinctions.
    length: Lanes<S>,
    /// The planes between which matter counts.
    ends: [Lanes<S>; 2],
    to_eye: Vector<S>,
}

/// A group on its way.
#[derive(Clone, Copy)]
struct State<S: Simd> {
    color: Vector<S>,
    transmittance: Lanes<S>,
    /// The scalars of the last four samples, and the central differences of the last three.
    scalars: [Lanes<S>; 4],
    differences: [Vector<S>; 3],
    /// The scalar at the end of the last slab.
    end: Lanes<S>,
    /// Its classification, if it is known.
    classified: Option<Classified<S>>,
    /// The number of the last sample.
    last: isize,
}

impl WithSimd for Tile<'_> {
    type Output = Work;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Work {
        let Self { picture, axes, place, side, corners, out } = self;
        let Picture { field, table, shader, .. } = *picture;
        let across = side / GROUP;
        let size = axes.size;
        let (zero, one) = (Lanes::<S>::all(simd, 0.0), Lanes::<S>::all(simd, 1.0));
        let group_place = |group: usize| [place[0] + group % across * GROUP, place[1] + group / across * GROUP];
        let rays: Vec<Rays<S>> = (0..across * across).map(|group| rays(picture, &axes, group_place(group))).collect();
        let mut states = vec![
            State {
                color: [zero; 3],
                transmittance: one,
                scalars: [zero; 4],
                differences: [[zero; 3]; 3],
                end: zero,
                classified: None,
                last: isize::MIN / 2,
            };
            rays.len()
        ];
        let mut alive: Vec<usize> = Vec::with_capacity(rays.len());
        for (group, rays) in rays.iter().enumerate() {
            if rays.ends[0].less(simd, rays.ends[1]).any(simd) {
                alive.push(group);
            }
        }
        // Number n stands for half plane (n - 1) / 2, so that slabs reach both faces.
        let count = 2 * size[2] + 1;
        let z_of = |number: usize| number as f64 / 2.0 - 0.5;
        let areas: Vec<Option<Area>> = (0..count).map(|number| Area::new(&corners, z_of(number), size)).collect();
        let shows = |low: [isize; 3], high: [isize; 3]| {
            let [low, high] = axes.of_box(low, high);
            !table.is_invisible(field.range(low, high))
        };
        let may_show: Vec<bool> = areas
            .iter()
            .enumerate()
            .map(|(number, area)| {
                area.is_some_and(|Area { low, high }| {
                    let plane = (number as isize - 1).div_euclid(2);
                    shows([low[0], low[1], plane - 1], [high[0], high[1], plane + 2])
                })
            })
            .collect();
        let near = |number: usize, distance: usize| {
            let last = (number + distance).min(count - 1);
            may_show[number.saturating_sub(distance).min(last)..=last].contains(&true)
        };
        let blocks = count / BLOCK + 2;
        let mut group_shows = vec![false; rays.len() * blocks];
        for &group in &alive {
            let [starts, steps] = [rays[group].start, rays[group].step].map(|pair| pair.map(Lanes::to_array));
            for block in 0..blocks {
                let numbers = BLOCK * block..(BLOCK * block + BLOCK).min(count);
                if numbers.start >= count || !may_show[numbers].contains(&true) {
                    continue;
                }
                let z = [z_of(BLOCK * block), z_of(BLOCK * block + BLOCK)].map(|z| z as f32);
                let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
                for corner in [0, GROUP - 1, RAYS - GROUP, RAYS - 1] {
                    for axis in 0..2 {
                        for z in z {
                            let place = starts[axis][corner] + steps[axis][corner] * z;
                            (low[axis], high[axis]) = (low[axis].min(place), high[axis].max(place));
                        }
                    }
                }
                if (0..2).any(|axis| high[axis] < -1.0 || low[axis] > size[axis] as f32) {
                    continue;
                }
                let within = |place: f32, axis: usize| place.clamp(-1.5, size[axis] as f32 + 0.5).floor() as isize;
                group_shows[group * blocks + block] = shows(
                    [within(low[0], 0) - 2, within(low[1], 1) - 2, z[0].floor() as isize - 2],
                    [within(high[0], 0) + 3, within(high[1], 1) + 3, z[1].floor() as isize + 2],
                );
            }
        }
        let shows_at = |group: usize, number: isize| {
            number >= 0 && group_shows[group * blocks + (number as usize / BLOCK).min(blocks - 1)]
        };
        let differs = shader.is_some() || !picture.gradient_opacity.is_empty();
        let shading = Shading::new(simd, picture, &axes);
        let mut plane = Plane::default();
        let mut work = Work::default();
        for number in 0..count + 2 {
            if alive.is_empty() {
                break;
            }
            let sampled = (number < count && near(number, 2)).then(|| areas[number]).flatten();
            if let Some(area) = sampled {
                let stride = plane.make(field, &axes, &area, number, differs);
                let z = Lanes::<S>::all(simd, z_of(number) as f32);
                let [width, height] = area.size();
                let low =
                    [Lanes::<S>::all(simd, area.low[0] as f32 + 1.0), Lanes::<S>::all(simd, area.low[1] as f32 + 1.0)];
                // Rays outside of the area are outside of the box.
                let most = [Lanes::<S>::all(simd, width as f32 - 4.001), Lanes::<S>::all(simd, height as f32 - 4.001)];
                for &group in &alive {
                    if !shows_at(group, number as isize - 2) && !shows_at(group, number as isize + 1) {
                        continue;
                    }
                    work.samples += RAYS as u64;
                    let rays = &rays[group];
                    let mut at = [zero; 2];
                    for axis in 0..2 {
                        let place = rays.step[axis].fma(simd, z, rays.start[axis]).sub(simd, low[axis]);
                        at[axis] = place.max(simd, one).min(simd, most[axis]);
                    }
                    let [scalar, a, b, m] = sampled_at(simd, &shading.order, &plane.channels, stride, at);
                    let state = &mut states[group];
                    if state.last == number as isize - 1 {
                        let [_, s1, s2, s3] = state.scalars;
                        state.scalars = [s1, s2, s3, scalar];
                        state.differences = [state.differences[1], state.differences[2], [a, b, m]];
                    } else {
                        state.scalars = [scalar; 4];
                        state.differences = [[a, b, m]; 3];
                        state.end = scalar;
                        state.classified = None;
                    }
                    state.last = number as isize;
                }
            } else {
                for &group in &alive {
                    let state = &mut states[group];
                    if state.last >= number as isize - 2 {
                        let [_, s1, s2, s3] = state.scalars;
                        state.scalars = [s1, s2, s3, s3];
                        state.differences = [state.differences[1], state.differences[2], state.differences[2]];
                    }
                }
            }
            // The slab around the sample before the last two.
            let Some(middle) = number.checked_sub(2).filter(|&middle| near(middle, 1)) else { continue };
            let mut has_ended = false;
            for &group in &alive {
                if !shows_at(group, middle as isize) || states[group].last < middle as isize {
                    states[group].classified = None;
                    continue;
                }
                if shading.slab(simd, &mut states[group], &rays[group], z_of(middle) as f32) {
                    work.slabs += RAYS as u64;
                    has_ended |= states[group].transmittance.largest(simd) < picture.termination;
                }
            }
            if has_ended {
                let mut left = 0;
                for index in 0..alive.len() {
                    if states[alive[index]].transmittance.largest(simd) >= picture.termination {
                        alive[left] = alive[index];
                        left += 1;
                    }
                }
                alive.truncate(left);
            }
        }
        for (group, state) in states.iter().enumerate() {
            let color = three!(channel => state.color[channel].to_array());
            let alpha = one.sub(simd, state.transmittance).to_array();
            for ray in 0..RAYS {
                let at = (group / across * GROUP + ray / GROUP) * side + group % across * GROUP + ray % GROUP;
                out[at] = [color[0][ray], color[1][ray], color[2][ray], alpha[ray]];
            }
        }
        work
    }
}

/// The rays of a group.
#[inline(always)]
fn rays<S: Simd>(picture: &Picture<'_>, axes: &Axes, [x, y]: [usize; 2]) -> Rays<S> {
    let mut numbers = [[0.0_f32; RAYS]; 10];
    let size = axes.size;
    for ray in 0..RAYS {
        let line = picture.line(axes, (x + ray % GROUP) as f64, (y + ray / GROUP) as f64);
        let mut ends = [(-0.5_f64).max(line.eye), size[2] as f64 - 0.5];
        // value + slope z is 0 or more inside.
        let mut cut = |value: f64, slope: f64| {
            if slope.abs() > 1e-12 * value.abs().max(1.0) {
                let at = -value / slope;
                ends = if slope > 0.0 { [ends[0].max(at), ends[1]] } else { [ends[0], ends[1].min(at)] };
            } else if value < 0.0 {
                ends = [f64::INFINITY, f64::NEG_INFINITY];
            }
        };
        for axis in 0..2 {
            cut(line.start[axis] + 0.5, line.step[axis]);
            cut(size[axis] as f64 - 0.5 - line.start[axis], -line.step[axis]);
        }
        for &(gradient, value) in picture.sides {
            let (frame, origin) = axes.frame();
            let start = origin + frame * DVec3::new(line.start[0], line.start[1], 0.0);
            let step = frame * DVec3::new(line.step[0], line.step[1], 1.0);
            cut(gradient.dot(start) + value, gradient.dot(step));
        }
        let ends = if ends[0] < ends[1] { ends } else { [1e9, -1e9] };
        let all =
            [line.start[0], line.start[1], line.step[0], line.step[1], line.length / picture.unit, ends[0], ends[1]];
        let eye = (-line.direction).to_array();
        for (numbers, value) in numbers.iter_mut().zip(all.into_iter().chain(eye)) {
            numbers[ray] = value as f32;
        }
    }
    let [a, b, step_a, step_b, length, first, last, ex, ey, ez] = numbers.map(Lanes::from_array);
    Rays { start: [a, b], step: [step_a, step_b], length, ends: [first, last], to_eye: [ex, ey, ez] }
}

impl Plane {
    /// Sums the coefficients of a half plane along the axis, and lays channels side by side: the scalar, and its
    /// central differences along a, b and the axis. Returns the numbers of a row. The outermost points stay as they
    /// were.
    #[inline(always)]
    fn make(&mut self, field: &Field, axes: &Axes, area: &Area, number: usize, differs: bool) -> usize {
        let [width, height] = area.size();
        let stride = width.next_multiple_of(ROUND);
        if self.scalars.len() < stride * height {
            self.scalars.resize(stride * height, 0.0);
            self.along.resize(stride * height, 0.0);
            self.channels.resize(4 * (stride * height + ROUND), 0.0);
        }
        let steps = field.steps();
        let plane = (number as isize - 1).div_euclid(2);
        // Sample (number - 1) / 2 lies at a plane, or half way to the next.
        let is_whole = number % 2 == 1;
        let (step, step_a) = (axes.axes, steps[axes.axes[0]]);
        for row in 0..height {
            let from = |offset: isize| {
                let mut point = [0; 3];
                point[step[0]] = area.low[0];
                point[step[1]] = area.low[1] + row as isize;
                point[step[2]] = axes.plane(plane + offset);
                field.from(point)
            };
            let scalars = &mut self.scalars[row * stride..][..width];
            let along = &mut self.along[row * stride..][..width];
            if is_whole {
                let planes = [from(-2), from(-1), from(0), from(1), from(2)];
                sum_whole(planes, step_a, scalars, along, differs);
            } else {
                let planes = [from(-2), from(-1), from(0), from(1), from(2), from(3)];
                sum_half(planes, step_a, scalars, along, differs);
            }
        }
        for row in 1..height - 1 {
            let at = |row: usize| &self.scalars[row * stride..][..width];
            let (before, own, behind) = (at(row - 1), at(row), at(row + 1));
            let along = &self.along[row * stride..][..width];
            let channels = &mut self.channels[4 * row * stride..][..4 * width];
            let (channels, _) = channels.as_chunks_mut::<4>();
            if differs {
                for x in 1..width - 1 {
                    channels[x] = [own[x], 0.5 * (own[x + 1] - own[x - 1]), 0.5 * (behind[x] - before[x]), along[x]];
                }
            } else {
                for x in 1..width - 1 {
                    channels[x][0] = own[x];
                }
            }
        }
        4 * stride
    }
}

/// The scalar at a plane and the central difference across it, by coefficients at five planes.
#[inline(always)]
fn whole([z, b, m, a, y]: [f32; 5]) -> (f32, f32) {
    let scalar = (b + a).mul_add(1.0 / 6.0, m * (4.0 / 6.0));
    (scalar, (y - z).mul_add(1.0 / 12.0, (a - b) * (4.0 / 12.0)))
}

/// The same half way between two planes, by coefficients at six.
#[inline(always)]
fn half([x, z, b, a, y, w]: [f32; 6]) -> (f32, f32) {
    let scalar = (z + y).mul_add(1.0 / 48.0, (b + a) * (23.0 / 48.0));
    let far = (y - z).mul_add(23.0, w - x);
    (scalar, far.mul_add(1.0 / 96.0, (a - b) * (22.0 / 96.0)))
}

/// Sums planes at a plane: weights 1, 4, 1 over 6; and central differences along the axis.
#[inline(always)]
fn sum_whole(planes: [&[f32]; 5], step: usize, scalars: &mut [f32], along: &mut [f32], differs: bool) {
    let count = scalars.len();
    if step == 1 {
        let [z, b, m, a, y] = planes.map(|plane| &plane[..count]);
        for x in 0..count {
            let (scalar, difference) = whole([z[x], b[x], m[x], a[x], y[x]]);
            scalars[x] = scalar;
            if differs {
                along[x] = difference;
            }
        }
    } else {
        for x in 0..count {
            let [z, b, m, a, y] = planes;
            let at = x * step;
            (scalars[x], along[x]) = whole([z[at], b[at], m[at], a[at], y[at]]);
        }
    }
}

/// Sums planes half way between planes: weights 1, 23, 23, 1 over 48; and central differences along the axis.
#[inline(always)]
fn sum_half(planes: [&[f32]; 6], step: usize, scalars: &mut [f32], along: &mut [f32], differs: bool) {
    let count = scalars.len();
    if step == 1 {
        let [p, z, b, a, y, w] = planes.map(|plane| &plane[..count]);
        for x in 0..count {
            let (scalar, difference) = half([p[x], z[x], b[x], a[x], y[x], w[x]]);
            scalars[x] = scalar;
            if differs {
                along[x] = difference;
            }
        }
    } else {
        for x in 0..count {
            let [p, z, b, a, y, w] = planes;
            let at = x * step;
            (scalars[x], along[x]) = half([p[at], z[at], b[at], a[at], y[at], w[at]]);
        }
    }
}

/// The weights of cubic B-splines at a fraction of the way from the second to the third of four points.
#[inline(always)]
fn spline<S: Simd>(simd: S, t: Lanes<S>) -> [Lanes<S>; 4] {
    let (one, half) = (Lanes::all(simd, 1.0), Lanes::all(simd, 0.5));
    let (sixth, two_thirds) = (Lanes::all(simd, 1.0 / 6.0), Lanes::all(simd, 2.0 / 3.0));
    let minus_one = Lanes::all(simd, -1.0);
    let u = one.sub(simd, t);
    let (t2, u2) = (t.mul(simd, t), u.mul(simd, u));
    [
        u2.mul(simd, u).mul(simd, sixth),
        t2.fma(simd, t.fma(simd, half, minus_one), two_thirds),
        u2.fma(simd, u.fma(simd, half, minus_one), two_thirds),
        t2.mul(simd, t).mul(simd, sixth),
    ]
}

/// The channels of a plane at the places of a group.
#[inline(always)]
fn sampled_at<S: Simd>(simd: S, order: &Order, plane: &[f32], stride: usize, [a, b]: [Lanes<S>; 2]) -> [Lanes<S>; 4] {
    let (first_a, first_b) = (a.floor(simd), b.floor(simd));
    let [along0, along1, along2, along3] = spline(simd, a.sub(simd, first_a));
    let [across0, across1, across2, across3] = spline(simd, b.sub(simd, first_b));
    let along = [along0.to_array(), along1.to_array(), along2.to_array(), along3.to_array()];
    let across = [across0.to_array(), across1.to_array(), across2.to_array(), across3.to_array()];
    let offset = first_b.fma(simd, Lanes::all(simd, stride as f32), first_a.mul(simd, Lanes::all(simd, 4.0)));
    let offset = offset.indices(simd);
    let mut channels = Channels::new(simd);
    for vector in 0..channels.0.len() {
        let [one, other] = order.pair(vector);
        let mut parts = [simd.splat_f32s(0.0); 2];
        for (part, ray) in [one, other].into_iter().enumerate() {
            let rows = &plane[offset[ray] as usize..];
            parts[part] = weighted(
                simd,
                [rows, &rows[stride..], &rows[2 * stride..], &rows[3 * stride..]],
                [across[0][ray], across[1][ray], across[2][ray], across[3][ray]],
                [along[0][ray], along[1][ray], along[2][ray], along[3][ray]],
            );
        }
        channels.0[vector] = added_up(simd, parts[0], parts[1]);
    }
    channels.apart(simd)
}

/// The classification and the light of slabs.
struct Shading<'a, S: Simd> {
    picture: &'a Picture<'a>,
    axes: Axes,
    order: Order,
    /// From differences along a, b and the planes to gradients in the world.
    gradient: [[Lanes<S>; 3]; 3],
    /// From the planes to places for the shader: rows of three factors and a sum.
    places: [[Lanes<S>; 4]; 3],
}

impl<'a, S: Simd> Shading<'a, S> {
    #[inline(always)]
    fn new(simd: S, picture: &'a Picture<'a>, axes: &Axes) -> Self {
        let (frame, origin) = axes.frame();
        let all = |value: f64| Lanes::all(simd, value as f32);
        let gradient = picture.to_lattice.matrix3.transpose() * frame;
        let map = picture.to_places * DAffine3::from_mat3_translation(frame, origin);
        Self {
            picture,
            axes: *axes,
            order: Order::new(simd),
            gradient: [0, 1, 2].map(|row| [0, 1, 2].map(|column| all(gradient.col(column)[row]))),
            places: [0, 1, 2].map(|row| {
                let factors = [0, 1, 2].map(|column| all(map.matrix3.col(column)[row]));
                [factors[0], factors[1], factors[2], all(map.translation[row])]
            }),
        }
    }

    /// Composites the slab around the half plane at `z`: two pieces, along which the scalar is linear. Returns false if
    /// nothing shows.
    #[inline(always)]
    fn slab(&self, simd: S, state: &mut State<S>, rays: &Rays<S>, z: f32) -> bool {
        let table = self.picture.table;
        let [s0, s1, s2, s3] = state.scalars;
        // The scalar half way to the next sample, by the cubic through four.
        let outer = s0.add(simd, s3);
        let last =
            s1.add(simd, s2).mul(simd, Lanes::all(simd, 9.0)).sub(simd, outer).mul(simd, Lanes::all(simd, 1.0 / 16.0));
        let first = state.end;
        let (low, high) = (first.min(simd, s1).min(simd, last), first.max(simd, s1).max(simd, last));
        let ends = rays.ends;
        let inside =
            ends[0].less(simd, Lanes::all(simd, z + 0.25)).and(simd, Lanes::all(simd, z - 0.25).less(simd, ends[1]));
        let above = Lanes::all(simd, table.invisible[1]).less(simd, high).and(simd, inside).any(simd);
        let below = low.less(simd, Lanes::all(simd, table.invisible[0])).and(simd, inside).any(simd);
        state.end = last;
        if !above && !below {
            state.classified = None;
            return false;
        }
        let begin = match state.classified {
            Some(begin) => begin,
            None => table.classified(simd, &self.order, first),
        };
        let middle = table.classified(simd, &self.order, s1);
        let end = table.classified(simd, &self.order, last);
        state.classified = Some(end);
        let (shine, share) = self.light(simd, state, rays, z, s1);
        // Cut pieces begin or end at other scalars.
        let is_cut = Lanes::all(simd, z - 0.25).less(simd, ends[0]).any(simd)
            || ends[1].less(simd, Lanes::all(simd, z + 0.25)).any(simd);
        if is_cut {
            let (start, stop) = self.cut(simd, ends, z - 0.25, [first, s1]);
            let length = self.length(simd, rays, z - 0.25, share);
            composite(simd, state, &Classified::mean(simd, &start, &stop), length, shine.as_ref());
            let (start, stop) = self.cut(simd, ends, z, [s1, last]);
            let length = self.length(simd, rays, z, share);
            composite(simd, state, &Classified::mean(simd, &start, &stop), length, shine.as_ref());
        } else {
            let length = rays.length.mul(simd, Lanes::all(simd, 0.25)).mul(simd, share);
            composite(simd, state, &Classified::mean(simd, &begin, &middle), length, shine.as_ref());
            composite(simd, state, &Classified::mean(simd, &middle, &end), length, shine.as_ref());
        }
        true
    }

    /// The length of the part of a quarter of a plane that counts, in the unit of extinctions.
    #[inline(always)]
    fn length(&self, simd: S, rays: &Rays<S>, from: f32, share: Lanes<S>) -> Lanes<S> {
        let start = rays.ends[0].max(simd, Lanes::all(simd, from));
        let stop = rays.ends[1].min(simd, Lanes::all(simd, from + 0.25));
        stop.sub(simd, start).max(simd, Lanes::all(simd, 0.0)).mul(simd, rays.length).mul(simd, share)
    }

    /// The ends of the part of a quarter of a plane that counts, between two scalars.
    #[inline(always)]
    fn cut(&self, simd: S, ends: [Lanes<S>; 2], from: f32, scalars: [Lanes<S>; 2]) -> (Classified<S>, Classified<S>) {
        let (low, high) = (Lanes::all(simd, from), Lanes::all(simd, from + 0.25));
        let rise = scalars[1].sub(simd, scalars[0]).mul(simd, Lanes::all(simd, 4.0));
        let start = ends[0].max(simd, low).min(simd, high).sub(simd, low).fma(simd, rise, scalars[0]);
        let stop = ends[1].max(simd, low).min(simd, high).sub(simd, low).fma(simd, rise, scalars[0]);
        let table = self.picture.table;
        (table.classified(simd, &self.order, start), table.classified(simd, &self.order, stop))
    }

    /// The light on a slab, and the share of its extinction by gradient opacity.
    #[inline(always)]
    fn light(
        &self,
        simd: S,
        state: &State<S>,
        rays: &Rays<S>,
        z: f32,
        scalar: Lanes<S>,
    ) -> (Option<Shine<S>>, Lanes<S>) {
        let points = self.picture.gradient_opacity;
        let shader = self.picture.shader;
        if shader.is_none() && points.is_empty() {
            return (None, Lanes::all(simd, 1.0));
        }
        let differences = state.differences[0];
        let gradient: Vector<S> = three!(axis => {
            let [a, b, m] = self.gradient[axis];
            a.fma(simd, differences[0], b.fma(simd, differences[1], m.mul(simd, differences[2])))
        });
        let share = if points.is_empty() {
            Lanes::all(simd, 1.0)
        } else {
            let length = super::light::dot(simd, &gradient, &gradient).sqrt(simd).to_array();
            Lanes::from_array(length.map(|length| scaled_share(points, length)))
        };
        let Some(shader) = shader else { return (None, share) };
        let largest = differences[0].abs(simd).max(simd, differences[1].abs(simd)).max(simd, differences[2].abs(simd));
        let at_a = rays.step[0].fma(simd, Lanes::all(simd, z), rays.start[0]);
        let at_b = rays.step[1].fma(simd, Lanes::all(simd, z), rays.start[1]);
        let mut kept = None;
        if let Some(arriving) = self.picture.arriving {
            let plane = if self.axes.is_flipped { (self.axes.size[2] - 1) as f32 - z } else { z };
            kept = Some(arriving.at(simd, &self.order, self.axes.axes, [at_a, at_b], plane));
        }
        let mut place = [Lanes::all(simd, 0.0); 3];
        if shader.has_places() {
            place = three!(axis => {
                let [a, b, m, sum] = self.places[axis];
                at_a.fma(simd, a, at_b.fma(simd, b, Lanes::all(simd, z).fma(simd, m, sum)))
            });
        }
        let shine = shader.shine(simd, &gradient, (largest, scalar), &place, &rays.to_eye, kept.as_ref());
        (Some(shine), share)
    }
}

/// Adds a piece of matter with these means of colour times extinction, and extinction.
#[inline(always)]
fn composite<S: Simd>(simd: S, state: &mut State<S>, mean: &[Lanes<S>; 4], length: Lanes<S>, shine: Option<&Shine<S>>) {
    let extinction = mean[3].max(simd, Lanes::all(simd, 0.0));
    let passed = state.transmittance.mul(simd, extinction.mul(simd, length).exp_neg(simd));
    let absorbed = state.transmittance.sub(simd, passed);
    let per = Lanes::all(simd, 1.0).div(simd, extinction.max(simd, Lanes::all(simd, 1e-30)));
    for channel in 0..3 {
        let mut color = mean[channel].mul(simd, per);
        if let Some(shine) = shine {
            color = shine.lit(simd, channel, color);
        }
        state.color[channel] = color.fma(simd, absorbed, state.color[channel]);
    }
    state.transmittance = passed;
}
