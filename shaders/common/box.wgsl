// The box of voxels of the painter `tiles`: each voxel has a texel of its own along the axes of the lattice, and behind
// the box lies a layer of zeros along each axis. Some devices cannot read storage textures of one or two channels
// (Direct3D 12), so the texture is sampled. The stage declares `page_table`.
// uses: common/packing, common/pages, common/ray_geometry

@group(0) @binding(1) var volume: texture_3d<u32>;

// The texture has the pages of the box that have voxels: see common/pages.wgsl.
override PAGED: bool = false;
// A voxel is a word, its scalar as f32. Other voxels are four f16: (colour, 1) times density, or (gradient, scalar).
override ONE_WORD: bool = false;

// Two voxels of a row.
struct Texel {
    // The row's place in the box, without a.
    row: vec3i,
    // The first voxel along a.
    a: i32,
}

// The number of a plane in the packed volume.
fn packed_plane(plane: i32) -> i32 {
    let number = plane - rays.first.z;
    return select(number, rays.voxels.z - 1 - number, rays.flipped == 1);
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

// The words of both voxels of the pair.
fn voxels_at(texel: Texel) -> vec4u {
    let first = place_of(texel, 0);
    if PAGED {
        // Both are in one page.
        let word = page_table[page_number(vec3u(first), rays.page_steps)];
        let at = place_in_page(word, vec3u(first));
        return vec4u(textureLoad(volume, at, 0).xy, textureLoad(volume, at + vec3u(rays.along_a), 0).xy);
    }
    return vec4u(textureLoad(volume, first, 0).xy, textureLoad(volume, place_of(texel, 1), 0).xy);
}

fn voxel_of(words: vec2u) -> vec4f {
    if ONE_WORD {
        return vec4f(0.0, 0.0, 0.0, bitcast<f32>(words.x));
    }
    return vec4f(unpack2x16float(words.x), unpack2x16float(words.y));
}

fn first_of(texel: vec4u) -> vec4f {
    return voxel_of(texel.xy);
}

fn second_of(texel: vec4u) -> vec4f {
    return voxel_of(texel.zw);
}
