// enlarge: the raster to the picture by cubic B-splines, from the coefficients that shaders/prefilter.wgsl found.

@group(0) @binding(0) var<uniform> raster: Raster;
@group(0) @binding(1) var coefficients: texture_2d<f32>;
@group(0) @binding(2) var filtered: sampler;
@group(0) @binding(3) var<storage, read_write> pixels: array<vec4f>;

// Weights of the cubic B-spline for the four coefficients around a place between two of them.
fn cubic(t: f32) -> vec4f {
    let u = 1.0 - t;
    return vec4f(u * u * u, 4.0 + t * t * (3.0 * t - 6.0), 4.0 + u * u * (3.0 * u - 6.0), t * t * t) * (1.0 / 6.0);
}

// Two neighbours at a time by the texture unit (Sigg and Hadwiger 2005, "Fast third-order texture filtering").
@compute @workgroup_size(64)
fn enlarge(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= raster.picture) {
        return;
    }
    let at = raster.pixel_origin + f32(id.x) * raster.pixel_x + f32(id.y) * raster.pixel_y;
    let cell = floor(at);
    let x = cubic(at.x - cell.x);
    let y = cubic(at.y - cell.y);
    let first = vec2f(x.x + x.y, y.x + y.y);
    let second = 1.0 - first;
    let texel = 1.0 / vec2f(raster.size);
    let a = (cell - 0.5 + vec2f(x.y, y.y) / first) * texel;
    let b = (cell + 1.5 + vec2f(x.w, y.w) / second) * texel;
    let top = first.x * textureSampleLevel(coefficients, filtered, a, 0.0)
        + second.x * textureSampleLevel(coefficients, filtered, vec2f(b.x, a.y), 0.0);
    let bottom = first.x * textureSampleLevel(coefficients, filtered, vec2f(a.x, b.y), 0.0)
        + second.x * textureSampleLevel(coefficients, filtered, b, 0.0);
    let sum = first.y * top + second.y * bottom;
    let alpha = clamp(sum.a, 0.0, 1.0);
    pixels[id.y * raster.picture.x + id.x] = vec4f(clamp(sum.rgb, vec3f(0.0), vec3f(alpha)), alpha);
}
