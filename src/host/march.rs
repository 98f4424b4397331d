//! Rays through a field, plane by plane.
//!
//! A tile of rays goes from plane to plane of the lattice, and of scalars half way between planes. For each, the
//! coefficients are first summed along the principal axis, which leaves a small picture of channels. Each ray then
//! reads 4 x 4 points of it. A [`Rule`] makes a pixel of its samples.

use glam::{DAffine3, DVec3};
use pulp::{Simd, WithSimd};

use super::between::{DELAY, PlaneSamples, is_apart};
use super::blending::{Blending, Colors};
use super::lanes::{Lanes, Order, RAYS};
use super::lattice::{Places, PlaneArea, Reach, ReadPoints, places};
use super::plane::Plane;
use super::post::{Post, SlabShading};
use super::project::{Projecting, Projection};
use super::rays::{Axes, Beam, Bounds, GROUP, RayNumbers, Rays};
use super::rule::Rule;
use crate::camera::Camera;
use crate::image::DepthMap;
use crate::vectors::dispatch;

/// The number of pixels along the side of the largest tile.
pub(super) const TILE: usize = 32;
/// The number of samples of a block; a group knows for each block whether matter may be visible.
const BLOCK: usize = 8;
/// The distance by which places of rays may be off between the corners of their group, in points.
const MARGIN: f64 = 1.0 / 16.0;
/// The least share of a ray's largest step among the axes of the lattice that its step along the principal axis has.
const LEAST_STEP: f64 = 0.5;

/// A picture of a field.
pub(super) struct Picture<'a> {
    pub(super) matter: RayMatter<'a>,
    /// The numbers of points of the lattice.
    pub(super) dims: [usize; 3],
    /// The first and the last point of the field along each axis.
    pub(super) held: [[f64; 2]; 3],
    /// The slabs of a partial picture; see [`Bounds::owned`].
    pub(super) owned: Option<([DVec3; 2], bool)>,
    pub(super) camera: &'a Camera,
    /// The map from the world to the lattice.
    pub(super) to_lattice: DAffine3,
    /// The length of the unit of extinctions, in world units.
    pub(super) unit: f64,
    /// The sides of unclipped matter, in the lattice: a gradient, and a value at point 0.
    pub(super) sides: &'a [(DVec3, f64)],
    /// The transmittance at which rays end.
    pub(super) termination: f32,
    /// The depths at which rays end.
    pub(super) solids: Option<&'a DepthMap>,
    /// Whether pixels are the depth at which a ray has lost half of its light, and 1; 0 if a ray keeps more.
    pub(super) halves: bool,
    /// The isosurfaces in matter that is classified voxel by voxel: rays find them first.
    pub(super) surfaces: Option<&'a Self>,
}

/// The matter along rays, by the kind of picture.
pub(super) enum RayMatter<'a> {
    Post(Post<'a>),
    Colors(Colors<'a>),
    Projection(Projection<'a>),
}

/// The work of painting a tile.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Work {
    /// Number of samples of rays.
    pub(super) samples: u64,
    /// Number of slabs of rays with visible matter.
    pub(super) slabs: u64,
}

impl Work {
    pub(super) fn and(self, other: Self) -> Self {
        Self { samples: self.samples + other.samples, slabs: self.slabs + other.slabs }
    }
}

impl Picture<'_> {
    /// Returns the field's reach, the distance in planes from the outermost voxels to the first and the last sample,
    /// and whether rays end at the faces.
    fn extent(&self) -> (Reach, f64, bool) {
        match &self.matter {
            RayMatter::Post(_) => (Post::REACH, 0.5, true),
            RayMatter::Projection(_) => (Projection::REACH, 0.5, true),
            RayMatter::Colors(colors) => (colors.reach(), colors.reach().beyond, false),
        }
    }

    /// Returns whether matter may be visible between two points of the lattice, ends included.
    fn shows(&self, low: [isize; 3], high: [isize; 3]) -> bool {
        match &self.matter {
            RayMatter::Post(post) => post.shows(low, high),
            RayMatter::Colors(colors) => {
                colors.shows(low, high) || self.surfaces.is_some_and(|surfaces| surfaces.shows(low, high))
            }
            // All scalars matter, if only because they are not the largest.
            RayMatter::Projection(_) => true,
        }
    }

    /// Paints the pixels of a square tile, row by row, into `out`. Pixels beyond the picture are painted too.
    pub(super) fn tile(&self, [x, y]: [usize; 2], side: usize, out: &mut [[f32; 4]]) -> Work {
        let ends = [0.0, (side - 1) as f64];
        let corners = [0, 1, 2, 3].map(|corner: usize| [x as f64 + ends[corner % 2], y as f64 + ends[corner / 2]]);
        let middle = (side as f64 - 1.0) / 2.0;
        let [width, height] = self.camera.size.map(f64::from);
        let in_lattice = |[x, y]: [f64; 2]| {
            let sx = (2.0 * (x + 0.5) / width - 1.0) * width / height;
            let sy = 1.0 - 2.0 * (y + 0.5) / height;
            self.to_lattice.matrix3 * self.camera.ray(sx, sy).1
        };
        let axes = Axes::new(in_lattice([x as f64 + middle, y as f64 + middle]), self.dims);
        let leans = corners.iter().any(|&corner| {
            let direction = in_lattice(corner);
            axes.of_vector(direction).z < LEAST_STEP * direction.abs().max_element()
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
        let beam = Beam::new(self.camera, &self.to_lattice, &axes);
        let corners = corners.map(|[x, y]| beam.line(x, y).along());
        dispatch(Tile { picture: self, axes, beam, place: [x, y], side, corners, out })
    }
}

/// A square tile of pixels to paint.
struct Tile<'a> {
    picture: &'a Picture<'a>,
    axes: Axes,
    beam: Beam,
    place: [usize; 2],
    side: usize,
    /// The rays at the corners of the tile, see [`places`].
    corners: [[[f64; 2]; 2]; 4],
    out: &'a mut [[f32; 4]],
}

/// The samples along the rays of a tile around which matter may be visible.
struct Course {
    /// The plane of sample 0.
    first: f64,
    /// The part of each plane that rays read.
    areas: Vec<Option<PlaneArea>>,
    /// Whether matter may be visible around each sample.
    may_show: Vec<bool>,
    /// Whether matter may be visible to each group in each block of [`BLOCK`] samples.
    groups: Vec<bool>,
    blocks: usize,
    /// The part of the planes of each block that each group reads, block after block; `None` far from visible matter.
    read: Vec<Option<PlaneArea>>,
}

impl Course {
    fn new(tile: &Tile<'_>, picture: &Picture<'_>, step: f64, groups: &[RayNumbers], is_alive: &[bool]) -> Self {
        let Tile { axes, corners, .. } = tile;
        let (reach, before, _) = picture.extent();
        let count = ((axes.size[2] as f64 - 1.0 + 2.0 * before) / step) as usize + 1;
        let z_of = |number: usize| number as f64 * step - before;
        let held = [picture.held[axes.axes[0]], picture.held[axes.axes[1]]];
        let mut areas = Vec::with_capacity(count);
        for number in 0..count {
            let (area, passes) = PlaneArea::around(places(corners, z_of(number)), held, reach, 0.0);
            areas.push((!passes).then_some(area));
        }
        // Slabs before the first that counts lead to it, and the sample behind the last shapes it.
        let ends = groups.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], numbers| {
            let [first, last] = numbers.ends();
            [low.min(first), high.max(last)]
        });
        let ends = [ends[0] - 3.0 * step, ends[1] + 2.0 * step];
        let shows = |area: &PlaneArea, z: [f64; 2]| {
            let low = [area.low[0], area.low[1], z[0].floor() as isize - 1];
            let high = [area.high[0], area.high[1], z[1].floor() as isize + 2];
            let [low, high] = axes.of_box(low, high);
            picture.shows(low, high)
        };
        let mut may_show = vec![false; count];
        for (number, area) in areas.iter().enumerate() {
            let z = z_of(number);
            may_show[number] = ends[0] < z && z < ends[1] && area.as_ref().is_some_and(|area| shows(area, [z; 2]));
        }
        let blocks = count.div_ceil(BLOCK);
        let corners: Vec<[[[f64; 2]; 2]; 4]> = groups.iter().map(RayNumbers::corners).collect();
        let mut visible = vec![false; groups.len() * blocks];
        let mut read = vec![None; groups.len() * blocks];
        // The places of groups where the last block ended.
        let mut ended: Vec<Option<Places>> = vec![None; groups.len()];
        for block in 0..blocks {
            let shows_within = |blocks: usize| {
                may_show[BLOCK * block.saturating_sub(blocks)..(BLOCK * (block + 1 + blocks)).min(count)]
                    .contains(&true)
            };
            // Samples count for slabs in the next blocks.
            if !shows_within(1) {
                ended.fill(None);
                continue;
            }
            let is_visible = shows_within(0);
            let z = [z_of(BLOCK * block), z_of(BLOCK * (block + 1))];
            for group in (0..groups.len()).filter(|&group| is_alive[group]) {
                let begin = ended[group].unwrap_or_else(|| places(&corners[group], z[0]));
                let end = places(&corners[group], z[1]);
                let hull = [0, 1].map(|axis| [begin[axis][0].min(end[axis][0]), begin[axis][1].max(end[axis][1])]);
                let (area, passes) = PlaneArea::around(hull, held, reach, MARGIN);
                visible[group * blocks + block] = is_visible && !passes && shows(&area, [z[0] - 1.0, z[1]]);
                read[block * groups.len() + group] = Some(area);
                ended[group] = Some(end);
            }
        }
        Self { first: -before, areas, may_show, groups: visible, blocks, read }
    }

    /// Returns the points that some groups read in a block.
    fn read(&self, groups: &[usize], block: usize) -> ReadPoints {
        let blocks = block.saturating_sub(1)..(block + 2).min(self.blocks);
        let count = self.groups.len() / self.blocks;
        let areas = &self.read[block * count..][..count];
        let is_read = |group: &&usize| self.groups[*group * self.blocks..][blocks.clone()].contains(&true);
        ReadPoints::new(groups.iter().filter(is_read).filter_map(|&group| areas[group]))
    }

    /// Returns whether matter may be visible within a distance of a sample.
    #[inline(always)]
    fn near(&self, number: usize, distance: usize) -> bool {
        let last = self.may_show.len() - 1;
        for near in number.saturating_sub(distance).min(last)..=(number + distance).min(last) {
            if self.may_show[near] {
                return true;
            }
        }
        false
    }

    /// Returns whether matter may be visible to a group around a sample.
    #[inline(always)]
    fn shows(&self, group: usize, number: isize) -> bool {
        number >= 0 && self.groups[group * self.blocks + (number as usize / BLOCK).min(self.blocks - 1)]
    }

    /// Returns whether matter may be visible to a group around a sample and its neighbours between two offsets, each
    /// less than a block.
    #[inline(always)]
    fn shows_near(&self, group: usize, number: usize, around: [isize; 2]) -> bool {
        let [first, last] = around.map(|offset| number as isize + offset);
        self.shows(group, first) || self.shows(group, number as isize) || self.shows(group, last)
    }
}

impl WithSimd for Tile<'_> {
    type Output = Work;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Work {
        let axes = self.axes;
        match &self.picture.matter {
            RayMatter::Post(post) => {
                let shading = SlabShading::new(simd, post, &self.picture.to_lattice, &axes, false);
                self.paint(simd, &shading)
            }
            RayMatter::Colors(colors) => {
                let (mut met, mut work) = (Vec::new(), Work::default());
                if let Some(picture) = self.picture.surfaces
                    && let RayMatter::Post(post) = &picture.matter
                {
                    let shading = SlabShading::new(simd, post, &picture.to_lattice, &axes, true);
                    let marched = self.march(simd, picture, &shading);
                    met.extend(marched.states.into_iter().map(|state| state.met));
                    work = marched.work;
                }
                work.and(self.paint(simd, &Blending::new(simd, colors, &axes, met)))
            }
            RayMatter::Projection(projection) => self.paint(simd, &Projecting::new(simd, projection, &axes)),
        }
    }
}

/// The groups of rays of a tile at their ends.
struct Marched<S: Simd, R: Rule<S>> {
    rays: Vec<Rays<S>>,
    states: Vec<R::State>,
    /// The planes at which rays have lost half of their light, if the picture shows them.
    halves: Vec<[f32; RAYS]>,
    work: Work,
}

impl Tile<'_> {
    /// Returns the numbers of the rays of all groups.
    fn groups(&self, picture: &Picture<'_>, step: f64) -> Vec<RayNumbers> {
        let Self { axes, beam, place, side, .. } = self;
        let across = side / GROUP;
        let (_, before, is_boxed) = picture.extent();
        let planes = [-before, (axes.size[2] - 1) as f64 + before];
        let Picture { sides, solids, owned, .. } = *picture;
        let bounds = Bounds { planes, is_boxed, sides, solids, owned, step };
        let place = |group: usize| [place[0] + group % across * GROUP, place[1] + group / across * GROUP];
        (0..across * across).map(|group| RayNumbers::new(beam, axes, &bounds, picture.unit, place(group))).collect()
    }

    /// Takes the rays of all groups through a picture.
    #[inline(always)]
    fn march<S: Simd, R: Rule<S>>(&self, simd: S, picture: &Picture<'_>, rule: &R) -> Marched<S, R> {
        let numbers = self.groups(picture, R::STEP);
        let is_alive: Vec<bool> = numbers.iter().map(RayNumbers::is_alive).collect();
        let course = Course::new(self, picture, R::STEP, &numbers, &is_alive);
        let mut rays: Vec<Rays<S>> = Vec::with_capacity(numbers.len());
        let mut alive: Vec<usize> = Vec::with_capacity(numbers.len());
        for (group, numbers) in numbers.iter().enumerate() {
            rays.push(Rays::new(simd, numbers));
            if is_alive[group] {
                alive.push(group);
            }
        }
        let order = Order::new(simd);
        let (reach, ..) = picture.extent();
        let mut states = Vec::with_capacity(rays.len());
        for group in 0..rays.len() {
            states.push(rule.start(simd, group));
        }
        let count = course.areas.len();
        let (mut plane, mut read) = (Plane::default(), ReadPoints::default());
        let mut halves = vec![[f32::NAN; RAYS]; if picture.halves { rays.len() } else { 0 }];
        let mut work = Work::default();
        // Interpolated samples need those behind them.
        let interpolated = rule.scalars().filter(|(blend, _)| blend.has_wide());
        let delay = if interpolated.is_some() { DELAY } else { 0 };
        let mut at_planes = vec![PlaneSamples::new(simd); if delay > 0 { rays.len() } else { 0 }];
        let around = [R::AROUND[0] - delay as isize, R::AROUND[1] + delay as isize];
        let mut is_taken = vec![true; count];
        if let Some((blend, along)) = interpolated {
            for number in (0..count).filter(|&number| !is_apart(number, count)) {
                let z = number as f64 * R::STEP + course.first;
                // Not of the part of the field that is held: a brick is drawn as a part of the whole.
                let corners = self.corners.map(|corner| [0, 1].map(|axis| corner[axis][0] + corner[axis][1] * z));
                is_taken[number] = !blend.are_wide(along, corners, z);
            }
        }
        for number in 0..count + R::BEHIND + delay {
            if alive.is_empty() {
                break;
            }
            let z = number as f64 * R::STEP + course.first;
            let is_near = number < count && is_taken[number] && course.near(number, R::BEHIND + delay);
            let area = if is_near { course.areas[number] } else { None };
            if number % BLOCK == 0 && number < count {
                read = course.read(&alive, number / BLOCK);
            }
            if let Some(area) = area {
                rule.make(simd, &mut plane, (&area, &read), number);
                let [width, height] = area.size();
                let low = [Lanes::all(simd, area.low[0] as f32 + 1.0), Lanes::all(simd, area.low[1] as f32 + 1.0)];
                // Rays outside of the area are outside of the field.
                let most = [width, height].map(|points| points as f32 - 3.001 - reach.around as f32);
                let most = [Lanes::all(simd, most[0]), Lanes::all(simd, most[1])];
                let least = Lanes::all(simd, reach.around as f32);
                for &group in &alive {
                    if !course.shows_near(group, number, around) {
                        if delay == 0 {
                            rule.passed(simd, &mut states[group], number);
                        } else {
                            at_planes[group].passed(number);
                        }
                        continue;
                    }
                    work.samples += RAYS as u64;
                    let [a, b] = rays[group].at(simd, Lanes::all(simd, z as f32));
                    let a = a.sub(simd, low[0]).max(simd, least).min(simd, most[0]);
                    let b = b.sub(simd, low[1]).max(simd, least).min(simd, most[1]);
                    let channels = plane.at(simd, &order, [a, b]);
                    if delay == 0 {
                        rule.sampled(&mut states[group], number, channels);
                    } else {
                        at_planes[group].sampled(number, channels);
                    }
                }
            } else if delay == 0 {
                for &group in &alive {
                    rule.passed(simd, &mut states[group], number);
                }
            } else if number % 2 == 1 {
                for &group in &alive {
                    at_planes[group].passed(number);
                }
            }
            if delay > 0 && number >= delay {
                let number = number - delay;
                let has_area = number < count && course.near(number, R::BEHIND) && course.areas[number].is_some();
                for &group in &alive {
                    if has_area && course.shows_near(group, number, R::AROUND) {
                        rule.sampled(&mut states[group], number, at_planes[group].at(simd, number, is_taken[number]));
                    } else {
                        rule.passed(simd, &mut states[group], number);
                    }
                }
            }
            // The slab whose last sample this is.
            let Some(slab) = number.checked_sub(R::BEHIND + delay) else { continue };
            if !course.near(slab, 1) {
                continue;
            }
            let z = (slab as f64 * R::STEP + course.first) as f32;
            let mut has_ended = false;
            for &group in &alive {
                let shows = course.shows(group, slab as isize);
                let before = rule.left(simd, &states[group]);
                if rule.slab(simd, &mut states[group], &rays[group], (slab, z), shows) {
                    work.slabs += RAYS as u64;
                    let left = rule.left(simd, &states[group]);
                    has_ended |= left.largest(simd) < picture.termination;
                    if picture.halves {
                        let half = 0.5 * R::STEP as f32;
                        let ends = [
                            rays[group].ends[0].max(simd, Lanes::all(simd, z - half)).to_array(),
                            rays[group].ends[1].min(simd, Lanes::all(simd, z + half)).to_array(),
                        ];
                        let surfaces = rule.half(&states[group]).map_or([f32::INFINITY; RAYS], Lanes::to_array);
                        note_halves(&mut halves[group], before.to_array(), left.to_array(), ends, surfaces);
                    }
                }
            }
            if has_ended {
                let mut left = 0;
                for index in 0..alive.len() {
                    if rule.left(simd, &states[alive[index]]).largest(simd) >= picture.termination {
                        alive[left] = alive[index];
                        left += 1;
                    }
                }
                alive.truncate(left);
            }
        }
        Marched { rays, states, halves, work }
    }

    /// Paints the pixels.
    #[inline(always)]
    fn paint<S: Simd, R: Rule<S>>(self, simd: S, rule: &R) -> Work {
        let Marched { rays, states, halves, work } = self.march(simd, self.picture, rule);
        let across = self.side / GROUP;
        for (group, state) in states.iter().enumerate() {
            let [r, g, b, a] = rule.pixel(simd, state, &rays[group]);
            let [r, g, b, a] = [r.to_array(), g.to_array(), b.to_array(), a.to_array()];
            for ray in 0..RAYS {
                let [x, y] = [group % across * GROUP + ray % GROUP, group / across * GROUP + ray / GROUP];
                let mut pixel = [r[ray], g[ray], b[ray], a[ray]];
                if self.picture.halves {
                    let line = self.beam.line((self.place[0] + x) as f64, (self.place[1] + y) as f64);
                    let depth = line.depth_of(f64::from(halves[group][ray])) as f32;
                    pixel = if depth.is_nan() { [0.0; 4] } else { [depth, 1.0, 0.0, 0.0] };
                }
                self.out[y * self.side + x] = pixel;
            }
        }
        work
    }
}

/// Notes for each ray the plane at which half of its light is left, in a slab between `ends` whose matter lowers the
/// transmittance from `before` to `after`; `surfaces` are the planes of isosurfaces that did so.
fn note_halves(
    halves: &mut [f32; RAYS],
    before: [f32; RAYS],
    after: [f32; RAYS],
    ends: [[f32; RAYS]; 2],
    surfaces: [f32; RAYS],
) {
    for ray in 0..RAYS {
        if halves[ray].is_nan() && surfaces[ray].is_finite() {
            halves[ray] = surfaces[ray];
        } else if halves[ray].is_nan() && after[ray] < 0.5 {
            let (before, after) = (f64::from(before[ray]), f64::from(after[ray].max(f32::MIN_POSITIVE)));
            let share = libm::log(2.0 * before) / libm::log(before / after);
            let [low, high] = ends.map(|end| f64::from(end[ray]));
            halves[ray] = (low + (high - low) * share.clamp(0.0, 1.0)) as f32;
        }
    }
}
