//! Each GPU stage against its CPU twin, on the adapter of the tests.

use glam::{DAffine3, DMat3, DVec2, DVec3};

use super::adapter_test::adapter;
use super::cache::Cache;
use super::context::Context;
use super::held_samples::HeldSamples;
use super::kept_voxels::KeptVoxels;
use super::layout::Splat;
use super::list::listed;
use super::recorder::Recorder;
use super::samples::Input;
use super::savings::Savings;
use super::scan::Scan;
use super::store::Store;
use super::twins_test::{self as twins, Voxel};
use super::view::{ViewGeometry, Weights};
use super::voxels::Voxels;
use crate::appearance::demos;
use crate::camera::{Camera, ProjectionKind, View};
use crate::formats::{LoadOptions, load};
use crate::frame::Frame;
use crate::image::Region;
use crate::kernel::FootprintTable;
use crate::layers::Layers;
use crate::lighting::Normals;
use crate::painters::quads::plan::{Plan, Target};
use crate::painters::quads::sort::Sorter;
use crate::prepare::drawable::classified as classified_on_host;
use crate::progress::Progress;
use crate::renderer::{Rendered, Renderer, RendererOptions};
use crate::settings::{Accumulation, Level, Model, Painter, Precision, QuadsSettings, Settings, Sheets};
use crate::transfer::{Classification, ControlPoint, GradientPoint, TransferFunction};
use crate::volume::{Grid, Samples, Volume};

fn context() -> Context {
    Context::new(Some(&adapter())).unwrap()
}

fn download(context: &Context, buffer: &wgpu::Buffer, bytes: u64) -> Vec<u8> {
    let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
    let staging = context.buffer("test.staging", bytes, usage).unwrap();
    let mut encoder = context.device.create_command_encoder(&Default::default());
    encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, bytes);
    context.queue.submit([encoder.finish()]);
    context.wait("test").unwrap();
    context.read_done("test", staging, bytes, <[u8]>::to_vec).unwrap()
}

fn words(bytes: &[u8]) -> Vec<u32> {
    bytes.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect()
}

/// Returns the visible voxels of a volume as lists of splats.
fn classified(context: &Context, volume: &Volume, transfer: &TransferFunction, lit: Option<Normals>) -> Vec<Store> {
    let (pipelines, held, kept) = (Cache::default(), HeldSamples::default(), KeptVoxels::default());
    let progress = Progress::default();
    let input = Input::new(context, volume, transfer, lit, &progress).unwrap();
    let (voxels, _) = Voxels::of_samples(&pipelines, &input, &held, &kept).unwrap();
    listed(context, &pipelines, &voxels).unwrap()
}

/// The classifier of layers on the host gives the same splats as the stage on the device, but for rounding.
#[test]
fn classify_on_the_host_matches_the_device() {
    let context = context();
    let dims = [70, 37, 35];
    let values: Vec<i32> =
        (0..dims.into_iter().product()).map(|i: u32| (i * 37 % 251 * (i / 70 % 5) / 8) as i32).collect();
    macro_rules! each {
        ($($variant:ident: $t:ty),*) => {
            vec![$(Samples::$variant(values.iter().map(|&v| (v - 20) as $t).collect())),*]
        };
    }
    let (mut splats, mut other) = (0, 0);
    for samples in each!(U8: u8, I8: i8, U16: u16, I16: i16, I32: i32, F32: f32) {
        for (slope, lit, thins) in [(1.0, false, false), (0.37, true, false), (-1.0, true, true), (0.5, false, true)] {
            let what = format!("{} {slope} {lit} {thins}", samples.sample_type());
            let grid = Grid::axis_parallel(dims, [1.0, 0.8, 1.7]).unwrap();
            let volume = Volume::new(grid, samples.clone()).unwrap().with_rescale(slope, 0.5).unwrap();
            let point = |magnitude, opacity| GradientPoint { magnitude, opacity };
            let thinning = if thins { vec![point(1.013, 0.0), point(4.0, 0.7), point(20.0, 1.0)] } else { Vec::new() };
            let transfer = steps().with_gradient_opacity(thinning).unwrap();
            let progress = Progress::default();
            // Powers of tensors magnify rounding.
            let normals = lit.then_some(Normals::Gradient);
            let device = classified(&context, &volume, &transfer, normals);
            let (host, _) =
                classified_on_host(&context, &Layers::of_volume(&volume, &transfer), normals, &progress).unwrap();
            let host = listed(&context, &Cache::default(), &host).unwrap();
            let all = |stores: &[Store]| -> Vec<(Voxel, u32)> {
                let normals = |store: &Store| {
                    let bytes = download(&context, &store.splats, u64::from(store.count) * 16);
                    let splats: Vec<Splat> = bytes.chunks_exact(16).map(bytemuck::pod_read_unaligned).collect();
                    splats.into_iter().map(|splat| splat.normal).collect::<Vec<_>>()
                };
                let normals = stores.iter().flat_map(normals);
                downloaded(&context, stores).into_iter().zip(normals).collect()
            };
            let (host, device) = (all(&host), all(&device));
            assert_eq!(host.len(), device.len(), "{what}");
            for ((host, host_normal), (device, normal)) in host.into_iter().zip(device) {
                splats += 1;
                other += usize::from(host != device || host_normal != normal);
                assert_eq!(host.point, device.point, "{what}");
                // A step of 13 or 14 bits.
                assert!(
                    (0..3).all(|c| (host.color[c] - device.color[c]).abs() < 1.3e-4),
                    "{what}: {host:?} {device:?}"
                );
                // A step of 15 bits: logarithms of drivers err by some units of the last of 24.
                assert!(
                    (host.density - device.density).abs() <= 3.1e-5 * device.density,
                    "{what}: {host:?} {device:?}"
                );
                // A step of 16 bits.
                let coordinates = |normal: u32| [normal << 16, normal].map(|bits| bits as i32 >> 16);
                let mut pairs = coordinates(host_normal).into_iter().zip(coordinates(normal));
                assert!(!lit || pairs.all(|(h, d)| h.abs_diff(d) <= 1), "{what}: {host_normal:x} {normal:x}");
            }
        }
    }
    println!("{other} of {splats} splats differ in some bit");
    assert!(splats > 100_000 && other * 20 < splats, "{other} of {splats}");
}

fn downloaded(context: &Context, stores: &[Store]) -> Vec<Voxel> {
    let read = |s: &Store| {
        let origins: Vec<[u32; 3]> = s.bricks.iter().map(|b| b.origin).collect();
        let bytes = download(context, &s.splats, u64::from(s.count) * 16);
        let splats: Vec<Splat> = bytes.chunks_exact(16).map(bytemuck::pod_read_unaligned).collect();
        // Bricks say where their splats begin.
        for (number, brick) in (0..).zip(&s.bricks) {
            let first = splats.iter().position(|splat| splat.place >> 15 == number);
            assert!(first.is_none_or(|first| first as u32 == brick.first), "{number}");
        }
        splats.iter().map(|splat| twins::unpack(splat, &origins)).collect::<Vec<_>>()
    };
    stores.iter().flat_map(read).collect()
}

fn steps() -> TransferFunction {
    let p = |value, color, opacity| ControlPoint { value, color, opacity };
    TransferFunction::new(
        vec![
            p(-20.0, [0.0, 0.2, 0.4], 0.0),
            p(3.0, [0.0, 0.2, 0.4], 0.0),
            p(3.0, [1.0, 0.5, 0.25], 0.0005),
            p(40.0, [0.3, 0.9, 0.1], 0.3),
            p(90.0, [0.6, 0.0, 1.0], 1.0),
        ],
        Some(2.0),
    )
    .unwrap()
}

#[test]
fn classify_matches_its_twin_for_every_type() {
    let context = context();
    let dims = [7, 5, 9];
    let values: Vec<i32> = (0..7 * 5 * 9).map(|i| i * 37 % 128).collect();
    macro_rules! each {
        ($($variant:ident: $t:ty),*) => {
            vec![$(Samples::$variant(values.iter().map(|&v| v as $t).collect())),*]
        };
    }
    let all = each!(U8: u8, I8: i8, U16: u16, I16: i16, U32: u32, I32: i32, U64: u64, I64: i64, F32: f32, F64: f64);
    for samples in all {
        let name = samples.sample_type();
        for (slope, intercept) in [(1.0, 0.0), (0.5, -20.0), (-1.0, 100.0)] {
            let grid = Grid::axis_parallel(dims, [1.0; 3]).unwrap();
            let volume = Volume::new(grid, samples.clone()).unwrap().with_rescale(slope, intercept).unwrap();
            assert_classified(&context, &volume, &steps(), &format!("{name} {slope} {intercept}"));
        }
    }
}

/// Asserts that the device and the host make the same splats of a volume.
fn assert_classified(context: &Context, volume: &Volume, transfer: &TransferFunction, what: &str) {
    let transfer = &transfer.clone().with_classification(Classification::Point);
    let got = downloaded(context, &classified(context, volume, transfer, None));
    let expected = twins::classify(volume, transfer);
    assert_eq!(got.len(), expected.len(), "{what}");
    for (g, e) in got.iter().zip(&expected) {
        assert_eq!(g.point, e.point, "{what}");
        // 13 bits of red and blue, 14 of green.
        for (c, (g, e)) in g.color.iter().zip(&e.color).enumerate() {
            let step = [1.0 / 8191.0, 1.0 / 16383.0, 1.0 / 8191.0][c];
            assert!((g - e).abs() <= 0.5 * step + 1e-6, "{what}: {g:?} {e:?}");
        }
        // A control point is the f32 above its value, by up to 4e-6 of a ramp here. Near opacity 1 a step of f32 in the
        // opacity is 4e-3 of its logarithm: hence the last term.
        let allowed = 3e-6 + 1.8e-5 * e.density + 1e-7 * e.density.exp();
        assert!((g.density - e.density).abs() <= allowed, "{what}: {g:?} {e:?}");
    }
}

#[test]
fn classify_matches_its_twin_for_few_and_many_control_points() {
    let context = context();
    let samples = Samples::F32((0..40 * 7 * 3).map(|i| (i * 37 % 1000) as f32 / 7.0 - 10.0).collect());
    let volume = Volume::new(Grid::axis_parallel([40, 7, 3], [1.0; 3]).unwrap(), samples).unwrap();
    for count in [1, 2, 3, 31, 32, 96] {
        // Two at each value but the first: ramps and steps, with what is clear in between.
        let point = |i: usize| ControlPoint {
            value: (i.div_ceil(2) as f64) * 100.0 / count as f64,
            color: [0.1, 0.5, 0.9].map(|c| (c + 0.37 * i as f64) % 1.0),
            opacity: if i % 5 < 2 { 0.0 } else { (0.13 * i as f64) % 0.7 },
        };
        let transfer = TransferFunction::new((2..2 + count).map(point).collect(), None).unwrap();
        assert_classified(&context, &volume, &transfer, &format!("{count} points"));
    }
}

/// Bricks hold the box around their splats, on which rays and culling rely.
#[test]
fn bricks_are_bounded_by_their_splats() {
    let context = context();
    let dims = [70_u32, 40, 33];
    let shown = [[3, 5, 7], [9, 5, 31], [31, 31, 32], [69, 39, 0]];
    let at = |[x, y, z]: [u32; 3]| (x + dims[0] * (y + dims[1] * z)) as usize;
    let mut samples = vec![0_u8; dims.iter().product::<u32>() as usize];
    for point in shown {
        samples[at(point)] = 60;
    }
    let volume = Volume::new(Grid::axis_parallel(dims, [1.0; 3]).unwrap(), Samples::U8(samples)).unwrap();
    let stores = classified(&context, &volume, &steps(), None);
    let bounds: Vec<_> = stores.iter().flat_map(Store::runs).map(|(brick, _)| brick.bounds).collect();
    let single = |[x, y, z]: [u32; 3]| [[x, y, z], [x + 1, y + 1, z + 1]];
    assert_eq!(bounds, [[[3, 5, 7], [10, 6, 32]], single(shown[3]), single(shown[2])]);
}

#[test]
fn wide_integers_keep_the_resolution_of_their_window() {
    let context = context();
    let base = 4_000_000_000_u32;
    let volume = Volume::new(
        Grid::axis_parallel([64, 1, 1], [1.0; 3]).unwrap(),
        Samples::U32((0..64).map(|i| base + i).collect()),
    )
    .unwrap();
    let p = |value, opacity| ControlPoint { value, color: [1.0; 3], opacity };
    let transfer =
        TransferFunction::new(vec![p(f64::from(base + 10), 0.0), p(f64::from(base + 50), 0.5)], None).unwrap();
    let transfer = transfer.with_classification(Classification::Point);
    let got = downloaded(&context, &classified(&context, &volume, &transfer, None));
    let expected = twins::classify(&volume, &transfer);
    assert_eq!(got.len(), expected.len());
    for (g, e) in got.iter().zip(&expected) {
        // Densities are stored to 1.5e-5 of themselves.
        assert!((g.density - e.density).abs() < 1e-6 + 1.6e-5 * e.density, "{g:?} {e:?}");
    }
}

#[test]
fn chunks_continue_the_lattice() {
    // 216 bricks, which take two batches, those at the ends cut short.
    let context = context();
    let dims = [163_u32, 167, 163];
    let count = dims.iter().product::<u32>();
    let samples = (0..count).map(|i| u8::from(i % 9973 == 0) * 60).collect();
    let volume = Volume::new(Grid::axis_parallel(dims, [1.0; 3]).unwrap(), Samples::U8(samples)).unwrap();
    let got = downloaded(&context, &classified(&context, &volume, &steps(), None));
    let expected = twins::classify(&volume, &steps());
    assert!(got.iter().map(|v| v.point).eq(expected.iter().map(|v| v.point)));
}

#[test]
fn scan_matches_its_twin() {
    let context = context();
    let scan = Scan::new(&context);
    for count in [1, 2, 127, 128, 129, 16_384, 16_385, 2_100_000] {
        let values: Vec<u32> = (0..count).map(|i: u32| i.wrapping_mul(2_654_435_761) >> 29).collect();
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let buffer = context.upload("test.values", bytemuck::cast_slice(&values), usage).unwrap();
        let mut recorder = Recorder::untimed(&context);
        scan.record(&context, &mut recorder.compute_pass("scan"), &buffer, u64::from(count)).unwrap();
        recorder.submit();
        assert!(words(&download(&context, &buffer, u64::from(count) * 4)) == twins::scan(&values), "{count}");
    }
}

/// Returns the painter quads, with some of its settings changed.
fn with_quads(settings: &Settings, change: impl FnOnce(&mut QuadsSettings)) -> Settings {
    let mut quads = settings.quads();
    change(&mut quads);
    Settings { painter: Painter::Quads(quads), ..settings.clone() }
}

/// Makes a small volume on a sheared, anisotropic grid, and two cameras on it.
fn scene() -> (Volume, TransferFunction, [Camera; 2], Settings) {
    let demo = load("demo:marschner-lobb:12", &LoadOptions::default()).unwrap();
    let matrix = DMat3::from_cols(DVec3::X, DVec3::new(0.2, 1.1, 0.0), DVec3::new(-0.3, 0.1, 2.0));
    let grid = Grid::new(demo.grid().dims(), DAffine3::from_mat3_translation(matrix, DVec3::splat(40.0))).unwrap();
    let volume = demo.with_grid(grid).unwrap();
    let settings = with_quads(&Settings { termination: 0.0, level: Level::At(0), ..Settings::default() }, |q| {
        q.precision = Some(Precision::F32);
    });
    let cameras = [ProjectionKind::Orthographic, ProjectionKind::Perspective { fov: 50.0 }].map(|projection| {
        let view = View { azimuth: 40.0, elevation: 25.0, roll: 10.0, projection, ..View::default() };
        Camera::new(&view, volume.grid(), [24, 20]).unwrap()
    });
    let transfer = demos::demo_transfer("marschner-lobb").unwrap().with_classification(Classification::Point);
    (volume, transfer, cameras, settings)
}

/// Returns the extinction per unit distance, as in pictures of pre-shaded scenes.
fn weights(volume: &Volume, transfer: &TransferFunction) -> Weights {
    Weights {
        max: TransferFunction::extinction(transfer.max_opacity(), 1.0),
        unit: transfer.unit_or(volume.grid().min_spacing()) / volume.grid().unit(),
        brightest: transfer.brightest(),
    }
}

const WHOLE: Region = Region { x: 0, y: 0, width: 24, height: 20 };

#[test]
fn sort_matches_its_twin() {
    let (volume, transfer, cameras, settings) = scene();
    let context = context();
    let scan = Scan::new(&context);
    let stores = classified(&context, &volume, &transfer, None);
    let splats = downloaded(&context, &stores);
    for (camera, perspective) in cameras.iter().zip([false, true]) {
        for (thickness, sheets_kind, size) in [
            (0.3, Sheets::Image, [24, 20]),
            (1.0, Sheets::Image, [24, 20]),
            (5.0, Sheets::Image, [24, 20]),
            (1.0, Sheets::Image, [6, 5]),
            (1.0, Sheets::Axis, [24, 20]),
        ] {
            let settings = with_quads(&settings, |q| (q.sheet_thickness, q.sheets) = (thickness, sheets_kind));
            let camera = Camera { size, ..*camera };
            let view = ViewGeometry::new(&camera, volume.grid(), &settings, Savings::default());
            let weights = Weights { max: 1.0, unit: 1.0, brightest: [1.0; 3] };
            let plan = Plan::new(&view, &settings, weights, Precision::F32);
            let axis = plan.axis.is_some();
            let constants = [("AXIS", axis.into()), ("GROWN", (view.max_growth() > 1.0).into())];
            let sorter = Sorter::new(&context, &constants);
            let frame = plan.frame(WHOLE);
            let uniform = wgpu::BufferUsages::UNIFORM;
            let buffer = context.upload("test.frame", bytemuck::bytes_of(&frame), uniform).unwrap();
            let target = Target { plan: &plan, region: WHOLE, frame: &buffer };
            let mode = twins::Mode { perspective, axis, additive: false };
            for sheets in [1, 4] {
                let mut recorder = Recorder::untimed(&context);
                let spans = sorter.run(&mut recorder, &scan, target, sheets, &stores).unwrap();
                let [span] = spans.as_slice() else { panic!("{} spans", spans.len()) };
                let total = u64::from(*span.starts.last().unwrap());
                let entries = words(&download(&context, &span.entries, total * 4));
                let expected = twins::sort(&frame, &splats, mode, sheets);
                assert_eq!(span.starts.len(), expected.len() + 1);
                for (batch, want) in (0..).zip(&expected) {
                    let range = span.batch(batch);
                    let got = &entries[range.start as usize..range.end as usize];
                    assert_eq!(got, want, "batch {batch} of {sheets} {sheets_kind} sheets, thickness {thickness}");
                }
            }
        }
    }
}

#[test]
fn feeding_several_sheets_at_once_changes_nothing_but_the_number_of_quads() {
    let volume = demos::volume("shepp-logan", 32).unwrap();
    let transfer = demos::demo_transfer("shepp-logan").unwrap();
    let painter = Painter::Quads(QuadsSettings::default());
    let settings = Settings { painter, termination: 0.0, level: Level::At(0), ..Settings::default() };
    let view = View { azimuth: 33.0, ..View::default() };
    let camera = Camera::new(&view, volume.grid(), [32; 2]).unwrap();
    let [single, several] = [1, 4].map(|attachments| {
        let options = RendererOptions { adapter: Some(adapter()), ..RendererOptions::default() };
        let mut renderer = Renderer::new(&options).unwrap();
        renderer.context.limits.max_color_attachments = attachments;
        renderer
            .render(&renderer.prepare(&volume, &transfer, &settings).unwrap(), &Frame::new(&camera, &settings))
            .unwrap()
    });
    for (a, b) in single.image.pixels().iter().flatten().zip(several.image.pixels().iter().flatten()) {
        assert!((a - b).abs() < 2e-6, "{a} {b}");
    }
    let quads_per_splat = |r: &Rendered| r.stats.quads().unwrap().quads as f64 / r.stats.splats_kept as f64;
    assert!(quads_per_splat(&several) <= 2.5, "{}", quads_per_splat(&several));
    assert!(quads_per_splat(&single) > 4.5, "{}", quads_per_splat(&single));
}

#[test]
fn splat_composite_and_resolve_match_their_twins() {
    let (volume, transfer, cameras, settings) = scene();
    let splats = twins::classify(&volume, &transfer);
    // A pass feeds as many sheets as the device has attachments.
    let of_attachments = |attachments: u32| {
        let options = RendererOptions { adapter: Some(adapter()), ..RendererOptions::default() };
        let mut renderer = Renderer::new(&options).unwrap();
        renderer.context.limits.max_color_attachments = attachments;
        let prepared = renderer.prepare(&volume, &transfer, &settings).unwrap();
        (renderer, prepared)
    };
    let [single, several] = [1, 4].map(of_attachments);
    for (camera, perspective) in cameras.iter().zip([false, true]) {
        for (sheets, accumulation, sheets_per_pass) in [
            (Sheets::Image, Accumulation::OpticalDepth, 1),
            (Sheets::Image, Accumulation::OpticalDepth, 4),
            (Sheets::Image, Accumulation::Additive, 4),
            (Sheets::Axis, Accumulation::OpticalDepth, 1),
            (Sheets::Axis, Accumulation::Additive, 4),
        ] {
            // Pixels as wide as two voxels, and as a fifth.
            for size in [[24, 20], [6, 5]] {
                let settings = with_quads(&settings, |q| (q.sheets, q.accumulation) = (sheets, accumulation));
                let (renderer, prepared) = if sheets_per_pass == 1 { &single } else { &several };
                let camera = Camera { size, ..*camera };
                let view = ViewGeometry::new(&camera, volume.grid(), &settings, Savings::default());
                let plan = Plan::new(&view, &settings, weights(&volume, &transfer), Precision::F32);
                let [width, height] = size;
                let frame = plan.frame(Region { x: 0, y: 0, width, height });
                let table = FootprintTable::new(&settings.kernel, Precision::F32.footprint_error()).unwrap();
                let additive = accumulation == Accumulation::Additive;
                let mode = twins::Mode { perspective, axis: sheets == Sheets::Axis, additive };
                let Rendered { image, stats } = renderer.render(prepared, &Frame::new(&camera, &settings)).unwrap();
                assert_eq!(stats.quads().unwrap().sheets_per_pass, sheets_per_pass);
                for (index, pixel) in (0..).zip(image.pixels()) {
                    let center = DVec2::new(f64::from(index % width) + 0.5, f64::from(index / width) + 0.5);
                    let sheets = twins::splat(&frame, &table, &splats, center, mode, |v| v);
                    for (got, want) in pixel.iter().zip(twins::composite(&sheets, additive)) {
                        let error = (f64::from(*got) - want).abs();
                        assert!(error < 2e-5, "pixel {index} x{sheets_per_pass} {mode:?}: {pixel:?}, {want}");
                    }
                }
            }
        }
    }
}

/// The precision of sheets of half floats, if sums are rounded to the nearest and if they are truncated. Shown on the
/// twin, because an adapter does one of the two.
#[test]
fn f16_sheets_keep_alpha() {
    let nearest = |v: f64| half::f16::from_f64(v).to_f64();
    let cut_off = |v: f64| {
        let bits = half::f16::from_f64(v).to_bits();
        let above = half::f16::from_bits(bits).to_f64() > v;
        half::f16::from_bits(bits - u16::from(above)).to_f64()
    };
    let (volume, transfer, cameras, settings) = scene();
    let splats = twins::classify(&volume, &transfer);
    let table = FootprintTable::new(&settings.kernel, Precision::F16.footprint_error()).unwrap();
    // Kernels have grown, by up to 1.9 times.
    for (model, limits) in [(Model::Composite, [5e-4, 1.2e-2]), (Model::Xray, [1.2e-3, 2e-2])] {
        let settings = Settings { model, ..settings.clone() };
        let mut worst = [0.0_f64; 2];
        for camera in cameras {
            let view = ViewGeometry::new(&camera, volume.grid(), &settings, Savings::default());
            let plan = Plan::new(&view, &settings, weights(&volume, &transfer), Precision::F16);
            let mode = twins::Mode { perspective: view.is_perspective(), ..twins::Mode::default() };
            let frame = plan.frame(WHOLE);
            for y in 0..20 {
                for x in 0..24 {
                    let center = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                    let alpha = |round: &dyn Fn(f64) -> f64| {
                        twins::composite(&twins::splat(&frame, &table, &splats, center, mode, round), false)[3]
                    };
                    let exact = alpha(&|v| v);
                    for (worst, round) in worst.iter_mut().zip([&nearest as &dyn Fn(f64) -> f64, &cut_off]) {
                        *worst = worst.max((alpha(round) - exact).abs());
                    }
                }
            }
        }
        println!("f16 sheets, {model}: alpha errs by {:.1e} to the nearest, {:.1e} cut off", worst[0], worst[1]);
        assert!(worst[0] <= limits[0] && worst[1] <= limits[1], "{model}: {worst:?}");
    }
}
