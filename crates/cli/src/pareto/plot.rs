//! Plots of speed against error, as SVG.

use voxsplat_volume::names::escaped;

/// A picture in a plot of speed against error.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Point {
    /// The name of the point's series in the legend. Each series has a colour.
    pub(crate) series: String,
    /// The text beside the point.
    pub(crate) label: Option<String>,
    /// The seconds of a frame, over 0.
    pub(crate) seconds: f64,
    /// The error of the picture; 0 lies on the lower edge.
    pub(crate) error: f64,
    /// Whether the point is on the front of its series, which a line joins.
    pub(crate) front: bool,
    pub(crate) marker: Marker,
}

/// The shape of a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Marker {
    Disc,
    Triangle,
    Square,
    Diamond,
}

/// Okabe and Ito's colours, which colour-blind people tell apart (2008, "Color universal design").
const COLORS: [&str; 7] = ["#0072b2", "#e69f00", "#009e73", "#d55e00", "#cc79a7", "#56b4e9", "#5a5a5a"];
/// Width and height of the picture, pixels.
const SIZE: [f64; 2] = [960.0, 640.0];
/// Left, right and lower edge of the chart, pixels.
const LEFT: f64 = 86.0;
const RIGHT: f64 = 936.0;
const BOTTOM: f64 = 584.0;
/// Left edge of the title and the legend, pixels.
const EDGE: f64 = 24.0;
const TITLE_HEIGHT: f64 = 48.0;
const LEGEND_ROW: f64 = 22.0;

/// Returns an SVG picture of points: seconds of a frame to the right, errors upwards, both in powers of ten. Points on
/// the front of their series are solid and joined, others are pale. Returns `None` if no point has finite numbers and a
/// time over 0.
pub(crate) fn plot(title: &str, error_name: &str, points: &[Point]) -> Option<String> {
    let is_shown = |p: &&Point| p.seconds > 0.0 && p.seconds.is_finite() && p.error.is_finite();
    let points: Vec<&Point> = points.iter().filter(is_shown).collect();
    let times = range(points.iter().map(|p| p.seconds))?;
    let errors = range(points.iter().map(|p| p.error)).unwrap_or([1e-6, 1.0]);
    let mut series: Vec<&str> = Vec::new();
    for point in &points {
        if !series.contains(&point.series.as_str()) {
            series.push(&point.series);
        }
    }
    let top = TITLE_HEIGHT + LEGEND_ROW * series.len().div_ceil(2) as f64 + 12.0;
    let across = |seconds: f64| LEFT + (RIGHT - LEFT) * fraction(seconds, times);
    let up = |error: f64| BOTTOM - (BOTTOM - top) * fraction(error.max(errors[0]), errors);
    let [width, height] = SIZE;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} \
         {height}\" font-family=\"sans-serif\" fill=\"#282828\">\n<rect width=\"100%\" height=\"100%\" \
         fill=\"white\"/>\n"
    );
    svg += &text(&format!("x=\"{EDGE}\" y=\"32\" font-size=\"20\""), title);
    for (number, text, grey) in ticks(times) {
        let x = across(number);
        svg += &line(&[[x, top], [x, BOTTOM]], grey);
        svg += &self::text(&format!("x=\"{x:.1}\" y=\"{}\" {TICK} text-anchor=\"middle\"", BOTTOM + 18.0), &text);
    }
    for (number, text, grey) in ticks(errors) {
        let y = up(number);
        svg += &line(&[[LEFT, y], [RIGHT, y]], grey);
        svg += &self::text(&format!("x=\"{}\" y=\"{:.1}\" {TICK} text-anchor=\"end\"", LEFT - 6.0, y + 4.0), &text);
    }
    svg += &line(&[[LEFT, top], [LEFT, BOTTOM], [RIGHT, BOTTOM]], "#282828");
    let middle = f64::midpoint(LEFT, RIGHT);
    svg += &text(&format!("x=\"{middle}\" y=\"624\" {AXIS}"), "seconds of a frame");
    let middle = f64::midpoint(top, BOTTOM);
    svg += &text(&format!("transform=\"translate(22 {middle}) rotate(-90)\" {AXIS}"), error_name);
    for (index, name) in series.iter().enumerate() {
        let color = COLORS[index % COLORS.len()];
        let x = EDGE + (index % 2) as f64 * (width / 2.0 - EDGE);
        let y = TITLE_HEIGHT + LEGEND_ROW * (index / 2) as f64 + 7.0;
        let own: Vec<&&Point> = points.iter().filter(|point| point.series == *name).collect();
        svg += &mark([x + 6.0, y], own[0].marker, 5.0, &format!("fill=\"{color}\""));
        svg += &text(&format!("x=\"{}\" y=\"{}\" font-size=\"14\"", x + 20.0, y + 5.0), name);
        let mut front: Vec<[f64; 2]> =
            own.iter().filter(|p| p.front).map(|p| [across(p.seconds), up(p.error)]).collect();
        front.sort_by(|a, b| a[0].total_cmp(&b[0]));
        // The error of a point is also reached by any slower one: the front is a staircase.
        let steps = front.windows(2).flat_map(|pair| [pair[0], [pair[1][0], pair[0][1]]]).chain(front.last().copied());
        svg += &line(&steps.collect::<Vec<_>>(), color);
        for point in own {
            let (size, opacity) = if point.front { (6.0, 1.0) } else { (4.0, 0.4) };
            let style = format!("fill=\"{color}\" opacity=\"{opacity}\"");
            svg += &mark([across(point.seconds), up(point.error)], point.marker, size, &style);
        }
    }
    for point in &points {
        if let Some(label) = &point.label {
            let [x, y] = [across(point.seconds) + 8.0, up(point.error) - 6.0];
            svg += &text(&format!("x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"13\""), label);
        }
    }
    Some(svg + "</svg>\n")
}

/// The style of the numbers at an axis, and of the name of an axis.
const TICK: &str = "font-size=\"13\"";
const AXIS: &str = "font-size=\"15\" text-anchor=\"middle\"";

/// Returns the range of the numbers over 0, with a margin; `None` if there are none.
fn range(numbers: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    let over_0 = numbers.filter(|&n| n > 0.0);
    let [low, high] = over_0.fold([f64::INFINITY, 0.0], |[low, high], n| [low.min(n), high.max(n)]);
    (high > 0.0).then(|| [low / 1.6, high * 1.6])
}

/// Returns the place of a number in a logarithmic range: 0 at its lower end, 1 at its upper end.
fn fraction(number: f64, [low, high]: [f64; 2]) -> f64 {
    libm::log(number / low) / libm::log(high / low)
}

/// Returns numbers of one digit in a range, each with its label and the grey of its line. Powers of ten have labels,
/// and in a short range 2 and 5 times as much.
fn ticks([low, high]: [f64; 2]) -> Vec<(f64, String, &'static str)> {
    let is_short = high / low < 100.0;
    let powers = libm::log10(low).floor() as i32..=libm::log10(high).floor() as i32;
    let tick = |(power, digit): (i32, u8)| {
        let number = f64::from(digit) * 10_f64.powi(power);
        let label = match power {
            _ if digit != 1 && !(is_short && [2, 5].contains(&digit)) => String::new(),
            ..-2 => format!("{digit}e{power}"),
            _ => format!("{number:.*}", (-power).max(0) as usize),
        };
        (number, label, if digit == 1 { "#cdcdcd" } else { "#eeeeee" })
    };
    let all = powers.flat_map(|power| (1..=9).map(move |digit| (power, digit))).map(tick);
    all.filter(|(number, ..)| (low..=high).contains(number)).collect()
}

fn text(attributes: &str, text: &str) -> String {
    format!("<text {attributes}>{}</text>\n", escaped(text))
}

fn line(points: &[[f64; 2]], color: &str) -> String {
    let points: Vec<String> = points.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
    format!("<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\"/>\n", points.join(" "))
}

fn mark([x, y]: [f64; 2], marker: Marker, size: f64, style: &str) -> String {
    let (left, right, top, bottom, side) = (x - size, x + size, y - size, y + size, 2.0 * size);
    match marker {
        Marker::Disc => format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{size}\" {style}/>\n"),
        Marker::Square => {
            format!("<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{side}\" height=\"{side}\" {style}/>\n")
        }
        Marker::Diamond => {
            let corners = format!("{left:.1},{y:.1} {x:.1},{top:.1} {right:.1},{y:.1} {x:.1},{bottom:.1}");
            format!("<polygon points=\"{corners}\" {style}/>\n")
        }
        Marker::Triangle => {
            let corners = format!("{left:.1},{bottom:.1} {right:.1},{bottom:.1} {x:.1},{top:.1}");
            format!("<polygon points=\"{corners}\" {style}/>\n")
        }
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
    fn powers_of_ten_have_labels_and_short_ranges_have_more() {
        let labels = |range| ticks(range).into_iter().map(|(_, label, _)| label).filter(|label| !label.is_empty());
        assert_eq!(labels([1e-4, 30.0]).collect::<Vec<_>>(), ["1e-4", "1e-3", "0.01", "0.1", "1", "10"]);
        assert_eq!(labels([0.15, 3.0]).collect::<Vec<_>>(), ["0.2", "0.5", "1", "2"]);
    }

    #[test]
    fn nothing_timed_is_no_plot() {
        assert_eq!(plot("", "", &[point(f64::NAN, 1.0)]), None);
    }
}
