//! Statistics, presets and transfer files.

use rayon::ThreadPoolBuilder;
use voxsplat::transfer::presets::{PRESETS, preset, suggest};
use voxsplat::transfer::{ControlPoint, TransferFunction};
use voxsplat::volume::{Grid, Samples, Statistics, Volume};

fn volume(samples: Samples) -> Volume {
    let grid = Grid::axis_parallel([samples.len() as u32, 1, 1], [1.0; 3]).unwrap();
    Volume::new(grid, samples).unwrap()
}

/// The same sequence on every machine: a linear congruential generator, 0..1.
fn noise(count: usize) -> Vec<f64> {
    let mut state = 1_u64;
    let next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / (1 << 24) as f64
    };
    std::iter::repeat_with(next).take(count).collect()
}

/// Classes of samples: (share in thousandths, mean), each spread by +-`spread`.
fn classes(classes: &[(usize, f64)], spread: f64) -> Samples {
    let noise = noise(60_000);
    let mut values = noise.iter().enumerate().map(|(i, n)| {
        let mut place = i % 1000;
        let class = classes.iter().find(|(share, _)| {
            let inside = place < *share;
            place = place.saturating_sub(*share);
            inside
        });
        class.unwrap_or(&classes[0]).1 + (n - 0.5) * 2.0 * spread
    });
    Samples::I16(values.by_ref().map(|v| v.round() as i16).collect())
}

/// Air, flesh and bone in Hounsfield units.
fn ct() -> Volume {
    volume(classes(&[(600, -1000.0), (350, 40.0), (50, 900.0)], 30.0))
}

/// Void, and two tissues of like extent.
fn mri() -> Volume {
    volume(classes(&[(500, 30.0), (250, 400.0), (250, 700.0)], 29.0))
}

#[test]
fn figures_of_a_small_volume_are_exact() {
    let s = Statistics::of(&volume(Samples::I16(vec![-3, 7, 1, 1, 4]))).unwrap();
    assert_eq!((s.min, s.max, s.mean, s.count, s.non_finite), (-3.0, 7.0, 2.0, 5, 0));
    assert!((s.std_dev - 11.2_f64.sqrt()).abs() < 1e-12);
    assert_eq!(s.histogram(), [1, 0, 0, 0, 2, 0, 0, 1, 0, 0, 1]);
    assert_eq!([0.0, 0.2, 0.5, 0.6, 0.8, 1.0].map(|q| s.quantile(q)), [-3.0, -3.0, 1.0, 1.0, 4.0, 7.0]);
    assert_eq!(s.quantile_above(1.0, 0.5), 4.0);
    assert_eq!([-4.0, -3.0, 0.5, 1.0, 6.9, 7.0].map(|v| s.fraction_above(v)), [1.0, 0.8, 0.8, 0.4, 0.2, 0.0]);
}

#[test]
fn a_rescale_maps_the_figures_even_where_it_falls() {
    let raw = volume(Samples::U8(vec![0, 10, 10, 200]));
    let s = Statistics::of(&raw.with_rescale(-0.5, 3.0).unwrap()).unwrap();
    assert_eq!((s.min, s.max, s.mean), (-97.0, 3.0, 3.0 - 27.5));
    assert_eq!(s.quantile(0.0), -97.0);
    assert_eq!(s.quantile(0.5), -2.0);
    assert_eq!(s.quantile(1.0), 3.0);
    assert_eq!(s.fraction_above(-2.0), 0.25);
}

#[test]
fn figures_do_not_depend_on_the_number_of_threads() {
    let samples: Vec<f32> = noise(3_000_000).iter().map(|&n| (n * 60.0).exp2() as f32).collect();
    let big = volume(Samples::F32(samples[..65_535].to_vec()));
    let grid = Grid::axis_parallel([1000, 1000, 3], [1.0; 3]).unwrap();
    let bigger = Volume::new(grid, Samples::F32(samples)).unwrap();
    for volume in [&big, &bigger] {
        let on = |threads| {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| Statistics::of(volume).unwrap())
        };
        assert_eq!(on(1), on(3));
    }
}

#[test]
fn odd_volumes_have_statistics() {
    let one = Statistics::of(&volume(Samples::F32(vec![5.0; 9]))).unwrap();
    assert_eq!((one.min, one.max, one.std_dev, one.quantile(0.5)), (5.0, 5.0, 0.0, 5.0));
    assert!(one.otsu(f64::NEG_INFINITY).is_none() && one.background().is_none());

    let nan = Statistics::of(&volume(Samples::F32(vec![f32::NAN, 1.0, f32::INFINITY, 3.0]))).unwrap();
    assert_eq!((nan.min, nan.max, nan.count, nan.non_finite), (1.0, 3.0, 2, 2));

    let none = Statistics::of(&volume(Samples::F64(vec![f64::NAN; 3]))).unwrap();
    assert!(none.count == 0 && none.mean.is_nan() && none.quantile(0.5).is_nan() && none.background().is_none());
}

#[test]
fn presets_of_extreme_ranges_do_not_panic() {
    // A range past that of f64, and the ends of 64-bit integers.
    for samples in [Samples::F64(vec![-1.7e308, 0.0, 1.7e308]), Samples::U64(vec![0, 1, u64::MAX])] {
        let s = Statistics::of(&volume(samples)).unwrap();
        assert_eq!(s.histogram().iter().sum::<u64>(), 3);
        for p in PRESETS {
            match preset(p.name, &s) {
                Ok(transfer) => assert!(transfer.points().iter().all(|p| p.value.is_finite()), "{}", p.name),
                Err(e) => assert!(!e.to_string().contains('\n'), "{e}"),
            }
        }
    }
}

#[test]
fn otsu_parts_classes_and_the_background_is_the_darkest() {
    let s = Statistics::of(&ct()).unwrap();
    let object = s.otsu(f64::NEG_INFINITY).unwrap();
    assert!((-970.0..=10.0).contains(&object), "{object}");
    let bone = s.otsu(object).unwrap();
    assert!((70.0..=870.0).contains(&bone), "{bone}");
    let background = s.background().unwrap();
    assert!((-985.0..=object).contains(&background.limit), "{background:?}");
    assert!((background.fraction - 0.6).abs() < 0.05, "{background:?}");
}

#[test]
fn presets_are_clear_in_the_background_and_denser_with_value() {
    for volume in [ct(), mri()] {
        let s = Statistics::of(&volume).unwrap();
        let limit = s.background().unwrap().limit;
        for p in PRESETS {
            let transfer = preset(p.name, &s).unwrap();
            assert!(transfer.points().len() >= 2 && transfer.unit_distance().is_none());
            assert!(transfer.points().windows(2).all(|w| w[0].opacity <= w[1].opacity), "{}", p.name);
            for value in [s.min - 1e6, s.min, (s.min + limit) / 2.0, limit] {
                assert_eq!(transfer.sample(value).1, 0.0, "{} at {value}", p.name);
            }
            assert!(transfer.sample(s.max).1 >= 0.05, "{}", p.name);
        }
    }
}

#[test]
fn ct_presets_take_hounsfield_units_at_their_word() {
    let transfer = preset("ct-bone", &Statistics::of(&ct()).unwrap()).unwrap();
    assert_eq!(transfer.sample(60.0).1, 0.0);
    assert!(transfer.sample(900.0).1 > 0.2);
    let soft = preset("ct-soft-tissue", &Statistics::of(&ct()).unwrap()).unwrap();
    assert!((0.001..0.03).contains(&soft.sample(40.0).1));
}

#[test]
fn presets_need_a_name_and_a_range() {
    let s = Statistics::of(&mri()).unwrap();
    assert!(preset("ct-wood", &s).unwrap_err().to_string().contains("ct-bone"));
    let one = Statistics::of(&volume(Samples::U8(vec![5; 4]))).unwrap();
    assert!(preset("mri", &one).unwrap_err().to_string().contains("all 5"));
}

#[test]
fn suggestions_follow_the_values() {
    let of = |volume: &Volume| suggest(volume, &Statistics::of(volume).unwrap()).name;
    assert_eq!(of(&ct()), "ct-bone");
    assert_eq!(of(&mri()), "mri");
    let shifted = volume(classes(&[(600, 100.0), (350, 1140.0), (50, 2000.0)], 30.0));
    assert_eq!(of(&shifted), "ct-bone");
    let field = volume(Samples::F32(noise(1000).iter().map(|&n| n as f32).collect()));
    assert_eq!(of(&field), "viridis");
    assert_eq!(of(&volume(Samples::U8(vec![7; 8]))), "grayscale");
}

#[test]
fn json_round_trips_exactly() {
    let point = |value, opacity| ControlPoint { value, color: [0.1, 1.0 / 3.0, 1.0], opacity };
    let points = vec![point(-1e300, 0.0), point(0.1 + 0.2, 0.123_456_789_012_345_68), point(f64::MAX, 1.0)];
    for unit in [None, Some(0.7)] {
        let transfer = TransferFunction::new(points.clone(), unit).unwrap();
        assert_eq!(TransferFunction::from_json(&transfer.to_json()).unwrap(), transfer);
    }
}

#[test]
fn json_colours_are_hex_or_numbers() {
    let text = r##"{"unit_distance": 2, "points": [{"value": 0, "color": "#ff8000", "opacity": 0},
        {"value": 1, "color": [0.5, 0, 1], "opacity": 1}]}"##;
    let transfer = TransferFunction::from_json(text).unwrap();
    assert_eq!(transfer.unit_distance(), Some(2.0));
    assert_eq!(transfer.points()[0].color, [1.0, 128.0 / 255.0, 0.0]);
    assert_eq!(transfer.points()[1].color, [0.5, 0.0, 1.0]);
}

#[test]
fn json_errors_name_the_point_and_the_line() {
    let good = r##"{"value": 1, "color": "#ffffff", "opacity": 0.5}"##;
    let cases = [
        (format!("{{\"points\": [\n{good},\n\n{{\"value\": 2}}]}}"), "point 2 (line 4): missing field `color`"),
        (format!("{{\"points\": [{good},\n{}]}}", good.replace("opacity", "alpha")), "point 2 (line 2): unknown field"),
        (format!("{{\"points\": [{}]}}", good.replace("#ffffff", "white")), "point 1 (line 1): invalid value"),
        (format!("{{\"points\": [{}]}}", good.replace("\"#ffffff\"", "[1, 2]")), "point 1 (line 1): invalid length 2"),
        (format!("{{\"points\": [{}]}}", good.replace("\"#ffffff\"", "[1, 2, 0]")), "must lie in 0..1"),
        (format!("{{\"points\": [{good},\n{}]}}", good.replace(": 1,", ": 0.5,")), "point 2 (line 2): value 0.5 comes"),
        (format!("{{\"points\": [{good}], \"units\": 1}}"), "expected one of `unit_distance`, `points`"),
        (format!("{{\"points\": [{good}], \"unit_distance\": 0}}"), "unit_distance 0"),
        ("{\"points\": []}".to_owned(), "0 control points"),
        ("{}".to_owned(), "missing field `points`"),
        ("{\n\"points\": [}".to_owned(), "line 2 column 12"),
        (format!("{{\"points\": [{}]}}", good.replace("0.5", "1e999")), "number out of range"),
    ];
    for (text, expected) in cases {
        let said = TransferFunction::from_json(&text).unwrap_err().to_string();
        assert!(said.contains(expected), "{text}: {said}");
    }
    let said = TransferFunction::from_json(&format!("{{\"points\": [{good}], \"unit\": 1}}")).unwrap_err();
    assert!(said.to_string().starts_with("transfer function: line 1 column "), "{said}");
}
