// present: the pixels of a region into the caller's texture, one fragment a pixel.

// Whether the texture encodes written values by the sRGB curve. Pixels are display values already, so they are decoded
// first.
override SRGB: bool = false;

struct Present {
    // First pixel of the region in the texture.
    corner: vec2u,
    // Pixels of a row of the buffer.
    row: u32,
}

@group(0) @binding(0) var<uniform> present: Present;
// Premultiplied RGBA.
@group(0) @binding(1) var<storage, read> pixels: array<vec4f>;

// One triangle over the whole texture; the scissor limits it to the region.
@vertex
fn cover(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4f {
    return vec4f(f32(corner & 1u) * 4.0 - 1.0, f32(corner >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

// The inverse of the sRGB curve (IEC 61966-2-1).
fn linear(display: vec3f) -> vec3f {
    return select(pow((display + 0.055) / 1.055, vec3f(2.4)), display / 12.92, display <= vec3f(0.04045));
}

@fragment
fn present_pixel(@builtin(position) place: vec4f) -> @location(0) vec4f {
    let at = vec2u(place.xy) - present.corner;
    let color = pixels[at.y * present.row + at.x];
    if SRGB {
        return vec4f(linear(clamp(color.rgb, vec3f(0.0), vec3f(1.0))), color.a);
    }
    return color;
}
