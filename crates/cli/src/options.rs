//! Options from settings, to be copied into a command line.

use std::path::{Path, PathBuf};

use clap::ArgMatches;
use voxsplat::settings::{
    Accumulation, Interslice, Level, Model, Painter, QuadsSettings, Resolution, Settings, Sheets, TilesSettings,
};

use super::rules::MAP;

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

/// The options of `voxsplat render` that a study varies, with their values; defaults are left out, apart from the
/// painter.
pub(crate) fn options_of(settings: &Settings) -> Vec<String> {
    let mut options = Vec::new();
    let mut tuned = Vec::new();
    let mut add = |name: &str, value: String| options.extend([format!("--{name}"), value]);
    let mut tune = |key: &str, value: String| tuned.push(format!("{key}={value}"));
    let default = Settings::default();
    if settings.model == Model::Composite && settings.shading != default.shading {
        add("shading", settings.shading.to_string());
    }
    if settings.response != default.response {
        add("response", settings.response.to_string());
    }
    if settings.kernel != default.kernel {
        add("kernel", settings.kernel.to_string());
    }
    if settings.sharpness != default.sharpness {
        add("sharpness", settings.sharpness.to_string());
    }
    if let Level::At(level) = settings.level {
        add("level", level.to_string());
    }
    if settings.termination != default.termination {
        tune("termination", settings.termination.to_string());
    }
    if settings.interslice != Interslice::default() {
        tune("interslice", settings.interslice.to_string());
    }
    match settings.painter {
        Painter::Auto => {}
        Painter::Tiles(TilesSettings { resolution }) => {
            add("painter", "tiles".to_owned());
            if resolution != Resolution::default() {
                tune("resolution", resolution.to_string());
            }
        }
        Painter::Quads(quads) => {
            add("painter", "quads".to_owned());
            let default = QuadsSettings::default();
            if quads.sheets != Sheets::default() {
                tune("sheets", quads.sheets.to_string());
            }
            if quads.accumulation != Accumulation::default() {
                tune("accumulate", quads.accumulation.to_string());
            }
            if quads.sheet_thickness != default.sheet_thickness {
                tune("sheet-thickness", quads.sheet_thickness.to_string());
            }
            if let Some(precision) = quads.precision {
                tune("precision", precision.to_string());
            }
            if let Some(error) = quads.table_error {
                tune("table-error", error.to_string());
            }
        }
    }
    if !tuned.is_empty() {
        options.extend(["--tune".to_owned(), tuned.join(",")]);
    }
    if settings.attenuation > 0.0 {
        options.extend(["--attenuation".to_owned(), settings.attenuation.to_string()]);
    }
    if settings.depth_coded {
        options.push("--depth-coded".to_owned());
    }
    options
}

/// A command line of words, those quoted that a shell would take apart.
pub(crate) fn command_line(words: &[String]) -> String {
    let plain = |word: &str| {
        !word.is_empty()
            && word.chars().all(|c| c.is_ascii_alphanumeric() || "-_./:,=+@%#".contains(c))
            && !word.starts_with('#')
    };
    let quoted = |word: &String| if plain(word) { word.clone() } else { format!("'{}'", word.replace('\'', r"'\''")) };
    words.iter().map(quoted).collect::<Vec<_>>().join(" ")
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
