// The volume of the painter `tiles` on software Vulkan: each texel holds two voxels. It is a storage texture because
// software looks up the level of a sampled texture in every invocation.
// uses: voxels/rows, voxels/vector_pairs

@group(0) @binding(1) var volume: texture_storage_2d<rgba32uint, read>;

fn voxels_at(texel: Texel) -> vec4u {
    return textureLoad(volume, texel);
}
