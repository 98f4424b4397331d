//! The shadows of the device against the sums of the host.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};

use super::cells::CellSize;
use super::drawable::classified;
use super::levels::ScalarNeed;
use super::light_on_host::{self, ListedSplats};
use super::light_volume::LitScalars;
use super::scalar_cells::Coarse;
use super::scalars::{Emission, EmissionKey, Samples};
use super::shadows::{Occluders, Shadows, shaded};
use crate::camera::clip::{Clip, Plane};
use crate::gpu::adapter_test::adapter;
use crate::gpu::cache::Cache;
use crate::gpu::context::Context;
use crate::gpu::drawable::Drawable;
use crate::gpu::held_samples::HeldSamples;
use crate::gpu::layout::{LIT_WORDS, LightBox};
use crate::gpu::list::listed;
use crate::gpu::recorder::Recorder;
use crate::gpu::scalar_field::ScalarField;
use crate::gpu::transfer::TransferTable;
use crate::gpu::voxels::Voxels;
use crate::kernel::{Kernel, Normalization};
use crate::layers::Layers;
use crate::lighting::shadow::ShadowLattice;
use crate::lighting::shadow::plan::LightPlans;
use crate::lighting::{Light, Lighting, Normals};
use crate::progress::Progress;
use crate::transfer::bins::VisibleValues;
use crate::transfer::scalars::Reduction;
use crate::transfer::{ControlPoint, GradientPoint, Resolution, TransferFunction};
use crate::volume::{self, Grid, Volume};

/// Returns the shares of light at voxels, in 1/65535: of three lights and of ambient light.
fn shares(context: &Context, voxels: &Voxels) -> Vec<[u32; 4]> {
    let of_words = |low: u32, high: u32| [low & 0xffff, low >> 16, high & 0xffff, high >> 16];
    let lists = listed(context, &Cache::default(), voxels).unwrap();
    let read = ListedSplats::read(context, &lists).unwrap();
    // Without the place, the light follows three words.
    read.splats().flatten().map(|(_, words)| of_words(words[LIT_WORDS - 1], words[LIT_WORDS])).collect()
}

/// Returns the visible voxels.
fn voxels(context: &Context, volume: &Volume, transfer: &TransferFunction) -> Arc<Voxels> {
    let layers = Layers::of_volume(volume, transfer);
    classified(context, &layers, Some(Normals::default()), &Progress::default()).unwrap().0
}

/// Makes a volume of a lattice from the values at its points.
fn volume(grid: Grid, value: impl Fn([f64; 3]) -> f64) -> Volume {
    let [nx, ny, nz] = grid.dims();
    let points = (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z].map(f64::from))));
    Volume::new(grid, volume::Samples::U8(points.map(|point| value(point).clamp(0.0, 255.0) as u8).collect())).unwrap()
}

/// Returns a hash of a lattice point, 0 to 255.
fn noise([x, y, z]: [f64; 3]) -> f64 {
    let number = x as u32 + 977 * (y as u32 + 991 * z as u32);
    f64::from(number.wrapping_mul(2_654_435_761) >> 24)
}

/// Makes a transfer function of one opacity from a value on to 255.
fn opaque(from: f64, opacity: f64) -> TransferFunction {
    let point = |value, opacity| ControlPoint { value, color: [0.7, 0.8, 0.9], opacity };
    TransferFunction::new(vec![point(from, 0.0), point(255.0, opacity)], Some(1.0)).unwrap()
}

/// A volume of a test: a name, the volume, and its transfer function.
type Body = (&'static str, Volume, TransferFunction);

fn bodies() -> Vec<Body> {
    let skewed = DMat3::from_cols(DVec3::X, DVec3::new(0.2, 1.3, 0.0), DVec3::new(0.0, -0.3, 3.0));
    let skewed = Grid::new([40, 36, 20], DAffine3::from_mat3(skewed)).unwrap();
    // Longer than a part of a sweep along x and y, and off the faces of the volume.
    let long = Grid::axis_parallel([150, 74, 40], [1.0; 3]).unwrap();
    let ball = |[x, y, z]: [f64; 3]| {
        let distance = |c: [f64; 3]| DVec3::new(x, y, z).distance(DVec3::from_array(c));
        255.0 - 8.0 * distance([40.0, 30.0, 20.0]).min(distance([112.0, 40.0, 18.0]))
    };
    let grains = Grid::axis_parallel([70, 9, 33], [1.0, 1.0, 2.0]).unwrap();
    vec![
        ("noise on a skewed lattice", volume(skewed, noise), opaque(200.0, 0.9)),
        ("two faint balls", volume(long, ball), opaque(100.0, 0.2)),
        ("dense grains", volume(grains, noise), opaque(180.0, 0.99)),
    ]
}

/// Returns lights along all axes and between them, soft lights, lights at places, and occlusion: up to three lights at
/// a time.
fn lightings() -> Vec<(&'static str, Lighting)> {
    let along = |x: f64, y: f64, z: f64| Light::directional(DVec3::new(x, y, z));
    let at = |x: f64, y: f64, z: f64| Light::at(DVec3::new(x, y, z));
    let of = |lights: Vec<Light>| Lighting { lights, shadows: 0.9, shadow_bias: 1.5, ..Lighting::default() };
    vec![
        ("axes", of(vec![along(1.0, 0.0, 0.0), along(0.0, -1.0, 0.0), along(0.0, 0.0, 1.0)])),
        ("other axes", of(vec![along(-1.0, 0.0, 0.0), along(0.0, 1.0, 0.0), along(0.0, 0.0, -1.0)])),
        ("oblique", of(vec![along(-0.5, -0.7, 0.6), along(0.9, 0.2, -0.3), along(0.1, -0.4, -0.8)])),
        ("diagonals", of(vec![along(1.0, 1.0, 1.0), along(-1.0, 0.0, 1.0), along(1.0, -1.0, 0.0)])),
        (
            "soft lights",
            of([along(0.4, -0.7, 1.0), along(-1.0, 0.3, 0.4)].map(|light| Light { size: 10.0, ..light }).into()),
        ),
        ("a wide light", of(vec![Light { size: 100.0, ..along(0.4, -0.7, 1.0) }])),
        ("no bias", Lighting { shadow_bias: 0.0, ..of(vec![along(0.3, -0.9, 0.5)]) }),
        ("a large bias", Lighting { shadow_bias: 4.0, ..of(vec![along(0.3, 0.9, 0.5), along(-0.8, 0.0, 0.1)]) }),
        ("occlusion", Lighting { shadows: 0.0, occlusion: Some(8.0), ..of(Vec::new()) }),
        ("near occlusion", Lighting { occlusion: Some(1.0), shadow_bias: 0.0, ..of(vec![along(0.0, 0.3, 1.0)]) }),
        ("a light far away", of(vec![Light::at(DVec3::new(1e12, -2e12, 3e12))])),
        ("lights around", of(vec![at(-90.0, 20.0, 60.0), at(40.0, 400.0, 30.0), at(20.0, 10.0, -30.5)])),
        ("lights within", of(vec![at(20.0, 15.0, 25.0), at(30.3, 4.4, 20.7), at(39.5, 11.5, 3.5)])),
        ("distant lights", of(vec![at(3e3, -2e3, 1e3), at(-1e6, 2e6, 3e6), at(0.0, 0.0, -3e4)])),
    ]
}

/// Returns the shadows on a volume.
fn shadows(volume: &Volume, lighting: &Lighting, kernel: Kernel, clip: &Clip) -> Shadows {
    let divisor = Normalization::default().divisor(&kernel);
    Shadows {
        casting: lighting.casting().unwrap(),
        lattice: ShadowLattice::new(volume.grid(), kernel, divisor, 1.0, 1.0),
        clip: clip.sides(volume.grid()),
    }
}

/// Both ways find the same light, to 1e-3 of it on average. Where neighbours are left out because hardly any light is
/// left, which host and device decide on their own, they agree to the light that is left: exp(-5.5).
#[test]
fn device_finds_the_light_of_the_host() {
    light_of_device_and_host(1, 5);
}

#[test]
#[ignore = "slow: 14 sets of lights on each body, with and without a clip"]
fn device_finds_the_light_of_the_host_on_every_body() {
    light_of_device_and_host(usize::MAX, 1);
}

/// Compares the light on the first `bodies`, of every `step`th set of lights.
fn light_of_device_and_host(bodies: usize, step: usize) {
    let context = Context::new(Some(&adapter())).unwrap();
    let (pipelines, progress) = (Cache::default(), Progress::default());
    let kernels = [
        ("the default kernel", Kernel::default()),
        ("a Kaiser-Bessel kernel", Kernel::KAISER_BESSEL),
        ("a wide kernel", Kernel::Gaussian { sigma: 1.4, radius: 3.5 }),
    ];
    let clip = Clip::new(vec![Plane::new(DVec3::new(-0.8, 0.3, 0.1), -20.0).unwrap()]).unwrap();
    let mut worst = 0.0_f64;
    for (name, volume, transfer) in self::bodies().iter().take(bodies) {
        for (number, (light, lighting)) in lightings().iter().enumerate().step_by(step) {
            let (wide, kernel) = kernels[if number < 6 { 0 } else { number % 3 }];
            for clip in [Clip::default(), clip.clone()] {
                let shadows = shadows(volume, lighting, kernel, &clip);
                let made = voxels(&context, volume, transfer);
                let (of, occluders) = ((&context, &pipelines), Occluders::default());
                let device = shaded(of, (&made, false), None, &occluders, &shadows, &progress).unwrap().unwrap();
                let device = shares(&context, &device);
                let host = light_on_host::shaded(of, &made, &shadows, &progress).unwrap();
                let host = shares(&context, &host);
                assert!(host.len() > 1000 && host.len() == device.len(), "{name}: {} splats", host.len());
                let differences: Vec<f64> = host
                    .as_flattened()
                    .iter()
                    .zip(device.as_flattened())
                    .map(|(a, b)| f64::from(a.abs_diff(*b)) / 65_535.0)
                    .collect();
                let largest = differences.iter().copied().fold(0.0, f64::max);
                let above = differences.iter().filter(|difference| **difference > 1e-3).count();
                let shadowed = host.as_flattened().iter().filter(|share| **share < 50_000).count();
                let what = format!("{name}, {light}, {wide}, {} planes", shadows.clip.len());
                let of_light = |light: usize| {
                    let pairs = host.iter().zip(&device).map(|(a, b)| a[light].abs_diff(b[light]));
                    pairs.max().unwrap_or(0)
                };
                let by_light = [0, 1, 2, 3].map(of_light);
                println!(
                    "{what}: {by_light:?} {largest:.1e}, {above} of {} over 1e-3, {shadowed} shadowed",
                    differences.len()
                );
                assert!(shadowed > 100 || !shadows.clip.is_empty(), "{what}: nothing is shadowed");
                assert!(largest < 4.2e-3 && above * 20 < differences.len(), "{what}: {largest:e}, {above}");
                worst = worst.max(largest);
            }
        }
    }
    println!("largest difference {worst:.1e}");
}

/// Splats that hold light keep the shares of lights that stay, in their own memory if nothing else needs it, and the
/// device does its part without a wait of the host.
#[test]
fn device_keeps_the_light_that_stays() {
    let context = Context::new(Some(&adapter())).unwrap();
    let (pipelines, progress) = (Cache::default(), Progress::default());
    let (_, volume, transfer) = &bodies()[0];
    let made = voxels(&context, volume, transfer);
    let lighting = |towards: DVec3| Lighting {
        lights: vec![Light::directional(DVec3::new(0.3, -0.5, 1.0)), Light::directional(towards)],
        shadows: 1.0,
        occlusion: Some(4.0),
        ..Lighting::default()
    };
    let [first, second] = [DVec3::new(1.0, 0.2, 0.1), DVec3::new(-1.0, 0.3, -0.4)]
        .map(|towards| shadows(volume, &lighting(towards), Kernel::default(), &Clip::default()));
    let (of, occluders) = ((&context, &pipelines), Occluders::default());
    let run = |voxels: (&Voxels, bool), held: Option<&Shadows>, shadows: &Shadows| {
        shaded(of, voxels, held, &occluders, shadows, &progress).unwrap().unwrap()
    };
    let before = run((&made, false), None, &first);
    let waits = context.traffic().waits;
    let turned = run((&before, false), Some(&first), &second);
    let anew = run((&made, false), None, &second);
    let over = run((&before, true), Some(&first), &second);
    let none = shadows(volume, &Lighting { shadows: 0.0, ..lighting(DVec3::X) }, Kernel::default(), &Clip::default());
    let without = run((&turned, false), Some(&second), &none);
    assert_eq!(context.traffic().waits, waits);
    let expected = shares(&context, &anew);
    assert!(shares(&context, &turned) == expected);
    assert!(shares(&context, &over) == expected);
    // The memory is the same.
    assert!(shares(&context, &before) == expected);
    let without = shares(&context, &without);
    assert!(without.iter().zip(&expected).all(|(a, b)| a[..3] == [65_535; 3] && a[3] == b[3]));
    assert!(listed(&context, &pipelines, &made).unwrap().iter().all(|store| store.stride == 16));
}

/// The matter of scalars that casts shadows, isosurfaces too, is the same from samples on the device as from lists on
/// the host, but for the table of the device: a function is linear within each of its 1600 bins.
#[test]
fn device_finds_the_occluders_of_the_host() {
    let context = Context::new(Some(&adapter())).unwrap();
    let (pipelines, progress) = (Cache::default(), Progress::default());
    let kernel = Kernel::default();
    let clip = Clip::new(vec![Plane::new(DVec3::new(-0.8, 0.3, 0.1), -20.0).unwrap()]).unwrap();
    let steep = |magnitude, opacity| GradientPoint { magnitude, opacity };
    let cells = |size: CellSize| {
        let growth = super::cells::least_growth(&kernel, size);
        Some((Coarse::new(&kernel, growth, Some(size)), growth))
    };
    let [(_, noise, _), (_, balls, faint), _] = bodies().try_into().unwrap();
    let surface = |value, opacity| ControlPoint { value, color: [1.0; 3], opacity };
    let surfaces = [surface(110.0, 0.7), surface(140.0, 0.2)];
    // Cells are about the mean of noise.
    for (name, volume, transfer) in [("noise", noise, opaque(105.0, 0.9)), ("balls", balls, faint)] {
        let (volume, transfer) = (&volume, &transfer);
        let thinned = transfer.clone().with_gradient_opacity(vec![steep(1.0, 0.2), steep(12.0, 1.0)]).unwrap();
        let thinned = thinned.with_isosurfaces(&surfaces).unwrap();
        for (transfer, coarse) in [transfer, &thinned]
            .into_iter()
            .flat_map(|of| [None, cells(CellSize::VOXEL.next()), cells(CellSize::of_level(1))].map(|c| (of, c)))
        {
            let thins = !transfer.gradient_opacity().is_empty();
            let unit = 1.3;
            let grid = coarse.map_or(*volume.grid(), |(cells, _)| cells.grid(volume.grid()).unwrap());
            let of_cells = coarse.map_or(kernel, |(cells, growth)| cells.kernel(&kernel, growth));
            let shadows = Shadows {
                lattice: ShadowLattice::new(&grid, of_cells, 1.0, 1.0, 1.0),
                clip: clip.sides(&grid),
                ..shadows(volume, &Lighting::studio(DVec3::X, DVec3::Z), kernel, &clip)
            };
            let reduction = Reduction::new(transfer, 1.0);
            let need = ScalarNeed { influence: kernel.radius() + 2.0, zeros: true, ..ScalarNeed::NONE };
            let key = EmissionKey {
                kernel,
                normalization: Normalization::default(),
                need,
                lit: thins,
                coarse: coarse.map(|(cells, _)| cells),
                whole: false,
                reduction,
            };
            let emission = Emission::new(&context, volume, transfer, VisibleValues::Opaque, &key).unwrap();
            let held = HeldSamples::default();
            let sampled = emission.sampled((&context, &pipelines), transfer, (&held, true), &progress).unwrap();
            let Samples::Held(Drawable { scalars: Some((scalars, _)), .. }) = sampled else { panic!("{name}") };
            let resolution = Resolution::new(transfer, volume).unwrap();
            let table = TransferTable::new(&context, transfer, &reduction, VisibleValues::Opaque, &resolution);
            let of = ScalarField { scalars: &scalars, table: &table, grid: &grid, unit };
            let listed = emission.emit(&context, &progress).unwrap();
            // The box of the lists lies within the box of the samples.
            let plans = LightPlans::new(&shadows.casting, &shadows.lattice, of.bounds()).unwrap();
            let dims = plans.dims();
            let light_box = LightBox {
                low: plans.low().map(|n| n as i32),
                dims: dims.map(|n| n as u32),
                middle: shadows.lattice.dims.map(|n| (n - 1) as f32 / 2.0),
                clip_planes: std::array::from_fn(|n| match shadows.clip.get(n) {
                    Some((gradient, value)) => gradient.extend(*value).as_vec4().to_array(),
                    None => [0.0, 0.0, 0.0, 1.0],
                }),
                ..bytemuck::Zeroable::zeroed()
            };
            let usage = wgpu::BufferUsages::UNIFORM;
            let light_box = context.upload("test", bytemuck::bytes_of(&light_box), usage).unwrap();
            let count = dims.into_iter().product::<usize>();
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
            let field = context.buffer("test", 4 * count as u64, usage).unwrap();
            let mut recorder = Recorder::untimed(&context);
            of.fill(&mut recorder, &pipelines, [&light_box, &field]).unwrap();
            let field = recorder.read_back("test", &field, 4 * count as u64).unwrap();
            recorder.submit();
            let field: Vec<f32> = field.values(&context, "test").unwrap();
            let largest = TransferFunction::extinction(transfer.max_opacity(), 1.0) as f32;
            let (mut worst, mut matter) = (0.0_f32, 0);
            let surfaces = transfer.isosurfaces();
            let scalars = LitScalars { grid: &grid, transfer, reduction: &reduction, table: &table, unit, surfaces };
            let lists = listed.lists(&context, &pipelines).unwrap();
            let read = ListedSplats::read(&context, &lists).unwrap();
            for (point, words) in read.splats().flatten() {
                let expected = if shadows.casts(point) { scalars.density(words) } else { 0.0 };
                let [px, py, pz] = [0, 1, 2].map(|axis| (point[axis] as i64 - plans.low()[axis]) as usize);
                let found = field[px + dims[0] * (py + dims[1] * pz)];
                worst = worst.max((found - expected).abs() / largest);
                matter += usize::from(expected > 0.0 && found > 0.0);
            }
            println!("{name}, thinned {thins}, cells {:?}: {worst:.1e}, {matter}", coarse.map(|(cells, _)| cells));
            assert!(matter > 20, "{name}: {matter} occluders");
            assert!(worst < 2e-3, "{name}, thinned {thins}: {worst:e}");
        }
    }
}
