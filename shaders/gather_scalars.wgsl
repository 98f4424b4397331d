// gather-scalars: rays of the painter `tiles` through voxels that are scalars, one ray for each pixel. They gather the
// kernels of voxel planes as in gather.wgsl, into slabs of scalar that are classified and lit when they are complete.
// `gather` marches one ray, `pair` marches the rays of two pixels.
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

// The largest error of one piece instead of several, in optical depth.
const ERROR_OF_ONE: f32 = 2.5e-4;

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
    let width = part.y - part.x;
    // Where pieces end on the parabola. One piece ends a little farther from it than several do.
    let p = parabola(means);
    let several = marched_parabola(means, width / f32(rays.samples));
    let begin = begin_of(value_at(several, part.x), before, rays.invisible);
    let end = value_at(several, part.y);
    let top = value_at(p, clamp(-0.5 * p.y / select(p.z, 1.0, p.z == 0.0), part.x, part.y));
    let beyond = p.z * width * width / 6.0;
    let low = min(min(begin, end), top) - max(beyond, 0.0);
    let high = max(max(begin, end), top) - min(beyond, 0.0);
    let range = range_from(low, rays.lookup);
    if low >= range.x && high < range.y {
        return Before(SCALAR, Classified(end, 0u, vec4f(0.0), vec4f(0.0)));
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
    let length = 0.5 * width * share * geometry.stretch / geometry.direction.z;
    let error = length * (abs(p.z) * width * width * range.z / 32.0 + length * range.w / 8.0);
    let is_straight = (high - low) * rays.lookup.x <= RANGE_BINS && error <= ERROR_OF_ONE;
    let samples = select(rays.samples, 1u, is_straight);
    return march_parabola(ray, means, part, before, samples, rays.samples == 1u, length / f32(samples), rays.lookup,
        rays.invisible, light);
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
    // A loop, because twice the code takes twice as long to compile.
    for (var half = 0u; half < 2u; half++) {
        let behind = select((*slabs).sums[8 - 2 * REACH], (*slabs).sums[9 - 2 * REACH], half == 1u);
        (*slabs).composited = advance(ray, (*slabs).composited, behind, geometry, middle + 0.5 * f32(half));
    }
    // On to the next plane.
    if # >= 8 - 2 * REACH { (*slabs).sums[#] = (*slabs).sums[# + 2]; }
    if # < 2 * REACH { (*slabs).sums[8 + #] = (*slabs).sums[10 + #]; }
}

// Adds a finished ray to its pixel.
fn add_ray(at: vec2u, share: f32, ray: RayState, geometry: RayGeometry) {
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

@compute @workgroup_size(64)
fn gather(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    let at = point_of(tile, lane);
    let share = share_of(line_of(at));
    if PERSPECTIVE && share == 0.0 {
        return;
    }
    let geometry = geometry_of(at);
    add_ray(at, share, march_planes(tile, geometry, new_ray()), geometry);
}

// A ray where it meets a plane.
struct Meeting {
    center: vec2f,
    direction: vec2f,
    growth: f32,
    half: f32,
    row_slope: f32,
    // The first row of voxels that reach the ray, and the last.
    rows: vec2i,
}

fn meeting_of(geometry: RayGeometry, plane: i32, end: i32) -> Meeting {
    let center = geometry.base + geometry.shear * f32(plane);
    let growth = growth_at(geometry, plane);
    let reach = reach_at(growth);
    let rows = rows_of(plane, end, center.y, geometry.footprint_half.y * reach);
    return Meeting(center, geometry.direction.xy, growth, geometry.row_half * reach, geometry.row_slope, rows);
}

// The places along a row of voxels between which they reach the ray.
fn reached_of(ray: Meeting, row: f32) -> vec2f {
    let middle = ray.center.x + (row - ray.center.y) * ray.row_slope;
    return vec2f(middle - ray.half, middle + ray.half);
}

// Six voxels of a row.
struct SixVoxels {
    a: vec4f,
    b: vec4f,
    c: vec4f,
    d: vec4f,
    e: vec4f,
    f: vec4f,
}

// Adds voxels of a row from `first` on to the sums of a ray.
fn add_six(sums: ptr<function, Moments>, ray: Meeting, first: vec2f, v: SixVoxels) {
    let at = first - ray.center;
    let w = row_weights(VoxelRow(vec2i(0), at.x, at.y), ray.direction, ray.growth);
    add_row(sums, w, v.a, v.b, v.c, v.d, v.e, v.f);
}

fn add_two(sums: ptr<function, Moments>, ray: Meeting, first: vec2f, v: vec4f, u: vec4f) {
    let at = first - ray.center;
    let w = weights(at.x, at.y, ray.direction, ray.growth);
    let x = weights(at.x + 1.0, at.y, ray.direction, ray.growth);
    (*sums).m0 += w.x * v + x.x * u;
    (*sums).m1 += w.y * v + x.y * u;
    (*sums).m2 += w.z * v + x.z * u;
}

struct MomentsOfTwo {
    r0: Moments,
    r1: Moments,
}

// The moments of a plane for two rays, which share the voxels that they meet; 0 if the plane is not before `end`. A
// voxel that does not reach a ray has a footprint of 0 there.
fn gathered_by_two(g0: RayGeometry, g1: RayGeometry, plane: i32, end: i32) -> MomentsOfTwo {
    let m0 = meeting_of(g0, plane, end);
    let m1 = meeting_of(g1, plane, end);
    let last_row = max(m0.rows.y, m1.rows.y);
    let origin = plane_texel(plane);
    var sums0 = Moments();
    var sums1 = Moments();
    for (var row = min(m0.rows.x, m1.rows.x); row <= last_row && plane < end; row++) {
        let y = f32(row);
        let s0 = reached_of(m0, y);
        let s1 = reached_of(m1, y);
        let first = i32(ceil(min(s0.x, s1.x))) & -2;
        let last = i32(floor(max(s0.y, s1.y)));
        let texel = texel_at(vec2i(first >> 1u, row), origin);
        let at = vec2f(f32(first), y);
        let t0 = voxels_at(texel);
        let t1 = voxels_at(texel + vec2i(1, 0));
        let t2 = voxels_at(texel + vec2i(2, 0));
        let v = SixVoxels(first_of(t0), second_of(t0), first_of(t1), second_of(t1), first_of(t2), second_of(t2));
        add_six(&sums0, m0, at, v);
        add_six(&sums1, m1, at, v);
        for (var voxel = 6; first + voxel <= last; voxel += 2) {
            let t = voxels_at(texel + vec2i(voxel / 2, 0));
            let place = at + vec2f(f32(voxel), 0.0);
            add_two(&sums0, m0, place, first_of(t), second_of(t));
            add_two(&sums1, m1, place, first_of(t), second_of(t));
        }
    }
    return MomentsOfTwo(sums0, sums1);
}

// The rays of two pixels side by side, which share the voxels that they meet. Both end before the invocation does.
@compute @workgroup_size(32)
fn pair(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    // Eight invocations in a row are a block of 4 x 4 pixels.
    let block = vec2u((lane >> 3u) & 1u, lane >> 4u);
    let at = tile.xy * 8u + block * 4u + vec2u((lane & 1u) * 2u, (lane >> 1u) & 3u);
    let next = at + vec2u(1u, 0u);
    let shares = vec2f(share_of(line_of(at)), share_of(line_of(next)));
    if PERSPECTIVE && all(shares == vec2f(0.0)) {
        return;
    }
    // A ray without a share, which may run across m, is marched as the other.
    let g0 = geometry_of(select(at, next, shares.x == 0.0));
    let g1 = geometry_of(select(next, at, shares.y == 0.0));
    var ray0 = new_ray();
    var ray1 = new_ray();
    for (var slot = 0u; ; slot++) {
        let run = run_at(tile, slot, min(ray0.depth, ray1.depth));
        if run.y == 0 {
            break;
        }
        let p0 = planes_of(run, g0);
        let p1 = planes_of(run, g1);
        let end = max(p0.y, p1.y);
        let last = max(p0.z, p1.z);
        var slabs0 = Slabs();
        var slabs1 = Slabs();
        begin_run(&ray0);
        begin_run(&ray1);
        for (var plane = min(p0.x, p1.x); plane < last; plane++) {
            let sums = gathered_by_two(g0, g1, plane, end);
            if !is_opaque(ray0) {
                feed(&ray0, &slabs0, sums.r0, g0, plane, end);
            }
            if !is_opaque(ray1) {
                feed(&ray1, &slabs1, sums.r1, g1, plane, end);
            }
            if is_opaque(ray0) && is_opaque(ray1) {
                break;
            }
        }
    }
    add_ray(at, shares.x, ray0, g0);
    add_ray(next, shares.y, ray1, g1);
}
