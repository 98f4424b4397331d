//! Opaque surfaces in a picture: a pearl in the mouth of a shell, and a ring of gold around it.
//!
//!     cargo run --release --example solids -- [FILE.png]
//!
//! `voxsplat render VOLUME --mesh FILE:COLOUR` draws meshes of files.

#![allow(clippy::disallowed_methods, reason = "the last bit of a place shows nowhere")]

use std::f64::consts::TAU;

use voxsplat::glam::DVec3;
use voxsplat::solids::{Mesh, Solid, Solids};
use voxsplat::{Appearance, Background, Frame, Renderer, RendererOptions, demos};

/// A closed surface with a grid of places, given as turns along and around it.
fn surface(place: impl Fn(f64, f64) -> DVec3) -> Mesh {
    const STEPS: u32 = 96;
    let at = |n: u32| f64::from(n) / f64::from(STEPS);
    let vertices = (0..=STEPS).flat_map(|a| (0..=STEPS).map(move |b| (a, b)));
    let mesh =
        Mesh { vertices: vertices.map(|(a, b)| place(at(a), at(b)).as_vec3().to_array()).collect(), ..Mesh::default() };
    let corners = (0..STEPS).flat_map(|a| (0..STEPS).map(move |b| a * (STEPS + 1) + b));
    let triangles = corners.flat_map(|n| [[n, n + 1, n + STEPS + 1], [n + 1, n + STEPS + 2, n + STEPS + 1]]).collect();
    Mesh { triangles, ..mesh }
}

fn main() -> voxsplat::Result<()> {
    let volume = demos::volume("nautilus", 192)?;
    let look = Appearance::for_file("demo:nautilus:192", &volume)?;
    let size = f64::from(volume.grid().dims()[0]) * volume.grid().min_spacing();
    let middle = volume.grid().center() + DVec3::new(0.27, -0.02, -0.14) * size;
    let pearl = surface(|a, b| {
        let (up, turn) = (0.5 * TAU * a, TAU * b);
        middle + 0.085 * size * DVec3::new(up.sin() * turn.cos(), up.sin() * turn.sin(), up.cos())
    });
    let ring = surface(|a, b| {
        let (along, around) = (TAU * a, TAU * b);
        let out = DVec3::new(along.cos(), 0.0, along.sin());
        middle + size * (0.15 * out + 0.018 * (out * around.cos() + DVec3::Y * around.sin()))
    });
    let solids = [Solid { mesh: pearl, color: [0.92, 0.9, 0.88] }, Solid { mesh: ring, color: [0.85, 0.62, 0.15] }];

    let renderer = Renderer::new(&RendererOptions::default())?;
    let scene = renderer.prepare_layers(&look.layers, &look.settings)?;
    let camera = look.camera([600, 450])?;
    let surfaces = Solids::of_meshes(&solids, &camera, look.settings.lighting.as_ref())?;
    let rendered = renderer.render(&scene, &Frame::new(&camera, &look.settings).solids(&surfaces))?;
    let path = std::env::args().nth(1).unwrap_or_else(|| "solids.png".to_owned());
    rendered.image.save(path, Background::default())
}
