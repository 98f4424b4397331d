//! Images of VTK (<https://docs.vtk.org/en/latest/vtk_file_formats/index.html>).

mod blocks;
pub(super) mod image_data;
pub(super) mod legacy;
pub(super) mod poly_data;

use glam::DVec3;

use super::LoadOptions;
use super::decode::{Layout, read_all};
use super::input::Input;
use super::placement::{Placement, plain_name};
use super::selection::{Role, colours_of_bytes, picked, sized};
use crate::error::{Result, Subject, refuse, refuse_if};
use crate::volume::{SampleType, Volume};

/// The array of a file that is to be read.
#[derive(Clone, Copy)]
pub(super) enum Wanted<'a> {
    /// The active array, or the first, with one number per sample.
    Scalars,
    /// The active array, or the first, with any number of numbers per sample.
    Any,
    /// The array of this name.
    Named(&'a str),
}

/// The result of reading an array.
pub(super) enum Found {
    Volume(Box<Volume>),
    /// The names of the arrays of a file that does not have the wanted one.
    Others(Vec<String>),
}

/// A reader of one of the formats of images.
type ReadArray = fn(Input, &LoadOptions, Wanted<'_>) -> Result<Found>;

/// Reads the volume of the array `inside`; without a name, of an array with one number per sample, or else with
/// several: for these the file is read again.
pub(super) fn read(input: Input, inside: Option<&str>, options: &LoadOptions, read_array: ReadArray) -> Result<Volume> {
    let (path, is_stream) = (input.path().to_owned(), input.at_most().is_none());
    let names = match read_array(input, options, inside.map_or(Wanted::Scalars, Wanted::Named))? {
        Found::Volume(volume) => return Ok(*volume),
        Found::Others(names) => names,
    };
    if let Some(name) = inside {
        let all = if names.is_empty() { "there is none".to_owned() } else { format!("there are {}", names.join(", ")) };
        refuse!(path, "has no array {name:?}: {all}");
    }
    refuse_if!(is_stream, path, "has no array of one number per sample, and is a stream: write it to a file");
    match read_array(Input::open(&path, None)?, options, Wanted::Any)? {
        Found::Volume(volume) => Ok(*volume),
        Found::Others(_) => refuse!(path, "has no array of scalars"),
    }
}

/// The largest number of arrays whose names are kept.
const MOST_NAMES: usize = 100;

/// Adds the name of an array that is not read.
fn note_name(names: &mut Vec<String>, name: Option<&str>) {
    names.extend(name.and_then(plain_name).filter(|_| names.len() < MOST_NAMES));
}

/// The places of an array's samples in the image: points or cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum At {
    Points,
    Cells,
}

/// An array of samples.
struct SampleArray {
    at: At,
    sample_type: SampleType,
    /// The number of numbers of each sample.
    components: u64,
}

/// The lattice of an image of VTK.
struct ImageLattice {
    /// The first and the last point along each axis.
    extent: [[i64; 2]; 3],
    spacing: [f64; 3],
    /// The world position of point (0, 0, 0), which need not be in the extent.
    origin: DVec3,
    directions: [DVec3; 3],
}

impl ImageLattice {
    /// Returns the number of samples along each axis, and their position. A sample of a cell is at its centre.
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

    /// Reads the volume of an array whose first sample is at the start of `input`.
    fn read(&self, array: &SampleArray, input: Input, layout: Layout, options: &LoadOptions) -> Result<Found> {
        let path = input.path().to_owned();
        let (sizes, placement) = self.placed(array.at);
        let grid = placement.grid(&path, &sizes, options.spacing)?;
        let mut axes = vec![(Role::Channel, sized(array.components))];
        axes.extend(sizes.map(|size| (Role::Space, size)));
        let (pick, mut contents) = picked(&path, &axes, options)?;
        if array.sample_type == SampleType::U8 {
            contents.labels = colours_of_bytes(contents.channels);
        }
        let samples = read_all(input, &pick, array.sample_type, layout)?;
        Ok(Found::Volume(Box::new(placement.volume(grid, samples)?.with_contents(contents))))
    }
}

/// Parses exactly `N` numbers, separated by blanks.
fn numbers<T: std::str::FromStr + Copy, const N: usize>(text: &str) -> Option<[T; N]> {
    let numbers: Vec<T> = text.split_ascii_whitespace().map(|word| word.parse().ok()).collect::<Option<_>>()?;
    numbers.try_into().ok()
}
