// A pair of voxels, each four f16: (colour, 1) times density, or (gradient, scalar).

fn first_of(texel: vec4u) -> vec4f {
    return vec4f(unpack2x16float(texel.x), unpack2x16float(texel.y));
}

fn second_of(texel: vec4u) -> vec4f {
    return vec4f(unpack2x16float(texel.z), unpack2x16float(texel.w));
}
