//! The transfer function as shaders read it: shaders/common/transfer.wgsl.

use super::context::Context;
use super::scalars::Shows;
use crate::transfer::TransferFunction;

/// Steps of the table.
const TABLE_STEPS: u32 = 4096;

/// What scalars are classified by.
pub(crate) struct TransferTable {
    /// Colour, and extinction or alpha, at equal steps from the first point of the transfer function to the last.
    pub(crate) texture: wgpu::TextureView,
    /// The scalars around 0, ends included, at which nothing shows; there are none if the first is larger.
    pub(crate) invisible: [f32; 2],
    /// Place of a scalar in the table: scalar times the first, plus the second.
    pub(crate) lookup: [f32; 2],
}

impl TransferTable {
    /// Opacities are per `unit`, in local lengths (see [`Grid::local`](crate::volume::Grid)): so is extinction.
    pub(crate) fn new(context: &Context, transfer: &TransferFunction, shows: Shows, unit: f64) -> Self {
        let base = transfer.base();
        let [first, last] = transfer.range();
        let steps = f64::from(TABLE_STEPS - 1);
        let values: Vec<f32> = (0..TABLE_STEPS)
            .flat_map(|step| {
                let (color, opacity) = transfer.sample(first + (last - first) * f64::from(step) / steps);
                let alpha = match shows {
                    Shows::Opaque => TransferFunction::extinction(opacity, unit),
                    Shows::Largest => opacity / transfer.max_opacity().max(f64::MIN_POSITIVE),
                };
                [color[0], color[1], color[2], alpha].map(|c| c as f32)
            })
            .collect();
        let scale = if last > first { steps / (last - first) } else { 0.0 };
        Self {
            texture: context.float_texture("shade.transfer", [TABLE_STEPS, 1], &values),
            invisible: transfer.invisible_around(base).map_or([1.0, -1.0], |ends| ends.map(|v| (v - base) as f32)),
            lookup: [scale as f32, ((base - first) * scale) as f32],
        }
    }
}
