// page_table: the places of the pages of a box in the texture, see common/pages.wgsl. An invocation for each page of
// each brick.
// uses: common/dispatch, common/pages

// Pages along the side of a brick.
const PER_BRICK: u32 = 8u;

struct PageTable {
    // Pages of the table along x, y and z.
    dims: vec3u,
    // Pages of the texture along x, and along y.
    across: u32,
    // Steps along x, y and z in the table.
    steps: vec3u,
    down: u32,
}

struct PagedBrick {
    // Pages along x, y and z from the first of the table to the first of the brick; less than none wraps around.
    low: vec3u,
    // The place of the first of its pages with splats, which follow one another.
    first: u32,
    // Bits of the pages with splats, x fastest, then y.
    pages: array<u32, 16>,
}

@group(0) @binding(0) var<uniform> parameters: PageTable;
@group(0) @binding(1) var<storage, read> bricks: array<PagedBrick>;
@group(0) @binding(2) var<storage, read_write> page_table: array<u32>;

@compute @workgroup_size(WORKGROUP)
fn places_of_pages(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    let of_brick = PER_BRICK * PER_BRICK * PER_BRICK;
    let brick = index / of_brick;
    if brick >= arrayLength(&bricks) {
        return;
    }
    let page = index % of_brick;
    let word = bricks[brick].pages[page / 32u];
    let bit = 1u << (page % 32u);
    let at = bricks[brick].low + vec3u(page % PER_BRICK, page / PER_BRICK % PER_BRICK, page / (PER_BRICK * PER_BRICK));
    if (word & bit) == 0u || any(at >= parameters.dims) {
        return;
    }
    var place = bricks[brick].first + countOneBits(word & (bit - 1u));
    for (var before = 0u; before < page / 32u; before++) {
        place += countOneBits(bricks[brick].pages[before]);
    }
    let down = place / parameters.across;
    page_table[dot(at, parameters.steps)] =
        page_word(vec3u(place % parameters.across, down % parameters.down, down / parameters.down));
}
