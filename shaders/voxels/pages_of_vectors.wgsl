// The volume of the painter `tiles`, if few pages of the box have voxels: see common/pages.wgsl. The two voxels
// of a pair are in one page.
// uses: common/pages, voxels/box, voxels/vector_pairs

@group(0) @binding(1) var volume: texture_3d<u32>;

fn voxels_at(texel: Texel) -> vec4u {
    let at = place_in_texture(place_of(texel, 0));
    return vec4u(textureLoad(volume, at, 0).xy, textureLoad(volume, at + vec3u(rays.along_a), 0).xy);
}

fn place_in_texture(place: vec3i) -> vec3u {
    return place_in_page(page_table[page_number(vec3u(place), rays.page_steps)], vec3u(place));
}
