//! Pictures against the f64 reference, and changes that must not alter a picture.

use glam::{DAffine3, DMat3, DQuat, DVec3};
use voxsplat::Frame;
use voxsplat::camera::{Camera, ProjectionKind, View};
use voxsplat::image::Region;
use voxsplat::kernel::{Kernel, Normalization};
use voxsplat::settings::{Level, Precision, Settings, Shading};
use voxsplat::volume::{Grid, Samples, Volume};

use crate::support::{
    PERSPECTIVE, PROJECTIONS, by_quads, camera, demo, draw, draw_on, errors, exact_quads, headlight, look, picture,
    prepare, render, renderer, thick, transfer, with_quads, with_tiles,
};
use crate::truth::truth;

#[test]
fn alpha_is_exact_at_every_thickness_and_colour_converges() {
    for name in ["marschner-lobb", "sphere", "vessels", "shepp-logan"] {
        let (volume, transfer) = demo(name, 32);
        for projection in PROJECTIONS {
            let camera = camera(33.0, projection, &volume, 40);
            let expected = truth(&volume, &transfer, &camera, &exact_quads());
            let error = |thickness| {
                let settings = thick(&exact_quads(), thickness);
                let (color, alpha) = errors(&render(&volume, &transfer, &camera, &settings), &expected);
                assert!(alpha < 5e-5, "{name} {projection:?} thickness {thickness}: alpha errs by {alpha:e}");
                color
            };
            let [half, one, two] = [0.5, 1.0, 2.0].map(error);
            assert!(one < 4e-3, "{name} {projection:?}: colour errs by {one:e}");
            // Second order: four times less for half the thickness. Below 2e-4 rounding blurs the ratio.
            assert!(half < one / 2.5 + 2e-4, "{name} {projection:?}: {half:e} at 0.5, {one:e} at 1");
            assert!(one < two / 2.0 + 2e-4, "{name} {projection:?}: {one:e} at 1, {two:e} at 2");
        }
    }
}

#[test]
fn anisotropic_and_sheared_grids_are_as_exact() {
    let (volume, transfer) = demo("marschner-lobb", 24);
    let matrices = [
        DMat3::from_diagonal(DVec3::new(1.0, 1.0, 4.0)),
        DMat3::from_cols(DVec3::X, DVec3::new(0.3, 1.0, 0.1), DVec3::new(0.2, -0.4, 1.5)),
        // Left-handed, in a unit a thousand times smaller and far from the origin.
        DMat3::from_diagonal(DVec3::new(-1e-3, 1e-3, 2e-3)),
    ];
    for (index, matrix) in matrices.into_iter().enumerate() {
        let origin = if index == 2 { DVec3::splat(50.0) } else { DVec3::ZERO };
        let grid = Grid::new([24; 3], DAffine3::from_mat3_translation(matrix, origin)).unwrap();
        let volume = volume.clone().with_grid(grid).unwrap();
        for projection in PROJECTIONS {
            let camera = camera(50.0, projection, &volume, 40);
            let expected = truth(&volume, &transfer, &camera, &exact_quads());
            // Second order in the thickness: the measured errors are 2.9e-4, 1.1e-3 and 4.2e-3.
            for (thickness, limit) in [(0.5, 5e-4), (1.0, 2e-3), (2.0, 7e-3)] {
                let settings = thick(&exact_quads(), thickness);
                let (color, alpha) = errors(&render(&volume, &transfer, &camera, &settings), &expected);
                assert!(alpha < 5e-6, "grid {index} {projection:?} {thickness}: alpha errs by {alpha:e}");
                assert!(color < limit, "grid {index} {projection:?} {thickness}: colour errs by {color:e}");
            }
        }
    }
}

#[test]
fn kernels_and_normalisations_follow_the_reference() {
    let (volume, transfer) = demo("vessels", 32);
    let kernels = [
        Kernel::KAISER_BESSEL,
        Kernel::Gaussian { sigma: 0.7, radius: 1.5 },
        Kernel::Gaussian { sigma: 1.2, radius: 3.3 },
        Kernel::KaiserBessel { radius: 2.5, alpha: 6.0 },
    ];
    for kernel in kernels {
        for normalization in [Normalization::Unit, Normalization::Peak] {
            let settings = thick(&Settings { kernel, normalization, ..exact_quads() }, 0.5);
            let camera = camera(10.0, PERSPECTIVE, &volume, 40);
            let expected = truth(&volume, &transfer, &camera, &settings);
            let (color, alpha) = errors(&render(&volume, &transfer, &camera, &settings), &expected);
            assert!(alpha < 5e-5, "{kernel:?} {normalization:?}: alpha errs by {alpha:e}");
            // Peak normalisation is twelve times denser: more matter lies within a sheet.
            let allowed = if normalization == Normalization::Unit { 4e-3 } else { 3e-2 };
            assert!(color < allowed, "{kernel:?} {normalization:?}: colour errs by {color:e}");
        }
    }
}

#[test]
fn a_camera_inside_the_volume_sees_what_is_in_front_of_it() {
    let (volume, transfer) = demo("marschner-lobb", 24);
    for distance in [0.1, 3.0, 9.0] {
        let projection = ProjectionKind::Perspective { fov: 70.0 };
        let view = View { azimuth: 20.0, projection, distance: Some(distance), ..View::default() };
        let settings = exact_quads();
        let camera = look(&view, &volume, [32; 2]);
        let expected = truth(&volume, &transfer, &camera, &settings);
        let (color, alpha) = errors(&render(&volume, &transfer, &camera, &settings), &expected);
        assert!(alpha < 5e-5 && color < 8e-3, "{distance}: alpha {alpha:e}, colour {color:e}");
    }
}

#[test]
fn a_distant_eye_sees_the_parallel_picture() {
    let (volume, transfer) = demo("vessels", 32);
    let settings = exact_quads();
    let parallel = View { view_height: Some(40.0), ..View::default() };
    // 1e7 voxels away: f32 coordinates from the eye would be off by a voxel.
    let distant =
        View { projection: ProjectionKind::Perspective { fov: 30.0 }, distance: Some(1e7), ..parallel.clone() };
    let [a, b] = [parallel, distant].map(|view| render(&volume, &transfer, &look(&view, &volume, [48; 2]), &settings));
    let (color, alpha) = errors(&a, &b);
    assert!(color < 1e-4 && alpha < 1e-4, "colour {color:e}, alpha {alpha:e}");
}

#[test]
fn densities_of_any_scale_neither_overflow_nor_vanish() {
    let (volume, _) = demo("sphere", 24);
    let camera = camera(33.0, ProjectionKind::Orthographic, &volume, 32);
    let color = [0.9, 0.6, 0.3];
    for unit in [1e-3, 1.0, 1e6] {
        for opacity in [1e-5, 1.0] {
            let transfer = transfer(&[(50.0, color, 0.0), (100.0, color, opacity)], Some(unit));
            let expected = truth(&volume, &transfer, &camera, &exact_quads());
            for precision in [Precision::F16, Precision::F32] {
                let settings = with_quads(&exact_quads(), |q| q.precision = Some(precision));
                let got = render(&volume, &transfer, &camera, &settings);
                // f16 with the rounding of software rasterisers: each of some fifty sums is truncated, more if kernels
                // grow.
                let relative = if precision == Precision::F16 { 1.6e-2 } else { 5e-5 };
                for (g, e) in got.pixels().iter().zip(expected.pixels()) {
                    let (g, e) = (f64::from(g[3]), f64::from(e[3]));
                    assert!(
                        (g - e).abs() <= relative * e + 1e-12,
                        "unit {unit} opacity {opacity} {precision}: {g} {e}"
                    );
                }
            }
        }
    }
}

#[test]
fn the_same_scene_gives_the_same_bytes() {
    let (volume, transfer) = demo("vessels", 48);
    let view = View { azimuth: 70.0, elevation: 25.0, projection: PERSPECTIVE, ..View::default() };
    let camera = look(&view, &volume, [64, 48]);
    let bits = || -> Vec<u32> {
        let image = render(&volume, &transfer, &camera, &Settings::default());
        image.pixels().iter().flatten().map(|v| v.to_bits()).collect()
    };
    let first = bits();
    assert!((0..3).all(|_| bits() == first));
}

#[test]
fn threads_share_a_renderer_and_a_scene() {
    const ROUNDS: usize = 60;
    let (volume, transfer) = demo("vessels", 24);
    let post = Settings { shading: Shading::Post, ..Settings::default() };
    let quads = [Settings::default(), post].map(|settings| with_quads(&settings, |_| ()));
    let tiles = quads.clone().map(|settings| with_tiles(&settings));
    let [pre, post] = quads.each_ref().map(|settings| prepare(&volume, &transfer, settings));
    let pictures = quads.iter().chain(&tiles).zip([&pre, &post, &pre, &post]);
    let cameras = [20.0, 110.0].map(|azimuth| camera(azimuth, ProjectionKind::Orthographic, &volume, 40));
    let jobs: Vec<_> = pictures.flat_map(|(settings, scene)| cameras.map(|camera| (settings, scene, camera))).collect();
    let alone: Vec<_> = jobs.iter().map(|(settings, scene, camera)| draw(scene, camera, settings).image).collect();
    // `draw` would give a thread the device of another test.
    let renderer = renderer();
    std::thread::scope(|scope| {
        for first in 0..4 {
            let (jobs, alone, renderer) = (&jobs, &alone, &renderer);
            // Each starts with another picture. Rays take turns at volumes that are packed along two axes.
            let rays = (0..ROUNDS).flat_map(|round| [4 + (first + round) % 2, 6 + (first + round) % 2]);
            let numbers: Vec<usize> = (first * 2..jobs.len()).chain(0..first * 2).chain(rays).collect();
            scope.spawn(move || {
                for number in numbers {
                    let (settings, scene, camera) = &jobs[number];
                    let drawn = draw_on(renderer, scene, camera, settings).unwrap();
                    assert!(drawn.image == alone[number], "picture {number}");
                }
            });
        }
    });
}

#[test]
fn transparent_voxels_change_nothing() {
    // The same ball with and without a margin of air.
    let ball = |size: u32| {
        let middle = f64::from(size - 1) / 2.0;
        let at = |i: u32| (f64::from(i) - middle).powi(2);
        let inside = |x, y, z| if at(x) + at(y) + at(z) < 60.0 { 90 } else { 0 };
        let samples =
            (0..size).flat_map(|z| (0..size).flat_map(move |y| (0..size).map(move |x| inside(x, y, z)))).collect();
        let grid = Grid::new([size; 3], DAffine3::from_translation(DVec3::splat(-middle))).unwrap();
        Volume::new(grid, Samples::U8(samples)).unwrap()
    };
    let color = [0.2, 0.7, 0.4];
    let transfer = transfer(&[(50.0, color, 0.0), (100.0, color, 0.2)], None);
    let view = View { azimuth: 25.0, elevation: 40.0, view_height: Some(24.0), ..View::default() };
    let settings = exact_quads();
    let [small, large] = [20, 40].map(|size| {
        let volume = ball(size);
        let camera = look(&view, &volume, [40; 2]);
        let rendered = picture(&volume, &transfer, &camera, &settings);
        (rendered.stats.splats_kept, rendered.image)
    });
    assert_eq!(small.0, large.0);
    // Sheets cut the ball elsewhere, which is invisible with one colour; sums are rounded in another order.
    let (color, alpha) = errors(&small.1, &large.1);
    assert!(alpha < 2e-6 && color < 3e-6, "colour {color:e}, alpha {alpha:e}");
}

#[test]
fn a_transparent_volume_is_the_background() {
    let (volume, _) = demo("sphere", 16);
    let transfer = transfer(&[(0.0, [1.0; 3], 0.0), (255.0, [1.0; 3], 0.0)], None);
    let camera = camera(0.0, ProjectionKind::Orthographic, &volume, 16);
    let rendered = picture(&volume, &transfer, &camera, &exact_quads());
    let (drawn, stats) = (by_quads(&rendered), rendered.stats);
    assert_eq!((stats.splats_kept, drawn.passes, drawn.quads), (0, 0, 0));
    assert!(rendered.image.pixels().iter().all(|p| *p == [0.0; 4]));
}

#[test]
fn scene_and_camera_turned_together_leave_the_picture() {
    let (volume, transfer) = demo("vessels", 32);
    let settings = exact_quads();
    let still = camera(30.0, PERSPECTIVE, &volume, 48);
    let turn = DQuat::from_scaled_axis(DVec3::new(0.7, -1.1, 0.4));
    let motion = DAffine3::from_rotation_translation(turn, DVec3::new(12.0, -7.0, 30.0));
    let grid = Grid::new([32; 3], motion * volume.grid().to_world()).unwrap();
    let moved = volume.clone().with_grid(grid).unwrap();
    let turned = Camera {
        target: motion.transform_point3(still.target),
        right: turn * still.right,
        up: turn * still.up,
        forward: turn * still.forward,
        ..still
    };
    let (color, alpha) =
        errors(&render(&volume, &transfer, &still, &settings), &render(&moved, &transfer, &turned, &settings));
    assert!(color < 1e-5 && alpha < 1e-5, "colour {color:e}, alpha {alpha:e}");
}

#[test]
#[ignore = "slow: a picture of 2103 x 2103 pixels"]
fn a_picture_made_in_parts_is_the_whole_picture() {
    // 2103^2 pixels are over 256 MiB of sheets, so they are made in several regions; 701^2 pixels are not.
    let (volume, transfer) = demo("vessels", 12);
    let scene = prepare(&volume, &transfer, &exact_quads());
    let view = View { view_height: Some(14.0), ..View::default() };
    let [large, small] = [2103, 701].map(|size| draw(&scene, &look(&view, &volume, [size; 2]), &exact_quads()));
    assert_eq!((small.stats.parts, large.stats.parts), (1, 4));
    // The middle of each small pixel is the middle of the middle one of nine large ones.
    let mut worst = 0.0_f32;
    for y in 0..701_usize {
        for x in 0..701_usize {
            let (a, b) = (small.image.pixels()[y * 701 + x], large.image.pixels()[(3 * y + 1) * 2103 + 3 * x + 1]);
            worst = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(worst, f32::max);
        }
    }
    // From 2048 pixels on the places of splats are rounded to 2^-12 of a pixel.
    assert!(worst < 2e-5, "{worst:e}");
}

#[test]
fn bricks_out_of_view_are_not_looked_at() {
    // The middle of a large picture, and that middle alone.
    let (volume, transfer) = demo("vessels", 128);
    for projection in PROJECTIONS {
        let part = |size: u32, zoom: f64| {
            let view = View { azimuth: 20.0, elevation: 10.0, zoom, projection, ..View::default() };
            picture(&volume, &transfer, &look(&view, &volume, [size; 2]), &exact_quads())
        };
        let (large, small) = (part(256, 1.0), part(64, 4.0));
        assert_eq!(by_quads(&large).splats_in_view, large.stats.splats_kept);
        let in_view = by_quads(&small).splats_in_view;
        assert!(4 * in_view < 3 * small.stats.splats_kept, "{in_view}");
        for (index, pixel) in small.image.pixels().iter().enumerate() {
            let same = large.image.pixels()[(96 + index / 64) * 256 + 96 + index % 64];
            let worst = pixel.iter().zip(same).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(worst < 1e-4, "{projection:?} {index}: {pixel:?} {same:?}");
        }
    }
}

#[test]
fn a_region_has_the_bytes_of_the_whole_picture() {
    let (volume, transfer) = demo("vessels", 48);
    let lit = Settings { lighting: headlight(), ..Settings::default() };
    let post = Settings { shading: Shading::Post, ..lit.clone() };
    let quads = with_quads(&Settings::default(), |_| {});
    let coarse = Settings { level: Level::At(1), ..Settings::default() };
    let turned =
        |azimuth: f64, zoom: f64, projection| View { azimuth, elevation: 17.0, zoom, projection, ..View::default() };
    let straight = View { zoom: 2.0, ..View::default() };
    let parallel = ProjectionKind::Orthographic;
    for (settings, view) in [
        (Settings::default(), turned(30.0, 2.0, parallel)),
        (Settings::default(), straight),
        (lit.clone(), turned(30.0, 2.0, PERSPECTIVE)),
        // Two layers of cells.
        (lit, View { distance: Some(60.0), ..turned(30.0, 0.4, PERSPECTIVE) }),
        (post.clone(), turned(120.0, 1.0, parallel)),
        (post, turned(120.0, 1.0, PERSPECTIVE)),
        (coarse, turned(44.0, 0.7, parallel)),
        (quads, turned(30.0, 1.0, PERSPECTIVE)),
    ] {
        let scene = prepare(&volume, &transfer, &settings);
        let camera = look(&view, &volume, [200, 170]);
        let whole = draw(&scene, &camera, &settings);
        for (x, y, width, height) in [(0, 0, 200, 170), (61, 83, 40, 30), (199, 0, 1, 170), (90, 70, 1, 1)] {
            let region = Region { x, y, width, height };
            let part = renderer().render(&scene, &Frame::new(&camera, &settings).region(region)).unwrap();
            assert_eq!((part.image.width(), part.image.height()), (width, height));
            for (i, pixel) in (0..).zip(part.image.pixels()) {
                let index = (y + i / width) * 200 + x + i % width;
                let of_whole = whole.image.pixels()[index as usize];
                assert_eq!(pixel.map(f32::to_bits), of_whole.map(f32::to_bits), "{region:?} {i} {view:?}");
            }
        }
        let beyond = Region { x: 180, y: 0, width: 21, height: 1 };
        let refused =
            renderer().render(&scene, &Frame::new(&camera, &settings).region(beyond)).err().unwrap().to_string();
        assert!(refused.starts_with("region: 21 x 1 pixels at (180, 0) are no part of"), "{refused}");
    }
}
