//! The truth: every model of [`Settings`], integrated in f64 along each pixel's ray.
//!
//! With j the lattice points, x a point in lattice coordinates, h the kernel, N its divisor and s_j the scale of kernel
//! j ([`Growth`]; 1 without antialiasing), values w_j at voxels are reconstructed as
//!
//! ```text
//! w(x) = sum_j w_j h((x - j) / s_j) / (s_j^3 N)
//! ```
//!
//! **Composite, pre-shaded.** tau_j and c_j are the extinction and colour that the transfer function gives voxel j
//! (Westover 1990; Max 1995, "Optical models for direct volume rendering", absorption plus emission):
//!
//! ```text
//! tau = sum of tau_j        e = sum of c_j tau_j        (both reconstructed as above)
//! C = integral of e(t) exp(-integral_0^t tau) dt        alpha = 1 - exp(-integral of tau dt)
//! ```
//!
//! Lit, c_j is [`Lighting::shade`] of colour, gradient, direction to the eye and the light that arrives at voxel j:
//! exp(-D_j), where D_j integrates tau from the voxel to the light in kernels that have not grown. The gradient along a
//! lattice axis is the sum over n = 1, 2 of b_n (f_(j+n) - f_(j-n)), smoothed along the other two axes by a_0 f_j + sum
//! of a_n (f_(j+n) + f_(j-n)), with a = 0.426375, 0.249153, 0.037659 and b = 0.278979, 0.11051 (Farid and Simoncelli
//! 2004). A neighbour beyond the edge has the value at the edge. The transpose of the map from the world to the lattice
//! takes the gradient to the world.
//!
//! With gradient opacity ([`TransferFunction::gradient_opacity`]) tau_j is multiplied by the share for the length of
//! the gradient by central differences, (f_(j+1) - f_(j-1)) / 2 along each lattice axis; post-shaded, tau is multiplied
//! by the share for the length of the reconstructed gradient, and of matter that casts shadows by that of the gradient
//! of the voxel.
//!
//! **X-ray.** The same tau; the pixel is [`Response::pixel`] of its integral, by default (alpha, alpha, alpha, alpha).
//!
//! **Composite, post-shaded** (Mueller, Moeller and Crawfis 1999, "Splatting without the blur"). The scalar is
//! reconstructed, relative to b = [`TransferFunction::base`], over the lattice with its edge samples repeated outwards
//! as far as kernels reach (the support radius times the largest scale in the lattice, rounded up), and exists inside
//! the box of the voxels, half a voxel beyond the outermost samples:
//!
//! ```text
//! f = b + sum of (f_j - b)        tau = extinction of f        e = colour of f times tau        C, alpha as above
//! ```
//!
//! Lit, the colour is shaded with a gradient, for an eye back along the ray, and with the light that arrives at voxels
//! as in pre-shading, trilinear between them. The gradient is reconstructed from gradients at the points of the
//! extended lattice: (f_(j+1) - f_(j-1)) / 2 along each axis, smoothed along the other two by
//! (f_(j-1) + 4 f_j + f_(j+1)) / 6.
//! A central difference is the slope of f + f'' / 6 along its axis, up to the fourth derivative, and with the smoothing
//! all three are slopes of f + (Laplacian of f) / 6: the gradient keeps its direction.
//!
//! **Isosurfaces** ([`TransferFunction::isosurfaces`]) lie where this f passes their value, post-shaded and pre-shaded
//! alike; pre-shaded, the matter between them is that of voxels. Each multiplies what is behind it by 1 - opacity. Its
//! colour is lit with the gradient there, and with the light that arrives 3 voxels before it along the gradient.
//!
//! **Maximum intensity.** With m the largest f on the ray's part in the box, alpha is the opacity of m over the largest
//! opacity of the transfer function, and the pixel's colour is the colour of m times alpha. The pixel of a ray that
//! misses the box is clear.
//!
//! Coded by depth, the colour is the hue of the place x of m times the largest channel of the colour of m: with v the
//! view's direction, h = 4.5 (1/2 + (x - middle of the box) . v / (depth of the box along v)), red, green and blue are
//! |h - 3| - 1, 2 - |h - 2| and 2 - |h - 4|, each cut off at 0 and 1.
//!
//! **Minimum and average intensity.** The same with the smallest f, and with the mean of f over the ray's part in the
//! box. A minimum is the maximum of -f_j by the transfer function mirrored at 0, with the base of the mirrored
//! function.
//!
//! **Clipping.** Only the part of a ray on the inner side of all planes of [`Settings::clip`] counts: tau and e are 0
//! beyond it, and the largest, the smallest and the mean value are taken over the part. Voxels whose centres are cut
//! away cast no shadow.
//!
//! **Sharpness.** The kernel is [`Settings::reconstruction_kernel`]; the f_j of all but extinction are the samples
//! filtered for it, in f64, as the renderer filters them in f32.
//!
//! Splatting approximates these models by footprints and sheets. Here there are neither: every ray is cut wherever it
//! enters or leaves a kernel's support and wherever f meets a control point, and Gauss's rule integrates the pieces.
//! Errors of optical depth, colour and means are about 1e-10 of their size, of lit post-shading 1e-9, of maxima 1e-12.
//! Settings of sheets, accumulation, termination, precision and the footprint table concern the renderer only.
//!
//! With a tolerance ([`Reference::with_tolerance`]) blocks are longer, and rays end sooner. In pre-shading a chord that
//! begins or ends in a block then adds only its first four moments: the error is of second order, and small if the
//! block is thin. Scalars are cut as without a tolerance, but a step whose nodes hardly differ is not halved.
//!
//! Empty space is skipped: the values around every cell of 4^3 voxels bound the field there.
//!
//! The reference shares no code with the painters but the samples, transfer functions and lighting, and the sums of
//! shadows, in f64 here, which a test holds against the integrals of [`Reference::ray`].

#![allow(
    clippy::disallowed_methods,
    reason = "tolerances are far above the last bit, and std's exponentials are faster"
)]

mod cells;
mod classify;
mod emission;
mod integrate;
mod media;
mod profile;
mod ray;
mod walk;

pub use integrate::RayIntegral;

use std::borrow::Cow;
use std::cell::RefCell;
use std::sync::{Arc, Mutex, PoisonError};

use glam::DVec3;
use rayon::prelude::*;

use crate::camera::Camera;
#[cfg(doc)]
use crate::camera::Growth;
use crate::camera::clip::Side;
use crate::error::{Error, Result};
use crate::image::{Image, Region};
use crate::kernel::Kernel;
use crate::layers::{Layers, finite};
use crate::lighting::{Casting, Lighting, Visibility};
use crate::progress::Progress;
use crate::settings::budget::{MAX_BLOCKS, MAX_CHORDS, MAX_RAY_CHORDS, too_much};
use crate::settings::{Model, Response, Settings};
use crate::transfer::{Resolution, TransferFunction};
use crate::volume::{Grid, Volume};
use cells::BoundMap;
use classify::{ClassifiedBricks, VoxelValues};
use integrate::{Accuracy, Attenuation, ClassifiedIntegral, EmissionIntegral, FieldClassifier, Maximum, Met};
use profile::Profile;
use ray::{LatticeRay, Viewer};
use walk::{Scratch, Sight, Sizes, Visitor, Walk};

/// The length of the longest block, in standard deviations of the smallest kernel: without and with a tolerance.
const LONGEST: [f64; 2] = [0.22, 1.1];
/// The number of steps of extinction and emission in a block: without and with a tolerance.
const STEPS: [f64; 2] = [1.0, 3.0];
/// The largest error of kernels, over their peak, without a tolerance.
const KERNEL_ERROR: f64 = 2e-14;
/// The largest error of kernels, over their peak and the tolerance.
const KERNEL_SHARE: f64 = 1e-3;

/// A volume, ready to be integrated from any camera.
///
/// Holds the samples, a quarter of a byte more per voxel, and 32 bytes per voxel of the bricks of 8^3 voxels that rays
/// have met so far and that have visible voxels. With shadows, 8 bytes more for every voxel. Pictures of any size need
/// no more.
#[derive(Debug)]
pub struct Reference {
    /// The grid of the volume, in a world whose origin is the middle of the lattice.
    grid: Grid,
    /// The middle of the lattice, in the world of the volume.
    center: DVec3,
    splats: VoxelValues,
    /// The voxels classified for all pictures; `None` if weights depend on the viewer.
    bricks: Option<Arc<ClassifiedBricks>>,
    kernel: Kernel,
    /// The standard deviation of the kernel, voxels: the length over which it changes.
    deviation: f64,
    profile: Profile,
    divisor: f64,
    longest: f64,
    accuracy: Accuracy,
    antialiasing: bool,
    depth_coded: bool,
    attenuation: f64,
    method: Method,
    /// The half-spaces that are not cut away.
    clip: Vec<Side>,
    /// The isosurfaces of a pre-shaded composite, as a scene of scalars.
    surfaces: Option<Box<Self>>,
    /// The field that light passes, and the lights, if light is found at every point.
    light: Option<Box<(Self, Casting)>>,
    progress: Progress,
}

/// The meaning of the sums over splats along a ray.
#[derive(Debug)]
enum Method {
    /// Sums of extinction and emission; voxels are lit if there is a light.
    PreShaded,
    /// Sums of extinction, whose integral makes the pixel.
    Xray(Response),
    /// Sums of the scalar, and of its gradient if there is a light.
    PostShaded(Box<FieldClassifier>),
    /// Sums of the scalar, relative to the base of the transfer function, which classifies the largest.
    Maximum(TransferFunction),
    /// Sums of the scalar, relative to the base of the transfer function, which classifies the mean.
    Mean(TransferFunction),
}

impl Reference {
    /// Reads a volume once, for the model, shading, light, kernel and normalization of `settings`.
    ///
    /// # Errors
    /// [`Error::Setting`] if a setting is out of range, [`Error::Input`] if
    /// samples are NaN, infinite or too far apart, [`Error::Transfer`] if an
    /// extinction overflows.
    pub fn new(volume: &Volume, transfer: &TransferFunction, settings: &Settings) -> Result<Self> {
        Self::of_layers(&Layers::of_volume(volume, transfer), settings)
    }

    /// Reads several layers once, pre-shaded; one volume alone as [`Self::new`] does.
    ///
    /// # Errors
    /// The errors of [`Self::new`], and [`Error::Setting`] for post-shading or a projection of several layers.
    pub fn of_layers(layers: &Layers, settings: &Settings) -> Result<Self> {
        settings.validate()?;
        let mut layers = Cow::Borrowed(layers);
        if let Some((volume, transfer)) = layers.plain() {
            let mirrored = settings.mirrored(volume, transfer)?;
            let (volume, transfer) = mirrored.as_ref().map_or((volume, transfer), |(volume, other)| (volume, other));
            let volume = &*finite(volume, transfer, settings.model)?;
            let filtered = settings.prefilter()?.map(|f| f.apply::<f64>(volume, transfer.base(), &Progress::default()));
            let filtered = filtered.transpose()?;
            layers = Cow::Owned(Layers::of_volume(filtered.as_ref().unwrap_or(volume), transfer));
        } else {
            Layers::check_settings(settings)?;
            layers = Cow::Owned(layers.finite()?);
        }
        let surfaces = match layers.isosurfaces(settings.model)?.filter(|_| !settings.is_post_shaded()) {
            None => None,
            Some((_, volume, transfer)) => {
                // The light that arrives is that of the whole scene.
                let open = |lighting: &Lighting| Lighting { shadows: 0.0, occlusion: None, ..lighting.clone() };
                let lighting = settings.lighting.as_ref().map(open);
                let settings = Settings { lighting, ..settings.along_rays() };
                Some(Box::new(Self::new(volume, &transfer, &settings)?))
            }
        };
        let settings = &Settings { kernel: settings.reconstruction_kernel(), ..settings.clone() };
        let (grid, kernel) = (layers.grid(), settings.kernel);
        let method = match (settings.model, layers.plain()) {
            (Model::Xray, _) => Method::Xray(settings.response),
            (Model::Mip | Model::Minip, Some((_, transfer))) => Method::Maximum(transfer.clone()),
            (Model::Average, Some((_, transfer))) => Method::Mean(transfer.clone()),
            (_, Some((volume, transfer))) if settings.is_post_shaded() => Method::PostShaded(Box::new(
                FieldClassifier::new(transfer, settings.lighting.as_ref(), grid, Resolution::new(transfer, volume)?),
            )),
            _ => Method::PreShaded,
        };
        let splats = VoxelValues::new(&layers, settings)?;
        // The viewer does not matter.
        let bricks = || Arc::new(ClassifiedBricks::new(&splats, Viewer::Towards(DVec3::Z)));
        let reference = Self {
            grid: grid.centered(),
            center: grid.center(),
            bricks: (!splats.depend_on_viewer()).then(bricks),
            splats,
            kernel,
            deviation: kernel.variance().sqrt(),
            profile: Profile::new(&kernel, 0.0, 1.0),
            divisor: settings.normalization.divisor(&kernel),
            longest: 0.0,
            accuracy: Accuracy { tolerance: 0.0, rim: kernel.value(kernel.radius().powi(2)), steps: 1.0 },
            antialiasing: settings.antialiasing,
            depth_coded: settings.depth_coded,
            attenuation: settings.attenuation,
            method,
            clip: settings.clip.sides(grid),
            surfaces,
            light: None,
            progress: Progress::default(),
        };
        Ok(reference.with_tolerance(0.0))
    }

    /// Makes a reference with light at every point, as a truth for light at voxels: light passes the field
    /// reconstructed and classified on its way, instead of splats of classified voxels, and is integrated for every lit
    /// point, instead of for voxels. Occlusion still comes from voxels. Takes thousands of times as long.
    ///
    /// # Errors
    /// The errors of [`Self::new`], and [`Error::Setting`] unless a post-shaded composite has light with shadows.
    pub fn with_light_everywhere(volume: &Volume, transfer: &TransferFunction, settings: &Settings) -> Result<Self> {
        let reference = Self::new(volume, transfer, settings)?;
        let Some(casting) = settings.casting().filter(|_| settings.is_post_shaded()) else {
            let reason = "light is found at every point of a post-shaded composite with shadows".to_owned();
            return Err(Error::Setting { name: "shadows", reason });
        };
        let field = Self::new(volume, transfer, &Settings { lighting: None, ..settings.clone() })?;
        Ok(Self { light: Some(Box::new((field.with_tolerance(Self::TOLERANCE), casting))), ..reference })
    }

    /// Returns the light that arrives at a place in the lattice.
    fn visibility(&self, place: DVec3) -> Visibility {
        let of_voxels = self.splats.visibility(place);
        let Some((field, casting)) = self.light.as_deref() else { return of_voxels };
        let world = self.grid.to_world().transform_point3(place) + self.center;
        let to_lattice = self.grid.to_lattice().matrix3;
        casting.visibility(world, of_voxels.ambient, |towards, reach| {
            let begin = casting.bias() / (to_lattice * towards).length();
            let beyond = |distance: f64| field.ray(world + distance * towards, towards, false).optical_depth;
            if reach <= begin { 0.0 } else { beyond(begin) - if reach.is_finite() { beyond(reach) } else { 0.0 } }
        })
    }

    /// A tolerance far below the errors of painters. A picture takes 0.3 of the time of an exact one pre-shaded, 0.5
    /// post-shaded, and hardly less if it is lit post-shaded.
    pub const TOLERANCE: f64 = 1e-5;

    /// Sets the largest error of a pixel's channels, about; 0 is as exact as rounding allows.
    #[must_use]
    pub fn with_tolerance(mut self, tolerance: f64) -> Self {
        let which = usize::from(tolerance > 0.0);
        let tolerance = tolerance.max(0.0);
        self.longest = LONGEST[which] * self.deviation;
        let beyond = self.longest * (self.longest + 2.0 * self.kernel.radius());
        self.profile = Profile::new(&self.kernel, beyond, KERNEL_ERROR.max(KERNEL_SHARE * tolerance));
        self.accuracy = Accuracy { tolerance, steps: STEPS[which], ..self.accuracy };
        self.surfaces = self.surfaces.map(|surfaces| Box::new(surfaces.with_tolerance(tolerance)));
        self
    }

    /// Sets a callback for the progress of pictures: "integrating", rising to 1.
    #[must_use]
    pub fn with_progress(mut self, progress: Progress) -> Self {
        self.progress = progress;
        self
    }

    /// Integrates a camera's picture, one ray through the centre of each pixel.
    ///
    /// With antialiasing, kernels grow for this camera. Runs on all cores of the current rayon pool. Takes about half a
    /// microsecond for each chord that a ray cuts out of a kernel, less with a tolerance, and accepts at most 2^36
    /// chords, or 2^24 for each pixel.
    ///
    /// # Errors
    /// [`Error::Setting`] if the picture has more chords: thousands of kernels that have grown far overlap.
    /// [`Error::Camera`] if the camera is not finite; [`Error::Setting`] if a side of the
    /// picture is 0 or over [`Camera::MAX_SIZE`] pixels.
    pub fn render(&self, camera: &Camera) -> Result<Image> {
        let [width, height] = camera.size;
        self.render_region(camera, Region { x: 0, y: 0, width, height })
    }

    /// Integrates a region of a camera's picture. The image has the size of the region.
    ///
    /// # Errors
    /// The errors of [`Self::render`], and [`Error::Setting`] if the region has no pixels or reaches beyond the
    /// picture.
    pub fn render_region(&self, camera: &Camera, region: Region) -> Result<Image> {
        camera.validate()?;
        region.check_within(camera.size)?;
        let mut image = Image::transparent(region.width, region.height)?;
        let rows = image.pixels_mut().par_chunks_exact_mut(region.width as usize).enumerate();
        self.traced(camera, region.area() as f64, rows, |trace, (y, row)| {
            for (x, pixel) in (region.x..).zip(row) {
                *pixel = trace([x, region.y + y as u32]).map(|v| v as f32);
            }
        })?;
        Ok(image)
    }

    /// Integrates some pixels (column and row, from the top left) of a camera's picture, in the given order. Returns
    /// premultiplied red, green, blue and alpha. Pixels outside the picture are accepted.
    ///
    /// # Errors
    /// The errors of [`Self::render`], of rays through these pixels only.
    pub fn pixels(&self, camera: &Camera, pixels: &[[u32; 2]]) -> Result<Vec<[f64; 4]>> {
        self.traced(camera, pixels.len() as f64, pixels.par_iter(), |trace, pixel| trace(*pixel))
    }

    /// Traces `count` pixels for `items` on all cores: calls a function for each item, with a function that traces a
    /// pixel.
    fn traced<I: IndexedParallelIterator, O: Send>(
        &self,
        camera: &Camera,
        count: f64,
        items: I,
        work: impl Fn(&dyn Fn([u32; 2]) -> [f64; 4], I::Item) -> O + Sync,
    ) -> Result<Vec<O>> {
        camera.validate()?;
        let camera = Camera { target: camera.target - self.center, ..*camera };
        camera.check_scale(&self.grid)?;
        let sizes = self.sizes(&camera);
        let chords = self.chords(&camera, sizes, count);
        let most = MAX_CHORDS.min(MAX_RAY_CHORDS * count);
        if chords > most {
            let what = format!("rays would cut {chords:.0e} chords out of kernels, at most {most:.0e} are added up");
            return Err(too_much(&what, sizes.largest()));
        }
        let blocks = sizes.reach / (self.longest * sizes.least);
        if blocks > MAX_BLOCKS {
            let what =
                format!("the largest reaches over {blocks:.0e} blocks of a ray, at most {MAX_BLOCKS:.0e} are kept");
            return Err(too_much(&what, sizes.largest()));
        }
        let rays = self.rays(camera.eye(), camera.forward, sizes, true);
        let (count, done) = (items.len(), Mutex::new(0_usize));
        let work = |item| {
            let made = work(&|pixel| rays.pixel(&camera, pixel), item);
            // Held while reporting: a fraction never follows a larger one.
            let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
            *done += 1;
            self.progress.report("integrating", *done as f64 / count as f64);
            made
        };
        Ok(items.map(work).collect())
    }

    /// Estimates the number of chords that the rays of a picture cut out of kernels.
    pub(crate) fn work(&self, camera: &Camera) -> f64 {
        let camera = Camera { target: camera.target - self.center, ..*camera };
        let [width, height] = camera.size.map(f64::from);
        self.chords(&camera, self.sizes(&camera), width * height)
    }

    /// Returns the sizes of the kernels in a picture, given a camera relative to the middle of the lattice.
    fn sizes(&self, camera: &Camera) -> Sizes {
        let radius = self.kernel.radius();
        if self.antialiasing { Sizes::seen(radius, &self.grid, camera) } else { Sizes::fixed(radius) }
    }

    /// Estimates the number of chords of kernels along `rays` rays of a picture, from a sample of them.
    fn chords(&self, camera: &Camera, sizes: Sizes, rays: f64) -> f64 {
        const SIDE: u32 = 32;
        let [across, down] = camera.size.map(|side| side.min(SIDE));
        let ray = |x: u32, y: u32| {
            let pixel = [x * camera.size[0] / across, y * camera.size[1] / down];
            let (sx, sy) = camera.image_coordinates(pixel);
            let (origin, direction) = camera.ray(sx, sy);
            let ray = self.lattice_ray(origin, direction, camera.eye().is_none(), &sizes)?;
            Walk::new(&self.splats, sizes, ray).map(|walk| walk.chords())
        };
        let sum: f64 = (0..down).flat_map(|y| (0..across).filter_map(move |x| ray(x, y))).sum();
        sum * rays / (f64::from(across) * f64::from(down))
    }

    /// Integrates a single ray from `origin` along `direction` (world coordinates, unit length), in f64. A `two_sided`
    /// ray comes from infinity behind its origin, as the rays of an orthographic camera do. Kernels do not grow,
    /// because a ray alone has no pixels.
    #[must_use]
    pub fn ray(&self, origin: DVec3, direction: DVec3, two_sided: bool) -> RayIntegral {
        let origin = origin - self.center;
        let rays = self.rays((!two_sided).then_some(origin), direction, Sizes::fixed(self.kernel.radius()), false);
        rays.trace(origin, direction, two_sided, &mut Scratch::default())
    }

    /// Returns the depth of a lattice place in the box along a direction of view, 0 to 1.
    fn depth(&self, forward: DVec3, place: DVec3) -> f64 {
        let gradient = self.grid.to_world().matrix3.transpose() * forward;
        let dims = DVec3::from_array(self.grid.dims().map(f64::from));
        0.5 + gradient.dot(place - (dims - 1.0) / 2.0) / gradient.abs().dot(dims)
    }

    /// Returns the attenuation of a maximum along a ray.
    fn fade(&self, forward: DVec3, ray: &LatticeRay) -> Attenuation {
        if self.attenuation <= 0.0 {
            return Attenuation::default();
        }
        let [start, next] = [0.0, 1.0].map(|place| self.depth(forward, ray.origin + ray.direction * place));
        Attenuation { start: self.attenuation * start, slope: (self.attenuation * (next - start)).max(0.0) }
    }

    /// Returns the pixel of a projection from a sum of splats, coded by its depth if there is one.
    fn projected(&self, transfer: &TransferFunction, sum: f64, depth: Option<f64>) -> RayIntegral {
        RayIntegral::of_pixel(transfer.projected(sum / self.divisor, depth))
    }

    /// Converts a ray to the lattice; `None` if it misses all splats, or the part of the lattice that is not cut away.
    fn lattice_ray(&self, origin: DVec3, direction: DVec3, two_sided: bool, sizes: &Sizes) -> Option<LatticeRay> {
        let middle = DVec3::from_array(self.grid.dims().map(|d| f64::from(d - 1))) / 2.0;
        let ray = LatticeRay::new(&self.grid, origin, direction, two_sided).within(&self.clip, middle)?;
        if self.splats.repeats() {
            // Scalars exist in the box of the voxels.
            let lattice = self.grid.dims().map(|d| [0, i64::from(d) - 1]);
            return ray.clipped(&lattice, 0.5);
        }
        ray.clipped(&self.splats.bounds(sizes.layers)?, sizes.reach)
    }

    /// Makes rays from an eye, or parallel rays in a direction. `many` rays skip empty space.
    fn rays(&self, eye: Option<DVec3>, direction: DVec3, sizes: Sizes, many: bool) -> PixelRays<'_> {
        let viewer = eye.map_or(Viewer::Towards(-direction), Viewer::At);
        let bricks = self.bricks.clone().unwrap_or_else(|| Arc::new(ClassifiedBricks::new(&self.splats, viewer)));
        let surfaces = self.surfaces.as_ref().map(|surfaces| Box::new(surfaces.rays(eye, direction, sizes, many)));
        let map = if many { self.map(sizes) } else { None };
        PixelRays { reference: self, sizes, forward: direction, bricks, map, surfaces }
    }

    /// Returns bounds of the field around each place.
    fn map(&self, sizes: Sizes) -> Option<BoundMap> {
        let map = |most: &(dyn Fn([f64; 2]) -> f64 + Sync)| Some(self.splats.cells.map(sizes.reach, most));
        let shown = |shows: &(dyn Fn([f64; 2]) -> bool + Sync)| map(&|range| f64::from(u8::from(shows(range))));
        // Bounds of sums of kernels, given the range of the values that they sum up.
        let field = |base: f64| {
            let [least, most] = kernel_sums(&self.kernel, sizes.least, sizes.largest())?;
            Some(move |range: [f64; 2]| {
                let [low, high] = range.map(|value| value - base);
                [low * if low < 0.0 { most } else { least }, high * if high > 0.0 { most } else { least }]
            })
        };
        match &self.method {
            Method::PreShaded | Method::Xray(_) => shown(&|range| self.splats.may_show(range)),
            Method::Mean(transfer) => {
                let base = transfer.base();
                shown(&|range| range != [base; 2])
            }
            Method::Maximum(transfer) => {
                let field = field(transfer.base())?;
                map(&|range| field(range)[1])
            }
            Method::PostShaded(classifier) => {
                let (base, field) = (classifier.base, field(classifier.base)?);
                shown(&|range| !classifier.transfer.is_invisible(field(range).map(|sum| base + sum / self.divisor)))
            }
        }
    }
}

/// The rays of a picture.
struct PixelRays<'a> {
    reference: &'a Reference,
    sizes: Sizes,
    /// The direction of the view.
    forward: DVec3,
    bricks: Arc<ClassifiedBricks>,
    map: Option<BoundMap>,
    /// The rays through the isosurfaces of a pre-shaded composite.
    surfaces: Option<Box<Self>>,
}

impl PixelRays<'_> {
    fn sight(&self) -> Sight<'_> {
        let Reference { splats, profile, deviation, longest, .. } = self.reference;
        let [deviation, longest] = [deviation, longest].map(|length| length * self.sizes.least);
        Sight { splats, bricks: &self.bricks, profile, sizes: self.sizes, deviation, longest }
    }

    /// Returns the parts of a ray where more than `enough` may be visible, front to back. Parts closer together share
    /// planes of splats.
    fn parts(&self, ray: LatticeRay, enough: f64) -> Vec<LatticeRay> {
        self.map.as_ref().map_or_else(|| vec![ray], |map| map.parts(ray, enough, 2.0 * self.sizes.reach))
    }

    /// Visits the parts of a ray that may be visible, as long as the visitor sees more.
    fn visit(&self, ray: LatticeRay, scratch: &mut Scratch, visitor: &mut impl Visitor) {
        let sight = self.sight();
        self.parts(ray, 0.0).into_iter().all(|part| sight.visit(part, scratch, visitor));
    }

    /// Integrates the sum of splats along a ray, in voxels.
    fn integral(&self, ray: LatticeRay) -> f64 {
        self.parts(ray, 0.0).into_iter().map(|part| self.sight().integral(part)).sum::<f64>()
    }

    /// Traces a pixel of a camera's picture: premultiplied red, green, blue and alpha. The origin of the camera's world
    /// is the middle of the lattice.
    fn pixel(&self, camera: &Camera, pixel: [u32; 2]) -> [f64; 4] {
        thread_local! {
            static SCRATCH: RefCell<Scratch> = RefCell::default();
        }
        let (sx, sy) = camera.image_coordinates(pixel);
        let (origin, direction) = camera.ray(sx, sy);
        let sum = SCRATCH.with_borrow_mut(|scratch| self.trace(origin, direction, camera.eye().is_none(), scratch));
        match self.reference.method {
            Method::Xray(response) => response.pixel(sum.optical_depth),
            _ => sum.rgba(),
        }
    }

    /// Integrates a classified field along a ray in the light that arrives. Returns the integral, and the isosurfaces
    /// that the ray meets.
    fn classified(
        &self,
        classifier: &FieldClassifier,
        ray: LatticeRay,
        to_eye: DVec3,
        arriving: &dyn Fn(DVec3) -> Visibility,
        scratch: &mut Scratch,
    ) -> (RayIntegral, Vec<Met>) {
        let Reference { divisor, accuracy, .. } = self.reference;
        let mut classified = ClassifiedIntegral {
            sum: RayIntegral::default(),
            classifier,
            ray,
            arriving,
            to_eye,
            sides: classifier.sides(to_eye),
            measure: 1.0 / ray.voxels_per_unit,
            divisor: *divisor,
            accuracy,
            above: Vec::new(),
            met: Vec::new(),
        };
        self.visit(ray, scratch, &mut classified);
        (classified.sum, classified.met)
    }

    /// Returns the isosurfaces of a pre-shaded composite that a ray meets, front to back.
    fn met(&self, origin: DVec3, direction: DVec3, two_sided: bool, scratch: &mut Scratch) -> Vec<Met> {
        let Some(surfaces) = &self.surfaces else { return Vec::new() };
        let Method::PostShaded(classifier) = &surfaces.reference.method else { return Vec::new() };
        let ray = surfaces.reference.lattice_ray(origin, direction, two_sided, &self.sizes);
        // Light passes all matter.
        let arriving = |place: DVec3| self.reference.visibility(place);
        ray.map_or(Vec::new(), |ray| surfaces.classified(classifier, ray, -direction, &arriving, scratch).1)
    }

    fn trace(&self, origin: DVec3, direction: DVec3, two_sided: bool, scratch: &mut Scratch) -> RayIntegral {
        let reference = self.reference;
        let met = self.met(origin, direction, two_sided, scratch);
        let Some(ray) = reference.lattice_ray(origin, direction, two_sided, &self.sizes) else {
            return met.iter().fold(RayIntegral::default(), |sum, (_, surface)| sum.before(surface));
        };
        let measure = 1.0 / (ray.voxels_per_unit * reference.divisor);
        match &reference.method {
            Method::PreShaded => {
                let sum = RayIntegral::default();
                let mut emission = EmissionIntegral { sum, met: &met, measure, accuracy: &reference.accuracy };
                self.visit(ray, scratch, &mut emission);
                emission.met.iter().fold(emission.sum, |sum, (_, surface)| sum.before(surface))
            }
            Method::Xray(response) => {
                let optical_depth = self.integral(ray) * measure;
                let [red, green, blue, _] = response.pixel(optical_depth);
                RayIntegral { color: [red, green, blue], optical_depth }
            }
            Method::PostShaded(classifier) => {
                self.classified(classifier, ray, -direction, &|place| reference.visibility(place), scratch).0
            }
            Method::Maximum(transfer) => {
                let fade = reference.fade(self.forward, &ray);
                let mut maximum = Maximum { largest: None, place: ray.start, fade };
                if let Some(best) = self.map.as_ref().and_then(|map| map.best(ray)) {
                    self.sight().visit(best, scratch, &mut maximum);
                }
                for part in self.parts(ray, maximum.largest.unwrap_or(f64::NEG_INFINITY)) {
                    self.sight().visit(part, scratch, &mut maximum);
                }
                let place = ray.origin + ray.direction * maximum.place;
                let depth = reference.depth_coded.then(|| reference.depth(self.forward, place));
                reference.projected(transfer, maximum.largest.unwrap_or_default(), depth)
            }
            Method::Mean(transfer) => reference.projected(transfer, self.integral(ray) / (ray.end - ray.start), None),
        }
    }
}

/// The largest radius of kernels whose sums are bounded: beyond, the bounds take longer than they save.
const MAX_REACH: f64 = 8.0;

/// Returns bounds of the sum of all kernels of a lattice at any place, for scales from `small` to `large`; `None` if
/// too many kernels overlap.
fn kernel_sums(kernel: &Kernel, small: f64, large: f64) -> Option<[f64; 2]> {
    /// The number of cells along half the distance of two lattice points: the rest of space is its mirror image.
    const CELLS: u32 = 5;
    let reach = kernel.radius() * large;
    if reach > MAX_REACH {
        return None;
    }
    let width = 0.5 / f64::from(CELLS);
    let middle = |i: u32| (f64::from(i) + 0.5) * width;
    let last = reach.ceil() as i32 + 1;
    // No place of a cell is farther from its middle.
    let radius = width * 0.75_f64.sqrt();
    let mut bounds = [f64::INFINITY, 0.0_f64];
    for cell in 0..CELLS * CELLS * CELLS {
        let place = DVec3::new(middle(cell % CELLS), middle(cell / CELLS % CELLS), middle(cell / CELLS / CELLS));
        let (mut least, mut most) = (0.0, 0.0);
        for z in -last..=last {
            for y in -last..=last {
                for x in -last..=last {
                    let distance = place.distance(DVec3::new(f64::from(x), f64::from(y), f64::from(z)));
                    // Kernels fall with the distance, and rise with the scale except for the factor 1 / s^3.
                    least += kernel.value(((distance + radius) / small).powi(2)) / large.powi(3);
                    most += kernel.value(((distance - radius).max(0.0) / large).powi(2)) / small.powi(3);
                }
            }
        }
        bounds = [bounds[0].min(least), bounds[1].max(most)];
    }
    Some(bounds)
}

#[cfg(test)]
mod tests;
