//! What a picture took: what was modelled and what was left out.

use std::fmt;

use serde::Serialize;

use crate::renderer::AdapterInfo;
use crate::settings::{Accumulation, Model, Precision, Shading, Sheets};

/// The time of one stage.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StageTime {
    /// The stage.
    pub name: &'static str,
    /// Seconds.
    pub seconds: f64,
    /// Whether the device's timestamps told, or the host's clock.
    pub clock: Clock,
}

/// What a stage was timed by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Clock {
    /// Timestamp queries on the device: the stage alone.
    Device,
    /// The host's clock: the stage with all waiting.
    Host,
}

/// What a picture took.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Stats {
    /// The adapter that made it.
    pub adapter: AdapterInfo,
    /// The painter: `quads`.
    pub painter: &'static str,
    /// What a pixel is.
    pub model: Model,
    /// When the transfer function was applied; after reconstruction for every maximum intensity projection.
    pub shading: Shading,
    /// The number of lights; 0 where colours are those of the transfer function.
    pub lights: u32,
    /// How splats were gathered into sheets.
    pub sheet_alignment: Sheets,
    /// What a sheet added up.
    pub accumulation: Accumulation,
    /// The format of the sheets.
    pub precision: Precision,
    /// Width and height of the picture, pixels.
    pub size: [u32; 2],
    /// Pixels that the volume can reach: only these have sheets.
    pub pixels_covered: u64,
    /// Voxels of the volume.
    pub voxels: u64,
    /// Voxels of some opacity, kept as splats.
    pub splats_kept: u64,
    /// Voxels of none, dropped before drawing.
    pub splats_dropped: u64,
    /// Copies of voxels beyond the faces of the volume, for the scalar field to be complete up to them.
    pub splats_padding: u64,
    /// Bricks of 32^3 voxels that the volume is classified in; 0 where the host looks at it (post-shading).
    pub bricks: u32,
    /// Of these, the ones whose range of values shows something: only they are uploaded.
    pub bricks_uploaded: u32,
    /// Their bytes.
    pub bytes_uploaded: u64,
    /// Sheets across the volume.
    pub sheets: u32,
    /// World thickness of a sheet.
    pub sheet_thickness: f64,
    /// How many times as large as asked the farthest kernel was, for voxels not to fall between pixels.
    pub kernel_growth: f64,
    /// Sheets that one pass feeds.
    pub sheets_per_pass: u32,
    /// Passes drawn, one per batch of sheets that splats reach.
    pub passes: u64,
    /// Splats in bricks within view: the others were not looked at. Summed over the parts that a large picture is made in.
    pub splats_in_view: u64,
    /// Quads, one per splat and batch that it reaches.
    pub quads: u64,
    /// Of these, not drawn because everything before them was opaque.
    pub quads_terminated: u64,
    /// Quads per splat kept.
    pub quads_per_splat: f64,
    /// Rows and terms of the footprint table.
    pub footprint_table: [u32; 2],
    /// Its largest error, as a fraction of the footprint's peak.
    pub footprint_error: f64,
    /// Bytes of the prepared volume on the device.
    pub scene_bytes: u64,
    /// Bytes made on the device for this picture besides.
    pub frame_bytes: u64,
    /// The time of each stage.
    pub stages: Vec<StageTime>,
}

impl fmt::Display for Stats {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |part: u64| 100.0 * part as f64 / self.voxels.max(1) as f64;
        writeln!(f, "adapter      {} ({}, {})", self.adapter.name, self.adapter.kind, self.adapter.driver)?;
        writeln!(
            f,
            "picture      {} x {} px, {} px within reach of the volume",
            self.size[0], self.size[1], self.pixels_covered
        )?;
        let shading = if self.shading == Shading::Post { "post-shaded" } else { "pre-shaded" };
        let light = match self.lights {
            0 => "unlit".to_owned(),
            1 => "1 light".to_owned(),
            n => format!("{n} lights"),
        };
        writeln!(f, "model        {}, {shading}, {light}", self.model)?;
        writeln!(f, "voxels       {:>12}", self.voxels)?;
        writeln!(f, "  kept       {:>12}  {:.2} % as splats", self.splats_kept, percent(self.splats_kept))?;
        if self.splats_padding > 0 {
            writeln!(f, "  copied     {:>12}  beyond the faces", self.splats_padding)?;
        }
        writeln!(f, "  dropped    {:>12}  {:.2} % transparent", self.splats_dropped, percent(self.splats_dropped))?;
        if self.bricks > 0 {
            writeln!(
                f,
                "bricks       {:>12}  {} of them uploaded, {} bytes",
                self.bricks, self.bricks_uploaded, self.bytes_uploaded
            )?;
        }
        writeln!(
            f,
            "sheets       {:>12}  {:.4} world units thick, {} a pass, {}, {}",
            self.sheets, self.sheet_thickness, self.sheets_per_pass, self.sheet_alignment, self.accumulation
        )?;
        writeln!(f, "passes       {:>12}  painter {}, {} sheets", self.passes, self.painter, self.precision)?;
        writeln!(
            f,
            "quads        {:>12}  of {} splats in view, {} hidden and not drawn",
            self.quads, self.splats_in_view, self.quads_terminated
        )?;
        writeln!(
            f,
            "footprint    {:>5} x {:>2} table, error {:.1e} of its peak",
            self.footprint_table[0], self.footprint_table[1], self.footprint_error
        )?;
        writeln!(f, "GPU memory   {:>12}  bytes of volume, {} of picture", self.scene_bytes, self.frame_bytes)?;
        for stage in &self.stages {
            let clock = if stage.clock == Clock::Device { "device" } else { "host" };
            writeln!(f, "{:<12} {:>9.3} ms  ({clock} clock)", stage.name, stage.seconds * 1e3)?;
        }
        Ok(())
    }
}
