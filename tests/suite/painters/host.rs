//! The host engine against the reference, and the sameness of its bytes.

use voxsplat::camera::{ProjectionKind, View};
use voxsplat::clip::{Clip, Plane};
use voxsplat::host::HostRenderer;
use voxsplat::image::{Image, Region};
use voxsplat::kernel::{Kernel, Normalization};
use voxsplat::layers::{Layer, Layers};
use voxsplat::lighting::{Light, Lighting};
use voxsplat::progress::Progress;
use voxsplat::reference::Reference;
use voxsplat::settings::{Interslice, Model, Painter, Response, Settings, Shading};
use voxsplat::stats::PainterStats;
use voxsplat::transfer::{GradientPoint, TransferFunction, maps};
use voxsplat::volume::{Grid, Samples, Volume};
use voxsplat::{Appearance, Camera, Frame, Renderer};

use glam::DVec3;

use crate::model::layers::{labels, scenes};
use crate::support::{PERSPECTIVE, PROJECTIONS, camera, demo, headlight, look, renderer, transfer, two_lights};

/// Soft matter: post-shaded pictures of it err least.
fn soft() -> TransferFunction {
    transfer(&[(0.2, [0.2, 0.4, 1.0], 0.0), (0.6, [1.0, 0.7, 0.2], 0.2), (1.0, [1.0; 3], 0.4)], None)
}

fn post() -> Settings {
    let kernel = Kernel::Gaussian { sigma: 1.0, radius: 3.0 };
    Settings { shading: Shading::Post, painter: Painter::Cpu, kernel, ..Settings::default() }
}

fn pre() -> Settings {
    Settings { shading: Shading::Pre, ..post() }
}

fn drawn(layers: &Layers, camera: &Camera, settings: &Settings) -> Image {
    let host = HostRenderer::new(&Progress::default());
    let scene = host.prepare_layers(layers, settings).unwrap();
    host.render(&scene, &Frame::new(camera, settings)).unwrap().image
}

/// The root mean square of the errors of a picture in steps of 1 of 255, at every seventh pixel of every seventh row
/// that shows something; of small pictures at every third.
fn error(layers: &Layers, camera: &Camera, settings: &Settings) -> f64 {
    let [width, height] = camera.size;
    let step = if width > 60 { 7 } else { 3 };
    let pixels: Vec<[u32; 2]> =
        (3..height).step_by(step).flat_map(|y| (3..width).step_by(step).map(move |x| [x, y])).collect();
    let reference = Reference::of_layers(layers, settings).unwrap().with_tolerance(Reference::TOLERANCE);
    let truth = reference.pixels(camera, &pixels).unwrap();
    let image = drawn(layers, camera, settings);
    let at = |[x, y]: [u32; 2]| image.pixels()[(y * width + x) as usize].map(f64::from);
    let shown: Vec<_> = pixels.iter().map(|&pixel| at(pixel)).zip(truth).filter(|(_, truth)| truth[3] > 0.0).collect();
    let squares: f64 = shown.iter().flat_map(|(got, truth)| (0..4).map(|c| (got[c] - truth[c]).powi(2))).sum();
    assert!(shown.len() > 4, "{} pixels show something", shown.len());
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
    // Minima and means show faint values too.
    let visible = transfer(&[(0.0, [0.2, 0.4, 1.0], 0.1), (1.0, [1.0; 3], 0.4)], None);
    // Sums of kernels that are not divided by their integral are 15 times as far from the base as samples.
    let dense = transfer(&[(0.15, [0.2, 0.4, 1.0], 0.0), (12.0, [1.0; 3], 0.1)], None);
    let mut too_far = Vec::new();
    let pictures = [
        ("unlit", &soft, post(), 0.12),
        ("unlit, the default kernel", &soft, jumping.clone(), 0.9),
        ("sums of kernels, not divided", &dense, Settings { normalization: Normalization::Peak, ..post() }, 0.2),
        ("the same, pre-shaded", &soft, Settings { normalization: Normalization::Peak, ..pre() }, 0.5),
        ("means of them", &dense, Settings { normalization: Normalization::Peak, model: Model::Average, ..pre() }, 0.2),
        ("headlight", &soft, Settings { lighting: headlight(), ..post() }, 1.4),
        ("headlight, the default kernel", &soft, Settings { lighting: headlight(), ..jumping }, 2.7),
        ("two lights", &soft, Settings { lighting: two_lights(), ..post() }, 2.2),
        ("a light at a place", &soft, Settings { lighting: Some(place.clone()), ..post() }, 3.5),
        ("shadows", &soft, Settings { lighting: Some(shadows.clone()), ..post() }, 2.4),
        ("gradient opacity", &thinned, post(), 0.15),
        ("clipped", &soft, Settings { clip: cut.clone(), lighting: headlight(), ..post() }, 1.7),
        ("sharpened", &soft, Settings { sharpness: 1.0, kernel: Kernel::default(), ..post() }, 1.7),
        ("pre-shaded", &soft, pre(), 0.1),
        ("pre-shaded, the default kernel", &soft, Settings { kernel: Kernel::default(), ..pre() }, 0.7),
        ("pre-shaded, two lights", &soft, Settings { lighting: two_lights(), ..pre() }, 0.1),
        ("pre-shaded, a light at a place", &soft, Settings { lighting: Some(place), ..pre() }, 0.15),
        ("pre-shaded, shadows", &soft, Settings { lighting: Some(shadows), ..pre() }, 0.1),
        ("pre-shaded, gradient opacity", &thinned, Settings { lighting: headlight(), ..pre() }, 0.1),
        ("pre-shaded, clipped", &soft, Settings { clip: cut, lighting: headlight(), ..pre() }, 0.5),
        ("an X-ray", &soft, Settings { model: Model::Xray, ..pre() }, 0.1),
        ("maxima", &soft, Settings { model: Model::Mip, ..pre() }, 1.4),
        // Of two places with almost the same value either may show its depth.
        ("maxima by depth", &soft, Settings { model: Model::Mip, depth_coded: true, ..pre() }, 4.5),
        ("maxima that fade", &soft, Settings { model: Model::Mip, attenuation: 2.0, ..pre() }, 1.4),
        ("minima by depth", &visible, Settings { model: Model::Minip, depth_coded: true, ..pre() }, 3.0),
        ("minima", &visible, Settings { model: Model::Minip, ..pre() }, 0.5),
        ("means", &visible, Settings { model: Model::Average, ..pre() }, 0.2),
    ];
    for (name, transfer, settings, most) in pictures {
        for projection in PROJECTIONS {
            let camera = camera(33.0, projection, &volume, 96);
            let error = error(&Layers::of_volume(&volume, transfer), &camera, &settings);
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
    let grid = Grid::new([16; 3], glam::DAffine3::from_mat3_translation(sheared, DVec3::splat(50.0))).unwrap();
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
            for (lighting, settings, most) in
                [(None, post(), 0.4), (two_lights(), post(), 3.0), (two_lights(), pre(), 0.2)]
            {
                let settings = Settings { lighting, ..settings };
                let camera = look(&View { azimuth, elevation, projection, ..View::default() }, volume, [100, 94]);
                let error = error(&Layers::of_volume(volume, &soft), &camera, &settings);
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

/// A light that changes no colour draws the bytes of the picture without light. Fields of lit voxels have coefficients
/// only where they have weights, of unlit ones everywhere.
#[test]
fn fields_of_lit_voxels_have_coefficients_where_they_have_weights() {
    let (volume, _) = demo("marschner-lobb", 64);
    let layers = Layers::of_volume(&volume, &soft());
    let flat = Lighting { ambient: 1.0, diffuse: 0.0, specular: 0.0, ..Lighting::default() };
    let lit = Settings { lighting: Some(flat), kernel: Kernel::default(), ..pre() };
    let unlit = Settings { lighting: None, ..lit.clone() };
    let host = HostRenderer::new(&Progress::default());
    // Views from afar, from near by, and from within the volume.
    for (azimuth, fov, size, distance) in [(0.0, 60.0, 20, 150.0), (40.0, 90.0, 24, 60.0), (71.0, 120.0, 30, 12.0)] {
        let projection = ProjectionKind::Perspective { fov };
        let view = View { azimuth, elevation: 17.0, projection, distance: Some(distance), ..View::default() };
        let camera = Camera::new(&view, volume.grid(), [size; 2]).unwrap();
        let [(lit, bytes), (unlit, all)] = [&lit, &unlit].map(|settings| {
            let scene = host.prepare_layers(&layers, settings).unwrap();
            let rendered = host.render(&scene, &Frame::new(&camera, settings)).unwrap();
            let PainterStats::Cpu(stats) = rendered.stats.painter else { panic!("another painter") };
            (rendered.image, stats.field_bytes)
        });
        println!("{azimuth}: {bytes} of {all} bytes");
        assert!(lit.pixels() == unlit.pixels(), "{azimuth}");
        // Lit voxels have normals, a quarter of their bytes, and from afar nearly all cells have two fields.
        assert!(distance > 100.0 || bytes < all, "{azimuth}: {bytes} of {all} bytes");
    }
}

#[test]
fn voxels_smaller_than_pixels_are_drawn() {
    let (volume, _) = demo("marschner-lobb", 32);
    let layers = Layers::of_volume(&volume, &soft());
    let wide = ProjectionKind::Perspective { fov: 60.0 };
    let mut too_far = Vec::new();
    // Of a wide kernel near voxels are blurred if far ones are much smaller than pixels.
    let default = |settings: Settings| Settings { kernel: Kernel::default(), ..settings };
    for (settings, most) in [
        (pre(), [0.2, 3.0]),
        (default(pre()), [0.2, 2.5]),
        (default(post()), [0.5, 4.0]),
        (Settings { lighting: headlight(), ..default(pre()) }, [0.2, 2.0]),
    ] {
        // From one voxel and a half to five to a pixel; growth that changes with depth.
        let parallel = ProjectionKind::Orthographic;
        for (projection, size) in [(parallel, 26), (parallel, 12), (wide, 26), (wide, 40)] {
            let camera = camera(33.0, projection, &volume, size);
            let error = error(&layers, &camera, &settings);
            println!("{:?} {:?}, {projection:?}, {size} px: {error:.3}", settings.shading, settings.kernel);
            let most = most[usize::from(projection == wide)];
            too_far.extend((error > most).then(|| format!("{projection:?}, {size} px: {error} of 255 rms")));
        }
    }
    assert!(too_far.is_empty(), "{too_far:#?}");
}

#[test]
fn samples_between_planes_of_wide_kernels_are_interpolated() {
    let (volume, _) = demo("marschner-lobb", 32);
    let layers = Layers::of_volume(&volume, &soft());
    let host = HostRenderer::new(&Progress::default());
    for (settings, most) in [
        (post(), 0.05),
        (Settings { lighting: headlight(), ..post() }, 0.4),
        (Settings { model: Model::Mip, ..post() }, 0.4),
        (Settings { model: Model::Average, ..post() }, 0.05),
    ] {
        let scene = host.prepare_layers(&layers, &settings).unwrap();
        // 1.48 to 2.4 voxels to a pixel.
        let samples = [38.5, 39.5, 52.0, 62.0].map(|height| {
            let view = View { azimuth: 30.0, elevation: 20.0, view_height: Some(height), ..View::default() };
            let camera = look(&view, &volume, [26; 2]);
            let error = error(&layers, &camera, &settings);
            println!("{:?}, {height}: {error:.3}", settings.model);
            assert!(error < most, "{:?}, {height}: {error} of 255", settings.model);
            let stats = host.render(&scene, &Frame::new(&camera, &settings)).unwrap().stats;
            let PainterStats::Cpu(stats) = stats.painter else { panic!("{:?}", stats.painter) };
            stats.samples as f64
        });
        assert!(samples[1] < 0.7 * samples[0], "{:?}: {samples:?}", settings.model);
    }
}

/// A rod seen end-on: near voxels are larger than pixels, and many of the farthest fall into one.
#[test]
fn near_matter_before_matter_far_away_is_sharp() {
    let dims = [300, 16, 16];
    let value = |i: u32| {
        let [x, y, z] = [i % dims[0], i / dims[0] % dims[1], i / (dims[0] * dims[1])].map(f64::from);
        0.5 + 0.5 * (0.7 * x).sin() * (0.6 * y).cos() * (0.5 * z + 1.0).sin()
    };
    let samples = Samples::F32((0..dims.iter().product()).map(|i| value(i) as f32).collect());
    let volume = Volume::new(Grid::axis_parallel(dims, [1.0; 3]).unwrap(), samples).unwrap();
    let layers = Layers::of_volume(&volume, &soft());
    let projection = ProjectionKind::Perspective { fov: 40.0 };
    let view = View { azimuth: 90.0, projection, ..View::default() };
    let camera = look(&view, &volume, [48; 2]);
    for (settings, most) in [(pre(), 2.0), (post(), 4.0)] {
        let error = error(&layers, &camera, &settings);
        println!("{:?}: {error:.2} of 255", settings.shading);
        assert!(error < most, "{:?}: {error} of 255", settings.shading);
    }
}

/// The rays of a group then read the same few points.
#[test]
fn voxels_larger_than_groups_of_pixels_are_drawn() {
    let (volume, _) = demo("marschner-lobb", 24);
    let layers = Layers::of_volume(&volume, &soft());
    for (zoom, projection) in [3.0, 5.0, 9.0].into_iter().flat_map(|zoom| PROJECTIONS.map(|of| (zoom, of))) {
        let view = View { azimuth: 33.0, elevation: 21.0, zoom, projection, ..View::default() };
        let camera = look(&view, &volume, [64; 2]);
        for (settings, most) in [(pre(), 0.1), (Settings { lighting: headlight(), ..post() }, 0.15)] {
            let error = error(&layers, &camera, &settings);
            println!("{zoom} {projection:?} {:?}: {error:.3} of 255", settings.shading);
            assert!(error < most, "{zoom} {projection:?} {:?}: {error} of 255", settings.shading);
        }
    }
}

#[test]
fn a_volume_far_smaller_than_a_pixel_is_a_picture() {
    let (volume, transfer) = demo("shell", 24);
    let layers = Layers::of_volume(&volume, &transfer);
    for settings in [pre(), post(), Settings { kernel: Kernel::Gaussian { sigma: 3.0, radius: 10.0 }, ..pre() }] {
        for zoom in [1.0, 1e-6] {
            let camera = look(&View { zoom, ..View::default() }, &volume, [9, 9]);
            assert!(drawn(&layers, &camera, &settings).pixels().iter().flatten().all(|channel| channel.is_finite()));
        }
    }
}

#[test]
fn a_scene_of_another_shading_is_refused() {
    let (volume, transfer) = demo("sphere", 8);
    let host = HostRenderer::new(&Progress::default());
    let scene = host.prepare_layers(&Layers::of_volume(&volume, &transfer), &pre()).unwrap();
    let camera = camera(0.0, ProjectionKind::Orthographic, &volume, 16);
    for (settings, words) in [
        (post(), "prepared for another shading"),
        (Settings { model: Model::Mip, attenuation: 1.0, ..pre() }, "prepared for another shading"),
        (Settings { lighting: headlight(), ..pre() }, "prepared without light"),
    ] {
        let error = host.render(&scene, &Frame::new(&camera, &settings)).err().unwrap().to_string();
        assert!(error.contains(words), "{error}");
    }
}

#[test]
fn layers_of_the_host_are_the_reference() {
    let mut too_far = Vec::new();
    for (number, layers) in scenes().iter().enumerate() {
        for (lighting, projection) in [None, two_lights()].into_iter().zip(PROJECTIONS) {
            let settings = Settings { lighting, ..pre() };
            let camera = camera(33.0, projection, &labels(), 64);
            let error = error(layers, &camera, &settings);
            println!("scene {number}, {projection:?}: {error:.3} of 255 rms");
            too_far.extend((error > 2.0).then(|| format!("scene {number}, {projection:?}: {error} of 255 rms")));
        }
    }
    assert!(too_far.is_empty(), "{too_far:#?}");
}

#[test]
fn light_in_uniform_matter_is_even() {
    let (volume, transfer) = demo("sphere", 32);
    let settings = Settings { lighting: headlight(), ..post() };
    let camera = camera(30.0, ProjectionKind::Orthographic, &volume, 96);
    let error = error(&Layers::of_volume(&volume, &transfer), &camera, &settings);
    assert!(error < 14.0, "{error} of 255 rms");
}

#[test]
fn parts_and_threads_change_no_byte() {
    let (volume, transfer) = demo("vessels", 40);
    let layers = Layers::of_volume(&volume, &transfer);
    let settings = [post(), pre()].map(|settings| Settings { lighting: headlight(), ..settings });
    let settings = settings.into_iter().chain([Settings { model: Model::Mip, ..post() }]);
    for (settings, projection) in settings.flat_map(|settings| PROJECTIONS.map(|kind| (settings.clone(), kind))) {
        let camera = camera(20.0, projection, &volume, 130);
        let whole = drawn(&layers, &camera, &settings);
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            assert!(pool.install(|| drawn(&layers, &camera, &settings)) == whole, "{threads} threads");
        }
        let host = HostRenderer::new(&Progress::default());
        let scene = host.prepare_layers(&layers, &settings).unwrap();
        let region = Region { x: 13, y: 31, width: 50, height: 37 };
        let part = host.render(&scene, &Frame::new(&camera, &settings).region(region)).unwrap();
        assert!(part.image == whole.part(region).unwrap());
        assert_eq!(part.stats.painter.name(), "cpu");
        // Stages have the names of the device's, by which programs find their times.
        assert!(part.stats.seconds("frame").is_some(), "{:?}", part.stats.stages);
    }
}

/// Pictures of one scene reuse fields, their memory, and the occlusion of ambient light.
#[test]
fn what_is_kept_for_the_next_picture_changes_no_byte() {
    let (volume, transfer) = demo("vessels", 40);
    let layers = Layers::of_volume(&volume, &transfer);
    for settings in [pre(), post()] {
        let host = HostRenderer::new(&Progress::default());
        let studio = |camera: &Camera| Some(Lighting::studio(camera.forward, camera.up));
        let lit =
            |camera: &Camera| Settings { lighting: studio(camera), kernel: Kernel::default(), ..settings.clone() };
        // Kernels shrink and grow.
        let views = [(10.0, 90.0), (10.0, 40.0), (55.0, 40.0), (100.0, 60.0), (150.0, 40.0), (150.0, 140.0)];
        let cameras = views.map(|(azimuth, view_height)| {
            let view = View { azimuth, view_height: Some(view_height), ..View::default() };
            Camera::new(&view, volume.grid(), [64; 2]).unwrap()
        });
        let scene = host.prepare_layers(&layers, &lit(&cameras[0])).unwrap();
        for camera in &cameras {
            let settings = lit(camera);
            let next = host.render(&scene, &Frame::new(camera, &settings)).unwrap().image;
            assert!(next == drawn(&layers, camera, &settings), "{}", settings.shading.name());
        }
    }
}

/// The hash FNV-1a of the numbers of a picture.
fn hash(image: &Image) -> u64 {
    let numbers = image.pixels().as_flattened().iter().map(|number| u64::from(number.to_bits()));
    numbers.fold(0xcbf2_9ce4_8422_2325, |hash, bits| (hash ^ bits).wrapping_mul(0x100_0000_01b3))
}

#[test]
fn pictures_have_the_same_bytes_on_every_machine() {
    let (volume, _) = demo("marschner-lobb", 32);
    let of = |transfer: &TransferFunction| Layers::of_volume(&volume, transfer);
    let of_soft = of(&soft());
    let side = |projection| camera(33.0, projection, &volume, 64);
    let [parallel, perspective] = PROJECTIONS.map(side);
    let close = look(&View { azimuth: 33.0, zoom: 5.0, projection: PERSPECTIVE, ..View::default() }, &volume, [64; 2]);
    let studio = Some(Lighting::studio(perspective.forward, perspective.up));
    let place = Light::at(volume.grid().center() + DVec3::new(20.0, -10.0, 30.0));
    let place = Some(Lighting { lights: vec![place], shadows: 0.8, ..Lighting::default() });
    let film = Response::Film { exposure: 10.0, gamma: 2.0 };
    let map = maps::find("turbo").and_then(|map| map.transfer()).unwrap();
    let labelled = &scenes()[1];
    let side_of_labels = camera(33.0, PERSPECTIVE, &labels(), 64);
    // All choices of the program.
    let nautilus = demo("nautilus", 48).0;
    let chosen = Appearance::for_file("demo:nautilus:48", &nautilus).unwrap();
    let chosen_settings = Settings { painter: Painter::Cpu, ..chosen.settings.clone() };
    let cpu = || Settings { painter: Painter::Cpu, ..Settings::default() };
    let pictures = [
        ("post-shaded, two lights", &of_soft, perspective, Settings { lighting: two_lights(), ..post() }),
        ("pre-shaded, studio light", &of_soft, perspective, Settings { lighting: studio, ..pre() }),
        ("a light at a place, shadows", &of_soft, parallel, Settings { lighting: place, ..pre() }),
        ("an X-ray on film", &of_soft, parallel, Settings { model: Model::Xray, response: film, ..cpu() }),
        ("maxima by depth", &of_soft, perspective, Settings { model: Model::Mip, depth_coded: true, ..cpu() }),
        ("a colour map, sharpened", &of(&map), parallel, Settings { sharpness: 1.0, ..cpu() }),
        ("labels over scalars", labelled, side_of_labels, Settings { lighting: two_lights(), ..pre() }),
        ("a nautilus", &chosen.layers, chosen.camera([64; 2]).unwrap(), chosen_settings),
        ("post-shaded, close", &of_soft, close, Settings { lighting: headlight(), ..post() }),
        ("pre-shaded, close", &of_soft, close, Settings { lighting: headlight(), ..pre() }),
    ];
    let hashes: [u64; 10] = [
        0xb575_764d_9ebd_652a,
        0xbcef_e527_eba0_b8ae,
        0x26f5_78ea_a303_eb1b,
        0xb113_8be9_cf97_76b9,
        0x0028_7c3e_1a45_95a3,
        0x8b0f_0e76_2324_aba8,
        0xff9d_187b_551f_3e92,
        0x2436_9c7f_26e1_400a,
        0xeaaf_7332_b61a_b3f2,
        0x4cef_82db_01c1_68f1,
    ];
    let mut others = Vec::new();
    for ((name, layers, camera, settings), expected) in pictures.into_iter().zip(hashes) {
        let found = hash(&drawn(layers, &camera, &settings));
        others.extend((found != expected).then(|| format!("{name}: {found:#018x}")));
    }
    assert!(others.is_empty(), "if a change means to change these pictures, take over the new hashes: {others:#?}");
}

#[test]
fn what_the_host_does_not_draw_is_refused_in_words() {
    let (volume, transfer) = demo("sphere", 8);
    let layers = Layers::of_volume(&volume, &transfer);
    let host = HostRenderer::new(&Progress::default());
    let refused = |settings: &Settings| host.prepare_layers(&layers, settings).err().unwrap().to_string();
    assert!(refused(&Settings { interslice: Interslice::Mean, ..post() }).contains("classifies between samples"));
    let two = layers.clone().with(Layer::scalars(&volume, &transfer)).unwrap();
    let error = host.prepare_layers(&two, &post()).err().unwrap().to_string();
    assert!(error.contains("post") || error.contains("pre"), "{error}");
    // Devices refuse the host's painter.
    let renderer: &Renderer = &renderer();
    let scene = renderer.prepare(&volume, &transfer, &post()).unwrap();
    let camera = camera(0.0, ProjectionKind::Orthographic, &volume, 16);
    let error = renderer.render(&scene, &Frame::new(&camera, &post())).err().unwrap().to_string();
    assert!(error.contains("cpu draws on no device"), "{error}");
}
