//! pages: the parts of a box that have splats, for boxes that are nearly empty. The texture has the texels of these
//! pages only, and a table says where each page of the box is in it. Brick pools of volume renderers are the same
//! (Crassin et al. 2009, "GigaVoxels"). See shaders/common/pages.wgsl.

use super::Packing;
use crate::gpu::context::Context;
use crate::gpu::store::{BrickSplats, PAGE, Store};
use crate::painters::tiles::axis::unordered;
use crate::volume::BRICK_EDGE as EDGE;

/// The least factor by which pages take less memory than their box.
const SAVES: u64 = 4;
/// Bits of a place along an axis in a word of the table; as in shaders/common/pages.wgsl.
const BITS: u32 = 10;
/// Pages along an edge of a brick.
const PER_BRICK: u32 = EDGE as u32 / PAGE;

/// The number of pages with splats; `None`: some splats are those of a coarser level.
pub(in crate::painters::tiles) fn occupied(stores: &[Store]) -> Option<u64> {
    let of = |brick: &BrickSplats| (brick.level == 0).then(|| u64::from(brick.pages.count_ones()));
    stores.iter().flat_map(|store| &store.bricks).map(of).sum()
}

/// Pages along each axis of a texture that holds so many, and one more without splats.
pub(super) fn atlas(occupied: u64) -> [u32; 3] {
    let pages = occupied + 1;
    let across = (pages as f64).cbrt().ceil().max(1.0) as u64;
    let down = (pages.div_ceil(across) as f64).sqrt().ceil().max(1.0) as u64;
    [across, down, pages.div_ceil(across * down)].map(|n| u32::try_from(n).unwrap_or(u32::MAX))
}

/// Whether pages of so many bytes are worth their look-ups in place of a box.
pub(super) fn are_worth_it(context: &Context, pages: u64, whole_box: u64) -> bool {
    whole_box >= context.savings.paged_bytes && SAVES.saturating_mul(pages) <= whole_box
}

impl Packing {
    /// Pages along x, y and z of the table. The last one of each axis is empty: it stands for places behind the box.
    pub(super) fn table_dims(&self) -> [u32; 3] {
        unordered(self.axes, self.dims.map(|n| n / PAGE + 1))
    }

    /// The steps along x, y and z in the table.
    pub(in crate::painters::tiles) fn table_steps(&self) -> [u32; 3] {
        let [nx, ny, _] = self.table_dims();
        [1, nx, nx * ny]
    }

    /// For each page of the box as it is stored, x fastest, its place in the texture: [`BITS`] along each axis. Pages
    /// without splats share place 0, where all is 0.
    pub(super) fn page_table(&self, stores: &[Store]) -> Vec<u32> {
        let [nx, ny, nz] = self.table_dims();
        let [across, down, _] = self.atlas;
        let mut table = vec![0; (nx * ny * nz) as usize];
        let mut used = 0;
        for brick in stores.iter().flat_map(|store| &store.bricks) {
            for bit in (0..u64::BITS).filter(|bit| brick.pages >> bit & 1 == 1) {
                let in_brick = [bit % PER_BRICK, bit / PER_BRICK % PER_BRICK, bit / (PER_BRICK * PER_BRICK)];
                let page = [0, 1, 2].map(|axis| brick.origin[axis] / PAGE + in_brick[axis]);
                let [x, y, z] = [0, 1, 2].map(|axis| page[axis].wrapping_sub(self.low[axis] / PAGE));
                if x < nx && y < ny && z < nz {
                    used += 1;
                    let place = [used % across, used / across % down, used / (across * down)];
                    table[(x + nx * (y + ny * z)) as usize] = place[0] | place[1] << BITS | place[2] << (2 * BITS);
                }
            }
        }
        table
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_atlas_has_room_for_its_pages_and_hardly_more() {
        for pages in [0, 1, 7, 8, 26, 27, 1000, 123_456] {
            let all: u64 = atlas(pages).map(u64::from).into_iter().product();
            assert!(all > pages && all as f64 <= 1.4 * pages as f64 + 8.0, "{pages}: {:?}", atlas(pages));
            assert!(atlas(pages).iter().all(|&n| n < 1 << BITS));
        }
    }
}
