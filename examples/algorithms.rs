//! What docs/algorithms.md states, measured: `cargo run --release --example algorithms [SECTION [FILE...]]`.
//!
//! Sections: thickness (also writes docs/thickness.svg), post, peak, gradients, minification, rim; termination, which needs
//! the scans to measure on. Without a section, all that need no file.

#![allow(clippy::print_stdout, reason = "printing its tables is what this program is for")]

use std::error::Error;
use std::fmt::Write as _;
use std::time::Instant;

use glam::DVec3;
use voxsplat::camera::{Camera, ProjectionKind, View};
use voxsplat::demos::demo_transfer;
use voxsplat::formats::{LoadOptions, load};
use voxsplat::image::Image;
use voxsplat::kernel::Kernel;
use voxsplat::lighting::{Light, Lighting};
use voxsplat::reference;
use voxsplat::renderer::{Rendered, Renderer, RendererOptions};
use voxsplat::report::compare;
use voxsplat::settings::{Accumulation, Interslice, Painter, Settings, Shading};
use voxsplat::transfer::{ControlPoint, TransferFunction, presets};
use voxsplat::volume::{Grid, Samples, Statistics, Volume};

type Outcome<T = ()> = Result<T, Box<dyn Error>>;
/// A section and its name.
type Section = (&'static str, fn(&Renderer) -> Outcome);

/// Nothing that is allowed to change a picture.
fn exact(size: u32) -> Settings {
    Settings { size: [size; 2], painter: Painter::Quads, termination: 0.0, ..Settings::default() }
}

fn demo(name: &str, size: u32) -> Outcome<(Volume, TransferFunction)> {
    let volume = load(format!("demo:{name}:{size}"), &LoadOptions::default())?;
    Ok((volume, demo_transfer(name).ok_or("no transfer function")?))
}

fn render(
    renderer: &Renderer,
    volume: &Volume,
    transfer: &TransferFunction,
    camera: &Camera,
    settings: &Settings,
) -> Outcome<Rendered> {
    let scene = renderer.prepare(volume, transfer, settings, &|_| ())?;
    Ok(renderer.render(&scene, camera, settings)?)
}

fn truth(volume: &Volume, transfer: &TransferFunction, camera: &Camera, settings: &Settings) -> Outcome<Image> {
    Ok(reference::Scene::new(volume, transfer, settings)?.render(camera, settings.size, &|_| ())?)
}

/// Root mean square of the colour channels over the pixels that either picture covers, of 255, and the number of pixels.
fn rms(a: &Image, b: &Image) -> (f64, usize) {
    let covered = |(p, q): &(&[f32; 4], &[f32; 4])| p[3] > 0.0 || q[3] > 0.0;
    let pixels: Vec<_> = a.pixels().iter().zip(b.pixels()).filter(covered).collect();
    let squares = pixels.iter().flat_map(|(p, q)| (0..3).map(|c| f64::from(p[c] - q[c]).powi(2)));
    (255.0 * (squares.sum::<f64>() / (3 * pixels.len()).max(1) as f64).sqrt(), pixels.len())
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Colour error against thickness for both accumulations.
fn thickness(renderer: &Renderer) -> Outcome {
    const THICKNESSES: [f64; 5] = [0.25, 0.5, 1.0, 2.0, 4.0];
    let (volume, transfer) = demo("marschner-lobb", 64)?;
    let settings = exact(128);
    let view = View { azimuth: 33.0, elevation: 21.0, ..View::default() };
    let camera = Camera::new(&view, volume.grid(), settings.size)?;
    let expected = truth(&volume, &transfer, &camera, &settings)?;
    println!("| accumulation | 0.25 | 0.5 | 1 | 2 | 4 |\n|---|---|---|---|---|---|");
    let mut curves = Vec::new();
    for accumulation in [Accumulation::OpticalDepth, Accumulation::Additive] {
        let mut errors = Vec::new();
        for sheet_thickness in THICKNESSES {
            let settings = Settings { accumulation, sheet_thickness, ..settings.clone() };
            let image = render(renderer, &volume, &transfer, &camera, &settings)?.image;
            let [r, g, b, _] = compare(&image, &expected, 0.0)?.max_channel;
            errors.push(r.max(g).max(b));
        }
        let row: Vec<String> = errors.iter().map(|e| format!("{e:.1e}")).collect();
        println!("| {accumulation} | {} |", row.join(" | "));
        curves.push((accumulation.to_string(), THICKNESSES.into_iter().zip(errors).collect::<Vec<_>>()));
    }
    std::fs::write("docs/thickness.svg", plot(&curves)?)?;
    Ok(())
}

/// A logarithmic plot of error over thickness as SVG.
fn plot(curves: &[(String, Vec<(f64, f64)>)]) -> Result<String, std::fmt::Error> {
    let x = |thickness: f64| 90.0 + (thickness / 0.25).log2() / 4.0 * 380.0;
    let y = |error: f64| 30.0 - error.log10() / 5.0 * 300.0;
    let mut svg = String::from(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 500 390\" font-family=\"sans-serif\" font-size=\"13\">\n\
         <rect width=\"500\" height=\"390\" fill=\"white\"/>\n",
    );
    for decade in 0..=5 {
        let at = y(10_f64.powi(-decade));
        writeln!(svg, "<path d=\"M90 {at:.1}H470\" stroke=\"#ddd\"/>")?;
        writeln!(svg, "<text x=\"82\" y=\"{:.1}\" text-anchor=\"end\">1e-{decade}</text>", at + 4.0)?;
    }
    for thickness in [0.25, 0.5, 1.0, 2.0, 4.0] {
        writeln!(svg, "<text x=\"{:.1}\" y=\"350\" text-anchor=\"middle\">{thickness}</text>", x(thickness))?;
    }
    writeln!(svg, "<text x=\"280\" y=\"375\" text-anchor=\"middle\">sheet thickness, voxels</text>")?;
    writeln!(svg, "<text x=\"90\" y=\"18\">largest colour error</text>")?;
    for ((name, points), color) in curves.iter().zip(["#1860b0", "#c04020"]) {
        let line: Vec<String> = points.iter().map(|&(d, e)| format!("{:.1},{:.1}", x(d), y(e))).collect();
        writeln!(svg, "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"2\"/>", line.join(" "))?;
        for &(d, e) in points {
            writeln!(svg, "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"3.5\" fill=\"{color}\"/>", x(d), y(e))?;
        }
        if let Some(&(d, e)) = points.first() {
            writeln!(svg, "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"{color}\">{name}</text>", x(d) + 8.0, y(e) - 8.0)?;
        }
    }
    svg.push_str("</svg>\n");
    Ok(svg)
}

/// Post-shading against its reference, by the parabola and by means.
fn post(renderer: &Renderer) -> Outcome {
    println!("| volume | interslice | rms at 0.25 | 0.5 | 1 | 2 (of 255) |\n|---|---|---|---|---|---|");
    for (name, size) in [("shell", 64), ("marschner-lobb", 64), ("vessels", 64)] {
        let (volume, transfer) = demo(name, size)?;
        let settings = Settings { shading: Shading::Post, ..exact(128) };
        let view = View { azimuth: 33.0, elevation: 21.0, ..View::default() };
        let camera = Camera::new(&view, volume.grid(), settings.size)?;
        let expected = truth(&volume, &transfer, &camera, &settings)?;
        for interslice in [Interslice::Parabola, Interslice::Mean] {
            let mut row = format!("| {name} | {interslice:?} |");
            for sheet_thickness in [0.25, 0.5, 1.0, 2.0] {
                let settings = Settings { interslice, sheet_thickness, ..settings.clone() };
                let image = render(renderer, &volume, &transfer, &camera, &settings)?.image;
                write!(row, " {:.2} |", rms(&image, &expected).0)?;
            }
            println!("{row}");
        }
    }
    Ok(())
}

/// The narrow peak of demo:shell:128 at one sheet per voxel, from the view that ray casters were measured at.
fn peak(renderer: &Renderer) -> Outcome {
    let (volume, transfer) = demo("shell", 128)?;
    let view = View { azimuth: 30.0, elevation: 20.0, up: DVec3::Y, view_height: Some(1.5 * 128.0), ..View::default() };
    let settings = Settings { shading: Shading::Post, ..exact(256) };
    let camera = Camera::new(&view, volume.grid(), settings.size)?;
    let expected = truth(&volume, &transfer, &camera, &settings)?;
    for (shading, interslice, sheet_thickness) in [
        (Shading::Post, Interslice::Parabola, 1.0),
        (Shading::Post, Interslice::Parabola, 0.5),
        (Shading::Post, Interslice::Mean, 1.0),
        (Shading::Post, Interslice::Mean, 0.5),
        (Shading::Pre, Interslice::Mean, 1.0),
    ] {
        let settings = Settings { shading, interslice, sheet_thickness, ..settings.clone() };
        let image = render(renderer, &volume, &transfer, &camera, &settings)?.image;
        let (error, pixels) = rms(&image, &expected);
        println!("| {shading:?} | {interslice:?} | {sheet_thickness} | {error:.2} | over {pixels} pixels");
    }
    Ok(())
}

/// Mean angle in degrees between the normals that light shows and the true ones, over the pixels of an isosurface.
fn angle(
    renderer: &Renderer,
    volume: &Volume,
    field: &dyn Fn(DVec3) -> f64,
    threshold: f64,
    settings: &Settings,
) -> Outcome<(f64, usize)> {
    let point = |value, opacity| ControlPoint { value, color: [1.0; 3], opacity };
    // As sharp a surface as the field is smooth.
    let points = vec![point(threshold - 0.01, 0.0), point(threshold + 0.01, 1.0)];
    let transfer = TransferFunction::new(points, Some(0.25))?;
    let view = View { azimuth: 33.0, elevation: 40.0, ..View::default() };
    let camera = Camera::new(&view, volume.grid(), settings.size)?;
    // Diffuse light from five sides shows the components of the normal.
    let shown = |towards: DVec3| -> Outcome<Image> {
        let lights = vec![Light::Directional(towards)];
        let lighting = Some(Lighting { ambient: 0.0, diffuse: 1.0, specular: 0.0, shininess: 1.0, lights });
        let settings = Settings { lighting, ..settings.clone() };
        Ok(render(renderer, volume, &transfer, &camera, &settings)?.image)
    };
    let sides = [camera.right, -camera.right, camera.up, -camera.up, -camera.forward]
        .map(shown)
        .into_iter()
        .collect::<Outcome<Vec<_>>>()?;
    let half = DVec3::from_array(volume.grid().dims().map(|d| f64::from(d - 1) / 2.0)) - 2.0;
    let gradient = |p: DVec3| {
        let d = |axis: DVec3| field(p + axis * 1e-4) - field(p - axis * 1e-4);
        DVec3::new(d(DVec3::X), d(DVec3::Y), d(DVec3::Z)).normalize()
    };
    let (mut sum, mut count) = (0.0, 0);
    for index in 0..sides[0].pixels().len() {
        let pixel = [index as u32 % settings.size[0], index as u32 / settings.size[0]];
        let (sx, sy) = Camera::image_coordinates(pixel, settings.size);
        let (origin, direction) = camera.ray(sx, sy);
        // The first place inside the volume, some voxels off its faces, where the field passes the threshold.
        let inside = |t: &f64| (origin + direction * *t).abs().cmple(half).all();
        let steps = (-2000..2000).map(|i| f64::from(i) * 0.05).filter(inside);
        let Some(hit) = steps.clone().find(|t| field(origin + direction * *t) > threshold) else { continue };
        // Where the ray enters inside the surface, the surface is not what is seen.
        if steps.clone().next() == Some(hit) || sides[0].pixels()[index][3] < 0.98 {
            continue;
        }
        let mut normal = gradient(origin + direction * hit);
        normal *= -normal.dot(direction).signum();
        let value = |side: usize| f64::from(sides[side].pixels()[index][0]);
        let seen = camera.right * (value(0) - value(1)) + camera.up * (value(2) - value(3)) - camera.forward * value(4);
        // Grazing surfaces are seen together with what is behind them.
        if normal.dot(-direction) > 0.3 && seen.length() > 0.0 {
            sum += seen.normalize().dot(normal).clamp(-1.0, 1.0).acos().to_degrees();
            count += 1;
        }
    }
    Ok((sum / f64::from(count.max(1)), count as usize))
}

fn gradients(renderer: &Renderer) -> Outcome {
    println!("| surface | voxels | kernel | pre-shaded | post-shaded |\n|---|---|---|---|---|");
    for size in [64, 128] {
        gradients_at(renderer, size)?;
    }
    Ok(())
}

fn gradients_at(renderer: &Renderer, size: u32) -> Outcome {
    let middle = f64::from(size - 1) / 2.0;
    let scale = 2.0 / f64::from(size);
    // Marschner and Lobb's signal, as the built-in volume samples it, in voxels from the middle.
    let marschner_lobb = |p: DVec3| {
        let p = p * scale;
        let rho = (12.0 * std::f64::consts::PI * (std::f64::consts::PI * p.x.hypot(p.y) / 2.0).cos()).cos();
        (1.0 - (std::f64::consts::PI * p.z / 2.0).sin() + 0.25 * (1.0 + rho)) / 2.5
    };
    let sphere = |p: DVec3| 0.5 + (0.3 * f64::from(size) - p.length()) / 8.0;
    let fields: [(&str, &dyn Fn(DVec3) -> f64); 2] = [("sphere", &sphere), ("marschner-lobb", &marschner_lobb)];
    for (name, field) in fields {
        let at = |i: u32| f64::from(i) - middle;
        let points = (0..size).flat_map(|z| (0..size).flat_map(move |y| (0..size).map(move |x| [x, y, z])));
        let samples = points.map(|[x, y, z]| field(DVec3::new(at(x), at(y), at(z))) as f32).collect();
        let grid = Grid::new([size; 3], glam::DAffine3::from_translation(DVec3::splat(-middle)))?;
        let volume = Volume::new(grid, Samples::F32(samples))?;
        for (kernel_name, kernel) in [("Gaussian", Kernel::default()), ("Kaiser-Bessel", Kernel::KAISER_BESSEL)] {
            let settings = Settings { kernel, ..exact(5 * size / 2) };
            let (pre, _) = angle(renderer, &volume, field, 0.5, &settings)?;
            let (post, pixels) =
                angle(renderer, &volume, field, 0.5, &Settings { shading: Shading::Post, ..settings })?;
            println!("| {name} | {size}^3 | {kernel_name} | {pre:.2} | {post:.2} | degrees over {pixels} pixels");
        }
    }
    Ok(())
}

/// Early splat termination on scans: what it leaves out, what it changes, what it saves.
fn termination(renderer: &Renderer, files: &[String]) -> Outcome {
    println!("| scan | extinction | termination | hidden | largest change | time of a frame over that without |");
    println!("|---|---|---|---|---|---|");
    for file in files {
        let volume = load(file, &LoadOptions::default())?;
        let statistics = Statistics::of(&volume)?;
        let suggested = presets::preset(presets::suggest(&volume, &statistics).name, &statistics)?;
        for denser in [1, 16] {
            let point = |p: &ControlPoint| ControlPoint { opacity: 1.0 - (1.0 - p.opacity).powi(denser), ..*p };
            let points = suggested.points().iter().map(point).collect();
            let transfer = TransferFunction::new(points, suggested.unit_distance())?;
            let without = exact(384);
            let camera = Camera::new(&View::default(), volume.grid(), without.size)?;
            let scene = renderer.prepare(&volume, &transfer, &without, &|_| ())?;
            let cases = [0.0, 1e-3, 1e-2];
            let mut times = cases.map(|_| Vec::new());
            let mut pictures = Vec::new();
            for round in 0..3 {
                for (case, times) in cases.iter().zip(&mut times) {
                    let settings = Settings { termination: *case, ..without.clone() };
                    let start = Instant::now();
                    let rendered = renderer.render(&scene, &camera, &settings)?;
                    times.push(start.elapsed().as_secs_f64());
                    if round == 0 {
                        pictures.push(rendered);
                    }
                }
            }
            let medians = times.map(median);
            for ((case, rendered), time) in cases.iter().zip(&pictures).zip(medians).skip(1) {
                let hidden = rendered.stats.quads_terminated as f64 / rendered.stats.quads as f64;
                let channels = compare(&rendered.image, &pictures[0].image, 0.0)?.max_channel;
                println!(
                    "| {} | x {denser} | {case} | {:.0} % | {:.1e} | {:.2} |",
                    file.rsplit('/').next().unwrap_or(file),
                    100.0 * hidden,
                    channels.into_iter().fold(0.0, f64::max),
                    time / medians[0]
                );
            }
        }
    }
    Ok(())
}

/// Energy of a zoom series, and the flicker of a small picture.
fn minification(renderer: &Renderer) -> Outcome {
    let (volume, _) = demo("shell", 64)?;
    let point = |value, opacity| ControlPoint { value, color: [1.0; 3], opacity };
    // Thin: alpha is optical depth, and its integral over the picture the mass of the volume.
    let transfer = TransferFunction::new(vec![point(0.1, 0.0), point(1.0, 1e-4)], Some(1.0))?;
    println!(
        "| projection | antialiasing | 1024 | 512 | 256 | 128 | 64 | 32 | 16 |\n|---|---|---|---|---|---|---|---|---|"
    );
    for projection in [ProjectionKind::Orthographic, ProjectionKind::Perspective { fov: 30.0 }] {
        for antialiasing in [true, false] {
            let mut row = String::new();
            let mut first = None;
            for size in [1024, 512, 256, 128, 64, 32, 16] {
                let settings = Settings { antialiasing, ..exact(size) };
                let view = View { azimuth: 33.0, elevation: 21.0, projection, ..View::default() };
                let camera = Camera::new(&view, volume.grid(), settings.size)?;
                let image = render(renderer, &volume, &transfer, &camera, &settings)?.image;
                let energy = image.pixels().iter().map(|p| f64::from(p[3])).sum::<f64>() / f64::from(size).powi(2);
                write!(row, " {:.4} |", energy / *first.get_or_insert(energy))?;
            }
            let kind = if projection == ProjectionKind::Orthographic { "parallel" } else { "perspective" };
            println!("| {kind} | {} |{row}", if antialiasing { "on" } else { "off" });
        }
    }
    let (volume, transfer) = demo("vessels", 256)?;
    println!(
        "\n| antialiasing | change of a picture of 32 x 32 pixels from one frame to the next, moved by 1/8 pixel |\n|---|---|"
    );
    for antialiasing in [true, false] {
        let settings = Settings { antialiasing, ..exact(32) };
        let scene = renderer.prepare(&volume, &transfer, &settings, &|_| ())?;
        let mut sums = Vec::new();
        for step in 0..9 {
            let pixel = 256.0 * 1.04 / 32.0;
            let target = Some(volume.grid().center() + DVec3::new(f64::from(step) / 8.0 * pixel, 0.0, 0.0));
            let view = View { target, view_height: Some(256.0 * 1.04), ..View::default() };
            let camera = Camera::new(&view, volume.grid(), settings.size)?;
            let image = renderer.render(&scene, &camera, &settings)?.image;
            sums.push(image.pixels().iter().map(|p| f64::from(p[3])).sum::<f64>());
        }
        let worst = sums.windows(2).map(|w| (w[1] / w[0] - 1.0).abs()).fold(0.0, f64::max);
        println!("| {} | {:.2} % of all alpha |", if antialiasing { "on" } else { "off" }, 100.0 * worst);
    }
    Ok(())
}

/// Alpha of a uniform box near its faces, over that in the middle.
fn rim(renderer: &Renderer) -> Outcome {
    let grid = Grid::axis_parallel([32; 3], [1.0; 3])?;
    let volume = Volume::new(grid, Samples::U8(vec![100; 32 * 32 * 32]))?;
    let point = |value, opacity| ControlPoint { value, color: [1.0; 3], opacity };
    let points = vec![point(60.0, 0.0), point(100.0, 0.02), point(140.0, 0.04)];
    let transfer = TransferFunction::new(points, Some(1.0))?;
    println!(
        "| shading | kernel | alpha at 0.25 | 0.75 | 1.5 | 2.5 voxels from the face, over that in the middle |\n|---|---|---|---|---|---|"
    );
    for shading in [Shading::Pre, Shading::Post] {
        for (name, kernel) in [("Gaussian", Kernel::default()), ("Kaiser-Bessel", Kernel::KAISER_BESSEL)] {
            let settings = Settings { shading, kernel, ..exact(144) };
            let view = View { view_height: Some(36.0), ..View::default() };
            let camera = Camera::new(&view, volume.grid(), settings.size)?;
            let image = render(renderer, &volume, &transfer, &camera, &settings)?.image;
            // Four pixels to a voxel; the box begins 2 voxels, 8 pixels, from the edge of the picture.
            let row = |voxels: f64| {
                let x = 8 + (voxels * 4.0) as usize;
                (64..80).map(|y| f64::from(image.pixels()[y * 144 + x][3])).sum::<f64>()
            };
            let values = [0.25, 0.75, 1.5, 2.5].map(|v| format!("{:.3}", row(v) / row(16.0)));
            println!("| {shading:?} | {name} | {} |", values.join(" | "));
        }
    }
    Ok(())
}

fn main() -> Outcome {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let renderer = Renderer::new(&RendererOptions::default())?;
    let section = arguments.first().map(String::as_str);
    let sections: [Section; 6] = [
        ("thickness", thickness),
        ("post", post),
        ("peak", peak),
        ("gradients", gradients),
        ("minification", minification),
        ("rim", rim),
    ];
    if section == Some("termination") {
        return termination(&renderer, &arguments[1..]);
    }
    let wanted: Vec<_> = sections.iter().filter(|(name, _)| section.is_none_or(|s| s == *name)).collect();
    if wanted.is_empty() {
        return Err(format!("no section {}", section.unwrap_or_default()).into());
    }
    for (name, run) in wanted {
        println!("\n## {name}\n");
        run(&renderer)?;
    }
    Ok(())
}
