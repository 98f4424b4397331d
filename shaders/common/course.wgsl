// The rays of the painter `tiles`, as they go from voxel plane to voxel plane and gather the kernels that reach them there:
// what shaders/gather.wgsl and shaders/gather_scalars.wgsl share.

// Terms of the footprint's polynomial: 6 or 8.
override TERMS: u32 = 6u;
// Voxels are scalars.
override SCALARS: bool = false;
// X-ray: white.
override WHITE: bool = false;

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
        let t0 = textureLoad(volume, texel);
        let t1 = textureLoad(volume, texel + vec2i(1, 0));
        let t2 = textureLoad(volume, texel + vec2i(2, 0));
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
            let t3 = textureLoad(volume, texel + vec2i(3, 0));
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
