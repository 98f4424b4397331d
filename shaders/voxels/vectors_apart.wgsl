// The volume of the painter `tiles` on GPUs: each texel holds a voxel, so that the stage `pack` can store voxel after
// voxel. Some devices cannot read storage textures of one or two channels (Direct3D 12), so the texture is sampled.
// uses: voxels/vector_pairs

@group(0) @binding(1) var volume: texture_2d<u32>;

fn voxels_at(texel: vec2i) -> vec4u {
    let first = vec2i(2 * texel.x, texel.y);
    return vec4u(textureLoad(volume, first, 0).xy, textureLoad(volume, first + vec2i(1, 0), 0).xy);
}
