//! A volume at halved resolutions, filtered so that sums over the lattice are kept (Burt and Adelson 1983, "The
//! Laplacian pyramid as a compact image code").
//!
//! Each voxel is shared between the two nearest cells along each axis, 3/4 and 1/4: adjoint to linear interpolation.
//! Sum and centre of mass of a level are those of the volume, and all voxels spread by the same variance, which kernels
//! can make up for: [`spread`]. A plain mean of 2^3 voxels moves them by half a cell.

use std::borrow::Cow;
use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::volume::{BRICK_EDGE as EDGE, RowCoding, Volume, with_samples};

/// Cells that a level keeps beyond each face: from the second on they hold nothing but copies of the outermost voxels.
const BORDER: usize = 2;

/// What a cell takes of the four cells around it along an axis.
const FILTER: [f32; 4] = [0.125, 0.375, 0.375, 0.125];

/// By how much the cells of level `level` spread a voxel along each axis: variance in voxels^2.
pub(crate) fn spread(level: u32) -> f64 {
    // 3/4 at 1/2 and 1/4 at 3/2 of a voxel of the level before: 3/4 of its square.
    (4_f64.powi(level as i32) - 1.0) / 4.0
}

/// Cells of 2^n voxels a side that cover a volume. Cell i lies in the middle of voxels 2^n i to 2^n (i + 1) - 1.
#[derive(Debug)]
pub(crate) struct Level {
    /// Cells along each axis, without the border.
    dims: [usize; 3],
    /// Weighted means of voxels, x fastest, with the border.
    values: Vec<f32>,
}

/// The levels of a volume made so far, the finest first: cells of 2 voxels a side, then 4, and so on.
#[derive(Debug, Default)]
pub(crate) struct Pyramid {
    levels: Mutex<Vec<Arc<Level>>>,
}

impl Pyramid {
    /// The first `count` levels of a volume, whose samples `coding` makes f32 numbers.
    pub(crate) fn levels(&self, volume: &Volume, coding: &impl RowCoding, count: usize) -> Result<Vec<Arc<Level>>> {
        let lock = || self.levels.lock().unwrap_or_else(PoisonError::into_inner);
        // Not made under the lock: who makes them waits for a pool of threads, which may hand it work that asks for
        // the lock.
        let mut levels = lock().clone();
        while levels.len() < count {
            levels.push(Arc::new(match levels.last() {
                None => Level::of_volume(volume, coding)?,
                Some(finer) => finer.halved()?,
            }));
        }
        let mut kept = lock();
        if kept.len() < levels.len() {
            kept.clone_from(&levels);
        }
        levels.truncate(count);
        Ok(levels)
    }
}

impl Level {
    fn of_volume(volume: &Volume, coding: &impl RowCoding) -> Result<Self> {
        let dims = volume.grid().dims().map(|d| d as usize);
        let size = dims[0] * dims[1];
        Self::halving(dims, 0, &|plane| {
            let samples = volume.read(plane * size..(plane + 1) * size)?;
            let mut bytes = Vec::with_capacity(4 * size);
            with_samples!(&samples, s => coding.append(s, &mut bytes));
            Ok(Cow::Owned(bytemuck::pod_collect_to_vec(&bytes)))
        })
    }

    fn halved(&self) -> Result<Self> {
        let size = (self.dims[0] + 2 * BORDER) * (self.dims[1] + 2 * BORDER);
        Self::halving(self.dims, BORDER, &|plane| Ok(Cow::Borrowed(&self.values[plane * size..(plane + 1) * size])))
    }

    /// Halves a lattice of `dims` cells with a border so wide around it, given its planes.
    fn halving<'a>(
        dims: [usize; 3],
        border: usize,
        plane: &(dyn Fn(usize) -> Result<Cow<'a, [f32]>> + Sync),
    ) -> Result<Self> {
        let halves = dims.map(|d| d.div_ceil(2));
        let [width, height, depth] = halves.map(|d| d + 2 * BORDER);
        // Along an axis, the four cells of the finer lattice that each cell takes, copies beyond its border.
        let taken = |axis: usize| -> Vec<[usize; 4]> {
            let last = (dims[axis] + 2 * border - 1) as i64;
            let first = |cell: usize| 2 * (cell as i64 - BORDER as i64) - 1 + border as i64;
            (0..halves[axis] + 2 * BORDER)
                .map(|cell| [0, 1, 2, 3].map(|tap| (first(cell) + tap).clamp(0, last) as usize))
                .collect()
        };
        let [across, down, deep] = [taken(0), taken(1), taken(2)];
        let count = width * height * depth;
        let mut values = Vec::new();
        if values.try_reserve_exact(count).is_err() {
            let what = "a volume at half its resolution".to_owned();
            return Err(Error::Memory { what, bytes: 4 * count as u64 });
        }
        values.resize(count, 0.0_f32);
        let stride = dims[0] + 2 * border;
        values.par_chunks_mut(width * height).zip(deep).try_for_each(|(sum, deep)| {
            for (plane_at, of_plane) in deep.into_iter().zip(FILTER) {
                let plane = plane(plane_at)?;
                let narrow: Vec<f32> = (plane.chunks_exact(stride))
                    .flat_map(|row| across.iter().map(|taps| (0..4).map(|t| FILTER[t] * row[taps[t]]).sum::<f32>()))
                    .collect();
                for (sum, taps) in sum.chunks_exact_mut(width).zip(&down) {
                    for (tap, of_row) in taps.iter().zip(FILTER) {
                        let share = of_plane * of_row;
                        sum.iter_mut().zip(&narrow[tap * width..]).for_each(|(sum, value)| *sum += share * value);
                    }
                }
            }
            Ok::<_, Error>(())
        })?;
        Ok(Self { dims: halves, values })
    }

    /// The values of the cells around `first`, with `halo` cells around 32^3 of them. Beyond the border they repeat.
    pub(crate) fn brick(&self, first: [i64; 3], halo: usize) -> Vec<f32> {
        let [width, height, _] = self.dims.map(|d| d + 2 * BORDER);
        let edge = EDGE + 2 * halo;
        let [across, down, deep] = [0, 1, 2].map(|axis| -> Vec<usize> {
            let last = (self.dims[axis] + 2 * BORDER - 1) as i64;
            let start = first[axis] - halo as i64 + BORDER as i64;
            (0..edge as i64).map(|cell| (start + cell).clamp(0, last) as usize).collect()
        });
        let mut values = Vec::with_capacity(edge * edge * edge);
        for z in deep {
            for &y in &down {
                let row = &self.values[width * (y + height * z)..][..width];
                values.extend(across.iter().map(|&x| row[x]));
            }
        }
        values
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Samples as they are.
    struct Plain;

    impl RowCoding for Plain {
        fn append<T: crate::volume::Number>(&self, samples: &[T], bytes: &mut Vec<u8>) {
            bytes.extend(samples.iter().flat_map(|s| (s.to_f64() as f32).to_ne_bytes()));
        }
    }

    /// Sum and first and second moments along x, in voxels, of the cells of a level, or of the volume as level 0.
    fn moments(dims: [usize; 3], level: u32, value: impl Fn([usize; 3]) -> f32) -> [f64; 3] {
        let size = f64::from(1 << level);
        let mut sums = [0.0; 3];
        for z in 0..dims[2] {
            for y in 0..dims[1] {
                for x in 0..dims[0] {
                    let mass = f64::from(value([x, y, z])) * size.powi(3);
                    let place = (x as f64 + 0.5) * size - 0.5;
                    (0..).zip(&mut sums).for_each(|(power, sum)| *sum += mass * place.powi(power));
                }
            }
        }
        sums
    }

    #[test]
    fn levels_keep_sums_and_centres_and_spread_all_voxels_alike() {
        // Away from the faces, beyond which copies would add up.
        let dims = [41, 37, 50];
        let inside = |p: [usize; 3]| (0..3).all(|a| p[a] >= 12 && p[a] + 12 < dims[a]);
        let value = |p: [usize; 3]| if inside(p) { ((p[0] * 7 + p[1] * 5 + p[2] * 3) % 11) as f32 } else { 0.0 };
        let points = (0..dims.iter().product()).map(|i| [i % dims[0], i / dims[0] % dims[1], i / (dims[0] * dims[1])]);
        let samples: Vec<f32> = points.map(value).collect();
        let volume = Volume::from_slice(dims.map(|d| d as u32), [1.0; 3], &samples).unwrap();
        let of = |[sum, first, second]: [f64; 3]| (sum, first / sum, second / sum - (first / sum).powi(2));
        let (sum, mean, variance) = of(moments(dims, 0, value));
        for (level, cells) in (1..).zip(Pyramid::default().levels(&volume, &Plain, 3).unwrap()) {
            let [width, height, _] = cells.dims.map(|d| d + 2 * BORDER);
            let at = |p: [usize; 3]| cells.values[p[0] + BORDER + width * (p[1] + BORDER + height * (p[2] + BORDER))];
            let got = of(moments(cells.dims, level, at));
            assert!((got.0 / sum - 1.0).abs() < 1e-5, "{level}: {got:?} {sum}");
            assert!((got.1 - mean).abs() < 1e-4, "{level}: {got:?} {mean}");
            assert!((got.2 - variance - spread(level)).abs() < 1e-3, "{level}: {got:?} {variance}");
        }
    }

    #[test]
    fn beyond_the_faces_levels_hold_copies_of_the_outermost_voxels() {
        // Odd, and changing up to the faces.
        let samples: Vec<f32> = (0..7 * 5 * 3).map(|i| (i % 7) as f32).collect();
        let volume = Volume::from_slice([7, 5, 3], [1.0; 3], &samples).unwrap();
        for cells in Pyramid::default().levels(&volume, &Plain, 4).unwrap() {
            let edge = EDGE + 2;
            let brick = cells.brick([-16; 3], 1);
            for (i, value) in brick.iter().enumerate() {
                let x = (i % edge) as i64 - 17;
                if x <= -2 {
                    assert_eq!(*value, 0.0);
                }
                if x > cells.dims[0] as i64 {
                    assert!((value - 6.0).abs() < 1e-5, "{value}");
                }
            }
        }
    }
}
