//! Pictures in bricks are the whole picture, at cuts as elsewhere.

use glam::{DAffine3, DMat3, DVec3};
use voxsplat::bricks::{Chunks, Partial, Plan, brick, merge};
use voxsplat::camera::{Camera, ProjectionKind, View};
use voxsplat::clip::{Clip, Plane};
use voxsplat::image::Image;
use voxsplat::layers::{Labels, Layer, Layers};
use voxsplat::settings::{Model, Painter, QuadsSettings, Resolution, Response, Settings, Shading, TilesSettings};
use voxsplat::transfer::TransferFunction;
use voxsplat::volume::{Grid, Samples, Volume};

use crate::support::{PERSPECTIVE, RENDERER, demo, two_lights};

/// Settings without early termination, which ends the rays of each brick on its own.
fn exact() -> Settings {
    Settings { termination: 0.0, ..Settings::default() }
}

fn quads(settings: &Settings) -> Settings {
    Settings { painter: Painter::Quads(QuadsSettings::default()), ..settings.clone() }
}

fn tiles(settings: &Settings) -> Settings {
    Settings { painter: Painter::Tiles(TilesSettings { resolution: Resolution::Full }), ..settings.clone() }
}

/// The same samples on another lattice.
fn on(volume: &Volume, axes: DMat3) -> Volume {
    let grid = Grid::new(volume.grid().dims(), DAffine3::from_mat3_translation(axes, DVec3::new(50.0, -3.0, 7.0)));
    let memory = volume.in_memory().unwrap();
    let samples = (0..volume.grid().len() as usize).map(|i| memory.value(i) as f32).collect();
    Volume::new(grid.unwrap(), Samples::F32(samples)).unwrap()
}

fn sheared(volume: &Volume) -> Volume {
    on(volume, DMat3::from_cols(DVec3::new(1.0, 0.2, 0.0), DVec3::new(0.3, 1.0, 0.1), DVec3::new(0.0, -0.4, 2.5)))
}

/// The parts of a plan, in order.
fn parts(plan: &Plan, layers: &Layers) -> Vec<Partial> {
    let draw = |number: usize| {
        let slice = layers.part(&plan.bricks()[number].held).unwrap();
        brick(&RENDERER, plan, number, &slice).unwrap().0
    };
    (0..plan.bricks().len()).map(draw).collect()
}

/// The whole picture by the settings of a plan.
fn whole(plan: &Plan, layers: &Layers) -> Image {
    let scene = RENDERER.prepare_layers(layers, plan.settings()).unwrap();
    RENDERER.render(&scene, plan.camera(), plan.settings()).unwrap().image
}

/// The merged picture, and the largest difference of a channel from the whole one.
fn apart(layers: &Layers, chunks: &Chunks, camera: &Camera, settings: &Settings) -> f64 {
    let plan = Plan::new(layers, chunks, camera, settings).unwrap();
    let merged = merge(&plan, parts(&plan, layers)).unwrap();
    let whole = whole(&plan, layers);
    let differences = difference(&merged, &whole);
    assert!(whole.pixels().iter().any(|pixel| pixel[3] > 0.05), "the picture is empty");
    differences.into_iter().fold(0.0, f64::max)
}

/// The largest difference of each pixel.
fn difference(a: &Image, b: &Image) -> Vec<f64> {
    let pixel = |(a, b): (&[f32; 4], &[f32; 4])| a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max);
    a.pixels().iter().zip(b.pixels()).map(pixel).collect()
}

fn layers_of(volume: &Volume, transfer: &TransferFunction) -> Layers {
    Layers::of_volume(volume, transfer)
}

fn seen(volume: &Volume, azimuth: f64, elevation: f64, projection: ProjectionKind, size: u32) -> Camera {
    let view = View { azimuth, elevation, projection, ..View::default() };
    Camera::new(&view, volume.grid(), [size; 2]).unwrap()
}

/// The models and shadings.
fn models() -> Vec<(&'static str, Settings)> {
    let base = exact();
    let post = Settings { shading: Shading::Post, ..base.clone() };
    let of = |model| Settings { model, ..base.clone() };
    vec![
        ("pre", base.clone()),
        ("pre lit", Settings { lighting: two_lights(), ..base.clone() }),
        ("post", post.clone()),
        ("post lit", Settings { lighting: two_lights(), ..post.clone() }),
        ("post sharp", Settings { sharpness: 0.7, ..post }),
        ("xray", of(Model::Xray)),
        ("film", Settings { response: Response::FILM, ..of(Model::Xray) }),
        ("mip", of(Model::Mip)),
        ("mip attenuated", Settings { attenuation: 1.5, ..of(Model::Mip) }),
        ("minip", of(Model::Minip)),
        ("average", of(Model::Average)),
    ]
}

#[test]
fn every_model_by_both_painters_is_the_whole() {
    let (volume, transfer) = demo("marschner-lobb", 24);
    let volume = sheared(&volume);
    let chunks = Chunks::new([24; 3], [vec![7, 17], vec![12, 3, 9], vec![10, 14]]).unwrap();
    let layers = layers_of(&volume, &transfer);
    let mut failures = Vec::new();
    for projection in [ProjectionKind::Orthographic, PERSPECTIVE] {
        let camera = seen(&volume, 33.0, 25.0, projection, 40);
        for (name, settings) in models() {
            for (painter, settings) in [("tiles", tiles(&settings)), ("quads", quads(&settings))] {
                let apart = apart(&layers, &chunks, &camera, &settings);
                println!("{projection:?} {name} {painter}: {apart:.1e}");
                if apart > 1e-5 {
                    failures.push(format!("{projection:?} {name} {painter}: {apart:.1e}"));
                }
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}
