//! Sharper pictures: narrower kernels, and filtered samples.

use glam::{DAffine3, DMat3, DVec3};
use voxsplat::camera::View;
use voxsplat::demos;
use voxsplat::error::Error;
use voxsplat::kernel::Kernel;
use voxsplat::lighting::{Light, Lighting};
use voxsplat::reference::Reference;
use voxsplat::settings::{Model, Settings, Shading};
use voxsplat::volume::Grid;

use crate::support::{
    PERSPECTIVE, camera, demo, draw_on, exact_quads, full, headlight, look, picture, prepare, render, renderer,
    rms_covered, with_tiles,
};
use crate::truth::truth;

fn post(sharpness: f64) -> Settings {
    Settings { shading: Shading::Post, sharpness, ..Settings::default() }
}

/// Settings of quads and of tiles without early termination.
fn painters(settings: &Settings) -> [Settings; 2] {
    let exact = Settings { termination: 0.0, painter: exact_quads().painter, ..settings.clone() };
    [exact.clone(), with_tiles(&exact)]
}

/// Asserts that both painters, quads and tiles, are as close to the reference as given.
fn assert_close(name: &str, size: u32, settings: &Settings, limits: [f64; 2]) {
    let (volume, transfer) = demo(name, size);
    let camera = camera(33.0, PERSPECTIVE, &volume, 40);
    let expected = truth(&volume, &transfer, &camera, settings);
    for (settings, limit) in painters(settings).iter().zip(limits) {
        let got = picture(&volume, &transfer, &camera, settings);
        let error = rms_covered(&got.image, &expected);
        println!("{name}, {}, {:?}: {error:.1e}", got.stats.painter.name(), settings.model);
        assert!(error < limit, "{name}, {}: {error:e}", got.stats.painter.name());
    }
}

/// Limits are 1.5 times the measured errors.
#[test]
fn both_painters_show_the_filtered_samples_of_the_reference() {
    assert_close("marschner-lobb", 24, &post(1.0), [6e-4, 2.4e-3]);
    // Filtered bytes overshoot the range of bytes.
    assert_close("vessels", 24, &post(1.0), [4e-3, 1.7e-2]);
    assert_close("sphere", 24, &Settings { model: Model::Mip, ..post(1.0) }, [9.5e-3, 3.5e-2]);
    assert_close("marschner-lobb", 24, &Settings { lighting: headlight(), ..post(0.5) }, [4e-3, 1.15e-2]);
}

#[test]
fn sharper_pictures_are_closer_to_the_field_that_was_sampled() {
    // The same cube, sampled three times as densely along each axis, serves as the true field.
    let (coarse, transfer) = demo("shell", 24);
    let transfer = voxsplat::transfer::TransferFunction::new(transfer.points().to_vec(), Some(1.0)).unwrap();
    let fine = demos::volume("shell", 72).unwrap();
    let spacing = DVec3::splat(1.0 / 3.0);
    let placed = DAffine3::from_mat3_translation(DMat3::from_diagonal(spacing), -35.5 * spacing);
    let fine = fine.with_grid(Grid::new([72; 3], placed).unwrap()).unwrap();
    let camera = look(&View { azimuth: 30.0, elevation: 20.0, ..View::default() }, &coarse, [64; 2]);
    let of = |settings: Settings| Settings { painter: full().painter, antialiasing: false, ..settings };
    let truth = render(&fine, &transfer, &camera, &of(post(1.0)));
    for shading in [Shading::Pre, Shading::Post] {
        let errors = [0.0, 0.5, 1.0].map(|sharpness| {
            let settings = of(Settings { shading, ..post(sharpness) });
            rms_covered(&render(&coarse, &transfer, &camera, &settings), &truth)
        });
        println!("{shading}: {errors:?}");
        let [none, half, full] = errors;
        assert!(half < none && full < half, "{shading}: {errors:?}");
        assert!(shading == Shading::Pre || full < 0.4 * none, "{errors:?}");
    }
}

#[test]
fn pre_shaded_a_sharper_kernel_is_a_narrower_blob() {
    let (volume, transfer) = demo("vessels", 24);
    let camera = camera(20.0, PERSPECTIVE, &volume, 32);
    // Kernels also cast shadows.
    let lights = vec![Light::directional(DVec3::new(0.4, -0.7, 1.0))];
    let lit = Settings {
        lighting: Some(Lighting { lights, shadows: 0.9, ..Lighting::default() }),
        sharpness: 1.0,
        ..Settings::default()
    };
    let blob = Settings { kernel: Kernel::KAISER_BESSEL, sharpness: 0.0, ..lit.clone() };
    let [sharp, expected] = [&lit, &blob].map(|settings| picture(&volume, &transfer, &camera, settings));
    assert_eq!(sharp.image, expected.image);
    let [sharp_truth, truth] = [&lit, &blob].map(|settings| {
        let reference = Reference::new(&volume, &transfer, settings).unwrap().with_tolerance(Reference::TOLERANCE);
        reference.pixels(&camera, &[[16, 16], [14, 20]]).unwrap()
    });
    assert_eq!(sharp_truth, truth);
    assert_eq!(expected.stats.noise, None);
    assert!((sharp.stats.noise.unwrap() - 0.395).abs() < 0.01, "{:?}", sharp.stats.noise);
    assert!(sharp.stats.to_string().contains("sharpness    1: noise 0."), "{}", sharp.stats);
    let between = Settings { sharpness: 0.5, ..Settings::default() }.reconstruction_kernel();
    assert_eq!(between, Kernel::KaiserBessel { radius: 2.0, alpha: 5.2 });
}

#[test]
fn a_scene_has_one_sharpness() {
    let (volume, transfer) = demo("sphere", 16);
    let camera = camera(0.0, PERSPECTIVE, &volume, 16);
    let scene = prepare(&volume, &transfer, &post(0.5));
    let blob = Settings { kernel: Kernel::KAISER_BESSEL, ..post(0.5) };
    for other in [post(0.0), post(1.0), blob] {
        let error = draw_on(&renderer(), &scene, &camera, &other).unwrap_err();
        assert!(matches!(error, Error::Setting { name: "sharpness", .. }), "{error}");
    }
    assert!(draw_on(&renderer(), &scene, &camera, &post(0.5)).is_ok());
}

#[test]
fn what_cannot_be_sharper_is_refused() {
    let blob = |radius| Kernel::KaiserBessel { radius, alpha: 10.4 };
    let wrong = [
        (Settings { sharpness: -0.1, ..Settings::default() }, "expected 0 to 1"),
        (Settings { sharpness: f64::NAN, ..Settings::default() }, "expected 0 to 1"),
        (Settings { sharpness: 0.5, kernel: Kernel::KAISER_BESSEL, ..Settings::default() }, "no kernel narrower"),
        (Settings { kernel: Kernel::Gaussian { sigma: 0.4, radius: 2.0 }, ..post(1.0) }, ""),
        (Settings { kernel: blob(5.0), ..post(1.0) }, "radius up to 4"),
    ];
    for (settings, part) in wrong {
        match settings.validate() {
            Ok(()) => assert!(part.is_empty(), "{settings:?}"),
            Err(error) => {
                let error = error.to_string();
                assert!(!part.is_empty() && error.starts_with("sharpness: ") && error.contains(part), "{error}");
            }
        }
    }
}
