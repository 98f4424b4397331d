// gather: the rays of the painter `tiles`. A ray goes from voxel plane to voxel plane and gathers the kernels that reach
// it there; each plane has a slab, from half way to the plane before to half way to the one behind, and every kernel is cut
// by the planes between slabs. Slabs are composited as they are complete: colours and densities, or scalars that are
// classified and lit now.
//
// A kernel's parts in the five slabs that it can reach are close to linear in the place of its centre along the ray, times
// its whole footprint: so a plane needs two sums, of footprints and of footprints times places, and its slabs get theirs
// from these. The parts add up to the footprint, so optical depth is that of whole footprints. Scalars, of which small
// differences may show, are summed in slabs half as thick: eight parts, close to parabolas, from three sums.
//
// `blocked` is written out for eight rays a voxel apart: they meet a plane at the same place between voxels and share the
// six footprints of a row. Loops over them would keep arrays in memory on drivers that unroll none.

@group(0) @binding(0) var<uniform> raster: Raster;
@group(0) @binding(1) var volume: texture_2d<u32>;
@group(0) @binding(2) var runs: texture_2d<u32>;
// What is enlarged later.
@group(0) @binding(3) var picture: texture_storage_2d<rgba32float, write>;
// What is not.
@group(0) @binding(4) var<storage, read_write> pixels: array<vec4f>;
@group(0) @binding(5) var<uniform> lighting: Lighting;
// Of scalars: colour and extinction per world length, or for maxima colour and alpha, at equal steps.
@group(0) @binding(6) var transfer: texture_2d<f32>;

// X-ray: white.
override WHITE: bool = false;
// Terms of the footprint's polynomial: 6 or 8.
override TERMS: u32 = 6u;
// Voxels are scalars, without light two floats to a texel, or their gradients too as half floats.
override SCALARS: bool = false;
// The largest scalar is kept.
override MAXIMUM: bool = false;
// `single` goes through raster points that are not pixels.
override ENLARGED: bool = false;

// What a ray is like everywhere.
struct Course {
    // It meets plane k at base + k shear.
    base: vec2f,
    shear: vec2f,
    // Unit vector in (a, b, m).
    direction: vec3f,
    // World length per lattice length.
    stretch: f32,
    // See Raster.
    half: vec2f,
    row_half: f32,
    row_slope: f32,
    section: Section,
    // Planes between which it counts: in front of the eye, and for scalars inside the box.
    inside: vec2f,
    // Unit vector to the eye, view coordinates.
    to_eye: vec3f,
}

// A ray so far: what it shows, its optical depth and what it lets through; or the largest scalar as `color.x`, once there
// is one as `color.y` = 1. And the two slabs behind that, the last of them complete.
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

// Farther than any plane, and an i32.
const FAR: f32 = 1e8;

fn course_of(at: vec2u) -> Course {
    let line = line_of(at);
    var course = Course(line.base, line.shear, raster.direction, raster.stretch, raster.half, raster.row_half,
        raster.row_slope, raster.sections[0], vec2f(-FAR, FAR), vec3f(0.0, 0.0, -1.0));
    if PERSPECTIVE {
        let per_length = inverseSqrt(dot(line.heading, line.heading));
        let d = line.heading * per_length;
        let plane = raster.plane_origin + vec2f(at) * raster.plane_step;
        let slant = sqrt(1.0 + dot(plane, plane));
        course.direction = d;
        course.stretch = slant * per_length;
        course.half = half_of(line.shear);
        let square = 1.0 - d.x * d.x;
        course.row_half = sqrt(raster.radius2 / square);
        course.row_slope = d.x * d.y / square;
        let lean = max(length(line.shear), 1e-4);
        let place = clamp(lean * SECTION_STEPS, 0.0, f32(SECTIONS) - 1.001);
        let step = u32(place);
        let from_section = raster.sections[step];
        let to_section = raster.sections[step + 1u];
        course.section.x = mix(from_section.x, to_section.x, place - f32(step));
        course.section.y = mix(from_section.y, to_section.y, place - f32(step)) / lean;
        course.section.z = mix(from_section.z, to_section.z, place - f32(step)) / (lean * lean);
        course.inside.x = raster.eye.z;
        course.to_eye = -vec3f(plane, 1.0) / slant;
    }
    if SCALARS {
        // Slabs (Kay and Kajiya 1986); a component of 0 is replaced by one that leaves the ends far outside.
        let shear = select(line.shear, vec2f(1e-20), abs(line.shear) < vec2f(1e-20));
        let a = (raster.box_low.xy - line.base) / shear;
        let b = (raster.box_high.xy - line.base) / shear;
        let near = min(a, b);
        let far = max(a, b);
        course.inside = vec2f(
            max(max(near.x, near.y), max(raster.box_low.z, course.inside.x)),
            min(min(far.x, far.y), raster.box_high.z),
        );
    }
    return course;
}

// The two voxels of a texel: (colour, 1) times density, or (gradient, scalar).
fn first_of(texel: vec4u) -> vec4f {
    if SCALARS && LIGHTS == 0u {
        return vec4f(0.0, 0.0, 0.0, bitcast<f32>(texel.x));
    }
    return vec4f(unpack2x16float(texel.x), unpack2x16float(texel.y));
}

fn second_of(texel: vec4u) -> vec4f {
    if SCALARS && LIGHTS == 0u {
        return vec4f(0.0, 0.0, 0.0, bitcast<f32>(texel.y));
    }
    return vec4f(unpack2x16float(texel.z), unpack2x16float(texel.w));
}

// Footprint of a voxel (du, dv) from where a ray of that direction meets its plane, and that times its place along the ray,
// and again.
fn weights(du: f32, dv: f32, direction: vec2f) -> vec3f {
    let s = du * direction.x + dv * direction.y;
    let c2 = max(raster.radius2 - (du * du + dv * dv - s * s), 0.0);
    let f = raster.footprint;
    let g = raster.footprint_high;
    var high = g.y * c2 + g.x;
    if TERMS > 6u {
        high += (g.w * c2 + g.z) * c2 * c2;
    }
    let w = sqrt(c2) * ((((high * c2 + f.w) * c2 + f.z) * c2 + f.y) * c2 + f.x);
    return vec3f(w, w * s, w * s * s);
}

// Parts of a plane's kernels in the slabs from two before its own to two behind, given its two sums: a kernel's part is
// its footprint times x + y s. Both are alike on either side, and its own slab has the rest.
fn part_0(section: Section, m: vec4f, n: vec4f) -> vec4f {
    return section.x.x * m + section.y.x * n;
}

fn part_1(section: Section, m: vec4f, n: vec4f) -> vec4f {
    return section.x.y * m + section.y.y * n;
}

fn part_2(section: Section, m: vec4f) -> vec4f {
    return (1.0 - 2.0 * (section.x.x + section.x.y)) * m;
}

fn part_3(section: Section, m: vec4f, n: vec4f) -> vec4f {
    return section.x.y * m - section.y.y * n;
}

fn part_4(section: Section, m: vec4f, n: vec4f) -> vec4f {
    return section.x.x * m - section.y.x * n;
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

// The same of scalars: the slab half a plane thick whose middle is at `middle`.
fn advance_scalars(ray: ptr<function, Ray>, behind: vec4f, course: Course, middle: f32) {
    // The part of it that counts, from -1/2 to 1/2.
    let part = clamp(2.0 * (course.inside - middle), vec2f(-0.5), vec2f(0.5));
    if part.x < part.y {
        if MAXIMUM {
            enlarge_maximum(ray, behind, course, part);
        } else {
            classify_slab(ray, behind, course, part);
        }
    }
    (*ray).before = (*ray).slab;
    (*ray).slab = behind;
}

// Means of the scalar in the slab that waits and its neighbours.
fn means_of(ray: Ray, behind: vec4f, course: Course) -> vec3f {
    return vec3f(ray.before.w, ray.slab.w, behind.w) * (2.0 * raster.density_scale * course.direction.z);
}

fn classify_slab(ray: ptr<function, Ray>, behind: vec4f, course: Course, part: vec2f) {
    let means = means_of(*ray, behind, course);
    if is_clear(means, raster.clear) {
        return;
    }
    var light = vec2f(1.0, 0.0);
    if LIGHTS > 0u {
        let g = (*ray).slab.xyz;
        light = light_on(raster.gradient_x * g.x + raster.gradient_y * g.y + raster.gradient_z * g.z, course.to_eye);
    }
    let p = parabola(means);
    let step = (part.y - part.x) / f32(raster.samples);
    let length = 0.5 * step * course.stretch / course.direction.z;
    for (var i = 0u; i < raster.samples; i++) {
        let u = part.x + (f32(i) + 0.5) * step;
        let c = classified(select(p.x + (p.y + p.z * u) * u, means.y, raster.samples == 1u), raster.lookup);
        if c.a > 0.0 {
            let depth = c.a * length;
            var color = c.rgb;
            if LIGHTS > 0u {
                color = lit(color, light);
            }
            (*ray).color += color * ((*ray).transmitted * absorbed(depth));
            (*ray).depth += depth;
            (*ray).transmitted *= exp(-depth);
        }
    }
}

fn enlarge_maximum(ray: ptr<function, Ray>, behind: vec4f, course: Course, part: vec2f) {
    let means = means_of(*ray, behind, course);
    let largest = shown(largest_in(means, part), means, raster.clear);
    (*ray).color.x = select(largest, max(largest, (*ray).color.x), (*ray).color.y > 0.0);
    (*ray).color.y = 1.0;
}

// A ray at its end.
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
fn rows_of(plane: i32, end: i32, b: f32, half: f32) -> vec2i {
    let first = i32(ceil(b - half));
    return vec2i(first, select(first - 1, i32(floor(b + half)), plane < end));
}

// Sums of a plane's voxels over the kernels that reach a ray: of footprints, of these times places, and of scalars again.
struct Moments {
    m: vec4f,
    n: vec4f,
    o: f32,
}

fn gathered(course: Course, plane: i32, end: i32) -> Moments {
    let direction = course.direction.xy;
    let center = course.base + course.shear * f32(plane);
    let rows = rows_of(plane, end, center.y, course.half.y);
    let place = place_of(plane);
    var sums = Moments(vec4f(0.0), vec4f(0.0), 0.0);
    for (var row = rows.x; row <= rows.y; row++) {
        let dv = f32(row) - center.y;
        let first = i32(ceil(center.x + dv * course.row_slope - course.row_half)) & -2;
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
        let w0 = weights(du, dv, direction);
        let w1 = weights(du + 1.0, dv, direction);
        let w2 = weights(du + 2.0, dv, direction);
        let w3 = weights(du + 3.0, dv, direction);
        let w4 = weights(du + 4.0, dv, direction);
        let w5 = weights(du + 5.0, dv, direction);
        sums.m += w0.x * v0 + w1.x * v1 + w2.x * v2 + w3.x * v3 + w4.x * v4 + w5.x * v5;
        sums.n += w0.y * v0 + w1.y * v1 + w2.y * v2 + w3.y * v3 + w4.y * v4 + w5.y * v5;
        sums.o += w0.z * v0.w + w1.z * v1.w + w2.z * v2.w + w3.z * v3.w + w4.z * v4.w + w5.z * v5.w;
        // Rays that lean along a reach farther: from here on over more than five voxels, not counting the one that a
        // texel may begin too early.
        if PERSPECTIVE && course.row_half >= 2.5 {
            let t3 = textureLoad(volume, texel + vec2i(3, 0), 0);
            let v6 = first_of(t3);
            let v7 = second_of(t3);
            let w6 = weights(du + 6.0, dv, direction);
            let w7 = weights(du + 7.0, dv, direction);
            sums.m += w6.x * v6 + w7.x * v7;
            sums.n += w6.y * v6 + w7.y * v7;
            sums.o += w6.z * v6.w + w7.z * v7.w;
        }
    }
    return sums;
}

// The planes of a run that can matter to a ray: the first, and the one after the last.
fn planes_of(run: vec2i, course: Course) -> vec2i {
    let last = min(run.y, raster.voxels.z);
    if PERSPECTIVE || SCALARS {
        // What counts before or behind begins so far off: a kernel reaches over two planes, curves look at the slabs next
        // to those, and conversions cut off.
        let near = i32(max(course.inside.x, -FAR)) - 4;
        return vec2i(max(run.x, near), min(last, i32(min(course.inside.y, FAR)) + 5));
    }
    return vec2i(run.x, last);
}

fn keep(at: vec2u, value: vec4f) {
    if ENLARGED {
        textureStore(picture, at, value);
    } else if all(at < raster.picture) {
        pixels[at.y * raster.picture.x + at.x] = value;
    }
}

// Planes after the last of a run until all that it feeds has been composited.
const FLUSH: i32 = 5;
const FLUSH_SCALARS: i32 = 4;

@compute @workgroup_size(64)
fn single(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    let at = tile.xy * 8u + vec2u(lane & 7u, lane >> 3u);
    if !is_followed(at) {
        return;
    }
    let course = course_of(at);
    let section = course.section;
    var ray = clear_ray();
    for (var slot = 0u; slot < raster.run_slots; slot++) {
        let run = vec2i(textureLoad(runs, runs_of(tile, slot), 0).xy);
        if run.y == 0 || ray.depth > raster.opaque_depth {
            break;
        }
        let planes = planes_of(run, course);
        var s0 = vec4f(0.0);
        var s1 = vec4f(0.0);
        var s2 = vec4f(0.0);
        var s3 = vec4f(0.0);
        ray.before = vec4f(0.0);
        ray.slab = vec4f(0.0);
        for (var plane = planes.x; plane < planes.y + FLUSH; plane++) {
            let sums = gathered(course, plane, planes.y);
            advance(&ray, s0 + part_0(section, sums.m, sums.n), course, f32(plane - 3));
            s0 = s1 + part_1(section, sums.m, sums.n);
            s1 = s2 + part_2(section, sums.m);
            s2 = s3 + part_3(section, sums.m, sums.n);
            s3 = part_4(section, sums.m, sums.n);
            if ray.depth > raster.opaque_depth {
                break;
            }
        }
    }
    keep(at, premultiplied(ray));
}

@compute @workgroup_size(64)
fn scalars(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    let at = tile.xy * 8u + vec2u(lane & 7u, lane >> 3u);
    if !is_followed(at) {
        return;
    }
    let course = course_of(at);
    let x = course.section.x;
    let y = course.section.y;
    let z = course.section.z;
    var ray = clear_ray();
    for (var slot = 0u; slot < raster.run_slots; slot++) {
        let run = vec2i(textureLoad(runs, runs_of(tile, slot), 0).xy);
        if run.y == 0 || ray.depth > raster.opaque_depth {
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
        for (var plane = planes.x; plane < planes.y + FLUSH_SCALARS; plane++) {
            let sums = gathered(course, plane, planes.y);
            // Kernels feed the slabs from two planes before theirs to two behind. What is even in s is the same on both
            // sides, what is odd the opposite.
            let o = vec4f(0.0, 0.0, 0.0, sums.o);
            let e0 = x.x * sums.m + z.x * o;
            let e1 = x.y * sums.m + z.y * o;
            let e2 = x.z * sums.m + z.z * o;
            let e3 = x.w * sums.m + z.w * o;
            let o0 = y.x * sums.n;
            let o1 = y.y * sums.n;
            let o2 = y.z * sums.n;
            let o3 = y.w * sums.n;
            advance_scalars(&ray, s0 + e0 + o0, course, f32(plane) - 2.25);
            advance_scalars(&ray, s1 + e1 + o1, course, f32(plane) - 1.75);
            s0 = s2 + e2 + o2;
            s1 = s3 + e3 + o3;
            s2 = s4 + e3 - o3;
            s3 = s5 + e2 - o2;
            s4 = e1 - o1;
            s5 = e0 - o0;
            if ray.depth > raster.opaque_depth {
                break;
            }
        }
    }
    if MAXIMUM {
        // Empty space that was skipped is at the base, 0, and shows nothing.
        let c = classified(ray.color.x, raster.lookup);
        let inside = course.inside.x < course.inside.y;
        keep(at, select(vec4f(0.0), vec4f(c.rgb * c.a, c.a), inside));
    } else {
        keep(at, premultiplied(ray));
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
                let dv = f32(row) - center.y;
                let first = i32(ceil(center.x + dv * course.row_slope - course.row_half)) & -2;
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
            advance(&ray0, s00 + part_0(course.section, m0, n0), course, f32(plane - 3));
            s00 = s01 + part_1(course.section, m0, n0);
            s01 = s02 + part_2(course.section, m0);
            s02 = s03 + part_3(course.section, m0, n0);
            s03 = part_4(course.section, m0, n0);
            advance(&ray1, s10 + part_0(course.section, m1, n1), course, f32(plane - 3));
            s10 = s11 + part_1(course.section, m1, n1);
            s11 = s12 + part_2(course.section, m1);
            s12 = s13 + part_3(course.section, m1, n1);
            s13 = part_4(course.section, m1, n1);
            advance(&ray2, s20 + part_0(course.section, m2, n2), course, f32(plane - 3));
            s20 = s21 + part_1(course.section, m2, n2);
            s21 = s22 + part_2(course.section, m2);
            s22 = s23 + part_3(course.section, m2, n2);
            s23 = part_4(course.section, m2, n2);
            advance(&ray3, s30 + part_0(course.section, m3, n3), course, f32(plane - 3));
            s30 = s31 + part_1(course.section, m3, n3);
            s31 = s32 + part_2(course.section, m3);
            s32 = s33 + part_3(course.section, m3, n3);
            s33 = part_4(course.section, m3, n3);
            advance(&ray4, s40 + part_0(course.section, m4, n4), course, f32(plane - 3));
            s40 = s41 + part_1(course.section, m4, n4);
            s41 = s42 + part_2(course.section, m4);
            s42 = s43 + part_3(course.section, m4, n4);
            s43 = part_4(course.section, m4, n4);
            advance(&ray5, s50 + part_0(course.section, m5, n5), course, f32(plane - 3));
            s50 = s51 + part_1(course.section, m5, n5);
            s51 = s52 + part_2(course.section, m5);
            s52 = s53 + part_3(course.section, m5, n5);
            s53 = part_4(course.section, m5, n5);
            advance(&ray6, s60 + part_0(course.section, m6, n6), course, f32(plane - 3));
            s60 = s61 + part_1(course.section, m6, n6);
            s61 = s62 + part_2(course.section, m6);
            s62 = s63 + part_3(course.section, m6, n6);
            s63 = part_4(course.section, m6, n6);
            advance(&ray7, s70 + part_0(course.section, m7, n7), course, f32(plane - 3));
            s70 = s71 + part_1(course.section, m7, n7);
            s71 = s72 + part_2(course.section, m7);
            s72 = s73 + part_3(course.section, m7, n7);
            s73 = part_4(course.section, m7, n7);
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
