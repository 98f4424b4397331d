//! Statistics, presets and transfer files.

use rayon::ThreadPoolBuilder;
use voxsplat::appearance::suggest;
use voxsplat::lighting::Lighting;
use voxsplat::settings::Settings;
use voxsplat::transfer::presets::{PRESETS, PresetValues, find, preset};
use voxsplat::transfer::{ControlPoint, TransferFunction};
use voxsplat::volume::{Grid, Samples, Statistics, Units, Volume};

fn volume(samples: Samples) -> Volume {
    let grid = Grid::axis_parallel([samples.len() as u32, 1, 1], [1.0; 3]).unwrap();
    Volume::new(grid, samples).unwrap()
}

/// A linear congruential generator, 0..1: the same sequence on every machine.
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

/// Empty space, and two tissues of similar extent.
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
    // A range wider than f64, and the ends of 64-bit integers.
    for samples in [Samples::F64(vec![-1.7e308, 0.0, 1.7e308]), Samples::U64(vec![0, 1, u64::MAX])] {
        let volume = volume(samples);
        let s = Statistics::of(&volume).unwrap();
        assert_eq!(s.histogram().iter().sum::<u64>(), 3);
        for p in PRESETS {
            match preset(p.name, &volume, &s, PresetValues::Auto) {
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
    // The middles of the gaps between -970 and 10, and between 70 and 870, to a hundredth of the range of values.
    assert!((object + 480.0).abs() < 20.0, "{object}");
    let bone = s.otsu(object).unwrap();
    assert!((bone - 470.0).abs() < 20.0, "{bone}");
    let background = s.background().unwrap();
    assert!((-985.0..=object).contains(&background.limit), "{background:?}");
    assert!((background.fraction - 0.6).abs() < 0.05, "{background:?}");
}

#[test]
fn presets_are_clear_in_the_background_and_denser_with_value() {
    for volume in [ct(), mri()] {
        let s = Statistics::of(&volume).unwrap();
        let limit = s.background().unwrap().limit;
        // A band of values, and the two ends.
        for p in PRESETS.iter().filter(|p| !["ct-lung", "activation"].contains(&p.name)) {
            let transfer = preset(p.name, &volume, &s, PresetValues::Auto).unwrap();
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
    let transfer = |name| TransferFunction::preset(name, &ct()).unwrap();
    let opacity = |name, value: f64| transfer(name).sample(value).1;
    assert_eq!(opacity("ct-bone", 60.0), 0.0);
    assert!(opacity("ct-bone", 900.0) > 0.2);
    assert!((0.001..0.1).contains(&opacity("ct-soft-tissue", 40.0)));
    assert!(opacity("ct-skin", -100.0) >= 0.5);
    assert!(opacity("ct-muscle", -100.0) == 0.0 && opacity("ct-muscle", 60.0) > 0.2);
    assert!(opacity("ct-lung", -400.0) > 0.1 && opacity("ct-lung", -800.0) > 0.0);
    assert!([-1000.0, 0.0, 60.0, 900.0].iter().all(|&value| opacity("ct-lung", value) == 0.0));
    // A file may state Hounsfield units that the values do not show.
    let flesh = volume(classes(&[(500, 0.0), (500, 60.0)], 9.0));
    let stated = flesh.with_units(Units { value: Some("HU".to_owned()), ..Units::default() });
    assert_eq!(TransferFunction::preset("ct-bone", &stated).unwrap().points(), transfer("ct-bone").points());
}

#[test]
fn gradient_opacity_of_a_preset_keeps_to_the_size_of_voxels_and_values() {
    let steps = |unit: f64, spacing: f64| {
        let samples = classes(&[(600, 0.0), (350, 1040.0), (50, 1900.0)], 30.0);
        let Samples::I16(samples) = samples else { unreachable!() };
        let volume = Volume::from_slice([samples.len() as u32, 1, 1], [2.0 * spacing, spacing, spacing], &samples);
        let volume = volume.unwrap().with_rescale(unit, 0.0).unwrap();
        TransferFunction::preset("ct-soft-tissue", &volume).unwrap().gradient_opacity().to_vec()
    };
    let first = steps(1.0, 1.0);
    assert!(first.len() >= 2 && first[0].opacity < 0.5 && first.last().unwrap().opacity == 1.0);
    // A step of the whole range over two voxels keeps all of its opacity.
    assert!(first.last().unwrap().magnitude < 950.0, "{first:?}");
    for (a, b) in first.iter().zip(steps(0.1, 0.25)) {
        assert!((a.magnitude * 0.4 - b.magnitude).abs() <= 1e-9 * b.magnitude && a.opacity == b.opacity);
    }
}

#[test]
fn statistics_show_from_three_standard_deviations_on_both_sides_of_zero() {
    let opacity = |volume: &Volume, value: f64| TransferFunction::preset("activation", volume).unwrap().sample(value).1;
    for volume in [scores(), scores().with_units(Units { value: Some("z".to_owned()), ..Units::default() })] {
        for value in [-7.0, -4.5, 4.5, 7.0] {
            assert!(opacity(&volume, value) > 0.2, "{value}");
        }
        assert!([-2.0, 0.0, 2.0].iter().all(|&value| opacity(&volume, value) == 0.0));
    }
    let color = TransferFunction::preset("activation", &scores()).unwrap();
    assert!(color.sample(5.0).0[0] > 0.5 && color.sample(-5.0).0[2] > 0.5);
}

#[test]
fn every_material_can_be_lit() {
    for p in PRESETS {
        assert_eq!(find(p.name).unwrap().description, p.description);
        let Some(material) = p.material else { continue };
        let lighting = Some(material.lit(Lighting::default()));
        Settings { lighting, ..Settings::default() }.validate().unwrap();
    }
    let refused = find("ct-wood").unwrap_err().to_string();
    assert!(refused.contains("no preset is called \"ct-wood\""), "{refused}");
}

#[test]
fn presets_need_a_name_and_a_range() {
    assert!(TransferFunction::preset("ct-wood", &mri()).unwrap_err().to_string().contains("ct-bone"));
    let one = volume(Samples::U8(vec![5; 4]));
    assert!(TransferFunction::preset("mri", &one).unwrap_err().to_string().contains("all values are 5"));
}

/// A volume with values of a function of two independent numbers in 0..1, and with this spacing.
fn made(spacing: f64, of: impl Fn(f64, f64) -> f64) -> Volume {
    let noise = noise(80_000);
    let values: Vec<f32> = noise.chunks(2).map(|n| of(n[0], n[1]) as f32).collect();
    Volume::from_slice([100, 100, 4], [spacing, spacing, 2.0 * spacing], &values).unwrap()
}

/// The same volume in unsigned integers.
fn counted(spacing: f64, of: impl Fn(f64, f64) -> f64) -> Volume {
    let made = made(spacing, of);
    let values: Vec<u16> = (0..40_000).map(|i| made.in_memory().unwrap().value(i).round() as u16).collect();
    Volume::from_slice([100, 100, 4], [spacing, spacing, 2.0 * spacing], &values).unwrap()
}

/// A normally distributed number from a number in 0..1 (Tukey's lambda distribution of 0.14).
fn normal(p: f64) -> f64 {
    let p = p.clamp(1e-6, 1.0 - 1e-6);
    4.91 * (p.powf(0.14) - (1.0 - p).powf(0.14))
}

/// The magnitude of complex noise, from a number in 0..1.
fn rayleigh(p: f64) -> f64 {
    (-2.0 * (1.0 - p).max(1e-9).ln()).sqrt()
}

/// A map of z scores in a masked brain: noise, and one in 25 voxels active.
fn scores() -> Volume {
    made(2.0, |place, p| match place {
        0.0..0.7 => 0.0,
        0.7..0.98 => normal(p),
        0.98..0.993 => 4.0 + 4.0 * p,
        _ => -4.0 - 3.0 * p,
    })
    .with_orientation_known()
}

#[test]
fn suggestions_follow_the_values() {
    let shifted = volume(classes(&[(600, 100.0), (350, 1140.0), (50, 2000.0)], 30.0));
    let above = volume(classes(&[(500, 130.0), (250, 500.0), (250, 800.0)], 29.0));
    let field = made(1.0, |_, p| p);
    let stated = made(1.0, |place, p| if place < 0.9 { 0.0 } else { 3.0 + p })
        .with_units(Units { value: Some("t".to_owned()), ..Units::default() });
    let uptake = |place: f64, p: f64| match place {
        0.0..0.7 => 20.0 * p,
        0.7..0.95 => 500.0 + 400.0 * p,
        0.95..0.998 => 2000.0 + 1000.0 * p,
        _ => 6000.0 + 12000.0 * p,
    };
    let vessels = |place: f64, p: f64| match place {
        0.0..0.5 => 12.0 * rayleigh(p),
        0.5..0.99 => 200.0 + 15.0 * normal(p),
        _ => 500.0 + 250.0 * p,
    };
    let t2 = |place: f64, p: f64| match place {
        0.0..0.6 => 9.0 * rayleigh(p),
        0.6..0.93 => 220.0 + 30.0 * normal(p),
        _ => 640.0 + 25.0 * normal(p),
    };
    let masked = |place: f64, p: f64| if place < 0.55 { 0.0 } else { 40.0 + 160.0 * p };
    let windowed = |place: f64, p: f64| match place {
        0.0..0.65 => 0.0,
        0.65..0.93 => 105.0 + 5.0 * normal(p),
        _ => 200.0 + 55.0 * p,
    };
    let cells = |place: f64, p: f64| match place {
        0.0..0.9 => 110.0 + 9.0 * normal(p),
        _ => 150.0 - 400.0 * (1.0 - p).max(1e-3).ln(),
    };
    let oriented = |volume: Volume| volume.with_orientation_known();
    for (what, volume, name, reason) in [
        ("Hounsfield units", ct(), "ct-bone", "Hounsfield"),
        ("CT, air at 100", shifted, "ct-bone", "flesh and bone"),
        ("CT, windowed", oriented(counted(0.8, windowed)), "ct-bone", "flesh and bone"),
        ("two tissues", mri(), "mri", "no peak"),
        ("two tissues over an offset", above, "mri", "no peak"),
        ("T2", oriented(counted(1.2, t2)), "mri", "as bone in CT"),
        ("masked brain", oriented(counted(1.0, masked)), "mr-brain", "masked"),
        ("MR angiogram", oriented(counted(0.6, vessels)), "angiography", "times as bright"),
        ("PET", oriented(counted(4.0, uptake)), "pet", "voxels of 4.0 mm"),
        ("PET, real numbers", oriented(made(4.0, uptake)), "pet", "voxels of 4.0 mm"),
        ("t, stated", stated, "activation", "statistics (t)"),
        ("z, not stated", scores(), "activation", "lie about 0"),
        ("microscopy", counted(0.3, cells), "fluorescence", "microscopy"),
        ("field", field, "field", "no scan"),
        ("constant", volume(Samples::U8(vec![7; 8])), "grayscale", "all values are 7"),
    ] {
        let suggestion = suggest(&volume, &Statistics::of(&volume).unwrap());
        assert!(suggestion.name == name && suggestion.reason.contains(reason), "{what}: {suggestion:?}");
    }
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
        (
            format!("{{\"points\": [{}]}}", good.replace("#ffffff", "whitte")),
            "point 1 (line 1): colour \"whitte\", expected \"#rrggbb\", a colour name of CSS or [red, green, blue] \
             from 0 to 1; a similar colour exists: white",
        ),
        (format!("{{\"points\": [{}]}}", good.replace("\"#ffffff\"", "[1, 2]")), "point 1 (line 1): colour [1,2], ex"),
        (format!("{{\"points\": [{}]}}", good.replace("\"#ffffff\"", "[1, 2, 0]")), "must lie in 0..1"),
        (format!("{{\"points\": [{good},\n{}]}}", good.replace(": 1,", ": 0.5,")), "point 2 (line 2): value 0.5 comes"),
        (
            format!("{{\"points\": [{good}], \"units\": 1}}"),
            "expected one of `unit_distance`, `points`, `gradient_opacity`",
        ),
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
