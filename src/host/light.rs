//! Light on sixteen rays: [`Lighting::shade`] in single precision.

use pulp::Simd;

use super::lanes::{Lanes, three};
use crate::lighting::{Lighting, Source};

/// A vector of the world for each of sixteen rays.
pub(super) type Vector<S> = [Lanes<S>; 3];

/// The place of a light.
#[derive(Clone, Copy)]
enum LightPosition {
    Eye,
    Towards([f32; 3]),
    At([f32; 3]),
}

/// The material and the lights of a picture.
pub(super) struct Shader {
    ambient: f32,
    diffuse: f32,
    specular: f32,
    shininess: f32,
    lights: Vec<(LightPosition, [f32; 3])>,
    /// The share of the distance of a scalar from the base that counts as rounding, and the resolution of the base.
    pub(super) resolution: [f32; 2],
}

/// Light on a colour: the colour times `diffuse`, plus `specular`, has the weight `surface`; the colour times `plain`
/// is added.
#[derive(Clone, Copy)]
pub(super) struct Shine<S: Simd> {
    diffuse: Vector<S>,
    specular: Vector<S>,
    surface: Lanes<S>,
    plain: Lanes<S>,
}

#[inline(always)]
pub(super) fn dot<S: Simd>(simd: S, a: &Vector<S>, b: &Vector<S>) -> Lanes<S> {
    a[0].fma(simd, b[0], a[1].fma(simd, b[1], a[2].mul(simd, b[2])))
}

/// Divides vectors by their lengths; zeros stay.
#[inline(always)]
pub(super) fn unit<S: Simd>(simd: S, vector: &Vector<S>) -> Vector<S> {
    let length = dot(simd, vector, vector).max(simd, Lanes::all(simd, 1e-30)).sqrt(simd);
    let inverse = Lanes::all(simd, 1.0).div(simd, length);
    three!(axis => vector[axis].mul(simd, inverse))
}

impl Shader {
    /// Converts material and lights. Places are relative to `center`, the middle of the lattice, in units of the
    /// smallest spacing, `unit`.
    pub(super) fn new(lighting: &Lighting, center: glam::DVec3, unit: f64, resolution: [f32; 2]) -> Self {
        let place = |source: &Source| match source {
            Source::Eye => LightPosition::Eye,
            Source::Direction(towards) => LightPosition::Towards(towards.normalize().as_vec3().to_array()),
            Source::Point(place) => LightPosition::At(((*place - center) / unit).as_vec3().to_array()),
        };
        let lights = lighting.lights.iter().map(|light| (place(&light.source), light.color.map(|c| c as f32)));
        Self {
            ambient: lighting.ambient as f32,
            diffuse: lighting.diffuse as f32,
            specular: lighting.specular as f32,
            shininess: lighting.shininess as f32,
            lights: lights.collect(),
            resolution,
        }
    }

    /// Returns whether some light is at a place, so that places of surfaces matter.
    pub(super) fn has_places(&self) -> bool {
        self.lights.iter().any(|(place, _)| matches!(place, LightPosition::At(_)))
    }

    /// Returns the share of surfaces where the largest of the central differences along the axes of the lattice is
    /// `differences`.
    #[inline(always)]
    pub(super) fn surface<S: Simd>(&self, simd: S, differences: Lanes<S>, scalar: Lanes<S>) -> Lanes<S> {
        let [of_distance, faintest] = self.resolution;
        let resolution = scalar.abs(simd).fma(simd, Lanes::all(simd, of_distance), Lanes::all(simd, faintest));
        let share = differences.div(simd, resolution).min(simd, Lanes::all(simd, 1e4));
        let square = share.mul(simd, share);
        let fourth = square.mul(simd, square);
        fourth.div(simd, fourth.add(simd, Lanes::all(simd, 1.0)))
    }

    /// Returns the light on surfaces across gradients of the world, whose lengths are between 1e-15 and 1e15 or 0.
    /// `kept` are the shares of the lights and of ambient light that arrive; `None` if all light does.
    #[inline(always)]
    pub(super) fn shine<S: Simd>(
        &self,
        simd: S,
        gradient: &Vector<S>,
        surface: Lanes<S>,
        place: &Vector<S>,
        to_eye: &Vector<S>,
        kept: Option<&[Lanes<S>; 4]>,
    ) -> Shine<S> {
        let (zero, one) = (Lanes::all(simd, 0.0), Lanes::all(simd, 1.0));
        let square = dot(simd, gradient, gradient).max(simd, Lanes::all(simd, 1e-30));
        let inverse = one.div(simd, square.sqrt(simd));
        let facing = dot(simd, gradient, to_eye).mul(simd, inverse);
        let cosine_of_eye = facing.abs(simd);
        // The normal is the gradient times this: it faces the eye.
        let to_normal = zero.sub(simd, inverse).or(simd, facing.less(simd, zero), inverse);
        let ambient_kept = match kept {
            Some(kept) => kept[3],
            None => one,
        };
        let ambient = ambient_kept.mul(simd, Lanes::all(simd, self.ambient));
        let (mut diffuse, mut specular) = ([zero; 3], [zero; 3]);
        let mut lost = zero;
        for (number, (light, color)) in self.lights.iter().enumerate() {
            let arrives = match kept {
                Some(kept) if number < 3 => kept[number],
                _ => one,
            };
            lost = lost.add(simd, one.sub(simd, arrives));
            let (cosine, highlight) = match light {
                LightPosition::Eye => (cosine_of_eye, cosine_of_eye),
                LightPosition::Towards(_) | LightPosition::At(_) => {
                    let towards = match light {
                        LightPosition::At(at) => {
                            let way = three!(axis => Lanes::all(simd, at[axis]).sub(simd, place[axis]));
                            let square = dot(simd, &way, &way);
                            let towards = unit(simd, &way);
                            // At the place of the light, light comes from the eye.
                            let is_there = square.less(simd, Lanes::all(simd, 1e-20));
                            three!(axis => to_eye[axis].or(simd, is_there, towards[axis]))
                        }
                        LightPosition::Towards(towards) => three!(axis => Lanes::all(simd, towards[axis])),
                        LightPosition::Eye => *to_eye,
                    };
                    let cosine = dot(simd, gradient, &towards).mul(simd, to_normal);
                    let between: Vector<S> = three!(axis => to_eye[axis].add(simd, towards[axis]));
                    let half_way = unit(simd, &between);
                    let highlight = dot(simd, gradient, &half_way).mul(simd, to_normal).max(simd, zero);
                    (cosine, zero.or(simd, cosine.less(simd, Lanes::all(simd, f32::MIN_POSITIVE)), highlight))
                }
            };
            let diffuse_share = cosine.max(simd, zero).mul(simd, arrives);
            let specular_share = highlight.min(simd, one).power(simd, self.shininess).mul(simd, arrives);
            for channel in 0..3 {
                diffuse[channel] = diffuse_share.fma(simd, Lanes::all(simd, color[channel]), diffuse[channel]);
                specular[channel] = specular_share.fma(simd, Lanes::all(simd, color[channel]), specular[channel]);
            }
        }
        // The light that arrives where there is no surface.
        let mean_lost = lost.mul(simd, Lanes::all(simd, 1.0 / self.lights.len() as f32));
        let shaded = one.sub(simd, ambient_kept).mul(simd, Lanes::all(simd, self.ambient));
        let without = one.sub(simd, shaded).sub(simd, mean_lost.mul(simd, Lanes::all(simd, 1.0 - self.ambient)));
        Shine {
            diffuse: three!(c => diffuse[c].fma(simd, Lanes::all(simd, self.diffuse), ambient)),
            specular: three!(c => specular[c].mul(simd, Lanes::all(simd, self.specular))),
            surface,
            plain: one.sub(simd, surface).mul(simd, without),
        }
    }
}

impl<S: Simd> Shine<S> {
    /// Returns a channel of a colour under this light.
    #[inline(always)]
    pub(super) fn lit(&self, simd: S, channel: usize, color: Lanes<S>) -> Lanes<S> {
        let (zero, one) = (Lanes::all(simd, 0.0), Lanes::all(simd, 1.0));
        let shaded = color.fma(simd, self.diffuse[channel], self.specular[channel]).max(simd, zero).min(simd, one);
        shaded.fma(simd, self.surface, self.plain.mul(simd, color))
    }
}
