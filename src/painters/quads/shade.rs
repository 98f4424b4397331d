//! shade: the steps in which sheets of scalars are classified and lit, or projected. See shaders/shade.wgsl.

use bytemuck::Zeroable;
use glam::DAffine3;

use super::plan::Plan;
use crate::gpu::layout::{Area, Shade, affine};
use crate::gpu::light_volume::PostShading;
use crate::gpu::pipeline::Binding::{
    self, DynamicUniform, FilteredTexture, Read, ReadTexture, Sampler, Texture, Uniform, Write,
};
use crate::gpu::view::half;

/// The bindings of shaders/shade.wgsl.
pub(super) const SLOTS: [Binding; 10] = {
    let sheets = Texture(wgpu::TextureViewDimension::D2Array);
    let transfer = ReadTexture(wgpu::TextureFormat::Rgba32Float);
    let light = FilteredTexture(wgpu::TextureViewDimension::D3);
    [Uniform, DynamicUniform, Uniform, sheets, sheets, transfer, Write, light, Sampler, Read]
};

/// Returns a step for each batch, whose last sheet waits for its neighbour, and one for the last sheet of all. A step
/// covers the pixels that its batch or the batch before reaches, or the whole region of the size `whole`.
pub(super) fn steps(
    plan: &Plan<'_>,
    post: &PostShading,
    sheets_per_pass: u32,
    reached: &[Area],
    whole: Option<[u32; 2]>,
) -> Vec<Shade> {
    let table = &post.table;
    let to_light = affine(&(post.to_light * DAffine3::from_translation(half(&plan.view.grid))));
    let area = |batch: Option<usize>| batch.and_then(|batch| reached.get(batch)).copied().unwrap_or_default();
    let has_splats = |area: Area| f32::from(u8::from(area != Area::default()));
    let step = |batch: usize| {
        let (before, current) = (area(batch.checked_sub(1)), area(Some(batch)));
        let Area { low, high } = whole.map_or_else(|| before.joined(current), |high| Area { low: [0, 0], high });
        // One sheet back: each is shaded when the next one is known.
        let depth = plan.sheet_depth(batch as u32 * sheets_per_pass) - plan.sheet_step;
        Shade {
            depth: depth as f32,
            previous: has_splats(before),
            current: has_splats(current),
            gradient_lookup: post.gradient_lookup,
            invisible: table.invisible,
            lookup: table.lookup,
            low,
            high,
            per_unit: post.per_unit,
            to_light,
            ..Shade::zeroed()
        }
    };
    (0..=reached.len()).map(step).collect()
}
