// occluders: the extinctions of splats into a box of voxels that is 0 elsewhere. An invocation a splat.
// uses: common/dispatch, common/light_box, common/splat

@group(0) @binding(0) var<uniform> light_box: LightBox;
@group(0) @binding(1) var<storage, read> splats: array<vec2u>;
@group(0) @binding(2) var<storage, read> origins: array<vec4u>;
@group(0) @binding(3) var<storage, read_write> field: array<f32>;

// The extinction of an occluder that is lit but casts no shadow.
const CLIPPED: f32 = 1e-30;

// Whether a voxel is inside all clipping planes: clipped matter casts no shadows.
fn casts(point: vec3u) -> bool {
    let from_middle = vec4f(vec3f(point) - light_box.middle, 1.0);
    var inside = true;
    for (var plane = 0u; plane < 8u; plane++) {
        inside = inside && dot(light_box.clip_planes[plane], from_middle) >= 0.0;
    }
    return inside;
}

@compute @workgroup_size(WORKGROUP)
fn occluders(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if index >= light_box.count {
        return;
    }
    let words = splat_words(index);
    let point = splat_point(words);
    field[index_in_box(point)] = select(CLIPPED, max(splat_weight(words), CLIPPED), casts(point));
}
