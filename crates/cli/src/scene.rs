//! Scene files: the options of a picture by their names, as JSON.
//!
//! A scene becomes the words of a command line and is read by the parser of command lines, so it holds whatever that
//! takes. Paths in a scene are relative to its folder.

use std::ffi::OsString;
use std::path::Path;

use clap::builder::ValueHint;
use clap::{Arg, ArgAction, ArgMatches, Command, FromArgMatches};
use serde_json::{Map, Value};
use voxsplat::error::InputError;
use voxsplat::formats::{is_url, read_json};
use voxsplat::program::MAP;

use super::args::{Args, RenderArgs};
use super::destination::STREAM;
use super::failure::{Failure, refuse};
use super::files::Files;
use super::job::RenderJob;
use super::options::{OptionValues, given};
use super::scene_file::{OF_TRANSFER, SceneFile, VERSION, VOLUME, is_scene};
use super::{args, effects, output, usage};

/// The largest scene file that is read, in bytes.
const MAX_BYTES: u64 = 16 << 20;

/// The key of several pictures.
const OUTPUTS: &str = "outputs";

/// The options, besides the input's, that pictures of one volume and one device share.
const SHARED: [&str; 5] = ["adapter", "reference", "units", "save-scene", "overlay"];
/// The option whose values of a scene and of the command line are joined: later pairs win.
const TUNE: &str = "tune";

/// Returns the pictures of a command line: one, or the pictures of a scene. `job` makes a job of each picture's
/// arguments. The command is `render` or a relative of it, and the words of a scene are options of `render`.
pub(crate) fn jobs(
    args: RenderArgs,
    (own, matches): (&Command, &ArgMatches),
    job: impl Fn(RenderArgs) -> Result<RenderJob, Failure>,
) -> Result<Vec<RenderJob>, Failure> {
    let program = args::built();
    let Some(command) = program.find_subcommand("render") else { return Ok(Vec::new()) };
    if !is_scene(&args.input.source) || args.input.dims.is_some() {
        let notes = effects::noted(own, vec![matches])?;
        let job = with_scene(args, given(command, matches), &job)?;
        notes.iter().for_each(|note| output::say(note));
        return Ok(vec![job]);
    }
    let path = &args.input.source;
    let in_scene = |failure: Failure| {
        let placed = failure.messages.iter().map(|message| format!("{}: {message}", path.display()));
        Failure { messages: placed.collect(), ..failure }
    };
    let no_scene = |error: InputError| match error {
        InputError::Format { path, reason, .. } if reason.starts_with("line ") => {
            Failure::failed(format!("{}: no scene, which is a JSON object: {reason}", path.display()))
        }
        other => other.into(),
    };
    let scene = read_json(path, MAX_BYTES).map_err(no_scene)?;
    let lines = read(path, scene, command, &given(command, matches)).map_err(in_scene)?;
    if lines.len() > 1 && args.save_scene.is_some() {
        return refuse("--save-scene: the scene has several outputs, expected one");
    }
    let mut notes: Vec<String> = Vec::new();
    let mut files = Files::default();
    // The lines include the outputs of the command line.
    files.add_inputs(command, matches);
    let mut parsed = |words: &Vec<OsString>| {
        let failed = |e: clap::Error| Failure { code: 2, messages: usage::messages(&e, words) };
        let whole = args::command().try_get_matches_from(words).map_err(failed)?;
        let of_scene = whole.subcommand_matches("render").unwrap_or(matches);
        files.add(command, of_scene);
        notes.extend(effects::noted(own, vec![of_scene, matches])?);
        let options = given(command, of_scene);
        match Args::from_arg_matches(&whole).map_err(failed)?.command {
            args::Command::Render(mut args) => {
                args.view.in_series = lines.len() > 1;
                with_scene(*args, options, &job)
            }
            _ => refuse("the command is not about a picture"),
        }
    };
    let jobs = lines.iter().map(|words| parsed(words).map_err(in_scene)).collect::<Result<_, Failure>>()?;
    files.check()?;
    let is_new = |at: &usize| !notes[..*at].contains(&notes[*at]);
    (0..notes.len()).filter(is_new).for_each(|at| output::say(&notes[at]));
    Ok(jobs)
}

/// Makes a job together with the scene that it writes.
fn with_scene(
    args: RenderArgs,
    options: Vec<OptionValues>,
    job: &impl Fn(RenderArgs) -> Result<RenderJob, Failure>,
) -> Result<RenderJob, Failure> {
    let scene = args.save_scene.clone().map(|path| SceneFile::new(path, options)).transpose()?;
    if scene.is_some() && args.input.source == Path::new(STREAM) {
        return refuse("--save-scene: standard input cannot be named in a file, expected a file as VOLUME");
    }
    let mut job = job(args)?;
    job.output.scene = scene;
    Ok(job)
}

/// Returns options with others in front: options of the same name, or that do not go with them, give way.
fn overlaid(command: &Command, base: &[OptionValues], over: &[OptionValues]) -> Vec<OptionValues> {
    let gives_way = |name: &str| {
        over.iter().any(|(other, _)| {
            let conflicts =
                args::option(command, other).map(|arg| command.get_arg_conflicts_with(arg)).unwrap_or_default();
            other == name || conflicts.iter().any(|arg| arg.get_long() == Some(name))
        })
    };
    let pairs = base.iter().filter(|(name, _)| name == TUNE).flat_map(|(_, pairs)| pairs);
    let mut all: Vec<OptionValues> = base.iter().filter(|(name, _)| !gives_way(name)).chain(over).cloned().collect();
    if gives_way(TUNE)
        && let Some((_, own)) = all.iter_mut().find(|(name, _)| name == TUNE)
    {
        own.splice(0..0, pairs.cloned());
    }
    all
}

/// Returns the command lines of a scene, with options that replace its own.
fn read(
    path: &Path,
    mut scene: Map<String, Value>,
    command: &Command,
    over: &[OptionValues],
) -> Result<Vec<Vec<OsString>>, Failure> {
    let folder = path.parent().unwrap_or(Path::new(""));
    scene.remove(VERSION);
    let volume = match scene.remove(VOLUME) {
        Some(Value::String(volume)) => found(folder, &volume, true),
        _ => return refuse(format!("{VOLUME:?} is missing: a scene names its volume")),
    };
    let outputs = match scene.remove(OUTPUTS) {
        None => vec![Map::new()],
        Some(Value::Array(outputs)) if !outputs.is_empty() => {
            let object = |output: Value| match output {
                Value::Object(output) => Ok(output),
                _ => refuse(format!("{OUTPUTS:?} has objects, each an output with options of its own")),
            };
            outputs.into_iter().map(object).collect::<Result<_, _>>()?
        }
        Some(_) => return refuse(format!("{OUTPUTS:?}: expected a list of objects")),
    };
    if outputs.len() > 1 && over.iter().any(|(name, _)| name == "output") {
        return refuse(format!("--output: the scene has {} outputs of its own", outputs.len()));
    }
    let options = |map: &Map<String, Value>| -> Result<Vec<OptionValues>, Failure> {
        let options = map.iter().map(|(key, value)| words(command, folder, key, value));
        Ok(options.collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect())
    };
    let base = options(&scene)?;
    let line = |output: &Map<String, Value>| {
        let shared = |name: &str| {
            let of_input = args::option(command, name).is_some_and(|arg| arg.get_help_heading() == Some("Input"));
            of_input || SHARED.contains(&name) || name == VOLUME
        };
        if let Some(name) = output.keys().find(|name| shared(name)) {
            return refuse(format!("{name:?} is for the whole scene, not for one of its outputs"));
        }
        let given = overlaid(command, &overlaid(command, &base, &options(output)?), over);
        let mut line: Vec<OsString> = vec!["voxsplat".into(), "render".into()];
        for (name, values) in given {
            let flag = || OsString::from(format!("--{name}"));
            if values.is_empty() {
                line.push(flag());
            }
            line.extend(values.iter().map(|value| {
                let mut word = flag();
                word.push("=");
                word.push(value);
                word
            }));
        }
        line.extend(["--".into(), volume.clone()]);
        Ok(line)
    };
    outputs.iter().map(line).collect()
}

/// Returns the option that a key of a scene stands for; `None` for a flag that is off.
fn words(command: &Command, folder: &Path, key: &str, value: &Value) -> Result<Option<OptionValues>, Failure> {
    let arg = args::option(command, key);
    let name = arg.and_then(Arg::get_long).unwrap_or(key).to_owned();
    let fault = |expected: &str| Failure::usage(format!("{key:?}: {value}, expected {expected}"));
    let word = |value: &Value| match value {
        Value::String(text) => Ok(text.clone()),
        Value::Number(number) => Ok(number.to_string()),
        _ => Err(fault("texts and numbers")),
    };
    let is_flag = arg.is_some_and(|arg| !arg.get_action().takes_values());
    let texts = match value {
        Value::Bool(on) if is_flag => return Ok(on.then_some((name, Vec::new()))),
        _ if is_flag => return Err(fault("true or false")),
        Value::Object(_) if name == OF_TRANSFER[0] => vec![value.to_string()],
        Value::Array(values) if values.is_empty() => return Err(fault("one value or more")),
        Value::Array(values) => {
            let words = values.iter().map(word).collect::<Result<Vec<_>, _>>()?;
            let repeats = arg.is_some_and(|arg| matches!(arg.get_action(), ArgAction::Append));
            if repeats { words } else { vec![words.join(",")] }
        }
        value => vec![word(value)?],
    };
    let is_path = arg.is_some_and(|arg| arg.get_value_hint() == ValueHint::AnyPath);
    let in_folder = |text: String| match is_path && !value.is_object() {
        // It may be the name of a preset or a colour map.
        true => found(folder, &text, !OF_TRANSFER.contains(&name.as_str())),
        false => text.into(),
    };
    let values = texts.into_iter().map(in_folder).collect();
    Ok(Some((name, values)))
}

/// Returns the path that a text in a scene means. A text that may be a name too is a path if there is such a file.
fn found(folder: &Path, text: &str, is_path: bool) -> OsString {
    if let Some(map) = text.strip_prefix(MAP) {
        let mut value = OsString::from(MAP);
        value.push(found(folder, map, is_path));
        return value;
    }
    let file = folder.join(text.split('#').next().unwrap_or_default());
    let stays = text == STREAM || text.starts_with("demo:") || is_url(Path::new(text));
    if !stays && (is_path || file.is_file()) { folder.join(text).into() } else { text.into() }
}
