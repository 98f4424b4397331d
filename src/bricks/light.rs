//! The light that enters bricks whose matter casts shadows on each other.

use std::io;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use exr::image::{AnyChannel, AnyChannels, FlatSamples, Image as ExrImage, Layer};
use exr::math::Vec2;
use exr::prelude::{Encoding, LayerAttributes, WritableImage};
use glam::DVec3;

use super::file::{CHECKSUM, checksum, decoded_layer, read_exr, text_of, write_exr};
use super::plan::{Brick, Plan};
use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::host::HostRenderer;
use crate::image::{Note, check_exr, exr_with_notes};
use crate::layers::Layers;
use crate::lighting::Casting;
use crate::lighting::shadow::ShadowLattice;
use crate::lighting::shadow::incoming::{Incoming, RayDepths};
use crate::lighting::shadow::passing::{LightPass, OPEN, margin, window};
use crate::progress::Progress;

/// The names of the attributes of files.
const PLAN: &str = "voxsplat.plan";
const BRICK: &str = "voxsplat.brick";
const RAYS: &str = "voxsplat.rays";

/// The voxels of slabs that need no less memory: they take some 300 MB.
const SLAB: u64 = 1 << 24;

/// The largest number in the description of rays.
const MOST: usize = 1 << 31;

/// The light that enters a brick: along each ray of each light that casts shadows, the extinctions that it has passed.
/// [`sweep_light`] finds it for all bricks of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct IncomingLight {
    plan: u64,
    brick: usize,
    rays: Arc<Vec<RayDepths>>,
}

/// Sweeps the light of a plan once through the whole volume, slab after slab away from each light, by the processor.
/// `slice` returns the slice of all layers in a box of voxels. Returns the light that enters each brick, in the order
/// of [`Plan::bricks`]; none if the plan has no light that casts shadows ([`Plan::casts_shadows`]).
///
/// A slab has about as many voxels as the largest brick, 16 million voxels, or three times the planes of a halo,
/// whichever is the most. Each ray of the whole lattice takes 4 bytes of memory, and each ray that enters a brick 4
/// more.
///
/// # Errors
/// The errors of `slice`, [`Error::Setting`] if it returns another number of voxels, [`Error::Input`] if samples cannot
/// be read, [`Error::Memory`], and [`Error::Cancelled`].
pub fn sweep_light(
    plan: &Plan,
    mut slice: impl FnMut(&[Range<u32>; 3]) -> Result<Layers>,
    progress: &Progress,
) -> Result<Vec<IncomingLight>> {
    let Some(casting) = plan.settings().casting().filter(Casting::casts_shadows) else { return Ok(Vec::new()) };
    let grid = plan.grid();
    let (kernel, dims) = (plan.settings().reconstruction_kernel(), grid.dims());
    let lattice = ShadowLattice::new(grid, kernel, plan.settings().normalization.divisor(&kernel), 1.0, 1.0);
    let windows = plan.bricks().iter().map(|brick| window(&plan.shaped(brick), dims, &kernel)).collect();
    let mut light = LightPass::new(&casting, &lattice, windows)?;
    let renderer = HostRenderer::new(&Progress::default());
    let largest = plan.bricks().iter().map(|brick| brick.held.iter().map(|held| held.len() as u64).product()).max();
    let halo = plan.shaping() + margin(&kernel);
    let ways = light.ways();
    for (number, way) in ways.iter().enumerate() {
        let count = dims[way.axis];
        let area: u64 = grid.len() / u64::from(count);
        let planes = largest.unwrap_or(0) / area;
        let planes = planes.max(SLAB / area).min(u64::from(count)) as u32;
        // Thinner slabs would be mostly halo.
        let step = planes.saturating_sub(2 * halo).max(halo);
        let slabs = count.div_ceil(step);
        for slab in 0..slabs {
            progress.check()?;
            let done = (number as f64 + f64::from(slab) / f64::from(slabs)) / ways.len() as f64;
            progress.report("sweeping light", done);
            let start = step * if way.ahead { slabs - 1 - slab } else { slab };
            let end = (start + step).min(count);
            let mut held = dims.map(|n| 0..n);
            held[way.axis] = start.saturating_sub(halo)..(end + halo).min(count);
            let part = grid.part(&held)?;
            let layers = slice(&held)?;
            if layers.grid().dims() != part.dims() {
                let (found, expected) = (layers.grid().dims(), part.dims());
                let reason = format!("a slice of {found:?} voxels, expected {expected:?}: {held:?}");
                return Err(Error::setting("light", reason));
            }
            let scene = renderer.prepare_layers(&layers.on_grid(&part)?, plan.settings())?;
            let first = [0, 1, 2].map(|axis| held[axis].start);
            let everywhere = [DVec3::NEG_INFINITY, DVec3::INFINITY];
            let scene = scene.within((*grid, first), (everywhere, false), plan.is_uniform);
            // Planes beyond the faces belong to the first and the last slab.
            let low = if start == 0 { -OPEN } else { i64::from(start) };
            let own = low..if end == count { OPEN } else { i64::from(end) };
            renderer.pass(&scene, &Frame::new(plan.camera(), plan.settings()), (*way, &own), &mut light)?;
        }
    }
    progress.report("sweeping light", 1.0);
    let of_brick = |(brick, rays)| IncomingLight { plan: plan.id(), brick, rays: Arc::new(rays) };
    Ok(light.finish()?.into_iter().enumerate().map(of_brick).collect())
}

impl IncomingLight {
    /// Returns the number of the brick, its place in [`Plan::bricks`].
    #[must_use]
    pub fn brick(&self) -> usize {
        self.brick
    }

    /// Returns the light for the scene of a brick of a plan.
    pub(super) fn of(&self, plan: &Plan, number: usize, brick: &Brick) -> Result<Incoming> {
        if self.plan != plan.id() || self.brick != number {
            let plan = if self.plan == plan.id() { "this" } else { "another" };
            let reason = format!("it enters brick {} of {plan} plan, expected brick {number} of this plan", self.brick);
            return Err(Error::setting("light", reason));
        }
        let window = window(&plan.shaped(brick), plan.grid().dims(), &plan.settings().reconstruction_kernel());
        Ok(Incoming { window, rays: Arc::clone(&self.rays) })
    }

    /// Writes the light as an OpenEXR file. The file appears whole or not at all.
    ///
    /// # Errors
    /// [`Error::Output`] and [`Error::Write`] if it cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        write_exr(path.as_ref(), self.to_exr())
    }

    /// Returns the bytes of the OpenEXR file: the sums of all rays, one after the other in the pixels of channel `tau`.
    ///
    /// # Errors
    /// The errors of the encoder.
    pub fn to_exr(&self) -> io::Result<Vec<u8>> {
        let mut sums: Vec<f32> = self.rays.iter().flat_map(|rays| rays.sums.iter().copied()).collect();
        let width = sums.len().clamp(1, Camera::MAX_SIZE as usize);
        sums.resize(sums.len().next_multiple_of(width).max(1), 0.0);
        let size = Vec2(width, sums.len() / width);
        let of_rays = |RayDepths { of: [light, direction], first: [row, column], width, sums }: &RayDepths| {
            format!("{light}:{direction}:{row}:{column}:{width}:{}", sums.len() / width)
        };
        let rays = self.rays.iter().map(of_rays).collect::<Vec<_>>().join(" ");
        let notes = [(PLAN, format!("{:016x}", self.plan)), (BRICK, self.brick.to_string()), (RAYS, rays)];
        let sum = checksum(notes.each_ref().map(|(_, text)| text.as_str()), sums.iter().copied());
        let [plan, brick, rays] = notes;
        let notes = [plan, brick, rays, (CHECKSUM, sum)].map(|(name, text)| Note { name, text });
        let channels = AnyChannels::sort([AnyChannel::new("tau", FlatSamples::F32(sums))].into_iter().collect());
        let layer = Layer::new(size, LayerAttributes::named("light"), Encoding::FAST_LOSSLESS, channels);
        exr_with_notes(ExrImage::from_layer(layer), &notes, |image, file| image.write().to_buffered(file))
    }

    /// Loads the light that enters a brick of a plan.
    ///
    /// # Errors
    /// [`Error::Input`] if the file cannot be read, is damaged, no light, or belongs to another plan or brick.
    pub fn load(path: impl AsRef<Path>, plan: &Plan, brick: usize) -> Result<Self> {
        let of_brick = |light: Self| light.of(plan, brick, plan.brick(brick)?).map(|_| light);
        let expected = "no light: expected OpenEXR that voxsplat plan wrote";
        read_exr(path.as_ref(), expected, |bytes| Self::decoded(bytes).and_then(of_brick))
    }

    /// Reads the light from the bytes of its OpenEXR file.
    ///
    /// # Errors
    /// [`Error::Input`] or [`Error::Setting`] if they are damaged or no light.
    pub fn from_exr(bytes: &[u8]) -> Result<Self> {
        check_exr(Path::new("light"), bytes)?;
        Self::decoded(bytes)
    }

    fn decoded(bytes: &[u8]) -> Result<Self> {
        let refused = |reason: &str| Error::setting("light", format!("no light: {reason}"));
        let image = decoded_layer(bytes).map_err(|reason| refused(&reason))?;
        let layer = image.layer_data;
        let [Some(plan), Some(brick), Some(rays)] = &[PLAN, BRICK, RAYS].map(|name| text_of(&layer, name)) else {
            return Err(refused("expected a file that voxsplat plan wrote"));
        };
        let channel = layer.channel_data.list.iter().find(|channel| channel.name == *"tau");
        let Some(FlatSamples::F32(sums)) = channel.map(|channel| &channel.sample_data) else {
            return Err(refused("it has no channel tau of 32-bit floats"));
        };
        if text_of(&layer, CHECKSUM) != Some(checksum([plan, brick, rays].map(String::as_str), sums.iter().copied())) {
            return Err(refused("it is damaged, its checksum differs: plan again, or copy the file again"));
        }
        let mut left = sums.as_slice();
        let mut of_rays = |text: &str| {
            let numbers: Vec<i64> = text.split(':').map(|number| number.parse().ok()).collect::<Option<_>>()?;
            let &[light, direction, row, column, width, height] = numbers.as_slice() else { return None };
            let [light, direction, width, height] =
                [light, direction, width, height].map(|number| usize::try_from(number).ok().filter(|n| *n <= MOST));
            let (width, count) = (width.filter(|&width| width > 0)?, width?.checked_mul(height?)?);
            let (sums, rest) = left.split_at_checked(count)?;
            left = rest;
            let is_near = |place: i64| place.unsigned_abs() <= MOST as u64;
            let first = Some([row, column]).filter(|first| first.iter().all(|&place| is_near(place)))?;
            Some(RayDepths { of: [light?, direction?], first, width, sums: sums.to_vec() })
        };
        let rays = rays.split_whitespace().map(&mut of_rays).collect::<Option<Vec<_>>>();
        let (plan, brick) = (u64::from_str_radix(plan, 16), brick.parse());
        let (Ok(plan), Ok(brick), Some(rays)) = (plan, brick, rays) else {
            return Err(refused("its attributes are damaged: plan again"));
        };
        Ok(Self { plan, brick, rays: Arc::new(rays) })
    }
}
