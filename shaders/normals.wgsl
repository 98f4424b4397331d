// normals: the packed normals of the visible voxels of bricks, for lights that move. An invocation for each voxel.
// uses: common/classified, common/dispatch

// For each row of a brick: the number of its first visible voxel among those of all bricks.
@group(0) @binding(3) var<storage, read> places: array<u32>;
@group(0) @binding(4) var<storage, read_write> normals: array<u32>;
// For each row of a brick: a bit for each voxel, set if it is visible.
@group(0) @binding(5) var<storage, read> seen: array<u32>;

@compute @workgroup_size(WORKGROUP)
fn find(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if index >= classify.bricks * EDGE * EDGE * EDGE {
        return;
    }
    let row = classify.first_brick * EDGE * EDGE + index / EDGE;
    let x = index % EDGE;
    let bits = seen[row];
    if ((bits >> x) & 1u) == 0u {
        return;
    }
    let i = first_sample(row / (EDGE * EDGE), row % EDGE, row / EDGE % EDGE) + x;
    normals[places[row] + countOneBits(bits & ((1u << x) - 1u))] = pack_normal(normal(i).xyz);
}
