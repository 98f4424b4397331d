//! A picture by quads: the needs of the painter, its precision, its sheets a pass, and its regions.

use std::sync::Arc;

use super::plan::{Plan, Target};
use super::splat::footprint_texture;
use super::{Feed, Inputs, QuadCounts, Quads, QuadsKey};
use crate::error::{Error, Result};
use crate::gpu::context::Context;
use crate::gpu::recorder::Recorder;
use crate::gpu::scan::Scan;
use crate::image::Region;
use crate::kernel::FootprintTable;
use crate::painters::painter::{Begun, Job, Painting, Room};
use crate::settings::budget::too_much;
use crate::settings::{Accumulation, Model, Precision};
use crate::stats::{PainterStats, QuadsStats};

/// The painter `quads`, which draws every picture without isosurfaces.
pub(crate) const ROOM: Room = Room {
    refusal: |_, _| None,
    reach: super::plan::reach,
    families: |_| vec![Box::new(|_| 1.0)],
    // The need is the same in both precisions.
    need: |view, settings, weights| Plan::new(view, settings, weights, Precision::F32).scalar_need(),
    layers: false,
    lists: true,
    begin: |job, _| Ok(Begun::Ready(Box::new(QuadsPicture::new(job)?))),
};

/// A picture by quads in progress.
struct QuadsPicture<'a> {
    job: Job<'a>,
    plan: Plan<'a>,
    key: QuadsKey,
    table: FootprintTable,
    footprint: wgpu::TextureView,
    /// The pixels that quads cover; see [`QuadsStats::fragments`].
    fragments: f64,
    drawn: QuadCounts,
    /// Number of parts of the picture that were painted.
    parts: u32,
}

/// The number of pieces per voxel in which sheets of scalars are classified. On the demos of 32^3 voxels, eight err by
/// 0 to 3 % less (rms), four by 1 to 10 % more.
const PIECES: f64 = 6.0;

impl<'a> QuadsPicture<'a> {
    fn new(job: Job<'a>) -> Result<Self> {
        let Job { context, view, settings, .. } = job;
        if job.isosurfaces() > 0 {
            return Err(Error::setting("painter", "quads draws no isosurfaces: use tiles or cpu"));
        }
        let knobs = settings.quads();
        let feed = match settings.model {
            Model::Xray => Feed::Depth,
            Model::Mip | Model::Minip | Model::Average => Feed::Projection,
            Model::Composite if settings.is_post_shaded() && settings.lighting.is_some() => Feed::LitScalars,
            Model::Composite if settings.is_post_shaded() => Feed::Scalars,
            Model::Composite => Feed::Colors,
        };
        let f32_fits = feed == Feed::Depth || batch_sizes(context, feed, Precision::F32).next().is_some();
        let precision = precision(knobs.precision, context.blends_f32() && f32_fits)
            .ok_or_else(|| context.unsupported("cannot blend f32 sheets: choose the precision f16".to_owned()))?;
        let plan = Plan::new(view, settings, job.weights, precision);
        let table_error = knobs.table_error.unwrap_or_else(|| precision.footprint_error());
        let table = FootprintTable::new(&settings.kernel, table_error)?;
        let sheets_per_pass = sheets_per_pass(context, feed, precision)?;
        let mut constants = job.constants();
        constants.extend([
            ("GROWN", (view.max_growth() > 1.0).into()),
            ("AXIS", plan.axis.is_some().into()),
            ("ADDITIVE", (knobs.accumulation == Accumulation::Additive).into()),
            ("SHEETS", sheets_per_pass),
            ("ROWS", table.rows()),
            ("TEXELS", table.terms() / 4),
        ]);
        if feed.is_scalar() {
            constants.push(("SAMPLES", settings.samples_per_slab(knobs.sheet_thickness, PIECES)));
        }
        let key = QuadsKey { feed, precision, sheets_per_pass, terminates: view.terminates(), constants };
        let bounds = view.projected_bounds();
        let fragments = bounds.map_or(0.0, |region| plan.fragments(job.lists, region, key.sheets_per_pass));
        let most = job.most_fragments;
        if fragments > most {
            let what = format!("quads would cover {fragments:.0e} pixels, at most {most:.0e} are drawn");
            return Err(too_much(&what, view.max_growth()));
        }
        let footprint = footprint_texture(context, &table);
        Ok(Self { job, plan, key, table, footprint, fragments, drawn: QuadCounts::default(), parts: 0 })
    }

    fn pipelines(&self) -> Result<Arc<Quads>> {
        let Job { context, pipelines, .. } = self.job;
        pipelines.get_or_make(self.key.clone(), || Quads::new(context, &self.key))
    }
}

impl Painting for QuadsPicture<'_> {
    fn is_empty(&self) -> bool {
        // Post-shading draws even without splats: the base value itself may be visible.
        (self.job.splats() == 0 && !self.key.feed.is_scalar()) || self.plan.sheets == 0
    }

    fn pixel_bytes(&self) -> u32 {
        self.key.sheet_bytes()
    }

    fn make_pipelines(&self) -> Result<()> {
        self.pipelines().map(|_| ())
    }

    /// Paints the whole region: a splat is hidden if all pixels that it covers are opaque, within the part or not.
    fn paint(&mut self, recorder: &mut Recorder<'_>, region: Region, _part: Region) -> Result<wgpu::Buffer> {
        let quads = self.pipelines()?;
        let Job { context, pipelines, lists, post, .. } = self.job;
        let solids = self.job.solid_depths(region)?;
        let inputs = Inputs { footprint: &self.footprint, lighting: self.job.lighting(), post, solids: &solids };
        let (plan, per_pass) = (&self.plan, self.key.sheets_per_pass);
        let frame = context.upload("frame", bytemuck::bytes_of(&plan.frame(region)), wgpu::BufferUsages::UNIFORM)?;
        let target = Target { plan, region, frame: &frame };
        let spans = quads.sorter.run(recorder, &*Scan::of(pipelines, context)?, target, per_pass, lists)?;
        let covered = plan.covered(lists, region, per_pass);
        self.parts += 1;
        quads.draw(recorder, target, &inputs, &spans, &covered, &mut self.drawn)
    }

    fn footprint_error(&self) -> f64 {
        self.table.max_error()
    }

    fn stats(&self) -> PainterStats {
        let knobs = self.job.settings.quads();
        let QuadCounts { sorted, passes, quads, terminated } = self.drawn;
        let (sheets, per_pass) = (self.plan.sheets, self.key.sheets_per_pass);
        PainterStats::Quads(QuadsStats {
            alignment: knobs.sheets,
            accumulation: knobs.accumulation,
            precision: self.key.precision,
            sheets,
            sheet_thickness: self.plan.sheet_step * self.job.view.unit,
            sheets_per_pass: per_pass,
            batches: if self.parts > 0 { sheets.div_ceil(per_pass) } else { 0 },
            passes,
            splats_in_view: sorted,
            quads,
            quads_terminated: terminated,
            fragments: self.fragments,
            footprint_table: [self.table.rows(), self.table.terms()],
        })
    }
}

/// Returns the requested precision, or f32 wherever the adapter blends it, whatever the model, the thickness and the
/// growth: half floats lose small contributions to a large sum, and some hardware cuts them off. `None` if f32 is
/// requested and the adapter does not blend it.
fn precision(requested: Option<Precision>, blends_f32: bool) -> Option<Precision> {
    match (requested, blends_f32) {
        (Some(Precision::F32), false) => None,
        (Some(precision), _) => Some(precision),
        (None, true) => Some(Precision::F32),
        (None, false) => Some(Precision::F16),
    }
}

/// Returns the numbers of sheets that a pass can feed within the adapter's attachments, the largest first.
fn batch_sizes(context: &Context, feed: Feed, precision: Precision) -> impl Iterator<Item = u32> {
    let bytes = context.limits.max_color_attachment_bytes_per_sample;
    let layers = context.limits.max_color_attachments.min(bytes / feed.texel_bytes(precision));
    feed.batch_sizes().iter().copied().filter(move |&n| n <= layers * feed.sheets_per_layer())
}

/// Returns the number of sheets that one pass feeds: the most that the adapter's attachments hold, up to 4: blending
/// takes the time.
fn sheets_per_pass(context: &Context, feed: Feed, precision: Precision) -> Result<u32> {
    if feed == Feed::Depth {
        return Ok(1);
    }
    let preferred = if feed.sheets_per_layer() > 1 { 8 } else { 4 };
    let largest = batch_sizes(context, feed, precision).filter(|&n| n <= preferred).max();
    largest.ok_or_else(|| context.unsupported(format!("cannot draw into the {precision} sheets of one pass at once")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sheets_are_f32_wherever_they_can_be() {
        use Precision::{F16, F32};
        let rows = [
            (None, true, Some(F32)),
            (None, false, Some(F16)),
            (Some(F16), true, Some(F16)),
            (Some(F16), false, Some(F16)),
            (Some(F32), true, Some(F32)),
            (Some(F32), false, None),
        ];
        for (requested, blends_f32, expected) in rows {
            assert_eq!(precision(requested, blends_f32), expected, "{requested:?} {blends_f32}");
        }
    }
}
