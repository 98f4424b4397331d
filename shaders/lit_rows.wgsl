// lit_rows: sums along x of the voxels of a box, which are classified, thinned by gradient opacity and lit on the way.
// A workgroup makes sums of a row: its invocations light voxels side by side, then each sums the voxels of a cell.
// uses: common/arriving, common/dispatch, common/lit_splat, common/sampled, common/voxel_box

// Cells that a voxel is shared among along an axis.
const NODES: u32 = 6u;
// Sums of a workgroup: as many as the voxels of 64 cells have all the values of.
const SUMS: u32 = WORKGROUP + 1u - NODES;
// Voxels that a workgroup holds at a time: those of 64 cells of level 1.
const HELD: u32 = 2u * WORKGROUP;

@group(0) @binding(3) var<uniform> lighting: Lighting;
// x fastest.
@group(0) @binding(4) var<storage, read_write> sums: array<vec4f>;
// As many for each voxel of a cell as a voxel has cells; for as many cells as the divisor of the voxels along a cell.
@group(0) @binding(7) var<storage, read> weights: array<f32>;
@group(0) @binding(8) var<uniform> inside: VoxelBox;

// Voxels: colour times density, and density.
var<workgroup> held: array<vec4f, HELD>;

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

@compute @workgroup_size(WORKGROUP)
fn lit_rows(
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
) {
    let taps = arrayLength(&weights) / inside.under;
    let groups_of_row = (inside.cells + SUMS - 1u) / SUMS;
    let number = group.x + group.y * groups.x;
    let row = number / groups_of_row;
    if row >= inside.dims.y * inside.dims.z {
        return;
    }
    let y = inside.low.y + row % inside.dims.y;
    let z = inside.low.z + row / inside.dims.y;
    let bricks = (classify.dims + EDGE - 1u) / EDGE;
    let first_brick = bricks.x * (y / EDGE + bricks.y * (z / EDGE));
    if first_brick < inside.first || first_brick >= inside.end {
        return;
    }
    let first_cell = number % groups_of_row * SUMS;
    // The number of the first voxel of the workgroup, and the end of its voxels.
    let begin = first_cell * inside.over / inside.under;
    let end = (min(first_cell + SUMS, inside.cells) - 1u) * inside.over / inside.under - begin + taps;
    // The voxels of this invocation's sum begin here among them, and its weights there.
    let start = (first_cell + lane) * inside.over / inside.under - begin;
    let own = (first_cell + lane) % inside.under * taps;
    var sum = vec4f(0.0);
    for (var before = 0u; before < min(end, WORKGROUP * ((taps + NODES - 1u) / NODES)); before += HELD) {
        for (var n = lane; n < HELD; n += WORKGROUP) {
            let x = inside.first_x + i32(begin + before + n);
            var voxel = vec4f(0.0);
            if x >= 0 && x < i32(classify.dims.x) {
                let point = vec3u(u32(x), y, z);
                let stored = first_brick - inside.first + point.x / EDGE;
                let first = first_sample(stored, y % EDGE, z % EDGE);
                voxel = lit_voxel((stored * EDGE + z % EDGE) * EDGE + y % EDGE, first, point);
            }
            held[n] = voxel;
        }
        workgroupBarrier();
        for (var n = max(start, before); n < min(start + taps, before + HELD); n++) {
            sum += weights[own + n - start] * held[n - before];
        }
        workgroupBarrier();
    }
    let cell = first_cell + lane;
    if lane < SUMS && cell < inside.cells {
        sums[cell + inside.cells * row] = sum;
    }
}
