//! Error and time of the splatting renderer against the f64 reference: the tables of ARCHITECTURE.md.
//!
//! `cargo run --release --example accuracy [SIZE [PIXELS]]`: the built-in volumes at SIZE^3 voxels (64) in pictures of
//! PIXELS^2 (128), from three oblique views each, parallel and perspective. Errors are the largest of any pixel.

#![allow(clippy::print_stdout, reason = "printing its tables is what this program is for")]

use std::error::Error;
use std::time::Instant;

use glam::{DAffine3, DMat3, DVec3};
use voxsplat::camera::{Camera, ProjectionKind, View};
use voxsplat::demos::{demo_transfer, demos};
use voxsplat::formats::{LoadOptions, load};
use voxsplat::image::Image;
use voxsplat::kernel::Kernel;
use voxsplat::reference;
use voxsplat::renderer::{Renderer, RendererOptions};
use voxsplat::report::compare;
use voxsplat::settings::{Painter, Precision, Settings};
use voxsplat::transfer::TransferFunction;
use voxsplat::volume::{Grid, Volume};

const VIEWS: [(f64, f64); 3] = [(33.0, 21.0), (118.0, -37.0), (247.0, 52.0)];
const THICKNESSES: [f64; 3] = [0.5, 1.0, 2.0];

/// Largest errors of (alpha, colour).
fn errors(got: &Image, expected: &Image) -> Result<(f64, f64), Box<dyn Error>> {
    let [r, g, b, alpha] = compare(got, expected, 0.0)?.max_channel;
    Ok((alpha, r.max(g).max(b)))
}

/// One row per scene: alpha and colour error at each thickness, over all views.
fn row(
    renderer: &Renderer,
    name: &str,
    volume: &Volume,
    transfer: &TransferFunction,
    settings: &Settings,
) -> Result<(), Box<dyn Error>> {
    let scene = renderer.prepare(volume, transfer, settings, &|_| ())?;
    let truth = reference::Scene::new(volume, transfer, settings)?;
    for projection in [ProjectionKind::Orthographic, ProjectionKind::Perspective { fov: 30.0 }] {
        let mut worst = [[(0.0_f64, 0.0_f64); 3]; 2];
        for (azimuth, elevation) in VIEWS {
            let view = View { azimuth, elevation, projection, ..View::default() };
            let camera = Camera::new(&view, volume.grid(), settings.size)?;
            let expected = truth.render(&camera, settings.size, &|_| ())?;
            for (precision, worst) in [Precision::F16, Precision::F32].into_iter().zip(&mut worst) {
                for (thickness, worst) in THICKNESSES.into_iter().zip(worst) {
                    let settings =
                        Settings { precision: Some(precision), sheet_thickness: thickness, ..settings.clone() };
                    let (alpha, color) = errors(&renderer.render(&scene, &camera, &settings)?.image, &expected)?;
                    *worst = (worst.0.max(alpha), worst.1.max(color));
                }
            }
        }
        let kind = if projection == ProjectionKind::Orthographic { "parallel" } else { "perspective" };
        for (precision, worst) in ["f16", "f32"].into_iter().zip(worst) {
            let [half, one, two] = worst;
            println!(
                "| {name} | {kind} | {precision} | {:.1e} / {:.1e} / {:.1e} | {:.1e} / {:.1e} / {:.1e} |",
                half.0, one.0, two.0, half.1, one.1, two.1
            );
        }
    }
    Ok(())
}

/// Quads per splat and the time of a frame, for each number of sheets that a pass feeds, in alternation.
fn feeding(renderer: &Renderer, settings: &Settings) -> Result<(), Box<dyn Error>> {
    let volume = load("demo:shepp-logan:64", &LoadOptions::default())?;
    let transfer = demo_transfer("shepp-logan").ok_or("no transfer function")?;
    let scene = renderer.prepare(&volume, &transfer, settings, &|_| ())?;
    let (azimuth, elevation) = VIEWS[0];
    let camera = Camera::new(&View { azimuth, elevation, ..View::default() }, volume.grid(), settings.size)?;
    let counts = [1, 2, 4, 8];
    let mut times = [const { Vec::new() }; 4];
    let mut quads = [0.0; 4];
    for _ in 0..5 {
        for (i, &sheets) in counts.iter().enumerate() {
            let settings = Settings { sheets_per_pass: Some(sheets), ..settings.clone() };
            let start = Instant::now();
            quads[i] = renderer.render(&scene, &camera, &settings)?.stats.quads_per_splat;
            times[i].push(start.elapsed().as_secs_f64());
        }
    }
    let median = |times: &mut Vec<f64>| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    };
    let times = times.map(|mut t| median(&mut t));
    println!("\n| sheets per pass | quads per splat | frame, ms | time of one sheet per pass over it |");
    println!("|---|---|---|---|");
    for i in 0..4 {
        println!("| {} | {:.2} | {:.0} | {:.2} |", counts[i], quads[i], times[i] * 1e3, times[0] / times[i]);
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let mut argument = |default: u32| arguments.next().map_or(Ok(default), |a| a.parse());
    let (size, pixels) = (argument(64)?, argument(128)?);
    let renderer = Renderer::new(&RendererOptions::default())?;
    let painter = Painter::Quads;
    let settings = Settings { size: [pixels; 2], painter, termination: 0.0, ..Settings::default() };
    println!("{} ({})\n", renderer.adapter().name, renderer.adapter().driver);
    println!("| volume, {size}^3 | rays | sheets | alpha at 0.5 / 1 / 2 | colour at 0.5 / 1 / 2 |");
    println!("|---|---|---|---|---|");
    for demo in demos() {
        let volume = load(format!("demo:{}:{size}", demo.name), &LoadOptions::default())?;
        let transfer = demo_transfer(demo.name).ok_or("no transfer function")?;
        row(&renderer, demo.name, &volume, &transfer, &settings)?;
    }
    let volume = load(format!("demo:marschner-lobb:{size}"), &LoadOptions::default())?;
    let transfer = demo_transfer("marschner-lobb").ok_or("no transfer function")?;
    let blob = Settings { kernel: Kernel::KAISER_BESSEL, ..settings.clone() };
    row(&renderer, "marschner-lobb, Kaiser-Bessel", &volume, &transfer, &blob)?;
    let grids = [
        ("1:1:4", DMat3::from_diagonal(DVec3::new(1.0, 1.0, 4.0))),
        ("sheared", DMat3::from_cols(DVec3::X, DVec3::new(0.3, 1.0, 0.1), DVec3::new(0.2, -0.4, 1.5))),
    ];
    for (name, matrix) in grids {
        let grid = Grid::new([size; 3], DAffine3::from_mat3(matrix))?;
        row(&renderer, &format!("marschner-lobb, {name}"), &volume.clone().with_grid(grid)?, &transfer, &settings)?;
    }
    feeding(&renderer, &settings)
}
