//! The error of a picture before anything is traced: from what was drawn and how.

use serde::Serialize;

use crate::gpu::cells::least_growth;
use crate::settings::{Accumulation, Interslice, Model, Precision, Settings, Shading, Sheets};
use crate::stats::{PainterStats, RaySpacing, Stats};
use crate::volume::Grid;

/// The predicted error of a picture, cause by cause: what 99.9 % of the covered pixels keep, 0 to 1.
///
/// Each is a formula of what the transfer function may show, times a factor fitted to measurements
/// (docs/measurements). The volume itself is not looked at, so that predictions are those of its worst places: most
/// pictures are several times closer to the truth.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Prediction {
    /// Colours that lie behind each other in a sheet or a slab are mixed.
    pub order: f64,
    /// Scalars between sheets are interpolated before they are classified, and kernels jump at their rims, which steps
    /// of the transfer function turn into other colours.
    pub interpolation: f64,
    /// Rays are fewer than pixels.
    pub rays: f64,
    /// The footprint is a table or a polynomial.
    pub footprint: f64,
    /// Sums are rounded.
    pub precision: f64,
    /// Cells stand for voxels.
    pub level: f64,
    /// What little light reaches is left out.
    pub termination: f64,
}

// Factors fitted to 243 pictures of 26 random scenes (docs/measurements/2026-11-22-predictions.md): five in six err by
// at most what is predicted, 95 % by at most twice as much, half by less than 0.4 of it.

/// Order in a sheet of the painter quads, and in a slab of tiles, which knows where in it matter lies.
const ORDER: [f64; 2] = [0.019, 0.010];
/// Of opacities that are added, and of sheets that are voxel planes: see docs/algorithms.md.
const ADDITIVE: f64 = 0.1;
const AXIS: f64 = 0.1;
/// Between sheets, by parabolas; by means it is twice as much.
const INTERPOLATION: f64 = 0.05;
const MEANS: f64 = 2.0;
/// Slabs of scalars are half a voxel thick, and err as sheets of this many times their thickness.
const SLAB: f64 = 1.7;
/// Light turns errors of gradients into errors of brightness.
const LIT: f64 = 1.5;
/// Of what a step of the transfer function changes, between means of sheets as thick as a voxel. Fitted to steps and
/// boxes of two opacities on three built-in volumes (docs/algorithms.md).
const STEPS: f64 = 0.9;
/// Of a maximum, which finds the jumps of kernels at their rims.
const RIM: f64 = 0.4;
const RAYS: f64 = 0.004;
const HALF_SHEETS: f64 = 0.004;
const FLOAT_SHEETS: f64 = 1e-5;
const FLOAT_RAYS: f64 = 2e-4;
/// Cells ring beside edges, the more the denser they are and the less their kernels have grown; pre- and post-shaded,
/// so that 16 small pictures of three scans err by about that (99.9 % of pixels). Light on reconstructed cells has
/// one normal for all of their voxels.
const CELLS: [f64; 2] = [0.075, 0.12];
const CELLS_BY_DEPTH: f64 = 0.75;
const LIT_CELLS: f64 = 0.03;
/// Voxels in a row, from which light is seen.
const FEW_VOXELS: f64 = 4.0;

/// What a transfer function may show of a volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Facts {
    /// The largest difference of two visible colours in a channel.
    contrast: f64,
    /// The largest optical depth of a voxel.
    depth: f64,
    /// The largest change of a channel at a step of the transfer function, of [`FEW_VOXELS`] in a row.
    step: f64,
    /// The least distance of two voxels, world units.
    voxel: f64,
}

impl Facts {
    /// Of the colours that show, the largest extinction of a voxel, per world unit, and the
    /// largest step of matter of a thickness in world units.
    pub(crate) fn of(colors: &[[f64; 3]], extinction: f64, step: impl Fn(f64) -> f64, grid: &Grid) -> Self {
        let range = |c: usize| {
            let [low, high] = colors
                .iter()
                .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], color| [low.min(color[c]), high.max(color[c])]);
            (high - low).max(0.0)
        };
        let voxel = grid.min_spacing();
        Self {
            contrast: (0..3).map(range).fold(0.0, f64::max),
            depth: extinction * voxel,
            step: step(FEW_VOXELS * voxel),
            voxel,
        }
    }
}

impl Prediction {
    /// What is predicted of a picture.
    pub(crate) fn of(stats: &Stats, settings: &Settings, facts: &Facts) -> Self {
        let lit = stats.lights > 0;
        let scalars = stats.shading == Shading::Post;
        let xray = stats.model == Model::Xray;
        let mip = matches!(stats.model, Model::Mip | Model::Minip);
        let Facts { contrast, depth, step, voxel } = *facts;
        let thickness = match &stats.painter {
            PainterStats::Quads(quads) => quads.sheet_thickness,
            PainterStats::Tiles(tiles) => tiles.slab_thickness,
        } / (voxel * stats.kernel_growth.max(1.0));
        let by_quads = stats.quads();
        // Across a kernel, which is some of its standard deviations wide, matter changes once.
        let change = |thickness: f64| thickness * thickness / settings.kernel.variance();
        // Opacity saturates, and light turns any colour into any brightness of it.
        let dense = depth / (1.0 + depth);
        let contrast = if lit { 1.0 } else { contrast };
        let order = contrast * change(thickness) * dense.powf(1.5);
        let order = match by_quads {
            _ if xray || scalars => 0.0,
            Some(quads) if quads.accumulation == Accumulation::Additive => ADDITIVE * dense,
            Some(quads) if quads.alignment == Sheets::Axis => AXIS * order,
            Some(_) => ORDER[0] * order,
            None => ORDER[1] * order,
        };
        let seen = 1.0 - (-FEW_VOXELS * depth).exp();
        let interpolation = if scalars {
            let thickness = if by_quads.is_some() { thickness } else { SLAB * thickness };
            let means = settings.interslice == Interslice::Mean && by_quads.is_some();
            let smooth =
                INTERPOLATION * change(thickness) * if means { MEANS } else { 1.0 } * if lit { LIT } else { 1.0 };
            let radius = settings.kernel.radius();
            let jumps = if mip { RIM * settings.kernel.value(radius * radius) * thickness.sqrt() } else { 0.0 };
            let steps = if mip || xray { 0.0 } else { STEPS * step * thickness.min(1.0).sqrt() };
            seen * (smooth + jumps) + steps
        } else {
            0.0
        };
        let capped = stats.tiles().is_some_and(|tiles| matches!(tiles.spacing, Some(RaySpacing::PerVoxel(_))));
        let precision = match by_quads.map(|quads| quads.precision) {
            Some(Precision::F16) => HALF_SHEETS * stats.kernel_growth,
            Some(Precision::F32) => FLOAT_SHEETS,
            None => FLOAT_RAYS,
        };
        let coarsest = stats.levels[1];
        let level = if coarsest > 0 {
            // Kernels of cells that the picture does not ask for blur what it would show.
            let growth = stats.kernel_growth / least_growth(&settings.kernel, coarsest);
            let blur = 1.0 - growth.min(1.0).powi(2);
            let depth = depth * f64::from(coarsest).exp2();
            let rings = CELLS[usize::from(scalars)] * depth.powf(CELLS_BY_DEPTH) / growth.max(1.0).powi(2);
            blur.max(rings + if lit && scalars { LIT_CELLS } else { 0.0 }).min(1.0)
        } else {
            0.0
        };
        Self {
            order: order.min(contrast / 2.0),
            interpolation: interpolation.min(1.0),
            rays: if capped && !scalars { RAYS * seen } else { 0.0 },
            footprint: stats.footprint_error,
            precision,
            level,
            termination: if xray { 0.0 } else { settings.termination },
        }
    }

    /// The causes and their errors.
    #[must_use]
    pub fn causes(&self) -> [(&'static str, f64); 7] {
        let Self { order, interpolation, rays, footprint, precision, level, termination } = *self;
        [
            ("order", order),
            ("interpolation", interpolation),
            ("rays", rays),
            ("footprint", footprint),
            ("precision", precision),
            ("level", level),
            ("termination", termination),
        ]
    }

    /// All causes together, as independent errors add up.
    #[must_use]
    pub fn error(&self) -> f64 {
        self.causes().iter().map(|(_, error)| error * error).sum::<f64>().sqrt()
    }
}
