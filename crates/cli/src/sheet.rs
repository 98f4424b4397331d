//! The command `voxsplat sheet`: small pictures of the volumes in a folder.

use std::path::{Path, PathBuf};

use clap::{ArgMatches, Command};
use serde::Serialize;
use voxsplat::figure::ContactSheet;
use voxsplat::formats::{is_zarr, volumes_in};
use voxsplat::image::Image;
use voxsplat::settings::Painter;

use super::args::SheetArgs;
use super::destination::Destination;
use super::failure::{Failure, fail, refuse};
use super::job::{Maker, RenderJob};
use super::progress::Remaining;
use super::scene_file::is_scene;
use super::session::Session;
use super::stages::Stages;
use super::{output, scene};

/// The result of a sheet as JSON.
#[derive(Serialize)]
struct SheetReport {
    version: &'static str,
    /// Each volume has choices of its own.
    choices: serde_json::Map<String, serde_json::Value>,
    /// The volumes that were drawn.
    volumes: Vec<PathBuf>,
    /// The volumes that could not be drawn.
    failed: Vec<PathBuf>,
    outputs: Vec<PathBuf>,
}

pub(crate) fn run(args: SheetArgs, line: (&Command, &ArgMatches)) -> Result<(), Failure> {
    let SheetArgs { render: mut args, each } = args;
    let folder = args.input.source.clone();
    let sheet = args.output.take().map(Destination::checked).transpose()?;
    if sheet.is_none() && each.is_none() {
        return refuse("--output FILE.png or --each DIR is missing: the destination of the pictures");
    }
    if is_scene(&folder) {
        return refuse("a sheet is of a folder, not of a scene: give the options of the scene");
    }
    let mut jobs = scene::jobs(args, line, |args| RenderJob::with_output(args, Destination::Stdout))?;
    let Some(mut job) = jobs.pop() else { return Ok(()) };
    job.reduced = true;
    // A device would take longer to open than a small picture to draw.
    if job.settings.painter == Painter::Auto && matches!(job.maker, Maker::Engine { adapter: None }) {
        job.settings.painter = Painter::Cpu;
    }
    let is_folder = folder.is_dir() && !is_zarr(&folder);
    let volumes = if is_folder { volumes_in(&folder)? } else { vec![folder.clone()] };
    if volumes.is_empty() {
        return fail(format!("{}: there is no volume in this folder", folder.display()));
    }
    let has_sheet = sheet.is_some() && is_folder;
    let mut contact = has_sheet.then(|| ContactSheet::new(volumes.len(), job.size)).transpose()?;
    if let Some(each) = &each {
        std::fs::create_dir_all(each)
            .map_err(|e| Failure::failed(format!("--each: the folder {} cannot be made: {e}", each.display())))?;
    }
    let progress = Remaining::new("volumes", volumes.len());
    // Notes on each volume would bury the names of broken ones.
    output::be_quiet();
    let (mut drawn, mut failed, mut outputs, mut alone) = (Vec::new(), Vec::new(), Vec::new(), None);
    for (done, volume) in volumes.iter().enumerate() {
        let name = volume.file_name().unwrap_or(folder.as_os_str()).to_string_lossy();
        progress.at(done, &name);
        match picture(&job, volume) {
            Ok(image) => {
                if let Some(each) = &each {
                    let path = each.join(format!("{name}.png"));
                    image.save(&path, job.output.background)?;
                    outputs.push(path);
                }
                drawn.push(volume.clone());
                match &mut contact {
                    Some(contact) => contact.add(&image, &name)?,
                    None => alone = Some(image),
                }
            }
            Err(failure) if !is_folder => return Err(failure),
            Err(Failure { messages, .. }) => {
                for message in messages {
                    let path = volume.display().to_string();
                    output::complain(&if message.contains(&path) { message } else { format!("{path}: {message}") });
                }
                failed.push(volume.clone());
            }
        }
    }
    drop(progress);
    let whole = contact.filter(|_| !drawn.is_empty()).map(|contact| contact.finish(job.output.background));
    if let (Some(sheet), Some(image)) = (&sheet, whole.transpose()?.or(alone)) {
        sheet.write(&image, None, job.output.background, &[])?;
        outputs.extend(match sheet {
            Destination::File(path) => Some(path.clone()),
            Destination::Stdout => None,
        });
    }
    let (bad, all) = (failed.len(), volumes.len());
    if output::is_json() {
        let (version, choices) = (env!("CARGO_PKG_VERSION"), serde_json::Map::new());
        output::print_json(&SheetReport { version, choices, volumes: drawn, failed, outputs })?;
    }
    if bad > 0 { fail(format!("{bad} of {all} volumes cannot be drawn")) } else { Ok(()) }
}

/// Draws a small picture of a volume.
fn picture(job: &RenderJob, volume: &Path) -> Result<Image, Failure> {
    let mut job = RenderJob { source: volume.to_owned(), ..job.clone() };
    let mut stages = Stages::default();
    let (mut session, fitted) = Session::open(&job, &mut stages)?;
    session.complete(&mut job, &fitted)?;
    let layers = session.layers(&job, &fitted, &mut stages)?;
    Ok(session.picture(&job, &layers, &fitted.transfer, &mut stages)?.image().clone())
}
