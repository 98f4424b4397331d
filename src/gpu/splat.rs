//! The twin of shaders/common/splat.wgsl, normal.wgsl and lighting.wgsl on the host: words of splats, and light on them.

use super::layout::Lighting;

/// The largest values of red, green and blue: 13, 14 and 13 bits.
const COLOR_STEPS: [f32; 3] = [8191.0, 16383.0, 8191.0];

/// The bits for "no direction".
const NO_NORMAL: u32 = 0x8000_8000;

/// -ln(1 - opacity): `density` in shaders/classify.wgsl.
pub(super) fn density(opacity: f32) -> f32 {
    let a = opacity.min(0.999_984_741_210_937_5);
    if a < 0.1 {
        return a * (1.0 + a * (1.0 / 2.0 + a * (1.0 / 3.0 + a * (1.0 / 4.0 + a * (1.0 / 5.0 + a * (1.0 / 6.0))))));
    }
    -(1.0 - a).ln()
}

/// The nearest whole number to one of 0 to 2^22, the even one of two: the sum has no bits for a fraction.
fn nearest(value: f32) -> u32 {
    (value + 8_388_608.0).to_bits() & 0x7f_ffff
}

/// The words density_blue and color.
pub(super) fn packed_appearance(color: [f32; 3], density: f32) -> [u32; 2] {
    let [r, g, b] = [0, 1, 2].map(|c| nearest(color[c].clamp(0.0, 1.0) * COLOR_STEPS[c]));
    let rounded = (density.to_bits() + 64) >> 7;
    [rounded << 8 | b >> 5, r | g << 13 | b << 27]
}

/// The colour and the density of these words.
pub(super) fn appearance([density_blue, color]: [u32; 2]) -> ([f32; 3], f32) {
    let blue = color >> 27 | (density_blue & 0xff) << 5;
    let steps = [color & 0x1fff, color >> 13 & 0x3fff, blue];
    ([0, 1, 2].map(|c| steps[c] as f32 / COLOR_STEPS[c]), f32::from_bits(density_blue >> 8 << 7))
}

/// 1 with the sign of a number, of 0 too.
fn sign_or_one(v: f32) -> f32 {
    if v >= 0.0 { 1.0 } else { -1.0 }
}

/// The bits of the direction of a vector of any length.
pub(super) fn packed_normal([x, y, z]: [f32; 3]) -> u32 {
    let sum = x.abs() + y.abs() + z.abs();
    if sum.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
        return NO_NORMAL;
    }
    let mut p = [x / sum, y / sum];
    if z < 0.0 {
        p = [(1.0 - p[1].abs()) * sign_or_one(p[0]), (1.0 - p[0].abs()) * sign_or_one(p[1])];
    }
    // The nearest whole number, from a sum without bits for a fraction: the lowest 16 bits hold it with its sign.
    let [low, high] = p.map(|c| (c.clamp(-1.0, 1.0) * 32767.0 + 12_582_912.0).to_bits() & 0xffff);
    low | high << 16
}

/// The direction, not of unit length; 0 for "no direction".
fn normal(bits: u32) -> [f32; 3] {
    if bits == NO_NORMAL {
        return [0.0; 3];
    }
    let [x, y] = [bits, bits >> 16].map(|bits| (f32::from(bits as u16 as i16) / 32767.0).max(-1.0));
    let z = 1.0 - x.abs() - y.abs();
    if z >= 0.0 {
        return [x, y, z];
    }
    [(1.0 - y.abs()) * sign_or_one(x), (1.0 - x.abs()) * sign_or_one(y), z]
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The steps of a gradient: `splat_gradient` in shaders/common/splat.wgsl.
pub(super) fn gradient([low, high]: [u32; 2]) -> [f32; 3] {
    let signed = |bits: u32| (bits << 14) as i32 >> 14;
    let steps = [low, low >> 18 | (high & 15) << 14, high >> 4].map(|bits| signed(bits & 0x3_ffff));
    let step = f32::from_bits(high >> 22 << 23) / 65_536.0;
    steps.map(|c| c as f32 * step)
}

/// The colour of a splat with a packed world gradient under so many lights. `to_eye` is the unit vector from the splat
/// to the eye, in view coordinates: `lit_splat` in shaders/common/lit_splat.wgsl.
pub(super) fn lit(lighting: &Lighting, lights: u32, color: [f32; 3], bits: u32, to_eye: [f32; 3]) -> [f32; 3] {
    let n = normal(bits);
    let gradient = [lighting.right, lighting.up, lighting.forward].map(|axis| dot(axis, n));
    let square = dot(gradient, gradient);
    if square <= 0.0 {
        return color;
    }
    let facing = if dot(gradient, to_eye) < 0.0 { -1.0 } else { 1.0 };
    let factor = facing / square.sqrt();
    let unit = gradient.map(|c| c * factor);
    let (mut diffuse, mut specular) = (0.0, 0.0);
    for &[x, y, z, _] in &lighting.lights[..lights as usize] {
        let light = [x, y, z];
        let towards = if light == [0.0; 3] { to_eye } else { light };
        let cosine = dot(unit, towards);
        if cosine > 0.0 {
            let between = [0, 1, 2].map(|i| to_eye[i] + towards[i]);
            let highlight = dot(unit, between) / dot(between, between).max(1e-20).sqrt();
            diffuse += cosine;
            specular += highlight.max(0.0).powf(lighting.shininess);
        }
    }
    let (factor, white) = (lighting.ambient + lighting.diffuse * diffuse, lighting.specular * specular);
    color.map(|c| (c * factor + white).clamp(0.0, 1.0))
}
