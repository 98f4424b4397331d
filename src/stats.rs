//! What a picture took: what was modelled and what was left out.

use std::fmt;

use serde::Serialize;

use crate::adapter::AdapterInfo;
use crate::names::spelled;
use crate::settings::{Accumulation, Model, Painter, Precision, Shading, Sheets};

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
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Clock {
    /// Timestamp queries on the device: the stage alone.
    Device,
    /// The host's clock: the stage with all waiting.
    Host,
}

spelled! { Clock { Device: "device", Host: "host" } }

/// What a picture took.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Stats {
    /// The adapter that made it.
    pub adapter: AdapterInfo,
    /// The painter that made it.
    pub painter: Painter,
    /// Why it did.
    pub painter_reason: String,
    /// Rays that the painter `tiles` followed; 0 where `quads` made the picture.
    pub rays: u64,
    /// Rays per voxel, along the two lattice axes that face the eye most: first the one that rays lean to less. `None`: rays
    /// are spaced by pixels.
    pub rays_per_voxel: Option<[u32; 2]>,
    /// Pixels from ray to ray where they are spaced so: 1 where each pixel has its own.
    pub pixels_per_ray: Option<f64>,
    /// What a pixel is.
    pub model: Model,
    /// When the transfer function was applied; after reconstruction for every maximum intensity projection.
    pub shading: Shading,
    /// Whether rays start at the eye.
    pub perspective: bool,
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
    /// Bricks of 32^3 voxels that splats are looked for in, with those of the copies.
    pub bricks: u32,
    /// Of these, the ones that may hold something that shows, by their ranges of values: only they are uploaded to be
    /// classified, or for post-shading looked at voxel by voxel.
    pub bricks_uploaded: u32,
    /// Bytes sent to the device for them: samples, or for post-shading the scalars that are kept.
    pub bytes_uploaded: u64,
    /// Sheets across the volume.
    pub sheets: u32,
    /// World thickness of a sheet.
    pub sheet_thickness: f64,
    /// How many times as large as asked the farthest kernel was, for voxels not to fall between pixels.
    pub kernel_growth: f64,
    /// Sheets that one pass feeds.
    pub sheets_per_pass: u32,
    /// Batches of sheets across the volume: `sheets` over `sheets_per_pass`.
    pub batches: u32,
    /// Passes drawn, one per batch of sheets that splats reach in each part of the picture.
    pub passes: u64,
    /// Splats in bricks within view: the others were not looked at. Summed over the parts that a large picture is made in.
    pub splats_in_view: u64,
    /// Quads, one per splat and batch that it reaches.
    pub quads: u64,
    /// Of these, not drawn because everything before them was opaque.
    pub quads_terminated: u64,
    /// Bricks found hidden as a whole: their splats were not looked at one by one. Summed over the parts of the picture,
    /// and over the lists that splats are sorted in, of which a brick may be in two.
    pub bricks_terminated: u64,
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
    /// Bytes sent to the device for this picture: parameters and lists of bricks, and splats of scalars where it does not
    /// hold them from the picture before.
    pub bytes_sent: u64,
    /// Pipelines that this renderer has made so far, for this picture, its scene, and those before.
    pub pipelines: u32,
    /// The time of each stage.
    pub stages: Vec<StageTime>,
}

/// A number with its thousands apart.
fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

impl fmt::Display for Stats {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [width, height] = self.size;
        writeln!(f, "adapter      {} ({}, {})", self.adapter.name, self.adapter.kind, self.adapter.driver)?;
        writeln!(f, "picture      {width} x {height} px")?;
        writeln!(f, "painter      {}: {}", self.painter, self.painter_reason)?;
        let shading = if self.shading == Shading::Post { "post-shaded" } else { "pre-shaded" };
        let light = match self.lights {
            0 => "unlit".to_owned(),
            1 => "1 light".to_owned(),
            n => format!("{n} lights"),
        };
        let rays = if self.perspective { "perspective" } else { "orthographic" };
        writeln!(f, "model        {}, {shading}, {light}, {rays}", self.model)?;
        if self.painter == Painter::Tiles {
            let rays = match (self.rays_per_voxel, self.pixels_per_ray) {
                (Some([a, b]), _) => format!("{a} x {b} per voxel"),
                (None, Some(pixels)) if pixels > 1.0 => format!("{pixels:.2} pixels apart"),
                _ => "one per pixel".to_owned(),
            };
            writeln!(f, "rays         {}, {rays}", grouped(self.rays))?;
            writeln!(f, "sheets       {} of {:.4} world units, along voxel planes", self.sheets, self.sheet_thickness)?;
        } else {
            writeln!(
                f,
                "sheets       {} of {:.4} world units, {}, {}, {}, {} a pass",
                self.sheets,
                self.sheet_thickness,
                self.sheet_alignment,
                self.accumulation,
                self.precision,
                self.sheets_per_pass
            )?;
            writeln!(
                f,
                "footprint    {} x {} table, error {:.1e} of its peak",
                self.footprint_table[0], self.footprint_table[1], self.footprint_error
            )?;
        }
        writeln!(f, "\n{:<10} {:>15} {:>15}", "", "modelled", "left out")?;
        let mut row = |name: &str, modelled: u64, left_out: u64, why: &str| {
            writeln!(f, "{name:<10} {:>15} {:>15}  {why}", grouped(modelled), grouped(left_out))
        };
        let pixels = u64::from(width) * u64::from(height);
        row("pixels", self.pixels_covered, pixels.saturating_sub(self.pixels_covered), "out of reach of the volume")?;
        row("bricks", self.bricks_uploaded.into(), (self.bricks - self.bricks_uploaded).into(), "show nothing")?;
        row("voxels", self.splats_kept, self.splats_dropped, "show nothing")?;
        if self.splats_padding > 0 {
            row("copies", self.splats_padding, 0, "beyond the faces, for the field to be complete there")?;
        }
        let splats = self.splats_kept + self.splats_padding;
        // Rays meet what is in their way, and nobody counts it.
        let counted = self.painter != Painter::Tiles;
        let mut row =
            |name, modelled, left_out, why: &str| if counted { row(name, modelled, left_out, why) } else { Ok(()) };
        row("splats", self.splats_in_view, splats.saturating_sub(self.splats_in_view), "out of view")?;
        let hidden = match self.bricks_terminated {
            0 => "hidden".to_owned(),
            bricks => format!("hidden, {} bricks of them as a whole", grouped(bricks)),
        };
        row("quads", self.quads - self.quads_terminated, self.quads_terminated, &hidden)?;
        row("batches", self.passes, u64::from(self.batches).saturating_sub(self.passes), "empty")?;
        writeln!(
            f,
            "\nGPU memory   {} bytes of volume, {} of picture; {} sent for it",
            grouped(self.scene_bytes),
            grouped(self.frame_bytes),
            grouped(self.bytes_sent)
        )?;
        writeln!(f, "pipelines    {} made so far", self.pipelines)?;
        for stage in &self.stages {
            writeln!(f, "{:<12} {:>9.3} ms  ({} clock)", stage.name, stage.seconds * 1e3, stage.clock)?;
        }
        Ok(())
    }
}
