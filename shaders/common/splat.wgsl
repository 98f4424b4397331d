// A splat as it is stored, in `splats`: 16 bytes where it is classified, 8 where it is a scalar. `origins` are the lattice
// points at which bricks of 32^3 voxels begin.
//
//     place               5 bits each of x, y and z in the brick, 17 bits of its number
//     scalar              f32
// or
//     density_blue        24 bits of density (an f32 without its sign and the last 7 bits of its fraction: to 8e-6 of
//                         itself), the 8 high ones of blue. Extinction times unit distance, -ln(1 - opacity), is a pure
//                         number, whatever the unit of length
//     color               13 bits of red, 14 of green, the 5 low ones of blue
//     normal              packed; see common/normal.wgsl

// Splats are scalars.
override SCALARS: bool = false;

fn splat_place(x: u32, y: u32, z: u32, brick: u32) -> u32 {
    return x | (y << 5u) | (z << 10u) | (brick << 15u);
}

fn splat_words(index: u32) -> vec2u {
    return splats[select(2u * index, index, SCALARS)];
}

// The number of its brick.
fn splat_brick(words: vec2u) -> u32 {
    return words.x >> 15u;
}

// Its lattice point.
fn splat_point(words: vec2u) -> vec3u {
    let p = words.x;
    return origins[splat_brick(words)].xyz + vec3u(p & 31u, (p >> 5u) & 31u, (p >> 10u) & 31u);
}

fn splat_lattice(words: vec2u) -> vec3f {
    return vec3f(splat_point(words));
}

// Density, or scalar.
fn splat_weight(words: vec2u) -> f32 {
    return bitcast<f32>(select((words.y >> 8u) << 7u, words.y, SCALARS));
}

const COLOR_STEPS: vec3f = vec3f(8191.0, 16383.0, 8191.0);

// density_blue and color.
fn packed_looks(color: vec3f, density: f32) -> vec2u {
    let c = vec3u(round(clamp(color, vec3f(0.0), vec3f(1.0)) * COLOR_STEPS));
    let rounded = (bitcast<u32>(density) + 64u) >> 7u;
    return vec2u((rounded << 8u) | (c.b >> 5u), c.r | (c.g << 13u) | (c.b << 27u));
}

fn splat_color(density_blue: u32, color: u32) -> vec3f {
    let blue = (color >> 27u) | ((density_blue & 0xffu) << 5u);
    return vec3f(vec3u(color & 0x1fffu, (color >> 13u) & 0x3fffu, blue)) / COLOR_STEPS;
}

// An entry of the sorted list is the index of a splat; its top bit tells that the splat was terminated.
const TERMINATED: u32 = 0x80000000u;

fn is_terminated(entry: u32) -> bool {
    return (entry & TERMINATED) != 0u;
}
