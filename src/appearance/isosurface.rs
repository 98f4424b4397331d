//! Isosurfaces that a user requests.

use std::str::FromStr;

use crate::error::{Error, Result};
use crate::settings::parse::finite;
use crate::settings::{Model, Painter, Settings, Shading};
use crate::transfer::presets::Material;
use crate::transfer::{ControlPoint, color};

/// The material of isosurfaces. They are opaque where matter is soft, so they get less light than presets: their
/// brightest sides keep their colours in studio light.
pub(super) const MATERIAL: Material = Material { ambient: 0.25, diffuse: 0.5, specular: 0.2, shininess: 30.0 };
/// The colours of isosurfaces that state none, in turn.
const COLORS: [[f64; 3]; 5] =
    [[0.88, 0.82, 0.70], [0.85, 0.48, 0.36], [0.42, 0.62, 0.80], [0.56, 0.74, 0.44], [0.72, 0.53, 0.78]];

/// A requested isosurface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IsosurfaceSpec {
    value: f64,
    /// Red, green and blue; `None`: the library chooses.
    color: Option<[f64; 3]>,
    opacity: f64,
}

impl FromStr for IsosurfaceSpec {
    type Err = Error;

    /// Parses `VALUE`, `VALUE:COLOUR` or `VALUE:COLOUR:OPACITY`.
    fn from_str(text: &str) -> Result<Self> {
        let mut parts = text.split(':');
        let value = parts.next().and_then(finite).map(|[value]| value);
        let color = parts.next().map(|name| color::parse(name.trim()));
        let opacity = parts.next().map_or(Some(1.0), |text| finite(text).map(|[opacity]| opacity));
        let opacity = opacity.filter(|opacity| *opacity > 0.0 && *opacity <= 1.0);
        let whole = match (value, color, opacity, parts.next()) {
            (Some(value), None, Some(opacity), None) => Some(Self { value, color: None, opacity }),
            (Some(value), Some(Some(color)), Some(opacity), None) => Some(Self { value, color: Some(color), opacity }),
            _ => None,
        };
        let expected = "VALUE, VALUE:COLOUR or VALUE:COLOUR:OPACITY such as 300:ivory:0.5, opacities over 0 to 1";
        whole.ok_or_else(|| Error::setting("iso", format!("{text:?}, expected {expected}")))
    }
}

impl IsosurfaceSpec {
    /// Returns the isosurfaces as points of a transfer function.
    #[must_use]
    pub fn points(specs: &[Self]) -> Vec<ControlPoint> {
        let mut own = COLORS.into_iter().cycle();
        let mut next = || own.next().unwrap_or_default();
        let point = |spec: &Self| ControlPoint {
            value: spec.value,
            color: spec.color.unwrap_or_else(&mut next),
            opacity: spec.opacity,
        };
        specs.iter().map(point).collect()
    }

    /// Makes settings of pictures with isosurfaces, which classify along rays.
    ///
    /// # Errors
    /// [`Error::Setting`] if there are isosurfaces and the model is not the composite one, or a painter is requested
    /// that draws none.
    pub fn settle(specs: &[Self], settings: &mut Settings) -> Result<()> {
        if specs.is_empty() {
            return Ok(());
        }
        if settings.model != Model::Composite {
            return Err(Error::setting("iso", format!("model {} has no surfaces", settings.model)));
        }
        settings.shading = Shading::Post;
        if matches!(settings.painter, Painter::Quads(_)) {
            return Err(Error::setting("painter", "quads draws no isosurfaces: use tiles or cpu"));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn isosurfaces_are_values_with_colours_and_opacities() {
        let spec = |text: &str| text.parse::<IsosurfaceSpec>();
        let specs = [spec("-300").unwrap(), spec("2e2:red:0.5").unwrap(), spec("0.5:#00ff00").unwrap()];
        let points = IsosurfaceSpec::points(&specs);
        assert_eq!(points.iter().map(|p| p.value).collect::<Vec<_>>(), [-300.0, 200.0, 0.5]);
        assert_eq!(points.iter().map(|p| p.opacity).collect::<Vec<_>>(), [1.0, 0.5, 1.0]);
        assert_eq!((points[0].color, points[1].color, points[2].color), (COLORS[0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]));
        for wrong in ["", "high", "1:2:3", "1:red:0", "1:red:1.5", "1:red:0.5:x", "nan", "1:"] {
            let error = spec(wrong).unwrap_err().to_string();
            assert!(error.starts_with("iso: ") && error.contains("expected VALUE"), "{error}");
        }
    }
}
