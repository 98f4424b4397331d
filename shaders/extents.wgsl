// extents: what the host needs of the visible voxels of bricks: the number of the first one, bits of the places along
// x, y and z in the brick that have any, and bits of its pages of 4^3 voxels that do. A workgroup for each brick.
// uses: common/dispatch

// Rows of a brick along x, y before z.
const EDGE: u32 = 32u;
// Words of the bits of pages.
const PAGES: u32 = 16u;

// For each row of a brick: the number of its first visible voxel. The last value is the number of all.
@group(0) @binding(0) var<storage, read> places: array<u32>;
// For each row of a brick: a bit for each voxel, set if it is visible.
@group(0) @binding(1) var<storage, read> seen: array<u32>;
struct Extent {
    // The bits along x, y and z, and the number of the first visible voxel. The last one holds the number of all.
    places: vec4u,
    // The bits of pages, x fastest, then y.
    pages: array<u32, PAGES>,
}

@group(0) @binding(2) var<storage, read_write> extents: array<Extent>;

// Along x, y and z, then of pages.
var<workgroup> bits: array<atomic<u32>, 3u + PAGES>;

// The bits of the eight pages along a row in which it has voxels.
fn pages_of(row: u32) -> u32 {
    // The lowest bit of each four says whether one of them is set; then these bits move together.
    let pairs = row | row >> 1u;
    let fours = (pairs | pairs >> 2u) & 0x11111111u;
    let in_bytes = (fours | fours >> 3u) & 0x03030303u;
    let in_halves = (in_bytes | in_bytes >> 6u) & 0x000f000fu;
    return (in_halves | in_halves >> 12u) & 0xffu;
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
    if lane < 3u + PAGES {
        atomicStore(&bits[lane], 0u);
    }
    workgroupBarrier();
    var own = vec3u(0u);
    for (var row = lane; row < EDGE * EDGE; row += WORKGROUP) {
        let seen_in_row = seen[brick * EDGE * EDGE + row];
        if seen_in_row != 0u {
            let y = row % EDGE;
            let z = row / EDGE;
            own |= vec3u(seen_in_row, 1u << y, 1u << z);
            let row_of_pages = y / 4u + 8u * (z / 4u);
            atomicOr(&bits[3u + row_of_pages / 4u], pages_of(seen_in_row) << (row_of_pages % 4u * 8u));
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
    extents[brick].places = vec4u(all, places[brick * EDGE * EDGE]);
    for (var word = 0u; word < PAGES; word++) {
        extents[brick].pages[word] = atomicLoad(&bits[3u + word]);
    }
    if brick + 1u == bricks {
        extents[bricks].places = vec4u(0u, 0u, 0u, places[bricks * EDGE * EDGE]);
    }
}
