//! A picture by rays: refusals, needs, preparation and regions.

use std::sync::{Arc, Mutex, PoisonError};

use super::axis::PrincipalAxis;
use super::pack::{self, Marking, Packable, Packed, Packing, TextureLayout, Voxel};
use super::parts::{Footprint, KernelSections, SlabKind};
use super::rays::{RaySetup, max_depth};
use super::{MAX_RADIUS, MAX_STRAIGHT_RADIUS, RayKind, RegionPixels, STRAIGHT, Tiles, TilesKey};
use crate::error::Result;
use crate::gpu::layout::{self, CELL, MACROCELL, TILE};
use crate::gpu::recorder::Recorder;
use crate::gpu::view::{ViewGeometry, Weights};
use crate::kernel::Kernel;
use crate::painters::painter::Job;
use crate::prepare::levels::ScalarNeed;
use crate::settings::{Model, Settings};
use crate::stats::TilesStats;

/// The work of [`PLANE_TEXELS`] texels of a plane of a ray, in units of the work of a fragment of a splat: 16 bytes a
/// texel and some 800 operations, where a fragment has 150 and blends up to 8 sheets. Most planes of most rays are
/// skipped: an H100 takes 7 ms for 10^9 of them and 0.7 s for 10^8 fragments.
const PLANE_WORK: u64 = 1;
/// The work of [`PLANE_TEXELS`] texels of a plane of a ray of scalars: two slabs with three moments each, classified in
/// pieces.
const SCALAR_PLANE_WORK: u64 = 3;
/// The number of texels of a plane that rays along m read by the default kernel: 5 rows of 3.
const PLANE_TEXELS: u64 = 15;
/// The work of a plane that clipping cuts, in planes: the sums of its kernels up to the cut are added, each by its
/// section.
const CUT_WORK: u64 = 3;

/// The optical depth of a voxel from which on parts of kernels are parabolas. Fitted by lines they err by 0.13 of 255
/// (rms) there, and by 0.9 at 2.3.
const DENSE: f64 = 0.7;

/// The least bytes of a pixel, which limit the regions of a picture and so the number of rays that march at a time.
const MIN_PIXEL_BYTES: u32 = 16;

/// The largest scalar that post-shading draws; visible ones are within 2. The parts of a single kernel err by some
/// hundredths of its scalar where a ray touches its rim. Errors of many kernels cancel unless a value stands alone,
/// like a value for voxels without data.
const MAX_SCALAR: f64 = 4096.0;

/// The least radius of kernels of scalars, in voxels: the fitted parts of narrower kernels in slabs of half a plane err
/// by half (a maximum of gaussian:0.25,0.5 by 0.26, rms).
const MIN_SCALAR_RADIUS: f64 = 1.0;

/// The tolerance for rounding of radii at a limit.
const ROUNDING: f64 = 1.0 + 1e-6;

pub(super) fn refusal(view: &ViewGeometry, settings: &Settings) -> Option<String> {
    let growth = view.max_growth();
    if settings.kernel.radius() * growth > MAX_RADIUS * ROUNDING {
        let grown = if growth > 1.0 { ", and they have grown to the size of pixels" } else { "" };
        return Some(format!("tiles draws kernels that reach at most {MAX_RADIUS} voxels{grown}"));
    }
    if settings.is_post_shaded() && settings.kernel.radius() * growth < MIN_SCALAR_RADIUS {
        return Some("tiles classifies slabs half a plane thick, in which kernels under a voxel leave gaps".to_owned());
    }
    if !settings.is_post_shaded() && view.is_among_voxels() {
        return Some("tiles does not cut kernels at the eye, and the eye is among the voxels".to_owned());
    }
    None
}

/// Returns the reach of slabs and of voxels beyond cuts; see [`Room::reach`](crate::painters::painter::Room::reach).
pub(super) fn reach(view: &ViewGeometry, settings: &Settings) -> [f64; 2] {
    // The planes whose kernels have parts in a slab; as `REACH` of the shaders.
    let planes = match view.max_radius() / ROUNDING {
        radius if radius <= 2.0 => 2.0,
        radius if radius <= 3.0 && !settings.is_post_shaded() => 3.0,
        _ => 4.0,
    };
    // A slab is at most a plane thick. The slabs beside it shape it, and the lack of the two slabs before them moves on
    // to it. Rays move across by at most 1.1 voxels from plane to plane, and meet kernels within their radius across.
    let along = planes + 0.5 + 1.0 + 2.0;
    const LEAN: f64 = 1.1;
    let across = LEAN * (0.5 + 1.0 + planes) + view.max_radius();
    // Scalars are there if they may take part where a visible voxel does, so visible voxels matter farther on.
    let influence = if settings.is_post_shaded() { influence(view) } else { 0.0 };
    [1.0, along.max(across) + influence]
}

/// Returns how far the scalars of a scene must reach. A place is classified by the means of its slab and of the two
/// beside it. A slab is half a voxel plane thick, along a ray at most sqrt(3) / 2 voxels, so three are at most 2.6
/// voxels. They count as 3: the parts of kernels in slabs are fitted, and a fit fades a little later than its kernel.
/// The need does not depend on the direction, so that a turn needs no other splats.
pub(super) fn need(view: &ViewGeometry, settings: &Settings, _weights: Weights) -> ScalarNeed {
    if !settings.is_post_shaded() {
        return ScalarNeed::NONE;
    }
    let need = ScalarNeed::new(view, view.max_radius() + 2.0 / 3.0 * SLABS, influence(view));
    ScalarNeed { samples: true, ..need }
}

/// The assumed length of three slabs of scalars, in voxels.
const SLABS: f64 = 3.0;

/// Returns [`ScalarNeed::influence`] for three slabs.
fn influence(view: &ViewGeometry) -> f64 {
    2.0 * view.max_radius() + SLABS
}

/// Returns the rule by which splats mark macrocells. A slab counts if a kernel of a visible scalar may reach it. Two
/// slabs belong to the voxel that is nearest to the ray in their plane: along each axis they reach a voxel beyond it at
/// most, half for rounding and half for a lean of 1. So a voxel that is more than the radius and one away along an axis
/// does not reach them.
fn marking(job: &Job<'_>) -> Marking {
    let Job { view, settings, post, magnification, .. } = job;
    // Macrocells are numbered in the whole lattice with its copies beyond the faces.
    let offset = view.first().as_ivec3() - job.padding as i32;
    let offset = offset.to_array().map(|n| n.rem_euclid(MACROCELL as i32) as u32);
    let Some(post) = post else { return Marking { offset, ..Marking::OWN } };
    let [low, high] = post.table.invisible;
    // All scalars count for a mean, and for a maximum if those below the invisible ones are visible.
    let marks_all = match settings.model {
        Model::Composite | Model::Xray => low > high,
        Model::Mip | Model::Minip => low > f32::MIN,
        Model::Average => true,
    };
    let invisible = match magnification {
        Some(times) if !marks_all => [low, high].map(|end| (f64::from(end) / times) as f32),
        _ => Marking::OWN.invisible,
    };
    // For a mean all parts of a kernel count, also those fitted to slabs beyond its radius: only the sum of all parts
    // is exact. They lie up to REACH planes away (the shaders) along a ray that leans by at most 1.1.
    let radius = view.max_radius() / ROUNDING;
    let reach = match settings.model {
        Model::Average => 3 * if radius <= 2.0 { 2 } else { 4 },
        _ => radius.ceil() as u32,
    };
    // Whole cells, so that splats of the same cell mark the same cells.
    Marking { reach: reach.next_multiple_of(CELL), invisible, offset }
}

/// A picture by rays in progress.
pub(super) struct TilesPicture<'a> {
    pub(super) job: Job<'a>,
    /// The reconstruction kernel, along parallel rays with its growth.
    kernel: Kernel,
    footprint: Footprint,
    kind: SlabKind,
    voxel: Voxel,
    layout: TextureLayout,
    /// The voxels that are packed; `None`: there are none, and nothing is drawn.
    source: Option<Packable>,
    pub(super) lighting: layout::Lighting,
    /// The principal axes of the picture, the one with the largest share first.
    pub(super) axes: Vec<PackedAxis>,
    /// The parts of kernels that rays along each axis gather; empty before the first region.
    pub(super) sections: Vec<Arc<wgpu::Buffer>>,
    packed: Option<Vec<Arc<Packed>>>,
    /// The statistics of the rays of all regions so far.
    drawn: TilesStats,
}

/// A principal axis along which rays are marched, and the packing of the volume that these rays read.
pub(super) struct PackedAxis {
    pub(super) axis: PrincipalAxis,
    packing: Packing,
}

impl<'a> TilesPicture<'a> {
    /// Plans a picture. An error is the reason for a refusal: the volume does not fit into a texture, or the kernel's
    /// footprint is no polynomial.
    pub(super) fn new(job: Job<'a>) -> std::result::Result<Self, String> {
        let Job { context, view, settings, post, .. } = job;
        if settings.is_post_shaded() && job.weights.max > MAX_SCALAR && job.isosurfaces() == 0 {
            return Err(
                "tiles does not draw values far beyond all visible ones: parts of kernels are fitted, and a small \
                 part of such a value would show"
                    .to_owned(),
            );
        }
        if job.is_outgrown {
            return Err(
                "tiles has no room for the samples of this volume: draw bricks (voxsplat plan), or use cpu or \
                        quads"
                    .to_owned(),
            );
        }
        if view.held.is_some() && job.isosurfaces() > 0 {
            return Err("bricks have no isosurfaces".to_owned());
        }
        let kernel = settings.kernel.grown(view.parallel_growth());
        let footprint = Footprint::new(&kernel)
            .ok_or("tiles draws footprints that are polynomials of 8 terms to 5e-5, and this kernel's is none")?;
        let lights = settings.light_count();
        let voxel = match (settings.is_post_shaded(), lights) {
            (false, lights) => Voxel::Color { lights, shadows: settings.casting().is_some() },
            (true, 0) => Voxel::Scalar,
            (true, _) => Voxel::Gradient,
        };
        let dims = view.held_dims().map(|n| n + 2 * job.padding);
        let mut axes = PrincipalAxis::all(&view.camera, &view.grid);
        if let Some(held) = view.held {
            axes = axes.get(held.family).copied().into_iter().collect();
        }
        let whole = job.base_shows();
        let marking = marking(&job);
        let earlier = kept_volumes(&job)
            .map(|held| held.lock().unwrap_or_else(PoisonError::into_inner).clone())
            .unwrap_or_default();
        // The splats of all bricks serve every eye and every clip, and to pack anew is to allocate a gigabyte.
        let source = Packable::of(&job);
        let pages = source.as_ref().and_then(pack::occupied);
        let pack = |axis: &PrincipalAxis| {
            let boxes = source.iter().flat_map(Packable::boxes);
            let packing = Packing::new(context, boxes, (dims, whole), pages, axis.axes, (voxel, marking))?;
            // Voxels are packed over those under another transfer function.
            Some(earlier.first().and_then(|held| packing.in_box_of(&held.packing)).unwrap_or(packing))
        };
        let packings: Option<Vec<Packing>> = axes.iter().map(pack).collect();
        let packings = packings.ok_or("tiles packs the volume into a texture, and this volume does not fit")?;
        let layout = packings.first().map_or(TextureLayout::Box, |packing| packing.layout);
        let dense = max_depth(&job) > DENSE;
        let kind = match post {
            Some(_) => SlabKind::Scalars,
            None if dense => SlabKind::DenseColors,
            None => SlabKind::Colors,
        };
        let axes = axes.into_iter().zip(packings).filter(|(_, packing)| !packing.is_empty());
        let axes = axes.map(|(axis, packing)| PackedAxis { axis, packing });
        let (axes, lighting) = (axes.collect(), job.lighting());
        let drawn = TilesStats::default();
        let (sections, packed) = (Vec::new(), None);
        Ok(Self { job, kernel, footprint, kind, voxel, layout, source, lighting, axes, sections, packed, drawn })
    }

    fn key(&self) -> TilesKey {
        let growth = self.job.view.depth_growth().1;
        let rays = self.ray_kind();
        let mut constants = self.job.constants();
        constants.extend([
            ("GROWN", (growth > 1.0).into()),
            ("CURVED", (self.kind == SlabKind::DenseColors).into()),
            ("TERMS", self.footprint.terms()),
            ("TEXELS", self.row_texels()),
            ("REACH", self.reach()),
            ("ISOSURFACES", self.job.isosurfaces()),
            ("STRAIGHT", (rays == RayKind::Straight).into()),
            ("LAYERED", (rays == RayKind::Layered).into()),
            ("PAGED", (self.layout == TextureLayout::Pages).into()),
            ("ONE_WORD", (self.voxel == Voxel::Scalar).into()),
        ]);
        TilesKey {
            voxel: self.voxel,
            layout: self.layout,
            rays,
            source: self.source.as_ref().map(Packable::key),
            constants,
        }
    }

    /// Returns the number of texels of a row that reach a ray.
    fn row_texels(&self) -> u32 {
        // A ball of the lattice reaches as far along a row.
        let along_row = |axis: &PackedAxis| self.largest_radius() / (1.0 - axis.axis.lean.powi(2)).sqrt();
        // n texels serve a reach of up to n - 1/2 voxels; of the largest kernels, along the rays that lean most, it is
        // 5.9.
        let texels = self.axes.iter().map(along_row).fold(0.0, f64::max) + 0.5;
        texels.floor().clamp(2.0, 6.0) as u32 + 1
    }

    /// Returns the number of planes, to either side, whose kernels have parts in a slab.
    fn reach(&self) -> u32 {
        match self.largest_radius() / ROUNDING {
            radius if radius <= 2.0 => 2,
            radius if radius <= 3.0 && self.kind != SlabKind::Scalars => 3,
            _ => 4,
        }
    }

    /// Returns the radius of the largest kernels, in voxels.
    fn largest_radius(&self) -> f64 {
        self.job.view.depth_growth().1 * self.kernel.radius()
    }

    fn ray_kind(&self) -> RayKind {
        match self.axes.first() {
            _ if self.is_layered() => RayKind::Layered,
            Some(axis) if self.is_straight(axis) => RayKind::Straight,
            _ => RayKind::Pixels,
        }
    }

    /// Returns whether the picture has several layers.
    pub(super) fn is_layered(&self) -> bool {
        self.job.view.fade.is_some()
    }

    /// Returns whether rays run along m so closely that they meet all planes at the same place.
    fn is_straight(&self, PackedAxis { axis, .. }: &PackedAxis) -> bool {
        let planes = self.job.view.grid.dims()[axis.axes[2]];
        !self.job.view.is_perspective()
            && self.kernel.radius() <= MAX_STRAIGHT_RADIUS
            && axis.shear().abs().max_element() * f64::from(planes) < STRAIGHT
    }

    /// Returns the packed splats for each axis: packed for an earlier picture of the scene, or now.
    fn pack(&self, recorder: &mut Recorder<'_>, pipelines: &Tiles) -> Result<Vec<Arc<Packed>>> {
        let Job { view, settings, weights, .. } = self.job;
        let light = view.splat_light(settings);
        let held = kept_volumes(&self.job)?;
        let mut held = held.lock().unwrap_or_else(PoisonError::into_inner);
        let packed_light = self.voxel.is_lit().then_some(&light);
        let (Some(source), Some(packer)) = (&self.source, &pipelines.packer) else { return Ok(Vec::new()) };
        let is_same = |packed: &Arc<Packed>| {
            let is_served = self.axes.iter().any(|axis| packed.serves(axis.packing, source));
            is_served && packed.light.as_ref() == packed_light
        };
        let (reusable, spare): (Vec<_>, Vec<_>) = held.drain(..).partition(is_same);
        // Drop unusable packings first, so that old and new are never in memory together. Others are packed over:
        // textures that exist are not cleared first.
        let has_room = |packed: &Packed, axis: &PackedAxis| {
            packed.serves(axis.packing, source) || packed.has_room_for(axis.packing)
        };
        let spare = spare.into_iter().filter_map(Arc::into_inner);
        let mut spare: Vec<Packed> =
            spare.filter(|packed| self.axes.iter().any(|axis| has_room(packed, axis))).collect();
        let mut packed: Vec<Arc<Packed>> = Vec::new();
        for axis in &self.axes {
            let served = packed.iter().chain(&reusable).find(|packed| packed.serves(axis.packing, source));
            packed.push(match served.map(Arc::clone) {
                Some(packed) => packed,
                None => {
                    let over = spare.iter().position(|packed| has_room(packed, axis)).map(|i| spare.swap_remove(i));
                    let stored = axis.packing.stored();
                    Arc::new(stored.pack(recorder, (packer, source), &light, weights.max, over)?)
                }
            });
        }
        // Another thread may draw from these volumes as soon as it sees them: its commands must come after those that
        // pack them.
        if !packed.iter().all(|packed| reusable.iter().any(|held| Arc::ptr_eq(held, packed))) {
            recorder.submit();
        }
        held.clone_from(&packed);
        Ok(packed)
    }

    /// Returns the inputs of the rays along an axis.
    pub(super) fn setup<'s>(&'s self, axis: &'s PackedAxis) -> RaySetup<'s> {
        let PackedAxis { axis, packing, .. } = axis;
        let (job, footprint) = (&self.job, &self.footprint);
        RaySetup { job, axis, packing: *packing, kernel: self.kernel, footprint }
    }

    /// Returns the pipelines of the picture.
    pub(super) fn pipelines(&self) -> Result<Arc<Tiles>> {
        let key = self.key();
        self.job.pipelines.get_or_make(key.clone(), || Tiles::new(self.job.context, &key))
    }
}

/// Returns the volumes that were packed for the last picture of the same splats.
fn kept_volumes(job: &Job<'_>) -> Result<Arc<Mutex<Vec<Arc<Packed>>>>> {
    job.kept.get_or_make((), || Ok(Mutex::default()))
}

impl TilesPicture<'_> {
    /// Returns whether no matter can be visible.
    pub(super) fn is_empty(&self) -> bool {
        self.axes.is_empty() || self.source.is_none() || self.job.splats() == 0 && !self.job.base_shows()
    }

    /// Returns the bytes on the device for each pixel; see
    /// [`Painting::pixel_bytes`](crate::painters::painter::Painting::pixel_bytes).
    pub(super) fn pixel_bytes(&self) -> u32 {
        // The runs of a tile, two words each, count two and a half times: a binding holds at least half of the bytes of
        // a part of a picture, and tiles may extend beyond the part.
        let runs = |axis: &PackedAxis| (axis.packing.macrocells()[2] + 1) * 20;
        let per_pixel = |axis: &PackedAxis| runs(axis).div_ceil(TILE * TILE);
        self.axes.iter().map(per_pixel).fold(MIN_PIXEL_BYTES, u32::max)
    }

    /// Returns the work of a pixel in fragments of splats, averaged over the picture.
    pub(super) fn pixel_work(&self) -> u64 {
        let Job { view, .. } = self.job;
        let is_cut = self.job.is_cut() && self.job.post.is_none();
        let pixels = view.camera.size.map(f64::from).into_iter().product::<f64>();
        let planes = |axis: &PackedAxis| {
            let rays = (axis.axis.covered(&view.camera, &view.grid) * pixels).ceil() as u64;
            let planes = self.planes_of_layer(axis);
            // A ray is cut where it enters the clipped volume and where it leaves it.
            let cut = if is_cut { planes.min(u64::from(2 * (2 * self.reach() + 1))) } else { 0 };
            u128::from(rays) * u128::from(planes + CUT_WORK * cut)
        };
        let rows = 2 * self.largest_radius().ceil() as u64 + 1;
        let texels = rows * u64::from(self.row_texels());
        let each = if self.job.post.is_some() { SCALAR_PLANE_WORK } else { PLANE_WORK };
        let work: u128 = self.axes.iter().map(|axis| u128::from(each * texels) * planes(axis)).sum();
        (work / u128::from(PLANE_TEXELS * pixels as u64)) as u64
    }

    /// Returns the largest number of planes that a ray of an axis marches through: in a layer, the planes between the
    /// growths at which its share begins and ends, and the planes whose kernels reach them.
    fn planes_of_layer(&self, PackedAxis { axis, packing, .. }: &PackedAxis) -> u64 {
        let (view, planes) = (&self.job.view, u64::from(packing.dims[2]));
        let Some(fade) = view.fade else { return planes };
        let shear = axis.shear();
        let per_plane = axis.ordered(view.gradients[2] * view.growth.slope).dot(shear.extend(1.0)).abs();
        let held = (fade.ends[1] - fade.begins[0]).abs() / per_plane.max(f64::MIN_POSITIVE);
        planes.min((held as u64).saturating_add(2 * u64::from(self.reach())))
    }

    /// Paints a region behind the layers that have been painted.
    pub(super) fn paint(&mut self, recorder: &mut Recorder<'_>, canvas: &mut RegionPixels) -> Result<()> {
        let pipelines = self.pipelines()?;
        if self.sections.is_empty() {
            let Job { context, pipelines, view, .. } = self.job;
            let (most, of) = (view.depth_growth().1, (&self.kernel, self.kind));
            let sections =
                |axis: &PackedAxis| KernelSections::on_device((context, pipelines), of, &view.camera, &axis.axis, most);
            self.sections = self.axes.iter().map(sections).collect::<Result<_>>()?;
        }
        let packed = match self.packed.take() {
            Some(packed) => packed,
            None => self.pack(recorder, &pipelines)?,
        };
        let drawn = pipelines.draw(recorder, self, &packed, canvas)?;
        self.packed = Some(packed);
        self.drawn.rays += drawn.rays;
        self.drawn.marches = self.drawn.marches.max(drawn.marches);
        Ok(())
    }

    pub(super) fn footprint_error(&self) -> f64 {
        self.footprint.error
    }

    /// Returns the painter's part of the picture's statistics.
    pub(super) fn stats(&self) -> TilesStats {
        let per_plane = if self.job.post.is_some() { 2 } else { 1 };
        let (slabs, slab_thickness) = self.axes.first().map_or((0, 0.0), |PackedAxis { axis, packing, .. }| {
            (packing.dims[2] * per_plane, axis.slab() / f64::from(per_plane))
        });
        TilesStats {
            slabs,
            slab_thickness: slab_thickness * self.job.view.unit,
            packed_bytes: self.packed.as_deref().map_or(0, Packed::bytes_of),
            ..self.drawn
        }
    }
}
