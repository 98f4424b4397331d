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
    let length = 0.5 * step * share * geometry.stretch / geometry.direction.z;
    return march_parabola(ray, means, part, before, rays.samples, length, rays.lookup, rays.invisible, light);
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

// Planes marched after the last plane of a run: kernels reach REACH planes beyond it, and slabs are composited REACH
// planes late.
override FLUSH: i32 = 2 * REACH;

// The incomplete slabs, the foremost first, two for each plane; and the slab composited last.
struct Slabs {
    composited: Before,
    s0: vec4f,
    s1: vec4f,
    s2: vec4f,
    s3: vec4f,
    s4: vec4f,
    s5: vec4f,
    // 0 if kernels reach 2 planes.
    s6: vec4f,
    s7: vec4f,
    s8: vec4f,
    s9: vec4f,
    s10: vec4f,
    s11: vec4f,
    s12: vec4f,
    s13: vec4f,
}

// The parts of the kernels of a plane in four slabs: terms that are even in s, equal on both sides, and odd terms,
// which change sign behind.
struct FourParts {
    even0: vec4f,
    even1: vec4f,
    even2: vec4f,
    even3: vec4f,
    odd0: vec4f,
    odd1: vec4f,
    odd2: vec4f,
    odd3: vec4f,
}

fn parts_of(section: Section, sums: Moments) -> FourParts {
    let x = section.by_m0;
    let y = section.by_m1;
    let z = section.by_m2;
    let m2 = vec4f(0.0, 0.0, 0.0, sums.m2.w);
    return FourParts(
        x.x * sums.m0 + z.x * m2,
        x.y * sums.m0 + z.y * m2,
        x.z * sums.m0 + z.z * m2,
        x.w * sums.m0 + z.w * m2,
        y.x * sums.m1,
        y.y * sums.m1,
        y.z * sums.m1,
        y.w * sums.m1,
    );
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
    let near = parts_of(section_at(geometry.near, geometry, plane), sums);
    let pending = *slabs;
    // The middle of the slab that waits.
    let middle = f32(plane) - f32(REACH) - 0.25;
    if REACH > 2 {
        let far = parts_of(section_at(geometry.far, geometry, plane), sums);
        let first = advance(ray, pending.composited, pending.s0 + far.even0 + far.odd0, geometry, middle);
        let second = advance(ray, first, pending.s1 + far.even1 + far.odd1, geometry, middle + 0.5);
        *slabs = Slabs(
            second,
            pending.s2 + far.even2 + far.odd2,
            pending.s3 + far.even3 + far.odd3,
            pending.s4 + near.even0 + near.odd0,
            pending.s5 + near.even1 + near.odd1,
            pending.s6 + near.even2 + near.odd2,
            pending.s7 + near.even3 + near.odd3,
            pending.s8 + near.even3 - near.odd3,
            pending.s9 + near.even2 - near.odd2,
            pending.s10 + near.even1 - near.odd1,
            pending.s11 + near.even0 - near.odd0,
            pending.s12 + far.even3 - far.odd3,
            pending.s13 + far.even2 - far.odd2,
            far.even1 - far.odd1,
            far.even0 - far.odd0,
        );
    } else {
        let first = advance(ray, pending.composited, pending.s0 + near.even0 + near.odd0, geometry, middle);
        let second = advance(ray, first, pending.s1 + near.even1 + near.odd1, geometry, middle + 0.5);
        let none = vec4f(0.0);
        *slabs = Slabs(
            second,
            pending.s2 + near.even2 + near.odd2,
            pending.s3 + near.even3 + near.odd3,
            pending.s4 + near.even3 - near.odd3,
            pending.s5 + near.even2 - near.odd2,
            near.even1 - near.odd1,
            near.even0 - near.odd0,
            none,
            none,
            none,
            none,
            none,
            none,
            none,
            none,
        );
    }
}

@compute @workgroup_size(64)
fn gather(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    let at = point_of(tile, lane);
    let share = share_of(line_of(at));
    if PERSPECTIVE && share == 0.0 {
        return;
    }
    let geometry = geometry_of(at);
    let ray = march_planes(tile, geometry, new_ray());
    var value = vec4f(ray.color, absorbed(ray.depth));
    if MAXIMUM || MEAN {
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
    add_to_pixel(at, share * value);
}
