//! list: visible voxels to lists of splats, which the painter `quads` sorts and draws: shaders/list.wgsl.

use std::ops::Range;

use super::cache::Cache;
use super::context::Context;
use super::layout::{LIT_WORDS, List, SHADED_WORDS};
use super::pipeline::Binding::{Read, Uniform, Write};
use super::recorder::Recorder;
use super::shaders;
use super::stage::{Constant, Stage, for_each};
use super::store::Store;
use super::voxels::{Voxels, VoxelsKey, parts};
use crate::error::Result;
use crate::splats::brick::BrickSplats;

/// The stage that lists voxels.
struct Lister(Stage);

impl Lister {
    fn new(context: &Context, key: VoxelsKey) -> Self {
        // Two bindings of other stages of voxels are free.
        let slots = [Uniform, Read, Read, Write, Uniform, Read, Read, Uniform, Uniform, Read, Read];
        let constants: Vec<Constant> = key.constants().collect();
        Self(Stage::new(context, shaders::LIST, ("classify", "splats_of_voxels"), &slots, &constants))
    }
}

/// Lists the visible voxels, in stores that each fit into a buffer.
pub(crate) fn listed(context: &Context, pipelines: &Cache, voxels: &Voxels) -> Result<Vec<Store>> {
    let words = if voxels.key().has_shadows() { SHADED_WORDS } else { LIT_WORDS };
    let stride = 4 * words as u64;
    let most = u32::try_from(context.largest_buffer() / stride).unwrap_or(u32::MAX);
    let stage = pipelines.get_or_make(voxels.key(), || Ok(Lister::new(context, voxels.key())))?;
    let mut stores = Vec::new();
    for (number, visible) in voxels.visible().iter().enumerate() {
        let ends: Vec<u32> = visible.bricks.iter().skip(1).map(|next| next.first).chain([visible.count]).collect();
        let numbers: Vec<Range<u32>> = visible.bricks.iter().zip(&ends).map(|(brick, &end)| brick.first..end).collect();
        for part in parts(&numbers, most, |splats| splats.len() as u32) {
            let (first, end) = (numbers[part.start].start, numbers[part.end - 1].end);
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
            let splats = context.buffer("store.splats", u64::from(end - first) * stride, usage)?;
            let list = List { first_brick: part.start as u32, first_splat: first };
            let list = context.upload("list.parameters", bytemuck::bytes_of(&list), wgpu::BufferUsages::UNIFORM)?;
            let mut recorder = Recorder::untimed(context);
            for dispatch in voxels.dispatches_of(context, number, part.clone()) {
                let own = bytemuck::bytes_of(&dispatch.parameters);
                let own = context.upload("list.classify", own, wgpu::BufferUsages::UNIFORM)?;
                let resources = [
                    own.as_entire_binding(),
                    dispatch.samples,
                    voxels.points().as_entire_binding(),
                    splats.as_entire_binding(),
                    list.as_entire_binding(),
                    dispatch.places,
                    dispatch.seen,
                    list.as_entire_binding(),
                    list.as_entire_binding(),
                    dispatch.normals,
                    dispatch.kept,
                ];
                stage.0.run(&mut recorder, &resources, for_each(context, dispatch.voxels));
                recorder.worked(dispatch.work);
            }
            recorder.submit();
            let brick = |brick: &BrickSplats| BrickSplats { first: brick.first - first, ..*brick };
            let bricks = visible.bricks[part].iter().map(brick).collect();
            stores.push(Store::new(context, splats, stride, end - first, bricks)?);
        }
    }
    Ok(stores)
}
