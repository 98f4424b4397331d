//! Images of VTK (<https://docs.vtk.org/en/latest/vtk_file_formats/index.html>).

mod blocks;
pub(super) mod image_data;
pub(super) mod legacy;

use glam::DVec3;

use super::placement::Placement;
use super::selection::Role;

/// Where samples lie in the image: an array belongs to points or to cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum At {
    Points,
    Cells,
}

/// The lattice of an image.
struct Lattice {
    /// The first and the last point along each axis.
    extent: [[i64; 2]; 3],
    spacing: [f64; 3],
    /// The world position of point (0, 0, 0), which need not be in the extent.
    origin: DVec3,
    directions: [DVec3; 3],
}

impl Lattice {
    /// The samples along each axis, and their position. A sample of a cell is at its centre.
    fn placed(&self, at: At) -> ([i64; 3], Placement) {
        let (mut sizes, mut origin) = ([1; 3], self.origin);
        for (axis, [first, last]) in self.extent.into_iter().enumerate() {
            let cells = last.saturating_sub(first);
            let (size, shift) = match at {
                At::Points => (cells.saturating_add(1), 0.0),
                // An axis with one point has cells without a height there.
                At::Cells if cells == 0 => (1, 0.0),
                At::Cells => (cells, 0.5),
            };
            sizes[axis] = size;
            origin += self.directions[axis] * self.spacing[axis] * (first as f64 + shift);
        }
        (sizes, Placement { directions: self.directions, spacing: self.spacing, origin, oriented: false })
    }
}

/// The axes of an array with so many numbers for each sample of a lattice.
fn axes(components: u64, [x, y, z]: [i64; 3]) -> [(Role, i64); 4] {
    let channels = i64::try_from(components).unwrap_or(i64::MAX);
    [(Role::Channel, channels), (Role::Space, x), (Role::Space, y), (Role::Space, z)]
}

/// As many numbers as the array has, separated by blanks; `None` if there are not so many.
fn numbers<T: std::str::FromStr + Copy, const N: usize>(text: &str) -> Option<[T; N]> {
    let numbers: Vec<T> = text.split_ascii_whitespace().map(|word| word.parse().ok()).collect::<Option<_>>()?;
    numbers.try_into().ok()
}
