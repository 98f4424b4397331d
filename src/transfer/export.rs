//! Files of transfer functions, for this library and for 3D Slicer.

use std::io::Write;
use std::path::Path;

use serde_json::{Value, json};

use super::{GradientPoint, TransferFunction};
use crate::error::{Error, Result};
use crate::output::write_atomically;
use crate::volume::Grid;

/// The schema of a `.vp.json`, for Slicer.
const SCHEMA: &str = "https://raw.githubusercontent.com/slicer/slicer/main/Modules/Loadable/VolumeRendering/Resources/\
                      Schema/volume-property-schema-v1.0.0.json#";

/// The writer of a format: returns the text of a function for the volume on a grid.
type Writer = fn(&TransferFunction, &Grid) -> String;

/// Returns the writer for the extension of a path.
fn writer(path: &Path) -> Result<Writer> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    let writers: [(&str, Writer); 3] = [
        (".vp.json", TransferFunction::to_slicer_json),
        (".json", |transfer, _| transfer.to_json()),
        (".vp", TransferFunction::to_slicer_vp),
    ];
    let known = writers.into_iter().find(|(extension, _)| name.ends_with(extension));
    let reason = || "transfer functions are written as .json, .vp.json or .vp".to_owned();
    Ok(known.ok_or_else(|| Error::Output { path: path.to_owned(), reason: reason() })?.1)
}

impl TransferFunction {
    /// Refuses a path that [`Self::save`] has no format for.
    ///
    /// # Errors
    /// [`Error::Output`] if the extension is not `.json`, `.vp.json` or `.vp`.
    pub fn check_output(path: impl AsRef<Path>) -> Result<()> {
        writer(path.as_ref()).map(drop)
    }

    /// Writes the function in the format of the extension of `path`: `.json` as [`Self::to_json`], `.vp.json` and `.vp`
    /// for 3D Slicer. The file appears whole or not at all.
    ///
    /// # Errors
    /// [`Error::Output`] as [`Self::check_output`]; [`Error::Write`] if writing fails.
    pub fn save(&self, path: impl AsRef<Path>, grid: &Grid) -> Result<()> {
        let path = path.as_ref();
        let text = writer(path)?(self, grid);
        write_atomically(path, |file| file.write_all(text.as_bytes()))
    }

    /// Returns the function as a `.vp` of 3D Slicer, without light. The format has no unit distance.
    #[must_use]
    pub fn to_slicer_vp(&self, grid: &Grid) -> String {
        let list = |numbers: Vec<f64>| {
            let words = numbers.iter().map(|number| format!(" {number:?}"));
            format!("{}{}", numbers.len(), words.collect::<String>())
        };
        let opacities = self.points().iter().flat_map(|p| [p.value, p.opacity]).collect();
        let gradient = self.gradient_for_slicer(grid).iter().flat_map(|p| [p.magnitude, p.opacity]).collect();
        let colors = self.points().iter().flat_map(|p| [p.value, p.color[0], p.color[1], p.color[2]]).collect();
        format!("1\n0\n0.9\n0.1\n0.2\n10\n{}\n{}\n{}\n", list(opacities), list(gradient), list(colors))
    }

    /// Returns the function as a `.vp.json` of 3D Slicer, without light.
    #[must_use]
    pub fn to_slicer_json(&self, grid: &Grid) -> String {
        let with = |at: f64, key: &str, value: Value| {
            let mut point = json!({"x": at, "midpoint": 0.5, "sharpness": 0.0});
            point[key] = value;
            point
        };
        let colors: Vec<Value> = self.points().iter().map(|p| with(p.value, "color", json!(p.color))).collect();
        let opacities: Vec<Value> = self.points().iter().map(|p| with(p.value, "y", json!(p.opacity))).collect();
        let gradient = self.gradient_for_slicer(grid);
        let gradient: Vec<Value> = gradient.iter().map(|p| with(p.magnitude, "y", json!(p.opacity))).collect();
        let property = json!({
            "effectiveRange": self.range(),
            "independentComponents": true,
            "interpolationType": "linear",
            "components": [{
                "componentWeight": 1.0,
                "shade": false,
                "lighting": {"diffuse": 0.9, "ambient": 0.1, "specular": 0.2, "specularPower": 10.0},
                "disableGradientOpacity": false,
                "scalarOpacityUnitDistance": self.unit_or(grid.min_spacing()),
                "rgbTransferFunction": {"type": "colorTransferFunction", "points": colors},
                "scalarOpacity": {"type": "piecewiseFunction", "points": opacities},
                "gradientOpacity": {"type": "piecewiseFunction", "points": gradient},
            }],
        });
        format!("{:#}\n", json!({"@schema": SCHEMA, "volumeProperties": [property]}))
    }

    /// Returns gradient opacity over differences of a mean spacing. Slicer requires points: without gradient opacity
    /// they are two of opacity 1.
    fn gradient_for_slicer(&self, grid: &Grid) -> Vec<GradientPoint> {
        let plain = [0.0, 255.0].map(|magnitude| GradientPoint { magnitude, opacity: 1.0 });
        let spacing = grid.mean_spacing();
        let over = |p: &GradientPoint| GradientPoint { magnitude: p.magnitude * spacing, ..*p };
        match self.gradient_opacity() {
            [] => plain.to_vec(),
            points => points.iter().map(over).collect(),
        }
    }
}
