//! Turns around a volume: one scene, one picture per step, and the time of each:
//! `cargo run --release --example turntable -- [FRAMES [PIXELS]]` writes turntable_000.png, turntable_001.png, ...

#![allow(clippy::print_stdout, reason = "the time of a picture is part of the example")]

use voxsplat::{Background, Camera, Frame, Renderer, RendererOptions, Settings, View, demos};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let frames: u32 = arguments.next().map_or(Ok(36), |a| a.parse())?;
    let pixels = arguments.next().map_or(Ok(512), |a| a.parse())?;

    let volume = demos::volume("shepp-logan", 64)?;
    let transfer = demos::demo_transfer("shepp-logan").ok_or("no such volume")?;
    let settings = Settings::default();
    let renderer = Renderer::new(&RendererOptions::default())?;
    // The visible voxels go to the device once. Each further picture sends parameters only.
    let scene = renderer.prepare(&volume, &transfer, &settings)?;
    for frame in 0..frames {
        let azimuth = 360.0 * f64::from(frame) / f64::from(frames);
        let view = View { azimuth, elevation: 20.0, ..View::default() };
        let camera = Camera::new(&view, volume.grid(), [pixels; 2])?;
        let rendered = renderer.render(&scene, &Frame::new(&camera, &settings))?;
        rendered.image.save(format!("turntable_{frame:03}.png"), Background::default())?;
        let seconds = rendered.stats.seconds("frame").unwrap_or_default();
        println!("{azimuth:>5.1} degrees: {:.0} ms, {} bytes sent", seconds * 1e3, rendered.stats.bytes_sent);
    }
    Ok(())
}
