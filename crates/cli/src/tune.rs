//! `--tune KEY=VALUE`: knobs that few pictures need, as the options of a parser of their own.

use std::error::Error as _;

use clap::{ArgAction, CommandFactory, Parser};
use voxsplat::kernel::Normalization;
use voxsplat::settings::{Accumulation, Interslice, Painter, Precision, QuadsSettings, Sheets};

use super::args;
use super::parse::{PainterArg, library, number, positive, tolerance, whole};

const QUADS: &str = "Painter quads (a key chooses this painter)";
const ANY: &str = "Any painter";

/// The values of the knobs.
#[derive(Debug, Clone, PartialEq, Parser)]
#[command(no_binary_name = true, disable_help_flag = true, args_override_self = true)]
pub(crate) struct Tuning {
    /// Put sheets parallel to the image, or (historical; pops) to the voxel planes most parallel to it
    #[arg(long, value_name = "image|axis", default_value = "image", value_parser = library::<Sheets>,
        help_heading = QUADS)]
    pub(crate) sheets: Sheets,
    /// Add up optical depths in a sheet, or (historical, inexact) opacities clamped at 1
    #[arg(long, value_name = "optical-depth|additive", default_value = "optical-depth",
        value_parser = library::<Accumulation>, help_heading = QUADS)]
    pub(crate) accumulate: Accumulation,
    /// Thickness of a sheet: thinner sheets are more exact and slower
    #[arg(long, value_name = "VOXELS, 0.05 to 64", default_value = "1", value_parser = positive, help_heading = QUADS)]
    pub(crate) sheet_thickness: f64,
    /// Format of the sheets. f16 changes alpha by 3e-4 to 4e-3, by up to 6e-2 if kernels grow, and scalars by 5e-4 of
    /// their range [default: f32 if the adapter blends it, otherwise f16]
    #[arg(long, value_name = "f16|f32", value_parser = library::<Precision>, help_heading = QUADS)]
    pub(crate) precision: Option<Precision>,
    /// Largest error of the footprint table, as a fraction of the footprint's peak [default: 1e-4 for f16, 1e-5 for
    /// f32]
    #[arg(long, value_name = "FRACTION, 1e-7 to 0.1", value_parser = positive, help_heading = QUADS)]
    pub(crate) table_error: Option<f64>,
    /// Classify a post-shaded sheet by the parabola through it and its neighbours, or (historical) by its mean
    #[arg(long, value_name = "parabola|mean", default_value = "parabola", value_parser = library::<Interslice>,
        help_heading = ANY)]
    pub(crate) interslice: Interslice,
    /// Divide sums of kernels by the kernel's integral, or (historical, denser) by its peak of 1
    #[arg(long, value_name = "unit|peak", default_value = "unit", value_parser = library::<Normalization>,
        help_heading = ANY)]
    pub(crate) normalization: Normalization,
    /// Early ray termination: skip splats that receive less than this fraction of the light. No channel changes by more
    /// than the fraction
    #[arg(long, value_name = "FRACTION, 0 (off) to under 1", default_value = "0.001", value_parser = tolerance,
        help_heading = ANY)]
    pub(crate) termination: f64,
    /// Enlarge kernels if voxels are closer together than pixels
    #[arg(long, value_name = "on|off", default_value = "on", value_parser = on_or_off, action = ArgAction::Set,
        help_heading = ANY)]
    pub(crate) antialiasing: bool,
    /// Ignore occluders closer than this many voxels. At 0 opaque surfaces lie in their own shadow [default: 1.5, 4 for
    /// labels lit by default]
    #[arg(long, value_name = "VOXELS, 0 to 16", value_parser = number, help_heading = ANY)]
    pub(crate) shadow_bias: Option<f64>,
    /// Trace this many covered pixels for --max-error, --verify and pareto, spread evenly; all, if there are fewer
    #[arg(long, value_name = "PIXELS, 64 or more", default_value = "4096",
        value_parser = whole::<u32, 64, { u64::MAX }>, help_heading = ANY)]
    pub(crate) sample: u32,
    /// Read larger volumes (MiB) brick by brick from their file, if the file is uncompressed
    #[arg(long, value_name = "MIB, 0 or more", default_value = "4", value_parser = mebibytes, help_heading = ANY)]
    pub(crate) stream_over: u64,
    /// Whether any knob of quads is given.
    #[arg(skip)]
    chooses_quads: bool,
}

/// Parses `on` or `off`.
fn on_or_off(text: &str) -> Result<bool, String> {
    match text {
        "on" => Ok(true),
        "off" => Ok(false),
        _ => Err("expected on or off".to_owned()),
    }
}

/// Parses a number of mebibytes to bytes.
fn mebibytes(text: &str) -> Result<u64, String> {
    whole::<u64, 0, { u64::MAX }>(text).map(|mebibytes| mebibytes.saturating_mul(1 << 20))
}

/// A value of `--tune`: pairs of key and value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct TuneArg(Vec<(String, String)>);

/// Parses `KEY=VALUE` or `KEY=VALUE,KEY=VALUE,..`.
pub(crate) fn tune(text: &str) -> Result<TuneArg, String> {
    let pair = |pair: &str| {
        let (key, value) = pair.split_once('=').ok_or("expected KEY=VALUE; --tune help lists the keys")?;
        let (key, value) = (key.trim().to_owned(), value.trim().to_owned());
        if !has(&key) {
            let command = Tuning::command();
            let keys: Vec<&str> = command.get_arguments().filter_map(clap::Arg::get_long).collect();
            return Err(format!("no key {key:?}, expected one of {}", keys.join(", ")));
        }
        let error = Tuning::try_parse_from([format!("--{key}={value}")]).err();
        match error.map(|error| error.source().map_or_else(|| error.to_string(), ToString::to_string)) {
            Some(reason) => Err(format!("{key}: {reason}")),
            None => Ok((key, value)),
        }
    };
    text.split(',').map(pair).collect::<Result<_, _>>().map(TuneArg)
}

/// Returns whether there is a knob of a key.
pub(crate) fn has(key: &str) -> bool {
    args::option(&Tuning::command(), key).is_some()
}

impl Tuning {
    /// Returns the defaults, changed by all pairs in their order: later pairs win.
    pub(crate) fn new(args: &[TuneArg]) -> Result<Self, String> {
        let pairs: Vec<&(String, String)> = args.iter().flat_map(|TuneArg(pairs)| pairs).collect();
        let words = pairs.iter().map(|(key, value)| format!("--{key}={value}"));
        let tuning = Self::try_parse_from(words).map_err(|error| format!("--tune: {error}"))?;
        let command = Self::command();
        let is_of_quads =
            |key: &str| args::option(&command, key).is_some_and(|knob| knob.get_help_heading() == Some(QUADS));
        Ok(Self { chooses_quads: pairs.iter().any(|(key, _)| is_of_quads(key)), ..tuning })
    }

    /// Returns the requested painter with its knobs. A knob of quads chooses quads.
    pub(crate) fn painter(&self, requested: PainterArg) -> Painter {
        let &Self { sheets, accumulate: accumulation, sheet_thickness, precision, table_error, .. } = self;
        match requested {
            PainterArg::Auto if !self.chooses_quads => Painter::Auto,
            PainterArg::Auto | PainterArg::Quads => {
                let default = QuadsSettings::default();
                Painter::Quads(QuadsSettings {
                    sheets,
                    accumulation,
                    sheet_thickness,
                    precision,
                    table_error,
                    ..default
                })
            }
            PainterArg::Tiles => Painter::Tiles,
            PainterArg::Cpu => Painter::Cpu,
        }
    }
}

/// Returns the pairs of `--tune` whose keys are not among some, as one value; `None` if there are none.
pub(crate) fn pairs_without(args: &[TuneArg], keys: &[&str]) -> Option<String> {
    let pairs = args.iter().flat_map(|TuneArg(pairs)| pairs).filter(|(key, _)| !keys.contains(&key.as_str()));
    let pairs: Vec<String> = pairs.map(|(key, value)| format!("{key}={value}")).collect();
    (!pairs.is_empty()).then(|| pairs.join(","))
}

/// The number of characters in a line of help, as in other help.
const WIDTH: usize = 100;

/// Returns the help of all knobs, by painter.
pub(crate) fn help() -> String {
    let command = Tuning::command().next_line_help(true).help_template("{all-args}").term_width(WIDTH);
    let options = command.clone().render_help().to_string();
    let line = |line: &str| match line.trim_start().strip_prefix("--") {
        Some(option) => format!("  {}\n", option.replacen(" <", "=", 1).trim_end_matches('>')),
        None => format!("{line}\n"),
    };
    "Knobs for special cases: --tune KEY=VALUE. Repeat the option, or part pairs by commas:\n\
     --tune sheets=axis,accumulate=additive. Later pairs win.\n\n"
        .to_owned()
        + &options.lines().map(line).collect::<String>()
}

#[cfg(test)]
mod tests {
    use voxsplat::formats::LoadOptions;
    use voxsplat::lighting::Lighting;
    use voxsplat::settings::Settings;

    use super::*;

    #[test]
    fn defaults_are_the_defaults_of_the_library() {
        let tuning = Tuning::new(&[]).unwrap();
        let settings = Settings::default();
        assert_eq!(tuning.painter(PainterArg::Quads), Painter::Quads(QuadsSettings::default()));
        assert_eq!(tuning.painter(PainterArg::Tiles), Painter::Tiles);
        assert_eq!(tuning.painter(PainterArg::Auto), Painter::Auto);
        assert_eq!(
            (tuning.interslice, tuning.normalization, tuning.termination, tuning.antialiasing),
            (settings.interslice, settings.normalization, settings.termination, settings.antialiasing)
        );
        assert_eq!(tuning.stream_over, LoadOptions::default().stream_over);
        let bias = format!("[default: {},", Lighting::default().shadow_bias);
        assert!(help().contains(&bias), "{bias}");
    }

    #[test]
    fn pairs_come_one_by_one_or_parted_by_commas_and_later_ones_win() {
        let together = Tuning::new(&[tune("sheets=axis, accumulate=additive,termination=0").unwrap()]).unwrap();
        let pairs = ["sheets=image", "termination=0", "accumulate=additive", "sheets=axis"];
        let apart: Vec<TuneArg> = pairs.iter().map(|pair| tune(pair).unwrap()).collect();
        assert_eq!(Tuning::new(&apart), Ok(together.clone()));
        assert!(together.chooses_quads);
        assert!(!Tuning::new(&[tune("sample=64").unwrap()]).unwrap().chooses_quads);
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
        for key in Tuning::command().get_arguments().filter_map(|arg| arg.get_long()) {
            assert_eq!(help.matches(&format!("\n  {key}=")).count(), 1, "{key}: {help}");
        }
        assert!(help.lines().all(|line| line.chars().count() <= WIDTH), "{help}");
    }
}
