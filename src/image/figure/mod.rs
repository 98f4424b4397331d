//! Figures: a scale bar, axes, a colour bar, a legend, a title and a caption on a picture.
//!
//! They are drawn on the finished picture, in Open Sans, and scale with the shorter side of the picture. They are white
//! on a dark background, otherwise black, with a halo that keeps them legible in front of the volume.
//!
//! ```no_run
//! use voxsplat::figure::{Figure, Shown};
//! # use voxsplat::{Background, Camera, Frame, Renderer, RendererOptions, Settings, TransferFunction, View, load};
//! # fn main() -> voxsplat::Result<()> {
//! # let volume = load("scan.nii.gz", &Default::default())?;
//! # let transfer = TransferFunction::preset("ct-bone", &volume)?;
//! # let settings = Settings::default();
//! # let renderer = Renderer::new(&RendererOptions::default())?;
//! # let scene = renderer.prepare(&volume, &transfer, &settings)?;
//! # let camera = Camera::new(&View::default(), volume.grid(), [512, 512])?;
//! let rendered = renderer.render(&scene, &Frame::new(&camera, &settings))?;
//! let figure = Figure { scale_bar: true, axes: true, title: Some("A head".to_owned()), ..Figure::default() };
//! let shown = Shown { volume: &volume, transfer: &transfer, values: None, camera: &camera, model: settings.model };
//! let background = Background::default();
//! figure.draw(&rendered.image, background, &shown)?.save("figure.png", background)?;
//! # Ok(())
//! # }
//! ```

mod axes;
mod canvas;
mod color_bar;
mod font;
mod legend;
mod number;
mod path;
mod scale_bar;
mod sheet;
mod slices;

use glam::DVec2;

use self::canvas::Canvas;
use self::font::Font;
pub use self::sheet::ContactSheet;
pub use self::slices::Slices;
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::image::{Background, Image, Region};
pub use crate::layers::LegendEntry;
use crate::settings::Model;
use crate::transfer::TransferFunction;
use crate::volume::Volume;

/// Annotations to be drawn on a picture; none by default.
///
/// End a literal with `..Figure::default()`: a minor release may add fields.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Figure {
    /// A bar of a round length (1, 2 or 5 times a power of ten) at the lower right, in the unit of
    /// [`Volume::length_unit`], otherwise in voxels if they are 1 apart, or in units. With parallel rays it is true
    /// everywhere; in perspective it is true at the depth of the camera's target, and labelled "at the centre".
    pub scale_bar: bool,
    /// The axes of the world at the lower left, as seen at the centre. If [`Volume::is_oriented`], letters name the
    /// sides of the patient: right and left, anterior and posterior, superior and inferior. Otherwise they are X, Y and
    /// Z.
    pub axes: bool,
    /// The colours of the transfer function over its visible values in the data, at the right, with a curve of its
    /// opacity (of a slab one unit distance thick) and the unit of the values, if it is known. Colours are unlit.
    /// X-rays have no colour bar.
    pub color_bar: bool,
    /// Patches of colour with the names of labels or channels at the upper left (see
    /// [`Layers::legend`](crate::layers::Layers::legend)), in columns over at most half of the picture. If there is no
    /// room for all, the last line counts the missing entries. Colours are unlit. X-rays have no legend.
    pub legend: Vec<LegendEntry>,
    /// The text above the picture, in at most 3 lines.
    pub title: Option<String>,
    /// The text below the picture, in at most 6 lines.
    pub caption: Option<String>,
    /// Makes literals that name all fields impossible.
    #[doc(hidden)]
    pub non_exhaustive: (),
}

/// The content of the picture that a figure annotates.
#[derive(Debug, Clone, Copy)]
pub struct Shown<'a> {
    /// The volume of the picture.
    pub volume: &'a Volume,
    /// The transfer function of the volume.
    pub transfer: &'a TransferFunction,
    /// The least and the largest value of the data ([`Volume::value_range`]), beyond which a colour bar does not reach;
    /// `None`: the bar spans the transfer function.
    pub values: Option<[f64; 2]>,
    /// The camera of the whole picture.
    pub camera: &'a Camera,
    /// The model of a pixel.
    pub model: Model,
}

/// The shortest side of a picture with room for letters, pixels.
const LEAST_SIDE: u32 = 128;
/// The size of letters, as a share of the shorter side: 8 points in a picture 8 cm high.
const EM: f64 = 0.035;
/// The smallest legible size of letters, pixels.
const LEAST_EM: f64 = 11.0;
/// The space between the edge of the picture and a figure, in sizes of letters.
const MARGIN: f64 = 0.8;
/// The least height of a colour bar, in sizes of letters.
const LEAST_BAR: f64 = 3.0;
/// The largest number of characters of a unit.
const LONGEST_UNIT: usize = 16;
/// The largest share of a picture that is reserved on a side.
const MOST_RESERVED: f64 = 1.0 / 3.0;
/// The distance of lines of text, in sizes of letters.
const LINE: f64 = 1.3;

/// The reason to refuse a part of a figure that does not fit.
const NO_ROOM: &str = "there is no room for it: choose a larger picture, or shorter texts";

/// The title or the caption, broken into lines.
struct Text {
    lines: Vec<String>,
    /// The size of letters, pixels.
    size: f64,
}

impl Text {
    /// Breaks a text into at most `most` lines of at most `width` pixels.
    fn new(
        font: &Font,
        name: &'static str,
        text: Option<&str>,
        size: f64,
        (most, width): (usize, f64),
    ) -> Result<Self> {
        let refused = |reason: String| Err(Error::setting(name, reason));
        let text = text.unwrap_or_default();
        if let Some(c) = text.chars().find(|&c| c.is_control() && c != '\n') {
            return refused(format!("it has the control character {c:?}"));
        }
        if let Some(c) = font.lacks(text) {
            return refused(format!("the font has no {c:?}: it has Latin, Greek and Cyrillic letters"));
        }
        let lines = font.lines(text, size, width);
        if lines.len() > most || lines.iter().any(|line| font.width(line, size) > width) {
            return refused(format!("it is too long: expected words that fit into {most} lines of the picture"));
        }
        Ok(Self { lines, size })
    }

    fn height(&self) -> f64 {
        self.lines.len() as f64 * LINE * self.size
    }

    /// Writes the lines in the middle of a width, the first below `top`.
    fn write(&self, canvas: &mut Canvas, width: f64, top: f64) {
        for (i, line) in self.lines.iter().enumerate() {
            let y = top + (i as f64 + 0.5) * LINE * self.size;
            canvas.write(line, self.size, DVec2::new(width / 2.0, y), 0.5);
        }
    }
}

/// The places of the parts of a figure, pixels.
struct Places {
    font: Font,
    /// The size of letters, pixels.
    em: f64,
    /// Width and height of the picture.
    size: [f64; 2],
    title: Text,
    caption: Text,
    /// The bottom of the area above the caption.
    low: f64,
    /// The corners of the area between the title, the caption, the scale bar and the margins.
    area: [DVec2; 2],
}

impl Figure {
    /// Returns whether the figure has nothing to draw.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Refuses a figure that cannot be drawn on a picture of a size (width, height) and a model.
    ///
    /// # Errors
    /// [`Error::Setting`] if a text is too long or has a character that the font lacks, if a side of the picture is
    /// under 128 pixels, or if there is no room for a colour bar or a legend, or the picture is an X-ray.
    pub fn validate(&self, size: [u32; 2], model: Model) -> Result<()> {
        if self.is_empty() {
            return Ok(());
        }
        if size.into_iter().any(|side| side < LEAST_SIDE) {
            let [width, height] = size;
            let reason = format!("{width}x{height} pixels, expected sides of {LEAST_SIDE} or more for a figure");
            return Err(Error::setting("size", reason));
        }
        let has_legend = !self.legend.is_empty();
        for (name, drawn, verb) in [("color_bar", self.color_bar, "show"), ("legend", has_legend, "name")] {
            if drawn && model == Model::Xray {
                return Err(Error::setting(name, format!("an X-ray is white: it has no colours to {verb}")));
            }
        }
        let places = self.places(size)?;
        if has_legend {
            let [least, most] = self.legend_area(&places);
            legend::check(&places.font, &self.legend, places.em, (most - least).to_array())?;
        }
        let [least, most] = places.area;
        if self.color_bar && color_bar::room(most.y - least.y, places.em) < LEAST_BAR * places.em {
            return Err(Error::setting("color_bar", NO_ROOM));
        }
        Ok(())
    }

    fn places(&self, size: [u32; 2]) -> Result<Places> {
        let font = Font::new();
        let size = size.map(f64::from);
        let [width, height] = size;
        let em = (EM * width.min(height)).max(LEAST_EM);
        let margin = MARGIN * em;
        let wide = width - 2.0 * margin;
        let title = Text::new(&font, "title", self.title.as_deref(), 1.25 * em, (3, wide))?;
        let caption = Text::new(&font, "caption", self.caption.as_deref(), 0.9 * em, (6, wide))?;
        let low = height - margin - caption.height();
        let bar = if self.scale_bar { scale_bar::height(em) } else { 0.0 };
        let area = [DVec2::new(margin, margin + title.height()), DVec2::new(width - margin, low - bar)];
        Ok(Places { font, em, size, title, caption, low, area })
    }

    /// Returns the area of a legend: left of a colour bar, and above axes.
    fn legend_area(&self, places: &Places) -> [DVec2; 2] {
        let [least, most] = places.area;
        let right = places.size[0] * if self.color_bar { 0.6 } else { 1.0 } - MARGIN * places.em;
        let foot = if self.axes { most.y - axes::room(places.em) } else { most.y };
        [least, DVec2::new(right, foot)]
    }

    /// Returns the shares of a picture of a size (width, height) at its left, right, top and bottom that the colour bar
    /// of a transfer function over values ([`Shown::values`]), the title and the caption take: with them as
    /// [`View::reserved`](crate::camera::View::reserved) the volume lies beside the figure. At most a third of the
    /// picture on a side, because the rest would be too small. Scale bar and axes are drawn in corners.
    ///
    /// # Errors
    /// [`Error::Setting`] as [`Self::validate`] if a text is too long, or if a colour bar has no range.
    pub fn reserved(&self, size: [u32; 2], transfer: &TransferFunction, values: Option<[f64; 2]>) -> Result<[f64; 4]> {
        let Places { font, em, size: [width, height], title, caption, area, .. } = self.places(size)?;
        let mut right = 0.0;
        if self.color_bar {
            right =
                (width - color_bar::left_end(&font, color_bar::Values { transfer, data: values }, em, area)?) / width;
        }
        let [title, caption] = [title, caption].map(|text| match text.lines.as_slice() {
            [] => 0.0,
            _ => (MARGIN * em + text.height()) / height,
        });
        Ok([0.0, right, title, caption].map(|share: f64| share.min(MOST_RESERVED)))
    }

    /// Draws the figure on a copy of a picture. If the background is a colour, the figure is opaque: save the copy over
    /// the same background.
    ///
    /// # Errors
    /// The errors of [`Self::validate`]; [`Error::Setting`] if a unit has over 16 characters or a character that the
    /// font lacks, if a scale bar has no length because the camera's target is not in front of its eye, or a colour bar
    /// no range because the transfer function has one value; [`Error::Image`] if the picture does not have the camera's
    /// size; [`Error::Memory`] if there is no memory for the copy.
    pub fn draw(&self, image: &Image, background: Background, shown: &Shown<'_>) -> Result<Image> {
        let [width, height] = shown.camera.size;
        self.draw_region(image, Region { x: 0, y: 0, width, height }, background, shown)
    }

    /// Draws the part of the figure on the picture of a [`Frame::region`](crate::Frame::region): the same bytes as in
    /// the whole picture.
    ///
    /// # Errors
    /// The errors of [`Self::draw`], and [`Error::Setting`] if the region reaches beyond the picture.
    pub fn draw_region(
        &self,
        image: &Image,
        region: Region,
        background: Background,
        shown: &Shown<'_>,
    ) -> Result<Image> {
        let size = shown.camera.size;
        self.validate(size, shown.model)?;
        region.check_within(size)?;
        if [image.width(), image.height()] != [region.width, region.height] {
            let [a, b, c, d] = [image.width(), image.height(), region.width, region.height];
            return Err(Error::Image(format!("{a} x {b} pixels are not those of a region of {c} x {d}")));
        }
        let places = self.places(size)?;
        let Places { font, em, size: [width, _], title, caption, low, area } = &places;
        let units = [("length_unit", shown.volume.length_unit()), ("value_unit", shown.volume.value_unit())];
        for (name, unit) in units {
            let Some(unit) = unit else { continue };
            if unit.chars().count() > LONGEST_UNIT || font.lacks(unit).is_some() {
                let reason = format!("{unit:?}, expected up to {LONGEST_UNIT} Latin, Greek or Cyrillic letters");
                return Err(Error::setting(name, reason));
            }
        }
        let mut canvas = Canvas::new(image, region, background, *em)?;
        let [left, right] = [area[0].x, area[1].x];
        title.write(&mut canvas, *width, MARGIN * em);
        caption.write(&mut canvas, *width, *low);
        if self.axes {
            axes::draw(&mut canvas, shown.camera, shown.volume.is_oriented(), DVec2::new(left, *low));
        }
        if self.scale_bar {
            scale_bar::draw(&mut canvas, shown, DVec2::new(right, *low), 0.28 * width)?;
        }
        if !self.legend.is_empty() {
            legend::draw(&mut canvas, &self.legend, self.legend_area(&places));
        }
        if self.color_bar {
            let values = color_bar::Values { transfer: shown.transfer, data: shown.values };
            color_bar::draw(&mut canvas, values, shown.volume.value_unit(), *area)?;
        }
        Ok(canvas.into_image())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{ProjectionKind, View};
    use crate::transfer::ControlPoint;
    use crate::volume::Units;

    const WHOLE: Region = Region { x: 0, y: 0, width: 320, height: 200 };

    fn volume() -> Volume {
        let volume = Volume::from_slice([2; 3], [3.0; 3], &[0_u8; 8]).unwrap();
        volume.with_units(Units { length: Some("mm".to_owned()), value: Some("HU".to_owned()) })
    }

    fn transfer() -> TransferFunction {
        let point = |value, opacity| ControlPoint { value, color: [1.0, f64::max(value, 0.0) / 200.0, 0.0], opacity };
        TransferFunction::new(vec![point(-100.0, 0.0), point(0.0, 0.0), point(200.0, 0.8)], None).unwrap()
    }

    fn everything() -> Figure {
        let (title, caption) = (Some("A title".to_owned()), Some("Two\nlines".to_owned()));
        let legend = vec![LegendEntry { name: "bone".to_owned(), color: [240, 230, 200] }];
        Figure { scale_bar: true, axes: true, color_bar: true, legend, title, caption, ..Figure::default() }
    }

    /// Draws a figure on a grey picture.
    fn drawn(figure: &Figure, view: &View, background: Background, region: Region) -> Result<Image> {
        let (volume, transfer) = (volume(), transfer());
        let camera = Camera::new(view, volume.grid(), [WHOLE.width, WHOLE.height])?;
        let shown =
            Shown { volume: &volume, transfer: &transfer, values: None, camera: &camera, model: Model::Composite };
        let pixels = vec![[0.3, 0.3, 0.3, 0.6]; region.area() as usize];
        figure.draw_region(&Image::new(region.width, region.height, pixels)?, region, background, &shown)
    }

    #[test]
    fn by_default_nothing_is_drawn() {
        for background in [Background::default(), Background::Transparent] {
            let image = drawn(&Figure::default(), &View::default(), background, WHOLE).unwrap();
            assert!(image.pixels().iter().all(|&pixel| pixel == [0.3, 0.3, 0.3, 0.6]));
        }
    }

    #[test]
    fn a_scale_bar_is_as_long_as_it_says() {
        let perspective = ProjectionKind::Perspective { fov: 40.0 };
        let figure = Figure { scale_bar: true, ..Figure::default() };
        for (projection, height, text) in
            [(ProjectionKind::Orthographic, 37.0, "10 mm"), (perspective, 61.7, "20 mm at the centre")]
        {
            let view = View { projection, view_height: Some(height), ..View::default() };
            let (volume, transfer) = (volume(), transfer());
            let camera = Camera::new(&view, volume.grid(), [320, 200]).unwrap();
            let shown =
                Shown { volume: &volume, transfer: &transfer, values: None, camera: &camera, model: Model::Mip };
            let bar = scale_bar::Bar::new(&shown, 0.28 * 320.0).unwrap();
            let length: f64 = text.split(' ').next().unwrap().parse().unwrap();
            assert_eq!(bar.text, text);
            assert!((bar.pixels - length * 200.0 / height).abs() < 1e-9);
            // White on black, in the lowest row that has any: as light adds up.
            let image = Image::transparent(320, 200).unwrap();
            let image = figure.draw(&image, Background::default(), &shown).unwrap();
            let lengths = image.pixels().chunks_exact(320).rev();
            let mut lengths =
                lengths.map(|row| row.iter().map(|p| crate::transfer::color::to_linear(p[0].into())).sum::<f64>());
            let found = lengths.find(|&length| length > 1.0).unwrap();
            assert!((found - bar.pixels).abs() < 0.01, "{found} {}", bar.pixels);
        }
    }

    #[test]
    fn a_region_of_a_figure_is_that_part_of_the_whole() {
        let view = View { azimuth: 30.0, elevation: 20.0, ..View::default() };
        for background in [Background::default(), Background::Transparent] {
            let whole = drawn(&everything(), &view, background, WHOLE).unwrap();
            for region in WHOLE.parts(77) {
                let part = drawn(&everything(), &view, background, region).unwrap();
                for (row, pixels) in part.pixels().chunks_exact(region.width as usize).enumerate() {
                    let start = (region.y as usize + row) * 320 + region.x as usize;
                    assert_eq!(pixels, &whole.pixels()[start..start + pixels.len()], "{region:?} {row}");
                }
            }
        }
    }

    #[test]
    fn what_is_drawn_beside_a_picture_lies_in_what_is_reserved() {
        let title = Some("A title of some words".to_owned());
        for (color_bar, title, caption) in
            [(true, None, None), (false, title.clone(), None), (true, title, Some("Two\nlines".to_owned()))]
        {
            let figure = Figure { color_bar, title, caption, ..Figure::default() };
            let image = drawn(&figure, &View::default(), Background::default(), WHOLE).unwrap();
            let reserved = figure.reserved([WHOLE.width, WHOLE.height], &transfer(), None).unwrap();
            let [left, right, top, bottom] = reserved;
            for (index, pixel) in image.pixels().iter().enumerate() {
                let (x, y) = ((index % 320) as f64 / 320.0, (index / 320) as f64 / 200.0);
                let free = x >= left && x + 1.0 / 320.0 <= 1.0 - right && y >= top && y + 1.0 / 200.0 <= 1.0 - bottom;
                assert!(!free || *pixel == [0.3, 0.3, 0.3, 0.6], "{x} {y} {reserved:?}");
            }
            assert!(reserved.iter().all(|part| (0.0..=MOST_RESERVED).contains(part)) && reserved != [0.0; 4]);
        }
        assert_eq!(Figure::default().reserved([320, 200], &transfer(), None).unwrap(), [0.0; 4]);
    }

    #[test]
    fn figures_show_on_every_background() {
        for color in [[0.0; 3], [1.0; 3], [0.5; 3], [1.0, 1.0, 0.0], [0.0, 0.0, 0.7]] {
            let figure = Figure { title: Some("H".to_owned()), ..Figure::default() };
            let image = drawn(&figure, &View::default(), Background::Color(color), WHOLE).unwrap();
            let bytes = image.to_rgba8(Background::Color(color));
            let luminance =
                |p: &[u8]| crate::transfer::color::luminance([p[0], p[1], p[2]].map(|byte| f64::from(byte) / 255.0));
            let (dark, bright) = bytes
                .chunks_exact(4)
                .map(luminance)
                .fold((1.0_f64, 0.0_f64), |(dark, bright), l| (dark.min(l), bright.max(l)));
            // Letters and their halo; WCAG asks for a contrast of 4.5 for text.
            assert!((bright + 0.05) / (dark + 0.05) > 4.5, "{color:?}: {dark} {bright}");
        }
    }

    #[test]
    fn what_cannot_be_drawn_is_refused() {
        let refused = |figure: Figure, size, model| figure.validate(size, model).unwrap_err().to_string();
        let title = |text: &str| Figure { title: Some(text.to_owned()), ..Figure::default() };
        let composite = Model::Composite;
        assert!(refused(title("a"), [127, 512], composite).contains("127x512 pixels, expected sides of 128"));
        assert!(refused(title("骨"), [512; 2], composite).contains("the font has no '骨'"));
        assert!(refused(title("a\u{7}"), [512; 2], composite).contains("control character"));
        assert!(refused(title(&"word ".repeat(99)), [512; 2], composite).contains("title: it is too long"));
        assert!(refused(title(&"w".repeat(99)), [512; 2], composite).contains("too long"));
        assert!(refused(everything(), [512; 2], Model::Xray).contains("an X-ray is white"));
        let legend = Figure { color_bar: false, ..everything() };
        assert!(refused(legend.clone(), [512; 2], Model::Xray).contains("legend: an X-ray is white"));
        assert!(refused(Figure { axes: true, ..legend }, [128; 2], composite).contains("legend: there is no room"));
        assert!(refused(everything(), [128; 2], composite).contains("no room"));
        assert!(everything().validate([160; 2], composite).is_ok());
        assert!(Figure { scale_bar: true, color_bar: true, ..Figure::default() }.validate([128; 2], composite).is_ok());
        let behind = View { projection: ProjectionKind::Perspective { fov: 30.0 }, ..View::default() };
        let volume = volume();
        let mut camera = Camera::new(&behind, volume.grid(), [320, 200]).unwrap();
        if let crate::camera::Projection::Perspective { distance, .. } = &mut camera.projection {
            *distance = -1.0;
        }
        let shown = Shown { volume: &volume, transfer: &transfer(), values: None, camera: &camera, model: composite };
        let image = Image::transparent(320, 200).unwrap();
        let error = everything().draw(&image, Background::default(), &shown).unwrap_err();
        assert!(error.to_string().contains("not in front of the eye"), "{error}");
        let unit = volume.clone().with_units(Units { value: Some("骨".to_owned()), ..Units::default() });
        let error = everything().draw(&image, Background::default(), &Shown { volume: &unit, ..shown }).unwrap_err();
        assert!(error.to_string().contains("value_unit"), "{error}");
        let small = Image::transparent(32, 20).unwrap();
        let error = everything().draw(&small, Background::default(), &shown).unwrap_err().to_string();
        assert!(error.contains("32 x 20 pixels are not those of a region of 320 x 200"), "{error}");
    }
}
