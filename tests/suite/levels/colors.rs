//! Cells in place of voxels with grown kernels, pre-shaded: `--level`.

use glam::DVec3;
use voxsplat::camera::{ProjectionKind, View};
use voxsplat::error::Error;
use voxsplat::image::Image;
use voxsplat::kernel::{Kernel, Normalization};
use voxsplat::lighting::Lighting;
use voxsplat::renderer::Scene;
use voxsplat::settings::{Level, Model, Settings, Shading};
use voxsplat::transfer::{GradientPoint, TransferFunction};
use voxsplat::volume::{Grid, Samples, Volume};

use crate::support::{
    demo, draw_on, errors, exact_quads, headlight, look, picture, prepare_on, render, renderer, rms_covered,
    rms_in_steps, transfer, two_lights, with_tiles,
};
use crate::truth::truth;

/// A soft ball, noise in a ball, a thin shell.
pub(crate) fn volumes(size: u32) -> Vec<(&'static str, Volume)> {
    let middle = f64::from(size - 1) / 2.0;
    let make = |value: &dyn Fn(f64, u32) -> f64| {
        let samples = (0..size.pow(3)).map(|n| {
            let p = [n % size, n / size % size, n / (size * size)].map(|c| f64::from(c) - middle);
            value(DVec3::from_array(p).length() / middle, n).clamp(0.0, 1.0) as f32
        });
        Volume::new(Grid::axis_parallel([size; 3], [1.0; 3]).unwrap(), Samples::F32(samples.collect())).unwrap()
    };
    // Knuth's multiplier.
    let noise = |n: u32| f64::from(n.wrapping_mul(2_654_435_761)) / f64::from(u32::MAX);
    vec![
        ("ball", make(&|r, _| 4.0 * (0.8 - r))),
        ("noise", make(&|r, n| if r < 0.8 { 0.5 + 0.5 * noise(n) } else { 0.0 })),
        ("shell", make(&|r, _| (-((r - 0.7) / 0.08).powi(2)).exp())),
    ]
}

fn tones(opacity: f64) -> TransferFunction {
    transfer(&[(0.1, [0.2, 0.4, 0.9], 0.0), (0.6, [0.9, 0.7, 0.2], opacity / 2.0), (1.0, [1.0; 3], opacity)], None)
}

/// Vessels of low absorption, so that cells may replace voxels from their least growth on.
fn faint_vessels() -> (Volume, TransferFunction) {
    let (volume, _) = demo("vessels", 48);
    (volume, transfer(&[(60.0, [0.2, 0.4, 0.9], 0.0), (150.0, [0.9, 0.7, 0.2], 0.03), (255.0, [1.0; 3], 0.05)], None))
}

fn auto() -> Settings {
    Settings { termination: 0.0, ..Settings::default() }
}

/// A view in which the kernels of a volume of `size`^3 voxels have this growth, and the pixels across the picture.
pub(crate) fn grown(size: u32, growth: f64, view: View) -> (View, [u32; 2]) {
    let pixels = (1.3 * f64::from(size) / growth).ceil() as u32;
    (View { view_height: Some(f64::from(pixels) * growth), ..view }, [pixels; 2])
}

#[test]
fn cells_err_by_less_than_a_step_beside_voxels() {
    compare_cells(&[(1.5, 1.0)], 2);
}

#[test]
#[ignore = "slow: cells of six sizes from three sides"]
fn cells_of_every_size_err_by_less_than_a_step_beside_voxels() {
    compare_cells(&[(1.2, 0.5), (1.5, 1.0), (2.2, 1.0), (2.4, 1.5), (3.0, 2.0), (5.0, 2.5)], 3);
}

/// Compares cells of levels that belong to growths of kernels, seen from the first `sides` of three sides.
fn compare_cells(growths: &[(f64, f32)], sides: usize) {
    let views = [
        View { azimuth: 30.0, elevation: 20.0, ..View::default() },
        View::default(),
        View { azimuth: 45.0, elevation: 35.26, ..View::default() },
    ];
    for (name, volume) in volumes(48) {
        for &(growth, level) in growths {
            for view in views.iter().take(sides).cloned() {
                let (view, pixels) = grown(48, growth, view);
                let camera = look(&view, &volume, pixels);
                let expected = truth(&volume, &tones(0.1), &camera, &auto());
                for settings in [with_tiles(&auto()), Settings { level: Level::Auto, ..exact_quads() }] {
                    let got = picture(&volume, &tones(0.1), &camera, &settings);
                    assert_eq!(got.stats.levels, [level; 2]);
                    let rms = 255.0 * rms_covered(&got.image, &expected);
                    println!("{name} {growth} {} {rms:.2}", got.stats.painter.name());
                    // Along an axis, the truncated kernels of the voxels themselves show their lattice.
                    let limit = if view.azimuth == 0.0 { 1.5 } else { 1.0 };
                    assert!(
                        rms < limit,
                        "{name} {growth} {:?} {}: rms {rms} of 255",
                        view.azimuth,
                        got.stats.painter.name()
                    );
                }
            }
        }
    }
}

#[test]
fn cells_of_every_kernel_model_and_lattice_follow_the_reference() {
    let (volume, transfer) = faint_vessels();
    let long = volume.clone().with_grid(Grid::axis_parallel([48; 3], [1.0, 1.0, 3.0]).unwrap()).unwrap();
    let left = Grid::axis_parallel([48; 3], [1.0; 3]).unwrap().to_world()
        * glam::DAffine3::from_scale(DVec3::new(-1.0, 1.0, 2.0));
    let left = volume.clone().with_grid(Grid::new([48; 3], left).unwrap()).unwrap();
    let cases = [
        (&volume, auto()),
        (&volume, Settings { model: Model::Xray, ..auto() }),
        (&volume, Settings { lighting: headlight(), ..auto() }),
        (&volume, Settings { kernel: Kernel::KAISER_BESSEL, ..auto() }),
        (&volume, Settings { kernel: Kernel::Gaussian { sigma: 1.2, radius: 3.0 }, ..auto() }),
        (&volume, Settings { normalization: Normalization::Peak, ..auto() }),
        (&long, auto()),
        (&left, Settings { lighting: headlight(), ..auto() }),
    ];
    for (number, (volume, settings)) in cases.into_iter().enumerate() {
        let view = View { azimuth: 30.0, elevation: 20.0, view_height: Some(100.0), ..View::default() };
        let camera = look(&view, volume, [40; 2]);
        let expected = truth(volume, &transfer, &camera, &settings);
        for settings in [settings.clone(), Settings { painter: exact_quads().painter, ..settings }] {
            let got = picture(volume, &transfer, &camera, &settings);
            assert!(got.stats.levels[0] > 0.0, "case {number}");
            let rms = 255.0 * rms_covered(&got.image, &expected);
            println!("case {number} {}: {rms:.2}", got.stats.painter.name());
            // Opaque edges, here by a divisor of 1, are sharper than kernels.
            let limit = if settings.normalization == Normalization::Peak { 2.0 } else { 1.3 };
            assert!(rms < limit, "case {number}, {}: rms {rms} of 255", got.stats.painter.name());
        }
    }
}

/// Light is computed voxel by voxel. Cells with a mean normal erred by 16 of 255 on folds finer than a cell, by 21 on
/// uniform matter, which has no normal, and by 25 in the shadows of cells.
#[test]
fn cells_are_lit_as_their_voxels_are() {
    let view = View { azimuth: 20.0, elevation: 15.0, ..View::default() };
    let shadowed = two_lights().map(|lighting| Lighting { shadows: 1.0, occlusion: Some(8.0), ..lighting });
    for (name, light) in
        [("marschner-lobb", headlight()), ("shepp-logan", headlight()), ("shell", headlight()), ("shell", shadowed)]
    {
        let (volume, transfer) = demo(name, 40);
        let (view, pixels) = grown(40, 2.6, view.clone());
        let camera = look(&view, &volume, pixels);
        let settings = Settings { lighting: light, level: Level::At(1), ..auto() };
        let expected = truth(&volume, &transfer, &camera, &settings);
        let got = picture(&volume, &transfer, &camera, &settings);
        let rms = 255.0 * rms_covered(&got.image, &expected);
        println!("{name}: {rms:.2}");
        assert!(rms < 2.0, "{name}: rms {rms} of 255");
    }
}

/// The optical depth of a cell determines the growth from which on it is used: see docs/algorithms.md.
#[test]
fn dense_matter_has_finer_cells() {
    let (_, volume) = volumes(48).swap_remove(1);
    let dense =
        |unit| transfer(&[(0.1, [0.2, 0.4, 0.9], 0.0), (0.6, [0.9, 0.7, 0.2], 0.5), (1.0, [1.0; 3], 0.79)], Some(unit));
    let mut before = f32::INFINITY;
    for unit in [10.0, 1.0, 0.084] {
        for growth in [1.6, 3.2, 6.4] {
            let (view, pixels) = grown(48, growth, View { azimuth: 30.0, elevation: 20.0, ..View::default() });
            let camera = look(&view, &volume, pixels);
            let got = picture(&volume, &dense(unit), &camera, &auto());
            let rms = 255.0 * rms_covered(&got.image, &truth(&volume, &dense(unit), &camera, &auto()));
            println!("{unit} {growth} {:?}: {rms:.2}", got.stats.levels);
            assert!(rms < 2.0, "{unit} {growth} {:?}: rms {rms} of 255", got.stats.levels);
            if growth == 3.2 {
                assert!(got.stats.levels[0] < before, "{unit}: {:?}", got.stats.levels);
                before = got.stats.levels[0];
            }
        }
    }
}

/// A view through one eye in which kernels grow from one level to the next within a volume of 48^3 voxels.
fn deep(view_height: f64) -> View {
    let projection = ProjectionKind::Perspective { fov: 60.0 };
    View { azimuth: 30.0, elevation: 20.0, projection, view_height: Some(view_height), ..View::default() }
}

#[test]
fn perspectives_by_quads_take_the_level_of_the_nearest_voxel() {
    let (volume, transfer) = faint_vessels();
    let projection = ProjectionKind::Perspective { fov: 30.0 };
    let view = View { azimuth: 30.0, elevation: 20.0, projection, view_height: Some(160.0), ..View::default() };
    let camera = look(&view, &volume, [40; 2]);
    let settings = Settings { level: Level::Auto, ..exact_quads() };
    let got = picture(&volume, &transfer, &camera, &settings);
    assert_eq!(got.stats.levels, [2.0; 2]);
    let rms = 255.0 * rms_covered(&got.image, &truth(&volume, &transfer, &camera, &settings));
    assert!(rms < 1.3, "rms {rms} of 255");
}

#[test]
fn layers_of_levels_follow_the_reference() {
    for (name, volume) in volumes(48) {
        for (view_height, levels) in [(60.0, [0.0, 1.0]), (100.0, [0.0, 2.0])] {
            let camera = look(&deep(view_height), &volume, [40; 2]);
            let expected = truth(&volume, &tones(0.1), &camera, &auto());
            let got = picture(&volume, &tones(0.1), &camera, &with_tiles(&auto()));
            assert_eq!(got.stats.levels, levels);
            let rms = 255.0 * rms_covered(&got.image, &expected);
            println!("{name} {view_height}: rms {rms:.2} of 255");
            assert!(rms < 1.0, "{name} {view_height}: rms {rms} of 255");
        }
    }
}

#[test]
fn layers_of_every_kernel_model_and_lattice_follow_the_reference() {
    let (volume, transfer) = faint_vessels();
    let long = volume.clone().with_grid(Grid::axis_parallel([48; 3], [1.0, 1.0, 3.0]).unwrap()).unwrap();
    let cases = [
        (&volume, auto()),
        (&volume, Settings { model: Model::Xray, ..auto() }),
        (&volume, Settings { lighting: headlight(), ..auto() }),
        (&volume, Settings { kernel: Kernel::KAISER_BESSEL, ..auto() }),
        (&long, auto()),
    ];
    for (number, (volume, settings)) in cases.into_iter().enumerate() {
        let camera = look(&deep(if number == 4 { 130.0 } else { 70.0 }), volume, [40; 2]);
        let expected = truth(volume, &transfer, &camera, &settings);
        let got = picture(volume, &transfer, &camera, &with_tiles(&settings));
        assert!(got.stats.levels[0] < got.stats.levels[1], "case {number}: {:?}", got.stats.levels);
        let rms = 255.0 * rms_covered(&got.image, &expected);
        println!("case {number} {:?}: {rms:.2}", got.stats.levels);
        // Levels begin at the least growth of cells: along parallel rays errors are also 1.5 of 255, of X-rays 1.8.
        assert!(rms < 2.0, "case {number}: rms {rms} of 255");
    }
}

#[test]
fn pictures_do_not_pop_while_levels_move_through_the_volume() {
    let worst = worst_changes(&with_tiles(&auto()), 5);
    assert!(worst.iter().all(|worst| 255.0 * worst < 1.5), "{worst:?}");
}

#[test]
#[ignore = "slow: 12 steps of truths, pre- and post-shaded; the test before has 5 steps pre-shaded"]
fn pictures_of_both_shadings_do_not_pop_while_levels_move_through_the_volume() {
    let mut worst = worst_changes(&with_tiles(&auto()), 12);
    worst.extend(worst_changes(&Settings { shading: Shading::Post, ..with_tiles(&auto()) }, 12));
    assert!(worst.iter().all(|worst| 255.0 * worst < 1.5), "{worst:?}");
}

/// The largest change of a channel of each volume, beyond the change of the reference, while levels move through it in
/// `steps` steps.
fn worst_changes(settings: &Settings, steps: u32) -> Vec<f32> {
    let mut all = Vec::new();
    for (name, volume) in volumes(48) {
        let scene = prepare_on(&renderer(), &volume, &tones(0.1), settings).unwrap();
        let mut before: Option<(Image, Image)> = None;
        let mut worst = 0.0_f32;
        for step in 0..steps {
            let camera = look(&deep(70.0 + 0.5 * f64::from(step)), &volume, [32; 2]);
            let got = draw_on(&renderer(), &scene, &camera, settings).unwrap();
            assert!(got.stats.levels[0] < got.stats.levels[1], "{:?}", got.stats.levels);
            let expected = truth(&volume, &tones(0.1), &camera, settings);
            if let Some((got_before, expected_before)) = &before {
                let changes = |a: &Image, b: &Image| -> Vec<f32> {
                    a.pixels().iter().flatten().zip(b.pixels().iter().flatten()).map(|(a, b)| a - b).collect()
                };
                let (ours, own) = (changes(&got.image, got_before), changes(&expected, expected_before));
                worst = ours.iter().zip(&own).map(|(a, b)| (a - b).abs()).fold(worst, f32::max);
            }
            before = Some((got.image, expected));
        }
        println!("{name}, beyond the reference's change: {:.2} of 255", 255.0 * worst);
        all.push(worst);
    }
    all
}

#[test]
fn a_level_is_taken_if_asked_for() {
    let (volume, transfer) = demo("vessels", 48);
    let camera = look(&View { azimuth: 30.0, ..View::default() }, &volume, [96; 2]);
    let at = |level| Settings { level: Level::At(level), ..auto() };
    let fine = picture(&volume, &transfer, &camera, &at(0));
    assert_eq!(fine.stats.levels, [0.0; 2]);
    // One scene serves all levels, one after the other.
    let scene = prepare_on(&renderer(), &volume, &transfer, &auto()).unwrap();
    let mut before = 0.0;
    for level in [1, 2, 3] {
        let got = draw_on(&renderer(), &scene, &camera, &at(level)).unwrap();
        assert_eq!(got.stats.levels, [level as f32; 2]);
        let rms = rms_in_steps(&got.image, &fine.image);
        assert!(rms > before, "coarser cells blur more: {rms}");
        before = rms;
    }
    assert!(draw_on(&renderer(), &scene, &camera, &at(0)).unwrap().image == fine.image);
    // `auto` uses no cells if kernels do not grow.
    assert_eq!(draw_on(&renderer(), &scene, &camera, &auto()).unwrap().stats.levels, [0.0; 2]);
}

#[test]
fn sums_over_the_picture_are_kept() {
    // An X-ray of small depth adds up the absorption of the volume.
    let (volume, _) = demo("vessels", 48);
    let faint = transfer(&[(20.0, [1.0; 3], 0.0), (255.0, [1.0; 3], 1e-5)], None);
    let view = View { azimuth: 30.0, elevation: 20.0, view_height: Some(120.0), ..View::default() };
    let camera = look(&view, &volume, [40; 2]);
    let sum = |level| {
        let settings = Settings { model: Model::Xray, level, ..exact_quads() };
        let image = render(&volume, &faint, &camera, &settings);
        image.pixels().iter().map(|p| f64::from(p[3])).sum::<f64>()
    };
    let [fine, coarse] = [Level::At(0), Level::Auto].map(sum);
    assert!((coarse / fine - 1.0).abs() < 5e-3, "{coarse} {fine}");
}

#[test]
fn levels_that_cannot_be_are_refused() {
    let refused = |settings: Settings| match settings.validate() {
        Err(Error::Setting { name: "level", reason }) => reason,
        other => panic!("{other:?}"),
    };
    assert!(refused(Settings { level: Level::At(13), ..auto() }).contains("0 to 12"));
}

#[test]
fn the_same_bytes_whatever_was_drawn_before() {
    draw_in_any_order(3);
}

#[test]
#[ignore = "slow: scenes in four kinds of light"]
fn the_same_bytes_in_any_light_whatever_was_drawn_before() {
    draw_in_any_order(0);
}

/// Draws scenes in several kinds of light, of which it leaves some out.
fn draw_in_any_order(left_out: usize) {
    let (volume, transfer) = demo("shell", 40);
    let thinned = transfer
        .clone()
        .with_gradient_opacity(vec![
            GradientPoint { magnitude: 0.0, opacity: 0.2 },
            GradientPoint { magnitude: 40.0, opacity: 1.0 },
        ])
        .unwrap();
    let small = look(&View { azimuth: 20.0, ..View::default() }, &volume, [16; 2]);
    let turned = look(&View { azimuth: 50.0, ..View::default() }, &volume, [16; 2]);
    let large = look(&View { azimuth: 20.0, ..View::default() }, &volume, [80; 2]);
    let layers = look(&deep(60.0), &volume, [40; 2]);
    let shadowed = two_lights().map(|lighting| Lighting { shadows: 0.8, ..lighting });
    let cases = [(&transfer, None), (&transfer, headlight()), (&thinned, two_lights()), (&transfer, shadowed)];
    for (transfer, lighting) in cases.into_iter().skip(left_out) {
        let settings = Settings { lighting, ..auto() };
        let prepare = || prepare_on(&renderer(), &volume, transfer, &settings).unwrap();
        let draw = |scene: &Scene, camera| draw_on(&renderer(), scene, camera, &settings).unwrap().image;
        let scene = prepare();
        let cameras = [&small, &turned, &large, &layers];
        let first = cameras.map(|camera| draw(&scene, camera));
        assert!(cameras.map(|camera| draw(&scene, camera)) == first);
        for (camera, first) in cameras.into_iter().zip(&first) {
            assert!(errors(first, &draw(&prepare(), camera)) == (0.0, 0.0));
        }
    }
}
