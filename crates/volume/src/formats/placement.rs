//! The position of a lattice in the world as a header states it, before it becomes a [`Grid`].

use std::path::Path;

use glam::{DAffine3, DMat3, DVec3};

use crate::error::{Error, Hint, Result, Subject, refuse};
use crate::volume::{Grid, MAX_DIM, Stored, Volume};

/// The factors from RAS, the world of NIfTI and FreeSurfer, to LPS, the world of DICOM.
pub(super) const RAS_TO_LPS: DVec3 = DVec3::new(-1.0, -1.0, 1.0);

/// The position of a lattice in the world: neighbouring samples along axis a are `spacing[a] * directions[a]` apart.
///
/// The two are separate so that the user's spacing can replace the header's and keep its directions.
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
    /// Returns a position with lattice axes along the world axes and the first sample at the origin.
    pub(super) fn axis_parallel(spacing: [f64; 3]) -> Self {
        Self { directions: [DVec3::X, DVec3::Y, DVec3::Z], spacing, origin: DVec3::ZERO, oriented: false }
    }

    /// Returns the position in a world whose axes are reversed if their component of `flip` is -1.
    ///
    /// (-1, -1, 1) takes the RAS of NIfTI (x to the right, y to the front) to the LPS of DICOM, and back.
    pub(super) fn flipped(mut self, flip: DVec3) -> Self {
        // Adding 0 turns -0 into 0: `info` prints these numbers.
        self.directions = self.directions.map(|d| d * flip + DVec3::ZERO);
        self.origin = self.origin * flip + DVec3::ZERO;
        self
    }

    /// Returns a volume of samples on a grid made by [`Placement::grid`].
    pub(super) fn volume(&self, grid: Grid, stored: Stored) -> Result<Volume> {
        let volume = Volume::of(grid, stored)?;
        Ok(if self.oriented { volume.with_orientation_known() } else { volume })
    }

    /// Returns the grid of a lattice with these sizes, fastest first, at this position; axes that are not there have
    /// one sample. A given `spacing` replaces the header's.
    ///
    /// An axis of one sample without a spacing gets the spacing of the first axis: a picture states no thickness.
    /// Readers make the grid before they read samples, so a header with a singular grid is refused at once.
    pub(super) fn grid(&self, path: &Path, sizes: &[i64], spacing: Option<[f64; 3]>) -> Result<Grid> {
        let dims = lattice(path, sizes)?;
        let mut axes = self.directions;
        for (a, axis) in axes.iter_mut().enumerate() {
            let stated = if dims[a] == 1 && self.spacing[a] == 0.0 { self.spacing[0] } else { self.spacing[a] };
            match spacing {
                // A direction of length 0 cannot be kept: the world axis replaces it.
                Some(spacing) => *axis = axis.normalize_or(DVec3::AXES[a]) * spacing[a],
                None if stated.is_finite() && stated > 0.0 => *axis *= stated,
                None => {
                    let reason = format!("the spacing of axis {} is {stated}, not a positive length", a + 1);
                    return Err(Error::format(path, reason).hinted(Hint::GiveSpacing));
                }
            }
        }
        let [x, y, z] = axes;
        Grid::new(dims, DAffine3::from_mat3_translation(DMat3::from_cols(x, y, z), self.origin)).map_err(|e| match e {
            Error::Volume(reason) => Error::format(path, reason),
            other => other,
        })
    }
}

/// Returns the dimensions of a lattice, each checked to be in the range that a grid accepts; missing ones are 1.
pub(super) fn lattice(path: &Path, sizes: &[i64]) -> Result<[u32; 3]> {
    let mut dims = [1; 3];
    for (axis, (dim, size)) in dims.iter_mut().zip(sizes).enumerate() {
        match u32::try_from(*size) {
            Ok(n) if (1..=MAX_DIM).contains(&n) => *dim = n,
            _ => refuse!(path, "dimension {} is {size}, expected 1 to {MAX_DIM}", axis + 1),
        }
    }
    Ok(dims)
}

/// Returns the spacings of a header, with lengths in place of some that are none: `length` has the length of an axis by
/// its number and the header's. A note says so, unless a spacing is given.
pub(super) fn lengths(
    spacing: [f64; 3],
    given: Option<[f64; 3]>,
    notes: &mut Vec<String>,
    length: impl Fn(usize, f64) -> f64,
) -> [f64; 3] {
    std::array::from_fn(|axis| {
        let (stated, used) = (spacing[axis], length(axis, spacing[axis]));
        if used.to_bits() != stated.to_bits() && given.is_none() {
            let axis = axis + 1;
            notes.push(format!("using {used} as the spacing of axis {axis} because the header states {stated}"));
        }
        used
    })
}

/// Returns the name of a file as one line of at most 80 characters; `None` if it is empty.
pub(super) fn plain_name(text: &str) -> Option<String> {
    let name: String = text.trim().chars().filter(|c| !c.is_control()).take(80).collect();
    (!name.is_empty()).then_some(name)
}

/// Returns a unit as a header names it; `None` if the text is no name.
pub(super) fn named_unit(text: &str) -> Option<String> {
    let name = text.trim_matches(|c: char| c.is_whitespace() || c == '"');
    let is_name = (1..=16).contains(&name.chars().count()) && !name.contains(|c: char| c.is_control() || c == '?');
    is_name.then(|| name.to_owned())
}

/// Refuses a spacing of the user unless all three are finite and over 0.
pub(super) fn check_spacing(spacing: [f64; 3]) -> Result<()> {
    if spacing.iter().all(|s| s.is_finite() && *s > 0.0) {
        return Ok(());
    }
    let [x, y, z] = spacing;
    Err(Error::Setting { name: "spacing", reason: format!("{x},{y},{z}, expected three positive lengths") })
}
