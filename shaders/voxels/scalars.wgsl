// The volume of the painter `tiles`: each texel holds two voxels, the scalar of each as f32. The scalar is returned as
// w.
//
// Direct3D 12 need not read storage textures of two channels, so this one is sampled.

@group(0) @binding(1) var volume: texture_2d<u32>;

fn voxels_at(texel: vec2i) -> vec4u {
    return textureLoad(volume, texel, 0);
}

fn first_of(texel: vec4u) -> vec4f {
    return vec4f(0.0, 0.0, 0.0, bitcast<f32>(texel.x));
}

fn second_of(texel: vec4u) -> vec4f {
    return vec4f(0.0, 0.0, 0.0, bitcast<f32>(texel.y));
}
