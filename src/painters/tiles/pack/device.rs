//! The stage on the device. See shaders/pack.wgsl.

use std::ops::Range;

use bytemuck::Zeroable;

use super::{Layout, Packing, Reached, Samples, reaches};
use crate::error::Result;
use crate::gpu::context::Context;
use crate::gpu::layout::Pack;
use crate::gpu::pipeline::texture_view;
use crate::gpu::recorder::Recorder;
use crate::gpu::sampled_scalars::Targets;
use crate::gpu::splat::{SplatLight, ToEye};
use crate::gpu::stage::{Stage, for_each};
use crate::gpu::store::Store;
use crate::painters::tiles::axis::unordered;
use crate::splats::brick::BrickSplats;

/// The largest number of bytes of the buffer that software packs and copies to the texture at a time: near the caches.
const BAND: u64 = 16 << 20;

/// Splats that a workgroup packs: 32 for each invocation.
const RUN: u32 = 2048;

/// The splats that each band of the texture needs, as the shader reads them. They depend on stores and packing only.
#[derive(Debug)]
pub(in crate::painters::tiles) struct Bands {
    /// Runs of at most [`RUN`] splats.
    runs: wgpu::Buffer,
    bands: Vec<Band>,
}

/// What is packed together.
#[derive(Debug)]
struct Band {
    /// The rows of the texture; none of a box.
    rows: Range<u32>,
    /// The number of a store, the runs of its splats, and the number of these splats.
    parts: Vec<(usize, Range<u32>, u64)>,
}

#[cfg(test)]
impl Bands {
    /// The number of bands, and the splats that they have together.
    pub(in crate::painters::tiles) fn visits(&self) -> (usize, u64) {
        let parts = self.bands.iter().flat_map(|band| &band.parts);
        (self.bands.len(), parts.map(|(_, _, splats)| splats).sum())
    }
}

impl Packing {
    /// The bands of the texture, with the splats of the bricks that lie in each.
    pub(in crate::painters::tiles) fn bands(
        &self,
        context: &Context,
        stores: &[Store],
        reached: &Reached,
    ) -> Result<Bands> {
        let mut runs: Vec<[u32; 2]> = Vec::new();
        let band = |(rows, planes): (Range<u32>, Range<u32>)| {
            let mut parts = Vec::new();
            for (number, store) in stores.iter().enumerate() {
                let first = runs.len() as u32;
                let mut splats = 0;
                for run in self.splats(store, &planes, |brick| reaches(reached, number, brick)) {
                    splats += run.len() as u64;
                    let end = run.end;
                    runs.extend(run.step_by(RUN as usize).map(|first| [first, end.min(first.saturating_add(RUN))]));
                }
                if splats > 0 {
                    parts.push((number, first..runs.len() as u32, splats));
                }
            }
            Band { rows, parts }
        };
        let parts = match self.layout {
            Layout::Rows => {
                self.rows_of_bands(context).into_iter().map(|rows| (rows.clone(), self.planes(rows))).collect()
            }
            Layout::Box | Layout::Pages => vec![(0..0, 0..self.dims[2])],
        };
        let bands = parts.into_iter().map(band).collect();
        let runs = context.upload("pack.runs", bytemuck::cast_slice(&runs), wgpu::BufferUsages::STORAGE)?;
        Ok(Bands { runs, bands })
    }

    /// The rows of each band: whole shelves of planes if they fit, so that most bricks are in one band.
    fn rows_of_bands(&self, context: &Context) -> Vec<Range<u32>> {
        let [_, height] = self.size;
        let limits = &context.limits;
        let most = BAND.min(limits.max_storage_buffer_binding_size).min(limits.max_buffer_size);
        let rows = (most / self.row_bytes()).clamp(1, u64::from(height)) as u32;
        let shelf = self.dims[1] + 1;
        // The first row of the texture is a margin before the first shelf.
        let (step, margin) = if rows > shelf { ((rows - 1) / shelf * shelf, 1) } else { (rows, 0) };
        let starts = (0..height).step_by(step as usize).map(|row| if row == 0 { 0 } else { row + margin });
        let starts: Vec<u32> = starts.filter(|&row| row < height).collect();
        let ends = starts.iter().skip(1).copied().chain([height]);
        starts.iter().copied().zip(ends).map(|(start, end)| start..end).collect()
    }

    /// Bytes of a row of the texture.
    fn row_bytes(&self) -> u64 {
        u64::from(self.size[0]) * self.voxel.texel()
    }

    /// The parameters of shaders, without splats.
    fn parameters(&self, light: &SplatLight, scale: f32) -> Pack {
        let ToEye { eye, view: [view_x, view_y, view_z], .. } = light.to_eye;
        Pack {
            low: unordered(self.axes, self.low),
            axes: self.axes.map(|axis| axis as u32),
            rows: self.dims[1],
            columns: self.columns,
            row_texels: self.row_texels,
            width: self.size[0],
            scale,
            planes: self.dims[2],
            across: self.dims[0],
            mark_shift: self.mark_shift(),
            mark_reach: self.marking.reach,
            mark_steps: self.mark_steps(),
            page_steps: self.table_steps(),
            least_invisible: self.marking.invisible[0],
            largest_invisible: self.marking.invisible[1],
            eye,
            view_x,
            view_y,
            view_z,
            ..Pack::zeroed()
        }
    }

    /// Fills the box of voxels and the marks of macrocells with samples. `clears`: the box holds other voxels.
    pub(super) fn fill_from_samples(
        &self,
        recorder: &mut Recorder<'_>,
        stage: &Stage,
        (samples, clears): (&Samples, bool),
        light: &SplatLight,
        scale: f32,
        (volume, marks, pages): (&wgpu::Texture, &wgpu::Buffer, &wgpu::Buffer),
    ) -> Result<()> {
        let context = recorder.context;
        let upload = |label, bytes: &[u8]| context.upload(label, bytes, wgpu::BufferUsages::UNIFORM);
        let parameters = Pack { clears: clears.into(), ..self.parameters(light, scale) };
        let parameters = upload("pack.parameters", bytemuck::bytes_of(&parameters))?;
        let lighting = upload("pack.lighting", bytemuck::bytes_of(&light.lighting))?;
        let view = volume.create_view(&wgpu::TextureViewDescriptor::default());
        recorder.clear(marks, self.mark_bytes());
        let (parameters, lighting) = (parameters.as_entire_binding(), lighting.as_entire_binding());
        let (marks, texels) = (marks.as_entire_binding(), texture_view(&view));
        match samples {
            Samples::Voxels(sampled) => {
                for dispatch in sampled.dispatches(context) {
                    let own = upload("pack.classify", bytemuck::bytes_of(&dispatch.parameters))?;
                    let resources = [
                        own.as_entire_binding(),
                        dispatch.samples,
                        sampled.points().as_entire_binding(),
                        marks.clone(),
                        texels.clone(),
                        dispatch.places,
                        dispatch.seen,
                        parameters.clone(),
                        lighting.clone(),
                        dispatch.normals,
                        dispatch.kept,
                        pages.as_entire_binding(),
                    ];
                    stage.run(recorder, &resources, for_each(context, dispatch.voxels));
                    recorder.worked(dispatch.work);
                }
            }
            Samples::Scalars(scalars) => {
                let targets = Targets { pack: parameters, marks, texels };
                scalars.pack(recorder, stage, (self.low, self.dims), &targets)?;
            }
        }
        Ok(())
    }

    /// Fills the texture of voxels and the marks of macrocells.
    pub(super) fn fill_on_device(
        &self,
        recorder: &mut Recorder<'_>,
        stage: &Stage,
        (stores, Bands { runs, bands }): (&[Store], &Bands),
        light: &SplatLight,
        scale: f32,
        (volume, marks, pages): (&wgpu::Texture, &wgpu::Buffer, &wgpu::Buffer),
    ) -> Result<()> {
        let context = recorder.context;
        let uniform = wgpu::BufferUsages::UNIFORM;
        let [width, _] = self.size;
        let common = self.parameters(light, scale);
        recorder.clear(marks, self.mark_bytes());
        let lighting = context.upload("pack.lighting", bytemuck::bytes_of(&light.lighting), uniform)?;
        let row_bytes = self.row_bytes();
        // One buffer serves all bands: the device orders what reads and writes it, so that nothing waits.
        let largest = bands.iter().map(|band| band.rows.len() as u64).max().unwrap_or_default();
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        let texels = (self.layout == Layout::Rows)
            .then(|| context.buffer("pack.texels", largest * row_bytes, usage))
            .transpose()?;
        let view = volume.create_view(&wgpu::TextureViewDescriptor::default());
        let stored = texels.as_ref().map_or_else(|| texture_view(&view), wgpu::Buffer::as_entire_binding);
        for (number, Band { rows, parts }) in bands.iter().enumerate() {
            let (first_row, row_count) = (rows.start, rows.len() as u32);
            // A new buffer holds zeros.
            if let Some(texels) = texels.as_ref().filter(|_| number > 0) {
                recorder.clear(texels, u64::from(row_count) * row_bytes);
            }
            for (store, part, splats) in parts {
                let store = &stores[*store];
                let parameters =
                    Pack { first_run: part.start, run_count: part.len() as u32, first_row, row_count, ..common };
                let parameters = context.upload("pack.parameters", bytemuck::bytes_of(&parameters), uniform)?;
                let buffer = store.on_device(context)?;
                let resources = [
                    parameters.as_entire_binding(),
                    lighting.as_entire_binding(),
                    buffer.as_entire_binding(),
                    marks.as_entire_binding(),
                    stored.clone(),
                    store.origins.as_entire_binding(),
                    runs.as_entire_binding(),
                    pages.as_entire_binding(),
                ];
                let (x, y) = context.workgroups(part.len() as u64, 1);
                stage.run(recorder, &resources, [x, y, 1]);
                recorder.worked(*splats);
            }
            if let Some(texels) = &texels {
                recorder.copy_rows(texels, row_bytes, volume, first_row, [width, row_count]);
            }
        }
        Ok(())
    }

    /// The runs of splats of a store that may be in these planes and that rays reach: neighbouring bricks are one run.
    fn splats(&self, store: &Store, planes: &Range<u32>, reaches: impl Fn(usize) -> bool) -> Vec<Range<u32>> {
        let (low, axis) = (self.low[2], self.axes[2]);
        let inside = |[first, end]: [u32; 2]| first < low + planes.end && end > low + planes.start;
        let inside = |brick: &BrickSplats| inside(brick.bounds.map(|point| point[axis]));
        let bricks = store.all_runs().enumerate().filter(|(number, (brick, _))| inside(brick) && reaches(*number));
        let mut runs: Vec<Range<u32>> = Vec::new();
        for (_, (_, run)) in bricks.filter(|(_, (_, run))| !run.is_empty()) {
            match runs.last_mut() {
                Some(last) if last.end == run.start => last.end = run.end,
                _ => runs.push(run),
            }
        }
        runs
    }
}
