//! Renderer (a device), Scene (a volume prepared on it), and pictures.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::gpu::classify::{Classifier, Store};
pub use crate::gpu::context::AdapterInfo;
use crate::gpu::context::{self, Context};
use crate::gpu::plan::{Plan, Region, Target};
use crate::gpu::quads::{Drawn, Quads, QuadsKey, footprint_texture};
use crate::gpu::scan::Scan;
use crate::gpu::sort::Sorter;
use crate::gpu::timing::{Timing, on_host};
use crate::image::Image;
use crate::kernel::FootprintTable;
use crate::settings::{Precision, Settings};
use crate::stats::{Clock, StageTime, Stats};
use crate::transfer::TransferFunction;
use crate::volume::{Grid, Volume};

/// How a renderer is made.
#[derive(Debug, Clone, Default)]
pub struct RendererOptions {
    /// Part of the name of the adapter to take, letter case ignored; `None` takes the best.
    pub adapter: Option<String>,
}

/// The adapters of this machine, best first.
#[must_use]
pub fn adapters() -> Vec<AdapterInfo> {
    context::adapters()
}

/// An open graphics device with the pipelines made on it so far.
pub struct Renderer {
    context: Context,
    scan: OnceLock<Scan>,
    classifier: OnceLock<Classifier>,
    sorter: OnceLock<Sorter>,
    quads: Mutex<HashMap<QuadsKey, Arc<Quads>>>,
}

/// A classified volume on the device of the renderer that prepared it.
pub struct Scene {
    stores: Vec<Store>,
    grid: Grid,
    unit: f64,
    max_density: f64,
    bytes: u64,
    seconds: f64,
}

impl Scene {
    /// The number of voxels that have some opacity.
    #[must_use]
    pub fn splats(&self) -> u64 {
        self.stores.iter().map(|s| u64::from(s.count)).sum()
    }
}

/// A picture and what it took.
#[derive(Debug, Clone)]
pub struct Rendered {
    /// The picture.
    pub image: Image,
    /// What it took.
    pub stats: Stats,
}

impl Renderer {
    /// Opens a device.
    ///
    /// # Errors
    /// [`Error::NoAdapter`] where there is none, none of that name, or it cannot be opened.
    pub fn new(options: &RendererOptions) -> Result<Self> {
        Ok(Self {
            context: Context::new(options.adapter.as_deref())?,
            scan: OnceLock::new(),
            classifier: OnceLock::new(),
            sorter: OnceLock::new(),
            quads: Mutex::new(HashMap::new()),
        })
    }

    /// The adapter in use.
    #[must_use]
    pub fn adapter(&self) -> &AdapterInfo {
        &self.context.info
    }

    /// Classifies a volume on the device; voxels of no opacity are dropped. `progress` is told the fraction done.
    ///
    /// # Errors
    /// [`Error::Volume`] where a sample is NaN or infinite; [`Error::OutOfMemory`], [`Error::Device`] and
    /// [`Error::Unsupported`] where the device fails or is too small.
    pub fn prepare(
        &self,
        volume: &Volume,
        transfer: &TransferFunction,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Scene> {
        volume.check_finite()?;
        let (stores, seconds) = on_host(|| {
            self.context.guarded("classifying the volume", || {
                let scan = self.scan.get_or_init(|| Scan::new(&self.context));
                let classifier = self.classifier.get_or_init(|| Classifier::new(&self.context));
                classifier.run(&self.context, scan, volume, transfer, progress)
            })
        });
        let stores = stores?;
        let bytes = stores.iter().map(|s| s.splats.size()).sum();
        Ok(Scene {
            stores,
            grid: *volume.grid(),
            unit: transfer.unit_or(volume.grid().min_spacing()),
            max_density: TransferFunction::extinction(transfer.max_opacity(), 1.0),
            bytes,
            seconds,
        })
    }

    /// Renders a picture of a scene that this renderer prepared.
    ///
    /// # Errors
    /// [`Error::Setting`] where a setting is out of range; [`Error::Unsupported`] where the adapter cannot do what is
    /// asked; [`Error::OutOfMemory`] and [`Error::Device`] where the device fails. There is never a picture then.
    pub fn render(&self, scene: &Scene, camera: &Camera, settings: &Settings) -> Result<Rendered> {
        settings.validate()?;
        let before = self.context.allocated();
        let precision = self.precision(settings)?;
        let table =
            FootprintTable::new(&settings.kernel, settings.max_error.unwrap_or_else(|| precision.footprint_error()))?;
        let sheets_per_pass = self.sheets_per_pass(settings, precision)?;
        let plan = Plan::new(camera, &scene.grid, settings, scene.max_density, scene.unit);
        let mut stages = vec![host_stage("classify", scene.seconds)];
        let key = QuadsKey {
            perspective: plan.is_perspective(),
            precision,
            sheets_per_pass,
            footprint_rows: table.rows(),
            footprint_terms: table.terms(),
        };
        let [width, height] = settings.size;
        let mut image = Image::transparent(width, height)?;
        let mut drawn = Drawn::default();
        let mut covered = 0;
        let reach = plan.reach().filter(|_| scene.splats() > 0 && plan.sheets() > 0);
        if let Some(reach) = reach {
            let (pipelines, seconds) = on_host(|| self.context.guarded("making pipelines", || Ok(self.quads(key))));
            let quads = pipelines?;
            stages.push(host_stage("pipelines", seconds));
            let mut timing = Timing::new(&self.context);
            let (result, seconds) = on_host(|| {
                self.context.guarded("rendering", || {
                    let footprint = footprint_texture(&self.context, &table);
                    for region in self.regions(reach, key) {
                        covered += u64::from(region.width) * u64::from(region.height);
                        let (pixels, done) = self.region(scene, &plan, &quads, &mut timing, region, &footprint)?;
                        drawn.passes += done.passes;
                        drawn.quads += done.quads;
                        let rows = image.pixels_mut().chunks_exact_mut(width as usize).skip(region.y as usize);
                        for (row, source) in rows.zip(pixels.chunks_exact(region.width as usize)) {
                            row[region.x as usize..][..source.len()].copy_from_slice(source);
                        }
                    }
                    Ok(())
                })
            });
            result?;
            let device = self.context.guarded("reading timestamps", || timing.finish(&self.context))?;
            for (name, seconds) in device.into_iter().flatten() {
                stages.push(StageTime { name, seconds, clock: Clock::Device });
            }
            stages.push(host_stage("frame", seconds));
        }
        let splats_kept = scene.splats();
        let stats = Stats {
            adapter: self.context.info.clone(),
            painter: "quads",
            precision,
            size: settings.size,
            pixels_covered: covered,
            voxels: scene.grid.len(),
            splats_kept,
            splats_dropped: scene.grid.len() - splats_kept,
            sheets: plan.sheets(),
            sheet_thickness: plan.sheet_step(),
            sheets_per_pass,
            passes: drawn.passes,
            quads: drawn.quads,
            quads_per_splat: drawn.quads as f64 / splats_kept.max(1) as f64,
            footprint_table: [table.rows(), table.terms()],
            footprint_error: table.max_error(),
            scene_bytes: scene.bytes,
            frame_bytes: self.context.allocated() - before,
            stages,
        };
        Ok(Rendered { image, stats })
    }

    /// One region of the picture: sort, splat, composite, resolve.
    fn region(
        &self,
        scene: &Scene,
        plan: &Plan,
        quads: &Quads,
        timing: &mut Timing,
        region: Region,
        footprint: &wgpu::TextureView,
    ) -> Result<(Vec<[f32; 4]>, Drawn)> {
        let context = &self.context;
        let frame = context.upload("frame", bytemuck::bytes_of(&plan.frame(region)), wgpu::BufferUsages::UNIFORM)?;
        let target = Target { plan, region, frame: &frame };
        let scan = self.scan.get_or_init(|| Scan::new(context));
        let sorter = self.sorter.get_or_init(|| Sorter::new(context));
        let spans = sorter.run(context, scan, timing, target, quads.sheets_per_pass(), &scene.stores)?;
        quads.run(context, timing, target, footprint, &spans)
    }

    fn quads(&self, key: QuadsKey) -> Arc<Quads> {
        let mut made = self.quads.lock().unwrap_or_else(PoisonError::into_inner);
        Arc::clone(made.entry(key).or_insert_with(|| Arc::new(Quads::new(&self.context, key))))
    }

    /// The rectangles in which a picture is made: one, unless it outgrows the adapter's textures or bindings, or its
    /// sheets would take more than [`MAX_SHEET_BYTES`].
    fn regions(&self, reach: Region, key: QuadsKey) -> Vec<Region> {
        let limits = &self.context.limits;
        let sheets = MAX_SHEET_BYTES / u64::from(key.sheets_per_pass * key.precision.bytes());
        let pixels = (limits.max_storage_buffer_binding_size.min(limits.max_buffer_size) / 16).min(sheets);
        let side = limits.max_texture_dimension_2d.min(pixels.isqrt() as u32).max(1);
        let steps = |start: u32, length: u32| {
            (0..length).step_by(side as usize).map(move |at| (start + at, side.min(length - at)))
        };
        steps(reach.y, reach.height)
            .flat_map(|(y, height)| steps(reach.x, reach.width).map(move |(x, width)| Region { x, y, width, height }))
            .collect()
    }

    /// The precision asked for, or the adapter's own: see [`Settings::precision`].
    fn precision(&self, settings: &Settings) -> Result<Precision> {
        let blendable = self.context.features.contains(wgpu::Features::FLOAT32_BLENDABLE);
        match settings.precision {
            Some(Precision::F32) if !blendable => {
                Err(self.context.unsupported("cannot blend f32 sheets: use --precision f16".to_owned()))
            }
            Some(precision) => Ok(precision),
            None if blendable && self.context.info.is_software() => Ok(Precision::F32),
            None => Ok(Precision::F16),
        }
    }

    /// How many sheets one pass feeds: as many as asked for, or the most that the adapter's attachments hold up to 8 on
    /// software, which is bound by the number of quads, and up to 4 on a GPU, which is bound by blending.
    fn sheets_per_pass(&self, settings: &Settings, precision: Precision) -> Result<u32> {
        let context = &self.context;
        let bytes = precision.bytes();
        let most =
            context.limits.max_color_attachments.min(context.limits.max_color_attachment_bytes_per_sample / bytes);
        let possible = [8, 4, 2, 1].into_iter().filter(|&n| n <= most);
        match settings.sheets_per_pass {
            None => {
                let preferred = if context.info.is_software() { 8 } else { 4 };
                Ok(possible.filter(|&n| n <= preferred).max().unwrap_or(1))
            }
            Some(asked) if possible.clone().any(|n| n == asked) => Ok(asked),
            Some(asked) => Err(Error::Setting {
                name: "sheets-per-pass",
                reason: format!(
                    "{asked}, but {} takes {} with these sheets",
                    context.info.name,
                    possible.map(|n| n.to_string()).collect::<Vec<_>>().join(", ")
                ),
            }),
        }
    }
}

/// The most memory that the sheets of a pass take; larger pictures are made in parts.
const MAX_SHEET_BYTES: u64 = 256 << 20;

fn host_stage(name: &'static str, seconds: f64) -> StageTime {
    StageTime { name, seconds, clock: Clock::Host }
}
