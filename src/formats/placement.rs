//! Where a header says that its lattice lies, on the way to a [`Grid`].

use std::path::Path;

use glam::{DAffine3, DMat3, DVec3};

use super::input::{format_error, hinted};
use crate::error::{Error, Hint, Result};
use crate::volume::{Grid, Stored, Volume};

/// The place of a lattice in the world: axis a runs along `directions[a]`, `spacing[a]` of these per sample.
///
/// The two are apart so that a spacing given by the user can take the place of the header's, directions kept.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placement {
    pub(super) directions: [DVec3; 3],
    pub(super) spacing: [f64; 3],
    /// The world position of the first sample.
    pub(super) origin: DVec3,
    /// Whether the world is the patient space of DICOM.
    pub(super) oriented: bool,
}

impl Placement {
    /// World axes along the lattice axes, the first sample at the origin.
    pub(super) fn axis_parallel(spacing: [f64; 3]) -> Self {
        Self { directions: [DVec3::X, DVec3::Y, DVec3::Z], spacing, origin: DVec3::ZERO, oriented: false }
    }

    /// The same place seen from a world whose axes are turned round where `flip` is -1.
    ///
    /// (-1, -1, 1) takes the RAS of NIfTI (x to the right, y to the front) to the LPS of DICOM, and back.
    pub(super) fn flipped(mut self, flip: DVec3) -> Self {
        // Adding 0 turns -0 into 0, which is what a user expects to see printed.
        self.directions = self.directions.map(|d| d * flip + DVec3::ZERO);
        self.origin = self.origin * flip + DVec3::ZERO;
        self
    }

    /// The samples on the grid made here.
    pub(super) fn volume(&self, grid: Grid, stored: Stored) -> Result<Volume> {
        let volume = Volume::of(grid, stored)?;
        Ok(if self.oriented { volume.with_orientation_known() } else { volume })
    }

    /// The grid of `dims` samples placed here; `spacing` takes the place of the header's. Readers make it before they read samples, so that a header that
    /// places them nowhere is refused at once.
    pub(super) fn grid(&self, path: &Path, dims: [u32; 3], spacing: Option<[f64; 3]>) -> Result<Grid> {
        let mut axes = self.directions;
        for (a, axis) in axes.iter_mut().enumerate() {
            match spacing {
                // A header whose directions are degenerate has none to keep.
                Some(spacing) => *axis = axis.normalize_or(DVec3::AXES[a]) * spacing[a],
                None if self.spacing[a].is_finite() && self.spacing[a] > 0.0 => *axis *= self.spacing[a],
                None => {
                    let reason = format!("the spacing of axis {} is {}, not a positive length", a + 1, self.spacing[a]);
                    return Err(hinted(format_error(path, reason), Hint::GiveSpacing));
                }
            }
        }
        let [x, y, z] = axes;
        Grid::new(dims, DAffine3::from_mat3_translation(DMat3::from_cols(x, y, z), self.origin)).map_err(|e| match e {
            Error::Volume(reason) => format_error(path, reason),
            other => other,
        })
    }
}

/// Refuses a spacing, given by the user, that is no length.
pub(super) fn check_spacing(spacing: [f64; 3]) -> Result<()> {
    if spacing.iter().all(|s| s.is_finite() && *s > 0.0) {
        return Ok(());
    }
    let [x, y, z] = spacing;
    Err(Error::Setting { name: "spacing", reason: format!("{x},{y},{z}, expected three positive lengths") })
}
