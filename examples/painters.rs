//! The two painters side by side: time of a frame and error, for every kind of picture that both draw.
//!
//! ```text
//! cargo run --release --example painters [--size PIXELS] [--runs N] [--error-size PIXELS] [VOLUME...]
//! ```
//!
//! For each kind of picture and volume a row of a table: median milliseconds of a frame by `tiles` and by `quads`, in
//! alternation after one frame each, and their ratio; the difference of `tiles` from a ray through every pixel; and the errors
//! of both against the f64 reference in a picture of the smaller size, where each pixel has its ray. Differences and errors
//! are rms over the colours of covered pixels, of 255. VOLUME is demo:NAME:SIZE, four of them where none is given.

#![allow(clippy::print_stdout, reason = "printing its table is what this program is for")]

use std::error::Error;

use voxsplat::camera::{Camera, ProjectionKind, View};
use voxsplat::demos::demo_transfer;
use voxsplat::formats::{LoadOptions, load};
use voxsplat::image::Image;
use voxsplat::lighting::{Light, Lighting};
use voxsplat::reference;
use voxsplat::renderer::{Rendered, Renderer, RendererOptions, Scene};
use voxsplat::settings::{Model, Painter, Resolution, Settings, Shading};
use voxsplat::transfer::TransferFunction;
use voxsplat::volume::Volume;

const VOLUMES: [&str; 4] = ["demo:marschner-lobb:64", "demo:shell:128", "demo:vessels:128", "demo:shepp-logan:128"];

struct Options {
    size: u32,
    error_size: u32,
    runs: usize,
    volumes: Vec<String>,
}

fn options() -> Result<Options, Box<dyn Error>> {
    let mut options = Options { size: 512, error_size: 128, runs: 3, volumes: Vec::new() };
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or(format!("{argument} takes a value"));
        match argument.as_str() {
            "--size" => options.size = value()?.parse()?,
            "--error-size" => options.error_size = value()?.parse()?,
            "--runs" => options.runs = value()?.parse()?,
            _ => options.volumes.push(argument),
        }
    }
    if options.volumes.is_empty() {
        options.volumes = VOLUMES.map(str::to_owned).to_vec();
    }
    Ok(options)
}

/// The kinds of pictures, and whether their rays go through one eye.
fn kinds() -> Vec<(&'static str, Settings, bool)> {
    // Voxels smaller than pixels are left to `quads`: for the reference's size, their kernels do not grow.
    let pre = Settings { antialiasing: false, ..Settings::default() };
    let post = Settings { shading: Shading::Post, ..pre.clone() };
    let lit = |settings: &Settings| {
        let lights = vec![Light::Headlight];
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

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Root mean square over the colours of covered pixels, of 255.
fn difference(a: &Image, b: &Image) -> f64 {
    let covered = |p: &[f32; 4]| p[..3].iter().any(|&c| c > 1.0 / 255.0);
    let pairs = a.pixels().iter().zip(b.pixels()).filter(|(p, q)| covered(p) || covered(q));
    let (mut sum, mut count) = (0.0, 0.0);
    for (p, q) in pairs {
        sum += p[..3].iter().zip(&q[..3]).map(|(p, q)| f64::from(p - q).powi(2)).sum::<f64>();
        count += 3.0;
    }
    255.0 * (sum / f64::max(count, 1.0)).sqrt()
}

/// Milliseconds of a frame.
fn frame(rendered: &Rendered) -> f64 {
    rendered.stats.stages.iter().find(|s| s.name == "frame").map_or(f64::NAN, |s| s.seconds * 1e3)
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
    fn camera(&self, size: u32) -> voxsplat::error::Result<Camera> {
        let kind = ProjectionKind::Perspective { fov: 30.0 };
        let projection = if self.perspective { kind } else { ProjectionKind::Orthographic };
        let view = View { azimuth: 30.0, elevation: 20.0, projection, ..View::default() };
        Camera::new(&view, self.volume.grid(), [size; 2])
    }

    fn picture(&self, painter: Painter, resolution: Resolution, size: u32) -> voxsplat::error::Result<Rendered> {
        let settings = Settings { painter, resolution, size: [size; 2], ..self.settings.clone() };
        self.renderer.render(&self.scene, &self.camera(size)?, &settings)
    }

    fn row(&self, options: &Options) -> voxsplat::error::Result<String> {
        let mut times = [Vec::new(), Vec::new()];
        let painters = [Painter::Tiles, Painter::Quads];
        for run in 0..=options.runs {
            for (painter, times) in painters.into_iter().zip(&mut times) {
                let rendered = self.picture(painter, Resolution::Capped, options.size)?;
                if run > 0 {
                    times.push(frame(&rendered));
                }
            }
        }
        let [tiles, quads] = times.map(median);
        let whole = self.picture(Painter::Tiles, Resolution::Full, options.size)?.image;
        let capped = difference(&self.picture(Painter::Tiles, Resolution::Capped, options.size)?.image, &whole);
        let settings = Settings { size: [options.error_size; 2], ..self.settings.clone() };
        let truth = reference::Scene::new(self.volume, self.transfer, &settings)?.render(
            &self.camera(options.error_size)?,
            settings.size,
            &|_| (),
        )?;
        let mut errors = [0.0; 2];
        for (error, painter) in errors.iter_mut().zip(painters) {
            *error = difference(&self.picture(painter, Resolution::Full, options.error_size)?.image, &truth);
        }
        let [tiles_error, quads_error] = errors;
        let ratio = quads / tiles;
        Ok(format!("{tiles:.0} | {quads:.0} | {ratio:.1} | {capped:.3} | {tiles_error:.3} | {quads_error:.3}"))
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let options = options()?;
    let renderer = Renderer::new(&RendererOptions::default())?;
    let adapter = renderer.adapter();
    println!("{}, {1} x {1} pixels, medians of {2}", adapter.name, options.size, options.runs);
    println!("| picture | volume | tiles, ms | quads, ms | ratio | capped | error of tiles | error of quads |");
    println!("|---|---|---|---|---|---|---|---|");
    for (name, settings, perspective) in kinds() {
        for source in &options.volumes {
            let volume = load(source, &LoadOptions::default())?;
            let transfer = source.strip_prefix("demo:").and_then(demo_transfer).ok_or("VOLUME is demo:NAME:SIZE")?;
            let scene = renderer.prepare(&volume, &transfer, &settings, &|_| ())?;
            let settings = settings.clone();
            let subject =
                Subject { renderer: &renderer, scene, volume: &volume, transfer: &transfer, settings, perspective };
            println!("| {name} | {source} | {} |", subject.row(&options)?);
        }
    }
    Ok(())
}
