// cells: sums along z to the cells of a box, brick by brick, like classify.wgsl. `count` counts the cells that are
// kept, each invocation in a row of a brick, a scan turns the counts into places, and `emit` writes the words of the
// cells there, an invocation each.
// uses: common/dispatch, common/words

// Cells along the side of a brick.
const EDGE: u32 = 32u;

struct CellBox {
    // Cells along each axis of the box.
    dims: vec3u,
    // Cells of a lower density are left out.
    least: f32,
    // Bricks along x and y, and all bricks.
    bricks: vec3u,
    // The plane with the first weight in the first cell: below 0 before the first plane.
    low: i32,
    // Voxels along a cell, as a fraction in lowest terms: as many cells as the divisor have weights of their own.
    over: u32,
    under: u32,
    // Planes; beyond them all sums are 0.
    planes: u32,
}

@group(0) @binding(0) var<uniform> inside: CellBox;
@group(0) @binding(1) var<storage, read> weights: array<f32>;
// Sums along x and y of planes of voxels: colour times density, and density; x fastest.
@group(0) @binding(2) var<storage, read> planes: array<vec4f>;
// For each row of a brick: its number of cells; after the scan, the place of its first one.
@group(0) @binding(3) var<storage, read_write> places: array<u32>;
// For each row of a brick: a bit for each cell, set if it is kept; the lowest bit is the first cell.
@group(0) @binding(4) var<storage, read_write> seen: array<u32>;
// The words density_blue and color of cells that are kept.
@group(0) @binding(5) var<storage, read_write> appearances: array<vec2u>;

// A row of a brick, along x.
struct CellRow {
    // Place of its first cell in a plane, and the plane with the first weight in it.
    first: u32,
    low: i32,
    // The first of its weights, and their number.
    weights: u32,
    taps: u32,
    // Number of its cells in the box.
    count: u32,
}

fn cell_row(index: u32) -> CellRow {
    let brick = index / (EDGE * EDGE);
    let y = index % EDGE;
    let z = index / EDGE % EDGE;
    let row = brick / inside.bricks.x;
    let point = vec3u(brick % inside.bricks.x, row % inside.bricks.y, row / inside.bricks.y) * EDGE + vec3u(0u, y, z);
    let first = point.x + inside.dims.x * point.y;
    let low = inside.low + i32(point.z * inside.over / inside.under);
    let taps = arrayLength(&weights) / inside.under;
    let own = point.z % inside.under * taps;
    if any(point >= inside.dims) {
        return CellRow(first, low, own, taps, 0u);
    }
    return CellRow(first, low, own, taps, min(EDGE, inside.dims.x - point.x));
}

// The cell number `i` of a row.
fn cell_of(row: CellRow, i: u32) -> vec4f {
    let plane = inside.dims.x * inside.dims.y;
    let end = min(i32(row.taps), i32(inside.planes) - row.low);
    var cell = vec4f(0.0);
    for (var tap = max(0, -row.low); tap < end; tap++) {
        cell += weights[row.weights + u32(tap)] * planes[row.first + i + u32(row.low + tap) * plane];
    }
    return cell;
}

@compute @workgroup_size(WORKGROUP)
fn count(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if index >= inside.bricks.z * EDGE * EDGE {
        return;
    }
    let row = cell_row(index);
    var kept = 0u;
    for (var i = 0u; i < row.count; i++) {
        kept |= u32(abs(cell_of(row, i).w) > inside.least) << i;
    }
    seen[index] = kept;
    places[index] = countOneBits(kept);
}

@compute @workgroup_size(WORKGROUP)
fn emit(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if index >= inside.bricks.z * EDGE * EDGE * EDGE {
        return;
    }
    let i = index % EDGE;
    let kept = seen[index / EDGE];
    if (kept >> i & 1u) == 0u {
        return;
    }
    let cell = cell_of(cell_row(index / EDGE), i);
    let place = places[index / EDGE] + countOneBits(kept & ((1u << i) - 1u));
    appearances[place] = packed_appearance(cell.rgb / cell.w, cell.w);
}
