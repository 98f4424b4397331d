// classify: voxels to splats. Each invocation owns a run of RUN consecutive voxels: `count` counts the visible ones,
// a scan turns counts into places, `emit` writes the splats there. Without atomics the order of the splats is that of
// the lattice, so the result does not depend on scheduling.

// How a sample is stored: 0 u8, 1 i8, 2 u16, 3 i16, 4 f32.
override SAMPLE_TYPE: u32 = 0u;
// Whether splats get normals.
override LIT: bool = false;
const RUN: u32 = 32u;

struct Classify {
    // Lattice size.
    dims: vec3u,
    // Voxels in this chunk.
    count: u32,
    // Lattice point of the chunk's first voxel.
    start: vec3u,
    // Control points of the transfer function.
    points: u32,
    // Subtracted from a sample before it is compared with the control points.
    sample_origin: f32,
    // Splats of earlier chunks.
    base: u32,
    // Index among the samples of the chunk's first voxel, and of the voxels below and above it (wrapping where the
    // volume has none): `samples` holds the chunk with a row on either side, then what is a plane before and behind.
    before: u32,
    below: u32,
    // World gradients of the lattice coordinates.
    gradient_x: vec3f,
    above: u32,
    gradient_y: vec3f,
    gradient_z: vec3f,
}

struct ControlPoint {
    color: vec3f,
    // In the units of the samples, less sample_origin.
    sample: f32,
    opacity: f32,
}

@group(0) @binding(0) var<uniform> classify: Classify;
@group(0) @binding(1) var<storage, read> samples: array<u32>;
@group(0) @binding(2) var<storage, read> control_points: array<ControlPoint>;
@group(0) @binding(3) var<storage, read_write> places: array<u32>;
@group(0) @binding(4) var<storage, read_write> splats: array<Splat>;
@group(0) @binding(5) var<storage, read_write> normals: array<u32>;

fn sample_at(i: u32) -> f32 {
    if SAMPLE_TYPE == 4u {
        return bitcast<f32>(samples[i]);
    }
    if SAMPLE_TYPE >= 2u {
        let bits = samples[i >> 1u] << (16u - 16u * (i & 1u));
        if SAMPLE_TYPE == 2u {
            return f32(bits >> 16u);
        }
        return f32(bitcast<i32>(bits) >> 16u);
    }
    let bits = samples[i >> 2u] << (24u - 8u * (i & 3u));
    if SAMPLE_TYPE == 0u {
        return f32(bits >> 24u);
    }
    return f32(bitcast<i32>(bits) >> 24u);
}

// Colour and opacity: piecewise linear, constant beyond the ends; at a step the later point holds.
fn transfer(sample: f32) -> vec4f {
    var above = 0u;
    var end = classify.points;
    while above < end {
        let middle = (above + end) / 2u;
        if control_points[middle].sample <= sample {
            above = middle + 1u;
        } else {
            end = middle;
        }
    }
    let a = control_points[max(above, 1u) - 1u];
    let b = control_points[min(above, classify.points - 1u)];
    let width = b.sample - a.sample;
    var f = 0.0;
    if width > 0.0 {
        f = clamp((sample - a.sample) / width, 0.0, 1.0);
    }
    return vec4f(a.color + (b.color - a.color) * f, a.opacity + (b.opacity - a.opacity) * f);
}

// -ln(1 - opacity), by its series where the subtraction would cancel. Keep in step with TransferFunction::MAX_OPACITY.
fn density(opacity: f32) -> f32 {
    let a = min(opacity, 0.9999847412109375);
    if a < 0.1 {
        return a * (1.0 + a * (1.0 / 2.0 + a * (1.0 / 3.0 + a * (1.0 / 4.0 + a * (1.0 / 5.0 + a * (1.0 / 6.0))))));
    }
    return -log(1.0 - a);
}

fn lattice_point(i: u32) -> vec3u {
    let x = classify.start.x + i;
    let y = classify.start.y + x / classify.dims.x;
    return vec3u(x % classify.dims.x, y % classify.dims.y, classify.start.z + y / classify.dims.y);
}

// World gradient at voxel `i` of the chunk, in units of half a sample: central differences, an edge standing for what is
// beyond it.
fn gradient(i: u32, p: vec3u) -> vec3f {
    let c = classify.before + i;
    let low = p > vec3u(0u);
    let high = p + 1u < classify.dims;
    let row = classify.dims.x;
    let x = sample_at(c + u32(high.x)) - sample_at(c - u32(low.x));
    let y = sample_at(c + select(0u, row, high.y)) - sample_at(c - select(0u, row, low.y));
    let z = sample_at(select(c, classify.above + i, high.z)) - sample_at(select(c, classify.below + i, low.z));
    return x * classify.gradient_x + y * classify.gradient_y + z * classify.gradient_z;
}

@compute @workgroup_size(WORKGROUP)
fn count(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let run = invocation_index(id, groups);
    let first = run * RUN;
    if first >= classify.count {
        return;
    }
    var visible = 0u;
    for (var i = first; i < min(first + RUN, classify.count); i++) {
        visible += u32(transfer(sample_at(classify.before + i) - classify.sample_origin).a > 0.0);
    }
    places[run] = visible;
}

@compute @workgroup_size(WORKGROUP)
fn emit(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let run = invocation_index(id, groups);
    let first = run * RUN;
    if first >= classify.count {
        return;
    }
    var place = classify.base + places[run];
    for (var i = first; i < min(first + RUN, classify.count); i++) {
        let classified = transfer(sample_at(classify.before + i) - classify.sample_origin);
        if classified.a > 0.0 {
            let p = lattice_point(i);
            let c = vec3u(round(clamp(classified.rgb, vec3f(0.0), vec3f(1.0)) * 65535.0));
            splats[place] = Splat(p.x | (p.y << 16u), p.z | (c.r << 16u), c.g | (c.b << 16u), density(classified.a));
            if LIT {
                normals[place] = pack_normal(gradient(i, p));
            }
            place += 1u;
        }
    }
}
