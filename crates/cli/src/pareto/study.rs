//! Speed against error: the settings of a study, and the errors and times of their pictures.

use serde::{Deserialize, Serialize};
use voxsplat::kernel::Kernel;
use voxsplat::settings::{
    Accumulation, Interslice, Level, Model, Painter, Precision, QuadsSettings, Settings, Shading, Sheets,
};

/// The settings of a picture in a study.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Variant {
    /// The shading and the kernel in words. Variants of the same model have the same truth.
    pub(crate) model: String,
    /// The remaining settings in words. Names differ within a model.
    pub(crate) name: String,
    pub(crate) settings: Settings,
}

/// A row of the grid of a study: the name of a variant, the condition on the base settings, and the change of these
/// settings. The first word of the name is the painter.
type Row = (&'static str, fn(&Settings) -> bool, fn(&mut Settings));

/// The grid of a study: settings that trade speed for accuracy and leave the picture as it is.
const GRID: [Row; 17] = [
    ("cpu", any, |s| s.painter = Painter::Cpu),
    ("tiles", any, |_| {}),
    ("tiles, voxels", any, |s| s.level = Level::At(0)),
    ("tiles, level 1", any, |s| s.level = Level::At(1)),
    ("tiles, level 2", any, |s| s.level = Level::At(2)),
    ("tiles, termination at 1 %", any, |s| s.termination = 0.01),
    ("tiles, no termination", any, |s| s.termination = 0.0),
    ("quads", any, |_| {}),
    ("quads, sheets of 0.25", has_sheets, |s| s.painter = quads(|q| q.sheet_thickness = 0.25)),
    ("quads, sheets of 0.5", has_sheets, |s| s.painter = quads(|q| q.sheet_thickness = 0.5)),
    ("quads, sheets of 2", has_sheets, |s| s.painter = quads(|q| q.sheet_thickness = 2.0)),
    ("quads, sheets of 4", has_sheets, |s| s.painter = quads(|q| q.sheet_thickness = 4.0)),
    ("quads, f16", any, |s| s.painter = quads(|q| q.precision = Some(Precision::F16))),
    ("quads, table of 1 %", any, |s| s.painter = quads(|q| q.table_error = Some(0.01))),
    ("quads, sheets by their means", Settings::is_post_shaded, |s| s.interslice = Interslice::Mean),
    ("quads, additive", is_composite, |s| s.painter = quads(|q| q.accumulation = Accumulation::Additive)),
    ("quads, axis-aligned", is_composite, |s| s.painter = quads(|q| q.sheets = Sheets::Axis)),
];

fn any(_: &Settings) -> bool {
    true
}

fn is_pre_shaded(settings: &Settings) -> bool {
    !settings.is_post_shaded()
}

/// Returns whether pictures have several sheets: an X-ray has one.
fn has_sheets(settings: &Settings) -> bool {
    settings.model != Model::Xray
}

fn is_composite(settings: &Settings) -> bool {
    settings.model == Model::Composite && is_pre_shaded(settings)
}

fn quads(change: fn(&mut QuadsSettings)) -> Painter {
    let mut quads = QuadsSettings::default();
    change(&mut quads);
    Painter::Quads(quads)
}

/// Returns the variants of a study around settings: the grid for the shading and kernel of `base` and, of a composite
/// picture, for the other shading, each with the other kind of kernel too.
pub(crate) fn variants(base: &Settings) -> Vec<Variant> {
    let other_kernel = match base.kernel {
        Kernel::KaiserBessel { .. } => Kernel::default(),
        _ => Kernel::KAISER_BESSEL,
    };
    let other_shading = match base.shading {
        Shading::Pre => Shading::Post,
        Shading::Post => Shading::Pre,
    };
    let composite = base.model == Model::Composite;
    let shadings = std::iter::once(base.shading).chain(composite.then_some(other_shading));
    let models = shadings.flat_map(|shading| [base.kernel, other_kernel].map(|kernel| (shading, kernel)));
    models.flat_map(|(shading, kernel)| of_model(&Settings { shading, kernel, ..base.clone() })).collect()
}

/// The rows that tell most, from the first on: all painters, then their settings that change time or error most. Other
/// rows follow in the order of the grid.
const TELLING: [&str; 6] = ["cpu", "tiles", "quads", "quads, sheets of 0.5", "tiles, level 1", "quads, sheets of 2"];

/// The number of rows by which a model is behind the model before it.
const ROWS_BEHIND: usize = 4;

/// Returns the order in which [`variants`] tell most, as indices: the shading and kernel of the picture begin, the
/// other shading follows, then the other kernel.
pub(crate) fn telling(variants: &[Variant]) -> Vec<usize> {
    let mut models: Vec<&str> = variants.iter().map(|variant| variant.model.as_str()).collect();
    models.dedup();
    let key = |&at: &usize| {
        let Variant { model, name, .. } = &variants[at];
        // Models come by shading, and within a shading by kernel.
        let of = models.iter().position(|other| other == model).unwrap_or_default();
        let turn = 2 * (of % 2) + of / 2;
        let rank = TELLING.iter().position(|first| first == name);
        let rank = rank.or(GRID.iter().position(|(row, ..)| row == name).map(|at| TELLING.len() + at));
        (rank.unwrap_or_default() + ROWS_BEHIND * turn, turn)
    };
    let mut order: Vec<usize> = (0..variants.len()).collect();
    order.sort_by_key(key);
    order
}

fn of_model(base: &Settings) -> Vec<Variant> {
    let kernel = match base.kernel {
        Kernel::Gaussian { sigma, radius } => format!("Gaussian of sigma {sigma} and radius {radius}"),
        Kernel::KaiserBessel { radius, alpha } => format!("Kaiser-Bessel of radius {radius} and alpha {alpha}"),
        other => format!("{other:?}"),
    };
    let model = match base.model {
        Model::Composite => format!("{}-shaded, {kernel}", base.shading),
        model => format!("{model}, {kernel}"),
    };
    let variant = |(name, _, change): &Row| {
        let is_tiles = name.starts_with("tiles");
        let painter = if is_tiles { Painter::Tiles } else { quads(|_| {}) };
        let mut settings = Settings { painter, ..base.clone() };
        change(&mut settings);
        Variant { model: model.clone(), name: (*name).to_owned(), settings }
    };
    let rows = GRID.iter().filter(|(_, is_for, _)| is_for(base)).map(variant);
    rows.filter(|variant| variant.settings.validate().is_ok()).collect()
}

/// Errors of a picture against its truth, the largest of several views. See
/// [`Comparison`](voxsplat::image::Comparison).
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct Errors {
    /// The largest error of any channel of any pixel.
    pub(crate) max: f64,
    /// The error of any channel that 99.9 % of the covered pixels keep.
    pub(crate) p999: f64,
    /// The root mean square error over the channels of covered pixels.
    pub(crate) rms: f64,
    /// The least peak signal-to-noise ratio, dB; 0 if all views are exact.
    pub(crate) psnr: f64,
    /// Largest error of alpha.
    pub(crate) alpha: f64,
    /// Largest error of red, green or blue.
    pub(crate) color: f64,
}

/// The times and errors of a variant.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Measurement {
    /// The model of the variant, [`Variant::model`].
    pub(crate) model: String,
    /// The name of the variant, [`Variant::name`].
    pub(crate) name: String,
    /// The reason why the variant cannot be drawn; `None` if it can.
    pub(crate) refused: Option<String>,
    /// The painter that drew the variant.
    pub(crate) painter: String,
    /// The number of views that were drawn: all, or only the first if that took long.
    pub(crate) views: u32,
    /// The seconds to prepare the volume and draw the first frame.
    pub(crate) first: f64,
    /// The seconds of the timed frames.
    pub(crate) frames: Vec<f64>,
    pub(crate) errors: Errors,
}

impl Measurement {
    /// Returns the median seconds of a frame; `None` before the first.
    pub(crate) fn seconds(&self) -> Option<f64> {
        let mut frames = self.frames.clone();
        frames.sort_by(f64::total_cmp);
        frames.get(frames.len() / 2).copied()
    }
}

/// Returns the Pareto front of each model: the measurements for which no other is at least as fast and at least as
/// exact by `error`, and better in one of the two. The result has indices, model by model, fastest first. If
/// measurements are equal, the first counts.
pub(crate) fn front(measurements: &[Measurement], error: fn(&Errors) -> f64) -> Vec<usize> {
    let model_of = |m: &Measurement| measurements.iter().position(|other| other.model == m.model);
    let timed = |(index, m): (usize, &Measurement)| Some((model_of(m)?, m.seconds()?, error(&m.errors), index));
    let mut timed: Vec<(usize, f64, f64, usize)> = measurements.iter().enumerate().filter_map(timed).collect();
    timed.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.total_cmp(&b.2)).then(a.3.cmp(&b.3)));
    let (mut current, mut least) = (usize::MAX, f64::INFINITY);
    timed.retain(|&(model, _, error, _)| {
        if model != current {
            (current, least) = (model, f64::INFINITY);
        }
        let better = error < least;
        least = least.min(error);
        better
    });
    timed.into_iter().map(|(.., index)| index).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured(seconds: f64, rms: f64) -> Measurement {
        Measurement {
            model: String::new(),
            name: String::new(),
            refused: None,
            painter: String::new(),
            views: 0,
            first: 0.0,
            frames: vec![2.0 * seconds, seconds, 0.0],
            errors: Errors { rms, ..Errors::default() },
        }
    }

    #[test]
    fn the_front_is_what_nothing_beats() {
        let mut all = vec![
            measured(2.0, 0.2),
            measured(1.0, 0.5),
            measured(3.0, 0.2),
            measured(1.0, 0.4),
            measured(4.0, 0.1),
            measured(2.0, 0.2),
        ];
        all.push(Measurement { frames: Vec::new(), ..measured(0.0, 0.0) });
        // Its time and error are against those of its own model.
        all.insert(0, Measurement { model: "other".to_owned(), ..measured(9.0, 0.9) });
        assert_eq!(front(&all, |errors| errors.rms), [0, 4, 1, 5]);
        assert!(front(&[], |errors| errors.max).is_empty());
    }

    #[test]
    fn the_most_telling_settings_come_first() {
        let all = variants(&Settings::default());
        let order = telling(&all);
        let names: Vec<(bool, &str)> =
            order.iter().map(|&at| (all[at].settings.is_post_shaded(), all[at].name.as_str())).collect();
        assert_eq!(names[..3], [(false, "cpu"), (false, "tiles"), (false, "quads")]);
        assert!(names[..8].contains(&(true, "tiles")) && names[..8].iter().filter(|(post, _)| *post).count() < 4);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.into_iter().eq(0..all.len()));
        assert!(TELLING.iter().all(|name| GRID.iter().any(|(row, ..)| row == name)));
    }

    #[test]
    fn variants_are_valid_and_differ() {
        for model in Model::ALL {
            let all = variants(&Settings { model, ..Settings::default() });
            assert!(all.len() >= if model == Model::Composite { 50 } else { 16 }, "{}", all.len());
            for (i, a) in all.iter().enumerate() {
                a.settings.validate().unwrap();
                assert!(all[..i].iter().all(|b| (&a.model, &a.name) != (&b.model, &b.name)), "{} {}", a.model, a.name);
            }
        }
    }
}
