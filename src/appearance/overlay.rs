//! Overlays: volumes of other files over the volume of a picture, such as a statistical map over a brain.

use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::CHANNELS;
use super::channels::{self, Loaded, Values, load_channels};
use super::choice::Choice;
use super::suggestion::suggest;
use super::transfer::{FittedTransfer, TransferChoice, TransferRequest};
use crate::error::{Error, Result};
use crate::formats::{LoadOptions, is_url};
use crate::layers::{Fit, Labels, Lattice, Layer, Layers, LegendEntry, count_labels, recognised};
use crate::transfer::presets::{self, PresetValues};
use crate::transfer::{ControlPoint, GradientPoint, TransferFunction, Window, color};
use crate::volume::{Statistics, Volume};
use voxsplat_volume::names::readable;

/// The look of an overlay with values under -LO in cold colours and values over LO in hot ones.
pub const TWO_SIDED: &str = "two-sided";
/// The look of an overlay with values over LO in hot colours.
pub const HOT: &str = "hot";

/// The threshold of z scores and Student's t: a common one for clusters, p under 0.011 on one side.
const SCORE: f64 = 2.3;
/// The threshold of one-sided maps as a share of their robust maximum: tumours in PET are drawn so.
const UPTAKE: f64 = 0.4;
/// The largest share of the voxels over the threshold of a one-sided map.
const FEW: f64 = 0.1;
/// The largest distance of the median from 0 in a two-sided map, as a share of its range.
const CENTRED: f64 = 0.02;
/// The least share of a side in the range of a two-sided map.
const ONE_SIDE: f64 = 0.05;
/// The opacities of a map just over the threshold and at its end, per voxel: it reads as solid.
const SOLID: [f64; 2] = [0.4, 0.95];
/// The place behind the threshold, as a share of the way to the end, at which a map becomes solid.
const EDGE: f64 = 0.06;

/// Presets of maps, which have no shell that overlays could lie in.
const MAPS: [&str; 3] = ["activation", "pet", "field"];
/// The opacity of the shell of a volume under overlays, per voxel.
const SHELL: f64 = 0.08;
/// The optical depth of the inside of a volume under overlays, along a mean ray.
const INSIDE: f64 = 0.4;
/// The changes of value from voxel to voxel that are flat, and a surface, in ranges from the least value to the tissue.
const FLAT: [f64; 2] = [0.2, 0.5];
/// The greys of the outside and the inside of the shell.
const GREY: [f64; 2] = [0.6, 0.95];

/// The largest number of labels of an overlay that is taken for labels because it has few values.
const FEW_LABELS: usize = 32;

/// Colours from the threshold to the end of a map: dark, middle and bright.
type Colors = [u32; 3];

/// The colour of values without a look.
const CLEAR: u32 = 0x40_4040;

/// Colours of one-sided maps in the order of their use. Two neighbours are the sides of a two-sided map.
const RAMPS: [Colors; 4] = [
    [0xc8_1400, 0xff_7800, 0xff_f060],
    [0x10_28c8, 0x18_88ff, 0x78_f4ff],
    [0x00_7828, 0x30_d048, 0xd8_ff90],
    [0x70_10a0, 0xd0_48d8, 0xff_b0f4],
];

/// An overlay as requested: a file, and maybe its look and the values that it shows.
#[derive(Debug, Clone)]
pub struct OverlaySpec {
    /// The path of the overlay's file.
    pub file: PathBuf,
    look: RequestedLook,
    /// The text that requests the look.
    transfer: Option<String>,
    /// The values at which the look begins and ends.
    range: [Option<f64>; 2],
}

#[derive(Debug, Clone)]
enum RequestedLook {
    Open,
    TwoSided,
    Hot,
    Color([f64; 3]),
    Transfer(Box<TransferRequest>),
}

/// Returns the error of an overlay.
fn refused<T>(reason: impl Into<String>) -> Result<T> {
    Err(Error::Setting { name: "overlay", reason: reason.into() })
}

/// Returns an error of another setting as an error of the overlay.
fn of_overlay(error: Error) -> Error {
    match error {
        Error::Setting { reason, .. } | Error::Transfer(reason) => Error::Setting { name: "overlay", reason },
        other => other,
    }
}

impl OverlaySpec {
    /// Makes a request of `FILE[:TRANSFER][@LO..HI]`. TRANSFER is `two-sided`, `hot`, whatever
    /// [`TransferRequest::new`] takes, or a colour. LO or HI may be missing. Of a path with a colon or an `@` in it the
    /// longest part that exists is the file.
    ///
    /// # Errors
    /// [`Error::Setting`] if there is no such look or no such range.
    pub fn new(text: &Path) -> Result<Self> {
        let (file, rest) = Self::parted(text);
        let (look, range) = with_range(rest);
        Self::with_look(file, look.strip_prefix(':'), range)
    }

    /// Splits `FILE[:TRANSFER][@LO..HI]` into the file and the rest.
    #[must_use]
    pub fn parted(text: &Path) -> (PathBuf, &str) {
        let whole = || (text.to_owned(), "");
        let Some(all) = text.to_str().filter(|_| !text.exists()) else { return whole() };
        let end = with_range(all).0.len();
        // The longest file that exists; a built-in volume may have a size behind it.
        let is_volume = |text: &str| match text.strip_prefix("demo:") {
            Some(name) => name.split_once(':').map_or(!name.is_empty(), |(_, size)| size.parse::<u32>().is_ok()),
            None => Path::new(text).exists(),
        };
        let colons: Vec<usize> = all[..end].match_indices(':').map(|(at, _)| at).collect();
        let mut ends = std::iter::once(end).chain(colons.iter().rev().copied());
        // Without such a file the first colon ends it, except the colon of a drive.
        let is_drive = |at: usize| at == 1 && all[2..].starts_with(['\\', '/']);
        // Colons of a url stand behind the scheme, in the host and before the look.
        let path = if is_url(Path::new(all)) { all[..end].rfind('/').unwrap_or(0) } else { 0 };
        let first = || colons.iter().copied().find(|&at| !is_drive(at) && at >= path);
        let at = ends.find(|&at| is_volume(&all[..at])).or_else(first).unwrap_or(end);
        (PathBuf::from(&all[..at]), &all[at..])
    }

    /// Makes a request of a file, and of the texts `TRANSFER` and `LO..HI`.
    ///
    /// # Errors
    /// The errors of [`Self::new`].
    pub fn with_look(file: PathBuf, transfer: Option<&str>, range: Option<&str>) -> Result<Self> {
        if file.as_os_str().is_empty() {
            return refused("expected FILE[:TRANSFER][@LO..HI]");
        }
        let range = range.map_or(Ok([None; 2]), ends)?;
        let look = match transfer {
            None => RequestedLook::Open,
            Some(TWO_SIDED) => RequestedLook::TwoSided,
            Some(HOT) => RequestedLook::Hot,
            Some(name) => {
                let window = match range {
                    [Some(low), Some(high)] => Some(Window { level: f64::midpoint(low, high), width: high - low }),
                    _ => None,
                };
                let request = TransferRequest::new(Some(Path::new(name)), window, PresetValues::Auto, None);
                match (request, color::parse(name)) {
                    (Ok(request), _) => {
                        if range != [None; 2] && (window.is_none() || request.values() == Values::Labels) {
                            return refused(format!("{name} takes both ends of @LO..HI, labels none"));
                        }
                        RequestedLook::Transfer(Box::new(request))
                    }
                    (Err(_), Some(color)) => RequestedLook::Color(color),
                    (Err(Error::Setting { reason, .. }), None) => {
                        return refused(format!("{reason}; or two-sided, hot or a colour"));
                    }
                    (Err(error), None) => return Err(error),
                }
            }
        };
        if let (RequestedLook::TwoSided, [Some(low), _]) = (&look, range)
            && low <= 0.0
        {
            return refused(format!("@{low}..: two-sided shows values under -LO and over LO, expected LO over 0"));
        }
        Ok(Self { file, look, transfer: transfer.map(str::to_owned), range })
    }

    /// Returns the overlay's name in a legend: the name of the file without its endings.
    fn name(&self) -> String {
        let name = self.file.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        let plain = name.strip_prefix("demo:").unwrap_or(&name);
        let stem = plain.find('.').filter(|at| *at > 0).map_or(plain, |at| &plain[..at]);
        stem.to_owned()
    }

    /// Loads the file. Samples that are not finite become 0, as programs for statistics mean them.
    ///
    /// # Errors
    /// The errors of [`load_channels`].
    pub fn load(&self) -> Result<Loaded> {
        let options = LoadOptions { replace_nan: Some(0.0), ..LoadOptions::default() };
        load_channels(&self.file, &options, &[], self.values())
    }

    /// Returns the request for the values of the file.
    #[must_use]
    pub fn values(&self) -> Values {
        match &self.look {
            RequestedLook::Open => Values::Open,
            RequestedLook::Transfer(request) => request.values(),
            _ => Values::Transfer,
        }
    }
}

/// Splits a text into the part before `@LO..HI`, and the range.
fn with_range(text: &str) -> (&str, Option<&str>) {
    match text.rsplit_once('@') {
        Some((rest, range)) if range.contains("..") || range.parse::<f64>().is_ok() => (rest, Some(range)),
        _ => (text, None),
    }
}

/// Parses `LO..HI`.
fn ends(text: &str) -> Result<[Option<f64>; 2]> {
    let number = |text: &str| match text.trim() {
        "" => Some(None),
        text => text.parse().ok().filter(|number: &f64| number.is_finite()).map(Some),
    };
    let both = text.split_once("..").and_then(|(low, high)| Some([number(low)?, number(high)?]));
    match both {
        Some([None, None]) | None => refused(format!("@{text}, expected @LO..HI, two values, or one of them")),
        Some([Some(low), Some(high)]) if low >= high => refused(format!("@{text}, expected LO under HI")),
        Some(both) => Ok(both),
    }
}

/// The look of an overlay. `Display` writes it as `FILE:TRANSFER@LO..HI`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OverlayLook {
    /// The path of the overlay's file.
    pub file: PathBuf,
    /// The overlay's name in a legend.
    pub name: String,
    /// The look in the words of a request; empty if a file has looks of its own, such as several channels.
    pub transfer: String,
    /// The values at which the look begins and ends.
    pub range: Option<[f64; 2]>,
    /// The reason for the look, if the library chose it.
    pub reason: Option<String>,
}

impl fmt::Display for OverlayLook {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file.display())?;
        if !self.transfer.is_empty() {
            write!(f, ":{}", self.transfer)?;
        }
        match self.range {
            Some([low, high]) => write!(f, "@{}..{}", readable(low), readable(high)),
            None => Ok(()),
        }
    }
}

/// An overlay on its own lattice.
#[derive(Debug, Clone)]
pub struct Overlay {
    /// The layers: one, or several of a file with several channels or layers of labels.
    pub layers: Vec<Layer>,
    /// The look of the overlay in words.
    pub look: OverlayLook,
    /// The overlay's volume, or the first of its channels.
    pub volume: Volume,
    /// The transfer function of the overlay, if it has one.
    pub transfer: Option<TransferFunction>,
}

/// The colours that overlays have used.
#[derive(Debug, Clone, Default)]
pub struct UsedColors {
    ramps: usize,
    colors: usize,
    /// The number of channels and overlays.
    count: usize,
}

impl UsedColors {
    /// Starts the colours of `overlays` overlays beside `channels` channels.
    #[must_use]
    pub fn new(channels: usize, overlays: usize) -> Self {
        Self { ramps: 0, colors: channels, count: channels + overlays }
    }

    fn ramp(&mut self) -> Colors {
        self.ramps += 1;
        RAMPS[(self.ramps - 1) % RAMPS.len()]
    }

    /// Returns the colours of values far over and far under 0.
    fn sides(&mut self) -> [Colors; 2] {
        self.ramps = self.ramps.next_multiple_of(2);
        [self.ramp(), self.ramp()]
    }

    fn color(&mut self) -> [f64; 3] {
        self.colors += 1;
        channels::nth_color(self.colors - 1)
    }
}

/// Overlays on the lattice of a picture.
#[derive(Debug, Clone)]
pub struct Overlays {
    /// The lattice of the picture: of the volume, or a finer one of an overlay in the box of the volume.
    pub lattice: Lattice,
    /// The overlays in their order.
    pub all: Vec<PlacedOverlay>,
    /// The number of samples that the finest lattice would have had, if they are too many.
    pub refused: Option<f64>,
    layers: Vec<Layer>,
}

/// The place of an overlay in a picture.
#[derive(Debug, Clone, Serialize)]
pub struct PlacedOverlay {
    /// The look of the overlay in words.
    #[serde(flatten)]
    pub look: OverlayLook,
    /// The numbers of the overlay's voxels along its axes.
    pub dims: [u32; 3],
    /// The way in which the overlay was put onto the lattice of the picture.
    #[serde(skip)]
    pub fit: Fit,
    /// Whether voxels of the picture are interpolated from the overlay's voxels.
    pub is_resampled: bool,
    /// The share of the overlay's visible voxels outside of the picture's lattice, 0 to 1.
    pub outside: f64,
    /// The overlay's volume, or the first of its channels, on its own lattice.
    #[serde(skip)]
    pub volume: Volume,
    /// The transfer function of the overlay, if it has one.
    #[serde(skip)]
    pub transfer: Option<TransferFunction>,
}

impl Overlays {
    /// Puts overlays onto the lattice of a picture of a volume.
    ///
    /// # Errors
    /// The errors of [`Lattice::finest`] and [`Layer::on_lattice`], which name the file.
    pub fn new(base: &Volume, overlays: Vec<Overlay>) -> Result<Self> {
        let (lattice, refused) = Lattice::finest(base, overlays.iter().map(|overlay| &overlay.volume))?;
        let (mut layers, mut all) = (Vec::new(), Vec::new());
        for Overlay { layers: own, look, volume, transfer } in overlays {
            let (dims, fit) = (volume.grid().dims(), Fit::Same);
            let mut placed = PlacedOverlay { look, dims, fit, is_resampled: false, outside: 0.0, volume, transfer };
            let in_file = |error| match error {
                Error::Setting { name, reason } => {
                    Error::Setting { name, reason: format!("{}: {reason}", placed.look.file.display()) }
                }
                other => other,
            };
            let own = own.iter().map(|layer| layer.on_lattice(&lattice, "overlay")).collect::<Result<Vec<_>>>();
            for (layer, fit) in own.map_err(in_file)? {
                placed.fit = fit;
                if let Fit::Nearest { outside } | Fit::Interpolated { outside } = fit {
                    (placed.is_resampled, placed.outside) = (true, outside);
                }
                layers.push(layer);
            }
            all.push(placed);
        }
        Ok(Self { lattice, all, refused, layers })
    }

    /// Returns layers with the overlays over them, on the lattice of the picture.
    ///
    /// # Errors
    /// The errors of [`Layers::on_lattice`] and [`Layers::with`].
    pub fn over(&self, layers: Layers) -> Result<Layers> {
        self.layers.iter().cloned().try_fold(layers.on_lattice(&self.lattice)?, Layers::with)
    }
}

/// The meaning of the values of an overlay.
enum OverlayKind {
    TwoSided {
        score: Option<f64>,
    },
    Hot,
    /// A scan, in one colour.
    Scan,
}

impl Overlay {
    /// Makes an overlay of the contents of its file, in colours that were not used before.
    ///
    /// # Errors
    /// [`Error::Setting`] if the values do not suit the requested look; the errors of [`TransferRequest::fit`].
    pub fn new(spec: &OverlaySpec, loaded: Loaded, used: &mut UsedColors) -> Result<Self> {
        Self::of(spec, loaded, used).map_err(of_overlay)
    }

    fn of(spec: &OverlaySpec, loaded: Loaded, used: &mut UsedColors) -> Result<Self> {
        let Loaded { volume, layers, labels, .. } = loaded;
        let (file, name) = (spec.file.clone(), spec.name());
        let look = |transfer: &str, range, reason| OverlayLook {
            file: file.clone(),
            name: name.clone(),
            transfer: transfer.to_owned(),
            range,
            reason,
        };
        let given = spec.transfer.clone().unwrap_or_default();
        if !layers.is_empty() {
            let reason = Some("the file has several channels".to_owned());
            return Ok(Self { layers, look: look("", None, reason), volume, transfer: None });
        }
        let of_labels = |look: OverlayLook| {
            let all = std::iter::once(&volume).chain(&labels);
            let layers = all.map(|volume| Layer::labels(volume, &Labels::stated(volume))).collect::<Result<_>>()?;
            Ok(Self { layers, look, volume: volume.clone(), transfer: None })
        };
        let statistics = || Ok(Statistics::of(&volume)?);
        let (kind, reason) = match &spec.look {
            RequestedLook::Transfer(request) => {
                let fitted = request.fit(&spec.file, &volume, false, statistics)?;
                if fitted.labels {
                    return of_labels(look(&given, None, None));
                }
                let range = request.window.map(|window| window.ends()).transpose()?;
                let FittedTransfer { transfer, .. } = fitted;
                let entry = LegendEntry { name: name.clone(), color: channels::bytes(transfer_color(&transfer)) };
                let layers = vec![Layer::scalars(&volume, &transfer).named(entry)];
                return Ok(Self { layers, look: look(&given, range, None), volume, transfer: Some(transfer) });
            }
            RequestedLook::Open => {
                if spec.range == [None; 2]
                    && let Some(reason) = labels_of(&volume)?
                {
                    return of_labels(look("labels", None, Some(reason)));
                }
                let (kind, reason) = kind(&volume, &statistics()?)?;
                (kind, Some(reason))
            }
            RequestedLook::TwoSided => (OverlayKind::TwoSided { score: None }, None),
            RequestedLook::Hot => (OverlayKind::Hot, None),
            RequestedLook::Color(_) => (OverlayKind::Scan, None),
        };
        let statistics = statistics()?;
        let [low, high] = spec.range;
        let range = |found: &dyn Fn() -> Result<Option<[f64; 2]>>| {
            if let (Some(low), Some(high)) = (low, high) {
                return Ok([low, high]);
            }
            let reason = || format!("all values are {}: give both ends of @LO..HI", readable(statistics.min));
            let [least, most] =
                found()?.map(|ends| ends.map(rounded)).ok_or_else(|| Error::setting("overlay", reason()))?;
            // A given end may lie beyond the other one.
            let width = most - least;
            Ok::<_, Error>(match (low, high) {
                (Some(low), _) if low >= most => [low, low + width],
                (_, Some(high)) if high <= least => [high - width, high],
                _ => [low.unwrap_or(least), high.unwrap_or(most)],
            })
        };
        let over = |range: [f64; 2]| format!("{name} over {}", readable(range[0]));
        let (text, range, transfer, entries) = match kind {
            OverlayKind::TwoSided { score } => {
                let range = range(&|| Ok(presets::significance(&statistics, score)))?;
                if range[0] <= 0.0 {
                    return refused(format!("{} has no value over a threshold of 0", file.display()));
                }
                let [hot, cold] = used.sides();
                let transfer = solid(range, hot, Some(cold))?;
                let under = format!("{name} under {}", readable(-range[0]));
                (TWO_SIDED.to_owned(), range, transfer, vec![(over(range), hot[1]), (under, cold[1])])
            }
            OverlayKind::Hot => {
                let range = range(&|| Ok(uptake(&statistics)))?;
                let hot = used.ramp();
                (HOT.to_owned(), range, solid(range, hot, None)?, vec![(over(range), hot[1])])
            }
            OverlayKind::Scan => {
                let range = range(&|| scan_range(&volume, &statistics))?;
                let color = match spec.look {
                    RequestedLook::Color(color) => color,
                    _ => used.color(),
                };
                let window = Window { level: f64::midpoint(range[0], range[1]), width: range[1] - range[0] };
                let transfer = channels::glow(&volume, &statistics, &window, color, used.count.max(1))?;
                let [r, g, b] = channels::bytes(color);
                let packed = u32::from_be_bytes([0, r, g, b]);
                let text = if given.is_empty() { format!("#{packed:06x}") } else { given };
                (text, range, transfer, vec![(name.clone(), packed)])
            }
        };
        let entry = |(name, rgb): (String, u32)| LegendEntry { name, color: channels::bytes(color::packed(rgb)) };
        let layer = entries.into_iter().map(entry).fold(Layer::scalars(&volume, &transfer), Layer::named);
        Ok(Self { layers: vec![layer], look: look(&text, Some(range), reason), volume, transfer: Some(transfer) })
    }
}

/// Returns why values are labels; `None` if they are not. A segmentation over a scan may be too small to be recognised
/// alone.
fn labels_of(volume: &Volume) -> Result<Option<String>> {
    if let Some(reason) = recognised(volume)? {
        return Ok(Some(reason));
    }
    if volume.sample_type().is_float() || volume.rescale() != (1.0, 0.0) {
        return Ok(None);
    }
    // Over a million different values are no labels.
    let Ok(counts) = count_labels(volume) else { return Ok(None) };
    let most = volume.grid().len() / 2;
    let is_sparse = counts.first().is_some_and(|background| background.label == 0 && background.voxels > most);
    let number = counts.len().saturating_sub(1);
    Ok((is_sparse && (1..=FEW_LABELS).contains(&number)).then(|| format!("it has {number} whole numbers in zeros")))
}

/// Returns a number of three digits, as a person would choose it.
fn rounded(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}

/// Returns the colour of a transfer function where it is densest.
fn transfer_color(transfer: &TransferFunction) -> [f64; 3] {
    let densest = transfer.points().iter().max_by(|a, b| a.opacity.total_cmp(&b.opacity));
    densest.map_or([1.0; 3], |point| point.color)
}

/// Returns the meaning of the values of a volume, and the reason.
fn kind(volume: &Volume, statistics: &Statistics) -> Result<(OverlayKind, String)> {
    let suggestion = suggest(volume, statistics);
    let unit = volume.value_unit();
    if suggestion.name == "activation" && !suggestion.is_guess {
        let score = unit.filter(|unit| ["t", "z"].contains(unit)).map(|_| SCORE);
        return Ok((OverlayKind::TwoSided { score }, suggestion.reason));
    }
    let &Statistics { min, max, .. } = statistics;
    let [least, largest] = [min, max].map(readable);
    let width = max - min;
    let is_centred = statistics.quantile(0.5).abs() <= CENTRED * width;
    let has_sides = -min > ONE_SIDE * width && max > ONE_SIDE * width;
    if suggestion.name == "activation" || (is_centred && has_sides && suggestion.name != "ct-bone") {
        let reason = format!("values from {least} to {largest} lie on both sides of 0");
        return Ok((OverlayKind::TwoSided { score: None }, reason));
    }
    if suggestion.name == "pet" {
        return Ok((OverlayKind::Hot, suggestion.reason));
    }
    let is_microscopy = suggestion.name == "fluorescence" && !volume.sample_type().is_float();
    if min >= 0.0
        && !is_microscopy
        && let Some([low, _]) = uptake(statistics)
        && statistics.fraction_above(low) <= FEW
        && (volume.sample_type().is_float() || volume.contents().origin.intent.is_some())
    {
        return Ok((OverlayKind::Hot, format!("most values from {least} to {largest} are near {least}")));
    }
    Ok((OverlayKind::Scan, suggestion.reason))
}

/// Returns the threshold and the end of a one-sided map.
fn uptake(statistics: &Statistics) -> Option<[f64; 2]> {
    let window = Window::of_foreground(statistics)?;
    let [low, high] = window.ends().ok()?;
    Some([low.max(0.0) + UPTAKE * (high - low.max(0.0)), high]).filter(|[low, high]| low < high)
}

/// Returns the values that are visible by the preset that suits a scan; `None` if all are the same.
fn scan_range(volume: &Volume, statistics: &Statistics) -> Result<Option<[f64; 2]>> {
    if statistics.min >= statistics.max {
        return Ok(None);
    }
    let name = suggest(volume, statistics).name;
    let transfer = presets::preset(name, volume, statistics, PresetValues::Auto)?;
    let points = transfer.points();
    let first = points.iter().take_while(|point| point.opacity <= 0.0).count().saturating_sub(1);
    let [low, high] = [points[first].value, transfer.range()[1]];
    Ok((low < high).then_some([low, high]))
}

/// Returns a solid map over a range, and under its negative if it has two sides.
fn solid([low, high]: [f64; 2], hot: Colors, cold: Option<Colors>) -> Result<TransferFunction> {
    let side = |sign: f64, colors: Colors| {
        let point = |share: f64, rgb: u32, opacity: f64| ControlPoint {
            value: sign * (low + share * (high - low)),
            color: color::packed(rgb),
            opacity,
        };
        let [dark, middle, bright] = colors;
        let [edge, end] = SOLID;
        [
            point(0.0, dark, 0.0),
            point(EDGE, dark, edge),
            point(0.5, middle, f64::midpoint(edge, end)),
            point(1.0, bright, end),
        ]
    };
    // Grey between the sides, for a colour bar.
    let grey = |value: f64| ControlPoint { value, color: color::packed(CLEAR), opacity: 0.0 };
    let under = cold.into_iter().flat_map(|cold| side(-1.0, cold).into_iter().rev().chain([grey(-low), grey(low)]));
    TransferFunction::new(under.chain(side(1.0, hot)).collect(), None)
}

impl FittedTransfer {
    /// Returns the transfer function of a volume under a number of overlays: grey and translucent, so that overlays
    /// inside show; of fluorescence the first colour of channels. A requested transfer function stays as it is. The
    /// second value is the choice.
    ///
    /// # Errors
    /// The errors of [`TransferFunction::new`].
    pub fn under_overlays(
        self,
        request: &TransferRequest,
        volume: &Volume,
        statistics: &Statistics,
        overlays: usize,
    ) -> Result<(Self, Option<Choice>)> {
        let is_suggested = matches!(request.choice, TransferChoice::Suggested) && request.isosurfaces.is_empty();
        if self.labels || !is_suggested {
            return Ok((self, None));
        }
        if self.preset.is_some_and(|preset| preset.name == CHANNELS) {
            let Some([low, high]) = scan_range(volume, statistics)? else { return Ok((self, None)) };
            let window = Window { level: f64::midpoint(low, high), width: high - low };
            let transfer = channels::glow(volume, statistics, &window, channels::nth_color(0), 1 + overlays)?;
            return Ok((Self { transfer, preset: None, ..self }, Some(Choice::Channel)));
        }
        if self.preset.is_some_and(|preset| MAPS.contains(&preset.name)) {
            return Ok((self, None));
        }
        let transfer = dimmed(&self.transfer, volume, statistics)?;
        Ok((Self { transfer, preset: None, ..self }, Some(Choice::Dimmed)))
    }
}

/// Returns the transfer function of a volume under overlays: a grey shell of the values between its background and its
/// tissue, as of glass, and a faint inside.
fn dimmed(transfer: &TransferFunction, volume: &Volume, statistics: &Statistics) -> Result<TransferFunction> {
    let points = transfer.points();
    let first = points.iter().take_while(|point| point.opacity <= 0.0).count().clamp(1, points.len() - 1);
    let [low, high] = [points[first - 1].value, points[first].value];
    let at = |share: f64| low + share * (high - low);
    // A ray through the visible voxels is as long as the edge of a cube of them.
    let voxels = statistics.fraction_above(at(1.0)) * volume.grid().len() as f64;
    let inside = (1.0 - libm::exp(-INSIDE / libm::cbrt(voxels).max(1.0))).min(SHELL);
    let point = |value: f64, grey: f64, opacity: f64| ControlPoint { value, color: [grey; 3], opacity };
    let [dark, bright] = GREY;
    let end = transfer.range()[1].max(at(2.0));
    let points = vec![
        point(low, dark, 0.0),
        point(at(0.25), dark, SHELL),
        point(at(0.75), bright, SHELL),
        point(at(1.25), bright, SHELL),
        point(end, bright, SHELL),
    ];
    // Values of the shell, and jumps to values of the inside.
    let steep = |share: f64| share * (at(1.0) - statistics.min) / volume.grid().min_spacing();
    let gradient = [(FLAT[0], inside / SHELL), (FLAT[1], 1.0)];
    let gradient = gradient.map(|(share, opacity)| GradientPoint { magnitude: steep(share), opacity });
    TransferFunction::new(points, None)?.with_gradient_opacity(gradient.to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the file, the look and the range of an overlay.
    fn of(text: &str) -> (String, Option<String>, [Option<f64>; 2]) {
        let spec = OverlaySpec::new(Path::new(text)).unwrap();
        (spec.file.to_string_lossy().into_owned(), spec.transfer, spec.range)
    }

    #[test]
    fn overlays_have_a_file_a_look_and_a_range() {
        for (text, file, look, range) in [
            ("z.nii", "z.nii", None, [None, None]),
            ("z.nii@2.3..8", "z.nii", None, [Some(2.3), Some(8.0)]),
            ("z.nii@2.3..", "z.nii", None, [Some(2.3), None]),
            ("z.nii@..-1e2", "z.nii", None, [None, Some(-100.0)]),
            ("a@b.nii", "a@b.nii", None, [None, None]),
            ("z.nii:hot", "z.nii", Some("hot"), [None, None]),
            ("z.nii:map:viridis@0..1", "z.nii", Some("map:viridis"), [Some(0.0), Some(1.0)]),
            (r"C:\a\z.nii:two-sided@2..", r"C:\a\z.nii", Some("two-sided"), [Some(2.0), None]),
            ("C:/z.nii:ct-bone", "C:/z.nii", Some("ct-bone"), [None, None]),
            (r"C:\z.nii", r"C:\z.nii", None, [None, None]),
            ("demo:sphere:16:gold@1..2", "demo:sphere:16", Some("gold"), [Some(1.0), Some(2.0)]),
            ("demo:sphere:#ff0000", "demo:sphere", Some("#ff0000"), [None, None]),
            ("Cargo.toml:labels", "Cargo.toml", Some("labels"), [None, None]),
        ] {
            assert_eq!(of(text), (file.to_owned(), look.map(str::to_owned), range), "{text}");
        }
        let refused = |text: &str| OverlaySpec::new(Path::new(text)).unwrap_err().to_string();
        for (text, expected) in [
            ("", "overlay: expected FILE[:TRANSFER][@LO..HI]"),
            ("z.nii@3..2", "overlay: @3..2, expected LO under HI"),
            ("z.nii@..", "overlay: @.., expected @LO..HI"),
            ("z.nii@nan..2", "overlay: @nan..2, expected @LO..HI"),
            ("z.nii@2", "overlay: @2, expected @LO..HI"),
            ("z.nii:hott", "overlay: \"hott\", expected a file, map:NAME"),
            ("z.nii:two-sided@-2..3", "overlay: @-2..: two-sided shows"),
            ("z.nii:ct-bone@2..", "overlay: ct-bone takes both ends"),
            ("z.nii:labels@1..2", "overlay: labels takes both ends of @LO..HI, labels none"),
        ] {
            assert!(refused(text).starts_with(expected), "{text}: {}", refused(text));
        }
    }

    #[test]
    fn overlays_use_colours_once() {
        let mut used = UsedColors::default();
        let first = used.ramp();
        // Both sides of a map are new, and neighbours.
        assert!(first == RAMPS[0] && used.sides() == [RAMPS[2], RAMPS[3]]);
        assert_eq!(UsedColors::new(2, 1).color(), channels::nth_color(2));
    }
}
