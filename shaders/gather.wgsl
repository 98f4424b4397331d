// gather: rays of the painter `tiles` through classified voxels. A ray goes from voxel plane to voxel plane and gathers
// the kernels of each plane that reach it. Each plane has a slab, from half way to the plane before it to half way to
// the plane behind it. The planes between slabs cut every kernel; a slab is composited when all kernels that reach it
// are known.
//
// A kernel reaches two or three slabs on either side of its own. Its part in each is nearly its footprint times a
// linear function of s, the place of its centre along the ray. So a plane needs two sums, its moments: footprints m0,
// and footprints times s, m1. In dense material, which shows where parts are off by little, it is a parabola, of a
// third moment m2. The slabs around a plane get their parts from these. The parts of a kernel add up to its footprint,
// so the optical depth of a ray is that of whole kernels.
//
// `single` marches one ray. `blocked` marches eight that are a voxel apart: they meet a plane at the same place between
// its voxels and share the six footprints of a row. It is written out eight times: loops over arrays stay in memory on
// drivers that do not unroll them.

@group(0) @binding(0) var<uniform> rays: Rays;
@group(0) @binding(2) var runs: texture_2d<u32>;
// Written if rays go through an intermediate image; read by `prefilter`.
@group(0) @binding(3) var intermediate: texture_storage_2d<rgba32float, write>;
// The picture: written if every pixel has its own ray.
@group(0) @binding(4) var<storage, read_write> pixels: array<vec4f>;

// X-ray: white.
override WHITE: bool = false;
// The rays of `single` go through an intermediate image.
override RESAMPLED: bool = false;

// Parts are parabolas in s.
override CURVED: bool = false;

// What the kernels of a plane add to the slab one, two or three planes before their own (`ahead`) and behind it, which
// differ in the sign of m1; the third is 0 for kernels with a radius of at most 2 voxels. Their own slab has the rest.
struct Parts {
    own: vec4f,
    ahead1: vec4f,
    ahead2: vec4f,
    ahead3: vec4f,
    behind1: vec4f,
    behind2: vec4f,
    behind3: vec4f,
}

fn parts_of(section: Section, sums: Moments) -> Parts {
    var even1 = section.by_m0.x * sums.m0;
    var even2 = section.by_m0.y * sums.m0;
    var even3 = section.by_m0.z * sums.m0;
    if CURVED {
        even1 += section.by_m2.x * sums.m2;
        even2 += section.by_m2.y * sums.m2;
        even3 += section.by_m2.z * sums.m2;
    }
    let odd1 = section.by_m1.x * sums.m1;
    let odd2 = section.by_m1.y * sums.m1;
    let odd3 = section.by_m1.z * sums.m1;
    return Parts(
        sums.m0 - 2.0 * (even1 + even2 + even3),
        even1 + odd1,
        even2 + odd2,
        even3 + odd3,
        even1 - odd1,
        even2 - odd2,
        even3 - odd3,
    );
}

// The largest slope of a slab's neighbour that shapes the slab, as a multiple of what the slab holds: where extinction
// rises steeper than that, light from the front of the slab is all that counts.
const STEEPEST: f32 = 3.0;

// What the fit of parts gives a slab, made such that no slab lacks anything: it holds no less than nothing, and no more
// of a colour than its extinction can be of. The slab pays what the slab behind it lacks, and leaves what it lacks
// itself, or has too much of, to the slab behind it. So the sums over all slabs are those of whole kernels. `x` is the
// slab, `y` the one behind it.
struct Pair {
    x: vec4f,
    y: vec4f,
}

fn settled(slab: vec4f, behind: vec4f) -> Pair {
    let paid = slab + min(behind, vec4f(0.0));
    var x = max(paid, vec4f(0.0));
    x = vec4f(min(x.rgb, x.w * rays.brightest), x.w);
    return Pair(x, max(behind, vec4f(0.0)) + (paid - x));
}

// Composites the slab of plane `plane`, which waits in `ray`, now that the slab behind it is known.
//
// Its colour changes with optical depth u as c(u) = mean + g (u / depth - 1/2), with g from its neighbours: that is
// right to second order. The integral of c(u) exp(-u) is mean (1 - exp(-depth)) - g f(depth), f(depth) = 1/2 +
// exp(-depth) / 2 - (1 - exp(-depth)) / depth. The fraction below errs by 0.04 at most, and not where depth is small.
fn advance(ray: ptr<function, RayState>, behind: vec4f, geometry: RayGeometry, plane: f32) {
    let pair = settled((*ray).slab, behind);
    let before = (*ray).before;
    // Where there is no extinction there is no colour: the quotients of 0 by the least number are 0.
    let per_extinction = 1.0 / max(pair.x.w, 1e-20);
    let mean = pair.x.rgb * per_extinction;
    let most = STEEPEST * pair.x.w;
    // Twice g.
    var slope = ((pair.y.rgb - mean * pair.y.w) * min(most / max(pair.y.w, 1e-20), 1.0)
        - (before.rgb - mean * before.w) * min(most / max(before.w, 1e-20), 1.0)) * per_extinction;
    var depth = pair.x.w * (rays.density_scale * geometry.stretch);
    (*ray).before = pair.x;
    (*ray).slab = pair.y;
    if PERSPECTIVE {
        // The eye may be in the slab: only the part in front of it counts.
        let part = clamp(geometry.inside - plane, vec2f(-0.5), vec2f(0.5));
        let length = max(part.y - part.x, 0.0);
        depth *= length;
        slope *= length;
    }
    // The light that arrives times 1 - exp(-depth). The series errs by depth^4 / 120 < 2e-7 of it.
    let passed = exp(-(*ray).depth - depth);
    let series = depth * (1.0 - depth * (1.0 / 2.0) * (1.0 - depth * (1.0 / 3.0) * (1.0 - depth * (1.0 / 4.0))));
    let absorbed = select((*ray).transmittance - passed, (*ray).transmittance * series, depth < 0.06);
    // f is 1/2 in depths whose square would leave the range of f32.
    let d = min(depth, 1e6);
    let f = d * d / (12.0 + d * (6.0 + 2.0 * d));
    let color = mean * absorbed - slope * (0.5 * f * (*ray).transmittance);
    (*ray).color += clamp(color, vec3f(0.0), rays.brightest * absorbed);
    (*ray).depth += depth;
    (*ray).transmittance = passed;
}

// A run of planes begins. Of the run before nothing is pending but what its last slab may lack.
fn begin_run(ray: ptr<function, RayState>) {
    (*ray).before = vec4f(0.0);
}

// The premultiplied colour of a ray that has ended. What the last slab lacks is left over: it is taken from the depth.
fn finished(ray: RayState, geometry: RayGeometry) -> vec4f {
    let lacking = min(ray.slab.w, 0.0) * rays.density_scale * geometry.stretch;
    let alpha = absorbed(max(ray.depth + lacking, 0.0));
    let color = ray.color * min(alpha / max(absorbed(ray.depth), 1e-30), 1.0);
    return vec4f(select(min(color, rays.brightest * alpha), vec3f(alpha), WHITE), alpha);
}

// Planes after the last of a run: kernels reach 3 slabs beyond it, and slabs are composited 4 planes late. By `blocked`
// kernels reach 2, and slabs are composited 3 planes late.
const FLUSH: i32 = 7;
const FLUSH_BLOCKED: i32 = 5;

// The slabs that planes may still add to, the foremost first.
struct Slabs {
    s0: vec4f,
    s1: vec4f,
    s2: vec4f,
    s3: vec4f,
    s4: vec4f,
    s5: vec4f,
}

// Adds a plane to the slabs that its kernels reach, and composites the slab before the foremost of these.
fn feed(ray: ptr<function, RayState>, slabs: ptr<function, Slabs>, sums: Moments, geometry: RayGeometry, plane: i32) {
    let parts = parts_of(geometry.section, sums);
    let pending = *slabs;
    advance(ray, pending.s0 + parts.ahead3, geometry, f32(plane - 4));
    *slabs = Slabs(
        pending.s1 + parts.ahead2,
        pending.s2 + parts.ahead1,
        pending.s3 + parts.own,
        pending.s4 + parts.behind1,
        pending.s5 + parts.behind2,
        parts.behind3,
    );
}

@compute @workgroup_size(64)
fn single(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    let at = point_of(tile, lane);
    if !is_marched(at) {
        return;
    }
    let geometry = geometry_of(at);
    let value = finished(march_planes(tile, geometry), geometry);
    if RESAMPLED {
        textureStore(intermediate, at, value);
    } else {
        store_pixel(at, value);
    }
}

// `Slabs` of kernels with a radius of at most 2 voxels.
struct NearSlabs {
    s0: vec4f,
    s1: vec4f,
    s2: vec4f,
    s3: vec4f,
}

// `feed` of such kernels.
fn feed_near(
    ray: ptr<function, RayState>,
    slabs: ptr<function, NearSlabs>,
    sums: Moments,
    geometry: RayGeometry,
    plane: i32,
) {
    let parts = parts_of(geometry.section, sums);
    let pending = *slabs;
    advance(ray, pending.s0 + parts.ahead2, geometry, f32(plane - 3));
    *slabs = NearSlabs(
        pending.s1 + parts.ahead1,
        pending.s2 + parts.own,
        pending.s3 + parts.behind1,
        parts.behind2,
    );
}

// A run begins: see `begin_run`.
fn restart(ray: ptr<function, RayState>, slabs: ptr<function, NearSlabs>) {
    begin_run(ray);
    *slabs = NearSlabs();
}

// The least optical depth of eight rays.
fn least(a: vec4f, b: vec4f) -> f32 {
    let m = min(a, b);
    return min(min(m.x, m.y), min(m.z, m.w));
}

@compute @workgroup_size(8)
fn blocked(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    let at = first_ray(tile) + vec2u(0u, lane * rays.phases.y);
    let geometry = geometry_of(at);
    let direction = geometry.direction.xy;
    var ray0 = new_ray();
    var ray1 = new_ray();
    var ray2 = new_ray();
    var ray3 = new_ray();
    var ray4 = new_ray();
    var ray5 = new_ray();
    var ray6 = new_ray();
    var ray7 = new_ray();
    var slabs0: NearSlabs;
    var slabs1: NearSlabs;
    var slabs2: NearSlabs;
    var slabs3: NearSlabs;
    var slabs4: NearSlabs;
    var slabs5: NearSlabs;
    var slabs6: NearSlabs;
    var slabs7: NearSlabs;
    var depth = 0.0;
    for (var slot = 0u; slot < rays.run_slots; slot++) {
        let run = run_at(tile, slot, depth);
        if run.y == 0 {
            break;
        }
        let end = min(run.y, rays.voxels.z);
        restart(&ray0, &slabs0);
        restart(&ray1, &slabs1);
        restart(&ray2, &slabs2);
        restart(&ray3, &slabs3);
        restart(&ray4, &slabs4);
        restart(&ray5, &slabs5);
        restart(&ray6, &slabs6);
        restart(&ray7, &slabs7);
        for (var plane = run.x; plane < run.y + FLUSH_BLOCKED; plane++) {
            let center = geometry.base + geometry.shear * f32(plane);
            let rows = rows_of(plane, end, center.y, geometry.footprint_half.y);
            let origin = plane_texel(plane);
            var sums0 = Moments();
            var sums1 = Moments();
            var sums2 = Moments();
            var sums3 = Moments();
            var sums4 = Moments();
            var sums5 = Moments();
            var sums6 = Moments();
            var sums7 = Moments();
            for (var row = rows.x; row <= rows.y; row++) {
                let at_row = voxel_row(geometry, center, row, origin);
                let w = row_weights(at_row, direction);
                let t0 = voxels_at(at_row.texel + vec2i(0, 0));
                let t1 = voxels_at(at_row.texel + vec2i(1, 0));
                let t2 = voxels_at(at_row.texel + vec2i(2, 0));
                let t3 = voxels_at(at_row.texel + vec2i(3, 0));
                let t4 = voxels_at(at_row.texel + vec2i(4, 0));
                let t5 = voxels_at(at_row.texel + vec2i(5, 0));
                let t6 = voxels_at(at_row.texel + vec2i(6, 0));
                let v0 = first_of(t0);
                let v1 = second_of(t0);
                let v2 = first_of(t1);
                let v3 = second_of(t1);
                let v4 = first_of(t2);
                let v5 = second_of(t2);
                let v6 = first_of(t3);
                let v7 = second_of(t3);
                let v8 = first_of(t4);
                let v9 = second_of(t4);
                let v10 = first_of(t5);
                let v11 = second_of(t5);
                let v12 = first_of(t6);
                add_row(&sums0, w, v0, v1, v2, v3, v4, v5);
                add_row(&sums1, w, v1, v2, v3, v4, v5, v6);
                add_row(&sums2, w, v2, v3, v4, v5, v6, v7);
                add_row(&sums3, w, v3, v4, v5, v6, v7, v8);
                add_row(&sums4, w, v4, v5, v6, v7, v8, v9);
                add_row(&sums5, w, v5, v6, v7, v8, v9, v10);
                add_row(&sums6, w, v6, v7, v8, v9, v10, v11);
                add_row(&sums7, w, v7, v8, v9, v10, v11, v12);
            }
            feed_near(&ray0, &slabs0, sums0, geometry, plane);
            feed_near(&ray1, &slabs1, sums1, geometry, plane);
            feed_near(&ray2, &slabs2, sums2, geometry, plane);
            feed_near(&ray3, &slabs3, sums3, geometry, plane);
            feed_near(&ray4, &slabs4, sums4, geometry, plane);
            feed_near(&ray5, &slabs5, sums5, geometry, plane);
            feed_near(&ray6, &slabs6, sums6, geometry, plane);
            feed_near(&ray7, &slabs7, sums7, geometry, plane);
            depth = least(
                vec4f(ray0.depth, ray1.depth, ray2.depth, ray3.depth),
                vec4f(ray4.depth, ray5.depth, ray6.depth, ray7.depth),
            );
            if depth > rays.opaque_depth {
                break;
            }
        }
    }
    textureStore(intermediate, at + vec2u(0u * rays.phases.x, 0u), finished(ray0, geometry));
    textureStore(intermediate, at + vec2u(1u * rays.phases.x, 0u), finished(ray1, geometry));
    textureStore(intermediate, at + vec2u(2u * rays.phases.x, 0u), finished(ray2, geometry));
    textureStore(intermediate, at + vec2u(3u * rays.phases.x, 0u), finished(ray3, geometry));
    textureStore(intermediate, at + vec2u(4u * rays.phases.x, 0u), finished(ray4, geometry));
    textureStore(intermediate, at + vec2u(5u * rays.phases.x, 0u), finished(ray5, geometry));
    textureStore(intermediate, at + vec2u(6u * rays.phases.x, 0u), finished(ray6, geometry));
    textureStore(intermediate, at + vec2u(7u * rays.phases.x, 0u), finished(ray7, geometry));
}
