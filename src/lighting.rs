//! Light on surfaces: two-sided Blinn-Phong with the gradient of the field as normal.

use glam::DVec3;

use crate::error::{Error, Result};

/// A light. Every light is white and has intensity 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Light {
    /// From the eye.
    Headlight,
    /// From infinitely far away: the world direction towards the light, of any length over 0.
    Directional(DVec3),
}

/// A material and the lights on it.
///
/// Let n be the unit normal (the direction of the gradient or its opposite, whichever faces the eye), v the direction
/// to the eye, l the direction to a light and h = (v + l) / |v + l|. A point of colour c then shows
///
/// ```text
/// c (ambient + diffuse sum max(n.l, 0)) + specular sum max(n.h, 0)^shininess [n.l > 0]      clamped to 0..1
/// ```
///
/// (Blinn 1977, "Models of light reflection for computer synthesized pictures"). If the gradient is 0 there is no
/// surface, and the colour stays as it is.
#[derive(Debug, Clone, PartialEq)]
pub struct Lighting {
    /// Share of the colour that shows without any light, 0 to 1.
    pub ambient: f64,
    /// Share of the colour that a light adds if it falls straight on the surface, 0 to 1.
    pub diffuse: f64,
    /// Strength of the white highlight, 0 to 1.
    pub specular: f64,
    /// Exponent of the highlight, 1 to 1000; a larger exponent makes it smaller and sharper.
    pub shininess: f64,
    /// The lights, 1 to [`Lighting::MAX_LIGHTS`].
    pub lights: Vec<Light>,
}

impl Default for Lighting {
    fn default() -> Self {
        Self { ambient: 0.3, diffuse: 0.7, specular: 0.2, shininess: 24.0, lights: vec![Light::Headlight] }
    }
}

impl Lighting {
    /// The most lights accepted.
    pub const MAX_LIGHTS: usize = 4;

    /// Refuses numbers out of range, no light or too many, and directions without length.
    ///
    /// # Errors
    /// [`Error::Setting`] that says what was given and what is accepted.
    pub fn validate(&self) -> Result<()> {
        let error = |name, reason: String| Err(Error::Setting { name, reason });
        for (what, value, low, high) in [
            ("ambient", self.ambient, 0.0, 1.0),
            ("diffuse", self.diffuse, 0.0, 1.0),
            ("specular", self.specular, 0.0, 1.0),
            ("shininess", self.shininess, 1.0, 1000.0),
        ] {
            if !(low..=high).contains(&value) {
                return error("material", format!("{what} is {value}, expected {low} to {high}"));
            }
        }
        if self.lights.is_empty() || self.lights.len() > Self::MAX_LIGHTS {
            return error("light", format!("{} lights, expected 1 to {}", self.lights.len(), Self::MAX_LIGHTS));
        }
        for light in &self.lights {
            if let Light::Directional(towards) = light
                && !(towards.is_finite() && towards.length() > 0.0)
            {
                return error("light", format!("direction {towards} points nowhere"));
            }
        }
        Ok(())
    }

    /// The colour that a lit point shows. `color` is its own colour, `gradient` the gradient of the field in world
    /// coordinates, of any length, and `to_eye` the unit world direction to the eye.
    #[must_use]
    pub fn shade(&self, color: [f64; 3], gradient: DVec3, to_eye: DVec3) -> [f64; 3] {
        let length = gradient.length();
        if length <= 0.0 {
            return color;
        }
        let normal = gradient / if gradient.dot(to_eye) < 0.0 { -length } else { length };
        let (mut diffuse, mut specular) = (0.0, 0.0);
        for light in &self.lights {
            let (towards, half_way) = match *light {
                Light::Headlight => (to_eye, to_eye),
                Light::Directional(towards) => {
                    let towards = towards.normalize();
                    (towards, (to_eye + towards).normalize_or_zero())
                }
            };
            let cosine = normal.dot(towards);
            if cosine > 0.0 {
                diffuse += cosine;
                let highlight = normal.dot(half_way).max(0.0);
                // Whole exponents up to 1000 take a fraction of the time.
                specular += if self.shininess.fract() == 0.0 {
                    highlight.powi(self.shininess as i32)
                } else {
                    highlight.powf(self.shininess)
                };
            }
        }
        color.map(|c| (c * (self.ambient + self.diffuse * diffuse) + self.specular * specular).clamp(0.0, 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_sides_of_a_surface_are_lit_alike_by_a_headlight() {
        let lighting = Lighting::default();
        for gradient in [DVec3::new(0.3, -2.0, 0.4), DVec3::new(1e-9, 1e-9, 0.0)] {
            let shown = |g: DVec3| lighting.shade([0.5, 0.2, 0.9], g, DVec3::NEG_Y);
            assert_eq!(shown(gradient), shown(-gradient));
        }
    }

    #[test]
    fn a_light_from_the_side_leaves_the_other_side_in_shadow() {
        let lighting = Lighting { lights: vec![Light::Directional(DVec3::X * 3.0)], ..Lighting::default() };
        let shown = |g: DVec3| lighting.shade([0.5; 3], g, DVec3::NEG_Y)[0];
        let (lit, dark) = (shown(DVec3::new(1.0, -0.2, 0.0)), shown(DVec3::new(-1.0, -0.2, 0.0)));
        assert!(lit > 0.45, "{lit}");
        assert!((dark - 0.15).abs() < 1e-12, "{dark}");
    }

    #[test]
    fn a_surface_that_faces_eye_and_light_is_brightest() {
        let lighting = Lighting::default();
        let shown = lighting.shade([0.5; 3], DVec3::Y, DVec3::Y);
        assert!((shown[0] - (0.5 + 0.2)).abs() < 1e-12);
        assert_eq!(lighting.shade([0.5, 0.4, 0.3], DVec3::ZERO, DVec3::Y), [0.5, 0.4, 0.3]);
    }

    #[test]
    fn wrong_materials_are_refused() {
        let wrong = [
            Lighting { ambient: -0.1, ..Lighting::default() },
            Lighting { shininess: f64::NAN, ..Lighting::default() },
            Lighting { lights: vec![], ..Lighting::default() },
            Lighting { lights: vec![Light::Directional(DVec3::ZERO)], ..Lighting::default() },
        ];
        assert!(wrong.iter().all(|l| l.validate().is_err()));
        assert!(Lighting::default().validate().is_ok());
    }
}
