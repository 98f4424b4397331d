//! A transfer function over equal bins of scalars, and its integral: the table by which painters classify.

use super::scalars::Reduction;
use super::{ControlPoint, TransferFunction};

/// The number of equal bins of scalars, BIN_COUNT in shaders/common/transfer.wgsl: few enough for the table of a
/// function without gradient opacity to have less than 64 KiB.
pub(crate) const BINS: usize = 1600;
/// The number of bins below the lowest scalar at which the function changes, and above the highest one: in the outer of
/// them it is constant.
pub(crate) const OUTER_BINS: usize = 2;
/// The least width of a bin, over the largest scalar: a few times the distance of neighbouring floats.
const LEAST_BIN: f64 = 1e-6;
/// The Gauss-Legendre quadrature of three points on [0, 1]: places and weights.
const QUADRATURE: [[f64; 2]; 3] =
    [[0.112_701_665_379_258_3, 5.0 / 18.0], [0.5, 8.0 / 18.0], [0.887_298_334_620_741_7, 5.0 / 18.0]];

/// The visible values of a scalar field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum VisibleValues {
    /// All values with opacity.
    Opaque,
    /// The largest value, if it has opacity. Smaller values matter only because they are not larger.
    Largest,
    /// The mean of all values.
    Mean,
}

/// A transfer function and its integral by bins of scalars, linear within a bin.
pub(crate) struct Bins {
    /// Rows of the table: the function at the beginning of each bin and behind the last one: colour times extinction,
    /// and extinction; for projections colour and alpha. Then its integral up to the beginning of each bin, in bins.
    pub(crate) rows: Vec<Vec<[f32; 4]>>,
    /// The scalar at which the inner bins begin, and the number of bins for each scalar.
    pub(crate) lookup: [f32; 2],
    /// The range of invisible scalars around 0, ends included; empty if the first is larger.
    pub(crate) invisible: [f32; 2],
}

impl Bins {
    /// Makes the bins of a function. Extinctions are per unit of the transfer function, so bins serve lattices of all
    /// sizes.
    pub(crate) fn new(transfer: &TransferFunction, reduction: &Reduction, shows: VisibleValues) -> Self {
        let value = |color: [f64; 3], opacity: f64| match shows {
            VisibleValues::Opaque => {
                let extinction = TransferFunction::extinction(opacity, 1.0);
                let [r, g, b] = color.map(|c| c * extinction);
                [r, g, b, extinction]
            }
            VisibleValues::Largest | VisibleValues::Mean => {
                let [r, g, b] = color;
                [r, g, b, opacity / transfer.max_opacity().max(f64::MIN_POSITIVE)]
            }
        };
        let (rows, lookup) = bins(transfer.knots(), reduction, &value);
        let around = transfer.invisible_around(reduction.base());
        let end =
            |value: f64| if value.is_finite() { reduction.scalar(value) } else { value.signum() as f32 * f32::MAX };
        Self { rows, lookup, invisible: around.map_or([1.0, -1.0], |ends| ends.map(end)) }
    }
}

/// A value of the function: colour times extinction, and extinction; for maxima and means colour and alpha.
type Value = [f64; 4];

fn mixed(a: Value, b: Value, f: f64) -> Value {
    std::array::from_fn(|c| a[c] + (b[c] - a[c]) * f)
}

/// The transfer function over the place among the bins: the integral over each bin, in two parts, whose weights fall
/// from the beginning of the bin and rise to its end by linear interpolation.
struct BinParts(Vec<[Value; 2]>);

impl BinParts {
    /// Adds a smooth part of the function, between two places; `at` is the function at a share of the way.
    fn add(&mut self, [from, to]: [f64; 2], at: impl Fn(f64) -> Value) {
        let last = to.min(BINS as f64);
        let mut start = from.max(0.0);
        while start < last {
            let bin = start.floor();
            let end = last.min(bin + 1.0);
            for [share, weight] in QUADRATURE {
                let place = start + (end - start) * share;
                let value = at((place - from) / (to - from));
                for (part, near) in self.0[bin as usize].iter_mut().zip([bin + 1.0 - place, place - bin]) {
                    *part = std::array::from_fn(|c| part[c] + weight * (end - start) * near * value[c]);
                }
            }
            start = end;
        }
    }

    /// Returns the function that is linear within every bin: its values at both ends of each bin. Both parts of a bin
    /// count for their ends, so the integral over any peak is exact, however narrow it is. But an invisible bin stays
    /// invisible: its neighbours give all to their other ends.
    fn linear(&self) -> Vec<Value> {
        let mut values = vec![[0.0; 4]; BINS + 1];
        for c in 0..4 {
            let is_empty = |bin: usize| self.0.get(bin).is_some_and(|parts| parts.iter().all(|part| part[c] == 0.0));
            let is_clear = |end: usize| is_empty(end) || end > 0 && is_empty(end - 1);
            for (bin, [first, last]) in self.0.iter().enumerate() {
                let (first, last) = match [is_clear(bin), is_clear(bin + 1)] {
                    [true, false] => (0.0, first[c] + last[c]),
                    [false, true] => (first[c] + last[c], 0.0),
                    _ => (first[c], last[c]),
                };
                values[bin][c] += first;
                values[bin + 1][c] += last;
            }
        }
        values
    }
}

/// Returns the integral from place 0 to the beginning of each bin, in bins.
fn integrals(values: &[Value]) -> Vec<Value> {
    let mut sum = [0.0; 4];
    let next = |ends: &[Value]| {
        let before = sum;
        let mean = mixed(ends[0], ends[1], 0.5);
        sum = std::array::from_fn(|c| sum[c] + mean[c]);
        before
    };
    values.windows(2).map(next).collect()
}

/// Returns the rows of the table for scalars, and the place of scalars among the bins, see [`Bins::lookup`].
fn bins(
    points: &[ControlPoint],
    reduction: &Reduction,
    value: &dyn Fn([f64; 3], f64) -> Value,
) -> (Vec<Vec<[f32; 4]>>, [f32; 2]) {
    let at = |p: &ControlPoint| value(p.color, p.opacity);
    let scalars: Vec<f64> = points.iter().map(|p| f64::from(reduction.scalar(p.value))).collect();
    let (low, high) = (scalars.first().copied().unwrap_or(0.0), scalars.last().copied().unwrap_or(0.0));
    let width = ((high - low) / (BINS - 2 * OUTER_BINS) as f64).max(LEAST_BIN * low.abs().max(high.abs()).max(1.0));
    let place = |scalar: f64| (scalar - low) / width + OUTER_BINS as f64;
    let [first, last] = [points.first(), points.last()].map(|p| p.map_or([0.0; 4], at));
    let mut parts = BinParts(vec![[[0.0; 4]; 2]; BINS]);
    parts.add([0.0, place(low)], |_| first);
    for (pair, ends) in points.windows(2).zip(scalars.windows(2)) {
        let ([a, b], &[from, to]) = (pair, ends) else { continue };
        parts.add([place(from), place(to)], |share| {
            let color = std::array::from_fn(|c| a.color[c] + (b.color[c] - a.color[c]) * share);
            value(color, a.opacity + (b.opacity - a.opacity) * share)
        });
    }
    parts.add([place(high), BINS as f64], |_| last);
    let mut values = parts.linear();
    values[..OUTER_BINS].fill(first);
    values[BINS + 1 - OUTER_BINS..].fill(last);
    let integrals = integrals(&values);
    // Integrals begin at the base, where scalars are the most precise.
    let origin = integrals[place(0.0).clamp(0.0, (BINS - 1) as f64) as usize];
    let texel = |value: Value| value.map(|c| c.clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32);
    let integrals = integrals.iter().map(|sum| texel(std::array::from_fn(|c| sum[c] - origin[c])));
    let rows = vec![values.into_iter().map(texel).collect(), integrals.collect()];
    (rows, [low as f32, width.recip() as f32])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The table of a function of opacity alone, whose values are the opacities.
    struct Table {
        reduction: Reduction,
        rows: Vec<Vec<[f32; 4]>>,
        lookup: [f32; 2],
    }

    impl Table {
        fn new(points: &[(f64, f64)]) -> Self {
            let point = |&(value, opacity): &(f64, f64)| ControlPoint { value, color: [1.0; 3], opacity };
            let transfer = TransferFunction::new(points.iter().map(point).collect(), None).unwrap();
            let reduction = Reduction::new(&transfer, 1.0);
            let (rows, lookup) = bins(transfer.knots(), &reduction, &|_, opacity| [opacity; 4]);
            Self { reduction, rows, lookup }
        }

        /// Returns the function at a value and its integral up to there, as shaders read them.
        fn at(&self, value: f64) -> [f32; 2] {
            let [low, scale] = self.lookup;
            let place = (self.reduction.scalar(value) - low) * scale + OUTER_BINS as f32;
            let bin = place.clamp(0.0, BINS as f32 - 1.0) as usize;
            let beyond = place - bin as f32;
            let [value, next, integral] = [self.rows[0][bin][3], self.rows[0][bin + 1][3], self.rows[1][bin][3]];
            let rise = (next - value) * beyond;
            [value + rise, integral + (value + 0.5 * rise) * beyond]
        }

        /// Returns the integral between two values.
        fn integral(&self, from: f64, to: f64) -> f64 {
            let [from, to] = [from, to].map(|value| f64::from(self.at(value)[1]));
            (to - from) / (f64::from(self.lookup[1]) * self.reduction.factor())
        }
    }

    #[test]
    fn peaks_keep_their_integral_and_steps_their_height() {
        // A peak of a hundredth of a bin, two steps, and a step at the end.
        let peak = [(0.2, 0.0), (0.5, 0.0), (0.500_005, 1.0), (0.500_01, 0.0)];
        let steps = [(0.7, 0.0), (0.7, 0.25), (0.75, 0.25), (0.75, 0.0), (0.9, 0.0), (0.9, 0.5)];
        let table = Table::new(&[peak.as_slice(), &steps].concat());
        for (from, to, expected, error) in
            [(0.4, 0.6, 5e-6, 1e-8), (0.68, 0.78, 0.0125, 1e-6), (1.0, 3.0, 1.0, 1e-3), (-9.0, 0.4, 0.0, 0.0)]
        {
            let got = table.integral(from, to);
            assert!((got - expected).abs() <= error, "{from} to {to}: {got}");
        }
        for (value, opacity) in
            [(-50.0, 0.0), (0.3, 0.0), (0.6, 0.0), (0.72, 0.25), (0.8, 0.0), (0.91, 0.5), (900.0, 0.5)]
        {
            let [got, _] = table.at(value);
            assert!((got - opacity).abs() < 1e-6, "{value}: {got}");
        }
    }

    #[test]
    fn ramps_are_linear_and_show_nothing_below() {
        let table = Table::new(&[(0.0, 0.0), (0.25, 0.0), (0.5, 0.8), (1.0, 0.1)]);
        for value in [0.0, 0.1, 0.2499] {
            assert_eq!(table.at(value)[0], 0.0);
        }
        for (value, opacity) in [(0.3, 0.16), (0.4, 0.48), (0.75, 0.45), (0.999, 0.1014)] {
            let [got, _] = table.at(value);
            assert!((got - opacity).abs() < 1e-4, "{value}: {got}");
        }
    }
}
