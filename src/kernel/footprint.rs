//! The cumulative footprint as a table for shaders, and the whole footprint as a polynomial.

use super::Kernel;
use super::quadrature::integrate;
use crate::error::{Error, Result};

/// The cumulative footprint F(r, t) of a kernel: tabulated over the distance r of the ray, a polynomial in the position
/// t along it.
///
/// Let c = sqrt(R^2 - r^2), the half chord of the ray in the support ball, and measure t from the chord's middle.
/// Row i of the table belongs to s = c^2 / R^2 = i / (rows - 1) and holds the coefficients a_k of
///
/// ```text
/// G(t) = integral from 0 to t of h(sqrt(r^2 + u^2)) du = t (a_0 + a_1 q + a_2 q^2 + ...)     q = 1 - t^2 / c^2
/// ```
///
/// for |t| <= c; G is odd and constant beyond. Rows are interpolated linearly in s. The section of the kernel between
/// t0 and t1 is G(t1) - G(t0), and Westover's footprint 2 G(c) = 2 c a_0.
///
/// These coordinates make the table smooth. In its ball a kernel is an analytic function g of y = R^2 - rho^2. On the
/// chord y = c^2 q, so G / t = integral from 0 to 1 of g(c^2 (1 - w^2 t^2/c^2)) dw is analytic in c^2 and q. A
/// truncated kernel has a square-root edge at r = R, which is the factor t <= c, and a kink at t = c, which is the
/// clamp of t. Neither is in the table.
///
/// For every g with positive Taylor coefficients, such as a Gaussian, the a_k are positive, so Horner's rule for q in
/// 0..1 suffers no cancellation. The sections of a splat in consecutive sheets share one row: they cost one table
/// access together, and a few multiply-adds each.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FootprintTable {
    rows: u32,
    terms: u32,
    coefficients: Vec<f32>,
    max_error: f64,
}

impl FootprintTable {
    /// The numbers of polynomial terms tried: multiples of the four that a texel holds.
    const TERMS: [u32; 4] = [4, 8, 12, 16];
    const MIN_ROWS: u32 = 32;
    const MAX_ROWS: u32 = 4096;

    /// Makes the smallest table whose sections err by at most `max_error`, as a fraction of the footprint's peak.
    ///
    /// # Errors
    /// [`Error::Setting`] if no table of up to 16 terms and 4096 rows is that accurate. This happens below about 2e-7,
    /// and with kernels that are very narrow in their support.
    pub(crate) fn new(kernel: &Kernel, max_error: f64) -> Result<Self> {
        let mut best = f64::INFINITY;
        for terms in Self::TERMS {
            // More rows cannot improve a polynomial of too low a degree, so the degree is chosen first, on a few rows.
            let degree = degree_error(kernel, terms);
            if degree > max_error {
                best = best.min(degree);
                continue;
            }
            let mut rows = Self::MIN_ROWS;
            while rows <= Self::MAX_ROWS {
                let table = Self::with_size(kernel, rows, terms);
                if table.max_error <= max_error {
                    return Ok(table);
                }
                best = best.min(table.max_error);
                rows *= 2;
            }
        }
        Err(Error::Setting {
            name: "table_error",
            reason: format!(
                "no footprint table of {kernel:?} is accurate to {max_error:e}, the best errs by {best:.1e} of the \
                 peak: allow a larger error, or choose a kernel with a smaller radius"
            ),
        })
    }

    /// Makes a table of `rows` rows (at least 2) of `terms` coefficients (1 to 16).
    #[must_use]
    pub(crate) fn with_size(kernel: &Kernel, rows: u32, terms: u32) -> Self {
        let row = |s: f64| fit(terms as usize, |q| mean_to(kernel, s, q));
        let coefficients: Vec<f32> =
            (0..rows).flat_map(|i| row(f64::from(i) / f64::from(rows - 1))).map(|a| a as f32).collect();
        let mut table = Self { rows, terms, coefficients, max_error: 0.0 };
        table.max_error = table.measure(kernel);
        table
    }

    /// Measures the largest error of 2 G, as a fraction of the footprint's peak, half way between rows, where linear
    /// interpolation errs most. It bounds the error of the footprint, and of a section whose two ends err oppositely.
    fn measure(&self, kernel: &Kernel) -> f64 {
        const PROBES: u32 = 64;
        let radius = kernel.radius();
        let peak = 2.0 * radius * mean_to(kernel, 1.0, 0.0);
        let worst = (0..PROBES).map(|i| {
            // Half way between two rows, spread over the whole table from the rim to the centre.
            let row = (f64::from(i) / f64::from(PROBES - 1) * f64::from(self.rows - 2)).floor() + 0.5;
            let s = row / f64::from(self.rows - 1);
            let c = radius * s.sqrt();
            (0..=16).map(f64::from).fold(0.0_f64, |worst, j| {
                let v = j / 16.0;
                let exact = mean_to(kernel, s, 1.0 - v * v);
                let error = (self.mean(s, 1.0 - v * v) - exact).abs() * c * v;
                worst.max(2.0 * error)
            })
        });
        worst.fold(0.0, f64::max) / peak
    }

    /// Returns G / t at s and q from the table, in f64 from the f32 coefficients.
    fn mean(&self, s: f64, q: f64) -> f64 {
        let at = s * f64::from(self.rows - 1);
        let low = at.floor().min(f64::from(self.rows - 2)) as usize;
        let f = at - low as f64;
        let terms = self.terms as usize;
        let (a, b) = self.coefficients[low * terms..(low + 2) * terms].split_at(terms);
        a.iter().zip(b).rev().fold(0.0, |sum, (&a, &b)| {
            let (a, b) = (f64::from(a), f64::from(b));
            sum * q + a + (b - a) * f
        })
    }

    /// Returns the number of rows; s runs from 0 (the rim, r = R) to 1 (the centre, r = 0).
    #[must_use]
    pub(crate) fn rows(&self) -> u32 {
        self.rows
    }

    /// Returns the number of coefficients of a row.
    #[must_use]
    pub(crate) fn terms(&self) -> u32 {
        self.terms
    }

    /// Returns the coefficients, row by row, a_0 first.
    #[must_use]
    pub(crate) fn coefficients(&self) -> &[f32] {
        &self.coefficients
    }

    /// Returns the largest measured error of a section, as a fraction of the footprint's peak.
    #[must_use]
    pub(crate) fn max_error(&self) -> f64 {
        self.max_error
    }

    /// Returns the section of the kernel between t0 and t1 (voxels along the ray from its closest point) for a ray at
    /// squared distance r2 from the centre, evaluated as by the shaders but in f64.
    pub(crate) fn section(&self, radius: f64, r2: f64, t0: f64, t1: f64) -> f64 {
        let c2 = radius * radius - r2;
        if c2 <= 0.0 {
            return 0.0;
        }
        let c = c2.sqrt();
        let g = |t: f64| {
            let t = t.clamp(-c, c);
            t * self.mean(c2 / (radius * radius), 1.0 - t * t / c2)
        };
        g(t1) - g(t0)
    }
}

/// Fits the polynomial p with `terms` terms that makes c p(c^2) the footprint of a ray with half chord c (voxels).
/// Returns its coefficients, lowest first, and the largest error as a fraction of the footprint's peak.
///
/// The footprint is 2 c times the mean of the kernel over half the chord, and this mean is analytic in c^2.
pub(crate) fn footprint_polynomial(kernel: &Kernel, terms: usize) -> (Vec<f64>, f64) {
    let radius2 = kernel.radius() * kernel.radius();
    let mean = |s: f64| 2.0 * mean_to(kernel, s, 0.0);
    let powers = fit(terms, mean);
    let worst = (0..=64).map(|i| {
        let s = f64::from(i) / 64.0;
        s.sqrt() * (powers.iter().rev().fold(0.0, |sum, a| sum * s + a) - mean(s)).abs()
    });
    let error = worst.fold(0.0, f64::max) / mean(1.0);
    (powers.iter().enumerate().map(|(k, a)| a / radius2.powi(k as i32)).collect(), error)
}

/// Returns the section of the kernel between t0 and t1 for a ray at squared distance r2 from the centre, by quadrature:
/// to 1e-7 for the default Gaussian.
pub(crate) fn section(kernel: &Kernel, r2: f64, t0: f64, t1: f64) -> f64 {
    section_by(kernel, r2, [t0, t1], 2)
}

/// Returns the section of the kernel between t0 and t1, as [`section`] does, by quadrature of `panels` panels.
pub(crate) fn section_by(kernel: &Kernel, r2: f64, [t0, t1]: [f64; 2], panels: u32) -> f64 {
    let c = (kernel.radius() * kernel.radius() - r2).max(0.0).sqrt();
    integrate(t0.clamp(-c, c), t1.clamp(-c, c), panels, |t| kernel.value(r2 + t * t))
}

/// Measures the largest error of 2 G with `terms` coefficients on exact rows, as a fraction of the footprint's peak.
fn degree_error(kernel: &Kernel, terms: u32) -> f64 {
    let radius = kernel.radius();
    let worst = (1..=8).map(|i| {
        let s = f64::from(i) / 8.0;
        let row = fit(terms as usize, |q| mean_to(kernel, s, q));
        (1..=16).map(f64::from).fold(0.0_f64, |worst, j| {
            let v = j / 16.0;
            let q = 1.0 - v * v;
            let fitted = row.iter().rev().fold(0.0, |sum, a| sum * q + a);
            worst.max(2.0 * radius * s.sqrt() * v * (fitted - mean_to(kernel, s, q)).abs())
        })
    });
    worst.fold(0.0, f64::max) / (2.0 * radius * mean_to(kernel, 1.0, 0.0))
}

/// Returns G(t) / t, the mean of the kernel from the middle of the chord to t, at s = c^2 / R^2 and q = 1 - t^2 / c^2.
fn mean_to(kernel: &Kernel, s: f64, q: f64) -> f64 {
    let radius2 = kernel.radius() * kernel.radius();
    let c2 = s * radius2;
    let v2 = 1.0 - q;
    integrate(0.0, 1.0, 6, |w| kernel.value(radius2 - c2 * (1.0 - v2 * w * w)))
}

/// Returns the coefficients of the polynomial of `terms` terms through `f` at the Chebyshev nodes of [0, 1], lowest
/// first: near-minimax (Trefethen, "Approximation Theory and Approximation Practice", chapter 16), by Newton's divided
/// differences.
fn fit(terms: usize, f: impl Fn(f64) -> f64) -> Vec<f64> {
    let nodes: Vec<f64> = (0..terms)
        .map(|i| 0.5 - 0.5 * libm::cos((2 * i + 1) as f64 / (2 * terms) as f64 * std::f64::consts::PI))
        .collect();
    let mut differences: Vec<f64> = nodes.iter().map(|&q| f(q)).collect();
    for order in 1..terms {
        for i in (order..terms).rev() {
            differences[i] = (differences[i] - differences[i - 1]) / (nodes[i] - nodes[i - order]);
        }
    }
    // From Newton's form to powers of q, innermost bracket first.
    let mut powers = vec![0.0; terms];
    for i in (0..terms).rev() {
        for k in (1..terms).rev() {
            powers[k] = powers[k - 1] - nodes[i] * powers[k];
        }
        powers[0] = differences[i] - nodes[i] * powers[0];
    }
    powers
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sections_match_direct_integration() {
        for kernel in [Kernel::default(), Kernel::KAISER_BESSEL, Kernel::Gaussian { sigma: 1.5, radius: 3.0 }] {
            let (radius, accuracy) = (kernel.radius(), 1e-5);
            let table = FootprintTable::new(&kernel, accuracy).unwrap();
            let peak = kernel.cumulative_footprint(0.0, radius);
            for r in [0.0, 0.3, 1.1, 1.7, 1.97, 1.9999].map(|r| r * radius / 2.0) {
                for (t0, t1) in [(-9.0, 9.0), (-2.5, -1.5), (-0.4, 0.1), (0.0, 1.0), (1.2, 1.3), (1.9, 2.9)] {
                    let exact = kernel.cumulative_footprint(r, t1) - kernel.cumulative_footprint(r, t0);
                    let got = table.section(radius, r * r, t0, t1);
                    assert!(
                        (got - exact).abs() <= accuracy * peak,
                        "{kernel:?} r {r} t {t0}..{t1}: {got} against {exact}"
                    );
                }
            }
        }
    }

    #[test]
    fn accuracy_asked_for_decides_the_size() {
        let coarse = FootprintTable::new(&Kernel::default(), 1e-3).unwrap();
        let fine = FootprintTable::new(&Kernel::default(), 1e-6).unwrap();
        assert!(coarse.coefficients().len() < fine.coefficients().len());
        assert!(coarse.max_error() <= 1e-3 && fine.max_error() <= 1e-6);
    }

    #[test]
    fn impossible_accuracy_is_refused() {
        let error = FootprintTable::new(&Kernel::default(), 1e-9).unwrap_err();
        assert!(error.to_string().starts_with("table_error: no footprint table"), "{error}");
    }

    #[test]
    fn coefficients_of_a_gaussian_do_not_cancel() {
        let table = FootprintTable::with_size(&Kernel::default(), 64, 8);
        assert!(table.coefficients().iter().all(|&a| a > -1e-6));
    }
}
