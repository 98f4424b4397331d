// resample: an intermediate image to the picture, by cubic B-splines with the coefficients of `prefilter`. If the
// splines may err too much, a pixel gets a share of its own ray instead, which `refine` adds.
// uses: common/rays

@group(0) @binding(0) var<uniform> uniform_rays: Rays;
// Storage textures are read faster than others on software Vulkan.
@group(0) @binding(1) var coefficients: texture_storage_2d<rgba32float, read>;
@group(0) @binding(2) var<storage, read_write> pixels: array<vec4f>;
// The estimated error of the splines around each point, and the share of its own ray that each pixel gets for it.
@group(0) @binding(3) var estimates: texture_storage_2d<r32float, read>;
@group(0) @binding(4) var<storage, read_write> refinement: array<f32>;

// The estimate up to which a pixel takes the splines, and the estimate from which on it takes its own ray. See
// docs/measurements/2026-11-22-rays.md.
const SPLINES: f32 = 0.16;
const OWN_RAY: f32 = 0.27;

// The estimate at a place, interpolated between the four points around it.
fn estimate_at(whole: vec2f, fraction: vec2f) -> f32 {
    // Pixels beyond the image are empty, and may have any estimate.
    let p = clamp(vec2i(whole), vec2i(0), vec2i(rays.size) - 2);
    let top = vec2f(textureLoad(estimates, p).x, textureLoad(estimates, p + vec2i(1, 0)).x);
    let bottom = vec2f(textureLoad(estimates, p + vec2i(0, 1)).x, textureLoad(estimates, p + 1).x);
    let between = mix(top, bottom, fraction.y);
    return mix(between.x, between.y, fraction.x);
}

// Weights of the cubic B-spline for the four coefficients around a place, at a fraction `t` of the way from the second
// to the third.
fn cubic(t: f32) -> vec4f {
    let u = 1.0 - t;
    return vec4f(u * u * u, 4.0 + t * t * (3.0 * t - 6.0), 4.0 + u * u * (3.0 * u - 6.0), t * t * t) * (1.0 / 6.0);
}

// The sum over four coefficients of a row.
fn row_sum(x: vec4i, y: i32, weights: vec4f) -> vec4f {
    return weights.x * textureLoad(coefficients, vec2i(x.x, y)) + weights.y * textureLoad(coefficients, vec2i(x.y, y))
        + weights.z * textureLoad(coefficients, vec2i(x.z, y)) + weights.w * textureLoad(coefficients, vec2i(x.w, y));
}

// One invocation for each pixel. Texture units would also interpolate, but with weights of 8 bits.
@compute @workgroup_size(64)
fn resample(@builtin(global_invocation_id) id: vec3u) {
    rays = uniform_rays;
    if any(id.xy >= rays.picture) {
        return;
    }
    let at = rays.pixel_origin + f32(id.x) * rays.pixel_x + f32(id.y) * rays.pixel_y;
    // Pixels beyond the image use the points at its ends, which are empty.
    let most = vec2f(rays.size);
    let whole = clamp(floor(at), vec2f(-2.0), most);
    let fraction = clamp(at - whole, vec2f(0.0), vec2f(1.0));
    let last = vec2i(rays.size) - 1;
    let x = clamp(i32(whole.x) + vec4i(-1, 0, 1, 2), vec4i(0), vec4i(last.x));
    let y = clamp(i32(whole.y) + vec4i(-1, 0, 1, 2), vec4i(0), vec4i(last.y));
    let a = cubic(fraction.x);
    let b = cubic(fraction.y);
    let sum = b.x * row_sum(x, y.x, a) + b.y * row_sum(x, y.y, a) + b.z * row_sum(x, y.z, a)
        + b.w * row_sum(x, y.w, a);
    // Splines overshoot at edges: a premultiplied colour is at most its alpha times the brightest colour.
    let alpha = clamp(sum.a, 0.0, 1.0);
    let spline = vec4f(clamp(sum.rgb, vec3f(0.0), alpha * rays.brightest), alpha);
    let estimate = estimate_at(whole, fraction);
    let own = max(smoothstep(SPLINES, OWN_RAY, estimate), rays.least_refined);
    let index = id.y * rays.picture.x + id.x;
    pixels[index] = with_share(pixels[index], rays.share * (1.0 - own) * spline);
    refinement[index] += rays.share * own;
}
