//! From a name to a volume: which reader reads what.

use std::io::Read;
use std::path::Path;

use glam::{DAffine3, DMat3};

use super::source::{Endian, Packing, SampleType, Source, malformed, open, read_full, sample_count};
use super::{Grid, Volume, metaimage, nifti, npy, nrrd, phantom};
use crate::error::{Error, Result};

/// What a file does not say about itself.
#[derive(Debug, Clone, Default)]
pub struct LoadOptions {
    /// Samples along x, y and z of a file without header.
    pub dims: Option<[u32; 3]>,
    /// Type of the samples of a file without header.
    pub sample_type: Option<SampleType>,
    /// World distance between samples along x, y and z; replaces what a header says.
    pub spacing: Option<[f64; 3]>,
    /// Byte order of a file without header; little where none is given.
    pub endian: Option<Endian>,
    /// Bytes before the samples of a file without header.
    pub offset: u64,
    /// What replaces NaN and infinite values; without it they are an error.
    pub replace_nan: Option<f64>,
}

/// A reader: whether a file's first bytes are its own, and how it reads.
struct Format {
    looks_like: fn(&[u8]) -> bool,
    read: fn(&Path) -> Result<Volume>,
}

/// Asked in this order; MetaImage last, whose files have no magic.
const FORMATS: [Format; 4] = [
    Format { looks_like: nrrd::looks_like, read: nrrd::read },
    Format { looks_like: nifti::looks_like, read: nifti::read },
    Format { looks_like: npy::looks_like, read: npy::read },
    Format { looks_like: metaimage::looks_like, read: metaimage::read },
];

/// Loads a volume from a file, or makes the built-in `demo:NAME[:SIZE]`.
///
/// The format is told by the file's first bytes, not by its name: NRRD, NIfTI-1 and -2 (packed or not), NumPy and
/// MetaImage; anything else is raw samples, x fastest, for which `options` must give dimensions and type.
///
/// # Errors
/// [`Error::Read`] where the file cannot be read, [`Error::Format`] where its content is malformed or not what the
/// options say, [`Error::Volume`] where it makes no volume or holds NaN.
pub fn load(source: &str, options: &LoadOptions) -> Result<Volume> {
    let mut volume = match source.strip_prefix("demo:") {
        Some(name) => {
            reject_raw_options(Path::new(source), options, "a built-in volume")?;
            phantom::demo(name)?
        }
        None => read_file(Path::new(source), options)?,
    };
    if let Some(spacing) = options.spacing {
        volume = respaced(volume, spacing)?;
    }
    match options.replace_nan {
        Some(value) => volume.replace_non_finite(value),
        None => volume.check_finite()?,
    }
    Ok(volume)
}

fn read_file(path: &Path, options: &LoadOptions) -> Result<Volume> {
    let head = first_bytes(path)?;
    if head.is_empty() {
        return Err(malformed(path, "the file is empty"));
    }
    // The .img of a pair is told by its name: its bytes are samples.
    let name = path.to_string_lossy().to_lowercase();
    let image_of_pair = name.trim_end_matches(".gz").ends_with(".img") && options.dims.is_none();
    if image_of_pair {
        return nifti::read(path);
    }
    match FORMATS.iter().find(|f| (f.looks_like)(&head)) {
        Some(format) => {
            reject_raw_options(path, options, "a file with a header")?;
            (format.read)(path)
        }
        None => read_raw(path, options),
    }
}

/// Up to a kilobyte of the file, unpacked.
fn first_bytes(path: &Path) -> Result<Vec<u8>> {
    let failed = |source| Error::Read { path: path.to_owned(), source };
    let mut head = vec![0; 1024];
    let got = read_full(&mut open(path)?, &mut head).map_err(failed)?;
    head.truncate(got);
    if head.starts_with(&[0x1f, 0x8b]) {
        let mut unpacked = vec![0; 1024];
        let mut decoder = flate2::read::MultiGzDecoder::new(open(path)?);
        // A damaged gzip file is reported by the reader that it looks like, or as raw.
        let got = read_full(&mut decoder as &mut dyn Read, &mut unpacked).unwrap_or(0);
        if got > 0 {
            unpacked.truncate(got);
            return Ok(unpacked);
        }
    }
    Ok(head)
}

fn reject_raw_options(path: &Path, options: &LoadOptions, what: &str) -> Result<()> {
    let given = [
        ("--dims", options.dims.is_some()),
        ("--type", options.sample_type.is_some()),
        ("--endian", options.endian.is_some()),
        ("--offset", options.offset != 0),
    ];
    match given.iter().find(|(_, given)| *given) {
        Some((option, _)) => Err(malformed(path, format!("this is {what}: {option} is for raw files"))),
        None => Ok(()),
    }
}

/// Raw samples, x fastest, described by the options alone.
fn read_raw(path: &Path, options: &LoadOptions) -> Result<Volume> {
    let (Some(dims), Some(sample_type)) = (options.dims, options.sample_type) else {
        return Err(malformed(
            path,
            "not NRRD, NIfTI, MetaImage or NumPy; for raw samples give --dims X,Y,Z and --type (u8, i16, f32, ...)",
        ));
    };
    let grid = Grid::axis_parallel(dims, [1.0; 3])?;
    let source = Source {
        path: path.to_owned(),
        offset: Some(options.offset),
        packing: Packing::Raw,
        skip_unpacked: 0,
        sample_type,
        endian: options.endian.unwrap_or_default(),
    };
    Volume::new(grid, source.read(sample_count(path, dims)?)?)
}

/// The volume with other distances between samples, its axes and first sample where they are.
fn respaced(volume: Volume, spacing: [f64; 3]) -> Result<Volume> {
    if let Some(bad) = spacing.iter().find(|s| !(s.is_finite() && **s > 0.0)) {
        return Err(Error::Setting { name: "spacing", reason: format!("{bad}, expected lengths over 0") });
    }
    let grid = volume.grid();
    let m = grid.to_world();
    let [x, y, z] = spacing;
    let axes = DMat3::from_cols(
        m.matrix3.x_axis.normalize() * x,
        m.matrix3.y_axis.normalize() * y,
        m.matrix3.z_axis.normalize() * z,
    );
    let grid = Grid::new(grid.dims(), DAffine3::from_mat3_translation(axes, m.translation))?;
    volume.with_grid(grid)
}
