//! The stage on the device. See shaders/pack.wgsl.

use std::ops::Range;

use bytemuck::Zeroable;

use super::{Lit, Packing};
use crate::error::Result;
use crate::gpu::layout::Pack;
use crate::gpu::pipeline::texture_view;
use crate::gpu::recorder::Recorder;
use crate::gpu::splat::ToEye;
use crate::gpu::store::Store;
use crate::painters::stage::{Stage, for_each};
use crate::painters::tiles::axis::unordered;

/// Bytes of the buffer that is packed and copied to the texture at a time: small beside the volume.
const BAND: u64 = 16 << 20;

impl Packing {
    /// Fills the texture of voxels and the texture of macrocells with splats.
    pub(super) fn fill_on_device(
        &self,
        recorder: &mut Recorder<'_>,
        stage: &Stage,
        stores: &[Store],
        lit: &Lit<'_>,
        scale: f32,
        [volume, occupied]: &[wgpu::Texture; 2],
    ) -> Result<()> {
        let context = recorder.context;
        let uniform = wgpu::BufferUsages::UNIFORM;
        let [width, height] = self.size;
        let ToEye { eye, view: [view_x, view_y, view_z], .. } = lit.to_eye;
        let common = Pack {
            low: unordered(self.axes, self.low),
            axes: self.axes.map(|axis| axis as u32),
            rows: self.dims[1],
            columns: self.columns,
            row_texels: self.row_texels,
            width,
            scale,
            planes: self.dims[2],
            across: self.dims[0],
            eye,
            view_x,
            view_y,
            view_z,
            ..Pack::zeroed()
        };
        let occupied = occupied.create_view(&wgpu::TextureViewDescriptor::default());
        let lighting = context.upload("pack.lighting", bytemuck::bytes_of(lit.lighting), uniform)?;
        let row_bytes = u64::from(width) * self.voxel.texel();
        let band = (BAND / row_bytes).clamp(1, u64::from(height)) as u32;
        for first_row in (0..height).step_by(band as usize) {
            let row_count = band.min(height - first_row);
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
            let texels = context.buffer("pack.texels", u64::from(row_count) * row_bytes, usage)?;
            let planes = self.planes(first_row..first_row + row_count);
            for store in stores {
                let splats = self.splats(store, &planes);
                if splats.is_empty() {
                    continue;
                }
                let parameters =
                    Pack { first_splat: splats.start, end_splat: splats.end, first_row, row_count, ..common };
                let parameters = context.upload("pack.parameters", bytemuck::bytes_of(&parameters), uniform)?;
                let buffer = store.on_device(context)?;
                let resources = [
                    parameters.as_entire_binding(),
                    lighting.as_entire_binding(),
                    buffer.as_entire_binding(),
                    store.origins.as_entire_binding(),
                    texels.as_entire_binding(),
                    texture_view(&occupied),
                ];
                stage.run(recorder, &resources, for_each(context, splats.len() as u64));
            }
            recorder.copy_rows(&texels, row_bytes, volume, first_row, [width, row_count]);
            recorder.submit();
            // One band at a time in memory.
            context.wait("packing the volume")?;
        }
        Ok(())
    }

    /// The splats of a store from the first to the last that may be in these planes.
    fn splats(&self, store: &Store, planes: &Range<u32>) -> Range<u32> {
        let (low, axis) = (self.low[2], self.axes[2]);
        let inside = |[first, end]: [u32; 2]| first < low + planes.end && end > low + planes.start;
        let bricks = store.runs().filter(|(brick, _)| inside(brick.bounds.map(|point| point[axis])));
        let runs = bricks.map(|(_, run)| run);
        runs.reduce(|hull, run| hull.start.min(run.start)..hull.end.max(run.end)).unwrap_or(0..0)
    }
}
