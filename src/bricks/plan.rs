//! The plan of a picture in bricks: the facts of the whole that bricks need, as JSON.

use std::ops::Range;

use glam::DAffine3;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::grid::{Chunks, owned};
use super::hash::fnv1a;
use super::memory::Memory;
use super::needs::{SHAPED, check, filter_reach, host_needs, is_by_host, kind, normals_reach, of_device};
use super::partial::{Look, Partial, Values, named};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::gpu::savings::Savings;
use crate::gpu::view::{Held, ViewGeometry};
use crate::host::{Needs, check_drawn, is_uniform};
use crate::image::Image;
use crate::layers::Layers;
use crate::painters::painter::FamilyShare;
use crate::settings::{Model, Painter, Settings};
use crate::transfer::TransferFunction;
use crate::volume::Grid;

/// The version of the JSON of a plan.
const FORMAT: &str = "voxsplat plan 1";

/// A brick of a plan.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Brick {
    /// The voxels that the brick owns, along x, y and z.
    pub voxels: [Range<u32>; 3],
    /// The slice of the samples that the brick needs: its voxels and its halo, within the volume.
    pub held: [Range<u32>; 3],
    /// The order of the brick: along every ray the keys of the bricks that the ray meets ascend.
    pub key: i64,
    /// The predicted bytes of memory of a process that draws the brick by the processor or on software Vulkan, without
    /// its picture: 16 bytes a pixel and family of rays. On software Vulkan a brick without visible voxels takes some
    /// 30 MB less.
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
    /// The largest of each channel of the colours, to which a device clamps them.
    brightest: Option<[f64; 3]>,
    /// The reach of slabs and sheets beyond cuts.
    beyond: f64,
    /// Whether the lit matter of the volume is uniform, as of a mask.
    pub(super) is_uniform: bool,
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
    brightest: Option<[f64; 3]>,
    beyond: f64,
    #[serde(default)]
    is_uniform: bool,
    bricks: Vec<Brick>,
}

impl Plan {
    /// Returns `settings` with light that needs no sweep and that [`Self::new`] accepts: without shadows, and on a
    /// device without occlusion. Returns also the choice in words, if they differ.
    #[must_use]
    pub fn settings_for(settings: &Settings) -> (Settings, Option<&'static str>) {
        let (mut chosen, by_host) = (settings.clone(), is_by_host(settings));
        if let Some(lighting) = &mut chosen.lighting {
            lighting.shadows = 0.0;
            lighting.occlusion = lighting.occlusion.filter(|_| by_host);
        }
        let has_occlusion = |of: &Settings| of.lighting.as_ref().is_some_and(|lighting| lighting.occlusion.is_some());
        let choice = if has_occlusion(settings) != has_occlusion(&chosen) {
            "light without shadows and occlusion because they need the matter of other bricks"
        } else {
            "light without shadows because they need the matter of other bricks"
        };
        let differs = *settings != chosen;
        (chosen, differs.then_some(choice))
    }

    /// Plans a picture of a volume on `grid` in bricks. The painter is fixed: [`Painter::Auto`] is the processor unless
    /// this machine may have a GPU. It draws with a ray for each pixel.
    ///
    /// `overview` has the look of the picture: the volume, or one volume with fewer samples of the same type in the
    /// same place, such as a coarse level of a pyramid. One of 256 of its samples is read, to predict the memory of
    /// bricks. Several layers, labels and masks are on `grid` itself.
    ///
    /// # Errors
    /// [`Error::Setting`] if `chunks` belong to another lattice, a setting is out of range, or the picture cannot be
    /// made in bricks: light with shadows or occlusion by a device, shadows of a light at a place, exact shadows,
    /// axis-aligned sheets, a level whose cells the cuts divide or that scalars have. [`Error::Camera`] if the camera
    /// is not finite.
    pub fn new(overview: &Layers, grid: &Grid, chunks: &Chunks, camera: &Camera, settings: &Settings) -> Result<Self> {
        let layers = overview;
        camera.validate()?;
        camera.check_scale(grid)?;
        settings.validate()?;
        if layers.plain().is_none() {
            Layers::check_settings(settings)?;
            if layers.grid().dims() != grid.dims() {
                let reason = "an overview of several layers, labels or masks has the lattice of the volume";
                return Err(Error::setting("overview", reason));
            }
        }
        if chunks.dims() != grid.dims() {
            return Err(Error::setting("grid", format!("chunks of {:?} voxels for {:?}", chunks.dims(), grid.dims())));
        }
        let by_host = is_by_host(settings);
        let of_light = check(settings, by_host)?;
        let (settings, level, beyond, reach) = if by_host {
            check_drawn(settings)?;
            let settings = Settings { painter: Painter::Cpu, ..settings.clone() };
            let (level, Needs { level: number, reach, .. }) = host_needs(layers, grid, chunks, camera, &settings)?;
            (Settings { level, ..settings }, number, 0.0, reach)
        } else {
            of_device(layers, grid, chunks, camera, settings)?
        };
        let halo = reach + normals_reach(layers, &settings).max(of_light) + filter_reach(&settings);
        let is_uniform = match layers.plain() {
            Some((volume, transfer)) if settings.is_post_shaded() && settings.lighting.is_some() => {
                is_uniform(volume, transfer)?
            }
            _ => false,
        };
        let transfer = layers.plain().map(|(_, transfer)| transfer.clone());
        let brightest = match (settings.painter, settings.lighting.is_some() || settings.is_post_shaded()) {
            (Painter::Cpu, _) => None,
            (Painter::Tiles, false) => Some(layers.brightest()),
            _ => Some([1.0; 3]),
        };
        let bricks = chunks.in_order(grid, camera).into_iter().map(|(brick, key)| {
            let voxels = chunks.voxels(brick);
            let wider = |axis: usize| {
                let Range { start, end } = voxels[axis].clone();
                // Slices begin between cells.
                let start = start.saturating_sub(halo) >> level << level;
                start..end.saturating_add(halo).next_multiple_of(1 << level).min(grid.dims()[axis])
            };
            let held = [0, 1, 2].map(wider);
            Brick { voxels, held, key, bytes: 0 }
        });
        let bricks = bricks.collect();
        let memory = Memory::new(layers, grid, camera, &settings)?;
        let (grid, camera) = (*grid, *camera);
        let mut plan = Self { grid, camera, settings, transfer, brightest, beyond, is_uniform, bricks, id: 0 };
        // A few pixels show which families of rays a brick has.
        let step = (plan.camera.size[0].min(plan.camera.size[1]) / 16).max(1);
        let families = |brick: &Brick| plan.families_of(plan.held(brick), step).into_iter().filter(|seen| *seen);
        let bytes = plan.bricks.iter().map(|brick| memory.of(&brick.held, families(brick).count() > 1));
        let bytes: Vec<u64> = bytes.collect();
        plan.bricks.iter_mut().zip(bytes).for_each(|(brick, bytes)| brick.bytes = bytes);
        Ok(plan.identified())
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
        let Document { format, dims, to_world, camera, settings, transfer, .. } = document;
        let Document { brightest, beyond, is_uniform, bricks, .. } = document;
        if format != FORMAT {
            return Err(refused(format!("{format:?}, expected {FORMAT:?}: plan again with this program")));
        }
        let grid = Grid::new(dims, to_world)?;
        camera.validate()?;
        settings.validate()?;
        check(&settings, settings.painter == Painter::Cpu)?;
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
        Ok(Self { grid, camera, settings, transfer, brightest, beyond, is_uniform, bricks, id: 0 }.identified())
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
            is_uniform: self.is_uniform,
            bricks: self.bricks.clone(),
        };
        serde_json::to_string_pretty(&document).map(|text| text + "\n").map_err(failed)
    }

    /// Returns the plan with its id, a hash of all of its facts.
    fn identified(self) -> Self {
        let id = fnv1a(format!("{self:?}").bytes().map(u64::from));
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
        merged.picture(&look, &self.camera, &self.shares(&view))
    }

    /// Returns whether lights cast shadows, so that bricks need the light that enters them:
    /// [`sweep_light`](super::sweep_light).
    #[must_use]
    pub fn casts_shadows(&self) -> bool {
        self.settings.casting().is_some_and(|casting| casting.casts_shadows())
    }

    /// Returns the distance in voxels of the farthest samples on which the extinction of a voxel depends.
    pub(super) fn shaping(&self) -> u32 {
        SHAPED + filter_reach(&self.settings)
    }

    /// Returns the voxels of a brick's slice whose extinctions do not depend on voxels beside the slice.
    pub(super) fn shaped(&self, Brick { held, .. }: &Brick) -> [Range<u32>; 3] {
        let dims = self.grid.dims();
        std::array::from_fn(|axis| {
            let Range { start, end } = held[axis];
            let low = if start == 0 { 0 } else { start + self.shaping() };
            low..if end == dims[axis] { end } else { end.saturating_sub(self.shaping()) }
        })
    }

    /// Returns the view of the whole lattice.
    fn view(&self) -> ViewGeometry {
        let settings = Settings { kernel: self.settings.reconstruction_kernel(), ..self.settings.clone() };
        ViewGeometry::new(&self.camera, &self.grid, &settings, Savings::default())
    }

    /// Returns the share of each family of rays in pixels.
    fn shares<'a>(&self, view: &'a ViewGeometry) -> Vec<FamilyShare<'a>> {
        match self.settings.painter {
            Painter::Cpu => vec![Box::new(|_| 1.0)],
            _ => (kind(self.settings.painter).room().families)(view),
        }
    }

    /// Returns the number of families of rays.
    pub(super) fn families(&self) -> usize {
        self.shares(&self.view()).len()
    }

    /// Returns the part of the lattice that a scene of a brick holds, for the first family of rays.
    pub(super) fn held(&self, Brick { voxels, held, .. }: &Brick) -> Held {
        let first = [0, 1, 2].map(|axis| held[axis].start);
        let dims = [0, 1, 2].map(|axis| held[axis].len() as u32);
        Held { first, dims, owned: owned(&self.grid, voxels, Held::OPEN), family: 0, beyond: self.beyond }
    }

    /// Returns for each family of rays whether it has a share in pixels, `step` pixels apart, that a brick reaches.
    pub(super) fn families_of(&self, held: Held, step: u32) -> Vec<bool> {
        let whole = self.view();
        let families = self.shares(&whole);
        let Some(bounds) = self.view().of_held(Some(held)).projected_bounds() else {
            return vec![false; families.len()];
        };
        // Kernels of cells reach a little farther than kernels of voxels.
        const MARGIN: u32 = 16;
        let [width, height] = self.camera.size;
        let columns = bounds.x.saturating_sub(MARGIN)..(bounds.x + bounds.width + MARGIN).min(width);
        let rows = bounds.y.saturating_sub(MARGIN)..(bounds.y + bounds.height + MARGIN).min(height);
        let apart = |pixels: &Range<u32>| pixels.clone().step_by(step as usize);
        let has = |share: FamilyShare<'_>| apart(&rows).any(|y| apart(&columns).any(|x| share([x, y]) > 0.0));
        families.into_iter().map(has).collect()
    }

    /// Refuses a partial picture of another plan.
    pub(super) fn check_part(&self, part: &Partial) -> Result<()> {
        let fits = part.size == self.camera.size
            && part.bricks.end <= self.bricks.len()
            && part.families.len() == self.families()
            && part.values == Values::of_model(self.settings.model);
        if part.plan == self.id && fits {
            return Ok(());
        }
        Err(of_another_plan(part))
    }
}

/// The error of a partial picture of another plan.
pub(super) fn of_another_plan(part: &Partial) -> Error {
    let belongs = if part.bricks.len() == 1 { "belongs" } else { "belong" };
    Error::setting("parts", format!("{} {belongs} to another plan: draw it by this one", named(&part.bricks)))
}
