//! Gradient opacity and the floor under gradients: pictures against the f64 truth, closed forms, and what users meet.

use glam::DVec3;
use voxsplat::clip::{Clip, Plane};
use voxsplat::kernel::Kernel;
use voxsplat::layers::{Layer, Layers};
use voxsplat::lighting::Lighting;
use voxsplat::reference::Reference;
use voxsplat::settings::{Level, Model, Settings, Shading};
use voxsplat::transfer::{GradientPoint, TransferFunction};
use voxsplat::volume::{Grid, Samples, Volume};

use crate::support::{
    PROJECTIONS, RENDERER, camera, demo, errors, exact_quads, full, headlight, picture, render, rms_covered, transfer,
    two_lights,
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

/// Cells stand for voxels that have been thinned out one by one.
#[test]
fn cells_are_thinned_out_as_their_voxels_are() {
    let (volume, plain) = demo("marschner-lobb", 64);
    let thin = thinned(&plain, &[(0.0, 0.0), (0.1, 1.0)]);
    let camera = camera(30.0, PROJECTIONS[0], &volume, 40);
    for (shading, lighting) in
        [(Shading::Pre, None), (Shading::Pre, headlight()), (Shading::Post, None), (Shading::Post, headlight())]
    {
        let at =
            |level| Settings { shading, lighting: lighting.clone(), level: Level::At(level), ..Settings::default() };
        let error = |transfer| {
            let cells = picture(&volume, transfer, &camera, &at(1));
            assert_eq!(cells.stats.levels, [1, 1]);
            rms_covered(&cells.image, &render(&volume, transfer, &camera, &at(0)))
        };
        let [with, without] = [&thin, &plain].map(error);
        let [thin, plain] = [&thin, &plain].map(|transfer| render(&volume, transfer, &camera, &at(0)));
        let effect = rms_covered(&thin, &plain);
        println!("{shading:?}: {with:e}, without {without:e}, effect {effect:e}");
        // Post-shaded, the gradients of cells are a little shorter than those of voxels.
        assert!(with < 1.5 * without + 4e-3, "{shading:?}: {with:e}, without {without:e}");
        assert!(effect > 3e-2, "{shading:?}: {effect:e}");
    }
}

/// A ramp has one gradient: what is left of it is a whole that absorbs as much less.
#[test]
fn a_share_of_extinction_stays() {
    let dims = [24, 24, 24];
    // Along x, 2 a voxel and so 4 a world unit.
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

/// The errors are those without a floor, and what weights of 8 bits and directions of 24 make.
#[test]
fn both_painters_light_surfaces_over_the_floor_of_the_reference() {
    let (volume, plain) = demo("marschner-lobb", 24);
    let floored = plain.clone().with_gradient_floor(0.15).unwrap();
    for shading in [Shading::Pre, Shading::Post] {
        for (number, projection) in PROJECTIONS.into_iter().enumerate() {
            let camera = camera(30.0, projection, &volume, 40);
            let shadows = if number == 0 { 0.8 } else { 0.0 };
            let lighting = two_lights().map(|lighting| Lighting { shadows, ..lighting });
            for settings in [exact_quads(), full()] {
                let settings = Settings { shading, lighting: lighting.clone(), ..settings };
                let image = |transfer| render(&volume, transfer, &camera, &settings);
                let error = |transfer| rms_covered(&image(transfer), &truth(&volume, transfer, &camera, &settings));
                let ((with, without), effect) =
                    ((error(&floored), error(&plain)), rms_covered(&image(&floored), &image(&plain)));
                let painter = &settings.painter;
                let what = format!("{shading:?} {projection:?} {painter:?}: {with:e}, without {without:e}, {effect:e}");
                println!("{what}");
                assert!(with < 1.1 * without + 2e-4 && effect > 0.02, "{what}");
            }
        }
    }
}

/// Cells have the mean weight of the surfaces of their voxels.
#[test]
fn cells_are_lit_over_the_floor_as_their_voxels_are() {
    let (volume, plain) = demo("marschner-lobb", 64);
    let floored = plain.clone().with_gradient_floor(0.05).unwrap();
    let camera = camera(30.0, PROJECTIONS[0], &volume, 40);
    for shading in [Shading::Pre, Shading::Post] {
        let at = |level| Settings { shading, lighting: two_lights(), level: Level::At(level), ..Settings::default() };
        let image = |transfer, level| render(&volume, transfer, &camera, &at(level));
        let error = |transfer| rms_covered(&image(transfer, 1), &image(transfer, 0));
        let ([with, without], effect) =
            ([&floored, &plain].map(error), rms_covered(&image(&floored, 0), &image(&plain, 0)));
        println!("{shading:?}: {with:e}, without {without:e}, effect {effect:e}");
        assert!(with < 1.2 * without + 2e-3 && effect > 0.02, "{shading:?}: {with:e}, {without:e}, {effect:e}");
    }
}

/// Layers with a floor are lit as the reference lights them, and so are those beside them without one.
#[test]
fn layers_have_floors_of_their_own() {
    let (volume, plain) = demo("marschner-lobb", 20);
    let floored = plain.clone().with_gradient_floor(0.15).unwrap();
    let (other, transfer) = demo("vessels", 20);
    let other = other.with_grid(*volume.grid()).unwrap();
    let camera = camera(30.0, PROJECTIONS[0], &volume, 32);
    let of = |first: &TransferFunction| {
        Layers::new(Layer::scalars(&volume, first)).with(Layer::scalars(&other, &transfer)).unwrap()
    };
    for settings in [exact_quads(), full()] {
        let settings = Settings { lighting: two_lights(), ..settings };
        let error = |layers: &Layers| {
            let expected =
                Reference::of_layers(layers, &settings).unwrap().with_tolerance(1e-4).render(&camera).unwrap();
            let scene = RENDERER.prepare_layers(layers, &settings).unwrap();
            rms_covered(&RENDERER.render(&scene, &camera, &settings).unwrap().image, &expected)
        };
        let [with, without] = [&floored, &plain].map(|first| error(&of(first)));
        assert!(with < 1.1 * without + 2e-4, "{with:e}, without {without:e}");
    }
}

/// A ball of 100 with noise: its inside does not sparkle, and its surface is lit as before.
#[test]
fn a_floor_over_the_noise_takes_the_sparkle_and_leaves_the_surface() {
    const N: u32 = 40;
    let mut state = 7_u32;
    let mut noise = move || {
        let sum: u32 = (0..4)
            .map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                state >> 16
            })
            .sum();
        // Nearly normal, of a standard deviation of 1.
        (f64::from(sum) / 65_536.0 - 2.0) * 3_f64.sqrt()
    };
    let ball = |i: u32| {
        let r = [i % N, i / N % N, i / N / N].map(|c| (f64::from(c) - 19.5).powi(2)).iter().sum::<f64>().sqrt();
        100.0 / (1.0 + (r - 15.0).exp())
    };
    let clean: Vec<f32> = (0..N * N * N).map(|i| ball(i) as f32).collect();
    let noisy: Vec<f32> = clean.iter().map(|v| v + (4.0 * noise()) as f32).collect();
    let [clean, noisy] = [clean, noisy].map(|samples| Volume::from_slice([N; 3], [1.0; 3], &samples).unwrap());
    // Cut open: the face is flat matter.
    let clip = Clip::new(vec![Plane::through(noisy.grid().center(), DVec3::Y).unwrap()]).unwrap();
    let skin = transfer(&[(30.0, [0.9, 0.7, 0.6], 0.0), (60.0, [0.9, 0.7, 0.6], 0.4)], None);
    let camera = camera(0.0, PROJECTIONS[0], &noisy, 80);
    for shading in [Shading::Pre, Shading::Post] {
        let lighting = Some(Lighting::studio(camera.forward, camera.up));
        let settings = Settings { shading, lighting, ..full() };
        let floor = skin.floor_over_noise(&noisy, &settings).unwrap().unwrap();
        let floored = skin.clone().with_gradient_floor(floor).unwrap();
        let cut = Settings { clip: clip.clone(), ..settings.clone() };
        let sparkle = |transfer| {
            let image = render(&noisy, transfer, &camera, &cut);
            let inside = |i: usize| [i % 80, i / 80].iter().all(|c| (30..50).contains(c));
            let values = || image.pixels().iter().enumerate().filter(|(i, _)| inside(*i)).map(|(_, p)| f64::from(p[1]));
            let mean = values().sum::<f64>() / values().count() as f64;
            (values().map(|v| (v - mean).powi(2)).sum::<f64>() / values().count() as f64).sqrt()
        };
        let ([with, without], shown) = (
            [&floored, &skin].map(sparkle),
            rms_covered(&render(&noisy, &floored, &camera, &settings), &render(&clean, &skin, &camera, &settings)),
        );
        let unlit = Settings { lighting: None, ..settings.clone() };
        let light = rms_covered(&render(&clean, &skin, &camera, &unlit), &render(&clean, &skin, &camera, &settings));
        let what = format!("{shading:?} {floor}: sparkle {with:e} of {without:e}, whole {shown:e}, light {light:e}");
        println!("{what}");
        assert!(with < 0.4 * without && shown < light / 3.0, "{what}");
    }
}
