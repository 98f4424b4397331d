//! Wrong command lines: a line for each error, with our option for a word of another program.

use std::ffi::OsString;
use std::ops::Range;
use std::path::Path;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Arg, Command};

use super::args;
use super::destination::STREAM;
use super::tune::knob;

/// Words of other programs and of earlier versions for options of this one: VTK and ParaView, 3D Slicer, niivue,
/// MRIcroGL, napari, Blender, ffmpeg and ImageMagick. A word whose option the command lacks gets no tip.
const FOREIGN: [(&[&str], &str); 33] = [
    (
        &[
            "preset",
            "tf",
            "transfer-function",
            "opacity-transfer-function",
            "lut",
            "opacity",
            "color-transfer-function",
        ],
        "--transfer takes presets and files",
    ),
    (
        &[
            "colour-map",
            "color-map",
            "colormap",
            "colourmap",
            "cmap",
            "palette",
            "clut",
            "color-preset",
            "colorscale",
            "colors",
        ],
        "--transfer map:NAME colours values",
    ),
    (
        &["threshold", "iso", "isovalue", "isosurface", "contour", "cal-min", "cal-max", "clim", "range", "min", "max"],
        "--window LEVEL,WIDTH says which values show",
    ),
    (&["level-width", "ww", "wl", "wc", "contrast", "contrast-limits", "brightness"], "--window LEVEL,WIDTH"),
    (
        &["slice", "slices", "slab", "cut", "cutplane", "clip-plane-depth", "section", "slice-type", "mosaic"],
        "there are no slices; --clip cuts the volume",
    ),
    (&["crop", "roi", "bounds", "extract", "subset", "voi"], "--clip voxels:I0:I1,J0:J1,K0:K1 keeps voxels"),
    (&["clip-box"], "--clip box:X0,X1,Y0,Y1,Z0,Z1 keeps a box of the world"),
    (&["length-unit"], "--units length=UNIT"),
    (&["value-unit"], "--units value=UNIT"),
    (&["label-opacity"], "--label all:xF multiplies the opacities of labels"),
    (&["footprint-table"], "it is removed; --tune table-error=E sets the accuracy of the table"),
    (&["sheets-per-pass"], "it is removed; the adapter's best number is used"),
    (
        &["view", "camera", "camera-position", "rotate", "rotation", "rotate-camera", "orientation", "angle", "side"],
        "--azimuth and --elevation turn the view, --direction X,Y,Z sets it",
    ),
    (&["pitch", "tilt", "elev"], "--elevation DEG raises the eye"),
    (&["yaw", "azi", "azim", "heading"], "--azimuth DEG turns the eye"),
    (&["view-up", "viewup", "up-vector"], "--up X,Y,Z"),
    (&["focal-point", "center", "centre", "look-at", "lookat", "focus"], "--target X,Y,Z is the middle of the picture"),
    (&["parallel", "parallel-projection", "ortho", "perspective"], "--projection orthographic or perspective"),
    (&["field-of-view", "view-angle", "focal-length", "lens"], "--fov DEG with --projection perspective"),
    (&["parallel-scale", "scale", "magnification"], "--zoom F magnifies, --view-height LENGTH sets the world height"),
    (
        &["resolution-xy", "width", "height", "image-size", "image-resolution", "geometry", "pixels", "window-size"],
        "--size WxH, in pixels",
    ),
    (&["bg", "background-colour", "back-color", "bgcolor", "clear-color"], "--background COLOUR"),
    (&["out", "save", "save-bmp", "savebmp", "screenshot", "file", "filename", "o"], "-o FILE is the picture"),
    (
        &["blend", "blend-mode", "render-mode", "rendering", "mode", "volume-mapper", "technique", "projection-mode"],
        "--model composite, xray, mip, minip or average",
    ),
    (&["mip", "maximum", "maximum-intensity", "max-intensity"], "--model mip"),
    (&["shade", "shader", "lighting", "illumination", "headlight"], "--light studio, headlight, AZ,EL or @X,Y,Z"),
    (&["ambient", "diffuse", "specular", "specular-power", "shininess"], "--material A,D,S,N of lit surfaces"),
    (&["ambient-occlusion", "ao", "ssao"], "--occlusion RADIUS"),
    (&["sample-distance", "step", "step-size", "samples", "quality", "lod"], "--max-error E sets the accuracy"),
    (&["interpolation", "interpolate", "filter", "smooth", "linear"], "--kernel and --sharpness reconstruct"),
    (&["fps", "framerate", "frame-rate", "r"], "--rate N, frames a second"),
    (&["overlay", "segmentation", "seg", "atlas", "labelmap", "label-map"], "--labels FILE, --mask FILE"),
    (&["colorbar", "scalar-bar", "scalarbar", "show-colorbar"], "--colour-bar"),
];

/// The most edits of a word that count as a misspelling.
fn most_edits(word: &str) -> usize {
    (word.len() / 4).max(1)
}

/// Insertions, deletions, replacements and swaps of neighbours that make one word of another.
fn edits(a: &str, b: &str) -> usize {
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
    let mut rows = vec![(0..=b.len()).collect::<Vec<usize>>()];
    for i in 1..=a.len() {
        let mut row = vec![i];
        for j in 1..=b.len() {
            let changed = usize::from(a[i - 1] != b[j - 1]);
            let mut least = (rows[i - 1][j] + 1).min(row[j - 1] + 1).min(rows[i - 1][j - 1] + changed);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                least = least.min(rows[i - 2][j - 2] + 1);
            }
            row.push(least);
        }
        rows.push(row);
    }
    rows[a.len()][b.len()]
}

/// The option for a word of another program or of an earlier version, if the command has all options that the text
/// names.
fn own_words(command: &Command, word: &str) -> Option<String> {
    let of_table = FOREIGN.iter().find(|(words, _)| words.contains(&word)).map(|(_, text)| (*text).to_owned());
    let text = of_table.or_else(|| knob(word).map(|knob| format!("--tune {}=VALUE", knob.key)))?;
    let has = |name: &str| command.get_arguments().any(|arg| arg.get_long() == Some(name));
    let is_known = named_in(&text).all(has);
    is_known.then_some(text)
}

/// Whether a command line asks for the list of knobs: `--tune help` of a command that has the option.
pub(crate) fn asks_for_knobs(words: &[OsString]) -> bool {
    let mut program = args::command();
    program.build();
    let command = words.get(1).and_then(|word| program.find_subcommand(word));
    let asks = words.contains(&OsString::from("--tune=help")) || words.windows(2).any(|two| two == ["--tune", "help"]);
    asks && command.is_some_and(|command| command.get_arguments().any(|arg| arg.get_long() == Some("tune")))
}

/// The options that a text names.
fn named_in(text: &str) -> impl Iterator<Item = &str> {
    text.split([' ', ',', ';']).filter_map(|word| word.strip_prefix("--"))
}

/// The most errors of a command line that are told.
const MOST_ERRORS: usize = 8;

/// What is wrong with a command line, a line for each error. The parser stops at the first error: what it is about is
/// left out, and the rest is parsed again.
pub(crate) fn messages(first: clap::Error, words: &[OsString]) -> Vec<String> {
    let mut program = args::command();
    program.build();
    let command = words.iter().skip(1).find_map(|word| program.find_subcommand(word));
    let (mut error, mut words, mut all) = (first, words.to_vec(), Vec::new());
    while all.len() < MOST_ERRORS {
        let numbers = Numbers::of(&error, &words, command).map(|numbers| numbers.message(&words));
        let said = numbers.unwrap_or_else(|| message(&error, command.map(Command::get_name)));
        if !all.contains(&said) {
            all.push(said);
        }
        let parsed = |words: Vec<OsString>| (args::command().try_get_matches_from(&words).err(), words);
        let mut rests = command.map(|command| without_fault(&error, &words, command)).unwrap_or_default().into_iter();
        let is_about_words = |error: &clap::Error| {
            use ErrorKind::{ArgumentConflict, InvalidValue, TooManyValues, UnknownArgument, ValueValidation};
            [ArgumentConflict, InvalidValue, TooManyValues, UnknownArgument, ValueValidation].contains(&error.kind())
        };
        // What is missing has been left out with the error, as the volume behind an unknown option.
        let next = rests.find_map(|rest| match parsed(rest) {
            (Some(error), _) if !is_about_words(&error) => None,
            next => Some(next),
        });
        match next {
            Some((Some(next), rest)) => (error, words) = (next, rest),
            Some((None, _)) | None => break,
        }
    }
    all
}

/// An option with a number behind it that is taken for another option or for a second volume: a negative number, or the
/// second of several.
struct Numbers<'a> {
    command: &'a str,
    arg: &'a Arg,
    /// Its word and the word behind its numbers.
    places: Range<usize>,
    /// The number that is taken for something else.
    fault: usize,
}

impl<'a> Numbers<'a> {
    fn of(error: &clap::Error, words: &[OsString], command: Option<&'a Command>) -> Option<Self> {
        let Some(ContextValue::String(typed)) = error.get(ContextKind::InvalidArg) else { return None };
        let command = command.filter(|_| error.kind() == ErrorKind::UnknownArgument)?;
        let is_number =
            |word: &OsString| word.to_string_lossy().split(',').all(|number| number.trim().parse::<f64>().is_ok());
        let found = |fault: usize| {
            // The parser names the first letter behind a dash.
            if !is_number(&words[fault]) || !words[fault].to_string_lossy().starts_with(typed.as_str()) {
                return None;
            }
            let first = (1..fault).rev().find(|at| !is_number(&words[*at]))?;
            let word = words[first].to_string_lossy();
            let takes = |arg: &&Arg| arg.get_action().takes_values() && spellings(arg).iter().any(|name| *name == word);
            let arg = command.get_arguments().find(takes)?;
            // A number that the option may have is not the fault.
            let is_fine = first + 1 == fault
                && (!typed.starts_with('-') || arg.is_allow_negative_numbers_set() || arg.is_allow_hyphen_values_set());
            let end =
                words[fault..].iter().position(|word| !is_number(word)).map_or(words.len(), |count| fault + count);
            (!is_fine).then_some(Self { command: command.get_name(), arg, places: first..end, fault })
        };
        (2..words.len()).find_map(found)
    }

    /// What is wrong: a number is negative, or numbers should be joined by commas.
    fn message(&self, words: &[OsString]) -> String {
        let long = self.arg.get_long().unwrap_or_default();
        let text = |at: usize| words[at].to_string_lossy().into_owned();
        let number = text(self.fault);
        if self.fault == self.places.start + 1 {
            let name = self.arg.get_value_names().and_then(|names| names.first()).map(ToString::to_string);
            let name = name.unwrap_or_default();
            return format!("invalid value '{number}' for '--{long} <{name}>': it is negative (see --help)");
        }
        let joined = (self.places.start + 1..self.places.end).map(text).collect::<Vec<_>>().join(",");
        // The option alone: what else is wrong does not count.
        let words = ["voxsplat", self.command, &format!("--{long}"), &joined].map(str::to_owned);
        let is_invalid = |error: clap::Error| match error.get(ContextKind::InvalidArg) {
            Some(ContextValue::String(arg)) => arg.split(' ').next() == Some(&format!("--{long}")),
            _ => false,
        };
        let tip = match args::command().try_get_matches_from(words).err().is_some_and(is_invalid) {
            true => String::new(),
            false => format!("; tip: --{long} {joined}"),
        };
        format!("unexpected argument '{number}' found{tip} (see --help)")
    }
}

/// A command line without what an error is about: the ways to leave it out, the likeliest first.
fn without_fault(error: &clap::Error, words: &[OsString], command: &Command) -> Vec<Vec<OsString>> {
    let text = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => text.clone(),
        Some(ContextValue::Strings(texts)) => texts.first().cloned().unwrap_or_default(),
        _ => String::new(),
    };
    let (typed, value) = (text(ContextKind::InvalidArg), text(ContextKind::InvalidValue));
    let name = typed.split([' ', '=']).next().unwrap_or_default();
    let without = |from: usize, count: usize| [&words[..from], &words[(from + count).min(words.len())..]].concat();
    if let Some(Numbers { places, .. }) = Numbers::of(error, words, Some(command)) {
        return vec![without(places.start, places.len())];
    }
    let is_value = |word: &OsString| {
        let word = word.to_string_lossy();
        !word.starts_with('-') || word == STREAM || word.parse::<f64>().is_ok()
    };
    let word_is = |word: &OsString, name: &str| {
        let word = word.to_string_lossy();
        let inline = || word.strip_prefix(name).is_some_and(|rest| rest.starts_with('='));
        word == name || (name.starts_with("--") && inline())
    };
    if error.kind() == ErrorKind::UnknownArgument {
        let Some(at) = words.iter().rposition(|word| word_is(word, name)) else { return Vec::new() };
        // Whether the words behind an unknown option are its values is not known.
        let is_alone = !name.starts_with('-') || words[at].to_string_lossy().contains('=');
        let values = words[at + 1..].iter().take_while(|word| is_value(word) && !is_alone).count();
        return (0..=values).rev().map(|values| without(at, 1 + values)).collect();
    }
    let Some(arg) = command.get_arguments().find(|arg| arg.get_long().is_some_and(|long| name == format!("--{long}")))
    else {
        return Vec::new();
    };
    let spelled = spellings(arg);
    let holds = |at: &usize| {
        let next = words.get(at + 1).map(|next| next.to_string_lossy().into_owned()).unwrap_or_default();
        words[*at].to_string_lossy().contains(&value) || next.contains(&value)
    };
    let places = (1..words.len()).filter(|&at| spelled.iter().any(|name| word_is(&words[at], name)));
    let Some(at) = places.rev().find(holds) else { return Vec::new() };
    let is_inline = words[at].to_string_lossy().contains('=');
    // A value may begin as an option does.
    let is_wrong = |word: &OsString| !value.is_empty() && word.to_string_lossy().contains(&value);
    let next = words.get(at + 1).filter(|word| is_value(word) || is_wrong(word));
    let has_value = arg.get_action().takes_values() && !is_inline && next.is_some();
    vec![without(at, 1 + usize::from(has_value))]
}

/// The words that stand for an option.
fn spellings(arg: &Arg) -> Vec<String> {
    let aliases = arg.get_all_aliases().unwrap_or_default();
    let long = arg.get_long().into_iter().chain(aliases).map(|name| format!("--{name}"));
    long.chain(arg.get_short().map(|short| format!("-{short}"))).collect()
}

/// What is wrong with the name of a command: `help` is an option, and a volume alone is no command.
fn of_command(error: &clap::Error) -> Option<String> {
    let Some(ContextValue::String(word)) = error.get(ContextKind::InvalidSubcommand) else { return None };
    let program = args::command();
    let is_near = |command: &Command| edits(word, command.get_name()) <= most_edits(word);
    if let Some(near) = program.get_subcommands().find(|command| is_near(command)) {
        return Some(format!(
            "unrecognized subcommand '{word}'; tip: a similar subcommand exists: '{}'",
            near.get_name()
        ));
    }
    let names: Vec<&str> = program.get_subcommands().map(Command::get_name).collect();
    let expected =
        if word == "help" { "voxsplat --help or voxsplat COMMAND --help".to_owned() } else { names.join(", ") };
    Some(format!("unrecognized subcommand '{word}', expected {expected}"))
}

/// What is wrong with a command line, in one line. `command` is the name of its command.
pub(crate) fn message(error: &clap::Error, command: Option<&str>) -> String {
    let text = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => Some(text.clone()),
        Some(ContextValue::Strings(texts)) => texts.first().cloned(),
        _ => None,
    };
    if let Some(said) = of_command(error) {
        return said;
    }
    let typed = text(ContextKind::InvalidArg).filter(|_| error.kind() == ErrorKind::UnknownArgument);
    let Some(word) = typed.as_deref().filter(|typed| typed.starts_with('-') && *typed != STREAM) else {
        return in_one_line(&error.render().to_string());
    };
    let word = word.trim_start_matches('-').split('=').next().unwrap_or_default().to_lowercase().replace('_', "-");
    let mut program = args::command();
    program.build();
    let command = command.and_then(|name| program.find_subcommand(name)).unwrap_or(&program);
    let suggested = text(ContextKind::SuggestedArg);
    let near = suggested.filter(|other| {
        let other = other.trim_start_matches('-').split([' ', '=']).next().unwrap_or_default();
        edits(&word, other) <= most_edits(&word) || (word.len() > 2 && other.starts_with(&word))
    });
    let tip = match (own_words(command, &word), near) {
        (Some(own), _) => format!(": {own}"),
        (None, Some(near)) => format!("; tip: a similar argument exists: '{near}'"),
        (None, None) => String::new(),
    };
    format!("unexpected argument '{}' found{tip} (see --help)", typed.unwrap_or_default())
}

/// A message with options in the spelling that was typed: some have aliases.
pub(crate) fn as_typed(message: &str, words: &[OsString]) -> String {
    let typed = |name: &str| {
        let word = |word: &OsString| word.to_string_lossy().split('=').next() == Some(&format!("--{name}"));
        words.iter().any(word)
    };
    let program = args::command();
    let aliased = program.get_subcommands().flat_map(Command::get_arguments).filter_map(|arg| {
        let long = arg.get_long().filter(|long| !typed(long))?;
        Some((long, arg.get_all_aliases()?.into_iter().find(|alias| typed(alias))?))
    });
    aliased.fold(message.to_owned(), |message, (long, alias)| {
        let option = format!("--{long}");
        let mut parts = message.split(&option);
        let first = parts.next().unwrap_or_default().to_owned();
        parts.fold(first, |text, part| {
            let is_whole = !part.starts_with(|next: char| next == '-' || next.is_alphanumeric());
            format!("{text}--{}{part}", if is_whole { alias } else { long })
        })
    })
}

/// The error of `clap` in one line: its first paragraph and its tips, without the usage text.
fn in_one_line(text: &str) -> String {
    let lines: Vec<&str> = text.lines().map(str::trim).collect();
    let end = lines.iter().position(|l| l.starts_with("Usage:") || l.starts_with("For more information"));
    let kept: Vec<&str> = lines[..end.unwrap_or(lines.len())].iter().copied().filter(|l| !l.is_empty()).collect();
    let message = kept.join("; ").replace(":; ", ": ");
    format!("{} (see --help)", plain(message.strip_prefix("error: ").unwrap_or(&message)))
}

/// A message of `clap` with lists and ranges as they are in other messages.
fn plain(message: &str) -> String {
    let listed = message.split_once("; [possible values: ").and_then(|(head, rest)| {
        let (values, tail) = rest.split_once(']')?;
        Some(format!("{head}: expected one of {values}{tail}"))
    });
    let ranged = message.split_once("..=").and_then(|(head, last)| {
        let (head, first) = head.rsplit_once(' ')?;
        let (head, _) = head.strip_suffix(" is not in")?.rsplit_once(' ')?;
        Some(format!("{head} expected {first} to {last}"))
    });
    let message = listed.or(ranged).unwrap_or_else(|| message.to_owned());
    let of_numbers = [
        ("invalid digit found in string", "expected a whole number"),
        ("cannot parse integer from empty string", "expected a whole number"),
        ("number too large to fit in target type", "the number is too large"),
    ];
    of_numbers.iter().fold(message, |message, (from, to)| message.replace(from, to))
}

/// What is wrong with the input of a wrong command line: a volume that is not there. It comes before what is wrong
/// with the options, so that both are known at once.
pub(crate) fn missing_input(words: &[OsString]) -> Option<String> {
    let matches = args::command().ignore_errors(true).try_get_matches_from(words).ok()?;
    let (name, matches) = matches.subcommand()?;
    let source = matches.try_get_one::<std::path::PathBuf>("source").ok().flatten()?;
    let text = source.to_string_lossy();
    // The value of a misspelt option may be taken for the volume: only what looks like a file is looked for.
    let is_number = text.split(',').all(|part| part.parse::<f64>().is_ok());
    let looks_like_file = text.contains(['.', '/', '\\']) && !is_number;
    let is_there = source.exists() || text.rsplit_once(':').is_some_and(|(file, _)| Path::new(file).exists());
    if !looks_like_file || is_there || text.starts_with("demo:") || *source == Path::new(STREAM) || name == "compare" {
        return None;
    }
    let reason = std::fs::metadata(source).err()?;
    Some(format!("cannot read {text}: {reason}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tune::{KNOBS, Knob};

    fn said(line: &str) -> String {
        let words: Vec<&str> = line.split_whitespace().collect();
        let error = args::command().try_get_matches_from(&words).unwrap_err();
        message(&error, Some(words[1]))
    }

    #[test]
    fn words_of_other_programs_lead_to_options_that_exist() {
        let mut program = args::command();
        program.build();
        let turntable = program.find_subcommand("turntable").unwrap();
        let has = |name: &str| {
            turntable
                .get_arguments()
                .any(|arg| arg.get_long() == Some(name) || arg.get_all_aliases().is_some_and(|all| all.contains(&name)))
        };
        let mut seen = Vec::new();
        for (words, text) in FOREIGN {
            for word in words {
                assert!(!has(word), "--{word} is an option");
                assert!(!seen.contains(word), "{word} is there twice");
                seen.push(word);
                assert!(said(&format!("voxsplat turntable a.nii --{word}")).contains(text), "{word}");
            }
            assert!(named_in(text).all(has), "{text}");
        }
    }

    #[test]
    fn keys_of_tune_that_were_options_lead_to_tune() {
        for Knob { key, .. } in KNOBS {
            for command in ["render", "turntable", "pareto"] {
                let said = said(&format!("voxsplat {command} a.nii --{key} 3"));
                assert!(said.contains(&format!("'--{key}' found: --tune {key}=VALUE")), "{said}");
            }
        }
    }

    #[test]
    fn a_first_picture_needs_few_options_and_help_has_a_bounded_number() {
        let mut program = args::command();
        program.build();
        let own = |arg: &&Arg| arg.get_long().is_some_and(|long| !["help", "quiet"].contains(&long));
        let count = |shown: &dyn Fn(&Arg) -> bool| {
            let render = program.find_subcommand("render").unwrap();
            render.get_arguments().filter(own).filter(|arg| shown(arg)).count()
        };
        let (brief, all) = (count(&|arg| !arg.is_hide_short_help_set()), count(&|_| true));
        assert!((15..=25).contains(&brief), "-h shows {brief} options");
        assert!(all <= 65, "--help shows {all} options");
    }

    #[test]
    fn tips_are_for_misspellings() {
        for (line, tip) in [
            ("render a --azimut 3", Some("'--azimuth'")),
            ("render a --elevaton 3", Some("'--elevation'")),
            ("render a --projecton 3", Some("'--projection'")),
            ("render a --sahdows on", Some("'--shadows'")),
            ("render a --slcie", None),
            ("render a --wobble", None),
            ("render a --frobnicate=3", None),
            ("info a --preset ct-bone", None),
        ] {
            let said = said(&format!("voxsplat {line}"));
            assert_eq!(said.contains("tip:"), tip.is_some(), "{line}: {said}");
            assert!(tip.is_none_or(|tip| said.contains(tip)) && !said.contains("-- --"), "{line}: {said}");
        }
    }

    #[test]
    fn errors_come_all_at_once_and_none_of_them_follows_from_another() {
        for (line, parts) in [
            ("render a.nii --azimut 3 --wobble", &["'--azimut' found; tip", "'--wobble'"][..]),
            ("render a.nii -o b.png --azimuth left --size 0x --zoom=x", &["left", "0x", "'x' for '--zoom"]),
            ("render a.nii --wobble --azimuth left -o b.png", &["'--wobble'", "left"]),
            ("render a.nii --azimuth left --azimut 3 --elevation up", &["'--azimut'", "left", "'up'"]),
            // The volume may stand behind an unknown option.
            ("render --wobble a.nii --azimut 3 -o b.png", &["'--wobble'", "'--azimut'"]),
            ("render --slice 3 a.nii --azimuth left", &["'--slice'", "left"]),
            ("render a.nii --pan 1 2 --azimuth left", &["'--pan'", "left"]),
            ("render a.nii --wobble=3 --wobble=4", &["'--wobble'"]),
            ("render a.nii b.nii --wobble", &["'b.nii'", "'--wobble'"]),
            ("render a.nii --light 3 --light 1,2 --light x", &["'3'", "'x'"]),
            ("render a.nii --direction 1,0,0 --azimuth 3 --zoom -x", &["cannot be used with", "'-x'"]),
            ("render a.nii --color-bar=3 --azimuth", &["value '3'", "a value is required for '--azimuth"]),
            ("render --azimuth left", &["left"]),
            ("render a.nii --window 3 -o", &["'3'", "a value is required for '--output"]),
            ("info a.nii --preset x --wobble", &["'--preset'", "'--wobble'"]),
            ("paint a.nii --wobble", &["'paint', expected render, "]),
            ("help render", &["expected voxsplat --help"]),
            ("rendr a.nii", &["tip: a similar subcommand exists: 'render'"]),
            // Numbers that look like options or like volumes.
            ("render a.nii --size -5 --elevation -5", &["'-5' for '--size <WxH>': it is negative"]),
            ("turntable a.nii --frames -3 --part -1/2", &["'-3' for '--frames <N>'", "'-1"]),
            ("render a.nii --region -1,0,5,5", &["'-1,0,5,5' for '--region <X,Y,W,H>': it is negative"]),
            (
                "render a.nii --up 0 0 1 --light 30 40",
                &["'0' found; tip: --up 0,0,1", "'40' found; tip: --light 30,40"],
            ),
            ("render a.nii --azimuth 30 40 --wobble", &["'40' found (see", "'--wobble'"]),
            ("turntable a.nii --frames 2.5", &["'2.5' for '--frames <N>': expected a whole number"]),
            ("render a.nii --window 40 400 --wobble", &["'400' found; tip: --window 40,400", "'--wobble'"]),
            ("render a.nii --projection iso", &["'iso' for '--projection <KIND>': expected one of orthographic, "]),
            ("turntable a.nii --frames 0", &["'0' for '--frames <N>': expected 1 to 100000"]),
            ("render a.nii --azimuth 30deg --zoom 200%", &["expected a finite number, without a unit", "0, without a"]),
            ("render", &["not provided"]),
        ] {
            let words: Vec<OsString> = format!("voxsplat {line}").split_whitespace().map(OsString::from).collect();
            let all = messages(args::command().try_get_matches_from(&words).unwrap_err(), &words);
            assert_eq!(all.len(), parts.len(), "{line}: {all:#?}");
            for part in parts {
                let count = all.iter().filter(|said| said.contains(part)).count();
                assert!(count > 0, "{line}: {part}: {all:#?}");
            }
        }
    }

    #[test]
    fn options_are_named_as_they_were_typed() {
        let words = ["render", "--color-bar", "--clip-plane=R"].map(OsString::from);
        for (message, spelled) in [
            ("--colour-bar: none", "--color-bar: none"),
            ("--clip-boxes and --clip R, --colour-map", "--clip-boxes and --clip-plane R, --colour-map"),
            ("--up: 0", "--up: 0"),
        ] {
            assert_eq!(as_typed(message, &words), spelled);
            assert_eq!(as_typed(message, &[]), message);
        }
    }

    #[test]
    fn edits_are_counted() {
        for (a, b, count) in [("azimut", "azimuth", 1), ("sahdows", "shadows", 1), ("slice", "size", 2), ("", "ab", 2)]
        {
            assert_eq!(edits(a, b), count, "{a} {b}");
        }
    }
}
