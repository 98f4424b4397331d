//! Which labels show.

use glam::DVec3;
use rayon::prelude::*;

use super::{Look, Mask, look_of};
use crate::clip::{Clip, is_inside};
use crate::error::Result;
use crate::volume::{ToF64, Volume, with_samples};

/// Of each look, whether one of its voxels shows: it is not clear, and the middle of the voxel is neither masked nor
/// cut away.
pub(super) fn labels(volume: &Volume, looks: &[Look], mask: Option<&Mask>, clip: &Clip) -> Result<Vec<bool>> {
    let is_clear = |look: &Look| look.opacity <= 0.0;
    if mask.is_none() && clip.is_empty() {
        return Ok(looks.iter().map(|look| !is_clear(look)).collect());
    }
    let [nx, ny, nz] = volume.grid().dims().map(|d| d as usize);
    let middle = DVec3::new(nx as f64, ny as f64, nz as f64) / 2.0 - 0.5;
    let sides = clip.sides(volume.grid());
    let slice = |z: usize| -> Result<Vec<bool>> {
        let range = z * nx * ny..(z + 1) * nx * ny;
        let values = values(volume, range.clone())?;
        let masked = mask.map(|mask| self::values(&mask.volume, range)).transpose()?;
        let is_shown = |i: usize| match (&masked, mask) {
            (Some(values), Some(mask)) => mask.shown.binary_search(&(values[i] as i64)).is_ok(),
            _ => true,
        };
        let mut found = vec![false; looks.len()];
        let mut last: Option<(f64, usize)> = None;
        for (i, &value) in values.iter().enumerate() {
            let at = match last {
                Some((of, at)) if of == value => at,
                _ => look_of(looks, value)
                    .map_or(looks.len(), |look| looks.partition_point(|other| other.label < look.label)),
            };
            last = Some((value, at));
            if found.get(at) == Some(&false) && !is_clear(&looks[at]) && is_shown(i) {
                let place = DVec3::new((i % nx) as f64, (i / nx) as f64, z as f64) - middle;
                found[at] = is_inside(&sides, place);
            }
        }
        Ok(found)
    };
    let either = |a: Vec<bool>, b: Vec<bool>| Ok(a.into_iter().zip(b).map(|(a, b)| a || b).collect());
    (0..nz).into_par_iter().map(slice).try_reduce(|| vec![false; looks.len()], either)
}

fn values(volume: &Volume, range: std::ops::Range<usize>) -> Result<Vec<f64>> {
    fn of<T: ToF64>(samples: &[T], (slope, intercept): (f64, f64)) -> Vec<f64> {
        samples.iter().map(|sample| slope * sample.to_f64() + intercept).collect()
    }
    let samples = volume.read(range)?;
    Ok(with_samples!(&samples, s => of(s, volume.rescale())))
}
