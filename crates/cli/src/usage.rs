//! Errors of command lines: a line for each error, with the program's option for a word of another program.

use std::ffi::OsString;
use std::path::Path;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Arg, Command};
use voxsplat::formats::is_url;
use voxsplat::program::ForeignWords;
use voxsplat_volume::names::{is_near, nearest};

use super::args;
use super::destination::STREAM;
use super::tune;

/// Returns the program's option for a word of another program or of an earlier version, if the command has all options
/// that the text names.
fn own_words(command: &Command, word: &str) -> Option<String> {
    let of_table = ForeignWords::of(word).map(|row| row.option.to_owned()).filter(|text| !text.is_empty());
    let text = of_table.or_else(|| tune::has(word).then(|| format!("--tune {word}=VALUE")))?;
    let is_known = named_in(&text).all(|name| args::option(command, name).is_some());
    is_known.then_some(text)
}

/// Returns whether a command line requests the list of knobs: `--tune help` of a command that has the option.
pub(crate) fn requests_knobs(words: &[OsString]) -> bool {
    let program = args::built();
    let command = words.get(1).and_then(|word| program.find_subcommand(word));
    let requests =
        words.contains(&OsString::from("--tune=help")) || words.windows(2).any(|two| two == ["--tune", "help"]);
    requests && command.is_some_and(|command| args::option(command, "tune").is_some())
}

/// Returns the options that a text names.
fn named_in(text: &str) -> impl Iterator<Item = &str> {
    text.split([' ', ',', ';']).filter_map(|word| word.strip_prefix("--"))
}

/// The largest number of errors of a command line that are reported.
const MOST_ERRORS: usize = 8;

/// Returns the errors of a command line, each in a line. The parser stops at the first error, so each option is parsed
/// alone with the words behind it, and then all that are right together.
pub(crate) fn messages(first: &clap::Error, words: &[OsString]) -> Vec<String> {
    let program = args::built();
    let found = words.iter().enumerate().skip(1).find_map(|(at, word)| Some((at + 1, program.find_subcommand(word)?)));
    let Some((at, command)) = found else { return vec![message(first, &program)] };
    let (head, tail) = words.split_at(at);
    let error = |words: &[OsString]| {
        use ErrorKind::{ArgumentConflict, InvalidValue, TooManyValues, UnknownArgument, ValueValidation};
        let about_words = [ArgumentConflict, InvalidValue, TooManyValues, UnknownArgument, ValueValidation];
        let error = args::command().try_get_matches_from([head, words].concat()).err()?;
        about_words.contains(&error.kind()).then_some(error)
    };
    let starts_option = |word: &OsString| {
        let word = word.to_string_lossy();
        let is_short = |arg: &Arg| arg.get_short().is_some_and(|short| word.starts_with(&format!("-{short}")));
        word.len() > 2 && word.starts_with("--") || command.get_arguments().any(is_short)
    };
    let (mut all, mut right) = (Vec::new(), Vec::new());
    for group in tail.chunk_by(|_, next| !starts_option(next)) {
        match parted_numbers(group, command, error).or_else(|| Some(message(&error(group)?, command))) {
            Some(message) if all.contains(&message) => {}
            Some(message) => all.push(message),
            None => right.extend_from_slice(group),
        }
    }
    all.extend(error(&right).map(|error| message(&error, command)));
    // Otherwise something is missing.
    if all.is_empty() {
        all.push(message(first, command));
    }
    all.truncate(MOST_ERRORS);
    all
}

/// Returns the error of an option with several numbers behind it, which should be joined by commas.
fn parted_numbers(
    group: &[OsString],
    command: &Command,
    error: impl Fn(&[OsString]) -> Option<clap::Error>,
) -> Option<String> {
    let texts: Vec<_> = group.iter().map(|word| word.to_string_lossy()).collect();
    let [option, numbers @ ..] = &texts[..] else { return None };
    let arg = command.get_arguments().find(|arg| spellings(arg).contains(&option.to_string()))?;
    let are_numbers = numbers.iter().all(|word| word.split(',').all(|number| number.trim().parse::<f64>().is_ok()));
    if numbers.len() < 2 || !are_numbers || !arg.get_action().takes_values() {
        return None;
    }
    let joined = numbers.join(",");
    let is_valid = error(&[group[0].clone(), OsString::from(&joined)]).is_none();
    let tip = if is_valid { format!("; tip: {option} {joined}") } else { String::new() };
    Some(format!("unexpected argument '{}' found{tip} (see --help)", numbers[1]))
}

/// Returns the words that stand for an option.
fn spellings(arg: &Arg) -> Vec<String> {
    let aliases = arg.get_all_aliases().unwrap_or_default();
    let long = arg.get_long().into_iter().chain(aliases).map(|name| format!("--{name}"));
    long.chain(arg.get_short().map(|short| format!("-{short}"))).collect()
}

/// Returns the text of an error's context.
fn context(error: &clap::Error, kind: ContextKind) -> Option<String> {
    match error.get(kind) {
        Some(ContextValue::String(text)) => Some(text.clone()),
        Some(ContextValue::Strings(texts)) => texts.first().cloned(),
        _ => None,
    }
}

/// Returns the error of a command's name, if it is one.
fn of_command(error: &clap::Error) -> Option<String> {
    let word = context(error, ContextKind::InvalidSubcommand)?;
    let program = args::command();
    let names: Vec<&str> = program.get_subcommands().map(Command::get_name).collect();
    if error.kind() == ErrorKind::MissingSubcommand {
        return Some(format!("a command is missing, expected {} (see --help)", names.join(", ")));
    }
    let tip = match nearest(&word, names.iter().copied()) {
        Some(near) => format!("; tip: a similar subcommand exists: '{near}'"),
        None if word == "help" => ", expected voxsplat --help or voxsplat COMMAND --help".to_owned(),
        None => format!(", expected {}", names.join(", ")),
    };
    Some(format!("unrecognized subcommand '{word}'{tip}"))
}

/// Returns an error of a command in one line.
fn message(error: &clap::Error, command: &Command) -> String {
    if let Some(message) = of_command(error) {
        return message;
    }
    let typed = context(error, ContextKind::InvalidArg).filter(|_| error.kind() == ErrorKind::UnknownArgument);
    let Some(typed) = typed.filter(|typed| typed.starts_with('-') && typed != STREAM) else {
        return in_one_line(&error.render().to_string());
    };
    let word = typed.trim_start_matches('-').split('=').next().unwrap_or_default().to_lowercase().replace('_', "-");
    let near = context(error, ContextKind::SuggestedArg).filter(|other| {
        let other = other.trim_start_matches('-').split([' ', '=']).next().unwrap_or_default();
        is_near(&word, other) || (word.len() > 2 && other.starts_with(&word))
    });
    let tip = match (own_words(command, &word), near) {
        (Some(own), _) => format!(": {own}"),
        (None, Some(near)) => format!("; tip: a similar argument exists: '{near}'"),
        (None, None) => String::new(),
    };
    format!("unexpected argument '{typed}' found{tip} (see --help)")
}

/// Returns a message with options in the spelling that was typed: some have aliases.
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

/// Returns the error of `clap` in one line: its first paragraph and its tips, without the usage text.
fn in_one_line(text: &str) -> String {
    let lines: Vec<&str> = text.lines().map(str::trim).collect();
    let end = lines.iter().position(|l| l.starts_with("Usage:") || l.starts_with("For more information"));
    let kept: Vec<&str> = lines[..end.unwrap_or(lines.len())].iter().copied().filter(|l| !l.is_empty()).collect();
    let message = kept.join("; ").replace(":; ", ": ");
    format!("{} (see --help)", plain(message.strip_prefix("error: ").unwrap_or(&message)))
}

/// Returns a message of `clap` with possible values as they are in other messages.
fn plain(message: &str) -> String {
    let (head, rest) = message.split_once("; [possible values: ").unwrap_or((message, ""));
    match rest.split_once(']') {
        Some((values, tail)) => format!("{head}: expected one of {values}{tail}"),
        None => message.to_owned(),
    }
}

/// Returns the error of a missing volume in a wrong command line, so that it is reported together with errors of
/// options.
pub(crate) fn missing_input(words: &[OsString]) -> Option<String> {
    let matches = args::command().ignore_errors(true).try_get_matches_from(words).ok()?;
    let (name, matches) = matches.subcommand()?;
    let source = matches.try_get_one::<std::path::PathBuf>("source").ok().flatten()?;
    let text = source.to_string_lossy();
    // The volume may be the value of a misspelt option, so only names of files are checked.
    let is_number = text.split(',').all(|part| part.parse::<f64>().is_ok());
    let looks_like_file = text.contains(['.', '/', '\\']) && !is_number;
    let is_there = source.exists() || text.rsplit_once(':').is_some_and(|(file, _)| Path::new(file).exists());
    if !looks_like_file
        || is_there
        || is_url(source)
        || text.starts_with("demo:")
        || *source == Path::new(STREAM)
        || name == "compare"
    {
        return None;
    }
    let reason = std::fs::metadata(source).err()?;
    Some(format!("cannot read {text}: {reason}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tune::Tuning;
    use clap::CommandFactory;

    fn said(line: &str) -> String {
        let words: Vec<&str> = line.split_whitespace().collect();
        let error = args::command().try_get_matches_from(&words).unwrap_err();
        message(&error, args::built().find_subcommand(words[1]).unwrap())
    }

    #[test]
    fn words_of_other_programs_lead_to_options_that_exist() {
        let program = args::built();
        let turntable = program.find_subcommand("turntable").unwrap();
        let has = |name: &str| args::option(turntable, name).is_some();
        let mut seen = Vec::new();
        for ForeignWords { words, option: text, .. } in ForeignWords::all() {
            for word in words.split(' ') {
                assert!(!seen.contains(&word), "{word} is there twice");
                seen.push(word);
                if text.is_empty() {
                    continue;
                }
                assert!(!has(word), "--{word} is an option");
                assert!(said(&format!("voxsplat turntable a.nii --{word}")).contains(text), "{word}");
            }
            assert!(named_in(text).all(has), "{text}");
        }
    }

    #[test]
    fn keys_of_tune_that_were_options_lead_to_tune() {
        for key in Tuning::command().get_arguments().filter_map(Arg::get_long) {
            for command in ["render", "turntable", "pareto"] {
                let said = said(&format!("voxsplat {command} a.nii --{key} 3"));
                assert!(said.contains(&format!("'--{key}' found: --tune {key}=VALUE")), "{said}");
            }
        }
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
            ("render a.nii --size -5 --elevation -5", &["'-5' for '--size <WxH>': expected WIDTHxHEIGHT"]),
            ("turntable a.nii --frames -3 --part -1/2", &["'-3' for '--frames <N>'", "'-1"]),
            ("render a.nii --region -1,0,5,5", &["'-1,0,5,5' for '--region <X,Y,W,H>': expected four"]),
            (
                "render a.nii --up 0 0 1 --light 30 40",
                &["'0' found; tip: --up 0,0,1", "'40' found; tip: --light 30,40"],
            ),
            ("render a.nii --azimuth 30 40 --wobble", &["'40' found (see", "'--wobble'"]),
            ("turntable a.nii --frames 2.5", &["'2.5' for '--frames <N>': expected a whole number"]),
            ("render a.nii --window 40 400 --wobble", &["'400' found; tip: --window 40,400", "'--wobble'"]),
            ("render a.nii --projection iso", &["'iso' for '--projection <KIND>': expected one of orthographic, "]),
            ("turntable a.nii --frames 0", &["'0' for '--frames <N>': expected a whole number from 1 to 100000"]),
            ("render a.nii --azimuth 30deg --zoom 200%", &["expected a finite number, without a unit", "0, without a"]),
            ("render", &["not provided"]),
        ] {
            let words: Vec<OsString> = format!("voxsplat {line}").split_whitespace().map(OsString::from).collect();
            let all = messages(&args::command().try_get_matches_from(&words).unwrap_err(), &words);
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
}
