//! The twin of shaders/common/splat.wgsl, normal.wgsl, resolution.wgsl and lighting.wgsl on the host: the words of
//! splats and the light on them.

use pulp::{Arch, NullaryFnOnce};

use super::layout::Lighting;
use crate::transfer::Resolution;

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

/// Unpacked normals of splats.
struct Normals {
    /// Octahedral coordinates.
    places: [Lanes; 2],
    /// 1, or 0 for "no direction".
    weights: Lanes,
}

/// Unpacks the words of normals.
#[inline(always)]
fn unpacked(words: &[u32; LANES]) -> Normals {
    let (mut px, mut py, mut weights) = (Lanes::default(), Lanes::default(), Lanes::default());
    for i in 0..LANES {
        let half = |bits: u32| (((bits << 16) as i32 >> 16) as f32 / 32767.0).max(-1.0);
        px[i] = half(words[i]);
        py[i] = half(words[i] >> 16);
        weights[i] = if words[i] == NO_NORMAL { 0.0 } else { 1.0 };
    }
    Normals { places: [px, py], weights }
}

/// Unit vectors across surfaces in view coordinates, facing the eye; 0 for "no direction".
#[inline(always)]
fn facing(lighting: &Lighting, Normals { places, weights }: &Normals, to_eye: &Vectors) -> Vectors {
    let mut normals = Vectors::default();
    let Lighting { right, up, forward, .. } = lighting;
    for i in 0..LANES {
        let (px, py) = (places[0][i], places[1][i]);
        let z = 1.0 - px.abs() - py.abs();
        let x = if z >= 0.0 { px } else { (1.0 - py.abs()) * sign_or_one(px) };
        let y = if z >= 0.0 { py } else { (1.0 - px.abs()) * sign_or_one(py) };
        let gradient = [right, up, forward].map(|axis| axis[0] * x + axis[1] * y + axis[2] * z);
        let [a, b, c] = gradient;
        let towards = a * to_eye[0][i] + b * to_eye[1][i] + c * to_eye[2][i];
        let length = (a * a + b * b + c * c).sqrt();
        let facing = if towards < 0.0 { -1.0 } else { 1.0 };
        let factor = if weights[i] == 0.0 || length <= 0.0 { 0.0 } else { facing / length };
        normals[0][i] = a * factor;
        normals[1][i] = b * factor;
        normals[2][i] = c * factor;
    }
    normals
}

/// x^exponent for x from 0 to a little over 1, to 2e-6.
#[inline(always)]
fn power(x: f32, exponent: f32) -> f32 {
    // x = 2^whole * m with m from sqrt(1/2) to sqrt(2), and ln(m) = 2 atanh((m - 1) / (m + 1)).
    let bits = x.max(f32::MIN_POSITIVE).to_bits().wrapping_sub(0x3f35_04f3);
    let whole = (bits as i32 >> 23) as f32;
    let m = f32::from_bits((bits & 0x7f_ffff) + 0x3f35_04f3);
    let t = (m - 1.0) / (m + 1.0);
    let t2 = t * t;
    let series = 2.0 * std::f32::consts::LOG2_E + t2 * (0.961_796_7 + t2 * (0.577_078_04 + t2 * 0.412_198_6));
    let y = (exponent * (whole + t * series)).clamp(-126.0, 126.0);
    // 2^y: the nearest whole number, from a sum without bits for a fraction, and the series of the rest.
    let rounded = y + 12_582_912.0;
    let f = (y - (rounded - 12_582_912.0)) * std::f32::consts::LN_2;
    let rest = 1.0 + f * (1.0 + f * (0.5 + f * (1.0 / 6.0 + f * (1.0 / 24.0 + f * (1.0 / 120.0 + f * (1.0 / 720.0))))));
    f32::from_bits((rounded.to_bits() << 23).wrapping_add(rest.to_bits()))
}

/// Unit vectors opposite to x * step + start, for each x.
#[inline(always)]
fn directions(xs: &[u32; LANES], step: [f32; 3], start: [f32; 3]) -> Vectors {
    let (mut vx, mut vy, mut vz) = (Lanes::default(), Lanes::default(), Lanes::default());
    for i in 0..LANES {
        let x = xs[i] as i32 as f32;
        let (a, b, c) = (x * step[0] + start[0], x * step[1] + start[1], x * step[2] + start[2]);
        let factor = -1.0 / (a * a + b * b + c * c).sqrt();
        vx[i] = a * factor;
        vy[i] = b * factor;
        vz[i] = c * factor;
    }
    [vx, vy, vz]
}

/// The directions from lattice points to the eye.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ToEye {
    /// Rays go through one eye; otherwise they are parallel.
    pub(crate) perspective: bool,
    /// Lattice point of the eye.
    pub(crate) eye: [f32; 3],
    /// View coordinates of a step along each axis of the lattice.
    pub(crate) view: [[f32; 3]; 3],
}

impl ToEye {
    /// The directions along parallel rays: all the same.
    pub(crate) const PARALLEL: Self = Self { perspective: false, eye: [0.0; 3], view: [[0.0; 3]; 3] };

    /// The directions from these points of a row, in view coordinates.
    #[inline(always)]
    fn at(&self, xs: &[u32; LANES], y: u32, z: u32) -> Vectors {
        if !self.perspective {
            return [[0.0; LANES], [0.0; LANES], [-1.0; LANES]];
        }
        let Self { eye, view: [along_x, along_y, along_z], .. } = self;
        let (oy, oz) = (y as f32 - eye[1], z as f32 - eye[2]);
        directions(xs, *along_x, [0, 1, 2].map(|i| along_y[i] * oy + along_z[i] * oz - along_x[i] * eye[0]))
    }
}

/// The places of lattice points in the coordinates of lights.
#[inline(always)]
fn places(lighting: &Lighting, xs: &[u32; LANES], y: u32, z: u32) -> Vectors {
    let [along_x, along_y, along_z, origin] = lighting.from_lattice;
    std::array::from_fn(|axis| {
        let start = along_y[axis] * y as f32 + along_z[axis] * z as f32 + origin[axis];
        xs.map(|x| along_x[axis] * x as i32 as f32 + start)
    })
}

/// Unit vectors from places towards a light; to the eye at the light itself.
#[inline(always)]
fn converging(light: [f32; 3], places: &Vectors, to_eye: &Vectors) -> Vectors {
    let mut towards = *to_eye;
    for i in 0..LANES {
        let way = [0, 1, 2].map(|axis| light[axis] - places[axis][i]);
        let square = way[0] * way[0] + way[1] * way[1] + way[2] * way[2];
        if square > 1e-20 {
            (0..3).for_each(|axis| towards[axis][i] = way[axis] / square.sqrt());
        }
    }
    towards
}

/// The index of ambient light among the shares.
const AROUND: usize = 3;

/// The shares of light that arrive at splats, given the words `kept`.
#[inline(always)]
fn kept([low, high]: &[[u32; LANES]; 2]) -> [Lanes; 4] {
    let mut kept = [Lanes::default(); 4];
    for i in 0..LANES {
        let shares = [low[i] & 0xffff, low[i] >> 16, high[i] & 0xffff, high[i] >> 16];
        (0..4).for_each(|share| kept[share][i] = shares[share] as i32 as f32 / 65_535.0);
    }
    kept
}

/// Lights splats of these colours, given their normals and unit vectors to the eye in view coordinates: `lit_splat` in
/// shaders/common/lit_splat.wgsl.
///
/// `kept` are the shares of the light that arrive from lights with shadows and from all around; `None`: all of it.
/// `places` are the places of the splats; `None`: no light has a position.
#[inline(always)]
fn light(
    lighting: &Lighting,
    lights: u32,
    colors: &mut Vectors,
    normals: &Normals,
    kept: Option<&[Lanes; 4]>,
    places: Option<&Vectors>,
    to_eye: &Vectors,
) {
    let weights = &normals.weights;
    let normals = facing(lighting, normals, to_eye);
    let (mut diffuse, mut specular) = (Vectors::default(), Vectors::default());
    for (number, (&[x, y, z, w], intensity)) in
        lighting.lights[..lights as usize].iter().zip(&lighting.colors).enumerate()
    {
        let towards = match places {
            Some(places) if w > 0.0 => converging([x, y, z], places, to_eye),
            _ if [x, y, z] == [0.0; 3] => *to_eye,
            _ => [[x; LANES], [y; LANES], [z; LANES]],
        };
        // In steps without a choice, which vectorise.
        let (mut cosines, mut shines) = (Lanes::default(), Lanes::default());
        for i in 0..LANES {
            let [ex, ey, ez] = [to_eye[0][i], to_eye[1][i], to_eye[2][i]];
            let [lx, ly, lz] = [towards[0][i], towards[1][i], towards[2][i]];
            let [nx, ny, nz] = [normals[0][i], normals[1][i], normals[2][i]];
            let [hx, hy, hz] = [ex + lx, ey + ly, ez + lz];
            cosines[i] = nx * lx + ny * ly + nz * lz;
            shines[i] = (nx * hx + ny * hy + nz * hz) / (hx * hx + hy * hy + hz * hz).max(1e-20).sqrt();
        }
        for shine in &mut shines {
            *shine = power(*shine, lighting.shininess);
        }
        for i in 0..LANES {
            shines[i] = if cosines[i] > 0.0 { shines[i] } else { 0.0 };
            cosines[i] = cosines[i].max(0.0);
        }
        // The fourth light has no shadows.
        if let Some(kept) = kept
            && number < AROUND
        {
            for i in 0..LANES {
                cosines[i] *= kept[number][i];
                shines[i] *= kept[number][i];
            }
        }
        for channel in 0..3 {
            for i in 0..LANES {
                diffuse[channel][i] += intensity[channel] * cosines[i];
                specular[channel][i] += intensity[channel] * shines[i];
            }
        }
    }
    let (mut ambient, mut shown) = ([lighting.ambient; LANES], [1.0; LANES]);
    if let Some(kept) = kept {
        for i in 0..LANES {
            ambient[i] *= kept[AROUND][i];
            let lost = ((1.0 - kept[0][i]) + (1.0 - kept[1][i]) + (1.0 - kept[2][i])) / lights as f32;
            shown[i] = 1.0 - lighting.ambient * (1.0 - kept[AROUND][i]) - (1.0 - lighting.ambient) * lost;
        }
    }
    for (color, (diffuse, specular)) in colors.iter_mut().zip(diffuse.iter().zip(&specular)) {
        for i in 0..LANES {
            let lit = color[i] * (ambient[i] + lighting.diffuse * diffuse[i]) + lighting.specular * specular[i];
            // Without a normal there is no surface.
            color[i] = weights[i] * lit.clamp(0.0, 1.0) + (1.0 - weights[i]) * shown[i] * color[i];
        }
    }
}

/// The light of a picture on splats.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SplatLight {
    pub(crate) lighting: Lighting,
    /// The number of lights.
    pub(crate) lights: u32,
    /// Whether a light has a position.
    pub(crate) points: bool,
    pub(crate) to_eye: ToEye,
}

impl SplatLight {
    /// Lights splats of these colours at points of a row. `arriving` are the words of the light that arrives; `None`:
    /// all of it.
    pub(crate) fn apply(
        &self,
        points: (&[u32; LANES], [u32; 2]),
        colors: &mut Vectors,
        normals: &[u32; LANES],
        arriving: Option<&[[u32; LANES]; 2]>,
    ) {
        Arch::new().dispatch(Shining { light: self, points, colors, normals, arriving });
    }
}

/// The parameters of [`SplatLight::apply`], as a type so that it is compiled for the widest vectors of the machine.
struct Shining<'a> {
    light: &'a SplatLight,
    points: (&'a [u32; LANES], [u32; 2]),
    colors: &'a mut Vectors,
    normals: &'a [u32; LANES],
    arriving: Option<&'a [[u32; LANES]; 2]>,
}

impl NullaryFnOnce for Shining<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { light: SplatLight { lighting, lights, points, to_eye }, colors, normals, arriving, .. } = self;
        let (xs, [y, z]) = self.points;
        let to_eye = to_eye.at(xs, y, z);
        let places = points.then(|| places(lighting, xs, y, z));
        light(lighting, *lights, colors, &unpacked(normals), arriving.map(kept).as_ref(), places.as_ref(), &to_eye);
    }
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

    #[test]
    fn powers_are_those_of_f64() {
        for exponent in [1.0_f32, 2.5, 24.0, 1000.0] {
            for x in (0..=2000).map(|i| i as f32 / 2000.0).chain([1.000_000_1, 0.999_999_9, 1e-30]) {
                let exact = f64::from(x).powf(f64::from(exponent));
                let got = f64::from(power(x, exponent));
                assert!((got - exact).abs() <= 2e-6, "{x}^{exponent}: {got} for {exact}");
            }
        }
    }
}
