// The scalars of post-shading, of the samples of bricks.
// uses: common/samples

// Layers of voxels around a brick.
override HALO: u32 = 0u;

struct Scalars {
    // Voxels of the volume along each axis.
    dims: vec3u,
    // Layers of copies beyond each face.
    padding: u32,
    // A scalar is the sample less `origin` and `rest`, times `factor`: `origin` is a number that samples near the base
    // are subtracted from without rounding.
    origin: f32,
    rest: f32,
    factor: f32,
    // The bricks whose samples are bound: the first, and the one after the last.
    first_brick: u32,
    end_brick: u32,
    // The planes of the box that they reach: the first, and their number.
    first_plane: u32,
    planes: u32,
    // The largest difference from the base: its scalar is Reduction::LIMIT of the host.
    most: f32,
}

@group(0) @binding(0) var<uniform> scalars: Scalars;

// The scalar of sample number `i` of the bricks that are bound.
fn scalar_at(i: u32) -> f32 {
    let difference = sample_at(i) - scalars.origin - scalars.rest;
    return clamp(difference, -scalars.most, scalars.most) * scalars.factor;
}

// The number of the brick of a voxel.
fn brick_of(voxel: vec3u) -> u32 {
    let brick = voxel / EDGE;
    let bricks = (scalars.dims + EDGE - 1u) / EDGE;
    return brick.x + bricks.x * (brick.y + bricks.y * brick.z);
}

// Whether the samples of a brick are bound.
fn is_bound(brick: u32) -> bool {
    return brick >= scalars.first_brick && brick < scalars.end_brick;
}

// The number of the sample of a voxel in a brick whose samples are bound.
fn sample_number(brick: u32, voxel: vec3u) -> u32 {
    let edge = EDGE + 2u * HALO;
    let inside = voxel % EDGE + HALO;
    return (((brick - scalars.first_brick) * edge + inside.z) * edge + inside.y) * edge + inside.x;
}
