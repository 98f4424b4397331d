//! Shapes in pixels of the picture, x to the right and y down, and the share of each pixel that they cover.

use ab_glyph_rasterizer::{Rasterizer, point};
use glam::DVec2;

/// A shape: closed polygons. A polygon of the opposite sense inside another is a hole.
#[derive(Debug, Clone, Default)]
pub(super) struct Path {
    polygons: Vec<Vec<DVec2>>,
}

/// The share of each pixel of a box that a shape covers, row by row.
pub(super) struct Coverage {
    /// The pixel at the top left of the box.
    pub(super) origin: [i64; 2],
    pub(super) width: usize,
    pub(super) shares: Vec<f32>,
}

/// The number of corners of the polygon that approximates a disc.
const CORNERS: u32 = 24;

impl Path {
    pub(super) fn polygon(corners: Vec<DVec2>) -> Self {
        Self { polygons: vec![corners] }
    }

    pub(super) fn rectangle(least: DVec2, most: DVec2) -> Self {
        Self::polygon(vec![least, DVec2::new(least.x, most.y), most, DVec2::new(most.x, least.y)])
    }

    /// Makes a line through points, `width` wide, with round ends.
    pub(super) fn line(points: &[DVec2], width: f64) -> Self {
        let mut line = Self::default();
        line.stroke(points, width / 2.0);
        line
    }

    /// Adds the places within `radius` of a line through points. Where parts overlap, edges get a little darker.
    fn stroke(&mut self, points: &[DVec2], radius: f64) {
        let corner = |i| {
            let (sine, cosine) = libm::sincos(std::f64::consts::TAU * f64::from(i) / f64::from(CORNERS));
            radius * DVec2::new(cosine, sine)
        };
        for &center in points {
            self.add((0..CORNERS).map(|i| center + corner(i)).collect());
        }
        for ends in points.windows(2) {
            let [a, b] = [ends[0], ends[1]];
            // Of the same sense as discs, so that overlaps add up.
            let aside = (b - a).normalize_or_zero().perp() * radius;
            self.add(vec![a + aside, a - aside, b - aside, b + aside]);
        }
    }

    pub(super) fn append(&mut self, other: Self) {
        self.polygons.extend(other.polygons);
    }

    pub(super) fn add(&mut self, polygon: Vec<DVec2>) {
        self.polygons.push(polygon);
    }

    /// Returns the places within `radius` of the edges, as a shape.
    pub(super) fn outline(&self, radius: f64) -> Self {
        let mut outline = Self::default();
        for polygon in &self.polygons {
            let closed: Vec<DVec2> = polygon.iter().chain(polygon.first()).copied().collect();
            outline.stroke(&closed, radius);
        }
        outline
    }

    /// Returns the corners of the bounding box; `None` if the shape is empty.
    pub(super) fn bounds(&self) -> Option<[DVec2; 2]> {
        let corners = || self.polygons.iter().flatten().copied();
        Some([corners().reduce(DVec2::min)?, corners().reduce(DVec2::max)?])
    }

    /// Rasterises the shape; `None` if it is empty.
    pub(super) fn coverage(&self) -> Option<Coverage> {
        let [least, most] = self.bounds()?;
        let (least, most) = (least.floor(), most.ceil());
        let [width, height] = (most - least).max(DVec2::ONE).to_array().map(|side| side as usize);
        let mut rasterizer = Rasterizer::new(width, height);
        for polygon in &self.polygons {
            for (i, &a) in polygon.iter().enumerate() {
                let [a, b] = [a, polygon[(i + 1) % polygon.len()]].map(|corner| {
                    let corner = (corner - least).as_vec2();
                    point(corner.x, corner.y)
                });
                rasterizer.draw_line(a, b);
            }
        }
        let mut shares = vec![0.0; width * height];
        rasterizer.for_each_pixel(|index, share| shares[index] = share.min(1.0));
        Some(Coverage { origin: [least.x as i64, least.y as i64], width, shares })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(path: &Path) -> f64 {
        path.coverage().unwrap().shares.iter().map(|&share| f64::from(share)).sum()
    }

    #[test]
    fn coverage_adds_up_to_the_area() {
        let rectangle = Path::rectangle(DVec2::new(1.25, -2.5), DVec2::new(7.75, 0.125));
        assert!((area(&rectangle) - 6.5 * 2.625).abs() < 1e-4);
        let coverage = rectangle.coverage().unwrap();
        assert_eq!((coverage.origin, coverage.width), ([1, -3], 7));
        // A line with round ends; a disc of 24 corners lacks 1.1 % of its area.
        let line = Path::line(&[DVec2::new(10.0, 20.0), DVec2::new(40.0, 60.0)], 6.0);
        let expected = 50.0 * 6.0 + std::f64::consts::PI * 9.0;
        assert!((area(&line) - expected).abs() < 0.02 * expected, "{} {expected}", area(&line));
    }
}
