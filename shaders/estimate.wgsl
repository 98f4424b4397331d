// estimate: a measure of the error of the splines through an intermediate image around each of its points: fourth
// differences along x and y. Splines follow values that change slowly from point to point, and not rims and edges.
// uses: common/rays

@group(0) @binding(0) var<uniform> uniform_rays: Rays;
@group(0) @binding(1) var source: texture_storage_2d<rgba32float, read>;
@group(0) @binding(2) var estimates: texture_storage_2d<r32float, write>;

// The fourth difference of the image along a step, the largest of a channel.
fn fourth_difference(at: vec2i, step: vec2i) -> f32 {
    let d = abs(textureLoad(source, at - 2 * step) + textureLoad(source, at + 2 * step)
        - 4.0 * (textureLoad(source, at - step) + textureLoad(source, at + step)) + 6.0 * textureLoad(source, at));
    return max(max(d.x, d.y), max(d.z, d.w));
}

@compute @workgroup_size(64)
fn estimate(@builtin(global_invocation_id) id: vec3u) {
    rays = uniform_rays;
    if any(id.xy >= rays.size) {
        return;
    }
    // If points are closer, smooth values have smaller differences. The rims of kernels, which no spline follows, have
    // nearly the same ones: a larger part of a difference is error. See docs/measurements/2026-11-22-rays.md.
    let gain = pow(rays.fineness * vec2f(rays.phases), vec2f(1.6));
    let p = vec2i(id.xy);
    var largest = 0.0;
    for (var y = -1; y <= 1; y++) {
        for (var x = -1; x <= 1; x++) {
            let at = p + vec2i(x, y);
            let both = vec2f(fourth_difference(at, vec2i(1, 0)), fourth_difference(at, vec2i(0, 1)));
            largest = max(largest, dot(gain, both));
        }
    }
    textureStore(estimates, id.xy, vec4f(largest));
}
