//! The colour bar: the colours of the transfer function over values, and a curve of their opacity.

use glam::DVec2;

use super::canvas::Canvas;
use super::font::Font;
use super::number::{label, ticks};
use super::path::Path;
use crate::error::{Error, Result};
use crate::transfer::{ControlPoint, TransferFunction};

/// The values of a colour bar.
#[derive(Clone, Copy)]
pub(super) struct Values<'a> {
    pub(super) transfer: &'a TransferFunction,
    /// The least and the largest value of the data, if they are known.
    pub(super) data: Option<[f64; 2]>,
}

/// Returns the range of values of a bar: from the first to the last control point, without clear ones at the ends, and
/// without values beyond the data's.
fn range(transfer: &TransferFunction, values: Option<[f64; 2]>) -> Result<[f64; 2]> {
    let points = transfer.points();
    let clear = |p: &&ControlPoint| p.opacity <= 0.0;
    // The last of the clear points is where opacity begins.
    let first = points.iter().take_while(clear).count().saturating_sub(1);
    let last = points.len() - 1 - points.iter().rev().take_while(clear).count().saturating_sub(1);
    let visible = if first < last { [points[first].value, points[last].value] } else { transfer.range() };
    let spread = |[low, high]: [f64; 2]| low < high && (high - low).is_finite();
    let reason = "the transfer function has one value, or values too far apart: there is no range to show";
    let of_data = values.map(|[low, high]| [visible[0].max(low), visible[1].min(high)]);
    let range = of_data.into_iter().chain([visible, transfer.range()]).find(|&range| spread(range));
    range.ok_or_else(|| Error::setting("color_bar", reason))
}

/// Returns the height of a bar in an area of a height: the unit is above it, and the label of the curve below.
pub(super) fn room(height: f64, em: f64) -> f64 {
    height - 3.0 * em
}

/// The places of a bar and its labels.
struct BarLayout {
    range: [f64; 2],
    labels: Vec<(f64, String)>,
    /// The edges of the bar, and its height, pixels.
    left: f64,
    right: f64,
    top: f64,
    tall: f64,
    /// The width of the panel of the curve at the left of the bar.
    wide: f64,
    /// The largest opacity in the range.
    densest: f64,
}

impl BarLayout {
    /// Places a bar with its labels at the right of the area between two corners, in the middle of its height.
    fn new(font: &Font, values: Values<'_>, em: f64, [least, most]: [DVec2; 2]) -> Result<Self> {
        let Values { transfer, data } = values;
        let range @ [low, high] = range(transfer, data)?;
        let tall = room(most.y - least.y, em).min(16.0 * em).floor();
        let top = (f64::midpoint(least.y, most.y) - tall / 2.0).round();
        let (step, values) = ticks(range, (tall / (1.9 * em)).clamp(2.0, 6.0) as usize);
        let labels: Vec<(f64, String)> = values.into_iter().map(|value| (value, label(value, step))).collect();
        let widest = labels.iter().map(|(_, label)| font.width(label, TEXT * em)).fold(0.0, f64::max);
        let right = (most.x - widest - 0.45 * em).floor();
        let left = right - em.round();
        let inside = transfer.points().iter().filter(|p| (low..=high).contains(&p.value)).map(|p| p.opacity);
        let densest = inside.chain([low, high].map(|end| transfer.sample(end).1)).fold(0.0, f64::max);
        let wide = if densest > 0.0 { 2.0 * em } else { 0.0 };
        Ok(Self { range, labels, left, right, top, tall, wide, densest })
    }
}

/// Returns the left end of a bar that is drawn in an area, with a little space beside it.
pub(super) fn left_end(font: &Font, values: Values<'_>, em: f64, area: [DVec2; 2]) -> Result<f64> {
    let layout = BarLayout::new(font, values, em, area)?;
    let text = if layout.wide > 0.0 { font.width(&curve_text(layout.densest), CURVE_TEXT * em) } else { 0.0 };
    Ok((layout.left - layout.wide).min(area[1].x - text) - 0.5 * em)
}

/// The size of labels, and of the label of the curve, in sizes of letters.
const TEXT: f64 = 0.9;
const CURVE_TEXT: f64 = 0.8;

/// Returns the label of a curve with a largest opacity.
fn curve_text(densest: f64) -> String {
    // Two digits, without a last 0.
    let number = label(densest, (densest / 10.0).min(0.1));
    format!("opacity 0–{}", if densest < 1.0 { number.trim_end_matches('0') } else { "1" })
}

/// Draws the bar with its labels at the right of the area between two corners, in the middle of its height.
pub(super) fn draw(canvas: &mut Canvas, values: Values<'_>, unit: Option<&str>, area: [DVec2; 2]) -> Result<()> {
    let transfer = values.transfer;
    let (em, [_, most]) = (canvas.em, area);
    let BarLayout { range: [low, high], labels, left, right, top, tall, wide, densest } =
        BarLayout::new(&canvas.font, values, em, area)?;

    // The curve of opacity, to the left; the largest opacity is as far from the bar as the panel is wide.
    let rows = tall as u32;
    let value_of = |y: f64| high - (high - low) * (y - top) / tall;
    if densest > 0.0 {
        let place = |row: u32| {
            let y = top + f64::from(row);
            DVec2::new(left - wide * transfer.sample(value_of(y).clamp(low, high)).1 / densest, y)
        };
        let curve: Vec<DVec2> = (0..=rows).map(place).collect();
        canvas.ground(&Path::rectangle(DVec2::new(left - wide, top), DVec2::new(left, top + tall)));
        let ends = [DVec2::new(left, top + tall), DVec2::new(left, top)];
        canvas.fill(&Path::polygon(curve.iter().copied().chain(ends).collect()), canvas.ink, 0.3);
        canvas.fill(&Path::line(&curve, (0.09 * em).max(1.0)), canvas.ink, 1.0);
        canvas.write(&curve_text(densest), CURVE_TEXT * em, DVec2::new(most.x, top + tall + 0.85 * em), 1.0);
    }

    canvas.halo(&Path::rectangle(DVec2::new(left, top), DVec2::new(right, top + tall)));
    let thin = (em / 14.0).max(1.0);
    for (value, label) in &labels {
        let y = (top + tall * (high - value) / (high - low)).clamp(top + thin / 2.0, top + tall - thin / 2.0);
        let tick = [DVec2::new(right, y - thin / 2.0), DVec2::new(right + 0.25 * em, y + thin / 2.0)];
        canvas.fill_with_halo(&Path::rectangle(tick[0], tick[1]), canvas.ink);
        canvas.write(label, TEXT * em, DVec2::new(right + 0.45 * em, y), 0.0);
    }
    // Over the halos of its ticks.
    for row in 0..rows {
        let y = top + f64::from(row);
        let color = transfer.sample(value_of(y + 0.5)).0;
        canvas.fill(&Path::rectangle(DVec2::new(left, y), DVec2::new(right, y + 1.0)), color, 1.0);
    }
    if let Some(unit) = unit {
        canvas.write(unit, TEXT * em, DVec2::new(most.x, top - 0.9 * em), 1.0);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn range_of(points: &[(f64, f64)]) -> Result<[f64; 2]> {
        let points = points.iter().map(|&(value, opacity)| ControlPoint { value, color: [1.0; 3], opacity }).collect();
        range(&TransferFunction::new(points, None).unwrap(), None)
    }

    #[test]
    fn a_bar_ends_at_the_values_of_the_data() {
        let point = |value, opacity| ControlPoint { value, color: [1.0; 3], opacity };
        let transfer = TransferFunction::new(vec![point(150.0, 0.0), point(1600.0, 0.6)], None).unwrap();
        for (data, expected) in [
            ([-1000.0, 900.0], [150.0, 900.0]),
            ([200.0, 3000.0], [200.0, 1600.0]),
            // Nothing is visible.
            ([0.0, 100.0], [150.0, 1600.0]),
        ] {
            assert_eq!(range(&transfer, Some(data)).unwrap(), expected, "{data:?}");
        }
    }

    #[test]
    fn what_is_clear_is_left_out() {
        assert_eq!(range_of(&[(0.0, 0.1), (2.0, 0.5)]).unwrap(), [0.0, 2.0]);
        assert_eq!(range_of(&[(-9.0, 0.0), (0.0, 0.0), (2.0, 0.5), (3.0, 0.0), (9.0, 0.0)]).unwrap(), [0.0, 3.0]);
        assert_eq!(range_of(&[(1.0, 0.0), (1.0, 0.5), (2.0, 0.5), (2.0, 0.0)]).unwrap(), [1.0, 2.0]);
        assert_eq!(range_of(&[(1.0, 0.0), (5.0, 0.0)]).unwrap(), [1.0, 5.0]);
        assert_eq!(range_of(&[(1.0, 0.0), (5.0, 0.0), (5.0, 1.0)]).unwrap(), [1.0, 5.0]);
        for points in [&[(1.0, 0.5)][..], &[(f64::MIN, 0.5), (f64::MAX, 1.0)]] {
            assert!(range_of(points).unwrap_err().to_string().contains("no range to show"), "{points:?}");
        }
    }
}
