// The pages of 4^3 voxels of a box that have splats (src/painters/tiles/pack/pages.rs). A table has a word for each
// page of the box: its place among the pages of the texture, 10 bits along each axis. Pages without splats share
// place 0, where all is 0.

// Voxels along a page, as a power of 2.
const PAGE_BITS: u32 = 2u;

// The word of a page, given its place among the pages of the texture.
fn page_word(place: vec3u) -> u32 {
    return place.x | place.y << 10u | place.z << 20u;
}

// The place in the texture of a place of the box, whose page has this word.
fn place_in_page(word: u32, place: vec3u) -> vec3u {
    let page = vec3u(word & 0x3ffu, word >> 10u & 0x3ffu, word >> 20u);
    return (page << vec3u(PAGE_BITS)) | (place & vec3u((1u << PAGE_BITS) - 1u));
}

// The number of the page of a place of the box in the table, which has these steps between pages.
fn page_number(place: vec3u, steps: vec3u) -> u32 {
    return dot(place >> vec3u(PAGE_BITS), steps);
}
