// The format of a splat in `splats`. A scalar takes two words of 32 bits:
//
//     place               5 bits each of x, y and z in the brick, then 17 bits of the brick's number in the store
//     scalar              f32
//
// A scalar that is lit takes four:
//
//     place, scalar       the same
//     gradient            half the differences of its neighbours along the axes of the lattice, x lowest: 18 bits each
//                         with their sign; then the exponent of the largest in the form of f32, 2^16 steps. Exact to
//                         8e-6 of the largest. 0 if all neighbours are equal
//
// A classified voxel takes four:
//
//     place               the same
//     density_blue        the 8 high bits of blue, then 24 bits of density: an f32 without the last 8 bits of its
//                         fraction, so rounded to 1.5e-5 of itself. Density is extinction times the unit distance,
//                         -ln(1 - opacity): a pure number. The density of cells may be a little below 0
//     color               13 bits of red, then 14 of green, then the 5 low bits of blue
//     normal              the direction of the world gradient (see common/words.wgsl)
//
// If there are shadows or occlusion it takes two more:
//
//     kept                the shares of light that arrive, 16 bits each: of the first three lights, then of ambient
//                         light; 65535 is all of it
//
// `origins` are the lattice points at which the bricks of the store begin (xyz), 32^3 places each, and their level (w):
// a place is a cell of 2^level voxels a side, which represents them by one kernel in its middle.
// uses: common/words

// Splats are scalars, not classified voxels.
override SCALARS: bool = false;
// Splats of scalars have gradients.
override GRADIENTS: bool = false;

// Classified voxels have the words `kept`; scalars never have.
override SHADOWS: bool = false;

// The index of the first word of a splat.
fn splat_at(index: u32) -> u32 {
    if SCALARS && !GRADIENTS {
        return index;
    }
    return index * select(2u, 3u, SHADOWS && !SCALARS);
}

// The first two words of a splat.
fn splat_words(index: u32) -> vec2u {
    return splats[splat_at(index)];
}

// The shares of light that arrive at a classified voxel.
fn splat_kept(index: u32) -> vec4f {
    if !SHADOWS {
        return vec4f(1.0);
    }
    let words = splats[splat_at(index) + 2u];
    return vec4f(unpack2x16unorm(words.x), unpack2x16unorm(words.y));
}

// The gradient of a lit scalar.
fn splat_gradient(index: u32) -> vec3f {
    let words = splats[splat_at(index) + 1u];
    let low = bitcast<i32>(words.x);
    let high = bitcast<i32>(words.y);
    let y = (extractBits(high, 0u, 4u) << 14u) | i32(words.x >> 18u);
    let steps = vec3f(vec3i(extractBits(low, 0u, 18u), y, extractBits(high, 4u, 18u)));
    // The exponent alone, without a fraction, is the power of two.
    return steps * (bitcast<f32>((words.y >> 22u) << 23u) / 65536.0);
}

// The number of its brick in the store.
fn splat_brick(words: vec2u) -> u32 {
    return words.x >> 15u;
}

// Its lattice point, at level 0.
fn splat_point(words: vec2u) -> vec3u {
    let p = words.x;
    return origins[splat_brick(words)].xyz + vec3u(p & 31u, (p >> 5u) & 31u, (p >> 10u) & 31u);
}

// The middle of its kernel in lattice coordinates.
fn splat_lattice(words: vec2u) -> vec3f {
    let p = words.x;
    let brick = origins[splat_brick(words)];
    let point = brick.xyz + (vec3u(p & 31u, (p >> 5u) & 31u, (p >> 10u) & 31u) << vec3u(brick.w));
    return vec3f(point) + 0.5 * f32((1u << brick.w) - 1u);
}

// Its density, or its scalar.
fn splat_weight(words: vec2u) -> f32 {
    if SCALARS {
        return bitcast<f32>(words.y);
    }
    return splat_density(words.y);
}

// An entry of the sorted list is the index of a splat. Its top bit is set if the splat was terminated.
const TERMINATED: u32 = 0x80000000u;

fn is_terminated(entry: u32) -> bool {
    return (entry & TERMINATED) != 0u;
}
