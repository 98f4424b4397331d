// kept: the shares of light that arrive at splats, in their last two words. `copy` makes splats with these words of
// splats with or without them, `keep` sets the share of a light. An invocation a splat.
// uses: common/dispatch, common/light_box, common/splat

@group(0) @binding(0) var<uniform> light_box: LightBox;
@group(0) @binding(1) var<storage, read_write> splats: array<vec2u>;
// Splats before they are lit.
@group(0) @binding(2) var<storage, read> unlit: array<vec2u>;
@group(0) @binding(2) var<storage, read> origins: array<vec4u>;
// For each voxel of the box the light that arrives, 65535 for all of it.
@group(0) @binding(3) var<storage, read> shares: array<u32>;

@compute @workgroup_size(WORKGROUP)
fn copy(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if index >= light_box.count {
        return;
    }
    let first = index * light_box.each;
    let at = splat_at(index);
    splats[at] = unlit[first];
    splats[at + 1u] = unlit[first + 1u];
    let is_lit = light_box.each > 2u;
    splats[at + 2u] = select(vec2u(0xffffffffu), unlit[first + select(1u, 2u, is_lit)], is_lit);
}

@compute @workgroup_size(WORKGROUP)
fn keep(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if index >= light_box.count {
        return;
    }
    let arrives = f32(shares[index_in_box(splat_point(splat_words(index)))]);
    let at = splat_at(index) + 2u;
    splats[at] = with_share(splats[at], arrives);
}
