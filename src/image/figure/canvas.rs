//! The canvas of a figure: a picture, or a region of it, over its background.

use glam::DVec2;

use super::font::Font;
use super::path::Path;
use crate::error::Result;
use crate::image::{Background, Image, Region};
use crate::transfer::color::{from_linear, luminance, to_linear};

/// A picture in the making. Coordinates are pixels of the whole picture, x to the right and y down.
pub(super) struct Canvas {
    image: Image,
    region: Region,
    background: Background,
    pub(super) font: Font,
    /// The font's size, pixels.
    pub(super) em: f64,
    /// The colour of letters and lines.
    pub(super) ink: [f64; 3],
    /// The colour of the halo around letters and lines.
    halo: [f64; 3],
}

/// The opacity of a halo.
const HALO: f64 = 0.8;

/// The luminance above which black has more contrast to a colour than white, by WCAG 2.
const BRIGHT: f64 = 0.179;

impl Canvas {
    /// Makes a canvas of a copy of the region of a picture.
    pub(super) fn new(image: &Image, region: Region, background: Background, em: f64) -> Result<Self> {
        let mut copy = Image::transparent(image.width(), image.height())?;
        copy.pixels_mut().copy_from_slice(image.pixels());
        // A transparent picture is usually put on paper.
        let dark = matches!(background, Background::Color(color) if luminance(color) <= BRIGHT);
        let (black, white) = ([0.0; 3], [1.0; 3]);
        let (ink, halo) = if dark { (white, black) } else { (black, white) };
        Ok(Self { image: copy, region, background, font: Font::new(), em, ink, halo })
    }

    pub(super) fn into_image(self) -> Image {
        self.image
    }

    /// Draws a shape in a colour that hides a share of the light behind it, its opacity.
    pub(super) fn fill(&mut self, path: &Path, color: [f64; 3], opacity: f64) {
        let Some(coverage) = path.coverage() else { return };
        let light = color.map(to_linear);
        let [width, height] = [self.region.width, self.region.height].map(i64::from);
        let offset = [self.region.x, self.region.y].map(i64::from);
        for (y, row) in (coverage.origin[1] - offset[1]..).zip(coverage.shares.chunks_exact(coverage.width)) {
            for (x, &share) in (coverage.origin[0] - offset[0]..).zip(row) {
                // Sums of f32 leave a rounding error outside the shape.
                if share > 1e-4 && (0..width).contains(&x) && (0..height).contains(&y) {
                    let pixel = &mut self.image.pixels_mut()[(y * width + x) as usize];
                    *pixel = blended(*pixel, self.background, light, opacity * f64::from(share));
                }
            }
        }
    }

    /// Draws a shape with a halo, visible on everything.
    pub(super) fn fill_with_halo(&mut self, path: &Path, color: [f64; 3]) {
        self.halo(path);
        self.fill(path, color, 1.0);
    }

    /// Draws the halo of a shape.
    pub(super) fn halo(&mut self, path: &Path) {
        self.fill(&path.outline((0.12 * self.em).max(1.2)), self.halo, HALO);
    }

    /// Draws a ground that makes letters and lines visible.
    pub(super) fn ground(&mut self, path: &Path) {
        self.fill(path, self.halo, 0.5);
    }

    /// Writes a line of text, `along` of its width to the left of `at` (0 to 1), the middle of its capitals at `at`.
    pub(super) fn write(&mut self, text: &str, size: f64, at: DVec2, along: f64) {
        let origin = at + DVec2::new(-along * self.font.width(text, size), 0.5 * self.font.capitals() * size);
        let path = self.font.text(text, size, origin);
        self.fill_with_halo(&path, self.ink);
    }
}

/// Covers a share of a pixel with light of a colour. Light adds up linearly, display values do not.
fn blended(pixel: [f32; 4], background: Background, light: [f64; 3], share: f64) -> [f32; 4] {
    let [r, g, b, alpha] = pixel.map(f64::from);
    let (premultiplied, alpha) = match background {
        Background::Transparent => ([r, g, b], alpha),
        Background::Color(behind) => (std::array::from_fn(|c| [r, g, b][c] + behind[c] * (1.0 - alpha)), 1.0),
    };
    let below = (1.0 - share) * alpha;
    let total = share + below;
    let channel = |c: usize| {
        let straight = if alpha > 0.0 { premultiplied[c] / alpha } else { 0.0 };
        from_linear((share * light[c] + below * to_linear(straight.clamp(0.0, 1.0))) / total) * total
    };
    [channel(0), channel(1), channel(2), total].map(|value| value as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_is_mixed_as_light() {
        let white = [1.0; 3];
        let half = blended([0.0; 4], Background::default(), white, 0.5);
        assert!((half[0] - 0.735_357).abs() < 1e-5 && half[3] == 1.0, "{half:?}");
        // Over nothing, the colour stays and the alpha is the share.
        let alone = blended([0.0; 4], Background::Transparent, white, 0.25);
        assert_eq!(alone, [0.25; 4]);
        // What covers a pixel replaces it; what covers none of it only adds the background.
        let pixel = [0.25, 0.125, 0.5, 0.5];
        for background in [Background::Transparent, Background::Color([0.2, 0.9, 0.4])] {
            let all = blended(pixel, background, [0.0, 1.0, 0.0], 1.0);
            assert!(all.iter().zip([0.0, 1.0, 0.0, 1.0]).all(|(a, b)| (a - b).abs() < 1e-6), "{all:?}");
            let none = blended(pixel, background, white, 0.0);
            let image = |pixel| Image::new(1, 1, vec![pixel]).unwrap().to_rgba8(background);
            assert!(image(none).iter().zip(image(pixel)).all(|(&a, b)| a.abs_diff(b) <= 1));
        }
    }
}
