// pack_scalars: samples into the box of scalars that the painter `tiles` marches through (see common/packing.wgsl),
// with copies of the outermost layers beyond the faces of the volume, and marks of cells near visible scalars. An
// invocation for each texel in the planes of the bricks that are bound.
// uses: common/dispatch, common/scalar_texels, common/scalars

// The voxel at a lattice point, or the one that a point beyond the faces copies.
fn nearest_voxel(point: vec3i) -> vec3i {
    return clamp(point, vec3i(0), vec3i(scalars.dims) - 1);
}

// Half the difference of the voxels `on` and `back` steps from sample number `i`.
fn difference(i: u32, on: i32, back: i32, step: u32) -> f32 {
    return 0.5 * scalar_at(u32(i32(i) + on * i32(step))) - 0.5 * scalar_at(u32(i32(i) + back * i32(step)));
}

@compute @workgroup_size(WORKGROUP)
fn texels(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    let of_plane = pack.across * pack.rows;
    if index >= of_plane * scalars.planes {
        return;
    }
    let place = vec3u(index % pack.across, index / pack.across % pack.rows, scalars.first_plane + index / of_plane);
    let wanted = vec3i(pack.low + place) - i32(scalars.padding);
    let point = nearest_voxel(wanted);
    let brick = brick_of(vec3u(point));
    if !is_bound(brick) {
        return;
    }
    let i = sample_number(brick, vec3u(point));
    let scalar = scalar_at(i);
    // Steps to the voxels on either side: 0 at a face.
    let back = nearest_voxel(wanted - 1) - point;
    if is_visible(scalar) {
        let in_brick = back.x == 0 || i32(u32(point.x) % EDGE + HALO) + back.x >= 0;
        let has_before = in_brick && marks_as_before(place);
        if !has_before || !is_visible(scalar_at(u32(i32(i) + select(0, back.x, has_before)))) {
            mark(place);
        }
    }
    if !GRADIENTS {
        store_scalar(place, vec3f(0.0), scalar);
        return;
    }
    let on = nearest_voxel(wanted + 1) - point;
    let edge = EDGE + 2u * HALO;
    let gradient = vec3f(
        difference(i, on.x, back.x, 1u),
        difference(i, on.y, back.y, edge),
        difference(i, on.z, back.z, edge * edge),
    );
    store_scalar(place, gradient, scalar);
}
