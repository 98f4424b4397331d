// The volume of scalars of the painter `tiles` on software Vulkan: each texel holds two voxels, the scalar of each as
// f32. vectors.wgsl explains why it is a storage texture.
// uses: voxels/rows, voxels/scalar_pairs

@group(0) @binding(1) var volume: texture_storage_2d<rg32uint, read>;

fn voxels_at(texel: Texel) -> vec4u {
    return textureLoad(volume, texel);
}
