// The box of voxels on which light falls: visible ones, and those around them whose kernels absorb light too.

struct LightBox {
    // The lattice point of the first voxel: below 0 before the first face.
    low: vec3i,
    // The word that holds the share of a light, and the bit at which it begins.
    word: u32,
    dims: vec3u,
    shift: u32,
    // The middle of the whole lattice.
    middle: vec3f,
    // The factor of the shadows of a light.
    strength: f32,
    // Gradients of the linear functions that are 0 or more inside clipping planes, and their values in the middle.
    clip_planes: array<vec4f, 8>,
}

// The place of a lattice point of the box in arrays of its voxels, x fastest.
fn index_in_box(point: vec3u) -> u32 {
    let place = vec3u(vec3i(point) - light_box.low);
    return place.x + light_box.dims.x * (place.y + light_box.dims.y * place.z);
}

// The shares of all lights with the share of one, given the light that arrives, 65535 for all of it.
fn with_share(kept: vec2u, arrives: f32) -> vec2u {
    let share = u32(65535.5 - light_box.strength * (65535.0 - arrives)) << light_box.shift;
    let others = ~(0xffffu << light_box.shift);
    let is_first = light_box.word == 0u;
    return select(vec2u(kept.x, (kept.y & others) | share), vec2u((kept.x & others) | share, kept.y), is_first);
}
