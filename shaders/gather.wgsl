// gather: rays of the painter `tiles` through classified voxels. A ray goes from voxel plane to voxel plane and gathers
// the kernels of each plane that reach it. Each plane has a slab, from half way to the plane before it to half way to
// the plane behind it. The planes between slabs cut every kernel; a slab is composited when all kernels that reach it
// are known.
//
// A kernel reaches two or three slabs on either side of its own. Its part in each is nearly its footprint times a
// linear function of s, the place of its centre along the ray. So a plane needs two sums, its moments: footprints m0,
// and footprints times s, m1. The slabs around it get their parts from these. The parts of a kernel add up to its
// footprint, so the optical depth of a ray is that of whole kernels.
//
// `single` marches one ray. `blocked` marches eight that are a voxel apart: they meet a plane at the same place between
// its voxels and share the six footprints of a row. It is written out eight times: loops over arrays stay in memory on
// drivers that do not unroll them.

@group(0) @binding(0) var<uniform> rays: Rays;
@group(0) @binding(2) var runs: texture_2d<u32>;
// Written by `single` if rays go through an intermediate image, and by `blocked`; read by `prefilter`.
@group(0) @binding(3) var intermediate: texture_storage_2d<rgba32float, write>;
// The picture: `single` and `refine` add to it.
@group(0) @binding(4) var<storage, read_write> pixels: array<vec4f>;
// The share of its own ray in each pixel, and the tiles in which there is one.
@group(0) @binding(3) var<storage, read> refinement: array<f32>;
@group(0) @binding(5) var<storage, read> refined: Refined;

// The rays of `single` go through an intermediate image.
override RESAMPLED: bool = false;

// What the kernels of a plane with moments m0 and m1 add to the slab one, two or three planes before their own. Behind
// their own the sign of m1 changes.
fn part_1(section: Section, m0: vec4f, m1: vec4f) -> vec4f {
    return section.by_m0.x * m0 + section.by_m1.x * m1;
}

fn part_2(section: Section, m0: vec4f, m1: vec4f) -> vec4f {
    return section.by_m0.y * m0 + section.by_m1.y * m1;
}

// 0 for kernels with a radius of at most 2 voxels.
fn part_3(section: Section, m0: vec4f, m1: vec4f) -> vec4f {
    return section.by_m0.z * m0 + section.by_m1.z * m1;
}

// What they add to their own slab: the rest.
fn part_0(section: Section, m0: vec4f) -> vec4f {
    return (1.0 - 2.0 * (section.by_m0.x + section.by_m0.y + section.by_m0.z)) * m0;
}

// Composites the slab of plane `plane`, which waits in `ray`, now that the slab behind it is known. The slope between
// its neighbours makes emission and extinction inside it right to second order.
fn advance(ray: ptr<function, RayState>, behind: vec4f, geometry: RayGeometry, plane: f32) {
    var x = (*ray).slab;
    var slope = behind - (*ray).before;
    if PERSPECTIVE {
        // The eye may be in the slab: only the part in front of it counts.
        let part = clamp(geometry.inside - plane, vec2f(-0.5), vec2f(0.5));
        let length = max(part.y - part.x, 0.0);
        x = length * (x + slope * (0.25 * (part.x + part.y)));
        slope *= length * length;
    }
    let scale = rays.density_scale * geometry.stretch;
    let depth = x.w * scale;
    let passed = exp(-depth);
    // (1 - exp(-depth)) / depth. Below 4e-3 the series errs by depth^2 / 6 < 3e-6; the quotient, in f32, by more than
    // 1e-5.
    let mean = select((1.0 - passed) / depth, 1.0 - 0.5 * depth, abs(depth) < 4e-3);
    // 1/24: a slab has a variance of 1/12 along the ray, and the slope is that over two slabs.
    let bend = sqrt(passed) * scale * scale * (1.0 / 24.0);
    let color = x.rgb * (scale * mean) + bend * (x.rgb * slope.w - x.w * slope.rgb);
    (*ray).color += (*ray).transmittance * color;
    (*ray).depth += depth;
    (*ray).transmittance *= passed;
    (*ray).before = (*ray).slab;
    (*ray).slab = behind;
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
    let section = geometry.section;
    let pending = *slabs;
    advance(ray, pending.s0 + part_3(section, sums.m0, sums.m1), geometry, f32(plane - 4));
    *slabs = Slabs(
        pending.s1 + part_2(section, sums.m0, sums.m1),
        pending.s2 + part_1(section, sums.m0, sums.m1),
        pending.s3 + part_0(section, sums.m0),
        pending.s4 + part_1(section, sums.m0, -sums.m1),
        pending.s5 + part_2(section, sums.m0, -sums.m1),
        part_3(section, sums.m0, -sums.m1),
    );
}

@compute @workgroup_size(64)
fn single(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    let at = point_of(tile, lane);
    let share = share_of(line_of(at));
    if share == 0.0 {
        return;
    }
    let value = share * premultiplied(march_planes(tile, geometry_of(at)));
    if RESAMPLED {
        textureStore(intermediate, at, value);
    } else {
        add_to_pixel(at, value);
    }
}

// The rays of pixels that the intermediate images do not show well enough: a workgroup for each tile of the list.
@compute @workgroup_size(64)
fn refine(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) group: vec3u) {
    let index = group.y * REFINED_ROW + group.x;
    if index >= refined.count {
        return;
    }
    let number = refined.tiles[index];
    let tile = vec3u(number % rays.tiles.x, number / rays.tiles.x, 0u);
    let at = point_of(tile, lane);
    if any(at >= rays.picture) {
        return;
    }
    let share = refinement[at.y * rays.picture.x + at.x] * share_of(line_of(at));
    if share > 0.0 {
        add_to_pixel(at, share * premultiplied(march_planes(tile, geometry_of(at))));
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
    let section = geometry.section;
    let pending = *slabs;
    advance(ray, pending.s0 + part_2(section, sums.m0, sums.m1), geometry, f32(plane - 3));
    *slabs = NearSlabs(
        pending.s1 + part_1(section, sums.m0, sums.m1),
        pending.s2 + part_0(section, sums.m0),
        pending.s3 + part_1(section, sums.m0, -sums.m1),
        part_2(section, sums.m0, -sums.m1),
    );
}

// A run begins: nothing before it is pending.
fn restart(ray: ptr<function, RayState>, slabs: ptr<function, NearSlabs>) {
    (*ray).before = vec4f(0.0);
    (*ray).slab = vec4f(0.0);
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
            var sums0 = Moments(vec4f(0.0), vec4f(0.0), 0.0);
            var sums1 = Moments(vec4f(0.0), vec4f(0.0), 0.0);
            var sums2 = Moments(vec4f(0.0), vec4f(0.0), 0.0);
            var sums3 = Moments(vec4f(0.0), vec4f(0.0), 0.0);
            var sums4 = Moments(vec4f(0.0), vec4f(0.0), 0.0);
            var sums5 = Moments(vec4f(0.0), vec4f(0.0), 0.0);
            var sums6 = Moments(vec4f(0.0), vec4f(0.0), 0.0);
            var sums7 = Moments(vec4f(0.0), vec4f(0.0), 0.0);
            for (var row = rows.x; row <= rows.y; row++) {
                let at_row = voxel_row(geometry, center, row, origin);
                let w = row_weights(at_row, direction);
                let t0 = textureLoad(volume, at_row.texel + vec2i(0, 0));
                let t1 = textureLoad(volume, at_row.texel + vec2i(1, 0));
                let t2 = textureLoad(volume, at_row.texel + vec2i(2, 0));
                let t3 = textureLoad(volume, at_row.texel + vec2i(3, 0));
                let t4 = textureLoad(volume, at_row.texel + vec2i(4, 0));
                let t5 = textureLoad(volume, at_row.texel + vec2i(5, 0));
                let t6 = textureLoad(volume, at_row.texel + vec2i(6, 0));
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
    textureStore(intermediate, at + vec2u(0u * rays.phases.x, 0u), premultiplied(ray0));
    textureStore(intermediate, at + vec2u(1u * rays.phases.x, 0u), premultiplied(ray1));
    textureStore(intermediate, at + vec2u(2u * rays.phases.x, 0u), premultiplied(ray2));
    textureStore(intermediate, at + vec2u(3u * rays.phases.x, 0u), premultiplied(ray3));
    textureStore(intermediate, at + vec2u(4u * rays.phases.x, 0u), premultiplied(ray4));
    textureStore(intermediate, at + vec2u(5u * rays.phases.x, 0u), premultiplied(ray5));
    textureStore(intermediate, at + vec2u(6u * rays.phases.x, 0u), premultiplied(ray6));
    textureStore(intermediate, at + vec2u(7u * rays.phases.x, 0u), premultiplied(ray7));
}
