// classify: voxels to splats, brick by brick. Each invocation owns a row of a brick. `count` counts the visible voxels
// of the row, a scan turns the counts into places, `emit` writes the splats there. There are no atomics: splats have
// the order of the bricks, and within a brick the order of the lattice, whatever the scheduling.
// uses: common/classified, common/dispatch, common/words

// Whether voxels that show nothing become splats too.
override KEEP_INVISIBLE: bool = false;
// Whether splats have the shares of light that arrive: common/splat.wgsl.
override SHADOWS: bool = false;

// For each row of a brick: its number of visible voxels; after the scan, the place of its first splat.
@group(0) @binding(3) var<storage, read_write> places: array<u32>;
@group(0) @binding(4) var<storage, read_write> splats: array<vec2u>;
// Lattice points of the first voxels of bricks.
@group(0) @binding(5) var<storage, read> origins: array<vec4u>;
// For each row of a brick: a bit for each voxel, set if it is visible; the lowest bit is the first voxel.
@group(0) @binding(6) var<storage, read_write> seen: array<u32>;
// The shares of light that arrive at visible voxels, if there are shadows.
@group(0) @binding(7) var<storage, read> kept: array<vec2u>;

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
    let first = first_sample(brick, y, z);
    if any(point >= classify.dims) {
        return BrickRow(brick, point, first, 0u);
    }
    return BrickRow(brick, point, first, min(EDGE, classify.dims.x - point.x));
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

@compute @workgroup_size(WORKGROUP)
fn emit(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if index >= classify.bricks * EDGE * EDGE {
        return;
    }
    let row = brick_row(index);
    var place = places[index] - classify.first_splat;
    // The lowest bit that is set is the next visible voxel; `rest & (rest - 1)` clears it.
    for (var rest = seen[index]; rest != 0u; rest &= rest - 1u) {
        let i = firstTrailingBit(rest);
        let at = splat_place(i, row.point.y % EDGE, row.point.z % EDGE, classify.first_brick + row.brick);
        let voxel = classified(row.first + i);
        let appearance = packed_appearance(voxel.rgb, voxel.w);
        let first = select(2u, 3u, SHADOWS) * place;
        splats[first] = vec2u(at, appearance.x);
        splats[first + 1u].x = appearance.y;
        if LIT {
            splats[first + 1u].y = pack_normal(normal(row.first + i).xyz);
        }
        if SHADOWS {
            splats[first + 2u] = kept[place + classify.first_splat];
        }
        place += 1u;
    }
}
