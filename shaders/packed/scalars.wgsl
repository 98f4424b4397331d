// Where `pack` stores unlit scalars: see common/box.wgsl. The stage has `stored_place`.

@group(0) @binding(4) var volume: texture_storage_3d<r32uint, write>;

fn store(place: vec3u, words: vec2u) {
    textureStore(volume, stored_place(place), vec4u(words.x, 0u, 0u, 0u));
}
