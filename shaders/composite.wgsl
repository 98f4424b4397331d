// composite: the sheets of a batch, front to back, into the frame. The frame keeps colour and the optical depth so far:
// transmittance is its exponential, so alpha does not gather the rounding of one exponential per sheet.

// Sheets of a batch.
override SHEETS: u32 = 4u;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var sheets: texture_2d_array<f32>;
@group(0) @binding(2) var<storage, read_write> pixels: array<vec4f>;

@compute @workgroup_size(8, 8)
fn composite(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= frame.region) {
        return;
    }
    let index = id.y * frame.region.x + id.x;
    var pixel = pixels[index];
    for (var i = 0u; i < SHEETS; i++) {
        let sheet = textureLoad(sheets, id.xy, i, 0) * frame.inverse_sheet_scale;
        if sheet.a > 0.0 {
            let weight = exp(-pixel.a) * absorbed(sheet.a) / sheet.a;
            pixel = vec4f(pixel.rgb + sheet.rgb * weight, pixel.a + sheet.a);
        }
    }
    pixels[index] = pixel;
}
