// prefilter: from the intermediate image to the coefficients of the cubic B-splines that go through its points (Unser,
// Aldroubi and Eden 1991, "Fast B-spline transforms for continuous image representation and interpolation"), one axis
// at a time.

@group(0) @binding(0) var source: texture_storage_2d<rgba32float, read>;
@group(0) @binding(1) var coefficients: texture_storage_2d<rgba32float, write>;

// Along y instead of x.
override DOWN: bool = false;

// The texel some steps along the axis from `at`; beyond the ends of the image, the texel at the end. No pixel depends
// on texels beyond the ends.
fn source_at(at: vec2i, steps: i32) -> vec4f {
    let last = vec2i(textureDimensions(source)) - 1;
    return textureLoad(source, clamp(at + select(vec2i(steps, 0), vec2i(0, steps), DOWN), vec2i(0), last));
}

// A cubic B-spline is (1, 4, 1) / 6 at the points. The inverse of this filter has the taps sqrt(3) z^|n|, z = sqrt(3) -
// 2. It is truncated after n = 5; the tap at 5 contains the rest, so that all taps add up to 1 and constants stay.
@compute @workgroup_size(64)
fn prefilter(@builtin(global_invocation_id) id: vec3u) {
    let p = vec2i(id.xy);
    let sum = 1.7320508 * source_at(p, 0) - 0.4641016 * (source_at(p, -1) + source_at(p, 1))
        + 0.1243556 * (source_at(p, -2) + source_at(p, 2)) - 0.0333210 * (source_at(p, -3) + source_at(p, 3))
        + 0.0089284 * (source_at(p, -4) + source_at(p, 4)) - 0.0018868 * (source_at(p, -5) + source_at(p, 5));
    textureStore(coefficients, id.xy, sum);
}
