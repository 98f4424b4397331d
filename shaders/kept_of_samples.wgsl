// kept_of_samples: the share of a light that arrives at visible voxels, in two words for each. An invocation for each
// voxel of some bricks.
// uses: common/dispatch, common/light_box, common/sampled

@group(0) @binding(3) var<uniform> light_box: LightBox;
@group(0) @binding(4) var<storage, read_write> kept: array<vec2u>;
// For each voxel of the box the light that arrives, 65535 for all of it.
@group(0) @binding(7) var<storage, read> shares: array<u32>;

@compute @workgroup_size(WORKGROUP)
fn keep(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if index >= classify.bricks * EDGE * EDGE * EDGE {
        return;
    }
    let voxel = brick_voxel(index);
    if !is_seen(voxel.row, voxel.x) {
        return;
    }
    let number = number_of(voxel.row, voxel.x);
    kept[number] = with_share(kept[number], f32(shares[index_in_box(voxel.point)]));
}
