//! Options that have no effect beside others: one table for command lines and scene files.
//!
//! An option is refused if it contradicts another one, and noted in one line if it is harmless. A unit test takes all
//! options from `clap` and fails for an option without a row.

use std::path::Path;

use clap::parser::ValueSource;
use clap::{ArgMatches, Command, CommandFactory};
use serde_json::{Map, Value};
use voxsplat::formats::{data_files, is_zarr, read_json};

use super::args::Args;
use super::{Failure, turntable};

/// A condition that takes the effect from an option.
struct Rule {
    idle: fn(&Given<'_>) -> bool,
    kind: Kind,
}

/// What happens to an option without effect. The text follows the name of the option.
enum Kind {
    /// The option contradicts others.
    Refused(&'static str),
    /// The option is harmless.
    Noted(&'static str),
}

const fn refused(idle: fn(&Given<'_>) -> bool, says: &'static str) -> Rule {
    Rule { idle, kind: Kind::Refused(says) }
}

const fn idle(idle: fn(&Given<'_>) -> bool, because: &'static str) -> Rule {
    Rule { idle, kind: Kind::Noted(because) }
}

/// The option has an effect, or its reader refuses it.
const ALWAYS: &[Rule] = &[];
/// The library refuses the option where it has no effect: `Settings::validate` and `formats::load`.
const BY_LIBRARY: &[Rule] = &[];
/// `clap` refuses the option without the one that it needs.
const BY_PARSER: &[Rule] = &[];

const FIGURE: &[Rule] = &[refused(keeps_values, " is drawn on a .png: an .exr keeps the values of the picture")];
const COLOUR_BAR: &[Rule] = &[
    refused(keeps_values, " is drawn on a .png: an .exr keeps the values of the picture"),
    refused(|given| given.has("depth-coded"), ": colours show values, and with --depth-coded those of depths"),
    refused(shows_labels, " is for transfer functions, not for labels"),
];
const LEGEND: &[Rule] = &[
    refused(keeps_values, " is drawn on a .png: an .exr keeps the values of the picture"),
    refused(|given| given.is_for("pareto"), ": a study is of one volume of values"),
];
const NEEDS_LIGHT: Rule = refused(|given| !is_lit(given), " needs a --light");
const LABELLED: &[Rule] =
    &[refused(|given| !given.has("labels") && !shows_labels(given), " needs --labels FILE or --transfer labels")];
const FOR_VALUES: Rule = refused(shows_labels, " is for values, not for labels");
const BY_REFERENCE: Rule = idle(|given| given.has("reference"), "because --reference integrates rays on the CPU");
const BY_KEYS: &str = "because key frames set it";
const FOR_QUADS: Rule =
    refused(|given| given.is("painter", "tiles") || given.has("resolution"), " is an option of quads, not of tiles");
const QUADS: &[Rule] = &[FOR_QUADS, BY_REFERENCE];
const SHEETS: &[Rule] =
    &[FOR_QUADS, BY_REFERENCE, idle(|given| given.is("model", "xray"), "because an X-ray has one sheet")];
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
    ("stream-over", &[idle(|given| given.source().starts_with("demo:"), "because the volume is built in")]),
    // Output.
    ("output", ALWAYS),
    ("preview", FOR_PICTURES),
    ("size", ALWAYS),
    ("region", ALWAYS),
    (
        "background",
        &[
            idle(|given| keeps_values(given) && !given.has("preview"), "because an .exr keeps alpha"),
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
    ("length-unit", BY_PARSER),
    ("value-unit", BY_PARSER),
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
    ("colour-map", BY_PARSER),
    ("window", &[FOR_VALUES]),
    ("gradient-opacity", &[FOR_VALUES, refused(shows_intensity, ": projections of intensity have none")]),
    (
        "gradient-floor",
        &[
            FOR_VALUES,
            refused(|given| !given.is("model", "composite"), ": only the composite model is lit"),
            idle(|given| given.has("light") && !is_lit(given), "without light"),
        ],
    ),
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
    ("clip-box", ALWAYS),
    ("crop", ALWAYS),
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
        "shadow-bias",
        &[
            NEEDS_LIGHT,
            refused(
                |given| is_lit(given) && !casts(given) && !occludes(given),
                " shows in shadows and occlusion alone: it needs either",
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
    ("normalization", ALWAYS),
    (
        "interslice",
        &[idle(|given| !is_post_shaded(given), "without --shading post of the composite model"), BY_REFERENCE],
    ),
    (
        "termination",
        &[idle(|given| !given.is("model", "composite"), "because only the composite model hides matter"), BY_REFERENCE],
    ),
    ("antialiasing", ALWAYS),
    ("level", &[BY_REFERENCE]),
    // Labels.
    ("labels", ALWAYS),
    ("label-table", LABELLED),
    ("label", LABELLED),
    ("label-opacity", LABELLED),
    ("mask", ALWAYS),
    // Painters and devices.
    ("painter", &[BY_REFERENCE]),
    ("sheet-thickness", SHEETS),
    ("sheets", QUADS),
    ("accumulate", QUADS),
    ("precision", QUADS),
    ("table-error", QUADS),
    ("footprint-table", QUADS),
    ("sheets-per-pass", SHEETS),
    (
        "resolution",
        &[
            refused(|given| given.is("painter", "quads"), " is an option of tiles, not of quads"),
            idle(
                |given| shows_intensity(given) || is_post_shaded(given),
                "because post-shaded pictures have a ray for each pixel",
            ),
            BY_REFERENCE,
        ],
    ),
    ("adapter", &[BY_REFERENCE]),
    ("reference", ALWAYS),
    // Accuracy and studies.
    ("max-error", BY_PARSER),
    ("verify", FOR_PICTURES),
    (
        "sample",
        &[idle(
            |given| !given.is_for("pareto") && !given.has("max-error") && !given.has("verify"),
            "without --max-error or --verify",
        )],
    ),
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

/// What a command line gives; of a scene, that of its picture first and then that of the program.
struct Given<'a> {
    command: &'a Command,
    lines: Vec<&'a ArgMatches>,
}

impl Given<'_> {
    fn is_for(&self, command: &str) -> bool {
        self.command.get_name() == command
    }

    /// The identifier of an option, if the command has it.
    fn id(&self, option: &str) -> Option<&str> {
        let found = self.command.get_arguments().find(|arg| arg.get_long() == Some(option));
        found.map(|arg| arg.get_id().as_str())
    }

    /// The lines that give an option.
    fn giving<'b>(&'b self, id: &'b str) -> impl Iterator<Item = &'b ArgMatches> {
        self.lines.iter().copied().filter(move |line| {
            line.try_contains_id(id).is_ok() && line.value_source(id) == Some(ValueSource::CommandLine)
        })
    }

    fn has(&self, option: &str) -> bool {
        self.id(option).is_some_and(|id| self.giving(id).next().is_some())
    }

    /// The values of an option or its default.
    fn values(&self, id: &str) -> Vec<String> {
        let line = self.giving(id).next().or(self.lines.first().copied());
        let raw = line.and_then(|line| line.try_get_raw(id).ok().flatten());
        raw.into_iter().flatten().map(|value| value.to_string_lossy().into_owned()).collect()
    }

    /// The last value of an option or its default; empty without.
    fn text(&self, option: &str) -> String {
        self.id(option).and_then(|id| self.values(id).pop()).unwrap_or_default()
    }

    fn is(&self, option: &str, value: &str) -> bool {
        self.text(option) == value
    }

    fn all(&self, option: &str, holds: impl Fn(&str) -> bool) -> bool {
        self.id(option).is_some_and(|id| self.values(id).iter().all(|value| holds(value)))
    }

    /// The volume as it was given.
    fn source(&self) -> String {
        self.values("source").pop().unwrap_or_default()
    }

    /// Whether a key frame sets this, and so all of them do.
    fn keys_set(&self, name: &str) -> bool {
        let keys =
            || read_json::<Vec<Map<String, Value>>>(Path::new(&self.text("key-frames")), turntable::MAX_KEY_FRAMES);
        self.has("key-frames") && keys().is_ok_and(|keys| keys.iter().any(|key| key.contains_key(name)))
    }

    /// Whether the volume is a file outside of folders whose files belong together, or built in.
    fn reads_one_file(&self) -> bool {
        let source = self.source();
        let path = Path::new(&source);
        source.starts_with("demo:") || (path.is_file() && !path.parent().is_some_and(is_zarr))
    }

    /// Whether the volume is a Zarr or a folder of TIFF files. DICOM files do not go with TIFF files.
    fn reads_no_dicom(&self) -> bool {
        let source = self.source();
        let path = Path::new(&source);
        let is_tiff = |file: &Path| {
            file.extension()
                .is_some_and(|extension| ["tif", "tiff"].iter().any(|end| extension.eq_ignore_ascii_case(end)))
        };
        is_zarr(path)
            || path.parent().is_some_and(|folder| path.is_file() && is_zarr(folder))
            || (path.is_dir() && data_files(path).first().is_some_and(|file| is_tiff(file)))
    }
}

/// Whether the picture is an `.exr`.
fn keeps_values(given: &Given<'_>) -> bool {
    !given.is_for("pareto") && given.text("output").to_lowercase().ends_with(".exr")
}

fn is_frames(given: &Given<'_>) -> bool {
    given.is_for("turntable") && given.text("output").contains("{frame}")
}

fn is_film(given: &Given<'_>) -> bool {
    given.is_for("turntable") && given.has("output") && !is_frames(given)
}

fn is_parallel(given: &Given<'_>) -> bool {
    given.is("projection", "orthographic")
}

/// Whether the size of the picture is given in the world, so that nothing is fitted.
fn is_sized(given: &Given<'_>) -> bool {
    given.has("view-height") || given.has("distance")
}

fn shows_labels(given: &Given<'_>) -> bool {
    given.is("transfer", super::layers::LABELS)
}

fn shows_intensity(given: &Given<'_>) -> bool {
    ["mip", "minip", "average"].iter().any(|model| given.is("model", model))
}

fn is_post_shaded(given: &Given<'_>) -> bool {
    given.is("model", "composite") && given.is("shading", "post")
}

fn is_lit(given: &Given<'_>) -> bool {
    given.has("light") && !given.all("light", |light| light == "off")
}

fn is_studio(given: &Given<'_>) -> bool {
    given.text("light").starts_with("studio")
}

fn casts(given: &Given<'_>) -> bool {
    match given.text("shadows").as_str() {
        "" => is_studio(given),
        "off" => false,
        strength => strength.parse().ok() != Some(0.0),
    }
}

fn occludes(given: &Given<'_>) -> bool {
    match given.text("occlusion").as_str() {
        "" => is_studio(given),
        radius => radius != "off",
    }
}

/// Notes on the options of a command that have no effect. A scene has two lines: that of its picture, and that of the
/// program.
///
/// Refuses options that contradict others, all at once.
pub(super) fn noted(command: &str, lines: Vec<&ArgMatches>) -> Result<Vec<String>, Failure> {
    let mut program = Args::command();
    program.build();
    let Some(command) = program.find_subcommand(command) else { return Ok(Vec::new()) };
    let given = &Given { command, lines };
    let (mut refusals, mut notes) = (Vec::new(), Vec::new());
    for (option, rules) in TABLE.iter().filter(|(option, _)| given.has(option)) {
        match rules.iter().find(|rule| (rule.idle)(given)).map(|rule| &rule.kind) {
            Some(Kind::Refused(says)) => refusals.push(format!("--{option}{says}")),
            Some(Kind::Noted(because)) => notes.push(format!("note: --{option} has no effect {because}")),
            None => {}
        }
    }
    if refusals.is_empty() { Ok(notes) } else { Err(Failure::Several(refusals)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_option_has_a_row() {
        let mut program = Args::command();
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
        let mut program = Args::command();
        program.build();
        let render = program.find_subcommand("turntable").unwrap();
        let words = TABLE.iter().flat_map(|(_, rules)| rules.iter()).flat_map(|rule| match rule.kind {
            Kind::Refused(text) | Kind::Noted(text) => text.split([' ', ',', ':', ')']),
        });
        for word in words.filter_map(|word| word.strip_prefix("--")) {
            assert!(render.get_arguments().any(|arg| arg.get_long() == Some(word)), "--{word}");
        }
    }
}
