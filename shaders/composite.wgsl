// composite: the sheets of a batch into the frame, front to back. The frame keeps premultiplied colour and optical
// depth. Transmittance is exp of minus the depth, so alpha does not gather the rounding of one exponential for each
// sheet.
// uses: common/absorbed, common/frame, common/half_depth, common/pixel_ray

// Sheets of a batch: 1, 2, 4 or 8.
override SHEETS: u32 = 4u;
// Sheets hold sums of opacity, not of optical depth.
override ADDITIVE: bool = false;

// The pixels of the region that a batch reaches, and the view depth at which its first sheet begins.
struct Reached {
    // The first pixel that the batch reaches.
    low: vec2u,
    // The pixel after the last.
    high: vec2u,
    depth: f32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var sheets: texture_2d_array<f32>;
@group(0) @binding(2) var<storage, read_write> pixels: array<vec4f>;
@group(0) @binding(3) var<uniform> batch: Reached;

// A texel of a sheet, as colour times optical depth (or opacity) and optical depth (or opacity).
fn load(at: vec2u, layer: u32) -> vec4f {
    return textureLoad(sheets, at, layer, 0) * frame.inverse_sheet_scale;
}

// The frame's pixel with one more sheet behind it, which begins at view depth `z`.
fn with_sheet(pixel: vec4f, sheet: vec4f, z: f32) -> vec4f {
    if sheet.a <= 0.0 {
        return pixel;
    }
    if HALF_DEPTH {
        let depths = frame.solid_depth.x * (z + vec2f(0.0, frame.sheet_step)) + frame.solid_depth.y;
        let depth = pixel.a + select(sheet.a, -log(max(1.0 - sheet.a, 1e-30)), ADDITIVE);
        return vec4f(half_depth(pixel.rgb, pixel.a, depth, depths), depth);
    }
    if ADDITIVE {
        // The sum of opacities is clamped at 1, and the colour scaled with it. A sheet that is full adds an optical
        // depth of -ln(1e-30) = 69, opaque to f32.
        let opacity = min(sheet.a, 1.0);
        let color = pixel.rgb + sheet.rgb * (exp(-pixel.a) * opacity / sheet.a);
        return vec4f(color, pixel.a - log(max(1.0 - opacity, 1e-30)));
    }
    let weight = exp(-pixel.a) * absorbed(sheet.a) / sheet.a;
    return vec4f(pixel.rgb + sheet.rgb * weight, pixel.a + sheet.a);
}

@compute @workgroup_size(8, 8)
fn composite(@builtin(global_invocation_id) id: vec3u) {
    let at = batch.low + id.xy;
    if any(at >= batch.high) {
        return;
    }
    // Written out because software drivers do not unroll a loop over the sheets. Most pixels of most batches are empty:
    // these neither read nor write the frame.
    var s = array<vec4f, 8>();
    var reached = 0.0;
    if #u < SHEETS { s[#] = load(at, #u); reached += s[#].a; }
    if reached <= 0.0 {
        return;
    }
    if BRICK {
        let owned = pixel_ray(at).owned;
        if #u < SHEETS && !owns_sheet(owned, batch.depth + f32(#) * frame.sheet_step) { s[#] = vec4f(0.0); }
    }
    let index = at.y * frame.region.x + at.x;
    var pixel = pixels[index];
    if #u < SHEETS { pixel = with_sheet(pixel, s[#], batch.depth + f32(#) * frame.sheet_step); }
    pixels[index] = pixel;
}

// X-ray: a batch is one sheet, of optical depth.
@compute @workgroup_size(8, 8)
fn depth(@builtin(global_invocation_id) id: vec3u) {
    let at = batch.low + id.xy;
    if any(at >= batch.high) {
        return;
    }
    pixels[at.y * frame.region.x + at.x].a += load(at, 0u).r;
}
