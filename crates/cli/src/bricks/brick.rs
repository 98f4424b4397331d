//! The command `voxsplat brick`.

use serde::Serialize;
use voxsplat::bricks::{self, Partial};
use voxsplat::engine::Engine;
use voxsplat::formats::load;
use voxsplat::layers::Layers;
use voxsplat::settings::{Painter, RendererOptions};

use super::{check_output, document};
use crate::args::BrickArgs;
use crate::failure::{Failure, refuse};
use crate::job::Maker;
use crate::session::Session;
use crate::stages::Stages;
use crate::{progress, report};

/// The bricks of a partial picture, as JSON.
#[derive(Serialize)]
struct PartialBricks {
    bricks: Vec<usize>,
}

pub(crate) fn run(args: &BrickArgs) -> Result<(), Failure> {
    check_output(&args.output, "exr")?;
    let (plan, mut job, choices) = document::load(&args.plan)?;
    plan.brick(*args.bricks.end())?;
    let output = args.output.canonicalize().ok();
    if output.is_some() && args.bricks.clone().any(|n| document::light(&args.plan, n).canonicalize().ok() == output) {
        return refuse(format!("--output: {}: it is the light that enters the brick", args.output.display()));
    }
    let layers = match plan.transfer() {
        // Samples in one piece of a file stay there, and only slices are read.
        Some(transfer) => {
            job.load.stream_over = 0;
            Layers::of_volume(&load(&job.source, &job.load)?, transfer)
        }
        None => {
            job.maker = Maker::Reference;
            let (mut session, fitted) = Session::open(&job, &mut Stages::default())?;
            session.layers(&job, &fitted, &mut Stages::default())?
        }
    };
    let options =
        RendererOptions { adapter: args.adapter.clone(), progress: progress::reporter(), ..RendererOptions::default() };
    if args.adapter.is_some() && plan.settings().painter == Painter::Cpu {
        return refuse("--adapter: the plan is for the processor: plan with --painter tiles, or leave out --adapter");
    }
    let engine = Engine::open(&options, plan.settings())?;
    let draw = |number: usize| -> Result<Partial, Failure> {
        let slice = layers.part(&plan.brick(number)?.held)?;
        let light = if plan.casts_shadows() { Some(document::load_light(&args.plan, &plan, number)?) } else { None };
        Ok(bricks::brick(&engine, &plan, number, &slice, light.as_ref())?.0)
    };
    let first = draw(*args.bricks.start())?;
    let mut others = args.bricks.clone().skip(1);
    let part = others.try_fold(first, |front, number| Ok::<_, Failure>(front.over(&draw(number)?)?))?;
    part.save(&args.output)?;
    report::print(choices, [&args.output], PartialBricks { bricks: args.bricks.clone().collect() })
}
