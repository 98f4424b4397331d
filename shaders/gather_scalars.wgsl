// gather-scalars: rays of the painter `tiles` through voxels that are scalars, one ray for each pixel. They gather the
// kernels of voxel planes as in gather.wgsl, into slabs of scalar that are classified and lit when they are complete.
//
// Classification magnifies small differences of a scalar, so slabs are finer here: half a plane thick. A kernel has
// parts in eight slabs, or in sixteen if it is wide. Each part is nearly its footprint times a parabola in s, so a
// plane needs three moments.
//
// A slab counts if the cell at its plane is marked (common/packing.wgsl): a rule that depends on the place alone,
// so that a picture does not depend on runs, and a brick has the slabs of the whole picture. Everywhere else every
// scalar is invisible, but sums of fitted parts of kernels could show a little.
// uses: common/absorbed, common/light_volume, common/march_parabola, common/plane, common/resolution

@group(0) @binding(0) var<uniform> uniform_rays: Rays;
@group(0) @binding(2) var<storage, read> runs: array<vec2u>;
@group(0) @binding(3) var<storage, read_write> pixels: array<vec4f>;
@group(0) @binding(4) var<uniform> uniform_lighting: Lighting;
// A copy, as `rays` is.
var<private> lighting: Lighting;
// The transfer function: see common/transfer.wgsl.
@group(0) @binding(5) var transfer: texture_storage_2d<rgba32float, read>;
// See common/light_volume.wgsl.
@group(0) @binding(6) var light_volume: texture_3d<f32>;
@group(0) @binding(7) var light_sampler: sampler;
@group(0) @binding(8) var<storage, read> solid_depths: array<f32>;
// The marks of macrocells: see common/packing.wgsl.
@group(0) @binding(9) var<storage, read> marks: array<u32>;
@group(0) @binding(10) var<uniform> tables: Tables;
// See common/pages.wgsl.
@group(0) @binding(11) var<storage, read> page_table: array<u32>;
// For each pixel, the state of its ray behind the layers before: premultiplied colour and optical depth.
@group(0) @binding(12) var<storage, read_write> gathered_before: array<vec4f>;

// Planes that kernels reach before and behind their own: 2, or 4.
override REACH: i32 = 2;

// The largest scalar of a ray is classified, instead of every slab.
override MAXIMUM: bool = false;

// The mean scalar of a ray is classified.
override MEAN: bool = false;

// Composites the slab that waits in `ray`, now that the slab behind it is known. Its middle is `middle` planes from
// plane 0. `before` is the slab composited last. The slab is invisible if it does not lie at a marked place.
fn advance(
    ray: ptr<function, RayState>,
    before: Before,
    behind: vec4f,
    geometry: RayGeometry,
    middle: f32,
    is_marked: bool,
) -> Before {
    let part = part_inside(geometry, middle);
    var composited = Before(unmarked(part), before.end);
    let so_far = *ray;
    if is_marked && part.x < part.y {
        if MAXIMUM {
            update_maximum(ray, behind, geometry, part, middle);
        } else if MEAN {
            // Skipped space is 0, the base, and adds nothing.
            (*ray).color.x += integral_over(means_of(*ray, behind, geometry), part);
        } else {
            composited = classify_slab(ray, before, behind, geometry, part, middle);
        }
    }
    if BRICK && !is_owned(geometry, middle) {
        // The slab only shapes its neighbours.
        *ray = so_far;
    }
    (*ray).before = (*ray).slab;
    (*ray).slab = behind;
    return composited;
}

// The part of a slab that is inside the box and unclipped, its ends from -1/2 to 1/2.
fn part_inside(geometry: RayGeometry, middle: f32) -> vec2f {
    return clamp(2.0 * (geometry.inside - middle), vec2f(-0.5), vec2f(0.5));
}

// The kind of a slab that does not count.
fn unmarked(part: vec2f) -> u32 {
    return select(AT_THE_FACE, INVISIBLE, part.x < part.y);
}

// Whether the cell at the place where a ray meets a plane is marked.
fn is_marked(geometry: RayGeometry, plane: i32) -> bool {
    let place = vec2i(floor(geometry.base + geometry.shear * f32(plane) + 0.5));
    let voxel = vec3i(place - rays.first.xy, packed_plane(plane)) + rays.mark_shift;
    let inside = all(voxel >= vec3i(0)) && all(voxel < rays.macrocells * MACROCELL);
    let at = marks_at(select(vec3i(0), voxel / MACROCELL, inside));
    let cell = dot(vec3u(voxel / CELL) & vec3u(1u), rays.mark_bits);
    // Read in any case: Mesa 22 leaks shaders with a branch that depends on uniforms alone.
    let word = marks[at.x];
    return rays.unskipped > 0 || inside && (word >> (at.y + cell) & 1u) != 0u;
}

// The factor from the sum of a slab to its mean.
fn mean_scale(geometry: RayGeometry) -> f32 {
    return 2.0 * rays.density_scale * geometry.direction.z;
}

// Means of the scalar in the slab that waits, in the slab before it and in the slab behind it.
fn means_of(ray: RayState, behind: vec4f, geometry: RayGeometry) -> vec3f {
    return vec3f(ray.before.w, ray.slab.w, behind.w) * mean_scale(geometry);
}

// The lattice point on a ray, `plane` planes from plane 0.
fn place_on(geometry: RayGeometry, plane: f32) -> vec3f {
    return rays.to_lattice * vec4f(geometry.base + geometry.shear * plane, plane, 1.0);
}

// The shares of light that arrive on a ray `plane` planes from plane 0.
fn kept_on(geometry: RayGeometry, plane: f32) -> vec4f {
    return kept_at(rays.to_light * vec4f(geometry.base + geometry.shear * plane, plane, 1.0));
}

fn classify_slab(
    ray: ptr<function, RayState>,
    before: Before,
    behind: vec4f,
    geometry: RayGeometry,
    part: vec2f,
    middle: f32,
) -> Before {
    let means = means_of(*ray, behind, geometry);
    if is_invisible(means, rays.invisible) {
        return Before(INVISIBLE, before.end);
    }
    var light = no_shine();
    var share = 1.0;
    if LIGHTS > 0u {
        let g = (*ray).slab.xyz;
        let gradient = rays.gradient_x * g.x + rays.gradient_y * g.y + rays.gradient_z * g.z;
        let of_means = gradient * mean_scale(geometry);
        let differences = g * mean_scale(geometry);
        let surface = reconstructed_share(differences, means.y, lighting.faintest);
        light = light_on(gradient, surface, place_on(geometry, middle), geometry.to_eye, kept_on(geometry, middle));
        share = gradient_share(of_means, rays.gradient_lookup);
    }
    let step = (part.y - part.x) / f32(rays.samples);
    if LAYERED {
        share *= layer_share(geometry, middle);
    }
    let length = 0.5 * step * share * rays.per_unit * geometry.stretch / geometry.direction.z;
    let so_far = *ray;
    let composited =
        march_parabola(ray, means, part, before, rays.samples, length, rays.lookup, rays.invisible, light);
    if HALF_DEPTH {
        let depths = vec2f(depth_of(geometry, middle + 0.5 * part.x), depth_of(geometry, middle + 0.5 * part.y));
        (*ray).color = half_depth(so_far.color, so_far.depth, (*ray).depth, depths);
    }
    return composited;
}

alias Marched = RayState;

fn add_sample(ray: ptr<function, Marched>, color: vec3f, depth: f32) {
    (*ray).color += color * ((*ray).transmittance * absorbed(depth));
    (*ray).depth += depth;
    (*ray).transmittance *= exp(-depth);
}

// The depth of a place on a ray, `plane` planes from plane 0, as a share of the depth of the box.
fn depth_at(geometry: RayGeometry, plane: f32) -> f32 {
    return dot(rays.model.xyz, vec3f(geometry.base + plane * geometry.shear, plane)) + rays.model.w;
}

fn update_maximum(
    ray: ptr<function, RayState>,
    behind: vec4f,
    geometry: RayGeometry,
    part: vec2f,
    middle: f32,
) {
    let means = means_of(*ray, behind, geometry);
    var largest = shown(largest_in(means, part), means, rays.invisible);
    let so_far = (*ray).color;
    if DEPTH_CODED || ATTENUATED {
        let place = middle + 0.5 * place_of_largest(means, part);
        if ATTENUATED {
            largest = faded(largest, depth_at(geometry, place), rays.attenuation);
        }
        let is_larger = so_far.y <= 0.0 || largest > so_far.x;
        (*ray).color.z = select(so_far.z, place, is_larger);
    }
    (*ray).color.x = select(largest, max(largest, so_far.x), so_far.y > 0.0);
    (*ray).color.y = 1.0;
}

// The largest scalar may be the last one, and all scalars count for the mean.
fn is_opaque(ray: RayState) -> bool {
    return !MAXIMUM && !MEAN && ray.depth > rays.opaque_depth;
}

struct Slabs {
    // What was composited last.
    composited: Before,
    // Sums in the slabs around a plane, from eight before it to eight behind it; then two that are 0. Kernels that
    // reach 2 planes fill the middle eight.
    sums: array<vec4f, 18>,
}

// Adds the parts of the kernels of a plane in slab number `slab` before the plane and in the slab as far behind it:
// terms that are even in s are alike on both sides, odd ones change sign. `section` are the factors of m0, m1 and m2.
fn add_part(slabs: ptr<function, Slabs>, slab: i32, section: vec3f, sums: Moments) {
    let even = section.x * sums.m0 + section.z * vec4f(0.0, 0.0, 0.0, sums.m2.w);
    let odd = section.y * sums.m1;
    (*slabs).sums[slab] = (*slabs).sums[slab] + even + odd;
    (*slabs).sums[15 - slab] = (*slabs).sums[15 - slab] + even - odd;
}

// Adds the parts in four slabs from number `slab` on, and in the slabs as far behind the plane.
fn add_parts(slabs: ptr<function, Slabs>, slab: i32, section: Section, sums: Moments) {
    let x = section.by_m0;
    let y = section.by_m1;
    let z = section.by_m2;
    add_part(slabs, slab, vec3f(x.x, y.x, z.x), sums);
    add_part(slabs, slab + 1, vec3f(x.y, y.y, z.y), sums);
    add_part(slabs, slab + 2, vec3f(x.z, y.z, z.z), sums);
    add_part(slabs, slab + 3, vec3f(x.w, y.w, z.w), sums);
}

// On to a plane: adds it to the slabs that its kernels reach.
fn add_plane(
    ray: ptr<function, RayState>,
    slabs: ptr<function, Slabs>,
    sums: Moments,
    geometry: RayGeometry,
    plane: i32,
) {
    (*ray).before = (*slabs).sums[8 - 2 * REACH];
    (*ray).slab = (*slabs).sums[9 - 2 * REACH];
    if # >= 8 - 2 * REACH { (*slabs).sums[#] = (*slabs).sums[# + 2]; }
    if # < 2 * REACH { (*slabs).sums[8 + #] = (*slabs).sums[10 + #]; }
    add_parts(slabs, 4, section_at(geometry.near, geometry, plane), sums);
    if REACH > 2 {
        add_parts(slabs, 0, section_at(geometry.far, geometry, plane), sums);
    }
}

// Composites the two slabs that are complete after a plane.
fn composite(ray: ptr<function, RayState>, slabs: ptr<function, Slabs>, geometry: RayGeometry, plane: i32) {
    let at = plane - REACH;
    let counts = is_marked(geometry, at);
    // The middle of the slab that waits.
    let middle = f32(at) - 0.25;
    let first = advance(ray, (*slabs).composited, (*slabs).sums[8 - 2 * REACH], geometry, middle, counts);
    (*slabs).composited = advance(ray, first, (*slabs).sums[9 - 2 * REACH], geometry, middle + 0.5, counts);
}

// The planes of a run whose slabs a ray composites: the first, and the plane after the last.
fn counting_planes(run: vec2i, geometry: RayGeometry) -> vec2i {
    // Slabs beyond the reach of packed planes are empty.
    let ends = clamp(run - rays.lead, vec2i(-REACH), vec2i(rays.voxels.z + REACH)) + rays.first.z;
    // The slabs of a plane begin half a plane before it. The slab before the first that a brick owns ends where the
    // first begins.
    let first = max(geometry.inside.x, geometry.owned.x);
    let last = min(geometry.inside.y, geometry.owned.y);
    return vec2i(
        max(ends.x, i32(floor(clamp(first, -FAR, FAR)))),
        min(ends.y, i32(ceil(clamp(last, -FAR, FAR))) + 1),
    );
}

// Marches a ray from voxel plane to voxel plane, run after run, from the state `start`.
fn march(tile: vec3u, geometry: RayGeometry, start: RayState) -> RayState {
    let footprints = footprints_of(geometry);
    var ray = start;
    for (var slot = 0u; ; slot++) {
        let run = run_at(tile, slot, ray.depth);
        if run.y == 0 {
            break;
        }
        let counting = counting_planes(run, geometry);
        // The planes that have parts in the first slabs and in the last.
        var plane = max(counting.x - REACH, rays.first.z);
        let end = min(counting.y + REACH, rays.first.z + rays.voxels.z);
        var slabs = Slabs();
        slabs.composited.kind = unmarked(part_inside(geometry, f32(counting.x) - 0.75));
        let last = select(plane, counting.y + REACH, counting.x < counting.y);
        while plane < last {
            // Only loops save work on software: planes before the first slabs are gathered by a loop of their own.
            loop {
                add_plane(&ray, &slabs, gathered(geometry, footprints, plane, end), geometry, plane);
                if plane >= counting.x + REACH {
                    break;
                }
                plane++;
            }
            composite(&ray, &slabs, geometry, plane);
            if is_opaque(ray) {
                break;
            }
            plane++;
        }
    }
    return ray;
}

// The rays of pixels through one of several layers, which are marched front to back. Each layer adds to the pixels the
// change of their rays' colours.
@compute @workgroup_size(64)
fn layer(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    rays = uniform_rays;
    lighting = uniform_lighting;
    let at = pixel_of(tile, lane);
    let share = share_of(line_of(at));
    if any(at >= rays.picture) || share == 0.0 {
        return;
    }
    let geometry = geometry_of_pixel(at);
    let index = at.y * rays.picture.x + at.x;
    let before = gathered_before[index];
    let ray = march(tile, geometry, ray_behind(before));
    gathered_before[index] = vec4f(ray.color, ray.depth);
    let change = vec4f(ray.color, absorbed(ray.depth)) - vec4f(before.rgb, absorbed(before.w));
    add_to_pixel(at, share * change);
}

@compute @workgroup_size(64)
fn gather(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    rays = uniform_rays;
    lighting = uniform_lighting;
    let at = pixel_of(tile, lane);
    let share = share_of(line_of(at));
    if PERSPECTIVE && share == 0.0 {
        return;
    }
    let geometry = geometry_of_pixel(at);
    let ray = march(tile, geometry, new_ray());
    var value = vec4f(ray.color, absorbed(ray.depth));
    if BRICK {
        value = vec4f(ray.color, ray.depth);
        let planes = min(geometry.inside.y, geometry.owned.y) - max(geometry.inside.x, geometry.owned.x);
        let counts = select(0.0, 1.0, planes > 0.0);
        if MAXIMUM {
            value = counts * vec4f(ray.color.xy, depth_at(geometry, ray.color.z) * ray.color.y, 1.0);
        }
        if MEAN {
            value = counts * vec4f(0.5 * ray.color.x, planes, 0.0, 1.0);
        }
    } else if MAXIMUM || MEAN {
        // A ray through skipped space alone has 0, the base, as its largest scalar and as its mean.
        var scalar = ray.color.x;
        let planes = geometry.inside.y - geometry.inside.x;
        if MEAN {
            // Slabs are half a plane thick.
            scalar *= 0.5 / max(planes, 1e-30);
        }
        let depth = depth_at(geometry, ray.color.z);
        value = select(vec4f(0.0), projected(scalar, depth, rays.lookup), planes > 0.0);
    }
    if BRICK {
        add_to_pixel(at, value);
    } else {
        add_to_pixel(at, share * value);
    }
}
