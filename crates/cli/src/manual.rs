//! The commands `voxsplat completions` and `voxsplat man`, made from the definitions of the arguments.

use clap::builder::{PossibleValuesParser, ValueHint};
use clap::{Arg, Command};
use clap_complete::Shell;
use clap_mangen::Man;
use serde::Serialize;
use voxsplat::program::LABELS;
use voxsplat::transfer::presets::PRESETS;
use voxsplat::volume::{Endian, SampleType};

use super::failure::{Failure, refuse};
use super::report::{self, Choices, NO_FILES};
use super::{args, output};

/// The values that shells complete for options that take other values too.
const VALUES: [(&str, &[&str]); 11] = [
    ("axis-order", &["zyx", "xyz"]),
    ("background", &["black", "white", "transparent"]),
    ("clip", &["L", "R", "A", "P", "S", "I", "box:", "voxels:"]),
    ("gradient-opacity", &["off"]),
    ("kernel", &["gaussian", "kaiser-bessel"]),
    ("level", &["auto"]),
    ("light", &["off", "headlight", "studio", "studio:eye"]),
    ("occlusion", &["off"]),
    ("response", &["absorption", "window", "film", "depth"]),
    ("shadows", &["on", "off", "exact"]),
    ("time", &["all"]),
];

/// Returns the values of an option that shells complete; `None`: its parser has them, or there are none.
fn values(arg: &Arg) -> Option<Vec<&'static str>> {
    let name = arg.get_long()?;
    match name {
        "transfer" => Some(PRESETS.iter().map(|preset| preset.name).chain([LABELS]).collect()),
        "type" => Some(SampleType::ALL.map(SampleType::name).to_vec()),
        "endian" => Some(Endian::ALL.map(Endian::name).to_vec()),
        _ => VALUES.iter().find(|(option, _)| *option == name).map(|(_, values)| values.to_vec()),
    }
}

/// The option that takes files too, beside the values that shells complete.
const WITH_FILES: &str = "transfer";

/// The text of a script or a page.
#[derive(Serialize)]
struct ManualText {
    text: String,
}

fn print(text: Vec<u8>) -> Result<(), Failure> {
    if output::is_json() {
        let text = String::from_utf8_lossy(&text).into_owned();
        return report::print(Choices::default(), NO_FILES, ManualText { text });
    }
    output::print_bytes(&text)
}

/// Prints the completions of a shell.
pub(crate) fn completions(shell: Shell) -> Result<(), Failure> {
    let completed = |arg: Arg| match values(&arg) {
        Some(values) => arg.value_parser(PossibleValuesParser::new(values)),
        // Shells complete files for options that they know nothing about.
        None if arg.get_action().takes_values() && arg.get_value_hint() != ValueHint::AnyPath => {
            arg.value_hint(ValueHint::Other)
        }
        None => arg,
    };
    let mut program = args::command().mut_subcommands(|command: Command| command.mut_args(completed));
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut program, "voxsplat", &mut text);
    let text = String::from_utf8_lossy(&text);
    let lines = text.split_inclusive('\n').map(|line| with_files(line, shell));
    print(lines.collect::<String>().into_bytes())
}

/// Returns a line of a script that completes files too if the option takes them. (Bash does so if no value fits.)
fn with_files(line: &str, shell: Shell) -> String {
    match shell {
        Shell::Fish if line.contains(&format!(" -l {WITH_FILES} ")) => line.replace(" -r -f -a ", " -r -F -a "),
        Shell::Zsh if line.starts_with(&format!("'--{WITH_FILES}=")) => {
            let parts = line.rsplit_once(":(").and_then(|(head, tail)| Some((head, tail.split_once(')')?)));
            let with_files = parts.map(|(head, (values, tail))| {
                format!("{head}:{{_alternative \"values:value:({values})\" \"files:file:_files\"}}{tail}")
            });
            with_files.unwrap_or_else(|| line.to_owned())
        }
        _ => line.to_owned(),
    }
}

/// Prints the manual page of the program, or of a command.
pub(crate) fn page(command: Option<&str>) -> Result<(), Failure> {
    let program = args::built();
    let page = match command {
        None => Man::new(program),
        Some(name) => {
            let known: Vec<String> = program.get_subcommands().map(|command| command.get_name().to_owned()).collect();
            let Some(command) = program.find_subcommand(name) else {
                return refuse(format!("man: {name:?}, expected one of {}", known.join(", ")));
            };
            Man::new(command.clone()).title(format!("voxsplat-{name}"))
        }
    };
    let page = page.source(format!("voxsplat {}", env!("CARGO_PKG_VERSION")));
    let mut text = Vec::new();
    page.render(&mut text).map_err(|e| Failure::failed(format!("cannot write the manual page: {e}")))?;
    print(text)
}
