// classify: which voxels of bricks are visible. Each invocation owns a row of a brick and counts its visible voxels; a
// scan turns the counts into the numbers of voxels. There are no atomics: voxels have the order of the bricks, and
// within a brick the order of the lattice, whatever the scheduling.
// uses: common/classified, common/dispatch

// Whether voxels that show nothing count too.
override KEEP_INVISIBLE: bool = false;

// For each row of a brick: its number of visible voxels; after the scan, the number of its first one.
@group(0) @binding(3) var<storage, read_write> places: array<u32>;
// For each row of a brick: a bit for each voxel, set if it is visible; the lowest bit is the first voxel.
@group(0) @binding(4) var<storage, read_write> seen: array<u32>;
// Lattice points of the first voxels of bricks.
@group(0) @binding(5) var<storage, read> origins: array<vec4u>;

// A row of a brick, along x.
struct BrickRow {
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
    let first = first_sample(brick, y, z);
    if any(point >= classify.dims) {
        return BrickRow(first, 0u);
    }
    return BrickRow(first, min(EDGE, classify.dims.x - point.x));
}

// Whether a sample shows.
fn shows(i: u32) -> bool {
    if KEEP_INVISIBLE {
        return true;
    }
    var opaque: bool;
    if BAND_LIMITED {
        opaque = band_limited(i).a > 0.0;
    } else {
        opaque = transfer(i).a > 0.0;
    }
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
