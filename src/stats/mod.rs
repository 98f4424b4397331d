//! Statistics of a picture: the splats, the savings, and the time.

pub mod adapter;

use std::fmt;
use std::time::Instant;

use serde::Serialize;

use crate::camera::clip::Clip;
use crate::image::Image;
use crate::settings::{Accumulation, Model, Precision, Shading, Sheets};
use crate::stats::adapter::AdapterInfo;
use voxsplat_volume::names::spelled;

/// The time of one stage of a picture.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StageTime {
    /// The name of the stage.
    pub name: &'static str,
    /// The seconds that the stage took.
    pub seconds: f64,
    /// The clock that measured the stage.
    pub clock: Clock,
}

impl StageTime {
    /// Makes the time of a stage by the host's clock.
    pub(crate) fn host(name: &'static str, seconds: f64) -> Self {
        Self { name, seconds, clock: Clock::Host }
    }
}

/// Runs `work` and returns its result with the seconds that it took on the host.
pub(crate) fn on_host<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = work();
    (result, start.elapsed().as_secs_f64())
}

/// A picture with its statistics.
#[derive(Debug, Clone)]
pub struct Rendered {
    /// The rendered picture.
    pub image: Image,
    /// The statistics of the picture.
    pub stats: Stats,
}

/// The clock that measured a stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Clock {
    /// Timestamp queries on the device: the stage alone.
    Device,
    /// The host's clock: the stage with all waiting.
    Host,
}

spelled! { Clock { Device: "device", Host: "host" } }

/// Statistics of a picture.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Stats {
    /// The adapter that made the picture.
    pub adapter: AdapterInfo,
    /// The painter that made the picture, with its statistics.
    pub painter: PainterStats,
    /// The reason for the choice of the painter.
    pub painter_reason: String,
    /// The model of the picture: the value of a pixel.
    pub model: Model,
    /// Whether the transfer function was applied before or after reconstruction; after it for every maximum intensity
    /// projection.
    pub shading: Shading,
    /// Whether rays start at the eye.
    pub perspective: bool,
    /// The number of lights; 0: colours come from the transfer function alone.
    pub lights: u32,
    /// The clipping planes, in the world.
    pub clip: Clip,
    /// Width and height of the picture, pixels.
    pub size: [u32; 2],
    /// Number of pixels that the volume can reach: only these were drawn.
    pub pixels_covered: u64,
    /// Number of parts in which the picture was made, one after the other: several if it outgrows the adapter's
    /// textures or bindings, or 256 MiB of sheets.
    pub parts: u32,
    /// Number of voxels of the volume.
    pub voxels: u64,
    /// Voxels that were kept as splats: voxels of some opacity; post-shaded, voxels that can take part in anything
    /// visible, and if the device keeps samples all voxels of the box around these. A cell of a coarser level counts as
    /// one; see `levels`.
    pub splats_kept: u64,
    /// Voxels that were dropped before drawing, or that cells of a coarser level stand for.
    pub splats_dropped: u64,
    /// Copies of voxels beyond the faces of the volume, which complete the scalar field up to the faces.
    pub splats_padding: u64,
    /// Bricks of 32^3 voxels that are searched for splats, bricks of copies included.
    pub bricks: u32,
    /// Bricks that may be visible, by their ranges of values: only these are uploaded to be classified, or for
    /// post-shading searched voxel by voxel.
    pub bricks_uploaded: u32,
    /// The number of bytes sent to the device for the uploaded bricks: samples, or for post-shading the scalars that
    /// are kept.
    pub bytes_uploaded: u64,
    /// The largest growth of a kernel: kernels grow so that no voxel falls between pixels.
    pub kernel_growth: f64,
    /// The finest and the coarsest level of the splats. A cell of level n stands for 2^n voxels along each axis, and of
    /// level n + 1/2 for half as many more, if kernels have grown so far that they do not resolve single voxels. Level
    /// 0 is the voxels.
    pub levels: [f32; 2],
    /// The sharpness of the picture: see [`Settings::sharpness`](crate::settings::Settings::sharpness).
    pub sharpness: f64,
    /// Root mean square of the noise of the reconstructed field over the noise of the samples, if that is white; `None`
    /// without sharpness.
    pub noise: Option<f64>,
    /// Largest error of the footprints, as a fraction of their peak.
    pub footprint_error: f64,
    /// The number of bytes of the prepared volume on the device.
    pub scene_bytes: u64,
    /// The number of bytes allocated on the device for this picture.
    pub frame_bytes: u64,
    /// The number of bytes sent to the device for this picture: parameters and lists of bricks, and splats of scalars
    /// unless the device holds them from the picture before.
    pub bytes_sent: u64,
    /// Number of dispatches of compute shaders and of draws for this picture.
    pub dispatches: u64,
    /// Number of submissions of commands to the device for this picture.
    pub submissions: u64,
    /// Number of times that the host waited for the device for this picture.
    pub waits: u64,
    /// The number of bytes of memory that the device holds after this picture, for all scenes, with the memory that
    /// wgpu keeps for transfers. 0 on Metal, which does not count.
    pub bytes_resident: u64,
    /// Number of pipelines that this renderer has made so far, for all scenes and pictures.
    pub pipelines: u32,
    /// The time of each stage of the picture.
    pub stages: Vec<StageTime>,
}

/// The work that a device has received since it was opened, and the memory that it holds now.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[non_exhaustive]
pub struct Counts {
    /// Number of dispatches of compute shaders, and of draws.
    pub dispatches: u64,
    /// Number of submissions of commands.
    pub submissions: u64,
    /// Number of times that the host waited for the device.
    pub waits: u64,
    /// The number of bytes sent to the device.
    pub uploaded: u64,
    /// The number of bytes of memory of all buffers and textures of the device, with the memory that wgpu keeps for
    /// transfers. 0 on Metal, which does not count.
    pub resident: u64,
}

/// Statistics of the painter of a picture.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "name", rename_all = "lowercase")]
#[non_exhaustive]
pub enum PainterStats {
    /// Statistics of the painter quads.
    Quads(QuadsStats),
    /// Statistics of the painter tiles.
    Tiles(TilesStats),
    /// Statistics of the host engine.
    Cpu(CpuStats),
}

/// Statistics of the host engine.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
#[non_exhaustive]
pub struct CpuStats {
    /// Number of samples of rays at planes of the lattice and half way between them. Interpolated ones do not count.
    pub samples: u64,
    /// Number of slabs of rays that were classified.
    pub slabs: u64,
    /// The number of bytes of the coefficients of the field.
    pub field_bytes: u64,
    /// The shares of the kernel that its B-splines leave out, of smooth data and of noise.
    pub misfit: [f64; 2],
}

/// Statistics of the painter quads.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct QuadsStats {
    /// The alignment of the sheets.
    pub alignment: Sheets,
    /// The quantity that a sheet adds up.
    pub accumulation: Accumulation,
    /// The format of the sheets.
    pub precision: Precision,
    /// Number of sheets across the volume.
    pub sheets: u32,
    /// Thickness of a sheet, in world units.
    pub sheet_thickness: f64,
    /// Number of sheets that one pass feeds.
    pub sheets_per_pass: u32,
    /// Number of batches of sheets across the volume: `sheets` over `sheets_per_pass`; 0 if nothing was drawn.
    pub batches: u32,
    /// Number of passes drawn, one per batch of sheets that splats reach, summed over the parts of the picture.
    pub passes: u64,
    /// Number of splats in bricks within view, summed over the parts of the picture. All other splats were skipped.
    pub splats_in_view: u64,
    /// Number of quads, one per splat and batch that it reaches.
    pub quads: u64,
    /// Number of quads not drawn because everything before them was opaque.
    pub quads_terminated: u64,
    /// Number of pixels that all quads of the picture cover, summed over the passes, as predicted before they are
    /// sorted.
    pub fragments: f64,
    /// Numbers of rows and terms of the footprint table.
    pub footprint_table: [u32; 2],
}

/// Statistics of the painter tiles.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
#[non_exhaustive]
pub struct TilesStats {
    /// Number of slabs across the volume, along voxel planes.
    pub slabs: u32,
    /// Thickness of a slab along the rays, in world units.
    pub slab_thickness: f64,
    /// Number of rays: one for each pixel and march.
    pub rays: u64,
    /// Number of marches whose colours were mixed: one for each principal axis with a share in the picture.
    pub marches: u32,
    /// The number of bytes of the packed volume on the device.
    pub packed_bytes: u64,
}

impl PainterStats {
    /// Returns the name of the painter.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Quads(_) => "quads",
            Self::Tiles(_) => "tiles",
            Self::Cpu(_) => "cpu",
        }
    }
}

impl Stats {
    /// Makes the statistics of an empty picture of the host engine.
    pub(crate) fn of_host(adapter: AdapterInfo) -> Self {
        Self {
            adapter,
            painter: PainterStats::Cpu(CpuStats::default()),
            painter_reason: String::new(),
            model: Model::default(),
            shading: Shading::default(),
            perspective: false,
            lights: 0,
            clip: Clip::default(),
            size: [0; 2],
            pixels_covered: 0,
            parts: 0,
            voxels: 0,
            splats_kept: 0,
            splats_dropped: 0,
            splats_padding: 0,
            bricks: 0,
            bricks_uploaded: 0,
            bytes_uploaded: 0,
            kernel_growth: 1.0,
            levels: [0.0; 2],
            sharpness: 0.0,
            noise: None,
            footprint_error: 0.0,
            scene_bytes: 0,
            frame_bytes: 0,
            bytes_sent: 0,
            dispatches: 0,
            submissions: 0,
            waits: 0,
            bytes_resident: 0,
            pipelines: 0,
            stages: Vec::new(),
        }
    }

    /// Adds the work for another part of the same picture: times, commands and bytes.
    pub(crate) fn add(&mut self, other: &Self) {
        for stage in &other.stages {
            let same = self.stages.iter_mut().find(|own| own.name == stage.name && own.clock == stage.clock);
            match same {
                Some(own) => own.seconds += stage.seconds,
                None => self.stages.push(stage.clone()),
            }
        }
        self.parts += other.parts;
        self.frame_bytes += other.frame_bytes;
        self.bytes_sent += other.bytes_sent;
        self.dispatches += other.dispatches;
        self.submissions += other.submissions;
        self.waits += other.waits;
    }

    /// Returns the statistics of the painter quads; `None` if another painter drew.
    #[must_use]
    pub fn quads(&self) -> Option<&QuadsStats> {
        if let PainterStats::Quads(quads) = &self.painter { Some(quads) } else { None }
    }

    /// Returns the statistics of the painter tiles; `None` if another painter drew.
    #[must_use]
    pub fn tiles(&self) -> Option<&TilesStats> {
        if let PainterStats::Tiles(tiles) = &self.painter { Some(tiles) } else { None }
    }

    /// Returns the seconds of a stage; `None` if it did not run.
    #[must_use]
    pub fn seconds(&self, stage: &str) -> Option<f64> {
        self.stages.iter().find(|s| s.name == stage).map(|s| s.seconds)
    }
}

/// Writes a number with its thousands separated.
fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let groups: Vec<&[u8]> = digits.as_bytes().rchunks(3).rev().collect();
    String::from_utf8_lossy(&groups.join(&b',')).into_owned()
}

impl fmt::Display for Stats {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.header(f)?;
        self.table(f)?;
        self.footer(f)
    }
}

impl Stats {
    fn header(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [width, height] = self.size;
        writeln!(f, "adapter      {} ({}, {})", self.adapter.name, self.adapter.kind, self.adapter.driver)?;
        writeln!(f, "picture      {width} x {height} px")?;
        writeln!(f, "painter      {}: {}", self.painter.name(), self.painter_reason)?;
        let shading = if self.shading == Shading::Post { "post-shaded" } else { "pre-shaded" };
        let light = match self.lights {
            0 => "unlit".to_owned(),
            1 => "1 light".to_owned(),
            n => format!("{n} lights"),
        };
        let rays = if self.perspective { "perspective" } else { "orthographic" };
        writeln!(f, "model        {}, {shading}, {light}, {rays}", self.model)?;
        for plane in self.clip.planes() {
            let [x, y, z] = plane.normal().to_array();
            writeln!(f, "clip         {x:.4},{y:.4},{z:.4},{:.4}", plane.offset())?;
        }
        if let Some(noise) = self.noise {
            writeln!(f, "sharpness    {}: noise {noise:.2} of that of the samples", self.sharpness)?;
        }
        let [finest, coarsest] = self.levels;
        let [small, large] = self.levels.map(|level| libm::exp2f(level.floor()) * (1.0 + level.fract()));
        if coarsest > finest {
            writeln!(f, "levels       {finest} to {coarsest}: cells of {small}^3 to {large}^3 voxels")?;
        } else if finest > 0.0 {
            writeln!(f, "level        {finest}: cells of {small}^3 voxels")?;
        }
        let error = self.footprint_error;
        match &self.painter {
            PainterStats::Quads(q) => {
                let QuadsStats { sheets, sheet_thickness, alignment, accumulation, precision, .. } = q;
                let per_pass = q.sheets_per_pass;
                writeln!(f, "sheets       {sheets} of {sheet_thickness:.4} world units, {alignment}, {accumulation}")?;
                writeln!(f, "             {precision}, {per_pass} a pass")?;
                let [rows, terms] = q.footprint_table;
                writeln!(f, "footprint    {rows} x {terms} table, error {error:.1e} of its peak")
            }
            PainterStats::Tiles(t) => {
                let mixed = if t.marches > 1 { format!(", {} marches mixed", t.marches) } else { String::new() };
                writeln!(f, "rays         {}, one per pixel{mixed}", grouped(t.rays))?;
                writeln!(f, "slabs        {} of {:.4} world units, along voxel planes", t.slabs, t.slab_thickness)?;
                writeln!(f, "footprint    polynomial, error {error:.1e} of its peak")
            }
            PainterStats::Cpu(CpuStats { samples, slabs, misfit: [data, noise], .. }) => {
                writeln!(f, "rays         one per pixel, {} samples, {} slabs", grouped(*samples), grouped(*slabs))?;
                let [data, noise] = [data, noise].map(|share| 100.0 * share);
                writeln!(
                    f,
                    "kernel       by B-splines, which leave out {data:.1} % of smooth data, {noise:.0} % of noise"
                )
            }
        }
    }

    /// Writes for each kind of item the number that was modelled, the number that was left out, and the reason.
    fn table(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let pixels = self.size.map(u64::from).iter().product::<u64>().saturating_sub(self.pixels_covered);
        if let PainterStats::Cpu(_) = &self.painter {
            return Ok(());
        }
        let bricks = [self.bricks_uploaded, self.bricks - self.bricks_uploaded].map(u64::from);
        let dropped = if self.levels[1] > 0.0 { "show nothing, or are part of a cell" } else { "show nothing" };
        let mut rows = vec![
            ("pixels", self.pixels_covered, pixels, "out of reach of the volume, or of the region"),
            ("bricks", bricks[0], bricks[1], "show nothing"),
            ("voxels", self.splats_kept, self.splats_dropped, dropped),
        ];
        if self.splats_padding > 0 {
            rows.push(("copies", self.splats_padding, 0, "beyond the faces, for the field to be complete there"));
        }
        // Tiles does not count the splats that rays meet.
        if let PainterStats::Quads(q) = &self.painter {
            let out_of_view = (self.splats_kept + self.splats_padding).saturating_sub(q.splats_in_view);
            rows.push(("splats", q.splats_in_view, out_of_view, "out of view"));
            rows.push(("quads", q.quads - q.quads_terminated, q.quads_terminated, "hidden"));
            rows.push(("batches", q.passes, u64::from(q.batches).saturating_sub(q.passes), "empty"));
        }
        writeln!(f, "\n{:<10} {:>15} {:>15}", "", "modelled", "left out")?;
        rows.into_iter().try_for_each(|(name, modelled, left_out, why)| {
            writeln!(f, "{name:<10} {:>15} {:>15}  {why}", grouped(modelled), grouped(left_out))
        })
    }

    fn footer(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let PainterStats::Cpu(CpuStats { field_bytes, .. }) = &self.painter {
            writeln!(f, "memory       {} bytes of coefficients", grouped(*field_bytes))?;
            return self.times(f);
        }
        let packed = self.tiles().map_or(0, |t| t.packed_bytes);
        let [volume, picture, sent] = [self.scene_bytes + packed, self.frame_bytes, self.bytes_sent].map(grouped);
        writeln!(f, "\nGPU memory   {volume} bytes of volume, {picture} of picture; {sent} sent for it")?;
        let [dispatches, submissions, waits] = [self.dispatches, self.submissions, self.waits].map(grouped);
        writeln!(f, "commands     {dispatches} dispatches in {submissions} submissions, {waits} waits")?;
        writeln!(f, "pipelines    {} made so far", self.pipelines)?;
        self.times(f)
    }

    fn times(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.stages.iter().try_for_each(|stage| {
            writeln!(f, "{:<12} {:>9.3} ms  ({} clock)", stage.name, stage.seconds * 1e3, stage.clock)
        })
    }
}
