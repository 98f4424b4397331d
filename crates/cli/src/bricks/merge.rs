//! The command `voxsplat merge`.

use serde::Serialize;
use voxsplat::bricks::{Partial, merge};
use voxsplat::image::Note;
use voxsplat::settings::Response;

use super::document;
use crate::args::MergeArgs;
use crate::destination::Destination;
use crate::draw::notes;
use crate::failure::{Failure, refuse};
use crate::report;

/// The number of merged bricks, as JSON.
#[derive(Serialize)]
struct MergedBricks {
    bricks: usize,
}

pub(crate) fn run(args: &MergeArgs) -> Result<(), Failure> {
    let output = Destination::checked(args.output.clone())?;
    let (plan, job, choices) = document::load(&args.plan)?;
    if plan.settings().response == Response::Depth && !output.keeps_values() {
        return refuse("--response depth is for an .exr: a .png holds 0 to 1, window shows it");
    }
    let parts = args.parts.iter().map(|path| Partial::load(path, &plan)).collect::<Result<Vec<_>, _>>()?;
    let mut notes = notes(plan.settings(), &job.figure.drawn, None);
    notes.push(Note { name: "Bricks", text: plan.bricks().len().to_string() });
    output.write(&merge(&plan, parts)?, None, args.background, &notes)?;
    report::print(choices, [&args.output], MergedBricks { bricks: plan.bricks().len() })
}
