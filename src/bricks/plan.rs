//! The plan of a picture in bricks: the facts of the whole that bricks need, as JSON.

use std::ops::Range;

use glam::DAffine3;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::grid::{Chunks, owned};
use super::partial::{Look, Partial, Values, named};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::gpu::savings::Savings;
use crate::gpu::view::{Held, ViewGeometry};
use crate::image::Image;
use crate::kernel::NORMAL_REACH;
use crate::layers::Layers;
use crate::painters::choice::PainterKind;
use crate::renderer::Renderer;
use crate::settings::{Level, Model, Painter, QuadsSettings, Resolution, Settings, Sheets, TilesSettings};
use crate::stats::Stats;
use crate::transfer::TransferFunction;
use crate::volume::Grid;

/// The version of the JSON of a plan.
const FORMAT: &str = "voxsplat plan 1";

/// Voxels to either side that the smoothed normals of labels and masks depend on.
const SMOOTHED_REACH: u32 = 4;

/// A brick of a plan.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Brick {
    /// The voxels that the brick owns, along x, y and z.
    pub voxels: [Range<u32>; 3],
    /// The slice of the samples that it needs: its voxels and its halo, within the volume.
    pub held: [Range<u32>; 3],
    /// Its order: along every ray the keys of the bricks that the ray meets ascend.
    pub key: i64,
    /// The bytes of memory that drawing it takes at most: samples, visible voxels, textures and pixels. A slice whose
    /// voxels are all visible takes as much.
    pub bytes: u64,
}

/// A plan of a picture: lattice, camera, settings and bricks. It holds no samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    grid: Grid,
    camera: Camera,
    settings: Settings,
    /// The transfer function, if the picture has one layer of scalars.
    transfer: Option<TransferFunction>,
    brightest: [f64; 3],
    /// How far slabs and sheets reach beyond cuts.
    beyond: f64,
    bricks: Vec<Brick>,
    id: u64,
}

/// The JSON of a plan.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    format: String,
    dims: [u32; 3],
    to_world: DAffine3,
    camera: Camera,
    settings: Settings,
    transfer: Option<Value>,
    brightest: [f64; 3],
    beyond: f64,
    bricks: Vec<Brick>,
}

impl Plan {
    /// Returns the same settings with light that [`Self::new`] accepts: without shadows and occlusion.
    #[must_use]
    pub fn settings_for(settings: &Settings) -> Settings {
        let mut settings = settings.clone();
        if let Some(lighting) = &mut settings.lighting {
            (lighting.shadows, lighting.occlusion) = (0.0, None);
        }
        settings
    }

    /// Plans a picture of layers in bricks. Reads no samples: `layers` may be an overview on the same lattice, or the
    /// volume itself. The painter is fixed, with a ray for each pixel.
    ///
    /// # Errors
    /// [`Error::Setting`] if `chunks` belong to another lattice, a setting is out of range, or the picture cannot be
    /// made in bricks: light with shadows or occlusion, axis-aligned sheets, levels above 0. [`Error::Camera`] if the
    /// camera is not finite.
    pub fn new(layers: &Layers, chunks: &Chunks, camera: &Camera, settings: &Settings) -> Result<Self> {
        let grid = layers.grid();
        camera.validate()?;
        camera.check_scale(grid)?;
        settings.validate()?;
        if layers.plain().is_none() {
            Layers::check_settings(settings)?;
        }
        if chunks.dims() != grid.dims() {
            return Err(Error::setting("grid", format!("chunks of {:?} voxels for {:?}", chunks.dims(), grid.dims())));
        }
        check(settings)?;
        let drawn = Settings { kernel: settings.reconstruction_kernel(), level: Level::At(0), ..settings.clone() };
        let view = ViewGeometry::new(camera, grid, &drawn, Savings::default());
        let painter = painter(&view, &drawn)?;
        let kind = if matches!(painter, Painter::Quads(_)) { PainterKind::Quads } else { PainterKind::Tiles };
        let settings = Settings { level: Level::At(0), painter, ..settings.clone() };
        let [beyond, reach] = (kind.room().reach)(&view, &Settings { painter, ..drawn });
        let halo = beyond.max(reach).ceil() as u32 + normals_reach(layers, &settings) + filter_reach(&settings)?;
        let transfer = layers.plain().map(|(_, transfer)| transfer.clone());
        let brightest = match (painter, settings.lighting.is_some() || settings.is_post_shaded()) {
            (Painter::Tiles(_), false) => layers.brightest(),
            _ => [1.0; 3],
        };
        let bricks = chunks.in_order(grid, camera).into_iter().map(|(brick, key)| {
            let voxels = chunks.voxels(brick);
            let wider = |axis: usize| {
                let Range { start, end } = voxels[axis].clone();
                start.saturating_sub(halo)..end.saturating_add(halo).min(grid.dims()[axis])
            };
            let held = [0, 1, 2].map(wider);
            let samples: u64 = held.iter().map(|range| range.len() as u64).product();
            Brick { voxels, held, key, bytes: samples * bytes_of(layers, &settings) }
        });
        let bricks = bricks.collect();
        Ok(Self { grid: *grid, camera: *camera, settings, transfer, brightest, beyond, bricks, id: 0 }.identified())
    }

    /// Reads a plan from JSON.
    ///
    /// # Errors
    /// [`Error::Setting`] if the text is no plan, or one of another version.
    pub fn from_json(text: &str) -> Result<Self> {
        let refused = |reason: String| Error::setting("plan", reason);
        let document: Document = serde_json::from_str(text).map_err(|e| {
            refused(format!("line {} column {}: {}", e.line(), e.column(), voxsplat_volume::files::fault(&e)))
        })?;
        let Document { format, dims, to_world, camera, settings, transfer, brightest, beyond, bricks } = document;
        if format != FORMAT {
            return Err(refused(format!("{format:?}, expected {FORMAT:?}: plan again with this program")));
        }
        let grid = Grid::new(dims, to_world)?;
        camera.validate()?;
        settings.validate()?;
        check(&settings)?;
        let transfer = transfer.map(|value| TransferFunction::from_json(&value.to_string())).transpose()?;
        for Brick { voxels, held, .. } in &bricks {
            let fits = |axis: usize| {
                let (voxels, held) = (&voxels[axis], &held[axis]);
                held.start <= voxels.start
                    && voxels.start < voxels.end
                    && voxels.end <= held.end
                    && held.end <= dims[axis]
            };
            if !(0..3).all(fits) {
                return Err(refused(format!("a brick of {voxels:?} in {held:?}, expected parts of {dims:?} voxels")));
            }
        }
        Ok(Self { grid, camera, settings, transfer, brightest, beyond, bricks, id: 0 }.identified())
    }

    /// Returns the plan as JSON. [`Self::from_json`] reads the same plan back.
    ///
    /// # Errors
    /// [`Error::Setting`] if a number is not finite.
    pub fn to_json(&self) -> Result<String> {
        let failed = |e: serde_json::Error| Error::setting("plan", e.to_string());
        let transfer = self.transfer.as_ref().map(|transfer| serde_json::from_str(&transfer.to_json()));
        let document = Document {
            format: FORMAT.to_owned(),
            dims: self.grid.dims(),
            to_world: self.grid.to_world(),
            camera: self.camera,
            settings: self.settings.clone(),
            transfer: transfer.transpose().map_err(failed)?,
            brightest: self.brightest,
            beyond: self.beyond,
            bricks: self.bricks.clone(),
        };
        serde_json::to_string_pretty(&document).map(|text| text + "\n").map_err(failed)
    }

    /// The same plan with the number of its facts.
    fn identified(self) -> Self {
        // FNV-1a, the same on every machine.
        let bytes = format!("{self:?}");
        let id = bytes
            .bytes()
            .fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3));
        Self { id, ..self }
    }

    /// Returns a number that plans of other pictures or other bricks do not share.
    #[must_use]
    pub fn id(&self) -> u64 {
        self.id
    }

    /// Returns the bricks, front to back.
    #[must_use]
    pub fn bricks(&self) -> &[Brick] {
        &self.bricks
    }

    /// Returns a brick by its place in [`Self::bricks`].
    ///
    /// # Errors
    /// [`Error::Setting`] if there is no such brick.
    pub fn brick(&self, number: usize) -> Result<&Brick> {
        let last = self.bricks.len().saturating_sub(1);
        self.bricks.get(number).ok_or_else(|| Error::setting("brick", format!("{number}, expected 0 to {last}")))
    }

    /// Returns the lattice of the whole volume.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Returns the camera of the whole picture.
    #[must_use]
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Returns the settings of all bricks.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Returns the transfer function, if the picture is of one volume alone.
    #[must_use]
    pub fn transfer(&self) -> Option<&TransferFunction> {
        self.transfer.as_ref()
    }

    /// Returns the picture of a partial picture of all bricks.
    ///
    /// # Errors
    /// [`Error::Setting`] if the partial picture belongs to another plan or lacks bricks; [`Error::Memory`].
    pub fn picture(&self, merged: &Partial) -> Result<Image> {
        self.check_part(merged)?;
        if merged.bricks != (0..self.bricks.len()) {
            let reason = format!("{} of {} are there, expected all", named(&merged.bricks), self.bricks.len());
            return Err(Error::setting("parts", reason));
        }
        let transfer = match self.settings.model {
            Model::Minip => self.transfer.as_ref().map(TransferFunction::mirrored),
            _ => self.transfer.clone(),
        };
        let look = Look { settings: &self.settings, brightest: self.brightest, transfer: transfer.as_ref() };
        let view = self.view();
        merged.picture(&look, &self.camera, &(self.painter().room().families)(&view))
    }

    /// The view of the whole lattice.
    fn view(&self) -> ViewGeometry {
        let settings = Settings { kernel: self.settings.reconstruction_kernel(), ..self.settings.clone() };
        ViewGeometry::new(&self.camera, &self.grid, &settings, Savings::default())
    }

    fn painter(&self) -> PainterKind {
        if matches!(self.settings.painter, Painter::Quads(_)) { PainterKind::Quads } else { PainterKind::Tiles }
    }

    /// The number of families of rays.
    pub(super) fn families(&self) -> usize {
        (self.painter().room().families)(&self.view()).len()
    }

    /// Refuses a partial picture of another plan.
    pub(super) fn check_part(&self, part: &Partial) -> Result<()> {
        let fits = part.region.check_within(self.camera.size).is_ok()
            && part.bricks.end <= self.bricks.len()
            && part.values == Values::of_model(self.settings.model);
        if part.plan == self.id && fits {
            return Ok(());
        }
        Err(Error::setting("parts", format!("{} belongs to another plan: draw it by this one", named(&part.bricks))))
    }
}

/// Draws a brick of a plan, by its place in [`Plan::bricks`], of the slice of all layers that [`Brick::held`] names.
/// The place of the slice in the world is that of the plan, whatever its own grid says.
///
/// # Errors
/// [`Error::Setting`] if there is no such brick or the slice has other dimensions, and the errors of
/// [`Renderer::prepare_layers`] and [`Renderer::render`].
pub fn brick(renderer: &Renderer, plan: &Plan, number: usize, slice: &Layers) -> Result<(Partial, Stats)> {
    let Brick { voxels, held, .. } = plan.brick(number)?;
    let grid = plan.grid.part(held)?;
    if slice.grid().dims() != grid.dims() {
        let reason = format!("a slice of {:?} voxels, expected {:?}: {held:?}", slice.grid().dims(), grid.dims());
        return Err(Error::setting("brick", reason));
    }
    let owned = owned(&plan.grid, voxels, Held::OPEN);
    let first = [0, 1, 2].map(|axis| held[axis].start);
    let held = Held { first, dims: grid.dims(), owned, family: 0, beyond: plan.beyond };
    let mut scene = renderer.prepare_layers(&slice.on_grid(&grid)?, &plan.settings)?.within(plan.grid, held);
    let (region, pixels, mut stats) = renderer.render_partial(&scene, &plan.camera, &plan.settings)?;
    let mut families = vec![pixels];
    for family in 1..plan.families() {
        scene = scene.by_family(family);
        let (_, pixels, next) = renderer.render_partial(&scene, &plan.camera, &plan.settings)?;
        families.push(pixels);
        stats.stages.extend(next.stages);
    }
    let values = Values::of_model(plan.settings.model);
    Ok((Partial { plan: plan.id, bricks: number..number + 1, values, region, families }, stats))
}

/// Refuses settings whose pictures cannot be made in bricks.
fn check(settings: &Settings) -> Result<()> {
    if settings.casting().is_some() {
        let reason = "shadows and occlusion need the matter of other bricks: expected light without them";
        return Err(Error::setting("lighting", reason));
    }
    if let Level::At(1..) = settings.level {
        return Err(Error::setting("level", "bricks are drawn of voxels: expected auto or 0"));
    }
    if settings.quads().sheets == Sheets::Axis {
        return Err(Error::setting("sheets", "no brick owns an axis-aligned sheet: expected image"));
    }
    Ok(())
}

/// The painter of all bricks, with a ray for each pixel.
fn painter(view: &ViewGeometry, settings: &Settings) -> Result<Painter> {
    let refusal = || (PainterKind::Tiles.room().refusal)(view, settings);
    match settings.painter {
        quads @ Painter::Quads(_) => Ok(quads),
        Painter::Auto if refusal().is_some() => Ok(Painter::Quads(QuadsSettings::default())),
        _ => match refusal() {
            Some(reason) => Err(Error::setting("painter", reason)),
            None => Ok(Painter::Tiles(TilesSettings { resolution: Resolution::Full })),
        },
    }
}

/// The most bytes of memory for a sample of a slice.
fn bytes_of(layers: &Layers, settings: &Settings) -> u64 {
    let samples: u64 = layers.sample_bytes();
    // Splats on the host and on the device, and the packed texture of the painter tiles.
    let (splat, packed) = match (settings.is_post_shaded(), settings.lighting.is_some()) {
        (false, _) => (16, 8),
        (true, false) => (8, 4),
        (true, true) => (16, 8),
    };
    let filtered = if settings.sharpens().is_some() { 4 } else { 0 };
    samples + filtered + splat + packed
}

/// How far samples that change the normal or the gradient of a voxel are from it.
fn normals_reach(layers: &Layers, settings: &Settings) -> u32 {
    let thins = layers.plain().is_some_and(|(_, transfer)| !transfer.gradient_opacity().is_empty());
    match (settings.lighting.is_some(), layers.plain().is_some()) {
        (true, true) => NORMAL_REACH as u32,
        (true, false) => SMOOTHED_REACH,
        (false, false) => 1,
        (false, true) => u32::from(thins),
    }
}

/// How far samples that change a filtered sample are from it.
fn filter_reach(settings: &Settings) -> Result<u32> {
    Ok(settings.prefilter()?.map_or(0, |filter| filter.reach() as u32))
}
