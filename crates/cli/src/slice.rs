//! The command `voxsplat slice`: a figure of sections beside a picture.

use clap::{ArgMatches, Command};
use voxsplat::figure::{Figure, Slices};
use voxsplat::program::PlaneSpec;

use super::args::SliceArgs;
use super::failure::{Failure, refuse};
use super::job::RenderJob;
use super::scene;
use super::sections::Sections;

/// Returns the picture of a command line, with its sections.
pub(crate) fn jobs(args: SliceArgs, line: (&Command, &ArgMatches)) -> Result<Vec<RenderJob>, Failure> {
    let SliceArgs { render: args, at, planes } = args;
    let planes: Vec<PlaneSpec> = planes.into_iter().flat_map(|planes| planes.0).collect();
    let jobs = scene::jobs(args, line, |mut args| {
        let (size, title, caption) = (args.size, args.figure.title.take(), args.figure.caption.take());
        let texts = Figure { title, caption, ..Figure::default() };
        let panels = Slices::panels(size, planes.len(), &texts)?;
        args.size = panels.last().map_or(size, |panel| [panel.width, panel.height]);
        let sections = Some(Sections { planes: planes.clone(), at, size, texts });
        Ok(RenderJob { sections, ..RenderJob::new(args)? })
    })?;
    match jobs.len() {
        1 => Ok(jobs),
        count => refuse(format!("the scene has {count} outputs, expected one")),
    }
}
