//! Compares a picture with the truth, the same model integrated in f64 along the ray of each pixel:
//! `cargo run --release --example truth -- [PIXELS]` prints the differences and writes truth-difference.png.

#![allow(clippy::print_stdout, reason = "the error is the result of the example")]

use voxsplat::image::{compare, difference_picture};
use voxsplat::reference::Reference;
use voxsplat::{Background, Camera, Frame, Renderer, RendererOptions, Settings, View, demos};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let pixels = std::env::args().nth(1).map_or(Ok(128), |a| a.parse())?;
    let volume = demos::volume("shell", 64)?;
    let transfer = demos::demo_transfer("shell").ok_or("no such volume")?;
    let settings = Settings::default();
    let camera = Camera::new(&View { azimuth: 30.0, elevation: 20.0, ..View::default() }, volume.grid(), [pixels; 2])?;

    let renderer = Renderer::new(&RendererOptions::default())?;
    let scene = renderer.prepare(&volume, &transfer, &settings)?;
    let rendered = renderer.render(&scene, &Frame::new(&camera, &settings))?;
    let truth = Reference::new(&volume, &transfer, &settings)?.render(&camera)?;

    let comparison = compare(&rendered.image, &truth, 1.0 / 255.0)?;
    println!("painter {}: {}", rendered.stats.painter.name(), rendered.stats.painter_reason);
    println!("rms over the {} covered pixels: {:.3} of 255", comparison.covered, 255.0 * comparison.rms_covered);
    println!("largest difference: {:.3} of 255", 255.0 * comparison.max);
    difference_picture(&rendered.image, &truth, 500.0)?.save("truth-difference.png", Background::default())?;
    Ok(())
}
