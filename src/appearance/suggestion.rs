//! The preset that suits a volume: by facts that its file states, otherwise a guess from the shape of the histogram.

use crate::transfer::presets::{STATISTICS, is_hounsfield};
use crate::volume::{Statistics, Volume};
use voxsplat_volume::names::{percent, readable};

/// A preset chosen for a volume, and why.
#[derive(Debug, Clone, PartialEq)]
pub struct Suggestion {
    /// The name of the suggested preset.
    pub name: &'static str,
    /// The property of the file or of the values that suits the preset.
    pub reason: String,
    /// Whether the values decided, because the file does not state the method that made them.
    pub is_guess: bool,
}

/// The least spacing of whole-body PET and of echo-planar MRI, mm. CT has smaller voxels.
const COARSE: f64 = 1.8;

/// The largest spread of the tissue of a CT. Fat, flesh and organs differ by at most 200 Hounsfield units, which is
/// little beside the 1000 units from air to water. The tissues of MRI differ by tens of per cent.
const NARROW: f64 = 0.07;
/// The least spread of fluorescence, whose brightness has no usual value.
const WIDE: f64 = 0.25;

/// The largest share of the voxels that sparse cells are.
const SPARSE: f64 = 0.2;

/// The least brightness of the brightest fluorescence, in multiples of most of it.
const BRIGHT: f64 = 4.0;
/// The largest share of the foreground that vessels are in an angiogram, for each multiple of the tissue over 2: if
/// vessels are brighter, fat is brighter too.
const FEW: f64 = 0.03;
/// The largest share of the foreground that bone is.
const MINORITY: f64 = 0.35;
/// The largest share of the voxels that a vessel tree without tissue is.
const TREE: f64 = 0.04;
/// The least brightness of bone in multiples of flesh, both above air: 450 Hounsfield units. Blood with contrast agent
/// has 200 to 500.
const BONE: f64 = 1.45;
/// The largest brightness in a brain without its skull: fat around a head is brighter than white matter.
const BRAIN: f64 = 1.75;

/// Suggests a preset for a volume: by its file (a DICOM modality, the intent or the description of a NIfTI file,
/// units), otherwise by its values. Bounds are rules of thumb.
#[must_use]
pub fn suggest(volume: &Volume, statistics: &Statistics) -> Suggestion {
    let shape = HistogramShape::of(statistics);
    let found = |(name, reason), is_guess| Suggestion { name, reason, is_guess };
    let constant = || ("grayscale", format!("all values are {}", readable(statistics.min)));
    let Some(shape) = shape else { return found(constant(), false) };
    stated(volume, &shape).map_or_else(|| found(guessed(volume, statistics, &shape), true), |known| found(known, false))
}

/// Words of descriptions that name a modality.
const WORDS: [(&str, &[&str]); 3] = [
    ("CT", &["ct", "cta"]),
    ("MR", &["mr", "mri", "mra", "tof", "t1", "t1w", "t2", "t2w", "flair", "mprage", "epi", "bold", "fmri", "dwi"]),
    ("PT", &["pet"]),
];

/// Words of descriptions that name an angiogram; also words that begin with angio.
const ANGIOGRAMS: [&str; 3] = ["cta", "mra", "tof"];

/// Returns the preset for the method that the file states.
fn stated(volume: &Volume, shape: &HistogramShape) -> Option<(&'static str, String)> {
    let origin = &volume.contents().origin;
    if let Some(unit) = volume.value_unit().filter(|unit| STATISTICS.contains(unit)) {
        return Some(("activation", format!("the file says that its values are statistics ({unit})")));
    }
    let description = origin.description.as_deref().unwrap_or_default();
    let lower = description.to_lowercase();
    let words: Vec<&str> = lower.split(|c: char| !c.is_alphanumeric()).collect();
    let named = || WORDS.into_iter().find(|(_, names)| words.iter().any(|word| names.contains(word)));
    let (modality, says) = match (origin.modality.as_deref(), volume.value_unit()) {
        (Some(modality), _) => (modality, format!("the file says {modality}")),
        (None, Some("HU")) => ("CT", "the file says HU".to_owned()),
        (None, _) => (named()?.0, format!("the file says {description:?}")),
    };
    let is_angiogram = words.iter().any(|word| word.starts_with("angio") || ANGIOGRAMS.contains(word));
    Some(match modality {
        "CT" | "MR" if is_angiogram => ("angiography", format!("the file says {description:?}")),
        "CT" => ("ct-bone", says),
        "MR" if shape.is_brain() => ("mr-brain", format!("{says}, and {}", shape.masked())),
        "MR" => ("mri", says),
        "XA" => ("angiography", says),
        "PT" | "NM" => ("pet", says),
        "GM" | "SM" => ("fluorescence", format!("{says}, microscopy")),
        "RTDOSE" => ("field", says),
        "US" | "IVUS" => ("grayscale", says),
        _ => return None,
    })
}

/// Returns the preset that the shape of the histogram suits.
fn guessed(volume: &Volume, statistics: &Statistics, shape: &HistogramShape) -> (&'static str, String) {
    let &Statistics { min, max, mean, std_dev, .. } = statistics;
    let [least, largest] = [min, max].map(readable);
    if is_hounsfield(statistics) {
        return ("ct-bone", format!("values from {least} to {largest} look like Hounsfield units"));
    }
    let (oriented, unit) = (volume.is_oriented(), volume.length_unit());
    let is_microscopic = unit.is_some_and(|unit| ["µm", "um", "nm"].contains(&unit));
    if volume.sample_type().is_float() && !oriented && !is_microscopic {
        return ("field", "real numbers without a patient orientation are no scan".to_owned());
    }
    if oriented && -min > max / 4.0 && max > -min / 4.0 && mean.abs() < std_dev / 2.0 {
        return ("activation", format!("values from {least} to {largest} lie about 0, as statistics do"));
    }
    let spacing = volume.grid().min_spacing();
    let is_coarse = oriented && unit.is_none_or(|unit| unit == "mm") && spacing >= COARSE;
    let HistogramShape { spread, top, bright, .. } = *shape;
    let far = format!("{} of the foreground are up to {top:.1} times as bright as most of it", percent(bright));
    if is_coarse && shape.is_hot {
        return ("pet", format!("few and far brighter voxels of {spacing:.1} mm, as uptake in PET"));
    }
    let is_sparse = shape.is_dim && shape.foreground < SPARSE;
    if !oriented && (is_sparse || spread >= WIDE && top >= BRIGHT) {
        return ("fluorescence", format!("{far}, without a patient orientation, as in microscopy"));
    }
    if (oriented || shape.is_masked) && shape.foreground < TREE {
        let reason = format!("{} of the voxels are over the background, as vessels alone", percent(shape.foreground));
        return ("angiography", reason);
    }
    if bright <= FEW * (top - 2.0) || shape.is_hot {
        return ("angiography", format!("{far}, as vessels with contrast agent or of flowing blood"));
    }
    if shape.has_bright_peak && shape.is_masked {
        return ("ct-bone", "the brightest values are a peak of their own, as bone in a window of CT".to_owned());
    }
    let narrow = match spread {
        0.0 => "a quarter of the foreground has one value".to_owned(),
        spread => format!("a quarter of the foreground lies within {}", percent(spread)),
    };
    if spread < NARROW && !is_coarse && top >= BONE && bright < MINORITY {
        return ("ct-bone", format!("{narrow} and brighter values follow, as flesh and bone in CT"));
    }
    if spread < NARROW / 2.0 && !is_coarse && shape.is_masked && top > 1.1 {
        return ("angiography", format!("{narrow} and nothing is as bright as bone, as in CT angiograms without bone"));
    }
    if is_microscopic && !oriented {
        return (
            "fluorescence",
            format!("voxels of {} {}, as in microscopy", readable(spacing), unit.unwrap_or_default()),
        );
    }
    let no_ct = if spread >= NARROW {
        format!("no peak is as narrow as flesh in CT ({} wide)", percent(spread))
    } else if is_coarse {
        format!("voxels of {spacing:.1} mm are larger than in CT")
    } else {
        "brighter values are not as few and bright as bone in CT".to_owned()
    };
    if shape.is_brain() {
        return ("mr-brain", format!("{no_ct}, and {}", shape.masked()));
    }
    ("mri", no_ct)
}

/// The shape of a histogram. Brightness counts from the least value, in multiples of the tissue: the middle of the
/// shortest range with a quarter of the brighter foreground.
struct HistogramShape {
    /// The least value.
    floor: f64,
    /// The share of the voxels over the background.
    foreground: f64,
    /// Whether the background is the least value alone.
    is_masked: bool,
    /// The length of the range of the tissue.
    spread: f64,
    /// The brightness of the 99.9th percentile of the foreground.
    top: f64,
    /// The share of the foreground that is nearer to `top` than to the tissue.
    bright: f64,
    /// The share of the foreground that is darker than a fifth of the tissue.
    dark: f64,
    /// Whether values gather near `top`, with fewer between them and the tissue.
    has_bright_peak: bool,
    /// Whether most of the foreground is dim: in the lowest fifth of its range.
    is_dim: bool,
    /// Whether most of the foreground is dim and few voxels are far brighter.
    is_hot: bool,
}

impl HistogramShape {
    /// Finds the shape of a histogram; `None` if all values are the same.
    fn of(statistics: &Statistics) -> Option<Self> {
        let object = statistics.otsu(f64::NEG_INFINITY)?;
        let background = statistics.background()?.limit.min(object);
        let least = statistics.min;
        let share_over = |value: f64| statistics.fraction_above(value);
        let foreground = share_over(background).max(f64::MIN_POSITIVE);
        // Real numbers are counted in bins.
        let over_least = share_over(least + (statistics.max - least) * 1e-4);
        // Noise and the edge of the object lie between the background and Otsu's threshold.
        let limit = f64::midpoint(background, object);
        let quantile = |share: f64| statistics.quantile_above(limit, share);
        let range = |percent: u32| {
            let [low, high] = [percent, percent + 25].map(|percent| quantile(f64::from(percent) / 100.0));
            (high - low, f64::midpoint(low, high))
        };
        let (length, tissue) = (0..=75).map(range).min_by(|a, b| a.0.total_cmp(&b.0))?;
        let floor = statistics.quantile(0.001);
        let unit = (tissue - floor).max(f64::MIN_POSITIVE);
        let top = (quantile(0.999) - floor) / unit;
        let over_limit = share_over(limit).max(f64::MIN_POSITIVE);
        let over = |brightness: f64| share_over(floor + brightness * unit) / over_limit;
        let [pile, slope] = [over(0.9 * top), over(0.75 * top)];
        let of_foreground = |share: f64| statistics.quantile_above(background, share);
        let [median, high] = [0.5, 0.995].map(of_foreground);
        let bright = statistics.otsu(object).unwrap_or(object);
        let is_dim = median - background < 0.2 * (high - background);
        Some(Self {
            floor: least,
            foreground,
            is_masked: over_least <= 1.05 * foreground,
            spread: length / unit,
            top,
            bright: over(f64::midpoint(1.0, top)),
            dark: (1.0 - share_over(floor + 0.2 * unit) / foreground).max(0.0),
            has_bright_peak: top > 4.0 / 3.0 && pile >= 0.04 && slope < 2.0 * pile,
            is_dim,
            is_hot: is_dim && share_over(bright) < 0.03 * foreground,
        })
    }

    /// Returns whether the values are of a brain without its skull, if they are MRI: no fat is brighter, or no bone
    /// darker.
    fn is_brain(&self) -> bool {
        self.is_masked && (self.top < BRAIN || self.dark < 0.01)
    }

    fn masked(&self) -> String {
        let masked = percent(1.0 - self.foreground);
        format!("{masked} of the voxels are {}, as around a masked brain", readable(self.floor))
    }
}
