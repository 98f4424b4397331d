// Where `pack` stores voxels on software: a buffer of some rows of the texture, which is copied to the texture.

// Two words for each classified voxel and each lit scalar, one for each other scalar.
@group(0) @binding(4) var<storage, read_write> texels: array<u32>;

// The row of the texture of a voxel at a place (a, b, plane) of the box.
fn row_of(place: vec3u) -> u32 {
    return place.z / pack.columns * (pack.rows + 1u) + 1u + place.y;
}

// Whether the row of a voxel is in the buffer.
fn is_stored(place: vec3u) -> bool {
    // The difference of rows before the first wraps around to a large number.
    return row_of(place) - pack.first_row < pack.row_count;
}

fn store(place: vec3u, words: vec2u) {
    // Two voxels to a step of `row_texels`.
    let at = 2u * (place.z % pack.columns * (pack.row_texels + u32(MARGIN)) + u32(MARGIN)) + place.x;
    let voxel = 2u * (row_of(place) - pack.first_row) * pack.width + at;
    if SCALARS && !GRADIENTS {
        texels[voxel] = words.x;
        return;
    }
    texels[2u * voxel] = words.x;
    texels[2u * voxel + 1u] = words.y;
}
