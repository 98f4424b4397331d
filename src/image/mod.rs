//! Pictures: composited values in f32.

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
    /// [`Error::Compare`] where their number is not `width * height`.
    pub fn new(width: u32, height: u32, pixels: Vec<[f32; 4]>) -> Result<Self> {
        if pixels.len() as u64 != u64::from(width) * u64::from(height) {
            return Err(Error::Compare(format!("{} pixels do not make {width} x {height}", pixels.len())));
        }
        Ok(Self { width, height, pixels })
    }

    /// A transparent picture.
    #[must_use]
    pub fn transparent(width: u32, height: u32) -> Self {
        Self { width, height, pixels: vec![[0.0; 4]; width as usize * height as usize] }
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

/// Stand-in: what lies behind a picture.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Background {
    /// Nothing.
    #[default]
    Transparent,
    /// A colour.
    Color([f32; 3]),
}

impl std::str::FromStr for Background {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match text {
            "transparent" => Ok(Self::Transparent),
            "black" => Ok(Self::Color([0.0; 3])),
            "white" => Ok(Self::Color([1.0; 3])),
            _ => Err(Error::Setting { name: "background", reason: format!("{text} is no colour") }),
        }
    }
}

impl Image {
    /// Stand-in.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn save(&self, path: &std::path::Path, _background: Background) -> Result<()> {
        let bytes = self.pixels.iter().flat_map(|p| p.map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8)).collect();
        let error = |e: String| Error::Write { path: path.to_owned(), reason: e };
        let picture = image::RgbaImage::from_raw(self.width, self.height, bytes).ok_or_else(|| error("size".into()))?;
        crate::output::write_atomically(path, |file| {
            picture.write_to(&mut std::io::BufWriter::new(file), image::ImageFormat::Png).map_err(std::io::Error::other)
        })
    }

    /// Stand-in.
    ///
    /// # Errors
    /// [`Error::Format`].
    pub fn load(path: &std::path::Path) -> Result<Self> {
        let error = |e: String| Error::Format { path: path.to_owned(), reason: e };
        std::fs::File::open(path).map_err(|source| Error::Read { path: path.to_owned(), source })?;
        let picture = image::open(path).map_err(|e| error(e.to_string()))?.to_rgba32f();
        Self::new(picture.width(), picture.height(), picture.pixels().map(|p| p.0).collect())
    }
}
