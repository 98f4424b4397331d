//! A kernel as piecewise polynomials: the same numbers as `Kernel::value`, many times faster. And sums of kernels along
//! a ray as polynomials, whose bounds and roots are known.

use std::f64::consts::PI;
use std::sync::LazyLock;

use super::classify::Weights;
use crate::kernel::Kernel;

/// Coefficients of one piece: degree 7.
const TERMS: usize = 8;
/// Largest error of a piece, as a fraction of the kernel's peak.
const MAX_ERROR: f64 = 2e-14;
/// Enough for a Gaussian of sigma 0.05 cut at 16, the sharpest kernel there is.
const MAX_PIECES: usize = 1 << 17;

/// A kernel as a function of y = R^2 - rho^2, in which every kernel is analytic inside its support.
#[derive(Debug)]
pub(super) struct Profile {
    pieces: Vec<[f64; TERMS]>,
    /// Pieces per unit of y.
    scale: f64,
}

impl Profile {
    pub(super) fn new(kernel: &Kernel) -> Self {
        let mut pieces = 16;
        loop {
            let profile = Self::with_pieces(kernel, pieces);
            if pieces >= MAX_PIECES || profile.error(kernel) <= MAX_ERROR {
                return profile;
            }
            pieces *= 2;
        }
    }

    /// The kernel at y voxels^2 inside the sphere of its support (y from 0 to R^2).
    #[inline]
    pub(super) fn value(&self, y: f64) -> f64 {
        let position = y * self.scale;
        // A float to integer cast saturates: y a rounding error below 0 lands in piece 0, where it belongs.
        let index = (position as usize).min(self.pieces.len() - 1);
        let s = position - index as f64;
        self.pieces[index].iter().rev().fold(0.0, |sum, c| sum * s + c)
    }

    fn with_pieces(kernel: &Kernel, count: usize) -> Self {
        let radius2 = kernel.radius() * kernel.radius();
        let width = radius2 / count as f64;
        let piece = |index: usize| interpolate(|s| kernel.value((radius2 - (index as f64 + s) * width).max(0.0)));
        Self { pieces: (0..count).map(piece).collect(), scale: 1.0 / width }
    }

    /// The largest error, looked for between the interpolation points of every piece.
    fn error(&self, kernel: &Kernel) -> f64 {
        let radius2 = kernel.radius() * kernel.radius();
        let samples = self.pieces.len() * 2 * TERMS;
        (0..=samples)
            .map(|i| radius2 * i as f64 / samples as f64)
            .map(|y| (self.value(y) - kernel.value(radius2 - y)).abs())
            .fold(0.0, f64::max)
    }
}

/// Coefficients, lowest first, of the polynomial that meets `f` at the Chebyshev points of [0, 1].
fn interpolate(f: impl Fn(f64) -> f64) -> [f64; TERMS] {
    let node = |i: usize| 0.5 - 0.5 * ((2 * i + 1) as f64 * PI / (2 * TERMS) as f64).cos();
    let nodes: [f64; TERMS] = std::array::from_fn(node);
    // Newton's divided differences, in place.
    let mut newton = nodes.map(f);
    for order in 1..TERMS {
        for i in (order..TERMS).rev() {
            newton[i] = (newton[i] - newton[i - 1]) / (nodes[i] - nodes[i - order]);
        }
    }
    // Horner's scheme on polynomials: p <- p (s - node) + coefficient.
    let mut p = [0.0; TERMS];
    for i in (0..TERMS).rev() {
        for k in (1..TERMS).rev() {
            p[k] = p[k - 1] - nodes[i] * p[k];
        }
        p[0] = newton[i] - nodes[i] * p[0];
    }
    p
}

/// Terms of a [`Series`], and the points that it is made from.
pub(super) const SERIES: usize = 8;

/// What all splats that hold a stretch of a ray add up to on it: a polynomial of degree 7 in x from -1 to 1 for each
/// weight, as Chebyshev series.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Series([Weights; SERIES]);

/// `COSINES[j][k]` is T_k at Chebyshev point j.
static COSINES: LazyLock<[[f64; SERIES]; SERIES]> = LazyLock::new(|| {
    let angle = |j: usize, k: usize| ((2 * j + 1) * k) as f64 * PI / (2 * SERIES) as f64;
    std::array::from_fn(|j| std::array::from_fn(|k| angle(j, k).cos()))
});

impl Series {
    /// The Chebyshev points of -1..1.
    pub(super) fn points() -> [f64; SERIES] {
        COSINES.map(|row| row[1])
    }

    /// The series that meets `values` at the Chebyshev points.
    pub(super) fn through(values: &[Weights; SERIES]) -> Self {
        let mut terms = [[0.0; 4]; SERIES];
        for (value, cosines) in values.iter().zip(&*COSINES) {
            for (term, cosine) in terms.iter_mut().zip(cosines) {
                for (t, v) in term.iter_mut().zip(value) {
                    *t += v * cosine;
                }
            }
        }
        for (k, term) in terms.iter_mut().enumerate() {
            *term = term.map(|t| t * if k == 0 { 1.0 } else { 2.0 } / SERIES as f64);
        }
        Self(terms)
    }

    /// Its sum at x, by Clenshaw's recurrence.
    pub(super) fn at(&self, x: f64) -> Weights {
        let (mut next, mut after) = ([0.0; 4], [0.0; 4]);
        for term in self.0[1..].iter().rev() {
            let sum = std::array::from_fn(|c| term[c] + 2.0 * x * next[c] - after[c]);
            (next, after) = (sum, next);
        }
        std::array::from_fn(|c| self.0[0][c] + x * next[c] - after[c])
    }

    /// One polynomial: the weights, each times its factor, added up.
    pub(super) fn combined(&self, factors: &Weights) -> Scalar {
        let products = self.0.map(|term| std::array::from_fn::<_, 4, _>(|c| term[c] * factors[c]));
        let value = products.map(|p| p.iter().sum::<f64>());
        // d/dx sum c_k T_k = sum d_k T_k with d_(k-1) = d_(k+1) + 2 k c_k, d_0 half of that.
        let mut slope = [0.0; SERIES + 1];
        for k in (1..SERIES).rev() {
            slope[k - 1] = slope[k + 1] + 2.0 * k as f64 * value[k];
        }
        slope[0] /= 2.0;
        // |T_k''| is largest at the ends: k^2 (k^2 - 1) / 3.
        let bend = |k: usize| (k * k * (k * k).saturating_sub(1)) as f64 / 3.0;
        Scalar {
            value,
            slope: std::array::from_fn(|k| slope[k]),
            curvature: value.iter().enumerate().map(|(k, c)| c.abs() * bend(k)).sum(),
            size: products.iter().flatten().map(|p| p.abs()).sum(),
        }
    }
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
        clenshaw(&self.value, x)
    }

    /// Bounds on the interval from a to b, by Taylor's formula about its middle.
    pub(super) fn range(&self, a: f64, b: f64) -> Range {
        let (middle, half) = (f64::midpoint(a, b), (b - a) / 2.0);
        let (slope, bend) = (clenshaw(&self.slope, middle).abs(), self.curvature * half);
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
        (0..6).fold(f64::midpoint(a, b), |x, _| (x + (value - self.at(x)) / clenshaw(&self.slope, x)).clamp(a, b))
    }
}

fn clenshaw(terms: &[f64; SERIES], x: f64) -> f64 {
    let (mut next, mut after) = (0.0, 0.0);
    for term in terms[1..].iter().rev() {
        (next, after) = (term + 2.0 * x * next - after, next);
    }
    terms[0] + x * next - after
}

#[cfg(test)]
mod tests {
    use super::*;

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
            let profile = Profile::new(&kernel);
            let radius2 = kernel.radius().powi(2);
            for i in 0..=10_007 {
                let y = radius2 * f64::from(i) / 10_007.0;
                let error = profile.value(y) - kernel.value(radius2 - y);
                assert!(error.abs() < 1e-13, "{kernel:?} at y = {y}: {error:e}");
            }
        }
    }

    #[test]
    fn the_sharpest_kernel_is_still_exact() {
        let kernel = Kernel::Gaussian { sigma: 0.05, radius: 16.0 };
        // y itself is rounded to 3e-14 voxels^2 there, which such a kernel turns into 6e-12 of its peak.
        assert!(Profile::new(&kernel).error(&kernel) <= 1e-11);
    }

    #[test]
    fn a_series_is_its_polynomial_and_knows_its_bounds() {
        let f = |x: f64| [x.powi(7) - 2.0 * x + 0.5, x * x, 1.0, -x.powi(5)];
        let series = Series::through(&Series::points().map(f));
        let scalar = series.combined(&[1.0, 0.0, 0.0, 0.0]);
        for i in 0..200 {
            let x = f64::from(i) / 100.0 - 1.0;
            for (got, expected) in series.at(x).iter().zip(f(x)) {
                assert!((got - expected).abs() < 1e-14);
            }
            assert!((scalar.at(x) - f(x)[0]).abs() < 1e-14);
            let range = scalar.range(x, x + 0.01);
            for y in [x, x + 0.005, x + 0.01] {
                assert!((f(y)[0] - range.middle).abs() <= range.spread + 1e-15);
            }
        }
        assert!(scalar.range(-0.02, 0.02).monotone && !scalar.range(-1.0, 1.0).monotone);
        let root = scalar.solve(0.5, -0.02, 0.018);
        assert!(root.abs() < 1e-15, "{root:e}");
    }
}
