//! The two painters side by side: time of a frame and error, for every kind of picture.
//!
//! ```text
//! cargo bench --bench painters -- [--size PIXELS] [--runs N] [--error-size PIXELS] [--write] [VOLUME...]
//! ```
//!
//! For each kind of picture and volume a row of a table: median milliseconds of a frame by `tiles` and by `quads`, in
//! alternation after one frame each, and their ratio; and the errors of both against the f64 reference in a picture of
//! the smaller size. Errors are rms over the four channels of covered pixels, of 255. VOLUME is a file or
//! demo:NAME:SIZE; if none is given, four built-in volumes are measured. `--write` keeps the table in
//! docs/measurements.

#![allow(clippy::print_stdout, reason = "printing its table is what this program is for")]

mod common;

use common::{Arguments, Outcome, Report, median, own_or_suggested, rms_of_255};
use voxsplat::lighting::{Light, Lighting};
use voxsplat::reference::Reference;
use voxsplat::settings::{Model, Painter, QuadsSettings, Shading};
use voxsplat::{
    Camera, Frame, LoadOptions, ProjectionKind, Rendered, Renderer, RendererOptions, Scene, Settings, TransferFunction,
    View, Volume, load,
};

const VOLUMES: [&str; 4] = ["demo:marschner-lobb:64", "demo:shell:128", "demo:vessels:128", "demo:shepp-logan:128"];

struct Options {
    size: u32,
    error_size: u32,
    runs: usize,
    volumes: Vec<String>,
}

fn options(arguments: &mut Arguments) -> Outcome<Options> {
    let mut options = Options {
        size: arguments.option("--size")?.unwrap_or(512),
        error_size: arguments.option("--error-size")?.unwrap_or(128),
        runs: arguments.option("--runs")?.unwrap_or(3),
        volumes: Vec::new(),
    };
    options.volumes = arguments.positional()?.to_vec();
    if options.volumes.is_empty() {
        options.volumes = VOLUMES.map(str::to_owned).to_vec();
    }
    Ok(options)
}

/// The kinds of pictures, and whether they are in perspective.
fn kinds() -> Vec<(&'static str, Settings, bool)> {
    // Without anti-aliasing kernels do not grow at the small size of the reference, so `tiles` does not refuse them.
    let pre = Settings { antialiasing: false, ..Settings::default() };
    let post = Settings { shading: Shading::Post, ..pre.clone() };
    let lit = |settings: &Settings| {
        let lights = vec![Light::HEADLIGHT];
        Settings { lighting: Some(Lighting { lights, ..Lighting::default() }), ..settings.clone() }
    };
    vec![
        ("pre-shaded", pre.clone(), false),
        ("pre-shaded, lit", lit(&pre), false),
        ("pre-shaded, perspective", pre.clone(), true),
        ("X-ray", Settings { model: Model::Xray, ..pre.clone() }, false),
        ("post-shaded", post.clone(), false),
        ("post-shaded, lit", lit(&post), false),
        ("post-shaded, perspective", post, true),
        ("maximum intensity", Settings { model: Model::Mip, ..pre }, false),
    ]
}

fn quads() -> Painter {
    Painter::Quads(QuadsSettings::default())
}

struct Subject<'a> {
    renderer: &'a Renderer,
    scene: Scene,
    volume: &'a Volume,
    transfer: &'a TransferFunction,
    settings: Settings,
    perspective: bool,
}

impl Subject<'_> {
    fn camera(&self, size: u32) -> voxsplat::Result<Camera> {
        let kind = ProjectionKind::Perspective { fov: 30.0 };
        let projection = if self.perspective { kind } else { ProjectionKind::Orthographic };
        let view = View { azimuth: 30.0, elevation: 20.0, projection, ..View::default() };
        Camera::new(&view, self.volume.grid(), [size; 2])
    }

    fn picture(&self, painter: Painter, size: u32) -> voxsplat::Result<Rendered> {
        let settings = Settings { painter, ..self.settings.clone() };
        self.renderer.render(&self.scene, &Frame::new(&self.camera(size)?, &settings))
    }

    fn row(&self, options: &Options) -> voxsplat::Result<String> {
        let mut times = [Vec::new(), Vec::new()];
        for run in 0..=options.runs {
            for (painter, times) in [Painter::Tiles, quads()].into_iter().zip(&mut times) {
                let rendered = self.picture(painter, options.size)?;
                if run > 0 {
                    times.push(rendered.stats.seconds("frame").map_or(f64::NAN, |seconds| seconds * 1e3));
                }
            }
        }
        let [tiles, by_quads] = times.map(median);
        let image = |painter| self.picture(painter, options.error_size).map(|rendered| rendered.image);
        let truth = Reference::new(self.volume, self.transfer, &self.settings)?;
        let truth = truth.render(&self.camera(options.error_size)?)?;
        let tiles_error = rms_of_255(&image(Painter::Tiles)?, &truth)?;
        let quads_error = rms_of_255(&image(quads())?, &truth)?;
        let ratio = by_quads / tiles;
        Ok(format!("{tiles:.0} | {by_quads:.0} | {ratio:.1} | {tiles_error:.3} | {quads_error:.3}"))
    }
}

fn main() -> Outcome {
    let mut arguments = Arguments::of_process();
    let options = options(&mut arguments)?;
    let mut report = Report::new("painters", &arguments);
    let renderer = Renderer::new(&RendererOptions::default())?;
    let Options { size, error_size, runs, .. } = options;
    report.line(format_args!(
        "{size} x {size} pixels, medians of {runs}; errors at {error_size} x {error_size} pixels.\n"
    ));
    report.line("| picture | volume | tiles, ms | quads, ms | ratio | error of tiles | error of quads |");
    report.line("|---|---|---|---|---|---|---|");
    for (name, settings, perspective) in kinds() {
        for source in &options.volumes {
            let volume = load(source, &LoadOptions::default())?;
            let transfer = own_or_suggested(source, &volume)?;
            let scene = renderer.prepare(&volume, &transfer, &settings)?;
            let settings = settings.clone();
            let subject =
                Subject { renderer: &renderer, scene, volume: &volume, transfer: &transfer, settings, perspective };
            report.line(format_args!("| {name} | {source} | {} |", subject.row(&options)?));
        }
    }
    report.finish(renderer.adapter())
}
