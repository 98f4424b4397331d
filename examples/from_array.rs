//! A volume from samples in memory, with the distances between them, and a transfer function made point by point:
//! `cargo run --release --example from_array`.

use voxsplat::transfer::ControlPoint;
use voxsplat::{Background, Camera, Frame, Renderer, RendererOptions, Settings, TransferFunction, View, Volume};

fn main() -> voxsplat::Result<()> {
    // x runs fastest, then y, then z. Slices are 1.5 mm apart, samples within a slice 0.5 mm: a box of 24 x 24 x 24 mm.
    let (dims, spacing) = ([48, 48, 16], [0.5, 0.5, 1.5]);
    let mut samples: Vec<i16> = Vec::new();
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            for x in 0..dims[0] {
                // Distance in mm from the middle of the box: a ball that fades from 1000 in its centre to 0 at 11 mm.
                let mm = |i: u32, axis: usize| (f64::from(i) - f64::from(dims[axis] - 1) / 2.0) * spacing[axis];
                let distance = (mm(x, 0).powi(2) + mm(y, 1).powi(2) + mm(z, 2).powi(2)).sqrt();
                samples.push((1000.0 * (1.0 - distance / 11.0)).max(0.0) as i16);
            }
        }
    }
    let volume = Volume::from_slice(dims, spacing, &samples)?;

    // A translucent blue skin around an orange core. Opacities are per 1 mm of material.
    let point = |value, color, opacity| ControlPoint { value, color, opacity };
    let (blue, orange) = ([0.2, 0.5, 0.9], [1.0, 0.5, 0.1]);
    let points =
        vec![point(50.0, blue, 0.0), point(150.0, blue, 0.05), point(500.0, orange, 0.1), point(900.0, orange, 0.5)];
    let transfer = TransferFunction::new(points, Some(1.0))?;

    let settings = Settings::default();
    let renderer = Renderer::new(&RendererOptions::default())?;
    let scene = renderer.prepare(&volume, &transfer, &settings)?;
    let camera = Camera::new(&View { azimuth: 30.0, elevation: 20.0, ..View::default() }, volume.grid(), [512, 512])?;
    renderer.render(&scene, &Frame::new(&camera, &settings))?.image.save("from_array.png", Background::Color([1.0; 3]))
}
