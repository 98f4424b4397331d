//! The command `voxsplat plan`.

use std::ffi::OsString;
use std::path::Path;

use clap::{ArgMatches, Command};
use serde::Serialize;
use serde_json::Value;
use voxsplat::bricks::{Chunks, Plan, sweep_light};
use voxsplat::settings::{Level, Painter};

use super::{check_output, document};
use crate::args::PlanArgs;
use crate::failure::{Failure, refuse};
use crate::job::{Maker, RenderJob};
use crate::options::given;
use crate::report::{self, Choices};
use crate::scene_file::is_scene;
use crate::session::Session;
use crate::stages::Stages;
use crate::{output, progress, scene};

/// The options of the command alone.
const OWN: [&str; 4] = ["grid", "output", "json", "quiet"];

/// A plan in numbers.
#[derive(Serialize)]
struct Planned {
    bricks: usize,
    /// A number, or "auto".
    level: Value,
    /// The memory of the largest brick.
    brick_bytes: u64,
}

pub(crate) fn run(args: PlanArgs, line: (&Command, &ArgMatches)) -> Result<(), Failure> {
    let PlanArgs { mut render, grid } = args;
    let Some(path) = render.output.take() else {
        return refuse("--output FILE is missing: the plan to write (see --help)");
    };
    check_output(&path, "json")?;
    if is_scene(&render.input.source) {
        return refuse("a plan is of a volume, not of a scene: give the options of the scene");
    }
    render.input.check_one_time()?;
    // Plans of several views have one size, as films do.
    render.view.in_series = true;
    let jobs = scene::jobs(render, line, |args| RenderJob::with_output(args, document::picture()))?;
    let words = given(line.0, line.1).into_iter().filter(|(name, _)| !OWN.contains(&name.as_str()));
    let mut options = Vec::new();
    for (name, values) in words {
        if values.is_empty() {
            options.push(format!("--{name}"));
        }
        for value in values {
            // Bricks may be drawn from another folder.
            let path = Path::new(&value);
            let value = if path.is_file() { path.canonicalize().map(OsString::from).unwrap_or(value) } else { value };
            let Ok(value) = value.into_string() else {
                return refuse(format!("--{name}: its value is not Unicode, as JSON is"));
            };
            options.push(format!("--{name}={value}"));
        }
    }
    for mut job in jobs {
        // No device is needed.
        job.maker = Maker::Reference;
        let (mut session, fitted) = Session::open(&job, &mut Stages::default())?;
        session.complete(&mut job, &fitted)?;
        let layers = session.layers(&job, &fitted, &mut Stages::default())?;
        let camera = session.camera(&job, &layers, &fitted.transfer, &mut Stages::default())?;
        let mut settings = job.settings.clone();
        if job.choices.open.light {
            let choice;
            (settings, choice) = Plan::settings_for(&settings);
            if let Some(choice) = choice {
                output::say(&format!("note: using {choice} (disable: --light off, with shadows: --light studio)"));
            }
        }
        let chunks = Chunks::even(layers.grid().dims(), grid)?;
        let plan = Plan::new(&layers, layers.grid(), &chunks, &camera, &settings)?;
        let painter = match plan.settings().painter {
            Painter::Cpu => "cpu",
            Painter::Quads(_) => "quads",
            _ => "tiles",
        };
        let choices = Choices::of(&job, plan.settings(), Some(&fitted), Some(painter));
        let (mut paths, mut bytes) = (vec![path.clone()], 0);
        for light in sweep_light(&plan, |held| layers.part(held), &progress::reporter())? {
            let of_brick = document::light(&path, light.brick());
            light.save(&of_brick)?;
            bytes += of_brick.metadata().map_or(0, |file| file.len());
            paths.push(of_brick);
        }
        document::save(&path, &plan, &job.source, options.clone(), &choices)?;
        let bricks = plan.bricks().len();
        let most = plan.bricks().iter().map(|brick| brick.bytes).max().unwrap_or_default();
        let level = match plan.settings().level {
            Level::At(level) => Value::from(level),
            _ => Value::from("auto"),
        };
        if paths.len() > 1 {
            let (first, megabytes) = (document::light(&path, 0), bytes as f64 / 1e6);
            let first = first.display();
            output::say(&format!("swept the light: keep {first} and the others, {megabytes:.0} MB, beside the plan"));
        }
        let (last, megabytes) = (bricks - 1, most as f64 / 1e6);
        let printed = level.as_str().map_or_else(|| level.to_string(), str::to_owned);
        output::say(&format!(
            "planned {bricks} bricks, numbers 0 to {last}, by --painter {painter} at --level {printed}, of up to \
             {megabytes:.0} MB"
        ));
        report::print(choices, &paths, Planned { bricks, level, brick_bytes: most })?;
    }
    Ok(())
}
