//! Which bricks a picture can show, and in which pixels.

use std::ops::Range;

use glam::DVec3;

use super::frustum::sides;
use super::plan::Plan;
use crate::clip::Side;
use crate::gpu::layout::Area;
use crate::gpu::store::{BrickSplats, Store};
use crate::image::Region;

impl Plan<'_> {
    /// The splats of a store whose bricks reach into a region, as runs of consecutive ones.
    pub(crate) fn in_view(&self, store: &Store, region: Region) -> Vec<Range<u32>> {
        let sides = self.sides(region);
        let mut runs: Vec<Range<u32>> = Vec::new();
        for (_, next) in store.runs().filter(|(brick, _)| self.reaches(brick, &sides)) {
            match runs.last_mut() {
                Some(run) if run.end == next.start => run.end = next.end,
                _ => runs.push(next),
            }
        }
        runs
    }

    /// For each batch of sheets, the pixels of a region that splats of it can touch: what lies outside is empty.
    pub(crate) fn covered(&self, stores: &[Store], region: Region, sheets_per_batch: u32) -> Vec<Area> {
        let extent = [region.width, region.height];
        let whole = Area { low: [0, 0], high: extent };
        let batches = self.sheets.div_ceil(sheets_per_batch) as usize;
        if self.axis.is_some() || !self.view.savings.pixels {
            return vec![whole; batches];
        }
        let sides = self.sides(region);
        let (scale, origin) = self.view.camera.pixels();
        let first_pixel = [region.x, region.y].map(f64::from);
        let mut areas = vec![Area::default(); batches];
        for store in stores {
            for (brick, _) in store.runs().filter(|(brick, _)| self.reaches(brick, &sides)) {
                let center = self.center(brick);
                let reach = |axis: usize| self.half_range(brick, self.view.gradients[axis]);
                let z = self.view.gradients[2].dot(center);
                let sheet = |z: f64| (z - self.sheet_origin) / self.sheet_step / f64::from(sheets_per_batch);
                // A float to integer cast saturates. One more on either side absorbs rounding.
                let first = (sheet(z - reach(2)) - 1e-3).floor() as usize;
                let last = (sheet(z + reach(2)) + 1e-3).floor() as usize;
                let (near, far) = (z - reach(2) + self.view.eye_depth, z + reach(2) + self.view.eye_depth);
                let mut area = whole;
                if !self.view.is_perspective() || near > 1e-3 * far {
                    for axis in 0..2 {
                        let middle = self.view.gradients[axis].dot(center) + self.view.offset[axis];
                        let ends = [middle - reach(axis), middle + reach(axis)];
                        let planes =
                            ends.map(|end| if self.view.is_perspective() { [end / near, end / far] } else { [end; 2] });
                        let pixels =
                            planes.as_flattened().iter().map(|p| (p - origin[axis]) / scale[axis] - first_pixel[axis]);
                        let (low, high) =
                            pixels.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
                        area.low[axis] = (low - 2.0).floor().clamp(0.0, f64::from(extent[axis])) as u32;
                        area.high[axis] = (high + 2.0).ceil().clamp(0.0, f64::from(extent[axis])) as u32;
                    }
                }
                for reached in areas.iter_mut().take(last.saturating_add(1)).skip(first) {
                    *reached = reached.joined(area);
                }
            }
        }
        areas
    }

    /// About how many pixels quads cover in a region, over all batches of sheets.
    pub(crate) fn fragments(&self, stores: &[Store], region: Region, sheets_per_batch: u32) -> f64 {
        let sides = self.sides(region);
        let (scale, _) = self.view.camera.pixels();
        let extent = [region.width, region.height].map(f64::from);
        let batches = f64::from(self.sheets.div_ceil(sheets_per_batch));
        let bricks = stores.iter().flat_map(Store::runs).filter(|(brick, _)| self.reaches(brick, &sides));
        bricks
            .map(|(brick, run)| {
                let z = self.view.gradients[2].dot(self.center(brick));
                let radius = self.view.radius * self.view.growth.at(z + self.view.eye_depth);
                let depth = if self.view.is_perspective() { z + self.view.eye_depth } else { 1.0 };
                let along = radius * self.view.gradients[2].length();
                let across = |axis: usize| {
                    // What the plane of the eye cuts may be anywhere.
                    let bounded = !self.view.is_perspective() || depth > along;
                    let pixels = 2.0 * radius * self.view.gradients[axis].length() / (scale[axis].abs() * depth) + 1.0;
                    if bounded { pixels.min(extent[axis]) } else { extent[axis] }
                };
                let passes = (2.0 * along / self.sheet_step / f64::from(sheets_per_batch) + 1.0).min(batches);
                run.len() as f64 * across(0) * across(1) * passes
            })
            .sum()
    }

    /// The planes that bound what a region shows.
    fn sides(&self, region: Region) -> Vec<Side> {
        if !self.view.savings.view {
            return Vec::new();
        }
        let mut sides = sides(self.view, region);
        // Scalars beyond a cut, within kernels and sheets, take part in what is classified before it.
        let beyond = f64::from(self.padding);
        sides.extend(self.view.clip.iter().map(|(gradient, value)| (*gradient, value + beyond)));
        sides
    }

    /// Whether the kernels of a brick's splats reach over all planes.
    fn reaches(&self, brick: &BrickSplats, sides: &[Side]) -> bool {
        let center = self.center(brick);
        sides.iter().all(|(gradient, value)| gradient.dot(center) + value + self.half_range(brick, *gradient) >= 0.0)
    }

    /// The middle of the box around a brick's splats, from that of the lattice.
    fn center(&self, brick: &BrickSplats) -> DVec3 {
        let [low, high] = brick.bounds.map(|point| DVec3::from_array(point.map(f64::from)));
        let lattice = DVec3::from_array(self.view.grid.dims().map(f64::from)) + f64::from(2 * self.padding);
        (low + high - lattice) / 2.0
    }

    /// Half the range of the linear function `gradient . x` over the kernels of a brick's splats.
    fn half_range(&self, brick: &BrickSplats, gradient: DVec3) -> f64 {
        let [low, high] = brick.bounds.map(|point| DVec3::from_array(point.map(f64::from)));
        gradient.abs().dot((high - low - 1.0) / 2.0) + self.view.max_radius() * gradient.length()
    }
}
