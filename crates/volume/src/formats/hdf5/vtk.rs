//! Images of VTK in HDF5, .vtkhdf (<https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/>).

use std::path::Path;

use glam::DVec3;
use netcdf_reader::NcGroup;

use super::slabs::{attribute, text};
use crate::error::{Result, Subject, refuse};
use crate::formats::placement::Placement;

/// The groups of arrays, with the place of their samples in a cell.
const ARRAYS: [(&str, f64); 2] = [("PointData", 0.0), ("CellData", 0.5)];

/// The image of a file of VTK.
pub(super) struct Image<'a>(&'a NcGroup);

/// Returns the image of a file; `None` if it is no file of VTK, an error if it is another object of VTK.
pub(super) fn image<'a>(root: &'a NcGroup, path: &Path) -> Result<Option<Image<'a>>> {
    let Some(group) = root.group("VTKHDF") else { return Ok(None) };
    match text(&group.attributes, "Type").as_deref() {
        Some("ImageData") => Ok(Some(Image(group))),
        other => refuse!(path, "is of VTK's type {:?}, expected ImageData", other.unwrap_or_default()),
    }
}

impl Image<'_> {
    /// Returns the path of the array that is named as the active scalars.
    pub(super) fn active(&self) -> Option<String> {
        let of = |(name, _): &(&str, f64)| {
            let scalars = text(&self.0.group(name)?.attributes, "Scalars")?;
            Some(format!("/VTKHDF/{name}/{scalars}"))
        };
        ARRAYS.iter().find_map(of)
    }

    /// Returns the position of the lattice of the array with the path `set`; `None` if it is no array of the image.
    pub(super) fn placement(&self, set: &str, path: &Path) -> Result<Option<Placement>> {
        let is_in = |(name, _): &&(&str, f64)| set.starts_with(&format!("/VTKHDF/{name}/"));
        let Some((_, place)) = ARRAYS.iter().find(is_in) else { return Ok(None) };
        let extent = self.numbers("WholeExtent", [0.0; 6], path)?;
        let spacing = self.numbers("Spacing", [1.0; 3], path)?;
        let m = self.numbers("Direction", [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], path)?;
        // Its columns are the directions of the axes.
        let directions = std::array::from_fn(|axis| DVec3::new(m[axis], m[axis + 3], m[axis + 6]));
        let first = |axis: usize| directions[axis] * spacing[axis] * (extent[2 * axis] + place);
        let origin = DVec3::from_array(self.numbers("Origin", [0.0; 3], path)?) + (0..3).map(first).sum::<DVec3>();
        Ok(Some(Placement { directions, spacing, origin, oriented: false }))
    }

    /// Returns the numbers of an attribute, or the usual ones if it is not stated.
    fn numbers<const N: usize>(&self, name: &str, usual: [f64; N], path: &Path) -> Result<[f64; N]> {
        let Some(stated) = attribute(&self.0.attributes, name) else { return Ok(usual) };
        let numbers = stated.value.as_f64_vec().and_then(|numbers| <[f64; N]>::try_from(numbers).ok());
        let finite = numbers.filter(|numbers| numbers.iter().all(|number| number.is_finite()));
        finite.ok_or_else(|| path.error(format!("{name} of VTKHDF has no {N} finite numbers")))
    }
}
