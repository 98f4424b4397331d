//! Colour spaces in which other programs interpolate, with VTK's constants, because its maps are tuned to them.

use std::f64::consts::PI;

use super::fault;
use crate::error::Result;
use crate::transfer::color::{from_linear, hsv, to_linear};

/// A colour space in which colours between two points are interpolated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ColorSpace {
    Rgb,
    /// HSV: hue, saturation and value; with `wrap` hues take the shorter way around.
    Hsv {
        wrap: bool,
    },
    /// CIE L*a*b* for a white of (0.9505, 1, 1.089).
    Lab,
    /// Polar Lab, through white if both ends are saturated and differ in hue (Moreland 2009, "Diverging color maps for
    /// scientific visualization").
    Diverging,
    /// No interpolation: the colour of the upper point from the lower one on.
    Step,
}

impl ColorSpace {
    /// Finds the space with a name of ParaView. Adds a note if colours differ from the named space.
    pub(super) fn named(name: &str, wrap: bool, notes: &mut Vec<String>) -> Result<Self> {
        Ok(match name.to_lowercase().as_str() {
            "rgb" => Self::Rgb,
            "hsv" => Self::Hsv { wrap },
            "wrapped" => Self::Hsv { wrap: true },
            "lab" | "cielab" => Self::Lab,
            "ciede2000" | "lab/ciede2000" => {
                notes.push("colours between points are mixed in Lab, without the paths of CIEDE2000".to_owned());
                Self::Lab
            }
            "diverging" => Self::Diverging,
            "step" => Self::Step,
            _ => {
                let expected = "expected RGB, HSV, Wrapped, Lab, Diverging or Step";
                return Err(fault(format!("colour space {name:?}, {expected}")));
            }
        })
    }

    /// Returns the colour at the share `s` of the way from `a` to `b`, both in 0..1.
    pub(super) fn between(self, a: [f64; 3], b: [f64; 3], s: f64) -> [f64; 3] {
        match self {
            Self::Rgb => mixed(a, b, s),
            Self::Step => b,
            Self::Lab => lab_to_rgb(mixed(rgb_to_lab(a), rgb_to_lab(b), s)),
            Self::Hsv { wrap } => {
                let (mut a, mut b) = (rgb_to_hsv(a), rgb_to_hsv(b));
                if wrap && (a[0] - b[0]).abs() > 0.5 {
                    if a[0] > b[0] { a[0] -= 1.0 } else { b[0] -= 1.0 }
                }
                hsv(mixed(a, b, s))
            }
            Self::Diverging => diverging(a, b, s),
        }
    }
}

fn mixed(a: [f64; 3], b: [f64; 3], s: f64) -> [f64; 3] {
    std::array::from_fn(|c| (1.0 - s) * a[c] + s * b[c])
}

fn rgb_to_hsv(rgb: [f64; 3]) -> [f64; 3] {
    let [r, g, b] = rgb;
    let (most, least) = (r.max(g).max(b), r.min(g).min(b));
    let range = most - least;
    if range <= 0.0 {
        return [0.0, 0.0, most];
    }
    let sixth = if r >= most {
        (g - b) / range
    } else if g >= most {
        2.0 + (b - r) / range
    } else {
        4.0 + (r - g) / range
    };
    [(sixth / 6.0).rem_euclid(1.0), range / most, most]
}

/// The white of Lab.
const WHITE: [f64; 3] = [0.9505, 1.0, 1.089];

fn rgb_to_lab(rgb: [f64; 3]) -> [f64; 3] {
    let [r, g, b] = rgb.map(to_linear);
    let xyz = [
        0.4124 * r + 0.3576 * g + 0.1805 * b,
        0.2126 * r + 0.7152 * g + 0.0722 * b,
        0.0193 * r + 0.1192 * g + 0.9505 * b,
    ];
    let root = |c: usize| {
        let share = xyz[c] / WHITE[c];
        if share > 0.008_856 { libm::cbrt(share) } else { 7.787 * share + 16.0 / 116.0 }
    };
    let [x, y, z] = [root(0), root(1), root(2)];
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn lab_to_rgb([l, a, b]: [f64; 3]) -> [f64; 3] {
    let y = (l + 16.0) / 116.0;
    let cube = |root: f64| if root.powi(3) > 0.008_856 { root.powi(3) } else { (root - 16.0 / 116.0) / 7.787 };
    let [x, y, z] = [y + a / 500.0, y, y - b / 200.0].map(cube);
    let [x, y, z] = [x * WHITE[0], y * WHITE[1], z * WHITE[2]];
    let rgb = [
        3.2406 * x - 1.5372 * y - 0.4986 * z,
        -0.9689 * x + 1.8758 * y + 0.0415 * z,
        0.0557 * x - 0.2040 * y + 1.0570 * z,
    ]
    .map(from_linear);
    // Colours out of gamut keep their hue.
    let most = rgb.into_iter().fold(1.0, f64::max);
    rgb.map(|c| c.max(0.0) / most)
}

/// Converts red, green and blue to magnitude, saturation and hue: polar coordinates of Lab.
fn rgb_to_msh(rgb: [f64; 3]) -> [f64; 3] {
    let [l, a, b] = rgb_to_lab(rgb);
    let m = (l * l + a * a + b * b).sqrt();
    let s = if m > 0.001 { libm::acos((l / m).clamp(-1.0, 1.0)) } else { 0.0 };
    [m, s, if s > 0.001 { libm::atan2(b, a) } else { 0.0 }]
}

fn msh_to_rgb([m, s, h]: [f64; 3]) -> [f64; 3] {
    lab_to_rgb([m * libm::cos(s), m * libm::sin(s) * libm::cos(h), m * libm::sin(s) * libm::sin(h)])
}

/// The smallest saturation at which a hue counts.
const SATURATED: f64 = 0.05;

fn diverging(a: [f64; 3], b: [f64; 3], s: f64) -> [f64; 3] {
    let (mut a, mut b, mut s) = (rgb_to_msh(a), rgb_to_msh(b), s);
    let apart = (a[2] - b[2]).abs().rem_euclid(2.0 * PI);
    if a[1] > SATURATED && b[1] > SATURATED && apart.min(2.0 * PI - apart) > 0.33 * PI {
        let white = [a[0].max(b[0]).max(88.0), 0.0, 0.0];
        if s < 0.5 {
            (b, s) = (white, 2.0 * s);
        } else {
            (a, s) = (white, 2.0 * s - 1.0);
        }
    }
    // An end without saturation has no hue of its own.
    if a[1] < SATURATED && b[1] > SATURATED {
        a[2] = spun(b, a[0]);
    } else if b[1] < SATURATED && a[1] > SATURATED {
        b[2] = spun(a, b[0]);
    }
    msh_to_rgb(mixed(a, b, s))
}

/// Returns the hue of an end without saturation, of magnitude `to`, given the saturated colour at the other end.
fn spun([m, s, h]: [f64; 3], to: f64) -> f64 {
    if m >= to - 0.1 {
        return h;
    }
    let spin = s * (to * to - m * m).sqrt() / (m * libm::sin(s));
    if h > -0.3 * PI { h + spin } else { h - spin }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spaces_keep_their_ends() {
        let colors = [[0.23, 0.3, 0.75], [0.7, 0.02, 0.15], [0.5; 3], [1.0, 1.0, 0.0], [0.0; 3], [0.2, 0.9, 0.4]];
        let spaces = [
            ColorSpace::Rgb,
            ColorSpace::Hsv { wrap: false },
            ColorSpace::Hsv { wrap: true },
            ColorSpace::Lab,
            ColorSpace::Diverging,
        ];
        for space in spaces {
            for a in colors {
                for b in colors {
                    for (end, s) in [(a, 0.0), (b, 1.0)] {
                        let found = space.between(a, b, s);
                        let off = (0..3).map(|c| (found[c] - end[c]).abs()).fold(0.0, f64::max);
                        // The matrices to and from XYZ have four digits.
                        assert!(off < 2e-3, "{space:?} {a:?} {b:?}: {found:?}");
                    }
                }
            }
        }
    }
}
