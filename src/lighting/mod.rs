//! Light on surfaces: two-sided Blinn-Phong with the gradient of the field as normal.

pub(crate) mod shadow;

use glam::DVec3;

use self::shadow::Shares;
use crate::error::{Error, Result};
use crate::kernel::NORMAL_REACH;
use voxsplat_volume::names::named;

/// The place of a light.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub enum Source {
    /// A light at the eye. Its shadows are never visible, so it casts none.
    Eye,
    /// A light infinitely far away: the world direction towards it, of any length over 0.
    Direction(DVec3),
    /// A light at a place in the world. Its brightness does not fall with distance; its size is 0.
    Point(DVec3),
}

impl Source {
    /// Returns the world direction towards a light that is the same everywhere, for every eye; `None` for other lights.
    #[must_use]
    pub fn direction(&self) -> Option<DVec3> {
        if let Self::Direction(towards) = self { Some(*towards) } else { None }
    }
}

/// A light: place, colour and apparent size.
///
/// End a literal with `..Light::HEADLIGHT`: a minor release may add fields.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Light {
    /// The place of the light.
    pub source: Source,
    /// Red, green and blue of the light, 0 to [`Self::BRIGHTEST`]; 1, 1, 1 is white of intensity 1.
    pub color: [f64; 3],
    /// The apparent diameter of the light in degrees, 0 to 90: the sun has 0.5, a window 20. It only softens shadows: 0
    /// casts hard ones.
    pub size: f64,
    /// Makes literals that name all fields impossible.
    #[doc(hidden)]
    #[serde(skip)]
    pub non_exhaustive: (),
}

impl Light {
    /// A white light of intensity 1 at the eye.
    pub const HEADLIGHT: Self = Self { source: Source::Eye, color: [1.0; 3], size: 0.0, non_exhaustive: () };
    /// The largest component of a colour.
    pub const BRIGHTEST: f64 = 16.0;
    /// Number of directions that represent a light with a size.
    const DIRECTIONS: u32 = 12;

    /// Makes a white light of intensity 1, infinitely far away in a world direction of any length over 0.
    #[must_use]
    pub const fn directional(towards: DVec3) -> Self {
        Self { source: Source::Direction(towards), ..Self::HEADLIGHT }
    }

    /// Makes a white light of intensity 1 at a place in the world.
    #[must_use]
    pub const fn at(place: DVec3) -> Self {
        Self { source: Source::Point(place), ..Self::HEADLIGHT }
    }

    /// Returns the origin of the light for shadows: no direction if it is at the eye; for a light with a size, unit
    /// world directions spread evenly over its disc (Vogel 1979, "A better way to construct the sunflower head").
    fn origin(&self) -> LightOrigin {
        let towards = match self.source {
            Source::Eye => return LightOrigin::default(),
            Source::Point(place) => return LightOrigin::Point(place),
            Source::Direction(towards) => towards.normalize(),
        };
        if self.size <= 0.0 {
            return LightOrigin::Directions(vec![towards]);
        }
        let (across, down) = towards.any_orthonormal_pair();
        let narrowest = libm::cos(self.size.to_radians() / 2.0);
        let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
        let direction = |i: u32| {
            // Parts of a spherical cap of equal height have equal areas.
            let cosine = 1.0 - (1.0 - narrowest) * (f64::from(i) + 0.5) / f64::from(Self::DIRECTIONS);
            let sine = (1.0 - cosine * cosine).sqrt();
            let (y, x) = libm::sincos(golden * f64::from(i));
            towards * cosine + (across * x + down * y) * sine
        };
        LightOrigin::Directions((0..Self::DIRECTIONS).map(direction).collect())
    }
}

/// A material, its lights, and their shadows.
///
/// Let n be the unit normal (the direction of the gradient or its opposite, whichever faces the eye), v the direction
/// to the eye, l the direction to a light of colour i and h = (v + l) / |v + l|. A point of colour c then shows
///
/// ```text
/// c (ambient A + diffuse sum i L max(n.l, 0)) + specular sum i L max(n.h, 0)^shininess [n.l > 0]   clamped to 0..1
/// ```
///
/// (Blinn 1977, "Models of light reflection for computer synthesized pictures"). L is the share of the light that
/// reaches the point and A the share of the ambient light ([`Visibility`]): 1 without shadows and without occlusion.
/// If the gradient is 0 there is no surface, and the colour is c (ambient A + (1 - ambient) mean of L).
///
/// End a literal with `..Lighting::default()`: a minor release may add fields.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Lighting {
    /// The share of the colour that is visible without any light, 0 to 1.
    pub ambient: f64,
    /// The share of the colour that a light adds if it falls straight on the surface, 0 to 1.
    pub diffuse: f64,
    /// The strength of the highlight, which has the light's colour, 0 to 1.
    pub specular: f64,
    /// The exponent of the highlight, 1 to 1000; a larger exponent makes it smaller and sharper.
    pub shininess: f64,
    /// The lights, 1 to [`Lighting::MAX_LIGHTS`].
    pub lights: Vec<Light>,
    /// The darkness of shadows, from 0 (none) to 1 (absorbed light is missing in full). The first three lights cast
    /// shadows; the fourth, and lights at the eye, cast none.
    pub shadows: f64,
    /// The distance from a voxel's centre within which occluders are ignored, voxels, 0 to [`Self::MAX_BIAS`]. At 0 the
    /// half of the voxel itself that faces the light counts, so the surface of opaque matter lies in its own shadow. At
    /// 1.5 or more, surfaces that face the light are lit at any extinction.
    pub shadow_bias: f64,
    /// The distance within which voxels occlude the ambient light of each other, voxels; `None`: no occlusion.
    pub occlusion: Option<f64>,
    /// Whether shadows and occlusion are sums of all kernels on each ray instead of sweeps through the volume. The
    /// light of sweeps errs by about 1 of 255 (rms), and takes a tenth of the time or less.
    pub exact_shadows: bool,
    /// The method that finds normals of voxels of scalars in pre-shading, when a scene is prepared.
    pub normals: Normals,
    /// Makes literals that name all fields impossible.
    #[doc(hidden)]
    #[serde(skip)]
    pub non_exhaustive: (),
}

/// The method that finds the normals of voxels of scalars. Labels and masks have normals of their own, and post-shading
/// uses the gradient of the field.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Normals {
    /// The gradient, by a filter of 5^3 voxels (Farid and Simoncelli 2004, "Differentiation of discrete
    /// multidimensional signals").
    Gradient,
    /// The dominant direction of a structure tensor of these gradients: g g^T of the voxel and an eighth of g g^T of
    /// each of its six neighbours (Bigun and Granlund 1987, "Optimal orientation detection of linear symmetry"). At the
    /// ridge of a thin layer the gradient passes 0 and its direction is noise, but both sides agree on the axis. In
    /// noise normals of layers of 2 and 3 voxels err by a third as much; waves shorter than 10 voxels lose 0.2 to 0.9
    /// degrees.
    #[default]
    Tensor,
}

impl Normals {
    /// Returns the distance in voxels, to either side, of voxels on which a normal depends.
    pub(crate) fn reach(self) -> usize {
        match self {
            Self::Gradient => NORMAL_REACH,
            Self::Tensor => NORMAL_REACH + 1,
        }
    }
}

named!("normals", Normals { Gradient: "gradient", Tensor: "tensor" });

/// The largest number of lights that cast shadows.
pub(crate) const MAX_CASTING: usize = 3;

/// The share of light that reaches a point, 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
#[doc(hidden)]
pub struct Visibility {
    /// The share of each light, in order: exp(-D), where D is the optical depth towards the light; for a light with a
    /// size, the mean over 12 directions. The fourth light and lights at the eye have 1.
    pub lights: [f64; Lighting::MAX_LIGHTS],
    /// The share of the ambient light: twice the mean of exp(-D) over all directions, at most 1, with D the optical
    /// depth within [`Lighting::occlusion`].
    pub ambient: f64,
}

impl Visibility {
    /// The visibility of full light: all of it arrives.
    pub const FULL: Self = Self { lights: [1.0; Lighting::MAX_LIGHTS], ambient: 1.0 };

    /// Returns the visibility of one voxel of a row.
    pub(crate) fn of_voxel<const N: usize>(shares: &Shares<N>, index: usize) -> Self {
        let mut visibility = Self { ambient: shares[MAX_CASTING][index], ..Self::FULL };
        let lights = visibility.lights.iter_mut().zip(&shares[..MAX_CASTING]);
        lights.for_each(|(light, shares)| *light = shares[index]);
        visibility
    }
}

/// The origin of a light that casts shadows.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum LightOrigin {
    /// World directions towards the light, unit length; none: the light casts no shadows.
    Directions(Vec<DVec3>),
    /// A place in the world.
    Point(DVec3),
}

impl Default for LightOrigin {
    fn default() -> Self {
        Self::Directions(Vec::new())
    }
}

impl LightOrigin {
    fn is_none(&self) -> bool {
        matches!(self, Self::Directions(towards) if towards.is_empty())
    }
}

/// The lights that cast shadows, with bias, occlusion and method.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Casting {
    /// The origins of the lights.
    lights: [LightOrigin; MAX_CASTING],
    strength: f64,
    /// The shadow bias, voxels.
    bias: f64,
    /// The distance of occlusion, voxels.
    occlusion: Option<f64>,
    /// Whether all kernels on each ray are summed.
    exact: bool,
}

impl Casting {
    /// Returns whether a light casts shadows, or for [`MAX_CASTING`] whether voxels occlude ambient light.
    fn casts(&self, light: usize) -> bool {
        self.lights.get(light).map_or(self.occlusion.is_some(), |origin| !origin.is_none())
    }

    /// Returns whether a light casts shadows.
    pub(crate) fn casts_shadows(&self) -> bool {
        (0..MAX_CASTING).any(|light| self.casts(light))
    }

    /// Returns the number of directions of all lights that cast shadows.
    pub(crate) fn directions(&self) -> usize {
        let of = |origin: &LightOrigin| if let LightOrigin::Directions(towards) = origin { towards.len() } else { 0 };
        self.lights.iter().map(of).sum()
    }

    /// Returns the radius of occlusion, voxels.
    pub(crate) fn occlusion(&self) -> Option<f64> {
        self.occlusion
    }

    /// Returns whether a light at a place casts shadows.
    pub(crate) fn has_places(&self) -> bool {
        self.lights.iter().any(|origin| matches!(origin, LightOrigin::Point(_)))
    }

    /// Returns the shadows of one light alone, or for [`MAX_CASTING`] the occlusion of ambient light.
    pub(crate) fn only(&self, light: usize) -> Self {
        let mut lights: [LightOrigin; MAX_CASTING] = Default::default();
        if let Some(origin) = self.lights.get(light) {
            lights[light] = origin.clone();
            return Self { lights, occlusion: None, ..*self };
        }
        Self { lights, strength: 0.0, ..*self }
    }

    /// Returns whether all kernels on each ray are summed.
    pub(crate) fn is_exact(&self) -> bool {
        self.exact
    }

    /// Returns the distance from a voxel's centre within which occluders are ignored, voxels.
    pub(crate) fn bias(&self) -> f64 {
        self.bias
    }

    /// Returns the visibility at a point of the world, given its ambient share and a function of the optical depth from
    /// the point in a unit direction up to a distance.
    pub(crate) fn visibility(&self, point: DVec3, ambient: f64, depth: impl Fn(DVec3, f64) -> f64) -> Visibility {
        let mut visibility = Visibility { ambient, ..Visibility::FULL };
        for (share, origin) in visibility.lights.iter_mut().zip(&self.lights).filter(|(_, o)| !o.is_none()) {
            let mean = match origin {
                LightOrigin::Directions(towards) => {
                    towards.iter().map(|&t| libm::exp(-depth(t, f64::INFINITY))).sum::<f64>() / towards.len() as f64
                }
                &LightOrigin::Point(place) => {
                    let distance = place.distance(point);
                    libm::exp(-depth((place - point).normalize_or_zero(), distance))
                }
            };
            *share = 1.0 - self.strength * (1.0 - mean);
        }
        visibility
    }
}

impl Default for Lighting {
    fn default() -> Self {
        Self {
            ambient: 0.3,
            diffuse: 0.7,
            specular: 0.2,
            shininess: 24.0,
            lights: vec![Light::HEADLIGHT],
            shadows: 0.0,
            shadow_bias: 1.5,
            occlusion: None,
            exact_shadows: false,
            normals: Normals::default(),
            non_exhaustive: (),
        }
    }
}

impl Lighting {
    /// The largest number of lights.
    pub const MAX_LIGHTS: usize = 4;
    /// Returns a lighting that changes no colour.
    pub(crate) fn flat() -> Self {
        Self { ambient: 1.0, diffuse: 0.0, specular: 0.0, ..Self::default() }
    }

    /// The largest shadow bias, voxels.
    pub const MAX_BIAS: f64 = 16.0;

    /// The largest distance of occlusion, voxels.
    pub const MAX_OCCLUSION: f64 = 256.0;

    /// Refuses numbers out of range, no light or too many, and directions without length.
    ///
    /// # Errors
    /// [`Error::Setting`] that states the wrong value and the accepted values.
    pub fn validate(&self) -> Result<()> {
        let error = |name, reason: String| Err(Error::Setting { name, reason });
        for (name, what, value, low, high) in [
            ("material", "ambient", self.ambient, 0.0, 1.0),
            ("material", "diffuse", self.diffuse, 0.0, 1.0),
            ("material", "specular", self.specular, 0.0, 1.0),
            ("material", "shininess", self.shininess, 1.0, 1000.0),
            ("shadows", "strength", self.shadows, 0.0, 1.0),
            ("shadow_bias", "distance", self.shadow_bias, 0.0, Self::MAX_BIAS),
            ("occlusion", "radius", self.occlusion.unwrap_or(1.0), 0.5, Self::MAX_OCCLUSION),
        ] {
            if !(low..=high).contains(&value) {
                return error(name, format!("{what} is {value}, expected {low} to {high}"));
            }
        }
        if self.lights.is_empty() || self.lights.len() > Self::MAX_LIGHTS {
            return error("light", format!("{} lights, expected 1 to {}", self.lights.len(), Self::MAX_LIGHTS));
        }
        for light in &self.lights {
            match light.source {
                Source::Direction(towards) if !(towards.is_finite() && towards.length() > 0.0) => {
                    return error("light", format!("direction {towards} points nowhere"));
                }
                Source::Point(place) if !place.is_finite() => {
                    return error("light", format!("place {place}, expected finite numbers"));
                }
                Source::Point(_) if light.size > 0.0 => {
                    return error("light_size", "a light at a place is a point".to_owned());
                }
                _ => (),
            }
            if !light.color.iter().all(|c| (0.0..=Light::BRIGHTEST).contains(c)) {
                let reason = format!("colour {:?}, expected numbers from 0 to {}", light.color, Light::BRIGHTEST);
                return error("light", reason);
            }
            if !(0.0..=90.0).contains(&light.size) {
                return error("light_size", format!("{} degrees, expected 0 to 90", light.size));
            }
        }
        Ok(())
    }

    /// Returns a photographer's set of lights for an eye that looks `forward` with `up` upwards (world directions, not
    /// parallel): a large warm key light from the upper left, which casts soft shadows, a weak cool fill light from the
    /// right, which casts none, a rim light from behind, and a weak light at the eye. Voxels occlude the ambient light
    /// of each other within 8 voxels. The lights keep their places in the world if the eye moves.
    #[must_use]
    pub fn studio(forward: DVec3, up: DVec3) -> Self {
        let forward = forward.normalize();
        let right = forward.cross(up).normalize_or(forward.any_orthonormal_vector());
        let up = right.cross(forward);
        let light = |towards: [f64; 3], color: [f64; 3], size: f64| {
            let towards = right * towards[0] + up * towards[1] - forward * towards[2];
            Light { color, size, ..Light::directional(towards) }
        };
        let key = light([-0.55, 0.65, 0.6], [1.35, 1.31, 1.24], 10.0);
        let rim = light([0.5, 0.6, -0.6], [0.9, 0.9, 1.0], 0.0);
        let fill = light([0.8, 0.1, 0.7], [0.28, 0.28, 0.3], 0.0);
        let front = Light { color: [0.25; 3], ..Light::HEADLIGHT };
        Self {
            ambient: 0.4,
            diffuse: 0.7,
            lights: vec![key, rim, front, fill],
            shadows: 0.85,
            occlusion: Some(8.0),
            ..Self::default()
        }
    }

    /// Returns the lights that cast shadows; `None` if there are no shadows and no occlusion.
    pub(crate) fn casting(&self) -> Option<Casting> {
        let mut lights: [LightOrigin; MAX_CASTING] = Default::default();
        if self.shadows > 0.0 {
            lights.iter_mut().zip(&self.lights).for_each(|(origin, light)| *origin = light.origin());
        }
        let casts = self.occlusion.is_some() || lights.iter().any(|origin| !origin.is_none());
        casts.then_some(Casting {
            lights,
            strength: self.shadows,
            bias: self.shadow_bias,
            occlusion: self.occlusion,
            exact: self.exact_shadows,
        })
    }

    /// Returns whether any light is at a place.
    pub(crate) fn has_points(&self) -> bool {
        self.lights.iter().any(|light| matches!(light.source, Source::Point(_)))
    }

    /// Returns the lighting in a world whose origin lies at `origin`.
    pub(crate) fn seen_from(&self, origin: DVec3) -> Self {
        let mut lighting = self.clone();
        for light in &mut lighting.lights {
            if let Source::Point(place) = &mut light.source {
                *place -= origin;
            }
        }
        lighting
    }

    /// Returns the largest factor by which ambient and diffuse light multiply a channel of the colour of a surface
    /// around `place`, among surfaces that face the eye or a light, seen in the unit direction `forward`.
    pub(crate) fn brightest_factor(&self, place: DVec3, forward: DVec3) -> f64 {
        let towards = |light: &Light| match light.source {
            Source::Eye => -forward,
            Source::Direction(towards) => towards.normalize(),
            Source::Point(light) => (light - place).normalize_or(-forward),
        };
        let factor = |normal: DVec3, channel: usize| {
            let fall = |light: &Light| light.color[channel] * normal.dot(towards(light)).max(0.0);
            self.ambient + self.diffuse * self.lights.iter().map(fall).sum::<f64>()
        };
        let facing = self.lights.iter().map(towards).filter(|normal| normal.dot(forward) < 0.0).chain([-forward]);
        facing.flat_map(|normal| [0, 1, 2].map(|channel| factor(normal, channel))).fold(0.0, f64::max)
    }

    /// Returns the colour of a point without a surface.
    pub(crate) fn shade_without_surface(&self, color: [f64; 3], visibility: &Visibility) -> [f64; 3] {
        let lights = self.lights.iter().zip(visibility.lights);
        let kept = 1.0 - lights.map(|(_, kept)| 1.0 - kept).sum::<f64>() / self.lights.len() as f64;
        let shown = 1.0 - self.ambient * (1.0 - visibility.ambient) - (1.0 - self.ambient) * (1.0 - kept);
        color.map(|c| c * shown)
    }

    /// Returns the colour of a lit point. `color` is its own colour, `gradient` the gradient of the field in world
    /// coordinates, of any length, `place` the point in the world, `to_eye` the unit world direction to the eye, and
    /// `visibility` the share of the light that arrives.
    #[must_use]
    #[doc(hidden)]
    pub fn shade(
        &self,
        color: [f64; 3],
        gradient: DVec3,
        place: DVec3,
        to_eye: DVec3,
        visibility: &Visibility,
    ) -> [f64; 3] {
        let length = gradient.length();
        let ambient = self.ambient * visibility.ambient;
        let lights = self.lights.iter().zip(visibility.lights);
        if length <= 0.0 {
            return self.shade_without_surface(color, visibility);
        }
        let normal = gradient / if gradient.dot(to_eye) < 0.0 { -length } else { length };
        let (mut diffuse, mut specular) = ([0.0; 3], [0.0; 3]);
        for (light, kept) in lights {
            let towards = match light.source {
                Source::Eye => to_eye,
                Source::Direction(towards) => towards.normalize(),
                // At the light itself the direction is undefined: the eye's stands for it.
                Source::Point(light) => (light - place).try_normalize().unwrap_or(to_eye),
            };
            let half_way = match light.source {
                Source::Eye => to_eye,
                _ => (to_eye + towards).normalize_or_zero(),
            };
            let cosine = normal.dot(towards);
            if cosine > 0.0 {
                let highlight = normal.dot(half_way).max(0.0);
                // Whole exponents up to 1000 take a fraction of the time.
                let highlight = if self.shininess.fract() == 0.0 {
                    highlight.powi(self.shininess as i32)
                } else {
                    libm::pow(highlight, self.shininess)
                };
                for (channel, intensity) in light.color.iter().enumerate() {
                    diffuse[channel] += intensity * kept * cosine;
                    specular[channel] += intensity * kept * highlight;
                }
            }
        }
        std::array::from_fn(|c| {
            (color[c] * (ambient + self.diffuse * diffuse[c]) + self.specular * specular[c]).clamp(0.0, 1.0)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_sides_of_a_surface_are_lit_alike_by_a_headlight() {
        let lighting = Lighting::default();
        for gradient in [DVec3::new(0.3, -2.0, 0.4), DVec3::new(1e-9, 1e-9, 0.0)] {
            let shown = |g: DVec3| lighting.shade([0.5, 0.2, 0.9], g, DVec3::ZERO, DVec3::NEG_Y, &Visibility::FULL);
            assert_eq!(shown(gradient), shown(-gradient));
        }
    }

    #[test]
    fn a_light_from_the_side_leaves_the_other_side_in_shadow() {
        let lighting = Lighting { lights: vec![Light::directional(DVec3::X * 3.0)], ..Lighting::default() };
        let shown = |g: DVec3| lighting.shade([0.5; 3], g, DVec3::ZERO, DVec3::NEG_Y, &Visibility::FULL)[0];
        let (lit, dark) = (shown(DVec3::new(1.0, -0.2, 0.0)), shown(DVec3::new(-1.0, -0.2, 0.0)));
        assert!(lit > 0.45, "{lit}");
        assert!((dark - 0.15).abs() < 1e-12, "{dark}");
    }

    #[test]
    fn a_light_at_a_place_lights_what_faces_it() {
        let lighting = Lighting { lights: vec![Light::at(DVec3::new(2.0, 0.0, 0.0))], ..Lighting::default() };
        let directional = |towards: DVec3| Lighting { lights: vec![Light::directional(towards)], ..lighting.clone() };
        for place in [DVec3::ZERO, DVec3::new(2.0, 1.0, -3.0), DVec3::new(7.0, -4.0, 0.5)] {
            let gradient = DVec3::new(0.4, -1.0, 0.3);
            let shown = |l: &Lighting| l.shade([0.5; 3], gradient, place, DVec3::NEG_Y, &Visibility::FULL);
            assert_eq!(shown(&lighting), shown(&directional(DVec3::new(2.0, 0.0, 0.0) - place)));
        }
        let wide = Lighting { lights: vec![Light { size: 3.0, ..Light::at(DVec3::X) }], ..lighting };
        assert_eq!(wide.validate().unwrap_err().to_string(), "light_size: a light at a place is a point");
    }

    #[test]
    fn a_surface_that_faces_eye_and_light_is_brightest() {
        let lighting = Lighting::default();
        let shown = lighting.shade([0.5; 3], DVec3::Y, DVec3::ZERO, DVec3::Y, &Visibility::FULL);
        assert!((shown[0] - (0.5 + 0.2)).abs() < 1e-12);
        assert_eq!(
            lighting.shade([0.5, 0.4, 0.3], DVec3::ZERO, DVec3::ZERO, DVec3::Y, &Visibility::FULL),
            [0.5, 0.4, 0.3]
        );
    }

    #[test]
    fn wrong_materials_are_refused() {
        let nowhere = vec![Light::directional(DVec3::ZERO)];
        for (wrong, expected) in [
            (Lighting { ambient: -0.1, ..Lighting::default() }, "material: ambient is -0.1"),
            (Lighting { shininess: f64::NAN, ..Lighting::default() }, "material: shininess is NaN"),
            (Lighting { lights: vec![], ..Lighting::default() }, "light: 0 lights"),
            (Lighting { lights: nowhere, ..Lighting::default() }, "light: direction [0, 0, 0] points nowhere"),
        ] {
            let error = wrong.validate().unwrap_err().to_string();
            assert!(error.starts_with(expected), "{error}");
        }
        assert!(Lighting::default().validate().is_ok());
    }
}
