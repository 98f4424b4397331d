//! Transfer functions by name, fitted to the values of a volume.
//!
//! All opacities are per voxel (the smallest spacing). The background has opacity 0 exactly, so it needs no splats.
//! Colours darken with falling value, which shows depth and edges without lighting.

use super::{ControlPoint, TransferFunction};
use crate::color;
use crate::error::{Error, Result};
use crate::volume::{Statistics, Volume};

/// A named way to make a transfer function from the values of a volume.
#[derive(Debug, Clone, Copy)]
pub struct Preset {
    /// The name on the command line.
    pub name: &'static str,
    /// What it shows, in a few words.
    pub description: &'static str,
    /// Whether it shows surfaces, which want light; otherwise all that there is, translucent.
    pub surfaces: bool,
    build: fn(&Levels) -> Vec<ControlPoint>,
}

/// Every preset.
pub const PRESETS: &[Preset] = &[
    Preset { name: "ct-bone", description: "CT: opaque bone in clear flesh", surfaces: true, build: ct_bone },
    Preset {
        name: "ct-soft-tissue",
        description: "CT: translucent skin and organs, bone within",
        surfaces: true,
        build: ct_soft_tissue,
    },
    Preset {
        name: "angiography",
        description: "CT or MR angiogram: vessels full of contrast agent",
        surfaces: true,
        build: angiography,
    },
    Preset {
        name: "mri",
        description: "MRI: all tissue translucent, bright tissue denser",
        surfaces: true,
        build: mri,
    },
    Preset { name: "grayscale", description: "black to white, denser with value", surfaces: false, build: grayscale },
    Preset {
        name: "gray",
        description: "the colour map gray with a gentle ramp of opacity",
        surfaces: false,
        build: gray,
    },
    Preset {
        name: "viridis",
        description: "the colour map viridis with a gentle ramp of opacity",
        surfaces: false,
        build: viridis,
    },
    Preset {
        name: "inferno",
        description: "the colour map inferno with a gentle ramp of opacity",
        surfaces: false,
        build: inferno,
    },
];

/// The preset `name`, fitted to a distribution of values.
///
/// # Errors
/// [`Error::Transfer`] if there is no such preset (the message lists them), or if all values are the same.
pub fn preset(name: &str, statistics: &Statistics) -> Result<TransferFunction> {
    let preset = find(name)?;
    let levels = Levels::of(statistics).ok_or_else(|| {
        Error::Transfer(format!(
            "preset {name} adapts to the range of the values, but they are all {}: give control points instead",
            statistics.min
        ))
    })?;
    TransferFunction::new((preset.build)(&levels), None)
}

/// The preset with a name.
fn find(name: &str) -> Result<&'static Preset> {
    PRESETS.iter().find(|p| p.name == name).ok_or_else(|| {
        let names: Vec<&str> = PRESETS.iter().map(|p| p.name).collect();
        Error::Transfer(format!("no preset is called {name:?}: there are {}", names.join(", ")))
    })
}

/// A preset chosen for a volume, and why.
#[derive(Debug, Clone, PartialEq)]
pub struct Suggestion {
    /// The preset's name.
    pub name: &'static str,
    /// The property of the volume that speaks for it.
    pub reason: String,
}

/// Guesses a preset from the values; the reason says which property decided.
#[must_use]
pub fn suggest(volume: &Volume, statistics: &Statistics) -> Suggestion {
    let say = |name, reason: String| Suggestion { name, reason };
    if is_hounsfield(statistics) {
        let (min, max) = (statistics.min, statistics.max);
        return say("ct-bone", format!("values from {min} to {max} look like Hounsfield units"));
    }
    let floats = volume.sample_type().is_float();
    if floats && !volume.is_oriented() {
        return say("viridis", "real numbers without a patient orientation: no scan, a field".to_owned());
    }
    let Some(levels) = Levels::of(statistics) else {
        return say("grayscale", format!("all values are {}", statistics.min));
    };
    // Otsu's threshold within the brighter class separates bone or contrast agent from flesh in CT: a minority of the
    // foreground. In MRI no tissue stands out like that, and about half of the foreground lies on either side.
    let (over, foreground) = (statistics.fraction_above(levels.bright), statistics.fraction_above(levels.background));
    let share = 100.0 * over / foreground.max(f64::MIN_POSITIVE);
    // The two bounds are rules of thumb.
    let saw = format!("{share:.1} % of the foreground is over {}", (levels.bright * 1e4).round() / 1e4);
    if share < 3.0 {
        say("angiography", format!("{saw}: thin and far brighter than the rest, as vessels with contrast agent are"))
    } else if share < 30.0 {
        say("ct-bone", format!("{saw}: a bright minority, as bone in CT is"))
    } else {
        say("mri", format!("{saw}: no bright minority stands out, as in MRI"))
    }
}

impl TransferFunction {
    /// A preset fitted to the values of a volume, which are all read.
    ///
    /// # Errors
    /// [`Error::Transfer`] as [`preset`]; [`Error::Read`] and [`Error::Memory`] if samples left in a file cannot be
    /// read.
    pub fn preset(name: &str, volume: &Volume) -> Result<Self> {
        preset(name, &Statistics::of(volume)?)
    }

    /// The preset that [`suggest`] chooses for a volume, fitted to its values, and the reason for the choice.
    ///
    /// A built-in volume has a better one of its own: [`own_transfer`](crate::demos::own_transfer).
    ///
    /// # Errors
    /// [`Error::Transfer`] if all values are the same: then there is no range to fit to.
    pub fn for_volume(volume: &Volume, statistics: &Statistics) -> Result<(Self, Suggestion)> {
        let suggestion = suggest(volume, statistics);
        Ok((preset(suggestion.name, statistics)?, suggestion))
    }
}

/// Whether values look like Hounsfield units: air (-1000) is far below 0, and bone or contrast agent far above it.
/// Values far outside the range of scanners are another quantity.
fn is_hounsfield(s: &Statistics) -> bool {
    s.min < -200.0 && s.max > 300.0 && s.min >= -10_000.0 && s.max <= 100_000.0
}

/// The values at which presets place their points, ascending; neighbours may be equal.
struct Levels {
    hounsfield: bool,
    /// The end of the background.
    background: f64,
    /// Otsu's threshold of all values.
    object: f64,
    /// Otsu's threshold of the foreground.
    vessel: f64,
    /// Otsu's threshold of the values over `object`.
    bright: f64,
    /// The 99.9th percentile of the values over `bright`: the end of the hardest tissue.
    top: f64,
    /// The 99.5th percentile of the foreground: the end of ramps over all of it.
    high: f64,
}

impl Levels {
    fn of(s: &Statistics) -> Option<Self> {
        let object = s.otsu(f64::NEG_INFINITY)?;
        let background = s.background()?.limit.min(object);
        let vessel = s.otsu(background).unwrap_or(object).max(object);
        let bright = s.otsu(object).unwrap_or(object);
        let top = s.quantile_above(bright, 0.999).max(bright).max(vessel);
        let high = s.quantile_above(background, 0.995).max(background);
        Some(Self { hounsfield: is_hounsfield(s), background, object, vessel, bright, top, high })
    }
}

/// The values of the foreground, up to its 99.5th percentile; `None` if all values are the same.
pub(super) fn foreground(statistics: &Statistics) -> Option<[f64; 2]> {
    Levels::of(statistics).map(|levels| [levels.background, levels.high])
}

/// Linear interpolation from `a` (f = 0) to `b` (f = 1).
pub(super) fn between(a: f64, b: f64, f: f64) -> f64 {
    let width = b - a;
    // Between the ends of the range of f64 the width overflows.
    if width.is_finite() { a + width * f } else { a * (1.0 - f) + b * f }
}

/// Points from (value, `0xrrggbb`, opacity).
fn points(rows: &[(f64, u32, f64)]) -> Vec<ControlPoint> {
    rows.iter().map(|&(value, rgb, opacity)| ControlPoint { value, color: color::packed(rgb), opacity }).collect()
}

fn ct_bone(l: &Levels) -> Vec<ControlPoint> {
    // Trabecular bone starts near 150 HU, cortical bone lies from 500 to 1900 HU.
    let (clear, soft, hard, top) = if l.hounsfield {
        (150.0, 300.0, 700.0, 1800.0)
    } else {
        let at = |f| between(l.bright, l.top, f);
        (between(l.object, l.bright, 0.75), at(0.05), at(0.45), l.top)
    };
    points(&[(clear, 0x7c_4a30, 0.0), (soft, 0xa8_734a, 0.05), (hard, 0xd8_b488, 0.2), (top, 0xff_faf0, 0.45)])
}

fn ct_soft_tissue(l: &Levels) -> Vec<ControlPoint> {
    // Fat from -120, muscle and organs 20 to 80, bone from 200 HU.
    let (air, fat, flesh, bone, top) = if l.hounsfield {
        (-300.0, -100.0, 50.0, 250.0, 1500.0)
    } else {
        let at = |f| between(l.background, l.bright, f);
        (at(0.15), at(0.35), at(0.7), l.bright, l.top)
    };
    points(&[
        (air, 0x38_140a, 0.0),
        (fat, 0x8c_4a2c, 0.008),
        (flesh, 0xc8_6e4b, 0.015),
        (bone, 0xdc_b482, 0.03),
        (top, 0xff_faf0, 0.12),
    ])
}

fn angiography(l: &Levels) -> Vec<ControlPoint> {
    // Blood with contrast agent lies from 150 to 500 HU, calcium, stents and bone above.
    let (clear, thin, full, top) = if l.hounsfield {
        (120.0, 200.0, 450.0, 1200.0)
    } else {
        let at = |f| between(l.vessel, l.top, f);
        (at(0.0), at(0.06), at(0.3), l.top)
    };
    points(&[(clear, 0x30_0406, 0.0), (thin, 0x8c_1414, 0.05), (full, 0xe6_6432, 0.3), (top, 0xff_f5dc, 0.7)])
}

fn mri(l: &Levels) -> Vec<ControlPoint> {
    let (mid, top) = (l.bright, l.top);
    points(&[
        (l.background, 0x0a_0a14, 0.0),
        (between(l.background, l.object, 0.6), 0x1e_1e32, 0.0),
        (l.object.max(l.background), 0x3c_3246, 0.008),
        (mid, 0xa0_8278, 0.03),
        (between(mid, top, 0.6), 0xe6_d2be, 0.12),
        (top, 0xff_faf5, 0.25),
    ])
}

fn grayscale(l: &Levels) -> Vec<ControlPoint> {
    points(&[(l.background, 0x00_0000, 0.0), (l.high, 0xff_ffff, 0.2)])
}

/// A colour map over the foreground. Opacity rises with the square of the position in the map, to 0.1.
fn map(l: &Levels, color: impl Fn(f64) -> colorous::Color) -> Vec<ControlPoint> {
    const STEPS: u32 = 16;
    (0..=STEPS)
        .map(|i| {
            let f = f64::from(i) / f64::from(STEPS);
            let colorous::Color { r, g, b } = color(f);
            ControlPoint {
                value: between(l.background, l.high, f),
                color: [r, g, b].map(|c| f64::from(c) / 255.0),
                opacity: 0.1 * f * f,
            }
        })
        .collect()
}

fn gray(l: &Levels) -> Vec<ControlPoint> {
    // The map of `colorous` runs from white to black.
    map(l, |f| colorous::GREYS.eval_continuous(1.0 - f))
}

fn viridis(l: &Levels) -> Vec<ControlPoint> {
    map(l, |f| colorous::VIRIDIS.eval_continuous(f))
}

fn inferno(l: &Levels) -> Vec<ControlPoint> {
    map(l, |f| colorous::INFERNO.eval_continuous(f))
}
