// lit_splats: the voxels of a box that are in shadows, from their splats, which hold the light that arrives. An
// invocation each.
// uses: common/dispatch, common/lit_splat, common/splat, common/voxel_box

@group(0) @binding(0) var<uniform> inside: VoxelBox;
@group(0) @binding(1) var<uniform> lighting: Lighting;
@group(0) @binding(2) var<storage, read> splats: array<vec2u>;
@group(0) @binding(3) var<storage, read> origins: array<vec4u>;
// Colour times density, and density; x fastest; 0 where nothing shows.
@group(0) @binding(4) var<storage, read_write> voxels: array<vec4f>;

@compute @workgroup_size(WORKGROUP)
fn lit_splats(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = inside.first + invocation_index(id, groups);
    if index >= inside.end {
        return;
    }
    let words = splat_words(index);
    // A place before the box wraps around to a large number.
    let place = splat_point(words) - inside.low;
    if any(place >= inside.dims) {
        return;
    }
    let appearance = splats[splat_at(index) + 1u];
    let at = splat_lattice(words);
    let color = splat_color(words.y, appearance.x);
    let lit = lit_splat(color, appearance.y, splat_kept(index), at, to_eye_from_point(at));
    let density = splat_weight(words);
    voxels[place.x + inside.dims.x * (place.y + inside.dims.y * place.z)] = vec4f(lit * density, density);
}
