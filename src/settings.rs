//! What is modelled, and how finely.

use crate::error::{Error, Result};
use crate::kernel::{Kernel, Normalization};

/// The format of the sheet buffers. The frame that they are composited into is always f32.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// Half-precision sheets: half the memory traffic.
    F16,
    /// Single-precision sheets; needs an adapter that blends 32-bit floats.
    F32,
}

/// The settings of a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Width and height of the picture in pixels.
    pub size: [u32; 2],
    /// The reconstruction kernel.
    pub kernel: Kernel,
    /// What sums of kernels are divided by.
    pub normalization: Normalization,
    /// Thickness of a sheet, in voxels along the central ray.
    pub sheet_thickness: f64,
    /// The format of the sheet buffers; `None` takes f16 on a GPU and f32 on a software adapter.
    ///
    /// Mesa's software rasteriser cuts each sum off when it stores half floats where GPUs round to the nearest: with
    /// some fifty contributions to a pixel of a sheet, alpha comes out 2e-3 to 4e-3 too low there, and f32 is as fast.
    pub precision: Option<Precision>,
    /// Largest interpolation error of the footprint table, as a fraction of the footprint's peak; `None` takes what
    /// the precision of the sheets deserves.
    pub max_error: Option<f64>,
    /// How many sheets one pass feeds; `None` takes what the adapter does best.
    pub sheets_per_pass: Option<u32>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            size: [1024, 1024],
            kernel: Kernel::default(),
            normalization: Normalization::default(),
            sheet_thickness: 1.0,
            precision: None,
            max_error: None,
            sheets_per_pass: None,
        }
    }
}

impl std::fmt::Display for Precision {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::F16 => "f16",
            Self::F32 => "f32",
        })
    }
}

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
        if let Some(n) = self.sheets_per_pass
            && !(1..=8).contains(&n)
        {
            return error("sheets-per-pass", format!("{n}, expected 1 to 8"));
        }
        Ok(())
    }
}
