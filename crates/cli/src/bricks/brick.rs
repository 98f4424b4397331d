//! `voxsplat brick`.

use voxsplat::bricks;
use voxsplat::formats::load;
use voxsplat::image::check_writable;
use voxsplat::layers::Layers;
use voxsplat::renderer::{Renderer, RendererOptions};

use super::document;
use crate::args::BrickArgs;
use crate::failure::Failure;
use crate::job::Engine;
use crate::progress;
use crate::session::Session;
use crate::stages::Stages;
use crate::stderr::silenced;

pub(crate) fn run(args: &BrickArgs) -> Result<(), Failure> {
    check_writable(&args.output).map_err(|e| Failure::usage(format!("--output: {e:#}")))?;
    let (plan, mut job) = document::load(&args.plan)?;
    let held = plan.brick(args.brick)?.held.clone();
    let slice = match plan.transfer() {
        // Samples in one piece of a file stay there, and only the slice is read.
        Some(transfer) => {
            job.load.stream_over = 0;
            Layers::of_volume(&load(&job.source, &job.load)?.part(held)?, transfer)
        }
        None => {
            job.engine = Engine::Reference;
            let (mut session, fitted) = Session::open(&job, &mut Stages::default())?;
            session.layers(&job, &fitted, &mut Stages::default())?.part(&held)?
        }
    };
    let options = RendererOptions { adapter: args.adapter.clone(), progress: progress::reporter() };
    let renderer = silenced(|| Renderer::new(&options))?;
    let (part, _) = bricks::brick(&renderer, &plan, args.brick, &slice)?;
    Ok(part.save(&args.output)?)
}
