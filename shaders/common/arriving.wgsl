// The shares of light that arrive at visible voxels, as in splats (common/splat.wgsl).

override SHADOWS: bool = false;

// The words of visible voxels, if there are shadows.
@group(0) @binding(10) var<storage, read> kept: array<vec2u>;

fn kept_at(number: u32) -> vec4f {
    if !SHADOWS {
        return vec4f(1.0);
    }
    let words = kept[number];
    return vec4f(unpack2x16unorm(words.x), unpack2x16unorm(words.y));
}
