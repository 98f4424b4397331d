//! A kernel as polynomials, many times faster than `Kernel::value` and continued beyond its support; and sums of
//! kernels along a ray as polynomials with known bounds and roots.

use std::f64::consts::PI;
use std::sync::LazyLock;

use super::ray::Weights;
use crate::kernel::Kernel;
use crate::kernel::quadrature::chebyshev;

/// The number of coefficients of a piece, if one piece is not enough.
const TERMS: usize = 8;
/// The largest number of coefficients of a single piece.
const MAX_TERMS: usize = 24;
/// The largest number of pieces: enough for a Gaussian of sigma 0.05 cut at 16, the sharpest kernel.
const MAX_PIECES: usize = 1 << 17;

/// A kernel as a function of y = R^2 - rho^2, in which every kernel is analytic, continued a little beyond its support.
#[derive(Debug)]
pub(super) struct Profile {
    /// The coefficients of each piece, lowest first, in s from -1 to 1 over the piece.
    coefficients: Vec<f64>,
    /// The number of coefficients of a piece.
    terms: usize,
    /// The least y of the profile.
    least: f64,
    /// The number of pieces per unit of y.
    scale: f64,
}

impl Profile {
    /// Makes the profile of a kernel from y = -`beyond` on, with errors of about `error` of its peak.
    pub(super) fn new(kernel: &Kernel, beyond: f64, error: f64) -> Self {
        for terms in TERMS..=MAX_TERMS {
            let profile = Self::with_pieces(kernel, beyond, 1, terms);
            if profile.error(kernel) <= error {
                return profile;
            }
        }
        let mut pieces = 16;
        loop {
            let profile = Self::with_pieces(kernel, beyond, pieces, TERMS);
            if pieces >= MAX_PIECES || profile.error(kernel) <= error {
                return profile;
            }
            pieces *= 2;
        }
    }

    /// Returns the kernel at some y voxels^2 inside the sphere of its support, or a little outside.
    #[inline]
    pub(super) fn values<const N: usize>(&self, y: [f64; N]) -> [f64; N] {
        if self.coefficients.len() == self.terms {
            let (factor, shift) = (2.0 * self.scale, -2.0 * self.least * self.scale - 1.0);
            let mut s = y;
            for s in &mut s {
                *s = *s * factor + shift;
            }
            let mut sum = [0.0; N];
            for c in self.coefficients.iter().rev() {
                for (sum, s) in sum.iter_mut().zip(&s) {
                    *sum = *sum * s + c;
                }
            }
            return sum;
        }
        y.map(|y| {
            let position = (y - self.least) * self.scale;
            let last = self.coefficients.len() / self.terms - 1;
            // A float to integer cast saturates: y a rounding error below the least lands in piece 0, where it belongs.
            let index = (position as usize).min(last);
            let s = 2.0 * (position - index as f64) - 1.0;
            let piece = &self.coefficients[index * self.terms..(index + 1) * self.terms];
            piece.iter().rev().fold(0.0, |sum, c| sum * s + c)
        })
    }

    fn with_pieces(kernel: &Kernel, beyond: f64, count: usize, terms: usize) -> Self {
        let scale = count as f64 / (kernel.radius() * kernel.radius() + beyond);
        let place = |index: usize, s: f64| (index as f64 + 0.5 + 0.5 * s) / scale - beyond;
        let coefficients =
            (0..count).flat_map(|index| interpolate(terms, |s| continued(kernel, place(index, s)))).collect();
        Self { coefficients, terms, least: -beyond, scale }
    }

    /// Measures the largest error, at places between the interpolation points of every piece.
    fn error(&self, kernel: &Kernel) -> f64 {
        let samples = self.coefficients.len() * 2;
        let range = kernel.radius() * kernel.radius() - self.least;
        (0..=samples)
            .map(|i| self.least + range * i as f64 / samples as f64)
            .map(|y| (self.values([y])[0] - continued(kernel, y)).abs())
            .fold(0.0, f64::max)
    }
}

/// Returns a kernel at y = R^2 - rho^2, continued analytically if y is negative.
fn continued(kernel: &Kernel, y: f64) -> f64 {
    kernel.continued(kernel.radius() * kernel.radius() - y)
}

/// Returns the coefficients, lowest first, of the polynomial of `terms` terms that meets `f` at the Chebyshev points of
/// [-1, 1].
fn interpolate(terms: usize, f: impl Fn(f64) -> f64) -> Vec<f64> {
    let mut sum = vec![0.0; terms];
    // T_k and T_(k - 1) as polynomials: T_(k + 1) = 2 x T_k - T_(k - 1).
    let (mut polynomial, mut before) = (vec![0.0; terms], vec![0.0; terms]);
    polynomial[0] = 1.0;
    for (k, factor) in chebyshev(terms, f).into_iter().enumerate() {
        for (s, c) in sum.iter_mut().zip(&polynomial) {
            *s += factor * c;
        }
        let twice = if k == 0 { 1.0 } else { 2.0 };
        let next = (0..terms).map(|i| if i > 0 { twice * polynomial[i - 1] } else { 0.0 } - before[i]).collect();
        before = std::mem::replace(&mut polynomial, next);
    }
    sum
}

/// The number of terms of a [`Chebyshev`] series, and of the nodes that make it.
pub(super) const SERIES: usize = 8;

/// A sum of splats along a stretch of a ray: a polynomial of degree 7 in x from -1 to 1 for each weight, as a series of
/// Chebyshev polynomials.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Chebyshev(pub(super) [Weights; SERIES]);

/// The nodes of a series, and the matrix that makes a series of values at them.
pub(super) struct SeriesRule {
    pub(super) nodes: [f64; SERIES],
    /// The contribution of the value at each node to each term.
    pub(super) terms: [[f64; SERIES]; SERIES],
}

/// The rule of interpolation at the zeros of T_8.
pub(super) static RULE: LazyLock<SeriesRule> = LazyLock::new(|| {
    let nodes = std::array::from_fn(|k| (PI * (k as f64 + 0.5) / SERIES as f64).cos());
    let share = |m: usize| if m == 0 { 1.0 } else { 2.0 } / SERIES as f64;
    let terms = nodes.map(|x| {
        let values = polynomials(x);
        std::array::from_fn(|m| share(m) * values[m])
    });
    SeriesRule { nodes, terms }
});

/// Returns the first Chebyshev polynomials at x.
#[inline]
fn polynomials(x: f64) -> [f64; SERIES] {
    let mut p = [1.0; SERIES];
    p[1] = x;
    for n in 2..SERIES {
        p[n] = 2.0 * x * p[n - 1] - p[n - 2];
    }
    p
}

impl Chebyshev {
    /// Returns the series that meets `values` (of each weight, at each node) at the nodes of [`RULE`].
    pub(super) fn through(values: &[[f64; SERIES]; 4]) -> Self {
        let mut series = Self::default();
        for (k, row) in RULE.terms.iter().enumerate() {
            series.add(row, &values.map(|weight| weight[k]));
        }
        series
    }

    /// Adds a polynomial, with these weights.
    pub(super) fn add<const N: usize>(&mut self, polynomial: &[f64; N], weights: &Weights) {
        for (term, p) in self.0.iter_mut().zip(polynomial) {
            for (t, w) in term.iter_mut().zip(weights) {
                *t += w * p;
            }
        }
    }

    /// Returns the sum of the series at x.
    #[inline]
    pub(super) fn at(&self, x: f64) -> Weights {
        let p = polynomials(x);
        let mut sum = [0.0; 4];
        for (term, p) in self.0.iter().zip(p) {
            for (s, t) in sum.iter_mut().zip(term) {
                *s += t * p;
            }
        }
        sum
    }

    /// Combines the weights, each times its factor, into one polynomial.
    pub(super) fn combined(&self, factors: &Weights) -> Scalar {
        /// The largest |T_n''|, which is at the ends: n^2 (n^2 - 1) / 3.
        const BENDS: [f64; SERIES] = [0.0, 0.0, 4.0, 24.0, 80.0, 200.0, 420.0, 784.0];
        let products = self.0.map(|term| std::array::from_fn::<_, 4, _>(|c| term[c] * factors[c]));
        let value = products.map(|p| p.iter().sum::<f64>());
        // T_n' = 2 n (T_(n - 1) + T_(n - 3) + ..), with half of T_0.
        let mut slope = [0.0; SERIES];
        let mut sums = [0.0; 2];
        for k in (0..SERIES - 1).rev() {
            sums[k % 2] += 2.0 * (k + 1) as f64 * value[k + 1];
            slope[k] = sums[k % 2];
        }
        slope[0] /= 2.0;
        let curvature = value.iter().zip(BENDS).map(|(c, bend)| c.abs() * bend).sum();
        Scalar { value, slope, curvature, size: products.iter().flatten().map(|p| p.abs()).sum() }
    }
}

/// A polynomial in x from -1 to 1 with a bound of its curvature.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scalar {
    value: [f64; SERIES],
    slope: [f64; SERIES],
    /// A bound of the second derivative.
    curvature: f64,
    /// A bound of the terms of the sums: rounding errors are some 1e-16 of it.
    pub(super) size: f64,
}

/// Bounds of a polynomial on an interval.
#[derive(Debug, Clone, Copy)]
pub(super) struct Range {
    /// The value in the middle of the interval.
    pub(super) middle: f64,
    /// A bound of the distance of all values from `middle`.
    pub(super) spread: f64,
    /// Whether the slope keeps its sign, and at least half of its size in the middle.
    pub(super) monotone: bool,
}

impl Scalar {
    pub(super) fn at(&self, x: f64) -> f64 {
        series_at(&self.value, x)
    }

    /// Returns bounds on the interval from a to b, by Taylor's formula about its middle.
    pub(super) fn range(&self, a: f64, b: f64) -> Range {
        let (middle, half) = (f64::midpoint(a, b), (b - a) / 2.0);
        let (slope, bend) = (series_at(&self.slope, middle).abs(), self.curvature * half);
        Range { middle: self.at(middle), spread: (slope + bend / 2.0) * half, monotone: slope > 2.0 * bend }
    }

    /// Adds the place between a and b, exclusive, where the polynomial has a value. Returns false if the polynomial is
    /// not monotone there, so that it may have the value more than once.
    pub(super) fn meets(&self, value: f64, a: f64, b: f64, places: &mut Vec<f64>) -> bool {
        if !self.range(a, b).monotone {
            return false;
        }
        if (self.at(a) - value) * (self.at(b) - value) < 0.0 {
            places.push(self.solve(value, a, b));
        }
        true
    }

    /// Returns the place where the polynomial, monotone on the interval from a to b, has one of its values there.
    fn solve(&self, value: f64, a: f64, b: f64) -> f64 {
        // With slopes of at least half the middle slope, and that over twice the curvature times half the
        // interval, Newton's error in halves of the interval goes from e to e^2 / 2 or less: 2^-63 after six steps.
        (0..6).fold(f64::midpoint(a, b), |x, _| (x + (value - self.at(x)) / series_at(&self.slope, x)).clamp(a, b))
    }
}

#[inline]
fn series_at(terms: &[f64; SERIES], x: f64) -> f64 {
    terms.iter().zip(polynomials(x)).map(|(t, p)| t * p).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    const ERROR: f64 = 2e-14;

    #[test]
    fn profile_is_the_kernel() {
        for kernel in [
            Kernel::default(),
            Kernel::KAISER_BESSEL,
            Kernel::KaiserBessel { radius: 3.0, alpha: 0.0 },
            Kernel::KaiserBessel { radius: 0.5, alpha: 50.0 },
            Kernel::Gaussian { sigma: 0.5, radius: 4.0 },
            Kernel::Gaussian { sigma: 16.0, radius: 0.5 },
        ] {
            let profile = Profile::new(&kernel, 0.1, ERROR);
            let radius2 = kernel.radius().powi(2);
            for i in 0..=10_007 {
                let y = radius2 * f64::from(i) / 10_007.0;
                let error = profile.values([y])[0] - kernel.value(radius2 - y);
                assert!(error.abs() < 1e-13, "{kernel:?} at y = {y}: {error:e}");
            }
        }
    }

    #[test]
    fn the_sharpest_kernel_is_still_exact() {
        let kernel = Kernel::Gaussian { sigma: 0.05, radius: 16.0 };
        // y itself is rounded to 3e-14 voxels^2 there, which such a kernel turns into 6e-12 of its peak.
        assert!(Profile::new(&kernel, 0.0, ERROR).error(&kernel) <= 1e-11);
    }

    #[test]
    fn a_series_is_its_polynomial_and_knows_its_bounds() {
        let f = |x: f64| [x.powi(7) - 2.0 * x + 0.5, x * x, 1.0, -x.powi(5)];
        let series = Chebyshev::through(&std::array::from_fn(|c| RULE.nodes.map(|x| f(x)[c])));
        let scalar = series.combined(&[1.0, 0.0, 0.0, 0.0]);
        for i in 0..200 {
            let x = f64::from(i) / 100.0 - 1.0;
            for (got, expected) in series.at(x).iter().zip(f(x)) {
                // The ends lie beyond the nodes, where rounding of the values at them grows.
                assert!((got - expected).abs() < 5e-14, "{:e} at {x}", got - expected);
            }
            assert!((scalar.at(x) - f(x)[0]).abs() < 5e-14);
            let range = scalar.range(x, x + 0.01);
            for y in [x, x + 0.005, x + 0.01] {
                assert!((f(y)[0] - range.middle).abs() <= range.spread + 5e-14);
            }
        }
        assert!(scalar.range(-0.02, 0.02).monotone && !scalar.range(-1.0, 1.0).monotone);
        let root = scalar.solve(0.5, -0.02, 0.018);
        assert!(root.abs() < 1e-14, "{root:e}");
    }
}
