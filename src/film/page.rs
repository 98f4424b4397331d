//! A page that turns when it is dragged: one HTML file with all frames in it, which asks nothing of the network.

use std::io::{self, Write};

use base64::display::Base64Display;
use base64::engine::general_purpose::STANDARD;

use voxsplat_volume::names::escaped;

/// What stands before the frames.
const HEAD: &str = include_str!("page_head.html");
/// What stands behind them.
const TAIL: &str = include_str!("page_tail.html");

/// A page that is being written.
pub(super) struct Page<W> {
    out: W,
    size: [u32; 2],
    /// Milliseconds a frame, when it plays.
    delay: u32,
    pub(super) title: String,
    /// Whether its head has been written.
    begun: bool,
}

impl<W: Write> Page<W> {
    /// Begins a page.
    pub(super) fn new(out: W, size: [u32; 2], rate: f64) -> Self {
        let delay = (1000.0 / rate).round().max(1.0) as u32;
        Self { out, size, delay, title: "voxsplat".to_owned(), begun: false }
    }

    /// Adds a frame of RGB bytes.
    pub(super) fn add(&mut self, rgb: &[u8]) -> io::Result<()> {
        if !self.begun {
            self.out.write_all(HEAD.replacen("{title}", &escaped(&self.title), 1).as_bytes())?;
            self.begun = true;
        }
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, self.size[0], self.size[1]);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_filter(png::Filter::Adaptive);
        encoder.write_header()?.write_image_data(rgb)?;
        writeln!(self.out, "\"{}\",", Base64Display::new(&file, &STANDARD))
    }

    /// Ends the page with lines of text below the picture.
    pub(super) fn finish(mut self, lines: &[String]) -> io::Result<()> {
        let [width, height] = self.size;
        let lines: String = lines.iter().map(|line| format!("<p>{}</p>\n", escaped(line))).collect();
        let tail = TAIL.replace("{width}", &width.to_string()).replace("{height}", &height.to_string());
        let tail = tail.replace("{delay}", &self.delay.to_string());
        // Last, for a line may say anything.
        self.out.write_all(tail.replacen("{lines}", &lines, 1).as_bytes())?;
        self.out.flush()
    }
}
