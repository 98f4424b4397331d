//! What a picture draws: visible voxels, scalars, or lists of splats.

use std::sync::{Arc, Mutex, PoisonError};

use super::cache::Cache;
use super::context::Context;
use super::list::listed;
use super::sampled_scalars::SampledScalars;
use super::samples::Bricks;
use super::store::{Store, Stores};
use super::voxels::{Voxels, new_id};
use crate::error::Result;

/// The voxels of a volume, or of a level of it.
#[derive(Default)]
pub(crate) struct Drawable {
    /// The visible voxels of pre-shading.
    pub(crate) voxels: Option<Arc<Voxels>>,
    /// The scalars of post-shading that no list holds, and the number that distinguishes them from others.
    pub(crate) scalars: Option<(Arc<SampledScalars>, u64)>,
    /// The lists of splats: of scalars, or of voxels if a painter has asked for them.
    lists: Mutex<Option<Arc<Vec<Store>>>>,
    /// Whether there are scalars that the device has no room for.
    pub(crate) is_outgrown: bool,
    pub(crate) bricks: Bricks,
    /// Number of splats that are copies of voxels beyond the faces of the volume.
    pub(crate) copies: u64,
    /// Resources that painters made of the splats.
    pub(crate) kept: Arc<Cache>,
}

impl Drawable {
    /// Makes the drawable of voxels.
    pub(crate) fn of_voxels(voxels: Arc<Voxels>, bricks: Bricks) -> Self {
        Self { voxels: Some(voxels), bricks, ..Self::default() }
    }

    /// Makes the drawable of scalars that no list holds.
    pub(crate) fn of_scalars(scalars: SampledScalars, bricks: Bricks) -> Self {
        let copies = scalars.copies();
        Self { scalars: Some((Arc::new(scalars), new_id())), bricks, copies, ..Self::default() }
    }

    /// Makes the drawable of scalars that the device has no room for.
    pub(crate) fn outgrown() -> Self {
        Self { is_outgrown: true, ..Self::default() }
    }

    /// Makes the drawable of listed scalars.
    pub(crate) fn of_lists(Stores { stores, bricks, copies }: Stores) -> Self {
        Self { lists: Mutex::new(Some(Arc::new(stores))), bricks, copies, ..Self::default() }
    }

    /// Returns the drawable with resources that painters made of voxels before.
    pub(crate) fn with_kept(self, kept: Arc<Cache>) -> Self {
        Self { kept, ..self }
    }

    /// Returns the lists of splats. Lists of voxels are made now if there are none.
    pub(crate) fn lists(&self, context: &Context, pipelines: &Cache) -> Result<Arc<Vec<Store>>> {
        let mut lists = self.lists.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(lists) = &*lists {
            return Ok(Arc::clone(lists));
        }
        let list = |voxels: &Arc<Voxels>| context.guarded("listing voxels", || listed(context, pipelines, voxels));
        let made = Arc::new(self.voxels.as_ref().map_or_else(|| Ok(Vec::new()), list)?);
        *lists = Some(Arc::clone(&made));
        Ok(made)
    }

    /// Returns the lists of splats, if there are any.
    fn made_lists(&self) -> Option<Arc<Vec<Store>>> {
        self.lists.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Returns the number of splats.
    pub(crate) fn splats(&self) -> u64 {
        if let Some(voxels) = &self.voxels {
            return voxels.count();
        }
        let listed = self.made_lists().map_or(0, |stores| stores.iter().map(|store| u64::from(store.count)).sum());
        self.scalars.as_ref().map_or(listed, |(scalars, _)| scalars.count())
    }

    /// Returns the bytes of device memory of voxels, scalars and lists.
    pub(crate) fn bytes(&self) -> u64 {
        let listed: u64 = self.made_lists().map_or(0, |stores| stores.iter().map(Store::bytes).sum());
        let scalars = self.scalars.as_ref().map_or(0, |(scalars, _)| scalars.bytes());
        listed + scalars + self.voxels.as_ref().map_or(0, |voxels| voxels.bytes())
    }
}
