//! Classification of scalars, against the reference: steps, narrow and distant segments, values in any unit, and
//! no-data values.

use voxsplat::camera::{Camera, ProjectionKind, View};
use voxsplat::kernel::Kernel;
use voxsplat::settings::{Model, Settings, Shading};
use voxsplat::transfer::TransferFunction;
use voxsplat::volume::{Sample, Volume};

use crate::support::{demo, exact_quads, headlight, look, render, rms_of_all, transfer, with_tiles};
use crate::truth::truth;

const WHITE: [f64; 3] = [1.0; 3];
const RED: [f64; 3] = [1.0, 0.3, 0.0];
const YELLOW: [f64; 3] = [1.0, 1.0, 0.0];

fn view(volume: &Volume) -> Camera {
    let view = View { azimuth: 33.0, elevation: 20.0, projection: ProjectionKind::Orthographic, ..View::default() };
    look(&view, volume, [40; 2])
}

/// Both painters.
fn painters(settings: &Settings) -> [Settings; 2] {
    [exact_quads(), with_tiles(&exact_quads())].map(|painter| Settings { painter: painter.painter, ..settings.clone() })
}

/// Pre-shaded, post-shaded and the maximum, with a kernel without jumps: the error of slab means at a jump is not
/// tested here.
fn models() -> [Settings; 3] {
    let common = Settings { kernel: Kernel::KAISER_BESSEL, antialiasing: false, ..exact_quads() };
    [common.clone(), Settings { shading: Shading::Post, ..common.clone() }, Settings { model: Model::Mip, ..common }]
}

/// The error of a picture over all pixels (rms), at most `bounds` for each of [`models`].
fn check(what: &str, volume: &Volume, transfer: &TransferFunction, bounds: [f64; 3]) {
    let camera = view(volume);
    for (settings, bound) in models().into_iter().zip(bounds) {
        let expected = truth(volume, transfer, &camera, &settings);
        assert!(expected.pixels().iter().any(|p| p[3] > 0.01), "{what}: the truth is empty");
        for settings in painters(&settings) {
            let error = rms_of_all(&render(volume, transfer, &camera, &settings), &expected);
            let model = (settings.model, settings.shading, settings.painter);
            assert!(error <= bound, "{what} {model:?}: {error:e} > {bound:e}");
        }
    }
}

#[test]
#[ignore = "slow: pictures by both painters in three models"]
fn steps_are_steps() {
    let (volume, _) = demo("vessels", 32);
    // An isosurface: the first two points share a value. Values below are transparent.
    let surface = transfer(&[(120.0, WHITE, 0.0), (120.0, RED, 0.5), (255.0, YELLOW, 0.5)], None);
    check("surface", &volume, &surface, [1e-3, 3e-2, 0.1]);
    let points = [(0.0, WHITE, 0.0), (100.0, WHITE, 0.0), (100.0, RED, 0.9), (140.0, YELLOW, 0.9), (140.0, RED, 0.0)];
    // The maximum across a step is all or nothing: with quads 1.4 % of the pixels, at silhouettes, flip.
    check("box", &volume, &transfer(&points, None), [1e-3, 4e-2, 0.15]);
    // The other way round: values below the step are visible.
    let below = transfer(&[(120.0, RED, 0.05), (120.0, WHITE, 0.0), (255.0, WHITE, 0.0)], None);
    check("below", &volume, &below, [1e-3, 1e-2, 0.1]);
}

#[test]
fn narrow_boxes_and_peaks_count_whatever_their_width() {
    let (volume, _) = demo("vessels", 32);
    // Narrower than the change of the scalar between any two sampled places.
    for (width, opacity) in [(1.0, 0.5), (0.02, 0.9999)] {
        let points = [
            (0.0, WHITE, 0.0),
            (100.0, WHITE, 0.0),
            (100.0, RED, opacity),
            (100.0 + width, YELLOW, opacity),
            (100.0 + width, YELLOW, 0.0),
        ];
        let camera = view(&volume);
        let settings = &models()[1];
        let transfer = transfer(&points, None);
        let expected = truth(&volume, &transfer, &camera, settings);
        for settings in painters(settings) {
            let error = rms_of_all(&render(&volume, &transfer, &camera, &settings), &expected);
            assert!(error < 2.5e-2, "{width} {:?}: {error:e}", settings.painter);
        }
    }
}

#[test]
#[ignore = "slow: pictures by both painters in three models"]
fn clear_points_far_away_change_nothing() {
    let (volume, _) = demo("shell", 24);
    let peak = [(0.4, RED, 0.0), (0.5, YELLOW, 0.6), (0.6, RED, 0.0)];
    let camera = view(&volume);
    for settings in models().iter().flat_map(painters) {
        let expected = render(&volume, &transfer(&peak, None), &camera, &settings);
        for far in [1.0, 300.0, 1e4, 1e7, 65_535.0, 1e300] {
            let points = [&[(-far, WHITE, 0.0)], &peak[..], &[(far, WHITE, 0.0)]].concat();
            let got = render(&volume, &transfer(&points, None), &camera, &settings);
            assert_eq!(got, expected, "{far}: {:?} {:?} {:?}", settings.model, settings.shading, settings.painter);
        }
    }
    check("peak", &volume, &transfer(&peak, None), [1e-3, 1.5e-2, 5e-2]);
}

#[test]
#[ignore = "slow: pictures by both painters in three models"]
fn many_control_points_are_as_exact_as_few() {
    let (volume, few) = demo("shell", 24);
    let [first, last] = few.range();
    let points: Vec<_> = (0..4096)
        .map(|i| first + (last - first) * f64::from(i) / 4095.0)
        .map(|value| (value, few.sample(value).0, few.sample(value).1))
        .collect();
    let many = transfer(&points, None);
    let camera = view(&volume);
    for settings in models().iter().flat_map(painters) {
        let [a, b] = [&few, &many].map(|transfer| render(&volume, transfer, &camera, &settings));
        let error = rms_of_all(&a, &b);
        assert!(error < 1e-3, "{:?} {:?} {:?}: {error:e}", settings.model, settings.shading, settings.painter);
    }
    // Alternating, as many as values of 8 bits: the error is the error of a slab, not of a table with a few bins for
    // each point. With 4096 points, 2.6 in a bin, post-shading errs by 0.05.
    let zigzag: Vec<_> = (0..256).map(|i| (f64::from(i) / 255.0, YELLOW, f64::from(i % 2) * 0.3)).collect();
    check("zigzag", &volume, &transfer(&zigzag, None), [2e-3, 1e-2, 0.3]);
}

/// A ball of values from 0 at the rim to 1, in multiples of 1/4096, times `unit`.
fn ball<T: Sample>(as_sample: impl Fn(f64) -> T) -> Volume {
    let n = 16_u32;
    let at = |i: u32| f64::from(i) - f64::from(n - 1) / 2.0;
    let samples: Vec<T> = (0..n * n * n)
        .map(|i| [i % n, i / n % n, i / (n * n)].map(at))
        .map(|[x, y, z]| (1.0 - (x * x + y * y + z * z).sqrt() / 8.0).max(0.0))
        .map(|value| as_sample((value * 4096.0).round() / 4096.0))
        .collect();
    Volume::from_slice([n; 3], [1.0; 3], &samples).unwrap()
}

fn ball_transfer(unit: f64) -> TransferFunction {
    transfer(
        &[(0.2 * unit, RED, 0.0), (0.45 * unit, RED, 0.3), (0.45 * unit, RED, 0.5), (0.8 * unit, YELLOW, 0.8)],
        None,
    )
}

#[test]
#[ignore = "slow: pictures by both painters in three models"]
fn values_in_any_unit_give_the_same_bytes() {
    let settings: Vec<Settings> = models()
        .into_iter()
        .chain(models()[..2].iter().map(|settings| Settings { lighting: headlight(), ..settings.clone() }))
        .flat_map(|settings| painters(&settings))
        .collect();
    for settings in settings {
        let same = |what: &str, of: &dyn Fn(f64) -> Volume, units: &[f64]| {
            let camera = view(&of(1.0));
            let expected = render(&of(1.0), &ball_transfer(1.0), &camera, &settings);
            for &unit in units {
                let got = render(&of(unit), &ball_transfer(unit), &camera, &settings);
                let kind = (settings.model, settings.shading, settings.painter, settings.lighting.is_some());
                assert_eq!(got, expected, "{what} times {unit:e} {kind:?}");
            }
        };
        let power = |k: f64| k.exp2();
        same("f64", &|unit| ball(|v| v * unit), &[power(1000.0), power(-1000.0), power(333.0)]);
        same("f32", &|unit| ball(|v| (v * unit) as f32), &[power(120.0), power(-110.0)]);
        // A header's slope.
        same(
            "slope",
            &|unit| ball(|v| (4096.0 * v) as i16).with_rescale(unit / 4096.0, 0.0).unwrap(),
            &[power(-100.0), power(300.0)],
        );
    }
}

#[test]
#[ignore = "slow: pictures by both painters in three models"]
fn values_out_of_the_range_of_f32_follow_the_reference() {
    let bounds = [2e-3, 5e-3, 2e-2];
    for unit in [1e100, 1e-300, 1e-310] {
        check(&format!("f64 times {unit:e}"), &ball(|v| v * unit), &ball_transfer(unit), bounds);
    }
    for unit in [3e38, 1e-38, 1e-40] {
        check(&format!("f32 times {unit:e}"), &ball(|v| (v * unit) as f32), &ball_transfer(unit), bounds);
    }
}

#[test]
#[ignore = "slow: pictures by both painters in three models"]
fn values_for_no_data_change_nothing_farther_than_their_kernels() {
    let n = 24_u32;
    let place = [19, 12, 12];
    let index = (place[0] + n * (place[1] + n * place[2])) as usize;
    let (shell, transfer) = demo("shell", n);
    let values: Vec<f32> = {
        let memory = shell.in_memory().unwrap();
        (0..(n * n * n) as usize).map(|i| memory.value(i) as f32).collect()
    };
    let with = |fill: f32| {
        let mut values = values.clone();
        values[index] = fill;
        Volume::from_slice([n; 3], [1.0; 3], &values).unwrap()
    };
    let camera = view(&with(0.0));
    for settings in models() {
        let settings = Settings { painter: exact_quads().painter, ..settings };
        let plain = render(&with(values[index]), &transfer, &camera, &settings);
        // Band-limited, the next voxels change too.
        let reach = if settings.is_post_shaded() { 2.1 } else { 3.1 };
        for fill in [-32_768.0, 1e10, 3e38, -3e38] {
            let volume = with(fill);
            let got = render(&volume, &transfer, &camera, &settings);
            let expected = truth(&volume, &transfer, &camera, &settings);
            let mut far = 0;
            for (i, pixel) in got.pixels().iter().enumerate() {
                assert!(pixel.iter().all(|c| c.is_finite()), "{fill}: {pixel:?}");
                let (sx, sy) = crate::support::coordinates(i, &camera);
                let (origin, direction) = camera.ray(sx, sy);
                let to = glam::DVec3::from(place.map(f64::from)) - origin;
                if to.cross(direction).length() > reach {
                    far += 1;
                    let error = (0..4).map(|c| (pixel[c] - plain.pixels()[i][c]).abs()).fold(0.0, f32::max);
                    assert!(error <= 1e-4, "{fill} {:?} {:?} pixel {i}: {error:e}", settings.model, settings.shading);
                }
            }
            assert!(far > 700);
            let error = rms_of_all(&got, &expected);
            assert!(error < 8e-2, "{fill} {:?} {:?}: {error:e}", settings.model, settings.shading);
        }
    }
}
