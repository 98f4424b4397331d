// lit_voxels: the voxels of a box of the lattice for the cells of a level (coarsen.wgsl): classified, thinned by gradient
// opacity and lit. A voxel is its colour times its density, and its density. An invocation each.
// uses: common/classified, common/dispatch, common/lit_splat

// Rays go through one eye.
override PERSPECTIVE: bool = false;

struct VoxelBox {
    // Lattice point of the first voxel: below 0 before the first face.
    low: vec3i,
    // The bricks of the batch that the box may reach, from this one to before the last.
    first_brick: u32,
    // Voxels along each axis.
    dims: vec3u,
    end_brick: u32,
    // Lattice point of the eye, and view coordinates of a step along each axis of the lattice.
    eye: vec3f,
    view_x: vec3f,
    view_y: vec3f,
    view_z: vec3f,
}

@group(0) @binding(3) var<uniform> lighting: Lighting;
// x fastest; 0 where nothing shows.
@group(0) @binding(4) var<storage, read_write> voxels: array<vec4f>;
@group(0) @binding(6) var<uniform> inside: VoxelBox;

// The unit vector from a lattice point to the eye, in view coordinates.
fn towards_eye(point: vec3f) -> vec3f {
    if !PERSPECTIVE {
        return vec3f(0.0, 0.0, -1.0);
    }
    let offset = point - inside.eye;
    return -normalize(inside.view_x * offset.x + inside.view_y * offset.y + inside.view_z * offset.z);
}

@compute @workgroup_size(WORKGROUP)
fn lit_voxels(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    let row = brick_row(inside.first_brick * EDGE * EDGE + index / EDGE);
    let x = index % EDGE;
    if row.brick >= inside.end_brick || x >= row.count {
        return;
    }
    let point = row.point + vec3u(x, 0u, 0u);
    // A place before the box wraps around to a large number.
    let place = vec3u(vec3i(point) - inside.low);
    if any(place >= inside.dims) {
        return;
    }
    let i = row.first + x;
    let classified = transfer(i);
    if classified.a <= 0.0 {
        return;
    }
    var density = density(classified.a);
    if GRADIENT_OPACITY {
        density *= gradient_share(gradient(i));
    }
    var color = classified.rgb;
    if LIGHTS > 0u {
        let at = vec3f(point);
        color = lit_splat(color, pack_normal(normal(i).xyz), UNSHADED, at, towards_eye(at));
    }
    voxels[place.x + inside.dims.x * (place.y + inside.dims.y * place.z)] = vec4f(color * density, density);
}
