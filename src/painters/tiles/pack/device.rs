//! The stages that pack voxels. See shaders/pack_samples.wgsl and shaders/pack_scalars.wgsl.

use bytemuck::Zeroable;

use super::{Packable, Packing};
use crate::error::Result;
use crate::gpu::layout::Pack;
use crate::gpu::pipeline::texture_view;
use crate::gpu::recorder::Recorder;
use crate::gpu::sampled_scalars::Targets;
use crate::gpu::splat::{SplatLight, ToEye};
use crate::gpu::stage::{Stage, for_each};

impl Packing {
    /// Returns the parameters of shaders.
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

    /// Fills the texture of voxels and the marks of macrocells. `clears` if the texture holds other voxels.
    pub(super) fn fill(
        &self,
        recorder: &mut Recorder<'_>,
        stage: &Stage,
        (source, clears): (&Packable, bool),
        (light, scale): (&SplatLight, f32),
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
        match source {
            Packable::Voxels(voxels) => {
                for dispatch in voxels.dispatches(context) {
                    let own = upload("pack.classify", bytemuck::bytes_of(&dispatch.parameters))?;
                    let resources = [
                        own.as_entire_binding(),
                        dispatch.samples,
                        voxels.points().as_entire_binding(),
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
            Packable::Scalars(scalars, _) => {
                let targets = Targets { pack: parameters, marks, texels };
                scalars.pack(recorder, stage, (self.low, self.dims), &targets)?;
            }
        }
        Ok(())
    }
}
