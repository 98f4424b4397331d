//! Images of VTK (<https://docs.vtk.org/en/latest/vtk_file_formats/index.html>).

mod blocks;
pub(super) mod image_data;
pub(super) mod legacy;
pub(super) mod poly_data;

use glam::DVec3;

use super::LoadOptions;
use super::decode::{Layout, read_all};
use super::input::Input;
use super::placement::Placement;
use super::selection::{Role, picked, sized};
use crate::error::{Result, Subject, refuse_if};
use crate::volume::{SampleType, Volume};

/// A reader of a format. The flag permits arrays with several numbers per sample.
type ReadArray = fn(Input, &LoadOptions, bool) -> Result<Option<Volume>>;

/// Reads the volume of an array with one number per sample, or else with several: for these the file is read again.
pub(super) fn read(input: Input, options: &LoadOptions, read_array: ReadArray) -> Result<Volume> {
    let (path, is_stream) = (input.path().to_owned(), input.at_most().is_none());
    if let Some(volume) = read_array(input, options, false)? {
        return Ok(volume);
    }
    refuse_if!(is_stream, path, "has no array of one number per sample, and is a stream: write it to a file");
    let found = read_array(Input::open(&path, None)?, options, true)?;
    found.ok_or_else(|| path.error("has no array of scalars"))
}

/// The places of an array's samples in the image: points or cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum At {
    Points,
    Cells,
}

/// An array of samples.
struct Array {
    at: At,
    sample_type: SampleType,
    /// The numbers of each sample.
    components: u64,
}

/// The lattice of an image.
struct ImageLattice {
    /// The first and the last point along each axis.
    extent: [[i64; 2]; 3],
    spacing: [f64; 3],
    /// The world position of point (0, 0, 0), which need not be in the extent.
    origin: DVec3,
    directions: [DVec3; 3],
}

impl ImageLattice {
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

    /// Reads the volume of an array whose first sample begins here.
    fn read(&self, array: &Array, input: Input, layout: Layout, options: &LoadOptions) -> Result<Volume> {
        let path = input.path().to_owned();
        let (sizes, placement) = self.placed(array.at);
        let grid = placement.grid(&path, &sizes, options.spacing)?;
        let mut axes = vec![(Role::Channel, sized(array.components))];
        axes.extend(sizes.map(|size| (Role::Space, size)));
        let (pick, contents) = picked(&path, &axes, options)?;
        let samples = read_all(input, &pick, array.sample_type, layout)?;
        Ok(placement.volume(grid, samples)?.with_contents(contents))
    }
}

/// Parses exactly `N` numbers, separated by blanks.
fn numbers<T: std::str::FromStr + Copy, const N: usize>(text: &str) -> Option<[T; N]> {
    let numbers: Vec<T> = text.split_ascii_whitespace().map(|word| word.parse().ok()).collect::<Option<_>>()?;
    numbers.try_into().ok()
}
