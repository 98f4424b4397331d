//! Pictures: composited values in f32.

mod background;
mod file;

pub use background::Background;

use crate::error::{Error, Result};

/// A picture as composited: premultiplied RGBA in f32, rows from the top.
///
/// Colours are in the transfer function's own (display) space; alpha is 1 - transmittance. Values are not clamped.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    width: u32,
    height: u32,
    pixels: Vec<[f32; 4]>,
}

impl Image {
    /// A picture of the given pixels, row by row from the top.
    ///
    /// # Errors
    /// [`Error::Image`] if their number is not `width * height`.
    pub fn new(width: u32, height: u32, pixels: Vec<[f32; 4]>) -> Result<Self> {
        if pixels.len() as u64 != u64::from(width) * u64::from(height) {
            return Err(Error::Image(format!("{} pixels do not make {width} x {height}", pixels.len())));
        }
        Ok(Self { width, height, pixels })
    }

    /// A transparent picture.
    ///
    /// # Errors
    /// [`Error::Memory`] if there is no memory for it: 16 bytes a pixel.
    pub fn transparent(width: u32, height: u32) -> Result<Self> {
        let count = u64::from(width) * u64::from(height);
        let mut pixels = Vec::new();
        let reserved = usize::try_from(count).ok().and_then(|n| pixels.try_reserve_exact(n).ok().map(|()| n));
        let Some(count) = reserved else {
            let what = format!("a picture of {width} x {height} pixels");
            return Err(Error::Memory { what, bytes: count.saturating_mul(16) });
        };
        pixels.resize(count, [0.0; 4]);
        Ok(Self { width, height, pixels })
    }

    /// Width in pixels.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in pixels.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The pixels, row by row from the top.
    #[must_use]
    pub fn pixels(&self) -> &[[f32; 4]] {
        &self.pixels
    }

    /// The pixels, to be changed.
    pub fn pixels_mut(&mut self) -> &mut [[f32; 4]] {
        &mut self.pixels
    }
}
