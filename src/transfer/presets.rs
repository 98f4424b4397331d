//! Presets: transfer functions by name, fitted to the values of a volume, with materials for lit surfaces.
//!
//! All opacities are per voxel (the smallest spacing). The background has opacity 0 exactly, so it needs no splats.
//! Colours darken with falling value, so that depth and edges show without light.

use super::{ControlPoint, GradientPoint, TransferFunction, maps};
use crate::error::{Error, Result};
use crate::lighting::Lighting;
use crate::transfer::color;
use crate::volume::{Statistics, Volume};
use voxsplat_volume::names::named;

/// A preset: a named method that makes a transfer function from the values of a volume.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct Preset {
    /// The name of the preset on the command line.
    pub name: &'static str,
    /// The data that the preset suits and the picture, in a few words.
    pub description: &'static str,
    /// The material of the lit surfaces that the preset shows; `None`: it shows translucent matter, without light.
    pub material: Option<Material>,
    ramp: Ramp,
    /// The gradient opacity of the preset: gradients in ranges of the tissue per voxel, and the share of extinction
    /// that stays.
    gradient: &'static [(f64, f64)],
}

/// A control point of a preset: its value, colour `0xrrggbb` and opacity.
type Row = (fn(&Levels) -> f64, u32, f64);

/// The control points of a preset.
#[derive(Debug, Clone, Copy)]
enum Ramp {
    Points(&'static [Row]),
    /// A colour map over the foreground. Opacity rises with the square of the place in the map, up to the given one.
    Map(fn(f64) -> colorous::Color, f64),
}

/// The material fields of [`Lighting`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Material {
    /// The share of ambient light, [`Lighting::ambient`].
    pub ambient: f64,
    /// The share of diffuse light, [`Lighting::diffuse`].
    pub diffuse: f64,
    /// The strength of the highlight, [`Lighting::specular`].
    pub specular: f64,
    /// The exponent of the highlight, [`Lighting::shininess`].
    pub shininess: f64,
}

impl Material {
    /// Returns the lighting with this material.
    #[must_use]
    pub fn lit(self, lighting: Lighting) -> Lighting {
        let Self { ambient, diffuse, specular, shininess } = self;
        Lighting { ambient, diffuse, specular, shininess, ..lighting }
    }
}

/// Makes a preset without light.
const fn preset_of(name: &'static str, description: &'static str, ramp: Ramp) -> Preset {
    Preset { name, description, material: None, ramp, gradient: &[] }
}

impl Preset {
    /// Returns the preset with lit surfaces of this material.
    const fn lit(self, ambient: f64, diffuse: f64, specular: f64, shininess: f64) -> Self {
        Self { material: Some(Material { ambient, diffuse, specular, shininess }), ..self }
    }
}

/// All presets.
pub const PRESETS: &[Preset] = &[
    preset_of("ct-bone", "CT: opaque bone in clear flesh", CT_BONE).lit(0.4, 0.8, 0.2, 24.0),
    preset_of("ct-skin", "CT: the opaque outside, skin or scales", CT_SKIN).lit(0.45, 0.9, 0.12, 12.0),
    preset_of("ct-muscle", "CT: opaque muscle and organs without fat and skin, pale bone", CT_MUSCLE)
        .lit(0.45, 0.85, 0.15, 20.0),
    Preset {
        gradient: &[(0.0, 0.1), (0.05, 0.1), (0.2, 1.0)],
        ..preset_of("ct-soft-tissue", "CT: translucent skin and organs, bone within", CT_SOFT_TISSUE)
            .lit(0.45, 0.8, 0.2, 20.0)
    },
    preset_of("ct-lung", "CT: lungs with their vessels and airways in clear flesh", CT_LUNG).lit(0.4, 0.7, 0.2, 20.0),
    preset_of("angiography", "CT or MR angiogram: vessels full of contrast agent or of flowing blood", ANGIOGRAPHY)
        .lit(0.4, 0.8, 0.3, 30.0),
    preset_of("mri", "MRI, T1 or T2: dense tissue in greys, brighter and denser with value", MRI)
        .lit(0.4, 0.8, 0.15, 20.0),
    preset_of("mr-brain", "MRI: the opaque surface of a brain whose skull was masked away", MR_BRAIN)
        .lit(0.4, 0.8, 0.25, 24.0),
    preset_of("pet", "PET or SPECT: dense uptake in a dim body", PET).lit(0.5, 0.7, 0.1, 20.0),
    preset_of("activation", "statistical map: values far over 0 in orange, values far under 0 in blue", ACTIVATION)
        .lit(0.5, 0.7, 0.15, 20.0),
    preset_of("fluorescence", "microscopy: cells that glow green in the dark", FLUORESCENCE).lit(0.6, 0.7, 0.1, 20.0),
    preset_of("field", "simulation: the colour map viridis, denser with value", Ramp::Map(VIRIDIS, 0.3))
        .lit(0.55, 0.6, 0.1, 20.0),
    preset_of("grayscale", "black to white, denser with value", GRAYSCALE),
    preset_of("gray", "the colour map gray with a gentle ramp of opacity", Ramp::Map(GRAY, GENTLE)),
    preset_of("viridis", "the colour map viridis with a gentle ramp of opacity", Ramp::Map(VIRIDIS, GENTLE)),
    preset_of("inferno", "the colour map inferno with a gentle ramp of opacity", Ramp::Map(INFERNO, GENTLE)),
];

/// The opacity at the end of a gentle ramp.
const GENTLE: f64 = 0.1;

const GRAY: fn(f64) -> colorous::Color = |f| colorous::GREYS.eval_continuous(1.0 - f); // white to black
const VIRIDIS: fn(f64) -> colorous::Color = |f| colorous::VIRIDIS.eval_continuous(f);
const INFERNO: fn(f64) -> colorous::Color = |f| colorous::INFERNO.eval_continuous(f);

/// Bone in CT. Trabecular bone starts near 150 HU, cortical bone lies from 500 to 1900 HU.
const CT_BONE: Ramp = Ramp::Points(&[
    (|l| l.hu(150.0, between(l.object, l.bright, 0.75)), 0xa0_6c48, 0.0),
    (|l| l.hu(280.0, l.bright), 0xd8_b088, 0.12),
    (|l| l.hu(600.0, between(l.bright, l.top, 0.4)), 0xf2_e0c4, 0.35),
    (|l| l.hu(1600.0, l.top), 0xff_f8ec, 0.6),
]);

/// Skin in CT, which begins half way from air at -1000 HU to fat at -100 HU and to water.
const CT_SKIN: Ramp = Ramp::Points(&[
    (|l| l.hu(-500.0, between(l.background, l.object, 0.35)), 0xa8_6a50, 0.0),
    (|l| l.hu(-200.0, between(l.background, l.object, 0.9)), 0xdc_a084, 0.5),
    (|l| l.hu(1000.0, l.bright), 0xf0_c0a0, 0.8),
]);

/// Muscle in CT, above fat, which ends at -50 HU. Muscle and organs have 20 to 80 HU, bone has 200 HU and more.
const CT_MUSCLE: Ramp = Ramp::Points(&[
    (|l| l.hu(-30.0, l.object), 0x3a_140e, 0.0),
    (|l| l.hu(20.0, between(l.object, l.bright, 0.3)), 0x8c_3a2c, 0.12),
    (|l| l.hu(70.0, between(l.object, l.bright, 0.6)), 0xb4_5642, 0.3),
    (|l| l.hu(250.0, l.bright), 0xe8_c8a0, 0.5),
    (|l| l.hu(1000.0, l.top), 0xff_faf0, 0.8),
]);

/// Soft tissue in CT. Fat has -120 HU and more, muscle and organs have 20 to 80 HU, bone has 200 HU and more.
const CT_SOFT_TISSUE: Ramp = Ramp::Points(&[
    (|l| l.hu(-300.0, between(l.background, l.bright, 0.15)), 0x6a_2c1a, 0.0),
    (|l| l.hu(-100.0, between(l.background, l.bright, 0.35)), 0xd0_8c68, 0.06),
    (|l| l.hu(50.0, between(l.background, l.bright, 0.7)), 0xd0_7054, 0.06),
    (|l| l.hu(250.0, l.bright), 0xec_d0a4, 0.2),
    (|l| l.hu(1500.0, l.top), 0xff_faf0, 0.6),
]);

/// Lungs in CT, with -900 to -700 HU. Their vessels and their surface mix with lung: a band below fat at -120 HU.
const CT_LUNG: Ramp = Ramp::Points(&[
    (|l| l.hu(-940.0, between(l.background, l.object, 0.0)), 0x48_6088, 0.0),
    (|l| l.hu(-860.0, between(l.background, l.object, 0.1)), 0x68_86b4, 0.004),
    (|l| l.hu(-700.0, between(l.background, l.object, 0.3)), 0xa0_a4c0, 0.012),
    (|l| l.hu(-540.0, between(l.background, l.object, 0.5)), 0xf0_a890, 0.1),
    (|l| l.hu(-348.0, between(l.background, l.object, 0.74)), 0xf8_d8c0, 0.2),
    (|l| l.hu(-220.0, between(l.background, l.object, 0.9)), 0xff_e8d8, 0.1),
    (|l| l.hu(-140.0, between(l.background, l.object, 1.0)), 0xff_f0e8, 0.0),
]);

/// Angiograms. Blood with contrast agent has 150 to 500 HU; calcium, stents and bone have more.
const ANGIOGRAPHY: Ramp = Ramp::Points(&[
    (|l| l.hu(120.0, between(l.vessel, l.top, 0.0)), 0x50_060a, 0.0),
    (|l| l.hu(200.0, between(l.vessel, l.top, 0.06)), 0xb4_1c18, 0.15),
    (|l| l.hu(450.0, between(l.vessel, l.top, 0.3)), 0xec_6c38, 0.5),
    (|l| l.hu(1200.0, l.top), 0xff_f5dc, 0.85),
]);

const MRI: Ramp = Ramp::Points(&[
    (|l| l.background, 0x14_100e, 0.0),
    (|l| between(l.background, l.object, 0.3), 0x4a_2c20, 0.0),
    (|l| between(l.background, l.object, 0.8), 0x8c_5c44, 0.05),
    (|l| l.bright, 0xd0_b49c, 0.2),
    (|l| between(l.bright, l.top, 0.6), 0xe8_dcd0, 0.4),
    (|l| l.top, 0xff_ffff, 0.6),
]);

const MR_BRAIN: Ramp = Ramp::Points(&[
    (|l| l.background, 0x30_181a, 0.0),
    (|l| between(l.background, l.object, 0.6), 0x6a_3c3c, 0.0),
    (|l| between(l.object, l.bright, 0.15), 0xb0_8078, 0.3),
    (|l| l.bright, 0xe0_b8ac, 0.55),
    (|l| between(l.bright, l.top, 0.6), 0xf6_e6dc, 0.7),
    (|l| l.top, 0xff_ffff, 0.8),
]);

const PET: Ramp = Ramp::Points(&[
    (|l| between(l.background, l.high, 0.0), 0x00_0010, 0.0),
    (|l| between(l.background, l.high, 0.06), 0x20_2060, 0.006),
    (|l| between(l.background, l.high, 0.2), 0x5a_1e96, 0.02),
    (|l| between(l.background, l.high, 0.4), 0xc8_3c5a, 0.08),
    (|l| between(l.background, l.high, 0.65), 0xfa_8c1e, 0.25),
    (|l| between(l.background, l.high, 1.0), 0xff_f4b4, 0.6),
]);

const ACTIVATION: Ramp = Ramp::Points(&[
    (|l| -l.strongest, 0xa0_f0ff, 0.8),
    (|l| -between(l.strongest, l.significant, 0.6), 0x20_80ff, 0.5),
    (|l| -l.significant, 0x18_28b0, 0.2),
    (|l| -0.8 * l.significant, 0x10_1870, 0.0),
    (|l| 0.8 * l.significant, 0x70_1008, 0.0),
    (|l| l.significant, 0xc0_2010, 0.2),
    (|l| between(l.strongest, l.significant, 0.6), 0xff_8010, 0.5),
    (|l| l.strongest, 0xff_f080, 0.8),
]);

const FLUORESCENCE: Ramp = Ramp::Points(&[
    (|l| between(l.background, l.high, 0.02), 0x00_401c, 0.0),
    (|l| between(l.background, l.high, 0.15), 0x10_a048, 0.06),
    (|l| between(l.background, l.high, 0.5), 0x40_e868, 0.3),
    (|l| between(l.background, l.high, 1.0), 0xd0_ffa8, 0.6),
]);

const GRAYSCALE: Ramp = Ramp::Points(&[(|l| l.background, 0x00_0000, 0.0), (|l| l.high, 0xff_ffff, 0.2)]);

impl Ramp {
    /// Returns the control points for the values of a volume.
    fn points(self, levels: &Levels) -> Vec<ControlPoint> {
        match self {
            Self::Points(rows) => {
                let point = |&(value, rgb, opacity): &Row| {
                    let (value, color) = (value(levels), color::packed(rgb));
                    ControlPoint { value, color, opacity }
                };
                rows.iter().map(point).collect()
            }
            Self::Map(map, densest) => {
                let point = |step: u32| {
                    let f = f64::from(step) / f64::from(MAP_STEPS);
                    let value = between(levels.background, levels.high, f);
                    ControlPoint { value, color: maps::rgb(map(f)), opacity: densest * f * f }
                };
                (0..=MAP_STEPS).map(point).collect()
            }
        }
    }
}

/// The values at which a preset places its points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum PresetValues {
    /// Absolute values if the file states Hounsfield units or statistics, or if the values look like Hounsfield units;
    /// otherwise fitted.
    #[default]
    Auto,
    /// Absolute values: Hounsfield units for presets of CT and for angiography, and scores of statistics from 3 on.
    Absolute,
    /// Values fitted to the histogram.
    Fitted,
}

named!("preset_values", PresetValues { Auto: "auto", Absolute: "absolute", Fitted: "fitted" });

/// The number of steps between the control points of a colour map.
const MAP_STEPS: u32 = 16;

/// Fits the preset `name` to a volume with these statistics.
///
/// # Errors
/// [`Error::Transfer`] if there is no such preset (the message lists them), or if all values are the same.
pub fn preset(name: &str, volume: &Volume, statistics: &Statistics, values: PresetValues) -> Result<TransferFunction> {
    let preset = find(name)?;
    let unit = volume.value_unit();
    let is_absolute = |stated: bool| match values {
        PresetValues::Auto => stated,
        PresetValues::Absolute => true,
        PresetValues::Fitted => false,
    };
    let hounsfield = is_absolute(unit == Some("HU") || is_hounsfield(statistics));
    // A correlation that chance makes depends on the number of samples.
    let scores = is_absolute(unit.is_some_and(|unit| unit != "r" && STATISTICS.contains(&unit)));
    let levels = Levels::new(statistics, hounsfield, scores).ok_or_else(|| {
        Error::Transfer(format!(
            "preset {name} adapts to the range of the values, but all values are {}: give a file of control points",
            statistics.min
        ))
    })?;
    // A wide range of values over a small spacing may exceed f64.
    let steep = (levels.tissue() / volume.grid().min_spacing()).min(f64::MAX);
    let point = |&(magnitude, opacity): &(f64, f64)| GradientPoint { magnitude: magnitude * steep, opacity };
    TransferFunction::new(preset.ramp.points(&levels), None)?
        .with_gradient_opacity(preset.gradient.iter().map(point).collect())
}

/// Finds the preset with a name.
///
/// # Errors
/// [`Error::Transfer`] if there is no such preset; the message lists all.
pub fn find(name: &str) -> Result<&'static Preset> {
    PRESETS.iter().find(|p| p.name == name).ok_or_else(|| {
        let names: Vec<&str> = PRESETS.iter().map(|p| p.name).collect();
        Error::Transfer(format!("no preset is called {name:?}: there are {}", names.join(", ")))
    })
}

/// The units of statistics that lie about 0: Student's t, z scores and correlations.
pub(crate) const STATISTICS: [&str; 3] = ["t", "z", "r"];

impl TransferFunction {
    /// Fits a preset to the values of a volume. Reads all samples.
    ///
    /// # Errors
    /// [`Error::Transfer`] as [`preset`]; [`Error::Input`] and [`Error::Memory`] if samples left in a file cannot be
    /// read.
    pub fn preset(name: &str, volume: &Volume) -> Result<Self> {
        preset(name, volume, &Statistics::of(volume)?, PresetValues::Auto)
    }
}

/// Returns whether values look like Hounsfield units: a hundredth of the voxels or more are air or lung, far below 0,
/// and bone or contrast agent is far above it. Values far outside the range of scanners are another quantity.
pub(crate) fn is_hounsfield(s: &Statistics) -> bool {
    let has_air = s.min < -200.0 && s.fraction_above(-200.0) <= 0.99;
    has_air && s.max > 300.0 && s.min >= -10_000.0 && s.max <= 100_000.0
}

/// Statistics of a volume at which presets place their points, ascending except for the last two; neighbours may be
/// equal.
struct Levels {
    hounsfield: bool,
    /// The end of the background.
    background: f64,
    /// Otsu's threshold of all values.
    object: f64,
    /// Otsu's threshold of the foreground, applied again to the values above it until less than a quarter of the
    /// foreground is left.
    vessel: f64,
    /// Otsu's threshold of the values over `object`.
    bright: f64,
    /// The 99.9th percentile of the values over `bright`: the end of the hardest tissue.
    top: f64,
    /// The 99.5th percentile of the foreground: the end of ramps over all of it.
    high: f64,
    /// The distance from 0 above which a statistic is more than noise.
    significant: f64,
    /// The distance of the strongest statistics from 0.
    strongest: f64,
}

impl Levels {
    /// Finds the levels of values, which may be Hounsfield units or scores; `None` if all values are the same.
    fn new(s: &Statistics, hounsfield: bool, scores: bool) -> Option<Self> {
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
        // Half of normally distributed noise is within 0.6745 standard deviations, and 0.3 % beyond 3. Chance makes a z
        // score or a Student's t over 3 as often.
        let noise = if scores { 3.0 } else { s.quantile_above(background.max(0.0), 0.5) / 0.6745 * 3.0 };
        let significant = if noise > 0.0 { noise.min(strongest / 2.0) } else { strongest / 2.0 };
        Some(Self { hounsfield, background, object, vessel, bright, top, high, significant, strongest })
    }

    /// Returns a value in Hounsfield units if the volume has them, and another value otherwise.
    fn hu(&self, hounsfield: f64, other: f64) -> f64 {
        if self.hounsfield { hounsfield } else { other }
    }

    /// Returns the range of values from the background to bone: gradients of surfaces scale with it.
    fn tissue(&self) -> f64 {
        self.hu(1700.0, self.bright - self.background)
    }
}

/// Returns the distance from 0 above which a statistic is more than noise, and the distance of the strongest ones;
/// `None` if all values are the same. Noise is below `score` if the values are scores.
pub(crate) fn significance(statistics: &Statistics, score: Option<f64>) -> Option<[f64; 2]> {
    let Levels { significant, strongest, .. } = Levels::new(statistics, false, false)?;
    Some([score.map_or(significant, |score| score.min(0.75 * strongest)), strongest])
}

/// Returns the range of values of the foreground, up to its 99.5th percentile; `None` if all values are the same.
pub(super) fn foreground(statistics: &Statistics) -> Option<[f64; 2]> {
    Levels::new(statistics, false, false).map(|levels| [levels.background, levels.high])
}

/// Interpolates linearly from `a` (f = 0) to `b` (f = 1).
pub(super) fn between(a: f64, b: f64, f: f64) -> f64 {
    let width = b - a;
    // Between the ends of the range of f64 the width overflows.
    if width.is_finite() { a + width * f } else { a * (1.0 - f) + b * f }
}
