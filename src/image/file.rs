//! Pictures as files: PNG to look at, EXR to measure.

use std::borrow::Cow;
use std::io::{self, BufWriter, Cursor, Write};
use std::path::Path;

use image::{DynamicImage, ExtendedColorType, ImageFormat, ImageReader, Rgba32FImage};

use super::{Background, Image};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::output::{check_writable, write_atomically};

fn format_of(path: &Path) -> Option<ImageFormat> {
    let extension = path.extension()?.to_str()?.to_lowercase();
    match extension.as_str() {
        "png" => Some(ImageFormat::Png),
        "exr" => Some(ImageFormat::OpenExr),
        _ => None,
    }
}

fn unknown(path: &Path) -> Error {
    Error::Output { path: path.to_owned(), reason: "pictures are written as .png or .exr".to_owned() }
}

impl Image {
    /// Refuses a path that [`Image::save`] could not write.
    ///
    /// # Errors
    /// [`Error::Output`] if the extension is neither .png nor .exr, or if the path is a directory, a device or a pipe;
    /// [`Error::Write`] if the directory cannot be written to.
    pub fn check_output(path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        if format_of(path).is_none() {
            return Err(unknown(path));
        }
        check_writable(path)
    }

    /// Writes the picture in the format of the extension of `path`. The file appears whole or not at all.
    ///
    /// - `.png`: 8 bits per channel as from [`Image::to_rgba8`]. Over a colour the file has no alpha channel.
    /// - `.exr`: RGBA in 32-bit float, premultiplied, exactly as composited. The background is not used.
    ///
    /// # Errors
    /// [`Error::Output`] as [`Image::check_output`], and if a PNG would have to hold a value that is not finite;
    /// [`Error::Write`] if encoding or writing fails. No partial file is left behind.
    pub fn save(&self, path: impl AsRef<Path>, background: Background) -> Result<()> {
        self.save_to(path.as_ref(), background)
    }

    fn save_to(&self, path: &Path, background: Background) -> Result<()> {
        let format = format_of(path).ok_or_else(|| unknown(path))?;
        if format == ImageFormat::Png
            && let Some(bad) = self.pixels.iter().position(|p| p.iter().any(|v| !v.is_finite()))
        {
            let (x, y) = (bad % self.width as usize, bad / self.width as usize);
            let reason = format!("pixel ({x}, {y}) is {:?}: only .exr holds such values", self.pixels[bad]);
            return Err(Error::Output { path: path.to_owned(), reason });
        }
        let (bytes, color): (Cow<'_, [u8]>, _) = match (format, background) {
            (ImageFormat::OpenExr, _) => (bytemuck::cast_slice(&self.pixels).into(), ExtendedColorType::Rgba32F),
            (_, Background::Transparent) => (self.to_rgba8(background).into(), ExtendedColorType::Rgba8),
            (_, Background::Color(_)) => (without_alpha(&self.to_rgba8(background)).into(), ExtendedColorType::Rgb8),
        };
        // Encoders seek, so they need a buffer; a failed encoding never touches the disk.
        let mut encoded = Cursor::new(Vec::new());
        image::write_buffer_with_format(&mut encoded, &bytes, self.width, self.height, color, format)
            .map_err(|e| Error::Write { path: path.to_owned(), source: io::Error::other(e) })?;
        write_atomically(path, |file| {
            let mut file = BufWriter::new(file);
            file.write_all(encoded.get_ref())?;
            file.flush()
        })
    }

    /// Reads a PNG or EXR picture. The alpha of a PNG is straight, that of an EXR premultiplied.
    ///
    /// # Errors
    /// [`Error::Read`] if the file cannot be read, [`Error::Format`] if it is neither PNG nor EXR or is damaged.
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let damaged = |reason: String| Error::Format { path: path.to_owned(), reason, hint: None };
        let bytes = std::fs::read(path).map_err(|source| Error::Read { path: path.to_owned(), source })?;
        let reader = ImageReader::new(Cursor::new(&bytes))
            .with_guessed_format()
            .map_err(|source| Error::Read { path: path.to_owned(), source })?;
        let format = reader.format();
        if !matches!(format, Some(ImageFormat::Png | ImageFormat::OpenExr)) {
            return Err(damaged("not a PNG or EXR picture".to_owned()));
        }
        check_exr_size(&bytes, format).map_err(damaged)?;
        let decoded: DynamicImage =
            reader.decode().map_err(|e| damaged(format!("the picture cannot be decoded: {e}")))?;
        let decoded: Rgba32FImage = decoded.into_rgba32f();
        let (width, height) = decoded.dimensions();
        let mut pixels: Vec<[f32; 4]> = decoded.pixels().map(|p| p.0).collect();
        if format == Some(ImageFormat::Png) {
            for p in &mut pixels {
                *p = [p[0] * p[3], p[1] * p[3], p[2] * p[3], p[3]];
            }
        }
        Self::new(width, height, pixels)
    }
}

/// Refuses an EXR whose header claims more than [`Settings::MAX_SIZE`] pixels along a side or 2^28 pixels, 4 GiB, in
/// all.
///
/// The decoder reserves the memory that the header claims, and aborts the process if there is none. `image` bounds PNG.
fn check_exr_size(bytes: &[u8], format: Option<ImageFormat>) -> std::result::Result<(), String> {
    const MOST: usize = Camera::MAX_SIZE as usize;
    if format != Some(ImageFormat::OpenExr) {
        return Ok(());
    }
    let meta = exr::meta::MetaData::read_from_buffered(bytes, false)
        .map_err(|e| format!("the picture cannot be decoded: {e}"))?;
    let sizes = meta.headers.iter().map(|h| h.layer_size);
    match sizes.into_iter().find(|s| s.width() > MOST || s.height() > MOST || s.area() > 1 << 28) {
        Some(s) => Err(format!("a picture of {} x {} pixels is too large", s.width(), s.height())),
        None => Ok(()),
    }
}

/// The bytes of red, green and blue of opaque pixels.
fn without_alpha(rgba: &[u8]) -> Vec<u8> {
    rgba.chunks_exact(4).flat_map(|pixel| &pixel[..3]).copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Image {
        let pixels = vec![[0.0; 4], [0.25, 0.125, 0.5, 0.5], [1.0, 0.5, 0.0, 1.0], [0.1, 0.2, 0.3, 0.7]];
        Image::new(2, 2, pixels).unwrap()
    }

    #[test]
    fn exr_keeps_every_bit() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.exr");
        let mut image = sample();
        image.pixels_mut()[0] = [1e-20, 3.5, -0.25, 1e-7];
        image.save(&path, Background::default()).unwrap();
        assert_eq!(Image::load(&path).unwrap(), image);
    }

    #[test]
    fn png_is_straight_or_over_the_background() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.png");
        sample().save(&path, Background::Transparent).unwrap();
        let raw = image::open(&path).unwrap().into_rgba8();
        assert_eq!(raw.get_pixel(0, 0).0, [0; 4]);
        assert_eq!(raw.get_pixel(1, 0).0, [128, 64, 255, 128]);
        sample().save(&path, "white".parse().unwrap()).unwrap();
        let raw = image::open(&path).unwrap();
        assert!(!raw.color().has_alpha());
        assert_eq!(raw.into_rgb8().get_pixel(1, 0).0, [191, 159, 255]);
    }

    #[test]
    fn bad_files_are_one_line() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.png");
        for bytes in [&b"not a picture"[..], b"\x89PNG\r\n\x1a\n", b"\x76\x2f\x31\x01\x02\0\0\0"] {
            std::fs::write(&path, bytes).unwrap();
            let error = Image::load(&path).unwrap_err().to_string();
            assert!(!error.contains('\n') && error.contains("a.png"), "{error}");
        }
        let mut image = sample();
        image.pixels_mut()[3][1] = f32::NAN;
        let error = image.save(&path, Background::default()).unwrap_err().to_string();
        assert!(error.contains("pixel (1, 1)"), "{error}");
        let error = sample().save(directory.path().join("a.jpg"), Background::default()).unwrap_err();
        assert!(error.to_string().contains(".png or .exr"), "{error}");
    }

    #[test]
    fn an_exr_header_that_claims_too_much_is_refused() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.exr");
        sample().save(&path, Background::default()).unwrap();
        let mut bytes = std::fs::read(&path).unwrap();
        let name = b"dataWindow\0box2i\0";
        let at = bytes.windows(name.len()).position(|w| w == name).unwrap() + name.len();
        // Past the attribute's size and xMin, yMin: xMax.
        bytes[at + 12..at + 16].copy_from_slice(&300_000_000_i32.to_le_bytes());
        std::fs::write(&path, bytes).unwrap();
        let error = Image::load(&path).unwrap_err().to_string();
        assert!(error.contains("too large"), "{error}");
    }
}
