//! The shadows on visible voxels of samples, which no list of splats holds: shaders/shadows_of_samples.wgsl.

use std::sync::Arc;

use super::{Buffers, ShadowJob, fits, planned, stage};
use crate::camera::clip::Side;
use crate::error::Result;
use crate::gpu::cache::Cache;
use crate::gpu::context::Context;
use crate::gpu::layout::LightBox;
use crate::gpu::pipeline::Binding;
use crate::gpu::recorder::Recorder;
use crate::gpu::sampled::Sampled;
use crate::gpu::samples::InputKey;
use crate::gpu::shaders;
use crate::gpu::stage::{Stage, for_each};
use crate::lighting::shadow::plan::LightPlans;
use crate::progress::Progress;

/// The stages that read samples in place of lists of splats.
struct SampleStages {
    occluders: Stage,
    keep: Stage,
}

impl SampleStages {
    /// Returns the stages for samples, made now if there are none.
    fn of(pipelines: &Cache, context: &Context, sampled: &Sampled) -> Result<Arc<Self>> {
        let key = sampled.input_key();
        pipelines.get_or_make(key, || Ok(Self::new(context, key)))
    }

    fn new(context: &Context, key: InputKey) -> Self {
        use Binding::{Read, Uniform, Write};
        let constants = key.constants();
        let slots = [Uniform, Read, Read, Uniform, Write, Read, Read, Read];
        let occluders = stage(context, shaders::SHADOWS_OF_SAMPLES, "occluders", &slots[..7], &constants);
        Self { occluders, keep: stage(context, shaders::SHADOWS_OF_SAMPLES, "keep", &slots, &constants) }
    }
}

/// Visible voxels of samples that are to get shares of light.
pub(crate) struct UnlitSamples<'a> {
    pub(crate) sampled: &'a Sampled,
    /// Whether nothing else needs the shares that the voxels hold: their memory is used again.
    pub(crate) over: bool,
    pub(crate) dims: [usize; 3],
    pub(crate) clip: &'a [Side],
}

/// Finds the light that arrives at voxels of samples, as [`run`](super::run) does at lists of splats.
pub(crate) fn run_on_samples(
    context: &Context,
    pipelines: &Cache,
    unlit: &UnlitSamples<'_>,
    plans: &LightPlans,
    lights: &[usize],
    held: Option<Buffers>,
    progress: &Progress,
) -> Result<Option<(Sampled, Buffers)>> {
    /// The number of bytes of the shares of a voxel.
    const EACH: u64 = 8;
    let lights = planned(plans, lights);
    let largest = unlit.sampled.counts().max().map(|count| u64::from(count) * EACH);
    if !fits(context, largest.unwrap_or(0), plans, lights.iter().map(|(_, plan)| plan)) {
        return Ok(None);
    }
    let is_filled = held.is_some();
    let job = ShadowJob::new(context, pipelines, plans, held)?;
    let stages = SampleStages::of(pipelines, context, unlit.sampled)?;
    let mut recorder = Recorder::untimed(context);
    if !is_filled {
        recorder.clear(&job.field, job.field.size());
        let light_box = job.uniform(&job.casting(unlit.dims, unlit.clip))?;
        job.each_dispatch(&mut recorder, unlit.sampled, &stages.occluders, (&light_box, &|_| job.field.clone()), &[])?;
    }
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
    // Lights that splats do not hold are all lights at first, so that each share is set.
    let kept = match unlit.sampled.kept() {
        Some(kept) if unlit.over => kept.to_vec(),
        before => {
            let buffer = |(number, count): (usize, u32)| {
                let buffer = context.buffer("shadows.kept", u64::from(count) * EACH, usage)?;
                if let Some(before) = before.and_then(|before| before.get(number)) {
                    recorder.copy(before, &buffer, 0, buffer.size());
                }
                Ok(buffer)
            };
            unlit.sampled.counts().enumerate().map(buffer).collect::<Result<Vec<_>>>()?
        }
    };
    job.each(&mut recorder, &lights, progress, &mut |recorder, light, plan| {
        let LightBox { strength, word, shift, .. } = job.share(light, plan);
        let light_box = job.uniform(&LightBox { strength, word, shift, ..job.of_plans() })?;
        let shares = [job.shares.as_entire_binding()];
        job.each_dispatch(recorder, unlit.sampled, &stages.keep, (&light_box, &|buffer| kept[buffer].clone()), &shares)
    })?;
    recorder.submit();
    Ok(Some((unlit.sampled.under(kept), job.buffers())))
}

impl ShadowJob<'_> {
    /// Records a stage over all samples. `written` returns the buffer that it writes for a buffer of samples, given the
    /// number of the latter; `others` are further buffers that it reads.
    fn each_dispatch(
        &self,
        recorder: &mut Recorder<'_>,
        sampled: &Sampled,
        stage: &Stage,
        (light_box, written): (&wgpu::Buffer, &dyn Fn(usize) -> wgpu::Buffer),
        others: &[wgpu::BindingResource<'_>],
    ) -> Result<()> {
        let context = self.context;
        for dispatch in sampled.dispatches(context) {
            let usage = wgpu::BufferUsages::UNIFORM;
            let classify = context.upload("shadows.classify", bytemuck::bytes_of(&dispatch.parameters), usage)?;
            let to = written(dispatch.buffer);
            let own = [
                classify.as_entire_binding(),
                dispatch.samples,
                sampled.points().as_entire_binding(),
                light_box.as_entire_binding(),
                to.as_entire_binding(),
                dispatch.places,
                dispatch.seen,
            ];
            stage.run(recorder, &[&own, others].concat(), for_each(context, dispatch.voxels));
            recorder.worked(dispatch.voxels);
        }
        Ok(())
    }
}
