// Where `pack` stores classified voxels and lit scalars if few pages of the box have voxels: see
// common/pages.wgsl.
// uses: common/pages

@group(0) @binding(4) var volume: texture_storage_3d<rg32uint, write>;

fn store(place: vec3u, words: vec2u) {
    let at = place_in_page(page_table[page_number(place, pack.page_steps)], place);
    textureStore(volume, at, vec4u(words, 0u, 0u));
}
