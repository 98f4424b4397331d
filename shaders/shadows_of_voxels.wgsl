// shadows_of_voxels: what shadows write and read for visible voxels. `occluders` stores extinctions into a box of
// voxels that is 0 elsewhere, `keep` sets the share of a light that arrives in two words for each voxel. An invocation
// for each voxel of some bricks.
// uses: common/casting, common/dispatch, common/sampled

@group(0) @binding(3) var<uniform> light_box: LightBox;
@group(0) @binding(4) var<storage, read_write> field: array<f32>;
@group(0) @binding(4) var<storage, read_write> kept: array<vec2u>;
// For each voxel of the box the light that arrives, 65535 for all of it.
@group(0) @binding(7) var<storage, read> shares: array<u32>;

// Whether an invocation has a visible voxel.
fn has_voxel(index: u32) -> bool {
    return index < classify.bricks * EDGE * EDGE * EDGE && is_seen(row_of_voxel(index), index % EDGE);
}

@compute @workgroup_size(WORKGROUP)
fn occluders(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if !has_voxel(index) {
        return;
    }
    let voxel = brick_voxel(index);
    let density = splat_density(appearance_of(voxel).x);
    field[index_in_box(voxel.point)] = occluder(density, voxel.point);
}

@compute @workgroup_size(WORKGROUP)
fn keep(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if !has_voxel(index) {
        return;
    }
    let voxel = brick_voxel(index);
    let number = number_of(voxel.row, voxel.x);
    kept[number] = with_share(kept[number], f32(shares[index_in_box(voxel.point)]));
}
