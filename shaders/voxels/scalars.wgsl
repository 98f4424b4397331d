// The volume of scalars of the painter `tiles` on GPUs. Some devices cannot read storage textures of two channels
// (Direct3D 12), so the texture is sampled.
// uses: voxels/scalar_pairs

@group(0) @binding(1) var volume: texture_2d<u32>;

fn voxels_at(texel: vec2i) -> vec4u {
    return textureLoad(volume, texel, 0);
}
