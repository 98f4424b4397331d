//! What is modelled, and how finely.

use crate::error::{Error, Result};
use crate::kernel::{Kernel, Normalization};
use crate::lighting::Lighting;
use crate::names::named;

/// The format of the sheet buffers. The frame that they are composited into is always f32.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Precision {
    /// Half-precision sheets: half the memory traffic.
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
    /// Absorption only: white of alpha = 1 - exp(-integral of tau). One sheet of whole footprints, exact.
    Xray,
    /// The colour of the largest reconstructed value on the ray, its alpha the opacity of that value over the largest
    /// opacity of the transfer function.
    Mip,
}

/// When the transfer function is applied. X-ray is always pre-shaded, a maximum intensity projection post-shaded.
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
    /// The voxel planes most parallel to the image, a whole footprint per voxel (Westover 1990). Historical: the picture
    /// pops where the planes switch.
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
    /// The parabola through the means of the sheet and its two neighbours, at eight samples per voxel of thickness.
    #[default]
    Parabola,
    /// The mean of the sheet, once. Historical: a narrow peak of the transfer function may fall between two sheets.
    Mean,
}

/// How splats are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Painter {
    /// `Tiles` on software adapters for the pictures that it serves, but X-rays of few voxels; `Quads` for all others. Only
    /// the adapter, what is asked for and the number of voxels decide, so the same input gives the same bytes;
    /// `Stats::painter_reason` says why.
    #[default]
    Auto,
    /// Instanced quads, added up in sheets by the rasteriser: every picture.
    Quads,
    /// Rays that gather the kernels they meet, plane by plane, in compute shaders: all models, shadings and projections, with
    /// kernels that reach at most 3 voxels as they have grown (2 in perspective, where they must not grow, and post-shaded),
    /// image-aligned sheets of optical depth a voxel thick or thicker, and pre-shaded an eye that no kernel reaches.
    Tiles,
}

/// How finely the painter `Tiles` looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Resolution {
    /// Pre-shaded, one to four rays per voxel and axis, as many as the direction of view and the opacity ask for, where that
    /// is fewer than pixels, and the picture enlarged from them. What is classified per pixel has a ray for each.
    #[default]
    Capped,
    /// A ray for each pixel.
    Full,
}

/// What is left out because it cannot show, or kept because it was made before; early termination is
/// [`Settings::termination`].
///
/// All of it is on by default, and none of it changes a picture: each can be turned off to be measured
/// (`cargo run --release --example savings`) or suspected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Savings {
    /// Bricks whose range of values shows nothing are not looked at.
    pub bricks: bool,
    /// Voxels that cannot show get no splat: transparent ones; of scalars, those out of reach of anything visible.
    pub voxels: bool,
    /// Splats of bricks out of view are neither sorted nor drawn.
    pub view: bool,
    /// Sheets are composited and shaded only where bricks reach.
    pub pixels: bool,
    /// Stages are specialised for what the scene has: no normals without light, no growth of kernels that do not grow.
    pub specialization: bool,
    /// Splats of scalars are kept for the next picture that asks for the same.
    pub reuse: bool,
}

impl Default for Savings {
    fn default() -> Self {
        Self { bricks: true, voxels: true, view: true, pixels: true, specialization: true, reuse: true }
    }
}

/// The settings of a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Width and height of the picture in pixels.
    pub size: [u32; 2],
    /// What a pixel is.
    pub model: Model,
    /// When the transfer function is applied.
    pub shading: Shading,
    /// The light on surfaces; `None`: colours are those of the transfer function.
    pub lighting: Option<Lighting>,
    /// How splats are gathered into sheets.
    pub sheets: Sheets,
    /// What a sheet adds up.
    pub accumulation: Accumulation,
    /// What a post-shaded sheet is classified by.
    pub interslice: Interslice,
    /// Early splat termination: a splat is not drawn where every pixel that it could touch lets through no more than
    /// this fraction of light already. No channel of the picture changes by more than it; 0 turns it off.
    pub termination: f64,
    /// Whether kernels grow where voxels fall closer together than pixels; see [`Growth`](crate::camera::Growth).
    pub antialiasing: bool,
    /// The reconstruction kernel.
    pub kernel: Kernel,
    /// What sums of kernels are divided by.
    pub normalization: Normalization,
    /// Thickness of a sheet, in voxels along the central ray, as many times more as the nearest kernel has grown.
    pub sheet_thickness: f64,
    /// The format of the sheet buffers; `None` takes f16 on a GPU and f32 on a software adapter, and f32
    /// for scalars, and where kernels grow by half or more, wherever the adapter blends it.
    ///
    /// Mesa's software rasteriser cuts each sum off when it stores half floats where GPUs round to the nearest: with
    /// some fifty contributions to a pixel of a sheet, alpha comes out 2e-3 to 4e-3 too low there, and f32 is as fast.
    pub precision: Option<Precision>,
    /// Largest interpolation error of the footprint table, as a fraction of the footprint's peak; `None` takes what
    /// the precision of the sheets deserves.
    pub max_error: Option<f64>,
    /// Rows and coefficients per row of the footprint table, in place of what `max_error` asks for.
    pub footprint_table: Option<[u32; 2]>,
    /// How many sheets one pass feeds; `None` takes what the adapter does best.
    pub sheets_per_pass: Option<u32>,
    /// How splats are drawn.
    pub painter: Painter,
    /// How finely the painter `Tiles` looks.
    pub resolution: Resolution,
    /// What is left out.
    pub savings: Savings,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            size: [1024, 1024],
            model: Model::default(),
            shading: Shading::default(),
            lighting: None,
            sheets: Sheets::default(),
            accumulation: Accumulation::default(),
            interslice: Interslice::default(),
            termination: 1e-3,
            antialiasing: true,
            kernel: Kernel::default(),
            normalization: Normalization::default(),
            sheet_thickness: 1.0,
            precision: None,
            max_error: None,
            footprint_table: None,
            sheets_per_pass: None,
            painter: Painter::default(),
            resolution: Resolution::default(),
            savings: Savings::default(),
        }
    }
}

named! { "precision", Precision { F16: "f16", F32: "f32" } }
named! { "model", Model { Composite: "composite", Xray: "xray", Mip: "mip" } }
named! { "shading", Shading { Pre: "pre", Post: "post" } }
named! { "sheets", Sheets { Image: "image", Axis: "axis" } }
named! { "accumulate", Accumulation { OpticalDepth: "optical-depth", Additive: "additive" } }
named! { "interslice", Interslice { Parabola: "parabola", Mean: "mean" } }
named! { "painter", Painter { Auto: "auto", Quads: "quads", Tiles: "tiles" } }
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

impl Settings {
    /// The largest width or height of a picture, in pixels.
    pub const MAX_SIZE: u32 = 32_768;

    /// Refuses settings out of range.
    ///
    /// # Errors
    /// [`Error::Setting`] that names the setting, what was given and what is accepted.
    pub fn validate(&self) -> Result<()> {
        let error = |name: &'static str, reason: String| Err(Error::Setting { name, reason });
        let [w, h] = self.size;
        if !(1..=Self::MAX_SIZE).contains(&w) || !(1..=Self::MAX_SIZE).contains(&h) {
            return error("size", format!("{w}x{h} pixels, expected 1x1 to {0}x{0}", Self::MAX_SIZE));
        }
        self.kernel.validate()?;
        if !(0.05..=64.0).contains(&self.sheet_thickness) {
            return error("sheet-thickness", format!("{} voxels, expected 0.05 to 64", self.sheet_thickness));
        }
        if let Some(e) = self.max_error
            && !(1e-7..=0.1).contains(&e)
        {
            return error("max-error", format!("{e}, expected 1e-7 to 0.1 of the footprint's peak"));
        }
        if let Some([rows, terms]) = self.footprint_table
            && !((2..=4096).contains(&rows) && matches!(terms, 4 | 8 | 12 | 16))
        {
            return error(
                "footprint-table",
                format!("{rows}x{terms}, expected 2 to 4096 rows of 4, 8, 12 or 16 terms"),
            );
        }
        if !(0.0..1.0).contains(&self.termination) {
            return error("termination", format!("{}, expected 0 to under 1", self.termination));
        }
        if let Some(lighting) = &self.lighting {
            lighting.validate()?;
        }
        if self.is_post_shaded() {
            let what = if self.model == Model::Mip { "a maximum intensity projection" } else { "post-shading" };
            if self.sheets == Sheets::Axis {
                return error(
                    "sheets",
                    format!("{what} cuts kernels by image-aligned sheets, axis does not go with it"),
                );
            }
            if self.accumulation == Accumulation::Additive {
                return error("accumulate", format!("{what} adds up scalars, additive does not go with it"));
            }
        }
        if self.model != Model::Composite && self.lighting.is_some() {
            return error("light", "only the composite model is lit".to_owned());
        }
        if self.model == Model::Xray {
            if self.shading == Shading::Post {
                return error("shading", "X-ray adds up the extinction of voxels, which is pre-shading".to_owned());
            }
            if self.sheets == Sheets::Axis || self.accumulation == Accumulation::Additive {
                return error(
                    "model",
                    "X-ray has one sheet of optical depth: leave sheets and accumulation".to_owned(),
                );
            }
        }
        if let Some(n) = self.sheets_per_pass
            && !(1..=8).contains(&n)
        {
            return error("sheets-per-pass", format!("{n}, expected 1 to 8"));
        }
        Ok(())
    }

    /// Whether classified voxels get normals.
    pub(crate) fn has_normals(&self) -> bool {
        self.lighting.is_some() || !self.savings.specialization
    }

    /// The places at which a post-shaded sheet is classified.
    pub(crate) fn samples_per_sheet(&self) -> u32 {
        match self.interslice {
            Interslice::Mean => 1,
            Interslice::Parabola => (8.0 * self.sheet_thickness).ceil().clamp(2.0, 64.0) as u32,
        }
    }

    /// Whether sheets hold scalars that are classified per pixel: post-shading and maximum intensity.
    #[must_use]
    pub fn is_post_shaded(&self) -> bool {
        match self.model {
            Model::Composite => self.shading == Shading::Post,
            Model::Xray => false,
            Model::Mip => true,
        }
    }
}
