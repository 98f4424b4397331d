// lit_voxels: the voxels of a box, classified, thinned by gradient opacity and lit. An invocation each.
// uses: common/classified, common/dispatch, common/lit_splat, common/voxel_box

@group(0) @binding(3) var<uniform> lighting: Lighting;
// x fastest; 0 where nothing shows.
@group(0) @binding(4) var<storage, read_write> voxels: array<vec4f>;
@group(0) @binding(6) var<uniform> inside: VoxelBox;

@compute @workgroup_size(WORKGROUP)
fn lit_voxels(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    let row = brick_row(inside.first * EDGE * EDGE + index / EDGE);
    let x = index % EDGE;
    if row.brick >= inside.end || x >= row.count {
        return;
    }
    let point = row.point + vec3u(x, 0u, 0u);
    let place = place_in_box(point);
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
        color = lit_splat(color, pack_normal(normal(i).xyz), UNSHADED, at, to_eye_from_point(at));
    }
    store_voxel(place, color, density);
}
