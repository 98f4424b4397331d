//! The mean emission of a transfer function over values, exactly.

use crate::kernel::quadrature::integrate;
use crate::transfer::TransferFunction;

/// Returns the emission of a value, given the unit distance: colour times extinction, extinction.
fn at(transfer: &TransferFunction, unit: f64, value: f64) -> [f64; 4] {
    let ([r, g, b], opacity) = transfer.sample(value);
    let tau = TransferFunction::extinction(opacity, unit);
    [r * tau, g * tau, b * tau, tau]
}

/// Returns the mean emission over the values between two; if they are equal, the emission there.
///
/// Between control points colour is linear and extinction is -ln(u) with u = 1 - opacity, also linear. With t from 0 to
/// 1 across the part of a segment, u = a + d t, the integrals of -ln(u) and of -t ln(u) follow by substitution; where d
/// is small they would cancel, and quadrature is exact.
fn mean(transfer: &TransferFunction, unit: f64, [low, high]: [f64; 2]) -> [f64; 4] {
    if low >= high {
        return at(transfer, unit, low);
    }
    let points = transfer.points();
    // Opacity is clamped after interpolation.
    let clamped = points.iter().zip(&points[1..]).filter_map(|(p, q)| {
        let share = (TransferFunction::MAX_OPACITY - p.opacity) / (q.opacity - p.opacity);
        (0.0 < share && share < 1.0).then_some(p.value + share * (q.value - p.value))
    });
    let mut ends: Vec<f64> = points.iter().map(|p| p.value).chain(clamped).collect();
    ends.retain(|&value| low < value && value < high);
    ends.extend([low, high]);
    ends.sort_by(f64::total_cmp);
    let mut sum = [0.0; 4];
    for (&a, &b) in ends.iter().zip(&ends[1..]).filter(|(a, b)| a < b) {
        // Inside the segment: at its ends another segment may begin with a step.
        let [near, far] = [1.0 / 3.0, 2.0 / 3.0].map(|share| transfer.sample(a + (b - a) * share));
        let at_end = |near: f64, far: f64| [2.0 * near - far, 2.0 * far - near];
        let clear = |opacity: f64| 1.0 - opacity.clamp(0.0, TransferFunction::MAX_OPACITY);
        let [u, v] = at_end(near.1, far.1).map(clear);
        let d = v - u;
        let [whole, moment] = if d.abs() < 0.2 * u.min(v) {
            let depth = |t: f64| -(u + d * t).ln();
            [integrate(0.0, 1.0, 2, depth), integrate(0.0, 1.0, 2, |t| t * depth(t))]
        } else {
            let first = |u: f64| u - u * u.ln();
            let second = |u: f64| u * u * (0.25 - u.ln() / 2.0);
            let whole = (first(v) - first(u)) / d;
            [whole, ((second(v) - second(u)) / d - u * whole) / d]
        };
        let share = (b - a) / (high - low) / unit;
        for (channel, sum) in sum[..3].iter_mut().enumerate() {
            let [c, e] = at_end(near.0[channel], far.0[channel]);
            *sum += share * (c * whole + (e - c) * moment);
        }
        sum[3] += share * whole;
    }
    sum
}

/// Returns the band-limited emission of a voxel: [`TransferFunction::with_classification`].
pub(super) fn band_limited(
    transfer: &TransferFunction,
    unit: f64,
    value: f64,
    [lowest, highest]: [f64; 2],
    rise: f64,
) -> [f64; 4] {
    let low = (value - rise).max(lowest).min(value);
    let high = (value + rise).min(highest).max(value);
    if transfer.is_invisible([low, high]) {
        return [0.0; 4];
    }
    let [below, above] = [[low, value], [value, high]].map(|range| mean(transfer, unit, range));
    [0, 1, 2, 3].map(|channel| (below[channel] + above[channel]) / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transfer::ControlPoint;

    #[test]
    fn means_are_integrals() {
        let point = |value, red, opacity| ControlPoint { value, color: [red, 1.0 - red, 0.5], opacity };
        let points = [(0.0, 0.1, 0.0), (1.0, 0.9, 1.0), (1.0, 0.2, 0.3), (3.0, 0.5, 0.31), (4.0, 0.0, 0.0)];
        let points = points.map(|(value, red, opacity)| point(value, red, opacity)).to_vec();
        let transfer = TransferFunction::new(points, None).unwrap();
        for range in [[-1.0, 0.7], [0.2, 0.9], [0.5, 3.5], [1.0, 2.0], [1.5, 1.5 + 1e-7], [3.2, 9.0]] {
            let found = mean(&transfer, 2.0, range);
            for (channel, found) in found.into_iter().enumerate() {
                let [low, high] = range;
                let sum = integrate(low, high, 100_000, |value| at(&transfer, 2.0, value)[channel]);
                let expected = sum / (high - low);
                // A panel of the sum spans the step.
                assert!((found - expected).abs() < 3e-4 * expected.max(0.01), "{range:?} {found} {expected}");
            }
        }
    }
}
