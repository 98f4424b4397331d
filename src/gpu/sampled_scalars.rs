//! Scalars that are no list: the device holds the samples, for painters that read these. Whatever the transfer function
//! shows, the samples are the same.

use std::sync::Arc;

use bytemuck::Zeroable;

use super::context::Context;
use super::layout::Scalars;
use super::pipeline::buffer_range;
use super::recorder::max_work;
use super::samples::{BrickBatch, FAR, HeldSamples, Input};
use super::stage::Constant;
use super::transfer::Reduction;
use crate::error::Result;
use crate::volume::{BRICK_EDGE as EDGE, SampleType};

/// The scalars of a lattice of voxels with copies beyond its faces.
pub(crate) struct SampledScalars {
    batches: Arc<Vec<BrickBatch>>,
    key: ScalarsKey,
    parameters: Scalars,
    /// Bricks of the volume along each axis.
    bricks: [u32; 3],
    /// The lattice points, copies included, that can take part in something visible: the first, and the one after the
    /// last.
    pub(crate) bounds: [[u32; 3]; 2],
}

/// How shaders read samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct ScalarsKey {
    sample_type: u32,
    gradients: bool,
}

impl ScalarsKey {
    pub(crate) fn constants(self) -> [Constant; 2] {
        [("SAMPLE_TYPE", self.sample_type), ("GRADIENTS", self.gradients.into())]
    }

    pub(crate) fn has_gradients(self) -> bool {
        self.gradients
    }
}

/// The samples that a dispatch reads, as a binding.
pub(crate) struct Dispatch<'a> {
    pub(crate) parameters: Scalars,
    pub(crate) texels: u64,
    pub(crate) samples: wgpu::BindingResource<'a>,
}

/// The largest difference of samples in the range of f32.
const FARTHEST: f64 = 1e38;
/// The largest factor from samples to scalars, and over the least one: normal numbers of f32.
const MOST_FACTOR: f64 = 1e37;

impl SampledScalars {
    /// The numbers `origin`, `rest` and `factor` of shaders; `None`: f32 cannot make scalars of these samples.
    fn numbers(input: &Input<'_>, reduction: &Reduction) -> Option<[f32; 3]> {
        if input.coding.reduction.is_some() {
            return Some([0.0, 0.0, 1.0]);
        }
        let (slope, intercept) = input.volume.rescale();
        let (base, factor) = ((reduction.base() - intercept) / slope, slope * reduction.factor());
        let origin = match input.volume.sample_type() {
            SampleType::F32 => f64::from(base.clamp(-FAR, FAR) as f32),
            _ => base.round().clamp(-32_768.0, 65_535.0),
        };
        let rest = (base - origin).clamp(-FAR, FAR);
        (1.0 / MOST_FACTOR..MOST_FACTOR).contains(&factor).then_some([origin as f32, rest as f32, factor as f32])
    }

    /// The scalars within `bounds` of a volume, whose samples the device holds from now on, and the bytes that were
    /// sent. `padding` are the layers of copies beyond each face. `None`: they have to be made on the host.
    pub(crate) fn new(
        input: &Input<'_>,
        reduction: &Reduction,
        held: &HeldSamples,
        (padding, bounds): (u32, [[u32; 3]; 2]),
    ) -> Result<Option<(Self, u64)>> {
        let Some([origin, rest, factor]) = Self::numbers(input, reduction) else { return Ok(None) };
        let key = ScalarsKey { sample_type: input.coding.sample_type, gradients: input.halo() > 0 };
        let dims = input.volume.grid().dims();
        let most = (Reduction::LIMIT / f64::from(factor)).min(FARTHEST) as f32;
        let parameters = Scalars { dims, padding, origin, rest, factor, most, ..Scalars::zeroed() };
        let (batches, sent) = held.with(input, |batches| Ok(Arc::clone(batches)))?;
        let bricks = input.volume.bricks();
        Ok(Some((Self { batches, key, parameters, bricks, bounds }, sent)))
    }

    pub(crate) fn key(&self) -> ScalarsKey {
        self.key
    }

    /// Lattice points within the bounds, copies beyond the faces included.
    pub(crate) fn count(&self) -> u64 {
        (0..3).map(|axis| u64::from(self.bounds[1][axis] - self.bounds[0][axis])).product()
    }

    /// The copies among them.
    pub(crate) fn copies(&self) -> u64 {
        let Scalars { dims, padding, .. } = self.parameters;
        let [low, high] = self.bounds;
        let inside = |axis: usize| high[axis].min(padding + dims[axis]).saturating_sub(low[axis].max(padding));
        self.count() - (0..3).map(|axis| u64::from(inside(axis))).product::<u64>()
    }

    /// Bytes of memory of the device.
    pub(crate) fn bytes(&self) -> u64 {
        self.batches.iter().map(|batch| batch.bytes.end - batch.bytes.start).sum()
    }

    /// The dispatches that make the scalars of a box of the lattice, an invocation each. None outlasts the watchdog of
    /// a small GPU.
    pub(crate) fn dispatches(&self, context: &Context, low: [u32; 3], dims: [u32; 3]) -> Vec<Dispatch<'_>> {
        let Scalars { padding, dims: [_, _, deep], .. } = self.parameters;
        let of_layer = self.bricks[0] * self.bricks[1];
        let of_plane = u64::from(dims[0]) * u64::from(dims[1]);
        let at_once = (max_work(context) / of_plane.max(1)).clamp(1, u64::from(dims[2].max(1))) as u32;
        let mut dispatches = Vec::new();
        let mut first_brick = 0;
        for of_buffer in BrickBatch::by_buffer(&self.batches) {
            let bricks = of_buffer.iter().map(|batch| batch.origins.len() as u32).sum::<u32>();
            let end_brick = first_brick + bricks;
            let [Some(first), Some(last)] = [of_buffer.first(), of_buffer.last()] else { continue };
            // The planes of these bricks in the extended lattice, and the copies beyond the faces.
            let [start, end] = [first_brick / of_layer, end_brick.div_ceil(of_layer)].map(|layer| layer * EDGE as u32);
            let start = if start == 0 { 0 } else { start + padding };
            let end = if end >= deep { deep + 2 * padding } else { end + padding };
            let [start, end] = [start, end].map(|plane| plane.saturating_sub(low[2]).min(dims[2]));
            for first_plane in (start..end).step_by(at_once as usize) {
                let planes = at_once.min(end - first_plane);
                dispatches.push(Dispatch {
                    parameters: Scalars { first_brick, end_brick, first_plane, planes, ..self.parameters },
                    texels: of_plane * u64::from(planes),
                    samples: buffer_range(&first.samples, first.bytes.start, last.bytes.end - first.bytes.start),
                });
            }
            first_brick = end_brick;
        }
        dispatches
    }
}
