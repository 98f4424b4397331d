// pack_scalars: samples into the box of scalars that the painter `tiles` marches through (see common/packing.wgsl),
// with copies of the outermost layers beyond the faces of the volume, and marks of cells near visible scalars. An
// invocation for each texel in the planes of the bricks that are bound.
// uses: common/dispatch, common/marking, common/packing, common/samples

// Texels have gradients; bricks are then stored with a layer of voxels around.
override GRADIENTS: bool = false;

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
@group(0) @binding(2) var<uniform> pack: Pack;

fn scalar_at(i: u32) -> f32 {
    let difference = sample_at(i) - scalars.origin - scalars.rest;
    return clamp(difference, -scalars.most, scalars.most) * scalars.factor;
}

// Whether a scalar marks cells.
fn is_visible(scalar: f32) -> bool {
    return scalar < pack.least_invisible || scalar > pack.largest_invisible;
}

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
    let brick = vec3u(point) / EDGE;
    let bricks = (scalars.dims + EDGE - 1u) / EDGE;
    let number = brick.x + bricks.x * (brick.y + bricks.y * brick.z);
    if number < scalars.first_brick || number >= scalars.end_brick {
        return;
    }
    let halo = u32(GRADIENTS);
    let edge = EDGE + 2u * halo;
    let inside = vec3u(point) % EDGE + halo;
    let i = (((number - scalars.first_brick) * edge + inside.z) * edge + inside.y) * edge + inside.x;
    let scalar = scalar_at(i);
    // Steps to the voxels on either side: 0 at a face.
    let back = nearest_voxel(wanted - 1) - point;
    if is_visible(scalar) {
        // The voxel before it in the row may mark the same cells: atomics are slow.
        let before = place - vec3u(1u, 0u, 0u);
        let has_before = place.x > 0u && (back.x == 0 || i32(inside.x) + back.x >= 0)
            && all(first_marked(before) == first_marked(place)) && all(last_marked(before) == last_marked(place));
        if !has_before || !is_visible(scalar_at(u32(i32(i) + select(0, back.x, has_before)))) {
            mark(place);
        }
    }
    if !GRADIENTS {
        store(place, vec2u(bitcast<u32>(scalar), 0u));
        return;
    }
    let on = nearest_voxel(wanted + 1) - point;
    let gradient = vec3f(
        difference(i, on.x, back.x, 1u),
        difference(i, on.y, back.y, edge),
        difference(i, on.z, back.z, edge * edge),
    );
    let v = rounded(vec4f(gradient, scalar) * pack.scale);
    store(place, vec2u(pack2x16float(v.xy), pack2x16float(v.zw)));
}
