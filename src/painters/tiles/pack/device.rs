//! The stages that pack lists of splats, and samples. See shaders/pack.wgsl, shaders/pack_samples.wgsl and
//! shaders/pack_scalars.wgsl.

use std::ops::Range;

use bytemuck::Zeroable;

use super::{Packing, Samples};
use crate::error::Result;
use crate::gpu::context::Context;
use crate::gpu::layout::Pack;
use crate::gpu::pipeline::texture_view;
use crate::gpu::recorder::Recorder;
use crate::gpu::sampled_scalars::Targets;
use crate::gpu::splat::{SplatLight, ToEye};
use crate::gpu::stage::{Stage, for_each};
use crate::gpu::store::Store;

/// The number of splats that a workgroup packs: 32 for each invocation.
const RUN: u32 = 2048;

/// The splats of stores, in the form that the stage of lists reads.
#[derive(Debug)]
pub(super) struct Runs {
    /// Runs of at most [`RUN`] splats.
    runs: wgpu::Buffer,
    parts: Vec<StoreRuns>,
}

/// The runs of the splats of a store.
#[derive(Debug)]
struct StoreRuns {
    /// The number of the store.
    store: usize,
    runs: Range<u32>,
    splats: u64,
}

impl Runs {
    pub(super) fn new(context: &Context, stores: &[Store]) -> Result<Self> {
        let (mut runs, mut parts): (Vec<[u32; 2]>, Vec<StoreRuns>) = (Vec::new(), Vec::new());
        for (store, of_store) in stores.iter().enumerate() {
            let first = runs.len() as u32;
            for Range { start, end } in joined(of_store) {
                runs.extend(
                    (start..end).step_by(RUN as usize).map(|first| [first, end.min(first.saturating_add(RUN))]),
                );
            }
            let splats = runs[first as usize..].iter().map(|[first, end]| u64::from(end - first)).sum();
            if splats > 0 {
                parts.push(StoreRuns { store, runs: first..runs.len() as u32, splats });
            }
        }
        let runs = context.upload("pack.runs", bytemuck::cast_slice(&runs), wgpu::BufferUsages::STORAGE)?;
        Ok(Self { runs, parts })
    }
}

/// Returns the runs of splats of a store: neighbouring bricks are one run.
fn joined(store: &Store) -> Vec<Range<u32>> {
    let mut runs: Vec<Range<u32>> = Vec::new();
    for (_, run) in store.all_runs().filter(|(_, run)| !run.is_empty()) {
        match runs.last_mut() {
            Some(last) if last.end == run.start => last.end = run.end,
            _ => runs.push(run),
        }
    }
    runs
}

impl Packing {
    /// Returns the parameters of shaders, without splats.
    fn parameters(&self, light: &SplatLight, scale: f32) -> Pack {
        let ToEye { eye, view: [view_x, view_y, view_z], .. } = light.to_eye;
        Pack {
            low: self.low,
            rows: self.dims[1],
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

    /// Fills the box of voxels and the marks of macrocells with samples. `clears` if the box holds other voxels.
    pub(super) fn fill_from_samples(
        &self,
        recorder: &mut Recorder<'_>,
        stage: &Stage,
        (samples, clears): (&Samples, bool),
        light: &SplatLight,
        scale: f32,
        (volume, marks, pages): (&wgpu::TextureView, &wgpu::Buffer, &wgpu::Buffer),
    ) -> Result<()> {
        let context = recorder.context;
        let upload = |label, bytes: &[u8]| context.upload(label, bytes, wgpu::BufferUsages::UNIFORM);
        let parameters = Pack { clears: clears.into(), ..self.parameters(light, scale) };
        let parameters = upload("pack.parameters", bytemuck::bytes_of(&parameters))?;
        let lighting = upload("pack.lighting", bytemuck::bytes_of(&light.lighting))?;
        recorder.clear(marks, self.mark_bytes());
        let (parameters, lighting) = (parameters.as_entire_binding(), lighting.as_entire_binding());
        let (marks, texels) = (marks.as_entire_binding(), texture_view(volume));
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

    /// Fills the texture of voxels and the marks of macrocells with splats.
    pub(super) fn fill_from_lists(
        &self,
        recorder: &mut Recorder<'_>,
        stage: &Stage,
        (stores, Runs { runs, parts }): (&[Store], &Runs),
        light: &SplatLight,
        scale: f32,
        (volume, marks, pages): (&wgpu::TextureView, &wgpu::Buffer, &wgpu::Buffer),
    ) -> Result<()> {
        let context = recorder.context;
        let uniform = wgpu::BufferUsages::UNIFORM;
        let common = self.parameters(light, scale);
        recorder.clear(marks, self.mark_bytes());
        let lighting = context.upload("pack.lighting", bytemuck::bytes_of(&light.lighting), uniform)?;
        for StoreRuns { store, runs: part, splats } in parts {
            let store = &stores[*store];
            let parameters = Pack { first_run: part.start, run_count: part.len() as u32, ..common };
            let parameters = context.upload("pack.parameters", bytemuck::bytes_of(&parameters), uniform)?;
            let buffer = store.on_device(context)?;
            let resources = [
                parameters.as_entire_binding(),
                lighting.as_entire_binding(),
                buffer.as_entire_binding(),
                marks.as_entire_binding(),
                texture_view(volume),
                store.origins.as_entire_binding(),
                runs.as_entire_binding(),
                pages.as_entire_binding(),
            ];
            let (x, y) = context.workgroups(part.len() as u64, 1);
            stage.run(recorder, &resources, [x, y, 1]);
            recorder.worked(*splats);
        }
        Ok(())
    }
}
