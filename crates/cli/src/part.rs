//! The part of a volume at a url that a picture needs.

use voxsplat::appearance::Framing;
use voxsplat::camera::Camera;
use voxsplat::figure::Figure;
use voxsplat::formats::{self, LatticePart, LoadOptions, is_url};
use voxsplat::program::{ChoiceContext, ClipSpec, OpenChoices, TransferChoice, needed_part};

use super::failure::Failure;
use super::job::RenderJob;
use super::output;

/// Returns the options that load the volume of a job: of a volume at a url only the chunks that its clip and its region
/// need, if the other chunks cannot change the picture.
pub(crate) fn options(job: &RenderJob) -> Result<LoadOptions, Failure> {
    let is_part = [job.region.width, job.region.height] != job.size;
    if !is_url(&job.source) || (job.clip.is_empty() && !is_part) {
        return Ok(job.load);
    }
    let (for_all, beside) = (reason_for_all(job), reason_for_others(job).filter(|_| is_part));
    if let Some(reason) = for_all.or(beside) {
        let within = if for_all.is_some() || job.clip.is_empty() { "" } else { " in --clip" };
        output::say(&format!("note: fetching all chunks{within} because {reason}"));
    }
    if for_all.is_some() || (beside.is_some() && job.clip.is_empty()) {
        return Ok(job.load);
    }
    // The lattice is known without chunks. Their fill value may be NaN.
    let channel = job.load.channel.or(Some(0));
    let empty = LoadOptions { part: Some(LatticePart::NOTHING), channel, replace_nan: Some(0.0), ..job.load };
    let volume = formats::load(&job.source, &empty)?;
    let (mut view, mut settings) = (job.view.clone(), job.settings.clone());
    settings.clip = ClipSpec::intersection(&job.clip, &volume)?;
    if job.choices.open.sharpness {
        // The sharpest that may be chosen reaches farthest.
        settings.sharpness = settings.sharpness.max(1.0);
    }
    let side = OpenChoices { side: job.choices.open.side, light: false, material: false, sharpness: false };
    ChoiceContext::of(&volume).make_choices(side, &mut view, &mut settings)?;
    let camera = Camera::new(&view, volume.grid(), job.size)?;
    let region = Some(job.region).filter(|_| is_part && beside.is_none());
    Ok(LoadOptions { part: Some(needed_part(volume.grid(), &camera, region, &settings)?), ..job.load })
}

/// Returns the reason why all chunks of a level change a picture, with the options that it depends on.
fn reason_for_all(job: &RenderJob) -> Option<&'static str> {
    if job.transfer.needs_statistics() || matches!(job.transfer.choice, TransferChoice::Labels) {
        return Some("the transfer function depends on all values (fetch fewer: --transfer FILE, --window or --iso)");
    }
    if !job.layers.is_plain() || !job.layers.overlays.is_empty() || job.channels.len() > 1 {
        return Some("labels, masks, overlays and several channels depend on all values");
    }
    if job.sections.is_some() || !job.solids.planes.is_empty() {
        return Some("sections show matter beside the clip too");
    }
    job.figure.drawn.color_bar.then_some("the colour bar shows the range of all values")
}

/// Returns the reason why chunks beside a region change a picture.
fn reason_for_others(job: &RenderJob) -> Option<&'static str> {
    let chosen = job.choices.open.light && !job.transfer.isosurfaces.is_empty();
    let casts = |lighting: &voxsplat::lighting::Lighting| lighting.shadows > 0.0 || lighting.occlusion.is_some();
    if chosen || job.studio.requested || job.settings.lighting.as_ref().is_some_and(casts) {
        return Some("matter beside --region casts shadows (fetch fewer: --light off or --shadows 0)");
    }
    if job.frame != Framing::Volume || job.figure.drawn != Figure::default() || job.figure.legend {
        return Some("the frame depends on them (fetch fewer: --frame volume, without a figure)");
    }
    (job.settings.depth_coded || job.accuracy.max_error.is_some() || job.accuracy.verify)
        .then_some("depths and errors are measured in them")
}
