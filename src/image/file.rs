//! Pictures as files: PNG to look at, EXR to measure.

use std::borrow::Cow;
use std::io::{BufWriter, Cursor, Write};
use std::path::Path;

use image::{DynamicImage, ExtendedColorType, ImageFormat, ImageReader, Rgba32FImage};

use super::{Background, Image};
use crate::error::{Error, Result};
use crate::output::{check_writable, write_atomically};
use crate::settings::Settings;

fn format_of(path: &Path) -> Option<ImageFormat> {
    let extension = path.extension()?.to_str()?.to_lowercase();
    match extension.as_str() {
        "png" => Some(ImageFormat::Png),
        "exr" => Some(ImageFormat::OpenExr),
        _ => None,
    }
}

fn unknown(path: &Path) -> Error {
    Error::Write { path: path.to_owned(), reason: "pictures are written as .png or .exr".to_owned() }
}

impl Image {
    /// Refuses a path that [`Image::save`] could not write.
    ///
    /// # Errors
    /// [`Error::Write`] where the extension is neither .png nor .exr, or as [`check_writable`].
    pub fn check_output(path: &Path) -> Result<()> {
        if format_of(path).is_none() {
            return Err(unknown(path));
        }
        check_writable(path)
    }

    /// Writes the picture by the extension of `path`.
    ///
    /// `.png`: 8 bits per channel, rounded to the nearest, values as composited (they are in display space already);
    /// over a colour, or with straight alpha where the background is transparent. `.exr`: RGBA in 32-bit float,
    /// premultiplied, exactly as composited; the background is left out.
    ///
    /// # Errors
    /// [`Error::Write`], also where a PNG would have to hold a value that is not finite; there is no partial file then.
    pub fn save(&self, path: &Path, background: Background) -> Result<()> {
        let format = format_of(path).ok_or_else(|| unknown(path))?;
        if format == ImageFormat::Png
            && let Some(bad) = self.pixels.iter().position(|p| p.iter().any(|v| !v.is_finite()))
        {
            let (x, y) = (bad % self.width as usize, bad / self.width as usize);
            let reason = format!("pixel ({x}, {y}) is {:?}: only .exr holds such values", self.pixels[bad]);
            return Err(Error::Write { path: path.to_owned(), reason });
        }
        let (bytes, color): (Cow<'_, [u8]>, _) = match (format, background) {
            (ImageFormat::OpenExr, _) => (bytemuck::cast_slice(&self.pixels).into(), ExtendedColorType::Rgba32F),
            (_, Background::Transparent) => (self.straight_bytes().into(), ExtendedColorType::Rgba8),
            (_, Background::Color(color)) => (self.bytes_over(color).into(), ExtendedColorType::Rgb8),
        };
        // Encoded in memory: encoders seek, and a failed encoding never touches the disk.
        let mut encoded = Cursor::new(Vec::new());
        image::write_buffer_with_format(&mut encoded, &bytes, self.width, self.height, color, format)
            .map_err(|e| Error::Write { path: path.to_owned(), reason: e.to_string() })?;
        write_atomically(path, |file| {
            let mut file = BufWriter::new(file);
            file.write_all(encoded.get_ref())?;
            file.flush()
        })
    }

    /// RGB bytes over an opaque colour.
    fn bytes_over(&self, color: [f64; 3]) -> Vec<u8> {
        self.pixels
            .iter()
            .flat_map(|p| {
                std::array::from_fn::<u8, 3, _>(|c| byte(f64::from(p[c]) + color[c] * (1.0 - f64::from(p[3]))))
            })
            .collect()
    }

    /// RGBA bytes with the colour divided by alpha.
    fn straight_bytes(&self) -> Vec<u8> {
        self.pixels
            .iter()
            .flat_map(|p| {
                let alpha = f64::from(p[3]);
                let straight = |c: usize| if alpha > 0.0 { byte(f64::from(p[c]) / alpha) } else { 0 };
                [straight(0), straight(1), straight(2), byte(alpha)]
            })
            .collect()
    }

    /// Reads a picture: PNG of any kind as display values with straight alpha, EXR as premultiplied values.
    ///
    /// # Errors
    /// [`Error::Read`] where the file cannot be read, [`Error::Format`] where it is neither or is damaged.
    pub fn load(path: &Path) -> Result<Self> {
        let damaged = |reason: String| Error::Format { path: path.to_owned(), reason };
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

/// Refuses an EXR whose header claims more pixels than a picture may have: its decoder takes the header's word and aborts
/// the process where there is no memory for it. (PNG decoding is bounded by `image` itself.)
fn check_exr_size(bytes: &[u8], format: Option<ImageFormat>) -> std::result::Result<(), String> {
    const MOST: usize = Settings::MAX_SIZE as usize;
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

/// Display value to 8 bits, to the nearest.
fn byte(value: f64) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0).round() as u8
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
        let error = sample().save(&directory.path().join("a.jpg"), Background::default()).unwrap_err();
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
