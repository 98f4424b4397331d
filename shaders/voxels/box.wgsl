// Where voxels are if each has a texel of its own in a box along the axes of the lattice, behind which lies a layer of
// zeros along each axis. Some devices cannot read storage textures of one or two channels (Direct3D 12), so the texture
// is sampled.

// Two voxels of a row.
struct Texel {
    // The row's place in the box, without a.
    row: vec3i,
    // The first voxel along a.
    a: i32,
}

// `n`, or the layer of zeros behind `count` voxels: a number below 0 wraps around to a large one.
fn or_zeros(n: i32, count: i32) -> i32 {
    return i32(min(u32(n), u32(count)));
}

// The first voxels of a plane.
fn plane_texel(plane: i32) -> Texel {
    return Texel(or_zeros(packed_plane(plane), rays.voxels.z) * rays.along_m, 0);
}

// A pair of voxels and a row of a plane, which begins at `origin`.
fn texel_at(texel: vec2i, origin: Texel) -> Texel {
    return Texel(origin.row + or_zeros(texel.y, rays.voxels.y) * rays.along_b, 2 * texel.x);
}

// The two voxels `count` pairs along the row.
fn along_row(texel: Texel, count: i32) -> Texel {
    return Texel(texel.row, texel.a + 2 * count);
}

// The place of voxel 0 or 1 of the pair.
fn place_of(texel: Texel, number: i32) -> vec3i {
    return texel.row + or_zeros(texel.a + number, rays.voxels.x) * rays.along_a;
}
