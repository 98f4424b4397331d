// gather: the rays of the painter `tiles`. A ray goes from voxel plane to voxel plane and gathers the kernels that reach
// it there; each plane has a slab, from half way to the plane before to half way to the one behind, and every kernel is cut
// by the planes between slabs. Slabs are composited as they are complete.
//
// A kernel's parts in the five slabs that it can reach are close to linear in the place of its centre along the ray, times
// its whole footprint: so a plane needs two sums, of footprints and of footprints times places, and its slabs get theirs
// from these. The parts add up to the footprint, so optical depth is that of whole footprints.
//
// `blocked` is written out for eight rays a voxel apart: they meet a plane at the same place between voxels and share the
// six footprints of a row. Loops over them would keep arrays in memory on drivers that unroll none.

@group(0) @binding(0) var<uniform> raster: Raster;
@group(0) @binding(1) var volume: texture_2d<u32>;
@group(0) @binding(2) var runs: texture_2d<u32>;
// What `blocked` writes.
@group(0) @binding(3) var picture: texture_storage_2d<rgba32float, write>;
// What `single` writes.
@group(0) @binding(4) var<storage, read_write> pixels: array<vec4f>;

// X-ray: white.
override WHITE: bool = false;
// Terms of the footprint's polynomial: 6 or 8.
override TERMS: u32 = 6u;

// A ray so far: what it shows, its optical depth and what it lets through; and the two slabs behind that, the last of them
// complete.
struct Ray {
    color: vec3f,
    depth: f32,
    transmitted: f32,
    before: vec4f,
    slab: vec4f,
}

fn clear_ray() -> Ray {
    return Ray(vec3f(0.0), 0.0, 1.0, vec4f(0.0), vec4f(0.0));
}

// The two voxels of a texel.
fn first_of(texel: vec4u) -> vec4f {
    return vec4f(unpack2x16float(texel.x), unpack2x16float(texel.y));
}

fn second_of(texel: vec4u) -> vec4f {
    return vec4f(unpack2x16float(texel.z), unpack2x16float(texel.w));
}

// Footprint of a voxel (du, dv) from where the ray meets its plane, and that times its place along the ray.
fn weights(du: f32, dv: f32) -> vec2f {
    let s = du * raster.direction.x + dv * raster.direction.y;
    let c2 = max(raster.radius2 - (du * du + dv * dv - s * s), 0.0);
    let f = raster.footprint;
    let g = raster.footprint_high;
    var high = g.y * c2 + g.x;
    if TERMS > 6u {
        high += (g.w * c2 + g.z) * c2 * c2;
    }
    let w = sqrt(c2) * ((((high * c2 + f.w) * c2 + f.z) * c2 + f.y) * c2 + f.x);
    return vec2f(w, w * s);
}

// Composites the slab that waits, now that the one behind it is known: with the slope between its neighbours inside it,
// emission and extinction are right to second order.
fn advance(ray: ptr<function, Ray>, behind: vec4f) {
    let x = (*ray).slab;
    let slope = behind - (*ray).before;
    let depth = x.w * raster.density_scale;
    let passed = exp(-depth);
    // (1 - exp(-depth)) / depth, by its series where that cancels.
    let mean = select((1.0 - passed) / depth, 1.0 - 0.5 * depth, abs(depth) < 4e-3);
    let bend = sqrt(passed) * raster.density_scale * raster.density_scale * (1.0 / 24.0);
    let color = x.rgb * (raster.density_scale * mean) + bend * (x.rgb * slope.w - x.w * slope.rgb);
    (*ray).color += (*ray).transmitted * color;
    (*ray).depth += depth;
    (*ray).transmitted *= passed;
    (*ray).before = x;
    (*ray).slab = behind;
}

fn premultiplied(ray: Ray) -> vec4f {
    let alpha = absorbed(max(ray.depth, 0.0));
    return vec4f(select(ray.color, vec3f(alpha), WHITE), alpha);
}

// The texel before the first of a plane's voxels.
fn place_of(plane: i32) -> vec2i {
    let k = select(plane, raster.voxels.z - 1 - plane, raster.flipped == 1);
    return vec2i(
        k % raster.columns * (raster.row_texels + MARGIN) + MARGIN,
        k / raster.columns * (raster.voxels.y + 1) + 1,
    );
}

// The rows of a plane that reach a ray, none past the last plane of a run.
fn rows_of(plane: i32, end: i32, b: f32) -> vec2i {
    let first = i32(ceil(b - raster.half.y));
    return vec2i(first, select(first - 1, i32(floor(b + raster.half.y)), plane < end));
}

// Slabs that a kernel's plane is not yet the last to feed are held, and the two that advance() looks at.
const FLUSH: i32 = 5;

@compute @workgroup_size(64)
fn single(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    let at = tile.xy * 8u + vec2u(lane & 7u, lane >> 3u);
    let base = base_of(at);
    var ray = clear_ray();
    for (var slot = 0u; slot < raster.run_slots; slot++) {
        let run = vec2i(textureLoad(runs, runs_of(tile, slot), 0).xy);
        if run.y == 0 || ray.depth > raster.opaque_depth {
            break;
        }
        let end = min(run.y, raster.voxels.z);
        var s0 = vec4f(0.0);
        var s1 = vec4f(0.0);
        var s2 = vec4f(0.0);
        var s3 = vec4f(0.0);
        ray.before = vec4f(0.0);
        ray.slab = vec4f(0.0);
        for (var plane = run.x; plane < run.y + FLUSH; plane++) {
            let center = base + raster.shear * f32(plane);
            let rows = rows_of(plane, end, center.y);
            let place = place_of(plane);
            var m0 = vec4f(0.0);
            var m1 = vec4f(0.0);
            for (var row = rows.x; row <= rows.y; row++) {
                let dv = f32(row) - center.y;
                let first = i32(ceil(center.x + dv * raster.row_slope - raster.row_half)) & -2;
                let du = f32(first) - center.x;
                let texel = vec2i(clamp(first >> 1u, -MARGIN, raster.row_texels), clamp(row, -1, raster.voxels.y)) + place;
                let t0 = textureLoad(volume, texel, 0);
                let t1 = textureLoad(volume, texel + vec2i(1, 0), 0);
                let t2 = textureLoad(volume, texel + vec2i(2, 0), 0);
                let v0 = first_of(t0);
                let v1 = second_of(t0);
                let v2 = first_of(t1);
                let v3 = second_of(t1);
                let v4 = first_of(t2);
                let v5 = second_of(t2);
                let w0 = weights(du, dv);
                let w1 = weights(du + 1.0, dv);
                let w2 = weights(du + 2.0, dv);
                let w3 = weights(du + 3.0, dv);
                let w4 = weights(du + 4.0, dv);
                let w5 = weights(du + 5.0, dv);
                m0 += w0.x * v0 + w1.x * v1 + w2.x * v2 + w3.x * v3 + w4.x * v4 + w5.x * v5;
                m1 += w0.y * v0 + w1.y * v1 + w2.y * v2 + w3.y * v3 + w4.y * v4 + w5.y * v5;
            }
            advance(&ray, s0 + raster.section_0.x * m0 + raster.section_0.y * m1);
            s0 = s1 + raster.section_1.x * m0 + raster.section_1.y * m1;
            s1 = s2 + raster.section_2.x * m0 + raster.section_2.y * m1;
            s2 = s3 + raster.section_3.x * m0 + raster.section_3.y * m1;
            s3 = raster.section_4.x * m0 + raster.section_4.y * m1;
            if ray.depth > raster.opaque_depth {
                break;
            }
        }
    }
    if all(at < raster.picture) {
        pixels[at.y * raster.picture.x + at.x] = premultiplied(ray);
    }
}

// The least optical depth of eight rays.
fn least(a: vec4f, b: vec4f) -> f32 {
    let m = min(a, b);
    return min(min(m.x, m.y), min(m.z, m.w));
}

@compute @workgroup_size(8)
fn blocked(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    let at = first_ray(tile) + vec2u(0u, lane);
    let base = base_of(at);
    var ray0 = clear_ray();
    var ray1 = clear_ray();
    var ray2 = clear_ray();
    var ray3 = clear_ray();
    var ray4 = clear_ray();
    var ray5 = clear_ray();
    var ray6 = clear_ray();
    var ray7 = clear_ray();
    for (var slot = 0u; slot < raster.run_slots; slot++) {
        let run = vec2i(textureLoad(runs, runs_of(tile, slot), 0).xy);
        let depth = least(vec4f(ray0.depth, ray1.depth, ray2.depth, ray3.depth), vec4f(ray4.depth, ray5.depth, ray6.depth, ray7.depth));
        if run.y == 0 || depth > raster.opaque_depth {
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
        for (var plane = run.x; plane < run.y + FLUSH; plane++) {
            let center = base + raster.shear * f32(plane);
            let rows = rows_of(plane, end, center.y);
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
                let dv = f32(row) - center.y;
                let first = i32(ceil(center.x + dv * raster.row_slope - raster.row_half)) & -2;
                let du = f32(first) - center.x;
                let texel = vec2i(clamp(first >> 1u, -MARGIN, raster.row_texels), clamp(row, -1, raster.voxels.y)) + place;
                let t0 = textureLoad(volume, texel + vec2i(0, 0), 0);
                let t1 = textureLoad(volume, texel + vec2i(1, 0), 0);
                let t2 = textureLoad(volume, texel + vec2i(2, 0), 0);
                let t3 = textureLoad(volume, texel + vec2i(3, 0), 0);
                let t4 = textureLoad(volume, texel + vec2i(4, 0), 0);
                let t5 = textureLoad(volume, texel + vec2i(5, 0), 0);
                let t6 = textureLoad(volume, texel + vec2i(6, 0), 0);
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
                let w0 = weights(du + 0.0, dv);
                let w1 = weights(du + 1.0, dv);
                let w2 = weights(du + 2.0, dv);
                let w3 = weights(du + 3.0, dv);
                let w4 = weights(du + 4.0, dv);
                let w5 = weights(du + 5.0, dv);
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
            advance(&ray0, s00 + raster.section_0.x * m0 + raster.section_0.y * n0);
            s00 = s01 + raster.section_1.x * m0 + raster.section_1.y * n0;
            s01 = s02 + raster.section_2.x * m0 + raster.section_2.y * n0;
            s02 = s03 + raster.section_3.x * m0 + raster.section_3.y * n0;
            s03 = raster.section_4.x * m0 + raster.section_4.y * n0;
            advance(&ray1, s10 + raster.section_0.x * m1 + raster.section_0.y * n1);
            s10 = s11 + raster.section_1.x * m1 + raster.section_1.y * n1;
            s11 = s12 + raster.section_2.x * m1 + raster.section_2.y * n1;
            s12 = s13 + raster.section_3.x * m1 + raster.section_3.y * n1;
            s13 = raster.section_4.x * m1 + raster.section_4.y * n1;
            advance(&ray2, s20 + raster.section_0.x * m2 + raster.section_0.y * n2);
            s20 = s21 + raster.section_1.x * m2 + raster.section_1.y * n2;
            s21 = s22 + raster.section_2.x * m2 + raster.section_2.y * n2;
            s22 = s23 + raster.section_3.x * m2 + raster.section_3.y * n2;
            s23 = raster.section_4.x * m2 + raster.section_4.y * n2;
            advance(&ray3, s30 + raster.section_0.x * m3 + raster.section_0.y * n3);
            s30 = s31 + raster.section_1.x * m3 + raster.section_1.y * n3;
            s31 = s32 + raster.section_2.x * m3 + raster.section_2.y * n3;
            s32 = s33 + raster.section_3.x * m3 + raster.section_3.y * n3;
            s33 = raster.section_4.x * m3 + raster.section_4.y * n3;
            advance(&ray4, s40 + raster.section_0.x * m4 + raster.section_0.y * n4);
            s40 = s41 + raster.section_1.x * m4 + raster.section_1.y * n4;
            s41 = s42 + raster.section_2.x * m4 + raster.section_2.y * n4;
            s42 = s43 + raster.section_3.x * m4 + raster.section_3.y * n4;
            s43 = raster.section_4.x * m4 + raster.section_4.y * n4;
            advance(&ray5, s50 + raster.section_0.x * m5 + raster.section_0.y * n5);
            s50 = s51 + raster.section_1.x * m5 + raster.section_1.y * n5;
            s51 = s52 + raster.section_2.x * m5 + raster.section_2.y * n5;
            s52 = s53 + raster.section_3.x * m5 + raster.section_3.y * n5;
            s53 = raster.section_4.x * m5 + raster.section_4.y * n5;
            advance(&ray6, s60 + raster.section_0.x * m6 + raster.section_0.y * n6);
            s60 = s61 + raster.section_1.x * m6 + raster.section_1.y * n6;
            s61 = s62 + raster.section_2.x * m6 + raster.section_2.y * n6;
            s62 = s63 + raster.section_3.x * m6 + raster.section_3.y * n6;
            s63 = raster.section_4.x * m6 + raster.section_4.y * n6;
            advance(&ray7, s70 + raster.section_0.x * m7 + raster.section_0.y * n7);
            s70 = s71 + raster.section_1.x * m7 + raster.section_1.y * n7;
            s71 = s72 + raster.section_2.x * m7 + raster.section_2.y * n7;
            s72 = s73 + raster.section_3.x * m7 + raster.section_3.y * n7;
            s73 = raster.section_4.x * m7 + raster.section_4.y * n7;
            if least(vec4f(ray0.depth, ray1.depth, ray2.depth, ray3.depth), vec4f(ray4.depth, ray5.depth, ray6.depth, ray7.depth))
                > raster.opaque_depth {
                break;
            }
        }
    }
    textureStore(picture, at + vec2u(0u * raster.phases, 0u), premultiplied(ray0));
    textureStore(picture, at + vec2u(1u * raster.phases, 0u), premultiplied(ray1));
    textureStore(picture, at + vec2u(2u * raster.phases, 0u), premultiplied(ray2));
    textureStore(picture, at + vec2u(3u * raster.phases, 0u), premultiplied(ray3));
    textureStore(picture, at + vec2u(4u * raster.phases, 0u), premultiplied(ray4));
    textureStore(picture, at + vec2u(5u * raster.phases, 0u), premultiplied(ray5));
    textureStore(picture, at + vec2u(6u * raster.phases, 0u), premultiplied(ray6));
    textureStore(picture, at + vec2u(7u * raster.phases, 0u), premultiplied(ray7));
}
