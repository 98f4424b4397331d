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

// The distance in lattice points, before an isosurface, of the place whose light it gets: as on the host.
const SURFACE_BIAS: f32 = 3.0;

// With isosurfaces: the scalar in the middle of the slab before.
var<private> middle_scalar: f32;

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
    let counts = is_marked && part.x < part.y;
    if ISOSURFACES > 0u && (counts || before.kind == CLASSIFIED) {
        meet_surfaces(ray, before.kind, behind, geometry, middle);
    }
    if counts {
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

// The shares of light that arrive `plane` planes from plane 0 on a ray, and so far `beside` it in (a, b, plane).
fn kept_on(geometry: RayGeometry, plane: f32, beside: vec3f) -> vec4f {
    return kept_at(rays.to_light * vec4f(vec3f(geometry.base + geometry.shear * plane, plane) + beside, 1.0));
}

// The gradient of a slab in view coordinates, given the sums of gradients along the axes of the lattice.
fn gradient_of(g: vec3f) -> vec3f {
    return rays.gradient_x * g.x + rays.gradient_y * g.y + rays.gradient_z * g.z;
}

// The light on matter of a scalar with these sums of gradients, `plane` planes from plane 0.
fn light_at(g: vec3f, scalar: f32, geometry: RayGeometry, plane: f32, kept: vec4f) -> Shine {
    let surface = reconstructed_share(g * mean_scale(geometry), scalar, lighting.faintest);
    return light_on(gradient_of(g), surface, place_on(geometry, plane), geometry.to_eye, kept);
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
        light = light_at(g, means.y, geometry, middle, kept_on(geometry, middle, vec3f(0.0)));
        share = gradient_share(gradient_of(g) * mean_scale(geometry), rays.gradient_lookup);
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

// Composites the isosurfaces that a ray meets between the middle of the slab before and the middle of the slab that
// waits. Each half has a parabola through the scalars at both middles and at the border of the slabs. A parabola
// begins with the scalar at which the last one ended, so a surface is met once.
fn meet_surfaces(
    ray: ptr<function, RayState>,
    kind: u32,
    behind: vec4f,
    geometry: RayGeometry,
    middle: f32,
) {
    let means = means_of(*ray, behind, geometry);
    let p = parabola(means);
    var first = means.x - p.z / 12.0;
    first = select(first, clamp(first, rays.invisible.x, rays.invisible.y), kind == INVISIBLE);
    first = select(first, middle_scalar, kind == CLASSIFIED);
    let last = p.x;
    middle_scalar = last;
    // The parabola through the middles that has the means of both slabs.
    let border = 2.0 * (first + last) - 1.5 * (means.x + means.y);
    for (var i = 0u; i < 2u * ISOSURFACES; i++) {
        let is_second = i >= ISOSURFACES;
        let ends = select(vec2f(first, border), vec2f(border, last), is_second);
        let rises = ends.x < ends.y;
        // A ray that rises meets the lowest surface first.
        let order = select(i, i - ISOSURFACES, is_second);
        let number = select(ISOSURFACES - order - 1u, order, rises);
        let scalar = surface_scalar(number);
        if scalar <= min(ends.x, ends.y) || scalar > max(ends.x, ends.y) {
            continue;
        }
        // From -1 to 1: the place on the chord, and two of Newton's steps.
        let low = select(-1.0, 0.0, is_second);
        let slope = 0.5 * (last - first);
        let bend = 0.5 * (first + last) - border;
        var place = low + (scalar - ends.x) / (ends.y - ends.x);
        for (var step = 0u; step < 2u; step++) {
            let rise = slope + 2.0 * bend * place;
            let off = border + (slope + bend * place) * place - scalar;
            place = clamp(place - off / select(rise, 1e30, abs(rise) < 1e-30), low, low + 1.0);
        }
        let plane = middle + 0.25 * (place - 1.0);
        if plane >= geometry.inside.x && plane <= geometry.inside.y {
            let g = mix((*ray).before, (*ray).slab, 0.5 * place + 0.5).xyz;
            add_surface(ray, g, geometry, number, plane, select(SURFACE_BIAS, -SURFACE_BIAS, rises));
        }
    }
}

// Composites an isosurface with these sums of gradients, `plane` planes from plane 0, in the light `ahead` lattice
// points along the gradient.
fn add_surface(
    ray: ptr<function, RayState>,
    g: vec3f,
    geometry: RayGeometry,
    number: u32,
    plane: f32,
    ahead: f32,
) {
    var surface = surface_texel(number);
    if LIGHTS > 0u {
        let differences = g * mean_scale(geometry);
        let beside = differences * (ahead * inverseSqrt(max(dot(differences, differences), 1e-36)));
        // The map to the lattice only swaps axes, and turns them.
        let axes = mat3x3f(rays.to_lattice[0], rays.to_lattice[1], rays.to_lattice[2]);
        let kept = kept_on(geometry, plane, beside * axes);
        surface = vec4f(lit(surface.rgb, light_at(g, surface_scalar(number), geometry, plane, kept)), surface.a);
    }
    if LAYERED {
        surface.a *= layer_share(geometry, plane);
    }
    let so_far = *ray;
    add_sample(ray, surface.rgb, surface.a);
    if HALF_DEPTH {
        (*ray).color = half_depth(so_far.color, so_far.depth, (*ray).depth, vec2f(depth_of(geometry, plane)));
    }
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
    var ends = clamp(run - rays.lead, vec2i(-REACH), vec2i(rays.voxels.z + REACH)) + rays.first.z;
    if ISOSURFACES > 0u {
        // The surfaces behind the middle of the last slab.
        ends.y++;
    }
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
