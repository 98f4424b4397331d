//! The file of a plan: the library's plan, the volume, and the options that its layers need.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use clap::FromArgMatches;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use serde_json::value::RawValue;
use voxsplat::bricks::{IncomingLight, Plan};
use voxsplat::formats::without_credentials;
use voxsplat::image::write_file;
use voxsplat_volume::files::{fault, read_text};

use crate::args::{self, Args};
use crate::destination::Destination;
use crate::failure::{Failure, fail};
use crate::job::RenderJob;
use crate::report::Choices;

/// The largest plan that is read, in bytes.
const MAX_BYTES: u64 = 256 << 20;

/// The document in the file of a plan.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlanDocument {
    /// The version of the program that wrote the plan.
    voxsplat: String,
    /// The path of the volume from the root, or the name of a built-in volume.
    volume: String,
    /// The options of `voxsplat render` that the layers need.
    options: Vec<String>,
    /// The look of the picture: see [`report`](crate::report).
    #[serde(default)]
    choices: Value,
    plan: Box<RawValue>,
}

/// Writes a plan. The file appears whole or not at all.
pub(super) fn save(
    path: &Path,
    plan: &Plan,
    volume: &Path,
    options: Vec<String>,
    choices: &Choices,
) -> Result<(), Failure> {
    let volume = match volume.canonicalize() {
        Ok(path) => path,
        Err(_) => volume.to_owned(),
    };
    let Some(volume) = volume.to_str() else {
        return fail(format!("{}: its name is not Unicode, as JSON is", volume.display()));
    };
    let failed = |e: serde_json::Error| Failure::failed(format!("{}: {e}", path.display()));
    let document = PlanDocument {
        voxsplat: env!("CARGO_PKG_VERSION").to_owned(),
        volume: volume.to_owned(),
        options,
        choices: serde_json::to_value(choices).map_err(failed)?,
        plan: RawValue::from_string(plan.to_json()?.trim_end().to_owned()).map_err(failed)?,
    };
    let text = serde_json::to_string_pretty(&document).map_err(failed)?;
    // Passwords and tokens are no part of a plan.
    Ok(write_file(path, (without_credentials(&text).into_owned() + "\n").as_bytes())?)
}

/// Returns the path of the light that enters a brick of the plan in a file: beside it, `plan.light-3.exr`.
pub(super) fn light(plan: &Path, brick: usize) -> PathBuf {
    plan.with_extension(format!("light-{brick}.exr"))
}

/// Loads the light that enters a brick of a plan.
pub(super) fn load_light(path: &Path, plan: &Plan, brick: usize) -> Result<IncomingLight, Failure> {
    let light = light(path, brick);
    if !light.exists() {
        return fail(format!("{}: missing: voxsplat plan wrote it beside the plan, copy it there", light.display()));
    }
    Ok(IncomingLight::load(light, plan, brick)?)
}

/// Reads a plan, the job of its whole picture, and the choices in it.
pub(super) fn load(path: &Path) -> Result<(Plan, RenderJob, Value), Failure> {
    let text = read_text(path, MAX_BYTES)?;
    let no_plan = |reason: String| Failure::failed(format!("{}: no plan: {reason}", path.display()));
    let PlanDocument { volume, options, choices, plan, .. } = serde_json::from_str(&text)
        .map_err(|e| no_plan(format!("line {} column {}: {}", e.line(), e.column(), fault(&e))))?;
    let plan = Plan::from_json(plan.get()).map_err(|e| no_plan(e.to_string()))?;
    let mut words: Vec<OsString> = ["voxsplat", "render"].map(OsString::from).to_vec();
    words.extend(options.into_iter().map(OsString::from));
    words.extend(["--".into(), volume.into()]);
    let parsed = args::command().try_get_matches_from(&words).and_then(|matches| Args::from_arg_matches(&matches));
    match parsed.map(|args| args.command) {
        Ok(args::Command::Render(args)) => Ok((plan, RenderJob::with_output(*args, picture())?, choices)),
        Ok(_) => Err(no_plan("its options are not about a picture".to_owned())),
        Err(error) => Err(no_plan(error.to_string().lines().next().unwrap_or_default().to_owned())),
    }
}

/// Returns the destination of the whole picture, which `merge` decides: one that keeps every value.
pub(super) fn picture() -> Destination {
    Destination::File(PathBuf::from("merged.exr"))
}
