//! The truth: the pre-shaded optical model, integrated in f64 along each pixel's ray.
//!
//! ```text
//! tau(x) = sum_j tau_j h(g(x) - j) / N        e(x) = sum_j c_j tau_j h(g(x) - j) / N
//! C = integral of e(t) exp(-integral_0^t tau) dt        alpha = 1 - exp(-integral of tau dt)
//! ```
//!
//! with j the lattice points, g the map from world to lattice, h the kernel, N its divisor, c_j and tau_j the colour
//! and extinction that the transfer function gives voxel j (Westover 1990; Max 1995, "Optical models for direct volume
//! rendering", absorption plus emission). This is what splatting approximates by footprints and sheets; here there
//! are neither: every ray is cut wherever it enters or leaves a kernel's support, and the pieces are integrated by
//! Gauss's rule on the values of the kernel. Errors of optical depth and colour are about 1e-10 of their size.
//!
//! Slow, and made to be right: nothing is shared with the renderer but the data it reads.

mod classify;
mod integrate;
mod profile;
#[cfg(test)]
pub(crate) mod stages;
mod walk;

pub use integrate::RayIntegral;

use std::cell::RefCell;
use std::sync::{Mutex, PoisonError};

use glam::DVec3;
use rayon::prelude::*;

use crate::camera::{Camera, Projection};
use crate::error::{Error, Result};
use crate::image::Image;
use crate::kernel::{Kernel, Normalization};
use crate::settings::Settings;
use crate::transfer::TransferFunction;
use crate::volume::{Grid, Volume};
use classify::Splats;
use integrate::{Scratch, Steps, integrate};
use profile::Profile;
use walk::{LatticeRay, Walk};

/// The longest step, as a fraction of the kernel's own scale (a Gaussian's sigma).
const LONGEST_STEP: f64 = 0.2;

/// A classified volume, ready to be integrated from any camera.
///
/// Holds a quarter of a byte per clear voxel and 32 bytes per other voxel; pictures of any size need no more.
#[derive(Debug)]
pub struct Scene {
    grid: Grid,
    splats: Splats,
    profile: Profile,
    radius: f64,
    divisor: f64,
    longest_step: f64,
}

impl Scene {
    /// Classifies a volume once.
    ///
    /// # Errors
    /// [`Error::Volume`] where samples are NaN or infinite, [`Error::Setting`] where the kernel is none,
    /// [`Error::Transfer`] where an extinction overflows.
    pub fn new(
        volume: &Volume,
        transfer: &TransferFunction,
        kernel: &Kernel,
        normalization: Normalization,
    ) -> Result<Self> {
        kernel.validate()?;
        volume.check_finite()?;
        Ok(Self {
            grid: *volume.grid(),
            splats: Splats::new(volume, transfer)?,
            profile: Profile::new(kernel),
            radius: kernel.radius(),
            divisor: normalization.divisor(kernel),
            longest_step: LONGEST_STEP * scale(kernel),
        })
    }

    /// The picture that a camera sees, `size` = width and height in pixels, one ray through the centre of each pixel.
    ///
    /// Runs on all cores of the current rayon pool. `progress` is told the fraction done, rising to 1, from one thread
    /// at a time.
    ///
    /// # Errors
    /// [`Error::Setting`] where a side of the picture is 0 or over [`Settings::MAX_SIZE`], [`Error::Camera`] where the
    /// camera is not finite.
    pub fn render(&self, camera: &Camera, size: [u32; 2], progress: &(dyn Fn(f64) + Sync)) -> Result<Image> {
        Settings { size, ..Settings::default() }.validate()?;
        let (origin, direction) = camera.ray(0.0, 0.0);
        if ![origin, direction, camera.right, camera.up].iter().all(|v| v.is_finite()) {
            return Err(Error::Camera("its position and axes must be finite".to_owned()));
        }
        thread_local! {
            static SCRATCH: RefCell<Scratch> = RefCell::default();
        }
        let two_sided = matches!(camera.projection, Projection::Orthographic { .. });
        let [width, height] = size;
        let done = Mutex::new(0_u32);
        let mut image = Image::transparent(width, height)?;
        image.pixels_mut().par_chunks_mut(width as usize).enumerate().for_each(|(y, row)| {
            SCRATCH.with_borrow_mut(|scratch| {
                for (x, pixel) in (0..width).zip(row) {
                    let (sx, sy) = Camera::image_coordinates([x, y as u32], size);
                    let (origin, direction) = camera.ray(sx, sy);
                    *pixel = self.trace(origin, direction, two_sided, scratch).rgba().map(|v| v as f32);
                }
            });
            // Held while reporting: a fraction never follows a larger one.
            let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
            *done += 1;
            progress(f64::from(*done) / f64::from(height));
        });
        Ok(image)
    }

    /// What a single ray collects, from `origin` along `direction` (world coordinates, unit length), in f64.
    /// A `two_sided` ray comes from infinity behind its origin, as the rays of an orthographic camera do.
    #[must_use]
    pub fn ray(&self, origin: DVec3, direction: DVec3, two_sided: bool) -> RayIntegral {
        self.trace(origin, direction, two_sided, &mut Scratch::default())
    }

    fn trace(&self, origin: DVec3, direction: DVec3, two_sided: bool, scratch: &mut Scratch) -> RayIntegral {
        let ray = LatticeRay::new(&self.grid, origin, direction, two_sided);
        let steps = Steps {
            profile: &self.profile,
            longest: self.longest_step,
            measure: 1.0 / (self.divisor * ray.voxels_per_unit),
        };
        Walk::new(&self.splats, ray, self.radius)
            .map_or_else(RayIntegral::default, |walk| integrate(walk, steps, scratch))
    }
}

/// The length in voxels over which a kernel changes: the sigma of the Gaussian that it resembles near its centre.
fn scale(kernel: &Kernel) -> f64 {
    match *kernel {
        Kernel::Gaussian { sigma, radius } => sigma.min(radius),
        // y^2 I_2(alpha sqrt y) with y = 1 - rho^2 / R^2 falls as exp(-alpha rho^2 / 2 R^2) for large alpha and as
        // exp(-2 rho^2 / R^2) for alpha 0.
        Kernel::KaiserBessel { radius, alpha } => radius / (alpha + 4.0).sqrt(),
    }
}

#[cfg(test)]
mod tests;
