//! Lights as users request them, before the view of a picture places them.

use std::str::FromStr;

use glam::DVec3;

use crate::camera::View;
use crate::error::{Error, Result};
use crate::lighting::{Light, Lighting, Normals, Source};
use crate::settings::parse::{expect, finite};
use crate::transfer::color::{parse as parse_color, tip};

/// A requested light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LightSpec {
    /// No light.
    Off,
    /// [Studio light](Lighting::studio) around the view.
    Studio {
        /// Whether the light follows the eye from picture to picture, instead of standing still.
        follows: bool,
    },
    /// A light with its colour.
    One(LightPlace, [f64; 3]),
}

/// The place of a light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LightPlace {
    /// The eye.
    Eye,
    /// The direction of an eye at this azimuth and elevation, degrees.
    From(f64, f64),
    /// A point in the world.
    At([f64; 3]),
}

impl FromStr for LightSpec {
    type Err = Error;

    /// Parses `off`, `studio`, `studio:eye`, or `headlight`, `AZ,EL` or `@X,Y,Z` with `:INTENSITY`, `:COLOUR` or
    /// `:INTENSITY,COLOUR`.
    fn from_str(text: &str) -> Result<Self> {
        let expected = "off, studio, studio:eye, headlight, AZ,EL in degrees or @X,Y,Z; the last three with \
                        :INTENSITY or :COLOUR";
        let (place, color) = text.split_once(':').map_or((text, None), |(place, color)| (place, Some(color)));
        let place = match (place, color) {
            ("off", None) => return Ok(Self::Off),
            ("studio", None) => return Ok(Self::Studio { follows: false }),
            ("studio", Some("eye")) => return Ok(Self::Studio { follows: true }),
            ("headlight", _) => Some(LightPlace::Eye),
            _ => match place.strip_prefix('@') {
                Some(point) => finite(point).map(LightPlace::At),
                None => finite(place).map(|[azimuth, elevation]| LightPlace::From(azimuth, elevation)),
            },
        };
        let place = expect("light", place, expected)?;
        let mut light = [1.0; 3];
        for part in color.into_iter().flat_map(|color| color.split(',')) {
            let factors = finite(part).map(|[intensity]| [intensity; 3]).or_else(|| parse_color(part));
            let factors = expect("light", factors, &format!("{expected}{}", tip(part)))?;
            light.iter_mut().zip(factors).for_each(|(light, factor)| *light *= factor);
        }
        Ok(Self::One(place, light))
    }
}

/// Requested shadows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShadowSpec {
    /// The strength of [`Lighting::shadows`]; `None`: the strength of studio light, or 1.
    pub strength: Option<f64>,
    /// Whether [`Lighting::exact_shadows`] is on.
    pub exact: bool,
}

impl FromStr for ShadowSpec {
    type Err = Error;

    /// Parses `on`, `off`, a strength from 0 to 1, `exact` or `exact:STRENGTH`.
    fn from_str(text: &str) -> Result<Self> {
        let strength = |text| match text {
            "on" => Ok(Some(1.0)),
            "off" => Ok(Some(0.0)),
            _ => expect(
                "shadows",
                finite(text).map(|[strength]| Some(strength)),
                "on, off, exact or a number from 0 to 1",
            ),
        };
        let (exact, text) = match text.split_once(':') {
            Some(("exact", text)) => (true, Some(text)),
            _ => (text == "exact", (text != "exact").then_some(text)),
        };
        Ok(Self { strength: text.map(strength).transpose()?.flatten(), exact })
    }
}

/// A requested radius of ambient occlusion in voxels; `None`: no occlusion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OcclusionSpec(pub Option<f64>);

impl FromStr for OcclusionSpec {
    type Err = Error;

    /// Parses `off` or a number.
    fn from_str(text: &str) -> Result<Self> {
        match text {
            "off" => Ok(Self(None)),
            _ => expect("occlusion", finite(text).map(|[radius]| Self(Some(radius))), "off or a radius in voxels"),
        }
    }
}

/// The requested light of a picture. `Default` requests nothing: [`make_choices`] may choose it.
///
/// [`make_choices`]: crate::appearance::ChoiceContext::make_choices
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LightRequest {
    /// The requested lights; empty if the library chooses.
    pub lights: Vec<LightSpec>,
    /// Ambient, diffuse and specular reflection, and shininess.
    pub material: Option<[f64; 4]>,
    /// The requested shadows.
    pub shadows: Option<ShadowSpec>,
    /// The angular size of directional lights, degrees.
    pub light_size: Option<f64>,
    /// The requested ambient occlusion.
    pub occlusion: Option<OcclusionSpec>,
    /// The [`Lighting::shadow_bias`], voxels.
    pub shadow_bias: Option<f64>,
    /// The [`Lighting::normals`].
    pub normals: Option<Normals>,
}

impl LightRequest {
    /// Returns whether studio light is requested.
    #[must_use]
    pub fn is_studio(&self) -> bool {
        self.lights.iter().any(|light| matches!(light, LightSpec::Studio { .. }))
    }

    /// Returns whether studio light is requested that follows the eye.
    #[must_use]
    pub fn follows(&self) -> bool {
        self.lights.contains(&LightSpec::Studio { follows: true })
    }

    /// Returns the lights around a view, and their material; `None` if no light is requested.
    ///
    /// # Errors
    /// [`Error::Setting`] if lights contradict each other, [`Error::Camera`] if the view has no direction.
    pub fn lighting(&self, view: &View) -> Result<Option<Lighting>> {
        let lit: Vec<LightSpec> = self.lights.iter().copied().filter(|light| *light != LightSpec::Off).collect();
        if lit.is_empty() {
            return Ok(None);
        }
        if lit.len() < self.lights.len() {
            return Err(Error::setting("light", "off and other lights contradict each other, give one of them"));
        }
        let mut lighting = if self.is_studio() {
            if lit.len() > 1 {
                return Err(Error::setting("light", "studio is three lights, expected no other light beside it"));
            }
            Lighting::studio(view.forward()?, view.up)
        } else {
            let mut lights = Vec::new();
            for light in lit {
                let LightSpec::One(place, color) = light else { continue };
                let light = match place {
                    LightPlace::Eye => Light::HEADLIGHT,
                    LightPlace::From(azimuth, elevation) => {
                        let towards = -View { azimuth, elevation, up: view.up, ..View::default() }.forward()?;
                        Light::directional(towards)
                    }
                    LightPlace::At(place) => Light::at(DVec3::from_array(place)),
                };
                lights.push(Light { color, ..light });
            }
            Lighting { lights, ..Lighting::default() }
        };
        if let Some([ambient, diffuse, specular, shininess]) = self.material {
            lighting = Lighting { ambient, diffuse, specular, shininess, ..lighting };
        }
        if let Some(ShadowSpec { strength, exact }) = self.shadows {
            let own = if lighting.shadows > 0.0 { lighting.shadows } else { 1.0 };
            lighting = Lighting { shadows: strength.unwrap_or(own), exact_shadows: exact, ..lighting };
        }
        if let Some(size) = self.light_size {
            let is_far = |light: &&mut Light| matches!(light.source, Source::Direction(_));
            lighting.lights.iter_mut().filter(is_far).for_each(|light| light.size = size);
        }
        if let Some(OcclusionSpec(radius)) = self.occlusion {
            lighting.occlusion = radius;
        }
        lighting.shadow_bias = self.shadow_bias.unwrap_or(lighting.shadow_bias);
        lighting.normals = self.normals.unwrap_or(lighting.normals);
        Ok(Some(lighting))
    }
}

/// Places studio light around a view.
///
/// # Errors
/// [`Error::Camera`] if the view has no direction.
pub fn place_studio(lighting: &mut Lighting, view: &View) -> Result<()> {
    let studio = Lighting::studio(view.forward()?, view.up);
    let placed = lighting.lights.iter_mut().zip(studio.lights);
    placed.for_each(|(light, there)| light.source = there.source);
    Ok(())
}
