//! The fuzz targets, for cargo-fuzz (`fuzz/fuzz_targets`) and for the suite (`tests/suite/hostile/fuzz.rs`): from bytes
//! to a value or an error of one line.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use voxsplat::appearance::suggest;
use voxsplat::error::{Error, InputError, Result};
use voxsplat::formats::{AxisOrder, LoadOptions, TimeSeries, load};
use voxsplat::image::{DepthMap, Image};
use voxsplat::solids::load_mesh;
use voxsplat::transfer::presets::{self, PresetValues};
use voxsplat::transfer::{Imported, TransferFunction, Window};
use voxsplat::volume::{Endian, Grid, SampleType, Statistics, Volume};

/// Files with their contents.
type Files = Vec<(PathBuf, Vec<u8>)>;

/// The folder in which files are written for the readers, with the fixtures that headers may name.
pub struct Place {
    folder: PathBuf,
    /// The files of the folders of Zarr, with their contents.
    zarr: Vec<(PathBuf, Files)>,
}

/// A fuzzed function. It returns whether the bytes were accepted.
pub type Target = fn(&Place, &[u8]) -> bool;

/// Every target by name, with the extensions of its seeds among the fixtures.
pub const TARGETS: &[(&str, Target, &[&str])] = &[
    ("nrrd", |place, bytes| place.volume("fuzzed.nrrd", bytes), &[".nrrd", ".nhdr"]),
    ("nifti", |place, bytes| place.volume("fuzzed.nii", bytes), &[".nii", ".nii.gz", ".hdr", ".hdr.gz"]),
    ("metaimage", |place, bytes| place.volume("fuzzed.mha", bytes), &[".mha", ".mhd"]),
    ("npy", |place, bytes| place.volume("fuzzed.npy", bytes), &[".npy", ".npy.gz"]),
    ("npz", |place, bytes| place.volume("fuzzed.npz", bytes), &[".npz"]),
    ("mgh", |place, bytes| place.volume("fuzzed.mgh", bytes), &[".mgh", ".mgz"]),
    ("afni", |place, bytes| place.volume("fuzzed.HEAD", bytes), &[".HEAD"]),
    ("philips", |place, bytes| place.volume("fuzzed.PAR", bytes), &[".PAR"]),
    ("mrc", |place, bytes| place.volume("fuzzed.mrc", bytes), &[".mrc", ".map", ".ccp4", ".mrc.gz"]),
    ("vti", |place, bytes| place.volume("fuzzed.vti", bytes), &[".vti"]),
    ("vtk", |place, bytes| place.volume("fuzzed.vtk", bytes), &[".vtk"]),
    ("slc", |place, bytes| place.volume("fuzzed.slc", bytes), &[".slc"]),
    ("tiff", |place, bytes| place.volume("fuzzed.tif", bytes), &[".tif", ".tiff", ".lsm"]),
    ("dicom", |place, bytes| place.volume("fuzzed.dcm", bytes), &[".dcm"]),
    ("hdf5", |place, bytes| place.volume("fuzzed.h5", bytes), &[".h5", ".nc", ".mat", ".mnc", ".vtkhdf"]),
    ("zarr", Place::zarr, &[]),
    ("zip", |place, bytes| place.volume("fuzzed.zip", bytes), &[".zip", ".ozx"]),
    ("raw", Place::raw, &[".raw", ".img", ".raw.gz"]),
    ("data", Place::data, &[".raw.gz", ".zraw", ".z", ".raw"]),
    ("transfer", Place::transfer, &[".json", ".vp", ".xml"]),
    ("ply", |place, bytes| place.mesh("fuzzed.ply", bytes), &[".ply"]),
    ("stl", |place, bytes| place.mesh("fuzzed.stl", bytes), &[".stl"]),
    ("obj", |place, bytes| place.mesh("fuzzed.obj", bytes), &[".obj"]),
    ("vtp", |place, bytes| place.mesh("fuzzed.vtp", bytes), &[".vtp"]),
    ("png", |place, bytes| place.picture("fuzzed.png", bytes), &[".png"]),
    ("exr", |place, bytes| place.picture("fuzzed.exr", bytes), &[".exr"]),
];

/// Headers that read their samples from fuzzed bytes.
const HEADERS: [(&str, &str); 5] = [
    ("raw.nhdr", "NRRD0004\ntype: short\ndimension: 3\nsizes: 3 4 5\nendian: little\nencoding: raw\nbyte skip: -1\n"),
    ("gzip.nhdr", "NRRD0004\ntype: float\ndimension: 3\nsizes: 3 4 5\nendian: big\nencoding: gzip\nline skip: 1\n"),
    ("text.nhdr", "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 3 4 5\nencoding: text\n"),
    ("hex.nhdr", "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 3 4 5\nencoding: hex\nbyte skip: 2\n"),
    ("zlib.mhd", "NDims = 3\nDimSize = 3 4 5\nElementType = MET_SHORT\nCompressedData = True\n"),
];

impl Place {
    /// A folder for files, with copies of the fixtures.
    pub fn new(folder: &Path, fixtures: &Path) -> std::io::Result<Self> {
        for entry in std::fs::read_dir(fixtures)? {
            let entry = entry?;
            std::fs::copy(entry.path(), folder.join(entry.file_name()))?;
        }
        // The files of samples of headers.
        for (from, to) in [("pair-i16.img", "img"), ("scaled-i16+orig.BRIK", "BRIK"), ("raw-u16.REC", "REC")] {
            std::fs::copy(fixtures.join(from), folder.join(format!("fuzzed.{to}")))?;
        }
        for (name, header) in HEADERS {
            let field = if name.ends_with(".mhd") { "ElementDataFile = " } else { "data file: " };
            std::fs::write(folder.join(format!("fuzzed-{name}")), format!("{header}{field}fuzzed.data\n"))?;
        }
        let mut zarr = Vec::new();
        for entry in std::fs::read_dir(fixtures.join("../zarr"))? {
            let from = entry?.path();
            if from.is_dir() {
                let to = folder.join(from.file_name().unwrap_or_default());
                let mut files = Vec::new();
                copied(&from, &to, &mut files)?;
                files.sort();
                zarr.push((to, files));
            }
        }
        zarr.sort();
        Ok(Self { folder: folder.to_owned(), zarr })
    }

    fn written(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.folder.join(name);
        // Truncating the last file first would flush it to the disk, which takes milliseconds.
        let file = File::options().write(true).create(true).truncate(false).open(&path);
        file.and_then(|mut file| {
            file.write_all(bytes)?;
            file.set_len(bytes.len() as u64)
        })
        .expect("the folder of the fuzzed files can be written to");
        path
    }

    fn volume(&self, name: &str, bytes: &[u8]) -> bool {
        let path = self.written(name, bytes);
        let volume = load(&path, &LoadOptions::default());
        let times = volume.as_ref().map_or(1, |volume| volume.contents().times);
        if times > 1 {
            // Another reader: it decompresses the file once.
            let mut series = TimeSeries::new(&path, &LoadOptions::default());
            checked(series.volume(times - 1));
            checked(series.volume(0));
        }
        checked(volume)
    }

    /// Bytes without a header: the first sixteen are the options.
    fn raw(&self, bytes: &[u8]) -> bool {
        let Some((options, samples)) = bytes.split_first_chunk::<16>() else { return false };
        let [x, y, z, long, kind, order, skip, replace, ..] = *options;
        let dims = [x, y, z].map(u32::from);
        let options = LoadOptions {
            dims: Some(if long == 0 { dims.map(|d| d << 16 | 0xffff) } else { dims }),
            sample_type: Some(SampleType::ALL[usize::from(kind) % SampleType::ALL.len()]),
            endian: Some(if order & 1 == 0 { Endian::Little } else { Endian::Big }),
            offset: u64::from(skip).saturating_pow(u32::from(order >> 4)),
            axis_order: (order & 4 != 0).then_some(AxisOrder::Xyz),
            spacing: (order & 2 == 0).then(|| std::array::from_fn(|a| 10_f64.powi(i32::from(options[8 + a]) - 128))),
            replace_nan: (replace & 1 == 0).then(|| 10_f64.powi(i32::from(replace) - 128)),
            stream_over: u64::from(replace),
            ..LoadOptions::default()
        };
        checked(load(self.written("fuzzed.bytes", samples), &options))
    }

    /// Bytes that good headers name; the first byte chooses the header.
    fn data(&self, bytes: &[u8]) -> bool {
        let Some((&choice, bytes)) = bytes.split_first() else { return false };
        self.written("fuzzed.data", bytes);
        let (name, _) = HEADERS[usize::from(choice) % HEADERS.len()];
        checked(load(self.folder.join(format!("fuzzed-{name}")), &LoadOptions::default()))
    }

    /// Bytes of a file of a folder of Zarr; the first two choose the folder and the file.
    fn zarr(&self, bytes: &[u8]) -> bool {
        let Some(([folder, file], bytes)) = bytes.split_first_chunk::<2>().map(|(choice, bytes)| (*choice, bytes))
        else {
            return false;
        };
        let (folder, files) = &self.zarr[usize::from(folder) % self.zarr.len()];
        let (file, content) = &files[usize::from(file) % files.len()];
        std::fs::write(file, bytes).expect("the folder of the fuzzed files can be written to");
        let options = LoadOptions { channel: Some(0), ..LoadOptions::default() };
        let accepted = checked(load(folder, &options));
        std::fs::write(file, content).expect("the folder of the fuzzed files can be written to");
        accepted
    }

    /// The seeds of [`Place::zarr`].
    pub fn zarr_seeds(&self) -> Vec<Vec<u8>> {
        let of = |(folder, (_, files)): (usize, &(PathBuf, Files))| {
            let seed = |(file, (_, content)): (usize, &(PathBuf, Vec<u8>))| {
                [&[folder as u8, file as u8], content.as_slice()].concat()
            };
            files.iter().enumerate().map(seed).collect::<Vec<_>>()
        };
        self.zarr.iter().enumerate().flat_map(of).collect()
    }

    fn transfer(&self, bytes: &[u8]) -> bool {
        accepted(Imported::load(self.written("fuzzed.json", bytes))).is_some_and(|imported| {
            let grid = Grid::axis_parallel([2; 3], [0.5, 1.0, 2.0]);
            let window = Window { level: 10.0, width: 20.0 };
            grid.iter().for_each(|grid| drop(accepted(imported.placed(grid, Some(&window)))));
            let transfer = imported.transfer;
            let again = TransferFunction::from_json(&transfer.to_json());
            assert!(again.is_ok_and(|again| again == transfer), "what is written is not what is read");
            let [first, last] = transfer.range();
            for value in [first, last, transfer.base(), f64::MIN, f64::MAX, 0.0] {
                let (color, opacity) = transfer.sample(value);
                assert!(color.iter().chain([&opacity]).all(|c| (-1e-9..=1.0 + 1e-9).contains(c)), "{value}");
            }
            true
        })
    }

    /// A mesh, whose triangles have vertices with finite places.
    fn mesh(&self, name: &str, bytes: &[u8]) -> bool {
        accepted(load_mesh(self.written(name, bytes))).is_some_and(|mesh| {
            let mut places = mesh.triangles.iter().flatten().map(|&vertex| mesh.place(vertex));
            assert!(places.all(|place| place.is_finite()));
            true
        })
    }

    fn picture(&self, name: &str, bytes: &[u8]) -> bool {
        let path = self.written(name, bytes);
        accepted(DepthMap::load(&path));
        accepted(Image::load(&path)).is_some_and(|image| {
            let same = voxsplat::image::compare(&image, &image, 0.0);
            assert!(same.is_ok_and(|same| same.rms == 0.0 || image.pixels().iter().flatten().any(|v| !v.is_finite())));
            true
        })
    }
}

/// Copies a folder, and lists its files with their contents.
fn copied(from: &Path, to: &Path, files: &mut Files) -> std::io::Result<()> {
    std::fs::create_dir_all(to)?;
    for entry in std::fs::read_dir(from)? {
        let entry = entry?;
        let (from, to) = (entry.path(), to.join(entry.file_name()));
        if from.is_dir() {
            copied(&from, &to, files)?;
        } else {
            let content = std::fs::read(from)?;
            std::fs::write(&to, &content)?;
            files.push((to, content));
        }
    }
    Ok(())
}

/// Reads a whole volume, and the properties that `info` prints.
fn checked(volume: Result<Volume, InputError>) -> bool {
    let Some(volume) = accepted(volume) else { return false };
    let Some(samples) = accepted(volume.in_memory()) else { return false };
    assert_eq!(samples.samples().len() as u64, volume.grid().len());
    if let Some(statistics) = accepted(Statistics::of(&volume)) {
        assert_eq!(statistics.count + statistics.non_finite, volume.grid().len());
        assert_eq!(statistics.histogram().iter().sum::<u64>(), statistics.count);
        let name = suggest(&volume, &statistics).name;
        accepted(presets::preset(name, &volume, &statistics, PresetValues::Auto));
    }
    true
}

/// Returns the value; an error must be a reading error of one line of bearable length.
fn accepted<T, E: Into<Error>>(result: Result<T, E>) -> Option<T> {
    let refused = |error: Error| {
        assert_one_line(&error);
        let reading =
            matches!(error, Error::Input(_) | Error::Setting { .. } | Error::Transfer(_) | Error::Memory { .. });
        assert!(reading, "{error:?}");
    };
    result.map_err(|error| refused(error.into())).ok()
}

/// Refuses an error that is not one line of bearable length.
pub fn assert_one_line(error: &impl std::fmt::Display) {
    let text = format!("{error:#}");
    assert!(!text.contains(char::is_control) && text.chars().count() < 2000, "{text:?}");
}
