//! The host engine: rays through fields of B-splines on the processor, without a graphics driver.
//!
//! [`HostRenderer`] draws post-shaded composites of a volume. The field that the kernels reconstruct is represented by
//! cubic B-splines (`kernel/spline.rs`): a filter of the samples depends on the kernel alone, and a sample of the field
//! then takes 64 coefficients, whatever the kernel, the view and the projection. [`Settings::painter`] has no effect
//! here; `voxsplat render --painter cpu` requests this engine.
//!
//! Pictures have the same bytes with any vectors and any number of threads: along rays the order of all sums is fixed,
//! and numbers are added, multiplied, divided and rooted only. Cameras, kernels and tables of transfer functions still
//! call exponentials and sines of the system's C library, whose last bit may differ between machines.

#![allow(
    clippy::needless_range_loop,
    reason = "loops over numbers are compiled for the vectors of the machine, and closures of iterators are not"
)]

mod arriving;
mod colors;
mod field;
mod lanes;
mod light;
mod march;
mod plane;
mod post;
mod project;
mod rays;
mod table;

use std::sync::{Arc, Mutex, PoisonError};

use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use self::arriving::{ArrivingLight, Falling, MAX_VOXELS, Matter};
use self::field::Field;
use self::light::Shader;
use self::march::{Matter as Found, Picture, TILE, Work};
use self::post::Post;
use self::project::{Extreme, Projection};
use self::table::Table;
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::image::{Image, Region};
use crate::kernel::{Kernel, SplineFilter};
use crate::layers::Layers;
use crate::lighting::shadow::ShadowLattice;
use crate::progress::Progress;
use crate::settings::{Interslice, Model, Settings, Shading};
use crate::stats::adapter::{AdapterInfo, AdapterKind};
use crate::stats::{CpuStats, PainterStats, Rendered, StageTime, Stats, on_host};
use crate::transfer::scalars::{Reduction, Relative};
use crate::transfer::{Resolution, TransferFunction};
use crate::volume::{Grid, Volume};
use voxsplat_volume::memory::available;

/// The largest growth of kernels of perspective pictures: growth by the last rounding does not count.
const NO_GROWTH: f64 = 1.0 + 1e-9;

/// The renderer of the host engine.
#[derive(Debug, Clone, Default)]
pub struct HostRenderer {
    /// Called with the progress of preparation and of pictures.
    progress: Progress,
}

/// A volume that a [`HostRenderer`] has prepared.
pub struct HostScene {
    /// The samples, filtered if the picture is sharpened.
    volume: Volume,
    transfer: TransferFunction,
    reduction: Reduction,
    resolution: Resolution,
    table: Table,
    sharpened: Option<(Kernel, f64)>,
    /// Whether most of the visible matter is uniform, as of a mask.
    is_uniform: bool,
    /// The field of the last kernel.
    field: Mutex<Option<(Kernel, Arc<Reconstructed>)>>,
    /// The last light with shadows.
    light: Mutex<Option<(Falling, Arc<ArrivingLight>)>>,
}

/// The field of a kernel.
struct Reconstructed {
    field: Field,
    filter: SplineFilter,
}

impl HostRenderer {
    /// Makes a renderer that reports its progress.
    #[must_use]
    pub fn new(progress: &Progress) -> Self {
        Self { progress: progress.clone() }
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

    /// Prepares layers for pictures with these settings: one volume.
    ///
    /// # Errors
    /// [`Error::Setting`] if a setting is out of range, or if this engine does not draw such pictures;
    /// [`Error::Input`] and [`Error::Memory`] if samples cannot be read.
    pub fn prepare_layers(&self, layers: &Layers, settings: &Settings) -> Result<HostScene> {
        settings.validate()?;
        let Some((volume, transfer)) = layers.plain() else { return Err(refused("draws one volume alone")) };
        if extreme(settings.model).is_none()
            && (settings.model != Model::Composite || settings.shading != Shading::Post)
        {
            return Err(refused("draws post-shaded composites and projections: --shading post"));
        }
        if settings.depth_coded || settings.attenuation != 0.0 {
            return Err(refused("codes no depths: leave out --depth-colours and --attenuation"));
        }
        if settings.interslice == Interslice::Mean {
            return Err(refused("classifies between samples: leave out interslice=mean"));
        }
        if settings.casting().is_some() && volume.grid().len() > MAX_VOXELS {
            return Err(refused(
                "casts shadows in up to 2^27 voxels: --light headlight, or --shadows off --occlusion off",
            ));
        }
        volume.check_finite()?;
        let is_uniform = is_uniform(volume, transfer)?;
        let filtered = settings.prefilter()?;
        let filtered =
            filtered.map(|filter| filter.apply::<f32>(volume, transfer.base(), &self.progress)).transpose()?;
        let volume = filtered.unwrap_or_else(|| volume.clone());
        let reduction = Reduction::new(transfer, volume.farthest_from(transfer.base())?);
        Ok(HostScene {
            table: Table::new(transfer, &reduction),
            resolution: Resolution::new(transfer, &volume)?,
            transfer: transfer.clone(),
            reduction,
            sharpened: settings.sharpens(),
            is_uniform,
            volume,
            field: Mutex::default(),
            light: Mutex::default(),
        })
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
    /// [`Error::Setting`] if a setting is out of range, the scene was prepared for another sharpness, kernels reach too
    /// far, or the region has no pixels or reaches beyond the picture; [`Error::Camera`] if the camera is not finite;
    /// [`Error::TooLarge`] and [`Error::Memory`]; [`Error::Cancelled`].
    pub fn render_region(
        &self,
        scene: &HostScene,
        camera: &Camera,
        settings: &Settings,
        region: Region,
    ) -> Result<Rendered> {
        camera.validate()?;
        settings.validate()?;
        region.check_within(camera.size)?;
        let grid = scene.volume.grid();
        camera.check_scale(grid)?;
        if settings.sharpens() != scene.sharpened {
            return Err(Error::setting("sharpness", "the scene was prepared for another sharpness or kernel"));
        }
        scene.check_memory(settings)?;
        let (growth, mut stages) = (growth(camera, grid, settings)?, Vec::new());
        let kernel = settings.reconstruction_kernel().grown(growth);
        let (reconstructed, seconds) = on_host(|| scene.reconstructed(kernel, &self.progress));
        let reconstructed = reconstructed?;
        stages.push(StageTime::host("filter", seconds));
        let Reconstructed { field, filter } = reconstructed.as_ref();
        let unit = scene.transfer.unit_or(grid.min_spacing());
        // Of a jump, splines leave a slope in uniform matter beside it: no surface.
        let of_misfit = if scene.is_uniform { 2.0 * filter.misfit().data } else { 0.0 };
        let of_distance = of_misfit.max(Resolution::OF_DISTANCE) as f32;
        let resolution = [of_distance, scene.reduction.faintest(&scene.resolution)];
        let shader = settings.lighting.as_ref();
        let shader = shader.map(|lighting| Shader::new(lighting, grid.center(), grid.unit(), resolution));
        let middle = DVec3::from_array(grid.dims().map(|d| (f64::from(d) - 1.0) / 2.0));
        let sides: Vec<(DVec3, f64)> = settings
            .clip
            .sides(grid)
            .into_iter()
            .map(|(gradient, value)| (gradient, value - gradient.dot(middle)))
            .collect();
        let gradient_opacity = scene.transfer.scaled_gradient_opacity(scene.reduction.factor());
        let arriving = match settings.casting() {
            None => None,
            Some(casting) => {
                let divisor = settings.normalization.divisor(&kernel);
                let lattice = ShadowLattice::new(grid, kernel, divisor, unit, 1.0);
                let falling = Falling { casting, lattice, clip: settings.clip.sides(grid) };
                let (light, seconds) = on_host(|| scene.arriving(field, &gradient_opacity, falling, &self.progress));
                stages.push(StageTime::host("shadows", seconds));
                Some(light?)
            }
        };
        let density = settings.normalization.density(&kernel);
        let to_world = grid.to_world();
        let matter = match extreme(settings.model) {
            Some(extreme) => Found::Projection(Projection { field, extreme }),
            None => Found::Post(Post {
                field,
                table: &scene.table,
                shader: shader.as_ref(),
                arriving: arriving.as_deref(),
                gradient_opacity: &gradient_opacity,
                to_places: DAffine3::from_scale(DVec3::splat(1.0 / grid.unit()))
                    * DAffine3::from_translation(-grid.center())
                    * to_world,
            }),
        };
        let picture = Picture {
            matter,
            dims: field.dims,
            camera,
            to_lattice: grid.to_lattice(),
            unit: unit / density,
            sides: &sides,
            termination: settings.termination as f32,
        };
        let mut image = Image::transparent(region.width, region.height)?;
        let (work, seconds) = on_host(|| self.paint(&picture, region, &mut image));
        let work = work?;
        if let Some(extreme) = extreme(settings.model) {
            let factor = density / scene.reduction.factor();
            image.pixels_mut().par_iter_mut().for_each(|pixel| {
                let [value, planes, ..] = pixel.map(f64::from);
                let value = if extreme == Extreme::Mean { value / planes } else { value };
                let shown = if value.is_finite() { scene.transfer.projected(value * factor, None) } else { [0.0; 4] };
                *pixel = shown.map(|channel| channel as f32);
            });
        }
        stages.push(StageTime::host("frame", seconds));
        let voxels = grid.len();
        let noise = (settings.sharpness > 0.0).then(|| settings.reconstruction()).transpose()?;
        Ok(Rendered {
            image,
            stats: Stats {
                painter: PainterStats::Cpu(CpuStats {
                    samples: work.samples,
                    slabs: work.slabs,
                    field_bytes: field.bytes(),
                    misfit: [filter.misfit().data, filter.misfit().noise],
                }),
                painter_reason: "requested".to_owned(),
                model: settings.model,
                shading: settings.shading,
                perspective: camera.eye().is_some(),
                lights: settings.light_count(),
                clip: settings.clip.clone(),
                size: camera.size,
                pixels_covered: region.area(),
                parts: 1,
                voxels,
                splats_kept: voxels,
                kernel_growth: growth,
                sharpness: settings.sharpness,
                noise: noise.map(|reconstruction| reconstruction.noise()),
                footprint_error: filter.misfit().data,
                scene_bytes: field.bytes(),
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
        self.volume.grid()
    }

    /// Refuses a picture that needs more memory than is left, before any is allocated. What the scene holds counts as
    /// left.
    fn check_memory(&self, settings: &Settings) -> Result<()> {
        let Some(available) = available() else { return Ok(()) };
        let field = field::bytes(self.grid().dims());
        let casts = settings.casting().is_some();
        let light = if casts { arriving::BYTES * self.grid().len() } else { 0 };
        let held = self.field.lock().unwrap_or_else(PoisonError::into_inner).as_ref().map_or(0, |_| field);
        let held = held + self.light.lock().unwrap_or_else(PoisonError::into_inner).as_ref().map_or(0, |_| light);
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

    /// The field of a kernel, kept for the next picture.
    fn reconstructed(&self, kernel: Kernel, progress: &Progress) -> Result<Arc<Reconstructed>> {
        let mut held = self.field.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, field)) = held.as_ref().filter(|(of, _)| *of == kernel) {
            return Ok(Arc::clone(field));
        }
        *held = None;
        let filter = SplineFilter::new(&kernel)?;
        let relative = Relative::new(&self.volume, self.reduction);
        let field = Field::new(&self.volume, &relative, &filter, progress)?;
        let made = Arc::new(Reconstructed { field, filter });
        *held = Some((kernel, Arc::clone(&made)));
        Ok(made)
    }

    /// The light that arrives at the voxels, kept for the next picture.
    fn arriving(
        &self,
        field: &Field,
        gradient_opacity: &[[f32; 2]],
        falling: Falling,
        progress: &Progress,
    ) -> Result<Arc<ArrivingLight>> {
        let mut held = self.light.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, light)) = held.as_ref().filter(|(of, _)| *of == falling) {
            return Ok(Arc::clone(light));
        }
        *held = None;
        let relative = Relative::new(&self.volume, self.reduction);
        let to_world = self.volume.grid().to_lattice().matrix3.transpose();
        let (volume, table) = (&self.volume, &self.table);
        let matter = Matter { volume, relative: &relative, table, field, gradient_opacity, to_world };
        let light = Arc::new(ArrivingLight::new(&matter, &falling, progress)?);
        *held = Some((falling, Arc::clone(&light)));
        Ok(light)
    }
}

/// Whether most visible samples equal the next along x. Inspects at most a million samples, in rows spread over the
/// volume. Of scans a few in a hundred do, of 8 bits one in five.
fn is_uniform(volume: &Volume, transfer: &TransferFunction) -> Result<bool> {
    const SAMPLES: usize = 1 << 20;
    let [nx, ny, nz] = volume.grid().dims().map(|d| d as usize);
    let (slope, intercept) = volume.rescale();
    let step = (nx * ny * nz).div_ceil(SAMPLES);
    // A step along y and z that have a factor in common would miss most of the slices.
    let rows = (0..ny * nz).filter(|row| (row % ny + row / ny).is_multiple_of(step));
    let (mut visible, mut equal) = (0_u64, 0_u64);
    for row in rows {
        let samples = volume.read(row * nx..(row + 1) * nx)?;
        for x in 1..nx {
            let [before, own] = [samples.raw(x - 1), samples.raw(x)];
            if transfer.sample(slope * own + intercept).1 > 0.0 {
                visible += 1;
                equal += u64::from(before == own);
            }
        }
    }
    Ok(2 * equal > visible)
}

/// The growth of the kernels of a picture, the same for all.
fn growth(camera: &Camera, grid: &Grid, settings: &Settings) -> Result<f64> {
    if !settings.antialiasing {
        return Ok(1.0);
    }
    let growth = camera.growth(grid);
    let Some(eye) = camera.eye() else { return Ok(growth.at(0.0)) };
    let to_center = (grid.center() - eye).dot(camera.forward);
    let corners = grid.corners_from_center(0.5);
    let farthest = corners.iter().map(|corner| to_center + corner.dot(camera.forward)).fold(0.0, f64::max);
    if growth.at(farthest) > NO_GROWTH {
        let reason =
            "draws no perspective in which voxels are smaller than pixels: make the picture larger, or zoom in";
        return Err(refused(reason));
    }
    Ok(1.0)
}

/// An error about a picture that this engine does not draw.
fn refused(reason: &str) -> Error {
    Error::setting("painter", format!("cpu {reason}"))
}
