//! Pictures: composited values in f32, their files and their 8-bit pixels.

pub mod figure;
#[cfg(feature = "film")]
pub mod film;

mod background;
mod compare;
mod depth;
mod file;
mod region;
mod section;

pub use background::Background;
pub use compare::{Comparison, compare, difference_picture};
pub(crate) use compare::{covered_differences, percentile};
pub use depth::DepthMap;
pub(crate) use depth::check_scale;
#[doc(hidden)]
pub use file::Note;
#[cfg(feature = "film")]
pub(crate) use file::png_encoder;
pub(crate) use file::{check_exr, exr_with_notes};
pub use region::Region;
pub use section::{Ground, SectionPlane, section};

pub use crate::output::{abandon_unfinished, check_writable, write_file};

use rayon::prelude::*;

use crate::error::{Error, Result};
use voxsplat_volume::memory::zeroed;

/// A picture as composited: premultiplied RGBA in f32, rows from the top, pixels of a row from the left.
///
/// Colours are in display space, as in the transfer function. Alpha is 1 - transmittance. Values are not clamped.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    width: u32,
    height: u32,
    pixels: Vec<[f32; 4]>,
}

impl Image {
    /// Makes a picture of premultiplied pixels, row by row from the top.
    ///
    /// # Errors
    /// [`Error::Image`] if there are not `width * height` pixels.
    pub fn new(width: u32, height: u32, pixels: Vec<[f32; 4]>) -> Result<Self> {
        if pixels.len() as u64 != u64::from(width) * u64::from(height) {
            return Err(Error::Image(format!("{} pixels do not make {width} x {height}", pixels.len())));
        }
        Ok(Self { width, height, pixels })
    }

    /// Makes a picture of transparent pixels.
    ///
    /// # Errors
    /// [`Error::Memory`] if there is no memory for the picture: 16 bytes a pixel.
    pub fn transparent(width: u32, height: u32) -> Result<Self> {
        let count = u64::from(width) * u64::from(height);
        let pixels = zeroed(count, || format!("a picture of {width} x {height} pixels"))?;
        Ok(Self { width, height, pixels })
    }

    /// Returns the picture as 8-bit RGBA, 4 bytes a pixel, rows from the top, each from the left: `4 * width * height`
    /// bytes.
    ///
    /// Over a colour, every alpha is 255. Over [`Background::Transparent`], alpha is straight: colours are divided by
    /// it, and a pixel of alpha 0 is four zeros. Values are clamped to 0..1 and rounded to the nearest of 256 steps;
    /// they are in display space already, so no gamma is applied. NaN becomes 0.
    ///
    /// ```
    /// use voxsplat::image::{Background, Image};
    ///
    /// // One pixel of half transparent red, premultiplied.
    /// let image = Image::new(1, 1, vec![[0.5, 0.0, 0.0, 0.5]])?;
    /// assert_eq!(image.to_rgba8(Background::Transparent), [255, 0, 0, 128]);
    /// assert_eq!(image.to_rgba8("white".parse()?), [255, 128, 128, 255]);
    /// # Ok::<(), voxsplat::error::Error>(())
    /// ```
    #[must_use]
    pub fn to_rgba8(&self, background: Background) -> Vec<u8> {
        let bytes = |&[r, g, b, a]: &[f32; 4]| {
            let (color, alpha) = ([r, g, b].map(f64::from), f64::from(a));
            let [r, g, b] = std::array::from_fn(|c| match background {
                Background::Color(behind) => byte(color[c] + behind[c] * (1.0 - alpha)),
                Background::Transparent if alpha > 0.0 => byte(color[c] / alpha),
                Background::Transparent => 0,
            });
            [r, g, b, if background == Background::Transparent { byte(alpha) } else { 255 }]
        };
        self.pixels.par_iter().map(bytes).collect::<Vec<[u8; 4]>>().into_flattened()
    }

    /// Returns a copy of a region of the picture.
    ///
    /// # Errors
    /// [`Error::Setting`] if the region reaches beyond the picture, [`Error::Memory`].
    pub fn part(&self, region: Region) -> Result<Self> {
        region.check_within([self.width, self.height])?;
        let mut part = Self::transparent(region.width, region.height)?;
        let columns = region.x as usize..(region.x + region.width) as usize;
        let rows = self.pixels.chunks_exact(self.width as usize).skip(region.y as usize);
        let parts = part.pixels.chunks_exact_mut(region.width as usize);
        parts.zip(rows).for_each(|(to, from)| to.copy_from_slice(&from[columns.clone()]));
        Ok(part)
    }

    /// Copies a picture into this one, with its top left pixel at a column and row.
    pub(crate) fn put(&mut self, image: &Self, [x, y]: [u32; 2]) {
        let columns = x as usize..(x + image.width) as usize;
        let rows = self.pixels.chunks_exact_mut(self.width as usize).skip(y as usize);
        rows.zip(image.pixels.chunks_exact(image.width as usize))
            .for_each(|(to, from)| to[columns.clone()].copy_from_slice(from));
    }

    /// Returns the width in pixels.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Returns the height in pixels.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Returns the premultiplied pixels, row by row from the top.
    #[must_use]
    pub fn pixels(&self) -> &[[f32; 4]] {
        &self.pixels
    }

    /// Returns the pixel in a column and row.
    pub(crate) fn at(&self, [x, y]: [u32; 2]) -> [f32; 4] {
        self.pixels[y as usize * self.width as usize + x as usize]
    }

    pub(crate) fn at_mut(&mut self, [x, y]: [u32; 2]) -> &mut [f32; 4] {
        &mut self.pixels[y as usize * self.width as usize + x as usize]
    }

    /// Returns the premultiplied pixels, mutable, row by row from the top.
    pub fn pixels_mut(&mut self) -> &mut [[f32; 4]] {
        &mut self.pixels
    }
}

/// Rounds a display value in 0..1 to the nearest of 256 steps; NaN becomes 0.
fn byte(value: f64) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_straight_or_over_the_background() {
        let pixels = vec![[0.25, 0.125, 0.5, 0.5], [0.0; 4], [2.0, -1.0, f32::NAN, 1.0]];
        let image = Image::new(3, 1, pixels).unwrap();
        let straight = image.to_rgba8(Background::Transparent);
        assert_eq!(straight, [128, 64, 255, 128, 0, 0, 0, 0, 255, 0, 0, 255]);
        let over = image.to_rgba8(Background::Color([1.0; 3]));
        assert_eq!(over, [191, 159, 255, 255, 255, 255, 255, 255, 255, 0, 0, 255]);
    }

    #[test]
    fn rows_run_from_the_top_left() {
        let pixel = |v| [v, 0.0, 0.0, 1.0];
        let image = Image::new(2, 2, [0.0, 0.2, 0.4, 0.6].map(pixel).to_vec()).unwrap();
        let reds: Vec<u8> = image.to_rgba8(Background::default()).chunks_exact(4).map(|p| p[0]).collect();
        assert_eq!(reds, [0, 51, 102, 153]);
    }

    #[test]
    fn pixels_must_fill_the_picture() {
        let error = Image::new(2, 2, vec![[0.0; 4]; 3]).unwrap_err().to_string();
        assert_eq!(error, "picture: 3 pixels do not make 2 x 2");
        let error = Image::transparent(u32::MAX, u32::MAX).unwrap_err();
        assert!(matches!(error, Error::Memory { bytes, .. } if bytes > 1 << 60), "{error}");
    }
}
