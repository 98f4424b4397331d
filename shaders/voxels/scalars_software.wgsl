// The volume of scalars of the painter `tiles` on software Vulkan. vectors.wgsl explains why it is a storage texture.
// uses: voxels/scalar_pairs

@group(0) @binding(1) var volume: texture_storage_2d<rg32uint, read>;

fn voxels_at(texel: vec2i) -> vec4u {
    return textureLoad(volume, texel);
}
