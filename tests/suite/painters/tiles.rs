//! The painter `tiles` against the f64 reference and against `quads`.

use glam::{DAffine3, DMat3, DVec3};
use voxsplat::camera::{Camera, ProjectionKind, View};
use voxsplat::error::Error;
use voxsplat::kernel::{Kernel, Normalization};
use voxsplat::settings::{Interslice, Level, Model, Settings, Shading};
use voxsplat::volume::{Grid, Samples, Volume};

use crate::support::{
    by_tiles, demo, draw, draw_on, errors, exact_quads, full, headlight, look, new_renderer, picture, prepare,
    prepare_on, renderer, rms_covered, rms_of_all, transfer, two_lights, with_quads, with_tiles,
};
use crate::truth::truth;

pub(crate) fn camera(azimuth: f64, elevation: f64, zoom: f64, volume: &Volume, size: u32) -> Camera {
    look(&View { azimuth, elevation, zoom, ..View::default() }, volume, [size; 2])
}

/// A perspective camera, at this distance from the middle of the volume if one is given.
pub(crate) fn from_eye(
    [azimuth, elevation, fov]: [f64; 3],
    distance: Option<f64>,
    volume: &Volume,
    size: u32,
) -> Camera {
    let projection = ProjectionKind::Perspective { fov };
    look(&View { azimuth, elevation, projection, distance, ..View::default() }, volume, [size; 2])
}

/// The limits of the errors of colour and alpha: 1.1 to 2 times the measured errors.
///
/// The matter of a slab is merged: the error of colours is of second order in its thickness, 1 to 1.7 voxels. It is
/// largest if one colour hides another within a slab, as in thin vessels, and least in ellipsoids of nearly one colour.
/// The error of alpha comes only from the fit of footprints by polynomials.
const LIMITS: [(&str, f64, f64); 3] =
    [("marschner-lobb", 2e-3, 1e-4), ("vessels", 4e-3, 1.5e-4), ("shepp-logan", 2e-4, 2e-4)];

/// Views along an axis, between two and three of them, from behind and from below.
const VIEWS: [(f64, f64); 6] = [(0.0, 0.0), (30.0, 20.0), (45.0, 35.264), (100.0, -50.0), (215.0, 10.0), (0.0, 45.0)];

#[test]
fn a_ray_per_pixel_is_the_reference() {
    for (name, color_limit, alpha_limit) in LIMITS {
        let (volume, transfer) = demo(name, 32);
        for (azimuth, elevation) in VIEWS {
            let settings = full();
            let camera = camera(azimuth, elevation, 1.0, &volume, 48);
            let expected = truth(&volume, &transfer, &camera, &settings);
            let got = picture(&volume, &transfer, &camera, &settings);
            by_tiles(&got);
            let (color, alpha) = errors(&got.image, &expected);
            assert!(alpha < alpha_limit && color < color_limit, "{name} {azimuth} {elevation}: {color:e} {alpha:e}");
        }
    }
}

#[test]
#[ignore = "slow: 40 truths of wide kernels"]
fn kernels_reach_three_voxels_along_parallel_rays() {
    // Voxels smaller than pixels, and larger kernels.
    let grown = Settings { antialiasing: true, ..full() };
    let wide = |kernel| Settings { kernel, ..full() };
    let cases = [
        (grown.clone(), 32.0),
        (Settings { model: Model::Xray, normalization: Normalization::Peak, ..grown.clone() }, 32.0),
        (Settings { kernel: Kernel::KAISER_BESSEL, ..grown.clone() }, 30.0),
        (wide(Kernel::Gaussian { sigma: 1.3, radius: 3.0 }), 30.0),
        (wide(Kernel::KaiserBessel { radius: 2.6, alpha: 10.4 }), 30.0),
    ];
    // Along the diagonal slabs of thin vessels are 1.7 voxels thick: 4.7e-3 with the steep blob.
    for (name, limit) in [("marschner-lobb", 3e-3), ("vessels", 6e-3)] {
        let (volume, transfer) = demo(name, 24);
        for (settings, height) in &cases {
            for &(azimuth, elevation) in &VIEWS[..4] {
                let view = View { azimuth, elevation, view_height: Some(*height), ..View::default() };
                let size = if settings.antialiasing { 24 } else { 48 };
                let camera = look(&view, &volume, [size; 2]);
                let expected = truth(&volume, &transfer, &camera, settings);
                let got = picture(&volume, &transfer, &camera, settings);
                assert_eq!(got.stats.kernel_growth > 1.0, settings.antialiasing);
                let (color, alpha) = errors(&got.image, &expected);
                assert!(
                    alpha < 4e-4 && color < limit,
                    "{settings:?} {name} {azimuth} {elevation}: {color:e} {alpha:e}"
                );
            }
        }
    }
}

#[test]
fn straight_rays_are_those_that_lean_a_little() {
    compare_straight_rays(4);
}

#[test]
#[ignore = "slow: 92 pictures"]
fn straight_rays_of_every_model_are_those_that_lean_a_little() {
    compare_straight_rays(1);
}

/// Compares every `step`th kind of picture.
fn compare_straight_rays(step: usize) {
    // Straight rays compute their footprints once, other rays in every plane.
    let post = Settings { shading: Shading::Post, ..full() };
    let cases = [
        full(),
        Settings { kernel: Kernel::KAISER_BESSEL, ..full() },
        Settings { model: Model::Xray, ..full() },
        post.clone(),
        Settings { lighting: headlight(), ..post.clone() },
        Settings { model: Model::Mip, ..post },
    ];
    let (volume, transfer) = demo("vessels", 24);
    let upright = [(0.0, 0.0, 0.0, 40), (90.0, 0.0, 0.0, 40), (180.0, 0.0, 0.0, 40), (0.0, 90.0, 0.0, 40)];
    let turned = [(90.0, 0.0, 90.0, 60), (180.0, 0.0, 30.0, 40), (180.0, 0.0, 30.0, 130), (0.0, 90.0, 0.0, 91)];
    for settings in cases.into_iter().step_by(step) {
        // A maximum of scalars may belong to another voxel.
        let turned = turned.into_iter().filter(|_| settings.model != Model::Mip);
        for (azimuth, elevation, roll, size) in upright.into_iter().chain(turned) {
            let [straight, leaning] = [0.0, 1e-3].map(|degrees| {
                let (azimuth, elevation) = (azimuth + degrees, elevation - degrees);
                let camera = look(&View { azimuth, elevation, roll, ..View::default() }, &volume, [size; 2]);
                picture(&volume, &transfer, &camera, &settings).image
            });
            let pairs = straight.pixels().as_flattened().iter().zip(leaning.pixels().as_flattened());
            let worst = pairs.fold(0.0_f32, |worst, (p, q)| worst.max((p - q).abs()));
            assert!(worst < 2e-3, "{settings:?} {azimuth} {elevation} {roll} {size}: {worst:e}");
        }
    }
}

/// Views through one eye: along one axis, two and all three, from behind; (azimuth, elevation, field of view).
const EYES: [[f64; 3]; 5] =
    [[0.0, 0.0, 30.0], [30.0, 20.0, 40.0], [45.0, 0.0, 50.0], [45.0, 35.0, 70.0], [215.0, -50.0, 90.0]];

#[test]
fn rays_through_one_eye_are_those_of_the_reference() {
    for (name, color_limit, alpha_limit) in LIMITS {
        let (volume, transfer) = demo(name, 32);
        for eye in EYES {
            let settings = full();
            let camera = from_eye(eye, None, &volume, 48);
            let expected = truth(&volume, &transfer, &camera, &settings);
            let got = picture(&volume, &transfer, &camera, &settings);
            assert_eq!(got.stats.painter.name(), "tiles");
            let (color, alpha) = errors(&got.image, &expected);
            assert!(alpha < alpha_limit && color < color_limit, "{name} {eye:?}: {color:e} {alpha:e}");
        }
    }
}

#[test]
#[ignore = "slow: 36 truths of wide kernels"]
fn kernels_grow_with_their_depth_before_an_eye() {
    let grown = Settings { antialiasing: true, ..full() };
    let wide = Kernel::Gaussian { sigma: 1.3, radius: 3.0 };
    // Growths from 1 in front to 1.5 behind, or 1 up to the middle; some kernels are wide and do not grow.
    let cases = [
        (grown.clone(), 24.0),
        (grown.clone(), 19.0),
        (Settings { model: Model::Xray, normalization: Normalization::Peak, ..grown.clone() }, 24.0),
        (Settings { kernel: Kernel::KAISER_BESSEL, ..grown.clone() }, 22.0),
        (Settings { lighting: headlight(), ..grown.clone() }, 24.0),
        (Settings { kernel: wide, ..full() }, 24.0),
    ];
    // Along the diagonal slabs are 1.7 voxels thick.
    for (name, limit) in [("marschner-lobb", 3e-3), ("vessels", 6e-3)] {
        let (volume, transfer) = demo(name, 24);
        for (settings, height) in &cases {
            for [azimuth, elevation] in [[30.0, 20.0], [45.0, 35.264], [190.0, -10.0]] {
                let projection = ProjectionKind::Perspective { fov: 30.0 };
                let view = View { azimuth, elevation, projection, view_height: Some(*height), ..View::default() };
                let camera = look(&view, &volume, [24; 2]);
                let expected = truth(&volume, &transfer, &camera, settings);
                let got = picture(&volume, &transfer, &camera, settings);
                assert_eq!(got.stats.painter.name(), "tiles");
                assert_eq!(got.stats.kernel_growth > 1.04, settings.antialiasing, "{}", got.stats.kernel_growth);
                let (color, alpha) = errors(&got.image, &expected);
                assert!(
                    alpha < 4e-4 && color < limit,
                    "{settings:?} {name} {azimuth} {elevation}: {color:e} {alpha:e}"
                );
            }
        }
    }
}

#[test]
#[ignore = "slow: 16 post-shaded truths of wide kernels"]
fn scalars_of_kernels_that_grew_err_about_as_little_as_by_quads() {
    let post = Settings { shading: Shading::Post, antialiasing: true, ..full() };
    let narrow = Settings { kernel: Kernel::Gaussian { sigma: 0.8, radius: 1.5 }, ..post.clone() };
    let cases = [
        (narrow, ProjectionKind::Orthographic, 32.0),
        (post.clone(), ProjectionKind::Orthographic, 32.0),
        (Settings { lighting: headlight(), ..post.clone() }, ProjectionKind::Orthographic, 46.0),
        (post.clone(), ProjectionKind::Perspective { fov: 30.0 }, 34.0),
        (Settings { lighting: headlight(), ..post.clone() }, ProjectionKind::Perspective { fov: 60.0 }, 24.0),
    ];
    for name in ["marschner-lobb", "shell"] {
        let (volume, transfer) = demo(name, 24);
        for (settings, projection, height) in &cases {
            for [azimuth, elevation] in [[30.0, 20.0], [190.0, -10.0]] {
                let view =
                    View { azimuth, elevation, projection: *projection, view_height: Some(*height), ..View::default() };
                let camera = look(&view, &volume, [24; 2]);
                let expected = truth(&volume, &transfer, &camera, settings);
                let [ours, by_quads] = [settings, &Settings { painter: exact_quads().painter, ..settings.clone() }]
                    .map(|settings| picture(&volume, &transfer, &camera, settings));
                let growth = ours.stats.kernel_growth;
                assert_eq!(ours.stats.painter.name(), "tiles");
                assert!(growth > 1.3 && growth <= 2.0, "{growth}");
                let [ours, by_quads] = [ours, by_quads].map(|got| rms_covered(&got.image, &expected));
                // Parts of kernels are fits, and sheets of quads exact means; a slab is lit by the gradient in its
                // middle, a sheet by one gradient in each half.
                let share = if settings.lighting.is_some() { 3.5 } else { 1.8 };
                println!("{name} {projection:?} {azimuth} {growth:.2}: {ours:.1e}, quads {by_quads:.1e}");
                assert!(ours < share * by_quads, "{name} {projection:?} {azimuth}: {ours:e} {by_quads:e}");
            }
        }
    }
}

#[test]
#[ignore = "slow: 30 post-shaded truths"]
fn scalars_are_classified_about_as_well_as_by_quads() {
    let post = Settings { shading: Shading::Post, ..full() };
    // A share of quads' error, and a limit for each volume: one and a half times the measured error. Halves of sheets
    // are lit separately, and their means are exact: tiles errs 1.55 times as much as quads, lit 2.75 times, and with
    // the blob 0.72 times. Slabs are thinner than sheets, and their means less exact if kernels end in a jump. A slab
    // is lit by the gradient in its middle, a sheet by one in each half. In many pixels the largest value of a ray lies
    // at a jump, as in marschner-lobb.
    let cases = [
        (post.clone(), 1.7, [2.7e-3, 1.6e-3]),
        (Settings { interslice: Interslice::Mean, ..post.clone() }, 1.2, [2.8e-3, 2.6e-3]),
        (Settings { lighting: headlight(), ..post.clone() }, 3.0, [7.7e-3, 2.8e-3]),
        (Settings { model: Model::Mip, ..post.clone() }, 1.2, [0.1, 4.4e-3]),
        (Settings { kernel: Kernel::KAISER_BESSEL, ..post }, 0.8, [5.4e-4, 2.3e-3]),
    ];
    for (settings, of_quads, alone) in cases {
        for (name, limit) in ["marschner-lobb", "vessels"].into_iter().zip(alone) {
            let (volume, transfer) = demo(name, 24);
            let cameras = [
                camera(100.0, -50.0, 1.0, &volume, 36),
                from_eye([45.0, 35.0, 60.0], None, &volume, 36),
                // The eye is inside the volume.
                from_eye([10.0, 5.0, 100.0], Some(6.0), &volume, 36),
            ];
            let squares = cameras.map(|camera| {
                let expected = truth(&volume, &transfer, &camera, &settings);
                let quads = with_quads(&settings, |_| ());
                let got = picture(&volume, &transfer, &camera, &settings);
                assert_eq!(got.stats.painter.name(), "tiles");
                [&got, &picture(&volume, &transfer, &camera, &quads)].map(|r| rms_of_all(&r.image, &expected).powi(2))
            });
            let [tiles, quads] = [0, 1].map(|painter| (squares.iter().map(|s| s[painter]).sum::<f64>() / 3.0).sqrt());
            assert!(tiles < of_quads * quads && tiles < limit, "{settings:?} {name}: {tiles:e}, quads {quads:e}");
        }
    }
}

#[test]
fn scalars_fill_their_box_and_what_shows_everywhere_shows() {
    // Opaque at the base too: a uniform box.
    let grid = Grid::axis_parallel([12, 10, 14], [1.0; 3]).unwrap();
    let volume = Volume::new(grid, Samples::F32(vec![0.25; 12 * 10 * 14])).unwrap();
    let transfer = transfer(&[(0.0, [0.2, 0.4, 0.8], 0.1), (1.0, [0.2, 0.4, 0.8], 0.1)], None);
    for model in [Model::Composite, Model::Mip] {
        let settings = Settings { model, shading: Shading::Post, ..full() };
        for camera in [camera(30.0, 20.0, 1.0, &volume, 48), from_eye([30.0, 20.0, 50.0], None, &volume, 48)] {
            let expected = truth(&volume, &transfer, &camera, &settings);
            let got = picture(&volume, &transfer, &camera, &settings);
            let (color, alpha) = errors(&got.image, &expected);
            assert!(
                got.stats.painter.name() == "tiles" && alpha < 1e-4 && color < 1e-4,
                "{model:?} {color:e} {alpha:e}"
            );
            assert!(got.image.pixels()[48 * 24 + 24][3] > 0.5);
        }
    }
}

#[test]
fn every_model_that_is_served_follows_the_reference() {
    let (volume, transfer) = demo("marschner-lobb", 32);
    let base = full();
    let cases = [
        base.clone(),
        Settings { model: Model::Xray, ..base.clone() },
        Settings { lighting: two_lights(), ..base.clone() },
        Settings { kernel: Kernel::KAISER_BESSEL, ..base.clone() },
        Settings {
            kernel: Kernel::Gaussian { sigma: 0.7, radius: 1.6 },
            normalization: Normalization::Peak,
            ..base.clone()
        },
    ];
    let oblong = View { azimuth: 30.0, elevation: 20.0, ..View::default() };
    let cameras = [
        camera(30.0, 20.0, 1.0, &volume, 48),
        camera(30.0, 20.0, 3.0, &volume, 48),
        from_eye([40.0, 30.0, 60.0], None, &volume, 48),
        look(&oblong, &volume, [70, 33]),
    ];
    for settings in cases {
        for camera in cameras {
            let expected = truth(&volume, &transfer, &camera, &settings);
            let got = picture(&volume, &transfer, &camera, &settings);
            assert_eq!(got.stats.painter.name(), "tiles");
            let (color, alpha) = errors(&got.image, &expected);
            // A slab is 1.2 voxels thick, which is much of a narrow kernel: it errs by 4.7e-3, others by 9.2e-4.
            // A single sum has no slabs. Alpha errs by the fit of footprints by polynomials: 9.4e-5.
            let narrow = settings.kernel.radius() < 2.0;
            let limit = if settings.model == Model::Xray { 1.5e-4 } else { [1.5e-3, 6e-3][usize::from(narrow)] };
            assert!(alpha < 1.5e-4 && color < limit, "{settings:?} {camera:?}: {color:e} {alpha:e}");
        }
    }
}

#[test]
fn grids_may_be_anisotropic_sheared_and_cropped() {
    let (volume, transfer) = demo("marschner-lobb", 24);
    let shear = DMat3::from_cols(DVec3::X, DVec3::new(0.3, 1.0, 0.0), DVec3::new(-0.2, 0.1, 1.7));
    for matrix in [DMat3::from_diagonal(DVec3::new(1.0, 1.5, 2.0)), shear] {
        let grid = Grid::new(volume.grid().dims(), DAffine3::from_mat3(matrix)).unwrap();
        let volume = volume.clone().with_grid(grid).unwrap();
        for (azimuth, elevation) in [(30.0, 20.0), (70.0, 40.0)] {
            let settings = full();
            let camera = camera(azimuth, elevation, 1.5, &volume, 80);
            let expected = truth(&volume, &transfer, &camera, &settings);
            let (color, alpha) = errors(&picture(&volume, &transfer, &camera, &settings).image, &expected);
            assert!(alpha < 5e-4 && color < 4e-3, "{matrix} {azimuth}: {color:e} {alpha:e}");
        }
    }
}

#[test]
fn termination_is_bounded_and_repeats_are_equal() {
    let (volume, _) = demo("sphere", 48);
    let transfer = transfer(&[(0.2, [0.1, 0.3, 1.0], 0.0), (0.5, [1.0; 3], 0.9)], None);
    let exact = full();
    let camera = camera(30.0, 20.0, 1.0, &volume, 96);
    let scene = prepare(&volume, &transfer, &exact);
    let whole = draw(&scene, &camera, &exact).image;
    let settings = Settings { termination: 1e-2, ..exact.clone() };
    let (color, alpha) = errors(&draw(&scene, &camera, &settings).image, &whole);
    assert!(color.max(alpha) < 1e-2 && color > 0.0, "{color:e} {alpha:e}");
    assert!(draw(&scene, &camera, &exact).image.pixels() == whole.pixels());
}

#[test]
fn auto_takes_tiles_where_they_serve_and_says_why_not() {
    let (volume, transfer) = demo("marschner-lobb", 24);
    let auto = Settings::default();
    let scene = prepare(&volume, &transfer, &auto);
    let near = camera(30.0, 20.0, 1.0, &volume, 64);
    let stats = |settings: &Settings, camera| draw_on(&renderer(), &scene, camera, settings).map(|r| r.stats);
    assert_eq!(stats(&auto, &near).unwrap().painter.name(), "tiles");
    let inside = from_eye([0.0, 0.0, 60.0], Some(5.0), &volume, 64);
    let far = camera(30.0, 20.0, 0.2, &volume, 64);
    let cases = [
        (auto.clone(), &inside, "eye"),
        (Settings { level: Level::At(0), ..auto.clone() }, &far, "grow"),
        // Cells may stand for voxels with a kernel so wide.
        (
            Settings { kernel: Kernel::Gaussian { sigma: 1.0, radius: 4.2 }, level: Level::At(0), ..auto.clone() },
            &near,
            "at most 4",
        ),
    ];
    for (settings, camera, word) in cases {
        let got = stats(&settings, camera).unwrap();
        assert_eq!(got.painter.name(), "quads", "{word}");
        assert!(got.painter_reason.contains(word), "{}", got.painter_reason);
        match stats(&with_tiles(&settings), camera) {
            Err(Error::Setting { name: "painter", reason }) => assert!(reason.contains(word), "{reason}"),
            other => panic!("{word}: {other:?}"),
        }
    }
    let quads = stats(&with_quads(&auto, |_| ()), &near).unwrap();
    assert_eq!((quads.painter.name(), quads.painter_reason.as_str()), ("quads", "requested"));
    let post = Settings { shading: Shading::Post, ..auto };
    let scene = prepare(&volume, &transfer, &post);
    assert_eq!(draw(&scene, &near, &post).stats.painter.name(), "tiles");
}

/// All axes read the same box.
#[test]
fn turning_packs_the_volume_once() {
    let (volume, transfer) = demo("marschner-lobb", 48);
    let settings = full();
    // Its own, for nobody else to be counted.
    let renderer = new_renderer();
    let scene = prepare_on(&renderer, &volume, &transfer, &settings).unwrap();
    let packs = |azimuth: f64, first: bool| {
        let camera = camera(azimuth, 20.0, 1.0, &volume, 96);
        let stats = draw_on(&renderer, &scene, &camera, &settings).unwrap().stats;
        let packs = stats.stages.iter().any(|s| s.name == "pack");
        // Marches send uniforms, mostly tables of sections. The first picture may send the splats.
        let most = 12_000 + if first { stats.scene_bytes } else { 0 };
        assert!(stats.bytes_sent < most, "{} of {most}", stats.bytes_sent);
        packs
    };
    // A GPU without timestamps lists no stages; the sent bytes are still compared.
    let listed = packs(25.0, true);
    assert!(listed || !renderer.adapter().is_software(), "the host has a clock");
    assert!([10.0, 35.0, 120.0].iter().all(|&azimuth| !packs(azimuth, false)));
}

#[test]
fn eyes_after_the_first_pack_nothing_and_change_no_byte() {
    let (volume, transfer) = demo("vessels", 96);
    let renderer = new_renderer();
    // Rays of each eye reach a part of the bricks.
    let eyes = [0.0, 2.0, 4.0, -3.0].map(|azimuth| from_eye([azimuth, 1.0, 12.0], Some(150.0), &volume, 48));
    let lit = Settings { lighting: headlight(), ..full() };
    let post = Settings { shading: Shading::Post, ..lit.clone() };
    for (settings, stays) in [(full(), true), (lit, false), (post, true)] {
        let prepare = || prepare_on(&renderer, &volume, &transfer, &settings).unwrap();
        let scene = prepare();
        for (number, eye) in eyes.iter().enumerate() {
            let got = draw_on(&renderer, &scene, eye, &settings).unwrap();
            let packs = got.stats.stages.iter().any(|stage| stage.name == "pack");
            assert!(!packs || number == 0 || !stays, "eye {number}");
            let alone = draw_on(&renderer, &prepare(), eye, &settings).unwrap();
            assert!(got.image == alone.image, "eye {number} {:?}", settings.shading);
        }
    }
}

#[test]
fn packing_over_another_light_leaves_nothing_of_it() {
    // Its own, for nobody else to be counted.
    let renderer = new_renderer();
    for name in ["marschner-lobb", "vessels"] {
        let (volume, transfer) = demo(name, 48);
        let settings = |lighting| Settings { lighting, ..full() };
        let scene = prepare_on(&renderer, &volume, &transfer, &settings(headlight())).unwrap();
        let cameras = [
            camera(25.0, 20.0, 1.0, &volume, 64),
            camera(10.0, 20.0, 1.0, &volume, 64),
            from_eye([25.0, 20.0, 30.0], None, &volume, 64),
            from_eye([12.0, 15.0, 30.0], None, &volume, 64),
        ];
        let mut made = Vec::new();
        for (lighting, camera) in [headlight(), two_lights()].iter().flat_map(|l| cameras.iter().map(move |c| (l, c))) {
            let settings = settings(lighting.clone());
            let turned = draw_on(&renderer, &scene, camera, &settings).unwrap();
            let expected = picture(&volume, &transfer, camera, &settings);
            assert_eq!(turned.image.pixels(), expected.image.pixels(), "{name}");
            made.push((turned.stats.frame_bytes, by_tiles(&turned).packed_bytes));
        }
        // A headlight turns with the eye: the second picture makes no textures of voxels.
        let [(first, packed), (second, _), ..] = made[..] else { panic!("eight pictures") };
        assert!(second + packed / 2 < first, "{second} {packed} {first}");
    }
}

#[test]
fn nothing_to_see_is_a_clear_picture() {
    let (volume, _) = demo("sphere", 16);
    let transfer = transfer(&[(500.0, [1.0; 3], 0.0), (600.0, [1.0; 3], 0.5)], None);
    let got = picture(&volume, &transfer, &camera(0.0, 0.0, 1.0, &volume, 16), &full());
    assert!(got.image.pixels().iter().all(|p| *p == [0.0; 4]) && by_tiles(&got).rays == 0);
}
