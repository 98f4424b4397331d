//! Scenes: what the host engine keeps of a volume from picture to picture.

use glam::DVec3;

use super::colors::Halves;
use super::scalars::Scalars;
use super::shot::{OwnedPart, Shot, fields_of_cell};
use super::voxels::Colored;
use super::{arriving, field};
use crate::error::{Error, Result};
use crate::lighting::shadow::incoming::Incoming;
use crate::volume::Grid;
use voxsplat_volume::memory::available;

/// A scene that a [`HostRenderer`] has prepared.
#[doc(hidden)]
pub struct HostScene {
    pub(super) content: HostContent,
    /// The part of a larger lattice of which partial pictures are made; `None`: whole pictures.
    pub(super) part: Option<OwnedPart>,
}

pub(super) enum HostContent {
    /// Scalars that are classified along rays.
    Scalars(Box<Scalars>),
    /// Voxels that are classified before they are reconstructed.
    Colored(Box<Colored>),
}

impl HostScene {
    /// Returns the lattice of the samples.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        match &self.content {
            HostContent::Scalars(scalars) => scalars.volume.grid(),
            HostContent::Colored(colored) => colored.grid(),
        }
    }

    /// Makes the scene one of a part of a larger lattice, whose voxels begin at `first` in `whole`. Its pictures are
    /// partial: the values of the slabs with their middles between the places in `owned`, in numbers of voxels, and
    /// with `has_eye` also of the slab of the eye. `is_uniform`: the lit matter of the larger volume is uniform, as of
    /// a mask.
    pub(crate) fn within(
        mut self,
        (whole, first): (Grid, [u32; 3]),
        (owned, has_eye): ([DVec3; 2], bool),
        is_uniform: bool,
    ) -> Self {
        if let HostContent::Scalars(scalars) = &mut self.content {
            scalars.is_uniform = is_uniform;
        }
        let held = *self.grid();
        self.part = Some(OwnedPart { grid: whole, held, first, owned, has_eye, incoming: None });
        self
    }

    /// Sets the light that enters the part of a lattice, from matter beside it.
    pub(crate) fn entered_by(mut self, incoming: Option<Incoming>) -> Self {
        self.part = self.part.map(|part| OwnedPart { incoming, ..part });
        self
    }

    /// Refuses a picture that needs more memory than is left, before any is allocated. The scene's own memory counts as
    /// left.
    pub(super) fn check_memory(&self, shot: &Shot<'_>) -> Result<()> {
        let kernels = shot.kernels();
        let dims = shot.level.grid(self.grid())?.dims();
        let points = field::count(dims, field::padding(&kernels));
        let scalars = points * (kernels.len() * size_of::<f32>()) as u64;
        let light = |lights: usize| lights as u64 * arriving::BYTES * self.grid().len();
        let (fields, held) = match &self.content {
            HostContent::Scalars(scene) => {
                let held = scene.field.sum(|made| made.field.bytes()) + light(scene.light.count());
                (scalars, held)
            }
            HostContent::Colored(colored) => {
                let of_surfaces = colored.surfaces.as_ref();
                let held = colored.field.sum(|made| made.field.bytes()) + light(colored.light.count());
                let held = held + of_surfaces.map_or(0, |scene| scene.field.sum(|made| made.field.bytes()));
                let colors = points * (fields_of_cell(shot.settings, kernels.len()) * size_of::<Halves>()) as u64;
                (colors + of_surfaces.map_or(0, |_| scalars), held)
            }
        };
        check_memory(fields, light(usize::from(shot.settings.casting().is_some())), held)
    }
}

/// Refuses a field and a light of more bytes than the memory that is left and the bytes `held` for them.
fn check_memory(field: u64, light: u64, held: u64) -> Result<()> {
    let Some(available) = available() else { return Ok(()) };
    if field + light <= available.bytes + held {
        return Ok(());
    }
    let mut remedies = Vec::new();
    if field <= available.bytes + held {
        remedies.push("--light off".to_owned());
    }
    remedies.push("--painter tiles".to_owned());
    Err(Error::TooLarge { bytes: field + light, available: available.bytes, limit: available.limit, remedies })
}
