// The samples of bricks with the voxels around each. Most stages classify them (common/classified.wgsl).

// How a sample is stored: 0 u8, 1 i8, 2 u16, 3 i16, 4 f32.
override SAMPLE_TYPE: u32 = 0u;
// Floats farther out than this are as far as any: their differences stay in the range of f32.
const FAR: f32 = 1e36;
// Voxels along the side of a brick.
const EDGE: u32 = 32u;

// Samples of the bricks, brick after brick, x fastest; several to a word, see SAMPLE_TYPE.
@group(0) @binding(1) var<storage, read> samples: array<u32>;

// Sample number `i` of the batch.
fn sample_at(i: u32) -> f32 {
    if SAMPLE_TYPE == 4u {
        return clamp(bitcast<f32>(samples[i]), -FAR, FAR);
    }
    if SAMPLE_TYPE >= 2u {
        let bits = samples[i >> 1u] << (16u - 16u * (i & 1u));
        if SAMPLE_TYPE == 2u {
            return f32(bits >> 16u);
        }
        return f32(bitcast<i32>(bits) >> 16u);
    }
    let bits = samples[i >> 2u] << (24u - 8u * (i & 3u));
    if SAMPLE_TYPE == 0u {
        return f32(bits >> 24u);
    }
    return f32(bitcast<i32>(bits) >> 24u);
}
