//! Lists of splats of voxels, and the samples that the device holds.

use super::adapter_test::adapter;
use super::cache::Cache;
use super::context::Context;
use super::held_samples::HeldSamples;
use super::kept_voxels::KeptVoxels;
use super::list::listed;
use super::samples::Input;
use super::voxels::Voxels;
use crate::lighting::Normals;
use crate::progress::Progress;
use crate::transfer::{Classification, ControlPoint, GradientPoint, TransferFunction};
use crate::volume::{Grid, Samples, Volume};

/// The first lattice point of a brick with splats, the box around them, and their words with the place in the brick.
type Listed = ([u32; 3], [[u32; 3]; 2], Vec<[u32; 4]>);

/// Lists the splats of each brick.
fn splats(context: &Context, pipelines: &Cache, voxels: &Voxels) -> Vec<Listed> {
    let mut all = Vec::new();
    for store in &listed(context, pipelines, voxels).unwrap() {
        let words = store.words(context).unwrap();
        for (brick, run) in store.runs() {
            let splats = words.chunks_exact(4).skip(run.start as usize).take(run.len());
            let splats = splats.map(|splat| [splat[0] & 0x7fff, splat[1], splat[2], splat[3]]);
            all.push((brick.origin, brick.bounds, splats.collect()));
        }
    }
    all
}

/// Makes a volume whose faces cut bricks.
fn volume(samples: Samples) -> Volume {
    Volume::new(Grid::axis_parallel([70, 70, 950], [1.0, 0.8, 1.7]).unwrap(), samples).unwrap()
}

/// The middle one of three batches of bricks is invisible. In small buffers, and with normals that are not kept, the
/// splats are the same.
#[test]
fn lists_are_the_same_however_the_device_holds_samples() {
    let context = || Context::new(Some(&adapter())).unwrap();
    let value = |i: usize| if (150..920).contains(&(i / 4900)) { 0 } else { i * 37 % 251 * (i / 70 % 5) / 8 };
    let values: Vec<usize> = (0..70 * 70 * 950).map(value).collect();
    let point = |value, opacity| ControlPoint { value, color: [0.9, 0.5, value / 200.0], opacity };
    let transfer = TransferFunction::new(vec![point(20.0, 0.0), point(60.0, 0.2), point(120.0, 0.9)], None).unwrap();
    let thins = vec![GradientPoint { magnitude: 1.0, opacity: 0.0 }, GradientPoint { magnitude: 20.0, opacity: 1.0 }];
    let thinned = transfer.clone().with_gradient_opacity(thins).unwrap();
    let bytes = || Samples::U8(values.iter().map(|&v| v as u8).collect());
    let floats = || Samples::F32(values.iter().map(|&v| v as f32).collect());
    let (mut small, mut without) = (context(), context());
    small.limits.max_storage_buffer_binding_size = 2 << 20;
    without.savings.normals = false;
    for (volume, transfer, lit) in
        [(volume(bytes()), &transfer, false), (volume(bytes()), &thinned, true), (volume(floats()), &transfer, true)]
    {
        let of = |context: &Context| {
            let (pipelines, held, kept) = (Cache::default(), HeldSamples::default(), KeptVoxels::default());
            let progress = Progress::default();
            let input = Input::new(context, &volume, transfer, lit.then(Normals::default), &progress).unwrap();
            let (voxels, bricks) = Voxels::of_samples(&pipelines, &input, &held, &kept).unwrap();
            let splats = splats(context, &pipelines, &voxels);
            let count: usize = splats.iter().map(|(.., splats)| splats.len()).sum();
            assert_eq!((bricks.all, count as u64), (9 * 30, voxels.count()));
            splats
        };
        let expected = of(&context());
        assert_eq!(expected.len(), 63);
        assert!(of(&small) == expected && of(&without) == expected);
    }
}

/// A brick is sent once, whatever functions show. Of few bricks only those that may show are held.
#[test]
fn bricks_that_may_show_are_held_and_sent_once() {
    // Bricks of one value each, of 5 x 3 x 4, and without a value in their outermost layers, by which the range of a
    // brick has no value of its neighbours.
    let value = |i: usize| {
        let place = [i % 150, i / 150 % 90, i / (150 * 90)];
        let [x, y, z] = place.map(|n| n / 32);
        let is_outside = place.iter().any(|n| [0, 31].contains(&(n % 32)));
        if is_outside { f32::INFINITY } else { (10 * x + 3 * y + z) as f32 }
    };
    let values = Samples::F32((0..150 * 90 * 128).map(value).collect());
    let volume = Volume::new(Grid::axis_parallel([150, 90, 128], [1.0; 3]).unwrap(), values).unwrap();
    let bricks_of = |shown: &[u8]| {
        let all = (0..60).map(|brick| (10 * (brick % 5) + 3 * (brick / 5 % 3) + brick / 15) as u8);
        all.filter(|value| shown.contains(value)).count() as u64
    };
    let showing = |shown: &[u8]| {
        let point = |value: f64, opacity| ControlPoint { value, color: [1.0, 0.5, 0.25], opacity };
        let of = |&value: &u8| {
            let value = f64::from(value);
            [point(value - 0.4, 0.0), point(value - 0.2, 0.5), point(value + 0.2, 0.5), point(value + 0.4, 0.0)]
        };
        let transfer = TransferFunction::new(shown.iter().flat_map(of).collect(), None).unwrap();
        transfer.with_classification(Classification::Point)
    };
    let mut context = Context::new(Some(&adapter())).unwrap();
    let (mut holds_all, pipelines_of_all) = (Context::new(Some(&adapter())).unwrap(), Cache::default());
    holds_all.savings.bricks = false;
    context.savings.paged_bytes = 0;
    // Two rows of bricks in a buffer.
    context.limits.max_storage_buffer_binding_size = 10 * 4 * 36_u64.pow(3);
    let (pipelines, held, progress) = (Cache::default(), HeldSamples::default(), Progress::default());
    let of_brick = 4 * 36_u64.pow(3);
    // The values that a function shows, and those of bricks that are held and sent.
    let edits: [(&[u8], &[u8], &[u8]); 5] = [
        (&[10, 25], &[10, 25], &[10, 25]),
        (&[10], &[10, 25], &[]),
        (&[0, 13], &[0, 10, 13, 25], &[0, 13]),
        (&[25, 46], &[0, 10, 13, 25, 46], &[46]),
        (&[0, 10], &[0, 10, 13, 25, 46], &[]),
    ];
    for (shown, are_held, sent) in edits {
        let transfer = showing(shown);
        let input = Input::new(&context, &volume, &transfer, Some(Normals::Gradient), &progress).unwrap();
        let kept = KeptVoxels::default();
        let before = context.traffic().sent;
        let (voxels, bricks) = Voxels::of_samples(&pipelines, &input, &held, &kept).unwrap();
        assert_eq!(bricks.bytes, bricks_of(sent) * of_brick, "{shown:?}");
        assert!(context.traffic().sent - before < bricks.bytes + (64 << 10));
        assert_eq!(held.bytes(), bricks_of(are_held) * of_brick, "{shown:?}");
        let (all, kept) = (HeldSamples::default(), KeptVoxels::default());
        let input = Input::new(&holds_all, &volume, &transfer, Some(Normals::Gradient), &progress).unwrap();
        let (others, _) = Voxels::of_samples(&pipelines_of_all, &input, &all, &kept).unwrap();
        assert_eq!(all.bytes(), 60 * of_brick);
        let own = splats(&context, &pipelines, &voxels);
        assert_eq!(own.len() as u64, bricks_of(shown));
        assert!(own == splats(&holds_all, &pipelines_of_all, &others), "{shown:?}");
    }
    // More than a quarter: all.
    let transfer = showing(&[0, 1, 2, 3, 10, 11, 12, 20, 21, 22, 30, 31, 32]);
    let input = Input::new(&context, &volume, &transfer, Some(Normals::Gradient), &progress).unwrap();
    let already = held.bytes();
    let (_, bricks) = Voxels::of_samples(&pipelines, &input, &held, &KeptVoxels::default()).unwrap();
    assert_eq!([held.bytes(), bricks.bytes], [60 * of_brick, 60 * of_brick - already]);
}

#[test]
fn samples_beyond_the_device_are_refused_with_what_helps() {
    let mut context = Context::new(Some(&adapter())).unwrap();
    // Less than a row of bricks.
    context.limits.max_storage_buffer_binding_size = 2 * 32_u64.pow(3);
    let volume = volume(Samples::U8(vec![100; 70 * 70 * 950]));
    let point = |value, opacity| ControlPoint { value, color: [1.0; 3], opacity };
    let transfer = TransferFunction::new(vec![point(20.0, 0.0), point(120.0, 0.9)], None).unwrap();
    let (pipelines, held, kept) = (Cache::default(), HeldSamples::default(), KeptVoxels::default());
    let progress = Progress::default();
    let input = Input::new(&context, &volume, &transfer, None, &progress).unwrap();
    let refused = Voxels::of_samples(&pipelines, &input, &held, &kept).map(drop).unwrap_err().to_string();
    assert!(refused.contains("draw bricks (voxsplat plan), or use --painter cpu"), "{refused}");
    assert_eq!(held.bytes(), 0);
}
