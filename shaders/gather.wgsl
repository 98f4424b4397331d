// gather: rays of the painter `tiles` through classified voxels. A ray goes from voxel plane to voxel plane and gathers the
// kernels that reach it there; each plane has a slab, from half way to the plane before to half way to the one behind, and
// every kernel is cut by the planes between slabs. Slabs are composited as they are complete.
//
// A kernel's parts in the slabs that it can reach, two or three on either side of its own, are close to linear in the place
// of its centre along the ray, times its whole footprint: so a plane needs two sums, of footprints and of footprints times
// places, and its slabs get theirs from these. The parts add up to the footprint, so optical depth is that of whole ones.
//
// `blocked` is written out for eight rays a voxel apart: they meet a plane at the same place between voxels and share the
// six footprints of a row. Loops over them would keep arrays in memory on drivers that unroll none.

@group(0) @binding(0) var<uniform> raster: Raster;
@group(0) @binding(2) var runs: texture_2d<u32>;
// What is enlarged later.
@group(0) @binding(3) var picture: texture_storage_2d<rgba32float, write>;
// What is not.
@group(0) @binding(4) var<storage, read_write> pixels: array<vec4f>;

// `single` goes through raster points that are not pixels.
override ENLARGED: bool = false;

// Parts of a plane's kernels, given its two sums, in the slab so many planes before or behind its own: a kernel's part is its
// footprint times x + y s. Both are alike on either side, and its own slab has the rest.
fn part_1(section: Section, m: vec4f, n: vec4f) -> vec4f {
    return section.x.x * m + section.y.x * n;
}

fn part_2(section: Section, m: vec4f, n: vec4f) -> vec4f {
    return section.x.y * m + section.y.y * n;
}

// Only of kernels over 2 voxels.
fn part_3(section: Section, m: vec4f, n: vec4f) -> vec4f {
    return section.x.z * m + section.y.z * n;
}

fn part_0(section: Section, m: vec4f) -> vec4f {
    return (1.0 - 2.0 * (section.x.x + section.x.y + section.x.z)) * m;
}

// Composites the slab that waits, of plane `plane`, now that the one behind it is known. With the slope between its
// neighbours inside it, emission and extinction are right to second order.
fn advance(ray: ptr<function, Ray>, behind: vec4f, course: Course, plane: f32) {
    var x = (*ray).slab;
    var slope = behind - (*ray).before;
    if PERSPECTIVE {
        // The eye may be in it.
        let part = clamp(course.inside - plane, vec2f(-0.5), vec2f(0.5));
        let length = max(part.y - part.x, 0.0);
        x = length * (x + slope * (0.25 * (part.x + part.y)));
        slope *= length * length;
    }
    let scale = raster.density_scale * course.stretch;
    let depth = x.w * scale;
    let passed = exp(-depth);
    // (1 - exp(-depth)) / depth, by its series where that cancels.
    let mean = select((1.0 - passed) / depth, 1.0 - 0.5 * depth, abs(depth) < 4e-3);
    let bend = sqrt(passed) * scale * scale * (1.0 / 24.0);
    let color = x.rgb * (scale * mean) + bend * (x.rgb * slope.w - x.w * slope.rgb);
    (*ray).color += (*ray).transmitted * color;
    (*ray).depth += depth;
    (*ray).transmitted *= passed;
    (*ray).before = (*ray).slab;
    (*ray).slab = behind;
}

fn keep(at: vec2u, value: vec4f) {
    if ENLARGED {
        textureStore(picture, at, value);
    } else {
        keep_pixel(at, value);
    }
}

// Planes after the last of a run until all that it feeds has been composited; by `blocked`, which kernels of 2 voxels reach.
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

// Adds a plane to the slabs that it reaches, and composites the one that no later plane reaches.
fn feed(ray: ptr<function, Ray>, slabs: ptr<function, Slabs>, sums: Moments, course: Course, plane: i32) {
    let section = course.section;
    let pending = *slabs;
    advance(ray, pending.s0 + part_3(section, sums.m, sums.n), course, f32(plane - 4));
    *slabs = Slabs(
        pending.s1 + part_2(section, sums.m, sums.n),
        pending.s2 + part_1(section, sums.m, sums.n),
        pending.s3 + part_0(section, sums.m),
        pending.s4 + part_1(section, sums.m, -sums.n),
        pending.s5 + part_2(section, sums.m, -sums.n),
        part_3(section, sums.m, -sums.n),
    );
}

@compute @workgroup_size(64)
fn single(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    let at = ray_of(tile, lane);
    if !is_followed(at) {
        return;
    }
    keep(at, premultiplied(march_planes(tile, course_of(at))));
}

// The least optical depth of eight rays.
fn least(a: vec4f, b: vec4f) -> f32 {
    let m = min(a, b);
    return min(min(m.x, m.y), min(m.z, m.w));
}

// The same where kernels reach two planes.
struct NearSlabs {
    s0: vec4f,
    s1: vec4f,
    s2: vec4f,
    s3: vec4f,
}

// Before each run: nothing is pending.
fn restart(ray: ptr<function, Ray>, slabs: ptr<function, NearSlabs>) {
    (*ray).before = vec4f(0.0);
    (*ray).slab = vec4f(0.0);
    *slabs = NearSlabs(vec4f(0.0), vec4f(0.0), vec4f(0.0), vec4f(0.0));
}

// Adds a plane to the slabs that it reaches, and composites the one that no later plane reaches.
fn feed_near(ray: ptr<function, Ray>, slabs: ptr<function, NearSlabs>, sums: Moments, course: Course, plane: i32) {
    let section = course.section;
    let pending = *slabs;
    advance(ray, pending.s0 + part_2(section, sums.m, sums.n), course, f32(plane - 3));
    *slabs = NearSlabs(
        pending.s1 + part_1(section, sums.m, sums.n),
        pending.s2 + part_0(section, sums.m),
        pending.s3 + part_1(section, sums.m, -sums.n),
        part_2(section, sums.m, -sums.n),
    );
}

@compute @workgroup_size(8)
fn blocked(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    let at = first_ray(tile) + vec2u(0u, lane * raster.phases.y);
    let course = course_of(at);
    let direction = course.direction.xy;
    var ray0 = clear_ray();
    var ray1 = clear_ray();
    var ray2 = clear_ray();
    var ray3 = clear_ray();
    var ray4 = clear_ray();
    var ray5 = clear_ray();
    var ray6 = clear_ray();
    var ray7 = clear_ray();
    var slabs0: NearSlabs;
    var slabs1: NearSlabs;
    var slabs2: NearSlabs;
    var slabs3: NearSlabs;
    var slabs4: NearSlabs;
    var slabs5: NearSlabs;
    var slabs6: NearSlabs;
    var slabs7: NearSlabs;
    var depth = 0.0;
    for (var slot = 0u; slot < raster.run_slots; slot++) {
        let run = run_of(tile, slot, depth);
        if run.y == 0 {
            break;
        }
        let end = min(run.y, raster.voxels.z);
        restart(&ray0, &slabs0);
        restart(&ray1, &slabs1);
        restart(&ray2, &slabs2);
        restart(&ray3, &slabs3);
        restart(&ray4, &slabs4);
        restart(&ray5, &slabs5);
        restart(&ray6, &slabs6);
        restart(&ray7, &slabs7);
        for (var plane = run.x; plane < run.y + FLUSH_BLOCKED; plane++) {
            let center = course.base + course.shear * f32(plane);
            let rows = rows_of(plane, end, center.y, course.half.y);
            let place = place_of(plane);
            var sums0 = Moments(vec4f(0.0), vec4f(0.0), 0.0);
            var sums1 = Moments(vec4f(0.0), vec4f(0.0), 0.0);
            var sums2 = Moments(vec4f(0.0), vec4f(0.0), 0.0);
            var sums3 = Moments(vec4f(0.0), vec4f(0.0), 0.0);
            var sums4 = Moments(vec4f(0.0), vec4f(0.0), 0.0);
            var sums5 = Moments(vec4f(0.0), vec4f(0.0), 0.0);
            var sums6 = Moments(vec4f(0.0), vec4f(0.0), 0.0);
            var sums7 = Moments(vec4f(0.0), vec4f(0.0), 0.0);
            for (var row = rows.x; row <= rows.y; row++) {
                let cut = row_at(course, center, row, place);
                let w = row_weights(cut, direction);
                let t0 = textureLoad(volume, cut.texel + vec2i(0, 0));
                let t1 = textureLoad(volume, cut.texel + vec2i(1, 0));
                let t2 = textureLoad(volume, cut.texel + vec2i(2, 0));
                let t3 = textureLoad(volume, cut.texel + vec2i(3, 0));
                let t4 = textureLoad(volume, cut.texel + vec2i(4, 0));
                let t5 = textureLoad(volume, cut.texel + vec2i(5, 0));
                let t6 = textureLoad(volume, cut.texel + vec2i(6, 0));
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
            feed_near(&ray0, &slabs0, sums0, course, plane);
            feed_near(&ray1, &slabs1, sums1, course, plane);
            feed_near(&ray2, &slabs2, sums2, course, plane);
            feed_near(&ray3, &slabs3, sums3, course, plane);
            feed_near(&ray4, &slabs4, sums4, course, plane);
            feed_near(&ray5, &slabs5, sums5, course, plane);
            feed_near(&ray6, &slabs6, sums6, course, plane);
            feed_near(&ray7, &slabs7, sums7, course, plane);
            depth = least(
                vec4f(ray0.depth, ray1.depth, ray2.depth, ray3.depth),
                vec4f(ray4.depth, ray5.depth, ray6.depth, ray7.depth),
            );
            if depth > raster.opaque_depth {
                break;
            }
        }
    }
    textureStore(picture, at + vec2u(0u * raster.phases.x, 0u), premultiplied(ray0));
    textureStore(picture, at + vec2u(1u * raster.phases.x, 0u), premultiplied(ray1));
    textureStore(picture, at + vec2u(2u * raster.phases.x, 0u), premultiplied(ray2));
    textureStore(picture, at + vec2u(3u * raster.phases.x, 0u), premultiplied(ray3));
    textureStore(picture, at + vec2u(4u * raster.phases.x, 0u), premultiplied(ray4));
    textureStore(picture, at + vec2u(5u * raster.phases.x, 0u), premultiplied(ray5));
    textureStore(picture, at + vec2u(6u * raster.phases.x, 0u), premultiplied(ray6));
    textureStore(picture, at + vec2u(7u * raster.phases.x, 0u), premultiplied(ray7));
}
