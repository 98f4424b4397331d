//! The filter of samples that undoes a kernel's blur at the lattice points.

use std::f64::consts::PI;

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::kernel::quadrature::chebyshev;
use crate::kernel::{Kernel, Real};
use crate::progress::Progress;
use crate::volume::{Samples, ToF64, Volume, with_samples};
use voxsplat_volume::memory::reserved;

/// The least response of a kernel at which a frequency is restored in full: no frequency of the samples grows by more
/// than about 1 / [`LEAST`].
const LEAST: f64 = 0.05;
/// The largest deviation from 1 of the response of kernel and filter together, at restored frequencies.
const ACCURACY: f64 = 5e-3;
/// The highest degree of the polynomial that approximates the filter.
const MAX_DEGREE: usize = 24;
/// The margin around the spectrum of the kernel, so that rounding and the faces of the lattice stay within the span.
const MARGIN: f64 = 0.01;
/// Number of intervals between the frequencies of a spectrum along an axis, from 0 to Nyquist's.
const FREQUENCIES: usize = 24;
/// The largest kernel radius that is undone, voxels: the work grows with its cube.
const MAX_RADIUS: f64 = 4.0;

/// A filter of samples: coefficients c that make a sum of kernels pass through the samples f.
///
/// At the lattice points the sum of kernels is the convolution B of c with the kernel's own values there, over its
/// integral. Interpolation requires B c = f. The spectrum of B is real and at most about 1, so a polynomial of B
/// approximates its inverse well, and needs only convolutions with a small stencil (Chebyshev polynomials; Golub and
/// Varga 1961). Below its least value the inverse g is bent to 0:
///
/// ```text
/// g(b) = 1 / b for b >= LEAST,        (2 - u^2) u / LEAST with u = b / LEAST below
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Prefilter {
    /// The values of the kernel at lattice points over its integral, by squared distance.
    shells: Vec<f64>,
    reach: usize,
    /// The range of responses that the Chebyshev polynomials span.
    span: [f64; 2],
    /// The coefficients of the Chebyshev polynomials, lowest first.
    coefficients: Vec<f64>,
}

/// Returns the inverse of a response, bent to 0 if it would be large.
fn inverse(b: f64) -> f64 {
    let u = b / LEAST;
    if u >= 1.0 { 1.0 / b } else { u.max(-1.0) * (2.0 - u * u).max(1.0) / LEAST }
}

impl Prefilter {
    /// Refuses a kernel that is too large to be undone.
    ///
    /// # Errors
    /// [`Error::Setting`] that names the sharpness.
    pub(crate) fn check(kernel: &Kernel) -> Result<()> {
        let radius = kernel.radius();
        if radius <= MAX_RADIUS {
            return Ok(());
        }
        let reason = format!(
            "samples are not filtered for a kernel of radius {radius}: expected 0, or a radius up to {MAX_RADIUS}"
        );
        Err(Error::Setting { name: "sharpness", reason })
    }

    /// Makes the filter of a kernel for a sharpness from 0 (no change) to 1 (all of the change).
    ///
    /// # Errors
    /// [`Error::Setting`] if the kernel is too large.
    pub(crate) fn new(kernel: &Kernel, sharpness: f64) -> Result<Self> {
        Self::check(kernel)?;
        let radius = kernel.radius();
        let reach = radius.floor() as usize;
        let at = |square: usize| {
            // On the rim, the mean of its two sides.
            let near = |square: f64| kernel.value(square.max(0.0));
            let square = square as f64;
            f64::midpoint(near(square - 1e-9), near(square + 1e-9)) / kernel.integral()
        };
        let shells = (0..=(radius * radius).floor() as usize).map(at).collect();
        let mut filter = Self { shells, reach, span: [0.0; 2], coefficients: Vec::new() };
        let spectrum = filter.spectrum();
        let bounds = |[low, high]: [f64; 2], b: &f64| [low.min(*b), high.max(*b)];
        let [low, high] = spectrum.iter().fold([f64::INFINITY, f64::NEG_INFINITY], bounds);
        filter.span = [low - MARGIN, high + MARGIN];
        let far = |filter: &Self| {
            let error = |&b: &f64| (1.0 - b * filter.gain_at(b)).abs();
            spectrum.iter().filter(|&&b| b >= LEAST).map(error).fold(0.0, f64::max)
        };
        let constant = filter.response([0.0; 3]);
        for degree in 2..=MAX_DEGREE {
            filter.coefficients = filter.fitted(degree, constant);
            if far(&filter) <= ACCURACY {
                break;
            }
        }
        for (degree, coefficient) in filter.coefficients.iter_mut().enumerate() {
            *coefficient = sharpness * *coefficient + if degree == 0 { 1.0 - sharpness } else { 0.0 };
        }
        Ok(filter)
    }

    /// Returns the coefficients of a polynomial of a degree that approximates the inverse. At the response to a
    /// constant it is exact, so that slow waves are right; the rest is fitted at Chebyshev's nodes.
    fn fitted(&self, degree: usize, constant: f64) -> Vec<f64> {
        let remains = |b: f64| match b {
            b if b >= LEAST => -1.0 / (b * constant),
            b => (inverse(b) - 1.0 / constant) / (b - constant),
        };
        let rest = self.transformed(degree - 1, remains);
        self.transformed(degree, |b| 1.0 / constant + (b - constant) * self.sum(&rest, b))
    }

    /// Returns the coefficients of the polynomial of a degree through a function at Chebyshev's nodes.
    fn transformed(&self, degree: usize, function: impl Fn(f64) -> f64) -> Vec<f64> {
        let [low, high] = self.span;
        chebyshev(degree + 1, |x| function(f64::midpoint(low, high) + (high - low) / 2.0 * x))
    }

    /// Returns the factor of the filter at a frequency where the kernel's response is `b`.
    fn gain_at(&self, b: f64) -> f64 {
        self.sum(&self.coefficients, b)
    }

    /// Sums Chebyshev polynomials by Clenshaw's rule.
    fn sum(&self, coefficients: &[f64], b: f64) -> f64 {
        let [low, high] = self.span;
        let x = (2.0 * b - low - high) / (high - low);
        let [first, second] = coefficients.iter().skip(1).rev().fold([0.0, 0.0], |[a, b], c| [c + 2.0 * x * a - b, a]);
        coefficients.first().copied().unwrap_or(0.0) + x * first - second
    }

    /// Returns the kernel's response to a frequency (radians a voxel) at the lattice points.
    fn response(&self, frequency: [f64; 3]) -> f64 {
        let cosines = frequency.map(|w| -> Vec<f64> {
            (0..=self.reach).map(|i| if i == 0 { 1.0 } else { 2.0 * libm::cos(i as f64 * w) }).collect()
        });
        let [x, y, z] = &cosines;
        let mut sum = 0.0;
        for (k, z) in z.iter().enumerate() {
            for (j, y) in y.iter().enumerate() {
                for (i, x) in x.iter().enumerate() {
                    sum += x * y * z * self.shells.get(i * i + j * j + k * k).copied().unwrap_or(0.0);
                }
            }
        }
        sum
    }

    /// Returns the factor of the filter at a frequency (radians a voxel).
    #[must_use]
    pub fn gain(&self, frequency: [f64; 3]) -> f64 {
        self.gain_at(self.response(frequency))
    }

    /// Returns the kernel's responses to the frequencies of a grid.
    fn spectrum(&self) -> Vec<f64> {
        let w = |i: usize| i as f64 * PI / FREQUENCIES as f64;
        let all = (0..=FREQUENCIES).flat_map(|i| (0..=i).flat_map(move |j| (0..=j).map(move |k| [i, j, k])));
        all.map(|frequency| self.response(frequency.map(w))).collect()
    }

    /// Filters the samples of a volume in f64.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if values are too far apart; [`Error::Input`](crate::Error::Input) and
    /// [`Error::Memory`].
    pub fn filtered(&self, volume: &Volume) -> Result<Volume> {
        self.apply::<f64>(volume, 0.0, &Progress::default())
    }

    /// Filters the samples of a volume. The result has samples of type `T` with a rescale of their own, so that
    /// differences from `base` keep their digits at any offset. Beyond the faces coefficients repeat, as painters
    /// assume.
    ///
    /// Planes pass all applications of the stencil as they are read: besides the result, memory holds 2 x radius + 3
    /// planes for each degree of the polynomial.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if values are too far apart; [`Error::Input`](crate::Error::Input) and
    /// [`Error::Memory`].
    pub(crate) fn apply<T: Real>(&self, volume: &Volume, base: f64, progress: &Progress) -> Result<Volume> {
        let (slope, intercept) = volume.rescale();
        let difference = |raw: f64| slope * raw + intercept - base;
        let largest = volume.ranges()?.iter().flatten().map(|&raw| difference(raw).abs()).fold(0.0, f64::max);
        if !largest.is_finite() {
            return Err(Error::volume("values are further apart than a number can hold"));
        }
        let unit = libm::exp2(libm::log2(largest.clamp(f64::MIN_POSITIVE, f64::MAX)).floor().clamp(-1000.0, 1000.0));
        let [nx, ny, nz] = volume.grid().dims().map(|d| d as usize);
        let size = nx * ny;
        let mut result: Vec<T> = reserved(volume.grid().len(), || "filtered samples".to_owned())?;
        result.resize(size * nz, T::from_f64(0.0));
        let degree = self.coefficients.len() - 1;
        // A plane of a polynomial is made once the planes that it needs have been made, a step before at the latest.
        let lag = self.reach + 1;
        let depth = 2 * lag + 1;
        let mut rings: Vec<Vec<Vec<T>>> = vec![vec![Vec::new(); depth]; degree + 1];
        for step in 0..nz + degree * lag {
            let mut work: Vec<(usize, usize, Vec<T>, &mut [T])> = Vec::new();
            let mut rest = &mut result[..];
            let mut taken = 0;
            for order in (0..=degree).rev() {
                let Some(z) = step.checked_sub(order * lag).filter(|z| *z < nz) else { continue };
                let (_, from) = std::mem::take(&mut rest).split_at_mut((z - taken) * size);
                let (sum, behind) = from.split_at_mut(size);
                (rest, taken) = (behind, z + 1);
                let mut plane = std::mem::take(&mut rings[order][z % depth]);
                if plane.is_empty() {
                    plane = reserved(size as u64, || "filtered samples".to_owned())?;
                    plane.resize(size, T::from_f64(0.0));
                }
                work.push((order, z, plane, sum));
            }
            work.par_iter_mut().try_for_each(|(order, z, plane, sum)| {
                if *order == 0 {
                    let samples = volume.read(*z * size..(*z + 1) * size)?;
                    with_samples!(&samples, s => {
                        let scaled = s.iter().map(|v| T::from_f64(difference(v.to_f64()) / unit));
                        plane.iter_mut().zip(scaled).for_each(|(to, v)| *to = v);
                    });
                } else {
                    let before = &rings[*order - 1];
                    let planes = |k: i64| -> &[T] {
                        let at = (*z as i64 + k).clamp(0, nz as i64 - 1) as usize;
                        &before[at % depth]
                    };
                    let last = order.checked_sub(2).map(|order| &rings[order][*z % depth][..]);
                    self.step(&planes, last, [nx, ny], plane);
                }
                let coefficient = T::from_f64(self.coefficients[*order]);
                sum.iter_mut().zip(plane.iter()).for_each(|(sum, &v)| *sum += coefficient * v);
                Ok::<(), Error>(())
            })?;
            for (order, z, plane, _) in work {
                rings[order][z % depth] = plane;
            }
            progress.report("sharpening", (step + 1) as f64 / (nz + degree * lag) as f64);
            progress.check()?;
        }
        let samples: Samples = T::collected(result);
        Ok(Volume::new(*volume.grid(), samples)?.with_rescale(unit, base)?)
    }

    /// Makes a plane of a Chebyshev polynomial, given the planes of the preceding polynomial by their distance, and the
    /// plane of the polynomial before that.
    fn step<'a, T: Real>(
        &self,
        planes: &dyn Fn(i64) -> &'a [T],
        last: Option<&[T]>,
        [nx, ny]: [usize; 2],
        out: &mut [T],
    ) {
        let [low, high] = self.span;
        let times = if last.is_some() { 2.0 } else { 1.0 };
        let scale = 2.0 * times / (high - low);
        let own = T::from_f64(-times * (high + low) / (high - low));
        let reach = self.reach as i64;
        // Rows at the same distance from the row in the middle have the same weight.
        let mut sums = vec![vec![T::from_f64(0.0); nx + 2 * self.reach]; self.shells.len()];
        let mut rows: Vec<Vec<&[T]>> = vec![Vec::new(); self.shells.len()];
        for (y, out) in out.chunks_exact_mut(nx).enumerate() {
            rows.iter_mut().for_each(Vec::clear);
            for k in -reach..=reach {
                let plane = planes(k);
                for j in -reach..=reach {
                    let at = (y as i64 + j).clamp(0, ny as i64 - 1) as usize;
                    if let Some(rows) = rows.get_mut((j * j + k * k) as usize) {
                        rows.push(&plane[at * nx..(at + 1) * nx]);
                    }
                }
            }
            for (sum, rows) in sums.iter_mut().zip(&rows) {
                add_up(rows, &mut sum[self.reach..][..nx]);
            }
            let row = &planes(0)[y * nx..(y + 1) * nx];
            match last {
                Some(last) => {
                    let last = &last[y * nx..(y + 1) * nx];
                    out.iter_mut().zip(row.iter().zip(last)).for_each(|(out, (&v, &last))| *out = own * v - last);
                }
                None => out.iter_mut().zip(row).for_each(|(out, &v)| *out = own * v),
            }
            for (square, sum) in sums.iter_mut().enumerate().filter(|(square, _)| !rows[*square].is_empty()) {
                let (first, end) = (sum[self.reach], sum[self.reach + nx - 1]);
                sum[..self.reach].fill(first);
                sum[self.reach + nx..].fill(end);
                for i in 0..=self.reach {
                    let Some(&shell) = self.shells.get(square + i * i) else { break };
                    let weight = T::from_f64(scale * shell);
                    let (left, right) = (&sum[self.reach - i..][..nx], &sum[self.reach + i..][..nx]);
                    if i == 0 {
                        out.iter_mut().zip(left).for_each(|(out, &v)| *out += weight * v);
                    } else {
                        let pairs = left.iter().zip(right);
                        out.iter_mut().zip(pairs).for_each(|(out, (&l, &r))| *out += weight * (l + r));
                    }
                }
            }
        }
    }
}

/// Sums rows: one, or a multiple of four, the number of lattice points on a circle.
fn add_up<T: Real>(rows: &[&[T]], sum: &mut [T]) {
    if let [row] = rows {
        sum.copy_from_slice(row);
    }
    for (index, rows) in rows.chunks_exact(4).enumerate() {
        let [a, b, c, d] = [rows[0], rows[1], rows[2], rows[3]];
        let fours = a.iter().zip(b).zip(c.iter().zip(d)).map(|((&a, &b), (&c, &d))| (a + b) + (c + d));
        if index == 0 {
            sum.iter_mut().zip(fours).for_each(|(sum, four)| *sum = four);
        } else {
            sum.iter_mut().zip(fours).for_each(|(sum, four)| *sum += four);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns values in 0..1 without order (splitmix64).
    fn noise(count: usize) -> Vec<f64> {
        let of = |index: usize| {
            let z = (index as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..count).map(of).collect()
    }

    fn values(volume: &Volume) -> Vec<f64> {
        let memory = volume.in_memory().unwrap();
        (0..memory.samples().len()).map(|index| memory.value(index)).collect()
    }

    /// Returns the sum of kernels at each lattice point, coefficients repeated beyond the faces.
    fn at_lattice_points(kernel: &Kernel, dims: [usize; 3], coefficients: &[f64]) -> Vec<f64> {
        let reach = kernel.radius().ceil() as i64;
        let range = || -reach..=reach;
        let point = |index: usize| [index % dims[0], index / dims[0] % dims[1], index / (dims[0] * dims[1])];
        let sum = |index: usize| {
            let at = point(index);
            let clamped = |axis: usize, step: i64| (at[axis] as i64 + step).clamp(0, dims[axis] as i64 - 1) as usize;
            let mut sum = 0.0;
            for k in range() {
                for j in range() {
                    for i in range() {
                        let index = clamped(0, i) + dims[0] * (clamped(1, j) + dims[1] * clamped(2, k));
                        sum += kernel.value((i * i + j * j + k * k) as f64) * coefficients[index];
                    }
                }
            }
            sum / kernel.integral()
        };
        (0..coefficients.len()).map(sum).collect()
    }

    fn filtered<T: Real>(kernel: &Kernel, dims: [usize; 3], samples: &[f64], base: f64) -> Vec<f64> {
        let volume = Volume::from_slice(dims.map(|d| d as u32), [1.0; 3], samples).unwrap();
        let filter = Prefilter::new(kernel, 1.0).unwrap();
        values(&filter.apply::<T>(&volume, base, &Progress::default()).unwrap())
    }

    #[test]
    fn the_blob_passes_through_any_samples_up_to_the_faces() {
        let dims = [21, 17, 12];
        let samples = noise(21 * 17 * 12);
        let blob = Kernel::KAISER_BESSEL;
        let field = at_lattice_points(&blob, dims, &filtered::<f64>(&blob, dims, &samples, 0.3));
        let far = samples.iter().zip(&field).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(far < ACCURACY, "{far}");
        let blurred = at_lattice_points(&blob, dims, &samples);
        assert!(samples.iter().zip(&blurred).any(|(a, b)| (a - b).abs() > 0.3));
    }

    #[test]
    fn constants_and_planes_stay() {
        let dims = [30, 30, 30];
        let point = |index: usize| [index % 30, index / 30 % 30, index / 900];
        let samples: Vec<f64> = (0..27_000).map(point).map(|[x, y, z]| (2 * x + y) as f64 - 3.0 * z as f64).collect();
        for kernel in [Kernel::KAISER_BESSEL, Kernel::Gaussian { sigma: 1.0, radius: 3.5 }] {
            let constant = filtered::<f64>(&kernel, dims, &[5.0; 27_000], 0.0);
            let field = at_lattice_points(&kernel, dims, &constant);
            assert!(field.iter().all(|v| (v - 5.0).abs() < 1e-8), "{kernel}: {:?}", &field[..4]);
        }
        let blob = Kernel::KAISER_BESSEL;
        let field = at_lattice_points(&blob, dims, &filtered::<f64>(&blob, dims, &samples, 0.0));
        for (index, (a, b)) in samples.iter().zip(&field).enumerate() {
            let inside = point(index).iter().all(|place| (8..22).contains(place));
            assert!((a - b).abs() < if inside { 1e-3 } else { 0.1 }, "{:?}: {a} {b}", point(index));
        }
    }

    #[test]
    fn single_precision_and_offsets_lose_nothing() {
        let dims = [16, 9, 11];
        let samples: Vec<f64> = noise(16 * 9 * 11).iter().map(|v| 1e9 + 1e-3 * v).collect();
        let exact = filtered::<f64>(&Kernel::KAISER_BESSEL, dims, &samples, 1e9);
        let single = filtered::<f32>(&Kernel::KAISER_BESSEL, dims, &samples, 1e9);
        // A number near 1e9 has steps of 1.2e-7.
        assert!(exact.iter().zip(&single).all(|(a, b)| (a - b).abs() < 2.5e-7));
    }

    #[test]
    fn gains_are_bounded_whatever_the_kernel() {
        let gaussian = |sigma, radius| Kernel::Gaussian { sigma, radius };
        let blob = |radius, alpha| Kernel::KaiserBessel { radius, alpha };
        for kernel in [gaussian(1.0, 2.0), gaussian(2.0, 4.0), gaussian(0.3, 0.5), blob(2.0, 2.0), blob(4.0, 0.0)] {
            let filter = Prefilter::new(&kernel, 1.0).unwrap();
            let worst = filter.spectrum().iter().map(|&b| filter.gain_at(b).abs()).fold(0.0, f64::max);
            assert!(worst < 1.3 / LEAST, "{kernel}: {worst}");
            // A sharpness is a share of the change.
            let half = Prefilter::new(&kernel, 0.5).unwrap();
            let at = [1.0, 0.5, 2.0];
            assert!((half.gain(at) - f64::midpoint(1.0, filter.gain(at))).abs() < 1e-12);
        }
        let error = Prefilter::new(&gaussian(1.0, 5.0), 1.0).unwrap_err().to_string();
        assert!(error.contains("radius 5") && error.contains("up to 4"), "{error}");
    }
}
