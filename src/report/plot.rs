//! Plots of speed against error.

use plotters::coord::Shift;
use plotters::element::{Drawable, PointCollection};
use plotters::prelude::*;
use plotters::style::ShapeStyle;
use plotters_backend::DrawingErrorKind;

use crate::error::{Error, Result};

/// A way to make a picture, in a plot of speed against error.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// The legend's name of what it belongs to. Each series has a colour.
    pub series: String,
    /// What is written beside it.
    pub label: Option<String>,
    /// Seconds of a frame, over 0.
    pub seconds: f64,
    /// How far off it is. 0 is shown at the lower edge.
    pub error: f64,
    /// Whether it is on the front of its series, which a line joins.
    pub front: bool,
    /// Its shape.
    pub marker: Marker,
}

/// The shape of a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Marker {
    /// A disc.
    Disc,
    /// A triangle.
    Triangle,
    /// A square.
    Square,
}

const SIZE: (u32, u32) = (960, 640);
const FONT: &str = "sans-serif";
/// Okabe and Ito's colours, which people tell apart whatever colours they see (2008, "Color universal design").
const COLORS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(230, 159, 0),
    RGBColor(0, 158, 115),
    RGBColor(213, 94, 0),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(90, 90, 90),
];
const INK: RGBColor = RGBColor(40, 40, 40);
/// Room at the left and right of the title and the legend, pixels.
const EDGE: i32 = 24;
const TITLE_HEIGHT: i32 = 48;
const LEGEND_ROW: i32 = 22;
const LEGEND_COLUMNS: usize = 2;

/// The colour of a series.
fn color(index: usize) -> RGBColor {
    COLORS[index % COLORS.len()]
}

/// An SVG picture of points: seconds of a frame to the right, errors upwards, both in powers of ten. Points on the
/// front of their series are solid and joined, others are pale.
///
/// # Errors
/// [`Error::Image`] if there is no point with finite numbers and a time over 0.
pub fn plot(title: &str, error_name: &str, points: &[Point]) -> Result<String> {
    let shown: Vec<&Point> =
        points.iter().filter(|p| p.seconds > 0.0 && p.seconds.is_finite() && p.error.is_finite()).collect();
    let Some(x) = range(shown.iter().map(|p| p.seconds)) else {
        return Err(Error::Image("nothing was timed: there is no plot".to_owned()));
    };
    let y = range(shown.iter().map(|p| p.error)).unwrap_or([1e-6, 1.0]);
    let mut svg = String::new();
    draw(&SVGBackend::with_string(&mut svg, SIZE).into_drawing_area(), title, error_name, &shown, [x, y])
        .map_err(|e| Error::Image(format!("the plot cannot be drawn: {e}")))?;
    Ok(svg)
}

/// The range of the numbers over 0, with room around; `None` if there are none.
fn range(numbers: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    let over_0 = numbers.filter(|&n| n > 0.0);
    let [low, high] = over_0.fold([f64::INFINITY, 0.0], |[low, high], n| [low.min(n), high.max(n)]);
    (high > 0.0).then(|| [low / 1.6, high * 1.6])
}

type Drawn<'a> = std::result::Result<(), Box<dyn std::error::Error + 'a>>;

fn draw<'a>(
    area: &DrawingArea<SVGBackend<'a>, Shift>,
    title: &str,
    error_name: &str,
    points: &[&Point],
    [x, y]: [[f64; 2]; 2],
) -> Drawn<'a> {
    area.fill(&WHITE)?;
    let mut names: Vec<&str> = Vec::new();
    for point in points {
        if !names.contains(&point.series.as_str()) {
            names.push(&point.series);
        }
    }
    let text = |size: u32| (FONT, size).into_font().color(&INK);
    let rows = names.len().div_ceil(LEGEND_COLUMNS) as i32;
    let (above, chart_area) = area.split_vertically(TITLE_HEIGHT + LEGEND_ROW * rows);
    above.draw(&Text::new(title, (EDGE, 12), text(20)))?;
    for (index, name) in names.iter().enumerate() {
        let (column, row) = ((index % LEGEND_COLUMNS) as i32, (index / LEGEND_COLUMNS) as i32);
        let (x, y) =
            (EDGE + column * (SIZE.0 as i32 - 2 * EDGE) / LEGEND_COLUMNS as i32, TITLE_HEIGHT + LEGEND_ROW * row);
        let shape = points.iter().find(|point| point.series == *name).map_or(Marker::Disc, |point| point.marker);
        above.draw(&Mark { at: (x + 6, y + 7), shape, size: 5, style: color(index).filled() })?;
        above.draw(&Text::new(*name, (x + 20, y), text(14)))?;
    }
    let mut chart = ChartBuilder::on(&chart_area)
        .margin(12)
        .margin_right(24)
        .x_label_area_size(44)
        .y_label_area_size(74)
        .build_cartesian_2d((x[0]..x[1]).log_scale(), (y[0]..y[1]).log_scale())?;
    chart
        .configure_mesh()
        .bold_line_style(RGBColor(205, 205, 205))
        .light_line_style(RGBColor(238, 238, 238))
        .axis_style(INK)
        .x_desc("seconds of a frame")
        .y_desc(error_name)
        .x_label_formatter(&|seconds| power_of_ten(*seconds))
        .y_label_formatter(&|error| power_of_ten(*error))
        .axis_desc_style(text(15))
        .label_style(text(13))
        .draw()?;
    let place = |point: &Point| (point.seconds, point.error.max(y[0]));
    for (index, name) in names.iter().enumerate() {
        let of_series = || points.iter().filter(|point| point.series == *name);
        let mut front: Vec<(f64, f64)> = of_series().filter(|p| p.front).map(|p| place(p)).collect();
        front.sort_by(|a, b| a.0.total_cmp(&b.0));
        // What is not slower than a point can have its error: the front is a staircase.
        let steps = front.windows(2).flat_map(|w| [w[0], (w[1].0, w[0].1)]).chain(front.last().copied());
        let steps: Vec<(f64, f64)> = steps.collect();
        chart.draw_series([PathElement::new(steps, color(index).mix(0.6).stroke_width(1))])?;
        chart.draw_series(of_series().map(|point| {
            let style = if point.front { color(index).filled() } else { color(index).mix(0.4).filled() };
            Mark { at: place(point), shape: point.marker, size: if point.front { 6 } else { 4 }, style }
        }))?;
    }
    let label = |point: &&Point| {
        let words = point.label.clone().unwrap_or_default();
        EmptyElement::at(place(point)) + Text::new(words, (8, -16), text(13))
    };
    chart.draw_series(points.iter().filter(|point| point.label.is_some()).map(label))?;
    area.present()?;
    Ok(())
}

/// A marker around a place of the chart, or of the picture.
struct Mark<Place> {
    at: Place,
    shape: Marker,
    size: i32,
    style: ShapeStyle,
}

impl<'a, Place: 'a> PointCollection<'a, Place> for &'a Mark<Place> {
    type Point = &'a Place;
    type IntoIter = std::iter::Once<&'a Place>;

    fn point_iter(self) -> Self::IntoIter {
        std::iter::once(&self.at)
    }
}

impl<Place, DB: DrawingBackend> Drawable<DB> for Mark<Place> {
    fn draw<I: Iterator<Item = (i32, i32)>>(
        &self,
        places: I,
        backend: &mut DB,
        _: (u32, u32),
    ) -> std::result::Result<(), DrawingErrorKind<DB::ErrorType>> {
        let Self { shape, size, style, .. } = self;
        for (x, y) in places {
            let (left, right, top, bottom) = (x - size, x + size, y - size, y + size);
            match shape {
                Marker::Disc => backend.draw_circle((x, y), *size as u32, style, true)?,
                Marker::Square => backend.draw_rect((left, top), (right, bottom), style, true)?,
                Marker::Triangle => backend.fill_polygon([(left, bottom), (right, bottom), (x, top)], style)?,
            }
        }
        Ok(())
    }
}

/// A number as people write a tick of a logarithmic axis.
fn power_of_ten(number: f64) -> String {
    match number {
        n if n >= 0.00999 => format!("{n}"),
        n => format!("{n:.0e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(seconds: f64, error: f64) -> Point {
        Point { series: "a < b".to_owned(), label: None, seconds, error, front: true, marker: Marker::Disc }
    }

    #[test]
    fn a_plot_is_svg_with_its_points() {
        let points = [point(0.1, 1e-3), Point { label: Some("best".to_owned()), ..point(1.0, 0.0) }, point(0.0, 1.0)];
        let svg = plot("speed & error", "rms", &points).unwrap();
        assert!(svg.starts_with("<svg") && svg.contains("best") && svg.contains("speed &amp; error"), "{svg}");
        // Two points, of which one is in the legend as well.
        assert_eq!(svg.matches("<circle").count(), 3, "{svg}");
        assert!(svg.contains("a &lt; b"));
    }

    #[test]
    fn nothing_timed_is_no_plot() {
        let refused = plot("", "", &[point(f64::NAN, 1.0)]).unwrap_err().to_string();
        assert!(refused.contains("nothing was timed: there is no plot"), "{refused}");
    }
}
