//! A picture of a volume file, or of a built-in volume, as `voxsplat render` draws it.
//! `cargo run --release --example minimal -- [VOLUME [PICTURE.png]]`

use voxsplat::{Appearance, Background, Engine, Frame, RendererOptions, load};

fn main() -> voxsplat::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let source = arguments.next().unwrap_or_else(|| "demo:vessels:96".to_owned());
    let picture = arguments.next().unwrap_or_else(|| "minimal.png".to_owned());

    let volume = load(&source, &Default::default())?;
    let look = Appearance::for_file(&source, &volume)?;
    let engine = Engine::open(&RendererOptions::default(), &look.settings)?;
    let scene = engine.prepare_layers(&look.layers, &look.settings)?;
    let rendered = engine.render(&scene, &Frame::new(&look.camera([512, 512])?, &look.settings))?;
    rendered.image.save(picture, Background::default())
}
