// The volume of the painter `tiles`.
// uses: voxels/box, voxels/vector_pairs

@group(0) @binding(1) var volume: texture_3d<u32>;

fn voxels_at(texel: Texel) -> vec4u {
    return vec4u(textureLoad(volume, place_of(texel, 0), 0).xy, textureLoad(volume, place_of(texel, 1), 0).xy);
}
