//! Figures of sections beside a picture of the volume.

use glam::{DVec2, DVec3};

use super::canvas::Canvas;
use super::path::Path;
use super::{EM, Figure, LEAST_EM, LEAST_SIDE, MARGIN, Shown, axes, number, scale_bar};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::image::{Background, Ground, Image, Region, SectionPlane, section};
use crate::layers::Layers;

/// A figure of sections of a volume in panels, at one scale, beside a picture of the volume in the last panel.
///
/// A panel has the letters of the patient or the axes of the world, a scale bar, the place of its plane, and the lines
/// in which the other planes cut it. The picture has the outlines of the planes.
#[derive(Debug, Clone)]
pub struct Slices<'a> {
    /// The layers that planes cut.
    pub layers: &'a Layers,
    /// The look of the first layer in the sections.
    pub ground: Ground,
    /// The planes of the sections.
    pub planes: &'a [SectionPlane],
    /// Width and height of the figure, pixels.
    pub size: [u32; 2],
    /// The title and the caption around the panels; other parts of a figure belong on the picture.
    pub texts: &'a Figure,
}

/// The gap between panels, in sizes of letters of a figure of one panel.
const GAP: f64 = 0.2;
/// The room around the largest section in its panel, in sizes of its letters: for letters of the patient.
const ROOM: f64 = 2.4;
/// The opacity of lines in which other planes cut a section.
const LINES: f64 = 0.75;

impl Slices<'_> {
    /// Returns the panels of a figure of `planes` sections: a panel for each section, and one for the picture, as large
    /// as possible, row by row.
    ///
    /// # Errors
    /// [`Error::Setting`] if a panel would have a side below 128 pixels, or a text is too long.
    pub fn panels(size: [u32; 2], planes: usize, texts: &Figure) -> Result<Vec<Region>> {
        let places = texts.places(size)?;
        let count = planes as u32 + 1;
        let top = if texts.title.is_some() { places.area[0].y.ceil() as u32 } else { 0 };
        let end = if texts.caption.is_some() { (places.low - MARGIN * places.em).floor() as u32 } else { size[1] };
        let gap = (GAP * places.em).ceil() as u32;
        let [width, height] = [size[0], end.saturating_sub(top)];
        let sides = |columns: u32| {
            let rows = count.div_ceil(columns);
            let side = |length: u32, parts: u32| length.saturating_sub(gap * (parts - 1)) / parts;
            [side(width, columns), side(height, rows)]
        };
        // The fewest columns of the largest panels.
        let least = |columns: &u32| sides(*columns)[0].min(sides(*columns)[1]);
        let columns = (1..=count).rev().max_by_key(least).unwrap_or(1);
        let [across, down] = sides(columns);
        if across.min(down) < LEAST_SIDE {
            let reason = format!(
                "{}x{} pixels make {count} panels of {across}x{down}, expected sides of {LEAST_SIDE} or more: choose a \
                 larger picture, or fewer planes",
                size[0], size[1]
            );
            return Err(Error::setting("size", reason));
        }
        let place = |number| Region {
            x: number % columns * (across + gap),
            y: top + number / columns * (down + gap),
            width: across,
            height: down,
        };
        Ok((0..count).map(place).collect())
    }

    /// Draws the figure around a picture of the size of the last panel. `shown` is the content of the picture.
    ///
    /// # Errors
    /// [`Error::Image`] if the picture does not have the size of the last panel, and the errors of [`section`],
    /// [`Slices::panels`] and [`Figure::draw`].
    pub fn draw(&self, picture: &Image, background: Background, shown: &Shown<'_>) -> Result<Image> {
        let Self { layers, ground, planes, size, texts } = *self;
        let panels = Self::panels(size, planes.len(), texts)?;
        let last = panels[planes.len()];
        if [picture.width(), picture.height()] != [last.width, last.height] {
            let [a, b, c, d] = [picture.width(), picture.height(), last.width, last.height];
            return Err(Error::Image(format!("{a} x {b} pixels are not those of a panel of {c} x {d}")));
        }
        let em = (EM * f64::from(last.width.min(last.height))).max(LEAST_EM);
        let grid = layers.grid();
        // All sections have the scale of the one that needs the most room.
        let needed = planes.iter().map(|plane| {
            let camera = plane.camera(grid, 1.0, [last.width, last.height])?;
            let reach = |axis: DVec3| {
                grid.corners_from_center(0.5).map(|corner| 2.0 * corner.dot(axis)).into_iter().fold(0.0, f64::max)
            };
            let room = |pixels: u32| f64::from(pixels) - 2.0 * ROOM * em;
            Ok((reach(camera.right) / room(last.width)).max(reach(camera.up) / room(last.height)))
        });
        let pixel = needed.collect::<Result<Vec<f64>>>()?.into_iter().fold(0.0, f64::max);
        let cameras = planes.iter().map(|plane| plane.camera(grid, pixel, [last.width, last.height]));
        let cameras = cameras.collect::<Result<Vec<Camera>>>()?;
        let mut image = Image::transparent(size[0], size[1])?;
        for (camera, panel) in cameras.iter().zip(&panels) {
            paste(&mut image, &section(layers, camera, ground)?, *panel);
        }
        paste(&mut image, picture, last);
        let whole = Region { x: 0, y: 0, width: size[0], height: size[1] };
        let mut canvas = Canvas::new(&image, whole, background, em)?;
        for (number, (camera, panel)) in cameras.iter().zip(&panels).enumerate() {
            let corner = DVec2::new(f64::from(panel.x), f64::from(panel.y));
            let span = DVec2::new(f64::from(panel.width), f64::from(panel.height));
            for (other, plane) in planes.iter().enumerate().filter(|(other, _)| *other != number) {
                if let Some(ends) = cut(plane, camera, pixel, span) {
                    let line = Path::line(&ends.map(|end| corner + end), (0.08 * em).max(1.0));
                    canvas.fill(&line, color(&planes[other]), LINES);
                }
            }
            for end in axes::ends(camera, shown.volume.is_oriented()) {
                if let Some(name) = end.name.filter(|_| end.place.length() > 0.7) {
                    let out = (span / 2.0 - 0.9 * em) * DVec2::new(end.place.x, -end.place.y);
                    canvas.write(name, em, corner + span / 2.0 + out, 0.5);
                }
            }
            let of_panel = Shown { camera, ..*shown };
            let foot = corner + span - DVec2::splat(MARGIN * em);
            scale_bar::draw(&mut canvas, &of_panel, foot, 0.28 * span.x)?;
            let text = place(&planes[number], shown, pixel);
            // Below the letter in the middle, if there is no room beside it.
            let is_wide = canvas.font.width(&text, em) > span.x / 2.0 - 2.0 * em;
            let top = if is_wide { 2.4 } else { 1.1 };
            canvas.write(&text, em, corner + DVec2::new(MARGIN, top) * em, 0.0);
        }
        let corner = DVec2::new(f64::from(last.x), f64::from(last.y));
        for plane in planes {
            // Outlines that reach behind the eye are left out.
            let corners: Vec<DVec3> = plane.outline(grid).into_iter().map(|place| shown.camera.seen(place)).collect();
            if shown.camera.eye().is_some() && corners.iter().any(|seen| seen.z <= 0.0) {
                continue;
            }
            let span = DVec2::new(f64::from(last.width), f64::from(last.height));
            for (number, end) in corners.iter().enumerate() {
                let ends = [corners[(number + 1) % corners.len()], *end].map(|seen| shown.camera.pixel_of(seen));
                if let Some(ends) = clipped(ends, span) {
                    let line = Path::line(&ends.map(|end| corner + end), (0.08 * em).max(1.0));
                    canvas.fill(&line, color(plane), LINES);
                }
            }
        }
        let camera = Camera { size, ..*shown.camera };
        texts.draw(&canvas.into_image(), background, &Shown { camera: &camera, ..*shown })
    }
}

/// Copies a picture into a region of another.
pub(super) fn paste(image: &mut Image, part: &Image, to: Region) {
    let width = image.width() as usize;
    for (row, pixels) in part.pixels().chunks_exact(to.width as usize).enumerate() {
        let start = (to.y as usize + row) * width + to.x as usize;
        image.pixels_mut()[start..start + pixels.len()].copy_from_slice(pixels);
    }
}

/// Returns the colour of a plane's lines: of the axis across it.
fn color(plane: &SectionPlane) -> [f64; 3] {
    axes::COLORS[plane.forward.abs().max_position()]
}

/// Returns the name and the place of a plane: where it cuts the axis across it.
fn place(plane: &SectionPlane, shown: &Shown<'_>, pixel: f64) -> String {
    let axis = plane.forward.abs().max_position();
    let value = plane.point.dot(plane.forward) / plane.forward[axis];
    let value = number::label(value, number::round_below(pixel.min(shown.volume.grid().min_spacing() / 2.0)));
    let unit = shown.volume.length_unit().map(|unit| format!(" {unit}")).unwrap_or_default();
    format!("{}  {} = {value}{unit}", plane.name, ["x", "y", "z"][axis]).trim_start().to_owned()
}

/// Returns the ends of the line in which a plane cuts a section, in pixels of its panel; `None` if it does not.
fn cut(plane: &SectionPlane, camera: &Camera, pixel: f64, span: DVec2) -> Option<[DVec2; 2]> {
    let normal = DVec2::new(plane.forward.dot(camera.right), -plane.forward.dot(camera.up));
    let distance = plane.forward.dot(plane.point - camera.target) / pixel;
    if normal.length() < 1e-6 * plane.forward.length() {
        return None;
    }
    let nearest = span / 2.0 + normal * (distance / normal.length_squared());
    let along = normal.perp().normalize() * (nearest.length() + span.length());
    clipped([nearest - along, nearest + along], span)
}

/// Returns the part of a line in a panel (Liang and Barsky 1984, "A new concept and method for line clipping").
fn clipped([from, to]: [DVec2; 2], span: DVec2) -> Option<[DVec2; 2]> {
    let step = to - from;
    let (mut first, mut last) = (0.0_f64, 1.0_f64);
    for (slope, room) in [(-step.x, from.x), (step.x, span.x - from.x), (-step.y, from.y), (step.y, span.y - from.y)] {
        match slope {
            0.0 if room < 0.0 => return None,
            0.0 => {}
            slope if slope < 0.0 => first = first.max(room / slope),
            slope => last = last.min(room / slope),
        }
    }
    (first < last).then(|| [from + first * step, from + last * step])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panels_fill_a_figure_and_do_not_overlap() {
        let title = Figure { title: Some("A title".to_owned()), ..Figure::default() };
        for (size, planes, columns) in
            [([1024, 1024], 3, 2), ([1600, 400], 3, 4), ([800, 400], 1, 2), ([400, 1600], 3, 1)]
        {
            for texts in [&Figure::default(), &title] {
                let panels = Slices::panels(size, planes, texts).unwrap();
                assert_eq!(panels.len(), planes + 1);
                assert_eq!(panels.iter().filter(|panel| panel.y == panels[0].y).count(), columns);
                panels.iter().for_each(|panel| panel.check_within(size).unwrap());
                let overlaps = |a: &Region| panels.iter().filter(|b| a.and(**b).is_some()).count();
                assert!(panels.iter().all(|panel| overlaps(panel) == 1));
                assert!(texts.title.is_none() || panels[0].y > 20);
            }
        }
        let refused = Slices::panels([300, 200], 3, &Figure::default()).unwrap_err().to_string();
        assert!(refused.contains("4 panels of") && refused.contains("128"), "{refused}");
    }

    #[test]
    fn lines_end_at_their_panel() {
        let span = DVec2::new(10.0, 6.0);
        let line =
            |a: [f64; 2], b: [f64; 2]| clipped([a.into(), b.into()], span).map(|ends| ends.map(|e| e.to_array()));
        assert_eq!(line([-5.0, 3.0], [15.0, 3.0]), Some([[0.0, 3.0], [10.0, 3.0]]));
        assert_eq!(line([5.0, 1.0], [5.0, 16.0]), Some([[5.0, 1.0], [5.0, 6.0]]));
        assert_eq!(line([-5.0, 7.0], [15.0, 7.0]), None);
        assert_eq!(line([-1.0, 1.0], [1.0, -1.0]), None);
    }
}
