//! The gradient that noise makes: the floor under which there is no surface, told by the data.

use rayon::prelude::*;

use super::TransferFunction;
use crate::error::Result;
use crate::reconstruction::noise_of_gradients;
use crate::settings::Settings;
use crate::volume::{ToF64, Volume, with_samples};

/// Voxels between those that are compared along an axis. Central differences compare such voxels too: what noise of
/// neighbours has in common counts in neither.
const STRIDE: usize = 2;
/// The most planes that are looked at.
const PLANES: usize = 32;
/// The least share of what shows that must lie among what shows, and the least number of voxels, for a median to be
/// that of noise and not of surfaces.
const LEAST_SHARE: f64 = 0.1;
const LEAST_COUNT: usize = 500;
/// The median of the absolute value of a normal distribution, in standard deviations.
const MEDIAN: f64 = 0.674_489_750_196_081_7;

impl TransferFunction {
    /// The floor over noise, in root mean squares of the gradient that noise makes.
    pub const FLOOR_OVER_NOISE: f64 = 2.0;

    /// A floor under gradients for [`Self::with_gradient_floor`], value per world unit:
    /// [`Self::FLOOR_OVER_NOISE`] times the root mean square of the gradient that the noise of a volume makes in what
    /// shows, as light finds it by some settings. `None` if hardly anything shows but surfaces and thin things, or
    /// there is no noise.
    ///
    /// The standard deviation of the noise is told by second differences along all three axes, one after the other
    /// (in 3-D what Immerkaer 1996, "Fast noise variance estimation", takes in 2-D), of voxels 2 apart: their noise is
    /// sqrt(6)^3 times that of the samples, and parabolas along any axis count nothing. The median of their absolute
    /// values, over 0.6745, leaves out what surfaces add. Only voxels with all 27 compared ones among what shows count.
    /// Noise that neighbours have in common up to 2 voxels apart errs little, as central differences compare voxels 2
    /// apart too. Reads up to 96 planes of the volume.
    ///
    /// # Errors
    /// [`Error::Read`](crate::error::Error::Read) and [`Error::Memory`](crate::error::Error::Memory) if samples left
    /// in a file cannot be read; [`Error::Setting`](crate::error::Error::Setting) if the settings cannot be had.
    pub fn floor_over_noise(&self, volume: &Volume, settings: &Settings) -> Result<Option<f64>> {
        let Some(deviation) = self.noise(volume)? else { return Ok(None) };
        // Central differences have half the variance of the samples; the outermost voxels are left aside.
        let gradients = volume.grid().to_lattice().matrix3.transpose();
        let along =
            |axis: usize| if volume.grid().dims()[axis] > 1 { gradients.col(axis).length_squared() } else { 0.0 };
        let gradient = deviation * ((0..3).map(along).sum::<f64>() / 2.0).sqrt() * noise_of_gradients(settings)?;
        let floor = gradient * Self::FLOOR_OVER_NOISE;
        Ok((floor.is_finite() && floor > 0.0).then_some(floor))
    }

    /// The standard deviation of the noise of what shows.
    fn noise(&self, volume: &Volume) -> Result<Option<f64>> {
        let dims = volume.grid().dims().map(|n| n as usize);
        let [nx, ny, _] = dims;
        let (slope, intercept) = volume.rescale();
        let visible = self.values_over(f64::MIN_POSITIVE);
        // Along an axis with too few voxels nothing is compared.
        let wide = dims.map(|n| n > 2 * STRIDE);
        let taps = |axis: usize| match wide[axis] {
            true => &[(0, 1.0), (STRIDE, -2.0), (2 * STRIDE, 1.0)][..],
            false => &[(0, 1.0)],
        };
        let middle = |axis: usize| if wide[axis] { STRIDE } else { 0 };
        let inner = |axis: usize| if wide[axis] { dims[axis] - 2 * STRIDE } else { dims[axis] };
        let of_plane = |z: usize| -> Result<(Vec<f32>, usize)> {
            let mut sums = vec![0.0; nx * ny];
            let mut among = vec![true; nx * ny];
            let mut shown = 0;
            for &(step, weight) in taps(2) {
                let start = (z + step) * nx * ny;
                let samples = volume.read(start..start + nx * ny)?;
                let mut shows = vec![false; nx * ny];
                with_samples!(&samples, s => for ((sum, shows), sample) in sums.iter_mut().zip(&mut shows).zip(s) {
                    let value = slope * sample.to_f64() + intercept;
                    *shows = visible.iter().any(|&[low, high]| (low..=high).contains(&value));
                    *sum += weight * value;
                });
                if step == middle(2) {
                    shown = shows.iter().filter(|shows| **shows).count();
                }
                among.iter_mut().zip(shows).for_each(|(among, shows)| *among &= shows);
            }
            let mut found = Vec::new();
            for (x, y) in (0..inner(1)).flat_map(|y| (0..inner(0)).map(move |x| (x, y))) {
                let compared = || {
                    let rows = taps(1).iter().map(|&(step, weight)| ((y + step) * nx + x, weight));
                    rows.flat_map(|(row, of_row)| taps(0).iter().map(move |&(step, w)| (row + step, w * of_row)))
                };
                if compared().all(|(at, _)| among[at]) {
                    found.push(compared().map(|(at, weight)| weight * sums[at]).sum::<f64>().abs() as f32);
                }
            }
            Ok((found, shown))
        };
        let planes: Vec<usize> = (0..inner(2)).step_by(inner(2).div_ceil(PLANES)).collect();
        let found = planes.into_par_iter().map(of_plane).collect::<Result<Vec<_>>>()?;
        let shown: usize = found.iter().map(|(_, shown)| shown).sum();
        let mut differences: Vec<f32> = found.into_iter().flat_map(|(found, _)| found).collect();
        let axes = wide.into_iter().filter(|wide| *wide).count();
        if axes == 0 || differences.len() < LEAST_COUNT || (differences.len() as f64) < LEAST_SHARE * shown as f64 {
            return Ok(None);
        }
        let half = differences.len() / 2;
        let (_, &mut median, _) = differences.select_nth_unstable_by(half, f32::total_cmp);
        Ok(Some(f64::from(median) / MEDIAN / 6_f64.sqrt().powi(axes as i32)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::Kernel;
    use crate::settings::Shading;
    use crate::transfer::ControlPoint;

    /// Normally distributed numbers (Box and Muller 1958).
    fn normal(count: usize) -> Vec<f64> {
        let mut state = 1_u64;
        let mut uniform = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
        };
        (0..count).map(|_| (-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos()).collect()
    }

    fn over(value: f64) -> TransferFunction {
        let point = |value, opacity| ControlPoint { value, color: [1.0; 3], opacity };
        TransferFunction::new(vec![point(value, 0.0), point(value + 10.0, 0.5)], None).unwrap()
    }

    const N: usize = 40;

    /// Noise of a standard deviation on a field.
    fn noisy(deviation: f64, field: impl Fn([f64; 3]) -> f64) -> Volume {
        let at = |i: usize| [i % N, i / N % N, i / N / N].map(|c| c as f64 - (N as f64 - 1.0) / 2.0);
        let samples: Vec<f32> =
            normal(N * N * N).iter().enumerate().map(|(i, noise)| (field(at(i)) + deviation * noise) as f32).collect();
        Volume::from_slice([N as u32; 3], [0.5, 0.8, 2.0], &samples).unwrap()
    }

    /// A ball of 100 with an edge about 2 voxels wide.
    fn ball([x, y, z]: [f64; 3]) -> f64 {
        100.0 / (1.0 + ((x * x + y * y + z * z).sqrt() - 14.0).exp())
    }

    #[test]
    fn the_deviation_of_noise_is_told_through_ramps_and_beside_surfaces() {
        for deviation in [0.5, 5.0, 20.0] {
            for (field, least) in [
                (&(|_| 500.0) as &dyn Fn([f64; 3]) -> f64, 0.0),
                (&|[x, y, z]| 900.0 + 7.0 * x - 3.0 * y + 0.2 * z * z, 0.0),
                (&ball, 30.0),
            ] {
                let found = over(least).noise(&noisy(deviation, field)).unwrap().unwrap();
                assert!((found / deviation - 1.0).abs() < 0.1, "{deviation}: {found}");
            }
        }
    }

    /// The length of gradients of noise is what central differences of it have; reconstructed they have less.
    #[test]
    fn the_floor_is_that_of_the_gradients_that_light_is_made_of() {
        let volume = noisy(5.0, |_| 500.0);
        let floor = |settings: &Settings| over(0.0).floor_over_noise(&volume, settings).unwrap().unwrap();
        let expected = 2.0 * 5.0 * ((4.0 + 1.0 / 0.64 + 0.25) / 2.0_f64).sqrt();
        let pre = floor(&Settings::default());
        assert!((pre / expected - 1.0).abs() < 0.05, "{pre} for {expected}");
        let post = |kernel| floor(&Settings { shading: Shading::Post, kernel, ..Settings::default() }) / pre;
        let shares = [Kernel::default(), Kernel::KAISER_BESSEL].map(post);
        assert!(shares[0] < 0.25 && shares[1] > 1.4 * shares[0] && shares[1] < 0.5, "{shares:?}");
    }

    #[test]
    fn what_is_all_surface_or_without_noise_has_no_floor() {
        let settings = Settings::default();
        let shell = |p: [f64; 3]| 100.0 - 60.0 * (p.iter().map(|c| c * c).sum::<f64>().sqrt() - 14.0).abs();
        assert_eq!(over(30.0).floor_over_noise(&noisy(1.0, shell), &settings).unwrap(), None);
        assert_eq!(over(0.0).floor_over_noise(&noisy(0.0, |_| 500.0), &settings).unwrap(), None);
        assert_eq!(over(1e6).floor_over_noise(&noisy(5.0, |_| 500.0), &settings).unwrap(), None);
        // Without noise the edge of a ball is hardly any.
        let clean = over(30.0).floor_over_noise(&noisy(0.0, ball), &settings).unwrap();
        assert!(clean.is_none_or(|floor| floor < 1.0), "{clean:?}");
    }

    #[test]
    fn a_picture_of_one_slice_has_noise_too() {
        let samples: Vec<f32> = normal(80 * 60).iter().map(|n| (500.0 + 5.0 * n) as f32).collect();
        let volume = Volume::from_slice([80, 60, 1], [1.0; 3], &samples).unwrap();
        let floor = over(0.0).floor_over_noise(&volume, &Settings::default()).unwrap().unwrap();
        assert!((floor / (2.0 * 5.0) - 1.0).abs() < 0.1, "{floor}");
    }
}
