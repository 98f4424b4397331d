//! The shadows on visible voxels: shaders/shadows_of_voxels.wgsl.

use std::sync::Arc;

use super::{Buffers, ShadowJob, fits, planned, stage};
use crate::camera::clip::Side;
use crate::error::Result;
use crate::gpu::cache::Cache;
use crate::gpu::context::Context;
use crate::gpu::layout::LightBox;
use crate::gpu::pipeline::Binding;
use crate::gpu::recorder::Recorder;
use crate::gpu::shaders;
use crate::gpu::stage::{Constant, Stage, for_each};
use crate::gpu::voxels::{EACH, Voxels, VoxelsKey};
use crate::lighting::shadow::plan::LightPlans;
use crate::progress::Progress;

/// The stages that read and write at visible voxels.
struct VoxelStages {
    occluders: Stage,
    keep: Stage,
}

impl VoxelStages {
    /// Returns the stages for voxels, made now if there are none.
    fn of(pipelines: &Cache, context: &Context, voxels: &Voxels) -> Result<Arc<Self>> {
        let key = voxels.key().unlit();
        pipelines.get_or_make(key, || Ok(Self::new(context, key)))
    }

    fn new(context: &Context, key: VoxelsKey) -> Self {
        use Binding::{Read, Uniform, Write};
        let constants: Vec<Constant> = key.constants().collect();
        let slots = [Uniform, Read, Read, Uniform, Write, Read, Read, Read];
        let occluders = stage(context, shaders::SHADOWS_OF_VOXELS, "occluders", &slots[..7], &constants);
        Self { occluders, keep: stage(context, shaders::SHADOWS_OF_VOXELS, "keep", &slots, &constants) }
    }
}

/// Visible voxels that are to get shares of light.
pub(crate) struct Unlit<'a> {
    pub(crate) voxels: &'a Voxels,
    /// Whether nothing else needs the shares that the voxels hold: their memory is used again.
    pub(crate) over: bool,
    /// Number of voxels along the axes of the lattice.
    pub(crate) dims: [usize; 3],
    /// The sides of matter that casts shadows.
    pub(crate) clip: &'a [Side],
}

/// Returns the voxels with the shares of `lights`, `MAX_CASTING` being the ambient light, and with the shares that they
/// hold of other lights; `None` if the device has no room. `held` are the buffers of other lights on the same voxels.
pub(crate) fn run(
    context: &Context,
    pipelines: &Cache,
    unlit: &Unlit<'_>,
    plans: &LightPlans,
    lights: &[usize],
    held: Option<Buffers>,
    progress: &Progress,
) -> Result<Option<(Voxels, Buffers)>> {
    let lights = planned(plans, lights);
    let largest = unlit.voxels.counts().max().map(|count| u64::from(count) * EACH);
    if !fits(context, largest.unwrap_or(0), plans, lights.iter().map(|(_, plan)| plan)) {
        return Ok(None);
    }
    let is_filled = held.is_some();
    let job = ShadowJob::new(context, pipelines, plans, held)?;
    let stages = VoxelStages::of(pipelines, context, unlit.voxels)?;
    let mut recorder = Recorder::untimed(context);
    if !is_filled {
        recorder.clear(&job.field, job.field.size());
        let light_box = job.uniform(&job.casting(unlit.dims, unlit.clip))?;
        job.each_dispatch(&mut recorder, unlit.voxels, &stages.occluders, (&light_box, &|_| job.field.clone()), &[])?;
    }
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
    // Lights that voxels do not hold are all lights at first, so that each share is set.
    let kept = match unlit.voxels.kept() {
        Some(kept) if unlit.over => kept.to_vec(),
        before => {
            let buffer = |(number, count): (usize, u32)| {
                let buffer = context.buffer("shadows.kept", u64::from(count) * EACH, usage)?;
                if let Some(before) = before.and_then(|before| before.get(number)) {
                    recorder.copy(before, &buffer, 0, buffer.size());
                }
                Ok(buffer)
            };
            unlit.voxels.counts().enumerate().map(buffer).collect::<Result<Vec<_>>>()?
        }
    };
    job.each(&mut recorder, &lights, progress, &mut |recorder, light, plan| {
        let LightBox { strength, word, shift, .. } = job.share(light, plan);
        let light_box = job.uniform(&LightBox { strength, word, shift, ..job.of_plans() })?;
        let shares = [job.shares.as_entire_binding()];
        job.each_dispatch(recorder, unlit.voxels, &stages.keep, (&light_box, &|buffer| kept[buffer].clone()), &shares)
    })?;
    recorder.submit();
    Ok(Some((unlit.voxels.under(kept), job.buffers())))
}

impl ShadowJob<'_> {
    /// Records a stage over all voxels. `written` returns the buffer that it writes for a buffer of voxels, given the
    /// number of the latter; `others` are further buffers that it reads.
    fn each_dispatch(
        &self,
        recorder: &mut Recorder<'_>,
        voxels: &Voxels,
        stage: &Stage,
        (light_box, written): (&wgpu::Buffer, &dyn Fn(usize) -> wgpu::Buffer),
        others: &[wgpu::BindingResource<'_>],
    ) -> Result<()> {
        let context = self.context;
        for dispatch in voxels.dispatches(context) {
            let usage = wgpu::BufferUsages::UNIFORM;
            let classify = context.upload("shadows.classify", bytemuck::bytes_of(&dispatch.parameters), usage)?;
            let to = written(dispatch.buffer);
            let own = [
                classify.as_entire_binding(),
                dispatch.samples,
                voxels.points().as_entire_binding(),
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
