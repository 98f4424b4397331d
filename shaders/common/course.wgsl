// The rays of the painter `tiles`, as they go from voxel plane to voxel plane and gather the kernels that reach them there:
// what shaders/gather.wgsl and shaders/gather_scalars.wgsl share.

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

// A ray at its end.
fn premultiplied(ray: Ray) -> vec4f {
    let alpha = absorbed(max(ray.depth, 0.0));
    return vec4f(select(ray.color, vec3f(alpha), WHITE), alpha);
}

// The ray of an invocation in a tile of neighbours.
fn ray_of(tile: vec3u, lane: u32) -> vec2u {
    return tile.xy * 8u + vec2u(lane & 7u, lane >> 3u);
}

// The planes of a run, the first and the one after the last; 0 where there are no more, or the ray is opaque.
fn run_of(tile: vec3u, slot: u32, depth: f32) -> vec2i {
    let run = vec2i(textureLoad(runs, runs_of(tile, slot), 0).xy);
    return select(run, vec2i(0), depth > raster.opaque_depth);
}

fn keep_pixel(at: vec2u, value: vec4f) {
    if all(at < raster.picture) {
        pixels[at.y * raster.picture.x + at.x] = value;
    }
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
