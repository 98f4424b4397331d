//! Gradient opacity: pictures against the f64 truth, closed forms, and effects that users see.

use voxsplat::kernel::Kernel;
use voxsplat::lighting::Lighting;
use voxsplat::settings::{Level, Model, Settings, Shading};
use voxsplat::transfer::{GradientPoint, TransferFunction};
use voxsplat::volume::{Grid, Samples, Volume};

use crate::support::{
    PROJECTIONS, camera, demo, errors, exact_quads, full, headlight, picture, render, rms_covered, transfer,
};
use crate::truth::truth;

fn thinned(transfer: &TransferFunction, points: &[(f64, f64)]) -> TransferFunction {
    let point = |&(magnitude, opacity): &(f64, f64)| GradientPoint { magnitude, opacity };
    transfer.clone().with_gradient_opacity(points.iter().map(point).collect()).unwrap()
}

/// The errors are as large as without gradient opacity: limits are 1.5 times the measured errors.
#[test]
fn both_painters_thin_out_what_the_reference_thins_out() {
    let shadings = [(Shading::Pre, [2e-3, 3e-3]), (Shading::Post, [2e-2, 4e-2])];
    for (shading, [quads, tiles]) in shadings {
        for (lighting, projection) in [(None, PROJECTIONS[0]), (headlight(), PROJECTIONS[1])] {
            let (volume, plain) = demo("marschner-lobb", 24);
            let thin = thinned(&plain, &[(0.02, 0.0), (0.2, 1.0)]);
            let camera = camera(30.0, projection, &volume, 40);
            let set = |settings: Settings| Settings { shading, lighting: lighting.clone(), ..settings };
            for (settings, limit) in [(set(exact_quads()), quads), (set(full()), tiles)] {
                let error = |transfer| {
                    let expected = truth(&volume, transfer, &camera, &settings);
                    rms_covered(&render(&volume, transfer, &camera, &settings), &expected)
                };
                let (with, without) = (error(&thin), error(&plain));
                println!("{shading:?} {projection:?}: {with:e}, without {without:e}");
                assert!(with < limit, "{shading:?} {projection:?}: {with:e}, without {without:e}");
            }
        }
    }
}

#[test]
#[ignore = "slow: cells beside voxels"]
fn cells_are_thinned_out_as_their_voxels_are() {
    thin_cells(&[
        (Shading::Pre, headlight()),
        (Shading::Pre, None),
        (Shading::Post, None),
        (Shading::Post, headlight()),
    ]);
}

/// Gradient opacity applies to voxels before they become cells.
fn thin_cells(kinds: &[(Shading, Option<Lighting>)]) {
    let (volume, plain) = demo("marschner-lobb", 64);
    let thin = thinned(&plain, &[(0.0, 0.0), (0.1, 1.0)]);
    let camera = camera(30.0, PROJECTIONS[0], &volume, 40);
    for &(shading, ref lighting) in kinds {
        let at =
            |level| Settings { shading, lighting: lighting.clone(), level: Level::At(level), ..Settings::default() };
        let error = |transfer| {
            let cells = picture(&volume, transfer, &camera, &at(1));
            assert_eq!(cells.stats.levels, [1.0; 2]);
            rms_covered(&cells.image, &render(&volume, transfer, &camera, &at(0)))
        };
        let [with, without] = [&thin, &plain].map(error);
        let [thin, plain] = [&thin, &plain].map(|transfer| render(&volume, transfer, &camera, &at(0)));
        let effect = rms_covered(&thin, &plain);
        println!("{shading:?}: {with:e}, without {without:e}, effect {effect:e}");
        // Post-shaded, the gradients of cells are a little shorter than the gradients of voxels.
        assert!(with < 1.5 * without + 4e-3 && with < 2e-2, "{shading:?}: {with:e}, without {without:e}");
        assert!(effect > 3e-2, "{shading:?}: {effect:e}");
    }
}

/// A ramp has one gradient, so gradient opacity scales the whole absorption.
#[test]
fn a_share_of_extinction_stays() {
    let dims = [24, 24, 24];
    // Along x, 2 per voxel and so 4 per world unit.
    let samples = Samples::F32((0..24 * 24 * 24).map(|i| 2.0 * (i % 24) as f32).collect());
    let volume = Volume::new(Grid::axis_parallel(dims, [0.5, 0.4, 0.6]).unwrap(), samples).unwrap();
    let plain = transfer(&[(0.0, [0.8, 0.5, 0.2], 0.1)], Some(0.5));
    let thin = thinned(&plain, &[(0.0, 0.0), (16.0, 1.0)]);
    let composite = Model::Composite;
    for (model, shading) in [(composite, Shading::Pre), (composite, Shading::Post), (Model::Xray, Shading::Pre)] {
        for settings in [exact_quads(), full()] {
            // A kernel without ripple.
            let settings = Settings { model, shading, kernel: Kernel::KAISER_BESSEL, ..settings };
            let camera = camera(90.0, PROJECTIONS[0], &volume, 48);
            let depth = |transfer| {
                let pixel = render(&volume, transfer, &camera, &settings).pixels()[24 * 48 + 24];
                -(1.0 - f64::from(pixel[3])).ln()
            };
            // The outermost two of 24 voxels have half the gradient, and post-shaded none beyond them.
            let ratio = depth(&thin) / depth(&plain);
            assert!((0.22..=0.2505).contains(&ratio), "{model:?} {shading:?}: {ratio}");
        }
    }
}

#[test]
fn a_maximum_stays_as_it_is() {
    let (volume, plain) = demo("vessels", 16);
    let settings = Settings { model: Model::Mip, ..full() };
    let camera = camera(30.0, PROJECTIONS[0], &volume, 24);
    let thin = thinned(&plain, &[(0.0, 0.0)]);
    assert_eq!(
        errors(&render(&volume, &thin, &camera, &settings), &render(&volume, &plain, &camera, &settings)).0,
        0.0
    );
}
