//! Solids: matter behind them is cut ray by ray, and depths of matter come back.

use glam::DVec3;
use voxsplat::Frame;
use voxsplat::camera::Camera;
use voxsplat::clip::{Clip, Plane};
use voxsplat::image::{DepthMap, Image};
use voxsplat::kernel::Kernel;
use voxsplat::layers::Layers;
use voxsplat::lighting::{Light, Lighting};
use voxsplat::settings::{Level, Model, Painter, Settings, Shading, Sheets};
use voxsplat::solids::{Mesh, Solid, Solids};
use voxsplat::volume::Grid;

use crate::support::{PROJECTIONS, camera, demo, engines, full, new_renderer, prepare_on, with_quads, with_tiles};
use crate::truth::truth;

/// The depths of a plane in the pixels of some columns.
fn depths_of_plane(camera: &Camera, point: DVec3, normal: DVec3, columns: std::ops::Range<u32>) -> DepthMap {
    let [width, height] = camera.size;
    let depth = |x: u32, y: u32| {
        if !columns.contains(&x) {
            return f32::INFINITY;
        }
        let (sx, sy) = camera.image_coordinates([x, y]);
        let (origin, direction) = camera.ray(sx, sy);
        let place = origin + direction * ((point - origin).dot(normal) / direction.dot(normal));
        (place - camera.eye().unwrap_or(camera.target)).dot(camera.forward) as f32
    };
    let depths = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| depth(x, y)).collect();
    DepthMap::new(width, height, depths).unwrap()
}

fn largest(a: &Image, b: &Image, columns: impl Fn(u32) -> bool) -> f32 {
    let width = a.width();
    let pixels = (0_u32..).zip(a.pixels().iter().zip(b.pixels())).filter(|(index, _)| columns(index % width));
    pixels.flat_map(|(_, (a, b))| (0..4).map(|c| (a[c] - b[c]).abs())).fold(0.0, f32::max)
}

/// Models, kinds of shading and kernels, by each painter.
fn settings() -> Vec<(&'static str, Settings)> {
    let lit = Some(Lighting { lights: vec![Light::HEADLIGHT], ..Lighting::default() });
    let base = Settings { antialiasing: false, level: Level::At(0), termination: 0.0, ..Settings::default() };
    let models = [
        ("pre lit", Settings { lighting: lit.clone(), ..base.clone() }),
        ("wide", Settings { kernel: Kernel::Gaussian { sigma: 1.2, radius: 3.0 }, ..base.clone() }),
        ("xray", Settings { model: Model::Xray, ..base.clone() }),
        ("post", Settings { shading: Shading::Post, ..base.clone() }),
        ("post lit", Settings { shading: Shading::Post, lighting: lit, ..base.clone() }),
        ("mip", Settings { model: Model::Mip, ..base.clone() }),
        ("average", Settings { model: Model::Average, ..base }),
    ];
    let painters = |(name, settings): &(&'static str, Settings)| {
        let cpu = Settings { painter: Painter::Cpu, ..settings.clone() };
        [(*name, cpu), (*name, with_quads(settings, |_| {})), (*name, with_tiles(settings))]
    };
    models.iter().flat_map(painters).collect()
}

#[test]
fn matter_behind_a_plane_is_cut_in_its_pixels_alone() {
    cut_by_plane(1, 5);
}

#[test]
#[ignore = "slow: two volumes by every painter in every model, through an eye too"]
fn matter_behind_a_plane_is_cut_in_its_pixels_alone_in_every_model() {
    cut_by_plane(2, 1);
}

/// Cuts the first `most` volumes through as many projections, in every `step`th kind of picture.
fn cut_by_plane(most: usize, step: usize) {
    let [device, host] = engines();
    // Thin matter in voxels ten times as long along z.
    let (long, thin) = demo("sphere", 24);
    let long = long.with_grid(Grid::axis_parallel([24; 3], [1.0, 1.0, 10.0]).unwrap()).unwrap();
    let scenes = [demo("vessels", 24), (long, thin)];
    let normal = DVec3::new(0.3, 0.9, -0.2).normalize();
    let projections = PROJECTIONS.into_iter().take(most);
    let all = projections.flat_map(|projection| scenes.iter().take(most).map(move |scene| (projection, scene)));
    for (projection, (volume, transfer)) in all {
        let center = volume.grid().center();
        let seen = camera(30.0, projection, volume, 48);
        let solids = Solids { depths: depths_of_plane(&seen, center, normal, 24..48), image: None };
        // The side of the eye is kept.
        let towards = if seen.forward.dot(normal) > 0.0 { -normal } else { normal };
        let clip = Clip::new(vec![Plane::through(center, towards).unwrap()]).unwrap();
        for (name, settings) in settings().into_iter().step_by(step) {
            let engine = if settings.painter == Painter::Cpu { &host } else { &device };
            let scene = engine.prepare_layers(&Layers::of_volume(volume, transfer), &settings).unwrap();
            let draw = |settings: &Settings, solids: Option<&Solids>| {
                engine.render(&scene, &Frame::new(&seen, settings).solids(solids)).unwrap().image
            };
            let cut = draw(&settings, Some(&solids));
            let uncut = draw(&settings, None);
            let clipped = Settings { clip: clip.clone(), ..settings.clone() };
            let by_clip = draw(&clipped, None);
            let at = format!("{projection:?} {name} {:?} {:?}", volume.grid().spacing(), settings.painter);
            let outside = largest(&cut, &uncut, |x| x < 24);
            assert!(outside <= 1e-6, "{at}: {outside:e} beside the solid");
            let inside = largest(&cut, &by_clip, |x| x >= 24);
            // The places of cuts are rounded otherwise: measured up to 2.2e-5.
            assert!(inside <= 4e-5, "{at}: {inside:e} before the solid");
            let changed = largest(&cut, &uncut, |x| x >= 24);
            // The mean shows little of this transfer function.
            assert!(changed > 2e-2 || settings.model == Model::Average, "{at}: {changed:e} is cut");
            // The truth, whose error is that of a picture with a clipping plane.
            let expected = truth(volume, transfer, &seen, &clipped);
            let [error, usual] = [&cut, &by_clip].map(|image| largest(image, &expected, |x| x >= 24));
            assert!(error <= usual + 4e-5, "{at}: {error:e}, a clipping plane {usual:e}");
        }
    }
}

#[test]
fn rays_that_end_at_their_depth_keep_half_of_their_light() {
    let [device, host] = engines();
    for (projection, name) in PROJECTIONS.into_iter().flat_map(|p| [(p, "vessels"), (p, "shepp-logan")]) {
        let (volume, transfer) = demo(name, 32);
        let seen = camera(30.0, projection, &volume, 64);
        let painters = [with_quads(&full(), |_| {}), full(), Settings { painter: Painter::Cpu, ..full() }];
        let all = painters.iter().flat_map(|settings| [Shading::Pre, Shading::Post].map(|shading| (settings, shading)));
        for (settings, shading) in all {
            let settings = Settings { shading, termination: 0.0, ..settings.clone() };
            let engine = if settings.painter == Painter::Cpu { &host } else { &device };
            let scene = engine.prepare_layers(&Layers::of_volume(&volume, &transfer), &settings).unwrap();
            let depths = engine.depths(&scene, &Frame::new(&seen, &settings)).unwrap();
            let alpha = |image: &Image| image.pixels().iter().map(|pixel| pixel[3]).collect::<Vec<f32>>();
            let draw =
                |solids: Option<&Solids>| engine.render(&scene, &Frame::new(&seen, &settings).solids(solids)).unwrap();
            let all = alpha(&draw(None).image);
            let painter = settings.painter;
            let before = draw(Some(&Solids { depths: depths.clone(), image: None }));
            let (mut count, mut sum, mut most) = (0, 0.0, 0.0_f32);
            for ((depth, all), half) in depths.depths().iter().zip(all).zip(alpha(&before.image)) {
                assert_eq!(
                    depth.is_finite(),
                    all >= 0.5,
                    "{name} {projection:?} {shading:?} {painter:?}: {depth} {all}"
                );
                if depth.is_finite() {
                    count += 1;
                    sum += (half - 0.5).powi(2);
                    most = most.max((half - 0.5).abs());
                }
            }
            let rms = (sum / count.max(1) as f32).sqrt();
            // Within a slab the extinction counts as constant: measured up to 6.4e-3 and 2.2e-2.
            let at = format!("{name} {projection:?} {shading:?} {painter:?}: {count} pixels, {rms:.1e}, {most:.1e}");
            assert!(count > 5 && rms < 1e-2 && most < 4e-2, "{at}");
            println!("{at}");
        }
    }
}

/// A square across the ray through the middle of the picture, which covers its right half.
fn half_plane(camera: &Camera, center: DVec3, half: f64) -> Mesh {
    let corner = |x: f64, y: f64| (center + camera.right * x + camera.up * y).as_vec3().to_array();
    Mesh {
        vertices: vec![corner(0.0, -half), corner(half, -half), corner(half, half), corner(0.0, half)],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    }
}

#[test]
fn a_plane_half_through_a_ball_changes_only_pixels_behind_it() {
    let [device, host] = engines();
    let (volume, transfer) = demo("sphere", 32);
    let center = volume.grid().center();
    // Splines follow the default kernel, which jumps at its rim, less exactly.
    let painters = [(&device, full(), 1e-3), (&host, full(), 2e-3)];
    let all = PROJECTIONS.into_iter().flat_map(|projection| painters.iter().map(move |of| (projection, of)));
    for (projection, (engine, settings, most)) in all {
        let seen = camera(30.0, projection, &volume, 64);
        let solid = Solid { mesh: half_plane(&seen, center, 1e3), color: [0.2, 0.4, 0.6] };
        let settings = Settings { antialiasing: false, level: Level::At(0), ..settings.clone() };
        let scene = engine.prepare_layers(&Layers::of_volume(&volume, &transfer), &settings).unwrap();
        let solids = Solids::of_meshes(&[solid], &seen, None).unwrap();
        let draw =
            |solids: Option<&Solids>| engine.render(&scene, &Frame::new(&seen, &settings).solids(solids)).unwrap();
        let (picture, without) = (draw(Some(&solids)).image, draw(None).image);
        // The edge of the plane lies on the line between the columns 31 and 32.
        let beside = largest(&picture, &without, |x| x < 32);
        assert!(beside <= 1e-6, "{projection:?}: {beside:e} beside the plane");
        let clip = Clip::new(vec![Plane::through(center, -seen.forward).unwrap()]).unwrap();
        let before = truth(&volume, &transfer, &seen, &Settings { clip, ..settings });
        let surfaces = solids.image.unwrap();
        let expected = before.over(&surfaces).unwrap();
        let error = largest(&picture, &expected, |x| x >= 32);
        println!("{projection:?}: {error:e}");
        assert!(error < *most, "{projection:?}: {error:e}");
        assert!(largest(&picture, &without, |x| x >= 32) > 0.1, "{projection:?}: the plane does not show");
    }
}

#[test]
fn pictures_without_depths_are_refused() {
    let renderer = new_renderer();
    let (volume, transfer) = demo("sphere", 12);
    let seen = camera(30.0, PROJECTIONS[0], &volume, 16);
    let axis = with_quads(&Settings::default(), |quads| quads.sheets = Sheets::Axis);
    for settings in [Settings { model: Model::Xray, ..Settings::default() }, axis] {
        let scene = prepare_on(&renderer, &volume, &transfer, &settings).unwrap();
        let error = renderer.depths(&scene, &Frame::new(&seen, &settings)).unwrap_err().to_string();
        assert!(error.contains("has depths"), "{error}");
    }
    let scene = prepare_on(&renderer, &volume, &transfer, &Settings::default()).unwrap();
    let small = DepthMap::new(2, 2, vec![1.0; 4]).unwrap();
    let error = renderer.render(&scene, &Frame::new(&seen, &Settings::default()).before(&small)).unwrap_err();
    assert!(error.to_string().contains("2 x 2 pixels, expected 16 x 16"), "{error}");
}
