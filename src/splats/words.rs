//! The words of splats: colours, densities and normals in few bits, in the format of shaders/common/splat.wgsl and
//! normal.wgsl.

use crate::transfer::Resolution;

/// The largest values of red, green and blue: 13, 14 and 13 bits.
const COLOR_STEPS: [f32; 3] = [8191.0, 16383.0, 8191.0];

/// The bits for "no direction".
pub(crate) const NO_NORMAL: u32 = 0x8000_8000;

/// Returns -ln(1 - opacity): `density` in shaders/common/classified.wgsl.
pub(crate) fn density(opacity: f32) -> f32 {
    let a = opacity.min(1.0 - 1.0 / 65_536.0);
    if a < 0.1 {
        return a * (1.0 + a * (1.0 / 2.0 + a * (1.0 / 3.0 + a * (1.0 / 4.0 + a * (1.0 / 5.0 + a * (1.0 / 6.0))))));
    }
    -libm::logf(1.0 - a)
}

/// Rounds a number of 0 to 2^22 to the nearest whole number, the even one of two: the sum has no bits for a fraction.
#[inline(always)]
fn nearest(value: f32) -> u32 {
    (value + 8_388_608.0).to_bits() & 0x7f_ffff
}

/// Packs colour and density into the words density_blue and color.
pub(crate) fn packed_appearance(color: [f32; 3], density: f32) -> [u32; 2] {
    let [r, g, b] = [0, 1, 2].map(|c| nearest(color[c].clamp(0.0, 1.0) * COLOR_STEPS[c]));
    // To the nearest: half of the lowest bit that stays is added.
    let rounded = density.to_bits().wrapping_add(128) & 0xffff_ff00;
    [rounded | b >> 5, r | g << 13 | b << 27]
}

/// Returns 1 with the sign of a number; 1 for 0.
#[inline(always)]
pub(crate) fn sign_or_one(v: f32) -> f32 {
    if v >= 0.0 { 1.0 } else { -1.0 }
}

/// Returns the central difference that counts half as a surface, at a scalar relative to the base.
pub(crate) fn resolution_at(scalar: f32, faintest: f32) -> f32 {
    Resolution::OF_DISTANCE as f32 * scalar.abs() + faintest
}

/// Packs the direction of a vector of any length into 32 bits.
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

/// The number of splats that are coloured together: loops of this length vectorise.
pub(crate) const LANES: usize = 16;

/// A number for each of [`LANES`] splats.
pub(crate) type Lanes = [f32; LANES];
/// A vector for each of [`LANES`] splats.
pub(crate) type Vectors = [Lanes; 3];

/// Unpacks the colours and the densities of splats from the words density_blue and color.
#[inline(always)]
pub(crate) fn appearances(density_blue: &[u32; LANES], color: &[u32; LANES]) -> (Vectors, Lanes) {
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
    /// The lattice points of the splats along x; arbitrary beyond the last.
    pub(crate) xs: [u32; LANES],
    /// The number of splats of the row: a column has a word of each.
    pub(crate) each_column: usize,
    /// The words of the first column from the first splat on, and all that follow.
    pub(crate) words: &'a [u32],
}

impl SplatRun<'_> {
    /// Returns word number `index` of each splat; arbitrary words beyond the last.
    #[inline(always)]
    pub(crate) fn column(&self, index: usize) -> [u32; LANES] {
        let words = &self.words[index * self.each_column..];
        if let Some(words) = words.first_chunk() {
            return *words;
        }
        let mut column = [0; LANES];
        column[..words.len()].copy_from_slice(words);
        column
    }
}

/// Unpacked normals of splats.
pub(crate) struct UnpackedNormals {
    /// The octahedral coordinates of the normals.
    pub(crate) places: [Lanes; 2],
    /// The weights of the normals: 1, or 0 for "no direction".
    pub(crate) weights: Lanes,
}

impl UnpackedNormals {
    /// Returns vectors of any length along the normals.
    #[inline(always)]
    pub(crate) fn directions(&self) -> Vectors {
        let (mut x, mut y, mut z) = (Lanes::default(), Lanes::default(), Lanes::default());
        for i in 0..LANES {
            let (px, py) = (self.places[0][i], self.places[1][i]);
            z[i] = 1.0 - px.abs() - py.abs();
            x[i] = if z[i] >= 0.0 { px } else { (1.0 - py.abs()) * sign_or_one(px) };
            y[i] = if z[i] >= 0.0 { py } else { (1.0 - px.abs()) * sign_or_one(py) };
        }
        [x, y, z]
    }
}

/// Unpacks the words of normals.
#[inline(always)]
pub(crate) fn unpacked(words: &[u32; LANES]) -> UnpackedNormals {
    let (mut px, mut py, mut weights) = (Lanes::default(), Lanes::default(), Lanes::default());
    for i in 0..LANES {
        let half = |bits: u32| (((bits << 16) as i32 >> 16) as f32 / 32767.0).max(-1.0);
        px[i] = half(words[i]);
        py[i] = half(words[i] >> 16);
        weights[i] = if words[i] == NO_NORMAL { 0.0 } else { 1.0 };
    }
    UnpackedNormals { places: [px, py], weights }
}
