//! The input volume.

use std::path::PathBuf;

use voxsplat::appearance::pyramid_level;
use voxsplat::camera::View;
use voxsplat::formats::{
    AxisOrder, CAN_FETCH, ComplexPart, FORMATS, FetchOptions, FetchProgress, Format, LoadOptions, MissingSlices,
    PyramidLevel,
};
use voxsplat::program::ChannelChoice;
use voxsplat::volume::{Endian, SampleType};

use crate::failure::{Failure, refuse};
use crate::parse::{self, TimeArg, one_of};
use crate::progress;

/// Returns the help of the volume: formats as the library lists them.
fn volume_help() -> String {
    let format = |format: &Format| match format.feature.filter(|_| !format.is_built()) {
        Some(feature) => format!("{} ({}; this build lacks --features {feature})", format.name, format.description),
        None => format!("{} ({})", format.name, format.description),
    };
    let formats: Vec<String> = FORMATS.iter().map(format).collect();
    let lacks = if CAN_FETCH { "" } else { " (this build lacks --features remote)" };
    format!(
        "A volume: a file, a folder of slices, - for standard input, a url{lacks}, or a built-in volume, \
         demo:NAME[:SIZE] with SIZE in voxels along each axis. render, slice and turntable also take a scene, \
         FILE.json.\n\n\
         Urls begin with https://, http:// or s3://BUCKET/. S3 is read as the variables AWS_ACCESS_KEY_ID, \
         AWS_SECRET_ACCESS_KEY, AWS_SESSION_TOKEN, AWS_REGION and AWS_ENDPOINT_URL state, anonymously without keys.\n\n\
         Formats: {}; raw samples.",
        formats.join("; ")
    )
}

/// The volume, and the properties that its file does not state.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Input")]
pub(crate) struct InputArgs {
    /// A volume: a file, a folder of slices, a url, - for standard input, or demo:NAME[:SIZE]
    #[arg(value_name = "VOLUME", long_help = volume_help())]
    pub(crate) source: PathBuf,
    /// Raw files: number of samples along x (fastest, see --axis-order), y and z
    #[arg(long, value_name = "X,Y,Z", value_parser = parse::dims)]
    pub(crate) dims: Option<[u32; 3]>,
    /// Raw files: type of the samples: u8, i8, u16, i16, u32, i32, u64, i64, f32 or f64
    #[arg(long = "type", value_name = "TYPE", value_parser = parse::library::<SampleType>)]
    pub(crate) sample_type: Option<SampleType>,
    /// Raw files: byte order, little or big [default: little]
    #[arg(long, value_name = "ORDER", value_parser = parse::library::<Endian>)]
    pub(crate) endian: Option<Endian>,
    /// Raw files: bytes to skip before the samples
    #[arg(long, value_name = "BYTES", default_value_t = 0, value_parser = parse::whole::<u64, 0, { u64::MAX }>)]
    pub(crate) offset: u64,
    /// NumPy arrays and raw files: order of the axes, zyx (x is the last and the fastest) or xyz [default: zyx]
    ///
    /// Arrays of nibabel are indexed (x, y, z). A note says if an array looks so and no order is requested.
    #[arg(long, value_name = "ORDER", value_parser = parse::library::<AxisOrder>)]
    pub(crate) axis_order: Option<AxisOrder>,
    /// World distance between samples; replaces the spacing of the file
    #[arg(long, value_name = "X,Y,Z", value_parser = parse::spacing)]
    pub(crate) spacing: Option<[f64; 3]>,
    /// Replace NaN and infinite samples by VALUE [default: draw nothing there]
    #[arg(long, value_name = "VALUE", value_parser = parse::number)]
    pub(crate) replace_nan: Option<f64>,
    /// Draw channel N, counted from 0; repeat the option to draw several, each in a colour
    ///
    /// [default: all channels, in the colours of the file or in green, magenta, cyan ..; channels that the file calls
    /// red, green and blue are the colours of voxels]
    #[arg(long, value_name = "N[:COLOUR]", value_parser = parse::library::<ChannelChoice>)]
    pub(crate) channel: Vec<ChannelChoice>,
    /// Draw time point N, counted from 0; a turntable also takes a range or all [default: 0]
    ///
    /// All frames use the first time point's transfer function and one common framing.
    #[arg(long, value_name = "N|FIRST-LAST|all", value_parser = parse::time)]
    pub(crate) time: Option<TimeArg>,
    /// Folders of DICOM files, TIFF, or OME-Zarr by Bio-Formats: read the N-th series, counted from 1 [default: list
    /// the series, if there are several]
    #[arg(long, value_name = "N", value_parser = parse::whole::<u32, 1, { u64::MAX }>)]
    pub(crate) series: Option<u32>,
    /// DICOM: refuse a series that lacks slices or has unequally spaced ones, or interpolate slices at equal distances
    #[arg(long, value_name = "HOW", default_value = "refuse", value_parser = one_of(MissingSlices::ALL,
        MissingSlices::name))]
    pub(crate) missing_slices: MissingSlices,
    /// Complex samples: read the absolute value (abs), real, imag or phase [default: refuse them]
    #[arg(long, value_name = "PART", value_parser = one_of(ComplexPart::ALL, ComplexPart::name))]
    pub(crate) complex: Option<ComplexPart>,
    /// OME-Zarr: read level N of the pyramid, 0 is the finest [default: the coarsest level whose samples are no coarser
    /// than pixels]
    #[arg(long, value_name = "N", value_parser = parse::whole::<u32, 0, { u64::MAX }>)]
    pub(crate) pyramid: Option<u32>,
    /// Volumes at urls: refuse to fetch more than SIZE bytes; K, M, G or T behind it stands for KiB, MiB, GiB or TiB
    #[arg(long, value_name = "SIZE", default_value = "1G", value_parser = parse::bytes)]
    pub(crate) fetch_limit: u64,
}

impl InputArgs {
    /// Returns the options that load the volume for a picture: of a pyramid they choose the level that its pixels need.
    pub(crate) fn options_for(&self, view: &View, size: [u32; 2]) -> LoadOptions {
        let options = self.options();
        let level = if self.pyramid.is_some() { options.level } else { pyramid_level(view, size) };
        LoadOptions { level, ..options }
    }

    /// Refuses several time points.
    pub(crate) fn check_one_time(&self) -> Result<(), Failure> {
        match self.time {
            None | Some(TimeArg::One(_)) => Ok(()),
            Some(several) => refuse(format!("--time {several}: several time points are for turntable")),
        }
    }

    pub(crate) fn options(&self) -> LoadOptions {
        LoadOptions {
            dims: self.dims,
            sample_type: self.sample_type,
            spacing: self.spacing,
            endian: self.endian,
            offset: self.offset,
            axis_order: self.axis_order,
            replace_nan: self.replace_nan,
            time: self.time.map(TimeArg::first),
            channel: self.channel.first().map(|channel| channel.number),
            series: self.series,
            missing_slices: self.missing_slices,
            complex: self.complex,
            level: self.pyramid.map_or(LoadOptions::default().level, PyramidLevel::At),
            fetch: FetchOptions {
                limit: self.fetch_limit,
                progress: Some(FetchProgress(progress::fetched)),
                ..FetchOptions::default()
            },
            ..LoadOptions::default()
        }
    }
}
