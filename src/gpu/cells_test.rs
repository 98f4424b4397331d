//! Lit cells of a level on the device: their normals are found once, whatever the buffers hold.

use std::sync::Arc;

use glam::DVec3;

use super::adapter_test::adapter;
use super::cache::Cache;
use super::cells::{self, MOST, Plan};
use super::context::Context;
use super::held_samples::HeldSamples;
use super::kept_voxels::{self, KeptVoxels};
use super::recorder::Recorder;
use super::samples::Input;
use super::savings::Savings;
use super::view::ViewGeometry;
use super::voxels::Voxels;
use crate::appearance::demos;
use crate::camera::{Camera, View};
use crate::formats::{LoadOptions, load};
use crate::lighting::{Light, Lighting, Normals};
use crate::prepare::cells::{CellSize, Shape};
use crate::progress::Progress;
use crate::settings::Settings;
use crate::transfer::{ControlPoint, TransferFunction};
use crate::volume::{Grid, Volume};

/// A volume whose cells a device makes.
struct Subject<'a> {
    context: &'a Context,
    volume: &'a Volume,
    transfer: &'a TransferFunction,
    size: CellSize,
    pipelines: Cache,
    held: HeldSamples,
    kept: KeptVoxels,
}

impl<'a> Subject<'a> {
    fn new(context: &'a Context, (volume, transfer): &'a (Volume, TransferFunction), size: CellSize) -> Self {
        let (pipelines, held, kept) = Default::default();
        Self { context, volume, transfer, size, pipelines, held, kept }
    }

    /// Makes the cells under a light from `side`.
    fn lit(&self, side: f64, before: Option<Arc<Voxels>>) -> Arc<Voxels> {
        let Self { context, volume, transfer, .. } = *self;
        let lights = vec![Light::HEADLIGHT, Light::directional(DVec3::new(side, 1.0, 0.5))];
        let settings = Settings { lighting: Some(Lighting { lights, ..Lighting::default() }), ..Settings::default() };
        let camera = Camera::new(&View::default(), volume.grid(), [32; 2]).unwrap();
        let light = ViewGeometry::new(&camera, volume.grid(), &settings, Savings::default()).splat_light(&settings);
        let (shape, progress) = (Shape::new(volume.grid(), transfer, self.size), Progress::default());
        let input = Input::new(context, volume, transfer, Some(Normals::default()), &progress).unwrap();
        let (voxels, _) = Voxels::of_samples(&self.pipelines, &input, &self.held, &self.kept).unwrap();
        let of = (&*voxels, Some(&light));
        cells::run(context, &self.pipelines, of, &shape.on_device(), before, &progress).unwrap()
    }

    /// Returns the words of cells.
    fn words(&self, cells: &Voxels) -> Vec<[u32; 2]> {
        let words = cells.buffers().flat_map(|of| {
            let mut recorder = Recorder::untimed(self.context);
            let bytes = 8 * u64::from(of.visible.count);
            let words = recorder.read_back("test", of.samples, bytes).unwrap();
            recorder.submit();
            words.values::<[u32; 2]>(self.context, "test").unwrap()
        });
        words.collect()
    }

    /// Returns the buffers of normals, and the number of visible voxels.
    fn normals(&self) -> Option<(Vec<wgpu::Buffer>, u64)> {
        let kept = self.kept.0.lock().unwrap();
        let (visible, normals) = kept.as_ref().unwrap();
        let kept_voxels::KeptNormals::Kept(normals) = normals else { return None };
        Some((normals.clone(), visible.iter().map(|part| u64::from(part.count)).sum()))
    }
}

fn vessels(size: u32) -> (Volume, TransferFunction) {
    let volume = load(format!("demo:vessels:{size}"), &LoadOptions::default()).unwrap();
    (volume, demos::demo_transfer("vessels").unwrap())
}

fn context() -> Context {
    Context::new(Some(&adapter())).unwrap()
}

/// A light that moves takes a dispatch for planes and one for cells. Other normals give other cells.
#[test]
fn device_cells_under_other_lights_take_the_normals_that_are_kept() {
    let context = context();
    let of = vessels(64);
    let size = CellSize::of_level(1);
    let subject = Subject::new(&context, &of, size);
    let first = subject.lit(1.0, None);
    let (normals, visible) = subject.normals().unwrap();
    assert!(visible > 1000, "{visible} voxels");
    assert_eq!(normals.iter().map(wgpu::Buffer::size).sum::<u64>(), 4 * visible);
    let before = context.traffic();
    let second = subject.lit(-1.0, Some(first));
    let after = context.traffic();
    let counts =
        [after.dispatches - before.dispatches, after.submissions - before.submissions, after.waits - before.waits];
    assert_eq!(counts, [2, 1, 0]);
    assert!(after.allocated - before.allocated < 8 << 20 && after.sent - before.sent < 64 << 10);
    let expected = subject.words(&second);
    assert!(expected == subject.words(&Subject::new(&context, &of, size).lit(-1.0, None)));
    let none = vec![crate::splats::words::NO_NORMAL; visible as usize];
    let mut rest = &none[..];
    for buffer in normals {
        let (of_buffer, others) = rest.split_at(buffer.size() as usize / 4);
        context.write(&buffer, 0, bytemuck::cast_slice(of_buffer));
        rest = others;
    }
    let flat = subject.lit(-1.0, Some(second));
    assert!(expected != subject.words(&flat), "normals are found again");
}

/// Without room for normals they are found for each light, and small buffers hold a few rows of bricks, so that several
/// dispatches sum the voxels of a cell: the cells are the same.
#[test]
fn device_cells_are_the_same_without_kept_normals_and_in_small_buffers() {
    cells_without_kept_normals(&[CellSize::of_level(2)]);
}

#[test]
#[ignore = "slow: cells of two further sizes"]
fn device_cells_of_every_size_are_the_same_without_kept_normals_and_in_small_buffers() {
    cells_without_kept_normals(&[CellSize::VOXEL.next(), CellSize::of_level(1)]);
}

fn cells_without_kept_normals(sizes: &[CellSize]) {
    let context = context();
    let mut without = self::context();
    without.savings.normals = false;
    // Three of the nine rows of bricks, of three bricks each: a layer of them. Two rows cut layers.
    let [layers, rows] = [10, 7].map(|bricks| {
        let mut small = self::context();
        small.limits.max_storage_buffer_binding_size = bricks * 38_u64.pow(3);
        small.savings.bricks = false;
        small
    });
    let of = vessels(70);
    for &size in sizes {
        let pictures = [&context, &without, &layers, &rows].map(|context| {
            let subject = Subject::new(context, &of, size);
            let first = subject.lit(1.0, None);
            let words = subject.words(&first);
            let buffers = subject.normals().map_or(0, |(normals, _)| normals.len());
            [words, subject.words(&subject.lit(-1.0, Some(first))), vec![[buffers as u32; 2]]]
        });
        let [expected, others @ ..] = &pictures;
        assert_eq!(pictures.each_ref().map(|[.., buffers]| buffers[0][0]), [1, 0, 3, 5]);
        for light in 0..2 {
            assert!(expected[light].len() > 300 && expected[0] != expected[1]);
            for (number, other) in others.iter().enumerate() {
                assert!(expected[light] == other[light], "{size:?}, light {light}, picture {number}");
            }
        }
    }
}

/// Makes two balls in a nearly empty volume, whose bricks that may be visible are 10 of 84.
fn balls() -> (Volume, TransferFunction) {
    let centers = [[33.0, 33.0, 33.0], [191.0, 16.0, 80.0]];
    let value = |[x, y, z]: [u32; 3]| {
        let distance = |center: &[f64; 3]| DVec3::from([x, y, z].map(f64::from)).distance(DVec3::from(*center));
        centers.iter().map(|center| (15.0 - distance(center)).max(0.0)).fold(0.0, f64::max) as f32
    };
    let points = (0..200 * 70 * 100).map(|i| value([i % 200, i / 200 % 70, i / (200 * 70)]));
    let volume = Volume::from_slice([200, 70, 100], [1.0, 1.0, 1.5], &points.collect::<Vec<f32>>()).unwrap();
    let point = |value, opacity| ControlPoint { value, color: [0.9, 0.5, 0.1], opacity };
    (volume, TransferFunction::new(vec![point(3.0, 0.0), point(12.0, 0.5)], None).unwrap())
}

/// If the device holds only bricks that may show, in one buffer or in several, cells are the same.
#[test]
fn device_cells_of_few_bricks_are_those_of_all() {
    cells_of_few_bricks(&[CellSize::of_level(2)]);
}

#[test]
#[ignore = "slow: cells of two further sizes"]
fn device_cells_of_every_size_of_few_bricks_are_those_of_all() {
    cells_of_few_bricks(&[CellSize::VOXEL.next(), CellSize::of_level(1)]);
}

fn cells_of_few_bricks(sizes: &[CellSize]) {
    let of = balls();
    let [all, few, several] = [(false, u64::MAX), (true, u64::MAX), (true, 7)].map(|(saves, bricks)| {
        let mut context = context();
        context.savings = Savings { bricks: saves, ..Savings::default() };
        let limit = &mut context.limits.max_storage_buffer_binding_size;
        *limit = (*limit).min(bricks.saturating_mul(4 * 38_u64.pow(3)));
        context
    });
    for &size in sizes {
        let pictures = [&all, &few, &several].map(|context| {
            let subject = Subject::new(context, &of, size);
            let first = subject.lit(1.0, None);
            let words = subject.words(&first);
            let (normals, visible) = subject.normals().unwrap();
            let held = subject.held.bytes() / (4 * 38_u64.pow(3));
            println!("{size:?}: {held} bricks, {} buffers, {visible} voxels, {} cells", normals.len(), words.len());
            ([held, normals.len() as u64], words, subject.words(&subject.lit(-1.0, Some(first))))
        });
        let [(of_all, expected, turned), (of_few, same, others), (of_several, again, same_others)] = pictures;
        assert_eq!([of_all, of_few, of_several], [[84, 1], [10, 1], [10, 2]]);
        assert!(expected.len() > 300 && expected != turned);
        assert!(same == expected && again == expected, "{size:?}");
        assert!(others == turned && same_others == turned, "{size:?}");
    }
}

/// Each box takes a dispatch for its planes and one for its cells. The splats of a box fit into half a buffer.
#[test]
fn cells_of_a_large_scan_take_few_dispatches() {
    let (_, transfer) = vessels(8);
    for (size, level, most, at_most) in [(512, 1, 2 * MOST, 3), (512, 1, MOST, 6), (1024, 2, 2 * MOST, 6)] {
        let shape =
            Shape::new(&Grid::axis_parallel([size; 3], [1.0; 3]).unwrap(), &transfer, CellSize::of_level(level));
        let lattice = shape.on_device();
        let Plan { rows, layers, planes, .. } = lattice.plan(most);
        let [_, down, deep] = lattice.dims;
        let boxes = down.div_ceil(rows) * deep.div_ceil(layers);
        println!("{size}, level {level}: {boxes} boxes, of {rows} rows and {layers} layers");
        assert!(boxes <= at_most, "{size}, level {level}: {boxes} boxes");
        assert!(lattice.dims[0] * rows * planes * 16 <= most as usize);
        assert!(lattice.dims[0] * rows * layers * 16 <= most as usize / 2);
    }
}
