//! A lit surface, classified and lit per pixel (post-shading): `cargo run --release --example light -- [PIXELS]`.

use voxsplat::kernel::Kernel;
use voxsplat::lighting::{Light, Lighting};
use voxsplat::settings::Shading;
use voxsplat::transfer::ControlPoint;
use voxsplat::{
    Background, Camera, Frame, Renderer, RendererOptions, Settings, TransferFunction, View, demos, glam::DVec3,
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let pixels = std::env::args().nth(1).map_or(Ok(512), |a| a.parse())?;
    let volume = demos::volume("marschner-lobb", 64)?;
    // An opaque surface where the scalar passes 0.5.
    let point = |value, opacity| ControlPoint { value, color: [0.9, 0.7, 0.5], opacity };
    let transfer = TransferFunction::new(vec![point(0.45, 0.0), point(0.55, 0.9)], None)?;
    let lighting = Lighting {
        lights: vec![Light::HEADLIGHT, Light::directional(DVec3::new(-1.0, -1.0, 2.0))],
        diffuse: 0.5,
        ..Lighting::default()
    };
    let settings = Settings {
        shading: Shading::Post,
        lighting: Some(lighting),
        // The default Gaussian has ripples of 14 % that light makes visible; this kernel has ripples of 0.05 %.
        kernel: Kernel::KAISER_BESSEL,
        ..Settings::default()
    };
    let renderer = Renderer::new(&RendererOptions::default())?;
    let scene = renderer.prepare(&volume, &transfer, &settings)?;
    let view = View { azimuth: 30.0, elevation: 45.0, ..View::default() };
    let camera = Camera::new(&view, volume.grid(), [pixels; 2])?;
    renderer.render(&scene, &Frame::new(&camera, &settings))?.image.save("light.png", Background::default())?;
    Ok(())
}
