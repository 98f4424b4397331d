//! Values between the samples of a volume, for a lattice in another place.

use std::borrow::Cow;
use std::ops::Range;

use glam::{DAffine3, DMat3, DVec3};
use rayon::prelude::*;

use crate::error::Result;
use crate::volume::Volume;
use voxsplat_volume::memory::reserved;

/// The pole of the filter that makes a cubic B-spline pass through samples (Unser 1999): sqrt(3) - 2.
const POLE: f64 = -0.267_949_192_431_122_7;
/// The number of samples beyond which the pole's power is under 1e-9.
const HORIZON: usize = 16;
/// The largest number of places along an axis whose values are averaged for a voxel that is coarser than the samples.
const MOST_PLACES: f64 = 16.0;
/// The difference in voxels below which points of two lattices are the same.
const SHARED: f64 = 1e-6;
/// The number of lines along y or z that are filtered together: they share cache lines.
const LINES: usize = 64;

/// Returns the value of a volume at each place of a lattice of `to` points, which `map` maps to the volume's lattice;
/// `absent` outside, and in place of NaN and infinite samples.
///
/// Lattices that share their points share their values. Otherwise a cubic spline through the samples is evaluated; a
/// voxel that spans several samples gets the mean of places spread evenly over it.
pub(crate) fn values(volume: &Volume, map: &DAffine3, to: [u32; 3], absent: f32) -> Result<Vec<f32>> {
    let (volume, low) = &reached(volume, map, to)?;
    let map = &(DAffine3::from_translation(-*low) * *map);
    let dims = volume.grid().dims().map(|d| d as usize);
    let [nx, ny, nz] = to.map(|d| d as usize);
    let what = || "a volume on the lattice of another one".to_owned();
    let mut placed: Vec<f32> = reserved(nx as u64 * ny as u64 * nz as u64, what)?;
    placed.resize(nx * ny * nz, absent);
    let (slope, intercept) = volume.rescale();
    let stored = volume.shared_samples()?;
    let mut samples: Vec<f32> = reserved(stored.len() as u64, what)?;
    (0..stored.len())
        .into_par_iter()
        .map(|i| (slope * stored.raw(i) + intercept) as f32)
        // A spline spreads a gap over the volume.
        .map(|value| if value.is_finite() { value } else { absent })
        .collect_into_vec(&mut samples);
    let is_shared = map.matrix3.abs_diff_eq(DMat3::IDENTITY, SHARED / nx.max(ny).max(nz) as f64)
        && map.translation.abs_diff_eq(map.translation.round(), SHARED);
    let field = SplineSamples::new(samples, dims, is_shared);
    let places = if is_shared { vec![DVec3::ZERO] } else { places(&map.matrix3) };
    let [fx, fy, fz] = dims.map(|d| d as f64);
    let end = DVec3::new(fx, fy, fz) - 0.5;
    // Rows of parallel lattices cross samples along one axis alone.
    let [along, across, up] = map.matrix3.x_axis.abs().to_array();
    let is_parallel = !is_shared && places.len() == 1 && across.max(up) * nx as f64 <= SHARED * along;
    placed.par_chunks_mut(nx).enumerate().for_each(|(row, out)| {
        let [y, z] = [row % ny, row / ny].map(|at| at as f64);
        let start = map.transform_point3(DVec3::new(0.0, y, z));
        let is_near = |axis: usize| (-0.5 - SHARED..end[axis] + SHARED).contains(&start[axis]);
        if is_parallel && is_near(1) && is_near(2) {
            let line = field.line(start);
            for (x, out) in out.iter_mut().enumerate() {
                let place = start.x + map.matrix3.x_axis.x * x as f64;
                if (-0.5 - SHARED..end.x + SHARED).contains(&place) {
                    let (steps, weights) = taps(place, dims[0]);
                    *out = steps.iter().zip(weights).map(|(i, weight)| weight * line[*i]).sum::<f64>() as f32;
                }
            }
            return;
        }
        for (x, out) in out.iter_mut().enumerate() {
            let place = start + map.matrix3.x_axis * x as f64;
            let is_inside = place.cmpge(DVec3::splat(-0.5 - SHARED)).all() && place.cmplt(end + SHARED).all();
            if is_inside {
                let sum: f64 = places.iter().map(|offset| field.at(place + *offset)).sum();
                *out = (sum / places.len() as f64) as f32;
            }
        }
    });
    Ok(placed)
}

/// Returns the part of a volume on which the values at the places of a lattice depend, and its first voxel. Of a plane
/// through a volume it is thin.
fn reached<'a>(volume: &'a Volume, map: &DAffine3, to: [u32; 3]) -> Result<(Cow<'a, Volume>, DVec3)> {
    let dims = volume.grid().dims();
    let last = DVec3::from_array(to.map(f64::from)) - 1.0;
    let corner = |c: usize| {
        let side = |axis: usize| if c >> axis & 1 == 1 { last[axis] + 0.5 } else { -0.5 };
        map.transform_point3(DVec3::from_array(std::array::from_fn(side)))
    };
    let corners: [DVec3; 8] = std::array::from_fn(corner);
    let (low, high) = corners.iter().fold((corners[0], corners[0]), |(low, high), c| (low.min(*c), high.max(*c)));
    let reach = HORIZON as f64 + 2.0;
    // Casts saturate; a lattice beside the volume keeps a voxel of it.
    let ranges: [Range<u32>; 3] = std::array::from_fn(|axis| {
        let start = ((low[axis] - reach).floor() as u32).min(dims[axis] - 1);
        start..((high[axis] + reach).ceil() as u32).clamp(start + 1, dims[axis])
    });
    let first = DVec3::from_array([0, 1, 2].map(|axis| f64::from(ranges[axis].start)));
    let is_whole = (0..3).all(|axis| ranges[axis] == (0..dims[axis]));
    Ok((if is_whole { Cow::Borrowed(volume) } else { Cow::Owned(volume.part(ranges)?) }, first))
}

/// Returns the offsets from a voxel, in samples, of the places whose values are averaged: one unless the voxel spans
/// more than one sample along an axis.
fn places(matrix: &DMat3) -> Vec<DVec3> {
    let axes = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    let counts = axes.map(|axis| (axis.abs().max_element() - SHARED).ceil().clamp(1.0, MOST_PLACES));
    let offsets = |axis: usize| {
        let count = counts[axis];
        (0..count as usize).map(move |i| axes[axis] * ((i as f64 + 0.5) / count - 0.5))
    };
    let plane = || offsets(0).flat_map(|x| offsets(1).map(move |y| x + y));
    plane().flat_map(|xy| offsets(2).map(move |z| xy + z)).collect()
}

/// Samples, or the coefficients of the spline through them.
struct SplineSamples {
    numbers: Vec<f32>,
    dims: [usize; 3],
    /// Whether `numbers` are samples, because the lattices share their points.
    is_shared: bool,
}

impl SplineSamples {
    fn new(mut numbers: Vec<f32>, dims: [usize; 3], is_shared: bool) -> Self {
        if !is_shared {
            prefilter(&mut numbers, dims);
        }
        Self { numbers, dims, is_shared }
    }

    /// Returns the place in memory of the sample nearest to a place.
    fn nearest(&self, place: DVec3) -> usize {
        let [i, j, k] = [0, 1, 2].map(|axis| (place[axis] + 0.5).clamp(0.0, self.dims[axis] as f64 - 1.0) as usize);
        i + self.dims[0] * (j + self.dims[1] * k)
    }

    /// Returns the coefficients along x at the y and z of a place.
    fn line(&self, place: DVec3) -> Vec<f64> {
        let [nx, ny, _] = self.dims;
        let [(ys, wy), (zs, wz)] = [1, 2].map(|axis| taps(place[axis], self.dims[axis]));
        let mut line = vec![0.0; nx];
        for (z, wz) in zs.into_iter().zip(wz) {
            for (y, wy) in ys.into_iter().zip(wy) {
                let row = &self.numbers[nx * (y + ny * z)..][..nx];
                line.iter_mut().zip(row).for_each(|(sum, number)| *sum += wy * wz * f64::from(*number));
            }
        }
        line
    }

    /// Returns the value at a place, whose coordinates are held within half a sample of the lattice.
    fn at(&self, place: DVec3) -> f64 {
        if self.is_shared {
            return f64::from(self.numbers[self.nearest(place + SHARED)]);
        }
        let [nx, ny, _] = self.dims;
        let [(xs, wx), (ys, wy), (zs, wz)] = [0, 1, 2].map(|axis| taps(place[axis], self.dims[axis]));
        let mut sum = 0.0;
        for (z, wz) in zs.into_iter().zip(wz) {
            for (y, wy) in ys.into_iter().zip(wy) {
                let row = nx * (y + ny * z);
                let along: f64 = xs.iter().zip(wx).map(|(x, w)| w * f64::from(self.numbers[row + x])).sum();
                sum += wy * wz * along;
            }
        }
        sum
    }
}

/// Returns the four coefficients around a place along an axis, mirrored at its ends, and their weights: the cubic
/// B-spline.
fn taps(place: f64, count: usize) -> ([usize; 4], [f64; 4]) {
    let last = count as i64 - 1;
    let place = place.clamp(-0.5, last as f64 + 0.5);
    let (whole, t) = (place.floor(), place - place.floor());
    let index = |step: i64| {
        let at = (whole as i64 + step).abs();
        (if at > last { 2 * last - at } else { at }).clamp(0, last) as usize
    };
    let [t2, t3, s] = [t * t, t * t * t, 1.0 - t];
    let weights = [s * s * s, 4.0 - 6.0 * t2 + 3.0 * t3, 1.0 + 3.0 * (t + t2 - t3), t3].map(|w| w / 6.0);
    ([-1, 0, 1, 2].map(index), weights)
}

/// Turns samples into the coefficients of the cubic spline through them, along x, y and z.
fn prefilter(numbers: &mut [f32], [nx, ny, nz]: [usize; 3]) {
    numbers.par_chunks_mut(nx).for_each(|line| {
        let mut wide: Vec<f64> = line.iter().map(|n| f64::from(*n)).collect();
        filter(&mut wide, 1);
        line.iter_mut().zip(wide).for_each(|(n, w)| *n = w as f32);
    });
    numbers.par_chunks_mut(nx * ny).for_each(|slice| across(slice, nx));
    // A line along z crosses all slices: groups of lines are gathered, filtered and put back.
    let plane = nx * ny;
    for start in (0..plane).step_by(LINES * 256) {
        let groups: Vec<usize> = (start..plane.min(start + LINES * 256)).step_by(LINES).collect();
        let filtered: Vec<(usize, usize, Vec<f64>)> = groups
            .into_par_iter()
            .map(|first| {
                let wide = LINES.min(plane - first);
                let rows = (0..nz).flat_map(|z| &numbers[z * plane + first..][..wide]);
                let mut lines: Vec<f64> = rows.map(|n| f64::from(*n)).collect();
                filter(&mut lines, wide);
                (first, wide, lines)
            })
            .collect();
        for (first, wide, lines) in filtered {
            for (z, row) in lines.chunks(wide).enumerate() {
                numbers[z * plane + first..][..wide].iter_mut().zip(row).for_each(|(n, w)| *n = *w as f32);
            }
        }
    }
}

/// Filters a slice along its rows.
fn across(slice: &mut [f32], nx: usize) {
    let mut wide: Vec<f64> = slice.iter().map(|n| f64::from(*n)).collect();
    filter(&mut wide, nx);
    slice.iter_mut().zip(wide).for_each(|(n, w)| *n = w as f32);
}

/// Filters lines side by side: each row of `wide` numbers has a number of each line. The recursion of Unser (1999),
/// mirrored at the ends.
fn filter(rows: &mut [f64], wide: usize) {
    let count = rows.len() / wide;
    if count < 2 {
        return;
    }
    let mirrored = |step: usize| {
        let at = step % (2 * count - 2);
        at.min(2 * count - 2 - at)
    };
    let gain = (1.0 - POLE) * (1.0 - 1.0 / POLE);
    rows.iter_mut().for_each(|number| *number *= gain);
    for line in 0..wide {
        let first: f64 = (0..HORIZON).map(|step| POLE.powi(step as i32) * rows[mirrored(step) * wide + line]).sum();
        rows[line] = first;
    }
    for at in wide..rows.len() {
        rows[at] += POLE * rows[at - wide];
    }
    let end = (count - 1) * wide;
    for line in end..rows.len() {
        rows[line] = POLE / (POLE * POLE - 1.0) * (rows[line] + POLE * rows[line - wide]);
    }
    for at in (0..end).rev() {
        rows[at] = POLE * (rows[at + wide] - rows[at]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(dims: [u32; 3], value: impl Fn(DVec3) -> f64) -> Volume {
        let [nx, ny, nz] = dims;
        let places = (0..nx * ny * nz).map(|i| DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / nx / ny) as f64));
        let samples: Vec<f32> = places.map(|place| value(place) as f32).collect();
        Volume::from_slice(dims, [1.0; 3], &samples).unwrap()
    }

    #[test]
    fn splines_pass_through_samples() {
        let noise = |p: DVec3| ((p.x * 12.9898 + p.y * 78.233 + p.z * 37.719).sin() * 43758.5453).fract();
        for dims in [[9, 7, 5], [1, 6, 2], [3, 1, 1], [1; 3], [70, 3, 2]] {
            let volume = of(dims, noise);
            // Off by a hundred thousandth of a voxel: not the same points.
            let map = DAffine3::from_translation(DVec3::splat(1e-5));
            let placed = values(&volume, &map, dims, f32::NAN).unwrap();
            let samples = volume.in_memory().unwrap();
            let off = placed.iter().enumerate().map(|(i, v)| (f64::from(*v) - samples.value(i)).abs());
            assert!(off.clone().all(|off| off < 1e-4), "{dims:?}: {}", off.fold(0.0, f64::max));
            // The same points have the same bits.
            let shifted = DAffine3::from_translation(DVec3::new(-1.0, 0.0, 0.0));
            let placed = values(&volume, &shifted, [dims[0] + 1, dims[1], dims[2]], -7.0).unwrap();
            for (i, value) in placed.iter().enumerate() {
                let x = i % (dims[0] as usize + 1);
                let expected = if x == 0 { -7.0 } else { samples.value(i - 1 - i / (dims[0] as usize + 1)) };
                assert_eq!(f64::from(*value), expected, "{dims:?} {i}");
            }
        }
    }

    /// A blob with the width of a statistical map smoothed by 8 mm, sampled at 3 mm, at places 1 mm apart. A cubic
    /// spline errs by up to the fourth derivative times 35/1152 h^4 or so in one dimension; here 0.027 of the peak.
    #[test]
    fn blobs_of_eight_millimetres_err_by_under_three_per_cent() {
        let sigma = 8.0 / 2.3548 / 3.0;
        let blob = |p: DVec3| (-(p - DVec3::new(11.8, 11.4, 12.2)).length_squared() / (2.0 * sigma * sigma)).exp();
        let volume = of([24; 3], blob);
        for turn in [0.0, 0.3] {
            let map = DAffine3::from_translation(DVec3::splat(5.0)) * DAffine3::from_rotation_z(turn);
            let map = map * DAffine3::from_scale(DVec3::splat(1.0 / 3.0));
            let placed = values(&volume, &map, [40; 3], 0.0).unwrap();
            let worst = placed.iter().enumerate().map(|(i, value)| {
                let at = DVec3::new((i % 40) as f64, (i / 40 % 40) as f64, (i / 1600) as f64);
                (f64::from(*value) - blob(map.transform_point3(at))).abs()
            });
            let worst = worst.fold(0.0, f64::max);
            assert!(worst > 0.005 && worst < 0.03, "{turn}: {worst}");
        }
    }

    #[test]
    fn coarser_voxels_get_means_and_voxels_outside_are_absent() {
        // Stripes that single places would see as all bright or all dark.
        let volume = of([16, 4, 4], |p| f64::from(p.x as u32 % 2));
        let map =
            DAffine3::from_translation(DVec3::new(0.5, 0.0, 0.0)) * DAffine3::from_scale(DVec3::new(2.0, 1.0, 1.0));
        let placed = values(&volume, &map, [8, 4, 4], 9.0).unwrap();
        for (i, value) in placed.iter().enumerate().filter(|(i, _)| (1..7).contains(&(i % 8))) {
            assert!((value - 0.5).abs() < 0.05, "{i}: {value}");
        }
        // Half a voxel beyond the last sample ends the lattice.
        let flat = of([4; 3], |_| 2.0);
        let placed = values(&flat, &DAffine3::from_translation(DVec3::splat(0.2)), [6, 4, 4], 9.0).unwrap();
        assert!(placed[..4].iter().all(|value| (value - 2.0).abs() < 1e-5) && placed[4..6] == [9.0; 2], "{placed:?}");
    }
}
