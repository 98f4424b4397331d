//! Options that have no effect beside others: one table for command lines and scene files.
//!
//! An option is refused if it contradicts another one, and noted in one line if it is harmless. A unit test takes all
//! options from `clap` and fails for an option that neither [`RULES`] nor [`FREE`] nor [`LACKING`] names.

use std::path::Path;

use clap::{ArgMatches, Command};
use voxsplat::formats::is_url;

use super::failure::Failure;
use super::given::{
    Given, casts, is_film, is_frames, is_lit, is_parallel, is_post_shaded, is_sized, keeps_values, occludes,
    shows_intensity, shows_labels,
};
use super::lacking::{LACKING, QUADS};

/// A condition that takes the effect from options.
struct EffectRule {
    /// The long names of the options, parted by blanks; `tune:KEY` for a key of `--tune`.
    options: &'static str,
    holds: fn(&Given<'_>) -> bool,
    kind: Consequence,
}

/// The consequence of a rule. The text follows the name of the option.
enum Consequence {
    /// The option contradicts others.
    Refused(&'static str),
    /// The option is harmless.
    Noted(&'static str),
}

const fn refused(options: &'static str, holds: fn(&Given<'_>) -> bool, text: &'static str) -> EffectRule {
    EffectRule { options, holds, kind: Consequence::Refused(text) }
}

const fn idle(options: &'static str, holds: fn(&Given<'_>) -> bool, because: &'static str) -> EffectRule {
    EffectRule { options, holds, kind: Consequence::Noted(because) }
}

/// The options that always have an effect, or that `clap` (`conflicts_with`), the library (`Settings::validate`,
/// `formats::load`) or `session::say_choice` refuse or note.
#[cfg(test)]
const FREE: &str = "help quiet json dims type offset axis-order spacing replace-nan complex pyramid \
                    size up target projection view-height transfer transfer-values model response \
                    depth-coded attenuation light clip kernel sharpness tune tune:normalization \
                    tune:antialiasing views repeats patience seconds rivals frames turn key-frames grid at planes each";

const BY_KEYS: &str = "because key frames set it";
const IS_ONE_FILE: &str = "because the volume is one file: only folders and TIFF hold series";
const IS_NO_DICOM: &str = "because only folders of DICOM files hold series";

/// The rules, by groups of options. If several rules apply to an option, the first counts.
const RULES: &[EffectRule] = &[
    // Input.
    idle("endian", |given| given.is("type", "u8") || given.is("type", "i8"), "because the samples are single bytes"),
    idle("series", |given| given.reads_one_file() && !given.reads_tiff(), IS_ONE_FILE),
    idle("missing-slices", |given| given.reads_no_dicom_file(), "because only DICOM has slices of its own"),
    idle("series missing-slices", |given| given.reads_no_dicom(), IS_NO_DICOM),
    idle("fetch-limit", |given| !is_url(Path::new(&given.source())), "because the volume is at no url"),
    idle("tune:stream-over", |given| given.source().starts_with("demo:"), "because the volume is built in"),
    // Output.
    idle("background", keeps_values, "because an .exr keeps alpha"),
    refused(
        "background",
        |given| is_film(given) && given.is("background", "transparent"),
        ": films have no alpha, expected a colour",
    ),
    refused("output", |given| given.is_for("sheet") && keeps_values(given), ": a contact sheet is a .png"),
    refused("output", |given| given.is_for("slice") && keeps_values(given), ": a figure of slices is a .png"),
    refused("save-transfer colour-bar", shows_labels, " is for transfer functions, not for labels"),
    refused("stats", |given| given.is_for("turntable") && given.is("output", "-"), ": standard output takes the film"),
    // Figure.
    refused(
        "scale-bar axes colour-bar legend title caption",
        keeps_values,
        " is drawn on a .png: an .exr keeps the values of the picture",
    ),
    refused(
        "colour-bar",
        |given| given.has("depth-coded"),
        " shows the colours of values; with --depth-coded colours show depths",
    ),
    refused("units", |given| lacks(given, "length", "scale-bar"), " length=.. needs --scale-bar"),
    refused("units", |given| lacks(given, "value", "colour-bar"), " value=.. needs --colour-bar"),
    // View.
    idle("azimuth", |given| given.keys_set("azimuth"), BY_KEYS),
    idle("elevation", |given| given.keys_set("elevation"), BY_KEYS),
    idle("roll", |given| given.keys_set("roll"), BY_KEYS),
    idle("zoom", |given| given.keys_set("zoom"), BY_KEYS),
    refused("fov distance", is_parallel, " needs --projection perspective"),
    refused(
        "fov",
        |given| given.has("view-height") && given.has("distance"),
        ": --view-height and --distance decide the field of view",
    ),
    idle("frame", |given| given.has("target") && is_sized(given), "because --target and the size place the picture"),
    idle("margin", is_sized, "because --view-height or --distance sets the size"),
    // Model.
    refused("window gradient-opacity classification iso", shows_labels, " is for values, not for labels"),
    refused("mask", |given| given.has("iso"), " shows voxels, and --iso surfaces between them: leave out either"),
    refused(
        "shading",
        |given| given.has("iso") && given.is("shading", "post") && (given.has("overlay") || given.has("labels")),
        " post: labels and overlays in --iso are drawn voxel by voxel",
    ),
    refused("shading", |given| given.has("iso") && given.is("shading", "pre"), " pre: --iso is post-shaded"),
    idle("normals", is_post_shaded, "because post-shading lights the gradient of the field"),
    idle("normals", shows_labels, "because labels have normals of their own"),
    idle(
        "classification",
        |given| shows_intensity(given) || is_post_shaded(given),
        "because post-shading and projections of intensity classify no voxels",
    ),
    refused("gradient-opacity", shows_intensity, ": projections of intensity have none"),
    refused(
        "shading",
        |given| shows_intensity(given) && given.is("shading", "pre"),
        " pre: projections of intensity reconstruct values before they classify them",
    ),
    idle("shading", shows_intensity, "because projections of intensity are always post-shaded"),
    refused(
        "material shadows light-size occlusion normals tune:shadow-bias",
        |given| !is_lit(given),
        " needs --light, such as --light studio",
    ),
    refused(
        "shadows",
        |given| casts(given) && given.all("light", |light| light.starts_with("headlight")),
        ": a headlight casts none, give a light by AZ,EL or @X,Y,Z",
    ),
    refused("light-size", |given| !casts(given), " shows in shadows alone: it needs --shadows"),
    refused(
        "light-size",
        |given| given.all("light", |light| light.starts_with('@')),
        ": a light at a place is a point, it needs a light by AZ,EL",
    ),
    refused(
        "tune:shadow-bias",
        |given| !casts(given) && !occludes(given),
        " acts on shadows and occlusion only: it needs either",
    ),
    idle("tune:termination", |given| !given.is("model", "composite"), "because only the composite model hides matter"),
    idle("tune:interslice", |given| !is_post_shaded(given), "without --shading post of the composite model"),
    // Labels.
    refused(
        "label label-table",
        |given| !given.has("labels") && !shows_labels(given),
        " needs --labels FILE or --transfer labels",
    ),
    // Solids.
    refused(
        "mesh plane depth",
        |given| given.has("reference") || given.has("max-error") || given.has("verify"),
        ": the reference draws no solids, so leave out --reference, --max-error and --verify",
    ),
    // Painters and devices.
    refused(QUADS, |given| given.is("painter", "tiles"), " is a knob of quads, not of tiles"),
    refused(QUADS, |given| given.is("painter", "cpu"), " is a knob of quads, not of cpu"),
    idle("level painter adapter tune:interslice tune:termination", is_traced, BY_REFERENCE),
    idle(QUADS, is_traced, BY_REFERENCE),
    idle("tune:sheet-thickness", |given| given.is("model", "xray"), "because an X-ray has one sheet"),
    // Accuracy and turntables.
    idle(
        "tune:sample",
        |given| !given.is_for("pareto") && !given.has("max-error") && !given.has("verify"),
        "without --max-error or --verify",
    ),
    idle("rate", is_frames, "because files of frames have no rate"),
    refused("format", is_frames, ": {frame} requests a file for each frame"),
    refused("part resume", is_film, " needs a file for each frame, such as -o frames/{frame}.png"),
];

/// Returns whether the reference makes the picture: rays on the CPU depend neither on painters nor on devices.
fn is_traced(given: &Given<'_>) -> bool {
    given.has("reference")
}

const BY_REFERENCE: &str = "because --reference integrates rays on the CPU";

/// Returns whether `--units` names the unit of a quantity without the option that shows it.
fn lacks(given: &Given<'_>, quantity: &str, option: &str) -> bool {
    let prefix = format!("{quantity}=");
    given.text("units").split(',').any(|pair| pair.trim_start().starts_with(&prefix)) && !given.has(option)
}

/// Returns notes on the options of a command that have no effect. A scene has two lines: the picture's line and the
/// program's.
///
/// Refuses options that contradict others, all at once.
pub(crate) fn noted(command: &Command, lines: Vec<&ArgMatches>) -> Result<Vec<String>, Failure> {
    let given = &Given { command, lines };
    let (mut refusals, mut notes, mut seen) = (Vec::new(), Vec::new(), Vec::new());
    for &(_, options, text) in LACKING.iter().filter(|(name, ..)| given.is_for(name)) {
        for option in options.split(' ').filter(|option| given.sets(option)) {
            seen.push(option);
            refusals.push(format!("--{}{text}", option.replace(':', " ")));
        }
    }
    for EffectRule { options, holds, kind } in RULES {
        for option in options.split(' ').filter(|option| given.sets(option)) {
            if seen.contains(&option) || !holds(given) {
                continue;
            }
            seen.push(option);
            let option = option.replace(':', " ");
            match kind {
                Consequence::Refused(text) => refusals.push(format!("--{option}{text}")),
                Consequence::Noted(because) => notes.push(format!("note: --{option} has no effect {because}")),
            }
        }
    }
    if refusals.is_empty() { Ok(notes) } else { Err(Failure { code: 2, messages: refusals }) }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::*;
    use crate::args;
    use crate::tune::Tuning;

    #[test]
    fn every_option_has_a_rule_or_is_free() {
        let program = args::built();
        let mut known: Vec<String> =
            Tuning::command().get_arguments().filter_map(|arg| Some(format!("tune:{}", arg.get_long()?))).collect();
        for name in ["render", "slice", "sheet", "turntable", "pareto", "plan"] {
            let arguments = program.find_subcommand(name).unwrap().get_arguments();
            known.extend(arguments.filter_map(|arg| arg.get_long().map(str::to_owned)));
        }
        let options = RULES.iter().map(|rule| rule.options).chain(LACKING.iter().map(|&(_, options, _)| options));
        let ruled = || options.clone().flat_map(|options| options.split(' '));
        for option in &known {
            let is_free = FREE.split(' ').any(|free| free == option);
            assert_ne!(is_free, ruled().any(|ruled| ruled == option), "--{option}");
        }
        for option in ruled().chain(FREE.split(' ')) {
            assert!(known.iter().any(|known| known == option), "--{option} is no option");
        }
    }

    #[test]
    fn rules_name_options_that_exist() {
        let program = args::built();
        let turntable = program.find_subcommand("turntable").unwrap();
        let of_rules = RULES.iter().map(|rule| match rule.kind {
            Consequence::Refused(text) | Consequence::Noted(text) => text,
        });
        let all = of_rules.chain(LACKING.iter().map(|&(_, _, text)| text));
        let words = all.flat_map(|text| text.split([' ', ',', ':', ';', ')']));
        for word in words.filter_map(|word| word.strip_prefix("--")) {
            assert!(args::option(turntable, word).is_some(), "--{word}");
        }
    }
}
