// The response of an X-ray: from the optical depth of a ray to a pixel. src/settings/response.rs explains it.
// uses: common/absorbed

// 0 if the model is no X-ray.
override RESPONSE: u32 = 0u;
const ABSORPTION: u32 = 1u;
const DEPTH: u32 = 2u;
const WINDOW: u32 = 3u;
const FILM: u32 = 4u;

// The largest density of film: 3 times the logarithm of 10.
const DENSITY: f32 = 6.907755;

// The display value of an intensity of light (IEC 61966-2-1).
fn display_value(light: f32) -> f32 {
    return select(1.055 * pow(light, 1.0 / 2.4) - 0.055, light * 12.92, light <= 0.0031308);
}

// The pixel of an optical depth. `curve` of a window has the depth of black, and the reciprocal of the range from there
// to white. `curve` of film has the exponent of exposure, the exponent times the logarithm of the exposure by the whole
// beam, the light that passes the film without absorption, and the reciprocal of the range from that light to clear
// film.
fn response(depth: f32, curve: vec4f) -> vec4f {
    if RESPONSE == DEPTH {
        return vec4f(vec3f(depth), absorbed(depth));
    }
    if RESPONSE == WINDOW {
        return vec4f(saturate((depth - curve.x) * curve.y));
    }
    if RESPONSE == FILM {
        let density = DENSITY / (1.0 + exp(min(curve.x * depth - curve.y, 80.0)));
        let light = select(0.0, exp(-density) - curve.z, depth > 0.0);
        return vec4f(display_value(saturate(light * curve.w)));
    }
    return vec4f(absorbed(depth));
}
