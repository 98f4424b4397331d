//! `voxsplat render`.

use std::path::Path;
use std::time::Instant;

use serde::Serialize;
use voxsplat::camera::Camera;
use voxsplat::image::Image;
use voxsplat::reference::Reference;
use voxsplat::renderer::{Renderer, RendererOptions};
use voxsplat::stats::{Clock, StageTime, Stats};
use voxsplat::transfer::TransferFunction;
use voxsplat::transfer::presets::{self, Suggestion};
use voxsplat::volume::{Statistics, Volume};
use voxsplat::{demos, formats};

use super::args::StatsFormat;
use super::job::{Engine, RenderJob, Transfer};
use super::progress::{self, Progress};
use super::stderr::silenced;
use super::{Failure, output};

/// Host times of the stages, in the order in which they ran.
#[derive(Default)]
pub(super) struct Stages(Vec<StageTime>);

impl Stages {
    fn time<T>(&mut self, name: &'static str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.0.push(StageTime { name, seconds: start.elapsed().as_secs_f64(), clock: Clock::Host });
        result
    }
}

/// Statistics of a picture by the reference.
#[derive(Serialize)]
struct ReferenceStats {
    painter: &'static str,
    size: [u32; 2],
    voxels: u64,
    stages: Vec<StageTime>,
}

pub(super) fn run(job: RenderJob) -> Result<(), Failure> {
    let mut stages = Stages::default();
    let mut opening = Stages::default();
    let progress = Progress::spinner("reading");
    // Opening the driver takes about as long as reading a small volume, so both run at once. The driver is silenced
    // meanwhile, and with it this process: notes are printed afterwards.
    let (read, opened) = std::thread::scope(|scope| {
        let adapter = match &job.engine {
            Engine::Device { adapter } => Some(adapter.clone()),
            Engine::Reference => None,
        };
        let device = adapter.map(|adapter| {
            let opening = &mut opening;
            let open = move || silenced(|| Renderer::new(&RendererOptions { adapter, progress: progress::reporter() }));
            scope.spawn(move || opening.time("device", open))
        });
        let read = || {
            let volume = stages.time("load", || formats::load(&job.source, &job.load))?;
            let (transfer, note) = transfer(&job.source, job.transfer, &volume, &mut stages)?;
            Ok::<_, Failure>((volume, transfer, note))
        };
        (read(), device.map(|thread| thread.join()))
    });
    drop(progress);
    let (volume, transfer, note) = read?;
    if let Some(note) = note {
        output::say(&note);
    }
    stages.0.append(&mut opening.0);
    let camera = Camera::new(&job.view, volume.grid(), job.size)?;
    let save = |image: &Image, stages: &mut Stages| stages.time("encode", || image.save(&job.output, job.background));
    match opened {
        Some(opened) => {
            let renderer = opened.unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
            let scene = renderer.prepare(&volume, &transfer, &job.settings)?;
            let mut rendered = renderer.render(&scene, &camera, &job.settings)?;
            let before = stages.0.len();
            save(&rendered.image, &mut stages)?;
            let after = stages.0.split_off(before);
            rendered.stats.stages.splice(0..0, stages.0);
            rendered.stats.stages.extend(after);
            print_stats(job.stats, &rendered.stats, Stats::to_string)
        }
        None => {
            let image = stages.time("integrate", || {
                Reference::new(&volume, &transfer, &job.settings)?.with_progress(progress::reporter()).render(&camera)
            })?;
            save(&image, &mut stages)?;
            let stats =
                ReferenceStats { painter: "reference", size: job.size, voxels: volume.grid().len(), stages: stages.0 };
            print_stats(job.stats, &stats, |stats| {
                let times: String = stats
                    .stages
                    .iter()
                    .map(|s| format!("{:<12} {:>9.3} ms  (host clock)\n", s.name, s.seconds * 1e3))
                    .collect();
                let [width, height] = stats.size;
                format!("painter      reference (f64)\npicture      {width} x {height} px\n{times}")
            })
        }
    }
}

fn print_stats<S: Serialize>(
    format: Option<StatsFormat>,
    stats: &S,
    table: impl FnOnce(&S) -> String,
) -> Result<(), Failure> {
    match format {
        None => Ok(()),
        Some(StatsFormat::Table) => output::print(&table(stats)),
        Some(StatsFormat::Json) => output::print_json(stats),
    }
}

/// The transfer function of a job, and a note for the user if a preset was suggested.
pub(super) fn transfer(
    source: &Path,
    choice: Transfer,
    volume: &Volume,
    stages: &mut Stages,
) -> Result<(TransferFunction, Option<String>), Failure> {
    let mut statistics = || stages.time("statistics", || Statistics::of(volume));
    match choice {
        Transfer::Given(transfer) => Ok((transfer, None)),
        Transfer::Preset(name) => Ok((presets::preset(name, &statistics()?)?, None)),
        Transfer::Suggested => {
            if let Some(own) = demos::own_transfer(source) {
                return Ok((own, None));
            }
            let (transfer, Suggestion { name, reason }) = TransferFunction::for_volume(volume, &statistics()?)?;
            Ok((transfer, Some(format!("note: --transfer {name} is taken, as {reason}"))))
        }
    }
}
