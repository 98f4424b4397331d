//! The choice of the cheapest settings whose picture keeps an error bound.

use super::{Estimate, Truth};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::layers::Layers;
use crate::renderer::{Rendered, Renderer, Scene};
use crate::settings::{Level, MAX_LEVEL, Model, Painter, QuadsSettings, Resolution, Settings, TilesSettings};

/// Settings that were tried, with the error of their picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Tried {
    /// The settings.
    pub settings: Settings,
    /// The error of the picture.
    pub estimate: Estimate,
}

/// The settings chosen for an error bound.
#[derive(Debug, Clone)]
pub struct Chosen {
    /// The settings.
    pub settings: Settings,
    /// The picture with these settings.
    pub rendered: Rendered,
    /// The error of the picture.
    pub estimate: Estimate,
    /// Whether the picture is expected to keep the bound. If not, it has the smallest error of all that were tried.
    pub keeps: bool,
    /// All settings that were tried, in order, including the chosen settings.
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
/// Largest number of attempts with thinner sheets, or with voxels in place of cells.
const MOST_THINNER: usize = 5;
/// The least thickness of sheets, voxels.
const THINNEST: f64 = 0.05;
/// The range of factors by which sheets become thinner at once.
const THINNER: [f64; 2] = [0.2, 0.8];

/// Chooses the cheapest settings whose picture keeps an error of `max_error` ([definition](super)). Draws the picture
/// with one set of settings after the other, the cheapest first, and compares it with about `pixels` traced pixels,
/// until it is close enough.
///
/// Model, shading, kernel, sharpness, light, normalization and antialiasing stay, but for a bound below 0.01 shadows
/// are [exact](crate::lighting::Lighting::exact_shadows). So do explicit choices in `settings`: a painter or a level
/// other than auto, and a termination other than the default.
///
/// # Errors
/// [`Error::Setting`] if the bound is not over 0; the errors of [`Truth::trace`], [`Renderer::prepare_layers`] and
/// [`Renderer::render`].
pub fn choose(
    renderer: &Renderer,
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
    let scene = renderer.prepare_layers(layers, &base)?;
    let truth = Truth::trace(layers, camera, &base, pixels)?;
    let bound = MARGIN * max_error;
    let mut search = Search { renderer, scene, camera, truth, bound, tried: Vec::new(), best: None };
    let first = search.draw(&base)?;
    if first.keeps {
        search.coarser(&base, &first)?;
    } else {
        search.finer(base, first)?;
    }
    let Search { tried, best, .. } = search;
    let (at, rendered) = best.ok_or_else(|| Error::Image("nothing was drawn".to_owned()))?;
    let Tried { settings, estimate } = tried[at].clone();
    Ok(Chosen { settings, rendered, estimate, keeps: estimate.error <= bound, tried })
}

/// Cuts a number over 0 off after its second digit, because people read and copy it.
fn rounded_down(number: f64) -> f64 {
    let unit = 10_f64.powi(number.log10().floor() as i32 - 1);
    // Parsing its decimal digits gives exactly the number that they mean.
    format!("{:.1e}", (number / unit).floor() * unit).parse().unwrap_or(number)
}

struct Search<'a> {
    renderer: &'a Renderer,
    scene: Scene,
    camera: &'a Camera,
    truth: Truth,
    bound: f64,
    tried: Vec<Tried>,
    /// The best picture so far, and its place in `tried`.
    best: Option<(usize, Rendered)>,
}

/// The outcome of one attempt.
struct Trial {
    keeps: bool,
    error: f64,
    by_tiles: bool,
    splats: u64,
    /// The coarsest level of the splats.
    level: u32,
}

impl Search<'_> {
    fn draw(&mut self, settings: &Settings) -> Result<Trial> {
        let rendered = self.renderer.render(&self.scene, self.camera, settings)?;
        let estimate = self.truth.estimate(&rendered.image)?;
        let trial = Trial {
            keeps: estimate.error <= self.bound,
            error: estimate.error,
            by_tiles: rendered.stats.tiles().is_some(),
            splats: rendered.stats.splats_kept,
            level: rendered.stats.levels[1],
        };
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
            Err(error) if error.refuses_settings() => Ok(()),
            drawn => drawn.map(|trial| *last = trial),
        }
    }

    /// Tries cheaper settings after `first`, which keeps the bound: cells coarser than the picture resolves.
    fn coarser(&mut self, base: &Settings, first: &Trial) -> Result<()> {
        let coarse = self.bound >= LEAST_OF_CELLS && first.splats >= MANY_SPLATS && base.level == Level::Auto;
        let one_eye = base.is_post_shaded() && self.camera.eye().is_some();
        if coarse && !one_eye && self.scene.has_cells() {
            for level in first.level + 1..=(first.level + COARSER).min(MAX_LEVEL) {
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
        let level = last.level;
        let full = Painter::Tiles(TilesSettings { resolution: Resolution::Full });
        let shares_rays = last.by_tiles && chosen_for == Painter::Auto && !base.is_post_shaded();
        if shares_rays {
            self.attempt(&Settings { painter: full, ..base.clone() }, &mut last)?;
        }
        if !last.keeps && level > 0 && base.level == Level::Auto {
            base.level = Level::At(0);
            self.attempt(&base, &mut last)?;
            if !last.keeps && shares_rays {
                self.attempt(&Settings { painter: full, ..base.clone() }, &mut last)?;
            }
        }
        let knobs = base.quads();
        // An X-ray has one sheet at any thickness.
        if last.keeps || matches!(chosen_for, Painter::Tiles(_)) || base.model == Model::Xray {
            return Ok(());
        }
        // Rays by tiles resolve the depth of a voxel as well as a sheet does.
        let mut thickness = knobs.sheet_thickness;
        for _ in 0..MOST_THINNER {
            // Thinner sheets do not make up for the error of cells, so voxels come first.
            let coarse = base.level == Level::Auto && last.level > 0;
            if coarse {
                base.level = Level::At(0);
            } else if thickness > THINNEST {
                let aim = (AIM * self.bound / last.error).sqrt().clamp(THINNER[0], THINNER[1]);
                thickness = rounded_down(thickness * aim).max(THINNEST);
            } else {
                break;
            }
            let painter = Painter::Quads(QuadsSettings { sheet_thickness: thickness, ..knobs });
            self.attempt(&Settings { painter, ..base.clone() }, &mut last)?;
            if last.keeps {
                break;
            }
        }
        Ok(())
    }
}
