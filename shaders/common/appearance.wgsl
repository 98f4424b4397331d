// The words of a classified voxel: its place and its appearance. See common/splat.wgsl.

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
