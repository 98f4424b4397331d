// lit_rows: sums along x and y of the voxels of a box, which are classified, thinned by gradient opacity and lit on the
// way. A workgroup marches along y through a plane: row by row its invocations light voxels side by side, each sums
// the voxels of a cell along x, and adds the sum to the cells along y that the row has a weight in. cells.wgsl sums
// along z.
// uses: common/arriving, common/dispatch, common/lit_splat, common/sampled, common/voxel_box

// Cells that a voxel is shared among along an axis.
const NODES: u32 = 6u;
// Sums of a workgroup along x: as many as the voxels of 64 cells have all the values of.
const SUMS: u32 = WORKGROUP + 1u - NODES;
// Cells of a workgroup along y.
const TILE_ROWS: u32 = 32u;
// Voxels that a workgroup holds at a time: those of 64 cells of level 1.
const HELD: u32 = 2u * WORKGROUP;
// Cells along y whose sums a workgroup makes at a time: at least as many as have a weight in one row, with those
// weights that are 0.
const OPEN: u32 = 8u;

@group(0) @binding(3) var<uniform> lighting: Lighting;
// Of cells along x and y, in planes of voxels; x fastest.
@group(0) @binding(4) var<storage, read_write> sums: array<vec4f>;
// As many for each voxel of a cell as a voxel has cells; for as many cells as the divisor of the voxels along a cell.
@group(0) @binding(7) var<storage, read> weights: array<f32>;
@group(0) @binding(8) var<uniform> inside: VoxelBox;

// Voxels of a row: colour times density, and density.
var<workgroup> held: array<vec4f, HELD>;
// The sums of the cells in row k of the tile are those from WORKGROUP * (k % OPEN) on.
var<workgroup> open: array<vec4f, OPEN * WORKGROUP>;
// The first voxel along y with a weight in each cell, below 0 before the face, and the first of the cell's weights.
var<workgroup> lows: array<vec2i, TILE_ROWS>;

// The voxel at a lattice point in row number `row` of the bricks, whose first sample is number `first`.
fn lit_voxel(row: u32, first: u32, point: vec3u) -> vec4f {
    let x = point.x % EDGE;
    if !is_seen(row, x) {
        return vec4f(0.0);
    }
    let i = first + x;
    let voxel = classified(i);
    var color = voxel.rgb;
    if LIGHTS > 0u {
        let number = number_of(row, x);
        let at = vec3f(point);
        color = lit_splat(color, packed_normal(number, i), kept_at(number), at, to_eye_from_point(at));
    }
    return vec4f(color * voxel.w, voxel.w);
}

// The first voxel along y with a weight in a cell of the box.
fn low_of(row: u32) -> i32 {
    return inside.first_y + i32(row * inside.over / inside.under);
}

@compute @workgroup_size(WORKGROUP)
fn lit_rows(
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
) {
    let taps = i32(arrayLength(&weights) / inside.under);
    let groups_of_row = (inside.cells + SUMS - 1u) / SUMS;
    let tiles = (inside.rows + TILE_ROWS - 1u) / TILE_ROWS;
    let number = group.x + group.y * groups.x;
    let tile = number / groups_of_row;
    if tile >= tiles * inside.dims.z {
        return;
    }
    let plane = tile / tiles;
    let z = inside.low.z + plane;
    let first_row = tile % tiles * TILE_ROWS;
    let rows = min(TILE_ROWS, inside.rows - first_row);
    for (var row = lane; row < rows; row += WORKGROUP) {
        let of_box = first_row + row;
        lows[row] = vec2i(low_of(of_box), i32(of_box % inside.under) * taps);
    }
    workgroupBarrier();
    // The rows of voxels whose samples are bound, if they are held: buffers serve whole rows of bricks.
    let bricks = (classify.dims + EDGE - 1u) / EDGE;
    let bound_bricks = vec2i(vec2u(inside.first, inside.end) / bricks.x) - i32(bricks.y * (z / EDGE));
    let bound = clamp(bound_bricks, vec2i(0), vec2i(bricks.yy)) * i32(EDGE);
    let first_y = max(low_of(first_row), bound.x);
    let end_y = min(low_of(first_row + rows - 1u) + taps, min(bound.y, i32(classify.dims.y)));
    let first_cell = number % groups_of_row * SUMS;
    // The number of the first voxel of the workgroup in a row, and the end of its voxels.
    let begin = first_cell * inside.over / inside.under;
    let end = (min(first_cell + SUMS, inside.cells) - 1u) * inside.over / inside.under - begin + u32(taps);
    // The voxels of this invocation's sum begin here among them, and its weights there.
    let start = (first_cell + lane) * inside.over / inside.under - begin;
    let own = (first_cell + lane) % inside.under * u32(taps);
    let cell = first_cell + lane;
    let has_cell = lane < SUMS && cell < inside.cells;
    let first_sum = cell + inside.cells * (first_row + inside.rows * (inside.first_plane + plane));
    // The first cell along y that has not ended.
    var open_row = 0u;
    while open_row < rows && lows[open_row].x + taps <= first_y {
        open_row++;
    }
    for (var row_y = first_y; row_y < end_y; row_y++) {
        let y = u32(row_y);
        let first_brick = bricks.x * (y / EDGE + bricks.y * (z / EDGE));
        var sum = vec4f(0.0);
        for (var passed = 0u; passed < min(end, WORKGROUP * ((u32(taps) + NODES - 1u) / NODES)); passed += HELD) {
            for (var n = lane; n < HELD; n += WORKGROUP) {
                let x = inside.first_x + i32(begin + passed + n);
                var voxel = vec4f(0.0);
                if x >= 0 && x < i32(classify.dims.x) {
                    let point = vec3u(u32(x), y, z);
                    let place = place_of_brick(first_brick - inside.first + point.x / EDGE);
                    if place != ABSENT {
                        let first = first_sample(place, y % EDGE, z % EDGE);
                        voxel = lit_voxel((place * EDGE + z % EDGE) * EDGE + y % EDGE, first, point);
                    }
                }
                held[n] = voxel;
            }
            workgroupBarrier();
            for (var n = max(start, passed); n < min(start + u32(taps), passed + HELD); n++) {
                sum += weights[own + n - start] * held[n - passed];
            }
            workgroupBarrier();
        }
        for (var row = open_row; row < rows && lows[row].x <= row_y; row++) {
            let low = lows[row];
            let tap = row_y - low.x;
            let at = WORKGROUP * (row % OPEN) + lane;
            let place = first_sum + inside.cells * row;
            if row_y == first_y || tap == 0 {
                // Samples in another buffer have begun the sum.
                var begun = vec4f(0.0);
                if has_cell && max(low.x, 0) < row_y {
                    begun = sums[place];
                }
                open[at] = begun;
            }
            open[at] += weights[low.y + tap] * sum;
            let is_last = tap == taps - 1;
            if has_cell && (is_last || row_y + 1 == end_y) {
                sums[place] = open[at];
            }
            open_row += u32(is_last);
        }
    }
    // Cells beyond the faces without a voxel.
    for (var row = 0u; row < rows; row++) {
        let low = lows[row].x;
        if has_cell && (low >= i32(classify.dims.y) || low + taps <= 0) {
            sums[first_sum + inside.cells * row] = vec4f(0.0);
        }
    }
}
