//! Coarser volumes: the mean of each block of voxels.

use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use super::{Grid, Samples, ToF64, Volume, with_samples};
use crate::error::Result;
use crate::memory::reserved;

impl Volume {
    /// Returns the volume with the mean of each block of voxels in the place of the block, in f32. `factors` are the
    /// numbers of voxels of a block along x, y and z, at least 1; blocks at the far sides may have fewer. NaN and
    /// infinite samples do not count; a block without other samples is NaN. Of samples in a file a few planes are in
    /// memory at a time.
    ///
    /// # Errors
    /// [`Error::Read`](crate::Error::Read) and [`Error::Memory`](crate::Error::Memory).
    pub fn reduced(&self, factors: [u32; 3]) -> Result<Self> {
        let factors = factors.map(|factor| factor.max(1));
        let own = self.grid.dims();
        let dims: [u32; 3] = std::array::from_fn(|axis| own[axis].div_ceil(factors[axis]));
        let [nx, ny, nz] = own.map(|d| d as usize);
        let [fx, fy, fz] = factors.map(|factor| factor as usize);
        let (wide, plane) = (dims[0] as usize, dims[0] as usize * dims[1] as usize);
        let (slope, intercept) = self.rescale();
        let mut means: Vec<f32> = reserved(plane as u64 * u64::from(dims[2]), || "a coarser volume".to_owned())?;
        means.resize(plane * dims[2] as usize, f32::NAN);
        means.par_chunks_mut(plane).enumerate().try_for_each(|(block, out)| {
            let mut sums = vec![(0.0, 0_u32); plane];
            for z in block * fz..((block + 1) * fz).min(nz) {
                let samples = self.read(nx * ny * z..nx * ny * (z + 1))?;
                with_samples!(&samples, samples => {
                    for (y, row) in samples.chunks_exact(nx).enumerate() {
                        let sums = &mut sums[y / fy * wide..][..wide];
                        for (values, (sum, count)) in row.chunks(fx).zip(sums) {
                            for value in values.iter().map(|value| value.to_f64()).filter(|value| value.is_finite()) {
                                *sum += value;
                                *count += 1;
                            }
                        }
                    }
                });
            }
            let mean = |(sum, count): &(f64, u32)| (slope * (sum / f64::from(*count)) + intercept) as f32;
            out.iter_mut().zip(&sums).for_each(|(out, sums)| *out = mean(sums));
            Ok::<_, crate::Error>(())
        })?;
        // The first block's middle is the first point.
        let shift = DVec3::from_array(factors.map(|factor| f64::from(factor - 1) / 2.0));
        let scale = DAffine3::from_scale(DVec3::from_array(factors.map(f64::from)));
        let grid = Grid::new(dims, self.grid.to_world() * DAffine3::from_translation(shift) * scale)?;
        let mut reduced = Self::new(grid, Samples::F32(means))?;
        (reduced.oriented, reduced.units) = (self.oriented, self.units.clone());
        reduced.contents = self.contents.clone();
        Ok(reduced)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_have_their_means_and_places() {
        let samples: Vec<f32> = (0..30).map(|i| if i == 5 || i == 9 { f32::NAN } else { i as f32 }).collect();
        let volume = Volume::from_slice([5, 3, 2], [1.0, 2.0, 4.0], &samples).unwrap().with_rescale(2.0, 1.0).unwrap();
        let reduced = volume.reduced([2, 3, 1]).unwrap();
        assert_eq!((reduced.grid().dims(), reduced.grid().spacing()), ([3, 1, 2], [2.0, 6.0, 4.0]));
        // The middle of the first block: of the places 0 and 1 along x, and 0 to 4 along y.
        assert_eq!(reduced.grid().to_world().translation, DVec3::new(0.5, 2.0, 0.0));
        let values: Vec<f64> = (0..6).map(|i| reduced.in_memory().unwrap().value(i)).collect();
        let mean = |all: &[f64]| 2.0 * all.iter().sum::<f64>() / all.len() as f64 + 1.0;
        let first = mean(&[0.0, 1.0, 6.0, 10.0, 11.0]);
        let last = mean(&[19.0, 24.0, 29.0]);
        assert!((values[0] - first).abs() < 1e-5 && (values[5] - last).abs() < 1e-5, "{values:?}");
        // Gaps do not count; the third column of the first plane has 4 and 14.
        assert!((values[2] - mean(&[4.0, 14.0])).abs() < 1e-5);
        assert_eq!(volume.reduced([1; 3]).unwrap().in_memory().unwrap().value(7), 15.0);
    }
}
