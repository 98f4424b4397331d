// The words of a classified voxel: its place, its appearance and its normal. See common/splat.wgsl.

// The first word of a splat.
fn splat_place(x: u32, y: u32, z: u32, brick: u32) -> u32 {
    return x | (y << 5u) | (z << 10u) | (brick << 15u);
}

// The largest values of red, green and blue: 13, 14 and 13 bits.
const COLOR_STEPS: vec3f = vec3f(8191.0, 16383.0, 8191.0);

// The words density_blue and color.
fn packed_appearance(color: vec3f, density: f32) -> vec2u {
    let c = vec3u(round(clamp(color, vec3f(0.0), vec3f(1.0)) * COLOR_STEPS));
    // To the nearest: half of the lowest remaining bit is added.
    let rounded = (bitcast<u32>(density) + 128u) & 0xffffff00u;
    return vec2u(rounded | (c.b >> 5u), c.r | (c.g << 13u) | (c.b << 27u));
}

// The density in the word density_blue.
fn splat_density(density_blue: u32) -> f32 {
    return bitcast<f32>(density_blue & 0xffffff00u);
}

fn splat_color(density_blue: u32, color: u32) -> vec3f {
    let blue = (color >> 27u) | ((density_blue & 0xffu) << 5u);
    return vec3f(vec3u(color & 0x1fffu, (color >> 13u) & 0x3fffu, blue)) / COLOR_STEPS;
}

// A direction has 32 bits: octahedral coordinates (Meyer et al. 2010, "On floating-point normal vectors"), 16 bits
// each.

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
