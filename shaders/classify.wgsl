// classify: voxels to splats, brick by brick. Each invocation owns a row of a brick. `count` counts the visible voxels
// of the row, a scan turns the counts into places, `emit` writes the splats there. There are no atomics: splats have
// the order of the bricks, and within a brick the order of the lattice, whatever the scheduling.
// uses: common/dispatch, common/normal, common/resolution, common/splat

// How a sample is stored: 0 u8, 1 i8, 2 u16, 3 i16, 4 f32.
override SAMPLE_TYPE: u32 = 0u;
// Whether splats get normals.
override LIT: bool = false;
// Whether extinction depends on gradients.
override GRADIENT_OPACITY: bool = false;
// Whether voxels that show nothing become splats too.
override KEEP_INVISIBLE: bool = false;
// Number of control points, if there are at most MAX_INLINE_POINTS. A sample is then compared with one after the other,
// in the uniform buffer, where all invocations read the same one at a time. 0: binary search in the storage buffer.
override INLINE_POINTS: u32 = 0u;
const MAX_INLINE_POINTS: u32 = 32u;
// Floats farther out than this are as far as any: their differences stay in the range of f32.
const FAR: f32 = 1e36;
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
    // Number of the first brick of this batch among the bricks of the store.
    first_brick: u32,
    // Control points of gradient opacity, after the other points: `sample` is the length of a gradient of samples.
    gradient_points: u32,
    // The base of the transfer function in the units of the samples, and the resolution there, see
    // common/resolution.wgsl.
    base: f32,
    faintest: f32,
    inline_points: array<ControlPoint, MAX_INLINE_POINTS>,
}

struct ControlPoint {
    color: vec3f,
    // Value in the units of the samples, minus sample_origin.
    sample: f32,
    opacity: f32,
}

@group(0) @binding(0) var<uniform> classify: Classify;
// Samples of the bricks, brick after brick, x fastest; several to a word, see SAMPLE_TYPE.
@group(0) @binding(1) var<storage, read> samples: array<u32>;
@group(0) @binding(2) var<storage, read> control_points: array<ControlPoint>;
// For each row of a brick: its number of visible voxels; after the scan, the place of its first splat.
@group(0) @binding(3) var<storage, read_write> places: array<u32>;
@group(0) @binding(4) var<storage, read_write> splats: array<vec2u>;
// Lattice points of the first voxels of bricks.
@group(0) @binding(5) var<storage, read> origins: array<vec4u>;
// For each row of a brick: a bit for each voxel, set if it is visible; the lowest bit is the first voxel.
@group(0) @binding(6) var<storage, read_write> seen: array<u32>;

// Sample number `i` of the batch.
fn sample_at(i: u32) -> f32 {
    if SAMPLE_TYPE == 4u {
        return clamp(bitcast<f32>(samples[i]), -FAR, FAR);
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

// `a` if `first`, otherwise `b`: select() takes no structs.
fn chosen(first: bool, a: ControlPoint, b: ControlPoint) -> ControlPoint {
    let color = select(b.color, a.color, first);
    return ControlPoint(color, select(b.sample, a.sample, first), select(b.opacity, a.opacity, first));
}

// Colour and opacity of a sample: linear between control points, constant beyond the first and the last. If several
// points have the same value, the last of them holds from there on.
fn transfer(sample: f32) -> vec4f {
    // a: the last point that is not above the sample, or the first point. b: the point after it.
    var a = classify.inline_points[0];
    var b = a;
    if INLINE_POINTS > 0u {
        for (var i = 0u; i < INLINE_POINTS; i++) {
            let next = classify.inline_points[min(i + 1u, INLINE_POINTS - 1u)];
            let reached = classify.inline_points[i].sample <= sample;
            a = chosen(reached, classify.inline_points[i], a);
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

// -ln(1 - opacity). Below 0.1, where the subtraction would cancel, by its series to opacity^6: the next term is 1.4e-7
// of it there. The largest opacity is TransferFunction::MAX_OPACITY, 1 - 2^-16.
fn density(opacity: f32) -> f32 {
    let a = min(opacity, 0.9999847412109375);
    if a < 0.1 {
        return a * (1.0 + a * (1.0 / 2.0 + a * (1.0 / 3.0 + a * (1.0 / 4.0 + a * (1.0 / 5.0 + a * (1.0 / 6.0))))));
    }
    return -log(1.0 - a);
}

// Whether bricks have a layer of neighbouring voxels around them, for gradients.
fn has_halo() -> bool {
    return LIT || GRADIENT_OPACITY;
}

// Voxels along the side of a stored brick.
fn stored_edge() -> u32 {
    return select(EDGE, EDGE + 2u, has_halo());
}

// A row of a brick, along x.
struct BrickRow {
    // Number of its brick in this batch.
    brick: u32,
    // Lattice point of its first voxel.
    point: vec3u,
    // Index of its first sample.
    first: u32,
    // Number of its voxels in the lattice.
    count: u32,
}

fn brick_row(index: u32) -> BrickRow {
    let brick = index / (EDGE * EDGE);
    let y = index % EDGE;
    let z = index / EDGE % EDGE;
    let point = origins[brick].xyz + vec3u(0u, y, z);
    let edge = stored_edge();
    let halo = u32(has_halo());
    let first = ((brick * edge + z + halo) * edge + y + halo) * edge + halo;
    if any(point >= classify.dims) {
        return BrickRow(brick, point, first, 0u);
    }
    return BrickRow(brick, point, first, min(EDGE, classify.dims.x - point.x));
}

// The world gradient at a sample, by central differences: a vector of moderate length (xyz) and its factor (w); 0 if
// the differences are rounding.
fn gradient(i: u32) -> vec4f {
    let row = stored_edge();
    let plane = row * row;
    let x = sample_at(i + 1u) - sample_at(i - 1u);
    let y = sample_at(i + row) - sample_at(i - row);
    let z = sample_at(i + plane) - sample_at(i - plane);
    let largest = largest_difference(vec3f(x, y, z));
    if 0.5 * largest < resolution_at(sample_at(i) - classify.base, classify.faintest) {
        return vec4f(0.0);
    }
    // Neither the unit of the samples nor the unit of the world moves it out of the range of f32.
    let d = vec3f(x, y, z) / largest;
    let direction = classify.gradient_x * d.x + classify.gradient_y * d.y + classify.gradient_z * d.z;
    return vec4f(direction, 0.5 * largest);
}

// The length of a gradient.
fn magnitude_of(gradient: vec4f) -> f32 {
    return min(length(gradient.xyz) * gradient.w, FAR);
}

// The share of extinction that stays at a gradient.
fn gradient_share(gradient: vec4f) -> f32 {
    let magnitude = magnitude_of(gradient);
    var above = 0u;
    var end = classify.gradient_points;
    while above < end {
        let middle = (above + end) / 2u;
        if control_points[classify.points + middle].sample <= magnitude {
            above = middle + 1u;
        } else {
            end = middle;
        }
    }
    let a = control_points[classify.points + max(above, 1u) - 1u];
    let b = control_points[classify.points + min(above, classify.gradient_points - 1u)];
    let width = b.sample - a.sample;
    var f = 0.0;
    if width > 0.0 {
        f = clamp((magnitude - a.sample) / width, 0.0, 1.0);
    }
    return a.opacity + (b.opacity - a.opacity) * f;
}

// Whether a sample shows.
fn shows(i: u32) -> bool {
    if KEEP_INVISIBLE {
        return true;
    }
    let opaque = transfer(sample_at(i) - classify.sample_origin).a > 0.0;
    if !GRADIENT_OPACITY || !opaque {
        return opaque;
    }
    return gradient_share(gradient(i)) > 0.0;
}

@compute @workgroup_size(WORKGROUP)
fn count(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if index >= classify.bricks * EDGE * EDGE {
        return;
    }
    let row = brick_row(index);
    var visible = 0u;
    for (var i = 0u; i < row.count; i++) {
        visible |= u32(shows(row.first + i)) << i;
    }
    seen[index] = visible;
    places[index] = countOneBits(visible);
}

@compute @workgroup_size(WORKGROUP)
fn emit(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if index >= classify.bricks * EDGE * EDGE {
        return;
    }
    let row = brick_row(index);
    var place = places[index];
    // The lowest bit that is set is the next visible voxel; `rest & (rest - 1)` clears it.
    for (var rest = seen[index]; rest != 0u; rest &= rest - 1u) {
        let i = firstTrailingBit(rest);
        let classified = transfer(sample_at(row.first + i) - classify.sample_origin);
        let at = splat_place(i, row.point.y % EDGE, row.point.z % EDGE, classify.first_brick + row.brick);
        var density = density(classified.a);
        if GRADIENT_OPACITY {
            density *= gradient_share(gradient(row.first + i));
        }
        let appearance = packed_appearance(classified.rgb, density);
        splats[2u * place] = vec2u(at, appearance.x);
        splats[2u * place + 1u].x = appearance.y;
        if LIT {
            splats[2u * place + 1u].y = pack_normal(gradient(row.first + i).xyz);
        }
        place += 1u;
    }
}
