//! A kernel as polynomials: the same numbers as `Kernel::value`, many times faster, and beyond its support. And sums of
//! kernels along a ray as polynomials, whose bounds and roots are known.

use std::f64::consts::PI;
use std::sync::LazyLock;

use super::ray::Weights;
use crate::kernel::Kernel;

/// Coefficients of a piece, where one is not enough.
const TERMS: usize = 8;
/// The most coefficients of a single piece.
const MAX_TERMS: usize = 24;
/// Enough pieces for a Gaussian of sigma 0.05 cut at 16, the sharpest kernel there is.
const MAX_PIECES: usize = 1 << 17;

/// A kernel as a function of y = R^2 - rho^2, in which every kernel is analytic, continued a little beyond its support.
#[derive(Debug)]
pub(super) struct Profile {
    /// Of each piece, lowest first, in s from -1 to 1 over the piece.
    coefficients: Vec<f64>,
    /// Coefficients of a piece.
    terms: usize,
    /// The least y.
    least: f64,
    /// Pieces per unit of y.
    scale: f64,
}

impl Profile {
    /// The kernel from y = -`beyond` on, with errors of about `error` of its peak.
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

    /// The kernel at some y voxels^2 inside the sphere of its support, or a little outside.
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

    /// The largest error, looked for between the interpolation points of every piece.
    fn error(&self, kernel: &Kernel) -> f64 {
        let samples = self.coefficients.len() * 2;
        let range = kernel.radius() * kernel.radius() - self.least;
        (0..=samples)
            .map(|i| self.least + range * i as f64 / samples as f64)
            .map(|y| (self.values([y])[0] - continued(kernel, y)).abs())
            .fold(0.0, f64::max)
    }
}

/// A kernel at y = R^2 - rho^2, continued analytically where that is negative.
fn continued(kernel: &Kernel, y: f64) -> f64 {
    match *kernel {
        Kernel::Gaussian { sigma, radius } => ((y - radius * radius) / (2.0 * sigma * sigma)).exp(),
        Kernel::KaiserBessel { radius, alpha } => {
            let y = y / (radius * radius);
            y * y * bessel(alpha * alpha * y) / bessel(alpha * alpha)
        }
    }
}

/// 8 I_2(z) / z^2 from z^2, of either sign: 2 sum_k (z^2 / 4)^k / (k! (k + 2)!).
fn bessel(z2: f64) -> f64 {
    let (mut term, mut sum, mut k) = (1.0_f64, 1.0_f64, 1.0);
    while term.abs() > 1e-18 * sum.abs() {
        term *= z2 / 4.0 / (k * (k + 2.0));
        sum += term;
        k += 1.0;
    }
    sum
}

/// Coefficients, lowest first, of the polynomial of so many terms that meets `f` at the Chebyshev points of [-1, 1].
fn interpolate(terms: usize, f: impl Fn(f64) -> f64) -> Vec<f64> {
    let angle = |i: usize| (2 * i + 1) as f64 * PI / (2 * terms) as f64;
    let values: Vec<f64> = (0..terms).map(|i| f(angle(i).cos())).collect();
    let mut sum = vec![0.0; terms];
    // T_k and T_(k - 1) as polynomials: T_(k + 1) = 2 x T_k - T_(k - 1).
    let (mut chebyshev, mut before) = (vec![0.0; terms], vec![0.0; terms]);
    chebyshev[0] = 1.0;
    for k in 0..terms {
        let product: f64 = values.iter().enumerate().map(|(i, v)| v * (k as f64 * angle(i)).cos()).sum();
        let factor = product * if k == 0 { 1.0 } else { 2.0 } / terms as f64;
        for (s, c) in sum.iter_mut().zip(&chebyshev) {
            *s += factor * c;
        }
        let twice = if k == 0 { 1.0 } else { 2.0 };
        let next = (0..terms).map(|i| if i > 0 { twice * chebyshev[i - 1] } else { 0.0 } - before[i]).collect();
        before = std::mem::replace(&mut chebyshev, next);
    }
    sum
}

/// Terms of a [`Series`], and the nodes that it is made from.
pub(super) const SERIES: usize = 8;

/// A sum of splats along a stretch of a ray: a polynomial of degree 7 in x from -1 to 1 for each weight, as Legendre
/// series.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Series(pub(super) [Weights; SERIES]);

/// The nodes of Gauss's rule on -1..1 (Abramowitz and Stegun, table 25.4), by bisection and Newton's method, and the
/// matrix that makes a Legendre series of values at them.
#[derive(Debug)]
pub(super) struct Gauss<const N: usize> {
    pub(super) nodes: [f64; N],
    /// `terms[k][m]` is (2 m + 1) / 2 w_k P_m(x_k), w_k the weight of node x_k.
    pub(super) terms: [[f64; N]; N],
}

impl<const N: usize> Gauss<N> {
    pub(super) fn new() -> Self {
        let nodes = std::array::from_fn(|k| {
            let first = -((k as f64 + 0.75) / (N as f64 + 0.5) * PI).cos();
            (0..10).fold(first, |x, _| {
                let p = legendre::<SERIES>(x);
                let (last, value) = (p[N - 1], next_legendre(N, x, p[N - 1], p[N - 2]));
                x - value * (1.0 - x * x) / (N as f64 * (last - x * value))
            })
        });
        let weight = |x: f64| {
            let last = legendre::<SERIES>(x)[N - 1];
            2.0 * (1.0 - x * x) / (N as f64 * last).powi(2)
        };
        let terms = std::array::from_fn(|k| {
            std::array::from_fn(|m| (m as f64 + 0.5) * weight(nodes[k]) * legendre::<SERIES>(nodes[k])[m])
        });
        Self { nodes, terms }
    }
}

/// P_n from P_(n - 1) and P_(n - 2).
fn next_legendre(n: usize, x: f64, last: f64, before: f64) -> f64 {
    ((2 * n - 1) as f64 * x * last - (n - 1) as f64 * before) / n as f64
}

/// 1 / n for the recurrence.
const RECIPROCALS: [f64; SERIES] = [0.0, 1.0, 1.0 / 2.0, 1.0 / 3.0, 1.0 / 4.0, 1.0 / 5.0, 1.0 / 6.0, 1.0 / 7.0];

/// The first Legendre polynomials at x.
#[inline]
pub(super) fn legendre<const N: usize>(x: f64) -> [f64; N] {
    let mut p = [1.0; N];
    p[1] = x;
    for n in 2..N {
        p[n] = x * p[n - 1] + (n - 1) as f64 * RECIPROCALS[n] * (x * p[n - 1] - p[n - 2]);
    }
    p
}

/// Gauss's rule for a whole series.
pub(super) static GAUSS: LazyLock<Gauss<SERIES>> = LazyLock::new(Gauss::new);

impl Series {
    /// The series that meets `values` (of each weight, at each node) at the nodes of [`GAUSS`].
    pub(super) fn through(values: &[[f64; SERIES]; 4]) -> Self {
        let gauss = &*GAUSS;
        let mut terms = [[0.0; 4]; SERIES];
        for (k, row) in gauss.terms.iter().enumerate() {
            let value = [values[0][k], values[1][k], values[2][k], values[3][k]];
            for (term, t) in terms.iter_mut().zip(row) {
                for (sum, v) in term.iter_mut().zip(value) {
                    *sum += t * v;
                }
            }
        }
        Self(terms)
    }

    /// Adds a polynomial, with these weights.
    pub(super) fn add<const N: usize>(&mut self, polynomial: &[f64; N], weights: &Weights) {
        for (term, p) in self.0.iter_mut().zip(polynomial) {
            for (t, w) in term.iter_mut().zip(weights) {
                *t += w * p;
            }
        }
    }

    /// Its sum at x.
    #[inline]
    pub(super) fn at(&self, x: f64) -> Weights {
        let p = legendre::<SERIES>(x);
        let mut sum = [0.0; 4];
        for (term, p) in self.0.iter().zip(p) {
            for (s, t) in sum.iter_mut().zip(term) {
                *s += t * p;
            }
        }
        sum
    }

    /// The mean of the first weight from a to b.
    pub(super) fn mean(&self, a: f64, b: f64) -> f64 {
        let (middle, half) = (f64::midpoint(a, b), (b - a) / 2.0);
        // The first term at a node is half of the weight.
        GAUSS.nodes.iter().zip(&GAUSS.terms).map(|(x, terms)| terms[0] * self.at(middle + half * x)[0]).sum()
    }

    /// One polynomial: the weights, each times its factor, added up.
    pub(super) fn combined(&self, factors: &Weights) -> Scalar {
        let products = self.0.map(|term| std::array::from_fn::<_, 4, _>(|c| term[c] * factors[c]));
        let value = products.map(|p| p.iter().sum::<f64>());
        // P_n' = sum of (2 k + 1) P_k over k = n - 1, n - 3, ..
        let mut slope = [0.0; SERIES];
        let mut sums = [0.0; 2];
        for k in (0..SERIES - 1).rev() {
            sums[k % 2] += value[k + 1];
            slope[k] = (2 * k + 1) as f64 * sums[k % 2];
        }
        Scalar { value, slope, curvature: bend(&value), size: products.iter().flatten().map(|p| p.abs()).sum() }
    }
}

/// A bound of the second derivative of a series.
pub(super) fn bend(terms: &[f64; SERIES]) -> f64 {
    // |P_n''| is largest at the ends: (n - 1) n (n + 1) (n + 2) / 8.
    const MOST: [f64; SERIES] = [0.0, 0.0, 3.0, 15.0, 45.0, 105.0, 210.0, 378.0];
    terms.iter().zip(MOST).map(|(c, most)| c.abs() * most).sum()
}

/// A polynomial in x from -1 to 1 that knows how it bends.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scalar {
    value: [f64; SERIES],
    slope: [f64; SERIES],
    /// No second derivative is larger.
    curvature: f64,
    /// No term of the sums that make it is larger: it is rounded at some 1e-16 of that.
    pub(super) size: f64,
}

/// What is sure about a polynomial on an interval.
#[derive(Debug, Clone, Copy)]
pub(super) struct Range {
    /// Its value in the middle.
    pub(super) middle: f64,
    /// No value is further from that.
    pub(super) spread: f64,
    /// Whether its slope keeps its sign, and at least half its size in the middle.
    pub(super) monotone: bool,
}

impl Scalar {
    pub(super) fn at(&self, x: f64) -> f64 {
        series_at(&self.value, x)
    }

    /// Bounds on the interval from a to b, by Taylor's formula about its middle.
    pub(super) fn range(&self, a: f64, b: f64) -> Range {
        let (middle, half) = (f64::midpoint(a, b), (b - a) / 2.0);
        let (slope, bend) = (series_at(&self.slope, middle).abs(), self.curvature * half);
        Range { middle: self.at(middle), spread: (slope + bend / 2.0) * half, monotone: slope > 2.0 * bend }
    }

    /// Adds where the polynomial has a value between a and b, both left out. False where it is not monotone there, so
    /// that it may have it more than once.
    pub(super) fn meets(&self, value: f64, a: f64, b: f64, places: &mut Vec<f64>) -> bool {
        if !self.range(a, b).monotone {
            return false;
        }
        if (self.at(a) - value) * (self.at(b) - value) < 0.0 {
            places.push(self.solve(value, a, b));
        }
        true
    }

    /// Where the polynomial, monotone on the interval from a to b, has a value that it has there.
    fn solve(&self, value: f64, a: f64, b: f64) -> f64 {
        // With slopes of at least half the middle one's size, and that over twice the curvature times half the
        // interval, Newton's error in halves of the interval goes from e to e^2 / 2 or less: 2^-63 after six steps.
        (0..6).fold(f64::midpoint(a, b), |x, _| (x + (value - self.at(x)) / series_at(&self.slope, x)).clamp(a, b))
    }
}

#[inline]
fn series_at(terms: &[f64; SERIES], x: f64) -> f64 {
    terms.iter().zip(legendre::<SERIES>(x)).map(|(t, p)| t * p).sum()
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
        let series = Series::through(&std::array::from_fn(|c| GAUSS.nodes.map(|x| f(x)[c])));
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
