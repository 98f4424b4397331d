// Directions in 32 bits: octahedral coordinates (Meyer et al. 2010, "On floating-point normal vectors"), 16 bits each.
// With a floor under gradients 12 bits each, the lower ones, and in the 8 high bits the weight of the surface: see
// common/floor.wgsl.

// The bits for "no direction": -32768 twice, which pack2x16snorm never makes (it clamps to -32767).
const NO_NORMAL: u32 = 0x80008000u;
// With a floor: the largest value of a coordinate, and of a weight.
const COORDINATE_STEPS: f32 = 2047.0;
const WEIGHT_STEPS: f32 = 255.0;

fn sign_or_one(v: vec2f) -> vec2f {
    return select(vec2f(-1.0), vec2f(1.0), v >= vec2f(0.0));
}

// The bits of the direction of a vector of any length, and of the weight of its surface.
fn pack_normal(v: vec3f, surface: f32) -> u32 {
    let sum = abs(v.x) + abs(v.y) + abs(v.z);
    if !(sum > 0.0) {
        // With a floor: a weight of 0.
        return select(NO_NORMAL, 0u, GRADIENT_FLOOR);
    }
    let p = v.xy / sum;
    let q = select((1.0 - abs(p.yx)) * sign_or_one(p), p, v.z >= 0.0);
    if GRADIENT_FLOOR {
        let steps = vec2i(round(clamp(q, vec2f(-1.0), vec2f(1.0)) * COORDINATE_STEPS));
        let weight = u32(round(surface * WEIGHT_STEPS));
        return (bitcast<u32>(steps.x) & 0xfffu) | ((bitcast<u32>(steps.y) & 0xfffu) << 12u) | (weight << 24u);
    }
    return pack2x16snorm(q);
}

// The direction, not of unit length, and the weight of the surface; 0 for "no direction".
fn unpack_normal(bits: u32) -> vec4f {
    if !GRADIENT_FLOOR && bits == NO_NORMAL {
        return vec4f(0.0);
    }
    var p = unpack2x16snorm(bits);
    var weight = 1.0;
    if GRADIENT_FLOOR {
        let steps = bitcast<vec2i>(vec2u(bits << 20u, bits << 8u)) >> vec2u(20u);
        p = vec2f(steps) / COORDINATE_STEPS;
        weight = f32(bits >> 24u) / WEIGHT_STEPS;
    }
    let z = 1.0 - abs(p.x) - abs(p.y);
    return vec4f(select((1.0 - abs(p.yx)) * sign_or_one(p), p, z >= 0.0), z, weight);
}
