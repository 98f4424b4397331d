//! The renderer (a device), its scenes (prepared volumes) and their pictures.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::frame::{Frame, Surfaces};
use crate::gpu::cache::Cache;
use crate::gpu::context::{self, Context, PIXEL_BYTES, Traffic};
use crate::gpu::drawable::Drawable;
use crate::gpu::light_volume::PostShading;
use crate::gpu::present::{self, Present};
use crate::gpu::recorder::Recorder;
use crate::gpu::samples::Bricks;
pub use crate::gpu::stderr::silenced;
use crate::gpu::store::Store;
use crate::gpu::view::ViewGeometry;
use crate::image::{DepthMap, Image, Region, check_scale};
use crate::layers::{Layers, absent_value, finite};
use crate::painters::choice::PainterChoice;
use crate::painters::painter::{Begun, Depths, Job, Room};
use crate::prepare::lattice::Lattice;
use crate::prepare::levels::ScalarNeed;
pub use crate::prepare::scene::Scene;
use crate::progress::Progress;
pub use crate::settings::RendererOptions;
use crate::settings::budget::MAX_FRAGMENTS;
use crate::settings::{Level, Model, Settings, Shading};
pub use crate::stats::Rendered;
use crate::stats::adapter::AdapterInfo;
use crate::stats::on_host;
use crate::stats::{Counts, StageTime, Stats};
use crate::transfer::TransferFunction;
use crate::volume::Volume;

/// Returns the adapters of this machine, best first; none if there is no memory for a driver.
#[must_use]
pub fn adapters() -> Vec<AdapterInfo> {
    context::adapters()
}

/// Refuses to open a driver if there is so little memory that threads may not start.
///
/// # Errors
/// [`Error::NoAdapter`].
pub(crate) fn check_memory() -> Result<()> {
    context::check_memory(LEAST_BYTES)
}

/// The bytes of addresses without which threads may not start.
const LEAST_BYTES: u64 = 256 << 20;

/// An open graphics device with the pipelines made on it so far.
pub struct Renderer {
    pub(crate) context: Context,
    pipelines: Cache,
    progress: Progress,
}

/// A part of a picture to render, with camera and settings.
#[derive(Clone, Copy)]
struct Shot<'a> {
    camera: &'a Camera,
    settings: &'a Settings,
    wanted: Region,
    depths: Depths<'a>,
    /// The largest number of pixels that quads may cover; see [`Job::most_fragments`].
    most_fragments: f64,
}

impl<'a> Shot<'a> {
    /// Makes the shot of a whole picture.
    fn whole(camera: &'a Camera, settings: &'a Settings) -> Self {
        let wanted = Frame::new(camera, settings).region;
        Self { camera, settings, wanted, depths: Depths::default(), most_fragments: MAX_FRAGMENTS }
    }
}

/// A layer of a picture: its lattice and its splats. Most pictures have one.
struct PictureLayer {
    lattice: Lattice,
    need: ScalarNeed,
    /// The classification and the light of scalars.
    post: Option<PostShading>,
    /// The largest factor by which reconstruction magnifies scalars; see [`Job::magnification`].
    magnification: Option<f64>,
    drawable: Arc<Drawable>,
    /// The splats, for painters that draw lists.
    lists: Arc<Vec<Store>>,
}

/// The largest memory of the sheets of a pass, bytes; larger pictures are made in parts.
const MAX_SHEET_BYTES: u64 = 256 << 20;

impl Renderer {
    /// Opens a device.
    ///
    /// # Errors
    /// [`Error::NoAdapter`] if there is no adapter, none of this name or index, or it cannot be opened.
    pub fn new(options: &RendererOptions) -> Result<Self> {
        Ok(Self {
            context: Context::new(options.adapter.as_deref())?,
            pipelines: Cache::default(),
            progress: options.progress.clone(),
        })
    }

    /// Makes a renderer on a device that the caller has opened, to share textures with it ([`Self::render_into`]).
    ///
    /// The device needs no features. It should have the [`Self::FEATURES`] that its adapter has: without
    /// `FLOAT32_BLENDABLE` sheets are f16. The callbacks for errors and for a lost device stay the caller's.
    /// `options.adapter` has no effect.
    #[must_use]
    pub fn from_device(
        device: wgpu::Device,
        queue: wgpu::Queue,
        adapter: &wgpu::Adapter,
        options: &RendererOptions,
    ) -> Self {
        let info = AdapterInfo::from(&adapter.get_info());
        Self {
            context: Context::of_device(device, queue, info),
            pipelines: Cache::default(),
            progress: options.progress.clone(),
        }
    }

    /// The device features that rendering uses if they are available.
    pub const FEATURES: wgpu::Features = Context::FEATURES;

    /// Returns the adapter in use.
    #[must_use]
    pub fn adapter(&self) -> &AdapterInfo {
        &self.context.info
    }

    /// Returns the work that the device has received from this renderer so far, and the memory that it holds now.
    #[must_use]
    pub fn counts(&self) -> Counts {
        let Traffic { sent, dispatches, submissions, waits, .. } = self.context.traffic();
        Counts { dispatches, submissions, waits, uploaded: sent, resident: self.context.resident() }
    }

    /// Prepares a volume for pictures with these settings. The scene depends only on the model, the shading and whether
    /// there is light; of a sharpened post-shaded picture also on kernel and sharpness. Invisible voxels are dropped.
    ///
    /// Pre-shaded voxels are classified here if the level is [`Level::At(0)`](Level::At). Otherwise the first picture
    /// decides between voxels and cells and spends that time. The file of a streamed volume must exist until then.
    ///
    /// Nothing is drawn of samples that are NaN or infinite.
    ///
    /// # Errors
    /// [`Error::Setting`] if a setting is out of range, [`Error::Input`] if samples cannot be read, and the errors of
    /// [`Self::render`] if the device fails or is too small.
    pub fn prepare(&self, volume: &Volume, transfer: &TransferFunction, settings: &Settings) -> Result<Scene> {
        settings.validate()?;
        let mirrored = settings.mirrored(volume, transfer)?;
        let (volume, transfer) = mirrored.as_ref().map_or((volume, transfer), |(volume, transfer)| (volume, transfer));
        let volume = finite(volume, transfer, settings.model)?;
        let has_gaps = matches!(volume, Cow::Owned(_)) && !matches!(settings.model, Model::Mip | Model::Minip);
        let (volume, context) = (&*volume, &self.context);
        let scene = if settings.is_post_shaded() {
            let prepare = || Scene::of_scalars(context, volume, transfer, settings, &self.progress);
            context.guarded("preparing the volume", prepare)?
        } else {
            self.prepared(&Layers::of_volume(volume, transfer), settings)?
        };
        Ok(if has_gaps { scene.with_gaps(absent_value(transfer)) } else { scene })
    }

    /// Prepares layers for pre-shaded pictures; one volume alone like [`Self::prepare`]. Several layers are always
    /// classified on the host and drawn of voxels.
    ///
    /// # Errors
    /// The errors of [`Self::prepare`], and [`Error::Setting`] if several layers are to be post-shaded, projected or
    /// drawn of cells.
    pub fn prepare_layers(&self, layers: &Layers, settings: &Settings) -> Result<Scene> {
        if let Some((volume, transfer)) = layers.plain() {
            return self.prepare(volume, transfer, settings);
        }
        settings.validate()?;
        Layers::check_settings(settings)?;
        self.prepared(&layers.finite()?, settings)
    }

    /// Gives a scene another transfer function, and the next picture shows it. On GPUs a change sends a table and no
    /// samples, but those of bricks that may show for the first time, if few bricks of the volume may show. The first
    /// change sends the samples that the scene then holds, if lists of splats took less memory before. The field of
    /// post-shaded shadows is made again.
    ///
    /// A pre-shaded picture has the bytes of a scene that was prepared with the function. A post-shaded one differs by
    /// up to 0.5 of 255 (rms), because sums of kernels err more if the base value is farther from the visible ones.
    ///
    /// # Errors
    /// [`Error::Setting`] if the scene has several layers, which have no single transfer function, or if the function
    /// shows the value that stands for samples that are NaN or infinite: prepare the scene again; and
    /// [`Error::Input`] if the samples cannot be read.
    pub fn set_transfer(&self, scene: &mut Scene, transfer: &TransferFunction) -> Result<()> {
        scene.set_transfer(transfer)
    }

    fn prepared(&self, layers: &Layers, settings: &Settings) -> Result<Scene> {
        if layers.isosurfaces(settings.model)?.is_some() {
            return Err(Error::setting("painter", "isosurfaces in classified voxels are drawn by cpu"));
        }
        let scene = Scene::of_splats(&self.context, layers, settings.normals());
        if settings.level == Level::At(0) {
            scene.classify(&self.context, &self.pipelines, settings, &self.progress)?;
        }
        Ok(scene)
    }

    /// Renders a picture of a scene that this renderer prepared.
    ///
    /// In a picture with surfaces each pixel has a ray of its own, whatever the painter.
    ///
    /// # Errors
    /// [`Error::Setting`] if a setting is out of range, the region is not in the picture, surfaces have another size,
    /// or the scene was prepared for other settings; [`Error::Camera`] if the camera is not finite,
    /// [`Error::Unsupported`] if the adapter cannot render the picture, and [`Error::OutOfMemory`] or [`Error::Device`]
    /// if the device fails. There is no picture then.
    pub fn render(&self, scene: &Scene, frame: &Frame<'_>) -> Result<Rendered> {
        self.render_within(scene, frame, MAX_FRAGMENTS)
    }

    /// Renders a picture, refused with [`Error::Setting`] if quads would cover over `most_fragments` pixels.
    pub(crate) fn render_within(&self, scene: &Scene, frame: &Frame<'_>, most_fragments: f64) -> Result<Rendered> {
        let most_fragments = most_fragments.min(MAX_FRAGMENTS);
        frame.drawn(|wanted, solids| {
            let depths = Depths { solids, halves: false };
            self.shot(scene, Shot { wanted, depths, most_fragments, ..Shot::whole(frame.camera, frame.settings) })
        })
    }

    /// Returns the depths at which rays have lost half of their light, for another renderer to combine: a surface at a
    /// smaller depth lies mostly before the matter. They are exact to about half a slab of the painter, which is about
    /// half a voxel. Rays that keep more than half of their light have no depth.
    ///
    /// Matter behind the surfaces of the frame does not count.
    ///
    /// # Errors
    /// The errors of [`Self::render`], and [`Error::Setting`] if there are no depths ([`Settings::has_depths`]).
    pub fn depths(&self, scene: &Scene, frame: &Frame<'_>) -> Result<DepthMap> {
        let Frame { camera, settings, region: wanted, .. } = *frame;
        settings.check_depths()?;
        frame.check()?;
        check_scale(camera)?;
        let depths = Depths { solids: frame.depths(), halves: true };
        let Rendered { image, .. } = self.shot(scene, Shot { wanted, depths, ..Shot::whole(camera, settings) })?;
        let unit = scene.grid().unit();
        Ok(DepthMap::of_halves(&image, &camera.local(scene.grid()), unit))
    }

    /// Renders a part of a picture of a whole volume and reads it back.
    fn shot(&self, scene: &Scene, shot: Shot<'_>) -> Result<Rendered> {
        let Shot { wanted, .. } = shot;
        check_whole(scene)?;
        let mut image = Image::transparent(wanted.width, wanted.height)?;
        let recorder = Recorder::timed(&self.context);
        let stats = self.paint(scene, shot, recorder, &mut |recorder, painted, part, pixels| {
            put(&mut image, [wanted, painted, part], recorder, pixels)
        })?;
        Ok(Rendered { image, stats })
    }

    /// Renders the partial picture of a brick by one family of rays: the region of the picture that the brick reaches,
    /// and the values of its pixels as painters leave them; `None` if it reaches no pixel. The scalars of projections
    /// are in units of values.
    pub(crate) fn render_partial(
        &self,
        scene: &Scene,
        camera: &Camera,
        settings: &Settings,
    ) -> Result<(Option<(Region, Image)>, Stats)> {
        camera.validate()?;
        let mut parts: Vec<(Region, Image)> = Vec::new();
        let recorder = Recorder::timed(&self.context);
        let stats =
            self.paint(scene, Shot::whole(camera, settings), recorder, &mut |recorder, painted, part, pixels| {
                let mut image = Image::transparent(part.width, part.height)?;
                put(&mut image, [part, painted, part], recorder, pixels)?;
                parts.push((part, image));
                Ok(())
            })?;
        let Some(region) = parts.iter().map(|(part, _)| *part).reduce(Region::around) else { return Ok((None, stats)) };
        let mut values = Image::transparent(region.width, region.height)?;
        parts.iter().for_each(|(part, image)| values.put(image, [part.x - region.x, part.y - region.y]));
        if settings.model != Model::Composite && settings.is_post_shaded() {
            let unit = 1.0 / scene.scalars_per_value();
            values.pixels_mut().iter_mut().for_each(|[scalar, ..]| *scalar = (f64::from(*scalar) * unit) as f32);
        }
        Ok((Some((region, values)), stats))
    }

    /// Returns the view of the voxels of a scene.
    fn view(&self, scene: &Scene, camera: &Camera, settings: &Settings) -> ViewGeometry {
        let settings = Settings { kernel: settings.reconstruction_kernel(), ..settings.clone() };
        ViewGeometry::new(camera, scene.grid(), &settings, self.context.savings).of_held(scene.held())
    }

    /// Renders a picture into a texture of this renderer's device. Pixels that the volume does not reach become
    /// transparent. Returns the statistics, without the times of stages on the device.
    ///
    /// The painter tiles, and so `auto`, neither reads back nor waits for the device once the scene holds the splats of
    /// the picture. Quads reads the number of splats in each batch of sheets.
    ///
    /// The texture has the size of the camera's picture, one sample, four float or normalised channels, and the usage
    /// `RENDER_ATTACHMENT`. It receives display values with premultiplied alpha, stored unchanged in sRGB formats too.
    /// Commands are submitted when this returns; later submissions of the caller come after them.
    ///
    /// The frame is a whole picture without coloured surfaces.
    ///
    /// # Errors
    /// The errors of [`Self::render`], and [`Error::Setting`] if the frame or the texture does not fit. The texture may
    /// be transparent then.
    pub fn render_into(&self, scene: &Scene, frame: &Frame<'_>, texture: &wgpu::Texture) -> Result<Stats> {
        let Frame { camera, settings, .. } = *frame;
        let whole = Shot::whole(camera, settings);
        if frame.region != whole.wanted || matches!(frame.surfaces, Surfaces::Solids(_)) {
            return Err(Error::setting("frame", "a texture receives whole pictures without coloured surfaces"));
        }
        frame.check()?;
        let context = &self.context;
        check_whole(scene)?;
        present::check_target(texture, camera.size)?;
        let (view, pipeline) = context.guarded("opening the target", || {
            let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
            let format = texture.format();
            let pipeline = self.pipelines.get_or_make(format, || Ok(Present::new(context, format)))?;
            present::clear(context, &view);
            Ok((view, pipeline))
        })?;
        self.paint(
            scene,
            Shot { depths: Depths { solids: frame.depths(), halves: false }, ..whole },
            Recorder::untimed(context),
            &mut |recorder, painted, _, pixels| {
                pipeline.record(recorder, &view, painted, pixels)?;
                recorder.submit();
                Ok(())
            },
        )
    }

    /// Paints the regions of a picture that a part of it needs, one after the other, and passes each to `take`.
    fn paint(
        &self,
        scene: &Scene,
        Shot { camera, settings, wanted, depths, most_fragments }: Shot<'_>,
        mut recorder: Recorder<'_>,
        take: &mut Take<'_>,
    ) -> Result<Stats> {
        camera.validate()?;
        settings.validate()?;
        let context = &self.context;
        scene.check(context, settings)?;
        let noise = (settings.sharpness > 0.0)
            .then(|| settings.reconstruction())
            .transpose()?
            .map(|reconstruction| reconstruction.noise());
        let lights = settings.light_count();
        let settings = &Settings { kernel: settings.reconstruction_kernel(), ..scene.drawn_with(settings) };
        let before = context.traffic();
        camera.check_scale(scene.grid())?;
        let voxels = self.view(scene, camera, settings);
        let mut choice = PainterChoice::new(context, settings)?;
        let mut seconds = scene.take_seconds();
        let mut layers;
        let mut painting = loop {
            let room = choice.kind.room();
            let lattices = scene.lattices(&voxels, settings, camera, room.layers)?;
            if let Some(reason) = lattices.iter().find_map(|of| (room.refusal)(&of.view, &of.settings)) {
                choice = PainterChoice::instead(context, settings, reason)?;
                continue;
            }
            scene.check_memory(context, &lattices, settings)?;
            scene.keep_levels(&lattices);
            let layer = |lattice| self.layer(scene, &room, lattice, &mut seconds);
            layers = lattices.into_iter().map(layer).collect::<Result<Vec<PictureLayer>>>()?;
            let mut jobs: Vec<Job<'_>> = layers.iter().map(|layer| self.job(layer, depths, most_fragments)).collect();
            match (room.begin)(jobs.remove(0), jobs)? {
                Begun::Ready(painting) => break painting,
                Begun::Refused(reason) => choice = PainterChoice::instead(context, settings, reason)?,
            }
        };
        let (nearest, farthest) = (&layers[0], &layers[layers.len() - 1]);
        let of_layers = [nearest, farthest].map(|layer| layer.lattice.size.level());
        let levels = nearest.need.cut.map_or(of_layers, |cut| cut.levels.map(|level| level as f32));
        let mut stages = Vec::new();
        if seconds > 0.0 {
            stages.push(StageTime::host("classify", seconds));
        }
        // The kernels of the farthest layer are the largest.
        let bounds = farthest.lattice.view.projected_bounds().filter(|_| !painting.is_empty());
        // The regions of the whole picture, so that their bytes do not depend on the part.
        let regions = bounds.map_or_else(Vec::new, |bounds| {
            bounds.parts(self.part_side(painting.pixel_bytes(), painting.most_pixels()))
        });
        let regions: Vec<(Region, Region)> =
            regions.into_iter().filter_map(|region| Some((region, region.and(wanted)?))).collect();
        if !regions.is_empty() {
            let (made, seconds) = on_host(|| painting.make_pipelines());
            made?;
            stages.push(StageTime::host("pipelines", seconds));
            let (rendered, seconds) = on_host(|| {
                context.guarded("rendering", || {
                    (0_u32..).zip(&regions).try_for_each(|(done, &(region, part))| {
                        self.progress.check()?;
                        self.progress.report("rendering", f64::from(done) / regions.len() as f64);
                        let pixels = painting.paint(&mut recorder, region, part)?;
                        take(&mut recorder, region, part, &pixels)
                    })
                })
            });
            self.progress.report("rendering", 1.0);
            rendered?;
            stages.extend(context.guarded("reading timestamps", || recorder.times())?);
            stages.push(StageTime::host("frame", seconds));
        }
        let traffic = context.traffic();
        let drawables = || layers.iter().map(|layer| layer.drawable.as_ref());
        let bricks = drawables().map(|drawable| &drawable.bricks).fold(Bricks::default(), Bricks::and);
        let splats_padding = drawables().map(|drawable| drawable.copies).sum();
        let splats_kept = drawables().map(Drawable::splats).sum::<u64>() - splats_padding;
        Ok(Stats {
            adapter: context.info.clone(),
            painter: painting.stats(),
            painter_reason: choice.reason,
            model: settings.model,
            shading: if settings.is_post_shaded() { Shading::Post } else { Shading::Pre },
            perspective: voxels.is_perspective(),
            lights,
            clip: settings.clip.clone(),
            size: camera.size,
            pixels_covered: regions.iter().map(|(_, part)| part.area()).sum(),
            parts: regions.len() as u32,
            voxels: scene.grid().len(),
            splats_kept,
            splats_dropped: scene.grid().len().saturating_sub(splats_kept),
            splats_padding,
            bricks: bricks.all,
            bricks_uploaded: bricks.uploaded,
            bytes_uploaded: bricks.bytes,
            kernel_growth: voxels.max_growth(),
            levels,
            sharpness: settings.sharpness,
            noise,
            footprint_error: painting.footprint_error(),
            scene_bytes: drawables().map(Drawable::bytes).sum::<u64>()
                + nearest.post.as_ref().map_or(0, |p| p.light.bytes),
            frame_bytes: traffic.allocated - before.allocated,
            bytes_sent: traffic.sent - before.sent,
            dispatches: traffic.dispatches - before.dispatches,
            submissions: traffic.submissions - before.submissions,
            waits: traffic.waits - before.waits,
            bytes_resident: context.resident(),
            pipelines: traffic.pipelines,
            stages,
        })
    }

    /// Makes a layer of a picture for a painter. Adds the seconds that this took.
    fn layer(&self, scene: &Scene, room: &Room, lattice: Lattice, seconds: &mut f64) -> Result<PictureLayer> {
        let need = (room.need)(&lattice.view, &lattice.settings, lattice.weights);
        let (drawable, took) = scene.drawable(&self.context, &self.pipelines, &lattice, need, &self.progress)?;
        *seconds += took;
        let (post, took) = scene.post_shading(&self.context, &self.pipelines, &lattice, &self.progress)?;
        *seconds += took;
        let magnification = scene.magnification(&lattice, &drawable);
        let lists = if room.lists { drawable.lists(&self.context, &self.pipelines)? } else { Arc::default() };
        Ok(PictureLayer { lattice, need, post, magnification, drawable, lists })
    }

    fn job<'a>(&'a self, layer: &'a PictureLayer, depths: Depths<'a>, most_fragments: f64) -> Job<'a> {
        let PictureLayer { lattice, need, post, magnification, drawable, lists } = layer;
        Job {
            context: &self.context,
            pipelines: &self.pipelines,
            view: &lattice.view,
            settings: &lattice.settings,
            kept: &drawable.kept,
            voxels: drawable.voxels.as_ref(),
            lists,
            scalars: drawable.scalars.as_ref(),
            is_outgrown: drawable.is_outgrown,
            weights: lattice.weights,
            post: post.as_ref(),
            magnification: *magnification,
            padding: need.padding,
            depths,
            most_fragments,
        }
    }

    /// Returns the side in pixels of the largest part of a picture: within the adapter's textures and bindings,
    /// [`MAX_SHEET_BYTES`] of sheets, given their bytes a pixel, and `most` pixels.
    fn part_side(&self, sheet_bytes: u32, most: u64) -> u32 {
        let limits = &self.context.limits;
        let bindable = self.context.largest_buffer() / PIXEL_BYTES;
        let pixels = bindable.min(MAX_SHEET_BYTES / u64::from(sheet_bytes.max(1))).min(most);
        limits.max_texture_dimension_2d.min(pixels.isqrt() as u32).max(1)
    }
}

/// Refuses the scene of a brick.
fn check_whole(scene: &Scene) -> Result<()> {
    match scene.held() {
        Some(_) => Err(Error::setting("scene", "a brick has a partial picture, and no picture of its own")),
        None => Ok(()),
    }
}

/// A callback that receives the painted regions of a picture, with the parts of them that are needed.
type Take<'a> = dyn FnMut(&mut Recorder<'_>, Region, Region, &wgpu::Buffer) -> Result<()> + 'a;

/// Reads a region back and copies a part of it into an image of another region.
fn put(
    image: &mut Image,
    [of_image, painted, part]: [Region; 3],
    recorder: &mut Recorder<'_>,
    pixels: &wgpu::Buffer,
) -> Result<()> {
    let pixels = recorder.read_back("picture.staging", pixels, painted.area() * PIXEL_BYTES)?;
    recorder.resolve_times()?;
    recorder.submit();
    pixels.read(recorder.context, "rendering", |pixels| {
        const BYTES: usize = PIXEL_BYTES as usize;
        let columns = |of: Region| (part.x - of.x) as usize..(part.x - of.x + part.width) as usize;
        let first_row = |of: Region| (part.y - of.y) as usize;
        let rows = image.pixels_mut().par_chunks_exact_mut(of_image.width as usize).skip(first_row(of_image));
        let sources = pixels.par_chunks_exact(painted.width as usize * BYTES).skip(first_row(painted));
        rows.zip(sources).take(part.height as usize).for_each(|(row, source)| {
            let Range { start, end } = columns(painted);
            let row: &mut [u8] = bytemuck::cast_slice_mut(&mut row[columns(of_image)]);
            row.copy_from_slice(&source[start * BYTES..end * BYTES]);
        });
    })
}
