//! The transfer function in the format of shaders: shaders/common/transfer.wgsl.

use super::context::Context;
use crate::transfer::bins::{Bins, VisibleValues};
use crate::transfer::scalars::Reduction;
use crate::transfer::{ControlPoint, Resolution, TransferFunction};

/// Number of equal bins of lengths of gradients.
const GRADIENT_BINS: usize = 4096;

/// The table by which shaders classify scalars.
pub(crate) struct TransferTable {
    /// The function and its integral by bins of scalars, gradient opacity by bins of gradients, and isosurfaces.
    pub(crate) texture: wgpu::TextureView,
    /// The range of invisible scalars around 0, ends included; empty if the first is larger.
    pub(crate) invisible: [f32; 2],
    /// The scalar at which the inner bins begin, and the number of bins for each scalar.
    pub(crate) lookup: [f32; 2],
    /// Whether extinction depends on gradients. The length of a gradient of scalars per world unit, times
    /// `gradient_lookup`, is its place among its bins.
    pub(crate) thins: bool,
    /// The number of isosurfaces.
    pub(crate) surfaces: u32,
    gradient_lookup: f64,
    /// The resolution of a scalar of 0, over 0.
    pub(crate) faintest: f32,
}

impl TransferTable {
    /// Makes the table of a transfer function. Extinctions are per unit of the function, so a table serves lattices of
    /// all sizes.
    pub(crate) fn new(
        context: &Context,
        transfer: &TransferFunction,
        reduction: &Reduction,
        shows: VisibleValues,
        resolution: &Resolution,
    ) -> Self {
        let Bins { mut rows, lookup, invisible } = Bins::new(transfer, reduction, shows);
        let steepest = transfer.gradient_opacity().last().map_or(0.0, |p| p.magnitude);
        let thins = !transfer.gradient_opacity().is_empty();
        let share = |place: usize| transfer.gradient_share(steepest * place as f64 / GRADIENT_BINS as f64) as f32;
        let bin = |bin: usize| [share(bin), share(bin + 1), 0.0, 0.0];
        rows.push(if thins { (0..GRADIENT_BINS).map(bin).collect() } else { Vec::new() });
        let surfaces = if shows == VisibleValues::Opaque { transfer.isosurfaces() } else { Vec::new() };
        let texels = |surface: &ControlPoint| {
            let [r, g, b] = surface.color.map(|c| c as f32);
            let depth = TransferFunction::extinction(surface.opacity, 1.0) as f32;
            [[r, g, b, depth], [reduction.scalar(surface.value), 0.0, 0.0, 0.0]]
        };
        if !surfaces.is_empty() {
            rows.push(surfaces.iter().flat_map(texels).collect());
        }
        let most = steepest * reduction.factor();
        let gradient_lookup = if most > 0.0 { GRADIENT_BINS as f64 / most } else { 0.0 };
        Self {
            texture: context.float_rows("shade.transfer", &rows),
            invisible,
            lookup,
            thins,
            surfaces: surfaces.len() as u32,
            gradient_lookup,
            faintest: reduction.faintest(resolution),
        }
    }

    /// Returns the factor from the length of a gradient to its place among its bins, if gradients of one value per
    /// world unit are reconstructed as `steepness`.
    pub(crate) fn gradient_lookup(&self, steepness: f64) -> f32 {
        (self.gradient_lookup / steepness).min(f64::from(f32::MAX)) as f32
    }
}
