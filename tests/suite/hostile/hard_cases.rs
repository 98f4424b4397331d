//! Hard cases, one row each: all painters draw them in every model, and differ from the reference within the bounds of
//! `bounds.rs`. `cargo test --test suite hard_cases:: -- --include-ignored --nocapture` prints the errors.

use glam::{DAffine3, DMat3, DVec3};
use voxsplat::camera::{ProjectionKind, View};
use voxsplat::error::InputError;
use voxsplat::kernel::Kernel;
use voxsplat::reference::Reference;
use voxsplat::settings::{Level, Model, Settings, Shading};
use voxsplat::transfer::TransferFunction;
use voxsplat::volume::{Grid, Samples, Volume};

use crate::hostile::bounds::{Bound, Measured, Outcome, measured};
use crate::support::{
    demo, errors, exact_quads, headlight, look, prepare_on, render, renderer, thick, transfer, with_cpu, with_tiles,
};

/// A scene that is hard; its name states the reason.
struct Case {
    name: String,
    volume: Volume,
    transfer: TransferFunction,
    view: View,
    size: [u32; 2],
    settings: Settings,
}

/// Pre-shaded, lit, post-shaded, X-ray, maximum, minimum and average.
fn models(base: &Settings) -> [(&'static str, Settings); 7] {
    let base = base.clone();
    [
        ("pre", base.clone()),
        ("lit", Settings { lighting: headlight(), ..base.clone() }),
        ("post", Settings { shading: Shading::Post, level: Level::Auto, ..base.clone() }),
        ("xray", Settings { model: Model::Xray, ..base.clone() }),
        ("mip", Settings { model: Model::Mip, level: Level::Auto, ..base.clone() }),
        ("minip", Settings { model: Model::Minip, level: Level::Auto, ..base.clone() }),
        ("average", Settings { model: Model::Average, level: Level::Auto, ..base }),
    ]
}

/// Checks the bounds of each case, with `quads` by its settings, with `tiles` and with `cpu`, in all models that
/// `wanted` names.
fn hold(cases: Vec<Case>, wanted: &[&str]) {
    let mut failures = Vec::new();
    for Case { name, volume, transfer, view, size, settings } in cases {
        let camera = look(&view, &volume, size);
        for (model, quads) in models(&settings).into_iter().filter(|(model, _)| wanted.contains(model)) {
            for settings in [with_cpu(&quads), with_tiles(&quads), quads] {
                let row = match measured(&volume, &transfer, &camera, &settings) {
                    Ok(Outcome::Drawn(m, _)) if m.worst() <= 1.0 => m.to_string(),
                    Ok(Outcome::Drawn(m, _)) => {
                        failures.push(format!("{name}, {model}: {m}"));
                        format!("{m} FAILS")
                    }
                    Ok(Outcome::Refused(reason)) => format!("refused: {reason}"),
                    Err(e) => {
                        failures.push(format!("{name}, {model}: {e}"));
                        format!("{e} FAILS")
                    }
                };
                println!("{name:<28} {model:<7} {row}");
            }
        }
    }
    assert!(failures.is_empty(), "{} fail:\n{}", failures.len(), failures.join("\n"));
}

const ALL: [&str; 7] = ["pre", "lit", "post", "xray", "mip", "minip", "average"];

/// A soft ball with a hard core, in a lattice of 12 x 11 x 10.
fn ball(to_world: DAffine3) -> Volume {
    let dims = [12, 11, 10];
    let value = |i: u32| {
        let p = [i % dims[0], i / dims[0] % dims[1], i / (dims[0] * dims[1])].map(f64::from);
        let distance = (DVec3::from_array(p) - DVec3::new(5.5, 5.0, 4.5)).length();
        if distance < 2.5 { 200.0 } else { (160.0 - 20.0 * distance).max(0.0) }
    };
    let samples = (0..dims.iter().product()).map(|i| value(i) as f32).collect();
    Volume::new(Grid::new(dims, to_world).unwrap(), Samples::F32(samples)).unwrap()
}

/// Blue to orange to white, translucent.
fn tones() -> TransferFunction {
    transfer(&[(20.0, [0.1, 0.3, 0.9], 0.0), (120.0, [0.9, 0.5, 0.1], 0.15), (200.0, [1.0; 3], 0.4)], None)
}

fn case(name: impl Into<String>, view: View) -> Case {
    Case {
        name: name.into(),
        volume: ball(DAffine3::IDENTITY),
        transfer: tones(),
        view,
        size: [26, 22],
        settings: exact_quads(),
    }
}

fn oblique() -> View {
    View { azimuth: 33.0, elevation: 21.0, ..View::default() }
}

fn through(fov: f64, view: View) -> View {
    View { projection: ProjectionKind::Perspective { fov }, ..view }
}

#[test]
fn views_along_an_axis_and_a_diagonal() {
    hold_views(&[("along z", 0.0, 90.0), ("diagonal of the lattice", 45.0, 35.264_389_682_754_654)]);
}

#[test]
#[ignore = "slow: every model from four places"]
fn views_along_axes_diagonals_and_planes_of_voxels() {
    hold_views(&[
        ("along y", 0.0, 0.0),
        ("along x", 90.0, 0.0),
        ("diagonal of a face", 45.0, 0.0),
        ("along a plane of voxels", 26.565_051_177_077_99, 0.0),
    ]);
}

/// Holds views from places with an azimuth and an elevation.
fn hold_views(places: &[(&str, f64, f64)]) {
    let mut cases = Vec::new();
    for &(name, azimuth, elevation) in places {
        let view = View { azimuth, elevation, ..View::default() };
        cases.push(case(name, view.clone()));
        cases.push(case(format!("{name}, perspective"), through(40.0, view)));
    }
    hold(cases, &ALL);
}

#[test]
fn eyes_inside_on_voxels_on_faces_and_far_away() {
    // Looking along +y, the eye `distance` before the target.
    let at = |eye: DVec3, distance: f64| View {
        target: Some(eye + DVec3::Y * distance),
        distance: Some(distance),
        ..through(70.0, View::default())
    };
    let far = |sizes: f64| View { distance: Some(12.0 * sizes), view_height: Some(16.0), ..through(30.0, oblique()) };
    let mut cases = vec![
        case("eye on a voxel", at(DVec3::new(5.0, 3.0, 4.0), 4.0)),
        case("eye between voxels", at(DVec3::new(5.5, 2.5, 4.5), 4.0)),
        case("eye on a face", at(DVec3::new(5.3, -0.5, 4.1), 4.0)),
        case("eye in a plane of voxels", at(DVec3::new(5.3, -6.0, 4.0), 8.0)),
        case("eye in the middle", at(DVec3::new(5.5, 5.0, 4.5), 1e-3)),
    ];
    cases.extend([1e3, 1e5, 1e6, 1e7].map(|sizes| case(format!("eye {sizes:e} sizes away"), far(sizes))));
    hold(cases, &ALL);
}

#[test]
#[ignore = "slow: truths of grown kernels"]
fn fields_of_view_from_a_degree_to_170() {
    let fov = |fov: f64| {
        let view = if fov > 100.0 { View { distance: Some(9.0), ..oblique() } } else { oblique() };
        case(format!("field of view {fov} degrees"), through(fov, view))
    };
    // If kernels grow over the whole volume, the reference takes a minute for a picture of scalars.
    hold(vec![fov(170.0)], &["pre", "lit", "xray"]);
    let settings = Settings { antialiasing: false, ..exact_quads() };
    hold(vec![Case { settings, ..fov(170.0) }], &ALL);
    hold([0.01, 1.0, 90.0, 140.0].map(fov).into(), &ALL);
}

#[test]
#[ignore = "slow: truths of grown kernels"]
fn voxels_over_the_screen_and_volumes_in_a_pixel() {
    let zoomed = |name: &str, zoom: f64| case(name, View { zoom, ..oblique() });
    let large = |name: &str, zoom: f64| case(name, View { zoom, ..through(30.0, oblique()) });
    hold(
        vec![
            zoomed("a voxel over the screen", 40.0),
            large("the same, perspective", 40.0),
            zoomed("a thousandth of a voxel", 2e4),
            zoomed("two voxels to a pixel", 0.5),
        ],
        &ALL,
    );
    hold(vec![zoomed("the volume in a pixel", 0.04), large("the same, perspective", 0.04)], &["pre", "lit", "xray"]);
}

#[test]
fn pictures_of_odd_sizes() {
    // Pixels closer together than voxels.
    let sized = |size: [u32; 2]| {
        let view = View { view_height: Some(0.6 * f64::from(size[1])), ..oblique() };
        Case { size, ..case(format!("{} x {} pixels", size[0], size[1]), view) }
    };
    hold([[1, 1], [1, 777], [777, 1], [33, 7], [17, 19]].map(sized).into(), &ALL);
}

#[test]
#[ignore = "slow: over a hundred pictures and their truths"]
fn lattices_of_any_spacing_origin_shear_and_hand() {
    let spaced = |x: f64, y: f64, z: f64| DMat3::from_diagonal(DVec3::new(x, y, z));
    let sheared = DMat3::from_cols(DVec3::X, DVec3::new(0.7, 1.0, 0.2), DVec3::new(-0.4, 0.5, 1.2));
    let lattices = [
        ("spacing 1:1:50", spaced(1.0, 1.0, 50.0), 0.0),
        ("spacing 1:1:300", spaced(1.0, 1.0, 300.0), 0.0),
        ("spacing 1:1:1000", spaced(1.0, 1.0, 1000.0), 0.0),
        ("spacing 1000:1:1", spaced(1000.0, 1.0, 1.0), 0.0),
        ("spacing 1e-9", spaced(1e-9, 1e-9, 1e-9), 0.0),
        ("spacing 1e-15", spaced(1e-15, 1e-15, 1e-15), 0.0),
        ("spacing 1e9", spaced(1e9, 1e9, 1e9), 0.0),
        ("spacing 1e20", spaced(1e20, 1e20, 1e20), 0.0),
        ("origin 1e7, spacing 1e-6", spaced(1e-6, 1e-6, 1e-6), 1e7),
        ("origin 1e9, spacing 1e-3", spaced(1e-3, 1e-3, 1e-3), 1e9),
        ("sheared", sheared, 0.0),
        ("sheared by 10 voxels", DMat3::from_cols(DVec3::X, DVec3::new(10.0, 1.0, 0.0), DVec3::Z), 0.0),
        ("left-handed", spaced(-1.0, 1.0, 2.0), 5.0),
    ];
    for (name, matrix, origin) in lattices {
        let volume = ball(DAffine3::from_mat3_translation(matrix, DVec3::splat(origin)));
        let cases = vec![
            Case { volume: volume.clone(), ..case(name, oblique()) },
            Case { volume, ..case(format!("{name}, perspective"), through(40.0, oblique())) },
        ];
        // Truths of scalars with kernels grown a hundred times take minutes and gigabytes.
        let models = if name.contains("00") { &["pre", "lit", "xray"][..] } else { &ALL };
        hold(cases, models);
    }
}

#[test]
fn lattices_that_are_flat_are_refused() {
    for flatness in [0.0, 1e-300, 1e-9, 1e-5, 1e-3] {
        let flat = DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::new(0.6, 0.8, flatness));
        let e = Grid::new([4; 3], DAffine3::from_mat3(flat)).unwrap_err();
        assert!(matches!(&e, InputError::Volume(reason) if reason.contains("do not span space")), "{flatness}: {e}");
    }
    // A fifth of a degree, in any unit of length.
    for unit in [1.0, 1e-30, 1e30] {
        let flat = DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::new(0.6, 0.8, 3.5e-3)) * unit;
        assert!(Grid::new([4; 3], DAffine3::from_mat3(flat)).is_ok());
    }
}

#[test]
fn volumes_of_one_voxel_and_one_slice() {
    hold_shapes(&[[1; 3], [8, 1, 7]]);
}

#[test]
#[ignore = "slow: every model of three shapes"]
fn volumes_of_one_row_along_x_and_y() {
    hold_shapes(&[[9, 1, 1], [1, 9, 1], [2; 3]]);
}

fn hold_shapes(shapes: &[[u32; 3]]) {
    let shaped = |dims: [u32; 3]| {
        let count = dims.iter().product::<u32>();
        let samples = (0..count).map(|i| 90 + (37 * i % 160) as u8).collect();
        let volume = Volume::new(Grid::axis_parallel(dims, [1.0; 3]).unwrap(), Samples::U8(samples)).unwrap();
        [("", oblique()), (", along it", View::default()), (", perspective", through(40.0, oblique()))].map(
            |(what, view)| {
                let [x, y, z] = dims;
                Case { volume: volume.clone(), ..case(format!("{x} x {y} x {z}{what}"), view) }
            },
        )
    };
    hold(shapes.iter().copied().flat_map(shaped).collect(), &ALL);
}

#[test]
fn material_of_any_density() {
    let white = [1.0; 3];
    let constant = |value: u8| {
        let grid = Grid::axis_parallel([9; 3], [1.0; 3]).unwrap();
        Volume::new(grid, Samples::U8(vec![value; 729])).unwrap()
    };
    let opaque = transfer(&[(20.0, [0.1, 0.3, 0.9], 0.0), (100.0, [0.9, 0.5, 0.1], 1.0)], None);
    let opaque_in = |unit: f64| transfer(&[(50.0, [0.1, 0.3, 0.9], 0.0), (100.0, [0.9, 0.5, 0.1], 1.0)], Some(unit));
    let tenth = |opacity: f64| transfer(&[(0.0, white, 0.0), (200.0, [0.9, 0.5, 0.1], opacity)], None);
    let tones_of = |name: &str, transfer: TransferFunction| Case { transfer, ..case(name, oblique()) };
    // Voxel k has an extinction of 10^(k - 8).
    let unit = 1e-5;
    let decades: Vec<(f64, [f64; 3], f64)> = (0..15)
        .map(|k| {
            let opacity = -(-(10.0_f64.powi(k - 8) * unit)).exp_m1();
            (f64::from(k), [f64::from(k % 3) / 2.0, f64::from(k % 5) / 4.0, 0.5], opacity)
        })
        .collect();
    let row = Volume::new(Grid::axis_parallel([15, 1, 1], [1.0; 3]).unwrap(), Samples::U8((0..15).collect())).unwrap();
    hold(
        vec![
            Case {
                volume: row,
                transfer: transfer(&decades, Some(unit)),
                size: [60, 9],
                ..case("extinctions 1e-8 to 1e6", View { elevation: 20.0, ..View::default() })
            },
            tones_of("opacity 1", opaque.clone()),
            Case { transfer: opaque, ..case("opacity 1, perspective", through(40.0, oblique())) },
            tones_of("opacity 1, unit 0.02", opaque_in(0.02)),
            tones_of("opacity 1, unit 1e-3", opaque_in(1e-3)),
            tones_of("opacity 1e-4", tenth(1e-4)),
            tones_of("opacity 1e-12", tenth(1e-12)),
            Case { volume: constant(150), ..case("all voxels equal", oblique()) },
            Case { volume: constant(150), ..case("the same, along z", View { elevation: 90.0, ..View::default() }) },
            Case { volume: constant(3), ..case("all voxels invisible", oblique()) },
        ],
        &ALL,
    );
}

#[test]
fn thousands_of_sheets_of_almost_nothing() {
    let dims = [5, 4096, 5];
    let volume = Volume::new(Grid::axis_parallel(dims, [1.0; 3]).unwrap(), Samples::U8(vec![9; 5 * 5 * 4096])).unwrap();
    let transfer = transfer(&[(0.0, [1.0, 0.5, 0.2], 1e-4)], None);
    let view = View { view_height: Some(8.0), ..View::default() };
    let camera = look(&view, &volume, [9, 9]);
    // In the middle, over a kernel away from the faces: 4096 voxels, and the parts of the outermost kernels beyond
    // them.
    for settings in [exact_quads(), with_tiles(&exact_quads())] {
        let drawn = measured(&volume, &transfer, &camera, &settings).unwrap();
        let Outcome::Drawn(m, image) = drawn else { panic!("refused") };
        println!("4096 sheets of opacity 1e-4   pre   {m}");
        assert!(m.worst() <= 1.0, "{m}");
        let alpha = f64::from(image.pixels()[4 * 9 + 4][3]);
        let expected = 1.0 - (1.0_f64 - 1e-4).powi(4096);
        // Across, the sum of default Gaussians has ripples of 14 % from voxel to voxel, with a peak in the middle.
        assert!((alpha / expected - 1.0).abs() < 0.08, "{}: {alpha} {expected}", m.painter);
    }
}

#[test]
#[ignore = "slow: over a hundred pictures and their truths"]
fn kernels_from_half_a_voxel_to_six() {
    let kernels = [
        Kernel::Gaussian { sigma: 1.0, radius: 0.5 },
        Kernel::Gaussian { sigma: 0.25, radius: 0.5 },
        Kernel::Gaussian { sigma: 0.5, radius: 1.0 },
        Kernel::KaiserBessel { radius: 1.5, alpha: 6.0 },
        Kernel::KAISER_BESSEL,
        Kernel::KaiserBessel { radius: 3.0, alpha: 8.0 },
        Kernel::Gaussian { sigma: 2.0, radius: 6.0 },
    ];
    let mut cases = Vec::new();
    for kernel in kernels {
        for (what, view) in [("", oblique()), (", perspective", through(40.0, oblique()))] {
            let settings = Settings { kernel, ..exact_quads() };
            cases.push(Case { settings, ..case(format!("{kernel:?}{what}"), view) });
        }
    }
    hold(cases, &["pre", "xray", "post", "mip"]);
}

#[test]
fn sheets_of_any_thickness() {
    let sheets = |thickness: f64| Case {
        settings: thick(&exact_quads(), thickness),
        ..case(format!("sheets of {thickness} voxels"), oblique())
    };
    hold([0.05, 0.3, 1.0, 7.0, 64.0].map(sheets).into(), &["pre", "lit", "xray"]);
}

/// The same volume with its samples stored in another order.
fn reordered(volume: &Volume, axes: [usize; 3], reversed: [bool; 3]) -> Volume {
    let (old, values) = (volume.grid(), volume.in_memory().unwrap());
    let dims = axes.map(|axis| old.dims()[axis]);
    let mut samples = Vec::new();
    let mut lattice = [0; 3];
    for index in 0..dims.iter().product::<u32>() {
        let p = [index % dims[0], index / dims[0] % dims[1], index / (dims[0] * dims[1])];
        for (new, axis) in axes.into_iter().enumerate() {
            lattice[axis] = if reversed[new] { dims[new] - 1 - p[new] } else { p[new] };
        }
        let [x, y, z] = lattice;
        samples.push(values.value((x + old.dims()[0] * (y + old.dims()[1] * z)) as usize) as f32);
    }
    let old_axes = [old.to_world().matrix3.x_axis, old.to_world().matrix3.y_axis, old.to_world().matrix3.z_axis];
    let (mut matrix, mut origin) = ([DVec3::ZERO; 3], old.to_world().translation);
    for (new, axis) in axes.into_iter().enumerate() {
        matrix[new] = if reversed[new] { -old_axes[axis] } else { old_axes[axis] };
        if reversed[new] {
            origin += old_axes[axis] * f64::from(dims[new] - 1);
        }
    }
    let matrix = DMat3::from_cols(matrix[0], matrix[1], matrix[2]);
    Volume::new(Grid::new(dims, DAffine3::from_mat3_translation(matrix, origin)).unwrap(), Samples::F32(samples))
        .unwrap()
}

#[test]
fn the_order_of_splats_changes_what_rounding_does() {
    let (volume, transfer) = (ball(DAffine3::IDENTITY), tones());
    // A sum of n terms of one sign in f32 errs by (n - 1) 2^-24 of itself in any order; a ray meets 4 x 4 kernels of
    // each of 15 planes. Alpha shows at most 1/e of the relative change of depth, colour all of it; both orders err.
    // The rest comes from footprints at differently rounded places.
    let terms = 4.0 * 4.0 * 15.0;
    let bound = 2.0 * terms * 2.0_f64.powi(-24) + 5e-6;
    for (view, settings) in [
        (oblique(), exact_quads()),
        (through(40.0, oblique()), exact_quads()),
        (oblique(), Settings { model: Model::Xray, ..exact_quads() }),
    ] {
        let picture = |volume: &Volume| render(volume, &transfer, &look(&view, volume, [26, 22]), &settings);
        let expected = picture(&volume);
        for (axes, reversed) in [([0, 1, 2], [true; 3]), ([0, 1, 2], [true, false, false]), ([2, 0, 1], [false; 3])] {
            let (color, alpha) = errors(&picture(&reordered(&volume, axes, reversed)), &expected);
            println!("splats in another order      {axes:?} {reversed:?}: alpha {alpha:.1e}, colour {color:.1e}");
            assert!(alpha < bound && color < bound, "{axes:?} {reversed:?}: {alpha:e} {color:e} of {bound:e}");
        }
    }
}

#[test]
fn a_full_turn_ends_where_it_began() {
    let (volume, transfer) = (ball(DAffine3::IDENTITY), tones());
    for settings in [exact_quads(), with_tiles(&exact_quads())] {
        let at = |azimuth: f64| {
            let view = View { azimuth, elevation: 20.0, ..View::default() };
            render(&volume, &transfer, &look(&view, &volume, [26, 22]), &settings)
        };
        let expected = at(0.0);
        for turns in [1.0, -1.0, 1000.0] {
            let (color, alpha) = errors(&at(360.0 * turns), &expected);
            // The sine of 360000 degrees is 1e-12.
            assert!(color.max(alpha) < 1e-5, "{turns} turns: {color:e} {alpha:e}");
        }
    }
}

#[test]
fn nothing_is_drawn_of_samples_that_are_no_numbers() {
    let transfer = tones();
    let of = |value: f32| {
        let mut samples = vec![150.0; 6 * 6 * 6];
        (samples[17], samples[100], samples[60]) = (value, value, 10.0);
        Volume::new(Grid::axis_parallel([6; 3], [1.0; 3]).unwrap(), Samples::F32(samples)).unwrap()
    };
    // As if they had the invisible value next to the visible ones, or one that is given.
    let expected = of(transfer.base() as f32);
    let camera = look(&oblique(), &expected, [20, 20]);
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let gaps = of(value);
        for settings in [exact_quads(), Settings { shading: Shading::Post, ..exact_quads() }] {
            let picture = |volume: &Volume| render(volume, &transfer, &camera, &settings);
            assert!(picture(&gaps) == picture(&expected), "{value}");
            assert!(picture(&gaps.clone().with_non_finite_replaced(0.0).unwrap()) == picture(&of(0.0)), "{value}");
            let (small, of) = (look(&oblique(), &expected, [6, 6]), |volume: &Volume| {
                Reference::new(volume, &transfer, &settings).unwrap()
            });
            assert!(of(&gaps).render(&small).unwrap() == of(&expected).render(&small).unwrap(), "{value}");
            // Another function may show the value that stands for them.
            let mut scene = prepare_on(&renderer(), &gaps, &transfer, &settings).unwrap();
            let white = crate::support::transfer(&[(0.0, [1.0; 3], 0.5), (200.0, [1.0; 3], 0.5)], None);
            let error = renderer().set_transfer(&mut scene, &white).unwrap_err().to_string();
            assert!(error.contains("which stands for samples that are no numbers"), "{error}");
        }
        // In projections of intensity they never win.
        for (model, never) in [(Model::Mip, 10.0), (Model::Minip, 150.0)] {
            let settings = Settings { model, ..exact_quads() };
            let picture = |volume: &Volume| render(volume, &transfer, &camera, &settings);
            assert!(picture(&gaps) == picture(&of(never)), "{value}, {model:?}");
            // Values of a statistic are visible at both ends, and beside them is nothing.
            let sides = [(-3.0, 0.5), (-0.1, 0.0), (0.1, 0.0), (3.0, 0.5)].map(|(v, o)| (v, [1.0; 3], o));
            let mut scores = vec![value; 6 * 6 * 6];
            (scores[129], scores[86]) = (3.0, -3.0);
            let scores = Volume::from_slice([6; 3], [1.0; 3], &scores).unwrap();
            let picture = render(&scores, &crate::support::transfer(&sides, None), &camera, &settings);
            let corner = picture.pixels().first().unwrap();
            assert!(corner[3] == 0.0 && picture.pixels().iter().any(|pixel| pixel[3] > 0.0), "{value}, {model:?}");
        }
        // A brick may have nothing else.
        let none = Volume::from_slice([2; 3], [1.0; 3], &[value; 8]).unwrap();
        let picture = render(&none, &transfer, &camera, &exact_quads());
        assert!(picture.pixels().iter().all(|pixel| pixel[3] == 0.0), "{value}");
    }
}

#[test]
fn a_bound_that_is_broken_is_told() {
    // The check can fail: a picture of another volume is not the truth of this one.
    let (volume, transfer) = demo("sphere", 8);
    let camera = look(&oblique(), &volume, [8, 8]);
    let Ok(Outcome::Drawn(m, _)) = measured(&volume, &transfer, &camera, &exact_quads()) else { panic!("refused") };
    assert!(m.worst() < 1.0);
    let tight = Measured { bound: Bound { alpha: 1e-12, ..m.bound }, ..m };
    assert!(tight.worst() > 1.0);
}
