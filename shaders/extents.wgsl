// extents: what the host needs of the visible voxels of bricks: the number of the first one, bits of the places along
// x, y and z in the brick that have any, and bits of its pages of 8^3 voxels that do. A workgroup for each brick.
// uses: common/dispatch

// Rows of a brick along x, y before z.
const EDGE: u32 = 32u;

// For each row of a brick: the number of its first visible voxel. The last value is the number of all.
@group(0) @binding(0) var<storage, read> places: array<u32>;
// For each row of a brick: a bit for each voxel, set if it is visible.
@group(0) @binding(1) var<storage, read> seen: array<u32>;
struct Extent {
    // The bits along x, y and z, and the number of the first visible voxel. The last one holds the number of all.
    places: vec4u,
    // The bits of pages, x fastest, then y: 32 of the lower half of the brick along z, and 32 of the upper one.
    pages: vec2u,
}

@group(0) @binding(2) var<storage, read_write> extents: array<Extent>;

// Along x, y and z, then of pages.
var<workgroup> bits: array<atomic<u32>, 5>;

// The bits of the four pages along a row in which it has voxels.
fn pages_of(row: u32) -> u32 {
    let parts = (vec4u(row) >> vec4u(0u, 8u, 16u, 24u)) & vec4u(0xffu);
    return dot(min(parts, vec4u(1u)), vec4u(1u, 2u, 4u, 8u));
}

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
    if lane < 5u {
        atomicStore(&bits[lane], 0u);
    }
    workgroupBarrier();
    var own = vec3u(0u);
    var pages = vec2u(0u);
    for (var row = lane; row < EDGE * EDGE; row += WORKGROUP) {
        let seen_in_row = seen[brick * EDGE * EDGE + row];
        if seen_in_row != 0u {
            let y = row % EDGE;
            let z = row / EDGE;
            own |= vec3u(seen_in_row, 1u << y, 1u << z);
            let in_half = pages_of(seen_in_row) << (4u * (y / 8u) + 16u * (z / 8u % 2u));
            pages |= select(vec2u(in_half, 0u), vec2u(0u, in_half), z >= EDGE / 2u);
        }
    }
    atomicOr(&bits[0], own.x);
    atomicOr(&bits[1], own.y);
    atomicOr(&bits[2], own.z);
    atomicOr(&bits[3], pages.x);
    atomicOr(&bits[4], pages.y);
    workgroupBarrier();
    if lane > 0u {
        return;
    }
    let all = vec3u(atomicLoad(&bits[0]), atomicLoad(&bits[1]), atomicLoad(&bits[2]));
    let of_pages = vec2u(atomicLoad(&bits[3]), atomicLoad(&bits[4]));
    extents[brick] = Extent(vec4u(all, places[brick * EDGE * EDGE]), of_pages);
    if brick + 1u == bricks {
        extents[bricks] = Extent(vec4u(0u, 0u, 0u, places[bricks * EDGE * EDGE]), vec2u(0u));
    }
}
