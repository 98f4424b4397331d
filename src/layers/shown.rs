//! The labels that are visible.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::{LabelLook, Mask};
use crate::camera::clip::{Clip, is_inside};
use crate::error::Result;
use crate::volume::Volume;

/// Returns for each look whether one of its voxels is visible: it is not clear, and the middle of the voxel is neither
/// masked nor clipped.
pub(super) fn labels(volume: &Volume, looks: &[LabelLook], mask: Option<&Mask>, clip: &Clip) -> Result<Vec<bool>> {
    if mask.is_none() && clip.is_empty() {
        return Ok(looks.iter().map(|look| look.opacity > 0.0).collect());
    }
    let [nx, ny, nz] = volume.grid().dims().map(|d| d as usize);
    let middle = DVec3::new(nx as f64, ny as f64, nz as f64) / 2.0 - 0.5;
    let sides = clip.sides(volume.grid());
    let slice = |z: usize| -> Result<Vec<bool>> {
        let range = z * nx * ny..(z + 1) * nx * ny;
        let label = labels_of(volume, range.clone())?;
        let masked = mask.map(|mask| labels_of(&mask.volume, range).map(|of| (of, &mask.shown))).transpose()?;
        let is_masked = |i: usize| masked.as_ref().is_some_and(|(of, shown)| shown.binary_search(&of(i)).is_err());
        let mut found = vec![false; looks.len()];
        // Labels come in runs: each is looked up once.
        let mut last = None;
        for i in 0..nx * ny {
            let label = label(i);
            let at = match last {
                Some((same, at)) if same == label => at,
                _ => looks.binary_search_by_key(&label, |look| look.label).ok(),
            };
            last = Some((label, at));
            let Some(at) = at.filter(|&at| !found[at] && looks[at].opacity > 0.0 && !is_masked(i)) else { continue };
            let place = DVec3::new((i % nx) as f64, (i / nx) as f64, z as f64) - middle;
            found[at] = is_inside(&sides, place);
        }
        Ok(found)
    };
    let either = |a: Vec<bool>, b: Vec<bool>| Ok(a.into_iter().zip(b).map(|(a, b)| a || b).collect());
    (0..nz).into_par_iter().map(slice).try_reduce(|| vec![false; looks.len()], either)
}

/// Reads a range of samples as labels.
fn labels_of(volume: &Volume, range: Range<usize>) -> Result<impl Fn(usize) -> i64> {
    let (samples, (slope, intercept)) = (volume.read(range)?, volume.rescale());
    Ok(move |i| (slope * samples.raw(i) + intercept) as i64)
}
