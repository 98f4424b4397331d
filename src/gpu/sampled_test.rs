//! Splats that are no list, beside lists of the same splats.

use std::ops::Range;

use super::adapter_test::adapter;
use super::cache::Cache;
use super::classify::Classifier;
use super::context::Context;
use super::held_samples::HeldSamples;
use super::kept_voxels::KeptVoxels;
use super::recorder::Recorder;
use super::sampled::Sampled;
use super::samples::Input;
use super::scan::Scan;
use super::store::{Drawable, Store};
use crate::lighting::Normals;
use crate::progress::Progress;
use crate::splats::brick::BrickSplats;
use crate::transfer::{Classification, ControlPoint, GradientPoint, TransferFunction};
use crate::volume::{Grid, Samples, Volume};

/// Returns the words of splats.
fn words(context: &Context, store: &Store) -> Vec<u32> {
    let mut recorder = Recorder::untimed(context);
    let buffer = store.on_device(context).unwrap();
    let words = recorder.read_back("test", &buffer, u64::from(store.count) * store.stride).unwrap();
    recorder.submit();
    words.values(context, "test").unwrap()
}

/// Makes a volume whose faces cut bricks.
fn volume(samples: Samples) -> Volume {
    Volume::new(Grid::axis_parallel([70, 70, 950], [1.0, 0.8, 1.7]).unwrap(), samples).unwrap()
}

/// The middle one of three batches of bricks is invisible.
#[test]
fn listed_samples_are_the_splats_of_a_classification() {
    let context = Context::new(Some(&adapter())).unwrap();
    let value = |i: usize| if (150..920).contains(&(i / 4900)) { 0 } else { i * 37 % 251 * (i / 70 % 5) / 8 };
    let values: Vec<usize> = (0..70 * 70 * 950).map(value).collect();
    let point = |value, opacity| ControlPoint { value, color: [0.9, 0.5, value / 200.0], opacity };
    let transfer = TransferFunction::new(vec![point(20.0, 0.0), point(60.0, 0.2), point(120.0, 0.9)], None).unwrap();
    let thins = vec![GradientPoint { magnitude: 1.0, opacity: 0.0 }, GradientPoint { magnitude: 20.0, opacity: 1.0 }];
    let thinned = transfer.clone().with_gradient_opacity(thins).unwrap();
    let bytes = || Samples::U8(values.iter().map(|&v| v as u8).collect());
    let floats = || Samples::F32(values.iter().map(|&v| v as f32).collect());
    for (volume, transfer, lit) in
        [(volume(bytes()), &transfer, false), (volume(bytes()), &thinned, true), (volume(floats()), &transfer, true)]
    {
        let (pipelines, held, kept) = (Cache::default(), HeldSamples::default(), KeptVoxels::default());
        let progress = Progress::default();
        let input = Input::new(&context, &volume, transfer, lit.then(Normals::default), &progress).unwrap();
        let sampled = Sampled::run(&pipelines, &input, &held, &kept).unwrap();
        let listed = Classifier::new(&input).run(&Scan::new(&context), &input).unwrap();
        assert!(Sampled::of(&sampled.stores).is_some() && Sampled::of(&listed.stores).is_none());
        assert_eq!(sampled.bricks.all, listed.bricks.all);
        // Both have the same bricks, which one numbers without invisible batches and the other one without invisible
        // bricks.
        let splats = |made: &Drawable| {
            let mut all = Vec::new();
            for store in &made.stores {
                let words = words(&context, store);
                for (brick, run) in store.runs() {
                    let splats = words.chunks_exact(4).skip(run.start as usize).take(run.len());
                    let places = splats.map(|splat| {
                        let normal = if lit { splat[3] } else { 0 };
                        [splat[0] & 0x7fff, splat[1], splat[2], normal]
                    });
                    all.push((brick.origin, brick.bounds, places.collect::<Vec<_>>()));
                }
            }
            all
        };
        let [own, others] = [&sampled, &listed].map(splats);
        assert_eq!([own.len(), others.len()], [63; 2]);
        assert!(own == others);
        assert!(Sampled::of(&sampled.stores).is_none());
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
        let sampled = Sampled::run(&pipelines, &input, &held, &kept).unwrap();
        assert_eq!(sampled.bricks.bytes, bricks_of(sent) * of_brick, "{shown:?}");
        assert!(context.traffic().sent - before < sampled.bricks.bytes + (64 << 10));
        assert_eq!(held.bytes(), bricks_of(are_held) * of_brick, "{shown:?}");
        let listed = Classifier::new(&input).run(&Scan::new(&context), &input).unwrap();
        let splats = |made: &Drawable| {
            let all = made.stores.iter().flat_map(|store| {
                let words = words(&context, store);
                let splat = |n: u32| words[4 * n as usize..][..4].to_vec();
                let own = |(brick, run): (&BrickSplats, Range<u32>)| {
                    (brick.origin, run.map(|n| (splat(n)[0] & 0x7fff, splat(n)[1..].to_vec())).collect::<Vec<_>>())
                };
                store.runs().map(own).collect::<Vec<_>>()
            });
            all.collect::<Vec<_>>()
        };
        let [own, others] = [&sampled, &listed].map(splats);
        assert_eq!(own.len() as u64, bricks_of(shown));
        assert!(own == others, "{shown:?}");
    }
    // More than a quarter: all.
    let transfer = showing(&[0, 1, 2, 3, 10, 11, 12, 20, 21, 22, 30, 31, 32]);
    let input = Input::new(&context, &volume, &transfer, Some(Normals::Gradient), &progress).unwrap();
    let already = held.bytes();
    let sampled = Sampled::run(&pipelines, &input, &held, &KeptVoxels::default()).unwrap();
    assert_eq!([held.bytes(), sampled.bricks.bytes], [60 * of_brick, 60 * of_brick - already]);
}
