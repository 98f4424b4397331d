// A box of voxels that become cells. The stage binds `inside`.
// uses: common/lit_splat

// Rays go through one eye.
override PERSPECTIVE: bool = false;

struct VoxelBox {
    // Lattice point of the first voxel.
    low: vec3u,
    // The bricks of the volume that the bound samples serve, from this one to before the last.
    first: u32,
    // Voxels along each axis.
    dims: vec3u,
    end: u32,
    // Lattice point of the eye, and view coordinates of a step along each axis of the lattice.
    eye: vec3f,
    // Cells along x.
    cells: u32,
    view_x: vec3f,
    // The first place along x with a weight in the first cell: below 0 before the first face.
    first_x: i32,
    view_y: vec3f,
    // Voxels along a cell, as a fraction in lowest terms.
    over: u32,
    view_z: vec3f,
    under: u32,
    // Cells along y, and the same first place.
    rows: u32,
    first_y: i32,
    // The number of the first of these planes of voxels among those of the cells.
    first_plane: u32,
}

// The unit vector from a lattice point to the eye, in view coordinates.
fn to_eye_from_point(point: vec3f) -> vec3f {
    if !PERSPECTIVE {
        return vec3f(0.0, 0.0, -1.0);
    }
    return towards_eye(point - inside.eye, inside.view_x, inside.view_y, inside.view_z);
}
