// occluders_of_samples: the extinctions of visible voxels into a box of voxels that is 0 elsewhere. An invocation for
// each voxel of some bricks.
// uses: common/casting, common/dispatch, common/sampled

@group(0) @binding(3) var<uniform> light_box: LightBox;
@group(0) @binding(4) var<storage, read_write> field: array<f32>;

@compute @workgroup_size(WORKGROUP)
fn occluders(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if index >= classify.bricks * EDGE * EDGE * EDGE {
        return;
    }
    let voxel = brick_voxel(index);
    if !is_seen(voxel.row, voxel.x) {
        return;
    }
    let density = splat_density(appearance_of(sample_of(voxel.row, voxel.x)).x);
    field[index_in_box(voxel.point)] = occluder(density, voxel.point);
}
