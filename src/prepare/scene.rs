//! A volume prepared on a device.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use glam::DAffine3;

use super::cells::{self, CellSize};
use super::drawable::{LastValue, PostShaded, PreShaded};
use super::lattice::Lattice;
use super::levels::ScalarNeed;
use super::light_volume::{self, FallenLight, LitScalars};
use super::memory::{self, Drawn};
use super::scalar_cells::{self, Coarse};
use super::scalars::{EmissionKey, magnification};
use super::shadows::Shadows;
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::gpu::cache::Cache;
use crate::gpu::context::Context;
use crate::gpu::drawable::Drawable;
use crate::gpu::held_samples::HeldSamples;
use crate::gpu::light_volume::{LightVolume, PostShading};
use crate::gpu::transfer::TransferTable;
use crate::gpu::view::{Fade, Held, ViewGeometry, Weights};
use crate::kernel::{Kernel, Normalization};
use crate::layers::Layers;
use crate::lighting::{Lighting, Normals, shadow};
use crate::progress::Progress;
use crate::settings::{Level, MAX_LEVEL, Model, Settings};
use crate::stats::on_host;
use crate::transfer::bins::VisibleValues;
use crate::transfer::scalars::Reduction;
use crate::transfer::{Resolution, TransferFunction};
use crate::volume::{Grid, Volume};

/// The largest number of units of a transfer function to a local length: products with it stay in the range of f32.
const MOST_PER_UNIT: f64 = 1e30;

/// A volume prepared on the device of the [`Renderer`](crate::renderer::Renderer) that prepared it.
pub struct Scene {
    content: Content,
    grid: Grid,
    /// The voxels of the grid that the scene holds; `None`: all of them.
    held: Option<Held>,
    weights: Weights,
    /// Seconds of preparation that no picture has reported yet, as the bits of an f64.
    seconds: AtomicU64,
    /// The [`Context::id`] of the device that holds the scene.
    device: u64,
    /// The value in place of NaN and infinite ones, if there are any.
    absent: Option<f64>,
    /// The properties of the picture whose memory was last found to suffice.
    foreseen: Mutex<Option<Drawn>>,
}

/// The content of a scene on the device.
enum Content {
    /// Classified voxels or cells.
    Splats(Box<PreShaded>),
    /// Scalars, classified when they have been reconstructed.
    Scalars(Box<PostShaded>),
}

/// Returns the number of cells of a level before the first voxel of a lattice.
fn cells_beyond(grid: &Grid, cells: &Grid, size: CellSize) -> u32 {
    (cells.dims()[0] - size.cells(grid.dims()[0])) / 2
}

/// Returns the weights of the splats of layers.
fn weights(layers: &Layers, grid: &Grid, lit: bool) -> Weights {
    Weights {
        max: layers.max_density(),
        unit: layers.unit() / grid.unit(),
        // Light may turn any colour white.
        brightest: if lit { [1.0; 3] } else { layers.brightest() },
    }
}

fn shows(settings: &Settings) -> VisibleValues {
    match settings.model {
        // The volume of a minimum is mirrored.
        Model::Mip | Model::Minip => VisibleValues::Largest,
        Model::Average => VisibleValues::Mean,
        Model::Composite | Model::Xray => VisibleValues::Opaque,
    }
}

impl Scene {
    fn new(context: &Context, content: Content, grid: Grid, weights: Weights, seconds: f64) -> Self {
        let seconds = AtomicU64::new(seconds.to_bits());
        Self {
            content,
            grid,
            held: None,
            weights,
            seconds,
            device: context.id,
            absent: None,
            foreseen: Mutex::default(),
        }
    }

    /// Returns the scene, in which an invisible value replaces NaN and infinite ones.
    pub(crate) fn with_gaps(self, absent: f64) -> Self {
        Self { absent: Some(absent), ..self }
    }

    /// Makes a scene of classified voxels. The first picture classifies them, because the picture decides between
    /// voxels and cells.
    pub(crate) fn of_splats(context: &Context, layers: &Layers, normals: Option<Normals>) -> Self {
        let grid = *layers.grid();
        let weights = weights(layers, &grid, normals.is_some());
        Self::new(context, Content::Splats(Box::new(PreShaded::new(layers.clone(), normals))), grid, weights, 0.0)
    }

    /// Makes a scene of scalars: the part of post-shading that does not depend on the camera.
    pub(crate) fn of_scalars(
        context: &Context,
        volume: &Volume,
        transfer: &TransferFunction,
        settings: &Settings,
        progress: &Progress,
    ) -> Result<Self> {
        let shows = shows(settings);
        if settings.prefilter()?.is_some() {
            let layers = Layers::of_volume(volume, transfer);
            memory::check(&layers, &Drawn { filtered: true, ..Drawn::new(context, settings, CellSize::VOXEL) })?;
        }
        let (prepared, seconds) = on_host(|| {
            let volume = match settings.prefilter()? {
                Some(filter) => filter.apply::<f32>(volume, transfer.base(), progress)?,
                None => volume.clone(),
            };
            Ok::<_, Error>((volume.farthest_from(transfer.base())?, Resolution::new(transfer, &volume)?, volume))
        });
        let (largest, resolution, volume) = prepared?;
        let reduction = Reduction::new(transfer, largest);
        let weights = Weights { max: reduction.length(largest), unit: 1.0, brightest: [1.0; 3] };
        let grid = *volume.grid();
        let scalars = PostShaded {
            volume,
            sharpened: settings.sharpens(),
            transfer: transfer.clone(),
            reduction,
            resolution,
            model: settings.model,
            shows,
            kept: Cache::default(),
            light: LastValue::default(),
            emitted: std::array::from_fn(|_| LastValue::default()),
            samples: HeldSamples::default(),
            whole: false,
        };
        Ok(Self::new(context, Content::Scalars(Box::new(scalars)), grid, weights, seconds))
    }

    /// Replaces the transfer function. The samples that are on the device serve the new one.
    pub(crate) fn set_transfer(&mut self, transfer: &TransferFunction) -> Result<()> {
        if let Some(absent) = self.absent.filter(|&absent| !transfer.is_invisible([absent; 2])) {
            let reason = format!("shows {absent}, which stands for samples that are no numbers: prepare a new scene");
            return Err(Error::setting("transfer", reason));
        }
        match &mut self.content {
            Content::Scalars(scalars) => {
                let mirrored = (scalars.model == Model::Minip).then(|| transfer.mirrored());
                scalars.set_transfer(mirrored.unwrap_or_else(|| transfer.clone()))?;
                let largest = scalars.volume.farthest_from(scalars.reduction.base())?;
                self.weights.max = scalars.reduction.length(largest);
            }
            Content::Splats(voxels) => {
                voxels.set_transfer(transfer)?;
                self.weights = weights(&voxels.layers, &self.grid, voxels.normals.is_some());
            }
        }
        Ok(())
    }

    /// Refuses a picture of these lattices if there is no memory for it, before any is allocated.
    pub(crate) fn check_memory(&self, context: &Context, lattices: &[Lattice], settings: &Settings) -> Result<()> {
        let finest = lattices.iter().map(|lattice| lattice.size).min().unwrap_or(CellSize::VOXEL);
        self.foresee(Drawn::new(context, settings, finest))
    }

    /// Refuses a picture without enough memory, checked once for each kind of picture: the scene holds much of what the
    /// next one needs.
    fn foresee(&self, drawn: Drawn) -> Result<()> {
        let mut foreseen = self.foreseen.lock().unwrap_or_else(PoisonError::into_inner);
        if *foreseen == Some(drawn) || self.held.is_some() {
            return Ok(());
        }
        match &self.content {
            Content::Splats(voxels) => memory::check(&voxels.layers, &drawn)?,
            Content::Scalars(scalars) => {
                memory::check(&Layers::of_volume(&scalars.volume, &scalars.transfer), &drawn)?;
            }
        }
        *foreseen = Some(drawn);
        Ok(())
    }

    pub(crate) fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Returns the scene as a brick of a larger lattice.
    pub(crate) fn within(self, grid: Grid, held: Held) -> Self {
        Self { grid, held: Some(held), ..self }
    }

    /// Returns the brick, to be drawn by another family of rays.
    pub(crate) fn by_family(self, family: usize) -> Self {
        Self { held: self.held.map(|held| Held { family, ..held }), ..self }
    }

    pub(crate) fn held(&self) -> Option<Held> {
        self.held
    }

    /// Returns the number of scalars of shaders for each unit of value; 1 for classified voxels.
    pub(crate) fn scalars_per_value(&self) -> f64 {
        if let Content::Scalars(scalars) = &self.content { scalars.reduction.factor() } else { 1.0 }
    }

    /// Classifies the voxels of a pre-shaded scene before the first picture.
    pub(crate) fn classify(
        &self,
        context: &Context,
        pipelines: &Cache,
        settings: &Settings,
        progress: &Progress,
    ) -> Result<()> {
        if let Content::Splats(voxels) = &self.content {
            self.foresee(Drawn::new(context, settings, CellSize::VOXEL))?;
            let (_, seconds) = voxels.classified(context, pipelines, None, progress)?;
            self.seconds.store(seconds.to_bits(), Ordering::Relaxed);
        }
        Ok(())
    }

    /// Returns the lattices of a picture, the nearest first, given its view of the voxels. With `layers`, a picture
    /// through one eye may have several.
    pub(crate) fn lattices(
        &self,
        voxels: &ViewGeometry,
        settings: &Settings,
        camera: &Camera,
        layers: bool,
    ) -> Result<Vec<Lattice>> {
        if let Some(coarse) = self.coarse(voxels, settings)? {
            return Ok(vec![self.scalar_cells((coarse, voxels.max_growth(), None), voxels, settings, camera)?]);
        }
        let sizes = match (settings.level, &self.content) {
            (Level::At(level), _) => [CellSize::of_level(level); 2],
            (Level::Auto, Content::Scalars(scalars)) if layers => self.sizes_of_scalars(scalars, voxels, settings)?,
            (Level::Auto, _) if !settings.takes_cells() || !self.has_cells() => [CellSize::VOXEL; 2],
            (Level::Auto, _) => {
                let farthest = if layers { voxels.max_growth() } else { voxels.min_growth() };
                let depth = self.voxel_depth(settings);
                let size = |growth| cells::size_for(&settings.kernel, growth, &self.grid, depth);
                [voxels.min_growth(), farthest].map(size)
            }
        };
        let range = sizes[0]..=sizes[1];
        let mut all: Vec<CellSize> = match &self.content {
            Content::Splats(_) => CellSize::all().filter(|size| range.contains(size)).collect(),
            Content::Scalars(_) => scalar_cells::sizes().filter(|size| range.contains(size)).collect(),
        };
        // Rays are cheap, and the lit cells of a further layer cost more than they save: a frame of a dense 512^3 scan
        // took 31 ms in place of 20 (docs/measurements/2026-11-26-half-octaves.md).
        let costs = all.len() > 1;
        // Quads have the one size of the nearest kernels. Cells of 3 voxels erred by 6.4 of 255 beside a clipping
        // plane, through a field of view of 150 degrees.
        if costs || voxels.is_perspective() && !layers {
            all = all.into_iter().map(CellSize::whole).collect();
            all.dedup();
        }
        let following = all.iter().skip(1).copied().map(Some).chain([None]);
        let layers = all.iter().zip(following).enumerate();
        let shadow_level = all.first().map_or(0, |nearest| nearest.level() as u32);
        let lattice = |(number, (&size, next))| {
            let lattice = self.lattice(size, (number == 0, next), voxels, settings, camera)?;
            Ok(Lattice { shadow_level, ..lattice })
        };
        layers.map(lattice).collect()
    }

    /// Returns the sizes of the nearest and of the farthest cells of scalars through an eye.
    fn sizes_of_scalars(
        &self,
        scalars: &PostShaded,
        voxels: &ViewGeometry,
        settings: &Settings,
    ) -> Result<[CellSize; 2]> {
        let serves = settings.model == Model::Composite
            && voxels.is_perspective()
            && self.weights.max <= scalar_cells::MOST_SCALAR
            && !(settings.lighting.is_some() && scalars.has_plateaus()?);
        let depth = self.voxel_depth(settings);
        let is_thin = |size: &CellSize| serves && depth * size.voxels() <= scalar_cells::MOST_DEPTH;
        let largest = scalar_cells::sizes().skip(1).take_while(is_thin).last().unwrap_or(CellSize::VOXEL);
        let size = |growth| Coarse::new(&settings.kernel, growth, None).cells.min(largest);
        Ok([voxels.min_growth(), voxels.max_growth()].map(size))
    }

    /// Returns whether cells can stand for voxels.
    pub(crate) fn has_cells(&self) -> bool {
        !matches!(&self.content, Content::Splats(voxels) if voxels.layers.plain().is_none())
    }

    /// Returns the optical depth of the densest voxel along the longest axis of the lattice.
    fn voxel_depth(&self, settings: &Settings) -> f64 {
        let densest = match &self.content {
            Content::Splats(voxels) => self.weights.max / voxels.layers.unit(),
            Content::Scalars(scalars) if settings.model == Model::Composite => {
                let unit = scalars.transfer.unit_or(self.grid.min_spacing());
                let matter = scalars.transfer.clone().without_isosurfaces(&scalars.transfer.isosurfaces());
                TransferFunction::extinction(matter.max_opacity(), unit)
            }
            Content::Scalars(_) => 0.0,
        };
        let [x, y, z] = self.grid.spacing();
        densest * x.max(y).max(z) * settings.normalization.density(&settings.kernel)
    }

    /// Returns the lattice of cells of a size. The pair tells whether they are the nearest, and the size of the cells
    /// behind them.
    fn lattice(
        &self,
        size: CellSize,
        (is_nearest, behind): (bool, Option<CellSize>),
        voxels: &ViewGeometry,
        settings: &Settings,
        camera: &Camera,
    ) -> Result<Lattice> {
        let (settings, weights) = (settings.clone(), self.weights);
        let of_scalars = matches!(self.content, Content::Scalars(_));
        // Nearer kernels are as wide as the least that cells can have.
        let least = |size| match settings.level {
            _ if of_scalars => scalar_cells::right_growth(&settings.kernel, size),
            Level::At(_) => cells::least_growth(&settings.kernel, size),
            Level::Auto => cells::right_growth(&settings.kernel, size, self.voxel_depth(&settings)),
        };
        let growth = match size {
            CellSize::VOXEL => 1.0,
            // The same cells for all eyes.
            _ if of_scalars => least(size),
            _ => voxels.min_growth().max(least(size)),
        };
        let fade = (!is_nearest || behind.is_some()).then(|| {
            let ramp = |size: CellSize| voxels.ramp(size.voxels(), least(size)).map(|voxel| voxel / growth);
            Fade {
                begins: if is_nearest { Fade::NEAREST } else { ramp(size) },
                ends: behind.map_or(Fade::FARTHEST, ramp),
            }
        });
        let view_of = |grid: &Grid, settings: &Settings, grown| {
            ViewGeometry::of_cells(camera, grid, settings, voxels.savings, grown, fade)
        };
        let shadows = self.shadows(&settings);
        if size == CellSize::VOXEL {
            let view = view_of(&self.grid, &settings, 1.0).of_held(self.held);
            return Ok(Lattice { view, settings, weights, size, shadows, light: None, coarse: None, shadow_level: 0 });
        }
        if of_scalars {
            let coarse = Coarse::new(&settings.kernel, growth, Some(size));
            return self.scalar_cells((coarse, growth, fade), voxels, &settings, camera);
        }
        let grid = cells::grid_of(&self.grid, size)?;
        let light = settings.lighting.is_some().then(|| voxels.splat_light(&settings));
        let kernel = cells::kernel_of(&settings.kernel, growth, size);
        // Cells are divided by the integral of their kernel. The normalisation of voxels still applies on top.
        let denser = settings.normalization.density(&settings.kernel);
        let unit = weights.unit * self.grid.unit() / (grid.unit() * denser);
        let grown = growth / size.voxels();
        let of_cells = Settings { kernel, normalization: Normalization::Unit, lighting: None, ..settings };
        let settings = of_cells.with_sheets_of(grown);
        let faces = cells_beyond(&self.grid, &grid, size);
        let held = self.held.map(|held| {
            held.of_cells(size.voxels(), held.dims.map(|count| size.cells(count) + 2 * faces), f64::from(faces))
        });
        let view = view_of(&grid, &settings, grown).of_held(held);
        let weights = Weights { unit, ..weights };
        Ok(Lattice { view, settings, weights, size, shadows, light, coarse: None, shadow_level: 0 })
    }

    /// Returns the shadows on voxels. Cells use them too: shadows of cells erred by up to 25 of 255.
    fn shadows(&self, settings: &Settings) -> Option<Shadows> {
        let Content::Splats(voxels) = &self.content else { return None };
        let casting = settings.casting()?;
        let divisor = settings.normalization.divisor(&settings.kernel);
        let lattice = shadow::ShadowLattice::new(&self.grid, settings.kernel, divisor, voxels.layers.unit(), 1.0);
        Some(Shadows { casting, lattice, clip: settings.clip.sides(&self.grid) })
    }

    /// Returns the lattice of cells of scalars that stand for voxels with kernels of a growth, or of a larger one
    /// farther away.
    fn scalar_cells(
        &self,
        (coarse, growth, fade): (Coarse, f64, Option<Fade>),
        voxels: &ViewGeometry,
        settings: &Settings,
        camera: &Camera,
    ) -> Result<Lattice> {
        let (kernel, normalization) = (settings.kernel, settings.normalization);
        // Cells are divided by the integral of their kernel. The normalisation of voxels still applies on top.
        let denser = normalization.density(&kernel);
        let weights = Weights { unit: self.weights.unit / denser, ..self.weights };
        let grown = growth / coarse.size();
        let of_cells =
            Settings { kernel: coarse.kernel(&kernel, growth), normalization: Normalization::Unit, ..settings.clone() };
        let settings = of_cells.with_sheets_of(grown);
        let grid = coarse.grid(&self.grid)?;
        let mut view = ViewGeometry::of_cells(camera, &grid, &settings, voxels.savings, grown, fade);
        // Cells at the faces may reach beyond the faces.
        view.faces = voxels.faces / coarse.size();
        Ok(Lattice {
            view,
            settings,
            weights,
            size: coarse.cells,
            shadows: None,
            light: None,
            coarse: Some((coarse, kernel, normalization)),
            shadow_level: coarse.cells.level() as u32,
        })
    }

    /// Returns the cells of scalars that stand for voxels along parallel rays; `None`: voxels, or the cells of
    /// [`ScalarNeed::cut`].
    fn coarse(&self, voxels: &ViewGeometry, settings: &Settings) -> Result<Option<Coarse>> {
        let Content::Scalars(scalars) = &self.content else { return Ok(None) };
        let at = |cells| Coarse::new(&settings.kernel, voxels.max_growth(), cells);
        match settings.level {
            Level::At(0) => Ok(None),
            Level::At(_) if voxels.is_perspective() => {
                let reason = "post-shading through one eye takes its levels by depth: expected auto or 0".to_owned();
                Err(Error::Setting { name: "level", reason })
            }
            Level::At(level) => Ok(Some(at(Some(CellSize::of_level(level))))),
            Level::Auto => {
                let most = 2.0 * scalar_cells::least_growth(&settings.kernel, CellSize::LARGEST);
                let serves = !voxels.is_perspective()
                    && voxels.max_growth() < most
                    && self.weights.max <= scalar_cells::MOST_SCALAR;
                let dense = |cells: Coarse| self.voxel_depth(settings) * cells.size() > scalar_cells::MOST_DEPTH;
                let fine = Coarse::fine(&settings.kernel, voxels.max_growth());
                let cells = Some(at(None)).map(|cells| if dense(cells) { fine } else { cells });
                let cells = cells.filter(|cells| serves && cells.cells > CellSize::VOXEL);
                let lit = cells.is_some() && settings.lighting.is_some();
                Ok(if lit && scalars.has_plateaus()? { None } else { cells })
            }
        }
    }

    /// Returns the largest factor by which the reconstruction of a lattice magnifies scalars; `None` for classified
    /// voxels, and for lists of scalars that serve other transfer functions too, whose visible ones are not found
    /// again.
    pub(crate) fn magnification(&self, lattice: &Lattice, drawable: &Drawable) -> Option<f64> {
        let Content::Scalars(scalars) = &self.content else { return None };
        let (kernel, normalization) = lattice.kernel_of_voxels();
        (!scalars.whole || drawable.scalars.is_some()).then(|| magnification(&kernel, normalization))
    }

    /// Returns the settings with which painters draw the scene. If extinction depends on reconstructed gradients, they
    /// have a light that changes no colour, because only lit scenes have gradients.
    pub(crate) fn drawn_with(&self, settings: &Settings) -> Settings {
        let mut settings = settings.clone();
        if let Content::Scalars(scalars) = &self.content
            && settings.model == Model::Composite
            && !scalars.transfer.gradient_opacity().is_empty()
        {
            settings.lighting.get_or_insert_with(Lighting::flat);
        }
        settings
    }

    /// Drops the cells of all sizes but the sizes of these lattices.
    pub(crate) fn keep_levels(&self, lattices: &[Lattice]) {
        let is_kept = |number: usize| lattices.iter().any(|lattice| lattice.size.number() == number);
        let left = |number: &usize| !is_kept(*number);
        match &self.content {
            Content::Splats(voxels) => (0..CellSize::COUNT).filter(left).for_each(|n| voxels.cells[n].clear()),
            Content::Scalars(scalars) => (0..CellSize::COUNT).filter(left).for_each(|n| scalars.emitted[n].clear()),
        }
    }

    /// Returns the preparation time in seconds once, then zero.
    pub(crate) fn take_seconds(&self) -> f64 {
        f64::from_bits(self.seconds.swap(0, Ordering::Relaxed))
    }

    /// Returns the table and the light of a lattice of a post-shaded scene, and the seconds that it took to find the
    /// light, 0 if the scene held it; `None` for classified voxels.
    pub(crate) fn post_shading(
        &self,
        context: &Context,
        pipelines: &Cache,
        lattice: &Lattice,
        progress: &Progress,
    ) -> Result<(Option<PostShading>, f64)> {
        let Content::Scalars(scalars) = &self.content else { return Ok((None, 0.0)) };
        let PostShaded { transfer, reduction, shows, resolution, .. } = scalars.as_ref();
        let table = || Ok(TransferTable::new(context, transfer, reduction, *shows, resolution));
        let table = scalars.kept.get_or_make((), table)?;
        // Lengths and gradients are in the local unit of the cells.
        let (local, unit) = (lattice.view.unit, transfer.unit_or(self.grid.min_spacing()));
        let per_unit = (local / unit).min(MOST_PER_UNIT) as f32;
        let gradient_lookup = table.gradient_lookup(local);
        let shading = |light, shadows, to_light| PostShading {
            table: Arc::clone(&table),
            per_unit,
            gradient_lookup,
            light,
            shadows,
            to_light,
        };
        let Some(casting) = lattice.settings.casting() else {
            let light = pipelines.get_or_make((), || Ok(LightVolume::none(context)))?;
            return Ok((Some(shading(light, false, DAffine3::IDENTITY)), 0.0));
        };
        let (kernel, normalization) = lattice.kernel_of_voxels();
        let (coarse, grid) = self.lit_cells(context, &kernel, lattice.shadow_level)?;
        let denser = normalization.density(&kernel);
        let cells = coarse.map_or(kernel, |(cells, growth)| cells.kernel(&kernel, growth));
        let voxels = coarse.map_or(1.0, |(cells, _)| cells.size());
        let lattice_of_light = shadow::ShadowLattice::new(&grid, cells, cells.integral() / denser, unit, voxels);
        let clip = lattice.settings.clip.sides(&grid);
        let shadows = Shadows { casting, lattice: lattice_of_light, clip };
        let (light, seconds) = scalars.light.get_or_make(shadows.clone(), PartialEq::eq, |held| {
            context.guarded("casting shadows", || {
                // All light on a place that may show lies between voxels so near. The light on an isosurface is the
                // light before it.
                let surfaces = transfer.isosurfaces();
                let ahead = if surfaces.is_empty() { 0.0 } else { f64::from(shadow::SURFACE_BIAS) };
                let coarse = coarse.map(|(cells, _)| cells);
                let of_cells = EmissionKey {
                    kernel,
                    normalization,
                    need: ScalarNeed { influence: kernel.radius() + 2.0 + ahead, zeros: true, ..ScalarNeed::NONE },
                    lit: !(transfer.gradient_opacity().is_empty() && surfaces.is_empty()),
                    coarse,
                    whole: false,
                    reduction: *reduction,
                };
                let of = (context, pipelines);
                let lit = LitScalars { grid: &grid, transfer, reduction, table: &table, unit, surfaces };
                let sample = || scalars.sampled(of, (&of_cells, true), progress);
                let list = || scalars.emit(of, (&of_cells, true), progress);
                FallenLight::new(of, held, &lit, (sample, list), &shadows, progress).map(Arc::new)
            })
        })?;
        let light = Arc::clone(&light.volume);
        let to_light = light.map_from(&lattice.coarse.map_or(Ok(self.grid), |(cells, ..)| cells.grid(&self.grid))?);
        Ok((Some(shading(light, true, to_light)), seconds))
    }

    /// Returns the lattice of the light of a post-shaded picture: voxels, or cells and the growth of the kernels that
    /// they stand for. It is no finer than the lattice of the picture and no larger than a light volume may be.
    fn lit_cells(&self, context: &Context, kernel: &Kernel, level: u32) -> Result<(Option<(Coarse, f64)>, Grid)> {
        let longest = context.limits.max_texture_dimension_3d;
        for level in level..=MAX_LEVEL {
            let growth = cells::least_growth(kernel, CellSize::of_level(level));
            let coarse = (level > 0).then(|| (Coarse::new(kernel, growth, Some(CellSize::of_level(level))), growth));
            let grid = coarse.map_or(Ok(self.grid), |(cells, _)| cells.grid(&self.grid))?;
            if grid.len() <= light_volume::MAX_CELLS && grid.dims().into_iter().all(|cells| cells <= longest) {
                return Ok((coarse, grid));
            }
        }
        Err(context.unsupported(format!(
            "holds volumes of at most {longest} voxels a side, and the light in this volume outgrows them: render \
             without shadows, or pre-shaded"
        )))
    }

    /// Refuses a scene of another device, and settings that it was not prepared for.
    pub(crate) fn check(&self, context: &Context, settings: &Settings) -> Result<()> {
        let error = |name, what: &str| Err(Settings::not_prepared(name, what));
        if self.device != context.id {
            return error("scene", "by another renderer, on another device");
        }
        match &self.content {
            Content::Splats(_) if settings.is_post_shaded() => error("shading", "for pre-shading"),
            Content::Splats(voxels) => {
                settings.check_normals(voxels.normals)?;
                voxels.layers.check(settings)
            }
            Content::Scalars(_) if !settings.is_post_shaded() => error("shading", "for post-shading"),
            Content::Scalars(scalars) if scalars.model != settings.model => error("model", "for another model"),
            Content::Scalars(scalars) if scalars.sharpened != settings.sharpens() => {
                error("sharpness", "for another sharpness, or for that of another kernel")
            }
            _ => Ok(()),
        }
    }

    /// Returns the splats of a lattice, and the seconds that it took to make them, 0 if the scene held them.
    pub(crate) fn drawable(
        &self,
        context: &Context,
        pipelines: &Cache,
        lattice: &Lattice,
        need: ScalarNeed,
        progress: &Progress,
    ) -> Result<(Arc<Drawable>, f64)> {
        match &self.content {
            Content::Splats(voxels) if lattice.size == CellSize::VOXEL => {
                voxels.classified(context, pipelines, lattice.shadows.as_ref(), progress)
            }
            Content::Splats(voxels) => voxels.cells(context, pipelines, lattice, progress),
            Content::Scalars(scalars) => scalars.emitted((context, pipelines), lattice, need, progress),
        }
    }
}
