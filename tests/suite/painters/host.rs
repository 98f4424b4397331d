//! The host engine against the reference, and the sameness of its bytes.

use voxsplat::camera::{ProjectionKind, View};
use voxsplat::clip::{Clip, Plane};
use voxsplat::host::HostRenderer;
use voxsplat::image::{Image, Region};
use voxsplat::kernel::Kernel;
use voxsplat::layers::Layers;
use voxsplat::lighting::{Light, Lighting};
use voxsplat::progress::Progress;
use voxsplat::reference::Reference;
use voxsplat::settings::{Model, Painter, Settings, Shading};
use voxsplat::transfer::{GradientPoint, TransferFunction};
use voxsplat::volume::Volume;
use voxsplat::{Camera, Renderer};

use glam::DVec3;

use crate::support::{PROJECTIONS, camera, demo, headlight, look, renderer, transfer, two_lights};

/// Soft matter: post-shaded pictures of it err least.
fn soft() -> TransferFunction {
    transfer(&[(0.2, [0.2, 0.4, 1.0], 0.0), (0.6, [1.0, 0.7, 0.2], 0.2), (1.0, [1.0; 3], 0.4)], None)
}

fn post() -> Settings {
    let kernel = Kernel::Gaussian { sigma: 1.0, radius: 3.0 };
    Settings { shading: Shading::Post, painter: Painter::Cpu, kernel, ..Settings::default() }
}

fn drawn(volume: &Volume, transfer: &TransferFunction, camera: &Camera, settings: &Settings) -> Image {
    let host = HostRenderer::new(&Progress::default());
    let scene = host.prepare_layers(&Layers::of_volume(volume, transfer), settings).unwrap();
    host.render(&scene, camera, settings).unwrap().image
}

/// The root mean square of the errors of a picture in steps of 1 of 255, at every seventh pixel of every seventh row
/// that shows something.
fn error(volume: &Volume, transfer: &TransferFunction, camera: &Camera, settings: &Settings) -> f64 {
    let [width, height] = camera.size;
    let pixels: Vec<[u32; 2]> =
        (3..height).step_by(7).flat_map(|y| (3..width).step_by(7).map(move |x| [x, y])).collect();
    let reference = Reference::new(volume, transfer, settings).unwrap().with_tolerance(Reference::TOLERANCE);
    let truth = reference.pixels(camera, &pixels).unwrap();
    let image = drawn(volume, transfer, camera, settings);
    let at = |[x, y]: [u32; 2]| image.pixels()[(y * width + x) as usize].map(f64::from);
    let shown: Vec<_> = pixels.iter().map(|&pixel| at(pixel)).zip(truth).filter(|(_, truth)| truth[3] > 0.0).collect();
    let squares: f64 = shown.iter().flat_map(|(got, truth)| (0..4).map(|c| (got[c] - truth[c]).powi(2))).sum();
    assert!(shown.len() > 40, "{} pixels show something", shown.len());
    255.0 * (squares / (4 * shown.len()) as f64).sqrt()
}

#[test]
fn pictures_of_the_host_are_the_reference() {
    let (volume, _) = demo("marschner-lobb", 32);
    let soft = soft();
    let steep = |magnitude, opacity| GradientPoint { magnitude, opacity };
    let thinned = soft.clone().with_gradient_opacity(vec![steep(0.01, 0.2), steep(0.1, 1.0)]).unwrap();
    let cut = Plane::through(volume.grid().center(), DVec3::new(0.3, 1.0, -0.5)).unwrap();
    let cut = Clip::new(vec![cut]).unwrap();
    let shadows =
        Lighting { lights: vec![Light::directional(DVec3::new(1.0, 1.0, 1.0))], shadows: 0.8, ..Lighting::default() };
    let place = Lighting {
        lights: vec![Light::at(volume.grid().center() + DVec3::new(20.0, -10.0, 30.0))],
        ..Lighting::default()
    };
    // It jumps at its rim, which splines do not follow.
    let jumping = Settings { kernel: Kernel::default(), ..post() };
    let mut too_far = Vec::new();
    let pictures = [
        ("unlit", &soft, post(), 0.12),
        ("unlit, the default kernel", &soft, jumping.clone(), 0.9),
        ("headlight", &soft, Settings { lighting: headlight(), ..post() }, 1.4),
        ("headlight, the default kernel", &soft, Settings { lighting: headlight(), ..jumping }, 2.7),
        ("two lights", &soft, Settings { lighting: two_lights(), ..post() }, 2.2),
        ("a light at a place", &soft, Settings { lighting: Some(place), ..post() }, 3.5),
        ("shadows", &soft, Settings { lighting: Some(shadows), ..post() }, 2.4),
        ("gradient opacity", &thinned, post(), 0.15),
        ("clipped", &soft, Settings { clip: cut, lighting: headlight(), ..post() }, 1.7),
        ("sharpened", &soft, Settings { sharpness: 1.0, kernel: Kernel::default(), ..post() }, 1.7),
    ];
    for (name, transfer, settings, most) in pictures {
        for projection in PROJECTIONS {
            let camera = camera(33.0, projection, &volume, 96);
            let error = error(&volume, transfer, &camera, &settings);
            println!("{name}, {projection:?}: {error:.3} of 255 rms");
            too_far.extend((error > most).then(|| format!("{name}, {projection:?}: {error} of 255 rms")));
        }
    }
    assert!(too_far.is_empty(), "{too_far:#?}");
}

#[test]
fn every_side_and_every_lattice_is_drawn() {
    let (volume, _) = demo("marschner-lobb", 16);
    let soft = soft();
    let sheared = glam::DMat3::from_cols(DVec3::X, DVec3::new(0.3, 1.0, 0.1), DVec3::new(0.2, -0.4, -2.5));
    let grid =
        voxsplat::Grid::new([16; 3], glam::DAffine3::from_mat3_translation(sheared, DVec3::splat(50.0))).unwrap();
    let sheared = volume.clone().with_grid(grid).unwrap();
    let mut too_far = Vec::new();
    for (volume, azimuth, elevation) in [
        (&volume, 0.0, 0.0),
        (&volume, 100.0, 5.0),
        (&volume, 200.0, -80.0),
        (&volume, 290.0, 40.0),
        (&sheared, 60.0, 50.0),
    ] {
        for projection in [ProjectionKind::Orthographic, ProjectionKind::Perspective { fov: 60.0 }] {
            // Light shows the directions of small gradients.
            for (lighting, most) in [(None, 0.4), (two_lights(), 3.0)] {
                let settings = Settings { lighting, ..post() };
                let camera = look(&View { azimuth, elevation, projection, ..View::default() }, volume, [100, 94]);
                let error = error(volume, &soft, &camera, &settings);
                println!(
                    "{azimuth} {elevation} {projection:?}, lit {}: {error:.3} of 255 rms",
                    settings.lighting.is_some()
                );
                let said = || format!("{azimuth} {elevation} {projection:?}, up to {most}: {error} of 255 rms");
                too_far.extend((error > most).then(said));
            }
        }
    }
    assert!(too_far.is_empty(), "{too_far:#?}");
}

#[test]
fn light_in_uniform_matter_is_even() {
    let (volume, transfer) = demo("sphere", 32);
    let settings = Settings { lighting: headlight(), ..post() };
    let camera = camera(30.0, ProjectionKind::Orthographic, &volume, 96);
    let error = error(&volume, &transfer, &camera, &settings);
    assert!(error < 14.0, "{error} of 255 rms");
}

#[test]
fn parts_and_threads_change_no_byte() {
    let (volume, transfer) = demo("vessels", 40);
    let settings = Settings { lighting: headlight(), ..post() };
    for projection in PROJECTIONS {
        let camera = camera(20.0, projection, &volume, 130);
        let whole = drawn(&volume, &transfer, &camera, &settings);
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            assert!(pool.install(|| drawn(&volume, &transfer, &camera, &settings)) == whole, "{threads} threads");
        }
        let host = HostRenderer::new(&Progress::default());
        let scene = host.prepare_layers(&Layers::of_volume(&volume, &transfer), &settings).unwrap();
        let region = Region { x: 13, y: 31, width: 50, height: 37 };
        let part = host.render_region(&scene, &camera, &settings, region).unwrap();
        assert!(part.image == whole.part(region).unwrap());
        assert_eq!(part.stats.painter.name(), "cpu");
    }
}

#[test]
fn what_the_host_does_not_draw_is_refused_in_words() {
    let (volume, transfer) = demo("sphere", 8);
    let layers = Layers::of_volume(&volume, &transfer);
    let host = HostRenderer::new(&Progress::default());
    let refused = |settings: &Settings| host.prepare_layers(&layers, settings).err().unwrap().to_string();
    assert!(refused(&Settings { shading: Shading::Pre, ..post() }).contains("post-shaded composites"));
    assert!(refused(&Settings { model: Model::Mip, ..post() }).contains("post-shaded composites"));
    let scene = host.prepare_layers(&layers, &post()).unwrap();
    let far = look(&View { projection: ProjectionKind::PERSPECTIVE, ..View::default() }, &volume, [4, 4]);
    let error = host.render(&scene, &far, &post()).err().unwrap().to_string();
    assert!(error.contains("voxels are smaller than pixels"), "{error}");
    // Devices refuse the host's painter.
    let renderer: &Renderer = &renderer();
    let scene = renderer.prepare(&volume, &transfer, &post()).unwrap();
    let camera = camera(0.0, ProjectionKind::Orthographic, &volume, 16);
    let error = renderer.render(&scene, &camera, &post()).err().unwrap().to_string();
    assert!(error.contains("cpu draws on no device"), "{error}");
}
