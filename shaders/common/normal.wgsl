// Directions in 32 bits: octahedral coordinates (Meyer et al. 2010, "On floating-point normal vectors"), 16 bits each.

// The bits for "no direction": -32768 twice, which pack2x16snorm never makes (it clamps to -32767).
const NO_NORMAL: u32 = 0x80008000u;

fn sign_or_one(v: vec2f) -> vec2f {
    return select(vec2f(-1.0), vec2f(1.0), v >= vec2f(0.0));
}

// The bits of the direction of a vector of any length.
fn pack_normal(v: vec3f) -> u32 {
    let sum = abs(v.x) + abs(v.y) + abs(v.z);
    if !(sum > 0.0) {
        return NO_NORMAL;
    }
    let p = v.xy / sum;
    let q = select((1.0 - abs(p.yx)) * sign_or_one(p), p, v.z >= 0.0);
    return pack2x16snorm(q);
}

// The direction, not of unit length; 0 for "no direction".
fn unpack_normal(bits: u32) -> vec3f {
    if bits == NO_NORMAL {
        return vec3f(0.0);
    }
    let p = unpack2x16snorm(bits);
    let z = 1.0 - abs(p.x) - abs(p.y);
    return vec3f(select((1.0 - abs(p.yx)) * sign_or_one(p), p, z >= 0.0), z);
}
