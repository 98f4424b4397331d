// classify: voxels to splats, brick by brick. Each invocation owns a row of a brick: `count` notes its visible voxels, a
// scan turns their counts into places, `emit` writes the splats there. Without atomics the order of the splats is that of the
// bricks and of the lattice in them, so the result does not depend on scheduling.

// How a sample is stored: 0 u8, 1 i8, 2 u16, 3 i16, 4 f32.
override SAMPLE_TYPE: u32 = 0u;
// Whether splats get normals. Bricks come with a layer of their neighbours' voxels around them then.
override LIT: bool = false;
// Whether transparent voxels stay.
override KEEP: bool = false;
// Control points, if they are so few that comparing with one after the other is fastest: all invocations read the same of
// them then. 0: they are many.
override FEW: u32 = 0u;
// The most that are few.
const MOST_FEW: u32 = 32u;
// Voxels along the side of a brick.
const EDGE: u32 = 32u;

struct Classify {
    // Lattice size.
    dims: vec3u,
    // Bricks in this batch.
    bricks: u32,
    // World gradients of the lattice coordinates.
    gradient_x: vec3f,
    // Control points of the transfer function.
    points: u32,
    gradient_y: vec3f,
    // Subtracted from a sample before it is compared with the control points.
    sample_origin: f32,
    gradient_z: vec3f,
    // Number of the first of them among the bricks of the store.
    first_brick: u32,
    few: array<ControlPoint, MOST_FEW>,
}

struct ControlPoint {
    color: vec3f,
    // In the units of the samples, less sample_origin.
    sample: f32,
    opacity: f32,
}

@group(0) @binding(0) var<uniform> classify: Classify;
// Brick after brick, x fastest.
@group(0) @binding(1) var<storage, read> samples: array<u32>;
@group(0) @binding(2) var<storage, read> control_points: array<ControlPoint>;
@group(0) @binding(3) var<storage, read_write> places: array<u32>;
@group(0) @binding(4) var<storage, read_write> splats: array<vec2u>;
// Lattice points of the first voxels of bricks.
@group(0) @binding(5) var<storage, read> origins: array<vec4u>;
// Row after row, a bit for each visible voxel, the first of a row the lowest.
@group(0) @binding(6) var<storage, read_write> seen: array<u32>;

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

fn chosen(first: bool, a: ControlPoint, b: ControlPoint) -> ControlPoint {
    let color = select(b.color, a.color, first);
    return ControlPoint(color, select(b.sample, a.sample, first), select(b.opacity, a.opacity, first));
}

// Colour and opacity: piecewise linear, constant beyond the ends; at a step the later point holds.
fn transfer(sample: f32) -> vec4f {
    // The last point that is not above the sample, or the first, and the one after it.
    var a = classify.few[0];
    var b = a;
    if FEW > 0u {
        for (var i = 0u; i < FEW; i++) {
            let next = classify.few[min(i + 1u, FEW - 1u)];
            let reached = classify.few[i].sample <= sample;
            a = chosen(reached, classify.few[i], a);
            b = chosen(reached, next, b);
        }
    } else {
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
        a = control_points[max(above, 1u) - 1u];
        b = control_points[min(above, classify.points - 1u)];
    }
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

// Voxels along the side of a brick as it is stored.
fn stored_edge() -> u32 {
    return select(EDGE, EDGE + 2u, LIT);
}

// Where a row begins: its brick, its lattice point, the index of its first sample, and how many voxels of it are in the lattice.
struct Row {
    brick: u32,
    point: vec3u,
    first: u32,
    count: u32,
}

fn row_of(run: u32) -> Row {
    let brick = run / (EDGE * EDGE);
    let y = run % EDGE;
    let z = run / EDGE % EDGE;
    let point = origins[brick].xyz + vec3u(0u, y, z);
    let edge = stored_edge();
    let halo = u32(LIT);
    let first = ((brick * edge + z + halo) * edge + y + halo) * edge + halo;
    if any(point >= classify.dims) {
        return Row(brick, point, first, 0u);
    }
    return Row(brick, point, first, min(EDGE, classify.dims.x - point.x));
}

// World gradient at a sample, in units of half a sample: central differences.
fn gradient(i: u32) -> vec3f {
    let row = stored_edge();
    let plane = row * row;
    let x = sample_at(i + 1u) - sample_at(i - 1u);
    let y = sample_at(i + row) - sample_at(i - row);
    let z = sample_at(i + plane) - sample_at(i - plane);
    return x * classify.gradient_x + y * classify.gradient_y + z * classify.gradient_z;
}

@compute @workgroup_size(WORKGROUP)
fn count(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let run = invocation_index(id, groups);
    if run >= classify.bricks * EDGE * EDGE {
        return;
    }
    let row = row_of(run);
    var visible = 0u;
    for (var i = 0u; i < row.count; i++) {
        let shows = KEEP || transfer(sample_at(row.first + i) - classify.sample_origin).a > 0.0;
        visible |= u32(shows) << i;
    }
    seen[run] = visible;
    places[run] = countOneBits(visible);
}

@compute @workgroup_size(WORKGROUP)
fn emit(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let run = invocation_index(id, groups);
    if run >= classify.bricks * EDGE * EDGE {
        return;
    }
    let row = row_of(run);
    var place = places[run];
    // From visible voxel to visible voxel.
    for (var rest = seen[run]; rest != 0u; rest &= rest - 1u) {
        let i = firstTrailingBit(rest);
        let classified = transfer(sample_at(row.first + i) - classify.sample_origin);
        let at = splat_place(i, row.point.y % EDGE, row.point.z % EDGE, classify.first_brick + row.brick);
        let looks = packed_looks(classified.rgb, density(classified.a));
        splats[2u * place] = vec2u(at, looks.x);
        splats[2u * place + 1u].x = looks.y;
        if LIT {
            splats[2u * place + 1u].y = pack_normal(gradient(row.first + i));
        }
        place += 1u;
    }
}
