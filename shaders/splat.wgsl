// splat: one instanced quad per splat and batch. A fragment evaluates the sections of its splat's kernel between the
// sheet planes of the batch and adds density times section, and colour times that, to each sheet of the batch.

override PERSPECTIVE: bool = false;
// Texels of a row of the footprint table: four coefficients each.
override TEXELS: u32 = 2u;
override ROWS: u32 = 256u;

struct Batch {
    // View depth of the first plane of the batch.
    depth: f32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> batch: Batch;
@group(0) @binding(2) var<storage, read> splats: array<Splat>;
// Row s of the cumulative footprint at texels (0 .. TEXELS, row).
@group(0) @binding(3) var footprint: texture_2d<f32>;

struct Varyings {
    @builtin(position) position: vec4f,
    // View coordinates of the splat's centre.
    @location(0) @interpolate(flat) center: vec3f,
    // What a section of length 1 adds to a sheet: (colour, 1) * density * section_scale.
    @location(1) @interpolate(flat) emission: vec4f,
}

// Bounds of the splat in one plane coordinate, as (middle, half extent).
//
// `axis` and `depth` are the gradients of the view coordinate and of depth in the lattice; the support is the lattice
// ball of the kernel's radius around the centre at view coordinate `center` and distance `z` in front of the eye.
fn bounds(axis: vec3f, center: f32, depth: vec3f, z: f32) -> vec2f {
    let r2 = frame.radius * frame.radius;
    if !PERSPECTIVE {
        return vec2f(center, frame.radius * length(axis));
    }
    // The planes through the eye of slope k = x / z that touch the support: (center - k z)^2 = R^2 |axis - k depth|^2.
    let a = z * z - r2 * dot(depth, depth);
    let b = center * z - r2 * dot(axis, depth);
    let c = center * center - r2 * dot(axis, axis);
    return vec2f(b / a, sqrt(max(b * b - a * c, 0.0)) / a);
}

@vertex
fn vertex(@builtin(vertex_index) corner: u32, @location(0) entry: u32) -> Varyings {
    let splat = splats[entry];
    let p = splat_lattice(splat) - frame.lattice_center;
    let center = vec3f(
        dot(frame.view_x, p) + frame.offset_x,
        dot(frame.view_y, p) + frame.offset_y,
        dot(frame.view_z, p),
    );
    let z = center.z + frame.eye_depth;
    let side = vec2f(f32(corner & 1u), f32(corner >> 1u)) * 2.0 - 1.0;
    var clip = side;
    // A support that the plane of the eye cuts has no bounds in the image: its quad covers the region.
    if !PERSPECTIVE || z > frame.depth_extent * 1.001 {
        let x = bounds(frame.view_x, center.x, frame.view_z, z);
        let y = bounds(frame.view_y, center.y, frame.view_z, z);
        let plane = vec2f(x.x, y.x) + side * (vec2f(x.y, y.y) + frame.quad_pad);
        clip = plane * frame.clip_scale + frame.clip_offset;
    }
    let density = splat.density * frame.section_scale;
    return Varyings(vec4f(clip, 0.0, 1.0), center, vec4f(splat_color(splat) * density, density));
}

// The most sheets one pass can feed, and the planes that bound them.
const MAX_SHEETS: u32 = 8u;
const MAX_PLANES: u32 = 9u;

// World length times kernel of the fragment's ray in each sheet: the sections of the splat.
fn sections(position: vec2f, center: vec3f, sheets: u32) -> array<f32, MAX_SHEETS> {
    var result: array<f32, MAX_SHEETS>;
    let plane = position * frame.pixel_scale + frame.pixel_offset;
    // The ray in lattice coordinates per unit of view depth, and its offset from the centre at the centre's depth.
    var ray = frame.grid_forward;
    var offset = plane - center.xy;
    var world_per_depth = 1.0;
    if PERSPECTIVE {
        ray += frame.grid_right * plane.x + frame.grid_up * plane.y;
        offset = plane * (center.z + frame.eye_depth) - center.xy;
        world_per_depth = sqrt(1.0 + dot(plane, plane));
    }
    let q = frame.grid_right * offset.x + frame.grid_up * offset.y;
    let grid_per_depth = length(ray);
    let along = dot(q, ray) / grid_per_depth;
    let c2 = frame.radius * frame.radius - (dot(q, q) - along * along);
    if c2 <= 0.0 {
        return result;
    }
    let c = sqrt(c2);
    let inverse_c2 = 1.0 / c2;
    let row = min(c2 / (frame.radius * frame.radius), 1.0) * f32(ROWS - 1u);
    let low = min(u32(row), ROWS - 2u);
    let f = row - f32(low);
    var coefficients: array<vec4f, 4>;
    for (var i = 0u; i < TEXELS; i++) {
        let a = textureLoad(footprint, vec2u(i, low), 0);
        let b = textureLoad(footprint, vec2u(i, low + 1u), 0);
        coefficients[i] = a + (b - a) * f;
    }
    let first = (batch.depth - center.z) * grid_per_depth + along;
    let step = frame.sheet_step * grid_per_depth;
    let scale = world_per_depth / grid_per_depth;
    var before = 0.0;
    for (var plane_index = 0u; plane_index <= sheets; plane_index++) {
        let t = clamp(first + f32(plane_index) * step, -c, c);
        let v = max(1.0 - t * t * inverse_c2, 0.0);
        var sum = 0.0;
        for (var i = TEXELS; i > 0u; i--) {
            let a = coefficients[i - 1u];
            sum = (((sum * v + a.w) * v + a.z) * v + a.y) * v + a.x;
        }
        let here = sum * t * scale;
        if plane_index > 0u {
            result[plane_index - 1u] = here - before;
        }
        before = here;
    }
    return result;
}

struct Sheets1 {
    @location(0) s0: vec4f,
}

@fragment
fn feed_1(in: Varyings) -> Sheets1 {
    let s = sections(in.position.xy, in.center, 1u);
    return Sheets1(in.emission * s[0]);
}

struct Sheets2 {
    @location(0) s0: vec4f,
    @location(1) s1: vec4f,
}

@fragment
fn feed_2(in: Varyings) -> Sheets2 {
    let s = sections(in.position.xy, in.center, 2u);
    return Sheets2(in.emission * s[0], in.emission * s[1]);
}

struct Sheets4 {
    @location(0) s0: vec4f,
    @location(1) s1: vec4f,
    @location(2) s2: vec4f,
    @location(3) s3: vec4f,
}

@fragment
fn feed_4(in: Varyings) -> Sheets4 {
    let s = sections(in.position.xy, in.center, 4u);
    return Sheets4(in.emission * s[0], in.emission * s[1], in.emission * s[2], in.emission * s[3]);
}

struct Sheets8 {
    @location(0) s0: vec4f,
    @location(1) s1: vec4f,
    @location(2) s2: vec4f,
    @location(3) s3: vec4f,
    @location(4) s4: vec4f,
    @location(5) s5: vec4f,
    @location(6) s6: vec4f,
    @location(7) s7: vec4f,
}

@fragment
fn feed_8(in: Varyings) -> Sheets8 {
    let s = sections(in.position.xy, in.center, 8u);
    let e = in.emission;
    return Sheets8(e * s[0], e * s[1], e * s[2], e * s[3], e * s[4], e * s[5], e * s[6], e * s[7]);
}
