//! A kernel as piecewise polynomials: the same numbers as `Kernel::value`, many times faster.

use std::f64::consts::PI;

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
}
