//! The font of figures: outlines of a subset of Open Sans Semibold (`font/README.md`).

use std::collections::HashMap;

use glam::DVec2;

use super::path::Path;

/// Outlines of characters. `font/README.md` describes their file.
pub(super) struct Font {
    units_per_em: f64,
    capitals: f64,
    /// The advance of each character in units of the font, and its contours in the text of the file.
    glyphs: HashMap<char, (f64, &'static str)>,
}

/// The largest distance of a chord from its curve, pixels.
const FLATNESS: f64 = 0.02;

impl Font {
    pub(super) fn new() -> Self {
        let mut lines = include_str!("font/outlines.txt").lines();
        let header = lines.next().and_then(|line| pair(line, ' ')).unwrap_or(DVec2::ONE);
        let glyph = |line: &'static str| {
            let (code, rest) = line.split_once(' ')?;
            let (advance, contours) = rest.split_once(" / ").unwrap_or((rest, ""));
            Some((char::from_u32(u32::from_str_radix(code, 16).ok()?)?, (advance.parse().ok()?, contours)))
        };
        Self { units_per_em: header.x, capitals: header.y, glyphs: lines.filter_map(glyph).collect() }
    }

    /// Returns the first character that the font lacks.
    pub(super) fn lacks(&self, text: &str) -> Option<char> {
        text.chars().find(|c| *c != '\n' && !self.glyphs.contains_key(c))
    }

    /// Returns the height of capital letters, as a share of the font's size.
    pub(super) fn capitals(&self) -> f64 {
        self.capitals / self.units_per_em
    }

    /// Returns the width of a line of text at a size in pixels.
    pub(super) fn width(&self, text: &str, size: f64) -> f64 {
        text.chars().map(|c| self.advance(c, size)).sum()
    }

    fn advance(&self, c: char, size: f64) -> f64 {
        self.glyphs.get(&c).map_or(0.0, |(advance, _)| advance * self.scale(size))
    }

    fn scale(&self, size: f64) -> f64 {
        size / self.units_per_em
    }

    /// Returns the outlines of a line of text at a size in pixels, which begins at `origin` on its baseline.
    pub(super) fn text(&self, text: &str, size: f64, mut origin: DVec2) -> Path {
        let mut path = Path::default();
        let scale = DVec2::new(self.scale(size), -self.scale(size));
        for c in text.chars() {
            // A blank has no outline.
            let contours = self.glyphs.get(&c).map_or("", |(_, contours)| contours);
            contours.split(" / ").filter(|contour| !contour.is_empty()).for_each(|contour| {
                path.add(polygon(contour, |place| origin + place * scale));
            });
            origin.x += self.advance(c, size);
        }
        path
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

/// Returns two numbers with a separator between them.
fn pair(text: &str, separator: char) -> Option<DVec2> {
    let (a, b) = text.split_once(separator)?;
    Some(DVec2::new(a.parse().ok()?, b.parse().ok()?))
}

/// Turns a contour of a TrueType font into a polygon of the picture. Points off the curve are the middle control points
/// of parabolas, which end at the middle between two such points.
fn polygon(contour: &str, to_picture: impl Fn(DVec2) -> DVec2) -> Vec<DVec2> {
    let mut at = DVec2::ZERO;
    let points = contour.split(' ').filter_map(|step| {
        let place = step.strip_suffix('*');
        at += pair(place.unwrap_or(step), ',')?;
        Some((at, place.is_some()))
    });
    let mut points: Vec<(DVec2, bool)> = points.collect();
    // The first point lies on the curve, and closes it.
    points.extend(points.first().copied());
    let mut polygon: Vec<DVec2> = Vec::new();
    let mut control: Option<DVec2> = None;
    for (point, is_control) in points {
        let end = if is_control { control.map(|control| control.midpoint(point)) } else { Some(point) };
        if let Some(end) = end {
            match (control, polygon.last()) {
                (Some(control), Some(&a)) => {
                    let (b, c) = (to_picture(control), to_picture(end));
                    let chords = ((a - 2.0 * b + c).length() / (4.0 * FLATNESS)).sqrt().ceil().max(1.0) as u32;
                    let shares = (1..=chords).map(|chord| f64::from(chord) / f64::from(chords));
                    polygon.extend(shares.map(|t| a.lerp(b, t).lerp(b.lerp(c, t), t)));
                }
                _ => polygon.push(to_picture(end)),
            }
        }
        control = is_control.then_some(point);
    }
    polygon
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_as_wide_as_it_says() {
        let font = Font::new();
        let [least, most] = font.text("HIH", 100.0, DVec2::new(10.0, 200.0)).bounds().unwrap();
        assert!(least.x > 10.0 && most.x < 10.0 + font.width("HIH", 100.0));
        assert_eq!(most.y, 200.0);
        assert!((200.0 - least.y - 100.0 * font.capitals()).abs() < 1.0);
        assert_eq!(font.width("12", 50.0), font.width("12", 100.0) / 2.0);
    }

    #[test]
    fn the_font_has_what_figures_need() {
        let font = Font::new();
        let known = "0123456789.,−+×⁰¹²³⁴⁵⁶⁷⁸⁹–—µμ°±≤≥≈ ABCÄßçøñŁő αβγΩσ ДЖя «»„“”‘’…√∞€\n";
        assert_eq!(font.lacks(known), None);
        assert_eq!(font.lacks("bone 骨"), Some('骨'));
    }

    #[test]
    fn the_file_of_the_font_is_read_whole() {
        let font = Font::new();
        assert_eq!((font.units_per_em, font.glyphs.len()), (2048.0, 538));
        for (_, contours) in font.glyphs.values().filter(|(_, contours)| !contours.is_empty()) {
            for contour in contours.split(" / ") {
                let steps: Vec<&str> = contour.split(' ').collect();
                let is_step = |step: &&str| pair(step.strip_suffix('*').unwrap_or(step), ',').is_some();
                assert!(steps.len() > 2 && steps.iter().all(is_step) && !steps[0].ends_with('*'), "{contour}");
            }
        }
    }

    #[test]
    fn points_off_the_curve_bend_it() {
        // A parabola from (0, 0) to (2, 0), and a line back.
        let bent = polygon("0,0 1,1* 1,-1", |place| 100.0 * place);
        let highest = bent.iter().map(|place| place.y).fold(0.0, f64::max);
        assert!((highest - 50.0).abs() < 0.1 && bent.len() > 20, "{highest}");
        assert_eq!((bent[0], bent[bent.len() - 1]), (DVec2::ZERO, DVec2::ZERO));
        // A circle of four points off the curve, nearly.
        let round = polygon("0,-1 1,0* 0,2* -2,0* 0,-2* 1,0", |place| 100.0 * place);
        assert!(round.iter().all(|place| (place.length() - 103.0).abs() < 4.0), "{round:?}");
    }

    #[test]
    fn lines_are_broken_between_words() {
        let font = Font::new();
        let text = "one two three four\nfive";
        let lines = font.lines(text, 10.0, font.width("one two three", 10.0));
        assert_eq!(lines, ["one two three", "four", "five"]);
        assert_eq!(font.lines("Donaudampfschiff x", 10.0, 5.0), ["Donaudampfschiff", "x"]);
    }
}
