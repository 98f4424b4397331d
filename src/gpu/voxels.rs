//! The visible voxels of a volume, of layers or of cells, on the device: samples that stages classify, or the words of
//! voxels that were classified before.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use bytemuck::Zeroable;
use voxsplat_volume::memory::reserved;

use super::cache::Cache;
use super::classify::VisibleVoxels;
use super::context::Context;
use super::held_samples::HeldSamples;
use super::kept_voxels::{FOUND, KeptVoxels};
use super::layout::{Classify, ControlPoint, MAX_BRICKS};
use super::recorder::max_work;
use super::samples::{BATCH, Bricks, Input, InputKey, ROWS};
use super::sender::send_bricks;
use super::stage::Constant;
use crate::error::Result;
use crate::lighting::{MAX_CASTING, Normals};
use crate::splats::brick::{BrickSplats, MadeBrick, bounds_of};
use crate::volume::BRICK_EDGE as EDGE;

/// Visible voxels on the device. A clone shares their memory.
#[derive(Clone)]
pub(crate) struct Voxels {
    /// The number that distinguishes the voxels from others of the program.
    pub(crate) id: u64,
    key: VoxelsKey,
    points: wgpu::Buffer,
    parameters: Classify,
    values: Arc<Vec<ValueBuffer>>,
    /// The visible voxels of each buffer of values.
    visible: Arc<Vec<VisibleVoxels>>,
    /// The packed normals of visible voxels, by buffer; `None`: there is no light or no room for them.
    normals: Option<Vec<wgpu::Buffer>>,
    /// The shares of light that arrive at visible voxels, 8 bytes each, by buffer; `None`: all light arrives.
    kept: Option<Vec<wgpu::Buffer>>,
}

/// The samples of some bricks, or the words of their visible voxels.
pub(super) struct ValueBuffer {
    /// The numbers in the volume of the bricks that the buffer serves, some of which may not be held; none of words.
    pub(super) bricks: Range<u32>,
    pub(super) buffer: wgpu::Buffer,
}

/// The form in which shaders read voxels; a key of pipelines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct VoxelsKey {
    input: InputKey,
    /// Whether voxels are words in place of samples.
    appearances: bool,
    kept_normals: bool,
    shadows: bool,
}

impl VoxelsKey {
    pub(crate) fn constants(self) -> impl Iterator<Item = Constant> {
        let Self { input, appearances, kept_normals, shadows } = self;
        let own = [("APPEARANCES", appearances), ("KEPT_NORMALS", kept_normals), ("SHADOWS", shadows)];
        input.constants().into_iter().chain(own.map(|(name, value)| (name, value.into())))
    }

    pub(super) fn has_shadows(self) -> bool {
        self.shadows
    }

    /// Returns the key of stages that read neither normals nor light.
    pub(super) fn unlit(self) -> Self {
        Self { kept_normals: false, shadows: false, ..self }
    }
}

/// A buffer of samples, with the visible voxels of its bricks.
pub(crate) struct SampledBuffer<'a> {
    /// The numbers in the volume of the buffer's bricks, some of which may not be held.
    pub(super) bricks: Range<u32>,
    pub(super) samples: &'a wgpu::Buffer,
    pub(super) visible: &'a VisibleVoxels,
    pub(super) normals: Option<&'a wgpu::Buffer>,
    pub(super) kept: Option<&'a wgpu::Buffer>,
}

/// The largest number of batches of a dispatch: shaders count invocations in 32 bits.
const MOST_TOGETHER: u64 = 1 << 9;
/// The number of bytes of the words of a voxel, and of the shares of light that arrive at it.
pub(super) const EACH: u64 = 8;
/// The usage of buffers of voxels.
const USAGE: wgpu::BufferUsages = wgpu::BufferUsages::STORAGE.union(wgpu::BufferUsages::COPY_DST);

/// The voxels that a dispatch reads, as bindings.
pub(crate) struct Dispatch<'a> {
    /// Parameters of the dispatch: its bricks, counted from brick `first_brick` of the buffer on.
    pub(crate) parameters: Classify,
    pub(crate) voxels: u64,
    pub(crate) work: u64,
    pub(crate) samples: wgpu::BindingResource<'a>,
    pub(crate) places: wgpu::BindingResource<'a>,
    pub(crate) seen: wgpu::BindingResource<'a>,
    pub(crate) normals: wgpu::BindingResource<'a>,
    pub(crate) kept: wgpu::BindingResource<'a>,
    /// The number of the buffer.
    pub(super) buffer: usize,
}

/// The number of sets of voxels made so far.
static MADE: AtomicU64 = AtomicU64::new(0);

/// Returns a number that distinguishes voxels, or scalars, from others of the program.
pub(crate) fn new_id() -> u64 {
    MADE.fetch_add(1, Ordering::Relaxed)
}

impl Voxels {
    /// Finds the visible voxels of a volume, whose samples the device holds from now on. Also returns the bytes that
    /// were sent.
    ///
    /// # Errors
    /// [`Error::Unsupported`](crate::error::Error::Unsupported) if the device has no room for the samples.
    pub(crate) fn of_samples(
        pipelines: &Cache,
        input: &Input<'_>,
        held: &HeldSamples,
        kept: &KeptVoxels,
    ) -> Result<(Arc<Self>, Bricks)> {
        let needed = input.needed_bricks()?;
        if !HeldSamples::fits(input, &needed) {
            return Err(input.context.outgrown());
        }
        let points = input.points_on_device()?;
        let (voxels, bytes) = held.with(input, needed, |held| {
            kept.with(pipelines, input, held, input.key().is_lit(), |visible, normals| {
                let values = held.buffers.iter();
                let values =
                    values.map(|of| ValueBuffer { bricks: of.bricks.clone(), buffer: of.samples.clone() }).collect();
                let normals = normals.map(<[_]>::to_vec);
                let key = VoxelsKey {
                    input: input.key(),
                    appearances: false,
                    kept_normals: normals.is_some(),
                    shadows: false,
                };
                Ok(Arc::new(Self {
                    id: new_id(),
                    key,
                    points,
                    parameters: input.parameters(),
                    values: Arc::new(values),
                    visible: Arc::clone(visible),
                    normals,
                    kept: None,
                }))
            })
        })?;
        Ok((voxels, Bricks { all: input.brick_count() as u32, uploaded: input.shown()?, bytes }))
    }

    /// Returns the voxels of bricks of a lattice of `dims` points whose words are in buffers, with their normals if
    /// they are lit.
    pub(super) fn of_words(
        context: &Context,
        dims: [u32; 3],
        of_buffers: impl IntoIterator<Item = (VisibleVoxels, wgpu::Buffer)>,
        normals: Option<(Normals, Vec<wgpu::Buffer>)>,
    ) -> Result<Self> {
        let (visible, values) =
            of_buffers.into_iter().map(|(visible, buffer)| (visible, ValueBuffer { bricks: 0..0, buffer })).unzip();
        let key = VoxelsKey {
            input: InputKey::of_words(normals.as_ref().map(|(kind, _)| *kind)),
            appearances: true,
            kept_normals: normals.is_some(),
            shadows: false,
        };
        let none = ControlPoint::zeroed();
        Ok(Self {
            id: new_id(),
            key,
            points: context.upload("classify.no_points", bytemuck::bytes_of(&none), wgpu::BufferUsages::STORAGE)?,
            parameters: Classify { dims, ..Classify::zeroed() },
            values: Arc::new(values),
            visible: Arc::new(visible),
            normals: normals.map(|(_, normals)| normals),
            kept: None,
        })
    }

    /// Sends the voxels of bricks that the host classified, in a lattice of `dims` points, with their normals if they
    /// are lit.
    pub(crate) fn send(
        context: &Context,
        dims: [u32; 3],
        bricks: &[MadeBrick],
        lit: Option<Normals>,
    ) -> Result<Arc<Self>> {
        let most = u32::try_from(context.largest_buffer() / EACH).unwrap_or(u32::MAX);
        let (mut of_buffers, mut normals) = (Vec::new(), Vec::new());
        for own in parts(bricks, most, |made| made.splats.count()) {
            let own = &bricks[own];
            let (visible, words) = sent(context, dims, own, lit.is_some().then_some(&mut normals))?;
            of_buffers.push((visible, words));
        }
        let normals = lit.map(|kind| (kind, normals));
        Self::of_words(context, dims, of_buffers, normals).map(Arc::new)
    }

    /// Returns the voxels with the shares `kept` of the light that arrives.
    pub(super) fn under(&self, kept: Vec<wgpu::Buffer>) -> Self {
        let key = VoxelsKey { shadows: true, ..self.key };
        Self { id: new_id(), key, kept: Some(kept), ..self.clone() }
    }

    /// Returns the voxels after other words have been written into their buffers.
    pub(super) fn again(&self) -> Self {
        Self { id: new_id(), ..self.clone() }
    }

    /// Returns the voxels with these shares of the light that arrives, buffer after buffer.
    pub(crate) fn under_shares(&self, context: &Context, shares: &[[u16; MAX_CASTING + 1]]) -> Result<Self> {
        let mut rest = shares;
        let of_buffer = |count: u32| {
            let (own, others) = rest.split_at(count as usize);
            rest = others;
            context.upload("shadows.kept", bytemuck::cast_slice(own), USAGE | wgpu::BufferUsages::COPY_SRC)
        };
        Ok(self.under(self.counts().map(of_buffer).collect::<Result<_>>()?))
    }

    /// Returns the shares of the light that arrives, by buffer.
    pub(super) fn kept(&self) -> Option<&[wgpu::Buffer]> {
        self.kept.as_deref()
    }

    /// Returns the number of visible voxels of each buffer.
    pub(super) fn counts(&self) -> impl Iterator<Item = u32> {
        self.visible.iter().map(|visible| visible.count)
    }

    /// Returns the number of visible voxels.
    pub(crate) fn count(&self) -> u64 {
        self.counts().map(u64::from).sum()
    }

    /// Returns the visible voxels of each buffer.
    pub(super) fn visible(&self) -> &[VisibleVoxels] {
        &self.visible
    }

    /// Returns the bricks with visible voxels.
    pub(crate) fn bricks(&self) -> impl Iterator<Item = &BrickSplats> {
        let bricks = self.visible.iter().flat_map(|visible| &visible.bricks);
        bricks.filter(|brick| brick.bounds[0] != brick.bounds[1])
    }

    /// Returns the first lattice point of the box around visible voxels, and its size; one voxel if there are none.
    pub(crate) fn bounds(&self) -> [[usize; 3]; 2] {
        bounds_of(self.bricks())
    }

    /// Returns the bytes of device memory of the voxels.
    pub(crate) fn bytes(&self) -> u64 {
        let of_values = self.values.iter().map(|values| values.buffer.size());
        let of_rows = self.visible.iter().map(|visible| visible.places.size() + visible.seen.size());
        let beside = [&self.normals, &self.kept].into_iter().flatten().flatten().map(wgpu::Buffer::size);
        of_values.chain(of_rows).chain(beside).sum()
    }

    pub(crate) fn key(&self) -> VoxelsKey {
        self.key
    }

    /// Returns the control points of the transfer function.
    pub(crate) fn points(&self) -> &wgpu::Buffer {
        &self.points
    }

    /// Returns the parameters of shaders, without bricks.
    pub(super) fn parameters(&self) -> Classify {
        self.parameters
    }

    /// Returns the buffers of samples.
    pub(super) fn buffers(&self) -> impl Iterator<Item = SampledBuffer<'_>> {
        let buffers = self.values.iter().zip(&*self.visible).enumerate();
        buffers.map(|(number, (values, visible))| {
            let [normals, kept] = [&self.normals, &self.kept].map(|buffers| buffers.as_ref()?.get(number));
            SampledBuffer { bricks: values.bricks.clone(), samples: &values.buffer, visible, normals, kept }
        })
    }

    /// Returns the dispatches that read all voxels, with an invocation for each. None outlasts the watchdog of a small
    /// GPU.
    pub(crate) fn dispatches(&self, context: &Context) -> Vec<Dispatch<'_>> {
        let of_buffer =
            |(number, visible): (usize, &VisibleVoxels)| self.dispatches_of(context, number, 0..visible.bricks.len());
        self.visible.iter().enumerate().flat_map(of_buffer).collect()
    }

    /// Returns the dispatches that read these bricks of a buffer, as [`Self::dispatches`] does.
    pub(super) fn dispatches_of(&self, context: &Context, number: usize, range: Range<usize>) -> Vec<Dispatch<'_>> {
        let each = if self.key.input.is_lit() && self.normals.is_none() { FOUND } else { 1 };
        let batch_work = (BATCH * EDGE * EDGE * EDGE) as u64 * each;
        let together = (max_work(context) / batch_work).clamp(1, MOST_TOGETHER) as usize * BATCH;
        let VisibleVoxels { places, seen, .. } = &self.visible[number];
        let [normals, kept] =
            [&self.normals, &self.kept].map(|buffers| buffers.as_ref().map_or(places, |of| &of[number]));
        let [samples, places, seen, normals, kept] =
            [&self.values[number].buffer, places, seen, normals, kept].map(wgpu::Buffer::as_entire_binding);
        let dispatch = |first: usize| {
            let bricks = together.min(range.end - first);
            let voxels = (bricks * ROWS * EDGE) as u64;
            Dispatch {
                parameters: Classify { bricks: bricks as u32, first_brick: first as u32, ..self.parameters },
                voxels,
                work: voxels * each,
                samples: samples.clone(),
                places: places.clone(),
                seen: seen.clone(),
                normals: normals.clone(),
                kept: kept.clone(),
                buffer: number,
            }
        };
        range.clone().step_by(together).map(dispatch).collect()
    }
}

/// Splits bricks into parts that follow one another, of at most `most` splats and no more bricks than a place can
/// name, given the number of splats of a brick. Bricks without splats are left out before and between parts.
pub(super) fn parts<B>(bricks: &[B], most: u32, count: impl Fn(&B) -> u32) -> Vec<Range<usize>> {
    let mut parts: Vec<(Range<usize>, u32)> = Vec::new();
    for (number, brick) in bricks.iter().enumerate() {
        let own = count(brick);
        match parts.last_mut() {
            _ if own == 0 => {}
            Some((part, held)) if most - *held >= own && number - part.start < MAX_BRICKS => {
                part.end = number + 1;
                *held += own;
            }
            _ => parts.push((number..number + 1, own)),
        }
    }
    parts.into_iter().map(|(part, _)| part).collect()
}

/// Sends bricks whose voxels fit into a buffer: returns them and their words, and adds the buffer of their normals to
/// `normals`.
fn sent(
    context: &Context,
    dims: [u32; 3],
    bricks: &[MadeBrick],
    normals: Option<&mut Vec<wgpu::Buffer>>,
) -> Result<(VisibleVoxels, wgpu::Buffer)> {
    let mut count = 0;
    let (mut places, mut seen, mut described) = (Vec::new(), Vec::new(), Vec::new());
    for MadeBrick { brick, splats, .. } in bricks {
        places.extend(splats.rows.iter().map(|row| count + row.first));
        seen.extend(splats.rows.iter().map(|row| row.bits));
        described.push(BrickSplats { first: count, ..*brick });
        count += splats.count();
    }
    places.push(count);
    places.extend(numbers_of(dims, described.iter().map(|brick| brick.origin)));
    let bytes: Vec<u64> = bricks.iter().map(|made| u64::from(made.splats.count()) * EACH).collect();
    let words = |number: usize| bricks[number].splats.columns(0..2);
    let appearances = send_bricks(context, ("classify.appearances", USAGE), &bytes, &words)?;
    if let Some(normals) = normals {
        let mut all = reserved(u64::from(count), || "normals of voxels".to_owned())?;
        bricks.iter().try_for_each(|made| made.splats.columns(2..3).map(|own| all.extend(own)))?;
        normals.push(context.upload("cells.normals", bytemuck::cast_slice(&all), USAGE)?);
    }
    let [places, seen] = [("classify.places", places), ("classify.seen", seen)]
        .map(|(label, words)| context.upload(label, bytemuck::cast_slice(&words), USAGE));
    Ok((VisibleVoxels { count, bricks: described, places: places?, seen: seen? }, appearances))
}

/// Returns the numbers of bricks of a lattice of `dims` points, x fastest, given their first lattice points.
pub(super) fn numbers_of(dims: [u32; 3], origins: impl Iterator<Item = [u32; 3]>) -> impl Iterator<Item = u32> {
    let [across, down, _] = dims.map(|n| n.div_ceil(EDGE as u32));
    origins.map(move |origin| {
        let [x, y, z] = origin.map(|n| n / EDGE as u32);
        x + across * (y + down * z)
    })
}
