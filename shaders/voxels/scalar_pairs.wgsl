// A texel of scalars holds two voxels, the scalar of each as f32. The scalar is returned as w.

fn first_of(texel: vec4u) -> vec4f {
    return vec4f(0.0, 0.0, 0.0, bitcast<f32>(texel.x));
}

fn second_of(texel: vec4u) -> vec4f {
    return vec4f(0.0, 0.0, 0.0, bitcast<f32>(texel.y));
}
