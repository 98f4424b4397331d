//! What is left out because it cannot show.

/// Switches of what is left out. Leaving out changes no picture: tests turn each switch off and compare bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Savings {
    /// Bricks whose range of values shows nothing are not looked at.
    pub(crate) bricks: bool,
    /// Voxels that cannot show get no splat: transparent ones; of scalars, those out of reach of anything visible.
    pub(crate) voxels: bool,
    /// Splats of bricks out of view are neither sorted nor drawn.
    pub(crate) view: bool,
    /// Sheets are composited and shaded only in the pixels that bricks reach.
    pub(crate) pixels: bool,
}

impl Default for Savings {
    fn default() -> Self {
        Self { bricks: true, voxels: true, view: true, pixels: true }
    }
}
