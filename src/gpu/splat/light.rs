//! The twin of shaders/common/lighting.wgsl and lit_splat.wgsl on the host: the light on splats.

use pulp::{Arch, NullaryFnOnce};

use crate::gpu::layout::Lighting;
use crate::splats::words::{LANES, Lanes, Normals, Vectors, unpacked};

/// Unit vectors across surfaces in view coordinates, facing the eye; 0 for "no direction".
#[inline(always)]
fn facing(lighting: &Lighting, normals: &Normals, to_eye: &Vectors) -> Vectors {
    let (directions, weights) = (normals.directions(), &normals.weights);
    let mut normals = Vectors::default();
    let Lighting { right, up, forward, .. } = lighting;
    for i in 0..LANES {
        let [x, y, z] = [directions[0][i], directions[1][i], directions[2][i]];
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
pub(super) struct Shining<'a> {
    pub(super) light: &'a SplatLight,
    pub(super) points: (&'a [u32; LANES], [u32; 2]),
    pub(super) colors: &'a mut Vectors,
    pub(super) normals: &'a [u32; LANES],
    pub(super) arriving: Option<&'a [[u32; LANES]; 2]>,
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

#[cfg(test)]
mod tests {
    use super::*;

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
