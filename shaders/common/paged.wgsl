// Where a stage stores a voxel in the texture of a box. The stage declares `page_table`, and `pack`, its parameters.
// uses: common/packing, common/pages

// The texture has the pages of the box that have voxels.
override PAGED: bool = false;

fn stored_place(place: vec3u) -> vec3u {
    if PAGED {
        return place_in_page(page_table[page_number(place, pack.page_steps)], place);
    }
    return place;
}
