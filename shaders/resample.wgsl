// resample: an intermediate image to the picture, by cubic B-splines with the coefficients that `prefilter` found. Where
// the splines may err too much, a pixel gets a share of its own ray instead, which `refine` adds.

@group(0) @binding(0) var<uniform> rays: Rays;
@group(0) @binding(1) var coefficients: texture_2d<f32>;
@group(0) @binding(2) var filtered: sampler;
@group(0) @binding(3) var<storage, read_write> pixels: array<vec4f>;
// How much the splines may err around each point, and the share of its own ray that each pixel gets for that.
@group(0) @binding(4) var estimates: texture_2d<f32>;
@group(0) @binding(5) var<storage, read_write> refinement: array<f32>;

// Estimates up to which a pixel is that of the splines, and from which on it is that of its own ray. At the first the
// largest error measured is 1.2e-2: docs/measurements/2026-11-22-rays.md.
const SPLINES: f32 = 0.16;
const OWN_RAY: f32 = 0.27;

// The estimate at a place, between those of the four points around it.
fn estimate_at(whole: vec2f, fraction: vec2f) -> f32 {
    // Pixels beyond the image show nothing, and may have any estimate.
    let p = clamp(vec2i(whole), vec2i(0), vec2i(rays.size) - 2);
    let top = vec2f(textureLoad(estimates, p, 0).x, textureLoad(estimates, p + vec2i(1, 0), 0).x);
    let bottom = vec2f(textureLoad(estimates, p + vec2i(0, 1), 0).x, textureLoad(estimates, p + 1, 0).x);
    let between = mix(top, bottom, fraction.y);
    return mix(between.x, between.y, fraction.x);
}

// Weights of the cubic B-spline for the four coefficients around a place, the fraction `t` of the way from the second
// of them to the third.
fn cubic(t: f32) -> vec4f {
    let u = 1.0 - t;
    return vec4f(u * u * u, 4.0 + t * t * (3.0 * t - 6.0), 4.0 + u * u * (3.0 * u - 6.0), t * t * t) * (1.0 / 6.0);
}

// One invocation for each pixel. The texture unit adds two neighbours at a time, with their weights as the place
// between them (Sigg and Hadwiger 2005, "Fast third-order texture filtering").
@compute @workgroup_size(64)
fn resample(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= rays.picture) {
        return;
    }
    let at = rays.pixel_origin + f32(id.x) * rays.pixel_x + f32(id.y) * rays.pixel_y;
    let whole = floor(at);
    let x = cubic(at.x - whole.x);
    let y = cubic(at.y - whole.y);
    let first = vec2f(x.x + x.y, y.x + y.y);
    let second = 1.0 - first;
    let texel = 1.0 / vec2f(rays.size);
    // The middle of texel n is at n + 1/2: the first two coefficients are texels whole - 1 and whole.
    let a = (whole - 0.5 + vec2f(x.y, y.y) / first) * texel;
    let b = (whole + 1.5 + vec2f(x.w, y.w) / second) * texel;
    let top = first.x * textureSampleLevel(coefficients, filtered, a, 0.0)
        + second.x * textureSampleLevel(coefficients, filtered, vec2f(b.x, a.y), 0.0);
    let bottom = first.x * textureSampleLevel(coefficients, filtered, vec2f(a.x, b.y), 0.0)
        + second.x * textureSampleLevel(coefficients, filtered, b, 0.0);
    let sum = first.y * top + second.y * bottom;
    // Splines overshoot at edges: a premultiplied colour is never above its alpha.
    let alpha = clamp(sum.a, 0.0, 1.0);
    let spline = vec4f(clamp(sum.rgb, vec3f(0.0), vec3f(alpha)), alpha);
    let estimate = estimate_at(whole, at - whole);
    let own = max(smoothstep(SPLINES, OWN_RAY, estimate), rays.least_refined);
    let index = id.y * rays.picture.x + id.x;
    pixels[index] += rays.share * (1.0 - own) * spline;
    refinement[index] += rays.share * own;
}
