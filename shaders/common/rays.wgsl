// The rays of the painter `tiles`, and the packed volume that they cross.
//
// Lattice axes: m is the principal viewing axis, the axis closest to the direction of the rays; a and b are the other
// two. a is the axis along which rays lean less. For parallel rays it is the first of the two along which rays lean so
// little that six voxels of a row hold every kernel that reaches a ray. Lengths are in voxels unless a name says
// otherwise. Voxels are numbered along (a, b, m) from one in the middle of the whole lattice, whatever part of it is
// packed, so that the rays of all bricks have the same numbers; planes are numbered front to back along m.
//
// A ray meets plane k at base + k shear, in (a, b). Base coordinates are the (a, b) of plane 0. Parallel rays share one
// shear. A ray close to a tie of two or three axes is marched along each of them, and the colours are mixed. Rays
// through one eye are marched along up to three axes, in either direction.
//
// Each pixel of the region has a ray.
//
// A stage binds `uniform_rays` and copies it into `rays` first, because Mesa's software driver loads a member of a
// uniform lane by lane, again in each pass of a loop. Arrays with an index that is no constant are read from the
// uniform: nothing reads their copies, so compilers leave these out, and others would lie in memory.
// uses: common/clip, common/owned

override PERSPECTIVE: bool = false;
// Rays go through the lattices of several levels, coarser ones farther away; the volume is one of these lattices.
override LAYERED: bool = false;

// A distance in planes that is larger than any in a volume and still fits into an i32.
const FAR: f32 = 1e8;

// Entries of the table of sections, at equal steps of the length of a ray's shear. The length is 0 for a ray along m,
// sqrt(2) for a ray along the diagonal, and at most 1.55 for a ray in which m has a share: its component along m is at
// least 0.542, the others are at most 0.592.
const SECTIONS: u32 = 9u;
const SECTION_STEPS: f32 = 8.0 / 1.55;
// Tables of sections: their values for kernels that have not grown, and the coefficients of the growth less 1 and of
// the square of that.
const SECTION_POWERS: u32 = 3u;
// The beginning of the tables for slabs that only wide kernels of scalars reach.
const FAR_SECTIONS: u32 = SECTIONS * SECTION_POWERS;

struct Rays {
    // Parallel rays: base coordinates of pixel (0, 0) of the picture, and the steps to its neighbours. Rays through one
    // eye: the same from `middle`, times the component of `heading` along m.
    origin: vec2f,
    step_x: vec2f,
    step_y: vec2f,
    shear: vec2f,
    // Parallel rays: unit vector in (a, b, m).
    direction: vec3f,
    // Parallel rays: world length per lattice length along the ray.
    stretch: f32,
    // Rays through one eye: lattice direction in (a, b, m) of pixel (0, 0), and the steps to its neighbours.
    heading: vec3f,
    // Optical depth per world length and stored density, or scalar per lattice length and stored scalar.
    density_scale: f32,
    heading_x: vec3f,
    // Optical depth at which a ray counts as opaque.
    opaque_depth: f32,
    heading_y: vec3f,
    // Square of the kernel's radius.
    radius2: f32,
    // Rays through one eye: the base coordinates of a ray in the middle of all of them. Places are measured from it,
    // because the eye may be too far away for f32.
    middle: vec2f,
    // The first pixel of the region in the picture.
    corner: vec2u,
    // The first voxel of the packed volume along a and b, and its first plane.
    first: vec3i,
    // Parallel rays: in the row of voxels at distance v along b from a ray, the kernels that reach the ray are centred
    // within row_half of row_slope v along a.
    row_half: f32,
    // The box of scalars, or the box that kernels of colours reach, in (a, b) and planes.
    box_low: vec3f,
    row_slope: f32,
    box_high: vec3f,
    // Pieces in which a slab of scalars is classified.
    samples: u32,
    // View coordinates of a gradient of 1 along each axis of the lattice.
    gradient_x: vec3f,
    // Planes whose empty macrocells may not be skipped: all of them or none.
    unskipped: i32,
    gradient_y: vec3f,
    // The largest number of runs of a tile.
    run_slots: u32,
    gradient_z: vec3f,
    // 1 if rays run against m, so that the first plane is the last of the texture, otherwise 0.
    flipped: i32,
    // Steps along a, b and m in the box of packed voxels.
    along_a: vec3i,
    // Planes from the first plane of the foremost macrocells to the first plane of the packed volume.
    lead: i32,
    along_b: vec3i,
    // World lengths in the unit that extinctions of scalars are per: lengths times this.
    per_unit: f32,
    // Macrocells along a, b and m; and those from one along these axes to the next in the buffer of their marks.
    macrocells: vec3i,
    along_m: vec3i,
    // Steps along x, y and z in the table of pages: see common/pages.wgsl.
    page_steps: vec3u,
    mark_steps: vec3i,
    // Voxels along a, b and m from the first voxel of the first macrocell to the first of the packed volume.
    mark_shift: vec3i,
    // The bit in the number of a cell of its place along a, b and m.
    mark_bits: vec3u,
    // Voxels along a, b and m.
    voxels: vec3i,
    // The share of these rays in the picture; rays through one eye also have individual shares.
    share: f32,
    // Parallel rays: the kernels of a plane that reach a ray are centred within this distance along a and b.
    footprint_half: vec2f,
    // Width and height of the region, pixels.
    picture: vec2u,
    // The footprint at squared half chord c2 is sqrt(c2) times the polynomial in c2 of these eight coefficients.
    footprint: vec4f,
    footprint_high: vec4f,
    // Rays through one eye: slopes dx/dz and dy/dz of pixel (0, 0) in view coordinates, and the step to the next pixel.
    slope_origin: vec2f,
    slope_step: vec2f,
    // The invisible scalars around 0, and the place of a scalar among bins: see common/transfer.wgsl.
    invisible: vec2f,
    lookup: vec2f,
    // Tiles of 8 x 8 rays across and down.
    tiles: vec2u,
    // The requested tiles: the first across and down, and the first beyond.
    clip_low: vec2u,
    clip_high: vec2u,
    // The largest of each channel of colours.
    brightest: vec3f,
    // Rays through one eye: the eye, in planes.
    eye_plane: f32,
    // Rays through one eye: the growth of a kernel at `middle`, if it is over 1, and its change along (a, b, m). Along
    // parallel rays all kernels have the same size.
    growth_slope: vec3f,
    growth_middle: f32,
    // The largest growth; and the largest difference between the growth of a kernel that reaches a ray and the growth
    // where the ray meets the kernel's plane.
    growth_most: f32,
    growth_around: f32,
    // Layers (see LAYERED): the growth at which the share of the layer begins, and one over the growth until it is
    // whole; the growth at which nothing of it is left, and one over the growth in which it fades before.
    fade_in: vec2f,
    fade_out: vec2f,
    // The place of the length of a gradient among bins: see common/transfer.wgsl.
    gradient_lookup: f32,
    // See faded() in common/transfer.wgsl.
    attenuation: f32,
    // From (a, b, plane) to the light volume, and to the lattice.
    to_light: mat4x3f,
    to_lattice: mat4x3f,
    // Parameters of the model. X-ray: `curve` of common/response.wgsl. Coded or attenuated by depth: the share of a
    // place (a, b, plane) in the depth of the box is dot(model.xyz, place) + model.w.
    model: vec4f,
    // The depth of a place (a, b, plane), as solids have it: dot(xyz, place) + w.
    view_depth: vec4f,
    // The part of the lattice that a brick owns, in (a, b, plane).
    owned_low: vec3f,
    owned_high: vec3f,
    // The inner side of a clipping plane are the places (a, b, plane) with dot(xyz, (a, b, plane)) + w >= 0. See
    // common/clip.wgsl.
    clip_planes: array<vec4f, MAX_CLIP_PLANES>,
}

var<private> rays: Rays;

// The parts of a kernel in four slabs before its centre: its footprint times (by_m0 + by_m1 s + by_m2 s^2), with s the
// place of its centre along the ray, measured from the point where the ray meets its plane. Their sums over a plane are
// by_m0 m0 + by_m1 m1 + by_m2 m2, with the plane's moments. Behind the centre the sign of s changes.
//
// Slabs of scalars are half a plane thick; the first component is the foremost slab, two planes before the centre, or
// four planes in a far section. Slabs of colours are a plane thick; the components are the slabs one to four before the
// kernel's own slab, which has the rest.
struct Section {
    by_m0: vec4f,
    by_m1: vec4f,
    by_m2: vec4f,
}

// The index of run number `slot` of a tile: the runs of a tile are consecutive.
fn run_index(tile: vec3u, slot: u32) -> u32 {
    return (tile.y * rays.tiles.x + tile.x) * rays.run_slots + slot;
}

// Where the marks of a macrocell are, given its numbers along a, b and m: the word, and the number of their lowest bit.
fn marks_at(macrocell: vec3i) -> vec2u {
    let along = macrocell * rays.mark_steps;
    let number = u32(along.x + along.y + along.z);
    return vec2u(number / 4u, number % 4u * 8u);
}

// A ray as a line through the planes.
struct Line {
    base: vec2f,
    shear: vec2f,
    // Lattice direction in (a, b, m), of any length.
    heading: vec3f,
}

// The line of the ray of a pixel of the region.
fn line_of(pixel: vec2u) -> Line {
    let x = f32(pixel.x + rays.corner.x);
    let y = f32(pixel.y + rays.corner.y);
    let place = rays.origin + x * rays.step_x + y * rays.step_y;
    if PERSPECTIVE {
        let heading = rays.heading + x * rays.heading_x + y * rays.heading_y;
        let shear = heading.xy / heading.z;
        return Line(rays.middle + place / heading.z, shear, heading);
    }
    return Line(place, rays.shear, rays.direction);
}

// The planes, as real numbers, between which a brick owns a ray.
fn owned_of(line: Line) -> vec2f {
    let low = rays.owned_low;
    let high = rays.owned_high;
    let along_a = owned_along(vec2f(low.z, high.z), line.base.x, line.shear.x, low.x, high.x);
    let owned = owned_along(along_a, line.base.y, line.shear.y, low.y, high.y);
    return clamp(owned, vec2f(-FAR), vec2f(FAR));
}

// The planes, as real numbers, between which a ray is unclipped; none if x >= y.
fn cut_of(base: vec2f, shear: vec2f) -> vec2f {
    var inside = vec2f(-FAR, FAR);
    for (var i = 0u; i < CLIP_PLANES; i++) {
        let side = uniform_rays.clip_planes[i];
        inside = on_inner_side(inside, dot(side.xy, base) + side.w, dot(side.xy, shear) + side.z);
    }
    return clamp(inside, vec2f(-FAR), vec2f(FAR));
}

// The kernels of a plane that reach a ray of this shear are centred within this distance of it along a and b.
fn footprint_half_of(shear: vec2f) -> vec2f {
    return sqrt(rays.radius2 * (1.0 + shear * shear));
}

// How much smaller than the largest component of a ray's unit vector the component along an axis with a share may be.
const BLEND: f32 = 0.05;

// The share of axis m in the colour of a ray: 1 if m is the closest axis by far, falling smoothly to 0. The shares of
// all axes add up to 1. `share` in src/painters/tiles/axis.rs is the same for parallel rays.
fn share_of(line: Line) -> f32 {
    if !PERSPECTIVE {
        return rays.share;
    }
    let d = normalize(line.heading);
    let along = abs(d);
    let m = smoothstep(-BLEND, BLEND, d.z - max(along.x, along.y));
    let a = smoothstep(-BLEND, BLEND, along.x - max(along.y, along.z));
    let b = smoothstep(-BLEND, BLEND, along.y - max(along.x, along.z));
    // Against m: d.z is negative, and the sum belongs to the two other axes or to the opposite direction.
    return m / max(m + a + b, 0.5) * rays.share;
}

// A pixel with one more share of its colour. Shares may be rounded to a sum above 1; alpha is clamped to 1.
fn with_share(pixel: vec4f, value: vec4f) -> vec4f {
    let sum = pixel + value;
    return vec4f(sum.rgb / max(sum.a, 1.0), min(sum.a, 1.0));
}
