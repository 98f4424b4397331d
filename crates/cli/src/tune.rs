//! `--tune KEY=VALUE`: knobs that few pictures need, in one table. Parsing, help, notes and errors are made of it.

use voxsplat::formats::LoadOptions;
use voxsplat::kernel::Normalization;
use voxsplat::settings::{Interslice, QuadsSettings, Settings, TilesSettings};

use super::parse::{self, PainterArg, library};
use super::rules::{
    BY_REFERENCE, Given, NEEDS_LIGHT, Rule, casts, idle, is_lit, is_post_shaded, occludes, refused, shows_intensity,
};

/// A knob of `--tune`.
pub(crate) struct Knob {
    pub(crate) key: &'static str,
    /// The values that it takes, with their unit and range.
    values: &'static str,
    default: &'static str,
    /// The painter that has the knob, and that the knob chooses; `None` if every painter has it.
    painter: Option<PainterArg>,
    help: &'static str,
    set: fn(&mut Tuning, &str) -> Result<(), String>,
    /// Conditions that take the effect from the knob of any painter.
    rules: &'static [Rule],
}

/// What `--tune` sets.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Tuning {
    /// The painter that a knob chooses.
    pub(crate) painter: Option<PainterArg>,
    pub(crate) quads: QuadsSettings,
    pub(crate) tiles: TilesSettings,
    pub(crate) interslice: Interslice,
    pub(crate) normalization: Normalization,
    pub(crate) termination: f64,
    pub(crate) antialiasing: bool,
    /// Voxels; `None` leaves the choice to the lights.
    pub(crate) shadow_bias: Option<f64>,
    /// Pixels that the reference traces.
    pub(crate) sample: u32,
    /// Bytes.
    pub(crate) stream_over: u64,
}

impl Default for Tuning {
    fn default() -> Self {
        let settings = Settings::default();
        Self {
            painter: None,
            quads: QuadsSettings::default(),
            tiles: TilesSettings::default(),
            interslice: settings.interslice,
            normalization: settings.normalization,
            termination: settings.termination,
            antialiasing: settings.antialiasing,
            shadow_bias: None,
            sample: 4096,
            stream_over: LoadOptions::default().stream_over,
        }
    }
}

/// The least pixels to trace: fewer say nothing of 99.9 % of them.
const MIN_SAMPLE: u32 = 64;

/// The knobs, by painter.
pub(crate) const KNOBS: &[Knob] = &[
    Knob {
        key: "sheets",
        values: "image|axis",
        default: "image",
        painter: Some(PainterArg::Quads),
        help: "Put sheets parallel to the image, or (historical; pops) to the voxel planes most parallel to it",
        set: |tuning, value| library(value).map(|sheets| tuning.quads.sheets = sheets),
        rules: &[],
    },
    Knob {
        key: "accumulate",
        values: "optical-depth|additive",
        default: "optical-depth",
        painter: Some(PainterArg::Quads),
        help: "Add up optical depths in a sheet, or (historical, inexact) opacities clamped at 1",
        set: |tuning, value| library(value).map(|accumulation| tuning.quads.accumulation = accumulation),
        rules: &[],
    },
    Knob {
        key: "sheet-thickness",
        values: "VOXELS, 0.05 to 64",
        default: "1",
        painter: Some(PainterArg::Quads),
        help: "Thickness of a sheet: thinner sheets are more exact and slower",
        set: |tuning, value| parse::positive(value).map(|thickness| tuning.quads.sheet_thickness = thickness),
        rules: &[idle(|given| given.is("model", "xray"), "because an X-ray has one sheet")],
    },
    Knob {
        key: "precision",
        values: "f16|f32",
        default: "f32 if the adapter blends it, otherwise f16",
        painter: Some(PainterArg::Quads),
        help: "Format of the sheets. f16 changes alpha by 3e-4 to 4e-3, by up to 6e-2 if kernels grow, and scalars by \
               5e-4 of their range",
        set: |tuning, value| library(value).map(|precision| tuning.quads.precision = Some(precision)),
        rules: &[],
    },
    Knob {
        key: "table-error",
        values: "FRACTION, 1e-7 to 0.1",
        default: "1e-4 for f16, 1e-5 for f32",
        painter: Some(PainterArg::Quads),
        help: "Largest error of the footprint table, as a fraction of the footprint's peak",
        set: |tuning, value| parse::positive(value).map(|error| tuning.quads.table_error = Some(error)),
        rules: &[],
    },
    Knob {
        key: "resolution",
        values: "capped|full",
        default: "capped",
        painter: Some(PainterArg::Tiles),
        help: "Trace 1 to 4 rays per voxel and axis, resample them to the picture and trace pixels that would err \
               (capped), or trace a ray per pixel (full). Pre-shaded pictures only",
        set: |tuning, value| library(value).map(|resolution| tuning.tiles.resolution = resolution),
        rules: &[idle(
            |given| shows_intensity(given) || is_post_shaded(given),
            "because post-shaded pictures have a ray for each pixel",
        )],
    },
    Knob {
        key: "interslice",
        values: "parabola|mean",
        default: "parabola",
        painter: None,
        help: "Classify a post-shaded sheet by the parabola through it and its neighbours, or (historical) by its mean",
        set: |tuning, value| library(value).map(|interslice| tuning.interslice = interslice),
        rules: &[idle(|given| !is_post_shaded(given), "without --shading post of the composite model"), BY_REFERENCE],
    },
    Knob {
        key: "normalization",
        values: "unit|peak",
        default: "unit",
        painter: None,
        help: "Divide sums of kernels by the kernel's integral, or (historical, denser) by its peak of 1",
        set: |tuning, value| library(value).map(|normalization| tuning.normalization = normalization),
        rules: &[],
    },
    Knob {
        key: "termination",
        values: "FRACTION, 0 (off) to under 1",
        default: "0.001",
        painter: None,
        help: "Early termination: skip splats that receive less than this fraction of the light. No channel changes \
               by more than the fraction",
        set: |tuning, value| parse::tolerance(value).map(|termination| tuning.termination = termination),
        rules: &[
            idle(|given| !given.is("model", "composite"), "because only the composite model hides matter"),
            BY_REFERENCE,
        ],
    },
    Knob {
        key: "antialiasing",
        values: "on|off",
        default: "on",
        painter: None,
        help: "Enlarge kernels if voxels are closer together than pixels",
        set: |tuning, value| match value {
            "on" | "off" => {
                tuning.antialiasing = value == "on";
                Ok(())
            }
            _ => Err("expected on or off".to_owned()),
        },
        rules: &[],
    },
    Knob {
        key: "shadow-bias",
        values: "VOXELS, 0 to 16",
        default: "1.5, 4 for labels lit by default",
        painter: None,
        help: "Ignore occluders closer than this many voxels. At 0 opaque surfaces lie in their own shadow",
        set: |tuning, value| parse::number(value).map(|bias| tuning.shadow_bias = Some(bias)),
        rules: &[
            NEEDS_LIGHT,
            refused(
                |given| is_lit(given) && !casts(given) && !occludes(given),
                " acts on shadows and occlusion only: it needs either",
            ),
        ],
    },
    Knob {
        key: "sample",
        values: "PIXELS, 64 or more",
        default: "4096",
        painter: None,
        help: "Trace this many covered pixels for --max-error, --verify and pareto, spread evenly; all, if there are \
               fewer",
        set: |tuning, value| match value.parse() {
            Ok(pixels) if pixels >= MIN_SAMPLE => {
                tuning.sample = pixels;
                Ok(())
            }
            _ => Err(format!("expected a whole number, {MIN_SAMPLE} or more")),
        },
        rules: &[idle(
            |given| !given.is_for("pareto") && !given.has("max-error") && !given.has("verify"),
            "without --max-error or --verify",
        )],
    },
    Knob {
        key: "stream-over",
        values: "MIB, 0 or more",
        default: "4",
        painter: None,
        help: "Read larger volumes (MiB) brick by brick from their file, if the file is uncompressed",
        set: |tuning, value| {
            let mebibytes: u64 = value.parse().map_err(|_| "expected a whole number".to_owned())?;
            tuning.stream_over = mebibytes.saturating_mul(1 << 20);
            Ok(())
        },
        rules: &[idle(|given| given.source().starts_with("demo:"), "because the volume is built in")],
    },
];

/// Rules of knobs of quads.
const OF_QUADS: &[Rule] = &[
    refused(
        |given| given.is("painter", "tiles") || given.tuned("resolution").is_some(),
        " is a knob of quads, not of tiles",
    ),
    refused(|given| given.is_for("pareto"), ": a study varies the painters and their knobs"),
    BY_REFERENCE,
];

/// Rules of knobs of tiles.
const OF_TILES: &[Rule] = &[
    refused(|given| given.is("painter", "quads"), " is a knob of tiles, not of quads"),
    refused(|given| given.is_for("pareto"), ": a study varies the painters and their knobs"),
    BY_REFERENCE,
];

impl Knob {
    /// Conditions that take the effect from the knob, the ones of its painter first.
    pub(crate) fn rules(&self) -> impl Iterator<Item = &'static Rule> {
        let of_painter = match self.painter {
            Some(PainterArg::Quads) => OF_QUADS,
            Some(PainterArg::Tiles) => OF_TILES,
            Some(PainterArg::Auto) | None => &[],
        };
        of_painter.iter().chain(self.rules)
    }

    /// Whether a command line or a scene turns the knob.
    pub(crate) fn is_given(&self, given: &Given<'_>) -> bool {
        given.tuned(self.key).is_some()
    }

    /// The help of the knob, in lines of at most `width` characters.
    fn lines(&self, width: usize) -> String {
        let Self { key, values, default, help, .. } = self;
        let mut text = format!("  {key}={values} [default: {default}]\n");
        let mut line = String::from("     ");
        for word in help.split_whitespace() {
            if line.len() + 1 + word.len() > width {
                text += &format!("{line}\n");
                line = String::from("     ");
            }
            line += &format!(" {word}");
        }
        text + &format!("{line}\n")
    }
}

/// The knob of a key.
pub(crate) fn knob(key: &str) -> Option<&'static Knob> {
    KNOBS.iter().find(|knob| knob.key == key)
}

/// A value of `--tune`: one pair of key and value, or several parted by commas.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct TuneArg(Vec<(&'static str, String)>);

/// `KEY=VALUE` or `KEY=VALUE,KEY=VALUE,..`.
pub(crate) fn tune(text: &str) -> Result<TuneArg, String> {
    let keys = || KNOBS.iter().map(|knob| knob.key).collect::<Vec<_>>().join(", ");
    let pair = |pair: &str| {
        let (key, value) = pair.split_once('=').ok_or("expected KEY=VALUE; --tune help lists the keys")?;
        let (key, value) = (key.trim(), value.trim());
        let knob = knob(key).ok_or_else(|| format!("no key {key:?}, expected one of {}", keys()))?;
        (knob.set)(&mut Tuning::default(), value).map_err(|reason| format!("{key}: {reason}"))?;
        Ok::<_, String>((knob.key, value.to_owned()))
    };
    text.split(',').map(pair).collect::<Result<_, _>>().map(TuneArg)
}

impl Tuning {
    /// The defaults, changed by all pairs in their order.
    pub(crate) fn new(args: &[TuneArg]) -> Result<Self, String> {
        let mut tuning = Self::default();
        for (key, value) in args.iter().flat_map(|TuneArg(pairs)| pairs) {
            let Some(knob) = knob(key) else { continue };
            (knob.set)(&mut tuning, value).map_err(|reason| format!("--tune {key}: {reason}"))?;
            tuning.painter = knob.painter.or(tuning.painter);
        }
        Ok(tuning)
    }
}

/// The pairs of `--tune` whose keys are none of some, as one value; `None` if there are none.
pub(crate) fn pairs_without(args: &[TuneArg], keys: &[&str]) -> Option<String> {
    let pairs = args.iter().flat_map(|TuneArg(pairs)| pairs).filter(|(key, _)| !keys.contains(key));
    let pairs: Vec<String> = pairs.map(|(key, value)| format!("{key}={value}")).collect();
    (!pairs.is_empty()).then(|| pairs.join(","))
}

/// Characters in a line of help, as in other help.
const WIDTH: usize = 100;

/// The help of all knobs, by painter.
pub(crate) fn help() -> String {
    let mut text = "Knobs for special cases: --tune KEY=VALUE. Repeat the option, or part pairs by commas:\n\
                    --tune sheets=axis,accumulate=additive. Later pairs win.\n"
        .to_owned();
    for (painter, heading) in [
        (Some(PainterArg::Quads), "Painter quads (a key chooses this painter):"),
        (Some(PainterArg::Tiles), "Painter tiles (a key chooses this painter):"),
        (None, "Any painter:"),
    ] {
        text += &format!("\n{heading}\n");
        KNOBS.iter().filter(|knob| knob.painter == painter).for_each(|knob| text += &knob.lines(WIDTH));
    }
    text
}

#[cfg(test)]
mod tests {
    use voxsplat::lighting::Lighting;

    use super::*;

    #[test]
    fn defaults_are_the_values_that_the_table_names() {
        let differing = ["precision", "table-error", "shadow-bias"];
        for knob in KNOBS.iter().filter(|knob| !differing.contains(&knob.key)) {
            let pair = tune(&format!("{}={}", knob.key, knob.default)).unwrap();
            let tuning = Tuning::new(&[pair]).unwrap();
            assert_eq!(Tuning { painter: None, ..tuning }, Tuning::default(), "{}", knob.key);
        }
        let bias = Lighting::default().shadow_bias.to_string();
        assert!(knob("shadow-bias").unwrap().default.starts_with(&format!("{bias},")));
    }

    #[test]
    fn pairs_come_one_by_one_or_parted_by_commas_and_later_ones_win() {
        let together = Tuning::new(&[tune("sheets=axis, accumulate=additive,termination=0").unwrap()]).unwrap();
        let pairs = ["sheets=image", "termination=0", "accumulate=additive", "sheets=axis"];
        let apart: Vec<TuneArg> = pairs.iter().map(|pair| tune(pair).unwrap()).collect();
        assert_eq!(Tuning::new(&apart), Ok(together.clone()));
        assert_eq!(together.painter, Some(PainterArg::Quads));
        assert_eq!(Tuning::new(&[tune("sample=64").unwrap()]).unwrap().painter, None);
        assert_eq!(pairs_without(&apart, &["sheets", "accumulate"]), Some("termination=0".to_owned()));
        assert_eq!(pairs_without(&apart[1..2], &["termination"]), None);
    }

    #[test]
    fn errors_say_what_is_expected() {
        for (text, reason) in [
            ("sheets", "expected KEY=VALUE"),
            ("sheet=axis", "no key \"sheet\", expected one of sheets, accumulate, "),
            ("sheets=box", "sheets: \"box\", expected image or axis"),
            ("sheets=axis,termination=-1", "termination: expected a number, 0 or over"),
            ("sample=63", "sample: expected a whole number, 64 or more"),
            ("antialiasing=yes", "antialiasing: expected on or off"),
        ] {
            assert!(tune(text).unwrap_err().starts_with(reason), "{text}: {:?}", tune(text));
        }
    }

    #[test]
    fn help_has_each_key_once_in_short_lines() {
        let help = help();
        for Knob { key, .. } in KNOBS {
            assert_eq!(help.matches(&format!("\n  {key}=")).count(), 1, "{key}");
        }
        assert!(help.lines().all(|line| line.chars().count() <= WIDTH), "{help}");
    }
}
