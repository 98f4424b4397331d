// The voxels of bricks, and which of them are visible. Voxels are classified samples, or words of visible voxels. An
// invocation for each voxel.
// uses: common/classified, common/words

// `samples` are the words density_blue and color of the visible voxels of the bricks, in their order.
override APPEARANCES: bool = false;

// The place of a brick whose samples are not in the buffer.
const ABSENT: u32 = 4294967295u;

// For each row of a brick: the number of its first visible voxel among those of all bricks of a buffer of samples.
// Then the number of all. Then for each brick of the buffer its number in the volume, and for each brick of a part of
// the volume its place in the buffer, or ABSENT.
@group(0) @binding(5) var<storage, read> places: array<u32>;
// For each row of a brick of the buffer: a bit for each voxel, set if it is visible.
@group(0) @binding(6) var<storage, read> seen: array<u32>;

struct BrickVoxel {
    // The number of its row among those of the bricks of the buffer.
    row: u32,
    // Its place in the row.
    x: u32,
    // Its lattice point, which may lie beyond the volume.
    point: vec3u,
}

// Bricks of the buffer.
fn bricks_of_buffer() -> u32 {
    return arrayLength(&seen) / (EDGE * EDGE);
}

// The place in the buffer of a brick of the part of the volume.
fn place_of_brick(number: u32) -> u32 {
    return places[bricks_of_buffer() * (EDGE * EDGE + 1u) + 1u + number];
}

// The row of an invocation. `classify.first_brick` is the first brick of the dispatch in the buffer.
fn row_of_voxel(index: u32) -> u32 {
    return classify.first_brick * EDGE * EDGE + index / EDGE;
}

// The voxel of an invocation.
fn brick_voxel(index: u32) -> BrickVoxel {
    let row = row_of_voxel(index);
    let bricks = (classify.dims + EDGE - 1u) / EDGE;
    let number = places[bricks_of_buffer() * EDGE * EDGE + 1u + row / (EDGE * EDGE)];
    let brick = vec3u(number % bricks.x, number / bricks.x % bricks.y, number / (bricks.x * bricks.y));
    let x = index % EDGE;
    return BrickVoxel(row, x, brick * EDGE + vec3u(x, row % EDGE, row / EDGE % EDGE));
}

// Whether the voxel at this place of a row is visible.
fn is_seen(row: u32, x: u32) -> bool {
    return ((seen[row] >> x) & 1u) != 0u;
}

// The number of a visible voxel.
fn number_of(row: u32, x: u32) -> u32 {
    return places[row] + countOneBits(seen[row] & ((1u << x) - 1u));
}

// The number of the sample of a voxel.
fn sample_of(row: u32, x: u32) -> u32 {
    return first_sample(row / (EDGE * EDGE), row % EDGE, row / EDGE % EDGE) + x;
}

// The words density_blue and color of a visible voxel.
fn appearance_of(voxel: BrickVoxel) -> vec2u {
    if APPEARANCES {
        let number = number_of(voxel.row, voxel.x);
        return vec2u(samples[2u * number], samples[2u * number + 1u]);
    }
    let found = classified(sample_of(voxel.row, voxel.x));
    return packed_appearance(found.rgb, found.w);
}
