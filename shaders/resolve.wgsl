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
    let alpha = absorbed(pixel.a);
    pixels[index] = vec4f(select(pixel.rgb, vec3f(alpha), WHITE), alpha);
}
