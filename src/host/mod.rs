//! The host engine: rays through fields of B-splines on the processor, without a graphics driver.
//!
//! The field that kernels reconstruct is represented by cubic B-splines (`kernel/spline.rs`): a filter of the samples
//! depends on the kernel alone, and a sample of the field then takes 64 coefficients, whatever the kernel, the view and
//! the projection. [`HostRenderer`] draws composites and projections of scalars ([`Shading::Post`]), and composites and
//! X-rays of classified voxels ([`Shading::Pre`]), which may have several layers. Where voxels are smaller than pixels,
//! kernels grow: of perspective pictures the fields of some sizes are blended. Fields of lit voxels, which serve one
//! view, have coefficients only where they have weights. A scene of a part of a lattice makes partial pictures, for
//! `src/bricks`. [`Settings::painter`] has no effect; `voxsplat render --painter cpu` requests this engine.
//!
//! # Files
//!
//! - *Scenes.* `scalars.rs` and `voxels.rs` have what is reconstructed: scalars, or classified and lit voxels.
//! - *Fields.* `filter.rs` leads from samples to coefficients of B-splines. `field.rs` and `colors.rs` are fields of
//!   coefficients, `lattice.rs` is their box and what rays read of it. `level.rs` and `blend.rs` have cells, and fields
//!   of several kernels, where voxels are smaller than pixels.
//! - *Rays.* `rays.rs`, `plane.rs` and `march.rs` take tiles of rays from plane to plane; `between.rs` interpolates
//!   samples of scalars half way between planes where kernels are wide. Each of `blending.rs`,
//!   `post.rs` and `project.rs` is a rule (`rule.rs`) for their samples: compositing of colours, classification along
//!   rays, projections of intensity. Of isosurfaces among classified voxels, rays find the surfaces by `post.rs` first,
//!   and `blending.rs` composites the voxels between them. `table.rs` is the transfer function as rays read it (by
//!   `transfer/bins.rs`), `lanes.rs` has sixteen rays in vectors.
//! - *Light.* `light.rs` lights samples, and `arriving.rs` finds the shares of light under shadows and occlusion, by
//!   `lighting/shadow.rs`: `sweep.rs` with `sweep/parallel.rs` (along directions), `converging.rs` (towards a place)
//!   and `buffer.rs`; `response.rs`, `field.rs` and `lanes.rs`; `around.rs` (occlusion); `exact.rs` (exact sums).
//!
//! The engine shares camera, kernel, transfer function, settings, the plans of shadows (`lighting/shadow/`) and the
//! classified voxels of `splats` (their words, bricks, and the classification of layers) with the device engine.
//!
//! # The same bytes
//!
//! Pictures have the same bytes on every machine, with any vectors and any number of threads. The order of all sums is
//! fixed, and IEEE 754 rounds sums, products, quotients and roots in one way. The crate `libm` computes exponentials,
//! logarithms and sines in Rust. Functions of std call the system's C library, whose last bit differs between machines,
//! so `.clippy.toml` disallows them; the reference and tests call them. Colour maps of `colorous` are tables and
//! polynomials, rounded to 8 bits.
//!
//! Loops over many voxels are types for `pulp`, such as `Band` in `lighting/shadow/sweep.rs`: they are compiled for
//! AVX2 too, and the machine decides as the program runs. Each row is the work of one thread
//! (docs/measurements/2026-11-26-wide-vectors.md).
//!
//! [`Shading::Post`]: crate::settings::Shading::Post
//! [`Shading::Pre`]: crate::settings::Shading::Pre

#![allow(
    clippy::needless_range_loop,
    reason = "loops over numbers are compiled for the vectors of the machine, and closures of iterators are not"
)]

mod arriving;
mod between;
mod blend;
mod blending;
mod colors;
mod field;
mod filter;
mod kept;
mod lanes;
mod lattice;
mod level;
mod light;
mod march;
mod plane;
mod post;
mod project;
mod rays;
mod rule;
mod scalars;
mod scene;
mod shot;
mod table;
mod voxels;

#[cfg(feature = "gpu")]
pub(crate) use self::arriving::BYTES as BYTES_OF_LIGHT;
#[cfg(feature = "gpu")]
pub(crate) use self::scalars::is_uniform;
#[cfg(feature = "gpu")]
pub(crate) use self::shot::{Needs, needs};

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use self::blending::Colors;
use self::level::Level;
use self::march::{Picture, RayMatter, TILE, Work};
use self::project::{Extreme, Projection};
use self::scalars::{Reconstructed, Scalars};
use self::scene::HostContent;
#[doc(hidden)]
pub use self::scene::HostScene;
use self::shot::{Depths, Shot};
use self::voxels::Colored;
use crate::camera::clip::Side;
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::image::{DepthMap, Image, Region};
use crate::kernel::Misfit;
use crate::layers::Layers;
use crate::lighting::shadow::Reusable;
use crate::lighting::shadow::passing::{LightPass, Way};
use crate::progress::Progress;
use crate::settings::{Interslice, Model, Settings};
use crate::stats::adapter::{AdapterInfo, AdapterKind};
use crate::stats::{CpuStats, PainterStats, Rendered, StageTime, Stats, on_host};
use crate::vectors::vector_level;

/// The renderer of the host engine.
#[derive(Debug, Clone)]
#[doc(hidden)]
pub struct HostRenderer {
    /// The callback for the progress of preparation and of pictures.
    progress: Progress,
    /// The reason why the host engine makes the pictures.
    reason: &'static str,
}

/// The memory and the voxels that a scene holds, for the statistics of a picture.
struct HeldMemory {
    bytes: u64,
    misfit: Misfit,
    /// Number of voxels that may be visible.
    voxels: u64,
}

impl HostRenderer {
    /// Makes a renderer that reports its progress.
    #[must_use]
    pub fn new(progress: &Progress) -> Self {
        Self::because(Self::REQUESTED, progress)
    }

    /// The reason of an engine that a user requested.
    pub(crate) const REQUESTED: &'static str = "requested";

    /// Makes a renderer with a reason, which statistics report.
    pub(crate) fn because(reason: &'static str, progress: &Progress) -> Self {
        Self { progress: progress.clone(), reason }
    }

    /// Returns the reason why this engine makes the pictures; `None` if it was requested.
    #[must_use]
    pub fn reason(&self) -> Option<&'static str> {
        Some(self.reason).filter(|reason| *reason != Self::REQUESTED)
    }

    /// Returns the processor as an adapter: its vectors and its threads.
    #[must_use]
    pub fn adapter() -> AdapterInfo {
        let threads = rayon::current_num_threads();
        AdapterInfo {
            name: "CPU".to_owned(),
            backend: "host".to_owned(),
            kind: AdapterKind::Cpu,
            driver: format!("{} vectors, {threads} threads", vector_level()),
        }
    }

    /// Prepares layers for pictures with these settings.
    ///
    /// # Errors
    /// [`Error::Setting`] if a setting is out of range, or if this engine does not draw such pictures;
    /// [`Error::Input`] and [`Error::Memory`] if samples cannot be read.
    pub fn prepare_layers(&self, layers: &Layers, settings: &Settings) -> Result<HostScene> {
        settings.validate()?;
        layers.check(settings)?;
        check_drawn(settings)?;
        if !settings.is_post_shaded() {
            let colored = Colored::new(layers, settings, &self.progress)?;
            return Ok(HostScene { content: HostContent::Colored(Box::new(colored)), part: None });
        }
        let Some((volume, transfer)) = layers.plain() else {
            return Err(refused("draws one volume alone if it classifies along rays: --shading pre"));
        };
        let scalars = Scalars::new(volume, transfer, settings, &self.progress)?;
        Ok(HostScene { content: HostContent::Scalars(Box::new(scalars)), part: None })
    }

    /// Renders a picture of a scene.
    ///
    /// # Errors
    /// [`Error::Setting`] if a setting is out of range, this engine does not draw such pictures, the scene was prepared
    /// for another shading, sharpness or light, the region is not in the picture, or surfaces have another size;
    /// [`Error::Camera`] if the camera is not finite; [`Error::TooLarge`] and [`Error::Memory`]; [`Error::Cancelled`].
    pub fn render(&self, scene: &HostScene, frame: &Frame<'_>) -> Result<Rendered> {
        frame.drawn(|region, solids| self.shot(scene, frame, region, Depths { solids, halves: false }))
    }

    /// Returns the depths at which rays have lost half of their light, exact to about a half of a voxel. Rays that keep
    /// more than half of their light have no depth. Matter behind the surfaces of the frame does not count.
    ///
    /// # Errors
    /// The errors of [`Self::render`], and [`Error::Setting`] if there are no depths ([`Settings::has_depths`]).
    pub fn depths(&self, scene: &HostScene, frame: &Frame<'_>) -> Result<DepthMap> {
        frame.settings.check_depths()?;
        frame.check()?;
        let depths = Depths { solids: frame.depths(), halves: true };
        let image = self.shot(scene, frame, frame.region, depths)?.image;
        let depth = |&[depth, has_depth, ..]: &[f32; 4]| if has_depth > 0.5 { depth } else { f32::INFINITY };
        DepthMap::new(image.width(), image.height(), image.pixels().iter().map(depth).collect())
    }

    /// Passes the light of a picture through some planes of a part of a lattice, on its way to other parts.
    ///
    /// # Errors
    /// The errors of [`Self::render`].
    pub(crate) fn pass(
        &self,
        scene: &HostScene,
        frame: &Frame<'_>,
        (way, own): (Way, &Range<i64>),
        light: &mut LightPass,
    ) -> Result<()> {
        let shot = Shot::new(frame, (scene.grid(), scene.part.as_ref()), frame.region, Depths::default())?;
        let mut reusable = Reusable::default();
        match &scene.content {
            HostContent::Scalars(scalars) => {
                let unit = scalars.transfer.unit_or(shot.grid.min_spacing());
                let Some(falling) = shot.falling(unit, true) else { return Ok(()) };
                // Visible matter is near by the field of the least kernel.
                let least = Shot { growths: shot.growths[..1].to_vec(), ..shot.clone() };
                let made = match shot.level {
                    Level(0) => scalars.reconstructed(&least, &self.progress)?,
                    _ => Vec::new(),
                };
                let near = made.first().map(|made| &made.field);
                scalars.casters(near, &falling).arrival(&falling, &mut reusable)?.pass(way, own, light)
            }
            HostContent::Colored(colored) => {
                let Some(falling) = shot.falling(colored.unit, false) else { return Ok(()) };
                colored.casters(None, &falling).arrival(&falling, &mut reusable)?.pass(way, own, light)
            }
        }
    }

    /// Renders the matter of a region of a picture, or its depths; of a part of a lattice, the values of the part.
    fn shot(&self, scene: &HostScene, frame: &Frame<'_>, region: Region, depths: Depths<'_>) -> Result<Rendered> {
        let Frame { camera, settings, .. } = *frame;
        let grid = scene.grid();
        camera.check_scale(grid)?;
        check_drawn(settings)?;
        let shot = Shot::new(frame, (grid, scene.part.as_ref()), region, depths)?;
        scene.check_memory(&shot)?;
        match (&scene.content, settings.is_post_shaded()) {
            (HostContent::Scalars(scalars), true) => self.render_scalars(scalars, &shot),
            (HostContent::Colored(colored), false) => self.render_colors(colored, &shot),
            _ => Err(Settings::not_prepared("shading", "for another shading or model")),
        }
    }

    /// Renders a picture of scalars that are classified along rays, or of their projection.
    fn render_scalars(&self, scene: &Scalars, shot: &Shot<'_>) -> Result<Rendered> {
        let Shot { settings, grid, .. } = *shot;
        let (reconstructed, seconds) = on_host(|| scene.reconstructed(shot, &self.progress));
        let reconstructed = reconstructed?;
        let mut stages = vec![StageTime::host("filter", seconds)];
        let Reconstructed { field, filter } = reconstructed[0].as_ref();
        let bytes = reconstructed.iter().map(|reconstructed| reconstructed.field.bytes()).sum();
        let unit = scene.transfer.unit_or(grid.min_spacing());
        let held = HeldMemory { bytes, misfit: filter.misfit(), voxels: grid.len() };
        if let Some(extreme) = extreme(settings.model) {
            let factor = scene.reduction.factor().recip();
            // Of a minimum, partial pictures have the value over the base of the mirrored transfer function.
            let of_mirrored = -scene.transfer.base() - scene.transfer.mirrored().base();
            let shown = |[value, second, ..]: [f64; 4]| match (extreme, shot.part) {
                (Extreme::Mean, _) if second <= 0.0 => [0.0; 4],
                _ if !value.is_finite() => [0.0; 4],
                (Extreme::Mean, None) => scene.transfer.projected(value / second * factor, None),
                (_, None) => scene.transfer.projected(value * factor, settings.depth_coded.then_some(second)),
                (Extreme::Mean, Some(_)) => [value * factor, second, 0.0, 1.0],
                (Extreme::Largest, Some(_)) => [value * factor, 1.0, second, 1.0],
                (Extreme::Smallest, Some(_)) => [of_mirrored - value * factor, 1.0, second, 1.0],
            };
            let attenuation = settings.attenuation as f32;
            let blend = shot.blend(&reconstructed, |reconstructed| &reconstructed.field);
            let matter = RayMatter::Projection(Projection { blend, extreme, depth: shot.depth_in_box(), attenuation });
            return self.painted(shot, (matter, unit), None, (stages, &held), Some(&shown));
        }
        let near = Some(field).filter(|_| shot.level == Level(0));
        let arriving = match shot.falling(unit, true) {
            None => None,
            Some(falling) => {
                let (light, seconds) = on_host(|| scene.arriving(near, falling, shot.incoming(), &self.progress));
                stages.push(StageTime::host("shadows", seconds));
                Some(light?)
            }
        };
        let matter = RayMatter::Post(scene.post(shot, &reconstructed, arriving.as_deref()));
        self.painted(shot, (matter, unit), None, (stages, &held), shot.part.map(|_| &emission as _))
    }

    /// Renders a picture of voxels that are classified before they are reconstructed.
    fn render_colors(&self, scene: &Colored, shot: &Shot<'_>) -> Result<Rendered> {
        let along_rays = shot.settings.along_rays();
        let of_surfaces = Shot { settings: &along_rays, ..shot.clone() };
        let (made, seconds) = on_host(|| {
            let surfaces = scene.surfaces.as_deref();
            let fields = surfaces.map(|surfaces| surfaces.reconstructed(&of_surfaces, &self.progress)).transpose()?;
            let near = fields.as_ref().map(|made| &made[0].field).filter(|_| shot.level == Level(0));
            let arriving = scene.arriving(shot, near, &self.progress)?;
            Ok::<_, Error>((scene.filtered(shot, arriving.as_deref(), &self.progress)?, surfaces.zip(fields), arriving))
        });
        let (filtered, surfaces, arriving) = made?;
        let stages = vec![StageTime::host("filter", seconds)];
        let blend = shot.blend(&filtered, |filtered| &filtered.field);
        let of_fields = surfaces.iter().flat_map(|(_, fields)| fields).map(|made| made.field.bytes());
        let bytes =
            filtered.iter().map(|filtered| filtered.field.bytes()).chain(of_fields).sum::<u64>() + scene.bytes();
        let surfaces = surfaces.as_ref();
        let surfaces = surfaces.map(|(scene, fields)| scene.post(&of_surfaces, fields, arriving.as_deref()));
        let held = HeldMemory { bytes, misfit: filtered[0].filter.misfit(), voxels: scene.count() };
        let is_xray = shot.settings.model == Model::Xray;
        let response = |[depth, ..]: [f64; 4]| match shot.part {
            None => shot.settings.response.pixel(depth),
            Some(_) => [0.0, 0.0, 0.0, depth],
        };
        let shown: Option<&Shown<'_>> = if is_xray { Some(&response) } else { shot.part.map(|_| &emission as _) };
        let matter = (RayMatter::Colors(Colors { blend, is_xray }), scene.unit * scene.scale / shot.density);
        let surfaces = surfaces.map(|post| (RayMatter::Post(post), of_surfaces.sides()));
        self.painted(shot, matter, surfaces, (stages, &held), shown)
    }

    /// Paints matter, and isosurfaces in it with their sides; `unit` is the world length of the unit of extinctions,
    /// and `shown` makes pixels of the results of rays.
    fn painted(
        &self,
        shot: &Shot<'_>,
        (matter, unit): (RayMatter<'_>, f64),
        surfaces: Option<(RayMatter<'_>, Vec<Side>)>,
        (mut stages, held): (Vec<StageTime>, &HeldMemory),
        shown: Option<&Shown<'_>>,
    ) -> Result<Rendered> {
        let Shot { camera, settings, grid, region, .. } = *shot;
        let (lattice, sides) = (&shot.lattice, shot.sides());
        let (surfaces, of_surfaces) = surfaces.unzip();
        let of_surfaces = of_surfaces.unwrap_or_default();
        let picture = Picture {
            matter,
            dims: lattice.dims().map(|d| d as usize),
            held: shot.held()?,
            owned: shot.owned(),
            camera,
            to_lattice: lattice.to_lattice(),
            unit,
            sides: &sides,
            termination: settings.termination as f32,
            solids: shot.depths.solids,
            halves: shot.depths.halves,
            surfaces: None,
        };
        let surfaces = surfaces.map(|matter| Picture { matter, sides: &of_surfaces, ..picture });
        let picture = Picture { surfaces: surfaces.as_ref(), ..picture };
        let mut image = Image::transparent(region.width, region.height)?;
        let (work, seconds) = on_host(|| self.paint(&picture, region, &mut image));
        let work = work?;
        if let Some(shown) = shown {
            let pixels = image.pixels_mut().par_iter_mut();
            pixels.for_each(|pixel| *pixel = shown(pixel.map(f64::from)).map(|channel| channel as f32));
        }
        stages.push(StageTime::host("frame", seconds));
        let noise = (settings.sharpness > 0.0).then(|| settings.reconstruction()).transpose()?;
        let Misfit { data, noise: of_noise } = held.misfit;
        Ok(Rendered {
            image,
            stats: Stats {
                painter: PainterStats::Cpu(CpuStats {
                    samples: work.samples,
                    slabs: work.slabs,
                    field_bytes: held.bytes,
                    misfit: [data, of_noise],
                }),
                painter_reason: self.reason.to_owned(),
                model: settings.model,
                shading: settings.shading,
                perspective: camera.eye().is_some(),
                lights: settings.light_count(),
                clip: settings.clip.clone(),
                size: camera.size,
                pixels_covered: region.area(),
                parts: 1,
                voxels: grid.len(),
                splats_kept: held.voxels,
                kernel_growth: shot.growths[shot.growths.len() - 1],
                levels: [shot.level.0 as f32; 2],
                sharpness: settings.sharpness,
                noise: noise.map(|reconstruction| reconstruction.noise()),
                footprint_error: data,
                scene_bytes: held.bytes,
                stages,
                ..Stats::of_host(Self::adapter())
            },
        })
    }

    /// Paints the tiles of the whole picture that a region reaches.
    fn paint(&self, picture: &Picture<'_>, region: Region, image: &mut Image) -> Result<Work> {
        let Region { x, y, width, height } = region;
        let [left, top] = [x, y].map(|place| place as usize / TILE);
        let right = ((x + width) as usize).div_ceil(TILE);
        let rows = (height as usize + y as usize % TILE).div_ceil(TILE);
        let width = width as usize;
        // The pixels of the image in each row of tiles.
        let mut bands: Vec<(usize, &mut [[f32; 4]])> = Vec::with_capacity(rows);
        let mut pixels = image.pixels_mut();
        for row in 0..rows {
            let first = ((top + row) * TILE).max(y as usize);
            let last = ((top + row + 1) * TILE).min((y + height) as usize);
            let (band, rest) = std::mem::take(&mut pixels).split_at_mut((last - first) * width);
            bands.push((row, band));
            pixels = rest;
        }
        let done = Mutex::new(0_usize);
        let paint = |(row, band): (usize, &mut [[f32; 4]])| -> Result<Work> {
            self.progress.check()?;
            let tiles = (left..right).into_par_iter().map(|column| {
                let mut pixels = vec![[0.0; 4]; TILE * TILE];
                let work = picture.tile([column * TILE, (top + row) * TILE], TILE, &mut pixels);
                (column, pixels, work)
            });
            let tiles: Vec<_> = tiles.collect();
            let first = ((top + row) * TILE).max(y as usize) - (top + row) * TILE;
            let mut work = Work::default();
            for (column, tile, of_tile) in tiles {
                work = work.and(of_tile);
                let start = (column * TILE).max(x as usize);
                let end = ((column + 1) * TILE).min(x as usize + width);
                for (line, out) in band.chunks_exact_mut(width).enumerate() {
                    let from = (first + line) * TILE + start - column * TILE;
                    out[start - x as usize..end - x as usize].copy_from_slice(&tile[from..from + end - start]);
                }
            }
            let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
            *done += 1;
            self.progress.report("rendering", *done as f64 / rows as f64);
            Ok(work)
        };
        bands.into_par_iter().map(paint).try_reduce(Work::default, |a, b| Ok(a.and(b)))
    }
}

/// A callback that makes a pixel of the result of a ray.
type Shown<'a> = dyn Fn([f64; 4]) -> [f64; 4] + Sync + 'a;

/// Returns the emission and the optical depth of a pixel with an alpha.
fn emission([r, g, b, alpha]: [f64; 4]) -> [f64; 4] {
    // Alphas are f32: the largest below 1 has a depth of 16.6.
    [r, g, b, -libm::log1p(-alpha.min(1.0 - f64::from(f32::EPSILON) / 2.0))]
}

/// Returns the scalar that pixels of a projection of intensity show; `None` for other models.
fn extreme(model: Model) -> Option<Extreme> {
    match model {
        Model::Mip => Some(Extreme::Largest),
        Model::Minip => Some(Extreme::Smallest),
        Model::Average => Some(Extreme::Mean),
        Model::Composite | Model::Xray => None,
    }
}

/// Refuses settings of pictures that this engine does not draw.
pub(crate) fn check_drawn(settings: &Settings) -> Result<()> {
    if settings.is_post_shaded() && settings.interslice == Interslice::Mean {
        return Err(refused("classifies between samples: leave out interslice=mean"));
    }
    Ok(())
}

/// Returns an error about a picture that this engine does not draw.
fn refused(reason: &str) -> Error {
    Error::setting("painter", format!("cpu {reason}"))
}
