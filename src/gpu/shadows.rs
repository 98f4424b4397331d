//! shadows: the light that arrives at visible voxels, on the device, without a wait: shaders/shadows_of_voxels.wgsl,
//! filter.wgsl, sweep.wgsl, converging.wgsl and around.wgsl; at the places of a box, box_light.wgsl. The twin of
//! `lighting/shadow.rs`, whose preparations it uses.
//!
//! The extinctions of voxels become a field over the box around them. A light is found for a few planes of the box at a
//! time, a part: they are filtered, rays add them up and carry their sums to the next part, and each voxel reads the
//! sums of its plane. So a part needs little memory besides the field and the light that arrives.

mod voxels;

pub(crate) use voxels::{Unlit, run};

use std::cell::RefCell;
use std::sync::{Arc, Mutex, PoisonError};

use bytemuck::Zeroable;
use glam::DVec4;

use super::cache::Cache;
use super::context::Context;
use super::layout::{ClipPlanes, Converging, LightBox, Sweep, clip_planes};
use super::light_volume::LightVolume;
use super::pipeline::{Binding, both, texture_view};
use super::recorder::{ComputePass, Recorder};
use super::scalar_field::ScalarField;
use super::shaders::{self, Shader};
use super::stage::{Constant, DynamicUniforms, Stage, for_each};
use crate::camera::clip::Side;
use crate::error::Result;
use crate::lighting::shadow::plan::{AroundPlan, ConvergingPlan, LightPlan, LightPlans, NearPlan, SweepPlan};
use crate::progress::Progress;
use crate::volume::Grid;

/// The largest number of bytes of the sums of the rays of a part with more than [`PLANES`] planes.
const SUMS: u64 = 128 << 20;
/// The least number of planes of a part, of which every number is a multiple: workgroups have up to so many planes.
const PLANES: usize = 8;
/// The largest number of planes of a part.
const MOST_PLANES: usize = 64;
/// The number of planes of a part of occlusion.
const AROUND_PLANES: usize = 32;
/// Columns and rows of a workgroup.
const GROUP: [u32; 2] = [32, 2];
/// The base 2 logarithm of the columns of a workgroup of columns and planes; if planes lie across x, which are
/// neighbours in memory.
const LANES: [u32; 2] = [5, 3];
/// Rows and columns of zeros at either end of a plane; ENDS in shaders/common/sweep.wgsl.
pub(super) const ENDS: usize = 2;

/// The stages of sweeps along directions and of occlusion. In
/// [`Stats::stages`](crate::stats::Stats::stages) all stages of shadows are part of `classify`.
struct ShadowStages {
    across: Stage,
    within: Stage,
    march: Stage,
    arrive: Stage,
    around: Stage,
}

/// The stages of sweeps to a place.
struct PlaceStages {
    march: Stage,
    arrive: Stage,
}

/// The stages that keep light at the voxels of a box.
struct BoxStages {
    keep: Stage,
    texels: Stage,
}

const CLASSIFY: &str = "classify";

/// Makes a stage of shadows with these constants.
fn stage(context: &Context, of: Shader, entry: &str, slots: &[Binding], constants: &[Constant]) -> Stage {
    Stage::new(context, of, (CLASSIFY, entry), slots, constants)
}

impl ShadowStages {
    fn new(context: &Context) -> Result<Self> {
        use Binding::{DynamicUniform, Read, Write};
        let filters = || {
            let entries = ["across", "within"].map(|entry| (CLASSIFY, entry));
            let filters = Stage::several(context, shaders::FILTER, entries, &[DynamicUniform, Read, Read, Write], &[]);
            let around = [DynamicUniform, Read, Read, Read, Read, Read, Write];
            (filters, stage(context, shaders::AROUND, "around", &around, &[]))
        };
        let sweeps = || {
            let rays = [DynamicUniform, Read, Read, Read, Write];
            let voxels = [DynamicUniform, Read, Read, Read, Write, Read, Read, Read];
            let march = stage(context, shaders::SWEEP, "march", &rays, &[]);
            let arrive = stage(context, shaders::SWEEP, "arrive", &voxels, &[]);
            [march, arrive]
        };
        let (([across, within], around), [march, arrive]) = both(context, filters, sweeps)?;
        Ok(Self { across, within, march, arrive, around })
    }
}

impl PlaceStages {
    fn new(context: &Context) -> Self {
        use Binding::{DynamicUniform, Read, Uniform, Write};
        let rays = [DynamicUniform, Uniform, Read, Read, Read, Write];
        let voxels = [DynamicUniform, Uniform, Read, Read, Read, Write, Read, Read, Read, Read];
        let march = stage(context, shaders::CONVERGING, "march_to_place", &rays, &[]);
        Self { march, arrive: stage(context, shaders::CONVERGING, "arrive_from_place", &voxels, &[]) }
    }
}

impl BoxStages {
    fn new(context: &Context) -> Self {
        use Binding::{Read, StorageTexture, Uniform, Write};
        let texels = StorageTexture(wgpu::TextureFormat::Rgba16Float, wgpu::TextureViewDimension::D3);
        let keep = stage(context, shaders::BOX_LIGHT, "keep_in_box", &[Uniform, Write, Read, Read], &[]);
        Self { keep, texels: stage(context, shaders::BOX_LIGHT, "texels", &[Uniform, Read, texels], &[]) }
    }
}

/// The buffers of the stages with the field of extinctions, for other lights on the same matter.
pub(crate) struct Buffers(Vec<(&'static str, wgpu::Buffer)>);

impl Buffers {
    /// Returns the bytes of all buffers.
    pub(crate) fn bytes(&self) -> u64 {
        self.0.iter().map(|(_, buffer)| buffer.size()).sum()
    }
}

/// Buffers of a device by their names, made when they are needed.
struct ScratchBuffers<'a> {
    context: &'a Context,
    held: RefCell<Vec<(&'static str, wgpu::Buffer)>>,
}

impl ScratchBuffers<'_> {
    /// Returns the buffer of this name, with at least `values` numbers.
    fn get(&self, name: &'static str, values: usize) -> Result<wgpu::Buffer> {
        let bytes = 4 * values as u64;
        let mut held = self.held.borrow_mut();
        if let Some((_, buffer)) = held.iter().find(|(of, buffer)| *of == name && buffer.size() >= bytes) {
            return Ok(buffer.clone());
        }
        held.retain(|(of, _)| *of != name);
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
        let buffer = self.context.buffer(name, bytes, usage)?;
        held.push((name, buffer.clone()));
        Ok(buffer)
    }
}

/// The planes of a sweep on the device.
struct SweepShape {
    /// Numbers of planes, rows and columns.
    dims: [usize; 3],
    /// Numbers of rows and columns of rays, for each direction.
    rays: [usize; 2],
    directions: usize,
    /// Number of planes of a part.
    together: usize,
    /// Number of filtered planes of a part.
    filtered: usize,
}

impl SweepShape {
    fn of_sweep(plan: &SweepPlan, dims: [usize; 3]) -> Self {
        let dims = plan.axes.map(|axis| dims[axis]);
        Self::of_rays(dims, [dims[1] + 3, dims[2] + 3], plan.factors.len())
    }

    fn of_converging(plan: &ConvergingPlan, dims: [usize; 3]) -> Self {
        Self::of_rays(plan.axes.map(|axis| dims[axis]), plan.size, 1)
    }

    fn of_rays(dims: [usize; 3], rays: [usize; 2], directions: usize) -> Self {
        let most = SUMS as usize / 4 / (rays[0] * rays[1] * directions);
        let together = (most.min(MOST_PLANES) / PLANES * PLANES).max(PLANES);
        Self { dims, rays, directions, together, filtered: together }
    }

    fn of_around(plan: &AroundPlan, [nx, ny, nz]: [usize; 3]) -> Self {
        let filtered = AROUND_PLANES + 2 * plan.halo();
        Self { dims: [nz, ny, nx], rays: [0; 2], directions: 1, together: AROUND_PLANES, filtered }
    }

    /// Returns the count of numbers of the filtered planes of a part, with their zeros.
    fn planes(&self) -> usize {
        self.filtered * (self.dims[1] + 2 * ENDS) * (self.dims[2] + 2 * ENDS)
    }

    /// Returns the number of sums of all rays at a plane.
    fn sums(&self) -> usize {
        self.rays[0] * self.rays[1] * self.directions
    }
}

/// The stencils of rays to places, on the device.
struct NearPlaces {
    steps: usize,
    direct: f32,
    /// The mean number of weights of a stencil.
    reads: usize,
    /// The rows of all stencils, their weights, their first rows and weights, and the table of sections.
    buffers: [wgpu::Buffer; 4],
}

impl NearPlaces {
    fn new(context: &Context, plans: &LightPlans) -> Result<Self> {
        let NearPlan { steps, direct, stencil, firsts } = plans.near_place();
        let upload = |bytes: &[u8]| context.upload("shadows.near", bytes, wgpu::BufferUsages::STORAGE);
        let buffers = [
            upload(bytemuck::cast_slice(&stencil.rows))?,
            upload(bytemuck::cast_slice(&stencil.weights))?,
            upload(bytemuck::cast_slice(&firsts))?,
            upload(bytemuck::cast_slice(plans.table()))?,
        ];
        let reads = stencil.weights.len() / (firsts.len() - 1);
        Ok(Self { steps, direct, reads, buffers })
    }
}

/// The shadows of all lights on a box of voxels.
struct ShadowJob<'a> {
    context: &'a Context,
    pipelines: &'a Cache,
    stages: Arc<ShadowStages>,
    plans: &'a LightPlans,
    scratch: ScratchBuffers<'a>,
    /// The extinctions of the voxels; `shares` are the shares of the light that arrives at them.
    field: wgpu::Buffer,
    shares: wgpu::Buffer,
    /// The weights of the filters of sweeps, across planes and within.
    filters: [wgpu::Buffer; 2],
}

/// The matter that casts shadows in a box of voxels: scalars, the numbers of points of their lattice, and the sides of
/// the casting matter.
pub(crate) type Field<'a> = (&'a ScalarField<'a>, [usize; 3], &'a [Side]);

/// The light that arrives at the voxels of a box, kept for other lights.
pub(crate) struct BoxLight {
    /// The first lattice point of the box, and its size.
    pub(crate) bounds: [[usize; 3]; 2],
    /// The buffers of the stages, with the shares in the form of splats.
    buffers: Buffers,
}

/// Returns the light on a box of places of `grid` as a texture, with the shares of `lights`, `MAX_CASTING` being the
/// ambient light, and with the held shares of other lights; `None` if the device has no room. `field` is read if no
/// light is held.
pub(crate) fn run_on_box(
    context: &Context,
    pipelines: &Cache,
    (grid, bounds): (&Grid, [[usize; 3]; 2]),
    (plans, lights): (&LightPlans, &[usize]),
    (held, field): (Option<BoxLight>, Option<Field<'_>>),
    progress: &Progress,
) -> Result<Option<(LightVolume, BoxLight)>> {
    let lights = planned(plans, lights);
    let voxels: usize = plans.dims().iter().product();
    if !fits(context, 8 * voxels as u64, plans, lights.iter().map(|(_, plan)| plan)) {
        return Ok(None);
    }
    let is_filled = held.is_some();
    let job = ShadowJob::new(context, pipelines, plans, held.map(|held| held.buffers))?;
    let stages = pipelines.get_or_make((), || Ok(BoxStages::new(context)))?;
    let kept = job.scratch.get("shadows.kept", 2 * voxels)?;
    let mut recorder = Recorder::untimed(context);
    if let Some((of, dims, clip)) = field.filter(|_| !is_filled) {
        recorder.clear(&job.field, job.field.size());
        let light_box = job.uniform(&job.casting(dims, clip))?;
        of.fill(&mut recorder, pipelines, [&light_box, &job.field])?;
    }
    job.each(&mut recorder, &lights, progress, &mut |recorder, light, plan| {
        let parameters = job.uniform(&LightBox { dims: plans.dims().map(|n| n as u32), ..job.share(light, plan) })?;
        let buffers = [&parameters, &kept, &job.field, &job.shares].map(wgpu::Buffer::as_entire_binding);
        stages.keep.run(recorder, &buffers, for_each(context, voxels as u64));
        Ok(())
    })?;
    let [low, size] = bounds.map(|point| point.map(|n| n as u32));
    let volume = LightVolume::stored(context, grid, low, size);
    let parameters = job.uniform(&LightBox { dims: plans.dims().map(|n| n as u32), ..LightBox::zeroed() })?;
    let [parameters, found] = [&parameters, &kept].map(wgpu::Buffer::as_entire_binding);
    let workgroups = size.map(|n| n.div_ceil(4));
    stages.texels.run(&mut recorder, &[parameters, found, texture_view(&volume.texture)], workgroups);
    recorder.submit();
    Ok(Some((volume, BoxLight { bounds, buffers: job.buffers() })))
}

/// Returns the plans of lights.
fn planned(plans: &LightPlans, lights: &[usize]) -> Vec<(usize, LightPlan)> {
    lights.iter().map(|&light| (light, plans.light(light))).collect()
}

/// Returns whether the buffers of the stages fit the device: one of `bytes` bytes, and the buffers of lights.
fn fits<'a>(
    context: &Context,
    bytes: u64,
    plans: &LightPlans,
    mut lights: impl Iterator<Item = &'a LightPlan>,
) -> bool {
    let bindable = context.largest_buffer();
    let most_groups = u64::from(context.limits.max_compute_workgroups_per_dimension);
    let dims = plans.dims();
    // Sheared rays take a row more a plane.
    let longest = dims.into_iter().fold(0, |sum, n| sum.max(n + MOST_PLANES + 4 * ENDS)) as u64;
    let voxels = dims.iter().try_fold(4_u64, |bytes, &n| bytes.checked_mul(n as u64));
    let fits = |values: usize| (4 * values as u64) <= bindable;
    let has_room = |shape: &SweepShape| {
        let longest = shape.rays.into_iter().max().unwrap_or(0) as u64;
        longest <= most_groups && fits(shape.planes()) && fits(shape.together * shape.sums())
    };
    let serves = |plan: &LightPlan| match plan {
        LightPlan::Full => true,
        LightPlan::Parallel(sweeps) => sweeps.iter().all(|sweep| has_room(&SweepShape::of_sweep(sweep, dims))),
        LightPlan::Converging(sweeps) => sweeps.iter().all(|sweep| has_room(&SweepShape::of_converging(sweep, dims))),
        LightPlan::Around(around) => has_room(&SweepShape::of_around(around, dims)),
    };
    longest <= most_groups && voxels.is_some_and(|bytes| bytes <= bindable) && bytes <= bindable && lights.all(serves)
}

/// A callback that keeps the found light of a plan.
type Keep<'a> = dyn FnMut(&mut Recorder<'_>, usize, &LightPlan) -> Result<()> + 'a;

impl<'a> ShadowJob<'a> {
    fn new(context: &'a Context, pipelines: &'a Cache, plans: &'a LightPlans, held: Option<Buffers>) -> Result<Self> {
        let stages = pipelines.get_or_make((), || ShadowStages::new(context))?;
        let voxels: usize = plans.dims().iter().product();
        let scratch = ScratchBuffers { context, held: RefCell::new(held.map_or_else(Vec::new, |Buffers(held)| held)) };
        let upload = |weights: &Vec<f32>| {
            context.upload("shadows.filter", bytemuck::cast_slice(weights), wgpu::BufferUsages::STORAGE)
        };
        let [across, within] = plans.filters();
        Ok(Self {
            context,
            pipelines,
            stages,
            plans,
            field: scratch.get("shadows.field", voxels)?,
            shares: scratch.get("shadows.shares", voxels)?,
            scratch,
            filters: [upload(&across)?, upload(&within)?],
        })
    }

    fn buffers(self) -> Buffers {
        Buffers(self.scratch.held.into_inner())
    }

    /// Records the light of each plan, and calls `keep` with it.
    fn each(
        &self,
        recorder: &mut Recorder<'_>,
        lights: &[(usize, LightPlan)],
        progress: &Progress,
        keep: &mut Keep<'_>,
    ) -> Result<()> {
        for (done, (light, plan)) in lights.iter().enumerate() {
            match plan {
                LightPlan::Parallel(sweeps) => {
                    for (number, sweep) in sweeps.iter().enumerate() {
                        self.sweep(recorder, sweep, number > 0)?;
                    }
                }
                LightPlan::Converging(sweeps) => {
                    let near = self.near_places()?;
                    for sweep in sweeps {
                        self.converging(recorder, sweep, &near)?;
                    }
                }
                LightPlan::Around(around) => self.around(recorder, around)?,
                LightPlan::Full => {}
            }
            keep(recorder, *light, plan)?;
            progress.report("casting shadows", (done + 1) as f64 / lights.len() as f64);
            progress.check()?;
        }
        Ok(())
    }

    /// Returns the stencils of rays to places, found once and kept.
    fn near_places(&self) -> Result<Arc<NearPlaces>> {
        let key = self.plans.near_key();
        let kept: Arc<Mutex<Option<Arc<NearPlaces>>>> = self.pipelines.get_or_make(key, || Ok(Mutex::default()))?;
        let lock = || kept.lock().unwrap_or_else(PoisonError::into_inner);
        let held = lock().clone();
        // Not made under a lock: the maker waits for a pool of threads, which may hand it work that takes the lock.
        let near = held.map_or_else(|| NearPlaces::new(self.context, self.plans).map(Arc::new), Ok)?;
        *lock() = Some(Arc::clone(&near));
        Ok(near)
    }

    /// Returns the place of a light among shares, and the factor of its shadows.
    fn share(&self, light: usize, plan: &LightPlan) -> LightBox {
        let strength = if matches!(plan, LightPlan::Full) { 0.0 } else { self.plans.strength(light) };
        let (word, shift) = ((light / 2) as u32, (light % 2 * 16) as u32);
        LightBox { strength, word, shift, ..LightBox::zeroed() }
    }

    /// Returns the box of the plans.
    fn of_plans(&self) -> LightBox {
        let dims = self.plans.dims().map(|n| n as u32);
        LightBox { low: self.plans.low().map(|n| n as i32), dims, ..LightBox::zeroed() }
    }

    /// Returns the box with the sides of matter that casts shadows, in a lattice of `dims` points.
    fn casting(&self, dims: [usize; 3], clip: &[Side]) -> LightBox {
        // Planes beyond the last one cut nothing.
        let inside = (0..ClipPlanes::default().len()).map(|_| DVec4::W);
        let mut planes = clip_planes(inside);
        let sides = clip_planes(clip.iter().map(|(gradient, value)| gradient.extend(*value)));
        planes[..clip.len()].copy_from_slice(&sides[..clip.len()]);
        LightBox { middle: dims.map(|n| (n - 1) as f32 / 2.0), clip_planes: planes, ..self.of_plans() }
    }

    fn uniform(&self, parameters: &LightBox) -> Result<wgpu::Buffer> {
        let usage = wgpu::BufferUsages::UNIFORM;
        self.context.upload("shadows.light_box", bytemuck::bytes_of(parameters), usage)
    }

    /// Splits a sweep across planes along these lattice axes into parts, without the planes that it skips.
    fn parts(&self, shape: &SweepShape, axes: [usize; 3], skipped: usize, common: Sweep) -> Vec<Sweep> {
        let [nx, ny, _] = self.plans.dims();
        let steps = axes.map(|axis| [1, nx, nx * ny][axis] as u32);
        let firsts = (skipped..shape.dims[0]).step_by(shape.together);
        let part = |first: usize| {
            let count = shape.together.min(shape.dims[0] - first);
            Sweep {
                steps,
                count: count as u32,
                dims: shape.dims.map(|n| n as u32),
                first: first as u32,
                lanes: LANES[usize::from(axes[0] == 0)],
                rays: shape.rays.map(|n| n as u32),
                directions: shape.directions as u32,
                filtered: (count + shape.filtered - shape.together) as u32,
                ..common
            }
        };
        firsts.map(part).collect()
    }

    /// Binds the filters of a field's planes, given their weights.
    fn filter(
        &self,
        uniforms: &DynamicUniforms,
        shape: &SweepShape,
        [across, within]: [&wgpu::Buffer; 2],
    ) -> Result<PlaneFilter<'_>> {
        let context = self.context;
        let [half, planes] = ["shadows.across", "shadows.planes"].map(|name| self.scratch.get(name, shape.planes()));
        let (half, planes) = (half?, planes?);
        let bind = |stage: &Stage, buffers: [&wgpu::Buffer; 3]| {
            let [weights, from, to] = buffers.map(wgpu::Buffer::as_entire_binding);
            stage.bind(context, &[uniforms.binding(), weights, from, to])
        };
        let across = bind(&self.stages.across, [across, &self.field, &half]);
        let within = bind(&self.stages.within, [within, &half, &planes]);
        Ok(PlaneFilter { stages: &self.stages, across, within, planes })
    }

    fn upload(&self, label: &str, values: &[impl bytemuck::NoUninit]) -> Result<wgpu::Buffer> {
        self.context.upload(label, bytemuck::cast_slice(values), wgpu::BufferUsages::STORAGE)
    }

    /// Records the light along directions that go together.
    fn sweep(&self, recorder: &mut Recorder<'_>, plan: &SweepPlan, adds: bool) -> Result<()> {
        let context = self.context;
        let shape = SweepShape::of_sweep(plan, self.plans.dims());
        let common =
            Sweep { before: plan.near as u32 + 1, ahead: plan.ahead.into(), adds: adds.into(), ..Sweep::zeroed() };
        let parts = self.parts(&shape, plan.axes, 0, common);
        let uniforms = DynamicUniforms::new(context, "shadows.sweep", &parts)?;
        let filter = self.filter(&uniforms, &shape, [&self.filters[0], &self.filters[1]])?;
        let [sums, carried] = self.sums(&shape)?;
        let words = |[(row, down), (column, right)]: [(i64, f32); 2]| {
            [row as i32, down.to_bits() as i32, column as i32, right.to_bits() as i32]
        };
        let places: Vec<[i32; 4]> = plan.places.iter().flatten().map(|place| words(*place)).collect();
        let factors: Vec<[f32; 4]> =
            plan.factors.iter().map(|&[planes, all, share]| [planes, all, share, 0.0]).collect();
        let places = self.upload("shadows.places", &places)?;
        let stencil = self.upload("shadows.stencil", &plan.stencil.rows)?;
        let weights = self.upload("shadows.weights", &plan.stencil.weights)?;
        let factors = self.upload("shadows.factors", &factors)?;
        let march = [&places, &filter.planes, &carried, &sums];
        let march = self.bind(&self.stages.march, &uniforms, &march);
        let arrive = [&places, &self.field, &sums, &self.shares, &stencil, &weights, &factors];
        let arrive = self.bind(&self.stages.arrive, &uniforms, &arrive);
        let rays = |part: &Sweep| {
            let [first, last] = [part.first, part.first + part.count - 1].map(|plane| &plan.places[plane as usize]);
            // The rows and columns that the rays of a direction pass between the first plane and the last.
            let drift = |axis: usize| {
                first.iter().zip(last).fold(0, |most, (a, b)| most.max(a[axis].0.abs_diff(b[axis].0))) as u32
            };
            let [_, rows, columns] = part.dims;
            groups(columns + 3 + drift(1), rows + 3 + drift(0), part.directions)
        };
        let passes = Passes {
            uniforms: &uniforms,
            filter: &filter,
            march: (&self.stages.march, &march),
            arrive: (&self.stages.arrive, &arrive),
            sums: [&sums, &carried],
            carried: 4 * shape.sums() as u64,
            reads: 26 * shape.directions + plan.stencil.weights.len(),
        };
        passes.record(recorder, &parts, &rays);
        Ok(())
    }

    /// Returns the buffers of the sums of the rays of a part, and of their sums at the last plane of the part before.
    fn sums(&self, shape: &SweepShape) -> Result<[wgpu::Buffer; 2]> {
        let sums = self.scratch.get("shadows.sums", shape.together * shape.sums())?;
        Ok([sums, self.scratch.get("shadows.carried", shape.sums())?])
    }

    /// Binds parts and buffers.
    fn bind(&self, stage: &Stage, uniforms: &DynamicUniforms, buffers: &[&wgpu::Buffer]) -> wgpu::BindGroup {
        let buffers = buffers.iter().map(|buffer| buffer.as_entire_binding());
        stage.bind(self.context, &std::iter::once(uniforms.binding()).chain(buffers).collect::<Vec<_>>())
    }

    /// Records the light from a place on the voxels of one side of a box.
    fn converging(&self, recorder: &mut Recorder<'_>, plan: &ConvergingPlan, near: &NearPlaces) -> Result<()> {
        let context = self.context;
        let stages = self.pipelines.get_or_make((), || Ok(PlaceStages::new(context)))?;
        let shape = SweepShape::of_converging(plan, self.plans.dims());
        let common = Sweep { before: self.plans.near_planes() as u32 + 1, ahead: plan.ahead.into(), ..Sweep::zeroed() };
        let parts = self.parts(&shape, plan.axes, plan.skipped, common);
        let uniforms = DynamicUniforms::new(context, "shadows.sweep", &parts)?;
        let filter = self.filter(&uniforms, &shape, [&self.filters[0], &self.filters[1]])?;
        let [sums, carried] = self.sums(&shape)?;
        let places = self.upload("shadows.places", &plan.planes)?;
        let [to_world_plane, to_world_row, to_world_column] = plan.to_world;
        let [radius, integral, inverse_divisor] = self.plans.kernel();
        let place = Converging {
            place: plan.place,
            bias: self.plans.bias(),
            to_world_plane,
            radius,
            to_world_row,
            direct: near.direct,
            to_world_column,
            integral,
            origin: plan.origin,
            inverse_divisor,
            steps: near.steps as f32,
            strict: plan.strict.map(u32::from),
            ..Converging::zeroed()
        };
        let usage = wgpu::BufferUsages::UNIFORM;
        let place = context.upload("shadows.converging", bytemuck::bytes_of(&place), usage)?;
        let march = [&place, &places, &filter.planes, &carried, &sums];
        let march = self.bind(&stages.march, &uniforms, &march);
        let [stencil, weights, firsts, table] = &near.buffers;
        let arrive = [&place, &places, &self.field, &sums, &self.shares, stencil, weights, firsts, table];
        let arrive = self.bind(&stages.arrive, &uniforms, &arrive);
        let passes = Passes {
            uniforms: &uniforms,
            filter: &filter,
            march: (&stages.march, &march),
            arrive: (&stages.arrive, &arrive),
            sums: [&sums, &carried],
            carried: 4 * shape.sums() as u64,
            reads: 26 + near.reads,
        };
        recorder.clear(&carried, passes.carried);
        passes.record(recorder, &parts, &|Sweep { rays: [rows, columns], .. }| groups(*columns, *rows, 1));
        Ok(())
    }

    /// Records the ambient light that occluders let through.
    fn around(&self, recorder: &mut Recorder<'_>, plan: &AroundPlan) -> Result<()> {
        let context = self.context;
        let axes = [2, 1, 0];
        let shape = SweepShape::of_around(plan, self.plans.dims());
        let parts = self.parts(&shape, axes, 0, Sweep { before: plan.halo() as u32, ..Sweep::zeroed() });
        let uniforms = DynamicUniforms::new(context, "shadows.around", &parts)?;
        let weights = self.upload("shadows.filter", &plan.filter)?;
        let filter = self.filter(&uniforms, &shape, [&weights; 2])?;
        let rays = self.upload("shadows.rays", &plan.rays)?;
        let factors = self.upload("shadows.factors", &plan.shares)?;
        let weights = self.upload("shadows.weights", &plan.weights)?;
        let buffers = [&self.field, &filter.planes, &rays, &factors, &weights, &self.shares];
        let around = self.bind(&self.stages.around, &uniforms, &buffers);
        for (number, part) in (0..).zip(&parts) {
            let offset = uniforms.offset(number);
            let [_, rows, columns] = part.dims;
            let mut pass = recorder.compute_pass(CLASSIFY);
            filter.record(&mut pass, offset, part);
            self.stages.around.record(&mut pass, &around, &[offset], groups(columns, rows, part.count));
            drop(pass);
            recorder.worked(work(part, plan.weights.len()));
        }
        Ok(())
    }
}

/// The passes of the parts of a sweep.
struct Passes<'a> {
    uniforms: &'a DynamicUniforms,
    filter: &'a PlaneFilter<'a>,
    march: (&'a Stage, &'a wgpu::BindGroup),
    arrive: (&'a Stage, &'a wgpu::BindGroup),
    /// The sums of the rays of a part, and their sums at the last plane of the part before.
    sums: [&'a wgpu::Buffer; 2],
    /// The bytes of the sums of a plane.
    carried: u64,
    /// The count of numbers that a voxel reads.
    reads: usize,
}

impl Passes<'_> {
    /// Records all parts; `rays` returns the workgroups of the rays of a part.
    fn record(&self, recorder: &mut Recorder<'_>, parts: &[Sweep], rays: &dyn Fn(&Sweep) -> [u32; 3]) {
        let ([sums, carried], (march, of_rays), (arrive, of_voxels)) = (self.sums, self.march, self.arrive);
        for (number, part) in (0..).zip(parts) {
            let offset = self.uniforms.offset(number);
            if number > 0 {
                recorder.copy(sums, carried, 0, self.carried);
            }
            let [_, rows, columns] = part.dims;
            let mut pass = recorder.compute_pass(CLASSIFY);
            self.filter.record(&mut pass, offset, part);
            march.record(&mut pass, of_rays, &[offset], rays(part));
            arrive.record(&mut pass, of_voxels, &[offset], groups_across(part, columns, part.count, rows));
            drop(pass);
            recorder.worked(work(part, self.reads));
        }
    }
}

/// The filters of the planes of parts.
struct PlaneFilter<'a> {
    stages: &'a ShadowStages,
    across: wgpu::BindGroup,
    within: wgpu::BindGroup,
    /// The filtered planes of a part.
    planes: wgpu::Buffer,
}

impl PlaneFilter<'_> {
    fn record(&self, pass: &mut ComputePass<'_>, offset: u32, part: &Sweep) {
        let [_, rows, columns] = part.dims.map(|n| n + 2 * ENDS as u32);
        let across = groups_across(part, columns, part.filtered, rows);
        self.stages.across.record(pass, &self.across, &[offset], across);
        self.stages.within.record(pass, &self.within, &[offset], groups(columns, rows, part.filtered));
    }
}

/// Returns the workgroups for this number of columns and rows, times a third number.
fn groups(columns: u32, rows: u32, others: u32) -> [u32; 3] {
    [columns.div_ceil(GROUP[0]), rows.div_ceil(GROUP[1]), others]
}

/// Returns the workgroups for columns and planes of a part, times its rows.
fn groups_across(part: &Sweep, columns: u32, planes: u32, rows: u32) -> [u32; 3] {
    [columns.div_ceil(1 << part.lanes), planes.div_ceil(64 >> part.lanes), rows]
}

/// Returns the work of a part whose voxels read `reads` numbers, in fragments of splats, which take some 16 operations.
fn work(part: &Sweep, reads: usize) -> u64 {
    let [_, rows, columns] = part.dims.map(u64::from);
    u64::from(part.count) * rows * columns * (reads as u64 + 20) / 16
}
