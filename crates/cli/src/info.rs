//! The command `voxsplat info`.

use std::path::Path;

use glam::DVec3;
use serde::Serialize;
use voxsplat::appearance::suggest;
use voxsplat::error::{Error, Hint};
use voxsplat::formats::{self, LoadOptions, PyramidLevel, Series, is_url};
use voxsplat::program::{GUESS, LabelLooks, ValueMeaning};
use voxsplat::transfer::presets::PresetValues;
use voxsplat::volume::{Channel, Grid, Statistics, Volume};
use voxsplat_volume::names::{percent, readable};

use super::args::InfoArgs;
use super::failure::Failure;
use super::layers::Listed;
use super::options::{OptionValues, quoted};
use super::progress::ProgressLine;
use super::report::{self, Choices, NO_FILES};
use super::session::say_level;
use super::{histogram, layers, output};

/// The properties of a volume. Field names are the keys of the JSON.
#[derive(Serialize)]
struct Info {
    source: String,
    dims: [u32; 3],
    voxels: u64,
    #[serde(rename = "type")]
    sample_type: &'static str,
    bytes: u64,
    slope: f64,
    intercept: f64,
    spacing: [f64; 3],
    /// The world length of the volume along each lattice axis, between its outer faces.
    extent: [f64; 3],
    center: [f64; 3],
    /// The unit of world lengths; `None` if it is not known.
    length_unit: Option<String>,
    /// The unit of values; `None` if the file does not state it.
    value_unit: Option<String>,
    /// The orientation of the lattice in the patient; `None` if the file does not state it.
    orientation: Option<Orientation>,
    min: f64,
    max: f64,
    mean: f64,
    std_dev: f64,
    /// The counts in equal bins over min..max.
    histogram: Vec<u64>,
    /// The largest value of the background, and its share of the voxels; `None` if all values are the same.
    background: Option<[f64; 2]>,
    /// The suggested preset, or labels; `None` for a built-in volume, which has a transfer function of its own, and if
    /// no preset fits.
    preset: Option<&'static str>,
    reason: String,
    /// Whether the values decided on the preset, because the file does not state its method.
    guess: bool,
    /// The method that made the values, as the file states it.
    modality: Option<String>,
    description: Option<String>,
    /// The meaning of the values, as the file states it.
    intent: Option<String>,
    /// The number of time points of the file.
    times: u32,
    /// The described time point.
    time: u32,
    /// The number of levels of the file's pyramid.
    levels: u32,
    /// The described level of the pyramid.
    level: u32,
    /// The number of channels of the file.
    channels: u32,
    /// The described channel.
    channel: u32,
    /// The names, colours and windows that the file states for its channels.
    labels: Vec<ChannelLabel>,
    /// Properties of the file that the volume could not keep.
    notes: Vec<String>,
    /// The command line that renders the volume; `None` if it needs a transfer function that the user must write.
    command: Option<String>,
}

/// The labels of a volume, as JSON.
#[derive(Serialize)]
struct LabelList {
    labels: Vec<Listed>,
}

/// The series of a folder, as JSON.
#[derive(Serialize)]
struct Several {
    source: String,
    series: Vec<Series>,
}

/// The name, colour and window that the file states for a channel.
#[derive(Serialize)]
struct ChannelLabel {
    name: Option<String>,
    /// The colour of the channel as #rrggbb.
    color: Option<String>,
    window: Option<[f64; 2]>,
}

/// The directions of the lattice axes in the patient.
#[derive(Serialize)]
struct Orientation {
    /// The letters of the lattice axes, one per axis: Left, Right, Posterior, Anterior, Superior or Inferior.
    axes: String,
    /// The largest angle between a lattice axis and the patient axis of its letter, degrees.
    oblique: f64,
}

impl ChannelLabel {
    fn of(channel: &Channel) -> Self {
        let color = channel.color.map(|[r, g, b]| format!("#{r:02x}{g:02x}{b:02x}"));
        Self { name: channel.name.clone(), color, window: channel.window }
    }

    /// Returns name, colour and window of the channel as text, if they are stated.
    fn text(&self) -> String {
        let window = self.window.map(|[low, high]| format!("{} to {}", readable(low), readable(high)));
        [self.name.clone(), self.color.clone(), window].into_iter().flatten().collect::<Vec<_>>().join(" ")
    }
}

impl Orientation {
    fn of(grid: &Grid) -> Self {
        let m = grid.to_world().matrix3;
        let mut oblique = 0.0_f64;
        let letters = [m.x_axis, m.y_axis, m.z_axis].map(|axis: DVec3| {
            let axis = axis.normalize();
            // The axes of patient space run to the left, to the back and to the head.
            let named = [(axis.x, "LR"), (axis.y, "PA"), (axis.z, "SI")];
            let (along, names) = named
                .into_iter()
                .fold((0.0, "??"), |best: (f64, &str), next| if next.0.abs() > best.0.abs() { next } else { best });
            oblique = oblique.max(libm::acos(along.abs().clamp(0.0, 1.0)).to_degrees());
            &names[if along < 0.0 { 1..2 } else { 0..1 }]
        });
        Self { axes: letters.join("-"), oblique }
    }
}

pub(crate) fn run(args: &InfoArgs, options: &[OptionValues]) -> Result<(), Failure> {
    args.input.check_one_time()?;
    if args.labels {
        let mut load = args.input.options();
        load.replace_nan = load.replace_nan.or(Some(0.0));
        let of = |channel| Ok(formats::load(&args.input.source, &LoadOptions { channel, ..load })?);
        let first = LoadOptions { channel: load.channel.or(Some(0)), ..load };
        let Some(first) = loaded(args, &first)? else { return Ok(()) };
        let unit = first.length_unit().map(str::to_owned);
        let all = if load.channel.is_some() { vec![first] } else { layers::with_others(first, of)? };
        let listed = layers::list(&all, &LabelLooks::new(args.label_table.as_deref(), &[])?)?;
        if listed.len() > MANY && args.label_table.is_none() {
            output::say("note: so many labels may be grey values, which info describes without --labels");
        }
        return match output::is_json() {
            true => report::print(Choices::default(), NO_FILES, LabelList { labels: listed }),
            false => layers::print(&listed, unit.as_deref()),
        };
    }
    let (volume, statistics) = {
        let load = args.input.options();
        // A file of several channels is described by its first.
        let channel = load.channel.or(Some(0));
        // A level of a pyramid that is read quickly, by a network less than by a disk.
        let pixels = if is_url(&args.input.source) { 256.0 } else { 512.0 };
        let level = if args.input.pyramid.is_none() { PyramidLevel::Pixels(pixels) } else { load.level };
        let Some(volume) = loaded(args, &LoadOptions { channel, level, ..load })? else { return Ok(()) };
        say_level(&volume, &load);
        let _progress = ProgressLine::spinner("reading");
        let statistics = Statistics::of(&volume)?;
        (volume, statistics)
    };
    let info = Info::new(&args.input.source, options, &volume, &statistics)?;
    match output::is_json() {
        true => report::print(Choices { preset: info.preset, classification: None, look: None }, NO_FILES, &info),
        false => output::print(&info.to_text()),
    }
}

/// The largest number of labels that are listed without a note: grey values of 8 bits are fewer.
const MANY: usize = 256;

/// Loads the volume. If it is one of several series and none is requested, prints the series and returns `None`.
fn loaded(args: &InfoArgs, load: &LoadOptions) -> Result<Option<Volume>, Failure> {
    let source = &args.input.source;
    let read = {
        let _progress = ProgressLine::spinner("reading");
        formats::load(source, load)
    };
    match read {
        Err(error) if error.hint() == Some(Hint::ChooseSeries) => match formats::list_series(source)? {
            all if all.is_empty() => Err(error.into()),
            series if output::is_json() => {
                let several = Several { source: source.to_string_lossy().into_owned(), series };
                report::print(Choices::default(), NO_FILES, several).map(|()| None)
            }
            all => output::print(&in_table(source, &all)).map(|()| None),
        },
        volume => Ok(Some(volume?)),
    }
}

/// The number of last characters of an identifier that a table shows.
const SHOWN_OF_UID: usize = 12;

/// Returns a table of series, and the option that chooses one of them.
fn in_table(source: &Path, all: &[Series]) -> String {
    let by = |numbers: [String; 3]| numbers.join(" x ");
    let row = |series: &Series| {
        let lattice = series.dims.map_or("no volume".to_owned(), |dims| by(dims.map(|dim| dim.to_string())));
        let times = if series.times > 1 { format!(", {} times", series.times) } else { String::new() };
        let date = match series.date.as_deref().unwrap_or_default() {
            date if date.len() == 8 && date.is_ascii() => [&date[..4], &date[4..6], &date[6..]].join("-"),
            date => date.to_owned(),
        };
        let from = series.uid.char_indices().rev().nth(SHOWN_OF_UID).map(|(at, c)| at + c.len_utf8());
        let uid = from.map_or(series.uid.clone(), |from| format!("…{}", &series.uid[from..]));
        [
            series.number.to_string(),
            series.modality.clone(),
            series.files.to_string(),
            lattice + &times,
            series.spacing.map_or(String::new(), |spacing| by(spacing.map(readable))),
            date,
            uid,
            series.description.clone(),
        ]
    };
    let names = ["series", "modality", "files", "lattice", "spacing", "date", "uid", "description"];
    let rows: Vec<[String; 8]> = std::iter::once(names.map(str::to_owned)).chain(all.iter().map(row)).collect();
    let widths: [usize; 8] =
        std::array::from_fn(|n| rows.iter().map(|row| row[n].chars().count()).max().unwrap_or_default());
    let line = |row: &[String; 8]| {
        let cells = row.iter().zip(widths).map(|(cell, width)| format!("{cell:<width$}"));
        cells.collect::<Vec<_>>().join("  ").trim_end().to_owned() + "\n"
    };
    let table: String = rows.iter().map(line).collect();
    table + &format!("describe one: voxsplat info {} --series N\n", quoted(source.as_os_str()))
}

impl Info {
    fn new(source: &Path, options: &[OptionValues], volume: &Volume, statistics: &Statistics) -> Result<Self, Failure> {
        let grid = volume.grid();
        let (slope, intercept) = volume.rescale();
        let meaning = ValueMeaning::find(source, volume, true, PresetValues::Auto, || Ok(statistics.clone()));
        let fits = meaning.is_ok();
        let (preset, reason, guess) = match meaning.map(ValueMeaning::look) {
            Ok(look) => look,
            Err(Error::Transfer(_)) => {
                let reason = suggest(volume, statistics).reason;
                (None, format!("no preset fits: {reason}; write one, and give --transfer FILE.json"), false)
            }
            Err(error) => return Err(error.into()),
        };
        let (spacing, contents) = (grid.spacing(), volume.contents());
        Ok(Self {
            source: source.to_string_lossy().into_owned(),
            dims: grid.dims(),
            voxels: grid.len(),
            sample_type: volume.sample_type().name(),
            bytes: grid.len() * volume.sample_type().size() as u64,
            slope,
            intercept,
            spacing,
            extent: std::array::from_fn(|a| spacing[a] * f64::from(grid.dims()[a])),
            center: grid.center().to_array(),
            length_unit: volume.length_unit().map(str::to_owned),
            value_unit: volume.value_unit().map(str::to_owned),
            orientation: volume.is_oriented().then(|| Orientation::of(grid)),
            min: statistics.min,
            max: statistics.max,
            mean: statistics.mean,
            std_dev: statistics.std_dev,
            histogram: statistics.histogram(),
            background: statistics.background().map(|b| [b.limit, b.fraction]),
            preset,
            reason,
            guess,
            modality: contents.origin.modality.clone(),
            description: contents.origin.description.clone(),
            intent: contents.origin.intent.clone(),
            times: contents.times,
            time: contents.time,
            levels: contents.levels,
            level: contents.level,
            channels: contents.channels,
            channel: contents.channel,
            labels: contents.labels.iter().map(ChannelLabel::of).collect(),
            notes: contents.notes.clone(),
            command: fits.then(|| command(source, options, preset)),
        })
    }

    fn to_text(&self) -> String {
        let by = |v: &[f64; 3]| v.map(readable).join(" x ");
        let mut text = String::new();
        let mut line = |name: &str, value: String| text += &format!("{name:<12} {value}\n");
        line("volume", self.source.clone());
        let [x, y, z] = self.dims;
        line("lattice", format!("{x} x {y} x {z} = {} voxels", self.voxels));
        line("samples", format!("{}, {}", self.sample_type, in_bytes(self.bytes)));
        let several = [
            ("times", self.times, self.time),
            ("levels", self.levels, self.level),
            ("channels", self.channels, self.channel),
        ];
        for (name, count, described) in several.into_iter().filter(|(_, count, _)| *count > 1) {
            line(name, format!("0 to {}: {described} is described", count - 1));
        }
        for (n, label) in self.labels.iter().enumerate().filter(|_| self.channels > 1) {
            line("", format!("{n} {}", label.text()));
        }
        if (self.slope, self.intercept) != (1.0, 0.0) {
            line("values", format!("{} * sample + {}", readable(self.slope), readable(self.intercept)));
        }
        let stated = [("modality", &self.modality), ("description", &self.description), ("intent", &self.intent)];
        for (name, value) in stated.into_iter().filter_map(|(name, value)| Some((name, value.as_ref()?))) {
            line(name, value.clone());
        }
        line("spacing", by(&self.spacing));
        for note in &self.notes {
            line("note", note.clone());
        }
        let unit = self.length_unit.as_deref().unwrap_or("world units");
        line("extent", format!("{} {unit}, centre at {}", by(&self.extent), self.center.map(readable).join(",")));
        line(
            "orientation",
            match &self.orientation {
                None => "not stated: world axes along the lattice".to_owned(),
                Some(Orientation { axes, oblique }) if *oblique < 0.05 => axes.clone(),
                Some(Orientation { axes, oblique }) => format!("{axes}, oblique by {oblique:.1} degrees"),
            },
        );
        let unit = self.value_unit.as_deref().map(|unit| format!(" {unit}")).unwrap_or_default();
        line("range", format!("{} to {}{unit}", readable(self.min), readable(self.max)));
        line("mean", format!("{}, standard deviation {}", readable(self.mean), readable(self.std_dev)));
        if let Some([limit, fraction]) = self.background {
            line("background", format!("{} of the voxels, values up to {}", percent(fraction), readable(limit)));
        }
        line("histogram", "(height: logarithm of the count)".to_owned());
        text += &histogram::draw(&self.histogram);
        text += &histogram::axis(&readable(self.min), &readable(self.max));
        let guess = if self.guess { GUESS.trim_end_matches(',') } else { "" };
        let preset = self.preset.map(|p| format!("{p}{guess}: ")).unwrap_or_default();
        text += &format!("{:<12} {preset}{}\n", "transfer", self.reason);
        text + &self.command.as_ref().map(|command| format!("{:<12} {command}\n", "render")).unwrap_or_default()
    }
}

/// Returns a number of bytes as text: in units of 1024 from 10 KiB on.
fn in_bytes(bytes: u64) -> String {
    let unit = [("GiB", 30), ("MiB", 20), ("KiB", 10)].into_iter().find(|(_, power)| bytes >= 10 << power);
    match unit {
        Some((name, power)) => format!("{:.0} {name}", bytes as f64 / f64::from(1_u32 << power)),
        None => format!("{bytes} bytes"),
    }
}

/// Returns the command line that renders the volume, with the same input options.
fn command(source: &Path, options: &[OptionValues], preset: Option<&str>) -> String {
    let mut words = vec!["voxsplat".to_owned(), "render".to_owned(), quoted(source.as_os_str())];
    for (name, values) in options {
        words.extend(values.iter().flat_map(|value| [format!("--{name}"), quoted(value)]));
    }
    words.extend(preset.map(|preset| format!("--transfer {preset}")));
    let name = match source.to_str().and_then(|source| source.strip_prefix("demo:")) {
        Some(name) => name.split(':').next(),
        // All extensions are dropped: scan.nii.gz becomes scan.png.
        None => source.file_name().and_then(|name| name.to_str()?.split('.').find(|part| !part.is_empty())),
    };
    words.push(format!("-o {}", quoted(format!("{}.png", name.unwrap_or("volume")).as_ref())));
    words.join(" ")
}
