//! Speed against error: the same picture drawn in many ways, each timed, and measured against the f64 reference.

use std::time::Instant;

use glam::DQuat;
use serde::{Deserialize, Serialize};

use super::{Sample, compare};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::image::Image;
use crate::kernel::Kernel;
use crate::reference::Reference;
use crate::renderer::{Renderer, Scene};
use crate::settings::{
    Accumulation, Interslice, Level, Model, Painter, Precision, QuadsSettings, Resolution, Settings, Shading, Sheets,
    TilesSettings,
};
use crate::transfer::TransferFunction;
use crate::volume::Volume;

/// A way to draw a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Variant {
    /// What is drawn: shading and kernel. Variants of the same model have the same truth.
    pub model: String,
    /// How it is drawn. Names differ within a model.
    pub name: String,
    /// The settings.
    pub settings: Settings,
}

/// The error of the truth: a tenth of that of the most exact pictures.
const TOLERANCE: f64 = 1e-6;

/// Degrees by which the eye turns before a frame is timed: the frames of a turntable are not drawn twice.
const TURN: f64 = 3.0;

/// The grid of a study: what trades speed for accuracy, around settings that say what is drawn. These are painters,
/// density of rays, level of the lattice, thickness, precision, accumulation and alignment of sheets, the footprint
/// table, what a slab is classified by, and early termination; for the shading and kernel of `base` and, of a composite
/// picture, the other shading, and the other kind of kernel.
#[must_use]
pub fn variants(base: &Settings) -> Vec<Variant> {
    let other_kernel = match base.kernel {
        Kernel::Gaussian { .. } => Kernel::KAISER_BESSEL,
        Kernel::KaiserBessel { .. } => Kernel::default(),
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

fn of_model(base: &Settings) -> Vec<Variant> {
    let kernel = match base.kernel {
        Kernel::Gaussian { sigma, radius } => format!("Gaussian of sigma {sigma} and radius {radius}"),
        Kernel::KaiserBessel { radius, alpha } => format!("Kaiser-Bessel of radius {radius} and alpha {alpha}"),
    };
    let post = base.is_post_shaded();
    let model = match base.model {
        Model::Composite => format!("{}-shaded, {kernel}", base.shading),
        model => format!("{model}, {kernel}"),
    };
    let variant = |name: &str, settings: Settings| Variant { model: model.clone(), name: name.to_owned(), settings };
    let tiles = |name: &str, resolution, change: &dyn Fn(Settings) -> Settings| {
        let painter = Painter::Tiles(TilesSettings { resolution });
        variant(name, change(Settings { painter, ..base.clone() }))
    };
    let at = |level| move |settings| Settings { level: Level::At(level), ..settings };
    let terminated = |termination| move |settings| Settings { termination, ..settings };
    let same = |settings| settings;
    let mut all = vec![
        tiles("tiles", Resolution::Capped, &same),
        tiles("tiles, voxels", Resolution::Capped, &at(0)),
        tiles("tiles, level 1", Resolution::Capped, &at(1)),
        tiles("tiles, level 2", Resolution::Capped, &at(2)),
        tiles("tiles, termination at 1 %", Resolution::Capped, &terminated(0.01)),
        tiles("tiles, no termination", Resolution::Capped, &terminated(0.0)),
    ];
    if !post {
        all.push(tiles("tiles, a ray a pixel", Resolution::Full, &same));
        all.push(tiles("tiles, a ray a pixel, voxels", Resolution::Full, &at(0)));
    }
    let quads = |name: &str, knobs| variant(name, Settings { painter: Painter::Quads(knobs), ..base.clone() });
    let knobs = QuadsSettings::default;
    all.push(quads("quads", knobs()));
    // An X-ray has one sheet.
    for thickness in [0.25, 0.5, 2.0, 4.0].into_iter().filter(|_| base.model != Model::Xray) {
        all.push(quads(
            &format!("quads, sheets of {thickness}"),
            QuadsSettings { sheet_thickness: thickness, ..knobs() },
        ));
    }
    all.push(quads("quads, f16", QuadsSettings { precision: Some(Precision::F16), ..knobs() }));
    all.push(quads("quads, table of 1 %", QuadsSettings { table_error: Some(0.01), ..knobs() }));
    if post {
        let mean = Settings { interslice: Interslice::Mean, painter: Painter::Quads(knobs()), ..base.clone() };
        all.push(variant("quads, sheets by their means", mean));
    } else if base.model == Model::Composite {
        all.push(quads("quads, additive", QuadsSettings { accumulation: Accumulation::Additive, ..knobs() }));
        all.push(quads("quads, axis-aligned", QuadsSettings { sheets: Sheets::Axis, ..knobs() }));
    }
    all.retain(|variant| variant.settings.validate().is_ok());
    all
}

/// Errors of a picture against its truth, the largest of several views. See [`Comparison`](super::Comparison).
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Errors {
    /// Of any channel of any pixel.
    pub max: f64,
    /// Of any channel of 99.9 % of the covered pixels.
    pub p999: f64,
    /// Root mean square over the channels of covered pixels.
    pub rms: f64,
    /// The least peak signal-to-noise ratio, dB; 0 if all views are exact.
    pub psnr: f64,
    /// Of alpha.
    pub alpha: f64,
    /// Of red, green or blue.
    pub color: f64,
}

/// What drawing in one way took, and how far off it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measurement {
    /// [`Variant::model`].
    pub model: String,
    /// [`Variant::name`].
    pub name: String,
    /// Why it cannot be drawn; `None` if it can.
    pub refused: Option<String>,
    /// The painter that drew it.
    pub painter: String,
    /// The views that were drawn: all, or only the first if that took long.
    pub views: u32,
    /// Seconds of preparing the volume and drawing the first frame.
    pub first: f64,
    /// Seconds of the timed frames.
    pub frames: Vec<f64>,
    /// How far off it is.
    pub errors: Errors,
}

impl Measurement {
    /// The median seconds of a frame; `None` before the first.
    #[must_use]
    pub fn seconds(&self) -> Option<f64> {
        let mut frames = self.frames.clone();
        frames.sort_by(f64::total_cmp);
        frames.get(frames.len() / 2).copied()
    }
}

/// The measurements that no other of their model beats: none is at most as slow and at most as far off by `error`, and
/// better in one of the two. Indices, model by model, fastest first. Of equal ones the first counts.
#[must_use]
pub fn front(measurements: &[Measurement], error: fn(&Errors) -> f64) -> Vec<usize> {
    let model_of = |m: &Measurement| measurements.iter().position(|other| other.model == m.model);
    let timed = |(index, m): (usize, &Measurement)| Some((model_of(m)?, m.seconds()?, error(&m.errors), index));
    let mut timed: Vec<(usize, f64, f64, usize)> = measurements.iter().enumerate().filter_map(timed).collect();
    timed.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.total_cmp(&b.2)).then(a.3.cmp(&b.3)));
    let (mut of, mut least) = (usize::MAX, f64::INFINITY);
    timed.retain(|&(model, _, error, _)| {
        if model != of {
            (of, least) = (model, f64::INFINITY);
        }
        let better = error < least;
        least = least.min(error);
        better
    });
    timed.into_iter().map(|(.., index)| index).collect()
}

/// What a scene was prepared for: whether for post-shading, and what its samples were filtered for.
type Prepared = (bool, Option<(Kernel, f64)>);

/// A volume seen from several sides, to be drawn in several ways.
pub struct Study<'a> {
    renderer: &'a Renderer,
    volume: &'a Volume,
    transfer: &'a TransferFunction,
    cameras: &'a [Camera],
    sample: Sample,
    /// Seconds of a frame beyond which only the first view is drawn.
    patience: f64,
    /// The scene of the variant before, and what it was prepared for.
    scene: Option<(Prepared, Scene)>,
}

impl<'a> Study<'a> {
    /// A study of pictures by these cameras, all of the same size, of which some `sample` pixels each are compared.
    ///
    /// # Errors
    /// [`Error::Camera`] if there are no cameras or their pictures differ in size.
    pub fn new(
        renderer: &'a Renderer,
        volume: &'a Volume,
        transfer: &'a TransferFunction,
        cameras: &'a [Camera],
        sample: u32,
    ) -> Result<Self> {
        match cameras {
            [first, rest @ ..] if rest.iter().all(|camera| camera.size == first.size) => {
                let sample = Sample::new(first.size, sample);
                Ok(Self { renderer, volume, transfer, cameras, sample, patience: f64::INFINITY, scene: None })
            }
            _ => Err(Error::Camera("a study needs cameras with pictures of one size".to_owned())),
        }
    }

    /// The same, which draws only the first view if a frame of it takes over so many seconds.
    #[must_use]
    pub fn with_patience(self, seconds: f64) -> Self {
        Self { patience: seconds, ..self }
    }

    /// The pixels that are compared.
    #[must_use]
    pub fn sample(&self) -> Sample {
        self.sample
    }

    /// The sampled pixels of each view by the reference: the truth of all variants of a model.
    ///
    /// # Errors
    /// Those of [`Reference::new`] and [`Reference::pixels`].
    pub fn truth(&self, variant: &Variant) -> Result<Vec<Image>> {
        let reference = Reference::new(self.volume, self.transfer, &variant.settings)?.with_tolerance(TOLERANCE);
        let [width, height] = self.sample.grid();
        let view = |camera: &Camera| {
            let pixels = reference.pixels(camera, &self.sample.pixels())?;
            Image::new(width, height, pixels.into_iter().map(|pixel| pixel.map(|v| v as f32)).collect())
        };
        self.cameras.iter().map(view).collect()
    }

    /// Draws each view in one way from the start, and compares it with its truth. What the renderer refuses to draw is
    /// a measurement as well.
    ///
    /// # Errors
    /// Those of [`Renderer::render`] if the device fails.
    pub fn measure(&mut self, variant: &Variant, truth: &[Image]) -> Result<Measurement> {
        let Variant { model, name, settings } = variant;
        let mut measured = Measurement {
            model: model.clone(),
            name: name.clone(),
            refused: None,
            painter: String::new(),
            views: 0,
            first: 0.0,
            frames: Vec::new(),
            errors: Errors::default(),
        };
        match self.errors(settings, truth, &mut measured) {
            Err(error) if error.refuses_settings() => measured.refused = Some(format!("{error:#}")),
            result => result?,
        }
        Ok(measured)
    }

    fn errors(&mut self, settings: &Settings, truth: &[Image], measured: &mut Measurement) -> Result<()> {
        let start = Instant::now();
        self.scene = None;
        for (camera, truth) in self.cameras.iter().zip(truth) {
            if measured.first > self.patience {
                break;
            }
            let rendered = self.draw(camera, settings)?;
            if measured.first == 0.0 {
                measured.first = start.elapsed().as_secs_f64();
                measured.painter = rendered.stats.painter.name().to_owned();
            }
            let c = compare(&self.sample.of(&rendered.image)?, truth, 0.0)?;
            let [red, green, blue, alpha] = c.max_channel;
            measured.views += 1;
            let errors = &mut measured.errors;
            let psnr = if errors.psnr == 0.0 { c.psnr } else { c.psnr.min(errors.psnr) };
            *errors = Errors {
                max: errors.max.max(c.max),
                p999: errors.p999.max(c.p999),
                rms: errors.rms.max(c.rms_covered),
                psnr: if psnr.is_finite() { psnr } else { 0.0 },
                alpha: errors.alpha.max(alpha),
                color: errors.color.max(red).max(green).max(blue),
            };
        }
        Ok(())
    }

    /// Times a frame of each view that was measured, after a frame that is not timed.
    ///
    /// # Errors
    /// Those of [`Renderer::render`].
    pub fn time(&mut self, variant: &Variant, measured: &mut Measurement) -> Result<()> {
        for camera in self.cameras.iter().take(measured.views as usize) {
            self.draw(camera, &variant.settings)?;
            let turn = DQuat::from_axis_angle(camera.up, TURN.to_radians());
            let turned = Camera { forward: turn * camera.forward, right: turn * camera.right, ..*camera };
            let start = Instant::now();
            self.draw(&turned, &variant.settings)?;
            measured.frames.push(start.elapsed().as_secs_f64());
        }
        Ok(())
    }

    /// The picture of the first view in one way.
    ///
    /// # Errors
    /// Those of [`Renderer::render`].
    pub fn picture(&mut self, variant: &Variant) -> Result<Image> {
        Ok(self.draw(&self.cameras[0], &variant.settings)?.image)
    }

    fn draw(&mut self, camera: &Camera, settings: &Settings) -> Result<crate::renderer::Rendered> {
        let prepared = (settings.is_post_shaded(), settings.sharpens());
        let held = self.scene.take().filter(|(of, _)| *of == prepared);
        let scene = match held {
            Some((_, scene)) => scene,
            None => self.renderer.prepare(self.volume, self.transfer, settings)?,
        };
        let (_, scene) = self.scene.insert((prepared, scene));
        self.renderer.render(scene, camera, settings)
    }
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
