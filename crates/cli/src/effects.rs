//! Options that have no effect beside others: one table for command lines and scene files.
//!
//! An option is refused if it contradicts another one, and noted in one line if it is harmless. A unit test takes all
//! options from `clap` and fails for an option without a row.

use clap::ArgMatches;

use super::args;
use super::failure::Failure;
use super::rules::{
    BY_REFERENCE, Given, Kind, NEEDS_LIGHT, Rule, casts, idle, is_film, is_frames, is_lit, is_parallel, is_sized,
    keeps_values, refused, shows_intensity, shows_labels,
};
use super::tune::KNOBS;

/// The option has an effect, or its reader refuses it.
const ALWAYS: &[Rule] = &[];
/// The library refuses the option where it has no effect: `Settings::validate` and `formats::load`.
const BY_LIBRARY: &[Rule] = &[];
/// `clap` refuses the option without the one that it needs.
const BY_PARSER: &[Rule] = &[];

const FIGURE: &[Rule] = &[refused(keeps_values, " is drawn on a .png: an .exr keeps the values of the picture")];
const COLOUR_BAR: &[Rule] = &[
    refused(keeps_values, " is drawn on a .png: an .exr keeps the values of the picture"),
    refused(|given| given.has("depth-coded"), " shows the colours of values; with --depth-coded colours show depths"),
    refused(shows_labels, " is for transfer functions, not for labels"),
];
const LEGEND: &[Rule] = &[
    refused(keeps_values, " is drawn on a .png: an .exr keeps the values of the picture"),
    refused(|given| given.is_for("pareto"), ": a study is of one volume of values"),
];
const LABELLED: &[Rule] =
    &[refused(|given| !given.has("labels") && !shows_labels(given), " needs --labels FILE or --transfer labels")];
const FOR_VALUES: Rule = refused(shows_labels, " is for values, not for labels");
const BY_KEYS: &str = "because key frames set it";
const FOR_PICTURES: &[Rule] = &[refused(|given| given.is_for("turntable"), " is for a picture, not for a turntable")];
const FOR_FRAMES: &[Rule] = &[refused(is_film, " needs a file for each frame, such as -o frames/{frame}.png")];

/// The options by their long names.
const TABLE: &[(&str, &[Rule])] = &[
    ("help", ALWAYS),
    ("quiet", ALWAYS),
    // Input.
    ("dims", BY_LIBRARY),
    ("type", BY_LIBRARY),
    (
        "endian",
        &[idle(|given| given.is("type", "u8") || given.is("type", "i8"), "because the samples are single bytes")],
    ),
    ("offset", BY_LIBRARY),
    ("spacing", ALWAYS),
    ("replace-nan", ALWAYS),
    ("channel", BY_LIBRARY),
    ("time", BY_LIBRARY),
    (
        "series",
        &[
            idle(|given| given.reads_one_file(), "because the volume is one file: only folders hold series"),
            idle(|given| given.reads_no_dicom(), "because only folders of DICOM files hold series"),
        ],
    ),
    // Whether a folder holds a pyramid is known when it is read: `session::say_choice`.
    ("pyramid", ALWAYS),
    (
        "missing-slices",
        &[
            idle(|given| given.reads_one_file(), "because the volume is one file"),
            idle(|given| given.reads_no_dicom(), "because only slices of DICOM have places"),
        ],
    ),
    // Output.
    ("output", ALWAYS),
    ("size", ALWAYS),
    ("region", ALWAYS),
    (
        "background",
        &[
            idle(keeps_values, "because an .exr keeps alpha"),
            refused(
                |given| is_film(given) && given.is("background", "transparent"),
                ": films have no alpha, expected a colour",
            ),
        ],
    ),
    ("save-scene", FOR_PICTURES),
    ("save-transfer", &[refused(shows_labels, " is for transfer functions, not for labels")]),
    (
        "stats",
        &[refused(|given| given.is_for("turntable") && given.is("output", "-"), ": standard output takes the film")],
    ),
    // Figure.
    ("scale-bar", FIGURE),
    ("axes", FIGURE),
    ("colour-bar", COLOUR_BAR),
    ("legend", LEGEND),
    ("title", FIGURE),
    ("caption", FIGURE),
    (
        "units",
        &[
            refused(|given| names_unit(given, "length") && !given.has("scale-bar"), " length=.. needs --scale-bar"),
            refused(|given| names_unit(given, "value") && !given.has("colour-bar"), " value=.. needs --colour-bar"),
        ],
    ),
    // View.
    ("azimuth", &[idle(|given| given.keys_set("azimuth"), BY_KEYS)]),
    ("elevation", &[idle(|given| given.keys_set("elevation"), BY_KEYS)]),
    ("roll", &[idle(|given| given.keys_set("roll"), BY_KEYS)]),
    ("up", ALWAYS),
    ("direction", &[refused(|given| given.is_for("turntable"), ": a turntable turns the azimuth")]),
    ("target", ALWAYS),
    ("projection", ALWAYS),
    (
        "fov",
        &[
            refused(is_parallel, " needs --projection perspective"),
            refused(
                |given| given.has("view-height") && given.has("distance"),
                ": --view-height and --distance decide the field of view",
            ),
        ],
    ),
    ("zoom", &[idle(|given| given.keys_set("zoom"), BY_KEYS)]),
    (
        "frame",
        &[idle(|given| given.has("target") && is_sized(given), "because --target and the size place the picture")],
    ),
    ("margin", &[idle(is_sized, "because --view-height or --distance sets the size")]),
    ("view-height", ALWAYS),
    ("distance", &[refused(is_parallel, " needs --projection perspective")]),
    // Model.
    ("transfer", ALWAYS),
    ("window", &[FOR_VALUES]),
    ("gradient-opacity", &[FOR_VALUES, refused(shows_intensity, ": projections of intensity have none")]),
    ("model", ALWAYS),
    ("response", BY_LIBRARY),
    ("depth-coded", BY_LIBRARY),
    ("attenuation", BY_LIBRARY),
    (
        "shading",
        &[
            refused(
                |given| shows_intensity(given) && given.is("shading", "pre"),
                " pre: projections of intensity reconstruct values before they classify them",
            ),
            idle(shows_intensity, "because projections of intensity are always post-shaded"),
        ],
    ),
    ("light", BY_LIBRARY),
    ("material", &[NEEDS_LIGHT]),
    ("clip", ALWAYS),
    (
        "shadows",
        &[
            NEEDS_LIGHT,
            refused(
                |given| is_lit(given) && casts(given) && given.all("light", |light| light.starts_with("headlight")),
                ": a headlight casts none, give a light by AZ,EL or @X,Y,Z",
            ),
        ],
    ),
    (
        "light-size",
        &[
            NEEDS_LIGHT,
            refused(|given| is_lit(given) && !casts(given), " shows in shadows alone: it needs --shadows"),
            refused(
                |given| is_lit(given) && given.all("light", |light| light.starts_with('@')),
                ": a light at a place is a point, it needs a light by AZ,EL",
            ),
        ],
    ),
    ("occlusion", &[NEEDS_LIGHT]),
    ("kernel", ALWAYS),
    ("sharpness", ALWAYS),
    ("level", &[BY_REFERENCE]),
    // Labels.
    ("labels", ALWAYS),
    ("label-table", LABELLED),
    ("label", LABELLED),
    ("mask", ALWAYS),
    // Painters and devices.
    ("painter", &[BY_REFERENCE]),
    // Each key has rules of its own.
    ("tune", ALWAYS),
    ("adapter", &[BY_REFERENCE]),
    ("reference", ALWAYS),
    // Accuracy and studies.
    ("max-error", BY_PARSER),
    ("verify", FOR_PICTURES),
    ("views", ALWAYS),
    ("repeats", ALWAYS),
    ("patience", ALWAYS),
    ("rivals", ALWAYS),
    // Turntables.
    ("frames", ALWAYS),
    ("turn", BY_PARSER),
    ("key-frames", BY_PARSER),
    ("rate", &[idle(is_frames, "because files of frames have no rate")]),
    ("format", &[refused(is_frames, ": {frame} asks for a file for each frame")]),
    ("part", FOR_FRAMES),
    ("resume", FOR_FRAMES),
];

/// Whether `--units` names the unit of a quantity.
fn names_unit(given: &Given<'_>, quantity: &str) -> bool {
    given.text("units").split(',').any(|pair| pair.trim_start().starts_with(&format!("{quantity}=")))
}

/// Notes on the options of a command that have no effect. A scene has two lines: that of its picture, and that of the
/// program.
///
/// Refuses options that contradict others, all at once.
pub(crate) fn noted(command: &str, lines: Vec<&ArgMatches>) -> Result<Vec<String>, Failure> {
    let mut program = args::command();
    program.build();
    let Some(command) = program.find_subcommand(command) else { return Ok(Vec::new()) };
    let given = &Given { command, lines };
    let (mut refusals, mut notes) = (Vec::new(), Vec::new());
    let mut apply = |option: &str, mut rules: Box<dyn Iterator<Item = &'static Rule>>| match rules
        .find(|rule| (rule.idle)(given))
        .map(|rule| &rule.kind)
    {
        Some(Kind::Refused(says)) => refusals.push(format!("--{option}{says}")),
        Some(Kind::Noted(because)) => notes.push(format!("note: --{option} has no effect {because}")),
        None => {}
    };
    for (option, rules) in TABLE.iter().filter(|(option, _)| given.has(option)) {
        apply(option, Box::new(rules.iter()));
    }
    for knob in KNOBS.iter().filter(|knob| knob.is_given(given)) {
        apply(&format!("tune {}", knob.key), Box::new(knob.rules()));
    }
    if refusals.is_empty() { Ok(notes) } else { Err(Failure::Several(refusals)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tune::Knob;

    #[test]
    fn every_option_has_a_row() {
        let mut program = args::command();
        program.build();
        let mut known = Vec::new();
        for name in ["render", "turntable", "pareto"] {
            for option in program.find_subcommand(name).unwrap().get_arguments().filter_map(|arg| arg.get_long()) {
                let rows = TABLE.iter().filter(|(row, _)| *row == option).count();
                assert_eq!(rows, 1, "--{option} of {name} has {rows} rows in the table of effects");
                known.push(option.to_owned());
            }
        }
        for (row, _) in TABLE {
            assert!(known.iter().any(|option| option == row), "--{row} is no option");
        }
    }

    #[test]
    fn rules_name_options_that_exist() {
        let mut program = args::command();
        program.build();
        let render = program.find_subcommand("turntable").unwrap();
        let of_knobs = KNOBS.iter().flat_map(Knob::rules);
        let words = TABLE.iter().flat_map(|(_, rules)| rules.iter()).chain(of_knobs).flat_map(|rule| match rule.kind {
            Kind::Refused(text) | Kind::Noted(text) => text.split([' ', ',', ':', ';', ')']),
        });
        for word in words.filter_map(|word| word.strip_prefix("--")) {
            assert!(render.get_arguments().any(|arg| arg.get_long() == Some(word)), "--{word}");
        }
    }
}
