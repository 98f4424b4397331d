//! Transfer functions: from a scalar to a colour and an opacity.

pub(crate) mod bins;
mod classification;
pub(crate) mod color;
mod export;
mod gradient;
mod import;
pub(crate) mod isosurface;
mod json;
mod lines;
pub mod maps;
pub mod presets;
pub(crate) mod scalars;
mod window;

pub use self::classification::Classification;
pub(crate) use self::classification::{Node, Pieces};
pub use self::gradient::GradientPoint;
pub(crate) use self::gradient::{Resolution, scaled_share};
#[doc(hidden)]
pub use self::import::Imported;
pub use self::window::Window;
use crate::error::{Error, Result};

/// A control point of a transfer function.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControlPoint {
    /// The scalar value of the point.
    pub value: f64,
    /// Red, green and blue of the point in 0..1, in display space: they are composited and written without conversion.
    pub color: [f64; 3],
    /// The opacity in 0..1 of a slab one unit distance thick.
    pub opacity: f64,
}

impl ControlPoint {
    /// Checks the point, and that it may follow the point `before`.
    fn check(&self, before: Option<&Self>) -> Result<(), String> {
        if !self.value.is_finite() {
            return Err(format!("value {} is not finite", self.value));
        }
        if let Some(before) = before
            && self.value < before.value
        {
            return Err(format!("value {} comes after {}: values must ascend", self.value, before.value));
        }
        if !self.color.iter().chain([&self.opacity]).all(|c| (0.0..=1.0).contains(c)) {
            return Err(format!("colour {:?} and opacity {} must lie in 0..1", self.color, self.opacity));
        }
        Ok(())
    }
}

/// Returns the points on both sides of a value, at least one point, and the place of the value between them, 0 to 1.
/// Beyond the ends both are the outermost point; of several points at one value the last holds from there on.
fn segment<T>(points: &[T], value: f64, at: impl Fn(&T) -> f64) -> (&T, &T, f64) {
    let above = points.partition_point(|p| at(p) <= value);
    let (a, b) = (&points[above.saturating_sub(1)], &points[above.min(points.len() - 1)]);
    let width = at(b) - at(a);
    (a, b, if width > 0.0 { (value - at(a)) / width } else { 0.0 })
}

/// A piecewise linear map from scalar values to colour and opacity, constant beyond its ends.
///
/// Two points at the same value make a step; at the value itself the later point holds. Points between others at the
/// same value are [isosurfaces](TransferFunction::isosurfaces).
#[derive(Debug, Clone, PartialEq)]
pub struct TransferFunction {
    points: Vec<ControlPoint>,
    unit_distance: Option<f64>,
    gradient: Vec<GradientPoint>,
    classification: Classification,
}

impl TransferFunction {
    /// The largest opacity that is used; larger ones are clamped, because an opacity of 1 would be infinite extinction.
    /// One unit distance lets less than 1/65000 of the light through, which no 8 or 16 bit picture shows.
    pub const MAX_OPACITY: f64 = 1.0 - 1.0 / 65_536.0;

    /// The largest number of control points that is accepted.
    pub const MAX_POINTS: usize = 4096;

    /// Makes a transfer function through `points`. Their opacities belong to a slab `unit_distance` thick, in world
    /// units; `None` is the smallest spacing of the volume that the function is applied to.
    ///
    /// ```
    /// use voxsplat::transfer::{ControlPoint, TransferFunction};
    ///
    /// // Bone in Hounsfield units: invisible up to 150, then an ivory that grows denser.
    /// let bone = [1.0, 0.95, 0.85];
    /// let points = vec![
    ///     ControlPoint { value: 150.0, color: bone, opacity: 0.0 },
    ///     ControlPoint { value: 1200.0, color: bone, opacity: 0.4 },
    /// ];
    /// let transfer = TransferFunction::new(points, None)?;
    /// let (color, opacity) = transfer.sample(675.0);
    /// assert_eq!((color, opacity), (bone, 0.2));
    /// # Ok::<(), voxsplat::error::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Transfer`] if there is no point or more than [`Self::MAX_POINTS`], if values are not finite or not in
    /// ascending order, if a colour or an opacity is outside 0..1, or if the unit distance is not positive.
    pub fn new(points: Vec<ControlPoint>, unit_distance: Option<f64>) -> Result<Self> {
        if points.is_empty() || points.len() > Self::MAX_POINTS {
            return Err(Self::wrong_count(points.len()));
        }
        for (i, p) in points.iter().enumerate() {
            p.check(i.checked_sub(1).map(|before| &points[before]))
                .map_err(|reason| Error::Transfer(format!("point {}: {reason}", i + 1)))?;
        }
        unit_distance.map_or(Ok(()), Self::check_unit)?;
        Ok(Self { points, unit_distance, gradient: Vec::new(), classification: Classification::Auto })
    }

    fn check_unit(unit: f64) -> Result<()> {
        if unit.is_finite() && unit > 0.0 {
            return Ok(());
        }
        Err(Error::Transfer(format!("unit_distance {unit} is not a positive length")))
    }

    /// Returns the error about too few or too many points.
    fn wrong_count(count: usize) -> Error {
        Error::Transfer(format!("{count} control points, expected 1 to {}", Self::MAX_POINTS))
    }

    /// Returns the control points, values ascending.
    #[must_use]
    pub fn points(&self) -> &[ControlPoint] {
        &self.points
    }

    /// Returns the values of the first and the last control point.
    #[must_use]
    pub fn range(&self) -> [f64; 2] {
        [self.points[0].value, self.points[self.points.len() - 1].value]
    }

    /// Returns the thickness of the slab, in world units, that opacities belong to; `None` is the smallest spacing of
    /// the volume.
    #[must_use]
    pub fn unit_distance(&self) -> Option<f64> {
        self.unit_distance
    }

    /// Returns colour and opacity at a value. The opacity is not clamped to [`Self::MAX_OPACITY`].
    #[must_use]
    pub fn sample(&self, value: f64) -> ([f64; 3], f64) {
        let (a, b, f) = segment(&self.points, value, |p| p.value);
        let mix = |x: f64, y: f64| x + (y - x) * f;
        (std::array::from_fn(|c| mix(a.color[c], b.color[c])), mix(a.opacity, b.opacity))
    }

    /// Returns the extinction per world unit of a slab with an opacity and a thickness of `unit` world units: -ln(1 -
    /// opacity) / unit.
    #[must_use]
    pub fn extinction(opacity: f64, unit: f64) -> f64 {
        -libm::log1p(-opacity.min(Self::MAX_OPACITY)) / unit
    }

    /// Returns the unit distance for a volume whose smallest spacing is `min_spacing`, in world units.
    #[must_use]
    pub(crate) fn unit_or(&self, min_spacing: f64) -> f64 {
        self.unit_distance.unwrap_or(min_spacing)
    }

    /// Returns the base value: the value of a scalar field outside the voxels that have splats.
    ///
    /// Post-shading reconstructs the difference of the scalar from the base value, so invisible voxels need no splats.
    /// The base value has no opacity, if any value has none, and is as near to the visible values as the transfer
    /// function allows: the error of a sum of kernels is proportional to the difference. It is the first of these:
    ///
    /// 1. the upper end of the values without opacity below all visible values;
    /// 2. the lower end of the values without opacity above all visible values;
    /// 3. a value without opacity between visible values;
    /// 4. the value of the first point.
    ///
    /// If opacity jumps at such an end, the base value is off it, on the invisible side: half way to the neighbouring
    /// invisible point, or by half the range of the points if there is none; but by no more than half the value, if
    /// that is not 0. A clear point far away therefore does not matter. A single step at 0 gives no scale: the
    /// distance is 0.5.
    #[must_use]
    pub fn base(&self) -> f64 {
        let below = self.base_below();
        if let Some(base) = below.or_else(|| self.mirrored().base_below().map(|base| -base)) {
            return base;
        }
        let p = &self.points;
        // Between two invisible points every value is invisible. A single invisible point is invisible at its value,
        // unless it is part of a step.
        let between = p.windows(2).find(|w| w.iter().all(|q| q.opacity <= 0.0) && w[0].value < w[1].value);
        if let Some([a, b]) = between {
            return f64::midpoint(a.value, b.value);
        }
        p.iter().find(|q| self.sample(q.value).1 <= 0.0).unwrap_or(&p[0]).value
    }

    /// Returns the base value below all visible values; `None` if the first value is visible.
    fn base_below(&self) -> Option<f64> {
        let p = &self.points;
        let end = p.iter().take_while(|q| q.opacity <= 0.0).count().checked_sub(1)?;
        let value = p[end].value;
        if p.get(end + 1).is_none_or(|next| next.value > value) {
            return Some(value);
        }
        // At a step, half the distance to the point before it, or of the range.
        let half = |q: &ControlPoint| (q.value / 2.0 - value / 2.0).abs();
        let neighbour = p[..end].iter().map(half).filter(|&gap| gap > 0.0).reduce(f64::min);
        let gap = neighbour.unwrap_or((p[p.len() - 1].value / 2.0 - p[0].value / 2.0).abs());
        let gap = [gap, value.abs() / 2.0].into_iter().filter(|&gap| gap > 0.0).reduce(f64::min);
        Some(value - gap.unwrap_or(0.5))
    }

    /// Returns the function mirrored at 0: it maps a value as this one maps its opposite. (At a step itself the other
    /// side holds.)
    #[must_use]
    pub(crate) fn mirrored(&self) -> Self {
        let points = self.points.iter().rev().map(|p| ControlPoint { value: -p.value, ..*p }).collect();
        Self { points, ..self.clone() }
    }

    /// Returns whether no value of a range has opacity. Both ends are included, and either may be infinite.
    #[must_use]
    pub(crate) fn is_invisible(&self, [low, high]: [f64; 2]) -> bool {
        let ends = [low, high].map(|v| self.sample(v.clamp(f64::MIN, f64::MAX)).1);
        let inside = self.points.iter().filter(|p| (low..=high).contains(&p.value)).map(|p| p.opacity);
        ends.into_iter().chain(inside).all(|opacity| opacity <= 0.0)
    }

    /// Returns the largest range of values without opacity around `value`, both ends included; an end may be infinite.
    /// `None`: the value has opacity. If opacity jumps at an end, the range ends half way to the jump.
    #[must_use]
    pub(crate) fn invisible_around(&self, value: f64) -> Option<[f64; 2]> {
        if !self.is_invisible([value; 2]) {
            return None;
        }
        Some([-self.mirrored().invisible_up_to(-value), self.invisible_up_to(value)])
    }

    /// Returns the upper end of the values without opacity from `value` on, which has no opacity.
    fn invisible_up_to(&self, value: f64) -> f64 {
        let p = &self.points;
        let Some(visible) = p.iter().position(|q| q.value > value && q.opacity > 0.0) else { return f64::INFINITY };
        // A segment is invisible if both its ends are, so the range ends with the last invisible point.
        match visible.checked_sub(1).map(|last| p[last].value) {
            Some(last) if last >= value && last != p[visible].value => last,
            _ => f64::midpoint(value, p[visible].value),
        }
    }

    /// Returns the ranges of values whose opacity is at least `least`, which is over 0: ascending and apart. Both ends
    /// are included, and either may be infinite. All values above the lowest isosurface count.
    pub(crate) fn values_over(&self, least: f64) -> Vec<[f64; 2]> {
        let over = |p: &ControlPoint| p.opacity >= least;
        let [first, last] = [self.points[0], self.points[self.points.len() - 1]];
        let below = over(&first).then_some([f64::NEG_INFINITY, first.value]);
        let between = self.points.windows(2).filter_map(|pair| {
            let [a, b] = [pair[0], pair[1]];
            let crossing = || a.value + (b.value - a.value) * ((least - a.opacity) / (b.opacity - a.opacity));
            match (over(&a), over(&b)) {
                // Of a step, the later point holds.
                (true, false) if a.value == b.value => Some([f64::NAN, a.value.next_down()]),
                (true, true) => Some([a.value, b.value]),
                (true, false) => Some([a.value, crossing()]),
                (false, true) => Some([crossing(), b.value]),
                (false, false) => None,
            }
        });
        let above = over(&last).then_some([last.value, f64::INFINITY]);
        let mut ranges: Vec<[f64; 2]> = Vec::new();
        for [low, high] in below.into_iter().chain(between).chain(above) {
            match ranges.last_mut() {
                Some(before) if low.is_nan() => before[1] = before[1].min(high),
                Some(before) if low <= before[1] => before[1] = before[1].max(high),
                _ => ranges.push([low, high]),
            }
        }
        ranges.retain(|[low, high]| low <= high);
        if let Some(lowest) = self.isosurfaces().first().map(|surface| surface.value) {
            ranges.retain(|[low, _]| *low < lowest);
            match ranges.last_mut() {
                Some(before) if before[1] >= lowest => before[1] = f64::INFINITY,
                _ => ranges.push([lowest, f64::INFINITY]),
            }
        }
        ranges
    }

    /// Returns the control points without redundant ones at the ends: beyond the outermost the function is constant.
    pub(crate) fn knots(&self) -> &[ControlPoint] {
        let alike =
            |a: &ControlPoint, b: &ControlPoint| a.opacity == b.opacity && (a.color == b.color || a.opacity <= 0.0);
        let mut points = self.points.as_slice();
        while let [a, rest @ ..] = points
            && rest.first().is_some_and(|b| alike(a, b))
        {
            points = rest;
        }
        while let [rest @ .., b] = points
            && rest.last().is_some_and(|a| alike(a, b))
        {
            points = rest;
        }
        points
    }

    /// Returns the distance from the base to the farthest of the [`Self::knots`], or `other` if none is apart from the
    /// base.
    pub(crate) fn extent_or(&self, other: f64) -> f64 {
        let base = self.base();
        let extent = self.knots().iter().map(|p| (p.value - base).abs()).fold(0.0, f64::max);
        if extent > 0.0 { extent } else { other }
    }

    /// Returns the largest opacity of any point.
    #[must_use]
    pub(crate) fn max_opacity(&self) -> f64 {
        self.points.iter().map(|p| p.opacity).fold(0.0, f64::max)
    }

    /// Returns the premultiplied pixel of the value that a projection keeps, relative to the base; its hue is `depth`,
    /// 0 to 1, if there is one.
    pub(crate) fn projected(&self, value: f64, depth: Option<f64>) -> [f64; 4] {
        let most = self.max_opacity();
        let (mut color, opacity) = self.sample(self.base() + value);
        if let Some(depth) = depth {
            let h = 4.5 * depth.clamp(0.0, 1.0);
            let hue = [(h - 3.0).abs() - 1.0, 2.0 - (h - 2.0).abs(), 2.0 - (h - 4.0).abs()];
            let bright = color.into_iter().fold(0.0, f64::max);
            color = hue.map(|channel| bright * channel.clamp(0.0, 1.0));
        }
        let alpha = if most > 0.0 { opacity / most } else { 0.0 };
        let [r, g, b] = color.map(|channel| channel * alpha);
        [r, g, b, alpha]
    }

    /// Returns the largest value of each channel of the colours.
    pub(crate) fn brightest(&self) -> [f64; 3] {
        std::array::from_fn(|channel| self.points.iter().map(|p| p.color[channel]).fold(0.0, f64::max))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn base(points: &[(f64, f64)]) -> f64 {
        let points = points.iter().map(|&(value, opacity)| ControlPoint { value, color: [1.0; 3], opacity }).collect();
        let transfer = TransferFunction::new(points, None).unwrap();
        let base = transfer.base();
        let invisible = |v: f64| transfer.sample(v).1 <= 0.0;
        let some = transfer.points().iter().any(|p| invisible(p.value)) || invisible(f64::MIN) || invisible(f64::MAX);
        assert!(invisible(base) || !some, "{base} is not invisible");
        base
    }

    #[test]
    fn base_is_the_invisible_value_next_to_the_visible_ones() {
        assert_eq!(base(&[(0.0, 0.0), (2.0, 0.0), (3.0, 0.5), (4.0, 0.0)]), 2.0);
        assert_eq!(base(&[(0.0, 0.5), (2.0, 0.0), (3.0, 0.0)]), 2.0);
        assert_eq!(base(&[(0.0, 0.5), (2.0, 0.0), (4.0, 0.0), (5.0, 1.0)]), 3.0);
        assert_eq!(base(&[(0.0, 0.5), (2.0, 0.0), (5.0, 1.0)]), 2.0);
        assert_eq!(base(&[(1.0, 0.5), (2.0, 0.1)]), 1.0);
        assert_eq!(base(&[(1.0, 0.0)]), 1.0);
    }

    #[test]
    fn invisible_ranges_end_where_opacity_begins() {
        let points = [(0.0, 0.0), (2.0, 0.0), (3.0, 0.5), (4.0, 0.0), (6.0, 0.0), (6.0, 0.3)];
        let point = |&(value, opacity): &(f64, f64)| ControlPoint { value, color: [1.0; 3], opacity };
        let transfer = TransferFunction::new(points.iter().map(point).collect(), None).unwrap();
        assert_eq!(transfer.invisible_around(1.0), Some([f64::NEG_INFINITY, 2.0]));
        assert_eq!(transfer.invisible_around(2.0), Some([f64::NEG_INFINITY, 2.0]));
        assert_eq!(transfer.invisible_around(2.5), None);
        assert_eq!(transfer.invisible_around(5.0), Some([4.0, 5.5]));
        assert_eq!(transfer.invisible_around(7.0), None);
        assert!(transfer.is_invisible([f64::NEG_INFINITY, 2.0]) && transfer.is_invisible([4.0, 5.9]));
        assert!(
            !transfer.is_invisible([1.0, 5.0])
                && !transfer.is_invisible([5.0, 6.0])
                && !transfer.is_invisible([2.5, 2.6])
        );
        assert!(!transfer.is_invisible([5.0, f64::INFINITY]));
    }

    #[test]
    fn values_over_an_opacity_are_ranges() {
        let over = |points: &[(f64, f64)], least| {
            let point = |&(value, opacity): &(f64, f64)| ControlPoint { value, color: [1.0; 3], opacity };
            TransferFunction::new(points.iter().map(point).collect(), None).unwrap().values_over(least)
        };
        let (low, high) = (f64::NEG_INFINITY, f64::INFINITY);
        assert_eq!(over(&[(1.0, 0.5)], 0.5), [[low, high]]);
        assert!(over(&[(1.0, 0.4)], 0.5).is_empty());
        assert_eq!(over(&[(0.0, 0.0), (2.0, 1.0), (4.0, 0.0), (5.0, 1.0)], 0.5), [[1.0, 3.0], [4.5, high]]);
        // At a step, the later point holds.
        let steps = [(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (2.0, 0.0), (2.0, 1.0), (3.0, 1.0), (3.0, 0.0)];
        assert_eq!(over(&steps, 0.5), [[low, 1.0_f64.next_down()], [2.0, 3.0_f64.next_down()]]);
        // All values above an isosurface.
        assert_eq!(over(&[(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (1.0, 0.0)], 0.5), [[1.0, high]]);
        let two = [(1.0, 0.0), (1.0, 1.0), (1.0, 0.0), (2.0, 0.0), (2.0, 1.0), (2.0, 0.0)];
        assert_eq!(over(&two, 0.5), [[1.0, high]]);
    }

    #[test]
    fn base_keeps_off_steps() {
        assert_eq!(base(&[(0.0, 0.0), (2.0, 0.0), (2.0, 0.5), (4.0, 1.0)]), 1.0);
        assert_eq!(base(&[(2.0, 0.0), (2.0, 0.5), (6.0, 1.0)]), 1.0);
        assert_eq!(base(&[(2.0, 0.0), (2.0, 0.5), (2.5, 1.0)]), 1.75);
        assert_eq!(base(&[(0.0, 0.5), (2.0, 0.5), (2.0, 0.0), (4.0, 0.0)]), 3.0);
        assert_eq!(base(&[(0.0, 0.5), (6.0, 0.5), (6.0, 0.0)]), 9.0);
        assert_eq!(base(&[(-1e7, 0.0), (128.0, 0.0), (128.0, 0.5), (1e9, 0.0)]), 64.0);
        assert_eq!(base(&[(0.0, 0.0), (0.0, 0.5)]), -0.5);
        // In any unit of the data alike.
        let unit = 1000_f64.exp2();
        assert_eq!(base(&[(2.0 * unit, 0.0), (2.0 * unit, 0.5)]), base(&[(2.0, 0.0), (2.0, 0.5)]) * unit);
    }
}
