//! The visible voxels of a volume and their normals (shaders/normals.wgsl), kept on the device for all lights and
//! levels.

use std::sync::{Arc, Mutex, PoisonError};

use super::cache::Cache;
use super::classify::{Classifier, VisibleVoxels};
use super::held_samples::{HeldBricks, HeldSamples};
use super::layout::Classify;
use super::pipeline::Binding;
use super::recorder::{Recorder, max_work};
use super::samples::{Input, InputKey};
use super::scan::Scan;
use super::shaders;
use super::stage::{Stage, for_each};
use crate::error::{Error, Result};
use crate::volume::BRICK_EDGE as EDGE;

/// The stage that cells are part of in [`Stats::stages`](crate::stats::Stats::stages).
pub(super) const CLASSIFY: &str = "classify";
/// The work for a voxel whose normal is found, in fragments of splats.
pub(super) const FOUND: u64 = 16;

/// The visible voxels of a volume and their normals on the device, for all lights and levels.
#[derive(Default)]
pub(crate) struct KeptVoxels(pub(super) Mutex<Option<(Arc<Vec<VisibleVoxels>>, KeptNormals)>>);

/// The packed normals of visible voxels, 4 bytes each.
pub(super) enum KeptNormals {
    /// No normals, because there was no light yet.
    Unlit,
    /// The normals for each buffer of samples.
    Kept(Vec<wgpu::Buffer>),
    /// No normals, because they do not fit: they are found again for each light.
    NoRoom,
}

/// The volumes whose normals one pipeline finds.
#[derive(PartialEq, Eq, Hash)]
struct NormalsKey(InputKey);

impl KeptVoxels {
    /// The largest number of bytes of normals: as many as of held samples.
    const MOST: u64 = HeldSamples::MOST;

    /// Drops all voxels, because others are visible.
    pub(crate) fn clear(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }

    /// Calls `work` with the visible voxels of these samples, and with their normals if they are lit and the normals
    /// fit. Normals are found at the first light and kept: the same shader finds the normals of all pictures, so that
    /// drivers round them in the same way for the first picture and for later ones.
    pub(super) fn with<T>(
        &self,
        pipelines: &Cache,
        input: &Input<'_>,
        held: &HeldBricks,
        is_lit: bool,
        work: impl FnOnce(&Arc<Vec<VisibleVoxels>>, Option<&[wgpu::Buffer]>) -> Result<T>,
    ) -> Result<T> {
        let lock = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = lock().take();
        let (visible, mut normals) = match kept {
            Some(kept) => kept,
            None => {
                let scan = Scan::of(pipelines, input.context)?;
                (Arc::new(Classifier::of(pipelines, input)?.visible(&scan, input, held)?), KeptNormals::Unlit)
            }
        };
        if is_lit && matches!(normals, KeptNormals::Unlit) {
            normals = KeptNormals::find(pipelines, input, held, &visible)?;
        }
        let result = match &normals {
            KeptNormals::Kept(normals) if is_lit => work(&visible, Some(normals)),
            _ => work(&visible, None),
        }?;
        *lock() = Some((visible, normals));
        Ok(result)
    }
}

impl KeptNormals {
    /// Finds the normals of visible voxels, if there is room for them.
    fn find(pipelines: &Cache, input: &Input<'_>, held: &HeldBricks, visible: &[VisibleVoxels]) -> Result<Self> {
        let context = input.context;
        let bytes = || visible.iter().map(|part| u64::from(part.count) * 4);
        let fits = bytes().all(|bytes| bytes <= context.largest_buffer()) && bytes().sum::<u64>() <= KeptVoxels::MOST;
        if !fits || !context.savings.normals {
            return Ok(Self::NoRoom);
        }
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let buffer = |bytes| context.buffer("cells.normals", bytes, usage);
        let normals = match context.guarded("keeping normals", || bytes().map(buffer).collect::<Result<Vec<_>>>()) {
            Err(Error::OutOfMemory(_)) => return Ok(Self::NoRoom),
            made => made?,
        };
        let make = || {
            use Binding::{Read, Uniform, Write};
            let slots = [Uniform, Read, Read, Read, Write, Read];
            Ok(Stage::new(context, shaders::NORMALS, (CLASSIFY, "find"), &slots, &input.key().constants()))
        };
        let stage = pipelines.get_or_make(NormalsKey(input.key()), make)?;
        let points = input.points_on_device()?;
        // No dispatch outlasts the watchdog of a small GPU.
        let work = (EDGE * EDGE * EDGE) as u64 * FOUND;
        let at_once = (max_work(context) / work).max(1) as usize;
        let mut recorder = Recorder::untimed(context);
        for ((of_buffer, visible), normals) in held.buffers.iter().zip(visible).zip(&normals) {
            let (samples, all) = (&of_buffer.samples, of_buffer.count());
            for first in (0..all).step_by(at_once) {
                let bricks = at_once.min(all - first);
                let parameters = Classify { bricks: bricks as u32, first_brick: first as u32, ..input.parameters() };
                let uniform = wgpu::BufferUsages::UNIFORM;
                let parameters = context.upload("cells.normals_of", bytemuck::bytes_of(&parameters), uniform)?;
                let buffers = [&parameters, samples, &points, &visible.places, normals, &visible.seen];
                let voxels = (bricks * EDGE * EDGE * EDGE) as u64;
                let buffers = buffers.map(wgpu::Buffer::as_entire_binding);
                stage.run(&mut recorder, &buffers, for_each(context, voxels));
                recorder.worked(voxels * FOUND);
            }
        }
        recorder.submit();
        Ok(Self::Kept(normals))
    }
}
