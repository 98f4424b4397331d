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

@compute @workgroup_size(64)
fn single(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    let at = ray_of(tile, lane);
    if !is_followed(at) {
        return;
    }
    let course = course_of(at);
    let section = course.section;
    let footprints = footprints_of(course);
    var ray = clear_ray();
    for (var slot = 0u; slot < raster.run_slots; slot++) {
        let run = run_of(tile, slot, ray.depth);
        if run.y == 0 {
            break;
        }
        let planes = planes_of(run, course);
        var s0 = vec4f(0.0);
        var s1 = vec4f(0.0);
        var s2 = vec4f(0.0);
        var s3 = vec4f(0.0);
        var s4 = vec4f(0.0);
        var s5 = vec4f(0.0);
        ray.before = vec4f(0.0);
        ray.slab = vec4f(0.0);
        for (var plane = planes.x; plane < planes.y + FLUSH; plane++) {
            let sums = gathered(course, footprints, plane, planes.y);
            advance(&ray, s0 + part_3(section, sums.m, sums.n), course, f32(plane - 4));
            s0 = s1 + part_2(section, sums.m, sums.n);
            s1 = s2 + part_1(section, sums.m, sums.n);
            s2 = s3 + part_0(section, sums.m);
            s3 = s4 + part_1(section, sums.m, -sums.n);
            s4 = s5 + part_2(section, sums.m, -sums.n);
            s5 = part_3(section, sums.m, -sums.n);
            if ray.depth > raster.opaque_depth {
                break;
            }
        }
    }
    keep(at, premultiplied(ray));
}

// The least optical depth of eight rays.
fn least(a: vec4f, b: vec4f) -> f32 {
    let m = min(a, b);
    return min(min(m.x, m.y), min(m.z, m.w));
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
    for (var slot = 0u; slot < raster.run_slots; slot++) {
        let depth = least(vec4f(ray0.depth, ray1.depth, ray2.depth, ray3.depth), vec4f(ray4.depth, ray5.depth, ray6.depth, ray7.depth));
        let run = run_of(tile, slot, depth);
        if run.y == 0 {
            break;
        }
        let end = min(run.y, raster.voxels.z);
        var s00 = vec4f(0.0);
        var s01 = vec4f(0.0);
        var s02 = vec4f(0.0);
        var s03 = vec4f(0.0);
        var s10 = vec4f(0.0);
        var s11 = vec4f(0.0);
        var s12 = vec4f(0.0);
        var s13 = vec4f(0.0);
        var s20 = vec4f(0.0);
        var s21 = vec4f(0.0);
        var s22 = vec4f(0.0);
        var s23 = vec4f(0.0);
        var s30 = vec4f(0.0);
        var s31 = vec4f(0.0);
        var s32 = vec4f(0.0);
        var s33 = vec4f(0.0);
        var s40 = vec4f(0.0);
        var s41 = vec4f(0.0);
        var s42 = vec4f(0.0);
        var s43 = vec4f(0.0);
        var s50 = vec4f(0.0);
        var s51 = vec4f(0.0);
        var s52 = vec4f(0.0);
        var s53 = vec4f(0.0);
        var s60 = vec4f(0.0);
        var s61 = vec4f(0.0);
        var s62 = vec4f(0.0);
        var s63 = vec4f(0.0);
        var s70 = vec4f(0.0);
        var s71 = vec4f(0.0);
        var s72 = vec4f(0.0);
        var s73 = vec4f(0.0);
        ray0.before = vec4f(0.0);
        ray0.slab = vec4f(0.0);
        ray1.before = vec4f(0.0);
        ray1.slab = vec4f(0.0);
        ray2.before = vec4f(0.0);
        ray2.slab = vec4f(0.0);
        ray3.before = vec4f(0.0);
        ray3.slab = vec4f(0.0);
        ray4.before = vec4f(0.0);
        ray4.slab = vec4f(0.0);
        ray5.before = vec4f(0.0);
        ray5.slab = vec4f(0.0);
        ray6.before = vec4f(0.0);
        ray6.slab = vec4f(0.0);
        ray7.before = vec4f(0.0);
        ray7.slab = vec4f(0.0);
        for (var plane = run.x; plane < run.y + FLUSH_BLOCKED; plane++) {
            let center = course.base + course.shear * f32(plane);
            let rows = rows_of(plane, end, center.y, course.half.y);
            let place = place_of(plane);
            var m0 = vec4f(0.0);
            var n0 = vec4f(0.0);
            var m1 = vec4f(0.0);
            var n1 = vec4f(0.0);
            var m2 = vec4f(0.0);
            var n2 = vec4f(0.0);
            var m3 = vec4f(0.0);
            var n3 = vec4f(0.0);
            var m4 = vec4f(0.0);
            var n4 = vec4f(0.0);
            var m5 = vec4f(0.0);
            var n5 = vec4f(0.0);
            var m6 = vec4f(0.0);
            var n6 = vec4f(0.0);
            var m7 = vec4f(0.0);
            var n7 = vec4f(0.0);
            for (var row = rows.x; row <= rows.y; row++) {
                let cut = row_at(course, center, row, place);
                let du = cut.du;
                let dv = cut.dv;
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
                let v13 = second_of(t6);
                let w0 = weights(du + 0.0, dv, direction);
                let w1 = weights(du + 1.0, dv, direction);
                let w2 = weights(du + 2.0, dv, direction);
                let w3 = weights(du + 3.0, dv, direction);
                let w4 = weights(du + 4.0, dv, direction);
                let w5 = weights(du + 5.0, dv, direction);
                m0 += w0.x * v0 + w1.x * v1 + w2.x * v2 + w3.x * v3 + w4.x * v4 + w5.x * v5;
                n0 += w0.y * v0 + w1.y * v1 + w2.y * v2 + w3.y * v3 + w4.y * v4 + w5.y * v5;
                m1 += w0.x * v1 + w1.x * v2 + w2.x * v3 + w3.x * v4 + w4.x * v5 + w5.x * v6;
                n1 += w0.y * v1 + w1.y * v2 + w2.y * v3 + w3.y * v4 + w4.y * v5 + w5.y * v6;
                m2 += w0.x * v2 + w1.x * v3 + w2.x * v4 + w3.x * v5 + w4.x * v6 + w5.x * v7;
                n2 += w0.y * v2 + w1.y * v3 + w2.y * v4 + w3.y * v5 + w4.y * v6 + w5.y * v7;
                m3 += w0.x * v3 + w1.x * v4 + w2.x * v5 + w3.x * v6 + w4.x * v7 + w5.x * v8;
                n3 += w0.y * v3 + w1.y * v4 + w2.y * v5 + w3.y * v6 + w4.y * v7 + w5.y * v8;
                m4 += w0.x * v4 + w1.x * v5 + w2.x * v6 + w3.x * v7 + w4.x * v8 + w5.x * v9;
                n4 += w0.y * v4 + w1.y * v5 + w2.y * v6 + w3.y * v7 + w4.y * v8 + w5.y * v9;
                m5 += w0.x * v5 + w1.x * v6 + w2.x * v7 + w3.x * v8 + w4.x * v9 + w5.x * v10;
                n5 += w0.y * v5 + w1.y * v6 + w2.y * v7 + w3.y * v8 + w4.y * v9 + w5.y * v10;
                m6 += w0.x * v6 + w1.x * v7 + w2.x * v8 + w3.x * v9 + w4.x * v10 + w5.x * v11;
                n6 += w0.y * v6 + w1.y * v7 + w2.y * v8 + w3.y * v9 + w4.y * v10 + w5.y * v11;
                m7 += w0.x * v7 + w1.x * v8 + w2.x * v9 + w3.x * v10 + w4.x * v11 + w5.x * v12;
                n7 += w0.y * v7 + w1.y * v8 + w2.y * v9 + w3.y * v10 + w4.y * v11 + w5.y * v12;
            }
            advance(&ray0, s00 + part_2(course.section, m0, n0), course, f32(plane - 3));
            s00 = s01 + part_1(course.section, m0, n0);
            s01 = s02 + part_0(course.section, m0);
            s02 = s03 + part_1(course.section, m0, -n0);
            s03 = part_2(course.section, m0, -n0);
            advance(&ray1, s10 + part_2(course.section, m1, n1), course, f32(plane - 3));
            s10 = s11 + part_1(course.section, m1, n1);
            s11 = s12 + part_0(course.section, m1);
            s12 = s13 + part_1(course.section, m1, -n1);
            s13 = part_2(course.section, m1, -n1);
            advance(&ray2, s20 + part_2(course.section, m2, n2), course, f32(plane - 3));
            s20 = s21 + part_1(course.section, m2, n2);
            s21 = s22 + part_0(course.section, m2);
            s22 = s23 + part_1(course.section, m2, -n2);
            s23 = part_2(course.section, m2, -n2);
            advance(&ray3, s30 + part_2(course.section, m3, n3), course, f32(plane - 3));
            s30 = s31 + part_1(course.section, m3, n3);
            s31 = s32 + part_0(course.section, m3);
            s32 = s33 + part_1(course.section, m3, -n3);
            s33 = part_2(course.section, m3, -n3);
            advance(&ray4, s40 + part_2(course.section, m4, n4), course, f32(plane - 3));
            s40 = s41 + part_1(course.section, m4, n4);
            s41 = s42 + part_0(course.section, m4);
            s42 = s43 + part_1(course.section, m4, -n4);
            s43 = part_2(course.section, m4, -n4);
            advance(&ray5, s50 + part_2(course.section, m5, n5), course, f32(plane - 3));
            s50 = s51 + part_1(course.section, m5, n5);
            s51 = s52 + part_0(course.section, m5);
            s52 = s53 + part_1(course.section, m5, -n5);
            s53 = part_2(course.section, m5, -n5);
            advance(&ray6, s60 + part_2(course.section, m6, n6), course, f32(plane - 3));
            s60 = s61 + part_1(course.section, m6, n6);
            s61 = s62 + part_0(course.section, m6);
            s62 = s63 + part_1(course.section, m6, -n6);
            s63 = part_2(course.section, m6, -n6);
            advance(&ray7, s70 + part_2(course.section, m7, n7), course, f32(plane - 3));
            s70 = s71 + part_1(course.section, m7, n7);
            s71 = s72 + part_0(course.section, m7);
            s72 = s73 + part_1(course.section, m7, -n7);
            s73 = part_2(course.section, m7, -n7);
            if least(vec4f(ray0.depth, ray1.depth, ray2.depth, ray3.depth), vec4f(ray4.depth, ray5.depth, ray6.depth, ray7.depth))
                > raster.opaque_depth {
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
