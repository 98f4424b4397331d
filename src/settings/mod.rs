//! Settings of a picture: the model, and its precision.

pub(crate) mod budget;
mod options;
pub(crate) mod parse;
pub(crate) mod response;

use crate::camera::clip::Clip;
use crate::error::{Error, Result};
use crate::kernel::reconstruction::{Prefilter, Reconstruction};
use crate::kernel::{Kernel, Normalization};
use crate::lighting::{Casting, Lighting, Normals};
pub use crate::settings::options::RendererOptions;
pub use crate::settings::response::Response;
use crate::transfer::TransferFunction;
use crate::volume::Volume;
use voxsplat_volume::names::named;

/// The format of the sheet buffers. The frame into which sheets are composited is always f32.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Precision {
    /// Half-precision sheets: half the memory traffic, and the errors that [`QuadsSettings::precision`] lists.
    F16,
    /// Single-precision sheets; needs an adapter that blends 32-bit floats.
    F32,
}

/// The model: the value of a pixel, given the fields along its ray.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Model {
    /// Emission and absorption: C = integral of c tau exp(-integral of tau), alpha = 1 - exp(-integral of tau).
    #[default]
    Composite,
    /// Absorption only: the [`Settings::response`] to the integral of tau, by default white of alpha = 1 -
    /// exp(-integral of tau). One sheet of whole footprints, exact.
    Xray,
    /// Maximum intensity projection: the colour of the largest reconstructed value on the ray's part in the box of the
    /// voxels, its alpha the opacity of that value over the largest opacity of the transfer function.
    Mip,
    /// Minimum intensity projection: as [`Self::Mip`], for the smallest value in the box of the voxels.
    Minip,
    /// Average intensity projection: as [`Self::Mip`], for the mean value.
    Average,
}

/// The stage at which the transfer function is applied. X-rays are always pre-shaded, projections of intensity
/// post-shaded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Shading {
    /// Each voxel is classified and lit, then extinction and emission are reconstructed. Fast, and blurs surfaces.
    #[default]
    Pre,
    /// The scalar is reconstructed, then classified and lit per pixel and sheet (Mueller, Moeller and Crawfis 1999,
    /// "Splatting without the blur"). Sharp at any magnification.
    Post,
}

/// The sheets into which splats are gathered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Sheets {
    /// Slabs parallel to the image; each kernel is cut by their planes (Mueller and Crawfis 1998).
    #[default]
    Image,
    /// The voxel planes most parallel to the image, a whole footprint per voxel (Westover 1990). Historical: the
    /// picture pops when the planes switch.
    Axis,
}

/// The quantity that a sheet accumulates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Accumulation {
    /// The optical depth: the alpha of a sheet is 1 - exp(-sum), exact for every thickness.
    #[default]
    OpticalDepth,
    /// The sum of opacities, clamped at 1. Historical: does not converge with thinner sheets.
    Additive,
}

/// The scalar by which a post-shaded sheet is classified.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Interslice {
    /// The parabola through the means of the sheet and its two neighbours, in six pieces per voxel of thickness.
    #[default]
    Parabola,
    /// The mean of the sheet, once. Historical: a narrow peak of the transfer function may fall between two sheets.
    Mean,
}

/// The painter that draws the picture, with its own knobs. To set a knob is to choose its painter.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub enum Painter {
    /// The choice of the library: for an [`Engine`](crate::engine::Engine) without a GPU `Cpu`; on a device `Tiles`, or
    /// `Quads` if tiles refuses the picture. Only the adapter and the settings decide, so that the same input gives the
    /// same bytes; [`Stats::painter_reason`](crate::stats::Stats::painter_reason) states the reason.
    #[default]
    Auto,
    /// Instanced quads that the rasteriser adds up in sheets. Draws every picture without isosurfaces.
    Quads(QuadsSettings),
    /// A ray for each pixel, which gathers the kernels that it meets, plane by plane, in compute shaders. Draws all
    /// models, shadings and projections, but not:
    ///
    /// - grown kernels that reach over 4 voxels;
    /// - post-shaded, kernels that reach less than a voxel;
    /// - pre-shaded, an eye within the reach of a kernel;
    /// - post-shaded, values over 4096 times as far from the transfer function's base as its control points.
    Tiles,
    /// The [host engine](crate::host): rays on the processor, without a graphics driver. A
    /// [`Renderer`](crate::renderer::Renderer) refuses it.
    Cpu,
}

/// The knobs of the painter quads.
///
/// End a literal with `..QuadsSettings::default()`: a minor release may add fields.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct QuadsSettings {
    /// The sheets into which splats are gathered.
    pub sheets: Sheets,
    /// The quantity that a sheet accumulates.
    pub accumulation: Accumulation,
    /// The thickness of a sheet in voxels, measured along the central ray; 0.05 to 64. If kernels grow (see
    /// [`Settings::antialiasing`]), the growth of the nearest kernel multiplies it. Sheets are thinner in wide fields
    /// of view, so that the most oblique ray is at most 2 times as long in a sheet, post-shaded 1.25 times.
    /// Post-shaded, they are also thinner by 1 - [`Settings::sharpness`] / 2, and by radius / 2 if the kernel's radius
    /// is under 2 voxels.
    pub sheet_thickness: f64,
    /// The format of the sheet buffers; `None` is f32 if the adapter blends it, and f16 otherwise.
    /// [`Stats::painter`](crate::stats::Stats::painter) reports the format.
    ///
    /// Half floats err in alpha by 3e-4 on hardware that rounds each sum to the nearest, and by 2e-3 to 4e-3 on
    /// hardware that truncates sums, such as Mesa's software rasteriser, and AMD's GPUs as Mesa's drivers configure
    /// them. If kernels grow (see [`Settings::antialiasing`]), more kernels meet in a sheet: 1.1e-2 was measured at 1.9
    /// times, and 6e-2 at twenty times. Scalars err by 5e-4 of their distance from the invisible value. Sheets of half
    /// floats are at most 4 voxels thick, also for X-rays, because thicker sheets lose late summands.
    pub precision: Option<Precision>,
    /// The largest interpolation error of the footprint table, as a fraction of the footprint's peak, 1e-7 to 0.1;
    /// `None` matches the precision of the sheets.
    pub table_error: Option<f64>,
    /// Makes literals that name all fields impossible.
    #[doc(hidden)]
    #[serde(skip)]
    pub non_exhaustive: (),
}

impl Default for QuadsSettings {
    fn default() -> Self {
        Self {
            sheets: Sheets::default(),
            accumulation: Accumulation::default(),
            sheet_thickness: 1.0,
            precision: None,
            table_error: None,
            non_exhaustive: (),
        }
    }
}

/// The coarsest level.
pub(crate) const MAX_LEVEL: u32 = 12;

/// The level of the cells that replace voxels with grown kernels: 2^n voxels along each axis at level n, and half as
/// many more at level n + 1/2. Cost then follows the picture instead of the volume (Laur and Hanrahan 1991,
/// "Hierarchical splatting").
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub enum Level {
    /// The coarsest accurate cells: within 2 of 255 (rms over covered pixels) of voxels with grown kernels.
    ///
    /// In thin matter level 1 replaces voxels if the default Gaussian has grown 1.5 times, level 2 if it has grown 3
    /// times. Pre-shaded pictures have the levels between too: level 1/2 if it has grown 1.125 times. Dense matter
    /// needs more growth: 2.5 times for level 1 if a cell has an optical depth of 2, 4.9 times at 10. The longest axis
    /// of the lattice decides. Light does not matter, because voxels are lit before they become cells. In perspective
    /// the level depends on depth; pre-shaded by [`Painter::Quads`] a picture has the level of its nearest kernels.
    /// Post-shaded pictures have level 1/2 and whole levels. Along parallel rays a picture has one level, a finer one
    /// in dense matter. In perspective cells have an optical depth of at most 1; [`Painter::Quads`], and maxima by both
    /// painters, replace voxels there from a growth of 4 on. Level 0 alone is used if values are over 16 times as far
    /// from the transfer function's base as its control points, or if regions of one value are visible and lit.
    #[default]
    Auto,
    /// Cells of this level, 0 to 12, without regard to accuracy. Kernels have at least the smallest width of cells: at
    /// level 1 the default Gaussian has grown 1.5 times. Level 0 is voxels. Post-shaded perspective allows only 0.
    At(u32),
}

/// The settings of a picture.
///
/// End a literal with `..Settings::default()`: a minor release may add fields.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Settings {
    /// The value of a pixel.
    pub model: Model,
    /// The response of an X-ray to the optical depth along a ray.
    pub response: Response,
    /// Whether colours encode the depth of a maximum or a minimum: red nearest, through yellow, green, cyan and blue,
    /// to violet farthest, along the view between the nearest and the farthest corner of the box of the voxels. They
    /// are as bright as the brightest channel of the transfer function's colour, which gives alpha as well.
    pub depth_coded: bool,
    /// The attenuation of a maximum by depth, 0 (none) to [`Self::MAX_ATTENUATION`]. The distance of a value from the
    /// transfer function's base is multiplied by exp(-attenuation d), with d from 0 at the nearest to 1 at the farthest
    /// corner of the box of the voxels, along the view. Of two equal values the nearer one is visible, and distant
    /// values are dim (Wallis and Miller 1991, "Three-dimensional display in nuclear medicine and radiology").
    pub attenuation: f64,
    /// The stage at which the transfer function is applied.
    pub shading: Shading,
    /// The light on surfaces; `None`: colours come from the transfer function alone.
    pub lighting: Option<Lighting>,
    /// Clipping in the world. A scene serves pictures with any clipping: only shadows are computed again.
    pub clip: Clip,
    /// The scalar by which a post-shaded slab is classified.
    pub interslice: Interslice,
    /// Early ray termination: nothing is drawn behind a pixel that transmits less than this fraction of the light. No
    /// channel of the picture changes by more. 0 (off) to under 1.
    pub termination: f64,
    /// Whether kernels grow if voxels are closer together than pixels; see [`Growth`](crate::camera::Growth).
    pub antialiasing: bool,
    /// The level of cells that replace voxels with grown kernels.
    pub level: Level,
    /// The reconstruction kernel.
    pub kernel: Kernel,
    /// The normalisation of sums of kernels.
    pub normalization: Normalization,
    /// The share of the blur of the kernel that is undone, 0 (none) to 1.
    ///
    /// A blob of radius 2 replaces a Gaussian; at 1 it is as narrow as [`Kernel::KAISER_BESSEL`]. Post-shading and
    /// projections of intensity also filter the samples, once for a scene: at 1 the field interpolates them as well as
    /// the kernel can, and overshoots beside edges. Noise grows: see [`Stats::noise`](crate::stats::Stats::noise) and
    /// [`reconstruction`](crate::kernel::reconstruction). Filtered samples take 4 bytes each of host memory while the
    /// scene lives. A pre-shaded blob is refused.
    pub sharpness: f64,
    /// The painter that draws the splats, with its own knobs.
    pub painter: Painter,
    /// Makes literals that name all fields impossible.
    #[doc(hidden)]
    #[serde(skip)]
    pub non_exhaustive: (),
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
            non_exhaustive: (),
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

impl Precision {
    /// Returns the error of the footprint table that matches the rounding of sheets of this precision, as a fraction of
    /// the footprint's peak.
    #[must_use]
    pub fn footprint_error(self) -> f64 {
        match self {
            Self::F16 => 1e-4,
            Self::F32 => 1e-5,
        }
    }
}

/// Refuses a number out of range.
fn in_range(name: &'static str, value: f64, range: std::ops::RangeInclusive<f64>, unit: &str) -> Result<()> {
    if range.contains(&value) {
        return Ok(());
    }
    let (low, high) = (range.start(), range.end());
    Err(Error::setting(name, format!("{value}, expected {low} to {high}{unit}")))
}

impl Settings {
    /// The largest attenuation of a maximum.
    pub const MAX_ATTENUATION: f64 = 20.0;

    /// Refuses settings out of range, and settings that exclude each other.
    ///
    /// [`Renderer::render`](crate::renderer::Renderer::render) refuses settings that the adapter or the painter does
    /// not support.
    ///
    /// # Errors
    /// [`Error::Setting`] that names the setting, its value and the accepted values.
    pub fn validate(&self) -> Result<()> {
        self.kernel.validate()?;
        in_range("sharpness", self.sharpness, 0.0..=1.0, "")?;
        self.check_sharpness()?;
        in_range("attenuation", self.attenuation, 0.0..=Self::MAX_ATTENUATION, "")?;
        if !(0.0..1.0).contains(&self.termination) {
            return Err(Error::setting("termination", format!("{}, expected 0 to under 1", self.termination)));
        }
        self.response.validate()?;
        self.lighting.as_ref().map_or(Ok(()), Lighting::validate)?;
        if let Level::At(level) = self.level
            && level > MAX_LEVEL
        {
            return Err(Error::setting("level", format!("{level}, expected auto or 0 to {MAX_LEVEL}")));
        }
        let quads = self.quads();
        in_range("sheet_thickness", quads.sheet_thickness, 0.05..=64.0, " voxels")?;
        in_range("table_error", quads.table_error.unwrap_or(1e-7), 1e-7..=0.1, " of the footprint's peak")?;
        self.check_combination(&quads)
    }

    /// Refuses a sharpness that the kernel does not support.
    fn check_sharpness(&self) -> Result<()> {
        let sharpens = self.sharpness > 0.0;
        if sharpens && !self.is_post_shaded() && self.kernel.narrowed(1.0).is_none() {
            let expected = "expected 0, a wider Gaussian, or post-shading";
            let reason = format!("no kernel narrower than {} is without ripple: {expected}", self.kernel);
            return Err(Error::setting("sharpness", reason));
        }
        if sharpens && self.is_post_shaded() { Prefilter::check(&self.reconstruction_kernel()) } else { Ok(()) }
    }

    /// Returns the kernel that reconstructs: the requested one, or a narrower one for sharpness.
    #[must_use]
    pub fn reconstruction_kernel(&self) -> Kernel {
        if self.sharpness > 0.0 { self.kernel.narrowed(self.sharpness).unwrap_or(self.kernel) } else { self.kernel }
    }

    /// Returns the kernel and the sharpness for which samples are filtered; `None`: no filter.
    pub(crate) fn sharpens(&self) -> Option<(Kernel, f64)> {
        (self.sharpness > 0.0 && self.is_post_shaded()).then(|| (self.reconstruction_kernel(), self.sharpness))
    }

    /// Returns the filter of the samples; `None`: no filter.
    ///
    /// # Errors
    /// [`Error::Setting`] if the kernel is too large.
    #[doc(hidden)]
    pub fn prefilter(&self) -> Result<Option<Prefilter>> {
        self.sharpens().map(|(kernel, sharpness)| Prefilter::new(&kernel, sharpness)).transpose()
    }

    /// Returns the reconstruction of pictures with these settings: their kernel and their filter.
    ///
    /// # Errors
    /// [`Error::Setting`] if the settings are refused.
    #[doc(hidden)]
    pub fn reconstruction(&self) -> Result<Reconstruction> {
        self.validate()?;
        Ok(Reconstruction::new(self.reconstruction_kernel(), self.prefilter()?))
    }

    /// Refuses settings that exclude each other: one row for each rule.
    fn check_combination(&self, quads: &QuadsSettings) -> Result<()> {
        let axis = quads.sheets == Sheets::Axis;
        let additive = quads.accumulation == Accumulation::Additive;
        let (post, model, response) = (self.is_post_shaded(), self.model, self.response);
        let (xray, extreme) = (model == Model::Xray, matches!(model, Model::Mip | Model::Minip));
        let coarse = matches!(self.level, Level::At(1..)) && !post;
        let rules = [
            (coarse && (axis || additive), "level", "cells above level 0 need image-aligned sheets of optical depth"),
            (post && axis, "sheets", "post-shading and projections of intensity need sheets along the image, not axis"),
            (post && additive, "accumulation", "post-shading and projections of intensity sum scalars, not opacities"),
            (model != Model::Composite && self.lighting.is_some(), "lighting", "only the composite model is lit"),
            (!xray && response != Response::default(), "response", "only an X-ray has a response: expected absorption"),
            (self.depth_coded && !extreme, "depth_coded", "only maxima and minima have a depth: expected mip or minip"),
            (self.attenuation > 0.0 && model != Model::Mip, "attenuation", "only maxima are attenuated: expected mip"),
            (xray && self.shading == Shading::Post, "shading", "an X-ray adds up voxels' extinction: it is pre-shaded"),
            (xray && axis, "sheets", "an X-ray has a single sheet: expected image"),
            (xray && additive, "accumulation", "an X-ray is a sheet of optical depth: expected optical-depth"),
        ];
        match rules.into_iter().find(|(broken, ..)| *broken) {
            Some((_, name, reason)) => Err(Error::setting(name, reason)),
            None => Ok(()),
        }
    }

    /// Returns whether pictures have depths ([`Renderer::depths`](crate::renderer::Renderer::depths)): only pictures of
    /// the composite model do, unless sheets lie along an axis of the lattice, where a sheet has no single depth.
    #[must_use]
    pub fn has_depths(&self) -> bool {
        self.model == Model::Composite && self.quads().sheets == Sheets::Image
    }

    /// Refuses settings of pictures without depths.
    pub(crate) fn check_depths(&self) -> Result<()> {
        if self.has_depths() {
            return Ok(());
        }
        let reason = "only the composite model has depths, and not in sheets along an axis";
        Err(Error::setting("model", format!("{}: {reason}", self.model.name())))
    }

    /// Returns RESPONSE and `curve` of shaders/common/response.wgsl.
    pub(crate) fn xray_response(&self) -> (u32, [f32; 4]) {
        if self.model == Model::Xray { self.response.for_shaders() } else { (0, [0.0; 4]) }
    }

    /// Returns the knobs of the painter quads; the defaults for another painter.
    pub(crate) fn quads(&self) -> QuadsSettings {
        if let Painter::Quads(quads) = self.painter { quads } else { QuadsSettings::default() }
    }

    /// Returns whether cells may replace voxels.
    pub(crate) fn takes_cells(&self) -> bool {
        let quads = self.quads();
        !self.is_post_shaded() && quads.sheets == Sheets::Image && quads.accumulation == Accumulation::OpticalDepth
    }

    /// Returns the settings with the thickness of sheets multiplied by a factor.
    pub(crate) fn with_sheets_of(self, times: f64) -> Self {
        let Painter::Quads(quads) = self.painter else { return self };
        let sheet_thickness = (times * quads.sheet_thickness).clamp(0.05, 64.0);
        Self { painter: Painter::Quads(QuadsSettings { sheet_thickness, ..quads }), ..self }
    }

    /// Returns whether any light is at a place.
    pub(crate) fn has_point_lights(&self) -> bool {
        self.lighting.as_ref().is_some_and(Lighting::has_points)
    }

    /// Returns the shadows that lights cast; `None`: no shadows.
    pub(crate) fn casting(&self) -> Option<Casting> {
        self.lighting.as_ref().and_then(Lighting::casting)
    }

    /// Returns the number of lights; 0 without light.
    pub(crate) fn light_count(&self) -> u32 {
        self.lighting.as_ref().map_or(0, |lighting| lighting.lights.len() as u32)
    }

    /// Returns the number of pieces in which a post-shaded slab of a thickness in voxels is classified, `per_voxel` to
    /// a voxel.
    pub(crate) fn samples_per_slab(&self, voxels: f64, per_voxel: f64) -> u32 {
        match self.interslice {
            Interslice::Mean => 1,
            Interslice::Parabola => (per_voxel * voxels).ceil().clamp(2.0, 64.0) as u32,
        }
    }

    /// Returns the normals that light needs; `None`: there is no light.
    pub(crate) fn normals(&self) -> Option<Normals> {
        self.lighting.as_ref().map(|lighting| lighting.normals)
    }

    /// Returns the error of a setting with which a scene was not prepared.
    pub(crate) fn not_prepared(name: &'static str, what: &str) -> Error {
        let reason = format!("the scene was prepared {what}: prepare it with the settings it is rendered with");
        Error::setting(name, reason)
    }

    /// Refuses light on a scene that was prepared with these normals, or without light.
    pub(crate) fn check_normals(&self, prepared: Option<Normals>) -> Result<()> {
        match (prepared, self.normals()) {
            (None, Some(_)) => Err(Self::not_prepared("light", "without light")),
            (Some(own), Some(other)) if own != other => Err(Self::not_prepared("normals", "with other normals")),
            _ => Ok(()),
        }
    }

    /// Returns whether sheets hold scalars that are classified per pixel: post-shading and projections of intensity.
    #[must_use]
    pub fn is_post_shaded(&self) -> bool {
        match self.model {
            Model::Composite => self.shading == Shading::Post,
            Model::Xray => false,
            Model::Mip | Model::Minip | Model::Average => true,
        }
    }

    /// Returns the settings of the isosurfaces in a picture: those of a scalar that is classified along rays.
    pub(crate) fn along_rays(&self) -> Self {
        Self { shading: Shading::Post, ..self.clone() }
    }

    /// Returns the volume and the transfer function mirrored at 0, whose maximum is the requested minimum; `None`: no
    /// minimum is requested.
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
