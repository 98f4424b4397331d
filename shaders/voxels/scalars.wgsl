// The volume of the painter `tiles`: two voxels to a texel, as f32 of the scalar. See vectors.wgsl.

@group(0) @binding(1) var volume: texture_storage_2d<rg32uint, read>;

fn first_of(texel: vec4u) -> vec4f {
    return vec4f(0.0, 0.0, 0.0, bitcast<f32>(texel.x));
}

fn second_of(texel: vec4u) -> vec4f {
    return vec4f(0.0, 0.0, 0.0, bitcast<f32>(texel.y));
}
