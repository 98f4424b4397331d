// The volume of the painter `tiles`: two voxels to a texel, as f16 of (colour, 1) times density or of (gradient, scalar).
//
// A storage texture, for a load from a sampled one looks up its level for each invocation on software Vulkan.

@group(0) @binding(1) var volume: texture_storage_2d<rgba32uint, read>;

fn first_of(texel: vec4u) -> vec4f {
    return vec4f(unpack2x16float(texel.x), unpack2x16float(texel.y));
}

fn second_of(texel: vec4u) -> vec4f {
    return vec4f(unpack2x16float(texel.z), unpack2x16float(texel.w));
}
