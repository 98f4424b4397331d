//! Windows of values, and transfer functions moved into them.

use super::{ControlPoint, GradientPoint, TransferFunction, presets};
use crate::error::{Error, Result};
use crate::volume::Statistics;

/// A window: a range of values by its middle and its extent, as radiologists state it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// The value in the middle of the window.
    pub level: f64,
    /// The width of the window: the difference of its ends.
    pub width: f64,
}

impl Window {
    /// Returns the window of the foreground, up to its 99.5th percentile; `None` if all values are the same.
    #[must_use]
    pub fn of_foreground(statistics: &Statistics) -> Option<Self> {
        let [low, high] = presets::foreground(statistics)?;
        Some(Self { level: f64::midpoint(low, high), width: high - low }).filter(|window| window.ends().is_ok())
    }

    /// Returns the lowest and the highest value of the window.
    ///
    /// # Errors
    /// [`Error::Setting`] if the width is not over 0, or if the ends are not finite and apart.
    pub fn ends(&self) -> Result<[f64; 2]> {
        let Self { level, width } = *self;
        let ends = [level - width / 2.0, level + width / 2.0];
        if width > 0.0 && ends.iter().all(|end| end.is_finite()) && ends[0] < ends[1] {
            return Ok(ends);
        }
        Err(Error::setting("window", format!("{level},{width}, expected a width over 0")))
    }
}

impl TransferFunction {
    /// Stretches the function over a window: its first point moves to the lower end and its last point to the upper
    /// end. Gradient opacity stays at its surfaces: its magnitudes grow with the range.
    ///
    /// ```
    /// use voxsplat::transfer::{TransferFunction, Window, maps};
    ///
    /// let soft_tissue = Window { level: 40.0, width: 400.0 };
    /// let transfer = maps::find("batlow")?.transfer()?.stretched(&soft_tissue)?;
    /// assert_eq!(transfer.range(), [-160.0, 240.0]);
    /// # Ok::<(), voxsplat::error::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Setting`] as [`Window::ends`]; [`Error::Transfer`] if all points are at one value.
    pub fn stretched(&self, window: &Window) -> Result<Self> {
        let [low, high] = window.ends()?;
        let [first, last] = self.range();
        if first >= last {
            return Err(Error::Transfer(format!("all its points are at {first}: no window stretches it")));
        }
        // Halves, because the range may be as wide as the range of f64.
        let share = |value: f64| (value / 2.0 - first / 2.0) / (last / 2.0 - first / 2.0);
        let point = |p: &ControlPoint| ControlPoint { value: presets::between(low, high, share(p.value)), ..*p };
        let grown = (high / 2.0 - low / 2.0) / (last / 2.0 - first / 2.0);
        Self { points: self.points.iter().map(point).collect(), ..self.clone() }.with_steeper_gradients(grown)
    }

    /// Returns the function with the magnitudes of its gradient opacity multiplied by a factor.
    pub(super) fn with_steeper_gradients(self, times: f64) -> Result<Self> {
        let steeper = |p: &GradientPoint| GradientPoint { magnitude: p.magnitude * times, ..*p };
        let gradient = self.gradient.iter().map(steeper).collect();
        self.with_gradient_opacity(gradient)
    }

    /// Returns the function with opacities for slabs `unit_distance` thick, in world units.
    ///
    /// # Errors
    /// [`Error::Transfer`] if the distance is not a positive length.
    pub fn with_unit_distance(&self, unit_distance: f64) -> Result<Self> {
        Self::check_unit(unit_distance)?;
        Ok(Self { unit_distance: Some(unit_distance), ..self.clone() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_moves_values_alone() {
        let point = |value, opacity| ControlPoint { value, color: [opacity; 3], opacity };
        let gradient = vec![GradientPoint { magnitude: 2.0, opacity: 0.5 }];
        let points = vec![point(0.0, 0.0), point(0.5, 0.5), point(1.0, 1.0)];
        let transfer = TransferFunction::new(points, Some(2.0)).unwrap().with_gradient_opacity(gradient).unwrap();
        let moved = transfer.stretched(&Window { level: 100.0, width: 50.0 }).unwrap();
        assert_eq!(moved.points(), [point(75.0, 0.0), point(100.0, 0.5), point(125.0, 1.0)]);
        assert_eq!((moved.unit_distance(), moved.gradient_opacity()[0].magnitude), (Some(2.0), 100.0));
        for window in [[1.0, 0.0], [1.0, -1.0], [f64::NAN, 1.0], [1e300, 1.0], [0.0, f64::INFINITY]] {
            let error = transfer.stretched(&Window { level: window[0], width: window[1] }).unwrap_err().to_string();
            assert!(error.starts_with("window: ") && error.ends_with("expected a width over 0"), "{window:?}: {error}");
        }
        let single = TransferFunction::new(vec![point(3.0, 0.5)], None).unwrap();
        let error = single.stretched(&Window { level: 0.0, width: 1.0 }).unwrap_err().to_string();
        assert!(error.contains("all its points are at 3: no window stretches it"), "{error}");
        let widest = TransferFunction::new(vec![point(f64::MIN, 0.0), point(f64::MAX, 1.0)], None).unwrap();
        assert_eq!(widest.stretched(&Window { level: 0.0, width: 2.0 }).unwrap().range(), [-1.0, 1.0]);
    }
}
