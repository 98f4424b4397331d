//! The scale bar.

use glam::DVec2;

use super::Shown;
use super::canvas::Canvas;
use super::number::{label, round_below};
use super::path::Path;
use crate::error::{Error, Result};

/// The length of a scale bar, with its label.
#[derive(Debug, PartialEq)]
pub(super) struct Bar {
    /// The length of the bar in pixels, not rounded.
    pub(super) pixels: f64,
    pub(super) text: String,
}

/// The units of length that are converted for shorter numbers: 1000 of each are the next.
const METRIC: [&str; 5] = ["nm", "µm", "mm", "m", "km"];

impl Bar {
    /// Finds the largest round length of at most `most` pixels.
    pub(super) fn new(shown: &Shown<'_>, most: f64) -> Result<Self> {
        let pixel = shown.camera.pixel_size();
        if !(pixel.is_finite() && pixel > 0.0) {
            let reason = "the target is not in front of the eye: there is no length to show";
            return Err(Error::setting("scale_bar", reason));
        }
        let length = round_below(most * pixel);
        let is_plain = shown.volume.grid().spacing() == [1.0; 3];
        let unit = shown.volume.length_unit().unwrap_or(if is_plain { "voxels" } else { "units" });
        let mut text = with_unit(length, unit);
        if shown.camera.projection.eye_distance().is_some() {
            text += " at the centre";
        }
        Ok(Self { pixels: length / pixel, text })
    }
}

/// Returns a round length with its unit.
fn with_unit(length: f64, unit: &str) -> String {
    let named = match unit {
        "um" | "micron" | "microns" | "μm" => "µm",
        unit => unit,
    };
    let Some(at) = METRIC.iter().position(|&metric| metric == named) else {
        return format!("{} {unit}", label(length, length));
    };
    // The first unit that gives a number under a thousand; tenths of millimetres are usual.
    let units = METRIC.iter().zip(0_i32..).map(|(unit, i)| (unit, length * 1000_f64.powi(at as i32 - i)));
    let fits = |&(unit, number): &(&&str, f64)| number < 1000.0 * (1.0 - 1e-9) && !(*unit == "µm" && number > 99.0);
    match units.clone().find(fits).filter(|(_, number)| *number > 0.05) {
        Some((unit, number)) => format!("{} {unit}", label(number, number)),
        None => format!("{} {named}", label(length, length)),
    }
}

/// Returns the height of the bar with its text.
pub(super) fn height(em: f64) -> f64 {
    1.6 * em
}

/// Draws the bar of at most `most` pixels with its right foot at `corner`.
pub(super) fn draw(canvas: &mut Canvas, shown: &Shown<'_>, corner: DVec2, most: f64) -> Result<()> {
    let Bar { pixels, text } = Bar::new(shown, most)?;
    let em = canvas.em;
    // Whole pixels, so that the edges are sharp; the left end is where it belongs.
    let (thick, tall) = ((em / 6.0).round().max(1.0), (0.5 * em).round());
    let [right, foot] = corner.floor().to_array();
    let left = right - pixels;
    let mut path = Path::rectangle(DVec2::new(left, foot - thick), DVec2::new(right, foot));
    for end in [left, right - thick] {
        path.append(Path::rectangle(DVec2::new(end, foot - tall), DVec2::new(end + thick, foot - thick)));
    }
    canvas.fill_with_halo(&path, canvas.ink);
    let width = canvas.font.width(&text, em);
    let middle = (left + pixels / 2.0).min(right - width / 2.0);
    canvas.write(&text, em, DVec2::new(middle, foot - tall - 0.55 * em), 0.5);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_short_numbers() {
        for (length, unit, expected) in [
            (50.0, "mm", "50 mm"),
            (0.5, "mm", "0.5 mm"),
            (0.1, "mm", "0.1 mm"),
            (0.05, "mm", "50 µm"),
            (5000.0, "mm", "5 m"),
            (0.002, "m", "2 mm"),
            (200.0, "microns", "0.2 mm"),
            (20.0, "um", "20 µm"),
            (0.5, "nm", "0.5 nm"),
            (1e-5, "nm", "1e−5 nm"),
            (2e7, "voxels", "2e7 voxels"),
            (10.0, "cm", "10 cm"),
        ] {
            assert_eq!(with_unit(length, unit), expected);
        }
    }
}
