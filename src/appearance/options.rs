//! Settings as options of `voxsplat render`, and as notes in the files of pictures.

use crate::image::Note;
use crate::lighting::Lighting;
use crate::settings::{Level, Model, Painter, QuadsSettings, Settings};

/// Returns the options of `voxsplat render` that make settings what they are, with their values: without defaults,
/// apart from the painter. Lights and clips are not among them.
#[must_use]
pub fn options_of(settings: &Settings) -> Vec<String> {
    let default = Settings::default();
    let is_composite = settings.model == Model::Composite;
    let level = |level| match level {
        Level::Auto => "auto".to_owned(),
        Level::At(level) => level.to_string(),
    };
    let painter = |painter: &Painter| match painter {
        Painter::Auto => "auto",
        Painter::Tiles => "tiles",
        Painter::Quads(_) => "quads",
        Painter::Cpu => "cpu",
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
            ("--tune", tuned(s)),
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

/// Returns the pairs of `--tune` that make settings what they are, parted by commas; empty if they are the defaults.
fn tuned(settings: &Settings) -> String {
    let painter = match settings.painter {
        Painter::Auto => Painter::Auto,
        Painter::Tiles => Painter::Tiles,
        Painter::Quads(_) => Painter::Quads(QuadsSettings::default()),
        Painter::Cpu => Painter::Cpu,
    };
    let default = knobs(&Settings { painter, ..Settings::default() });
    let changed = knobs(settings).into_iter().filter(|pair| !default.contains(pair));
    changed.map(|(key, value)| format!("{key}={value}")).collect::<Vec<_>>().join(",")
}

/// Returns all knobs of settings with their values.
fn knobs(settings: &Settings) -> Vec<(&'static str, String)> {
    let mut pairs =
        vec![("termination", settings.termination.to_string()), ("interslice", settings.interslice.to_string())];
    match settings.painter {
        Painter::Auto | Painter::Cpu | Painter::Tiles => {}
        Painter::Quads(quads) => {
            pairs.push(("sheets", quads.sheets.to_string()));
            pairs.push(("accumulate", quads.accumulation.to_string()));
            pairs.push(("sheet-thickness", quads.sheet_thickness.to_string()));
            pairs.extend(quads.precision.map(|precision| ("precision", precision.to_string())));
            pairs.extend(quads.table_error.map(|error| ("table-error", error.to_string())));
        }
    }
    pairs
}

/// Returns a text as one word of a POSIX shell.
#[must_use]
pub fn quoted(text: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "-_./:,=+@%#".contains(c);
    match !text.is_empty() && !text.starts_with('#') && text.chars().all(plain) {
        true => text.to_owned(),
        false => format!("'{}'", text.replace('\'', r"'\''")),
    }
}

/// Returns a command line of words, quoted for a shell.
#[must_use]
pub fn command_line(words: &[String]) -> String {
    words.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" ")
}

/// Returns the notes in the file of a picture: program and settings.
#[must_use]
pub fn notes(settings: &Settings) -> Vec<Note> {
    let software = format!("voxsplat {}", env!("CARGO_PKG_VERSION"));
    let mut options = vec!["--model".to_owned(), settings.model.to_string()];
    options.extend(options_of(settings));
    for plane in settings.clip.planes() {
        let [x, y, z] = plane.normal().to_array();
        options.extend(["--clip".to_owned(), format!("{x},{y},{z},{}", plane.offset())]);
    }
    let light = settings.lighting.as_ref().map_or_else(
        || "none".to_owned(),
        |Lighting { lights, shadows, shadow_bias, occlusion, .. }| {
            let around = occlusion.map_or_else(|| "off".to_owned(), |radius| radius.to_string());
            format!("{}, shadows {shadows}, bias {shadow_bias}, occlusion {around}", lights.len())
        },
    );
    let settings = format!("{}; lights: {light}", command_line(&options));
    vec![Note { name: "Software", text: software }, Note { name: "Settings", text: settings }]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_quoted() {
        let all = ["a b", "it's", "--up", "0,1,0", ""].map(str::to_owned);
        assert_eq!(command_line(&all), r"'a b' 'it'\''s' --up 0,1,0 ''");
    }
}
