//! An HTML page that turns when it is dragged: one file with all frames, without requests to the network.

use std::io::{self, Write};

use base64::display::Base64Display;
use base64::engine::general_purpose::STANDARD;
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder};

use crate::image::png_encoder;
use voxsplat_volume::names::escaped;

/// The HTML before the frames.
const HEAD: &str = include_str!("page_head.html");
/// The HTML behind the frames.
const TAIL: &str = include_str!("page_tail.html");

/// The quality of frames in JPEG, 1 to 100. Their errors are measured in docs/measurements/2026-11-25-seconds.md.
const QUALITY: u8 = 95;

/// A page that is written frame by frame.
pub(super) struct Page<W> {
    out: W,
    size: [u32; 2],
    /// The milliseconds per frame when the page plays.
    delay: u32,
    pub(super) title: String,
    /// Whether the head of the page has been written.
    begun: bool,
}

impl<W: Write> Page<W> {
    /// Begins a page.
    pub(super) fn new(out: W, size: [u32; 2], rate: f64) -> Self {
        let delay = (1000.0 / rate).round().max(1.0) as u32;
        Self { out, size, delay, title: "voxsplat".to_owned(), begun: false }
    }

    /// Adds a frame of RGB bytes, as PNG or as JPEG, whichever is smaller.
    pub(super) fn add(&mut self, rgb: &[u8]) -> io::Result<()> {
        if !self.begun {
            let head = HEAD.replace("{width}", &self.size[0].to_string());
            self.out.write_all(head.replacen("{title}", &escaped(&self.title), 1).as_bytes())?;
            self.begun = true;
        }
        let mut file = Vec::new();
        let encoder = png_encoder(&mut file, self.size, png::ColorType::Rgb, png::Compression::Balanced);
        encoder.write_header()?.write_image_data(rgb)?;
        let (mut lossy, [width, height]) = (Vec::new(), self.size);
        let encoder = JpegEncoder::new_with_quality(&mut lossy, QUALITY);
        encoder.write_image(rgb, width, height, ExtendedColorType::Rgb8).map_err(io::Error::other)?;
        let smaller = if lossy.len() < file.len() { lossy } else { file };
        writeln!(self.out, "\"{}\",", Base64Display::new(&smaller, &STANDARD))
    }

    /// Ends the page with lines of text below the picture.
    pub(super) fn finish(mut self, lines: &[String]) -> io::Result<()> {
        let [width, height] = self.size;
        let lines: String = lines.iter().map(|line| format!("<p>{}</p>\n", escaped(line))).collect();
        let tail = TAIL.replace("{width}", &width.to_string()).replace("{height}", &height.to_string());
        let tail = tail.replace("{delay}", &self.delay.to_string());
        // The texts of the user come last, because they may contain a placeholder.
        let (before, behind) = tail.split_once("{lines}").unwrap_or((&tail, ""));
        let before = before.replacen("{title}", &escaped(&self.title), 1);
        [&before, &lines, behind].iter().try_for_each(|text| self.out.write_all(text.as_bytes()))?;
        self.out.flush()
    }
}
