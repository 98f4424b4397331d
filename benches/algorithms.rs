//! Measures the figures of docs/algorithms.md.
//!
//! ```text
//! cargo bench --bench algorithms -- [SECTION [FILE...]] [--write]
//! ```
//!
//! Sections: thickness, post, peak, gradients, minification, rim, and termination, which takes the files of the scans
//! to measure. Without a section, it measures all sections that need no file. `--write` keeps the tables in
//! docs/measurements; section thickness then also writes docs/thickness.svg.

#![allow(clippy::disallowed_methods, reason = "measurements allow more than the last bit")]
#![allow(clippy::print_stdout, reason = "printing its tables is what this program is for")]

mod common;

use std::fmt::Write as _;
use std::time::Instant;

use common::{Arguments, Outcome, Report, median, rms_of_255};
use glam::DVec3;
use voxsplat::appearance::suggest;
use voxsplat::demos::{self, demo_transfer};
use voxsplat::image::compare;
use voxsplat::kernel::Kernel;
use voxsplat::lighting::{Light, Lighting};
use voxsplat::reference::Reference;
use voxsplat::settings::{Accumulation, Interslice, Painter, QuadsSettings, Shading};
use voxsplat::transfer::ControlPoint;
use voxsplat::volume::{Samples, Statistics};
use voxsplat::{
    Camera, Frame, Grid, Image, LoadOptions, ProjectionKind, Rendered, Renderer, RendererOptions, Settings,
    TransferFunction, View, Volume, load,
};

/// A section and its name.
type Section = (&'static str, fn(&Renderer, &mut Report) -> Outcome);

/// Settings of quads without early termination.
fn exact(quads: QuadsSettings) -> Settings {
    Settings { painter: Painter::Quads(quads), termination: 0.0, ..Settings::default() }
}

fn exact_of_thickness(sheet_thickness: f64) -> Settings {
    exact(QuadsSettings { sheet_thickness, ..QuadsSettings::default() })
}

fn demo(name: &str, size: u32) -> Outcome<(Volume, TransferFunction)> {
    Ok((demos::volume(name, size)?, demo_transfer(name).ok_or("no transfer function")?))
}

fn render(
    renderer: &Renderer,
    volume: &Volume,
    transfer: &TransferFunction,
    camera: &Camera,
    settings: &Settings,
) -> Outcome<Rendered> {
    let scene = renderer.prepare(volume, transfer, settings)?;
    Ok(renderer.render(&scene, &Frame::new(camera, settings))?)
}

fn truth(volume: &Volume, transfer: &TransferFunction, camera: &Camera, settings: &Settings) -> Outcome<Image> {
    Ok(Reference::new(volume, transfer, settings)?.render(camera)?)
}

/// Colour error against thickness for both accumulations.
fn thickness(renderer: &Renderer, report: &mut Report) -> Outcome {
    const THICKNESSES: [f64; 5] = [0.25, 0.5, 1.0, 2.0, 4.0];
    let (volume, transfer) = demo("marschner-lobb", 64)?;
    let view = View { azimuth: 33.0, elevation: 21.0, ..View::default() };
    let camera = Camera::new(&view, volume.grid(), [128; 2])?;
    let expected = truth(&volume, &transfer, &camera, &exact(QuadsSettings::default()))?;
    report.line("| accumulation | 0.25 | 0.5 | 1 | 2 | 4 |\n|---|---|---|---|---|---|");
    let mut curves = Vec::new();
    for accumulation in [Accumulation::OpticalDepth, Accumulation::Additive] {
        let mut errors = Vec::new();
        for sheet_thickness in THICKNESSES {
            let settings = exact(QuadsSettings { accumulation, sheet_thickness, ..QuadsSettings::default() });
            let image = render(renderer, &volume, &transfer, &camera, &settings)?.image;
            let [r, g, b, _] = compare(&image, &expected, 0.0)?.max_channel;
            errors.push(r.max(g).max(b));
        }
        let row: Vec<String> = errors.iter().map(|e| format!("{e:.1e}")).collect();
        report.line(format_args!("| {accumulation} | {} |", row.join(" | ")));
        curves.push((accumulation.to_string(), THICKNESSES.into_iter().zip(errors).collect::<Vec<_>>()));
    }
    if report.write {
        std::fs::write(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/thickness.svg"), plot(&curves)?)?;
    }
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

/// Post-shading against its reference, with the parabola and with means.
fn post(renderer: &Renderer, report: &mut Report) -> Outcome {
    report.line("| volume | interslice | rms at 0.25 | 0.5 | 1 | 2 (of 255) |\n|---|---|---|---|---|---|");
    for (name, size) in [("shell", 64), ("marschner-lobb", 64), ("vessels", 64)] {
        let (volume, transfer) = demo(name, size)?;
        let settings = Settings { shading: Shading::Post, ..exact_of_thickness(1.0) };
        let view = View { azimuth: 33.0, elevation: 21.0, ..View::default() };
        let camera = Camera::new(&view, volume.grid(), [128; 2])?;
        let expected = truth(&volume, &transfer, &camera, &settings)?;
        for interslice in [Interslice::Parabola, Interslice::Mean] {
            let mut row = format!("| {name} | {interslice} |");
            for sheet_thickness in [0.25, 0.5, 1.0, 2.0] {
                let settings = Settings { interslice, shading: Shading::Post, ..exact_of_thickness(sheet_thickness) };
                let image = render(renderer, &volume, &transfer, &camera, &settings)?.image;
                write!(row, " {:.2} |", rms_of_255(&image, &expected)?)?;
            }
            report.line(row);
        }
    }
    Ok(())
}

/// The narrow peak of demo:shell:128 at one sheet per voxel, from the view of the measured ray casters.
fn peak(renderer: &Renderer, report: &mut Report) -> Outcome {
    let (volume, transfer) = demo("shell", 128)?;
    let view = View { azimuth: 30.0, elevation: 20.0, up: DVec3::Y, view_height: Some(1.5 * 128.0), ..View::default() };
    let settings = Settings { shading: Shading::Post, ..exact_of_thickness(1.0) };
    let camera = Camera::new(&view, volume.grid(), [256; 2])?;
    let expected = truth(&volume, &transfer, &camera, &settings)?;
    report.line("| shading | interslice | thickness | error, of 255 | covered pixels |\n|---|---|---|---|---|");
    for (shading, interslice, sheet_thickness) in [
        (Shading::Post, Interslice::Parabola, 1.0),
        (Shading::Post, Interslice::Parabola, 0.5),
        (Shading::Post, Interslice::Mean, 1.0),
        (Shading::Post, Interslice::Mean, 0.5),
        (Shading::Pre, Interslice::Mean, 1.0),
    ] {
        let settings = Settings { shading, interslice, ..exact_of_thickness(sheet_thickness) };
        let image = render(renderer, &volume, &transfer, &camera, &settings)?.image;
        let error = rms_of_255(&image, &expected)?;
        let pixels = compare(&image, &expected, 0.0)?.covered;
        report.line(format_args!("| {shading} | {interslice} | {sheet_thickness} | {error:.2} | {pixels} |"));
    }
    Ok(())
}

/// Mean angle in degrees between the normals of lit pictures and the true normals, over the pixels of the isosurface at
/// 0.5, in a picture of `size`^2 pixels; and the number of these pixels.
fn angle(
    renderer: &Renderer,
    volume: &Volume,
    field: &dyn Fn(DVec3) -> f64,
    size: u32,
    settings: &Settings,
) -> Outcome<(f64, usize)> {
    let threshold = 0.5;
    let point = |value, opacity| ControlPoint { value, color: [1.0; 3], opacity };
    // A surface as sharp as the smooth field permits.
    let points = vec![point(threshold - 0.01, 0.0), point(threshold + 0.01, 1.0)];
    let transfer = TransferFunction::new(points, Some(0.25))?;
    let view = View { azimuth: 33.0, elevation: 40.0, ..View::default() };
    let camera = Camera::new(&view, volume.grid(), [size; 2])?;
    // Diffuse light from five sides gives the components of the normal.
    let shown = |towards: DVec3| -> Outcome<Image> {
        let lights = vec![Light::directional(towards)];
        let lighting =
            Some(Lighting { ambient: 0.0, diffuse: 1.0, specular: 0.0, shininess: 1.0, lights, ..Lighting::default() });
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
        let (sx, sy) = camera.image_coordinates([index as u32 % size, index as u32 / size]);
        let (origin, direction) = camera.ray(sx, sy);
        // The first place inside the volume, some voxels off its faces, where the field passes the threshold.
        let inside = |t: &f64| (origin + direction * *t).abs().cmple(half).all();
        let steps = (-2000..2000).map(|i| f64::from(i) * 0.05).filter(inside);
        let Some(hit) = steps.clone().find(|t| field(origin + direction * *t) > threshold) else { continue };
        // If the ray enters inside the surface, the surface is not visible.
        if steps.clone().next() == Some(hit) || sides[0].pixels()[index][3] < 0.98 {
            continue;
        }
        let mut normal = gradient(origin + direction * hit);
        normal *= -normal.dot(direction).signum();
        let value = |side: usize| f64::from(sides[side].pixels()[index][0]);
        let seen = camera.right * (value(0) - value(1)) + camera.up * (value(2) - value(3)) - camera.forward * value(4);
        // Grazing surfaces are mixed with the matter behind them.
        if normal.dot(-direction) > 0.3 && seen.length() > 0.0 {
            sum += seen.normalize().dot(normal).clamp(-1.0, 1.0).acos().to_degrees();
            count += 1;
        }
    }
    Ok((sum / f64::from(count.max(1)), count as usize))
}

fn gradients(renderer: &Renderer, report: &mut Report) -> Outcome {
    report
        .line("| surface | voxels | kernel | pre-shaded, degrees | post-shaded | pixels |\n|---|---|---|---|---|---|");
    for size in [64, 128] {
        gradients_at(renderer, report, size)?;
    }
    Ok(())
}

fn gradients_at(renderer: &Renderer, report: &mut Report, size: u32) -> Outcome {
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
            let settings = Settings { kernel, ..exact_of_thickness(1.0) };
            let (pre, _) = angle(renderer, &volume, field, 5 * size / 2, &settings)?;
            let settings = Settings { shading: Shading::Post, ..settings };
            let (post, pixels) = angle(renderer, &volume, field, 5 * size / 2, &settings)?;
            report.line(format_args!("| {name} | {size}^3 | {kernel_name} | {pre:.2} | {post:.2} | {pixels} |"));
        }
    }
    Ok(())
}

/// Early splat termination on scans: skipped splats, changes of the picture and saved time.
fn termination(renderer: &Renderer, report: &mut Report, files: &[String]) -> Outcome {
    report.line("| scan | extinction | termination | hidden | largest change | time of a frame over that without |");
    report.line("|---|---|---|---|---|---|");
    for file in files {
        let volume = load(file, &LoadOptions::default())?;
        let suggested = TransferFunction::preset(suggest(&volume, &Statistics::of(&volume)?).name, &volume)?;
        for denser in [1, 16] {
            let point = |p: &ControlPoint| ControlPoint { opacity: 1.0 - (1.0 - p.opacity).powi(denser), ..*p };
            let points = suggested.points().iter().map(point).collect();
            let transfer = TransferFunction::new(points, suggested.unit_distance())?;
            let without = exact_of_thickness(1.0);
            let camera = Camera::new(&View::default(), volume.grid(), [384; 2])?;
            let scene = renderer.prepare(&volume, &transfer, &without)?;
            let cases = [0.0, 1e-3, 1e-2];
            let mut times = cases.map(|_| Vec::new());
            let mut pictures = Vec::new();
            for round in 0..3 {
                for (case, times) in cases.iter().zip(&mut times) {
                    let settings = Settings { termination: *case, ..without.clone() };
                    let start = Instant::now();
                    let rendered = renderer.render(&scene, &Frame::new(&camera, &settings))?;
                    times.push(start.elapsed().as_secs_f64());
                    if round == 0 {
                        pictures.push(rendered);
                    }
                }
            }
            let medians = times.map(median);
            for ((case, rendered), time) in cases.iter().zip(&pictures).zip(medians).skip(1) {
                let quads = rendered.stats.quads().ok_or("another painter")?;
                let hidden = quads.quads_terminated as f64 / quads.quads as f64;
                let channels = compare(&rendered.image, &pictures[0].image, 0.0)?.max_channel;
                report.line(format_args!(
                    "| {} | x {denser} | {case} | {:.0} % | {:.1e} | {:.2} |",
                    file.rsplit('/').next().unwrap_or(file),
                    100.0 * hidden,
                    channels.into_iter().fold(0.0, f64::max),
                    time / medians[0]
                ));
            }
        }
    }
    Ok(())
}

/// Energy of a zoom series, and the flicker of a small picture.
fn minification(renderer: &Renderer, report: &mut Report) -> Outcome {
    let (volume, _) = demo("shell", 64)?;
    let point = |value, opacity| ControlPoint { value, color: [1.0; 3], opacity };
    // So thin that alpha is optical depth, and its integral over the picture the mass of the volume.
    let transfer = TransferFunction::new(vec![point(0.1, 0.0), point(1.0, 1e-4)], Some(1.0))?;
    report.line(
        "| projection | antialiasing | 1024 | 512 | 256 | 128 | 64 | 32 | 16 |\n|---|---|---|---|---|---|---|---|---|",
    );
    for projection in [ProjectionKind::Orthographic, ProjectionKind::Perspective { fov: 30.0 }] {
        for antialiasing in [true, false] {
            let mut row = String::new();
            let mut first = None;
            for size in [1024, 512, 256, 128, 64, 32, 16] {
                let settings = Settings { antialiasing, ..exact_of_thickness(1.0) };
                let view = View { azimuth: 33.0, elevation: 21.0, projection, ..View::default() };
                let camera = Camera::new(&view, volume.grid(), [size; 2])?;
                let image = render(renderer, &volume, &transfer, &camera, &settings)?.image;
                let energy = image.pixels().iter().map(|p| f64::from(p[3])).sum::<f64>() / f64::from(size).powi(2);
                write!(row, " {:.4} |", energy / *first.get_or_insert(energy))?;
            }
            let kind = if projection == ProjectionKind::Orthographic { "parallel" } else { "perspective" };
            report.line(format_args!("| {kind} | {} |{row}", if antialiasing { "on" } else { "off" }));
        }
    }
    let (volume, transfer) = demo("vessels", 256)?;
    report.line("\n32 x 32 pixels, moved by 1/8 pixel from one frame to the next:\n");
    report.line("| antialiasing | largest change of the sum of alpha |\n|---|---|");
    for antialiasing in [true, false] {
        let settings = Settings { antialiasing, ..exact_of_thickness(1.0) };
        let scene = renderer.prepare(&volume, &transfer, &settings)?;
        let mut sums = Vec::new();
        for step in 0..9 {
            let pixel = 256.0 * 1.04 / 32.0;
            let target = Some(volume.grid().center() + DVec3::new(f64::from(step) / 8.0 * pixel, 0.0, 0.0));
            let view = View { target, view_height: Some(256.0 * 1.04), ..View::default() };
            let camera = Camera::new(&view, volume.grid(), [32; 2])?;
            let image = renderer.render(&scene, &Frame::new(&camera, &settings))?.image;
            sums.push(image.pixels().iter().map(|p| f64::from(p[3])).sum::<f64>());
        }
        let worst = sums.windows(2).map(|w| (w[1] / w[0] - 1.0).abs()).fold(0.0, f64::max);
        report.line(format_args!("| {} | {:.2} % |", if antialiasing { "on" } else { "off" }, 100.0 * worst));
    }
    Ok(())
}

/// Alpha of a uniform box near its faces, over the alpha in the middle.
fn rim(renderer: &Renderer, report: &mut Report) -> Outcome {
    let grid = Grid::axis_parallel([32; 3], [1.0; 3])?;
    let volume = Volume::new(grid, Samples::U8(vec![100; 32 * 32 * 32]))?;
    let point = |value, opacity| ControlPoint { value, color: [1.0; 3], opacity };
    let points = vec![point(60.0, 0.0), point(100.0, 0.02), point(140.0, 0.04)];
    let transfer = TransferFunction::new(points, Some(1.0))?;
    report
        .line("| shading | kernel | alpha at 0.25 | 0.75 | 1.5 | 2.5 voxels from the face, over that in the middle |");
    report.line("|---|---|---|---|---|---|");
    for shading in [Shading::Pre, Shading::Post] {
        for (name, kernel) in [("Gaussian", Kernel::default()), ("Kaiser-Bessel", Kernel::KAISER_BESSEL)] {
            let settings = Settings { shading, kernel, ..exact_of_thickness(1.0) };
            let view = View { view_height: Some(36.0), ..View::default() };
            let camera = Camera::new(&view, volume.grid(), [144; 2])?;
            let image = render(renderer, &volume, &transfer, &camera, &settings)?.image;
            // Four pixels per voxel; the box begins 2 voxels, 8 pixels, from the edge of the picture.
            let row = |voxels: f64| {
                let x = 8 + (voxels * 4.0) as usize;
                (64..80).map(|y| f64::from(image.pixels()[y * 144 + x][3])).sum::<f64>()
            };
            let values = [0.25, 0.75, 1.5, 2.5].map(|v| format!("{:.3}", row(v) / row(16.0)));
            report.line(format_args!("| {shading} | {name} | {} |", values.join(" | ")));
        }
    }
    Ok(())
}

fn main() -> Outcome {
    let arguments = Arguments::of_process();
    let mut report = Report::new("algorithms", &arguments);
    let renderer = Renderer::new(&RendererOptions::default())?;
    let positional = arguments.positional()?;
    let section = positional.first().map(String::as_str);
    let sections: [Section; 6] = [
        ("thickness", thickness),
        ("post", post),
        ("peak", peak),
        ("gradients", gradients),
        ("minification", minification),
        ("rim", rim),
    ];
    if section == Some("termination") {
        termination(&renderer, &mut report, &positional[1..])?;
        return report.finish(renderer.adapter());
    }
    let wanted: Vec<_> = sections.iter().filter(|(name, _)| section.is_none_or(|s| s == *name)).collect();
    if wanted.is_empty() {
        return Err(format!("no section {}", section.unwrap_or_default()).into());
    }
    for (name, run) in wanted {
        report.line(format_args!("\n## {name}\n"));
        run(&renderer, &mut report)?;
    }
    report.finish(renderer.adapter())
}
