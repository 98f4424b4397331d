//! Gradient opacity: pictures against the f64 truth, closed forms, and what users meet.

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

/// The errors are those without gradient opacity: 1.5 times what was measured.
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
