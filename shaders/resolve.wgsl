// resolve: from the frame's colour and optical depth to premultiplied RGBA.
// uses: common/absorbed, common/frame, common/half_depth, common/response

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read_write> pixels: array<vec4f>;

@compute @workgroup_size(8, 8)
fn resolve(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= frame.region) {
        return;
    }
    let index = id.y * frame.region.x + id.x;
    let pixel = pixels[index];
    // The absorption of cells may be slightly negative.
    let depth = max(pixel.a, 0.0);
    if RESPONSE > 0u {
        pixels[index] = response(depth, frame.model);
    } else {
        let alpha = absorbed(depth);
        if HALF_DEPTH {
            pixels[index].a = alpha;
            return;
        }
        pixels[index] = vec4f(clamp(pixel.rgb, vec3f(0.0), vec3f(alpha)), alpha);
    }
}
