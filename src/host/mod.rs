//! The host engine: rays through fields of B-splines on the processor, without a graphics driver.
//!
//! The field that kernels reconstruct is represented by cubic B-splines (`kernel/spline.rs`): a filter of the samples
//! depends on the kernel alone, and a sample of the field then takes 64 coefficients, whatever the kernel, the view and
//! the projection. [`HostRenderer`] draws composites and projections of scalars ([`Shading::Post`]), and composites and
//! X-rays of classified voxels ([`Shading::Pre`]), which may have several layers. Where voxels are smaller than pixels,
//! kernels grow: of perspective pictures the fields of some sizes are blended. [`Settings::painter`] has no effect;
//! `voxsplat render --painter cpu` requests this engine.
//!
//! Pictures have the same bytes with any vectors and any number of threads: along rays the order of all sums is fixed,
//! and numbers are added, multiplied, divided and rooted only. Cameras, kernels and tables of transfer functions still
//! call exponentials and sines of the system's C library, whose last bit may differ between machines.
//!
//! [`Shading::Post`]: crate::settings::Shading::Post
//! [`Shading::Pre`]: crate::settings::Shading::Pre

#![allow(
    clippy::needless_range_loop,
    reason = "loops over numbers are compiled for the vectors of the machine, and closures of iterators are not"
)]

mod arriving;
mod blend;
mod blending;
mod colors;
mod field;
mod filter;
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
mod table;
mod voxels;

use std::sync::{Arc, Mutex, PoisonError};

use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use self::arriving::Falling;
use self::blend::Blend;
use self::blending::Colors;
use self::colors::Halves;
use self::level::Level;
use self::light::Shader;
use self::march::{Matter, Picture, TILE, Work};
use self::post::Post;
use self::project::{Extreme, Projection};
use self::scalars::{Reconstructed, Scalars};
use self::voxels::Colored;
use crate::camera::{Camera, Growth};
use crate::error::{Error, Result};
use crate::image::{DepthMap, Image, Region};
use crate::kernel::{Kernel, Misfit};
use crate::layers::Layers;
use crate::lighting::shadow::ShadowLattice;
use crate::progress::Progress;
use crate::settings::{Interslice, Level as Cells, Model, Settings};
use crate::solids::Solids;
use crate::stats::adapter::{AdapterInfo, AdapterKind};
use crate::stats::{CpuStats, PainterStats, Rendered, StageTime, Stats, on_host};
use crate::transfer::Resolution;
use crate::volume::Grid;
use voxsplat_volume::memory::available;

/// The largest growth of kernels of perspective pictures: growth by the last rounding does not count.
const NO_GROWTH: f64 = 1.0 + 1e-9;

/// The renderer of the host engine.
#[derive(Debug, Clone)]
pub struct HostRenderer {
    /// Called with the progress of preparation and of pictures.
    progress: Progress,
    /// Why this engine makes the pictures.
    reason: &'static str,
}

/// What a [`HostRenderer`] has prepared.
pub struct HostScene(Content);

enum Content {
    /// Scalars that are classified along rays.
    Scalars(Box<Scalars>),
    /// Voxels that are classified before they are reconstructed.
    Colored(Box<Colored>),
}

/// What a picture is made with.
struct Frame<'a> {
    camera: &'a Camera,
    settings: &'a Settings,
    grid: &'a Grid,
    region: Region,
    /// The growths of the kernels whose fields are blended, ascending.
    growths: Vec<f64>,
    /// The level of these fields, and the lattice of its cells.
    level: Level,
    lattice: Grid,
    /// The kernel without growth.
    kernel: Kernel,
    /// The ratio of the sums of kernels to their means.
    density: f64,
    depths: Depths<'a>,
}

/// The depths that a picture reads and writes.
#[derive(Debug, Clone, Copy, Default)]
struct Depths<'a> {
    /// See [`Picture::solids`].
    solids: Option<&'a DepthMap>,
    /// See [`Picture::halves`].
    halves: bool,
}

impl Frame<'_> {
    /// The kernels whose fields are blended.
    fn kernels(&self) -> Vec<Kernel> {
        self.growths.iter().map(|growth| self.level.kernel(&self.kernel, *growth)).collect()
    }

    /// The blend of the fields of these kernels.
    fn blend<'a, V, F>(&self, made: &'a [Arc<V>], field: impl Fn(&'a V) -> &'a F) -> Blend<'a, F> {
        let Self { camera, grid, .. } = *self;
        let levels = self.growths.iter().zip(made).map(|(growth, made)| (*growth, field(made))).collect();
        Blend::new(levels, camera.growth(grid), camera, &self.lattice.to_world())
    }

    /// The size of cells in voxels, and the voxel at cell 0 along each axis.
    fn to_voxels(&self) -> [f32; 2] {
        let first = self.grid.to_lattice().transform_point3(self.lattice.to_world().translation);
        [self.level.size() as f32, first.x as f32]
    }

    /// See [`Picture::sides`].
    fn sides(&self) -> Vec<(DVec3, f64)> {
        let Self { settings, grid, level, lattice, .. } = self;
        let middle = DVec3::from_array(grid.dims().map(|d| (f64::from(d) - 1.0) / 2.0));
        let to_voxels = grid.to_lattice() * lattice.to_world();
        let side = |(gradient, value): (DVec3, f64)| {
            (to_voxels.matrix3.transpose() * gradient, value + gradient.dot(to_voxels.translation - middle))
        };
        let mut sides: Vec<(DVec3, f64)> = settings.clip.sides(grid).into_iter().map(side).collect();
        // Cells reach beyond the volume, where scalars end.
        if settings.is_post_shaded() && *level != Level(0) {
            sides.extend((0..3).flat_map(|axis| {
                let voxels = f64::from(grid.dims()[axis]);
                let faces = [(1.0, 0.5 + middle[axis]), (-1.0, voxels - 0.5 - middle[axis])];
                faces.map(|(sign, value)| side((sign * DVec3::AXES[axis], value)))
            }));
        }
        sides
    }

    /// See [`Projection::depth`].
    fn depth_in_box(&self) -> (DVec3, f64) {
        let Self { camera, grid, lattice, .. } = self;
        let in_voxels = grid.to_world().matrix3.transpose() * camera.forward;
        let dims = DVec3::from_array(grid.dims().map(f64::from));
        let gradient = in_voxels / in_voxels.abs().dot(dims);
        let to_voxels = grid.to_lattice() * lattice.to_world();
        let at_zero = 0.5 + gradient.dot(to_voxels.translation - (dims - 1.0) / 2.0);
        (to_voxels.matrix3.transpose() * gradient, at_zero)
    }

    /// The light with shadows, if there is one, in matter whose extinctions have a unit in the world.
    fn falling(&self, unit: f64) -> Option<Falling> {
        let Self { settings, grid, kernel, .. } = *self;
        let casting = settings.casting()?;
        let lattice = ShadowLattice::new(grid, kernel, settings.normalization.divisor(&kernel), unit, 1.0);
        Some(Falling { casting, lattice, clip: settings.clip.sides(grid) })
    }
}

/// What a scene holds for a picture.
struct Held {
    bytes: u64,
    misfit: Misfit,
    /// Voxels that may show.
    voxels: u64,
}

/// The map from the points of a lattice of cells to the places of a [`Shader`] of a volume.
fn places_of_light(grid: &Grid, lattice: &Grid) -> DAffine3 {
    let to_places = DAffine3::from_scale(DVec3::splat(1.0 / grid.unit()));
    to_places * DAffine3::from_translation(-grid.center()) * lattice.to_world()
}

/// The values that were made for the last picture, and what they were made for.
struct Kept<K, V>(Mutex<Vec<(K, Arc<V>)>>);

impl<K, V> Default for Kept<K, V> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<K: PartialEq, V> Kept<K, V> {
    /// The values for keys: those that are held, else those that `make` makes after all others are gone.
    fn get_or_make(&self, keys: Vec<K>, make: impl Fn(&K) -> Result<V>) -> Result<Vec<Arc<V>>> {
        let mut held = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        held.retain(|(key, _)| keys.contains(key));
        let mut values = Vec::with_capacity(keys.len());
        for key in keys {
            let value = match held.iter().find(|(of, _)| *of == key) {
                Some((_, value)) => Arc::clone(value),
                None => {
                    let made = Arc::new(make(&key)?);
                    held.push((key, Arc::clone(&made)));
                    made
                }
            };
            values.push(value);
        }
        Ok(values)
    }

    /// The sum of a number of each value.
    fn sum(&self, number: impl Fn(&V) -> u64) -> u64 {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).iter().map(|(_, value)| number(value)).sum()
    }

    /// The number of values.
    fn count(&self) -> usize {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).len()
    }
}

impl HostRenderer {
    /// Makes a renderer that reports its progress.
    #[must_use]
    pub fn new(progress: &Progress) -> Self {
        Self::because(Self::REQUESTED, progress)
    }

    /// The reason for this engine if a user asks for it.
    pub(crate) const REQUESTED: &'static str = "requested";

    /// Makes a renderer for a reason that statistics tell.
    pub(crate) fn because(reason: &'static str, progress: &Progress) -> Self {
        Self { progress: progress.clone(), reason }
    }

    /// Why this engine makes the pictures; `None` if it was requested.
    #[must_use]
    pub fn reason(&self) -> Option<&'static str> {
        Some(self.reason).filter(|reason| *reason != Self::REQUESTED)
    }

    /// The processor as an adapter: its vectors and its threads.
    #[must_use]
    pub fn adapter() -> AdapterInfo {
        let threads = rayon::current_num_threads();
        AdapterInfo {
            name: "CPU".to_owned(),
            backend: "host".to_owned(),
            kind: AdapterKind::Cpu,
            driver: format!("{} vectors, {threads} threads", lanes::vector_level()),
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
            return Ok(HostScene(Content::Colored(Box::new(colored))));
        }
        let Some((volume, transfer)) = layers.plain() else {
            return Err(refused("draws one volume alone if it classifies along rays: --shading pre"));
        };
        let scalars = Scalars::new(volume, transfer, settings, &self.progress)?;
        Ok(HostScene(Content::Scalars(Box::new(scalars))))
    }

    /// Renders a picture of a scene.
    ///
    /// # Errors
    /// The errors of [`Self::render_region`].
    pub fn render(&self, scene: &HostScene, camera: &Camera, settings: &Settings) -> Result<Rendered> {
        let [width, height] = camera.size;
        self.render_region(scene, camera, settings, Region { x: 0, y: 0, width, height })
    }

    /// Renders a part of the picture that [`Self::render`] makes: the same bytes, without the rest. The image has the
    /// size of the region.
    ///
    /// # Errors
    /// [`Error::Setting`] if a setting is out of range, this engine does not draw such pictures, the scene was prepared
    /// for another shading, sharpness or light, or the region has no pixels or reaches beyond the picture;
    /// [`Error::Camera`] if the camera is not finite; [`Error::TooLarge`] and [`Error::Memory`]; [`Error::Cancelled`].
    pub fn render_region(
        &self,
        scene: &HostScene,
        camera: &Camera,
        settings: &Settings,
        region: Region,
    ) -> Result<Rendered> {
        self.shot(scene, camera, settings, region, Depths::default())
    }

    /// Renders a part of a picture without the matter behind solids: each ray ends, exactly, at the depth of its pixel.
    /// [`Image::over`] lays the picture over a picture of the solids. `solids` has the size of the whole picture.
    ///
    /// # Errors
    /// Like [`Self::render_region`], and [`Error::Setting`] if the sizes differ.
    pub fn render_before(
        &self,
        scene: &HostScene,
        camera: &Camera,
        settings: &Settings,
        region: Region,
        solids: &DepthMap,
    ) -> Result<Rendered> {
        self.shot(scene, camera, settings, region, Depths { solids: Some(solids), halves: false })
    }

    /// Renders a part of a picture with opaque surfaces in it: the matter before them, and behind it the surfaces.
    /// Surfaces without colours only hide matter. `solids` has the size of the whole picture. Pixels without a surface
    /// are the ones of [`Self::render_region`].
    ///
    /// # Errors
    /// Like [`Self::render_before`].
    pub fn render_with_solids(
        &self,
        scene: &HostScene,
        camera: &Camera,
        settings: &Settings,
        region: Region,
        solids: &Solids,
    ) -> Result<Rendered> {
        solids.in_picture(
            camera,
            region,
            |reached| self.render_before(scene, camera, settings, reached, &solids.depths),
            || self.render_region(scene, camera, settings, region),
        )
    }

    /// Returns the depths of a part of a picture at which rays have lost half of their light, exact to about a half of
    /// a voxel. Rays that keep more than half of their light have no depth. Matter behind `solids` does not count.
    ///
    /// # Errors
    /// Like [`Self::render_before`], and [`Error::Setting`] if there are none ([`Settings::has_depths`]).
    pub fn depths(
        &self,
        scene: &HostScene,
        camera: &Camera,
        settings: &Settings,
        region: Region,
        solids: Option<&DepthMap>,
    ) -> Result<DepthMap> {
        settings.check_depths()?;
        let image = self.shot(scene, camera, settings, region, Depths { solids, halves: true })?.image;
        let depth = |&[depth, has_depth, ..]: &[f32; 4]| if has_depth > 0.5 { depth } else { f32::INFINITY };
        DepthMap::new(region.width, region.height, image.pixels().iter().map(depth).collect())
    }

    /// Renders a part of a picture, or its depths.
    fn shot(
        &self,
        scene: &HostScene,
        camera: &Camera,
        settings: &Settings,
        region: Region,
        depths: Depths<'_>,
    ) -> Result<Rendered> {
        camera.validate()?;
        settings.validate()?;
        region.check_within(camera.size)?;
        depths.solids.map_or(Ok(()), |solids| solids.check(camera))?;
        let grid = scene.grid();
        camera.check_scale(grid)?;
        check_drawn(settings)?;
        let kernel = settings.reconstruction_kernel();
        let (growths, level) = growths(camera, grid, settings, &kernel);
        let frame = Frame {
            camera,
            settings,
            grid,
            region,
            growths,
            level,
            lattice: level.grid(grid)?,
            kernel,
            density: settings.normalization.density(&kernel),
            depths,
        };
        scene.check_memory(&frame)?;
        match (&scene.0, settings.is_post_shaded()) {
            (Content::Scalars(scalars), true) => self.render_scalars(scalars, &frame),
            (Content::Colored(colored), false) => self.render_colors(colored, &frame),
            _ => Err(Settings::not_prepared("shading", "for another shading or model")),
        }
    }

    /// Renders a picture of scalars that are classified along rays, or of their projection.
    fn render_scalars(&self, scene: &Scalars, frame: &Frame<'_>) -> Result<Rendered> {
        let Frame { settings, grid, .. } = *frame;
        if settings.sharpens() != scene.sharpened {
            return Err(Settings::not_prepared("sharpness", "for another sharpness or kernel"));
        }
        let (reconstructed, seconds) = on_host(|| scene.reconstructed(frame, &self.progress));
        let reconstructed = reconstructed?;
        let mut stages = vec![StageTime::host("filter", seconds)];
        let Reconstructed { field, filter } = reconstructed[0].as_ref();
        let blend = frame.blend(&reconstructed, |reconstructed| &reconstructed.field);
        let bytes = reconstructed.iter().map(|reconstructed| reconstructed.field.bytes()).sum();
        let unit = scene.transfer.unit_or(grid.min_spacing());
        let held = Held { bytes, misfit: filter.misfit(), voxels: grid.len() };
        if let Some(extreme) = extreme(settings.model) {
            let factor = frame.density / scene.reduction.factor();
            let shown = |[value, second, ..]: [f64; 4]| {
                let value = if extreme == Extreme::Mean { value / second } else { value };
                let depth = settings.depth_coded.then_some(second);
                if value.is_finite() { scene.transfer.projected(value * factor, depth) } else { [0.0; 4] }
            };
            let attenuation = settings.attenuation as f32;
            let matter = Matter::Projection(Projection { blend, extreme, depth: frame.depth_in_box(), attenuation });
            return self.painted(frame, (matter, unit), stages, &held, Some(&shown));
        }
        // Of a jump, splines leave a slope in uniform matter beside it: no surface.
        let of_misfit = if scene.is_uniform { 2.0 * filter.misfit().data } else { 0.0 };
        let of_distance = of_misfit.max(Resolution::OF_DISTANCE) as f32;
        let resolution = [of_distance, scene.reduction.faintest(&scene.resolution)];
        let shader = settings.lighting.as_ref();
        let shader = shader.map(|lighting| Shader::new(lighting, grid.center(), grid.unit(), resolution));
        let gradient_opacity = scene.transfer.scaled_gradient_opacity(scene.reduction.factor());
        let near = Some(field).filter(|_| frame.level == Level(0));
        let arriving = match frame.falling(unit) {
            None => None,
            Some(falling) => {
                let (light, seconds) = on_host(|| scene.arriving(near, &gradient_opacity, falling, &self.progress));
                stages.push(StageTime::host("shadows", seconds));
                Some(light?)
            }
        };
        let matter = Matter::Post(Post {
            blend,
            table: &scene.table,
            shader: shader.as_ref(),
            arriving: arriving.as_deref(),
            gradient_opacity: &gradient_opacity,
            to_places: places_of_light(grid, &frame.lattice),
            to_voxels: frame.to_voxels(),
        });
        self.painted(frame, (matter, unit), stages, &held, None)
    }

    /// Renders a picture of voxels that are classified before they are reconstructed.
    fn render_colors(&self, scene: &Colored, frame: &Frame<'_>) -> Result<Rendered> {
        let (filtered, seconds) = on_host(|| scene.filtered(frame, &self.progress));
        let filtered = filtered?;
        let stages = vec![StageTime::host("filter", seconds)];
        let blend = frame.blend(&filtered, |filtered| &filtered.field);
        let bytes = filtered.iter().map(|filtered| filtered.field.bytes()).sum::<u64>() + scene.bytes();
        let held = Held { bytes, misfit: filtered[0].filter.misfit(), voxels: scene.count() };
        let is_xray = frame.settings.model == Model::Xray;
        let response = |[depth, ..]: [f64; 4]| frame.settings.response.pixel(depth);
        let matter = (Matter::Colors(Colors { blend, is_xray }), scene.unit * scene.scale);
        self.painted(frame, matter, stages, &held, is_xray.then_some(&response))
    }

    /// Paints matter, whose extinctions have a unit in the world; `shown` makes pixels of what rays return.
    fn painted(
        &self,
        frame: &Frame<'_>,
        (matter, unit): (Matter<'_>, f64),
        mut stages: Vec<StageTime>,
        held: &Held,
        shown: Option<&(dyn Fn([f64; 4]) -> [f64; 4] + Sync)>,
    ) -> Result<Rendered> {
        let Frame { camera, settings, grid, region, density, .. } = *frame;
        let (lattice, sides) = (&frame.lattice, frame.sides());
        let picture = Picture {
            matter,
            dims: lattice.dims().map(|d| d as usize),
            camera,
            to_lattice: lattice.to_lattice(),
            unit: unit / density,
            sides: &sides,
            termination: settings.termination as f32,
            solids: frame.depths.solids,
            halves: frame.depths.halves,
        };
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
                kernel_growth: frame.growths[frame.growths.len() - 1],
                levels: [frame.level.0 as f32; 2],
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

/// The scalar that pixels of a model show, if it is a projection of intensity.
fn extreme(model: Model) -> Option<Extreme> {
    match model {
        Model::Mip => Some(Extreme::Largest),
        Model::Minip => Some(Extreme::Smallest),
        Model::Average => Some(Extreme::Mean),
        Model::Composite | Model::Xray => None,
    }
}

impl HostScene {
    /// The lattice of the samples.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        match &self.0 {
            Content::Scalars(scalars) => scalars.volume.grid(),
            Content::Colored(colored) => colored.grid(),
        }
    }

    /// Refuses a picture that needs more memory than is left, before any is allocated. What the scene holds counts as
    /// left.
    fn check_memory(&self, frame: &Frame<'_>) -> Result<()> {
        let kernels = frame.kernels();
        let count = field::count(frame.lattice.dims(), field::padding(&kernels)) * kernels.len() as u64;
        let light = |lights: usize| lights as u64 * arriving::BYTES * self.grid().len();
        let (fields, held) = match &self.0 {
            Content::Scalars(scalars) => {
                let held = scalars.field.sum(|made| made.field.bytes()) + light(scalars.light.count());
                (count * size_of::<f32>() as u64, held)
            }
            Content::Colored(colored) => {
                let held = colored.field.sum(|made| made.field.bytes()) + light(colored.light.count());
                (count * size_of::<Halves>() as u64, held)
            }
        };
        check_memory(fields, light(usize::from(frame.settings.casting().is_some())), held)
    }
}

/// Refuses settings of pictures that this engine does not draw.
fn check_drawn(settings: &Settings) -> Result<()> {
    if settings.is_post_shaded() && settings.interslice == Interslice::Mean {
        return Err(refused("classifies between samples: leave out interslice=mean"));
    }
    Ok(())
}

/// Refuses a field and a light that need more memory than is left and than is held for them.
fn check_memory(field: u64, light: u64, held: u64) -> Result<()> {
    let Some(available) = available() else { return Ok(()) };
    if field + light <= available.bytes + held {
        return Ok(());
    }
    let mut remedies = Vec::new();
    if field <= available.bytes + held {
        remedies.push("--light off".to_owned());
    }
    remedies.push("--painter tiles".to_owned());
    Err(Error::TooLarge { bytes: field + light, available: available.bytes, limit: available.limit, remedies })
}

/// The growths of the kernels whose fields a picture needs, and the level of the lattice that they are made on.
fn growths(camera: &Camera, grid: &Grid, settings: &Settings, kernel: &Kernel) -> (Vec<f64>, Level) {
    let growth = if settings.antialiasing { camera.growth(grid) } else { Growth::NONE };
    let depths = camera.eye().map_or([0.0; 2], |eye| {
        let to_center = (grid.center() - eye).dot(camera.forward);
        let depths = grid.corners_from_center(0.5).map(|corner| to_center + corner.dot(camera.forward));
        [depths.into_iter().fold(f64::INFINITY, f64::min).max(0.0), depths.into_iter().fold(0.0, f64::max)]
    });
    let requested = if let Cells::At(level) = settings.level { Some(level) } else { None };
    let least = requested.map_or(0.0, |level| Level(level).least());
    let [smallest, largest] = depths.map(|depth| growth.at(depth).max(least));
    let level = Level::new(kernel, smallest, requested);
    if camera.eye().is_none() || largest <= NO_GROWTH {
        return (vec![largest], level);
    }
    (blend::levels(smallest, largest, level.most(kernel)), level)
}

/// An error about a picture that this engine does not draw.
fn refused(reason: &str) -> Error {
    Error::setting("painter", format!("cpu {reason}"))
}
