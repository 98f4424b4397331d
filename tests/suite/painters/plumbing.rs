//! Counts of the work that a picture gives to the device: dispatches, submissions, waits and bytes sent. A GPU is held
//! up by them, and they are the same on software.

use glam::DVec3;
use voxsplat::Frame;
use voxsplat::camera::{Camera, ProjectionKind};
use voxsplat::clip::{Clip, Plane};
use voxsplat::error::Error;
use voxsplat::layers::{Layer, Layers};
use voxsplat::lighting::{Light, Lighting};
use voxsplat::renderer::{Rendered, Renderer, Scene};
use voxsplat::settings::{Level, Painter, QuadsSettings, Settings, Shading};
use voxsplat::stats::{Clock, Stats};
use voxsplat::transfer::{ControlPoint, GradientPoint, TransferFunction};
use voxsplat::volume::{Grid, Samples, Volume};
use voxsplat::wgpu;

use super::embed::{Host, host};
use crate::support::{
    PROJECTIONS, camera, demo, draw_on, headlight, new_renderer, prepare_on, renderer, rms_of_all, transfer,
};

/// Pre- and post-shaded pictures of voxels, unlit and lit.
fn kinds() -> [Settings; 4] {
    // Without anti-aliasing the scalars that a picture needs do not depend on the view.
    let pre = Settings { level: Level::At(0), antialiasing: false, ..Settings::default() };
    let post = Settings { shading: Shading::Post, ..pre.clone() };
    let lit = |settings: &Settings| Settings { lighting: headlight(), ..settings.clone() };
    [lit(&pre), lit(&post), pre, post]
}

/// The same picture with another light, if it is lit, and the same picture with a clipping plane at this place.
fn changed(settings: &Settings, place: f64) -> [Settings; 2] {
    let light = Lighting { lights: vec![Light::directional(DVec3::new(place, 1.0, 1.0))], ..Lighting::default() };
    let lit = Settings { lighting: settings.lighting.as_ref().map(|_| light), ..settings.clone() };
    let plane = Plane::new(DVec3::X, place).unwrap();
    [lit, Settings { clip: Clip::new(vec![plane]).unwrap(), ..settings.clone() }]
}

/// Volumes of which GPUs make lists of splats, and of which they keep the samples.
fn listed_and_sampled() -> [(Volume, TransferFunction); 2] {
    [demo("vessels", 40), demo("marschner-lobb", 40)]
}

/// Draws a frame into a texture.
fn frame(host: &Host, scene: &Scene, camera: &Camera, settings: &Settings) -> Stats {
    let texture = host.texture(camera.size, wgpu::TextureFormat::Rgba8Unorm);
    host.renderer.render_into(scene, &Frame::new(camera, settings), &texture).unwrap()
}

#[test]
fn frames_into_a_texture_wait_for_nothing_and_send_parameters_only() {
    let volumes = listed_and_sampled();
    let host = host(Renderer::FEATURES);
    let all = kinds().into_iter().flat_map(|kind| PROJECTIONS.map(|p| (kind.clone(), p)));
    let all = all.flat_map(|(kind, p)| volumes.each_ref().map(|volume| (kind.clone(), p, volume)));
    for (settings, projection, (volume, transfer)) in all {
        let scene = prepare_on(&host.renderer, volume, transfer, &settings).unwrap();
        let draw =
            |azimuth, settings: &Settings| frame(&host, &scene, &camera(azimuth, projection, volume, 96), settings);
        draw(20.0, &settings);
        let [lit, clipped] = changed(&settings, 0.0);
        let [other_light, moved] = changed(&settings, 2.0);
        draw(20.0, &lit);
        draw(20.0, &clipped);
        for (event, azimuth, settings) in [
            ("next", 30.0, &settings),
            ("next", 120.0, &settings),
            ("light", 30.0, &other_light),
            ("clip", 30.0, &moved),
        ] {
            let stats = draw(azimuth, settings);
            let what = format!("{event}, {projection:?}: {settings:?}");
            assert!(stats.tiles().is_some(), "{what}");
            assert_eq!(stats.waits, 0, "{what}");
            // One clears the target, one packs the volume, one draws.
            assert!(stats.submissions <= 3, "{} submissions: {what}", stats.submissions);
            assert!(stats.dispatches < 30, "{} dispatches: {what}", stats.dispatches);
            assert!(stats.bytes_sent < 40_000, "{} bytes: {what}", stats.bytes_sent);
        }
    }
}

/// Studio light with shadows and occlusion, turned about the vertical axis.
fn studio(degrees: f64) -> Lighting {
    let (sin, cos) = degrees.to_radians().sin_cos();
    Lighting::studio(DVec3::new(sin, cos, 0.0), DVec3::Z)
}

/// The shadows of the first picture, and of lights that turn, are found on the device: the host waits for none of them,
/// and splats do not travel.
#[test]
fn shadows_wait_for_nothing_and_send_parameters_only() {
    let host = host(Renderer::FEATURES);
    listed_and_sampled().iter().for_each(|volume| assert_shadows_send_parameters_only(&host, volume));
}

fn assert_shadows_send_parameters_only(host: &Host, (volume, transfer): &(Volume, TransferFunction)) {
    let settings = |lighting: Lighting| Settings { lighting: Some(lighting), ..kinds()[0].clone() };
    let camera = camera(20.0, PROJECTIONS[0], volume, 96);
    let first = |settings: &Settings| {
        let scene = prepare_on(&host.renderer, volume, transfer, settings).unwrap();
        let stats = frame(host, &scene, &camera, settings);
        (scene, stats)
    };
    let without = Lighting { shadows: 0.0, occlusion: None, ..studio(0.0) };
    let (_, unshadowed) = first(&settings(without));
    let (scene, shadowed) = first(&settings(studio(0.0)));
    assert_eq!(shadowed.waits, unshadowed.waits);
    // Stencils, weights and the places of planes.
    let more = shadowed.bytes_sent - unshadowed.bytes_sent;
    assert!(more < 150_000, "{more} bytes more for {} splats", shadowed.splats_kept);
    for degrees in [10.0, 20.0] {
        let stats = frame(host, &scene, &camera, &settings(studio(degrees)));
        let [dispatches, submissions] = [stats.dispatches, stats.submissions];
        println!("{dispatches} dispatches, {submissions} submissions, {} bytes", stats.bytes_sent);
        assert_eq!(stats.waits, 0);
        assert!(submissions <= 4 && dispatches < 70 && stats.bytes_sent < 150_000);
    }
}

#[test]
fn a_picture_waits_once_for_its_pixels_and_times() {
    let renderer = new_renderer();
    let (volume, transfer) = demo("vessels", 40);
    for settings in kinds() {
        let scene = prepare_on(&renderer, &volume, &transfer, &settings).unwrap();
        let draw = |azimuth| {
            draw_on(&renderer, &scene, &camera(azimuth, PROJECTIONS[0], &volume, 96), &settings).unwrap().stats
        };
        draw(20.0);
        let stats = draw(25.0);
        assert_eq!(stats.waits, 1, "{settings:?}");
        let seconds = stats.stages.iter().find(|stage| stage.name == "gather" && stage.clock == Clock::Device);
        assert!(seconds.is_some_and(|stage| stage.seconds > 0.0), "{:?}", stats.stages);
    }
}

#[test]
fn a_lit_picture_is_packed_again_only_under_another_light() {
    let renderer = new_renderer();
    let (volume, transfer) = demo("vessels", 40);
    let [settings, ..] = kinds();
    for projection in PROJECTIONS {
        let scene = prepare_on(&renderer, &volume, &transfer, &settings).unwrap();
        let draw = |azimuth, settings: &Settings| {
            draw_on(&renderer, &scene, &camera(azimuth, projection, &volume, 96), settings).unwrap()
        };
        let first = draw(20.0, &settings);
        let [light, _] = changed(&settings, 2.0);
        let packs = |stats: &Stats| stats.stages.iter().any(|stage| stage.name == "pack");
        let again = draw(20.0, &settings);
        assert!(packs(&first.stats) && !packs(&again.stats), "{projection:?}");
        assert!(again.image == first.image);
        for (azimuth, settings) in [(24.0, &settings), (20.0, &light)] {
            let other = draw(azimuth, settings);
            assert!(packs(&other.stats) && other.image != first.image, "{projection:?}, {azimuth}");
        }
        let back = draw(20.0, &settings);
        assert!(packs(&back.stats) && back.image == first.image, "{projection:?}");
    }
}

/// Light on cells changes with every view. The samples that they are made from stay on the device, and so do the
/// normals: a frame sums planes of lit voxels and emits cells.
#[test]
fn cells_under_another_light_send_no_samples() {
    let host = host(Renderer::FEATURES);
    let (volume, transfer) = demo("vessels", 64);
    let [settings, ..] = kinds();
    let settings = Settings { level: Level::At(1), ..settings };
    for projection in PROJECTIONS {
        let prepare = || prepare_on(&host.renderer, &volume, &transfer, &settings).unwrap();
        let mut scene = prepare();
        let draw = |scene: &Scene, azimuth| {
            draw_on(&host.renderer, scene, &camera(azimuth, projection, &volume, 40), &settings).unwrap()
        };
        let first = draw(&scene, 20.0);
        assert!(first.stats.bytes_sent > volume.grid().len());
        let turned = draw(&scene, 30.0);
        assert!(turned.image == draw(&prepare(), 30.0).image);
        for azimuth in [40.0, 50.0] {
            let at = camera(azimuth, projection, &volume, 40);
            let stats = frame(&host, &scene, &at, &settings);
            let [dispatches, submissions] = [stats.dispatches, stats.submissions];
            println!("{projection:?}: {dispatches} dispatches, {submissions} submissions, {} bytes", stats.bytes_sent);
            assert_eq!(stats.waits, 0);
            assert!(stats.bytes_sent < 64 << 10, "{} bytes", stats.bytes_sent);
            // Two dispatches make the cells, in a submission.
            let drawn = frame(&host, &scene, &at, &settings);
            let more = [dispatches - drawn.dispatches, submissions - drawn.submissions];
            // Another one packs them, in another submission.
            assert_eq!(more, [3, 2], "{projection:?}");
        }
        host.renderer.set_transfer(&mut scene, &transfer).unwrap();
        let again = draw(&scene, 20.0);
        assert!(again.stats.bytes_sent < 64 << 10, "{} bytes", again.stats.bytes_sent);
        assert!(again.image == first.image);
    }
}

/// The device has 3-D textures of 2048 texels a side, as WebGPU promises.
#[test]
fn light_in_a_long_volume_fits_into_the_textures_of_the_device() {
    let host = host(Renderer::FEATURES);
    let dims = [2500, 5, 5];
    let sample = |i: u32| if i % dims[0] % 50 < 25 { 200 } else { 0 };
    let samples = Samples::U8((0..dims.iter().product()).map(sample).collect());
    let volume = Volume::new(Grid::axis_parallel(dims, [1.0; 3]).unwrap(), samples).unwrap();
    let transfer = transfer(&[(50.0, [1.0; 3], 0.0), (200.0, [1.0, 0.5, 0.2], 0.5)], None);
    let lights = vec![Light::directional(DVec3::new(1.0, 0.3, 0.2))];
    let lighting = Some(Lighting { lights, shadows: 1.0, ..Lighting::default() });
    let [_, post, ..] = kinds();
    let settings = Settings { lighting, ..post };
    let scene = prepare_on(&host.renderer, &volume, &transfer, &settings).unwrap();
    draw_on(&host.renderer, &scene, &camera(0.0, PROJECTIONS[0], &volume, 64), &settings).unwrap();
}

/// Pre-shaded pictures have the bytes of a scene that was prepared with the function. Post-shaded ones differ by sums
/// of kernels around another base: by less than half a step of 8 bits.
#[test]
fn another_transfer_function_sends_a_table_and_no_samples() {
    [demo("vessels", 64), demo("marschner-lobb", 64)].iter().for_each(assert_transfers_send_tables);
}

fn assert_transfers_send_tables((volume, first): &(Volume, TransferFunction)) {
    let [low, high] = first.range();
    let moved = |share: f64| {
        let shift = |p: &ControlPoint| ControlPoint { value: p.value + share * (high - low), ..*p };
        TransferFunction::new(first.points().iter().map(shift).collect(), first.unit_distance()).unwrap()
    };
    let renderer = new_renderer();
    for settings in kinds() {
        let camera = camera(20.0, PROJECTIONS[1], volume, 96);
        let draw = |scene: &Scene| draw_on(&renderer, scene, &camera, &settings).unwrap();
        let mut scene = prepare_on(&renderer, volume, first, &settings).unwrap();
        let before = draw(&scene).image;
        for (change, share) in [0.05, -0.05, 0.0].into_iter().enumerate() {
            let other = moved(share);
            renderer.set_transfer(&mut scene, &other).unwrap();
            let Rendered { image, stats } = draw(&scene);
            let what = format!("{share}: {settings:?}");
            // The first change may send the samples.
            if change > 0 {
                assert!(stats.bytes_sent < 64 << 10, "{} bytes: {what}", stats.bytes_sent);
            }
            let expected = draw(&prepare_on(&renderer, volume, &other, &settings).unwrap()).image;
            let error = 255.0 * rms_of_all(&image, &expected);
            let allowed = if settings.is_post_shaded() { 0.5 } else { 0.0 };
            assert!(error <= allowed, "{error} of 255: {what}");
            assert!(share == 0.0 || image != before, "{what}");
        }
    }
}

/// GPUs pack voxels from their samples, and make no list of splats unless something reads it. A picture has the same
/// bytes if it is packed from lists, and if it is packed over another transfer function's.
#[test]
fn voxels_packed_from_samples_are_those_packed_from_lists() {
    compare_voxels(11);
}

#[test]
#[ignore = "slow: 12 scenes, two minutes"]
fn voxels_of_every_look_packed_from_samples_are_those_packed_from_lists() {
    compare_voxels(1);
}

/// Compares every `step`-th of 12 scenes.
fn compare_voxels(step: usize) {
    let (volume, transfer) = demo("marschner-lobb", 48);
    let thins = [(0.0, 0.0), (0.02, 1.0)].map(|(magnitude, opacity)| GradientPoint { magnitude, opacity });
    let thinned = transfer.clone().with_gradient_opacity(thins.to_vec()).unwrap();
    let host = host(Renderer::FEATURES);
    let by_quads =
        |settings: &Settings| Settings { painter: Painter::Quads(QuadsSettings::default()), ..settings.clone() };
    let [lit, _, unlit, _] = kinds();
    let [_, clipped] = changed(&lit, 2.0);
    let in_studio = |degrees| Settings { lighting: Some(studio(degrees)), ..lit.clone() };
    let (shadows, turned) = (in_studio(0.0), in_studio(40.0));
    let all = [
        (&lit, &transfer),
        (&unlit, &thinned),
        (&lit, &thinned),
        (&clipped, &transfer),
        (&shadows, &transfer),
        (&shadows, &thinned),
    ];
    let scenes = all.into_iter().flat_map(|look| PROJECTIONS.map(|projection| (look, projection)));
    for ((settings, transfer), projection) in scenes.step_by(step) {
        let camera = camera(20.0, projection, &volume, 96);
        let draw = |scene: &Scene| draw_on(&host.renderer, scene, &camera, settings).unwrap();
        let mut sampled = prepare_on(&host.renderer, &volume, transfer, settings).unwrap();
        let listed = prepare_on(&host.renderer, &volume, transfer, &by_quads(settings)).unwrap();
        let quads = draw_on(&host.renderer, &listed, &camera, &by_quads(settings)).unwrap().image;
        let [own, others] = [&sampled, &listed].map(draw);
        assert_ne!(own.stats.scene_bytes, others.stats.scene_bytes);
        let [own, others] = [own, others].map(|drawn| drawn.image);
        let what = format!("{projection:?}: {settings:?}");
        assert!(own == others, "{} of 255: {what}", 255.0 * rms_of_all(&own, &others));
        if settings.lighting == shadows.lighting {
            // Other lights take the places of those before.
            for other in [&turned, settings] {
                let [own, others] =
                    [&sampled, &listed].map(|scene| draw_on(&host.renderer, scene, &camera, other).unwrap().image);
                assert!(own == others, "{} of 255: {what}", 255.0 * rms_of_all(&own, &others));
            }
        }
        // The list of a scene that was packed from samples.
        let later = draw_on(&host.renderer, &sampled, &camera, &by_quads(settings)).unwrap().image;
        assert!(later == quads && draw(&sampled).image == own, "{what}");
        for function in [&less_of(transfer), transfer] {
            host.renderer.set_transfer(&mut sampled, function).unwrap();
            let fresh = prepare_on(&host.renderer, &volume, function, settings).unwrap();
            assert!(draw(&sampled).image == draw(&fresh).image, "{what}");
        }
    }
}

/// Cells in shadows are made of samples, as those without, also if lists of the voxels were drawn before.
#[test]
fn cells_in_shadows_of_samples_are_those_of_lists() {
    compare_cells_in_shadows(&PROJECTIONS[1..], &[0.0]);
}

#[test]
#[ignore = "slow: 12 pictures in shadows"]
fn cells_under_turning_lights_are_those_of_lists() {
    compare_cells_in_shadows(&PROJECTIONS, &[0.0, 40.0, 0.0]);
}

fn compare_cells_in_shadows(projections: &[ProjectionKind], lights: &[f64]) {
    // Lists of few splats take less memory than samples, and are made.
    let (volume, transfer) = demo("marschner-lobb", 48);
    let host = host(Renderer::FEATURES);
    let settings = |degrees, painter| {
        let lighting = Some(studio(degrees));
        Settings { lighting, level: Level::At(1), painter, ..kinds()[0].clone() }
    };
    let quads = Painter::Quads(QuadsSettings::default());
    for &projection in projections {
        let camera = camera(20.0, projection, &volume, 40);
        let prepare = |settings: &Settings| prepare_on(&host.renderer, &volume, &transfer, settings).unwrap();
        let draw = |scene: &Scene, degrees| {
            draw_on(&host.renderer, scene, &camera, &settings(degrees, Painter::Auto)).unwrap()
        };
        let sampled = prepare(&settings(0.0, Painter::Auto));
        let at_voxels = Settings { level: Level::At(0), ..settings(0.0, quads) };
        let listed = prepare(&at_voxels);
        draw_on(&host.renderer, &listed, &camera, &at_voxels).unwrap();
        for &degrees in lights {
            let [own, others] = [&sampled, &listed].map(|scene| draw(scene, degrees).image);
            assert!(own == others, "{projection:?}, {degrees}: {} of 255", 255.0 * rms_of_all(&own, &others));
        }
        assert!(draw(&sampled, 0.0).image != draw(&sampled, 40.0).image);
        let at = frame(&host, &sampled, &camera, &settings(60.0, Painter::Auto));
        println!("{} dispatches, {} submissions, {} bytes", at.dispatches, at.submissions, at.bytes_sent);
        assert_eq!(at.waits, 0);
    }
}

/// The same function with less visible.
fn less_of(transfer: &TransferFunction) -> TransferFunction {
    let [low, high] = transfer.range();
    let moved = |p: &ControlPoint| ControlPoint { value: p.value + 0.2 * (high - low), ..*p };
    TransferFunction::new(transfer.points().iter().map(moved).collect(), transfer.unit_distance()).unwrap()
}

#[test]
fn several_layers_take_no_transfer_function() {
    let (volume, transfer) = demo("vessels", 12);
    let layer = || Layer::scalars(&volume, &transfer);
    let layers = Layers::new(layer()).with(layer()).unwrap();
    let mut scene = renderer().prepare_layers(&layers, &Settings::default()).unwrap();
    let refused = renderer().set_transfer(&mut scene, &transfer);
    assert!(matches!(refused, Err(Error::Setting { name: "transfer", .. })));
}
