// resolve: from the frame's colour and optical depth to premultiplied RGBA.

// X-ray: white.
override WHITE: bool = false;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read_write> pixels: array<vec4f>;

@compute @workgroup_size(8, 8)
fn resolve(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= frame.region) {
        return;
    }
    let index = id.y * frame.region.x + id.x;
    let pixel = pixels[index];
    // Cells may absorb a little less than nothing.
    let alpha = absorbed(max(pixel.a, 0.0));
    pixels[index] = vec4f(select(clamp(pixel.rgb, vec3f(0.0), vec3f(alpha)), vec3f(alpha), WHITE), alpha);
}
