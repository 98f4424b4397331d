// How a volume is packed for the painter `tiles`.

// Texels of zeros before each row of voxels.
const MARGIN: i32 = 7;
// Voxels along the side of the cells that are skipped where they are empty.
const CELL: i32 = 4;

struct Pack {
    // First lattice point of the box that is packed.
    low: vec3u,
    // The splats that are looked at, and the one after the last.
    first_splat: u32,
    // Numbers of the lattice axes that a, b and m run along.
    axes: vec3u,
    // Voxels along b.
    rows: u32,
    columns: u32,
    row_texels: u32,
    // Texels of a row of the texture.
    width: u32,
    // Rows of the texture in the buffer: the first, and how many.
    first_row: u32,
    row_count: u32,
    // What is f16 is multiplied by to stay in its range.
    scale: f32,
    end_splat: u32,
    // Voxel planes.
    planes: u32,
    // Lattice point of the eye, and view coordinates of a step along each axis of the lattice.
    eye: vec3f,
    view_x: vec3f,
    view_y: vec3f,
    view_z: vec3f,
}

// Rounded to 11 bits, which f16 holds exactly: some drivers cut off when they pack.
fn rounded(v: vec4f) -> vec4f {
    return bitcast<vec4f>((bitcast<vec4u>(v) + 0x1000u) & vec4u(0xffffe000u));
}
