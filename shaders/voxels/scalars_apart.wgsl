// The volume of scalars of the painter `tiles` on GPUs: each texel holds a voxel, see vectors_apart.wgsl.
// uses: voxels/scalar_pairs

@group(0) @binding(1) var volume: texture_2d<u32>;

fn voxels_at(texel: vec2i) -> vec4u {
    let first = vec2i(2 * texel.x, texel.y);
    return vec4u(textureLoad(volume, first, 0).x, textureLoad(volume, first + vec2i(1, 0), 0).x, 0u, 0u);
}
