//! The volume.

use std::path::PathBuf;

use voxsplat::formats::{LoadOptions, MissingSlices, PyramidLevel};
use voxsplat::volume::{Endian, SampleType};

use super::view::ViewArgs;
use crate::cli::Failure;
use crate::cli::channels::{ChannelArg, channel};
use crate::cli::parse::{self, TimeArg, one_of};

/// The volume, and what its file does not state.
#[derive(Debug, clap::Args)]
pub(in crate::cli) struct InputArgs {
    /// A volume: a file (NRRD, NIfTI, MetaImage, NumPy, MRC, VTK, TIFF, DICOM, raw; HDF5 or NetCDF, also as
    /// FILE:/SET), a folder of DICOM or TIFF files or of Zarr, - for standard input, or a built-in volume,
    /// demo:NAME[:SIZE]; for render also a scene, FILE.json
    #[arg(value_name = "VOLUME")]
    pub(in crate::cli) source: PathBuf,
    /// Raw files: samples along x (fastest), y and z
    #[arg(long, value_name = "X,Y,Z", value_parser = parse::dims, allow_hyphen_values = true, help_heading = "Input")]
    pub(in crate::cli) dims: Option<[u32; 3]>,
    /// Raw files: type of the samples: u8, i8, u16, i16, u32, i32, u64, i64, f32 or f64
    #[arg(long = "type", value_name = "TYPE", value_parser = parse::library::<SampleType>, help_heading = "Input")]
    pub(in crate::cli) sample_type: Option<SampleType>,
    /// Raw files: byte order, little or big [default: little]
    #[arg(long, value_name = "ORDER", value_parser = parse::library::<Endian>, help_heading = "Input")]
    pub(in crate::cli) endian: Option<Endian>,
    /// Raw files: bytes to skip before the samples
    #[arg(long, value_name = "BYTES", default_value_t = 0, help_heading = "Input")]
    pub(in crate::cli) offset: u64,
    /// World distance between samples; replaces the spacing of the file
    #[arg(long, value_name = "X,Y,Z", value_parser = parse::spacing, allow_hyphen_values = true,
        help_heading = "Input")]
    pub(in crate::cli) spacing: Option<[f64; 3]>,
    /// Replace NaN and infinite samples by VALUE; without this option they are refused. They are transparent if the
    /// transfer function gives VALUE no opacity
    #[arg(long, value_name = "VALUE", value_parser = parse::number, allow_hyphen_values = true, help_heading = "Input")]
    pub(in crate::cli) replace_nan: Option<f64>,
    /// Files of several channels: draw channel N, counted from 0. Repeat the option to draw several together, each in a
    /// colour [default: all, in the colours of the file or green, magenta, cyan ..; red, green and blue as colours]
    #[arg(long, value_name = "N[:COLOUR]", value_parser = channel, help_heading = "Input")]
    pub(in crate::cli) channel: Vec<ChannelArg>,
    /// Files of several points in time: which of them, counted from 0; for turntable also a range or all of them, one
    /// after the other, by the transfer function of the first and framed for all [default: 0]
    #[arg(long, value_name = "N|FIRST-LAST|all", value_parser = parse::time, help_heading = "Input")]
    pub(in crate::cli) time: Option<TimeArg>,
    /// Folders of DICOM files, or of OME-Zarr by Bio-Formats: which of several series, counted from 1; without this
    /// option those of DICOM are listed
    #[arg(long, value_name = "N", help_heading = "Input")]
    pub(in crate::cli) series: Option<u32>,
    /// Folders of DICOM files: refuse a series that lacks slices between others, or interpolate them
    #[arg(long, value_name = "HOW", default_value = "refuse",
        value_parser = one_of(MissingSlices::ALL, MissingSlices::name), help_heading = "Input")]
    pub(in crate::cli) missing_slices: MissingSlices,
    /// OME-Zarr: which level of the pyramid of resolutions, 0 is the finest [default: the coarsest whose samples are no
    /// coarser than pixels]
    #[arg(long, value_name = "N", help_heading = "Input")]
    pub(in crate::cli) pyramid: Option<u32>,
    /// Read a volume of more than MIB MiB piece by piece from its file, if that is uncompressed
    #[arg(long, value_name = "MIB", default_value_t = 4, help_heading = "Input")]
    pub(in crate::cli) stream_over: u64,
}

impl InputArgs {
    /// The options for a picture: of a pyramid, the level that its pixels need.
    pub(in crate::cli) fn options_for(&self, view: &ViewArgs, size: [u32; 2]) -> LoadOptions {
        let options = self.options();
        let level = match (self.pyramid, view.view_height) {
            (Some(_), _) => options.level,
            (None, Some(height)) => PyramidLevel::PixelSize(height / view.zoom / f64::from(size[1])),
            (None, None) => PyramidLevel::Pixels(f64::from(size[0].max(size[1])) * view.zoom),
        };
        LoadOptions { level, ..options }
    }

    /// Refuses several points in time.
    pub(in crate::cli) fn check_one_time(&self) -> Result<(), Failure> {
        match self.time {
            None | Some(TimeArg::One(_)) => Ok(()),
            Some(several) => Err(Failure::Usage(format!("--time {several}: several points in time are for turntable"))),
        }
    }

    pub(in crate::cli) fn options(&self) -> LoadOptions {
        LoadOptions {
            dims: self.dims,
            sample_type: self.sample_type,
            spacing: self.spacing,
            endian: self.endian,
            offset: self.offset,
            replace_nan: self.replace_nan,
            time: self.time.map(TimeArg::first),
            channel: self.channel.first().map(|channel| channel.number),
            series: self.series,
            missing_slices: self.missing_slices,
            level: self.pyramid.map_or(LoadOptions::default().level, PyramidLevel::At),
            stream_over: self.stream_over.saturating_mul(1 << 20),
        }
    }
}
