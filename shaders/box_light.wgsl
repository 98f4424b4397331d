// box_light: the shares of light that arrive at the voxels of a box, as a texture for post-shading. `keep_in_box` sets
// the share of a light in two words of a voxel, in the form of splats; `texels` stores the shares of all lights.
// uses: common/dispatch, common/light_box, common/packing

@group(0) @binding(0) var<uniform> light_box: LightBox;
@group(0) @binding(1) var<storage, read_write> kept: array<vec2u>;
@group(0) @binding(2) var<storage, read> field: array<f32>;
// For each voxel of the box the light that arrives, 65535 for all of it.
@group(0) @binding(3) var<storage, read> shares: array<u32>;

@group(0) @binding(1) var<storage, read> found: array<vec2u>;
@group(0) @binding(2) var texture: texture_storage_3d<rgba16float, write>;

@compute @workgroup_size(WORKGROUP)
fn keep_in_box(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if index >= light_box.dims.x * light_box.dims.y * light_box.dims.z {
        return;
    }
    // All light arrives where there is no matter.
    let arrives = select(65535.0, f32(shares[index]), field[index] > 0.0);
    kept[index] = with_share(kept[index], arrives);
}

@compute @workgroup_size(4, 4, 4)
fn texels(@builtin(global_invocation_id) id: vec3u) {
    let size = textureDimensions(texture);
    if any(id >= size) {
        return;
    }
    // The box has voxels around those of the texture.
    let place = id + (light_box.dims - size) / 2u;
    let words = found[place.x + light_box.dims.x * (place.y + light_box.dims.y * place.z)];
    textureStore(texture, id, rounded(vec4f(unpack2x16unorm(words.x), unpack2x16unorm(words.y))));
}
