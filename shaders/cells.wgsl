// cells: the cells of a box as splats, brick by brick, like classify.wgsl: each invocation owns a row of a brick.
// `count` counts its cells that are kept, a scan turns the counts into places, `emit` writes the splats there.
// uses: common/appearance, common/dispatch

// Cells along the side of a brick.
const EDGE: u32 = 32u;

struct CellBox {
    // Cells along each axis of the box.
    dims: vec3u,
    // Cells of a lower density are left out.
    least: f32,
    // Bricks along x and y, and all bricks.
    bricks: vec3u,
    // Number of the first brick of the box among the bricks of the store.
    first_brick: u32,
    // Number of its first splat among the splats of the store.
    first_splat: u32,
}

@group(0) @binding(0) var<uniform> inside: CellBox;
// Colour times density, and density; x fastest.
@group(0) @binding(1) var<storage, read> cells: array<vec4f>;
// For each row of a brick: its number of cells; after the scan, the place of its first splat.
@group(0) @binding(2) var<storage, read_write> places: array<u32>;
// For each row of a brick: a bit for each cell, set if it is kept; the lowest bit is the first cell.
@group(0) @binding(3) var<storage, read_write> seen: array<u32>;
@group(0) @binding(4) var<storage, read_write> splats: array<vec2u>;

// A row of a brick, along x.
struct CellRow {
    brick: u32,
    y: u32,
    z: u32,
    // Index of its first cell.
    first: u32,
    // Number of its cells in the box.
    count: u32,
}

fn cell_row(index: u32) -> CellRow {
    let brick = index / (EDGE * EDGE);
    let y = index % EDGE;
    let z = index / EDGE % EDGE;
    let row = brick / inside.bricks.x;
    let point = vec3u(brick % inside.bricks.x, row % inside.bricks.y, row / inside.bricks.y) * EDGE + vec3u(0u, y, z);
    let first = point.x + inside.dims.x * (point.y + inside.dims.y * point.z);
    if any(point >= inside.dims) {
        return CellRow(brick, y, z, first, 0u);
    }
    return CellRow(brick, y, z, first, min(EDGE, inside.dims.x - point.x));
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
        kept |= u32(abs(cells[row.first + i].w) > inside.least) << i;
    }
    seen[index] = kept;
    places[index] = countOneBits(kept);
}

@compute @workgroup_size(WORKGROUP)
fn emit(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if index >= inside.bricks.z * EDGE * EDGE {
        return;
    }
    let row = cell_row(index);
    var place = inside.first_splat + places[index];
    // The lowest bit that is set is the next cell; `rest & (rest - 1)` clears it.
    for (var rest = seen[index]; rest != 0u; rest &= rest - 1u) {
        let i = firstTrailingBit(rest);
        let cell = cells[row.first + i];
        let appearance = packed_appearance(cell.rgb / cell.w, cell.w);
        splats[2u * place] = vec2u(splat_place(i, row.y, row.z, inside.first_brick + row.brick), appearance.x);
        // Cells have no normals.
        splats[2u * place + 1u] = vec2u(appearance.y, 0u);
        place += 1u;
    }
}
