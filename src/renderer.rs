//! Renderer (a device), what it prepares (a scene), and pictures.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use crate::adapter::AdapterInfo;
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::gpu::classify::Classifier;
use crate::gpu::context::{self, Context};
use crate::gpu::quads::plan::{Plan, Region, Subject, Target};
use crate::gpu::quads::sort::{SortKey, Sorter};
use crate::gpu::quads::{Drawn, Feed, Inputs, Quads, QuadsKey, footprint_texture};
use crate::gpu::scan::Scan;
use crate::gpu::store::Store;
use crate::gpu::tiles::{self, Followed, Spacing, Tiles, TilesKey};
use crate::gpu::timing::{Timing, on_host};
use crate::image::Image;
use crate::kernel::FootprintTable;
use crate::scene::Drawable;
pub use crate::scene::Scene;
use crate::settings::{Accumulation, Model, Painter, Precision, Resolution, Settings, Shading};
use crate::stats::{Clock, StageTime, Stats};
use crate::transfer::TransferFunction;
use crate::volume::Volume;

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
    sorters: Mutex<HashMap<SortKey, Arc<Sorter>>>,
    quads: Mutex<HashMap<QuadsKey, Arc<Quads>>>,
    tiles: Mutex<HashMap<TilesKey, Arc<Tiles>>>,
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
            sorters: Mutex::new(HashMap::new()),
            quads: Mutex::new(HashMap::new()),
            tiles: Mutex::new(HashMap::new()),
        })
    }

    /// The adapter in use.
    #[must_use]
    pub fn adapter(&self) -> &AdapterInfo {
        &self.context.info
    }

    /// Prepares a volume for pictures of these settings: of them, what counts is the model, the shading and whether there
    /// is light. Voxels that cannot show are dropped. `progress` is told the fraction done.
    ///
    /// # Errors
    /// [`Error::Setting`] where a setting is out of range; [`Error::Volume`] where a sample is NaN or infinite;
    /// [`Error::OutOfMemory`], [`Error::Device`] and [`Error::Unsupported`] where the device fails or is too small.
    pub fn prepare(
        &self,
        volume: &Volume,
        transfer: &TransferFunction,
        settings: &Settings,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Scene> {
        settings.validate()?;
        volume.check_finite()?;
        let context = &self.context;
        if settings.is_post_shaded() {
            let prepare = || Scene::of_scalars(context, volume, transfer, settings);
            return context.guarded("preparing the volume", prepare);
        }
        let (classified, seconds) = on_host(|| {
            context.guarded("classifying the volume", || {
                let scan = self.scan.get_or_init(|| Scan::new(context));
                let classifier = self.classifier.get_or_init(|| Classifier::new(context));
                classifier.run(context, scan, volume, transfer, settings, progress)
            })
        });
        Ok(Scene::of_splats(classified?, settings.has_normals(), volume, transfer, seconds))
    }

    /// Renders a picture of a scene that this renderer prepared.
    ///
    /// # Errors
    /// [`Error::Setting`] where a setting is out of range or the scene was prepared for other ones;
    /// [`Error::Unsupported`] where the adapter cannot do what is asked; [`Error::OutOfMemory`] and [`Error::Device`] where
    /// the device fails. There is never a picture then.
    pub fn render(&self, scene: &Scene, camera: &Camera, settings: &Settings) -> Result<Rendered> {
        settings.validate()?;
        scene.check(settings)?;
        let before = self.context.traffic();
        let plan = Plan::new(camera, scene.grid(), settings, scene.subject());
        let (drawable, seconds) = scene.drawable(&self.context, &plan, settings)?;
        let mut stages = vec![host_stage("classify", scene.seconds + seconds)];
        let (painter, painter_reason) = self.painter(&plan, scene, drawable.stores(), camera, settings)?;
        let painted = match painter {
            Choice::Tiles(view) => self.tiles(scene, &plan, &view, &mut stages)?,
            Choice::Quads => self.quads(scene, &plan, &drawable, settings, &mut stages)?,
        };
        let bricks = drawable.bricks();
        let traffic = self.context.traffic();
        let (splats, splats_kept) = (drawable.splats(), drawable.voxels());
        let Painted { image, drawn, followed, covered, precision, sheets, sheet_thickness, .. } = painted;
        let spacing = followed.and_then(|f| f.spacing);
        let stats = Stats {
            adapter: self.context.info.clone(),
            painter: if followed.is_some() { Painter::Tiles } else { Painter::Quads },
            painter_reason,
            rays: followed.map_or(0, |f| f.rays),
            rays_per_voxel: spacing.and_then(|s| if let Spacing::Voxel(rays) = s { Some(rays) } else { None }),
            pixels_per_ray: spacing.and_then(|s| if let Spacing::Pixels(pitch) = s { Some(pitch) } else { None }),
            model: settings.model,
            shading: if settings.is_post_shaded() { Shading::Post } else { Shading::Pre },
            perspective: plan.is_perspective(),
            lights: settings.lighting.as_ref().map_or(0, |l| l.lights.len() as u32),
            sheet_alignment: settings.sheets,
            accumulation: settings.accumulation,
            precision,
            size: settings.size,
            pixels_covered: covered,
            voxels: scene.grid().len(),
            splats_kept,
            splats_dropped: scene.grid().len() - splats_kept,
            splats_padding: splats - splats_kept,
            bricks: bricks.all,
            bricks_uploaded: bricks.uploaded,
            bytes_uploaded: bricks.bytes,
            sheets,
            sheet_thickness,
            kernel_growth: plan.max_growth(),
            sheets_per_pass: painted.sheets_per_pass,
            batches: if painted.sheets_per_pass > 0 && covered > 0 {
                sheets.div_ceil(painted.sheets_per_pass)
            } else {
                0
            },
            passes: drawn.passes,
            splats_in_view: drawn.sorted,
            quads: drawn.quads,
            quads_terminated: drawn.terminated,
            bricks_terminated: drawn.hidden_bricks,
            quads_per_splat: drawn.quads as f64 / splats.max(1) as f64,
            footprint_table: painted.footprint_table,
            footprint_error: painted.footprint_error,
            scene_bytes: drawable.bytes() + painted.packed_bytes,
            frame_bytes: traffic.allocated - before.allocated,
            bytes_sent: traffic.sent - before.sent,
            pipelines: traffic.pipelines,
            stages,
        };
        Ok(Rendered { image, stats })
    }

    /// The painter of a picture, and why it is taken.
    fn painter<'a>(
        &self,
        plan: &Plan,
        scene: &'a Scene,
        stores: &'a [Store],
        camera: &'a Camera,
        settings: &'a Settings,
    ) -> Result<(Choice<'a>, String)> {
        if settings.painter == Painter::Quads {
            return Ok((Choice::Quads, "asked for".to_owned()));
        }
        let view = || {
            let Subject { max_weight, unit } = scene.subject();
            let (padding, growth) = (plan.padding(), plan.max_growth());
            let (grid, transfer) = (scene.grid(), scene.table());
            let subject = tiles::Subject { stores, grid, padding, growth, max_weight, unit, transfer };
            tiles::View::new(&self.context, subject, camera, settings).map(Box::new).map_err(str::to_owned)
        };
        let served = match tiles::refusal(&self.context, plan, settings) {
            None if settings.painter == Painter::Auto && !self.context.info.is_software() => {
                return Ok((Choice::Quads, "the adapter has a rasteriser".to_owned()));
            }
            None => view(),
            Some(reason) => Err(reason),
        };
        match (settings.painter, served) {
            (Painter::Auto, Ok(view)) if settings.resolution == Resolution::Capped && view.is_better_by_quads() => {
                Ok((Choice::Quads, "few voxels make an X-ray faster by quads".to_owned()))
            }
            (Painter::Auto, Ok(view)) => Ok((Choice::Tiles(view), "the adapter is software".to_owned())),
            (Painter::Auto, Err(reason)) => Ok((Choice::Quads, format!("tiles does not serve: {reason}"))),
            (_, Ok(view)) => Ok((Choice::Tiles(view), "asked for".to_owned())),
            (_, Err(reason)) => {
                Err(Error::Setting { name: "painter", reason: format!("tiles does not serve: {reason}") })
            }
        }
    }

    /// Draws by rays.
    fn tiles(
        &self,
        scene: &Scene,
        plan: &Plan,
        view: &tiles::View<'_>,
        stages: &mut Vec<StageTime>,
    ) -> Result<Painted> {
        let settings = view.settings;
        let (sheets, sheet_thickness) = view.slabs();
        let mut painted =
            Painted { footprint_error: view.footprint_error(), ..Painted::new(settings, sheets, sheet_thickness)? };
        let mut followed = Followed::default();
        let Some(reach) = plan.reach().filter(|_| !view.is_empty()) else {
            return Ok(Painted { followed: Some(followed), ..painted });
        };
        let key = view.key();
        let (pipelines, seconds) = on_host(|| made(&self.tiles, key, || Tiles::new(&self.context, key)));
        let pipelines = pipelines?;
        stages.push(host_stage("pipelines", seconds));
        self.timed(stages, |timing| {
            let lighting = settings.lighting.as_ref().map(|l| plan.lighting(l)).unwrap_or_default();
            let packed = scene.packed(view, |look| pipelines.pack(&self.context, timing, view, look, &lighting))?;
            painted.packed_bytes = packed.iter().map(|packed| packed.bytes()).sum();
            for region in self.regions(reach, 16) {
                painted.covered += u64::from(region.width) * u64::from(region.height);
                let (pixels, done) = pipelines.run(&self.context, timing, view, &packed, &lighting, region)?;
                followed = Followed { rays: followed.rays + done.rays, ..done };
                painted.put(region, 0, &pixels);
            }
            Ok(())
        })?;
        Ok(Painted { followed: Some(followed), ..painted })
    }

    /// Draws by quads.
    fn quads(
        &self,
        scene: &Scene,
        plan: &Plan,
        drawable: &Drawable<'_>,
        settings: &Settings,
        stages: &mut Vec<StageTime>,
    ) -> Result<Painted> {
        let precision = self.precision(settings, plan)?;
        let table = match settings.footprint_table {
            Some([rows, terms]) => FootprintTable::with_size(&settings.kernel, rows, terms),
            None => FootprintTable::new(
                &settings.kernel,
                settings.max_error.unwrap_or_else(|| precision.footprint_error()),
            )?,
        };
        let feed = match settings.model {
            Model::Xray => Feed::Depth,
            Model::Mip => Feed::Maximum,
            Model::Composite if settings.is_post_shaded() => Feed::Scalars,
            Model::Composite => Feed::Colors,
        };
        let sheets_per_pass = self.sheets_per_pass(settings, feed, precision)?;
        let key = QuadsKey {
            feed,
            perspective: plan.is_perspective(),
            grown: plan.is_grown(),
            axis: plan.is_axis_aligned(),
            additive: settings.accumulation == Accumulation::Additive,
            lights: settings.lighting.as_ref().map_or(0, |l| l.lights.len() as u32),
            samples: if feed.is_scalar() { settings.samples_per_sheet() } else { 1 },
            terminates: plan.terminates(),
            precision,
            sheets_per_pass,
            footprint_rows: table.rows(),
            footprint_terms: table.terms(),
        };
        let mut painted = Painted {
            precision,
            sheets_per_pass,
            footprint_table: [table.rows(), table.terms()],
            footprint_error: table.max_error(),
            ..Painted::new(settings, plan.sheets(), plan.sheet_step())?
        };
        // Scalars are everywhere, be it as the base alone.
        let reach = plan.reach().filter(|_| (drawable.splats() > 0 || feed.is_scalar()) && plan.sheets() > 0);
        let Some(reach) = reach else { return Ok(painted) };
        let (pipelines, seconds) = on_host(|| made(&self.quads, key, || Quads::new(&self.context, key)));
        let quads = pipelines?;
        stages.push(host_stage("pipelines", seconds));
        self.timed(stages, |timing| {
            let inputs = Inputs {
                footprint: &footprint_texture(&self.context, &table),
                lighting: settings.lighting.as_ref().map(|l| plan.lighting(l)).unwrap_or_default(),
                transfer: scene.table(),
            };
            for region in self.regions(reach, key.sheet_bytes()) {
                painted.covered += u64::from(region.width) * u64::from(region.height);
                let (pixels, done) = self.region(drawable.stores(), plan, &quads, timing, region, &inputs)?;
                painted.drawn.add(done);
                painted.put(region, plan.margin(), &pixels);
            }
            Ok(())
        })?;
        Ok(painted)
    }

    /// Runs the stages of a picture and notes their times.
    fn timed(&self, stages: &mut Vec<StageTime>, work: impl FnOnce(&mut Timing) -> Result<()>) -> Result<()> {
        let mut timing = Timing::new(&self.context);
        let (result, seconds) = on_host(|| self.context.guarded("rendering", || work(&mut timing)));
        result?;
        let device = self.context.guarded("reading timestamps", || timing.finish(&self.context))?;
        for (name, seconds) in device.into_iter().flatten() {
            stages.push(StageTime { name, seconds, clock: Clock::Device });
        }
        stages.push(host_stage("frame", seconds));
        Ok(())
    }

    /// One region of the picture: sort, splat, composite, resolve.
    fn region(
        &self,
        stores: &[Store],
        plan: &Plan,
        quads: &Quads,
        timing: &mut Timing,
        region: Region,
        inputs: &Inputs<'_>,
    ) -> Result<(Vec<[f32; 4]>, Drawn)> {
        let context = &self.context;
        let frame = context.upload("frame", bytemuck::bytes_of(&plan.frame(region)), wgpu::BufferUsages::UNIFORM)?;
        let target = Target { plan, region, frame: &frame };
        let scan = self.scan.get_or_init(|| Scan::new(context));
        let key = SortKey { axis: plan.is_axis_aligned(), grown: plan.is_grown(), scalars: plan.is_post_shaded() };
        let sorter = made(&self.sorters, key, || Ok(Sorter::new(context, key)))?;
        let spans = sorter.run(context, scan, timing, target, quads.sheets_per_pass(), stores)?;
        let covered = plan.covered(stores, region, quads.sheets_per_pass());
        quads.run(context, timing, target, inputs, &spans, &covered)
    }

    /// The rectangles in which a picture is made: one, unless it outgrows the adapter's textures or bindings, or its
    /// sheets, of that many bytes a pixel, would take more than [`MAX_SHEET_BYTES`].
    fn regions(&self, reach: Region, sheet_bytes: u32) -> Vec<Region> {
        let limits = &self.context.limits;
        let sheets = MAX_SHEET_BYTES / u64::from(sheet_bytes);
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
    fn precision(&self, settings: &Settings, plan: &Plan) -> Result<Precision> {
        let blendable = self.context.features.contains(wgpu::Features::FLOAT32_BLENDABLE);
        match settings.precision {
            Some(Precision::F32) if !blendable => {
                Err(self.context.unsupported("cannot blend f32 sheets: choose precision f16".to_owned()))
            }
            Some(precision) => Ok(precision),
            None if blendable && (self.context.info.is_software() || settings.is_post_shaded()) => Ok(Precision::F32),
            // A kernel s times as large meets s^2 times as many others in a pixel, each as much fainter: half floats
            // lose them.
            None if blendable && plan.max_growth() > 1.5 => Ok(Precision::F32),
            None => Ok(Precision::F16),
        }
    }

    /// How many sheets one pass feeds: as many as asked for, or the most that the adapter's attachments hold up to 8 on
    /// software, which is bound by the number of quads, and up to 4 on a GPU, which is bound by blending.
    fn sheets_per_pass(&self, settings: &Settings, feed: Feed, precision: Precision) -> Result<u32> {
        if feed == Feed::Depth {
            return Ok(1);
        }
        let context = &self.context;
        let attachment = if feed.is_scalar() { 4 } else { 1 } * feed.sheet_bytes(precision);
        let bytes = context.limits.max_color_attachment_bytes_per_sample;
        let most = context.limits.max_color_attachments.min(bytes / attachment);
        // Scalars go four to an attachment.
        let (most, least) = if feed.is_scalar() { (4 * most, 4) } else { (most, 1) };
        let possible = [8, 4, 2, 1].into_iter().filter(|&n| (least..=most).contains(&n));
        match settings.sheets_per_pass {
            None => {
                let preferred = if context.info.is_software() || feed.is_scalar() { 8 } else { 4 };
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

/// The painter of a picture.
enum Choice<'a> {
    Quads,
    Tiles(Box<tiles::View<'a>>),
}

/// A picture, and what it took to paint it.
struct Painted {
    image: Image,
    drawn: Drawn,
    followed: Option<Followed>,
    covered: u64,
    precision: Precision,
    sheets: u32,
    sheet_thickness: f64,
    sheets_per_pass: u32,
    footprint_table: [u32; 2],
    footprint_error: f64,
    packed_bytes: u64,
}

impl Painted {
    /// Nothing yet.
    fn new(settings: &Settings, sheets: u32, sheet_thickness: f64) -> Result<Self> {
        let [width, height] = settings.size;
        Ok(Self {
            image: Image::transparent(width, height)?,
            drawn: Drawn::default(),
            followed: None,
            covered: 0,
            precision: Precision::F32,
            sheets,
            sheet_thickness,
            sheets_per_pass: 0,
            footprint_table: [0; 2],
            footprint_error: 0.0,
            packed_bytes: 0,
        })
    }

    /// Puts the pixels of a region, with a margin around them, in their place.
    fn put(&mut self, region: Region, margin: u32, pixels: &[[f32; 4]]) {
        let margin = margin as usize;
        let (x, length, width) = (region.x as usize, region.width as usize, self.image.width() as usize);
        let rows = self.image.pixels_mut().chunks_exact_mut(width).skip(region.y as usize);
        let sources = pixels.chunks_exact(length + 2 * margin).skip(margin);
        for (row, source) in rows.take(region.height as usize).zip(sources) {
            row[x..x + length].copy_from_slice(&source[margin..margin + length]);
        }
    }
}

/// What was made for `key` before, or is made now.
fn made<K: Eq + std::hash::Hash, V>(
    cache: &Mutex<HashMap<K, Arc<V>>>,
    key: K,
    make: impl FnOnce() -> Result<V>,
) -> Result<Arc<V>> {
    let mut cache = cache.lock().unwrap_or_else(PoisonError::into_inner);
    Ok(match cache.entry(key) {
        Entry::Occupied(held) => Arc::clone(held.get()),
        Entry::Vacant(place) => Arc::clone(place.insert(Arc::new(make()?))),
    })
}

/// The most memory that the sheets of a pass take; larger pictures are made in parts.
const MAX_SHEET_BYTES: u64 = 256 << 20;

fn host_stage(name: &'static str, seconds: f64) -> StageTime {
    StageTime { name, seconds, clock: Clock::Host }
}
