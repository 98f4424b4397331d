// occluders: the extinctions of splats into a box of voxels that is 0 elsewhere. An invocation a splat.
// uses: common/casting, common/dispatch, common/splat

@group(0) @binding(0) var<uniform> light_box: LightBox;
@group(0) @binding(1) var<storage, read> splats: array<vec2u>;
@group(0) @binding(2) var<storage, read> origins: array<vec4u>;
@group(0) @binding(3) var<storage, read_write> field: array<f32>;

@compute @workgroup_size(WORKGROUP)
fn occluders(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if index >= light_box.count {
        return;
    }
    let words = splat_words(index);
    let point = splat_point(words);
    field[index_in_box(point)] = occluder(splat_weight(words), point);
}
