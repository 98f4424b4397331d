//! Transfer functions by name, fitted to the values of a volume, and materials for the light on them.
//!
//! All opacities are per voxel (the smallest spacing). The background has opacity 0 exactly, so it needs no splats.
//! Colours darken with falling value, which shows depth and edges without lighting.

use super::{ControlPoint, GradientPoint, TransferFunction};
use crate::color;
use crate::error::{Error, Result};
use crate::lighting::Lighting;
use crate::volume::{Statistics, Volume};
use voxsplat_volume::names::readable;

/// A named way to make a transfer function from the values of a volume.
#[derive(Debug, Clone, Copy)]
pub struct Preset {
    /// The name on the command line.
    pub name: &'static str,
    /// What it shows, in a few words.
    pub description: &'static str,
    /// The material of the surfaces that it shows, which want light; `None`: it shows all that there is, translucent.
    pub material: Option<Material>,
    build: fn(&Levels) -> Vec<ControlPoint>,
    /// Gradient opacity: gradients in ranges of the tissue per voxel, and the share of extinction that stays.
    gradient: &'static [(f64, f64)],
}

/// What [`Lighting`] has of a material.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Material {
    /// [`Lighting::ambient`].
    pub ambient: f64,
    /// [`Lighting::diffuse`].
    pub diffuse: f64,
    /// [`Lighting::specular`].
    pub specular: f64,
    /// [`Lighting::shininess`].
    pub shininess: f64,
}

impl Material {
    /// These lights on this material.
    #[must_use]
    pub fn lit(self, lighting: Lighting) -> Lighting {
        let Self { ambient, diffuse, specular, shininess } = self;
        Lighting { ambient, diffuse, specular, shininess, ..lighting }
    }
}

const fn material(ambient: f64, diffuse: f64, specular: f64, shininess: f64) -> Option<Material> {
    Some(Material { ambient, diffuse, specular, shininess })
}

/// Every preset.
pub const PRESETS: &[Preset] = &[
    Preset {
        name: "ct-bone",
        description: "CT: opaque bone in clear flesh",
        material: material(0.4, 0.8, 0.2, 24.0),
        build: ct_bone,
        gradient: &[],
    },
    Preset {
        name: "ct-skin",
        description: "CT: the opaque outside, skin or scales",
        material: material(0.45, 0.9, 0.12, 12.0),
        build: ct_skin,
        gradient: &[],
    },
    Preset {
        name: "ct-muscle",
        description: "CT: opaque muscle and organs without fat and skin, pale bone",
        material: material(0.45, 0.85, 0.15, 20.0),
        build: ct_muscle,
        gradient: &[],
    },
    Preset {
        name: "ct-soft-tissue",
        description: "CT: translucent skin and organs, bone within",
        material: material(0.45, 0.8, 0.2, 20.0),
        build: ct_soft_tissue,
        gradient: &[(0.0, 0.1), (0.05, 0.1), (0.2, 1.0)],
    },
    Preset {
        name: "ct-lung",
        description: "CT: lungs with their vessels and airways in clear flesh",
        material: material(0.4, 0.7, 0.2, 20.0),
        build: ct_lung,
        gradient: &[],
    },
    Preset {
        name: "angiography",
        description: "CT or MR angiogram: vessels full of contrast agent or of flowing blood",
        material: material(0.4, 0.8, 0.3, 30.0),
        build: angiography,
        gradient: &[],
    },
    Preset {
        name: "mri",
        description: "MRI, T1 or T2: dense tissue in greys, brighter and denser with value",
        material: material(0.4, 0.8, 0.15, 20.0),
        build: mri,
        gradient: &[],
    },
    Preset {
        name: "mr-brain",
        description: "MRI: the opaque surface of a brain whose skull was masked away",
        material: material(0.4, 0.8, 0.25, 24.0),
        build: mr_brain,
        gradient: &[],
    },
    Preset {
        name: "pet",
        description: "PET or SPECT: dense uptake in a dim body",
        material: material(0.5, 0.7, 0.1, 20.0),
        build: pet,
        gradient: &[],
    },
    Preset {
        name: "activation",
        description: "statistical map: what is far over 0 in orange, what is far under 0 in blue",
        material: material(0.5, 0.7, 0.15, 20.0),
        build: activation,
        gradient: &[],
    },
    Preset {
        name: "fluorescence",
        description: "microscopy: cells that glow green in the dark",
        material: material(0.6, 0.7, 0.1, 20.0),
        build: fluorescence,
        gradient: &[],
    },
    Preset {
        name: "field",
        description: "simulation: the colour map viridis, denser with value",
        material: material(0.55, 0.6, 0.1, 20.0),
        build: field,
        gradient: &[],
    },
    Preset {
        name: "grayscale",
        description: "black to white, denser with value",
        material: None,
        build: grayscale,
        gradient: &[],
    },
    Preset {
        name: "gray",
        description: "the colour map gray with a gentle ramp of opacity",
        material: None,
        build: gray,
        gradient: &[],
    },
    Preset {
        name: "viridis",
        description: "the colour map viridis with a gentle ramp of opacity",
        material: None,
        build: viridis,
        gradient: &[],
    },
    Preset {
        name: "inferno",
        description: "the colour map inferno with a gentle ramp of opacity",
        material: None,
        build: inferno,
        gradient: &[],
    },
];

/// The preset `name`, fitted to a volume with these statistics.
///
/// # Errors
/// [`Error::Transfer`] if there is no such preset (the message lists them), or if all values are the same.
pub fn preset(name: &str, volume: &Volume, statistics: &Statistics) -> Result<TransferFunction> {
    let preset = find(name)?;
    let levels = Levels::of(volume.value_unit(), statistics).ok_or_else(|| {
        Error::Transfer(format!(
            "preset {name} adapts to the range of the values, but they are all {}: give control points instead",
            statistics.min
        ))
    })?;
    // A range of values over a small spacing may be over that of f64.
    let steep = (levels.tissue() / volume.grid().min_spacing()).min(f64::MAX);
    let point = |&(magnitude, opacity): &(f64, f64)| GradientPoint { magnitude: magnitude * steep, opacity };
    TransferFunction::new((preset.build)(&levels), None)?
        .with_gradient_opacity(preset.gradient.iter().map(point).collect())
}

/// The preset with a name.
///
/// # Errors
/// [`Error::Transfer`] if there is none; the message lists them.
pub fn find(name: &str) -> Result<&'static Preset> {
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

/// Guesses a preset from the values; the reason says which property decided. Bounds are rules of thumb.
#[must_use]
pub fn suggest(volume: &Volume, statistics: &Statistics) -> Suggestion {
    let say = |name, reason: String| Suggestion { name, reason };
    let &Statistics { min, max, mean, std_dev, .. } = statistics;
    if is_hounsfield(volume.value_unit(), statistics) {
        return say(
            "ct-bone",
            format!("values from {} to {} look like Hounsfield units", readable(min), readable(max)),
        );
    }
    if let Some(unit) = volume.value_unit().filter(|unit| STATISTICS.contains(unit)) {
        return say("activation", format!("the file says that its values are statistics ({unit})"));
    }
    let oriented = volume.is_oriented();
    if volume.sample_type().is_float() && !oriented {
        return say("field", "real numbers without a patient orientation: no scan, a field".to_owned());
    }
    let Some(levels) = Levels::of(volume.value_unit(), statistics) else {
        return say("grayscale", format!("all values are {}", readable(min)));
    };
    if oriented && -min > max / 4.0 && max > -min / 4.0 && mean.abs() < std_dev / 2.0 {
        let (min, max) = (readable(min), readable(max));
        return say("activation", format!("values from {min} to {max} lie about 0, as statistics do"));
    }
    let foreground = statistics.fraction_above(levels.background);
    let median = statistics.quantile_above(levels.background, 0.5);
    let skewed = median < between(levels.background, levels.high, 0.2);
    if !oriented && skewed && foreground < 0.2 {
        let dark = 100.0 * (1.0 - foreground);
        let reason =
            format!("{dark:.1} % are dark and most others dim, without a patient orientation: as in microscopy");
        return say("fluorescence", reason);
    }
    // Otsu's threshold within the brighter class separates bone or contrast agent from flesh in CT: a minority of the
    // foreground. In MRI no tissue stands out like that, and about half of the foreground lies on either side.
    let share = 100.0 * statistics.fraction_above(levels.bright) / foreground.max(f64::MIN_POSITIVE);
    let saw = format!("{share:.1} % of the foreground is over {}", readable(levels.bright));
    let spacing = volume.grid().min_spacing();
    let in_millimetres = volume.length_unit().is_none_or(|unit| unit == "mm");
    if share < 3.0 && skewed && oriented && in_millimetres && spacing >= 1.8 {
        return say("pet", format!("{saw} in voxels of {spacing:.1} mm: few and far brighter, as uptake in PET is"));
    }
    if share < 3.0 {
        return say(
            "angiography",
            format!("{saw}: thin and far brighter than the rest, as vessels with contrast agent are"),
        );
    }
    // The magnitude of complex noise is positive and hardly ever 0. What CT scanners make of air is noise about a
    // value, or cut off at one.
    let background = 1.0 - foreground;
    let (floor, at_floor) = (levels.background / 10.0, 1.0 - statistics.fraction_above(min));
    if (0.0..floor).contains(&min) && at_floor < background / 10.0 {
        return say("mri", format!("the background is noise from {} up, as in MRI", readable(min)));
    }
    if share < 30.0 {
        return say("ct-bone", format!("{saw}: a bright minority, as bone in CT is"));
    }
    if at_floor >= background {
        let nothing = 100.0 * at_floor;
        let reason = format!(
            "no bright minority stands out, and {nothing:.1} % are {}, as in masked MRI of brains",
            readable(min)
        );
        return say("mr-brain", reason);
    }
    say("mri", format!("{saw}: no bright minority stands out, as in MRI"))
}

/// Units of statistics that lie about 0: of Student's t, z scores and correlations.
const STATISTICS: [&str; 3] = ["t", "z", "r"];

impl TransferFunction {
    /// A preset fitted to the values of a volume, which are all read.
    ///
    /// # Errors
    /// [`Error::Transfer`] as [`preset`]; [`Error::Input`] and [`Error::Memory`] if samples left
    /// in a file cannot be read.
    pub fn preset(name: &str, volume: &Volume) -> Result<Self> {
        preset(name, volume, &Statistics::of(volume)?)
    }

    /// The preset that [`suggest`] chooses for a volume, fitted to its values, and the reason for the choice.
    ///
    /// A built-in volume has a better one of its own: [`own_transfer`](crate::demos::own_transfer).
    ///
    /// # Errors
    /// [`Error::Transfer`] if all values are the same: then there is no range to fit to.
    pub fn for_volume(volume: &Volume, statistics: &Statistics) -> Result<(Self, Suggestion)> {
        let suggestion = suggest(volume, statistics);
        Ok((preset(suggestion.name, volume, statistics)?, suggestion))
    }
}

/// Whether values are Hounsfield units, or look like them: air (-1000) is far below 0, and bone or contrast agent far
/// above it. Values far outside the range of scanners are another quantity.
fn is_hounsfield(unit: Option<&str>, s: &Statistics) -> bool {
    unit == Some("HU") || s.min < -200.0 && s.max > 300.0 && s.min >= -10_000.0 && s.max <= 100_000.0
}

/// The values at which presets place their points, ascending but for the last two; neighbours may be equal.
struct Levels {
    hounsfield: bool,
    /// The end of the background.
    background: f64,
    /// Otsu's threshold of all values.
    object: f64,
    /// Otsu's threshold of the foreground, and of what is over it until under a quarter of the foreground is.
    vessel: f64,
    /// Otsu's threshold of the values over `object`.
    bright: f64,
    /// The 99.9th percentile of the values over `bright`: the end of the hardest tissue.
    top: f64,
    /// The 99.5th percentile of the foreground: the end of ramps over all of it.
    high: f64,
    /// How far from 0 a statistic is more than noise.
    significant: f64,
    /// How far from 0 the strongest statistics are.
    strongest: f64,
}

impl Levels {
    /// Those of values of a unit, if it is known.
    fn of(unit: Option<&str>, s: &Statistics) -> Option<Self> {
        let object = s.otsu(f64::NEG_INFINITY)?;
        let background = s.background()?.limit.min(object);
        let mut vessel = s.otsu(background).unwrap_or(object).max(object);
        while s.fraction_above(vessel) > s.fraction_above(background) / 4.0
            && let Some(above) = s.otsu(vessel).filter(|above| *above > vessel)
        {
            vessel = above;
        }
        let bright = s.otsu(object).unwrap_or(object);
        let top = s.quantile_above(bright, 0.999).max(bright).max(vessel);
        let high = s.quantile_above(background, 0.995).max(background);
        let far = s.quantile_above(0.0, 0.998).max(-s.quantile(0.0005));
        let strongest = if far > 0.0 { far } else { s.min.abs().max(s.max.abs()) };
        // Half of normally distributed noise is within 0.6745 standard deviations, and 0.3 % beyond 3. A z score or a
        // Student's t of 3 is one that chance brings about as often.
        let scores = unit.is_some_and(|unit| unit != "r" && STATISTICS.contains(&unit));
        let noise = if scores { 3.0 } else { s.quantile_above(background.max(0.0), 0.5) / 0.6745 * 3.0 };
        let significant = if noise > 0.0 { noise.min(strongest / 2.0) } else { strongest / 2.0 };
        Some(Self {
            hounsfield: is_hounsfield(unit, s),
            background,
            object,
            vessel,
            bright,
            top,
            high,
            significant,
            strongest,
        })
    }

    /// The range of values from the background to bone, which the gradients of surfaces scale with.
    fn tissue(&self) -> f64 {
        if self.hounsfield { 1700.0 } else { self.bright - self.background }
    }
}

/// The values of the foreground, up to its 99.5th percentile; `None` if all values are the same.
pub(super) fn foreground(statistics: &Statistics) -> Option<[f64; 2]> {
    Levels::of(None, statistics).map(|levels| [levels.background, levels.high])
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
        (150.0, 280.0, 600.0, 1600.0)
    } else {
        (between(l.object, l.bright, 0.75), l.bright, between(l.bright, l.top, 0.4), l.top)
    };
    points(&[(clear, 0xa0_6c48, 0.0), (soft, 0xd8_b088, 0.12), (hard, 0xf2_e0c4, 0.35), (top, 0xff_f8ec, 0.6)])
}

fn ct_skin(l: &Levels) -> Vec<ControlPoint> {
    // Half way from air at -1000 to fat at -100 HU and to water.
    let (air, skin, inside) = if l.hounsfield {
        (-500.0, -200.0, 1000.0)
    } else {
        let at = |f| between(l.background, l.object, f);
        (at(0.35), at(0.9), l.bright)
    };
    points(&[(air, 0xa8_6a50, 0.0), (skin, 0xdc_a084, 0.5), (inside, 0xf0_c0a0, 0.8)])
}

fn ct_muscle(l: &Levels) -> Vec<ControlPoint> {
    // Over fat, which ends at -50 HU. Muscle and organs 20 to 80, bone from 200 HU.
    let (fat, flesh, dense, bone, top) = if l.hounsfield {
        (-30.0, 20.0, 70.0, 250.0, 1000.0)
    } else {
        let at = |f| between(l.object, l.bright, f);
        (l.object, at(0.3), at(0.6), l.bright, l.top)
    };
    points(&[
        (fat, 0x3a_140e, 0.0),
        (flesh, 0x8c_3a2c, 0.12),
        (dense, 0xb4_5642, 0.3),
        (bone, 0xe8_c8a0, 0.5),
        (top, 0xff_faf0, 0.8),
    ])
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
        (air, 0x6a_2c1a, 0.0),
        (fat, 0xd0_8c68, 0.06),
        (flesh, 0xd0_7054, 0.06),
        (bone, 0xec_d0a4, 0.2),
        (top, 0xff_faf0, 0.6),
    ])
}

fn ct_lung(l: &Levels) -> Vec<ControlPoint> {
    // Lungs lie from -900 to -700 HU. Their vessels and their surface mix with them: a band below fat at -120 HU.
    let at = |f| if l.hounsfield { between(-940.0, -140.0, f) } else { between(l.background, l.object, f) };
    points(&[
        (at(0.0), 0x48_6088, 0.0),
        (at(0.1), 0x68_86b4, 0.004),
        (at(0.3), 0xa0_a4c0, 0.012),
        (at(0.5), 0xf0_a890, 0.1),
        (at(0.74), 0xf8_d8c0, 0.2),
        (at(0.9), 0xff_e8d8, 0.1),
        (at(1.0), 0xff_f0e8, 0.0),
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
    points(&[(clear, 0x50_060a, 0.0), (thin, 0xb4_1c18, 0.15), (full, 0xec_6c38, 0.5), (top, 0xff_f5dc, 0.85)])
}

fn mri(l: &Levels) -> Vec<ControlPoint> {
    let at = |f| between(l.background, l.object, f);
    points(&[
        (l.background, 0x14_100e, 0.0),
        (at(0.3), 0x4a_2c20, 0.0),
        (at(0.8), 0x8c_5c44, 0.05),
        (l.bright, 0xd0_b49c, 0.2),
        (between(l.bright, l.top, 0.6), 0xe8_dcd0, 0.4),
        (l.top, 0xff_ffff, 0.6),
    ])
}

fn mr_brain(l: &Levels) -> Vec<ControlPoint> {
    points(&[
        (l.background, 0x30_181a, 0.0),
        (between(l.background, l.object, 0.6), 0x6a_3c3c, 0.0),
        (between(l.object, l.bright, 0.15), 0xb0_8078, 0.3),
        (l.bright, 0xe0_b8ac, 0.55),
        (between(l.bright, l.top, 0.6), 0xf6_e6dc, 0.7),
        (l.top, 0xff_ffff, 0.8),
    ])
}

fn pet(l: &Levels) -> Vec<ControlPoint> {
    let at = |f| between(l.background, l.high, f);
    points(&[
        (at(0.0), 0x00_0010, 0.0),
        (at(0.06), 0x20_2060, 0.006),
        (at(0.2), 0x5a_1e96, 0.02),
        (at(0.4), 0xc8_3c5a, 0.08),
        (at(0.65), 0xfa_8c1e, 0.25),
        (at(1.0), 0xff_f4b4, 0.6),
    ])
}

fn activation(l: &Levels) -> Vec<ControlPoint> {
    let (low, high) = (l.significant, l.strongest);
    let mid = between(high, low, 0.6);
    points(&[
        (-high, 0xa0_f0ff, 0.8),
        (-mid, 0x20_80ff, 0.5),
        (-low, 0x18_28b0, 0.2),
        (-0.8 * low, 0x10_1870, 0.0),
        (0.8 * low, 0x70_1008, 0.0),
        (low, 0xc0_2010, 0.2),
        (mid, 0xff_8010, 0.5),
        (high, 0xff_f080, 0.8),
    ])
}

fn fluorescence(l: &Levels) -> Vec<ControlPoint> {
    let at = |f| between(l.background, l.high, f);
    points(&[
        (at(0.02), 0x00_401c, 0.0),
        (at(0.15), 0x10_a048, 0.06),
        (at(0.5), 0x40_e868, 0.3),
        (at(1.0), 0xd0_ffa8, 0.6),
    ])
}

fn grayscale(l: &Levels) -> Vec<ControlPoint> {
    points(&[(l.background, 0x00_0000, 0.0), (l.high, 0xff_ffff, 0.2)])
}

/// A colour map over the foreground. Opacity rises with the square of the position in the map, to `densest`.
fn map(l: &Levels, densest: f64, color: impl Fn(f64) -> colorous::Color) -> Vec<ControlPoint> {
    const STEPS: u32 = 16;
    (0..=STEPS)
        .map(|i| {
            let f = f64::from(i) / f64::from(STEPS);
            let colorous::Color { r, g, b } = color(f);
            ControlPoint {
                value: between(l.background, l.high, f),
                color: [r, g, b].map(|c| f64::from(c) / 255.0),
                opacity: densest * f * f,
            }
        })
        .collect()
}

/// The opacity at the end of a gentle ramp.
const GENTLE: f64 = 0.1;

fn gray(l: &Levels) -> Vec<ControlPoint> {
    // The map of `colorous` runs from white to black.
    map(l, GENTLE, |f| colorous::GREYS.eval_continuous(1.0 - f))
}

fn viridis(l: &Levels) -> Vec<ControlPoint> {
    map(l, GENTLE, |f| colorous::VIRIDIS.eval_continuous(f))
}

fn inferno(l: &Levels) -> Vec<ControlPoint> {
    map(l, GENTLE, |f| colorous::INFERNO.eval_continuous(f))
}

fn field(l: &Levels) -> Vec<ControlPoint> {
    map(l, 0.3, |f| colorous::VIRIDIS.eval_continuous(f))
}
