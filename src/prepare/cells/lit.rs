//! Voxels in shadows, from their splats, which hold colour, density, normal and the light that arrives.

use std::ops::Range;

use crate::gpu::splat::SplatLight;
use crate::prepare::shadows::Places;
use crate::splats::classification::Emission;
use crate::volume::BRICK_EDGE as EDGE;

/// The splats of voxels, and the light on them.
pub(crate) struct LitSplats<'a> {
    pub(crate) places: Places<'a>,
    pub(crate) light: &'a SplatLight,
}

impl LitSplats<'_> {
    /// The lit voxels of a row between two columns, and some more. Returns a range outside which all are transparent;
    /// if it is empty, `voxels` are left as they are.
    pub(super) fn row(&self, place: [usize; 2], columns: &Range<usize>, voxels: &mut [Emission]) -> Range<usize> {
        let mut shown: Option<Range<usize>> = None;
        let bricks = columns.start / EDGE..columns.end.div_ceil(EDGE);
        let number = place[0] % EDGE + EDGE * (place[1] % EDGE);
        for (first, brick, _) in self.places.bricks_of_row(bricks, place) {
            let shown = shown.get_or_insert_with(|| {
                voxels.fill([0.0; 4]);
                first..first
            });
            shown.end = (first + EDGE).min(voxels.len());
            let [y, z] = place.map(|place| place as u32);
            for (run, count) in brick.runs(number, u32::MAX, [first as u32, y, z]) {
                let ([red, green, blue], densities) = run.appearances(Some(self.light));
                for at in 0..count {
                    let density = densities[at];
                    voxels[run.xs[at] as usize] = [red[at] * density, green[at] * density, blue[at] * density, density];
                }
            }
        }
        shown.unwrap_or_default()
    }
}
