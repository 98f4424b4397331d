// What lights visible voxels of samples: their normals, and the shares of light that arrive, as in splats
// (common/splat.wgsl).
// uses: common/classified

// Whether the normals of visible voxels are kept: if not, they are found.
override KEPT_NORMALS: bool = false;
override SHADOWS: bool = false;

// The packed normals of visible voxels, if they are kept.
@group(0) @binding(9) var<storage, read> normals: array<u32>;
// The words of visible voxels, if there are shadows.
@group(0) @binding(10) var<storage, read> kept: array<vec2u>;

// The packed normal of a visible voxel, sample number `i`.
fn packed_normal(number: u32, i: u32) -> u32 {
    if KEPT_NORMALS {
        return normals[number];
    }
    return pack_normal(normal(i).xyz);
}

fn kept_at(number: u32) -> vec4f {
    if !SHADOWS {
        return vec4f(1.0);
    }
    let words = kept[number];
    return vec4f(unpack2x16unorm(words.x), unpack2x16unorm(words.y));
}
