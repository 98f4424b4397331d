//! The font of figures: a subset of Open Sans Semibold (`font/README.md`).

use glam::DVec2;
use ttf_parser::{Face, OutlineBuilder};

use super::path::Path;
use crate::error::{Error, Result};

pub(super) struct Font(Face<'static>);

/// The largest distance of a chord from its curve, pixels.
const FLATNESS: f64 = 0.02;

impl Font {
    pub(super) fn new() -> Result<Self> {
        Face::parse(include_bytes!("font/OpenSans-Semibold.ttf"), 0)
            .map(Self)
            .map_err(|e| Error::Image(format!("the font of figures cannot be read: {e}")))
    }

    /// The first character that the font lacks.
    pub(super) fn lacks(&self, text: &str) -> Option<char> {
        text.chars().find(|&c| c != '\n' && self.0.glyph_index(c).is_none())
    }

    /// The height of capital letters, as a share of the font's size.
    pub(super) fn capitals(&self) -> f64 {
        f64::from(self.0.capital_height().unwrap_or(0)) / f64::from(self.0.units_per_em())
    }

    /// The width of a line of text at a size in pixels.
    pub(super) fn width(&self, text: &str, size: f64) -> f64 {
        text.chars().map(|c| self.advance(c, size)).sum()
    }

    fn advance(&self, c: char, size: f64) -> f64 {
        let advance = self.0.glyph_index(c).and_then(|glyph| self.0.glyph_hor_advance(glyph)).unwrap_or(0);
        f64::from(advance) * self.scale(size)
    }

    fn scale(&self, size: f64) -> f64 {
        size / f64::from(self.0.units_per_em())
    }

    /// The outlines of a line of text at a size in pixels, which begins at `origin` on its baseline.
    pub(super) fn text(&self, text: &str, size: f64, origin: DVec2) -> Path {
        let mut pen = Pen { path: Path::default(), polygon: Vec::new(), origin, scale: self.scale(size) };
        for c in text.chars() {
            if let Some(glyph) = self.0.glyph_index(c) {
                // A blank has no outline.
                self.0.outline_glyph(glyph, &mut pen);
            }
            pen.origin.x += self.advance(c, size);
        }
        pen.path
    }

    /// Breaks text into lines of at most `width` pixels, between words and at line breaks.
    pub(super) fn lines(&self, text: &str, size: f64, width: f64) -> Vec<String> {
        let mut lines = Vec::new();
        for paragraph in text.lines() {
            let mut line = String::new();
            for word in paragraph.split_whitespace() {
                let longer = if line.is_empty() { word.to_owned() } else { format!("{line} {word}") };
                if line.is_empty() || self.width(&longer, size) <= width {
                    line = longer;
                } else {
                    lines.push(std::mem::replace(&mut line, word.to_owned()));
                }
            }
            lines.push(line);
        }
        lines
    }
}

/// Turns the outlines of glyphs into polygons.
struct Pen {
    path: Path,
    polygon: Vec<DVec2>,
    origin: DVec2,
    scale: f64,
}

impl Pen {
    fn at(&self, x: f32, y: f32) -> DVec2 {
        self.origin + DVec2::new(x.into(), -f64::from(y)) * self.scale
    }
}

impl OutlineBuilder for Pen {
    fn move_to(&mut self, x: f32, y: f32) {
        self.polygon = vec![self.at(x, y)];
    }

    fn line_to(&mut self, x: f32, y: f32) {
        self.polygon.push(self.at(x, y));
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let Some(&a) = self.polygon.last() else { return };
        let (b, c) = (self.at(x1, y1), self.at(x, y));
        let chords = ((a - 2.0 * b + c).length() / (4.0 * FLATNESS)).sqrt().ceil().max(1.0) as u32;
        let shares = (1..=chords).map(|chord| f64::from(chord) / f64::from(chords));
        self.polygon.extend(shares.map(|t| a.lerp(b, t).lerp(b.lerp(c, t), t)));
    }

    /// TrueType fonts have no cubic curves.
    fn curve_to(&mut self, _: f32, _: f32, _: f32, _: f32, x: f32, y: f32) {
        self.line_to(x, y);
    }

    fn close(&mut self) {
        self.path.add(std::mem::take(&mut self.polygon));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_as_wide_as_it_says() {
        let font = Font::new().unwrap();
        let [least, most] = font.text("HIH", 100.0, DVec2::new(10.0, 200.0)).bounds().unwrap();
        assert!(least.x > 10.0 && most.x < 10.0 + font.width("HIH", 100.0));
        assert_eq!(most.y, 200.0);
        assert!((200.0 - least.y - 100.0 * font.capitals()).abs() < 1.0);
        assert_eq!(font.width("12", 50.0), font.width("12", 100.0) / 2.0);
    }

    #[test]
    fn the_font_has_what_figures_need() {
        let font = Font::new().unwrap();
        let known = "0123456789.,−+×⁰¹²³⁴⁵⁶⁷⁸⁹–—µμ°±≤≥≈ ABCÄßçøñŁő αβγΩσ ДЖя «»„“”‘’…√∞€\n";
        assert_eq!(font.lacks(known), None);
        assert_eq!(font.lacks("bone 骨"), Some('骨'));
    }

    #[test]
    fn lines_are_broken_between_words() {
        let font = Font::new().unwrap();
        let text = "one two three four\nfive";
        let lines = font.lines(text, 10.0, font.width("one two three", 10.0));
        assert_eq!(lines, ["one two three", "four", "five"]);
        assert_eq!(font.lines("Donaudampfschiff x", 10.0, 5.0), ["Donaudampfschiff", "x"]);
    }
}
