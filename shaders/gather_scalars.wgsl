// gather-scalars: rays of the painter `tiles` through voxels that are scalars, one ray for each pixel. They gather the
// kernels of voxel planes as in gather.wgsl, into slabs of scalar that are classified and lit when they are complete.
//
// Classification magnifies small differences of a scalar, so slabs are finer here: half a plane thick. A kernel has
// parts in eight slabs, or in sixteen if it is wide. Each part is nearly its footprint times a parabola in s, so a
// plane needs three moments.
// uses: common/absorbed, common/light_volume, common/march_parabola, common/march_planes, common/resolution

@group(0) @binding(0) var<uniform> rays: Rays;
@group(0) @binding(2) var<storage, read> runs: array<vec2u>;
@group(0) @binding(3) var<storage, read_write> pixels: array<vec4f>;
@group(0) @binding(4) var<uniform> lighting: Lighting;
// The transfer function: see common/transfer.wgsl.
@group(0) @binding(5) var transfer: texture_storage_2d<rgba32float, read>;
// See common/light_volume.wgsl.
@group(0) @binding(6) var light_volume: texture_3d<f32>;
@group(0) @binding(7) var light_sampler: sampler;
@group(0) @binding(8) var<storage, read> solid_depths: array<f32>;
// For each pixel, the state of its ray behind the layers before: premultiplied colour and optical depth.
@group(0) @binding(9) var<storage, read_write> gathered_before: array<vec4f>;

// Planes that kernels reach before and behind their own: 2, or 4.
override REACH: i32 = 2;

// The largest scalar of a ray is classified, instead of every slab.
override MAXIMUM: bool = false;

// The mean scalar of a ray is classified.
override MEAN: bool = false;

// Composites the slab that waits in `ray`, now that the slab behind it is known. Its middle is `middle` planes from
// plane 0. `before` is the slab composited last.
fn advance(
    ray: ptr<function, RayState>,
    before: Before,
    behind: vec4f,
    geometry: RayGeometry,
    middle: f32,
) -> Before {
    var composited = Before(AT_THE_FACE, before.end);
    // The part of the slab that counts, its ends from -1/2 to 1/2.
    let part = clamp(2.0 * (geometry.inside - middle), vec2f(-0.5), vec2f(0.5));
    let so_far = *ray;
    if part.x < part.y {
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
    let length = 0.5 * step * share * geometry.stretch / geometry.direction.z;
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

// A run of planes begins: nothing before it is pending.
fn begin_run(ray: ptr<function, RayState>) {
    (*ray).before = vec4f(0.0);
    (*ray).slab = vec4f(0.0);
}

// The largest scalar may be the last one, and all scalars count for the mean.
fn is_opaque(ray: RayState) -> bool {
    return !MAXIMUM && !MEAN && ray.depth > rays.opaque_depth;
}

// Planes after the last of a run: kernels reach REACH planes beyond it, and slabs wait for as many.
override FLUSH: i32 = 2 * REACH;

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

// Adds a plane to the slabs that its kernels reach, and composites the two slabs before these.
fn feed(
    ray: ptr<function, RayState>,
    slabs: ptr<function, Slabs>,
    sums: Moments,
    geometry: RayGeometry,
    plane: i32,
    end: i32,
) {
    add_parts(slabs, 4, section_at(geometry.near, geometry, plane), sums);
    if REACH > 2 {
        add_parts(slabs, 0, section_at(geometry.far, geometry, plane), sums);
    }
    // The middle of the slab that waits.
    let middle = f32(plane) - f32(REACH) - 0.25;
    let first = advance(ray, (*slabs).composited, (*slabs).sums[8 - 2 * REACH], geometry, middle);
    (*slabs).composited = advance(ray, first, (*slabs).sums[9 - 2 * REACH], geometry, middle + 0.5);
    // On to the next plane.
    if # >= 8 - 2 * REACH { (*slabs).sums[#] = (*slabs).sums[# + 2]; }
    if # < 2 * REACH { (*slabs).sums[8 + #] = (*slabs).sums[10 + #]; }
}

// The rays of pixels through one of several layers, which are marched front to back. Each layer adds to the pixels the
// change of their rays' colours.
@compute @workgroup_size(64)
fn layer(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    let at = point_of(tile, lane);
    let share = share_of(line_of(at));
    if any(at >= rays.picture) || share == 0.0 {
        return;
    }
    let geometry = geometry_of_pixel(at);
    let index = at.y * rays.picture.x + at.x;
    let before = gathered_before[index];
    var ray = new_ray();
    ray.color = before.rgb;
    ray.depth = before.w;
    ray.transmittance = exp(-before.w);
    ray = march_planes(tile, geometry, ray);
    gathered_before[index] = vec4f(ray.color, ray.depth);
    let change = vec4f(ray.color, absorbed(ray.depth)) - vec4f(before.rgb, absorbed(before.w));
    add_to_pixel(at, share * change);
}

@compute @workgroup_size(64)
fn gather(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    let at = point_of(tile, lane);
    let share = share_of(line_of(at));
    if PERSPECTIVE && share == 0.0 {
        return;
    }
    let geometry = geometry_of_pixel(at);
    let ray = march_planes(tile, geometry, new_ray());
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
