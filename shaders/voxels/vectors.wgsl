// The volume of the painter `tiles`: each texel holds two voxels, as four f16: (colour, 1) times density, or (gradient,
// scalar).
//
// It is a storage texture because software Vulkan looks up the level of a sampled texture in every invocation.

@group(0) @binding(1) var volume: texture_storage_2d<rgba32uint, read>;

fn voxels_at(texel: vec2i) -> vec4u {
    return textureLoad(volume, texel);
}

fn first_of(texel: vec4u) -> vec4f {
    return vec4f(unpack2x16float(texel.x), unpack2x16float(texel.y));
}

fn second_of(texel: vec4u) -> vec4f {
    return vec4f(unpack2x16float(texel.z), unpack2x16float(texel.w));
}
