//! Options from settings, to be copied into a command line.

use std::ffi::{OsStr, OsString};
use std::path::Path;

use clap::builder::ValueHint;
use clap::parser::ValueSource;
use clap::{Arg, ArgMatches, Command};
use voxsplat::program::{self, MAP};

use super::args;

/// An option by its long name, with its values; a flag has none.
pub(crate) type OptionValues = (String, Vec<OsString>);

/// Returns the options that a command line gives, without the defaults.
pub(crate) fn given(command: &Command, matches: &ArgMatches) -> Vec<OptionValues> {
    let is_given = |arg: &&Arg| matches.value_source(arg.get_id().as_str()) == Some(ValueSource::CommandLine);
    let option = |arg: &Arg| {
        let raw = arg.get_action().takes_values().then(|| matches.get_raw(arg.get_id().as_str())).flatten();
        Some((arg.get_long()?.to_owned(), raw.into_iter().flatten().map(OsStr::to_owned).collect()))
    };
    command.get_arguments().filter(is_given).filter_map(option).collect()
}

/// Returns a text as one word of a POSIX shell. Text that is not UTF-8 is written as `$'...'` (POSIX 2024).
pub(crate) fn quoted(text: &OsStr) -> String {
    let byte = |&byte: &u8| match char::from(byte) {
        c if c.is_ascii_alphanumeric() || "-_./:,=+@%#".contains(c) => c.to_string(),
        _ => format!("\\x{byte:02x}"),
    };
    let bytes = || text.as_encoded_bytes().iter().map(byte).collect::<String>();
    text.to_str().map_or_else(|| format!("$'{}'", bytes()), program::quoted)
}

/// Returns the words behind a command: its input, and its options but for some. `path` writes paths.
pub(crate) fn words(
    (command, matches): (&Command, &ArgMatches),
    skipped: &[&str],
    path: impl Fn(&str) -> String,
) -> Vec<String> {
    let source = matches.get_raw("source").into_iter().flatten().map(|source| path(&source.to_string_lossy()));
    let mut words: Vec<String> = source.collect();
    for (name, values) in given(command, matches).into_iter().filter(|(name, _)| !skipped.contains(&name.as_str())) {
        let arg = args::option(command, &name);
        let short = arg.and_then(Arg::get_short).map(|short| format!("-{short}"));
        let option = short.unwrap_or_else(|| format!("--{name}"));
        let is_path = arg.is_some_and(|arg| arg.get_value_hint() == ValueHint::AnyPath);
        if values.is_empty() {
            words.push(option.clone());
        }
        for value in values {
            let value = value.to_string_lossy();
            words.extend([option.clone(), if is_path { path(&value) } else { value.into_owned() }]);
        }
    }
    words
}

/// Returns the name of a file or a folder, with the data set behind it; for a colour map in a file, with its prefix.
pub(crate) fn file_name(path: &str) -> String {
    if let Some(map) = path.strip_prefix(MAP) {
        return format!("{MAP}{}", file_name(map));
    }
    if path.starts_with('{') || path.starts_with("demo:") {
        return path.to_owned();
    }
    let (file, inside) = match path.rfind(":/").filter(|at| *at > 1) {
        Some(at) => path.split_at(at),
        None => (path, ""),
    };
    let name = Path::new(file).canonicalize().ok().filter(|_| file.ends_with('.')).unwrap_or_else(|| file.into());
    name.file_name().map_or_else(|| file.to_owned(), |name| name.to_string_lossy().into_owned()) + inside
}

#[cfg(test)]
mod tests {
    use clap::Parser;
    use voxsplat::program::options_of;
    use voxsplat::settings::{Model, Settings};

    use super::super::args::{Args, Command};
    use super::super::job::RenderJob;
    use super::super::pareto::variants;
    use super::*;

    #[test]
    fn options_are_those_that_make_the_settings() {
        for model in Model::ALL {
            for variant in variants(&Settings { model, ..Settings::default() }) {
                let mut words = ["voxsplat", "render", "demo:sphere", "-o", "a.png", "--model", model.name()]
                    .map(str::to_owned)
                    .to_vec();
                words.extend(options_of(&variant.settings));
                let Command::Render(args) = Args::try_parse_from(&words).unwrap().command else { unreachable!() };
                let job = RenderJob::new(*args).unwrap();
                assert_eq!(job.settings, variant.settings, "{words:?}");
            }
        }
    }

    #[test]
    fn names_stand_for_paths() {
        for (path, name) in [
            ("/home/me/ct.nrrd", "ct.nrrd"),
            ("a/b/", "b"),
            ("ct.nrrd", "ct.nrrd"),
            ("/home/me/a.h5:/group/set", "a.h5:/group/set"),
            ("/home/me/m.nrrd:2,3", "m.nrrd:2,3"),
            ("demo:vessels:64", "demo:vessels:64"),
            ("map:/home/me/map.json", "map:map.json"),
            ("map:viridis", "map:viridis"),
            ("-", "-"),
        ] {
            assert_eq!(file_name(path), name);
        }
    }

    #[test]
    fn words_are_left_out() {
        let program = args::built();
        let line = "voxsplat pareto a/ct.nrrd -ob/dir --level=2 --resume --transfer c/t.json --zoom 2";
        let matches = args::command().try_get_matches_from(line.split(' ')).unwrap();
        let line = (program.find_subcommand("pareto").unwrap(), matches.subcommand().unwrap().1);
        let kept = words(line, &["output", "level", "resume"], file_name);
        assert_eq!(kept, ["ct.nrrd", "--zoom", "2", "--transfer", "t.json"]);
        assert_eq!(words(line, &["level", "resume", "zoom", "transfer"], str::to_owned), ["a/ct.nrrd", "-o", "b/dir"]);
    }
}
