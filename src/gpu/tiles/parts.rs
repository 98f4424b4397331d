//! Kernels as rays see them: their footprints, and the parts of these in slabs.

use glam::{DMat3, DVec3};

use super::super::layout;
use super::look::Look;
use crate::camera::{Camera, Projection};
use crate::kernel::{Kernel, footprint_polynomial, section};

/// Terms of the footprint's polynomial: the fewer where they do.
const TERMS: [usize; 2] = [6, 8];
/// The most that it may err by, as a fraction of the footprint's peak.
const FOOTPRINT_ERROR: f64 = 5e-5;

/// The footprint of a kernel as a polynomial.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Footprint {
    pub(super) coefficients: Vec<f64>,
    /// Its largest error, as a fraction of the footprint's peak.
    pub(super) error: f64,
}

impl Footprint {
    /// `None` where the terms there are do not do.
    pub(super) fn new(kernel: &Kernel) -> Option<Self> {
        let fits = TERMS.map(|terms| footprint_polynomial(kernel, terms));
        let (coefficients, error) = fits.into_iter().find(|(_, error)| *error <= FOOTPRINT_ERROR)?;
        Some(Self { coefficients, error })
    }

    pub(super) fn terms(&self) -> u32 {
        self.coefficients.len() as u32
    }
}

/// The parts of kernels in slabs, as all rays of a picture need them: the same for every look and region of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sections(pub(super) [[[f32; 4]; 3]; layout::SECTIONS]);

impl Sections {
    pub(super) fn new(kernel: &Kernel, camera: &Camera, looks: &[Look], scalars: bool) -> Self {
        Self(match (camera.projection, looks) {
            (Projection::Orthographic { .. }, [look, ..]) => {
                [sections(kernel, look.direction, scalars); layout::SECTIONS]
            }
            _ => std::array::from_fn(|step| section_step(step, kernel, scalars)),
        })
    }
}

/// A step of the table of sections: those of any direction that leans so far, with s in units of that. So they are smooth
/// towards rays along m, which meet all kernels of a plane at s = 0.
fn section_step(step: usize, kernel: &Kernel, scalars: bool) -> [[f32; 4]; 3] {
    let lean = (std::f64::consts::SQRT_2 * step as f64 / (layout::SECTIONS - 1) as f64).max(1e-3);
    let [x, y, z] = sections(kernel, DVec3::new(0.0, lean, 1.0).normalize(), scalars);
    let lean = lean as f32;
    [x, y.map(|c| c * lean), z.map(|c| c * lean * lean)]
}

/// The parts of a kernel in the slabs before its middle, as the least squares fit over where rays can meet its plane: for
/// each slab, by its number, footprint times x + y s, with scalars + z s^2; s is the place of its centre along the ray.
///
/// Slabs are a plane thick, with a plane in their middle, those of scalars half as thick between planes.
fn sections(kernel: &Kernel, direction: DVec3, scalars: bool) -> [[f32; 4]; 3] {
    /// Places along a side of the square that is looked at.
    const SIDE: i32 = 25;
    let radius = kernel.radius();
    let reach = radius / direction.z;
    // Planes where slabs begin and end: of scalars the first one first, of colours the nearest.
    let slabs: &[[f64; 2]] = if scalars {
        &[[-2.0, -1.5], [-1.5, -1.0], [-1.0, -0.5], [-0.5, 0.0]]
    } else {
        &[[-1.5, -0.5], [-2.5, -1.5], [-3.5, -2.5]]
    };
    // Powers of s that are told apart: rays along m meet all kernels of a plane at s = 0.
    let terms = if direction.z > 1.0 - 1e-9 {
        1
    } else if scalars {
        3
    } else {
        2
    };
    // Sums of squares of the footprint times powers of s, and of these times each part.
    let mut normal = DMat3::ZERO;
    let mut parts = [DVec3::ZERO; 4];
    for i in 0..SIDE {
        for j in 0..SIDE {
            let place = |n: i32| reach * (f64::from(2 * n + 1) / f64::from(SIDE) - 1.0);
            let (du, dv) = (place(i), place(j));
            let s = du * direction.x + dv * direction.y;
            let r2 = du * du + dv * dv - s * s;
            if r2 >= radius * radius {
                continue;
            }
            let powers = DVec3::new(1.0, s, s * s) * section(kernel, r2, -radius, radius);
            normal += DMat3::from_cols(powers * powers.x, powers * powers.y, powers * powers.z);
            for (sum, slab) in parts.iter_mut().zip(slabs) {
                *sum += powers * section(kernel, r2, slab[0] / direction.z - s, slab[1] / direction.z - s);
            }
        }
    }
    // Powers that are not fitted are left out of the equations.
    for unused in terms..3 {
        let axis = DVec3::AXES[unused];
        let keep = DVec3::ONE - axis;
        normal = DMat3::from_cols(normal.x_axis * keep, normal.y_axis * keep, normal.z_axis * keep);
        *normal.col_mut(unused) = axis;
        parts = parts.map(|part| part * keep);
    }
    let solve = normal.inverse();
    let fits = parts.map(|part| (solve * part).as_vec3());
    [fits.map(|fit| fit.x), fits.map(|fit| fit.y), fits.map(|fit| fit.z)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_a_kernel_are_its_sections() {
        for direction in [DVec3::Z, DVec3::new(0.1, 0.4, 0.8).normalize(), DVec3::new(1.0, 1.0, 1.0).normalize()] {
            for kernel in [Kernel::default(), Kernel::KAISER_BESSEL] {
                let [[x1, x0, ..], [y1, y0, ..], _] = sections(&kernel, direction, false).map(|c| c.map(f64::from));
                // Of a kernel before the ray's place, more is in the slabs before.
                assert!(direction == DVec3::Z || y0 < 0.0 && y1 < 0.0, "{y0} {y1}");
                // Through the middle: what symmetry leaves adds up to the footprint.
                let plane = |n: f64| n / direction.z;
                let whole = section(&kernel, 0.0, -9.0, 9.0);
                for (x, n) in [(x0, -2.5), (x1, -1.5), (1.0 - 2.0 * (x0 + x1), -0.5)] {
                    let exact = section(&kernel, 0.0, plane(n), plane(n + 1.0)) / whole;
                    // The fit is to all places at once, most of which are beside the middle.
                    assert!((x - exact).abs() < 0.15, "{kernel:?} {direction} {n}: {x} for {exact}");
                }
            }
        }
    }

    #[test]
    fn footprints_are_polynomials() {
        for kernel in [Kernel::default(), Kernel::KAISER_BESSEL] {
            let Footprint { coefficients, error } = Footprint::new(&kernel).unwrap();
            let radius = kernel.radius();
            let peak = kernel.cumulative_footprint(0.0, radius);
            let worst = (0..=50).map(|i| {
                let r = radius * f64::from(i) / 50.0;
                let c2 = radius * radius - r * r;
                let got = c2.sqrt() * coefficients.iter().rev().fold(0.0, |sum, a| sum * c2 + a);
                (got - kernel.cumulative_footprint(r, radius)).abs() / peak
            });
            let worst = worst.fold(0.0, f64::max);
            assert!(worst < 2e-5 && (worst - error).abs() < 1e-5, "{kernel:?}: {worst:e}, {error:e}");
        }
    }
}
