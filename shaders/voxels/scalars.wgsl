// The volume of the painter `tiles`: each texel holds two voxels, the scalar of each as f32. The scalar is returned as
// w. vectors.wgsl says why it is a storage texture.

@group(0) @binding(1) var volume: texture_storage_2d<rg32uint, read>;

fn first_of(texel: vec4u) -> vec4f {
    return vec4f(0.0, 0.0, 0.0, bitcast<f32>(texel.x));
}

fn second_of(texel: vec4u) -> vec4f {
    return vec4f(0.0, 0.0, 0.0, bitcast<f32>(texel.y));
}
