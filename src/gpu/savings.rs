//! Work that is left out because it is invisible.

/// Switches of the work that is left out. Leaving it out changes no picture: tests turn each switch off and compare
/// bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Savings {
    /// Skips bricks whose range of values is invisible.
    pub(crate) bricks: bool,
    /// Makes no splats of invisible voxels: transparent ones; of scalars, voxels out of reach of anything visible.
    pub(crate) voxels: bool,
    /// Neither sorts nor draws splats of bricks out of view.
    pub(crate) view: bool,
    /// Composites and shades sheets only in pixels that bricks reach.
    pub(crate) pixels: bool,
    /// Finds the normals of voxels that become cells only once.
    pub(crate) normals: bool,
    /// The least bytes of a nearly empty box of which GPUs hold only the pages that have splats, and of the samples of
    /// a nearly empty volume of which they hold only the bricks that may show. Smaller boxes are held whole, because
    /// rays look up every pair of voxels in pages; of smaller volumes, from the second transfer function on, all
    /// samples.
    pub(crate) paged_bytes: u64,
}

impl Default for Savings {
    fn default() -> Self {
        Self { bricks: true, voxels: true, view: true, pixels: true, normals: true, paged_bytes: 128 << 20 }
    }
}
