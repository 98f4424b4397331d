//! The truth: what every model of [`Settings`] means, integrated in f64 along each pixel's ray.
//!
//! With j the lattice points, x a point in lattice coordinates, h the kernel, N its divisor and s_j the scale of kernel
//! j ([`Growth`]; 1 without antialiasing), a value w_j per voxel is reconstructed as
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
//! Lit, c_j is [`Lighting::shade`] of colour, gradient, direction to the eye and what light arrives at voxel j:
//! exp(-D_j), where D_j integrates tau from there to the light in kernels of their own size. The gradient along a
//! lattice axis is (f_(j+1) - f_(j-1)) / 2, a neighbour beyond the edge having the value at the edge, taken to the
//! world by the transpose of the map from there.
//!
//! With gradient opacity ([`TransferFunction::gradient_opacity`]) tau_j is multiplied by the share that belongs to the
//! length of that gradient; post-shaded, tau is, by that of the gradient reconstructed there.
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
//! Lit, the colour is shaded with the gradient reconstructed from the central differences of the extended lattice, for
//! an eye back along the ray, and the light that arrives at voxels as in pre-shading, trilinear between them.
//!
//! **Maximum intensity.** With m the largest f on the ray's part in the box, alpha is the opacity of m over the largest
//! of the transfer function and the pixel's colour that of m times alpha; no pixel if the ray misses the box.
//!
//! Coded by depth, the colour is the hue of the place x of m times the largest channel of the colour of m: with v the
//! view's direction, h = 4.5 (1/2 + (x - middle of the box) . v / (depth of the box along v)), red, green and blue are
//! |h - 3| - 1, 2 - |h - 2| and 2 - |h - 4|, each cut off at 0 and 1.
//!
//! **Minimum and average intensity.** The same with the smallest f, and with the mean of f over the ray's part in the
//! box. A minimum is the maximum of -f_j by the transfer function mirrored at 0; b is the base of that.
//!
//! **Clipping.** Of a ray counts the part on the inner side of all planes of [`Settings::clip`]: tau and e are 0
//! beyond, no value there is largest or smallest, and a mean is that of the part. Voxels whose centres are cut away
//! keep no light from others.
//!
//! **Sharpness.** The kernel is [`Settings::reconstruction_kernel`]; the f_j of all but extinction are the
//! samples filtered for it, in f64, as the renderer filters them in f32.
//!
//! This is what splatting approximates by footprints and sheets; here there are neither: every ray is cut wherever it
//! enters or leaves a kernel's support, and where f meets a control point; the pieces are integrated by Gauss's rule.
//! Errors of optical depth, colour and means are about 1e-10 of their size, of lit post-shading 1e-9, of maxima 1e-12.
//! Sheets, accumulation, termination, precision and the footprint table are the renderer's affair and change nothing.
//!
//! A tolerance ([`Reference::with_tolerance`]) makes blocks longer. In pre-shading a chord that begins or ends in a
//! block adds its first four moments there: what is lost is of second order, and small where a block is thin. Scalars
//! are followed from end to end of chords as before, by two nodes of Gauss's rule if that is enough.
//! Rays end sooner.
//!
//! Where nothing can show, nothing is added up: the values around every cell of 4^3 voxels bound the field there.
//!
//! Made to be right: nothing is shared with the renderer but the data it reads, and the sums behind shadows, in f64
//! here, which a test holds against the integrals of [`Reference::ray`].

mod cells;
mod classify;
mod integrate;
mod layers;
mod profile;
mod ray;
mod walk;

pub use integrate::RayIntegral;

use std::cell::RefCell;
use std::sync::{Mutex, PoisonError};

use glam::DVec3;
use rayon::prelude::*;

use crate::budget::{MAX_BLOCKS, MAX_CHORDS, MAX_RAY_CHORDS, too_much};
use crate::camera::Camera;
#[cfg(doc)]
use crate::camera::Growth;
use crate::clip::Side;
use crate::error::{Error, Result};
use crate::image::{Image, Region};
use crate::kernel::Kernel;
use crate::layers::Layers;
#[cfg(doc)]
use crate::lighting::Lighting;
use crate::lighting::{Casting, Visibility};
use crate::progress::Progress;
use crate::settings::{Model, Response, Settings};
use crate::transfer::{Resolution, TransferFunction};
use crate::volume::{Grid, Volume};
use cells::Map;
use classify::{Bricks, Splats};
use integrate::{Accuracy, Classified, Classifier, Emission, Fade, Integral, Maximum};
use profile::{Gauss, Profile};
use ray::{LatticeRay, Viewer};
use walk::{Cuts, Scratch, Sight, Sizes, Walk, blocks};

/// The longest block, in scales of the smallest kernel (a Gaussian's sigma): without and with a tolerance.
const LONGEST: [f64; 2] = [0.2, 1.0];
/// Steps of extinction and emission in a block, likewise.
const STEPS: [f64; 2] = [1.0, 3.0];
/// The error of kernels, over their peak, without a tolerance.
const KERNEL_ERROR: f64 = 2e-14;
/// The same over the tolerance.
const KERNEL_SHARE: f64 = 1e-3;
/// The least tolerance for which weights are kept in f32.
const ROUNDED: f64 = 1e-7;

/// A volume, ready to be integrated from any camera.
///
/// Holds the samples, a quarter of a byte more per voxel, and 32 bytes per voxel of the bricks of 8^3 voxels that rays
/// have met so far and that have visible voxels; 16 with a tolerance. Where light is kept from voxels, 8 bytes more
/// for every voxel. Pictures of any size need no more.
#[derive(Debug)]
pub struct Reference {
    /// In a world that begins in the middle of the lattice.
    grid: Grid,
    /// Where that is in the world.
    center: DVec3,
    splats: Splats,
    /// Unless they depend on the viewer.
    bricks: Option<Bricks>,
    kernel: Kernel,
    profile: Profile,
    radius: f64,
    divisor: f64,
    longest: f64,
    accuracy: Accuracy,
    antialiasing: bool,
    depth_coded: bool,
    attenuation: f64,
    method: Method,
    /// What is not cut away.
    clip: Vec<Side>,
    /// If light is found at every point: the field that it passes, and the lights.
    light: Option<Box<(Self, Casting)>>,
    progress: Progress,
}

/// What is made of the sums over splats along a ray.
#[derive(Debug)]
enum Method {
    /// They are extinction and emission; voxels are lit if there is a light.
    PreShaded,
    /// They are extinction, of whose integral the pixel is made.
    Xray(Response),
    /// They are the scalar, and its gradient if there is a light.
    PostShaded(Box<Classifier>),
    /// They are the scalar, of which the transfer function classifies the largest, relative to its base.
    Maximum(TransferFunction),
    /// The same of the mean.
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
        settings.validate()?;
        volume.check_finite()?;
        let mirrored = settings.mirrored(volume, transfer)?;
        let (volume, transfer) = mirrored.as_ref().map_or((volume, transfer), |(volume, transfer)| (volume, transfer));
        let filtered = match settings.prefilter()? {
            Some(filter) => Some(filter.apply::<f64>(volume, transfer.base(), &Progress::default())?),
            None => None,
        };
        let volume = filtered.as_ref().unwrap_or(volume);
        let settings = &Settings { kernel: settings.reconstruction_kernel(), ..settings.clone() };
        let grid = *volume.grid();
        let lighting = settings.lighting.as_ref();
        let method = match settings.model {
            Model::Xray => Method::Xray(settings.response),
            Model::Mip | Model::Minip => Method::Maximum(transfer.clone()),
            Model::Average => Method::Mean(transfer.clone()),
            Model::Composite if settings.is_post_shaded() => Method::PostShaded(Box::new(Classifier::new(
                transfer,
                lighting,
                &grid,
                Resolution::new(transfer, volume)?,
            ))),
            Model::Composite => Method::PreShaded,
        };
        Ok(Self::of(&grid, Splats::new(volume, transfer, settings)?, method, settings))
    }

    /// Reads several layers once, pre-shaded; one volume alone as [`Self::new`] does.
    ///
    /// # Errors
    /// Those of [`Self::new`], and [`Error::Setting`] if several layers are to be post-shaded or projected.
    pub fn of_layers(layers: &Layers, settings: &Settings) -> Result<Self> {
        if let Some((volume, transfer)) = layers.plain() {
            return Self::new(volume, transfer, settings);
        }
        settings.validate()?;
        layers.check(settings)?;
        let settings = &Settings { kernel: settings.reconstruction_kernel(), ..settings.clone() };
        let method = if settings.model == Model::Xray { Method::Xray(settings.response) } else { Method::PreShaded };
        Ok(Self::of(layers.grid(), Splats::of_layers(layers, settings)?, method, settings))
    }

    fn of(grid: &Grid, splats: Splats, method: Method, settings: &Settings) -> Self {
        let kernel = &settings.kernel;
        let reference = Self {
            grid: grid.centered(),
            center: grid.center(),
            splats,
            bricks: None,
            kernel: *kernel,
            profile: Profile::new(kernel, 0.0, 1.0),
            radius: kernel.radius(),
            divisor: settings.normalization.divisor(kernel),
            longest: 0.0,
            accuracy: Accuracy {
                tolerance: 0.0,
                rim: kernel.value(kernel.radius().powi(2)),
                rule: Gauss::new(),
                scale: scale(kernel),
                steps: 1.0,
            },
            antialiasing: settings.antialiasing,
            depth_coded: settings.depth_coded,
            attenuation: settings.attenuation,
            method,
            clip: settings.clip.sides(grid),
            light: None,
            progress: Progress::default(),
        };
        reference.with_tolerance(0.0)
    }

    /// The same of another light, to tell what light at voxels leaves out: post-shaded, light passes the field as it is
    /// reconstructed and classified on its way, instead of splats of classified voxels, and it is found at every point
    /// that is lit, instead of at voxels. Occlusion stays that of voxels. Takes thousands of times as long.
    ///
    /// # Errors
    /// Those of [`Self::new`], and [`Error::Setting`] unless a post-shaded composite has light with shadows.
    pub fn with_light_everywhere(volume: &Volume, transfer: &TransferFunction, settings: &Settings) -> Result<Self> {
        let reference = Self::new(volume, transfer, settings)?;
        let Some(casting) = settings.casting().filter(|_| settings.is_post_shaded()) else {
            let reason = "light is found at every point of a post-shaded composite with shadows".to_owned();
            return Err(Error::Setting { name: "shadows", reason });
        };
        let field = Self::new(volume, transfer, &Settings { lighting: None, ..settings.clone() })?;
        Ok(Self { light: Some(Box::new((field.with_tolerance(Self::TOLERANCE), casting))), ..reference })
    }

    /// What of the light arrives at a place in the lattice, if light is found at every point.
    fn visibility(&self, place: DVec3) -> Visibility {
        let of_voxels = self.splats.visibility(place);
        let Some((field, casting)) = self.light.as_deref() else { return of_voxels };
        let world = self.grid.to_world().transform_point3(place) + self.center;
        let to_lattice = self.grid.to_lattice().matrix3;
        casting.visibility(world, of_voxels.ambient, |towards, reach| {
            let begin = casting.bias() / (to_lattice * towards).length();
            let beyond = |distance: f64| field.ray(world + distance * towards, towards, false).optical_depth;
            match reach.is_finite() {
                true if reach <= begin => 0.0,
                true => beyond(begin) - beyond(reach),
                false => beyond(begin),
            }
        })
    }

    /// A tolerance far below what pictures err by, which takes a tenth of the time of an exact picture or less.
    pub const TOLERANCE: f64 = 1e-5;

    /// The same, with an error of about `tolerance` at most in each channel of a pixel; 0 is as exact as rounding
    /// allows.
    #[must_use]
    pub fn with_tolerance(mut self, tolerance: f64) -> Self {
        let which = usize::from(tolerance > 0.0);
        let tolerance = tolerance.max(0.0);
        self.longest = LONGEST[which] * scale(&self.kernel);
        let beyond = self.longest * (self.longest + 2.0 * self.radius);
        self.profile = Profile::new(&self.kernel, beyond, KERNEL_ERROR.max(KERNEL_SHARE * tolerance));
        self.accuracy.tolerance = tolerance;
        self.accuracy.steps = STEPS[which];
        // Who looks at them does not matter.
        let viewer = Viewer::Towards(DVec3::Z);
        self.bricks =
            (!self.splats.depend_on_viewer()).then(|| Bricks::new(&self.splats, viewer, tolerance >= ROUNDED));
        self
    }

    /// The same, telling how far each picture is: "integrating", rising to 1.
    #[must_use]
    pub fn with_progress(mut self, progress: Progress) -> Self {
        self.progress = progress;
        self
    }

    /// The picture that a camera sees, one ray through the centre of each pixel.
    ///
    /// With antialiasing, kernels are as large as this camera makes them. Runs on all cores of the current rayon pool.
    /// Takes about half a microsecond for each chord that a ray cuts out of a kernel, a tenth of that with a tolerance,
    /// and at most 2^36 of them, or 2^24 for each pixel.
    ///
    /// # Errors
    /// [`Error::Setting`] if the picture takes more: kernels that have grown far overlap in thousands.
    /// [`Error::Camera`] if the camera is not finite; [`Error::Setting`] if a side of the
    /// picture is 0 or over [`Camera::MAX_SIZE`] pixels.
    pub fn render(&self, camera: &Camera) -> Result<Image> {
        let [width, height] = camera.size;
        self.render_region(camera, Region { x: 0, y: 0, width, height })
    }

    /// A part of that picture, the same pixels without the rest. The image has the size of the region.
    ///
    /// # Errors
    /// Those of [`Self::render`], and [`Error::Setting`] if the region has no pixels or reaches beyond the picture.
    pub fn render_region(&self, camera: &Camera, region: Region) -> Result<Image> {
        camera.validate()?;
        region.check_within(camera.size)?;
        let mut image = Image::transparent(region.width, region.height)?;
        let rows = image.pixels_mut().par_chunks_exact_mut(region.width as usize).enumerate();
        self.traced(camera, region.area() as f64, rows, |tracer, (y, row)| {
            for (x, pixel) in (region.x..).zip(row) {
                *pixel = tracer.pixel([x, region.y + y as u32]).map(|v| v as f32);
            }
        })?;
        Ok(image)
    }

    /// Some pixels (column and row, from the top left) of the picture that a camera sees, in the order given:
    /// premultiplied red, green, blue and alpha. Pixels outside of the picture are as the rays through them.
    ///
    /// # Errors
    /// Those of [`Self::render`], for rays through these pixels only.
    pub fn pixels(&self, camera: &Camera, pixels: &[[u32; 2]]) -> Result<Vec<[f64; 4]>> {
        self.traced(camera, pixels.len() as f64, pixels.par_iter(), |tracer, pixel| tracer.pixel(*pixel))
    }

    /// Does some work for each of `items`, which trace so many rays in all, on all cores.
    fn traced<I: IndexedParallelIterator, O: Send>(
        &self,
        camera: &Camera,
        rays: f64,
        items: I,
        work: impl Fn(&Tracer<'_>, I::Item) -> O + Sync,
    ) -> Result<Vec<O>> {
        camera.validate()?;
        let camera = Camera { target: camera.target - self.center, ..*camera };
        camera.check_scale(&self.grid)?;
        let sizes = if self.antialiasing {
            Sizes::seen(self.radius, &self.grid, &camera, camera.growth(&self.grid))
        } else {
            Sizes::fixed(self.radius)
        };
        let chords = self.chords(&camera, sizes, rays);
        let most = MAX_CHORDS.min(MAX_RAY_CHORDS * rays);
        if chords > most {
            let what = format!("rays would cut {chords:.0e} chords out of kernels, at most {most:.0e} are added up");
            return Err(too_much(&what, sizes.largest(self.radius)));
        }
        let blocks = sizes.reach / (self.longest * sizes.least);
        if blocks > MAX_BLOCKS {
            let what =
                format!("the largest reaches over {blocks:.0e} blocks of a ray, at most {MAX_BLOCKS:.0e} are kept");
            return Err(too_much(&what, sizes.largest(self.radius)));
        }
        let tracer = Tracer { rays: self.rays(camera.eye(), camera.forward, sizes, true), camera };
        let (count, done) = (items.len(), Mutex::new(0_usize));
        let work = |item| {
            let made = work(&tracer, item);
            // Held while reporting: a fraction never follows a larger one.
            let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
            *done += 1;
            self.progress.report("integrating", *done as f64 / count as f64);
            made
        };
        Ok(items.map(work).collect())
    }

    /// About how many chords of kernels so many rays of a picture add up, from some of them.
    fn chords(&self, camera: &Camera, sizes: Sizes, rays: f64) -> f64 {
        const SIDE: u32 = 32;
        let [across, down] = camera.size.map(|side| side.min(SIDE));
        let ray = |x: u32, y: u32| {
            let pixel = [x * camera.size[0] / across, y * camera.size[1] / down];
            let (sx, sy) = camera.image_coordinates(pixel);
            let (origin, direction) = camera.ray(sx, sy);
            let ray = self.lattice_ray(origin, direction, camera.eye().is_none())?;
            Walk::new(self.sight(sizes), ray).map(|walk| walk.chords())
        };
        let sum: f64 = (0..down).flat_map(|y| (0..across).filter_map(move |x| ray(x, y))).sum();
        sum * rays / (f64::from(across) * f64::from(down))
    }

    /// What a single ray collects, from `origin` along `direction` (world coordinates, unit length), in f64.
    /// A `two_sided` ray comes from infinity behind its origin, as the rays of an orthographic camera do. Kernels have
    /// their own size: a ray alone has no pixels.
    #[must_use]
    pub fn ray(&self, origin: DVec3, direction: DVec3, two_sided: bool) -> RayIntegral {
        let origin = origin - self.center;
        let rays = self.rays((!two_sided).then_some(origin), direction, Sizes::fixed(self.radius), false);
        rays.trace(origin, direction, two_sided, &mut Scratch::default())
    }

    /// The share of a lattice place in the depth of the box along a direction of view.
    fn depth(&self, forward: DVec3, place: DVec3) -> f64 {
        let gradient = self.grid.to_world().matrix3.transpose() * forward;
        let dims = DVec3::from_array(self.grid.dims().map(f64::from));
        0.5 + gradient.dot(place - (dims - 1.0) / 2.0) / gradient.abs().dot(dims)
    }

    /// What a maximum is attenuated by along a ray.
    fn fade(&self, forward: DVec3, ray: &LatticeRay) -> Fade {
        if self.attenuation <= 0.0 {
            return Fade::default();
        }
        let [start, next] = [0.0, 1.0].map(|place| self.depth(forward, ray.origin + ray.direction * place));
        Fade { start: self.attenuation * start, slope: (self.attenuation * (next - start)).max(0.0) }
    }

    /// The pixel of the sum of splats that a projection keeps, coded by its depth if there is one.
    fn projected(&self, transfer: &TransferFunction, sum: f64, depth: Option<f64>) -> RayIntegral {
        let most = transfer.max_opacity();
        let (mut color, opacity) = transfer.sample(transfer.base() + sum / self.divisor);
        if let Some(depth) = depth {
            let h = 4.5 * depth.clamp(0.0, 1.0);
            let hue = [(h - 3.0).abs() - 1.0, 2.0 - (h - 2.0).abs(), 2.0 - (h - 4.0).abs()];
            let bright = color.into_iter().fold(0.0, f64::max);
            color = hue.map(|channel| bright * channel.clamp(0.0, 1.0));
        }
        RayIntegral::uniform(color, if most > 0.0 { opacity / most } else { 0.0 })
    }

    fn sight(&self, sizes: Sizes) -> Sight<'_> {
        Sight { splats: &self.splats, radius: self.radius, sizes }
    }

    /// A ray in the lattice; `None` if it misses what is left of that, or the box that scalars exist in.
    fn lattice_ray(&self, origin: DVec3, direction: DVec3, two_sided: bool) -> Option<LatticeRay> {
        let middle = DVec3::from_array(self.grid.dims().map(|d| f64::from(d - 1))) / 2.0;
        let ray = LatticeRay::new(&self.grid, origin, direction, two_sided).within(&self.clip, middle)?;
        if self.splats.repeats() {
            let lattice = self.grid.dims().map(|d| [0, i64::from(d) - 1]);
            return ray.clipped(&lattice, 0.5);
        }
        Some(ray)
    }

    /// What rays from an eye, or parallel ones in a direction, find. If many are to come, what they may leave out.
    fn rays(&self, eye: Option<DVec3>, direction: DVec3, sizes: Sizes, many: bool) -> Rays<'_> {
        let viewer = eye.map_or(Viewer::Towards(-direction), Viewer::At);
        let rounded = self.accuracy.tolerance >= ROUNDED;
        let bricks = match &self.bricks {
            Some(bricks) => Either::Shared(bricks),
            None => Either::Own(Bricks::new(&self.splats, viewer, rounded)),
        };
        Rays { reference: self, sizes, forward: direction, bricks, map: if many { self.map(sizes) } else { None } }
    }

    /// The most that can show at each place.
    fn map(&self, sizes: Sizes) -> Option<Map> {
        let seen = |seen: bool| f64::from(u8::from(seen));
        let map = |most: &(dyn Fn([f64; 2]) -> f64 + Sync)| self.splats.cells.map(sizes.reach, most);
        let transfer = self.splats.transfer();
        if matches!(self.method, Method::PreShaded | Method::Xray(_)) {
            return Some(map(&|range| seen(self.splats.may_show(range))));
        }
        let base = transfer.base();
        if matches!(self.method, Method::Mean(_)) {
            return Some(map(&|range| seen(range != [base; 2])));
        }
        // Sums of kernels, where all weights are 1.
        let [least, most] = kernel_sums(&self.kernel, sizes.least, sizes.largest(self.radius))?;
        let field = |[low, high]: [f64; 2]| {
            let [low, high] = [low - base, high - base];
            [low * if low < 0.0 { most } else { least }, high * if high > 0.0 { most } else { least }]
        };
        Some(if matches!(self.method, Method::Maximum(_)) {
            map(&|range| field(range)[1])
        } else {
            map(&|range| seen(!transfer.is_invisible(field(range).map(|v| base + v / self.divisor))))
        })
    }
}

/// What rays find.
struct Rays<'a> {
    reference: &'a Reference,
    sizes: Sizes,
    /// The direction of the view.
    forward: DVec3,
    bricks: Either<'a>,
    map: Option<Map>,
}

/// The bricks of a scene.
enum Either<'a> {
    Shared(&'a Bricks),
    Own(Bricks),
}

impl Rays<'_> {
    /// Calls `visit` for the blocks of a ray, front to back, until it returns false; returns that.
    fn blocks(
        &self,
        ray: LatticeRay,
        scratch: &mut Scratch,
        visit: impl FnMut(&walk::Block<'_>, &mut Cuts) -> bool,
    ) -> bool {
        let reference = self.reference;
        let bricks = match &self.bricks {
            Either::Shared(bricks) => bricks,
            Either::Own(bricks) => bricks,
        };
        Walk::new(reference.sight(self.sizes), ray).is_none_or(|walk| {
            blocks(walk, bricks, &reference.profile, reference.longest * self.sizes.least, scratch, visit)
        })
    }

    /// Calls `visit` for the parts of a ray where more than `enough` may show, front to back, until it returns false.
    fn parts(&self, ray: LatticeRay, enough: f64, mut visit: impl FnMut(LatticeRay) -> bool) {
        let Some(map) = &self.map else {
            visit(ray);
            return;
        };
        // Parts closer together share planes of splats.
        map.parts(&ray, enough, 2.0 * self.sizes.reach, visit);
    }

    fn trace(&self, origin: DVec3, direction: DVec3, two_sided: bool, scratch: &mut Scratch) -> RayIntegral {
        let reference = self.reference;
        let Some(ray) = reference.lattice_ray(origin, direction, two_sided) else { return RayIntegral::default() };
        let measure = 1.0 / ray.voxels_per_unit;
        let accuracy = &reference.accuracy;
        match &reference.method {
            Method::PreShaded | Method::Xray(_) => {
                let mut emission = Emission {
                    sum: RayIntegral::default(),
                    measure: measure / reference.divisor,
                    accuracy,
                    hides: !matches!(reference.method, Method::Xray(response) if response != Response::Absorption),
                };
                let bounds = reference.splats.bounds(self.sizes.layers);
                if let Some(ray) = bounds.and_then(|bounds| ray.clipped(&bounds, self.sizes.reach)) {
                    self.parts(ray, 0.0, |part| self.blocks(part, scratch, |block, cuts| emission.block(block, cuts)));
                }
                let mut sum = emission.sum;
                if let Method::Xray(response) = reference.method {
                    let [red, green, blue, _] = response.pixel(sum.optical_depth);
                    sum.color = [red, green, blue];
                }
                sum
            }
            Method::PostShaded(classifier) => {
                let of_voxels = |place| reference.splats.visibility(place);
                let of_points = |place| reference.visibility(place);
                let arriving: Option<&dyn Fn(DVec3) -> Visibility> = match &reference.light {
                    _ if !reference.splats.has_shadows() => None,
                    None => Some(&of_voxels),
                    Some(_) => Some(&of_points),
                };
                let mut classified = Classified {
                    sum: RayIntegral::default(),
                    classifier,
                    ray,
                    arriving,
                    to_eye: -direction,
                    sides: classifier.sides(-direction),
                    measure,
                    divisor: reference.divisor,
                    position: ray.start,
                    accuracy,
                    segment: 0,
                };
                self.parts(ray, 0.0, |part| {
                    classified.position = part.start;
                    let more = self.blocks(part, scratch, |block, cuts| classified.block(block, cuts));
                    classified.empty(part.end);
                    more
                });
                classified.sum
            }
            Method::Maximum(transfer) => {
                let fade = reference.fade(self.forward, &ray);
                let mut maximum = Maximum { largest: None, place: ray.start, position: ray.start, fade };
                let mut search = |maximum: &mut Maximum, part: LatticeRay| {
                    maximum.position = part.start;
                    self.blocks(part, scratch, |block, cuts| {
                        maximum.block(block, cuts);
                        true
                    });
                    maximum.empty(part.end);
                };
                if let Some(part) = self.map.as_ref().and_then(|map| map.best(&ray)) {
                    search(&mut maximum, part);
                }
                let found = maximum.largest.unwrap_or(f64::NEG_INFINITY);
                self.parts(ray, found, |part| {
                    search(&mut maximum, part);
                    true
                });
                let place = ray.origin + ray.direction * maximum.place;
                let depth = reference.depth_coded.then(|| reference.depth(self.forward, place));
                reference.projected(transfer, maximum.largest.unwrap_or_default(), depth)
            }
            Method::Mean(transfer) => {
                let mut integral = Integral(0.0);
                self.parts(ray, 0.0, |part| {
                    self.blocks(part, scratch, |block, cuts| {
                        integral.block(block, cuts);
                        true
                    })
                });
                reference.projected(transfer, integral.0 / (ray.end - ray.start), None)
            }
        }
    }
}

/// The rays of a picture.
struct Tracer<'a> {
    rays: Rays<'a>,
    /// In the world that begins in the middle of the lattice.
    camera: Camera,
}

impl Tracer<'_> {
    /// A pixel: premultiplied red, green, blue and alpha.
    fn pixel(&self, pixel: [u32; 2]) -> [f64; 4] {
        thread_local! {
            static SCRATCH: RefCell<Scratch> = RefCell::default();
        }
        let (sx, sy) = self.camera.image_coordinates(pixel);
        let (origin, direction) = self.camera.ray(sx, sy);
        let two_sided = self.camera.eye().is_none();
        let sum = SCRATCH.with_borrow_mut(|scratch| self.rays.trace(origin, direction, two_sided, scratch));
        match self.rays.reference.method {
            Method::Xray(response) => response.pixel(sum.optical_depth),
            _ => sum.rgba(),
        }
    }
}

/// Kernels that reach further are not added up: bounds of their sums take longer than they save.
const MAX_REACH: f64 = 8.0;

/// Bounds of the sum of all kernels of a lattice at any place, for scales from `small` to `large`; `None` if there are
/// too many of them.
fn kernel_sums(kernel: &Kernel, small: f64, large: f64) -> Option<[f64; 2]> {
    /// Cells along half the distance of two lattice points: the rest of space is its mirror image.
    const CELLS: u32 = 5;
    let reach = kernel.radius() * large;
    if reach > MAX_REACH {
        return None;
    }
    let width = 0.5 / f64::from(CELLS);
    let middle = |i: u32| (f64::from(i) + 0.5) * width;
    let last = reach.ceil() as i32 + 1;
    // No place of a cell is further from its middle.
    let radius = width * 0.75_f64.sqrt();
    let mut bounds = [f64::INFINITY, 0.0_f64];
    for cell in 0..CELLS * CELLS * CELLS {
        let place = DVec3::new(middle(cell % CELLS), middle(cell / CELLS % CELLS), middle(cell / CELLS / CELLS));
        let (mut least, mut most) = (0.0, 0.0);
        for z in -last..=last {
            for y in -last..=last {
                for x in -last..=last {
                    let distance = place.distance(DVec3::new(f64::from(x), f64::from(y), f64::from(z)));
                    // Kernels fall with the distance, and rise with the scale but for its cube.
                    least += kernel.value(((distance + radius) / small).powi(2)) / large.powi(3);
                    most += kernel.value(((distance - radius).max(0.0) / large).powi(2)) / small.powi(3);
                }
            }
        }
        bounds = [bounds[0].min(least), bounds[1].max(most)];
    }
    Some(bounds)
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
