//! Splats that are no list, beside lists of the same splats.

use super::adapter_test::adapter;
use super::cache::Cache;
use super::classify::Classifier;
use super::context::Context;
use super::kept_voxels::KeptVoxels;
use super::recorder::Recorder;
use super::sampled::Sampled;
use super::samples::{HeldSamples, Input};
use super::scan::Scan;
use super::store::{Drawable, Store};
use crate::progress::Progress;
use crate::transfer::{ControlPoint, GradientPoint, TransferFunction};
use crate::volume::{Grid, Samples, Volume};

/// The words of splats.
fn words(context: &Context, store: &Store) -> Vec<u32> {
    let mut recorder = Recorder::untimed(context);
    let buffer = store.on_device(context).unwrap();
    let words = recorder.read_back("test", &buffer, u64::from(store.count) * store.stride).unwrap();
    recorder.submit();
    words.values(context, "test").unwrap()
}

/// A volume whose faces cut bricks.
fn volume(samples: Samples) -> Volume {
    Volume::new(Grid::axis_parallel([70, 70, 950], [1.0, 0.8, 1.7]).unwrap(), samples).unwrap()
}

/// The middle one of three batches of bricks is invisible.
#[test]
fn listed_samples_are_the_splats_of_a_classification() {
    let context = Context::new(Some(&adapter())).unwrap().with_device_stages();
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
        let input = Input::new(&context, &volume, transfer, lit, &progress).unwrap();
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
