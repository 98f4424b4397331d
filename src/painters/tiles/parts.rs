//! Kernels in the form that rays evaluate: the footprint as a polynomial, and its parts in the slabs around a kernel as
//! linear or quadratic functions.

use std::sync::Arc;

use glam::{DMat3, DVec3};

use super::axis::PrincipalAxis;
use crate::camera::{Camera, Projection};
use crate::error::Result;
use crate::gpu::cache::Cache;
use crate::gpu::context::Context;
use crate::gpu::layout;
use crate::kernel::{Kernel, footprint_polynomial, section};

/// The numbers of terms of the footprint's polynomial, of which the first that is accurate enough is used.
const TERMS: [usize; 2] = [6, 8];
/// The largest error of the polynomial, as a fraction of the footprint's peak: 1/80 of a step of 8-bit colour.
const FOOTPRINT_ERROR: f64 = 5e-5;

/// The shear of the last entry of the table of sections; SECTION_STEPS in shaders/common/rays.wgsl.
const LARGEST_SHEAR: f64 = 1.55;

/// The footprint of a kernel as a polynomial.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Footprint {
    pub(super) coefficients: Vec<f64>,
    /// The largest error of the polynomial, as a fraction of the footprint's peak.
    pub(super) error: f64,
}

impl Footprint {
    /// Fits the footprint of a kernel; `None` if the largest number of terms is not accurate enough.
    pub(super) fn new(kernel: &Kernel) -> Option<Self> {
        let fits = TERMS.map(|terms| footprint_polynomial(kernel, terms));
        let (coefficients, error) = fits.into_iter().find(|(_, error)| *error <= FOOTPRINT_ERROR)?;
        Some(Self { coefficients, error })
    }

    pub(super) fn terms(&self) -> u32 {
        self.coefficients.len() as u32
    }
}

/// The contents of slabs, which decide how thick they are and how parts are fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum SlabKind {
    /// Colours, in slabs a plane thick: x + y s.
    Colors,
    /// Colours of dense material, in which small errors of parts are visible: x + y s + z s^2.
    DenseColors,
    /// Scalars, in slabs half a plane thick: x + y s + z s^2.
    Scalars,
}

impl SlabKind {
    /// Returns the places where slabs begin and end along m, from the kernel's plane: four near slabs, then far ones.
    /// For scalars the foremost of four is first, for colours the one next to the kernel's own, as in
    /// shaders/common/rays.wgsl.
    fn slabs(self) -> Vec<[f64; 2]> {
        let scalars = [-2.0, -1.5, -1.0, -0.5, -4.0, -3.5, -3.0, -2.5].map(|low| [low, low + 0.5]);
        let colors = [-1.5, -2.5, -3.5, -4.5].map(|low| [low, low + 1.0]);
        if self == Self::Scalars { scalars.to_vec() } else { colors.to_vec() }
    }

    /// Returns the number of powers of s that are fitted.
    fn terms(self) -> usize {
        match self {
            Self::Colors => 2,
            Self::DenseColors | Self::Scalars => 3,
        }
    }
}

/// The parts of a kernel in near and in far slabs.
type NearAndFar = [layout::Section; 2];

/// The parts of kernels in slabs for every ray of a picture: [`layout::Tables::sections`]. Parts of kernels that
/// grow with their depth are parabolas in their growth less 1, through the least kernel, the largest and one between.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct KernelSections(pub(super) [[[layout::Section; layout::SECTIONS]; layout::SECTION_POWERS]; 2]);

impl KernelSections {
    /// Returns the parts for the rays along an axis, on the device. For rays through one eye they depend on the kernel
    /// and its growth alone, take 2 ms to fit, and are kept for growths up to the next eighth of an octave.
    pub(super) fn on_device(
        (context, made): (&Context, &Cache),
        (kernel, kind): (&Kernel, SlabKind),
        camera: &Camera,
        axis: &PrincipalAxis,
        most: f64,
    ) -> Result<Arc<wgpu::Buffer>> {
        const STEPS: f64 = 8.0;
        let most = if most > 1.0 { libm::exp2((libm::log2(most) * STEPS).ceil() / STEPS) } else { 1.0 };
        let make = || {
            let tables = layout::Tables { sections: Self::new(kernel, camera, axis, kind, most).0 };
            context.upload("gather.sections", bytemuck::bytes_of(&tables), wgpu::BufferUsages::UNIFORM)
        };
        if let Projection::Orthographic { .. } = camera.projection {
            return make().map(Arc::new);
        }
        made.get_or_make((format!("{kernel:?}"), kind, most.to_bits()), make)
    }

    /// Fits the parts for the rays along an axis. `most` is the largest growth of rays through one eye.
    pub(super) fn new(kernel: &Kernel, camera: &Camera, axis: &PrincipalAxis, kind: SlabKind, most: f64) -> Self {
        const NONE: layout::Section = [[0.0; 4]; 3];
        let table = |growth: f64| -> [NearAndFar; layout::SECTIONS] {
            std::array::from_fn(|step| section_step(step, &kernel.grown(growth), kind))
        };
        let mut powers = [[[NONE; layout::SECTIONS]; layout::SECTION_POWERS]; 2];
        if let Projection::Orthographic { .. } = camera.projection {
            let both = sections(kernel, axis.direction, kind);
            for (powers, section) in powers.iter_mut().zip(both) {
                powers[0] = [section; layout::SECTIONS];
            }
            return Self(powers);
        }
        // Nodes that are so close that differences are rounding are put farther apart.
        let range = (most - 1.0).max(0.01);
        let least = table(1.0);
        let nodes = (most > 1.0).then(|| [0.5, 1.0].map(|part| table(1.0 + part * range)));
        for (half, powers) in powers.iter_mut().enumerate() {
            for step in 0..layout::SECTIONS {
                let low = least[step][half];
                powers[0][step] = low;
                let Some([between, high]) = nodes.map(|nodes| nodes.map(|table| table[step][half])) else { continue };
                for (term, slab) in (0..3).flat_map(|term| (0..4).map(move |slab| (term, slab))) {
                    let [low, between, high] = [low, between, high].map(|section| f64::from(section[term][slab]));
                    powers[1][step][term][slab] = ((4.0 * between - high - 3.0 * low) / range) as f32;
                    powers[2][step][term][slab] = (2.0 * (high - 2.0 * between + low) / (range * range)) as f32;
                }
            }
        }
        Self(powers)
    }
}

/// Fits an entry of the table of sections: the parts along every ray whose shear has this length, its lean, with s in
/// units of the lean. In this unit the coefficients change smoothly towards rays along m, which meet all kernels of a
/// plane at s = 0.
fn section_step(step: usize, kernel: &Kernel, kind: SlabKind) -> NearAndFar {
    // Rays along m have no fit over s. They get the entry of a lean of 1e-3. Its linear terms are below 4e-4 of the
    // footprint, because s is at most twice the lean, and 0 is their limit.
    let lean = (LARGEST_SHEAR * step as f64 / (layout::SECTIONS - 1) as f64).max(1e-3);
    let both = sections(kernel, DVec3::new(0.0, lean, 1.0).normalize(), kind);
    let lean = lean as f32;
    both.map(|[x, y, z]| [x, y.map(|c| c * lean), z.map(|c| c * lean * lean)])
}

/// Fits the parts of a kernel in the slabs before its centre, as fractions of its footprint: x + y s, or x + y s + z
/// s^2. s is the place of its centre along the ray, from where the ray meets its plane; lengths are in voxels. The fit
/// is by least squares over all places of the plane in which a ray meets the kernel.
///
/// A slab of colours is a plane thick and has its plane in the middle. A slab of scalars is half a plane thick and lies
/// between two planes or half planes.
///
/// Returned are x, y and z, each for up to four near slabs, and for up to four far ones.
fn sections(kernel: &Kernel, direction: DVec3, kind: SlabKind) -> NearAndFar {
    /// The number of places along each side of the square around the ray. More of them change the fractions by less
    /// than 1e-3.
    const SIDE: i32 = 25;
    let radius = kernel.radius();
    let reach = radius / direction.z;
    // Only s^0 for rays along m, which meet all kernels of a plane at s = 0.
    let terms = if direction.z > 1.0 - 1e-9 { 1 } else { kind.terms() };
    // The normal equations: sums of products of the footprint times powers of s, and of these times each part.
    let mut normal = DMat3::ZERO;
    let mut parts = [DVec3::ZERO; 8];
    let slabs = kind.slabs();
    // The kernel does not reach other slabs.
    let reached = |slab: &[f64; 2]| -slab[1] < radius;
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
            for (sum, slab) in parts.iter_mut().zip(&slabs).filter(|(_, slab)| reached(slab)) {
                *sum += powers * section(kernel, r2, slab[0] / direction.z - s, slab[1] / direction.z - s);
            }
        }
    }
    // A power that is not fitted gets the equation `coefficient = 0`.
    for unused in terms..3 {
        let axis = DVec3::AXES[unused];
        let keep = DVec3::ONE - axis;
        normal = DMat3::from_cols(normal.x_axis * keep, normal.y_axis * keep, normal.z_axis * keep);
        *normal.col_mut(unused) = axis;
        parts = parts.map(|part| part * keep);
    }
    let solve = normal.inverse();
    let fits = parts.map(|part| (solve * part).as_vec3());
    [0, 4].map(|first| {
        let four: [_; 4] = std::array::from_fn(|slab| fits[first + slab]);
        [four.map(|fit| fit.x), four.map(|fit| fit.y), four.map(|fit| fit.z)]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the root mean square error of the parts, of the footprint's peak, over the square in which rays meet a
    /// plane.
    fn rms_of_parts(kernel: &Kernel, direction: DVec3, kind: SlabKind) -> f64 {
        let slabs = kind.slabs();
        let fits = sections(kernel, direction, kind).map(|half| half.map(|row| row.map(f64::from)));
        let radius = kernel.radius();
        // Places between the places of the fit.
        let places = (0..20).map(|i| (f64::from(2 * i + 1) / 20.0 - 1.0) * radius / direction.z);
        let (mut squares, mut count) = (0.0, 0.0);
        for (du, dv) in places.clone().flat_map(|u| places.clone().map(move |v| (u, v))) {
            let s = du * direction.x + dv * direction.y;
            let r2 = du * du + dv * dv - s * s;
            if r2 >= radius * radius {
                continue;
            }
            let footprint = section(kernel, r2, -radius, radius);
            for (slab, planes) in slabs.iter().enumerate() {
                let [x, y, z] = fits[slab / 4].map(|row| row[slab % 4]);
                let [near, far] = planes.map(|plane| plane / direction.z - s);
                squares += (footprint * (x + y * s + z * s * s) - section(kernel, r2, near, far)).powi(2);
                count += 1.0;
            }
        }
        (squares / count).sqrt() / section(kernel, 0.0, -radius, radius)
    }

    #[test]
    fn parts_of_a_kernel_are_its_sections() {
        // Along the diagonal a slab is 1.7 voxels of the ray, in which kernels are not straight: 2.2e-2 of a Gaussian.
        let oblique = DVec3::new(0.1, 0.4, 0.8).normalize();
        for (direction, limit) in [(DVec3::Z, 0.01), (oblique, 0.01), (DVec3::ONE.normalize(), 0.025)] {
            for kernel in [Kernel::default(), Kernel::KAISER_BESSEL] {
                for kind in [SlabKind::Colors, SlabKind::DenseColors, SlabKind::Scalars] {
                    let rms = rms_of_parts(&kernel, direction, kind);
                    assert!(rms < limit, "{kernel:?} {direction} {kind:?}: {rms:e}");
                }
                // Of a kernel before the ray's place, more is in the slabs before.
                let [[_, [y1, y0, ..], _], _] = sections(&kernel, direction, SlabKind::Colors);
                assert!(direction == DVec3::Z || y0 < 0.0 && y1 < 0.0, "{y0} {y1}");
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
