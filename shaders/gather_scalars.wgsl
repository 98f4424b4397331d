// gather-scalars: rays of the painter `tiles`, one for each pixel, through voxels that are scalars. As in shaders/gather.wgsl
// they gather the kernels of a plane, into slabs that are classified and lit as they are complete.
//
// Of scalars small differences may show: they are summed in slabs half as thick as a plane. A kernel has eight parts there,
// close to parabolas in the place of its centre, from three sums.

@group(0) @binding(0) var<uniform> raster: Raster;
@group(0) @binding(2) var runs: texture_2d<u32>;
@group(0) @binding(3) var<storage, read_write> pixels: array<vec4f>;
@group(0) @binding(4) var<uniform> lighting: Lighting;
// Colour and extinction per world length, or for maxima colour and alpha, at equal steps.
@group(0) @binding(5) var transfer: texture_storage_2d<rgba32float, read>;

// The largest scalar is kept.
override MAXIMUM: bool = false;

// Composites the slab that waits, half a plane thick and with its middle at `middle`, now that the one behind it is known.
fn advance(ray: ptr<function, Ray>, behind: vec4f, course: Course, middle: f32) {
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
    let step = (part.y - part.x) / f32(raster.samples);
    let length = 0.5 * step * course.stretch / course.direction.z;
    march_parabola(ray, means, part, raster.samples, length, raster.lookup, light);
}

alias Marched = Ray;

fn add_sample(ray: ptr<function, Marched>, color: vec3f, depth: f32) {
    (*ray).color += color * ((*ray).transmitted * absorbed(depth));
    (*ray).depth += depth;
    (*ray).transmitted *= exp(-depth);
}

fn enlarge_maximum(ray: ptr<function, Ray>, behind: vec4f, course: Course, part: vec2f) {
    let means = means_of(*ray, behind, course);
    let largest = shown(largest_in(means, part), means, raster.clear);
    (*ray).color.x = select(largest, max(largest, (*ray).color.x), (*ray).color.y > 0.0);
    (*ray).color.y = 1.0;
}

// Planes after the last of a run until all that it feeds has been composited.
const FLUSH: i32 = 4;

// The slabs that planes may still add to, the foremost first.
struct Slabs {
    s0: vec4f,
    s1: vec4f,
    s2: vec4f,
    s3: vec4f,
    s4: vec4f,
    s5: vec4f,
}

// Kernels feed the slabs from two planes before theirs to two behind. What is even in s is the same on both sides, what is
// odd the opposite.
fn feed(ray: ptr<function, Ray>, slabs: ptr<function, Slabs>, sums: Moments, course: Course, plane: i32) {
    let x = course.section.x;
    let y = course.section.y;
    let z = course.section.z;
    let o = vec4f(0.0, 0.0, 0.0, sums.o);
    let e0 = x.x * sums.m + z.x * o;
    let e1 = x.y * sums.m + z.y * o;
    let e2 = x.z * sums.m + z.z * o;
    let e3 = x.w * sums.m + z.w * o;
    let o0 = y.x * sums.n;
    let o1 = y.y * sums.n;
    let o2 = y.z * sums.n;
    let o3 = y.w * sums.n;
    let pending = *slabs;
    advance(ray, pending.s0 + e0 + o0, course, f32(plane) - 2.25);
    advance(ray, pending.s1 + e1 + o1, course, f32(plane) - 1.75);
    *slabs = Slabs(pending.s2 + e2 + o2, pending.s3 + e3 + o3, pending.s4 + e3 - o3, pending.s5 + e2 - o2, e1 - o1, e0 - o0);
}

@compute @workgroup_size(64)
fn gather(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    let at = ray_of(tile, lane);
    if !is_followed(at) {
        return;
    }
    let course = course_of(at);
    let ray = march_planes(tile, course);
    var value = premultiplied(ray);
    if MAXIMUM {
        // Empty space that was skipped is at the base, 0, and shows nothing.
        let c = classified(ray.color.x, raster.lookup);
        let inside = course.inside.x < course.inside.y;
        value = select(vec4f(0.0), vec4f(c.rgb * c.a, c.a), inside);
    }
    keep_pixel(at, value);
}
