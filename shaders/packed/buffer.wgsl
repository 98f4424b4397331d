// Where `pack` stores voxels on software: a buffer of some rows of the texture, which is copied to the texture.

// Two words for each classified voxel and each lit scalar, one for each other scalar.
@group(0) @binding(4) var<storage, read_write> texels: array<u32>;

// Whether a row of the texture is stored.
fn is_stored(row: u32) -> bool {
    // The difference of rows before the first wraps around to a large number.
    return row - pack.first_row < pack.row_count;
}

// Stores a voxel at a place of a row.
fn store(place: u32, row: u32, words: vec2u) {
    let voxel = 2u * (row - pack.first_row) * pack.width + place;
    if SCALARS && !GRADIENTS {
        texels[voxel] = words.x;
        return;
    }
    texels[2u * voxel] = words.x;
    texels[2u * voxel + 1u] = words.y;
}
