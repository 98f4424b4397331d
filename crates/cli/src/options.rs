//! Options from settings, to be copied into a command line.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

use clap::parser::ValueSource;
use clap::{Arg, ArgMatches, Command};
use voxsplat::settings::{Level, Model, Painter, Settings};

use super::given::MAP;
use super::tune;

/// Keys of `--tune` that a study varies or measures by.
pub(crate) const STUDIED: [&str; 9] = [
    "sheets",
    "accumulate",
    "sheet-thickness",
    "precision",
    "table-error",
    "resolution",
    "interslice",
    "termination",
    "sample",
];

/// Returns the options of `voxsplat render` that make settings what they are, with their values. Defaults are left out,
/// apart from the painter.
pub(crate) fn options_of(settings: &Settings) -> Vec<String> {
    let default = Settings::default();
    let is_composite = settings.model == Model::Composite;
    let level = |level| match level {
        Level::Auto => "auto".to_owned(),
        Level::At(level) => level.to_string(),
    };
    let painter = |painter: &Painter| match painter {
        Painter::Auto => "auto",
        Painter::Tiles(_) => "tiles",
        Painter::Quads(_) => "quads",
    };
    let text = |s: &Settings| {
        let shading = if is_composite { s.shading } else { default.shading };
        [
            ("--shading", shading.to_string()),
            ("--response", s.response.to_string()),
            ("--kernel", s.kernel.to_string()),
            ("--sharpness", s.sharpness.to_string()),
            ("--level", level(s.level)),
            ("--painter", painter(&s.painter).to_owned()),
            ("--tune", tune::pairs_of(s)),
            ("--attenuation", s.attenuation.to_string()),
        ]
    };
    let changed = text(settings).into_iter().zip(text(&default)).filter(|(own, default)| own != default);
    let mut options: Vec<String> = changed.flat_map(|((name, value), _)| [name.to_owned(), value]).collect();
    if settings.depth_coded {
        options.push("--depth-coded".to_owned());
    }
    options
}

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

/// Returns a command line of words, quoted for a shell.
pub(crate) fn command_line(words: &[String]) -> String {
    words.iter().map(|word| quoted(word.as_ref())).collect::<Vec<_>>().join(" ")
}

/// Returns a text as one word of a POSIX shell. Text that is not UTF-8 is written as `$'...'` (POSIX 2024).
pub(crate) fn quoted(text: &OsStr) -> String {
    let plain = |c: char| c.is_alphanumeric() || "-_./:,=+@%#".contains(c);
    match text.to_str() {
        Some(text) if !text.is_empty() && !text.starts_with('#') && text.chars().all(plain) => text.to_owned(),
        Some(text) => format!("'{}'", text.replace('\'', r"'\''")),
        None => {
            let byte = |&byte: &u8| match char::from(byte) {
                c if c.is_ascii() && plain(c) => c.to_string(),
                _ => format!("\\x{byte:02x}"),
            };
            format!("$'{}'", text.as_encoded_bytes().iter().map(byte).collect::<String>())
        }
    }
}

/// The words of this process's command line with the names of files for their paths: folders are private.
pub(crate) fn without_folders(words: impl IntoIterator<Item = String>, matches: &ArgMatches) -> Vec<String> {
    let of = |id: &clap::Id| matches.try_get_many::<PathBuf>(id.as_str()).ok().flatten();
    let paths: Vec<String> =
        matches.ids().filter_map(of).flatten().map(|path| path.to_string_lossy().into_owned()).collect();
    let shared = |word: String| {
        let path = paths.iter().filter(|path| !path.is_empty() && word.ends_with(*path)).max_by_key(|path| path.len());
        match path {
            Some(path) => format!("{}{}", &word[..word.len() - path.len()], file_name(path)),
            None => word,
        }
    };
    words.into_iter().map(shared).collect()
}

/// The name of a file or a folder, with the data set behind it; of a colour map in a file, with its prefix.
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

/// The words of a command line without some options and their values, and without some that have none.
pub(crate) fn without(words: impl IntoIterator<Item = String>, valued: &[&str], bare: &[&str]) -> Vec<String> {
    let mut kept = Vec::new();
    let mut words = words.into_iter();
    while let Some(word) = words.next() {
        let name = word.split_once('=').map_or(word.as_str(), |(name, _)| name);
        let is_short = |option: &&str| option.len() == 2 && word.len() > 2 && word.starts_with(*option);
        if bare.contains(&name) || valued.iter().any(|option| is_short(option) && !word.starts_with("--")) {
            continue;
        }
        if valued.contains(&name) {
            if name == word {
                words.next();
            }
            continue;
        }
        kept.push(word);
    }
    kept
}

#[cfg(test)]
mod tests {
    use clap::Parser;

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
    fn words_are_quoted_and_left_out() {
        let words = ["a b", "it's", "--up", "0,1,0", ""].map(str::to_owned);
        assert_eq!(command_line(&words), r"'a b' 'it'\''s' --up 0,1,0 ''");
        let words = "ct.nrrd -o dir -odir --level=2 --resume --zoom 2 --level 1".split(' ').map(str::to_owned);
        assert_eq!(without(words, &["-o", "--level"], &["--resume"]), ["ct.nrrd", "--zoom", "2"]);
    }
}
