//! Clipping: clipped matter is gone and kept matter is unchanged, within the bounds of unclipped pictures.

use glam::{DAffine3, DMat3, DVec3};
use voxsplat::camera::{Camera, Hull, ProjectionKind, View};
use voxsplat::clip::{Clip, Plane};
use voxsplat::image::{Image, compare};
use voxsplat::kernel::Kernel;
use voxsplat::lighting::{Light, Lighting};
use voxsplat::reference::Reference;
use voxsplat::settings::{Level, Model, Settings, Shading};
use voxsplat::transfer::TransferFunction;
use voxsplat::volume::{Grid, Samples, Volume};

use crate::support::{
    PERSPECTIVE, PROJECTIONS, camera, demo, draw, exact_quads, full, look, picture, prepare, render, rms_covered,
    thick, transfer, with_tiles,
};
use crate::truth::truth;

fn plane(normal: [f64; 3], offset: f64) -> Plane {
    Plane::new(DVec3::from_array(normal), offset).unwrap()
}

fn clip(planes: &[([f64; 3], f64)]) -> Clip {
    Clip::new(planes.iter().map(|&(normal, offset)| plane(normal, offset)).collect()).unwrap()
}

fn clipped(settings: &Settings, clip: &Clip) -> Settings {
    Settings { clip: clip.clone(), ..settings.clone() }
}

/// A demo on a skewed lattice, four times as long along z.
fn skewed(name: &str, size: u32) -> (Volume, TransferFunction) {
    let (volume, transfer) = demo(name, size);
    let axes = DMat3::from_cols(DVec3::new(1.0, 0.2, 0.0), DVec3::new(0.3, 1.0, 0.1), DVec3::new(0.0, -0.4, 4.0));
    let grid = Grid::new(volume.grid().dims(), DAffine3::from_mat3_translation(axes, DVec3::new(50.0, -3.0, 7.0)));
    let memory = volume.in_memory().unwrap();
    let samples: Vec<f32> = (0..volume.grid().len() as usize).map(|i| memory.value(i) as f32).collect();
    (Volume::new(grid.unwrap(), Samples::F32(samples)).unwrap(), transfer)
}

/// Cuts of a cube of voxels: oblique, through voxels, between them, a wedge, a box.
fn cuts(volume: &Volume) -> Vec<(&'static str, Clip)> {
    let grid = volume.grid();
    let [n, ..] = grid.dims();
    let through = |normal: DVec3| Plane::through(grid.center() + grid.to_world().x_axis_shift(0.3), normal).unwrap();
    let oblique = through(DVec3::new(0.5, 0.7, -0.4));
    let wedge = vec![through(DVec3::new(1.0, 0.3, 0.2)), through(DVec3::new(-0.4, 1.0, -0.1))];
    vec![
        ("oblique", Clip::new(vec![oblique]).unwrap()),
        (
            "through voxels",
            Clip::new(vec![
                Plane::through(grid.to_world().transform_point3(DVec3::splat(f64::from(n / 2))), DVec3::Y).unwrap(),
            ])
            .unwrap(),
        ),
        ("wedge", Clip::new(wedge).unwrap()),
        ("box", Clip::of_voxels(grid, [n / 4..n - n / 4, n / 3..n, 0..n / 2]).unwrap()),
    ]
}

trait Shift {
    fn x_axis_shift(&self, voxels: f64) -> DVec3;
}

impl Shift for DAffine3 {
    fn x_axis_shift(&self, voxels: f64) -> DVec3 {
        self.matrix3.x_axis * voxels
    }
}

#[test]
#[ignore = "slow: 432 pictures beside the reference"]
fn cut_pictures_are_those_of_the_reference() {
    let lit = Some(Lighting { lights: vec![Light::HEADLIGHT], ..Lighting::default() });
    let base = Settings { antialiasing: false, level: Level::At(0), termination: 0.0, ..Settings::default() };
    let models = [
        ("pre", Settings { ..base.clone() }),
        ("pre lit", Settings { lighting: lit.clone(), ..base.clone() }),
        ("blob", Settings { kernel: Kernel::KAISER_BESSEL, ..base.clone() }),
        ("wide", Settings { kernel: Kernel::Gaussian { sigma: 1.2, radius: 3.0 }, ..base.clone() }),
        ("xray", Settings { model: Model::Xray, ..base.clone() }),
        ("post", Settings { shading: Shading::Post, ..base.clone() }),
        ("post lit", Settings { shading: Shading::Post, lighting: lit, ..base.clone() }),
        ("mip", Settings { model: Model::Mip, ..base.clone() }),
        ("average", Settings { model: Model::Average, ..base.clone() }),
    ];
    let mut failures = Vec::new();
    for (name, (volume, transfer)) in [("vessels", demo("vessels", 24)), ("skewed", skewed("marschner-lobb", 20))] {
        for projection in PROJECTIONS {
            let seen = camera(30.0, projection, &volume, 64);
            for (model, settings) in &models {
                let quads = crate::support::with_quads(settings, |_| {});
                let painters = [("quads", quads), ("tiles", with_tiles(settings))];
                let scene = prepare(&volume, &transfer, settings);
                let error = |settings: &Settings, cut: &Clip, of: &Image| {
                    let drawn = draw(&scene, &seen, &clipped(settings, cut)).image;
                    let max = compare(&drawn, of, 0.0).unwrap().max_channel.into_iter().fold(0.0, f64::max);
                    (rms_covered(&drawn, of), max)
                };
                let whole = truth(&volume, &transfer, &seen, settings);
                let uncut: Vec<(f64, f64)> = painters.iter().map(|(_, s)| error(s, &Clip::default(), &whole)).collect();
                for (cut_name, cut) in cuts(&volume) {
                    let expected = truth(&volume, &transfer, &seen, &clipped(settings, &cut));
                    for ((painter, settings), (usual, usual_max)) in painters.iter().zip(&uncut) {
                        let (rms, max) = error(settings, &cut, &expected);
                        let line = format!(
                            "{name} {projection:?} {model} {painter} {cut_name}: {rms:.1e} (usual {usual:.1e}), \
                             max {max:.1e} ({usual_max:.1e})"
                        );
                        // On a piece thinner than a slab, the mean of a ray is the mean of a short part of a parabola.
                        let thin = if settings.model == Model::Average { 4e-3 } else { 0.0 };
                        if rms > 1.6 * usual + 1e-4 + thin {
                            failures.push(line);
                        }
                    }
                }
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// The boxes of two cells along each axis, front to back along parallel rays.
fn boxes(grid: &Grid, forward: DVec3) -> Vec<Clip> {
    let dims = grid.dims();
    let along = grid.to_lattice().matrix3 * forward;
    let at = [dims[0] / 3, dims[1] / 2, dims[2] / 2 + 1];
    let mut boxes: Vec<(i32, Clip)> = (0..8)
        .map(|number: usize| {
            let far = |axis: usize| number >> axis & 1 == 1;
            let ranges = [0, 1, 2].map(|a| if far(a) { at[a]..dims[a] } else { 0..at[a] });
            let depth = (0..3).map(|a| if far(a) == (along[a] > 0.0) { 1 } else { 0 }).sum();
            (depth, Clip::of_voxels(grid, ranges).unwrap())
        })
        .collect();
    boxes.sort_by_key(|(depth, _)| *depth);
    boxes.into_iter().map(|(_, clip)| clip).collect()
}

/// Premultiplied pictures, the first in front.
fn composited(pictures: impl Iterator<Item = Vec<[f64; 4]>>) -> Vec<[f64; 4]> {
    pictures
        .reduce(|front, back| {
            front.iter().zip(back).map(|(f, b)| std::array::from_fn(|c| f[c] + (1.0 - f[3]) * b[c])).collect()
        })
        .unwrap()
}

fn largest_difference(a: &[[f64; 4]], b: &[[f64; 4]], channels: std::ops::Range<usize>) -> f64 {
    let pairs = a.iter().zip(b).flat_map(|(a, b)| a[channels.clone()].iter().zip(&b[channels.clone()]));
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

fn as_f64(image: &Image) -> Vec<[f64; 4]> {
    image.pixels().iter().map(|p| p.map(f64::from)).collect()
}

#[test]
fn disjoint_boxes_composited_are_the_whole() {
    for (volume, transfer) in [demo("vessels", 20), skewed("marschner-lobb", 16)] {
        let seen = camera(33.0, ProjectionKind::Orthographic, &volume, 31);
        let boxes = boxes(volume.grid(), seen.forward);
        let pixels: Vec<[u32; 2]> = (0..31 * 31).map(|i| [i % 31, i / 31]).collect();
        for shading in [Shading::Pre, Shading::Post] {
            let settings = Settings { shading, ..exact_quads() };
            // The reference, to its own precision.
            let integrated = |clip: &Clip| {
                let reference = Reference::new(&volume, &transfer, &clipped(&settings, clip)).unwrap();
                reference.pixels(&seen, &pixels).unwrap()
            };
            let whole = integrated(&Clip::default());
            let of_boxes = composited(boxes.iter().map(integrated));
            let apart = largest_difference(&whole, &of_boxes, 0..4);
            assert!(apart < 1e-9, "reference {shading}: {apart:e}");
            // Painters: pre-shaded alpha belongs to whole kernels. Colours within a sheet or slab have no order.
            let thin = thick(&settings, 0.25);
            let tiles = Settings { shading, ..full() };
            for (painter, settings, alpha, colors) in
                [("quads", &settings, 1e-6, 4e-4), ("quads, thin", &thin, 1e-6, 1e-5), ("tiles", &tiles, 4e-6, 2e-3)]
            {
                let scene = prepare(&volume, &transfer, settings);
                let drawn = |clip: &Clip| as_f64(&draw(&scene, &seen, &clipped(settings, clip)).image);
                let (whole, of_boxes) = (drawn(&Clip::default()), composited(boxes.iter().map(drawn)));
                let apart = [0..3, 3..4].map(|channels| largest_difference(&whole, &of_boxes, channels));
                // Post-shaded, a cut slab is classified in two parts: errors are errors of classification.
                let [colors, alpha] = if shading == Shading::Pre { [colors, alpha] } else { [3e-3; 2] };
                assert!(apart[1] < alpha && apart[0] < colors, "{painter} {shading}: {apart:?}");
            }
        }
    }
}

/// docs/guide/views.md has the figures.
#[test]
fn halves_of_magnified_folds_are_the_whole_with_a_ray_for_each_pixel() {
    let (volume, transfer) = demo("marschner-lobb", 20);
    let view = View { direction: Some(DVec3::new(1.0, 0.6, -0.4)), ..View::default() };
    let seen = look(&view, &volume, [48; 2]);
    let settings = with_tiles(&Settings { termination: 0.0, level: Level::At(0), ..Settings::default() });
    let scene = prepare(&volume, &transfer, &settings);
    for normal in [DVec3::X, DVec3::Y, DVec3::new(1.0, 1.0, 0.0)] {
        // The half towards the eye is in front.
        let halves = [-1.0, 1.0].map(|side| {
            let plane = Plane::through(volume.grid().center(), side * normal).unwrap();
            Clip::new(vec![plane]).unwrap()
        });
        let drawn = |clip: &Clip| as_f64(&draw(&scene, &seen, &clipped(&settings, clip)).image);
        let apart = largest_difference(&drawn(&Clip::default()), &composited(halves.iter().map(drawn)), 0..4);
        println!("{normal}: {apart:e}");
        assert!(apart < 5e-4, "{normal}: {apart:e}");
    }
}

/// The matter of a sheet has no order. So parts differ from the whole if a plane divides sheets, by the matter on
/// either side of it in the same sheet. If the plane runs between two sheets, only rounding differs.
#[test]
fn a_cut_between_sheets_divides_nothing() {
    let (volume, transfer) = demo("vessels", 24);
    let view = View { azimuth: 0.0, elevation: 0.0, ..View::default() };
    let seen = look(&view, &volume, [48; 2]);
    let apart = |thickness: f64, at: f64| {
        let settings = thick(&exact_quads(), thickness);
        let middle = volume.grid().center() + DVec3::Y * at;
        let near = Plane::through(middle, DVec3::NEG_Y).unwrap();
        let scene = prepare(&volume, &transfer, &settings);
        let drawn =
            |planes: Vec<Plane>| as_f64(&draw(&scene, &seen, &clipped(&settings, &Clip::new(planes).unwrap())).image);
        let (whole, parts) =
            (drawn(vec![]), composited([near, near.flipped()].map(|plane| drawn(vec![plane])).into_iter()));
        largest_difference(&whole, &parts, 0..3)
    };
    // Places of the plane in a sheet, in eighths of it.
    let along = |thickness: f64| (0..8_u8).map(move |i| f64::from(i) / 8.0 * thickness);
    let [one, quarter] =
        [1.0, 0.25].map(|thickness| along(thickness).map(|at| apart(thickness, at)).collect::<Vec<f64>>());
    println!("{one:?} {quarter:?}");
    let ends = |all: &[f64]| all.iter().fold([f64::INFINITY, 0.0_f64], |[low, high], &d| [low.min(d), high.max(d)]);
    let ([least, most], [_, thin]) = (ends(&one), ends(&quarter));
    assert!(least < 1e-6 && most > 1e-4 && thin < most / 8.0, "{one:?} {quarter:?}");
}

#[test]
fn a_slab_of_one_material_has_the_alpha_of_its_thickness() {
    let volume = Volume::from_slice([24; 3], [1.0; 3], &[1.0_f32; 24 * 24 * 24]).unwrap();
    let transfer = transfer(&[(0.0, [1.0; 3], 0.0), (1.0, [1.0; 3], 0.2)], None);
    let tau = -(0.8_f64.ln());
    for thickness in [0.01, 0.7, 3.0] {
        let normal = DVec3::new(0.2, 1.0, 0.3).normalize();
        let middle = volume.grid().center() + DVec3::splat(0.21);
        let ends = [(normal, -thickness / 2.0), (-normal, -thickness / 2.0)];
        let planes = ends.map(|(n, d)| Plane::through(middle + n * d, n).unwrap());
        let cut = Clip::new(planes.to_vec()).unwrap();
        for projection in PROJECTIONS {
            let view = View { azimuth: 10.0, elevation: 5.0, projection, ..View::default() };
            let seen = look(&view, &volume, [33; 2]);
            let (_, along) = seen.ray(0.0, 0.0);
            let expected = 1.0 - (-tau * thickness / along.dot(normal).abs()).exp();
            // The blob ripples by 5e-4, and parts of kernels are fits. The ends are rounded to 1e-6 of a voxel.
            for (shading, limit) in [(Shading::Pre, 2e-3), (Shading::Post, 2e-4 + 4e-6 / thickness)] {
                let settings = Settings { shading, kernel: Kernel::KAISER_BESSEL, ..exact_quads() };
                let tiles = Settings { shading, kernel: Kernel::KAISER_BESSEL, ..full() };
                for (painter, settings) in [("quads", settings), ("tiles", tiles)] {
                    let image = render(&volume, &transfer, &seen, &clipped(&settings, &cut));
                    let [_, _, _, alpha] = image.pixels()[33 * 16 + 16];
                    let off = (f64::from(alpha) - expected).abs() / expected;
                    assert!(off < limit, "{painter} {shading} {projection:?} {thickness}: {alpha} {expected}");
                }
            }
        }
    }
}

#[test]
fn planes_that_miss_change_nothing_and_planes_that_take_all_leave_nothing() {
    let (volume, transfer) = demo("vessels", 20);
    let misses = clip(&[([1.0, 0.0, 0.0], -100.0), ([0.3, -0.4, 0.2], -100.0)]);
    let takes = clip(&[([1.0, 0.0, 0.0], 100.0)]);
    let nothing = clip(&[([1.0, 0.0, 0.0], 9.0), ([-1.0, 0.0, 0.0], -8.5)]);
    for projection in PROJECTIONS {
        let seen = camera(20.0, projection, &volume, 32);
        for shading in Shading::ALL {
            for settings in [exact_quads(), full()] {
                let settings = Settings { shading, ..settings };
                let scene = prepare(&volume, &transfer, &settings);
                let drawn = |clip: &Clip| draw(&scene, &seen, &clipped(&settings, clip)).image;
                let apart = compare(&drawn(&Clip::default()), &drawn(&misses), 0.0).unwrap();
                assert!(apart.max_channel.into_iter().all(|d| d < 1e-6), "{projection:?} {shading} {apart:?}");
                for clip in [&takes, &nothing] {
                    assert!(drawn(clip).pixels().iter().all(|p| *p == [0.0; 4]), "{projection:?} {shading}");
                }
            }
        }
    }
}

#[test]
fn what_is_cut_away_casts_no_shadow() {
    // A ball under a plate; and without the plate.
    let sample = |plate: bool| {
        move |i: usize| {
            let [x, y, z] = [i % 24, i / 24 % 24, i / 576];
            let ball =
                [x, y, z].iter().zip([11.5, 11.5, 8.0]).map(|(&p, c)| (p as f32 - c).powi(2)).sum::<f32>() < 25.0;
            if ball || plate && z == 20 { 1.0_f32 } else { 0.0 }
        }
    };
    let volume = |plate| {
        let samples: Vec<f32> = (0..24 * 24 * 24).map(sample(plate)).collect();
        Volume::from_slice([24; 3], [1.0; 3], &samples).unwrap()
    };
    let (both, ball) = (volume(true), volume(false));
    let transfer = transfer(&[(0.0, [1.0; 3], 0.0), (1.0, [0.9, 0.7, 0.5], 0.5)], None);
    let cut = clip(&[([0.0, 0.0, -1.0], -17.0)]);
    let lights = vec![Light::directional(DVec3::new(0.2, -0.3, 1.0))];
    let lighting = Some(Lighting { lights, shadows: 1.0, exact_shadows: true, ..Lighting::default() });
    let seen = camera(20.0, ProjectionKind::Orthographic, &both, 48);
    for shading in Shading::ALL {
        for settings in [exact_quads(), full()] {
            let settings = Settings { shading, lighting: lighting.clone(), kernel: Kernel::KAISER_BESSEL, ..settings };
            let scene = prepare(&both, &transfer, &settings);
            let shaded = draw(&scene, &seen, &settings).image;
            let opened = draw(&scene, &seen, &clipped(&settings, &cut)).image;
            let alone = render(&ball, &transfer, &seen, &clipped(&settings, &cut));
            let [difference, before] = [&opened, &shaded].map(|image| rms_covered(image, &alone));
            // Post-shaded, light is interpolated in a texture as large as the visible part: software Vulkan rounds
            // its coordinates by more than the change of the cut.
            let limit = if shading == Shading::Pre { 1e-4 } else { 2e-2 };
            assert!(difference < limit && before > 0.1, "{shading} {difference:e} {before:e}");
            let reference = Reference::new(&both, &transfer, &clipped(&settings, &cut)).unwrap();
            let error = rms_covered(&opened, &reference.render(&seen).unwrap());
            assert!(error < if shading == Shading::Pre { 2e-3 } else { 2e-2 }, "{shading} {error:e}");
        }
    }
}

#[test]
fn a_plane_moves_without_classifying_the_scene() {
    let (volume, transfer) = demo("vessels", 24);
    let seen = camera(20.0, PERSPECTIVE, &volume, 24);
    for shading in Shading::ALL {
        let settings = Settings { shading, ..Settings::default() };
        let scene = prepare(&volume, &transfer, &settings);
        draw(&scene, &seen, &settings);
        for offset in [5.0, 9.0] {
            let stats = draw(&scene, &seen, &clipped(&settings, &clip(&[([1.0, 0.2, 0.0], offset)]))).stats;
            assert!(stats.stages.iter().all(|stage| stage.name != "classify"), "{:?}", stats.stages);
            let said = &serde_json::to_value(&stats).unwrap()["clip"];
            assert_eq!((said.as_array().unwrap().len(), &said[0]["offset"]), (1, &offset.into()));
            assert!((said[0]["normal"][1].as_f64().unwrap() - 0.2 / 1.04_f64.sqrt()).abs() < 1e-12);
        }
    }
}

#[test]
fn an_eye_among_what_was_cut_away_sees_what_is_left() {
    let (volume, transfer) = demo("vessels", 24);
    let cut = clip(&[([0.0, 1.0, 0.0], 14.0)]);
    let settings = clipped(&exact_quads(), &cut);
    // In the middle of the clipped part, looking at the rest.
    let view = View {
        projection: PERSPECTIVE,
        target: Some(DVec3::new(11.5, 18.0, 11.5)),
        distance: Some(12.0),
        ..View::default()
    };
    let seen: Camera = look(&view, &volume, [40; 2]);
    assert!((seen.eye().unwrap().y - 6.0).abs() < 1e-9);
    let rendered = picture(&volume, &transfer, &seen, &settings);
    let error = rms_covered(&rendered.image, &truth(&volume, &transfer, &seen, &settings));
    assert!(error < 2e-3, "{error:e}");
}

#[test]
fn a_picture_frames_what_is_left() {
    let (volume, transfer) = demo("sphere", 32);
    let hull = |clip: &Clip| Hull::of_visible(&volume, &transfer, clip).unwrap();
    let half = Clip::new(vec![Plane::through(volume.grid().center(), DVec3::Z).unwrap()]).unwrap();
    let height = |around| {
        let view = View { around, ..View::default() };
        look(&view, &volume, [64; 2]).target.z
    };
    let [whole, upper] = [Clip::default(), half].map(|clip| height(hull(&clip)));
    assert!(upper > whole + 0.2 * (volume.grid().corners(0.0)[7].z - whole), "{whole} {upper}");
    assert!(hull(&clip(&[([0.0, 0.0, 1.0], 1e3)])).is_none());
}
