//! classify on the host: the twin of the device's stage, faster on software adapters.

use std::cell::LazyCell;

use rayon::prelude::*;

use super::classify::{STRIDE, joined};
use super::samples::Input;
use super::store::{Drawable, StoreBuilder};
use crate::error::Result;
use crate::kernel::DerivativeFilter;
use crate::splats::brick::MadeBrick;
use crate::splats::gradients::{FAR, gradient_of, steepness_of};
use crate::splats::words::{density, packed_appearance, packed_normal, resolution_at, with_density};
use crate::transfer::scaled_share;
use crate::volume::{BRICK_EDGE as EDGE, Brick};

/// The twin of the device's stage on the host, faster on software adapters.
pub(crate) struct HostClassifier<'a> {
    input: &'a Input<'a>,
    /// The entry of each sample of 8 and 16 bits, by its bits.
    table: Vec<Entry>,
    normals: DerivativeFilter,
}

/// The appearance of a sample.
#[derive(Debug, Clone, Copy)]
struct Entry {
    density: f32,
    /// Words of the splat; `None`: the sample is invisible.
    appearance: Option<[u32; 2]>,
}

impl HostClassifier<'_> {
    /// The visible voxels of a volume as splats, brick by brick, with normals if there is light.
    pub(crate) fn run(input: &Input<'_>) -> Result<Drawable> {
        let mut classifier = HostClassifier { input, table: Vec::new(), normals: DerivativeFilter::of_normals() };
        classifier.table = match input.coding.sample_type {
            0 => classifier.table(256, |bits| bits as u8 as f32),
            1 => classifier.table(256, |bits| bits as i8 as f32),
            2 => classifier.table(65_536, |bits| bits as f32),
            3 => classifier.table(65_536, |bits| bits as i16 as f32),
            _ => Vec::new(),
        };
        let mut stores = StoreBuilder::new(input.context, STRIDE, joined(input.context));
        let bricks =
            input.each_brick(&|_, range| input.may_show(range), &|brick| classifier.brick(brick), &mut |brick| {
                stores.push(brick)
            })?;
        Ok(Drawable { bricks, ..stores.finish()? })
    }

    fn table(&self, count: u32, sample: impl Fn(u32) -> f32 + Sync) -> Vec<Entry> {
        (0..count).into_par_iter().map(|bits| self.entry(sample(bits))).collect()
    }

    fn entry(&self, sample: f32) -> Entry {
        let (color, opacity) = self.transfer(sample - self.input.coding.origin as f32);
        let shows = self.input.keeps_invisible() || opacity > 0.0;
        let density = density(opacity);
        Entry { density, appearance: shows.then(|| packed_appearance(color, density)) }
    }

    /// `transfer` in shaders/common/classified.wgsl.
    fn transfer(&self, sample: f32) -> ([f32; 3], f32) {
        let points = self.input.points.as_slice();
        let above = points.partition_point(|point| point.sample <= sample);
        let a = points[above.max(1) - 1];
        let b = points[above.min(points.len() - 1)];
        let width = b.sample - a.sample;
        let f = if width > 0.0 { ((sample - a.sample) / width).clamp(0.0, 1.0) } else { 0.0 };
        let color = [0, 1, 2].map(|c| a.color[c] + (b.color[c] - a.color[c]) * f);
        (color, a.opacity + (b.opacity - a.opacity) * f)
    }

    fn brick(&self, (origin, bytes): Brick) -> Result<MadeBrick> {
        let words = || bytemuck::pod_collect_to_vec::<u8, u16>(&bytes);
        let (narrow, wide) = (|bits: u8| self.table[usize::from(bits)], |bits: u16| self.table[usize::from(bits)]);
        match self.input.coding.sample_type {
            0 => self.splats(origin, &bytes, f32::from, narrow),
            1 => self.splats(origin, &bytes, |bits| f32::from(bits as i8), narrow),
            2 => self.splats(origin, &words(), f32::from, wide),
            3 => self.splats(origin, &words(), |bits| f32::from(bits as i16), wide),
            _ => {
                let samples: Vec<f32> = bytemuck::pod_collect_to_vec(&bytes);
                let sample = |sample: f32| sample.clamp(-FAR as f32, FAR as f32);
                self.splats(origin, &samples, sample, |value| self.entry(sample(value)))
            }
        }
    }

    /// The splats of a brick, given its samples with the halo around them.
    fn splats<T: Copy>(
        &self,
        origin: [u32; 3],
        samples: &[T],
        sample: impl Fn(T) -> f32,
        entry: impl Fn(T) -> Entry,
    ) -> Result<MadeBrick> {
        let Input { lit, thinning, gradients, resolution: [base, faintest], .. } = self.input;
        let halo = self.input.halo();
        let edge = EDGE + 2 * halo;
        let each = if *lit { 3 } else { 2 };
        let slopes = LazyCell::new(|| {
            let field: Vec<f32> = samples.iter().map(|&s| sample(s) - base).collect();
            self.normals.slopes(&field, EDGE, halo)
        });
        MadeBrick::of_rows(origin, self.input.volume.grid().dims(), each, |[y, z], count, words| {
            let start = halo + edge * (y + halo + edge * (z + halo));
            let mut bits = 0;
            for (x, &value) in samples[start..][..count].iter().enumerate() {
                let Entry { density, appearance: Some(mut appearance), .. } = entry(value) else { continue };
                let at = |i: usize| sample(samples[i]);
                let i = start + x;
                let gradient = |slopes| gradient_of(gradients, slopes, resolution_at(at(i) - base, *faintest));
                if !thinning.is_empty() {
                    let differences = [1, edge, edge * edge].map(|step| 0.5 * (at(i + step) - at(i - step)));
                    let share = scaled_share(thinning, steepness_of(gradient(differences)));
                    if share <= 0.0 && !self.input.keeps_invisible() {
                        continue;
                    }
                    appearance = with_density(appearance, density * share);
                }
                bits |= 1 << x;
                words.extend(appearance);
                if *lit {
                    let inside = x + EDGE * (y + EDGE * z);
                    words.push(packed_normal(gradient([0, 1, 2].map(|axis| slopes[axis][inside])).0));
                }
            }
            bits
        })
    }
}
