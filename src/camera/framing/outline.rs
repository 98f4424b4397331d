//! The outermost voxels of a volume with values in given ranges.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use voxsplat_volume::volume::{ToF64, Volume, with_samples};

use crate::camera::clip::Side;
use crate::error::Result;

/// The smallest number of inspected rows and planes of a volume: a frame needs places to within a hundredth.
const ROWS: usize = 128;

/// Columns and rows of voxels in a plane of a volume.
type Places = Vec<[i64; 2]>;

/// Returns the steps between the rows along y and the planes along z that [`outline`] inspects: 128 to 256 of each.
pub(super) fn outline_steps(volume: &Volume) -> [usize; 2] {
    let [_, height, depth] = volume.grid().dims().map(|d| d as usize);
    [height, depth].map(|d| (d / ROWS).max(1))
}

/// Returns lattice points with the same convex hull as all voxels with values in `ranges`, which ascend and are apart:
/// the corners of the hull of each plane of voxels along z. Inspects only some rows and planes of large volumes. Voxels
/// on the outer side of any of `sides` do not count.
pub(super) fn outline(volume: &Volume, ranges: &[[f64; 2]], sides: &[Side]) -> Result<Vec<DVec3>> {
    let [width, height, depth] = volume.grid().dims().map(|d| d as usize);
    let plane = width * height;
    let (slope, intercept) = volume.rescale();
    let shows = |raw: f64| {
        let value = slope * raw + intercept;
        let range = ranges.get(ranges.partition_point(|range| range[1] < value));
        // Nothing is at values that are not finite.
        value.is_finite() && range.is_some_and(|range| range[0] <= value)
    };
    let [rows, planes] = outline_steps(volume);
    let planes: Vec<usize> = every(planes, depth).collect();
    let middle = DVec3::from_array(volume.grid().dims().map(|d| f64::from(d - 1))) / 2.0;
    let places = planes.par_iter().map(|&z| {
        let range = z * plane..(z + 1) * plane;
        let columns = |y: usize| columns(sides, DVec3::new(0.0, y as f64, z as f64) - middle, width);
        match volume.held() {
            Some(samples) => Ok(with_samples!(samples, s => hull(&s[range], [width, rows], &columns, &shows))),
            None => {
                let read = volume.read(range)?;
                Ok(with_samples!(&read, s => hull(s, [width, rows], &columns, &shows)))
            }
        }
    });
    let places: Vec<Places> = places.collect::<Result<_>>()?;
    let point = |z: usize| move |[x, y]: [i64; 2]| DVec3::new(x as f64, y as f64, z as f64);
    Ok(planes.into_iter().zip(places).flat_map(|(z, places)| places.into_iter().map(point(z))).collect())
}

/// Returns every n-th number below a count, and the last.
fn every(n: usize, count: usize) -> impl Iterator<Item = usize> {
    let last = count - 1;
    (0..last).step_by(n).chain([last])
}

/// Returns the voxels of a row on the inner side of all `sides`. `first` is the place of the first voxel, from the
/// middle of the lattice.
fn columns(sides: &[Side], first: DVec3, width: usize) -> Range<usize> {
    let (mut low, mut high) = (0.0_f64, width as f64 - 1.0);
    for (gradient, value) in sides {
        let at = gradient.dot(first) + value;
        if gradient.x > 0.0 {
            low = low.max(-at / gradient.x);
        } else if gradient.x < 0.0 {
            high = high.min(-at / gradient.x);
        } else if at < 0.0 {
            return 0..0;
        }
    }
    // A float to integer cast saturates.
    low.ceil() as usize..((high.floor() + 1.0) as usize).max(low.ceil() as usize)
}

/// Returns the corners of the convex hull of the visible samples of a plane, in every n-th row and in its columns.
fn hull<T: ToF64>(
    samples: &[T],
    [width, rows]: [usize; 2],
    columns: &impl Fn(usize) -> Range<usize>,
    shows: &(impl Fn(f64) -> bool + Sync),
) -> Places {
    let (mut left, mut right) = (Places::new(), Places::new());
    for y in every(rows, samples.len() / width) {
        let columns = columns(y);
        let start = columns.start;
        let row = samples[y * width..(y + 1) * width].get(columns).unwrap_or_default();
        let shows = |v: &T| shows(v.to_f64());
        if let (Some(first), Some(last)) = (row.iter().position(shows), row.iter().rposition(shows)) {
            push(&mut left, [(start + first) as i64, y as i64], 1);
            push(&mut right, [(start + last) as i64, y as i64], -1);
        }
    }
    left.append(&mut right);
    left
}

/// Adds a place below the places of a convex chain: `sense` is 1 for a left side, -1 for a right side.
fn push(chain: &mut Places, place: [i64; 2], sense: i64) {
    while let [.., a, b] = chain[..] {
        let cross = (b[0] - a[0]) * (place[1] - a[1]) - (b[1] - a[1]) * (place[0] - a[0]);
        // Place b lies within.
        if cross * sense < 0 {
            break;
        }
        chain.pop();
    }
    chain.push(place);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_outline_has_the_hull_of_what_shows() {
        // Scattered voxels: every one of them lies in the hull of the outline, in each of many directions.
        let mut state = 1_u32;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state >> 24
        };
        let samples: Vec<u8> = (0..13 * 11 * 7).map(|_| if next() < 30 { 200 } else { 10 }).collect();
        let volume = Volume::from_slice([13, 11, 7], [1.0; 3], &samples).unwrap();
        let volume = volume.with_rescale(-2.0, 3.0).unwrap();
        let found = outline(&volume, &[[-1e3, -300.0], [0.0, 1.0]], &[]).unwrap();
        let all: Vec<DVec3> = (0..samples.len())
            .filter(|&i| samples[i] == 200)
            .map(|i| DVec3::new((i % 13) as f64, (i / 13 % 11) as f64, (i / 143) as f64))
            .collect();
        assert!(found.len() < all.len() && found.iter().all(|p| all.contains(p)));
        for i in 0..500 {
            let t = f64::from(i);
            let direction = DVec3::new(t.cos(), (1.7 * t).sin(), (0.3 * t).sin());
            let farthest = |points: &[DVec3]| points.iter().map(|p| p.dot(direction)).fold(f64::MIN, f64::max);
            assert_eq!(farthest(&found), farthest(&all), "{direction}");
        }
        assert!(outline(&volume, &[], &[]).unwrap().is_empty());
    }

    #[test]
    fn of_a_large_volume_some_rows_tell() {
        let shows = |y: usize, z: usize| (101..=397).contains(&y) && (50..=298).contains(&z);
        let samples: Vec<u8> = (0..300 * 400 * 2).map(|i| if shows(i / 2 % 400, i / 800) { 1 } else { 0 }).collect();
        let volume = Volume::from_slice([2, 400, 300], [1.0; 3], &samples).unwrap();
        assert_eq!(outline_steps(&volume), [3, 2]);
        let found = outline(&volume, &[[1.0, 1.0]], &[]).unwrap();
        let least = found.iter().copied().reduce(DVec3::min).unwrap();
        let most = found.iter().copied().reduce(DVec3::max).unwrap();
        assert_eq!((least, most), (DVec3::new(0.0, 102.0, 50.0), DVec3::new(1.0, 396.0, 298.0)));
    }
}
