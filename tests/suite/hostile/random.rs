//! Scenes from a seed: volume, lattice, view, transfer function and settings. All painters draw each scene, and differ
//! from the reference within the bounds of `bounds.rs`.
//!
//! `VOXSPLAT_RANDOM_SEEDS=0..999 cargo test --test suite random:: -- --nocapture` draws a thousand scenes and prints a
//! table. A failure prints its seed and its scene; `VOXSPLAT_RANDOM_SEEDS=SEED..SEED` draws it again.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use glam::{DAffine3, DMat3, DVec3};
use voxsplat::camera::{Camera, ProjectionKind, View};
use voxsplat::clip::{Clip, Plane};
use voxsplat::error::Error;
use voxsplat::kernel::{Kernel, Normalization};
use voxsplat::lighting::Light;
use voxsplat::reference::Reference;
use voxsplat::settings::{Interslice, Level, Model, Settings, Shading, Sheets};
use voxsplat::transfer::{Classification, ControlPoint, TransferFunction};
use voxsplat::volume::{Grid, Samples, Volume};

use crate::hostile::bounds::{Measured, Outcome, measured};
use crate::support::{
    draw_on, errors, headlight, prepare_on, renderer, rms_covered, two_lights, with_cpu, with_quads, with_tiles,
};

/// Steele, Lea and Flood 2014, "Fast splittable pseudorandom number generators": a seed gives the same scene on every
/// machine.
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// From 0 to under 1.
    fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    fn whole(&mut self, low: u32, high: u32) -> u32 {
        low + (self.bits() % u64::from(high - low + 1)) as u32
    }

    /// True once in `n` times.
    fn once_in(&mut self, n: u32) -> bool {
        self.whole(1, n) == 1
    }

    fn of<T: Clone>(&mut self, choices: &[T]) -> T {
        choices[self.whole(0, choices.len() as u32 - 1) as usize].clone()
    }

    fn color(&mut self) -> [f64; 3] {
        std::array::from_fn(|_| self.unit())
    }
}

/// A scene, and the description of its parts.
struct Scene {
    kind: &'static str,
    volume: Volume,
    transfer: TransferFunction,
    view: View,
    size: [u32; 2],
    quads: Settings,
    tiles: Settings,
}

/// Values from 0 to 1 by lattice point, x fastest.
fn field(random: &mut Random, kind: &str, dims: [u32; 3]) -> Vec<f64> {
    let waves: Vec<(DVec3, f64)> = (0..4)
        .map(|_| {
            let wave = DVec3::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0), random.between(-1.0, 1.0));
            (wave, random.between(0.0, TAU))
        })
        .collect();
    let boxes: Vec<([f64; 6], f64)> = (0..3)
        .map(|_| {
            let mut ends = [0.0; 6];
            for axis in 0..3 {
                let [a, b] = [random.unit(), random.unit()].map(|u| u * f64::from(dims[axis]));
                (ends[axis], ends[axis + 3]) = (a.min(b), a.max(b));
            }
            (ends, random.unit())
        })
        .collect();
    let mut values = Vec::new();
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            for x in 0..dims[0] {
                let p = DVec3::new(f64::from(x), f64::from(y), f64::from(z));
                values.push(match kind {
                    "smooth" => 0.5 + waves.iter().map(|(w, phase)| (w.dot(p) + phase).sin()).sum::<f64>() / 8.0,
                    "boxes" => {
                        let inside = |e: &[f64; 6]| (0..3).all(|a| e[a] <= p[a] && p[a] <= e[a + 3]);
                        boxes.iter().rev().find(|(ends, _)| inside(ends)).map_or(0.0, |(_, value)| *value)
                    }
                    "bright voxels" => f64::from(u8::from(random.once_in(200))),
                    "constant" => 0.7,
                    _ => random.unit(),
                });
            }
        }
    }
    values
}

/// Samples of a type, and the values of 0 and 1 of the field.
fn samples(random: &mut Random, values: &[f64]) -> (Samples, [f64; 2]) {
    macro_rules! integers {
        ($type:ident, $variant:ident) => {{
            let (low, high) = ($type::MIN as f64, $type::MAX as f64);
            // Not the ends of 64 bits, which f64 cannot represent.
            let (low, high) = (low + (high - low) * 1e-3, high - (high - low) * 1e-3);
            let sample = |v: &f64| (low + v * (high - low)).round() as $type;
            (Samples::$variant(values.iter().map(sample).collect()), [low, high])
        }};
    }
    match random.whole(0, 9) {
        0 => integers!(u8, U8),
        1 => integers!(i8, I8),
        2 => integers!(u16, U16),
        3 => integers!(i16, I16),
        4 => integers!(u32, U32),
        5 => integers!(i32, I32),
        6 => integers!(u64, U64),
        7 => integers!(i64, I64),
        choice => {
            let unit = 10.0_f64.powi(random.whole(0, 12) as i32 - 6);
            let low = unit * random.of(&[0.0, -1.0, 3.0]);
            let value = |v: &f64| low + v * unit;
            let samples = if choice == 8 {
                Samples::F32(values.iter().map(|v| value(v) as f32).collect())
            } else {
                Samples::F64(values.iter().map(value).collect())
            };
            (samples, [low, low + unit])
        }
    }
}

fn lattice(random: &mut Random, dims: [u32; 3]) -> Grid {
    let unit = if random.once_in(3) { 10.0_f64.powi(random.whole(0, 12) as i32 - 6) } else { 1.0 };
    let spacing = random.of(&[[1.0, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 4.0], [2.0, 1.0, 0.5], [1.0, 10.0, 3.0]]);
    let mut matrix = DMat3::from_diagonal(DVec3::from_array(spacing));
    if random.once_in(3) {
        // Rotated and sheared.
        matrix = DMat3::from_rotation_x(random.between(0.0, TAU))
            * DMat3::from_rotation_z(random.between(0.0, TAU))
            * matrix;
        matrix.y_axis += matrix.x_axis * random.between(-0.5, 0.5);
    }
    if random.once_in(4) {
        // Left-handed.
        matrix.x_axis = -matrix.x_axis;
    }
    let far = random.of(&[0.0, 0.0, 100.0, 1e5]);
    let origin = unit * far * DVec3::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0), 1.0);
    Grid::new(dims, DAffine3::from_mat3_translation(matrix * unit, origin)).unwrap()
}

fn transfer_function(random: &mut Random, [low, high]: [f64; 2], min_spacing: f64) -> (&'static str, TransferFunction) {
    let at = |u: f64| low + u * (high - low);
    let opacity = random.of(&[0.02, 0.2, 0.6, 1.0, 1e-6]);
    let point = |value, color, opacity| ControlPoint { value, color, opacity };
    let (a, b) = (random.color(), random.color());
    let middle = random.between(0.1, 0.9);
    let (kind, points) = match random.whole(0, 5) {
        0 => ("one colour", vec![point(at(0.2), a, 0.0), point(at(1.0), a, opacity)]),
        1 => ("step", vec![point(at(middle), a, 0.0), point(at(middle), a, opacity), point(at(1.0), b, opacity)]),
        2 => (
            "narrow box",
            vec![
                point(at(middle), a, 0.0),
                point(at(middle), a, opacity),
                point(at(middle + 0.03), b, opacity),
                point(at(middle + 0.03), b, 0.0),
            ],
        ),
        3 => {
            let count = random.whole(20, 200);
            let mut values: Vec<f64> = (0..count).map(|_| at(random.unit())).collect();
            values.sort_by(f64::total_cmp);
            let points = values.into_iter().map(|value| {
                let (color, share) = (random.color(), random.unit());
                point(value, color, opacity * share)
            });
            ("many points", points.collect())
        }
        4 => ("visible everywhere", vec![point(at(0.0), a, opacity / 2.0), point(at(1.0), b, opacity)]),
        _ => ("ramp", vec![point(at(0.1), a, 0.0), point(at(0.6), b, opacity), point(at(1.0), a, opacity / 4.0)]),
    };
    let unit = random.of(&[None, None, Some(0.25), Some(4.0)]).map(|u: f64| u * min_spacing);
    (kind, TransferFunction::new(points, unit).unwrap())
}

fn view(random: &mut Random, grid: &Grid) -> View {
    let extent = grid.corners(0.5)[7].distance(grid.corners(0.5)[0]);
    let perspective = random.once_in(2);
    let fov = random.of(&[1.0, 20.0, 40.0, 60.0, 100.0, 150.0]);
    // Inside, at a corner, near, and far away; most are fitted.
    let distance = random.of(&[None, None, None, None, Some(0.1), Some(0.5), Some(3.0), Some(1e3), Some(1e5)]);
    let distance = distance.map(|d: f64| d * extent).filter(|_| perspective);
    let angle = |random: &mut Random| {
        if random.once_in(3) {
            random.of(&[0.0, 45.0, 90.0, 35.264_389_682_754_654])
        } else {
            random.between(-90.0, 90.0)
        }
    };
    View {
        azimuth: angle(random) * random.of(&[1.0, -2.0]),
        elevation: angle(random),
        roll: random.of(&[0.0, 0.0, 30.0, 90.0]),
        projection: if perspective { ProjectionKind::Perspective { fov } } else { ProjectionKind::Orthographic },
        zoom: random.of(&[1.0, 1.0, 1.0, 0.5, 3.0]),
        // A distant eye looks through a small angle.
        view_height: distance.filter(|d| *d > 10.0 * extent).map(|_| extent),
        distance,
        ..View::default()
    }
}

/// The settings for both painters: equal except for the painters' own settings.
fn settings(random: &mut Random) -> [Settings; 2] {
    let (model, shading) = random.of(&[
        (Model::Composite, Shading::Pre),
        (Model::Composite, Shading::Pre),
        (Model::Composite, Shading::Post),
        (Model::Xray, Shading::Pre),
        (Model::Mip, Shading::Pre),
    ]);
    let lighting = match random.whole(0, 3) {
        0 if model == Model::Composite => headlight(),
        1 if model == Model::Composite => two_lights(),
        _ => None,
    };
    let kernel = random.of(&[
        Kernel::default(),
        Kernel::default(),
        Kernel::KAISER_BESSEL,
        Kernel::Gaussian { sigma: 0.5, radius: 1.0 },
        Kernel::Gaussian { sigma: 0.7, radius: 1.5 },
        Kernel::Gaussian { sigma: 1.2, radius: 3.0 },
        Kernel::KaiserBessel { radius: 1.5, alpha: 6.0 },
    ]);
    let light = random.of(&[Some(Light::HEADLIGHT), None]).is_some();
    let settings = Settings {
        model,
        shading,
        lighting: lighting.filter(|_| light),
        interslice: Interslice::Parabola,
        termination: random.of(&[0.0, 1e-3, 1e-3, 1e-2]),
        antialiasing: random.once_in(2),
        kernel,
        normalization: if random.once_in(8) { Normalization::Peak } else { Normalization::Unit },
        // Post-shaded, cells keep the cost of small pictures within bounds.
        level: if model == Model::Mip || shading == Shading::Post { Level::Auto } else { Level::At(0) },
        ..Settings::default()
    };
    let pre = model == Model::Composite && shading == Shading::Pre;
    let quads = with_quads(&settings, |q| {
        q.sheet_thickness =
            if settings.is_post_shaded() { random.of(&[0.5, 1.0]) } else { random.of(&[0.25, 1.0, 3.0]) };
        q.sheets = if pre && random.once_in(8) { Sheets::Axis } else { Sheets::Image };
    });
    let tiles = with_tiles(&settings);
    [quads, tiles]
}

/// One or two planes through the lattice, in a third of the scenes.
fn clip(random: &mut Random, grid: &Grid) -> Clip {
    let count = if random.once_in(3) { random.whole(1, 2) } else { 0 };
    let plane = |_| {
        let [a, b] = [0, 1].map(|_| DVec3::from_array([0; 3].map(|_| random.unit())));
        let place = grid.to_world().transform_point3(a * DVec3::from_array(grid.dims().map(f64::from)) - 0.5);
        Plane::through(place, b - 0.5).unwrap()
    };
    Clip::new((0..count).map(plane).collect()).unwrap()
}

fn scene(seed: u64) -> Scene {
    scene_within(seed, [2, 14])
}

/// A scene of a volume with this number of voxels along an axis.
fn scene_within(seed: u64, [least, most]: [u32; 2]) -> Scene {
    let random = &mut Random(seed);
    let kind = random.of(&["smooth", "noise", "boxes", "bright voxels", "constant", "one voxel", "row", "slice"]);
    let side = |random: &mut Random| random.whole(least, most);
    let dims = match kind {
        "one voxel" => [1; 3],
        "row" => [side(random), 1, 1],
        "slice" => [side(random), 1, side(random)],
        _ => [side(random), side(random), side(random)],
    };
    let values = field(random, kind, dims);
    let (samples, range) = samples(random, &values);
    let grid = lattice(random, dims);
    let volume = Volume::new(grid, samples).unwrap();
    let (_, transfer) = transfer_function(random, range, grid.min_spacing());
    let view = view(random, &grid);
    let size = [random.whole(1, 40), random.whole(8, 40)];
    // Separate sequences: clipping and classification do not change the scene of a seed.
    let clip = clip(&mut Random(seed ^ 0x5851_f42d_4c95_7f2d), &grid);
    let classified = Random(seed ^ 0x1405_7b7e_f767_814f).of(&Classification::ALL);
    let transfer = transfer.with_classification(classified);
    let [quads, tiles] = settings(random).map(|settings| Settings { clip: clip.clone(), ..settings });
    Scene { kind, volume, transfer, view, size, quads, tiles }
}

/// A scene whose kernels have grown 1.5 to 8 times, drawn at the level of `auto`.
fn minified(seed: u64) -> Scene {
    let scene = scene_within(seed, [12, 40]);
    let random = &mut Random(seed ^ 0x2545_f491_4f6c_dd1d);
    let [nx, ny, nz] = scene.volume.grid().dims();
    let pixels = (f64::from(nx.max(ny).max(nz)) / random.between(1.5, 8.0)).ceil() as u32 + 2;
    let view = View { zoom: 1.0, distance: None, view_height: None, ..scene.view };
    let auto = |settings: Settings| Settings { level: Level::Auto, antialiasing: true, termination: 0.0, ..settings };
    // Thin sheets, so that the error comes from the cells.
    let quads = with_quads(&auto(scene.quads), |q| (q.sheets, q.sheet_thickness) = (Sheets::Image, 0.25));
    Scene { view, size: [pixels; 2], quads, tiles: auto(scene.tiles), ..scene }
}

impl Scene {
    /// The description of the scene, without the samples.
    fn describe(&self, seed: u64) -> String {
        let Self { kind, volume, transfer, view, size, quads, tiles } = self;
        format!(
            "VOXSPLAT_RANDOM_SEEDS={seed}..{seed}\n{kind}, {} samples, {:?}\n{transfer:?}\n{view:?}, {size:?} pixels\n\
             {quads:?}\n{:?}",
            volume.sample_type(),
            volume.grid(),
            tiles.painter
        )
    }

    /// Draws and measures the scene, and returns the painters that drew it.
    fn check(&self) -> Result<Vec<Measured>, String> {
        let camera = match Camera::new(&self.view, self.volume.grid(), self.size) {
            Err(Error::Camera(_)) => return Ok(Vec::new()),
            camera => camera.map_err(|e| format!("{e:#}"))?,
        };
        // If the reference refuses a scene, the renderer refuses it too.
        if let Err(e) = Reference::new(&self.volume, &self.transfer, &self.quads) {
            let refused = measured(&self.volume, &self.transfer, &camera, &self.quads)?;
            return match refused {
                Outcome::Refused(_) => Ok(Vec::new()),
                Outcome::Drawn(..) => Err(format!("the reference refuses what is drawn: {e:#}")),
            };
        }
        let mut drawn = Vec::new();
        for settings in [&self.quads, &self.tiles, &with_cpu(&self.tiles)] {
            match measured(&self.volume, &self.transfer, &camera, settings)? {
                Outcome::Drawn(m, image) => drawn.push((m, image)),
                Outcome::Refused(reason) => println!("refused: {reason}"),
            }
        }
        for (m, _) in &drawn {
            if m.worst() > 1.0 {
                return Err(format!("{m}, worst at {:?}", m.pixel));
            }
        }
        if let [(a, first), (b, second), ..] = drawn.as_slice() {
            let (color, alpha) = errors(first, second);
            if color > a.bound.color + b.bound.color || alpha > a.bound.alpha + b.bound.alpha {
                return Err(format!("the painters differ by {color:.1e} and {alpha:.1e} of alpha"));
            }
        }
        Ok(drawn.into_iter().map(|(m, _)| m).collect())
    }
}

/// The first and the last seed: from the environment, or these defaults.
fn seeds(usual: &str) -> (u64, u64) {
    let seeds = std::env::var("VOXSPLAT_RANDOM_SEEDS").unwrap_or_else(|_| usual.to_owned());
    let (first, last) = seeds.split_once("..").unwrap();
    (first.parse().unwrap(), last.parse().unwrap())
}

#[test]
fn random_scenes_keep_within_their_bounds() {
    check_scenes(seeds("0..14"));
}

#[test]
#[ignore = "slow: 200 scenes and their truths"]
fn many_random_scenes_keep_within_their_bounds() {
    check_scenes((15, 214));
}

fn check_scenes((first, last): (u64, u64)) {
    // The number of scenes, the worst fraction of the bound, its seed and its errors, by painter and kind of picture.
    let mut worst: BTreeMap<String, (u32, f64, u64, String)> = BTreeMap::new();
    let mut failures = Vec::new();
    for seed in first..=last {
        let scene = scene(seed);
        let result = std::panic::catch_unwind(|| scene.check())
            .unwrap_or_else(|e| Err(format!("panics: {:?}", e.downcast_ref::<String>())));
        let measured = result.unwrap_or_else(|e| {
            println!("{e}\n{}\n", scene.describe(seed));
            failures.push(format!("{seed}: {e}"));
            Vec::new()
        });
        for m in measured {
            let Settings { model, shading, lighting, .. } = &scene.quads;
            let lit = if lighting.is_some() { ", lit" } else { "" };
            let shading = if *model == Model::Composite { format!(", {shading}") } else { String::new() };
            let row = worst.entry(format!("{} {model}{shading}{lit}", m.painter)).or_default();
            row.0 += 1;
            if m.worst() > row.1 {
                (row.1, row.2, row.3) = (m.worst(), seed, m.to_string());
            }
            if m.seconds > 2.0 {
                println!("seed {seed} took {:.1} s with {}", m.seconds, m.painter);
            }
        }
    }
    for (class, (count, fraction, seed, text)) in worst {
        println!(
            "{class:<28} {count:>4} pictures, worst {:>3.0} % of the bound, seed {seed}: {text}",
            100.0 * fraction
        );
    }
    assert!(failures.is_empty(), "{} of {}:\n{}", failures.len(), last - first + 1, failures.join("\n"));
}

/// `VOXSPLAT_RANDOM_SEEDS=0..999` draws a thousand.
#[test]
fn cells_are_taken_only_where_they_are_right() {
    check_cells(seeds("0..5"));
}

#[test]
#[ignore = "slow: 54 scenes of small voxels and their truths"]
fn cells_of_many_scenes_are_taken_only_where_they_are_right() {
    check_cells((6, 59));
}

fn check_cells((first, last): (u64, u64)) {
    // The numbers of pictures, of pictures with cells, and of these over 2 of 255 (rms), the worst and its seed, by
    // kind.
    let mut rows: BTreeMap<String, (u32, u32, u32, f64, u64)> = BTreeMap::new();
    let mut failures = Vec::new();
    for seed in first..=last {
        let scene = minified(seed);
        let Ok(camera) = Camera::new(&scene.view, scene.volume.grid(), scene.size) else { continue };
        let Ok(reference) = Reference::new(&scene.volume, &scene.transfer, &scene.quads) else { continue };
        let Ok(expected) = reference.render(&camera) else { continue };
        for settings in [&scene.quads, &scene.tiles] {
            let Ok(prepared) = prepare_on(&renderer(), &scene.volume, &scene.transfer, settings) else { continue };
            let rms = |settings: &Settings| {
                let got = draw_on(&renderer(), &prepared, &camera, settings).ok()?;
                Some((255.0 * rms_covered(&got.image, &expected), got.stats))
            };
            let Some((error, stats)) = rms(settings) else { continue };
            let Settings { model, lighting, .. } = settings;
            let lit = if lighting.is_some() { ", lit" } else { "" };
            let eye = if stats.perspective { ", perspective" } else { "" };
            let post = settings.is_post_shaded();
            let shading = if post { "post" } else { "pre" };
            let row = rows.entry(format!("{} {model}, {shading}{lit}{eye}", stats.painter.name())).or_default();
            row.0 += 1;
            if stats.levels[1] == 0.0 {
                continue;
            }
            row.1 += 1;
            row.2 += u32::from(error > 2.0);
            if error > row.3 {
                (row.3, row.4) = (error, seed);
            }
            if error > 2.0 {
                let voxels = with_quads(&Settings { level: Level::At(0), ..settings.clone() }, |quads| {
                    (quads.sheets, quads.sheet_thickness) = (Sheets::Image, 0.25);
                });
                let of_voxels = rms(&voxels).map_or(0.0, |(error, _)| error);
                let text = format!(
                    "{seed}: {} {:?} err by {error:.2} of 255 (rms), quads of voxels by {of_voxels:.2}",
                    stats.painter.name(),
                    stats.levels
                );
                println!("{text}\n{}\n", scene.describe(seed));
                if !post {
                    failures.push(text);
                }
            }
        }
    }
    for (kind, (pictures, cells, over, worst, seed)) in rows {
        println!("{kind:<40} {pictures:>4}, of cells {cells:>4}, over 2: {over:>3}, at most {worst:>6.2}, seed {seed}");
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}
