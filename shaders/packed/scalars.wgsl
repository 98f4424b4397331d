// Where `pack` stores unlit scalars on GPUs: the texture itself.

@group(0) @binding(4) var volume: texture_storage_2d<r32uint, write>;

fn is_stored(row: u32) -> bool {
    return true;
}

fn store(place: u32, row: u32, words: vec2u) {
    textureStore(volume, vec2u(place, row), vec4u(words.x, 0u, 0u, 0u));
}
