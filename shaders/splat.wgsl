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

// The chord of a fragment's ray in a splat's support, and the row of the footprint table that belongs to it. Written
// out, without loops and arrays: a compiler that does not unroll them keeps both in memory, at five times the time.
struct Chord {
    // Lattice length along the ray, from the middle of the chord, of the batch's first plane; and between planes.
    first: f32,
    step: f32,
    // Half the chord's length, and 1 / its square.
    half: f32,
    inverse_half2: f32,
    // World length per lattice length along the ray.
    scale: f32,
    a0: vec4f,
    a1: vec4f,
    a2: vec4f,
    a3: vec4f,
}

fn coefficients(texel: u32, row: u32, f: f32) -> vec4f {
    let a = textureLoad(footprint, vec2u(texel, row), 0);
    let b = textureLoad(footprint, vec2u(texel, row + 1u), 0);
    return a + (b - a) * f;
}

fn chord(in: Varyings) -> Chord {
    let plane = in.position.xy * frame.pixel_scale + frame.pixel_offset;
    // The ray in lattice coordinates per unit of view depth, and its offset from the centre at the centre's depth.
    var ray = frame.grid_forward;
    var offset = plane - in.center.xy;
    var world_per_depth = 1.0;
    if PERSPECTIVE {
        ray += frame.grid_right * plane.x + frame.grid_up * plane.y;
        offset = plane * (in.center.z + frame.eye_depth) - in.center.xy;
        world_per_depth = sqrt(1.0 + dot(plane, plane));
    }
    let q = frame.grid_right * offset.x + frame.grid_up * offset.y;
    let grid_per_depth = length(ray);
    let along = dot(q, ray) / grid_per_depth;
    let half2 = frame.radius * frame.radius - (dot(q, q) - along * along);
    if half2 <= 0.0 {
        discard;
    }
    var c: Chord;
    c.first = (batch.depth - in.center.z) * grid_per_depth + along;
    c.step = frame.sheet_step * grid_per_depth;
    c.half = sqrt(max(half2, 0.0));
    c.inverse_half2 = 1.0 / half2;
    c.scale = world_per_depth / grid_per_depth;
    let s = clamp(half2 / (frame.radius * frame.radius), 0.0, 1.0) * f32(ROWS - 1u);
    let row = min(u32(s), ROWS - 2u);
    let f = s - f32(row);
    c.a0 = coefficients(0u, row, f);
    if TEXELS > 1u {
        c.a1 = coefficients(1u, row, f);
    }
    if TEXELS > 2u {
        c.a2 = coefficients(2u, row, f);
    }
    if TEXELS > 3u {
        c.a3 = coefficients(3u, row, f);
    }
    return c;
}

fn horner(sum: f32, q: f32, a: vec4f) -> f32 {
    return (((sum * q + a.w) * q + a.z) * q + a.y) * q + a.x;
}

// World length times kernel from the middle of the chord to plane `k` of the batch: G(t) of the footprint table.
fn cumulative(c: Chord, k: f32) -> f32 {
    let t = clamp(c.first + k * c.step, -c.half, c.half);
    let q = max(1.0 - t * t * c.inverse_half2, 0.0);
    var sum = 0.0;
    if TEXELS > 3u {
        sum = horner(sum, q, c.a3);
    }
    if TEXELS > 2u {
        sum = horner(sum, q, c.a2);
    }
    if TEXELS > 1u {
        sum = horner(sum, q, c.a1);
    }
    return horner(sum, q, c.a0) * t * c.scale;
}

struct Sheets1 {
    @location(0) s0: vec4f,
}

@fragment
fn feed_1(in: Varyings) -> Sheets1 {
    let c = chord(in);
    return Sheets1(in.emission * (cumulative(c, 1.0) - cumulative(c, 0.0)));
}

struct Sheets2 {
    @location(0) s0: vec4f,
    @location(1) s1: vec4f,
}

@fragment
fn feed_2(in: Varyings) -> Sheets2 {
    let c = chord(in);
    let g1 = cumulative(c, 1.0);
    return Sheets2(in.emission * (g1 - cumulative(c, 0.0)), in.emission * (cumulative(c, 2.0) - g1));
}

struct Sheets4 {
    @location(0) s0: vec4f,
    @location(1) s1: vec4f,
    @location(2) s2: vec4f,
    @location(3) s3: vec4f,
}

// Sections of four consecutive sheets from the five planes around them.
fn sections(c: Chord, first: f32) -> vec4f {
    let g = vec4f(cumulative(c, first), cumulative(c, first + 1.0), cumulative(c, first + 2.0), cumulative(c, first + 3.0));
    return vec4f(g.yzw, cumulative(c, first + 4.0)) - g;
}

@fragment
fn feed_4(in: Varyings) -> Sheets4 {
    let s = sections(chord(in), 0.0);
    let e = in.emission;
    return Sheets4(e * s.x, e * s.y, e * s.z, e * s.w);
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
    let c = chord(in);
    let s = sections(c, 0.0);
    let r = sections(c, 4.0);
    let e = in.emission;
    return Sheets8(e * s.x, e * s.y, e * s.z, e * s.w, e * r.x, e * r.y, e * r.z, e * r.w);
}
