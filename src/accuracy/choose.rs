//! The choice of the cheapest settings whose picture keeps an error bound.

use super::estimate::Tracer;
use super::{Estimate, Truth};
use crate::camera::Camera;
use crate::engine::{Engine, EngineScene};
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::image::Image;
use crate::layers::Layers;
use crate::reference::Reference;
use crate::settings::{Level, MAX_LEVEL, Model, Painter, QuadsSettings, Settings};
use crate::stats::Rendered;

/// Settings that were tried, with the error of their picture.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Tried {
    /// The tried settings.
    pub settings: Settings,
    /// The error of the picture with the tried settings.
    pub estimate: Estimate,
}

/// The settings chosen for an error bound.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Chosen {
    /// The settings of the chosen picture.
    pub settings: Settings,
    /// The chosen picture: with these settings, or traced.
    pub rendered: Rendered,
    /// The error of the chosen picture.
    pub estimate: Estimate,
    /// Whether the picture is expected to keep the bound. Otherwise it has the smallest error of all pictures tried.
    pub keeps: bool,
    /// Whether the reference traced the picture, because a painter would have done more work to keep the bound.
    /// `rendered.stats` then belong to the best picture of a painter.
    pub traced: bool,
    /// All settings that were tried, in order, including the chosen settings unless the picture is traced.
    pub tried: Vec<Tried>,
}

/// The share of a bound that an estimate may reach, because the estimate errs as well.
const MARGIN: f64 = 0.85;
/// The share of a bound that thinner sheets aim at: errors grow only roughly as the square of the thickness.
const AIM: f64 = 0.6;
/// The share of a bound that early ray termination may use up.
const TERMINATION: f64 = 0.2;
/// The smallest bound for which coarser cells than the picture resolves are tried: their pictures err by more.
const LEAST_OF_CELLS: f64 = 3e-3;
/// The smallest bound for which the light of sweeps is tried: pictures with it err by up to about 2 of 255.
const LEAST_OF_SWEEPS: f64 = 0.01;
/// Number of splats from which coarser cells save more time than the attempt takes.
const MANY_SPLATS: u64 = 1 << 20;
/// Number of levels by which cells may be coarser than the picture resolves.
const COARSER: u32 = 2;
/// The least thickness of sheets, voxels.
const THINNEST: f64 = 0.05;
/// The power of the thickness of sheets with which the errors of composites grow.
const SQUARE: f64 = 2.0;
/// The least power for which thinner sheets are tried.
const LEAST_POWER: f64 = 0.5;
/// The range of factors by which sheets become thinner at once.
const THINNER: [f64; 2] = [0.1, 0.8];
/// The pixels of quads that are as much work as one chord of the reference: a chord is evaluated at 8 nodes of each of
/// about three blocks, a pixel of a quad at the borders of up to 8 sheets. A constant, so that the choice depends on no
/// speed.
const PIXELS_OF_A_CHORD: f64 = 3.0;

/// The largest number of pictures that [`choose`] draws.
pub const MOST_PICTURES: usize = 5;

/// Chooses the cheapest settings whose picture keeps an error of `max_error` ([definition](super)). Draws the picture
/// with one set of settings after the other, the cheapest first, and compares it with about `pixels` traced pixels,
/// until it is close enough. It draws at most [`MOST_PICTURES`] and predicts the thickness of sheets from the errors
/// so far. If none of the pictures keeps the bound, or thinner sheets are predicted not to, the best one is the result
/// ([`Chosen::keeps`]).
///
/// All pictures by quads together cover at most as many pixels as count as much as tracing the whole picture. If the
/// next one would exceed that, and the painter is left open, the reference traces the picture ([`Chosen::traced`]). The
/// processor draws one picture, or two if the first is of cells; then the reference traces it.
///
/// Model, shading, kernel, sharpness, light, normalization and antialiasing stay, but for a bound below 0.01 shadows
/// are [exact](crate::lighting::Lighting::exact_shadows). So do explicit choices in `settings`: a painter or a level
/// other than auto, and a termination other than the default.
///
/// # Errors
/// [`Error::Setting`] if the bound is not over 0; the errors of [`Truth::trace`], [`Engine::prepare_layers`] and
/// [`Engine::render`].
pub fn choose(
    engine: &Engine,
    layers: &Layers,
    camera: &Camera,
    settings: &Settings,
    max_error: f64,
    pixels: u32,
) -> Result<Chosen> {
    if !(max_error > 0.0 && max_error.is_finite()) {
        let reason = format!("{max_error}, expected over 0");
        return Err(Error::Setting { name: "max_error", reason });
    }
    let mut base = settings.clone();
    if base.model == Model::Composite && base.termination == Settings::default().termination {
        base.termination = rounded_down(TERMINATION * max_error).min(0.01);
    }
    if let Some(lighting) = base.lighting.as_mut().filter(|lighting| lighting.casting().is_some()) {
        lighting.exact_shadows |= max_error < LEAST_OF_SWEEPS;
    }
    let scene = engine.prepare_layers(layers, &base)?;
    let mut tracer = Tracer::new(layers, camera, &base)?;
    let truth = tracer.truth(pixels)?;
    let bound = MARGIN * max_error;
    let mut search = Search {
        engine,
        scene,
        camera,
        budget: PIXELS_OF_A_CHORD * truth.work(),
        quads_are_refused: false,
        truth,
        bound,
        tried: Vec::new(),
        best: None,
        sheets: Vec::new(),
    };
    let first = search.draw(&base)?;
    if first.keeps {
        search.coarser(&base, &first)?;
    } else {
        search.finer(base.clone(), first)?;
    }
    let Search { tried, best, quads_are_refused, .. } = search;
    let (at, mut rendered) = best.ok_or_else(|| Error::Image("nothing was drawn".to_owned()))?;
    let Tried { settings, estimate } = tried[at].clone();
    let keeps = estimate.error <= bound;
    let traces = !keeps && quads_are_refused && base.painter == Painter::Auto && max_error >= Reference::TOLERANCE;
    if let Some((image, estimate)) = traces.then(|| traced(&mut tracer)).transpose()?.flatten() {
        rendered.image = image;
        return Ok(Chosen { settings: base, rendered, estimate, keeps: true, traced: true, tried });
    }
    Ok(Chosen { settings, rendered, estimate, keeps, traced: false, tried })
}

/// Traces the whole picture with the reference and estimates its error; `None` if the reference refuses it.
fn traced(tracer: &mut Tracer) -> Result<Option<(Image, Estimate)>> {
    match tracer.truth(u32::MAX) {
        Ok(truth) => truth.whole().map(|image| Ok((image.clone(), truth.estimate(image)?))).transpose(),
        Err(error) if error.refuses_settings() => Ok(None),
        Err(error) => Err(error),
    }
}

/// Cuts a number over 0 off after its second digit, because people read and copy it.
fn rounded_down(number: f64) -> f64 {
    let unit = 10_f64.powi(libm::log10(number).floor() as i32 - 1);
    // Parsing its decimal digits gives exactly the number that they mean.
    format!("{:.1e}", (number / unit).floor() * unit).parse().unwrap_or(number)
}

struct Search<'a> {
    engine: &'a Engine,
    scene: EngineScene,
    camera: &'a Camera,
    truth: Truth,
    bound: f64,
    tried: Vec<Tried>,
    /// The best picture so far, and its place in `tried`.
    best: Option<(usize, Rendered)>,
    /// The number of pixels that further quads may cover.
    budget: f64,
    /// Whether the engine refused settings because their quads exceed `budget`, or because it draws none.
    quads_are_refused: bool,
    /// Level, thickness of sheets and error of each picture by `quads`, all of the level of the last one.
    sheets: Vec<(f32, f64, f64)>,
}

/// The outcome of one attempt.
struct Trial {
    keeps: bool,
    error: f64,
    splats: u64,
    /// The coarsest level of the splats.
    level: f32,
}

impl Search<'_> {
    fn draw(&mut self, settings: &Settings) -> Result<Trial> {
        // The first picture is the one without a bound.
        let most = if self.tried.is_empty() { f64::INFINITY } else { self.budget };
        let rendered = self.engine.render_within(&self.scene, &Frame::new(self.camera, settings), most)?;
        self.budget -= rendered.stats.quads().map_or(0.0, |quads| quads.fragments);
        let estimate = self.truth.estimate(&rendered.image)?;
        let trial = Trial {
            keeps: estimate.error <= self.bound,
            error: estimate.error,
            splats: rendered.stats.splats_kept,
            level: rendered.stats.levels[1],
        };
        if rendered.stats.quads().is_some() {
            self.sheets.retain(|(level, ..)| *level == trial.level);
            self.sheets.push((trial.level, settings.quads().sheet_thickness, trial.error));
        }
        // After settings that keep the bound only cheaper settings are tried.
        let better = |(at, _): &(usize, Rendered)| trial.keeps || estimate.error < self.tried[*at].estimate.error;
        if self.best.as_ref().is_none_or(better) {
            self.best = Some((self.tried.len(), rendered));
        }
        self.tried.push(Tried { settings: settings.clone(), estimate });
        Ok(trial)
    }

    /// Draws with other settings, whose outcome becomes `last`. Settings that a painter refuses are skipped.
    fn attempt(&mut self, settings: &Settings, last: &mut Trial) -> Result<()> {
        match self.draw(settings) {
            Err(error) if error.refuses_settings() => {
                self.quads_are_refused |= matches!(settings.painter, Painter::Quads(_));
                Ok(())
            }
            drawn => drawn.map(|trial| *last = trial),
        }
    }

    /// Tries cheaper settings after `first`, which keeps the bound: cells coarser than the picture resolves.
    fn coarser(&mut self, base: &Settings, first: &Trial) -> Result<()> {
        let coarse = self.bound >= LEAST_OF_CELLS && first.splats >= MANY_SPLATS && base.level == Level::Auto;
        let one_eye = base.is_post_shaded() && self.camera.eye().is_some();
        let has_cells = self.scene.has_cells();
        if coarse && !one_eye && has_cells {
            let finest = first.level as u32;
            for level in finest + 1..=(finest + COARSER).min(MAX_LEVEL) {
                match self.draw(&Settings { level: Level::At(level), ..base.clone() }) {
                    Ok(trial) if trial.keeps => {}
                    Err(error) if !error.refuses_settings() => return Err(error),
                    _ => break,
                }
            }
        }
        Ok(())
    }

    /// Tries more expensive settings after `last`, which misses the bound, until some keep it.
    fn finer(&mut self, mut base: Settings, mut last: Trial) -> Result<()> {
        let chosen_for = base.painter;
        // Thinner sheets do not make up for the error of cells, so voxels come first.
        if last.level > 0.0 && base.level == Level::Auto {
            base.level = Level::At(0);
            self.attempt(&base, &mut last)?;
        }
        if matches!(self.engine, Engine::Host(_)) {
            self.quads_are_refused = true;
            return Ok(());
        }
        let knobs = base.quads();
        // An X-ray has one sheet at any thickness.
        if last.keeps || matches!(chosen_for, Painter::Tiles) || base.model == Model::Xray {
            return Ok(());
        }
        while !last.keeps && self.tried.len() < MOST_PICTURES {
            // Rays by tiles resolve the depth of a voxel about as well as a sheet does.
            let mut so_far: Vec<(f64, f64)> =
                self.sheets.iter().map(|&(_, thickness, error)| (thickness, error)).collect();
            if so_far.is_empty() {
                so_far.push((knobs.sheet_thickness, last.error));
            }
            let Some(sheet_thickness) = thickness(&so_far, self.bound) else { break };
            let painter = Painter::Quads(QuadsSettings { sheet_thickness, ..knobs });
            let drawn = self.tried.len();
            self.attempt(&Settings { painter, ..base.clone() }, &mut last)?;
            if self.tried.len() == drawn {
                break;
            }
            if last.level > 0.0 && base.level == Level::Auto {
                base.level = Level::At(0);
            }
        }
        Ok(())
    }
}

/// Predicts a thickness of sheets whose picture keeps `bound`, from the thickness and the error of each picture so far,
/// of which there is one at least; `None` if thinner sheets are predicted not to keep it.
fn thickness(so_far: &[(f64, f64)], bound: f64) -> Option<f64> {
    let &(last, error) = so_far.last()?;
    // Errors grow as a power of the thickness: composites as the square, projections of intensity more slowly.
    let power = match so_far {
        [.., (before, error_before), _] => libm::log(error_before / error) / libm::log(before / last),
        _ => SQUARE,
    };
    // Near the share of the error that sheets do not change, the power falls to 0.
    if last <= THINNEST || power.is_nan() || power < LEAST_POWER {
        return None;
    }
    let [least, most] = THINNER.map(|factor| factor * last);
    let predicted = last * libm::pow(AIM * bound / error, power.min(SQUARE).recip());
    Some(rounded_down(predicted.clamp(least, most)).max(THINNEST))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_thickness_of_sheets_is_predicted_from_errors() {
        // One error: as the square.
        let one = thickness(&[(1.0, 6e-3)], 1e-3).unwrap();
        assert!((0.3..=0.316).contains(&one), "{one}");
        // Errors of 1e-3 + 4e-3 t^2 have to be under 2e-3: sheets of 0.5 are just too thick.
        let error = |t: f64| 1e-3 + 4e-3 * t * t;
        let two = thickness(&[(1.0, error(1.0)), (0.6, error(0.6))], 2e-3).unwrap();
        assert!(error(two) < 2e-3 && two > 0.3, "{two}");
        // They come near to 1e-3 and stay there, so no thickness keeps 0.5e-3.
        assert_eq!(thickness(&[(0.2, error(0.2)), (0.1, error(0.1))], 0.5e-3), None);
        // Errors that grow as the thickness need thinner sheets than errors that grow as its square.
        let linear = thickness(&[(1.0, 8e-3), (0.5, 4e-3)], 2e-3).unwrap();
        assert!((0.14..=0.15).contains(&linear), "{linear}");
        assert_eq!(thickness(&[(1.0, 5e-3), (0.5, 5e-3)], 1e-3), None);
        assert_eq!(thickness(&[(THINNEST, 5e-3)], 1e-3), None);
        // No step is larger than tenfold.
        assert_eq!(thickness(&[(1.0, 1.0)], 1e-9), Some(0.1));
    }
}
