//! A picture in layers: rays through one eye go through finer cells near the eye and coarser ones farther away, each
//! level on its own, front to back. Most pictures have one layer.

use super::RegionPixels;
use super::axis::families;
use super::paint::{TilesPicture, need, reach, refusal};
use crate::error::Result;
use crate::gpu::recorder::{Recorder, max_work};
use crate::image::Region;
use crate::painters::painter::{Begun, Job, Painting, Room};
use crate::stats::{PainterStats, TilesStats};

/// The painter `tiles`: fast, but it refuses some pictures.
pub(crate) const ROOM: Room = Room { refusal, reach, families, need, layers: true, lists: false, begin };

fn begin<'a>(nearest: Job<'a>, behind: Vec<Job<'a>>) -> Result<Begun<'a>> {
    let jobs = std::iter::once(nearest).chain(behind);
    let pictures: std::result::Result<Vec<TilesPicture<'_>>, String> = jobs.map(TilesPicture::new).collect();
    Ok(match pictures {
        Err(reason) => Begun::Refused(reason),
        Ok(pictures) => Begun::Ready(Box::new(PictureLayers(pictures))),
    })
}

/// The layers of a picture, the nearest first.
struct PictureLayers<'a>(Vec<TilesPicture<'a>>);

impl Painting for PictureLayers<'_> {
    fn is_empty(&self) -> bool {
        self.0.iter().all(TilesPicture::is_empty)
    }

    fn pixel_bytes(&self) -> u32 {
        self.0.iter().map(TilesPicture::pixel_bytes).max().unwrap_or_default()
    }

    fn most_pixels(&self) -> u64 {
        let Some(TilesPicture { job, .. }) = self.0.first() else { return u64::MAX };
        // A region goes through all layers in one submission.
        let work: u64 = self.0.iter().map(TilesPicture::pixel_work).sum();
        max_work(job.context) / work.max(1)
    }

    fn make_pipelines(&self) -> Result<()> {
        self.0.iter().try_for_each(|layer| layer.pipelines().map(|_| ()))
    }

    fn paint(&mut self, recorder: &mut Recorder<'_>, region: Region, part: Region) -> Result<wgpu::Buffer> {
        let Some(nearest) = self.0.first() else {
            return recorder.context.pixels("tiles.pixels", [region.width, region.height]);
        };
        let mut canvas = RegionPixels::new(&nearest.job, region, part)?;
        self.0.iter_mut().try_for_each(|layer| layer.paint(recorder, &mut canvas))?;
        Ok(canvas.pixels)
    }

    fn footprint_error(&self) -> f64 {
        self.0.iter().map(TilesPicture::footprint_error).fold(0.0, f64::max)
    }

    fn stats(&self) -> PainterStats {
        let layers = self.0.iter().map(TilesPicture::stats);
        // Every layer has the same rays; the thickness belongs to the thinnest slabs.
        let all = layers.reduce(|near, far| TilesStats {
            slabs: near.slabs + far.slabs,
            rays: near.rays.max(far.rays),
            packed_bytes: near.packed_bytes + far.packed_bytes,
            marches: near.marches.max(far.marches),
            slab_thickness: near.slab_thickness,
        });
        PainterStats::Tiles(all.unwrap_or_default())
    }
}
