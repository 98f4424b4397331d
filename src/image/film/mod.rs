//! Films: pictures of one size as GIF, APNG, Y4M or an HTML page that turns when it is dragged.

mod page;
mod palette;

use std::fs::File;
use std::io::{self, BufWriter, Error as IoError, Read, Seek, Write};
use std::path::Path;

use page::Page;
use palette::Histogram;

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::image::{Background, Image, png_encoder};
use crate::output::{check_writable, write_atomically};
use voxsplat_volume::names::named;

/// The format of a film.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// 256 colours for all frames, with an ordered dither, endless.
    Gif,
    /// Animated PNG: all colours, endless.
    Apng,
    /// Uncompressed YUV (BT.601, 4:4:4) for encoders of video, such as `ffmpeg -i -`.
    Y4m,
    /// One HTML page with every frame, which turns when it is dragged. Frames are PNG, or JPEG if that is smaller.
    Html,
}

named!("format", Format { Gif: "gif", Apng: "apng", Y4m: "y4m", Html: "html" });

impl Format {
    /// Returns the format for the extension of a path.
    #[must_use]
    pub fn for_path(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?.to_lowercase();
        Self::ALL.into_iter().find(|format| format.name() == extension)
    }
}

/// A film that is written frame by frame.
///
/// ```
/// use voxsplat::film::{Film, Format};
/// use voxsplat::{Background, Image};
///
/// let mut bytes = Vec::new();
/// let mut film = Film::new(&mut bytes, Format::Y4m, [2, 1], 2, 25.0)?;
/// for light in [0.0, 1.0] {
///     film.add(&Image::new(2, 1, vec![[light, light, light, 1.0]; 2])?, Background::default())?;
/// }
/// film.finish()?;
/// assert!(bytes.starts_with(b"YUV4MPEG2 W2 H1 F25000:1000"));
/// # Ok::<(), voxsplat::error::Error>(())
/// ```
pub struct Film<W: Write> {
    size: [u32; 2],
    frames: u32,
    added: u32,
    lines: Vec<String>,
    sink: Sink<W>,
}

enum Sink<W: Write> {
    /// A GIF, whose frames wait in a temporary file until their palette is known.
    Gif {
        out: W,
        waiting: BufWriter<File>,
        histogram: Box<Histogram>,
        hundredths: u16,
    },
    Apng(png::Writer<W>),
    Y4m(W),
    Html(Page<W>),
}

impl<W: Write> Film<W> {
    /// Begins a film of a number of frames of `size` (width, height) pixels, at `rate` frames a second. A GIF shows
    /// frames for whole hundredths of a second.
    ///
    /// # Errors
    /// [`Error::Setting`] if a side is 0 or over [`Camera::MAX_SIZE`], there are no frames, or the rate is not 0.1 to
    /// 1000; [`Error::Image`] if the head of the film cannot be written.
    pub fn new(out: W, format: Format, size: [u32; 2], frames: u32, rate: f64) -> Result<Self> {
        if size.iter().any(|side| !(1..=Camera::MAX_SIZE).contains(side)) {
            let [width, height] = size;
            let reason = format!("{width}x{height}, expected 1 to {} pixels", Camera::MAX_SIZE);
            return Err(Error::setting("size", reason));
        }
        if frames == 0 {
            return Err(Error::setting("frames", "0, expected 1 or more"));
        }
        if !(0.1..=1000.0).contains(&rate) {
            return Err(Error::setting("rate", format!("{rate}, expected 0.1 to 1000 frames a second")));
        }
        let sink = match format {
            Format::Gif => {
                let hundredths = (100.0 / rate).round().max(1.0) as u16;
                Sink::Gif { out, waiting: BufWriter::new(temporary()?), histogram: Box::default(), hundredths }
            }
            Format::Apng => Sink::apng(out, size, frames, rate).map_err(failed)?,
            Format::Y4m => Sink::y4m(out, size, rate).map_err(failed)?,
            Format::Html => Sink::Html(Page::new(out, size, rate)),
        };
        Ok(Self { size, frames, added: 0, lines: Vec::new(), sink })
    }

    /// Sets the lines of text below the picture, which only a page shows.
    pub fn describe(&mut self, lines: Vec<String>) {
        self.lines = lines;
    }

    /// Sets the title, which only a page shows, before the first frame.
    pub fn title(&mut self, title: &str) {
        if let Sink::Html(page) = &mut self.sink {
            page.title = title.to_owned();
        }
    }

    /// Adds the next frame, over an opaque background.
    ///
    /// # Errors
    /// [`Error::Image`] if the picture has another size, is one too many, or cannot be written; [`Error::Setting`] if
    /// the background is transparent.
    pub fn add(&mut self, image: &Image, background: Background) -> Result<()> {
        if background == Background::Transparent {
            return Err(Error::setting("background", "transparent, expected a colour: films have no alpha"));
        }
        if [image.width(), image.height()] != self.size || self.added == self.frames {
            let [width, height] = self.size;
            let reason = format!("a film of {} frames of {width} x {height} pixels has no place for it", self.frames);
            return Err(Error::Image(reason));
        }
        self.added += 1;
        self.sink.add(&image.to_rgb8(background)).map_err(failed)
    }

    /// Completes the film.
    ///
    /// # Errors
    /// [`Error::Image`] if frames are missing, or the end cannot be written.
    pub fn finish(self) -> Result<()> {
        if self.added < self.frames {
            return Err(Error::Image(format!("the film has {} of {} frames", self.added, self.frames)));
        }
        self.sink.finish(self.size, self.frames, &self.lines).map_err(failed)
    }
}

impl<W: Write> Sink<W> {
    fn apng(out: W, size: [u32; 2], frames: u32, rate: f64) -> io::Result<Self> {
        let mut encoder = png_encoder(out, size, png::ColorType::Rgb, png::Compression::Fast);
        encoder.set_animated(frames, 0)?;
        let milliseconds = (1000.0 / rate).round().clamp(1.0, f64::from(u16::MAX));
        encoder.set_frame_delay(milliseconds as u16, 1000)?;
        Ok(Self::Apng(encoder.write_header()?))
    }

    fn y4m(mut out: W, [width, height]: [u32; 2], rate: f64) -> io::Result<Self> {
        let thousandths = (rate * 1000.0).round();
        writeln!(out, "YUV4MPEG2 W{width} H{height} F{thousandths}:1000 Ip A1:1 C444")?;
        Ok(Self::Y4m(out))
    }

    /// Adds a frame of RGB bytes.
    fn add(&mut self, rgb: &[u8]) -> io::Result<()> {
        match self {
            Self::Gif { waiting, histogram, .. } => {
                histogram.count(rgb);
                waiting.write_all(rgb)
            }
            Self::Apng(writer) => Ok(writer.write_image_data(rgb)?),
            Self::Y4m(out) => {
                out.write_all(b"FRAME\n")?;
                out.write_all(&planes(rgb))
            }
            Self::Html(page) => page.add(rgb),
        }
    }

    fn finish(self, size: [u32; 2], frames: u32, lines: &[String]) -> io::Result<()> {
        match self {
            Self::Gif { out, waiting, histogram, hundredths } => {
                let mut waiting = waiting.into_inner()?;
                waiting.rewind()?;
                let [width, height] = size.map(|side| side as u16);
                let palette = histogram.palette();
                let mut encoder = gif::Encoder::new(out, width, height, &palette.bytes()).map_err(IoError::other)?;
                encoder.set_repeat(gif::Repeat::Infinite).map_err(IoError::other)?;
                let mut pixels = vec![0; usize::from(width) * usize::from(height) * 3];
                for _ in 0..frames {
                    waiting.read_exact(&mut pixels)?;
                    let indices = palette.indices(&pixels, usize::from(width));
                    let mut frame = gif::Frame::from_indexed_pixels(width, height, indices, None);
                    frame.delay = hundredths;
                    encoder.write_frame(&frame).map_err(IoError::other)?;
                }
                encoder.into_inner().map_err(IoError::other)?.flush()
            }
            Self::Apng(writer) => Ok(writer.finish()?),
            Self::Y4m(mut out) => out.flush(),
            Self::Html(page) => page.finish(lines),
        }
    }
}

/// Opens a file without a name, for frames.
fn temporary() -> Result<File> {
    tempfile::tempfile().map_err(|source| {
        let folder = std::env::temp_dir();
        Error::Image(format!("no temporary file can be made in {}: {source}", folder.display()))
    })
}

/// Returns the error of an encoder or the system.
fn failed(error: IoError) -> Error {
    Error::Image(format!("the film cannot be written: {error}"))
}

/// Returns the planes of luma and chroma of RGB bytes.
fn planes(rgb: &[u8]) -> Vec<u8> {
    let yuv: Vec<[u8; 3]> = rgb.as_chunks().0.iter().copied().map(yuv).collect();
    (0..3).flat_map(|plane| yuv.iter().map(move |pixel| pixel[plane])).collect()
}

/// Returns the luma and the chroma of a colour, limited range (ITU-R BT.601).
fn yuv(rgb: [u8; 3]) -> [u8; 3] {
    let [r, g, b] = rgb.map(|c| f32::from(c) / 255.0);
    let luma = 0.299 * r + 0.587 * g + 0.114 * b;
    let limited = [16.0 + 219.0 * luma, 128.0 + 224.0 * (b - luma) / 1.772, 128.0 + 224.0 * (r - luma) / 1.402];
    limited.map(|c| (c + 0.5) as u8)
}

/// A film in a file, which appears whole or not at all.
#[doc(hidden)]
pub struct FilmFile {
    /// The film, which waits in a temporary file.
    pub film: Film<File>,
    file: File,
}

impl FilmFile {
    /// Refuses a path that cannot be written, before frames are made.
    ///
    /// # Errors
    /// [`Error::Output`] and [`Error::Write`] as [`Image::check_output`]; [`Error::Image`] if no temporary file can be
    /// made.
    pub fn check(path: impl AsRef<Path>) -> Result<()> {
        check_writable(path.as_ref())?;
        temporary().map(drop)
    }

    /// Begins a film in a temporary file.
    ///
    /// # Errors
    /// The errors of [`Film::new`].
    pub fn new(format: Format, size: [u32; 2], frames: u32, rate: f64) -> Result<Self> {
        let file = temporary()?;
        Ok(Self { film: Film::new(file.try_clone().map_err(failed)?, format, size, frames, rate)?, file })
    }

    /// Completes the film and writes it to `path`.
    ///
    /// # Errors
    /// The errors of [`Film::finish`]; [`Error::Output`] and [`Error::Write`] if the file cannot be written.
    pub fn save(self, path: impl AsRef<Path>) -> Result<()> {
        self.film.finish()?;
        write_atomically(path.as_ref(), |target| {
            let mut written = &self.file;
            written.rewind()?;
            io::copy(&mut written, target).map(drop)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames() -> Vec<Image> {
        let ramp = |frame: usize| {
            let pixel = |i: usize| {
                let (x, y) = ((i % 32) as f32 / 31.0, (i / 32) as f32 / 15.0);
                [x, y, frame as f32 / 2.0, 1.0]
            };
            Image::new(32, 16, (0..512).map(pixel).collect()).unwrap()
        };
        (0..3).map(ramp).collect()
    }

    fn film(format: Format) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut film = Film::new(&mut bytes, format, [32, 16], 3, 12.5).unwrap();
        frames().iter().for_each(|frame| film.add(frame, Background::default()).unwrap());
        film.finish().unwrap();
        bytes
    }

    /// Returns the root mean square of the differences of channels, 0 to 255.
    fn off(frame: &Image, pixels: &[u8]) -> f64 {
        let rgba = frame.to_rgba8(Background::default());
        let rgb = rgba.chunks_exact(4).flat_map(|p| &p[..3]);
        let squares: f64 = rgb.zip(pixels).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum();
        (squares / pixels.len() as f64).sqrt()
    }

    #[test]
    fn a_gif_has_every_frame_in_one_palette() {
        let bytes = film(Format::Gif);
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::Indexed);
        let mut decoder = options.read_info(bytes.as_slice()).unwrap();
        let palette = decoder.global_palette().unwrap().to_vec();
        for frame in frames() {
            let read = decoder.read_next_frame().unwrap().unwrap();
            assert_eq!((read.delay, read.palette.is_none()), (8, true));
            let pixels: Vec<u8> =
                read.buffer.iter().flat_map(|&i| palette[3 * usize::from(i)..][..3].to_vec()).collect();
            // 1536 colours in 256.
            assert!(off(&frame, &pixels) < 12.0, "{}", off(&frame, &pixels));
        }
        assert!(decoder.read_next_frame().unwrap().is_none());
    }

    #[test]
    fn an_apng_has_every_colour() {
        let bytes = film(Format::Apng);
        let mut reader = png::Decoder::new(io::Cursor::new(&bytes)).read_info().unwrap();
        assert_eq!(reader.info().animation_control.unwrap().num_frames, 3);
        for frame in frames() {
            let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut pixels).unwrap();
            assert_eq!(off(&frame, &pixels), 0.0);
            assert_eq!(reader.info().frame_control.unwrap().delay_num, 80);
        }
    }

    #[test]
    fn a_page_has_every_frame_and_what_is_said_of_them() {
        let mut bytes = Vec::new();
        let mut film = Film::new(&mut bytes, Format::Html, [32, 16], 3, 12.5).unwrap();
        film.title("{lines} <i>");
        frames().iter().for_each(|frame| film.add(frame, Background::default()).unwrap());
        film.describe(vec!["a <b> & {delay}".to_owned()]);
        film.finish().unwrap();
        let text = String::from_utf8(bytes).unwrap();
        assert!(text.contains("<p>a &lt;b&gt; &amp; {delay}</p>") && text.contains("show(frame + 1), 80)"), "{text}");
        assert!(text.contains("alt=\"{lines} &lt;i&gt;: a volume") && text.contains("width: 32px;"), "{text}");
        assert!(!text.contains("http"), "asks for something of the network");
        let files = files_of(&text);
        assert_eq!(files.len(), 3);
        for (file, frame) in files.into_iter().zip(frames()) {
            let mut reader = png::Decoder::new(io::Cursor::new(&file)).read_info().unwrap();
            let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut pixels).unwrap();
            assert_eq!(off(&frame, &pixels), 0.0);
        }
    }

    /// Returns the files of the frames of a page.
    fn files_of(page: &str) -> Vec<Vec<u8>> {
        let listed = page.split("const frames = [\n").nth(1).unwrap().split("];").next().unwrap();
        let decoded = |text: &str| base64::Engine::decode(&base64::engine::general_purpose::STANDARD, text).unwrap();
        listed.lines().map(|line| decoded(line.trim_matches(['"', ',']))).collect()
    }

    #[test]
    fn a_frame_of_many_colours_of_a_page_is_a_good_jpeg() {
        let wave = |i: usize, across: f32, down: f32| {
            0.5 + 0.4 * ((i % 64) as f32 * across).sin() * ((i / 64) as f32 * down).cos()
        };
        let pixel = |i: usize| [wave(i, 0.31, 0.17), wave(i, 0.13, 0.29), wave(i, 0.23, 0.37), 1.0];
        let frame = Image::new(64, 64, (0..4096).map(pixel).collect()).unwrap();
        let mut bytes = Vec::new();
        let mut film = Film::new(&mut bytes, Format::Html, [64, 64], 1, 25.0).unwrap();
        film.add(&frame, Background::default()).unwrap();
        film.finish().unwrap();
        let file = files_of(&String::from_utf8(bytes).unwrap()).remove(0);
        let read = image::load_from_memory_with_format(&file, image::ImageFormat::Jpeg).unwrap().to_rgb8();
        assert!(off(&frame, read.as_raw()) < 2.0, "{}", off(&frame, read.as_raw()));
    }

    #[test]
    fn y4m_has_three_planes_a_frame() {
        let bytes = film(Format::Y4m);
        let head = b"YUV4MPEG2 W32 H16 F12500:1000 Ip A1:1 C444\n";
        assert!(bytes.starts_with(head));
        assert_eq!(bytes.len(), head.len() + 3 * (b"FRAME\n".len() + 3 * 512));
        assert_eq!([yuv([0; 3]), yuv([255; 3]), yuv([255, 0, 0])], [[16, 128, 128], [235, 128, 128], [81, 90, 240]]);
    }

    #[test]
    fn what_makes_no_film_is_refused() {
        let frame = &frames()[0];
        let new = |size, frames, rate| Film::new(Vec::new(), Format::Y4m, size, frames, rate);
        let refused = |size, frames, rate| new(size, frames, rate).err().unwrap().to_string();
        assert!(refused([0, 1], 1, 25.0).starts_with("size: 0x1, expected"));
        assert_eq!(refused([1, 1], 0, 25.0), "frames: 0, expected 1 or more");
        assert_eq!(refused([1, 1], 1, f64::NAN), "rate: NaN, expected 0.1 to 1000 frames a second");
        let other = new([8, 8], 1, 25.0).unwrap().add(frame, Background::default()).unwrap_err().to_string();
        assert!(other.contains("a film of 1 frames of 8 x 8 pixels has no place for it"), "{other}");
        let mut film = new([32, 16], 2, 25.0).unwrap();
        assert!(film.add(frame, Background::Transparent).unwrap_err().to_string().contains("no alpha"));
        film.add(frame, Background::default()).unwrap();
        assert!(film.finish().unwrap_err().to_string().ends_with("has 1 of 2 frames"));
    }
}
