// extents: what the host needs of the visible voxels of bricks: the number of the first one, and bits of the places
// along x, y and z in the brick that have any. A workgroup for each brick.
// uses: common/dispatch

// Rows of a brick along x, y before z.
const EDGE: u32 = 32u;

// For each row of a brick: the number of its first visible voxel. The last value is the number of all.
@group(0) @binding(0) var<storage, read> places: array<u32>;
// For each row of a brick: a bit for each voxel, set if it is visible.
@group(0) @binding(1) var<storage, read> seen: array<u32>;
// For each brick: the bits along x, y and z, and the number of its first visible voxel. The last one holds the number
// of all.
@group(0) @binding(2) var<storage, read_write> extents: array<vec4u>;

var<workgroup> bits: array<atomic<u32>, 3>;

@compute @workgroup_size(WORKGROUP)
fn extents_of_bricks(
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
) {
    let brick = group.x + group.y * groups.x;
    let bricks = arrayLength(&seen) / (EDGE * EDGE);
    if brick >= bricks {
        return;
    }
    if lane < 3u {
        atomicStore(&bits[lane], 0u);
    }
    workgroupBarrier();
    var own = vec3u(0u);
    for (var row = lane; row < EDGE * EDGE; row += WORKGROUP) {
        let seen_in_row = seen[brick * EDGE * EDGE + row];
        if seen_in_row != 0u {
            own |= vec3u(seen_in_row, 1u << (row % EDGE), 1u << (row / EDGE));
        }
    }
    atomicOr(&bits[0], own.x);
    atomicOr(&bits[1], own.y);
    atomicOr(&bits[2], own.z);
    workgroupBarrier();
    if lane > 0u {
        return;
    }
    let all = vec3u(atomicLoad(&bits[0]), atomicLoad(&bits[1]), atomicLoad(&bits[2]));
    extents[brick] = vec4u(all, places[brick * EDGE * EDGE]);
    if brick + 1u == bricks {
        extents[bricks] = vec4u(0u, 0u, 0u, places[bricks * EDGE * EDGE]);
    }
}
