//! What is modelled, and how finely.

use crate::clip::Clip;
use crate::error::{Error, Result};
use crate::kernel::{Kernel, Normalization};
use crate::lighting::{Casting, Lighting};
use crate::reconstruction::Prefilter;
pub use crate::response::Response;
use crate::transfer::TransferFunction;
use crate::volume::Volume;
use voxsplat_volume::names::named;

/// The format of the sheet buffers. The frame that they are composited into is always f32.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Precision {
    /// Half-precision sheets: half the memory traffic; see [`QuadsSettings::precision`] for what they lose.
    F16,
    /// Single-precision sheets; needs an adapter that blends 32-bit floats.
    F32,
}

/// What a pixel is, given the fields along its ray.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Model {
    /// Emission and absorption: C = integral of c tau exp(-integral of tau), alpha = 1 - exp(-integral of tau).
    #[default]
    Composite,
    /// Absorption only: what [`Settings::response`] makes of the integral of tau, by default white of alpha = 1 -
    /// exp(-integral of tau). One sheet of whole footprints, exact.
    Xray,
    /// Maximum intensity projection: the colour of the largest reconstructed value on the ray's part in the box of the
    /// voxels, its alpha the opacity of that value over the largest opacity of the transfer function.
    Mip,
    /// Minimum intensity projection: the same of the smallest value. What is outside of the box does not count.
    Minip,
    /// Average intensity projection: the same of the mean value.
    Average,
}

/// When the transfer function is applied. X-ray is always pre-shaded, projections of intensity are post-shaded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Shading {
    /// Each voxel is classified and lit, then extinction and emission are reconstructed. Fast, and blurs surfaces.
    #[default]
    Pre,
    /// The scalar is reconstructed, then classified and lit per pixel and sheet (Mueller, Moeller and Crawfis 1999,
    /// "Splatting without the blur"). Sharp whatever the magnification.
    Post,
}

/// How splats are gathered into sheets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Sheets {
    /// Slabs parallel to the image; each kernel is cut by their planes (Mueller and Crawfis 1998).
    #[default]
    Image,
    /// The voxel planes most parallel to the image, a whole footprint per voxel (Westover 1990). Historical: the
    /// picture pops when the planes switch.
    Axis,
}

/// What a sheet adds up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Accumulation {
    /// Optical depth: alpha of a sheet is 1 - exp(-sum), exact for every thickness.
    #[default]
    OpticalDepth,
    /// Opacities, clamped at 1. Historical: does not converge with thinner sheets.
    Additive,
}

/// What a post-shaded sheet is classified by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Interslice {
    /// The parabola through the means of the sheet and its two neighbours, in six pieces per voxel of thickness.
    #[default]
    Parabola,
    /// The mean of the sheet, once. Historical: a narrow peak of the transfer function may fall between two sheets.
    Mean,
}

/// What draws the splats, with the knobs of its own. To set a knob is to choose its painter.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Painter {
    /// Tiles, unless it refuses the picture or the picture is an X-ray of few voxels on a software adapter; quads
    /// otherwise. On GPUs tiles has a ray for each pixel. By operations and bytes that is expected to be the fastest
    /// there; no GPU has been measured. Only the adapter, the settings and the number of voxels decide, so that the
    /// same input gives the same bytes; [`Stats::painter_reason`](crate::stats::Stats::painter_reason) says why.
    #[default]
    Auto,
    /// Instanced quads, added up in sheets by the rasteriser. Draws every picture.
    Quads(QuadsSettings),
    /// Rays that gather the kernels they meet, plane by plane, in compute shaders. Draws all models, shadings and
    /// projections, but not:
    ///
    /// - kernels that reach over 4 voxels once they have grown;
    /// - post-shaded, kernels that reach less than a voxel;
    /// - pre-shaded, an eye that a kernel reaches;
    /// - post-shaded, values over 4096 times as far from the transfer function's base as its control points.
    Tiles(TilesSettings),
}

/// Knobs of the painter quads.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QuadsSettings {
    /// How splats are gathered into sheets.
    pub sheets: Sheets,
    /// What a sheet adds up.
    pub accumulation: Accumulation,
    /// Thickness of a sheet in voxels, measured along the central ray; 0.05 to 64. If kernels grow (see
    /// [`Settings::antialiasing`]), it is multiplied by the growth of the nearest kernel. Sheets are thinner in wide
    /// fields of view, so that the most oblique ray is at most 2 times as long in a sheet, post-shaded 1.25 times; and
    /// post-shaded, if the kernel's radius is under 2 voxels, by radius / 2, and by 1 - [`Settings::sharpness`] / 2.
    pub sheet_thickness: f64,
    /// The format of the sheet buffers; `None` takes f32 wherever the adapter blends it, and f16 where not, which
    /// [`Stats::painter`](crate::stats::Stats::painter) tells.
    ///
    /// Half floats err in alpha by 3e-4 where hardware rounds each sum to the nearest, and by 2e-3 to 4e-3 where it
    /// cuts sums off, as Mesa's software rasteriser does and Mesa's drivers set AMD's GPUs up to do. If kernels grow
    /// (see [`Settings::antialiasing`]), more of them meet in a sheet: 1.1e-2 was measured at 1.9 times, and 6e-2 at
    /// twenty times. Scalars err by 5e-4 of their distance from the invisible value. Sheets of half floats are at most
    /// 4 voxels thick, those of an X-ray too, because thicker ones lose what is added last.
    pub precision: Option<Precision>,
    /// Largest interpolation error of the footprint table, as a fraction of the footprint's peak, 1e-7 to 0.1; `None`
    /// takes what the precision of the sheets deserves.
    pub table_error: Option<f64>,
}

impl Default for QuadsSettings {
    fn default() -> Self {
        Self {
            sheets: Sheets::default(),
            accumulation: Accumulation::default(),
            sheet_thickness: 1.0,
            precision: None,
            table_error: None,
        }
    }
}

/// Knobs of the painter tiles.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TilesSettings {
    /// How finely rays are spaced.
    pub resolution: Resolution,
}

/// How densely the painter tiles spaces its rays.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Resolution {
    /// Pre-shaded: one to four rays per voxel and axis, by the direction of view, the kernel and the opacity, resampled
    /// to the picture, and rays of their own for pixels that would err. If pixels are fewer, each pixel has its own
    /// ray. Post-shaded: a ray for each pixel.
    #[default]
    Capped,
    /// A ray for each pixel.
    Full,
}

/// The coarsest level.
pub(crate) const MAX_LEVEL: u32 = 12;

/// What stands for voxels whose kernels have grown: cells of 2^n voxels along each axis, n their level. Cost then
/// follows the picture instead of the volume (Laur and Hanrahan 1991, "Hierarchical splatting").
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Level {
    /// The coarsest cells that are right: within 2 of 255 (rms over covered pixels) of voxels whose kernels have grown.
    ///
    /// Level 1 stands for voxels of little optical depth whose default Gaussian has grown 1.5 times, level 2 from 3
    /// times on. The denser matter is, the more kernels must have grown: 2.5 times for level 1 if a cell has an optical
    /// depth of 2, 4.9 times at 10. The longest axis of the lattice counts. Light does not, because voxels are lit
    /// before they become cells. In perspective levels go by depth; pre-shaded by [`Painter::Quads`] a picture has one
    /// level, that of its nearest kernels. Post-shaded along parallel rays it has one as well, in dense matter a finer
    /// one; none if values are over 16 times as far from the transfer function's base as its control points, or, lit,
    /// things of one value show.
    #[default]
    Auto,
    /// Cells of this level, 0 to 12, whatever they lose. Kernels then are at least as wide as cells can have them:
    /// level 1 has the default Gaussian grown 1.5 times. 0 is the voxels. Post-shaded through one eye: only 0.
    At(u32),
}

/// The settings of a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// What a pixel is.
    pub model: Model,
    /// What an X-ray shows of the optical depth along a ray.
    pub response: Response,
    /// Whether the colours of a maximum or a minimum tell how deep it lies: red nearest, through yellow, green, cyan
    /// and blue, to violet farthest, along the view and between the nearest and the farthest corner of the box of the
    /// voxels. As bright as the brightest channel of the transfer function's colour, which gives alpha as well.
    pub depth_coded: bool,
    /// How much a maximum is attenuated by depth, 0 (not at all) to [`Self::MAX_ATTENUATION`]. What is over the
    /// transfer function's base counts times exp(-attenuation d), d from 0 at the nearest to 1 at the farthest corner
    /// of the box of the voxels, along the view; so of two equal values the nearer one shows, and what is far is dim
    /// (Wallis and Miller 1991, "Three-dimensional display in nuclear medicine and radiology").
    pub attenuation: f64,
    /// When the transfer function is applied.
    pub shading: Shading,
    /// The light on surfaces; `None`: colours are those of the transfer function.
    pub lighting: Option<Lighting>,
    /// What is cut away, in the world. A scene serves pictures of any: nothing is classified anew. Shadows are found
    /// anew.
    pub clip: Clip,
    /// What a post-shaded slab is classified by.
    pub interslice: Interslice,
    /// Early termination: what lies behind a pixel that lets through no more than this fraction of light is not drawn.
    /// No channel of the picture changes by more than it; 0 turns it off, under 1.
    pub termination: f64,
    /// Whether kernels grow if voxels fall closer together than pixels; see [`Growth`](crate::camera::Growth).
    pub antialiasing: bool,
    /// What stands for voxels whose kernels have grown.
    pub level: Level,
    /// The reconstruction kernel.
    pub kernel: Kernel,
    /// What sums of kernels are divided by.
    pub normalization: Normalization,
    /// How much of the blur of the kernel is taken back, 0 (none) to 1.
    ///
    /// A Gaussian gives way to a blob of radius 2, which is as narrow as [`Kernel::KAISER_BESSEL`] at 1. If scalars are
    /// reconstructed (post-shading and projections of intensity), the samples are filtered besides, once for a scene:
    /// at 1 the field passes through them as well as the kernel can, and overshoots beside edges. Noise grows: see
    /// [`Stats::noise`](crate::stats::Stats::noise) and [`reconstruction`](crate::reconstruction). Filtered samples
    /// take 4 bytes each of host memory as long as the scene lives. Pre-shaded, a blob is refused.
    pub sharpness: f64,
    /// What draws the splats, with its own knobs.
    pub painter: Painter,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            model: Model::default(),
            response: Response::default(),
            depth_coded: false,
            attenuation: 0.0,
            shading: Shading::default(),
            lighting: None,
            clip: Clip::default(),
            interslice: Interslice::default(),
            termination: 1e-3,
            antialiasing: true,
            level: Level::default(),
            kernel: Kernel::default(),
            normalization: Normalization::default(),
            sharpness: 0.0,
            painter: Painter::default(),
        }
    }
}

named! { "precision", Precision { F16: "f16", F32: "f32" } }
named! {
    "model",
    Model { Composite: "composite", Xray: "xray", Mip: "mip", Minip: "minip", Average: "average" }
}
named! { "shading", Shading { Pre: "pre", Post: "post" } }
named! { "sheets", Sheets { Image: "image", Axis: "axis" } }
named! { "accumulation", Accumulation { OpticalDepth: "optical-depth", Additive: "additive" } }
named! { "interslice", Interslice { Parabola: "parabola", Mean: "mean" } }
named! { "resolution", Resolution { Capped: "capped", Full: "full" } }

impl Precision {
    /// The error of the footprint table that the rounding of such sheets makes worth while, of the footprint's peak.
    #[must_use]
    pub fn footprint_error(self) -> f64 {
        match self {
            Self::F16 => 1e-4,
            Self::F32 => 1e-5,
        }
    }
}

impl QuadsSettings {
    /// Refuses knobs out of range.
    fn validate(&self) -> Result<()> {
        in_range("sheet_thickness", self.sheet_thickness, 0.05..=64.0, "voxels")?;
        if let Some(e) = self.table_error {
            in_range("table_error", e, 1e-7..=0.1, "of the footprint's peak")?;
        }
        Ok(())
    }
}

/// Refuses a number out of range.
fn in_range(name: &'static str, value: f64, range: std::ops::RangeInclusive<f64>, unit: &str) -> Result<()> {
    if range.contains(&value) {
        return Ok(());
    }
    let (low, high) = (range.start(), range.end());
    Err(Error::Setting { name, reason: format!("{value}, expected {low} to {high} {unit}") })
}

impl Settings {
    /// The most that a maximum is attenuated.
    pub const MAX_ATTENUATION: f64 = 20.0;

    /// Refuses settings out of range, and settings that do not go together.
    ///
    /// What the adapter or a painter cannot do is refused by [`Renderer::render`](crate::renderer::Renderer::render).
    ///
    /// # Errors
    /// [`Error::Setting`] that names the setting, what was given and what is accepted.
    pub fn validate(&self) -> Result<()> {
        self.kernel.validate()?;
        in_range("sharpness", self.sharpness, 0.0..=1.0, "")?;
        self.check_sharpness()?;
        in_range("attenuation", self.attenuation, 0.0..=Self::MAX_ATTENUATION, "")?;
        if !(0.0..1.0).contains(&self.termination) {
            let reason = format!("{}, expected 0 to under 1", self.termination);
            return Err(Error::Setting { name: "termination", reason });
        }
        self.response.validate()?;
        if let Some(lighting) = &self.lighting {
            lighting.validate()?;
        }
        if let Level::At(level) = self.level
            && level > MAX_LEVEL
        {
            return Err(Error::Setting {
                name: "level",
                reason: format!("{level}, expected auto or 0 to {MAX_LEVEL}"),
            });
        }
        let quads = self.quads();
        quads.validate()?;
        self.check_combination(&quads)
    }

    /// Refuses a sharpness that the kernel cannot have.
    fn check_sharpness(&self) -> Result<()> {
        let sharpens = self.sharpness > 0.0;
        if sharpens && !self.is_post_shaded() && self.kernel.narrowed(1.0).is_none() {
            let reason = format!(
                "no kernel narrower than {} is without ripple: expected 0, a wider Gaussian, or post-shading",
                self.kernel
            );
            return Err(Error::Setting { name: "sharpness", reason });
        }
        if sharpens && self.is_post_shaded() { Prefilter::check(&self.reconstruction_kernel()) } else { Ok(()) }
    }

    /// The kernel that reconstructs: the one asked for, or a narrower one if the picture is to be sharper.
    #[must_use]
    pub fn reconstruction_kernel(&self) -> Kernel {
        if self.sharpness > 0.0 { self.kernel.narrowed(self.sharpness).unwrap_or(self.kernel) } else { self.kernel }
    }

    /// What the samples are filtered for: a kernel and a sharpness; `None`: they are not.
    pub(crate) fn sharpens(&self) -> Option<(Kernel, f64)> {
        (self.sharpness > 0.0 && self.is_post_shaded()).then(|| (self.reconstruction_kernel(), self.sharpness))
    }

    /// The filter of the samples; `None`: they are not filtered.
    ///
    /// # Errors
    /// [`Error::Setting`] if the kernel is too large.
    pub fn prefilter(&self) -> Result<Option<Prefilter>> {
        self.sharpens().map(|(kernel, sharpness)| Prefilter::new(&kernel, sharpness)).transpose()
    }

    /// Refuses what does not go together: one row for each rule.
    fn check_combination(&self, quads: &QuadsSettings) -> Result<()> {
        let axis = quads.sheets == Sheets::Axis;
        let additive = quads.accumulation == Accumulation::Additive;
        let post = self.is_post_shaded();
        let xray = self.model == Model::Xray;
        let coarse = matches!(self.level, Level::At(level) if level > 0) && !post;
        let rules = [
            (
                coarse && (axis || additive),
                "level",
                "cells of a level above 0 need image-aligned sheets of optical depth",
            ),
            (
                post && axis,
                "sheets",
                "post-shading and projections of intensity need image-aligned sheets, axis does not go",
            ),
            (
                post && additive,
                "accumulation",
                "post-shading and projections of intensity add up scalars, additive does not go",
            ),
            (self.model != Model::Composite && self.lighting.is_some(), "lighting", "only the composite model is lit"),
            (
                !xray && self.response != Response::default(),
                "response",
                "only an X-ray shows the optical depth of rays: expected absorption",
            ),
            (
                self.depth_coded && !matches!(self.model, Model::Mip | Model::Minip),
                "depth_coded",
                "only a maximum or a minimum lies at a depth: the model is neither mip nor minip",
            ),
            (
                self.attenuation > 0.0 && self.model != Model::Mip,
                "attenuation",
                "only a maximum is attenuated by its depth: the model is not mip",
            ),
            (xray && self.shading == Shading::Post, "shading", "an X-ray adds up voxels' extinction: it is pre-shaded"),
            (xray && axis, "sheets", "an X-ray has one sheet, axis does not go"),
            (xray && additive, "accumulation", "an X-ray is a sheet of optical depth, additive does not go"),
        ];
        match rules.into_iter().find(|(broken, ..)| *broken) {
            Some((_, name, reason)) => Err(Error::Setting { name, reason: reason.to_owned() }),
            None => Ok(()),
        }
    }

    /// RESPONSE and `curve` in shaders/common/response.wgsl.
    pub(crate) fn xray_response(&self) -> (u32, [f32; 4]) {
        if self.model == Model::Xray { self.response.for_shaders() } else { (0, [0.0; 4]) }
    }

    /// The knobs of the painter quads, if that draws the picture.
    pub(crate) fn quads(&self) -> QuadsSettings {
        if let Painter::Quads(quads) = self.painter { quads } else { QuadsSettings::default() }
    }

    /// The knobs of the painter tiles, if that draws the picture.
    pub(crate) fn tiles(&self) -> TilesSettings {
        if let Painter::Tiles(tiles) = self.painter { tiles } else { TilesSettings::default() }
    }

    /// Whether cells may stand for voxels.
    pub(crate) fn takes_cells(&self) -> bool {
        let quads = self.quads();
        !self.is_post_shaded() && quads.sheets == Sheets::Image && quads.accumulation == Accumulation::OpticalDepth
    }

    /// The same with sheets so many times as thick.
    pub(crate) fn with_sheets_of(self, times: f64) -> Self {
        let Painter::Quads(quads) = self.painter else { return self };
        let sheet_thickness = (times * quads.sheet_thickness).clamp(0.05, 64.0);
        Self { painter: Painter::Quads(QuadsSettings { sheet_thickness, ..quads }), ..self }
    }

    /// Which light is kept from voxels; `None` if all of it arrives.
    /// Whether some light is at a place.
    pub(crate) fn has_point_lights(&self) -> bool {
        self.lighting.as_ref().is_some_and(Lighting::has_points)
    }

    pub(crate) fn casting(&self) -> Option<Casting> {
        self.lighting.as_ref().and_then(Lighting::casting)
    }

    /// The number of lights; 0 without light.
    pub(crate) fn light_count(&self) -> u32 {
        self.lighting.as_ref().map_or(0, |lighting| lighting.lights.len() as u32)
    }

    /// The pieces, `per_voxel` of them, in which a post-shaded slab is classified that is so many voxels thick.
    pub(crate) fn samples_per_slab(&self, voxels: f64, per_voxel: f64) -> u32 {
        match self.interslice {
            Interslice::Mean => 1,
            Interslice::Parabola => (per_voxel * voxels).ceil().clamp(2.0, 64.0) as u32,
        }
    }

    /// Whether sheets hold scalars that are classified per pixel: post-shading and projections of intensity.
    #[must_use]
    pub fn is_post_shaded(&self) -> bool {
        match self.model {
            Model::Composite => self.shading == Shading::Post,
            Model::Xray => false,
            Model::Mip | Model::Minip | Model::Average => true,
        }
    }

    /// The volume and the transfer function whose maximum is the minimum that is asked for: mirrored at 0. `None`: no
    /// minimum is asked for.
    pub(crate) fn mirrored(
        &self,
        volume: &Volume,
        transfer: &TransferFunction,
    ) -> Result<Option<(Volume, TransferFunction)>> {
        if self.model != Model::Minip {
            return Ok(None);
        }
        let (slope, intercept) = volume.rescale();
        Ok(Some((volume.clone().with_rescale(-slope, -intercept)?, transfer.mirrored())))
    }
}
