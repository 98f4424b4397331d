//! The twin of shaders/common/splat.wgsl, normal.wgsl and resolution.wgsl on the host: the words of splats.

mod light;

use pulp::{Arch, NullaryFnOnce};

use self::light::Shining;
use crate::transfer::Resolution;

pub(crate) use self::light::{SplatLight, ToEye};

/// The largest values of red, green and blue: 13, 14 and 13 bits.
const COLOR_STEPS: [f32; 3] = [8191.0, 16383.0, 8191.0];

/// The bits for "no direction".
pub(crate) const NO_NORMAL: u32 = 0x8000_8000;

/// -ln(1 - opacity): `density` in shaders/common/classified.wgsl.
pub(crate) fn density(opacity: f32) -> f32 {
    let a = opacity.min(1.0 - 1.0 / 65_536.0);
    if a < 0.1 {
        return a * (1.0 + a * (1.0 / 2.0 + a * (1.0 / 3.0 + a * (1.0 / 4.0 + a * (1.0 / 5.0 + a * (1.0 / 6.0))))));
    }
    -(1.0 - a).ln()
}

/// The whole number nearest to a number of 0 to 2^22, the even one of two: the sum has no bits for a fraction.
#[inline(always)]
fn nearest(value: f32) -> u32 {
    (value + 8_388_608.0).to_bits() & 0x7f_ffff
}

/// The words density_blue and color.
pub(crate) fn packed_appearance(color: [f32; 3], density: f32) -> [u32; 2] {
    let [r, g, b] = [0, 1, 2].map(|c| nearest(color[c].clamp(0.0, 1.0) * COLOR_STEPS[c]));
    // To the nearest: half of the lowest bit that stays is added.
    let rounded = density.to_bits().wrapping_add(128) & 0xffff_ff00;
    [rounded | b >> 5, r | g << 13 | b << 27]
}

/// These words with another density.
pub(crate) fn with_density([density_blue, color]: [u32; 2], density: f32) -> [u32; 2] {
    [density.to_bits().wrapping_add(128) & 0xffff_ff00 | density_blue & 0xff, color]
}

/// 1 with the sign of a number, of 0 too.
#[inline(always)]
fn sign_or_one(v: f32) -> f32 {
    if v >= 0.0 { 1.0 } else { -1.0 }
}

/// The central difference that counts half as a surface, at a scalar relative to the base.
pub(crate) fn resolution_at(scalar: f32, faintest: f32) -> f32 {
    Resolution::OF_DISTANCE as f32 * scalar.abs() + faintest
}

/// The bits of the direction of a vector of any length.
#[inline]
pub(crate) fn packed_normal([x, y, z]: [f32; 3]) -> u32 {
    let sum = x.abs() + y.abs() + z.abs();
    if sum.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
        return NO_NORMAL;
    }
    let mut p = [x / sum, y / sum];
    if z < 0.0 {
        p = [(1.0 - p[1].abs()) * sign_or_one(p[0]), (1.0 - p[0].abs()) * sign_or_one(p[1])];
    }
    // The nearest whole number, from a sum without bits for a fraction: the lowest bits hold it with its sign.
    let [low, high] = p.map(|c| (c.clamp(-1.0, 1.0) * 32767.0 + 12_582_912.0).to_bits() & 0xffff);
    low | high << 16
}

/// The steps of a gradient: `splat_gradient` in shaders/common/splat.wgsl.
pub(crate) fn gradient([low, high]: [u32; 2]) -> [f32; 3] {
    let signed = |bits: u32| (bits << 14) as i32 >> 14;
    let steps = [low, low >> 18 | (high & 15) << 14, high >> 4].map(|bits| signed(bits & 0x3_ffff));
    let step = f32::from_bits(high >> 22 << 23) / 65_536.0;
    steps.map(|c| c as f32 * step)
}

/// Splats that are coloured together: loops of this length vectorise.
pub(crate) const LANES: usize = 16;

/// A number of each of these splats.
pub(crate) type Lanes = [f32; LANES];
/// A vector of each of them.
pub(crate) type Vectors = [Lanes; 3];

/// The colours and the densities of splats, given the words density_blue and color.
#[inline(always)]
fn appearances(density_blue: &[u32; LANES], color: &[u32; LANES]) -> (Vectors, Lanes) {
    let mut colors = Vectors::default();
    let mut densities = Lanes::default();
    for i in 0..LANES {
        let (density_blue, color) = (density_blue[i], color[i]);
        let blue = color >> 27 | (density_blue & 0xff) << 5;
        colors[0][i] = (color & 0x1fff) as i32 as f32 / COLOR_STEPS[0];
        colors[1][i] = (color >> 13 & 0x3fff) as i32 as f32 / COLOR_STEPS[1];
        colors[2][i] = blue as i32 as f32 / COLOR_STEPS[2];
        densities[i] = f32::from_bits(density_blue & 0xffff_ff00);
    }
    (colors, densities)
}

/// Up to [`LANES`] splats of a row of a brick.
pub(crate) struct SplatRun<'a> {
    /// Lattice points of the splats along x; arbitrary beyond the last.
    pub(crate) xs: [u32; LANES],
    pub(crate) y: u32,
    pub(crate) z: u32,
    /// Words of a splat without its place.
    pub(crate) each: usize,
    /// The words of the splats and of some that follow.
    pub(crate) words: &'a [u32],
    /// The light that arrives at these splats; empty: all of it.
    pub(crate) light: &'a [[u32; 2]],
}

impl SplatRun<'_> {
    /// Word number `index` of each splat; 0 beyond the last.
    #[inline(always)]
    pub(crate) fn column(&self, index: usize) -> [u32; LANES] {
        let mut column = [0; LANES];
        for (place, words) in column.iter_mut().zip(self.words.chunks_exact(self.each)) {
            *place = words[index];
        }
        column
    }

    /// The words of the light that arrives at each splat; `None`: all of it.
    #[inline(always)]
    fn kept(&self) -> Option<[[u32; LANES]; 2]> {
        if self.light.is_empty() {
            return None;
        }
        let mut kept = [[u32::MAX; LANES]; 2];
        for (place, light) in self.light.iter().take(LANES).enumerate() {
            (0..2).for_each(|word| kept[word][place] = light[word]);
        }
        Some(kept)
    }

    /// The colours under a light, `None` for unlit ones, and the densities of classified splats.
    pub(crate) fn appearances(&self, light: Option<&SplatLight>) -> (Vectors, Lanes) {
        Arch::new().dispatch(Appearances { run: self, light })
    }

    /// The same for the texture of the painter `tiles`: colours times densities, and densities, which are multiplied by
    /// `scale` first.
    pub(crate) fn packed(&self, light: Option<&SplatLight>, scale: f32) -> [[u32; 2]; LANES] {
        Arch::new().dispatch(Packing { appearances: Appearances { run: self, light }, scale })
    }
}

/// The parameters of [`SplatRun::appearances`], as a type like [`Shining`].
struct Appearances<'a> {
    run: &'a SplatRun<'a>,
    light: Option<&'a SplatLight>,
}

impl NullaryFnOnce for Appearances<'_> {
    type Output = (Vectors, Lanes);

    #[inline(always)]
    fn call(self) -> Self::Output {
        let Self { run, light } = self;
        let (mut colors, densities) = appearances(&run.column(0), &run.column(1));
        if let Some(light) = light {
            let (points, normals) = ((&run.xs, [run.y, run.z]), &run.column(2));
            Shining { light, points, colors: &mut colors, normals, arriving: run.kept().as_ref() }.call();
        }
        (colors, densities)
    }
}

/// The parameters of [`SplatRun::packed`].
struct Packing<'a> {
    appearances: Appearances<'a>,
    scale: f32,
}

impl NullaryFnOnce for Packing<'_> {
    type Output = [[u32; 2]; LANES];

    #[inline(always)]
    fn call(self) -> Self::Output {
        let (mut colors, mut weights) = self.appearances.call();
        weights.iter_mut().for_each(|weight| *weight *= self.scale);
        for color in &mut colors {
            color.iter_mut().zip(weights).for_each(|(c, weight)| *c *= weight);
        }
        halves(&colors, &weights)
    }
}

/// Four numbers of each splat as the nearest f16: `rounded` in shaders/common/packing.wgsl, then pack2x16float.
#[inline(always)]
pub(crate) fn halves([x, y, z]: &Vectors, w: &Lanes) -> [[u32; 2]; LANES] {
    let half = |value: f32| {
        let bits = value.to_bits().wrapping_add(0x1000) & 0xffff_e000;
        let size = bits & 0x7fff_ffff;
        // Less than the least normal f16: in steps of 2^-24, which is the last bit of 1/2.
        let small = (f32::from_bits(size) + 0.5).to_bits().wrapping_sub(0x3f00_0000);
        let normal = size.wrapping_sub(0x3800_0000) >> 13;
        bits >> 16 & 0x8000 | if size < 0x3880_0000 { small } else { normal }
    };
    let (mut low, mut high) = ([0; LANES], [0; LANES]);
    for i in 0..LANES {
        low[i] = half(x[i]) | half(y[i]) << 16;
        high[i] = half(z[i]) | half(w[i]) << 16;
    }
    std::array::from_fn(|i| [low[i], high[i]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::layout::Lighting;

    #[test]
    fn wider_vectors_change_no_bit_of_splats() {
        let random = |i: u32| (i + 1).wrapping_mul(2_654_435_761) ^ i.wrapping_mul(40_503);
        let density = |i: u32| (0.01 + (i % 50) as f32).to_bits();
        let words: Vec<u32> = (0..16).flat_map(|i| [density(i), random(3 * i), random(3 * i + 1)]).collect();
        let kept: Vec<[u32; 2]> = (0..16).map(|i| [random(100 + i), random(200 + i)]).collect();
        let lighting = Lighting {
            right: [0.8, 0.1, 0.0],
            up: [0.0, 1.1, 0.3],
            forward: [-0.6, 0.2, 1.0],
            ambient: 0.15,
            diffuse: 0.6,
            specular: 0.3,
            shininess: 24.0,
            lights: [[0.0; 4], [0.6, 0.0, -0.8, 0.0], [3.0, 4.0, -5.0, 1.0], [0.0; 4]],
            colors: [[0.9, 0.8, 0.7, 0.0]; 4],
            from_lattice: [[0.1, 0.0, 0.0, 0.0], [0.0, 0.1, 0.0, 0.0], [0.0, 0.0, 0.1, 0.0], [0.0; 4]],
            ..Lighting::default()
        };
        let view = [[1.0, 0.0, 0.2], [0.0, 1.0, 0.1], [-0.2, 0.0, 1.0]];
        let to_eye = ToEye { perspective: true, eye: [40.0, -10.0, -90.0], view };
        let light = SplatLight { lighting, lights: 3, points: true, to_eye };
        for (light, kept) in [(None, &[][..]), (Some(&light), &[]), (Some(&light), &kept)] {
            let xs = std::array::from_fn(|i| 5 + i as u32);
            let run = SplatRun { xs, y: 3, z: 60, each: 3, words: &words, light: kept };
            let narrow = Packing { appearances: Appearances { run: &run, light }, scale: 4.0 }.call();
            assert_eq!(run.packed(light, 4.0), narrow);
            assert!(narrow.iter().any(|[low, _]| *low != 0));
        }
    }
}
