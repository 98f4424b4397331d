//! A picture of a volume file, or of a built-in volume.
//! `cargo run --release --example minimal -- [VOLUME [PICTURE.png]]`

use voxsplat::volume::Statistics;
use voxsplat::{Background, Camera, Renderer, RendererOptions, Settings, TransferFunction, View, demos, load};

fn main() -> voxsplat::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let source = arguments.next().unwrap_or_else(|| "demo:vessels:96".to_owned());
    let picture = arguments.next().unwrap_or_else(|| "minimal.png".to_owned());

    let volume = load(&source, &Default::default())?;
    // A built-in volume has a transfer function of its own; for a file the data suggest a preset.
    let transfer = match demos::own_transfer(&source) {
        Some(transfer) => transfer,
        None => TransferFunction::for_volume(&volume, &Statistics::of(&volume)?)?.0,
    };
    let settings = Settings::default();
    let renderer = Renderer::new(&RendererOptions::default())?;
    let scene = renderer.prepare(&volume, &transfer, &settings)?;
    let camera = Camera::new(&View { azimuth: 30.0, elevation: 20.0, ..View::default() }, volume.grid(), [512, 512])?;
    renderer.render(&scene, &camera, &settings)?.image.save(picture, Background::default())
}
