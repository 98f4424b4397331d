// Where voxels are if planes lie in rows of a texture: see common/packing.wgsl.

// A texel, which holds two voxels of a row.
alias Texel = vec2i;

// The texel that holds the first voxels of a plane.
fn plane_texel(plane: i32) -> Texel {
    let k = packed_plane(plane);
    // k / columns in floats, exact below 2^21: software Vulkan divides integers lane by lane.
    let row = i32((f32(k) + 0.5) / f32(rays.columns));
    return vec2i(
        (k - row * rays.columns) * (rays.row_texels + MARGIN) + MARGIN,
        row * (rays.voxels.y + 1) + 1,
    );
}

// The texel of a pair of voxels and a row of a plane, which begins at `origin`. Texels outside the plane become texels
// of the zeros around it.
fn texel_at(texel: vec2i, origin: Texel) -> Texel {
    return vec2i(clamp(texel.x, -MARGIN, rays.row_texels), clamp(texel.y, -1, rays.voxels.y)) + origin;
}

// The texel `count` pairs along the row.
fn along_row(texel: Texel, count: i32) -> Texel {
    return texel + vec2i(count, 0);
}
