//! The bricks that a picture may show, and the pixels that they reach.

use std::ops::Range;

use glam::DVec3;

use super::frustum::sides;
use super::plan::Plan;
use crate::camera::clip::Side;
use crate::gpu::layout::Area;
use crate::gpu::store::Store;
use crate::image::Region;
use crate::splats::brick::BrickSplats;

impl Plan<'_> {
    /// Returns the splats of a store whose bricks reach into a region, as runs of consecutive splats.
    pub(crate) fn in_view(&self, store: &Store, region: Region) -> Vec<Range<u32>> {
        let mut runs: Vec<Range<u32>> = Vec::new();
        for (_, next) in self.bricks_in_view(std::slice::from_ref(store), region) {
            match runs.last_mut() {
                Some(run) if run.end == next.start => run.end = next.end,
                _ => runs.push(next),
            }
        }
        runs
    }

    /// Returns the pixels of a region that the splats of each batch of sheets can touch; all other pixels stay empty.
    pub(crate) fn covered(&self, stores: &[Store], region: Region, sheets_per_batch: u32) -> Vec<Area> {
        let extent = [region.width, region.height];
        let whole = Area { low: [0, 0], high: extent };
        let batches = self.sheets.div_ceil(sheets_per_batch) as usize;
        if self.axis.is_some() || !self.view.savings.pixels {
            return vec![whole; batches];
        }
        let view = self.view;
        let (scale, origin) = view.camera.pixels();
        let first_pixel = [region.x, region.y].map(f64::from);
        let mut areas = vec![Area::default(); batches];
        for (brick, _) in self.bricks_in_view(stores, region) {
            let center = self.center(brick);
            let reach = |axis: usize| self.half_range(brick, view.gradients[axis]);
            let z = view.gradients[2].dot(center);
            let ends = [z - reach(2), z + reach(2)];
            let sheet = |z: f64| (z - self.sheet_origin) / self.sheet_step / f64::from(sheets_per_batch);
            // A float to integer cast saturates. One more on either side absorbs rounding.
            let first = (sheet(ends[0]) - 1e-3).floor() as usize;
            let last = (sheet(ends[1]) + 1e-3).floor() as usize;
            let [near, far] = ends.map(|end| end + view.eye_depth);
            let mut area = whole;
            if !view.is_perspective() || near > 1e-3 * far {
                for axis in 0..2 {
                    let middle = view.gradients[axis].dot(center) + view.offset[axis];
                    let ends = [middle - reach(axis), middle + reach(axis)];
                    let depths = if view.is_perspective() { [near, far] } else { [1.0; 2] };
                    let planes = ends.into_iter().flat_map(|end| depths.map(|depth| end / depth));
                    let pixels = planes.map(|p| (p - origin[axis]) / scale[axis] - first_pixel[axis]);
                    let (low, high) = pixels.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
                    area.low[axis] = (low - 2.0).floor().clamp(0.0, f64::from(extent[axis])) as u32;
                    area.high[axis] = (high + 2.0).ceil().clamp(0.0, f64::from(extent[axis])) as u32;
                }
            }
            for reached in areas.iter_mut().take(last.saturating_add(1)).skip(first) {
                *reached = reached.joined(area);
            }
        }
        areas
    }

    /// Estimates the number of pixels that quads cover in a region, over all batches of sheets.
    pub(crate) fn fragments(&self, stores: &[Store], region: Region, sheets_per_batch: u32) -> f64 {
        let view = self.view;
        let (scale, _) = view.camera.pixels();
        let extent = [region.width, region.height].map(f64::from);
        let batches = f64::from(self.sheets.div_ceil(sheets_per_batch));
        let fragments = self.bricks_in_view(stores, region).map(|(brick, run)| {
            let z = view.gradients[2].dot(self.center(brick)) + view.eye_depth;
            let radius = view.radius * view.growth.at(z);
            let depth = if view.is_perspective() { z } else { 1.0 };
            let along = radius * view.gradients[2].length();
            let across = |axis: usize| {
                // A splat that the plane of the eye cuts may be anywhere.
                let bounded = !view.is_perspective() || depth > along;
                let pixels = 2.0 * radius * view.gradients[axis].length() / (scale[axis].abs() * depth) + 1.0;
                if bounded { pixels.min(extent[axis]) } else { extent[axis] }
            };
            let passes = (2.0 * along / self.sheet_step / f64::from(sheets_per_batch) + 1.0).min(batches);
            run.len() as f64 * across(0) * across(1) * passes
        });
        fragments.sum()
    }

    /// Returns the bricks whose kernels reach into a region, with the numbers of their splats in their store.
    fn bricks_in_view<'s>(
        &self,
        stores: &'s [Store],
        region: Region,
    ) -> impl Iterator<Item = (&'s BrickSplats, Range<u32>)> {
        let sides = self.sides(region);
        stores.iter().flat_map(Store::runs).filter(move |(brick, _)| {
            let center = self.center(brick);
            let reaches =
                |(gradient, value): &Side| gradient.dot(center) + value + self.half_range(brick, *gradient) >= 0.0;
            sides.iter().all(reaches)
        })
    }

    /// Returns the planes that bound the space that a region shows.
    fn sides(&self, region: Region) -> Vec<Side> {
        if !self.view.savings.view {
            return Vec::new();
        }
        let mut sides = sides(self.view, region);
        // Scalars beyond a cut, within kernels and sheets, take part in the classification before it.
        let beyond = f64::from(self.padding);
        sides.extend(self.view.clip.iter().map(|(gradient, value)| (*gradient, value + beyond)));
        sides
    }

    /// Returns the middle of the box around a brick's splats, from the middle of the lattice.
    fn center(&self, brick: &BrickSplats) -> DVec3 {
        let [low, high] = brick.bounds.map(|point| DVec3::from_array(point.map(f64::from)));
        let lattice = DVec3::from_array(self.view.grid.dims().map(f64::from)) + f64::from(2 * self.padding);
        (low + high - lattice) / 2.0 + self.view.first()
    }

    /// Returns half the range of the linear function `gradient . x` over the kernels of a brick's splats.
    fn half_range(&self, brick: &BrickSplats, gradient: DVec3) -> f64 {
        let [low, high] = brick.bounds.map(|point| DVec3::from_array(point.map(f64::from)));
        gradient.abs().dot((high - low - 1.0) / 2.0) + self.view.max_radius() * gradient.length()
    }
}
