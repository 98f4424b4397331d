// A pair of scalars, each an f32, as voxels whose w it is.

fn first_of(texel: vec4u) -> vec4f {
    return vec4f(0.0, 0.0, 0.0, bitcast<f32>(texel.x));
}

fn second_of(texel: vec4u) -> vec4f {
    return vec4f(0.0, 0.0, 0.0, bitcast<f32>(texel.y));
}
