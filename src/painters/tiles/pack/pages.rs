//! pages: the parts of a box that have splats, for boxes that are nearly empty. The texture has the texels of these
//! pages only, and a table says where each page of the box is in it. Brick pools of volume renderers are the same
//! (Crassin et al. 2009, "GigaVoxels"). See shaders/common/pages.wgsl.

use super::{Packable, Packing, TextureLayout};
use crate::error::Result;
use crate::gpu::context::Context;
use crate::gpu::layout::{PageTable, PagedBrick};
use crate::gpu::pipeline::Binding::{Read, Uniform, Write};
use crate::gpu::recorder::Recorder;
use crate::gpu::shaders;
use crate::gpu::stage::{Stage, for_each};
use crate::painters::tiles::axis::unordered;
use crate::splats::brick::{BrickSplats, PAGE};
use crate::volume::BRICK_EDGE as EDGE;

/// The least factor by which pages take less memory than their box.
const SAVES: u64 = 4;
/// The number of pages along an edge of a brick.
const PER_BRICK: u32 = EDGE as u32 / PAGE;

/// Returns the number of a brick's pages with splats.
fn count(brick: &BrickSplats) -> u64 {
    brick.pages.iter().map(|word| u64::from(word.count_ones())).sum()
}

/// Returns the number of pages with visible voxels; `None` for scalars, which are everywhere.
pub(in crate::painters::tiles) fn occupied(source: &Packable) -> Option<u64> {
    source.scalars().is_none().then(|| source.bricks().map(count).sum())
}

/// Returns the numbers of pages along each axis of a texture of `occupied` pages, and one more without splats.
pub(super) fn atlas(occupied: u64) -> [u32; 3] {
    let pages = occupied + 1;
    let across = libm::cbrt(pages as f64).ceil().max(1.0) as u64;
    let down = (pages.div_ceil(across) as f64).sqrt().ceil().max(1.0) as u64;
    [across, down, pages.div_ceil(across * down)].map(|n| u32::try_from(n).unwrap_or(u32::MAX))
}

/// Returns whether `pages` bytes of pages are worth their look-ups in place of `whole_box` bytes.
pub(super) fn are_worth_it(context: &Context, pages: u64, whole_box: u64) -> bool {
    whole_box >= context.savings.paged_bytes && SAVES.saturating_mul(pages) <= whole_box
}

impl Packing {
    /// Returns the numbers of pages along x, y and z of the table. The last one of each axis is empty: it stands for
    /// places behind the box.
    pub(super) fn table_dims(&self) -> [u32; 3] {
        unordered(self.axes, self.dims.map(|n| n / PAGE + 1))
    }

    /// Returns the steps along x, y and z in the table.
    pub(in crate::painters::tiles) fn table_steps(&self) -> [u32; 3] {
        let [nx, ny, _] = self.table_dims();
        [1, nx, nx * ny]
    }

    /// Returns the bytes of the table of pages; 0 for other layouts.
    pub(super) fn table_bytes(&self) -> u64 {
        let words: u64 = self.table_dims().map(u64::from).into_iter().product();
        if self.layout == TextureLayout::Pages { 4 * words } else { 0 }
    }

    /// Makes the table of the places in the texture of the pages of the box.
    pub(super) fn page_table(
        &self,
        recorder: &mut Recorder<'_>,
        stage: &Stage,
        source: &Packable,
    ) -> Result<wgpu::Buffer> {
        let context = recorder.context;
        let dims = self.table_dims();
        let [across, down, _] = self.atlas;
        let parameters = PageTable { dims, across, steps: self.table_steps(), down };
        // Place 0 is that of pages without splats.
        let mut next = 1;
        let paged = |brick: &BrickSplats| {
            let first = next;
            next += count(brick) as u32;
            let low = [0, 1, 2].map(|axis| (brick.origin[axis] / PAGE).wrapping_sub(self.low[axis] / PAGE));
            PagedBrick { low, first, pages: brick.pages }
        };
        let bricks: Vec<PagedBrick> = source.bricks().map(paged).collect();
        let table = context.buffer("pack.pages", self.table_bytes(), wgpu::BufferUsages::STORAGE)?;
        let parameters =
            context.upload("pages.parameters", bytemuck::bytes_of(&parameters), wgpu::BufferUsages::UNIFORM)?;
        let on_device = context.upload("pages.bricks", bytemuck::cast_slice(&bricks), wgpu::BufferUsages::STORAGE)?;
        let resources = [&parameters, &on_device, &table].map(wgpu::Buffer::as_entire_binding);
        stage.run(recorder, &resources, for_each(context, u64::from(PER_BRICK.pow(3)) * bricks.len() as u64));
        Ok(table)
    }
}

/// Returns the stage that makes tables of pages.
pub(super) fn stage(context: &Context) -> Stage {
    Stage::new(context, shaders::PAGE_TABLE, ("pack", "places_of_pages"), &[Uniform, Read, Write], &[])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_atlas_has_room_for_its_pages_and_hardly_more() {
        // Pages of 64 scalars, as many as the largest packed volume has.
        for pages in [0, 1, 7, 8, 26, 27, 1000, 123_456, super::super::MAX_BYTES / 256] {
            let all: u64 = atlas(pages).map(u64::from).into_iter().product();
            assert!(all > pages && all as f64 <= 1.4 * pages as f64 + 8.0, "{pages}: {:?}", atlas(pages));
            // A word of the table has 10 bits for a place along an axis.
            assert!(atlas(pages).iter().all(|&n| n <= 1 << 10));
        }
    }
}
