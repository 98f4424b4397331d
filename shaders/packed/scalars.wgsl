// Where `pack` stores unlit scalars: the texture itself, see voxels/box.wgsl.

@group(0) @binding(4) var volume: texture_storage_3d<r32uint, write>;

fn store(place: vec3u, words: vec2u) {
    textureStore(volume, place, vec4u(words.x, 0u, 0u, 0u));
}
