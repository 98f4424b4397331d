//! Pictures within a requested error.

use voxsplat::accuracy::{MOST_PICTURES, Truth, choose};
use voxsplat::error::Error;
use voxsplat::layers::Layers;
use voxsplat::lighting::Lighting;
use voxsplat::reference::Reference;
use voxsplat::settings::{Painter, QuadsSettings, Settings, Shading};

use crate::support::{PERSPECTIVE, PROJECTIONS, camera, demo, draw, engines, headlight, prepare};

#[test]
fn chosen_settings_keep_the_bound() {
    let [device, _] = engines();
    let (volume, transfer) = demo("vessels", 24);
    let camera = camera(33.0, PERSPECTIVE, &volume, 64);
    let lit = Settings { lighting: headlight(), ..Settings::default() };
    let post = Settings { shading: Shading::Post, ..lit.clone() };
    for (settings, bound) in [(&lit, 3e-2), (&lit, 3e-3), (&lit, 3e-4), (&lit, 1e-4), (&post, 2e-2)] {
        let chosen = choose(&device, &Layers::of_volume(&volume, &transfer), &camera, settings, bound, 4096).unwrap();
        assert!(chosen.keeps && chosen.estimate.error <= bound, "{bound}: {:?}", chosen.estimate);
        assert!(chosen.tried.len() <= MOST_PICTURES, "{bound}: {:?}", chosen.tried);
        // All pixels: the choice also traced all.
        let truth = Truth::trace(&Layers::of_volume(&volume, &transfer), &camera, &chosen.settings, u32::MAX).unwrap();
        let all = truth.estimate(&chosen.rendered.image).unwrap();
        assert!(all.error <= bound, "{bound}: {all:?}");
        // The content stays, and the settings reproduce the picture.
        assert_eq!((chosen.settings.shading, &chosen.settings.lighting), (settings.shading, &settings.lighting));
        let again = draw(&prepare(&volume, &transfer, &chosen.settings), &camera, &chosen.settings);
        assert!(!chosen.traced && again.image == chosen.rendered.image, "{bound}: {:?}", chosen.estimate);
        assert_eq!(chosen.tried.last().unwrap().settings, chosen.settings);
    }
}

/// A bound below the errors of sweeps takes exact shadows, a looser one does not.
#[test]
fn strict_bounds_have_exact_shadows() {
    let [device, _] = engines();
    let (volume, transfer) = demo("vessels", 24);
    let camera = camera(33.0, PERSPECTIVE, &volume, 32);
    let lighting = Some(Lighting::studio(camera.forward, camera.up));
    let settings = Settings { lighting, ..Settings::default() };
    for (bound, is_exact) in [(3e-2, false), (3e-3, true)] {
        let chosen = choose(&device, &Layers::of_volume(&volume, &transfer), &camera, &settings, bound, 1024).unwrap();
        assert!(chosen.keeps, "{bound}: {:?}", chosen.estimate);
        assert_eq!(chosen.settings.lighting.unwrap().exact_shadows, is_exact, "{bound}");
    }
}

#[test]
fn a_loose_bound_costs_less_than_a_tight_one() {
    let [device, _] = engines();
    let (volume, transfer) = demo("vessels", 24);
    let camera = camera(33.0, PERSPECTIVE, &volume, 48);
    let settings = Settings { lighting: headlight(), ..Settings::default() };
    let of = |bound| choose(&device, &Layers::of_volume(&volume, &transfer), &camera, &settings, bound, 1024).unwrap();
    let (loose, tight) = (of(3e-2), of(1e-4));
    assert_eq!(loose.tried.len(), 1, "the defaults keep it");
    assert!(
        tight.tried.len() > 1 && matches!(tight.settings.painter, Painter::Quads(quads) if quads.sheet_thickness < 1.0),
        "{:?}",
        tight.settings
    );
    assert!(tight.settings.termination < loose.settings.termination);
}

/// Each pixel sees thousands of voxels, so that thin sheets of voxels are more work than a few rays: such a search took
/// ten times as long as tracing the picture.
#[test]
fn a_picture_that_is_more_work_for_the_painters_than_for_the_reference_is_traced() {
    let [device, _] = engines();
    let (volume, transfer) = demo("marschner-lobb", 48);
    let (camera, layers) = (camera(33.0, PROJECTIONS[0], &volume, 12), Layers::of_volume(&volume, &transfer));
    let settings = Settings { shading: Shading::Post, lighting: headlight(), ..Settings::default() };
    let chosen = choose(&device, &layers, &camera, &settings, 2e-3, 1024).unwrap();
    assert!(chosen.traced && chosen.keeps && chosen.tried.len() < MOST_PICTURES, "{:?}", chosen.tried);
    let reference = Reference::of_layers(&layers, &chosen.settings).unwrap().with_tolerance(Reference::TOLERANCE);
    assert_eq!(chosen.rendered.image, reference.render(&camera).unwrap());
    // A painter that is chosen stays, and so does a bound that the reference may not keep.
    let quads = Settings { painter: Painter::Quads(QuadsSettings::default()), ..settings.clone() };
    for (settings, bound) in [(&quads, 2e-3), (&settings, 1e-7)] {
        assert!(!choose(&device, &layers, &camera, settings, bound, 1024).unwrap().traced, "{bound}");
    }
}

#[test]
fn a_bound_that_nothing_keeps_is_said_to_be_broken() {
    let [device, _] = engines();
    let (volume, transfer) = demo("shell", 16);
    // So few pixels that cells replace voxels: these are the next thing to try.
    let camera = camera(33.0, PERSPECTIVE, &volume, 20);
    let settings = Settings { shading: Shading::Post, ..Settings::default() };
    let chosen = choose(&device, &Layers::of_volume(&volume, &transfer), &camera, &settings, 1e-7, 1024).unwrap();
    let least = chosen.tried.iter().map(|tried| tried.estimate.error).fold(f64::INFINITY, f64::min);
    assert!(!chosen.keeps && chosen.estimate.error == least);
    assert!((2..=MOST_PICTURES).contains(&chosen.tried.len()), "{:?}", chosen.tried);
    for bound in [0.0, f64::NAN, f64::INFINITY] {
        let refused = choose(&device, &Layers::of_volume(&volume, &transfer), &camera, &settings, bound, 1024);
        assert!(matches!(refused, Err(Error::Setting { name: "max_error", .. })));
    }
}

#[test]
fn the_processor_keeps_a_bound_or_has_the_picture_traced() {
    let [_, host] = engines();
    let (volume, transfer) = demo("vessels", 24);
    let (camera, layers) = (camera(33.0, PERSPECTIVE, &volume, 48), Layers::of_volume(&volume, &transfer));
    let settings = Settings { lighting: headlight(), ..Settings::default() };
    let choose = |settings: &Settings, bound| choose(&host, &layers, &camera, settings, bound, 1024).unwrap();
    let loose = choose(&settings, 0.05);
    assert!(loose.keeps && !loose.traced && loose.rendered.stats.painter.name() == "cpu", "{:?}", loose.estimate);
    let tight = choose(&settings, 1e-4);
    assert!(tight.keeps && tight.traced, "{:?}", tight.estimate);
    // A painter that is chosen stays.
    let chosen = choose(&Settings { painter: Painter::Cpu, ..settings }, 1e-4);
    assert!(!chosen.keeps && !chosen.traced, "{:?}", chosen.estimate);
}
