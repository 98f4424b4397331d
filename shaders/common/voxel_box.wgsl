// A box of voxels that become cells, see coarsen.wgsl. A voxel is its colour times its density, and its density. The
// stage binds `inside` and `voxels`.
// uses: common/lit_splat

// Rays go through one eye.
override PERSPECTIVE: bool = false;

struct VoxelBox {
    // Lattice point of the first voxel: below 0 before the first face.
    low: vec3i,
    // The bricks or splats that the box may reach, from this one to before the last.
    first: u32,
    // Voxels along each axis.
    dims: vec3u,
    end: u32,
    // Lattice point of the eye, and view coordinates of a step along each axis of the lattice.
    eye: vec3f,
    view_x: vec3f,
    view_y: vec3f,
    view_z: vec3f,
}

// The unit vector from a lattice point to the eye, in view coordinates.
fn to_eye_from_point(point: vec3f) -> vec3f {
    if !PERSPECTIVE {
        return vec3f(0.0, 0.0, -1.0);
    }
    return towards_eye(point - inside.eye, inside.view_x, inside.view_y, inside.view_z);
}

// The place of a lattice point in the box: at least `dims` outside.
fn place_in_box(point: vec3u) -> vec3u {
    // A place before the box wraps around to a large number.
    return vec3u(vec3i(point) - inside.low);
}

// Stores a voxel at a place in the box.
fn store_voxel(place: vec3u, color: vec3f, density: f32) {
    voxels[place.x + inside.dims.x * (place.y + inside.dims.y * place.z)] = vec4f(color * density, density);
}
