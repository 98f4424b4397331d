//! Scalars that are no list: the device holds the samples, for painters that read these, as voxels or as cells. The
//! samples are the same for every transfer function.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use bytemuck::Zeroable;

use super::cache::Cache;
use super::context::Context;
use super::held_samples::{HeldBricks, HeldSamples};
use super::layout::Scalars;
use super::recorder::{Recorder, max_work};
use super::samples::Input;
use super::scalar_cells::{BoundSamples, CellFilters, ScalarCells};
use super::stage::{Constant, Stage, for_each};
use crate::error::Result;
use crate::kernel::Slopes;
use crate::splats::gradients::FAR;
use crate::transfer::scalars::Reduction;
use crate::volume::{BRICK_EDGE as EDGE, SampleType};

/// The scalars of a lattice of voxels, or of cells, with copies beyond its faces.
pub(crate) struct SampledScalars {
    held: Arc<HeldBricks>,
    key: ScalarsKey,
    parameters: Scalars,
    /// Bricks of the volume along each axis.
    bricks: [u32; 3],
    /// The cells that are made of the voxels; `None`: the lattice is the lattice of the voxels.
    cells: Option<ScalarCells>,
    /// Lattice points that cover the volume along each axis, without copies.
    dims: [u32; 3],
    /// The lattice points, copies included, that can take part in anything visible: the first, and the one after the
    /// last.
    pub(crate) bounds: [[u32; 3]; 2],
}

/// The form in which shaders read samples; a key of pipelines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct ScalarsKey {
    sample_type: u32,
    /// Number of layers of voxels around each brick.
    halo: u32,
    gradients: bool,
    cells: bool,
}

/// The bindings of a box that shaders fill: parameters, marks and texels.
pub(crate) struct Targets<'a> {
    pub(crate) pack: wgpu::BindingResource<'a>,
    pub(crate) marks: wgpu::BindingResource<'a>,
    pub(crate) texels: wgpu::BindingResource<'a>,
}

impl ScalarsKey {
    pub(crate) fn constants(self) -> [Constant; 4] {
        let gradients = self.gradients.into();
        [("SAMPLE_TYPE", self.sample_type), ("GRADIENTS", gradients), ("RANGES", gradients), ("HALO", self.halo)]
    }

    /// Returns the constants of stages that make cells, and whether cells have gradients.
    fn of_cells(self) -> (Vec<Constant>, bool) {
        (self.constants().to_vec(), self.gradients)
    }

    pub(crate) fn has_gradients(self) -> bool {
        self.gradients
    }

    pub(crate) fn has_cells(self) -> bool {
        self.cells
    }
}

/// The largest difference of samples in the range of f32.
const FARTHEST: f64 = 1e38;

impl SampledScalars {
    /// Returns the numbers `origin`, `rest` and `factor` of shaders.
    fn numbers(input: &Input<'_>, reduction: &Reduction) -> [f32; 3] {
        if input.coding.reduction.is_some() {
            return [0.0, 0.0, 1.0];
        }
        let (slope, intercept) = input.volume.rescale();
        let (base, factor) = ((reduction.base() - intercept) / slope, slope * reduction.factor());
        let origin = match input.volume.sample_type() {
            SampleType::F32 => f64::from(base.clamp(-FAR, FAR) as f32),
            _ => base.round().clamp(-32_768.0, 65_535.0),
        };
        let rest = (base - origin).clamp(-FAR, FAR);
        [origin as f32, rest as f32, factor as f32]
    }

    /// Holds the samples of a volume and returns its scalars within `bounds` of the lattice, with the bytes that were
    /// sent. `padding` is the number of layers of copies beyond each face, `filters` make cells of the voxels.
    pub(crate) fn new(
        (input, pipelines): (&Input<'_>, &Cache),
        reduction: &Reduction,
        held: &HeldSamples,
        (padding, bounds): (u32, [[u32; 3]; 2]),
        (filters, gradients): (Option<&CellFilters<'_>>, bool),
    ) -> Result<(Self, u64)> {
        let [origin, rest, factor] = Self::numbers(input, reduction);
        let (sample_type, cells) = (input.coding.sample_type, filters.is_some());
        let key = ScalarsKey { sample_type, halo: input.halo() as u32, gradients, cells };
        let voxels = input.volume.grid().dims();
        let most = (Reduction::LIMIT / f64::from(factor)).min(FARTHEST) as f32;
        let parameters = Scalars { dims: voxels, padding, origin, rest, factor, most, ..Scalars::zeroed() };
        let (held, sent) = held.with(input, input.all_bricks(), |held| Ok(Arc::clone(held)))?;
        let bricks = input.volume.bricks();
        let cells = |filters| ScalarCells::new(input.context, pipelines, key.of_cells(), voxels, filters);
        let cells = filters.map(cells).transpose()?;
        let dims = filters.map_or(voxels, |filters| filters.dims);
        Ok((Self { held, key, parameters, bricks, cells, dims, bounds }, sent))
    }

    pub(crate) fn key(&self) -> ScalarsKey {
        self.key
    }

    /// Returns the number of lattice points within the bounds, copies beyond the faces included.
    pub(crate) fn count(&self) -> u64 {
        (0..3).map(|axis| u64::from(self.bounds[1][axis] - self.bounds[0][axis])).product()
    }

    /// Returns the number of lattice points within the bounds that are copies beyond the faces.
    pub(crate) fn copies(&self) -> u64 {
        let (dims, padding) = (self.dims, self.parameters.padding);
        let [low, high] = self.bounds;
        let inside = |axis: usize| high[axis].min(padding + dims[axis]).saturating_sub(low[axis].max(padding));
        self.count() - (0..3).map(|axis| u64::from(inside(axis))).product::<u64>()
    }

    /// Returns the bytes of the samples on the device.
    pub(crate) fn bytes(&self) -> u64 {
        self.held.bytes()
    }

    /// Returns the cells; of a lattice of voxels, cells of one voxel each.
    pub(super) fn as_cells(&self, context: &Context, pipelines: &Cache) -> Result<Cow<'_, ScalarCells>> {
        if let Some(cells) = &self.cells {
            return Ok(Cow::Borrowed(cells));
        }
        let own = [vec![1.0]];
        let axes = [(0, own.as_slice()); 3];
        let filters = CellFilters { dims: self.dims, size: [1; 2], axes, beside: 1, slopes: Slopes::of_cells(1.0) };
        ScalarCells::new(context, pipelines, self.key.of_cells(), self.dims, &filters).map(Cow::Owned)
    }

    /// Returns the first cell within the bounds, and the number of cells along each axis.
    pub(super) fn cells_of_bounds(&self) -> ([i64; 3], [u32; 3]) {
        let [low, high] = self.bounds;
        let first = low.map(|point| i64::from(point) - i64::from(self.parameters.padding));
        (first, [0, 1, 2].map(|axis| high[axis] - low[axis]))
    }

    /// Returns the samples with the parameters that make cells of them.
    pub(super) fn bound(&self) -> BoundSamples<'_> {
        let of_layer = self.bricks[0] * self.bricks[1];
        BoundSamples { parameters: self.parameters, buffers: self.buffers().collect(), of_layer }
    }

    /// Returns the samples of each buffer as a binding, and the numbers of their bricks.
    fn buffers(&self) -> impl Iterator<Item = (Range<u32>, wgpu::BindingResource<'_>)> {
        self.held.buffers.iter().map(|buffer| (buffer.bricks.clone(), buffer.samples.as_entire_binding()))
    }

    /// Records the packing of the scalars of a box of the lattice, from `low` on and with `dims` points, into texels by
    /// the stage of [`Self::key`].
    pub(crate) fn pack(
        &self,
        recorder: &mut Recorder<'_>,
        stage: &Stage,
        (low, dims): ([u32; 3], [u32; 3]),
        targets: &Targets<'_>,
    ) -> Result<()> {
        let Targets { pack, marks, texels: volume } = targets;
        if let Some(cells) = &self.cells {
            let low = low.map(|point| i64::from(point) - i64::from(self.parameters.padding));
            return cells.each_part(recorder, &self.bound(), (low, dims), &mut |recorder, [part, cells], count| {
                let [part, cells] = [part, cells].map(wgpu::Buffer::as_entire_binding);
                let resources = [part, cells, pack.clone(), marks.clone(), volume.clone()];
                stage.run(recorder, &resources, for_each(recorder.context, count));
            });
        }
        let context = recorder.context;
        for (parameters, samples) in self.of_voxels(context, low, dims) {
            let texels = u64::from(dims[0]) * u64::from(dims[1]) * u64::from(parameters.planes);
            let parameters =
                context.upload("pack.scalars", bytemuck::bytes_of(&parameters), wgpu::BufferUsages::UNIFORM)?;
            let resources = [parameters.as_entire_binding(), samples, pack.clone(), marks.clone(), volume.clone()];
            stage.run(recorder, &resources, for_each(context, texels));
            recorder.worked(texels);
        }
        Ok(())
    }

    /// Returns the parameters and the samples of the dispatches that make the scalars of a box of voxels, an invocation
    /// for each voxel. None outlasts the watchdog of a small GPU.
    fn of_voxels(&self, context: &Context, low: [u32; 3], dims: [u32; 3]) -> Vec<(Scalars, wgpu::BindingResource<'_>)> {
        let Scalars { padding, dims: [_, _, deep], .. } = self.parameters;
        let of_layer = self.bricks[0] * self.bricks[1];
        let of_plane = u64::from(dims[0]) * u64::from(dims[1]);
        let at_once = (max_work(context) / of_plane.max(1)).clamp(1, u64::from(dims[2].max(1))) as u32;
        let mut dispatches = Vec::new();
        for (Range { start: first_brick, end: end_brick }, samples) in self.buffers() {
            // The planes of these bricks in the extended lattice, and the copies beyond the faces.
            let [start, end] = [first_brick / of_layer, end_brick.div_ceil(of_layer)].map(|layer| layer * EDGE as u32);
            let start = if start == 0 { 0 } else { start + padding };
            let end = if end >= deep { deep + 2 * padding } else { end + padding };
            let [start, end] = [start, end].map(|plane| plane.saturating_sub(low[2]).min(dims[2]));
            for first_plane in (start..end).step_by(at_once as usize) {
                let planes = at_once.min(end - first_plane);
                let own = Scalars { first_brick, end_brick, first_plane, planes, ..self.parameters };
                dispatches.push((own, samples.clone()));
            }
        }
        dispatches
    }
}
