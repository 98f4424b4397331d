//! Hard cases of the painter `tiles`: dense material, distant eyes, odd lattices, volumes that outgrow its textures.

use glam::{DAffine3, DMat3, DVec3};
use voxsplat::camera::{Camera, ProjectionKind, View};
use voxsplat::image::Image;
use voxsplat::settings::{Model, Painter, Settings, Shading};
use voxsplat::transfer::{Classification, TransferFunction};
use voxsplat::volume::{Grid, Samples, Volume};

use crate::support::{
    PERSPECTIVE, PROJECTIONS, by_tiles, demo, errors, exact_quads, full, headlight, look, picture, render, renderer,
    rms_covered, transfer,
};
use crate::truth::truth;

fn oblique(projection: ProjectionKind, zoom: f64, volume: &Volume, size: u32) -> Camera {
    look(&View { azimuth: 33.0, elevation: 20.0, projection, zoom, ..View::default() }, volume, [size; 2])
}

/// From a transparent blue over red to white; an opacity of 1 is this optical depth per voxel.
fn opaque([clear, red, white]: [f64; 3], depth: f64) -> TransferFunction {
    let points = [(clear, [0.1, 0.2, 0.9], 0.0), (red, [0.8, 0.1, 0.1], 1.0), (white, [0.9, 0.95, 0.7], 1.0)];
    // Opacity 1 stands for an optical depth of 16 ln 2.
    transfer(&points, Some(16.0 * 2.0_f64.ln() / depth)).with_classification(Classification::Point)
}

fn assert_in_range(image: &Image, brightest: [f32; 3], what: &str) {
    for (index, &[r, g, b, alpha]) in image.pixels().iter().enumerate() {
        assert!((0.0..=1.0).contains(&alpha), "{what}: alpha of pixel {index} is {alpha}");
        for (color, most) in [r, g, b].into_iter().zip(brightest) {
            assert!(
                (0.0..=most * alpha * (1.0 + 1e-6)).contains(&color),
                "{what}: pixel {index} is {color} of {alpha}"
            );
        }
    }
}

#[test]
fn dense_material_is_as_right_as_by_quads() {
    // Optical depth of a voxel, and the largest error (rms of covered pixels) as a multiple of the error of quads. From
    // 69 on the fit of parts is visible, which errs by a hundredth of a kernel; at 700 such a part hides the matter
    // behind it.
    let depths = [(0.7, 1.6), (2.3, 0.8), (6.9, 1.0), (11.0, 1.1), (23.0, 1.4), (69.0, 1.5), (700.0, 2.2), (7e3, 3.5)];
    for (name, values, zoom) in [
        ("sphere", [50.0, 100.0, 255.0], 1.0),
        ("vessels", [50.0, 100.0, 255.0], 1.5),
        ("marschner-lobb", [0.2, 0.4, 1.0], 1.0),
    ] {
        let (volume, _) = demo(name, 24);
        for projection in PROJECTIONS {
            let camera = oblique(projection, zoom, &volume, 48);
            for (depth, of_quads) in depths {
                let transfer = opaque(values, depth);
                let expected = truth(&volume, &transfer, &camera, &full());
                let got = picture(&volume, &transfer, &camera, &full());
                by_tiles(&got);
                let what = format!("{name} {projection:?} {depth}");
                assert_in_range(&got.image, [0.9, 0.95, 0.9], &what);
                let (_, alpha) = errors(&got.image, &expected);
                let quads = render(&volume, &transfer, &camera, &Settings { antialiasing: false, ..exact_quads() });
                let [got, quads] = [&got.image, &quads].map(|image| 255.0 * rms_covered(image, &expected));
                // The polynomial of a footprint errs by 1e-5 of its peak, times the depth.
                assert!(alpha < 2e-4 + 1e-5 * depth, "{what}: alpha errs by {alpha:e}");
                assert!(got < of_quads * quads, "{what}: {got} of 255, quads {quads}");
            }
        }
    }
}

#[test]
fn no_extinction_is_too_much() {
    let (volume, _) = demo("sphere", 24);
    for depth in [1e-30, 1e5, 1e12, 1e30, 1e37] {
        let transfer = opaque([50.0, 100.0, 255.0], depth);
        for projection in PROJECTIONS {
            let camera = oblique(projection, 1.0, &volume, 48);
            for settings in
                [full(), Settings { model: Model::Xray, ..full() }, Settings { lighting: headlight(), ..full() }]
            {
                let got = picture(&volume, &transfer, &camera, &settings);
                by_tiles(&got);
                let what = format!("{depth:e} {projection:?} {settings:?}");
                assert_in_range(&got.image, [1.0; 3], &what);
                let middle = got.image.pixels()[24 * 48 + 24][3];
                assert!(if depth > 1.0 { middle == 1.0 } else { middle < 1e-27 }, "{what}: {middle}");
            }
        }
    }
}

#[test]
fn an_xray_of_dark_colours_is_white() {
    let (volume, _) = demo("sphere", 24);
    let dark = transfer(&[(50.0, [0.1, 0.2, 0.3], 0.0), (255.0, [0.1, 0.2, 0.3], 0.5)], None);
    for projection in PROJECTIONS {
        let settings = Settings { model: Model::Xray, ..full() };
        let got = picture(&volume, &dark, &oblique(projection, 1.0, &volume, 48), &settings);
        by_tiles(&got);
        let pixels = got.image.pixels();
        assert!(pixels.iter().any(|p| p[3] > 0.5), "{projection:?}: empty");
        let white = |p: &[f32; 4]| p[..3].iter().all(|&c| (c - p[3]).abs() < 1e-6);
        assert!(pixels.iter().all(white), "{projection:?}: not white");
    }
}

#[test]
fn one_dense_voxel_is_its_footprint() {
    let mut samples = vec![0_u8; 125];
    samples[62] = 200;
    let volume = Volume::new(Grid::axis_parallel([5; 3], [1.0; 3]).unwrap(), Samples::U8(samples)).unwrap();
    for depth in [1.0, 1e2, 1e4, 1e6] {
        let transfer = opaque([50.0, 100.0, 255.0], depth);
        for projection in PROJECTIONS {
            let camera = oblique(projection, 1.2, &volume, 48);
            let expected = truth(&volume, &transfer, &camera, &full());
            let got = render(&volume, &transfer, &camera, &full());
            let (color, alpha) = errors(&got, &expected);
            assert!(color < 1e-3 && alpha < 2e-4, "{depth:e} {projection:?}: {color:e} {alpha:e}");
        }
    }
}

#[test]
fn a_distant_eye_sees_the_parallel_picture() {
    let (volume, transfer) = demo("vessels", 24);
    let (scalars, lit) = (Settings { shading: Shading::Post, ..full() }, Settings { lighting: headlight(), ..full() });
    for settings in [full(), scalars, lit] {
        for (azimuth, elevation) in [(33.0, 20.0), (62.0, 25.0), (200.0, -70.0)] {
            let parallel = View { azimuth, elevation, view_height: Some(30.0), ..View::default() };
            let near = render(&volume, &transfer, &look(&parallel, &volume, [48; 2]), &settings);
            for distance in [1e5, 1e6, 1e7, 1e9, 1e12] {
                let view = View { projection: PERSPECTIVE, distance: Some(24.0 * distance), ..parallel.clone() };
                let got = picture(&volume, &transfer, &look(&view, &volume, [48; 2]), &settings);
                by_tiles(&got);
                let (color, alpha) = errors(&got.image, &near);
                // At 1e5 sizes the picture itself differs by 2e-5; parts of kernels are interpolated: 4e-5.
                let limit = if settings.shading == Shading::Post { 2e-3 } else { 2e-4 };
                assert!(color < limit && alpha < limit, "{azimuth} {distance:e}: colour {color:e}, alpha {alpha:e}");
            }
        }
    }
}

#[test]
fn a_field_of_view_may_be_a_ten_thousandth_of_a_degree() {
    let (volume, transfer) = demo("vessels", 24);
    for fov in [1e-2, 1e-4, 1e-6] {
        let camera = oblique(ProjectionKind::Perspective { fov }, 1.3, &volume, 48);
        let expected = truth(&volume, &transfer, &camera, &full());
        let (color, alpha) = errors(&render(&volume, &transfer, &camera, &full()), &expected);
        assert!(color < 4e-3 && alpha < 2e-4, "{fov}: colour {color:e}, alpha {alpha:e}");
    }
}

#[test]
fn neither_origin_nor_unit_of_the_lattice_matters() {
    let (volume, transfer) = demo("vessels", 24);
    let placed = |spacing: f64, origin: f64| {
        let matrix = DMat3::from_diagonal(DVec3::new(spacing, -spacing, 2.0 * spacing));
        let grid = Grid::new([24; 3], DAffine3::from_mat3_translation(matrix, DVec3::splat(origin))).unwrap();
        volume.clone().with_grid(grid).unwrap()
    };
    let cases = [
        full(),
        Settings { lighting: headlight(), ..full() },
        Settings { shading: Shading::Post, ..full() },
        Settings { shading: Shading::Post, lighting: headlight(), ..full() },
    ];
    for settings in cases {
        for projection in PROJECTIONS {
            let drawn = |spacing, origin| {
                let volume = placed(spacing, origin);
                let got = picture(&volume, &transfer, &oblique(projection, 1.3, &volume, 48), &settings);
                by_tiles(&got);
                got.image
            };
            let expected = drawn(1.0, 0.0);
            for (spacing, origin) in [(1e-6, 1e7), (1e-3, 1e9), (1e-9, 0.0), (1e9, 0.0), (1e-30, 0.0), (1e30, 0.0)] {
                let (color, alpha) = errors(&drawn(spacing, origin), &expected);
                let what = format!("{settings:?} {projection:?} {spacing:e} {origin:e}");
                // The middle of the lattice is rounded to 1e-16 of the origin: at most 2e-3 of a voxel. Packed normals
                // round differently in another unit: 2.6e-5 of a lit colour.
                let rounded = if settings.lighting.is_some() { 1e-4 } else { 1e-5 };
                let limit = if origin == 0.0 { rounded } else { 5e-4 };
                assert!(color < limit && alpha < limit, "{what}: colour {color:e}, alpha {alpha:e}");
            }
        }
    }
}

/// Scattered bright voxels in a transparent volume.
fn sparse(dims: [u32; 3], every: usize) -> Volume {
    let count = dims.into_iter().map(|n| n as usize).product();
    let samples = (0..count).map(|index: usize| if index.is_multiple_of(every) { 200 } else { 0 }).collect();
    Volume::new(Grid::axis_parallel(dims, [1.0; 3]).unwrap(), Samples::U8(samples)).unwrap()
}

#[test]
#[ignore = "slow: a picture of 1500 x 1500 pixels through 2000 planes"]
fn runs_of_many_planes_are_kept_for_a_part_of_the_picture_at_a_time() {
    let volume = sparse([16, 16, 2000], 10_007);
    let transfer = transfer(&[(0.0, [1.0, 0.5, 0.2], 0.0), (255.0, [1.0, 0.5, 0.2], 0.5)], None);
    let view = View { elevation: 90.0, zoom: 1.2, ..View::default() };
    // Runs of 2000 planes take 158 bytes per pixel, in parts of at most 256 MiB.
    let camera = look(&view, &volume, [1500; 2]);
    let got = picture(&volume, &transfer, &camera, &full());
    by_tiles(&got);
    let (color, alpha) = errors(&got.image, &render(&volume, &transfer, &camera, &exact_quads()));
    assert!(color < 2e-3 && alpha < 5e-4 && got.stats.parts > 1, "colour {color:e}, alpha {alpha:e}");
}

#[test]
fn what_outgrows_a_texture_is_drawn_by_quads() {
    let transfer = transfer(&[(0.0, [1.0, 0.5, 0.2], 0.0), (255.0, [1.0, 0.5, 0.2], 0.5)], None);
    // A row of more texels than a texture has.
    let volume = sparse([65_530, 2, 2], 10_007);
    let settings = Settings { antialiasing: false, ..Settings::default() };
    let got = picture(&volume, &transfer, &oblique(ProjectionKind::Orthographic, 1.0, &volume, 64), &settings);
    assert_eq!(got.stats.painter.name(), "quads");
    assert!(
        !renderer().adapter().is_software() || got.stats.painter_reason.contains("does not fit"),
        "{}",
        got.stats.painter_reason
    );
}

#[test]
fn an_eye_on_a_voxel_or_a_face_is_that_of_the_reference_or_refused() {
    let (volume, transfer) = demo("marschner-lobb", 24);
    // The lattice goes from 0 to 23; eyes on a voxel, between voxels, on the face of the volume, and beside it.
    for [x, y, z] in [[11.0, 5.0, 12.0], [11.5, 5.5, 12.25], [11.0, -0.5, 12.0], [11.0, -2.6, 12.0], [-2.6, 4.0, 30.0]]
    {
        let target = DVec3::new(x, y + 10.0, z);
        let view = View { projection: PERSPECTIVE, target: Some(target), distance: Some(10.0), ..View::default() };
        let camera = look(&view, &volume, [40; 2]);
        let post = Settings { shading: Shading::Post, ..full() };
        let got = picture(&volume, &transfer, &camera, &post);
        by_tiles(&got);
        let rms = 255.0 * rms_covered(&got.image, &truth(&volume, &transfer, &camera, &post));
        assert!(rms < 2.5, "{x} {y} {z}, post-shaded: {rms} of 255");
        let auto = Settings { painter: Painter::Auto, ..full() };
        let got = picture(&volume, &transfer, &camera, &auto);
        let (color, alpha) = errors(&got.image, &truth(&volume, &transfer, &camera, &auto));
        assert!(color < 8e-3 && alpha < 5e-4, "{x} {y} {z}, {}: {color:e} {alpha:e}", got.stats.painter_reason);
    }
}
