//! Files of pictures: PNG to view, EXR to measure.

use std::ffi::OsStr;
use std::io::{self, Cursor, Write};
use std::path::Path;

use exr::image::SpecificChannels;
use exr::image::write::WritableImage;
use exr::meta::attribute::AttributeValue;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Rgba};
use rayon::prelude::*;

use super::{Background, Image};
use voxsplat_volume::files;

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::output::{check_writable, write_atomically};
use voxsplat_volume::memory;

/// Returns the format for the extension of a path.
fn format_of(path: &Path) -> Result<ImageFormat> {
    match path.extension().and_then(OsStr::to_str).map(str::to_lowercase).as_deref() {
        Some("png") => Ok(ImageFormat::Png),
        Some("exr") => Ok(ImageFormat::OpenExr),
        _ => Err(Error::Output { path: path.to_owned(), reason: "pictures are written as .png or .exr".to_owned() }),
    }
}

/// Makes a PNG encoder of 8-bit pixels.
pub(crate) fn png_encoder<W: Write>(
    out: W,
    [width, height]: [u32; 2],
    color: png::ColorType,
    compression: png::Compression,
) -> png::Encoder<'static, W> {
    let mut encoder = png::Encoder::new(out, width, height);
    encoder.set_color(color);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(compression);
    encoder.set_filter(png::Filter::Adaptive);
    encoder
}

/// A text in a picture's file beside the pixels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Note {
    /// The keyword of the note: 1 to 79 characters of ASCII. PNG knows Title, Author, Description, Software, Comment
    /// and others.
    pub name: &'static str,
    /// The text of the note. Characters beyond Latin-1 become question marks in an EXR.
    pub text: String,
}

impl Image {
    /// Refuses a path that [`Image::save`] cannot write.
    ///
    /// # Errors
    /// [`Error::Output`] if the extension is neither .png nor .exr, or if the path is a directory, a device or a pipe;
    /// [`Error::Write`] if the directory cannot be written to.
    pub fn check_output(path: impl AsRef<Path>) -> Result<()> {
        format_of(path.as_ref())?;
        check_writable(path.as_ref())
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
        self.save_with_notes(path, background, &[])
    }

    /// Writes the picture as [`Self::save`], with notes: text chunks of a PNG, attributes of an EXR.
    ///
    /// # Errors
    /// The errors of [`Self::save`].
    pub fn save_with_notes(&self, path: impl AsRef<Path>, background: Background, notes: &[Note]) -> Result<()> {
        let path = path.as_ref();
        let format = format_of(path)?;
        if format == ImageFormat::Png
            && let Some(bad) = self.pixels.par_iter().position_first(|p| p.iter().any(|v| !v.is_finite()))
        {
            let (x, y) = (bad % self.width as usize, bad / self.width as usize);
            let reason = format!("pixel ({x}, {y}) is {:?}: only .exr holds such values", self.pixels[bad]);
            return Err(Error::Output { path: path.to_owned(), reason });
        }
        // A failed encoding never touches the disk.
        let encoded = self.encoded(format, background, notes, &path.display().to_string())?;
        let encoded = encoded.map_err(|source| Error::Write { path: path.to_owned(), source })?;
        write_atomically(path, |file| file.write_all(&encoded))
    }

    /// Returns the bytes of a PNG file as [`Self::save`] writes it.
    ///
    /// # Errors
    /// [`Error::Image`] if the picture cannot be encoded; [`Error::Memory`] if there is no memory for the file.
    pub fn to_png(&self, background: Background) -> Result<Vec<u8>> {
        self.to_png_with_notes(background, &[])
    }

    /// Returns the bytes of a PNG file as [`Self::save_with_notes`] writes it.
    ///
    /// # Errors
    /// The errors of [`Self::to_png`].
    pub fn to_png_with_notes(&self, background: Background, notes: &[Note]) -> Result<Vec<u8>> {
        self.encoded(ImageFormat::Png, background, notes, "a PNG")?
            .map_err(|e| Error::Image(format!("it cannot be encoded: {e}")))
    }

    /// Encodes a file; `name` is for messages. The inner error comes from the encoder.
    fn encoded(
        &self,
        format: ImageFormat,
        background: Background,
        notes: &[Note],
        name: &str,
    ) -> Result<io::Result<Vec<u8>>> {
        // 8-bit pixels with and without alpha, or the encoder's copy of f32, and the file.
        let area = u64::from(self.width) * u64::from(self.height);
        memory::check(area * if format == ImageFormat::Png { 12 } else { 32 }, || name.to_owned())?;
        Ok(match (format, background) {
            (ImageFormat::OpenExr, _) => self.exr(notes),
            (_, Background::Transparent) => self.png(&self.to_rgba8(background), png::ColorType::Rgba, notes),
            (_, Background::Color(_)) => self.png(&self.to_rgb8(background), png::ColorType::Rgb, notes),
        })
    }

    /// Returns the picture over an opaque background as 8-bit RGB.
    pub(crate) fn to_rgb8(&self, background: Background) -> Vec<u8> {
        let rgba = self.to_rgba8(background);
        let pixels: Vec<[u8; 3]> = rgba.as_chunks().0.iter().map(|&[r, g, b, _]: &[u8; 4]| [r, g, b]).collect();
        pixels.into_flattened()
    }

    fn png(&self, bytes: &[u8], color: png::ColorType, notes: &[Note]) -> io::Result<Vec<u8>> {
        let mut file = Vec::new();
        let mut encoder = png_encoder(&mut file, [self.width, self.height], color, png::Compression::Fast);
        for Note { name, text } in notes {
            encoder.add_itxt_chunk((*name).to_owned(), text.clone())?;
        }
        let mut writer = encoder.write_header()?;
        writer.write_image_data(bytes)?;
        writer.finish()?;
        Ok(file)
    }

    fn exr(&self, notes: &[Note]) -> io::Result<Vec<u8>> {
        let size = (self.width as usize, self.height as usize);
        let pixel = |at: exr::math::Vec2<usize>| <(f32, f32, f32, f32)>::from(self.pixels[at.y() * size.0 + at.x()]);
        let channels = SpecificChannels::rgba(pixel);
        let image = exr::image::Image::from_channels(size, channels);
        exr_with_notes(image, notes, |image, file| image.write().to_buffered(file))
    }

    /// Loads a PNG or EXR picture. The alpha of a PNG is straight, the alpha of an EXR premultiplied.
    ///
    /// # Errors
    /// [`Error::Input`] if the file cannot be read, is not a regular file (standard input excepted), is neither PNG nor
    /// EXR, is damaged or too large; [`Error::Memory`] if there is no memory for it.
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let damaged = |reason: String| Error::format(path, format!("the picture cannot be decoded: {reason}"));
        let bytes = files::read(path, MAX_BYTES)?;
        let format = match image::guess_format(&bytes) {
            Ok(format @ (ImageFormat::Png | ImageFormat::OpenExr)) => format,
            _ => return Err(Error::format(path, "not a PNG or EXR picture")),
        };
        if format == ImageFormat::OpenExr {
            check_exr(path, &bytes)?;
        }
        let reader = ImageReader::with_format(Cursor::new(&bytes), format);
        let decoder = reader.into_decoder().map_err(|e| damaged(e.to_string()))?;
        let (width, height) = decoder.dimensions();
        let area = u64::from(width) * u64::from(height);
        if width > Camera::MAX_SIZE || height > Camera::MAX_SIZE || area > MAX_AREA {
            return Err(Error::format(path, format!("a picture of {width} x {height} pixels is too large")));
        }
        // The decoder, its pixels of any type, and two copies in f32.
        memory::check(2 * decoder.total_bytes() + 32 * area, || format!("the picture {}", path.display()))?;
        let decoded = DynamicImage::from_decoder(decoder).map_err(|e| damaged(e.to_string()))?.into_rgba32f();
        let pixel = |&Rgba([r, g, b, a]): &Rgba<f32>| match format {
            ImageFormat::Png => [r * a, g * a, b * a, a],
            _ => [r, g, b, a],
        };
        Self::new(width, height, decoded.pixels().map(pixel).collect())
    }
}

/// Encodes an EXR with notes as its attributes.
pub(crate) fn exr_with_notes<C>(
    mut image: exr::image::Image<exr::image::Layer<C>>,
    notes: &[Note],
    write: impl FnOnce(&exr::image::Image<exr::image::Layer<C>>, &mut Cursor<Vec<u8>>) -> exr::error::UnitResult,
) -> io::Result<Vec<u8>> {
    for Note { name, text } in notes {
        // OpenEXR holds bytes of Latin-1.
        let text = exr::meta::attribute::Text::from(text.as_str());
        let name = exr::meta::attribute::Text::from(*name);
        image.layer_data.attributes.other.insert(name, AttributeValue::Text(text));
    }
    // The encoder seeks, so it needs a buffer.
    let mut file = Cursor::new(Vec::new());
    write(&image, &mut file).map_err(io::Error::other)?;
    let mut bytes = file.into_inner();
    sort_attributes(&mut bytes);
    Ok(bytes)
}

/// The largest number of pixels of a picture that is read: 4 GiB of RGBA in f32.
const MAX_AREA: u64 = 1 << 28;

/// The largest file that is read, in bytes: the largest picture, and as much again for unused channels.
pub(super) const MAX_BYTES: u64 = 32 * MAX_AREA;

/// Sorts the attributes in the header of an encoded EXR with one part by their names. The encoder keeps them in a hash
/// map, so that the bytes of one picture would differ from run to run. The header keeps its length.
fn sort_attributes(bytes: &mut [u8]) {
    // Behind the magic number and the version: name, type, both ending in 0, size in four bytes, value; a 0 ends them.
    let begin = 8;
    let mut records: Vec<Vec<u8>> = Vec::new();
    let mut at = begin;
    while bytes.get(at).is_some_and(|&byte| byte != 0) {
        let after_text = |at: usize| bytes[at..].iter().position(|&byte| byte == 0).map(|length| at + length + 1);
        let Some(size_at) = after_text(at).and_then(after_text) else { return };
        let Some(&[a, b, c, d]) = bytes[size_at..].first_chunk() else { return };
        let end = size_at + 4 + u32::from_le_bytes([a, b, c, d]) as usize;
        let Some(record) = bytes.get(at..end) else { return };
        records.push(record.to_vec());
        at = end;
    }
    records.sort_unstable();
    bytes[begin..at].copy_from_slice(&records.concat());
}

/// Refuses an EXR whose header claims more than the largest picture: the decoder allocates the memory that the header
/// claims, for every layer, before it reads pixels.
pub(crate) fn check_exr(path: &Path, bytes: &[u8]) -> Result<()> {
    let meta = exr::meta::MetaData::read_from_buffered(bytes, false)
        .map_err(|e| Error::format(path, format!("the picture cannot be decoded: {e}")))?;
    let most = Camera::MAX_SIZE as usize;
    let sizes = meta.headers.iter().map(|h| h.layer_size);
    match sizes.into_iter().find(|s| s.width() > most || s.height() > most || s.area() as u64 > MAX_AREA) {
        Some(s) => Err(Error::format(path, format!("a picture of {} x {} pixels is too large", s.width(), s.height()))),
        None => Ok(()),
    }
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
    fn files_hold_their_notes() {
        let directory = tempfile::tempdir().unwrap();
        let notes =
            [Note { name: "Software", text: "a renderer".to_owned() }, Note { name: "Error", text: "1e-3".to_owned() }];
        let path = directory.path().join("a.png");
        sample().save_with_notes(&path, Background::default(), &notes).unwrap();
        let file = io::BufReader::new(std::fs::File::open(&path).unwrap());
        let reader = png::Decoder::new(file).read_info().unwrap();
        let texts = &reader.info().utf8_text;
        assert_eq!(
            (texts.len(), texts[1].keyword.as_str(), texts[1].get_text().unwrap().as_str()),
            (2, "Error", "1e-3")
        );
        let path = directory.path().join("a.exr");
        sample().save_with_notes(&path, Background::default(), &notes).unwrap();
        assert_eq!(Image::load(&path).unwrap(), sample());
        let meta = exr::meta::MetaData::read_from_file(&path, false).unwrap();
        let attributes = &meta.headers[0].own_attributes.other;
        assert_eq!(attributes[b"Software".as_slice()], AttributeValue::Text("a renderer".into()));
        // The encoder's order is another each time.
        let notes: Vec<Note> = ["A", "B", "C", "D", "E", "F", "G", "H"]
            .map(|name| Note { name, text: name.repeat(3) })
            .into_iter()
            .collect();
        let encoded = || sample().exr(&notes).unwrap();
        let first = encoded();
        assert!((0..8).all(|_| encoded() == first), "bytes differ");
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
