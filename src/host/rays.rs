//! The rays of a picture over the planes of a lattice.

use glam::{DAffine3, DMat3, DVec3};
use pulp::Simd;

use super::lanes::{Lanes, RAYS};
use super::light::Vector;
use crate::camera::Camera;
use crate::image::DepthMap;

/// The number of rays along the side of a group, which branches together.
pub(super) const GROUP: usize = 4;

/// The axes of a lattice for the rays of a tile: axes a and b of a plane, and planes front to back along the third.
#[derive(Clone, Copy)]
pub(super) struct Axes {
    pub(super) axes: [usize; 3],
    pub(super) is_flipped: bool,
    pub(super) size: [usize; 3],
}

impl Axes {
    /// Returns the axes for rays in a direction of the lattice.
    pub(super) fn new(direction: DVec3, dims: [usize; 3]) -> Self {
        let sizes = direction.abs();
        let principal = if sizes.z >= sizes.x.max(sizes.y) { 2 } else { usize::from(sizes.y >= sizes.x) };
        let axes = [[1, 2, 0], [0, 2, 1], [0, 1, 2]][principal];
        Self { axes, is_flipped: direction[principal] < 0.0, size: axes.map(|axis| dims[axis]) }
    }

    /// Returns the plane of the lattice that is number `plane` from the front.
    #[inline(always)]
    pub(super) fn plane(&self, plane: isize) -> isize {
        if self.is_flipped { self.size[2] as isize - 1 - plane } else { plane }
    }

    /// Returns a vector of the lattice in these axes.
    pub(super) fn of_vector(&self, vector: DVec3) -> DVec3 {
        let [a, b, m] = self.axes.map(|axis| vector[axis]);
        DVec3::new(a, b, if self.is_flipped { -m } else { m })
    }

    /// Returns a point of the lattice in these axes.
    fn of_point(&self, point: DVec3) -> DVec3 {
        let [a, b, m] = self.axes.map(|axis| point[axis]);
        DVec3::new(a, b, if self.is_flipped { (self.size[2] - 1) as f64 - m } else { m })
    }

    /// Returns the unit vectors of these axes in the lattice, and the point of the lattice at 0, 0, 0.
    pub(super) fn frame(&self) -> (DMat3, DVec3) {
        let along = |axis: usize, sign: f64| {
            let mut vector = DVec3::ZERO;
            vector[self.axes[axis]] = sign;
            vector
        };
        let sign = if self.is_flipped { -1.0 } else { 1.0 };
        let origin = if self.is_flipped { along(2, (self.size[2] - 1) as f64) } else { DVec3::ZERO };
        (DMat3::from_cols(along(0, 1.0), along(1, 1.0), along(2, sign)), origin)
    }

    /// Returns the box of the lattice of a box in these axes, ends included.
    pub(super) fn of_box(&self, low: [isize; 3], high: [isize; 3]) -> [[isize; 3]; 2] {
        let planes = [self.plane(low[2]), self.plane(high[2])];
        let (low, high) = ([low[0], low[1], planes[0].min(planes[1])], [high[0], high[1], planes[0].max(planes[1])]);
        let (mut from, mut to) = ([0; 3], [0; 3]);
        for (number, &axis) in self.axes.iter().enumerate() {
            (from[axis], to[axis]) = (low[number], high[number]);
        }
        [from, to]
    }
}

/// A ray over the planes of an axis: the place in a plane is `start + z step` at plane z.
#[derive(Clone, Copy)]
pub(super) struct AxisRay {
    start: [f64; 2],
    step: [f64; 2],
    /// The length from plane to plane, in world units.
    length: f64,
    /// The plane at depth 0, which is the eye's if there is an eye, and the number of planes per world unit of depth.
    depth: [f64; 2],
    /// The plane at which the ray begins.
    first: f64,
    direction: DVec3,
}

impl AxisRay {
    /// Returns along a and b the place in plane 0 and the step from plane to plane.
    pub(super) fn along(&self) -> [[f64; 2]; 2] {
        [0, 1].map(|axis| [self.start[axis], self.step[axis]])
    }

    /// Returns the depth of a plane, see [`DepthMap`].
    pub(super) fn depth_of(&self, plane: f64) -> f64 {
        let [zero, per_unit] = self.depth;
        (plane - zero) / per_unit
    }

    /// Returns the plane at a depth.
    fn plane_at(&self, depth: f64) -> f64 {
        let [zero, per_unit] = self.depth;
        per_unit.mul_add(depth, zero)
    }
}

/// A vector that is linear in the place of a pixel: its value at pixel 0, and its steps from column to column and from
/// row to row.
#[derive(Clone, Copy)]
struct Linear([DVec3; 3]);

impl Linear {
    fn at(&self, x: f64, y: f64) -> DVec3 {
        let [value, column, row] = self.0;
        value + column * x + row * y
    }
}

/// The rays of all pixels over the planes of an axis.
pub(super) struct Beam {
    origin: Linear,
    /// The direction of each ray in the lattice, of any length; `in_world` is the same vector in the world.
    direction: Linear,
    in_world: Linear,
    has_eye: bool,
}

impl Beam {
    pub(super) fn new(camera: &Camera, to_lattice: &DAffine3, axes: &Axes) -> Self {
        let [width, height] = camera.size.map(f64::from);
        let pixel = 2.0 / height;
        let (sx, sy) = (0.5 * pixel - width / height, 1.0 - 0.5 * pixel);
        let forward = camera.ray(0.0, 0.0).1;
        // Directions are linear if all reach as far along the axis of the camera.
        let rays = [(sx, sy), (sx + 1.0, sy), (sx, sy - 1.0)].map(|(x, y)| {
            let (origin, direction) = camera.ray(x, y);
            (origin, direction / direction.dot(forward))
        });
        let linear = |of: [DVec3; 3]| Linear([of[0], (of[1] - of[0]) * pixel, (of[2] - of[0]) * pixel]);
        let in_world = linear(rays.map(|(_, direction)| direction));
        Self {
            origin: linear(rays.map(|(origin, _)| axes.of_point(to_lattice.transform_point3(origin)))),
            direction: Linear(in_world.0.map(|vector| axes.of_vector(to_lattice.matrix3 * vector))),
            in_world,
            has_eye: camera.eye().is_some(),
        }
    }

    /// Returns the ray of a pixel.
    pub(super) fn line(&self, x: f64, y: f64) -> AxisRay {
        let (o, d, world) = (self.origin.at(x, y), self.direction.at(x, y), self.in_world.at(x, y));
        let (inverse, length) = (1.0 / d.z, world.length());
        let step = [d.x * inverse, d.y * inverse];
        AxisRay {
            start: [o.x - step[0] * o.z, o.y - step[1] * o.z],
            step,
            length: length * inverse,
            // Directions reach 1 along the axis of the camera.
            depth: [o.z, d.z],
            first: if self.has_eye { o.z } else { f64::NEG_INFINITY },
            direction: world / length,
        }
    }
}

/// The bounds of the part of rays that counts.
pub(super) struct Bounds<'a> {
    /// The first and the last plane.
    pub(super) planes: [f64; 2],
    /// Whether rays end half a voxel beyond the lattice.
    pub(super) is_boxed: bool,
    /// The sides of unclipped matter, in the lattice: a gradient, and a value at point 0.
    pub(super) sides: &'a [(DVec3, f64)],
    /// The depths at which rays end.
    pub(super) solids: Option<&'a DepthMap>,
    /// The least and the largest place, in the lattice, of the middles of the slabs that count; slabs that one plane
    /// parts count behind it. And whether the eye lies among them.
    pub(super) owned: Option<([DVec3; 2], bool)>,
    /// The distance in planes from the middle of a slab to the next.
    pub(super) step: f64,
}

/// Cuts a ray where `value + slope z` is negative.
fn cut(ends: [f64; 2], value: f64, slope: f64) -> [f64; 2] {
    if slope.abs() > 1e-12 * value.abs().max(1.0) {
        let at = -value / slope;
        if slope > 0.0 { [ends[0].max(at), ends[1]] } else { [ends[0], ends[1].min(at)] }
    } else if value < 0.0 {
        [f64::INFINITY, f64::NEG_INFINITY]
    } else {
        ends
    }
}

impl Bounds<'_> {
    /// Returns the planes between which the ray of a pixel counts.
    fn ends(&self, axes: &Axes, line: &AxisRay, [x, y]: [usize; 2]) -> [f64; 2] {
        let mut ends = [self.planes[0].max(line.first), self.planes[1]];
        if let Some(solids) = self.solids {
            let [width, height] = solids.size().map(|size| size as usize);
            // Tiles reach beyond the picture.
            let depth = if x < width && y < height { solids.at([x as u32, y as u32]) } else { f32::INFINITY };
            ends[1] = ends[1].min(line.plane_at(f64::from(depth)));
        }
        if self.is_boxed {
            for axis in 0..2 {
                ends = cut(ends, line.start[axis] + 0.5, line.step[axis]);
                ends = cut(ends, axes.size[axis] as f64 - 0.5 - line.start[axis], -line.step[axis]);
            }
        }
        if !self.sides.is_empty() {
            let (frame, origin) = axes.frame();
            let start = origin + frame * DVec3::new(line.start[0], line.start[1], 0.0);
            let step = frame * DVec3::new(line.step[0], line.step[1], 1.0);
            for &(gradient, value) in self.sides {
                ends = cut(ends, gradient.dot(start) + value, gradient.dot(step));
            }
        }
        if let Some(owned) = self.owned {
            let slabs = self.owned_slabs(axes, line, owned);
            ends = [ends[0].max(slabs[0]), ends[1].min(slabs[1])];
        }
        if ends[0] < ends[1] { ends } else { [1e9, -1e9] }
    }

    /// Returns the ends of the slabs whose middles lie between two corners of a box of the lattice. Boxes that share a
    /// plane share the arithmetic at it, so each slab is in one of them.
    fn owned_slabs(&self, axes: &Axes, line: &AxisRay, ([low, high], has_eye): ([DVec3; 2], bool)) -> [f64; 2] {
        let [a, b, m] = axes.axes;
        let last = (axes.size[2] - 1) as f64;
        let mut planes = if axes.is_flipped { [last - high[m], last - low[m]] } else { [low[m], high[m]] };
        for (number, axis) in [a, b].into_iter().enumerate() {
            let (start, step) = (line.start[number], line.step[number]);
            if step == 0.0 {
                if start < low[axis] || start >= high[axis] {
                    return [f64::INFINITY, f64::NEG_INFINITY];
                }
                continue;
            }
            let [first, second] = [(low[axis] - start) / step, (high[axis] - start) / step];
            planes = [planes[0].max(first.min(second)), planes[1].min(first.max(second))];
        }
        let end = |plane: f64| self.planes[0] + (((plane - self.planes[0]) / self.step).ceil() - 0.5) * self.step;
        // The slab of the eye, whose middle may lie behind it, is of the box that the eye is in.
        if has_eye {
            [f64::NEG_INFINITY, end(planes[1].max(line.first))]
        } else {
            [end(planes[0].max(line.first)), end(planes[1])]
        }
    }
}

/// The numbers of the rays of a group, in the order of [`Rays::new`].
pub(super) struct RayNumbers([[f32; RAYS]; 10]);

impl RayNumbers {
    /// Makes the rays of the group of pixels from (x, y) on. `unit` is the world length of the unit of extinctions.
    pub(super) fn new(beam: &Beam, axes: &Axes, bounds: &Bounds<'_>, unit: f64, [x, y]: [usize; 2]) -> Self {
        let mut numbers = [[0.0; RAYS]; 10];
        for ray in 0..RAYS {
            let pixel = [x + ray % GROUP, y + ray / GROUP];
            let line = beam.line(pixel[0] as f64, pixel[1] as f64);
            let (AxisRay { start, step, length, direction, .. }, ends) = (line, bounds.ends(axes, &line, pixel));
            let all = [start[0], start[1], step[0], step[1], length / unit, ends[0], ends[1]];
            for (number, value) in all.into_iter().chain((-direction).to_array()).enumerate() {
                numbers[number][ray] = value as f32;
            }
        }
        Self(numbers)
    }

    /// Returns whether any ray of the group crosses matter that counts.
    pub(super) fn is_alive(&self) -> bool {
        let [first, last] = self.ends();
        first < last
    }

    /// Returns the first and the last plane between which matter counts for any ray of the group.
    pub(super) fn ends(&self) -> [f64; 2] {
        let [.., first, last, _, _, _] = &self.0;
        let counted = first.iter().zip(last).filter(|(first, last)| first < last);
        counted.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], (&first, &last)| {
            [low.min(f64::from(first)), high.max(f64::from(last))]
        })
    }

    /// Returns the rays at the corners: along a and b, the place in plane 0 and the step from plane to plane.
    pub(super) fn corners(&self) -> [[[f64; 2]; 2]; 4] {
        let number = |number: usize, ray: usize| f64::from(self.0[number][ray]);
        [0, GROUP - 1, RAYS - GROUP, RAYS - 1].map(|ray| [0, 1].map(|axis| [number(axis, ray), number(axis + 2, ray)]))
    }
}

/// The rays of a group.
#[derive(Clone, Copy)]
pub(super) struct Rays<S: Simd> {
    pub(super) start: [Lanes<S>; 2],
    pub(super) step: [Lanes<S>; 2],
    /// The length from plane to plane in the unit of extinctions.
    pub(super) length: Lanes<S>,
    pub(super) longest: f32,
    /// The planes between which matter counts.
    pub(super) ends: [Lanes<S>; 2],
    pub(super) to_eye: Vector<S>,
}

impl<S: Simd> Rays<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, numbers: &RayNumbers) -> Self {
        let number = |index: usize| Lanes::<S>::from_array(numbers.0[index]);
        let length = number(4);
        Self {
            start: [number(0), number(1)],
            step: [number(2), number(3)],
            length,
            longest: length.largest(simd),
            ends: [number(5), number(6)],
            to_eye: [number(7), number(8), number(9)],
        }
    }

    /// Returns the places of the rays in a plane.
    #[inline(always)]
    pub(super) fn at(&self, simd: S, plane: Lanes<S>) -> [Lanes<S>; 2] {
        [self.step[0].fma(simd, plane, self.start[0]), self.step[1].fma(simd, plane, self.start[1])]
    }
}
