// The rows of a texture in which the painter `tiles` keeps a volume on software (voxels/rows.wgsl). A texel holds two
// voxels of a row along a. The rows of a plane, one for each voxel along b, stand below one another; `columns` planes
// stand side by side and make a shelf; shelves stand below one another. MARGIN texels of zeros precede each row, one
// row of zeros precedes each shelf.

// Texels of zeros before each row. `eight` in gather.wgsl reads 7 texels from a place of which `texel_at` clamps the
// start: if a ray misses the row, all of them are zeros, before it or after it.
const MARGIN: i32 = 7;
// Voxels along the side of a macrocell: `skip` tests macrocells, and rays skip them as a whole.
const MACROCELL: i32 = 4;

struct Pack {
    // First lattice point of the packed box. Splats outside the box are skipped.
    low: vec3u,
    // The runs of splats of this dispatch: the first one, and their number (run_count).
    first_run: u32,
    // Numbers of the lattice axes of a, b and m: 0 x, 1 y, 2 z. In a box (voxels/box.wgsl) a is x, b is y and m is z.
    axes: vec3u,
    // Voxels along b.
    rows: u32,
    // Planes side by side.
    columns: u32,
    // Texels of a row of voxels, without the margin.
    row_texels: u32,
    // Texels of a row of the texture.
    width: u32,
    // The rows of the texture in the buffer: the first, and their number.
    first_row: u32,
    row_count: u32,
    // The factor of values that are stored as f16, to stay in the range of f16.
    scale: f32,
    run_count: u32,
    // Voxel planes.
    planes: u32,
    // Lattice point of the eye.
    eye: vec3f,
    // Voxels along a.
    across: u32,
    // View coordinates of a step along each axis of the lattice.
    view_x: vec3f,
    view_y: vec3f,
    view_z: vec3f,
}

// Rounded to the nearest number of 11 significant bits, which f16 holds exactly: some drivers truncate when they pack.
// An f32 has 24 significant bits: half of the lowest remaining bit is added, and the 13 bits below it are cleared.
fn rounded(v: vec4f) -> vec4f {
    return bitcast<vec4f>((bitcast<vec4u>(v) + 0x1000u) & vec4u(0xffffe000u));
}
