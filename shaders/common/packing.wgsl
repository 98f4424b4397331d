// The box of voxels that the painter `tiles` marches through (common/box.wgsl), and the marks of its cells.

// Voxels along the side of a macrocell, which has 2^3 cells. Macrocells are numbered in the whole lattice, whatever
// part of it is packed. A buffer has a byte of marks for each, four to a word, the first one the lowest: cell number c
// is marked by bit c. Bit 0 of c is the place of the cell along x, bit 1 along y and bit 2 along z. A cell is marked if
// it has a splat; of scalars, if the kernel of a visible scalar may reach a slab at one of its voxels.
const MACROCELL: i32 = 4;
const CELL: i32 = 2;

struct Pack {
    // First lattice point of the packed box. Splats outside the box are skipped.
    low: vec3u,
    // The runs of splats of this dispatch: the first one, and their number (run_count).
    first_run: u32,
    // Lattice point of the eye.
    eye: vec3f,
    // Voxels along x, and along y.
    across: u32,
    rows: u32,
    // The factor of values that are stored as f16, to stay in the range of f16.
    scale: f32,
    run_count: u32,
    // Voxels along z.
    planes: u32,
    // View coordinates of a step along each axis of the lattice.
    view_x: vec3f,
    // Voxels along each axis within which a splat marks cells.
    mark_reach: u32,
    view_y: vec3f,
    // Scalars from the least to the largest are invisible however kernels add them up, and mark nothing; none if the
    // least is larger.
    least_invisible: f32,
    view_z: vec3f,
    largest_invisible: f32,
    // Voxels along a, b and m from the first voxel of the first macrocell to the first of the box.
    mark_shift: vec3u,
    // Macrocells in the buffer of marks from one along a, b and m to the next.
    mark_steps: vec3u,
    // Steps along x, y and z in the table of pages: see common/pages.wgsl.
    page_steps: vec3u,
    // Whether voxels that do not show are stored too, over those of another volume.
    clears: u32,
}

// Rounded to the nearest number of 11 significant bits, which f16 holds exactly: some drivers truncate when they pack.
// An f32 has 24 significant bits: half of the lowest remaining bit is added, and the 13 bits below it are cleared.
fn rounded(v: vec4f) -> vec4f {
    return bitcast<vec4f>((bitcast<vec4u>(v) + 0x1000u) & vec4u(0xffffe000u));
}
