//! The stage on the device. See shaders/pack.wgsl.

use std::ops::Range;

use super::Packing;
use crate::error::Result;
use crate::gpu::layout::{Lighting, Pack};
use crate::gpu::pipeline::texture_view;
use crate::gpu::recorder::Recorder;
use crate::gpu::store::Store;
use crate::painters::stage::{Stage, for_each};

/// Bytes of the buffer that is packed and copied to the texture at a time: small beside the volume.
const BAND: u64 = 16 << 20;

/// A run of the stage on the device.
pub(super) struct DeviceStage<'a> {
    pub(super) stage: &'a Stage,
    pub(super) stores: &'a [Store],
    pub(super) packing: &'a Packing,
    pub(super) lighting: &'a Lighting,
}

impl DeviceStage<'_> {
    /// Makes the texture of splats, and that of the macrocells which have any.
    pub(super) fn run(
        &self,
        recorder: &mut Recorder<'_>,
        common: Pack,
        volume: &wgpu::Texture,
        occupied: &wgpu::Texture,
    ) -> Result<()> {
        let Self { packing, stores, .. } = self;
        let context = recorder.context;
        let uniform = wgpu::BufferUsages::UNIFORM;
        let [width, height] = packing.size;
        let occupied = occupied.create_view(&wgpu::TextureViewDescriptor::default());
        let lighting = context.upload("pack.lighting", bytemuck::bytes_of(self.lighting), uniform)?;
        let row_bytes = u64::from(width) * packing.voxel.texel();
        let band = (BAND / row_bytes).clamp(1, u64::from(height)) as u32;
        for first_row in (0..height).step_by(band as usize) {
            let row_count = band.min(height - first_row);
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
            let texels = context.buffer("pack.texels", u64::from(row_count) * row_bytes, usage)?;
            let planes = packing.planes(first_row..first_row + row_count);
            for store in *stores {
                let splats = packing.splats(store, &planes);
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
                self.stage.run(recorder, &resources, for_each(context, splats.len() as u64));
            }
            recorder.copy_rows(&texels, row_bytes, volume, first_row, [width, row_count]);
            recorder.submit();
            // One band at a time in memory.
            context.wait("packing the volume")?;
        }
        Ok(())
    }
}

impl Packing {
    /// The splats of a store from the first to the last that can be in these planes.
    fn splats(&self, store: &Store, planes: &Range<u32>) -> Range<u32> {
        let (low, axis) = (self.low[2], self.axes[2]);
        let inside = |[first, end]: [u32; 2]| first < low + planes.end && end > low + planes.start;
        let bricks = store.runs().filter(|(brick, _)| inside(brick.bounds.map(|point| point[axis])));
        let runs = bricks.map(|(_, run)| run);
        runs.reduce(|hull, run| hull.start.min(run.start)..hull.end.max(run.end)).unwrap_or(0..0)
    }
}
