// The raster of the painter `tiles`, its volume, and the way from one to the other.
//
// The lattice is looked at along the axis m that the rays follow most; a and b are the other two, a the one that rays lean
// to less. Voxel planes are numbered front to back. Base coordinates are the (a, b) at which a ray meets plane 0; it meets
// plane k further on by k times `shear`.
struct Raster {
    // Base coordinates of raster point (0, 0), and the steps from there to its neighbours in x and y.
    origin: vec2f,
    step_x: vec2f,
    step_y: vec2f,
    shear: vec2f,
    // Unit vector of the rays in (a, b, m).
    direction: vec3f,
    // Optical depth per lattice length and stored density.
    density_scale: f32,
    // Voxels along a, b and m.
    voxels: vec3i,
    // Whether plane 0 is the last of the volume: 1 or 0.
    flipped: i32,
    // How far from a ray's place in a plane kernels reach it along a and b.
    half: vec2f,
    // Of a row of voxels, at distance v along b, kernels within row_half of row_slope v along a reach the ray.
    row_half: f32,
    row_slope: f32,
    // Footprint at squared half chord c2: sqrt(c2) times the polynomial in c2 of these eight coefficients.
    footprint: vec4f,
    footprint_high: vec4f,
    // Raster points.
    size: vec2u,
    // Tiles of 8 x 8 rays across and down, of each phase.
    tiles: vec2u,
    // Rays of a tile are so many raster points apart along x, a voxel; tiles of as many phases lie between each other.
    phases: u32,
    // Optical depth at which a ray counts as opaque.
    opaque_depth: f32,
    // Columns of planes in the volume's texture, and texels of a row of voxels: two voxels each.
    columns: i32,
    row_texels: i32,
    // Places for the runs of a tile.
    run_slots: u32,
    // Square of the kernel's radius.
    radius2: f32,
    // Part of a kernel in the slab of the plane n - 2 planes behind its own: footprint times (x + y s), s the place of its
    // centre along the ray from where the ray meets its plane.
    section_0: vec2f,
    section_1: vec2f,
    section_2: vec2f,
    section_3: vec2f,
    section_4: vec2f,
    // Raster coordinates of the middle of the picture's first pixel, and the steps to its neighbours in x and y.
    pixel_origin: vec2f,
    pixel_x: vec2f,
    pixel_y: vec2f,
    // Pixels.
    picture: vec2u,
}

// Tiles in a row of the texture of runs.
const RUN_ROW: u32 = 4096u;

// Where the runs of a tile are kept.
fn runs_of(tile: vec3u, slot: u32) -> vec2u {
    let index = (tile.z * raster.tiles.y + tile.y) * raster.tiles.x + tile.x;
    return vec2u(index % RUN_ROW, index / RUN_ROW * raster.run_slots + slot);
}

// The first ray of a tile.
fn first_ray(tile: vec3u) -> vec2u {
    return vec2u(tile.x * 8u * raster.phases + tile.z, tile.y * 8u);
}

fn base_of(ray: vec2u) -> vec2f {
    return raster.origin + f32(ray.x) * raster.step_x + f32(ray.y) * raster.step_y;
}
