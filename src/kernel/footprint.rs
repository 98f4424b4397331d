//! The cumulative footprint as a table that a shader can sample.

use super::Kernel;
use super::quadrature::integrate;
use crate::error::{Error, Result};

/// The running line integral of a kernel, sampled for bilinear interpolation.
///
/// With c = sqrt(R^2 - r^2), the half chord of the ray in the support ball, and v = t / c, entry (i, j) holds
///
/// ```text
/// G(c, v) = integral from 0 to v c of h(sqrt(r^2 + u^2)) du      c = R i / (n - 1),  v = j / (n - 1)
/// ```
///
/// and the section of the kernel between t0 and t1 is G(c, t1/c) - G(c, t0/c), odd in v and constant beyond |v| = 1.
///
/// These coordinates are why a small table is enough. In (r, t) the truncated kernel has a square-root edge at r = R
/// and a kink along t = c. Here both lie on the border of the table: with h = g(R^2 - rho^2), G = c * integral from 0
/// to v of g(c^2 (1 - w^2)) dw is analytic in c and v, and the bilinear error falls as 1/n^2 everywhere.
#[derive(Debug, Clone, PartialEq)]
pub struct FootprintTable {
    size: u32,
    values: Vec<f32>,
    max_error: f64,
}

impl FootprintTable {
    const MIN_SIZE: u32 = 16;
    /// Past this, rounding to f32 outweighs interpolation.
    const MAX_SIZE: u32 = 1024;

    /// The smallest table (a power of two across) whose interpolation errs by at most `max_error` of the peak of the
    /// footprint, measured at the cell centres and edges, where a bilinear interpolant of a smooth function errs most.
    ///
    /// # Errors
    /// [`Error::Setting`] where no table up to 1024^2 is that accurate (about 3e-7).
    pub fn new(kernel: &Kernel, max_error: f64) -> Result<Self> {
        let mut size = Self::MIN_SIZE;
        loop {
            let table = Self::with_size(kernel, size);
            if table.max_error <= max_error {
                return Ok(table);
            }
            if size >= Self::MAX_SIZE {
                return Err(Error::Setting {
                    name: "max-error",
                    reason: format!(
                        "{max_error} asks for more than a footprint table of {size} x {size} gives ({:.1e})",
                        table.max_error
                    ),
                });
            }
            size *= 2;
        }
    }

    /// A table of `size` x `size` entries, `size` at least 2.
    #[must_use]
    pub fn with_size(kernel: &Kernel, size: u32) -> Self {
        // Sampled at twice the resolution: the even nodes are the table, the odd ones measure it.
        let fine = 2 * size - 1;
        let radius = kernel.radius();
        let exact: Vec<f64> = (0..fine)
            .flat_map(|i| {
                let c = radius * f64::from(i) / f64::from(fine - 1);
                let r2 = radius * radius - c * c;
                let step = c / f64::from(fine - 1);
                let mut sum = 0.0;
                (0..fine).map(move |j| {
                    if j > 0 {
                        let end = f64::from(j) * step;
                        sum += integrate(end - step, end, 1, |u| kernel.value(r2 + u * u));
                    }
                    sum
                })
            })
            .collect();
        let at = |i: u32, j: u32| exact[(i * fine + j) as usize];
        let values =
            (0..size).flat_map(|i| (0..size).map(move |j| (2 * i, 2 * j))).map(|(i, j)| at(i, j) as f32).collect();
        let peak = 2.0 * at(fine - 1, fine - 1);
        let mut worst = 0.0_f64;
        for i in 0..fine {
            for j in 0..fine {
                // Nodes around (i, j): itself along an even coordinate, its two neighbours along an odd one.
                let (i0, i1, j0, j1) = (i - i % 2, i + i % 2, j - j % 2, j + j % 2);
                let bilinear = (at(i0, j0) + at(i0, j1) + at(i1, j0) + at(i1, j1)) / 4.0;
                worst = worst.max((bilinear - at(i, j)).abs());
            }
        }
        Self { size, values, max_error: worst / peak }
    }

    /// Entries across: the table is `size` x `size`.
    #[must_use]
    pub fn size(&self) -> u32 {
        self.size
    }

    /// The entries, v fastest.
    #[must_use]
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The largest interpolation error found, as a fraction of the footprint's peak.
    #[must_use]
    pub fn max_error(&self) -> f64 {
        self.max_error
    }
}
