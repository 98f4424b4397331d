// pack_scalars: samples into the box of scalars that the painter `tiles` marches through (see common/packing.wgsl),
// with copies of the outermost layers beyond the faces of the volume, and marks of cells near visible scalars. An
// invocation for each texel in the planes of the bricks that are bound.
// uses: common/dispatch, common/scalar_texels, common/scalars

// The voxel at a lattice point, or the one that a point beyond the faces copies.
fn nearest_voxel(point: vec3i) -> vec3i {
    return clamp(point, vec3i(0), vec3i(scalars.dims) - 1);
}

// Half the difference of the voxels `on` and `back` numbers from sample number `i`.
fn half_difference(i: i32, on: i32, back: i32) -> f32 {
    return 0.5 * scalar_at(u32(i + on)) - 0.5 * scalar_at(u32(i + back));
}

// The slope at sample number `i` along an axis, with the slopes to either side along another. The voxels to either side
// lie these numbers on and back: 0 at a face.
fn line(i: i32, own: vec2i, across: vec2i) -> f32 {
    let sides = half_difference(i + across.x, own.x, own.y) + half_difference(i + across.y, own.x, own.y);
    return half_difference(i, own.x, own.y) + 0.25 * sides;
}

// A component of a gradient: slopes, smoothed along the other two axes by 1, 4, 1 over 6; see src/kernel/derivative.rs.
fn component(i: i32, own: vec2i, across: vec2i, down: vec2i) -> f32 {
    let sides = line(i + down.x, own, across) + line(i + down.y, own, across);
    return 4.0 / 9.0 * (line(i, own, across) + 0.25 * sides);
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
    let edge = i32(EDGE + 2u * HALO);
    let x = vec2i(on.x, back.x);
    let y = vec2i(on.y, back.y) * edge;
    let z = vec2i(on.z, back.z) * edge * edge;
    let own = i32(i);
    let gradient = vec3f(component(own, x, y, z), component(own, y, z, x), component(own, z, x, y));
    store_scalar(place, gradient, scalar);
}
