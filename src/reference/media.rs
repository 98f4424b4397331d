//! Layers in f64: the extinction, colour and normal of each voxel, summed directly.

use std::sync::Arc;

use glam::{DMat3, DVec3};

use super::emission;
use crate::error::{Error, Result};
use crate::layers::{LabelLook, Layer, Layers, Matter, look_of, luminance};
use crate::lighting::Normals;
use crate::settings::Settings;
use crate::transfer::{ControlPoint, Resolution, TransferFunction, isosurface};
use crate::volume::{Samples, Volume};

/// Number of voxels to either side whose extinctions make the normal of a voxel, if samples jump.
const REACH: i64 = 4;
/// The weights of voxels at distances 0, 1 and 2 along an axis in the normals of scalars, and in [`SLOPE`] the weights
/// of their differences (Farid and Simoncelli 2004), scaled so that a ramp of slope 1 has slope 1.
const SMOOTH: [f64; 3] = [0.426_375, 0.249_153, 0.037_659];
const SLOPE: [f64; 3] = [0.0, 0.278_979, 0.110_51];
/// Twice the variance of the Gaussian weights of the extinctions that make a normal, voxels^2.
const SPREAD: f64 = 2.0 * 1.5 * 1.5;
/// The least slope of the smoothed extinction, per voxel, over the largest extinction of the layer.
const FLAT: f64 = 1e-4;

/// The values of a volume, in memory.
struct SampleValues {
    samples: Arc<Samples>,
    slope: f64,
    intercept: f64,
}

impl SampleValues {
    fn new(volume: &Volume) -> Result<Self> {
        let (slope, intercept) = volume.rescale();
        Ok(Self { samples: volume.shared_samples()?, slope, intercept })
    }

    fn at(&self, index: usize) -> f64 {
        self.slope * self.samples.raw(index) + self.intercept
    }
}

enum Optics {
    Transfer(TransferFunction),
    Labels(Arc<[LabelLook]>),
    /// The transfer function of alpha or luminance, the channels beside red, and their largest value.
    Colors(TransferFunction, Vec<SampleValues>, f64),
}

struct SampledMedium {
    values: SampleValues,
    optics: Optics,
    unit: f64,
    /// The scalar that differences are relative to.
    base: f64,
    /// The resolution of scalars: smaller differences are only rounding.
    resolution: Resolution,
    mask: Option<(SampleValues, Arc<[i64]>)>,
    /// The largest extinction of any voxel.
    most: f64,
}

impl SampledMedium {
    /// Returns red, green and blue, or the value three times.
    fn channels(&self, index: usize) -> [f64; 3] {
        let red = self.values.at(index);
        match &self.optics {
            Optics::Colors(_, others, _) => [red, others[0].at(index), others[1].at(index)],
            _ => [red; 3],
        }
    }

    /// Returns the number on which opacity depends: the value, the alpha or the luminance.
    fn scalar(&self, index: usize) -> f64 {
        match &self.optics {
            Optics::Colors(_, others, _) => match others.get(2) {
                Some(alpha) => alpha.at(index),
                None => luminance(self.channels(index)),
            },
            _ => self.values.at(index),
        }
    }
}

/// The media of a lattice, at least one.
pub(super) struct Media {
    dims: [usize; 3],
    media: Vec<SampledMedium>,
    /// Whether voxels are classified, and not the reconstructed field.
    is_pre_shaded: bool,
    /// The isosurfaces, and the number of their medium.
    surfaces: (usize, Vec<ControlPoint>),
    normals: Normals,
    /// The map from gradients along the lattice axes to gradients in the world.
    to_world: DMat3,
}

impl std::fmt::Debug for Media {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Media")
    }
}

impl Media {
    pub(super) fn new(layers: &Layers, settings: &Settings) -> Result<Self> {
        let medium = |layer: &Layer| {
            let optics = match &layer.matter {
                Matter::Scalars { transfer, .. } => Optics::Transfer(transfer.clone()),
                Matter::Labels { looks, .. } => Optics::Labels(Arc::clone(looks)),
                Matter::Colors(colors) => {
                    let others = colors.channels[1..].iter().chain(&colors.alpha).map(SampleValues::new);
                    Optics::Colors(colors.transfer.clone(), others.collect::<Result<_>>()?, colors.white)
                }
            };
            let mask = layer
                .mask
                .as_ref()
                .map(|mask| Ok::<_, Error>((SampleValues::new(&mask.volume)?, Arc::clone(&mask.shown))));
            let unit = layer.unit();
            let most = TransferFunction::extinction(layer.max_opacity(), unit);
            if !most.is_finite() {
                return Err(Error::Transfer(format!("opacity per {unit} is more extinction than a number can hold")));
            }
            let (base, resolution) = match &layer.matter {
                Matter::Scalars { transfer, .. } => (transfer.base(), Resolution::new(transfer, layer.volume())?),
                _ => (0.0, Resolution::NONE),
            };
            let (values, mask) = (SampleValues::new(layer.volume())?, mask.transpose()?);
            Ok(SampledMedium { values, optics, unit, base, resolution, mask, most })
        };
        Ok(Self {
            dims: layers.grid().dims().map(|d| d as usize),
            media: layers.all().iter().map(medium).collect::<Result<_>>()?,
            is_pre_shaded: !settings.is_post_shaded(),
            surfaces: layers
                .isosurfaces(settings.model)?
                .map(|(number, _, t)| (number, t.isosurfaces()))
                .unwrap_or_default(),
            normals: settings.normals().unwrap_or_default(),
            to_world: layers.grid().to_lattice().matrix3.transpose(),
        })
    }

    /// Returns the transfer function, if there is only one medium, of scalars and without a mask.
    pub(super) fn plain(&self) -> Option<&TransferFunction> {
        match self.media.as_slice() {
            [SampledMedium { optics: Optics::Transfer(transfer), mask: None, .. }] => Some(transfer),
            _ => None,
        }
    }

    /// Returns the transfer function, if the value of a voxel alone decides whether it is visible.
    fn by_value(&self) -> Option<&TransferFunction> {
        self.plain().filter(|transfer| !(self.is_pre_shaded && transfer.is_band_limited()))
    }

    /// Returns the number that decides whether a voxel may be visible: its value, or its extinction.
    pub(super) fn number(&self, index: usize) -> f64 {
        if self.by_value().is_some() { self.media[0].scalar(index) } else { self.splatted(self.point(index)) }
    }

    /// Returns whether voxels with numbers in a range may be visible.
    pub(super) fn may_show(&self, range: [f64; 2]) -> bool {
        self.by_value().map_or(range[1] > 0.0, |transfer| !transfer.is_invisible(range))
    }

    /// Returns the lattice point of a voxel, given its place in memory.
    pub(super) fn point(&self, index: usize) -> [usize; 3] {
        let [nx, ny, _] = self.dims;
        [index % nx, index / nx % ny, index / nx / ny]
    }

    /// Returns the place in memory of the voxel at or nearest to a lattice point.
    fn index(&self, point: [i64; 3]) -> usize {
        let [i, j, k] = [0, 1, 2].map(|axis| point[axis].clamp(0, self.dims[axis] as i64 - 1) as usize);
        i + self.dims[0] * (j + self.dims[1] * k)
    }

    /// Returns the scalar of a medium at a voxel less the base, and half the differences of its neighbours along the
    /// lattice axes. A neighbour beyond the edge has the value at the edge.
    fn scalar(&self, medium: &SampledMedium, point: [i64; 3], differs: bool) -> [f64; 4] {
        // Halved first, so that no difference of numbers overflows.
        let half = |axis: usize, step: i64| {
            let mut beside = point;
            beside[axis] += step;
            medium.scalar(self.index(beside)) / 2.0
        };
        let [x, y, z] = [0, 1, 2].map(|axis| if differs { half(axis, 1) - half(axis, -1) } else { 0.0 });
        [medium.scalar(self.index(point)) - medium.base, x, y, z]
    }

    /// Returns the scalar of the first medium at a point, which may lie beyond the edge, and its gradient along the
    /// lattice axes; without `differs` the gradient is 0.
    pub(super) fn first_scalar(&self, point: [i64; 3], differs: bool) -> [f64; 4] {
        let medium = &self.media[0];
        if differs { self.slopes(medium, point) } else { self.scalar(medium, point, false) }
    }

    /// Returns the scalar and the gradient along the lattice axes: half the differences of neighbours along an axis,
    /// in post-shading smoothed along the other two.
    fn slopes(&self, medium: &SampledMedium, point: [i64; 3]) -> [f64; 4] {
        if self.is_pre_shaded { self.scalar(medium, point, true) } else { self.smooth_slopes(medium, point) }
    }

    /// Returns the scalar and half the differences of neighbours along each axis, smoothed along the other two.
    fn smooth_slopes(&self, medium: &SampledMedium, point: [i64; 3]) -> [f64; 4] {
        let mut sums = self.scalar(medium, point, false);
        for beside in (0..27).map(|i| [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1]) {
            let smooth = |axis: usize| if beside[axis] == 0 { 4.0 / 6.0 } else { 1.0 / 6.0 };
            let place = [0, 1, 2].map(|axis| point[axis] + beside[axis]);
            let [_, differences @ ..] = self.scalar(medium, place, true);
            for axis in (0..3).filter(|&axis| beside[axis] == 0) {
                sums[axis + 1] += smooth((axis + 1) % 3) * smooth((axis + 2) % 3) * differences[axis];
            }
        }
        sums
    }

    /// Returns the world gradient of the scalar of a medium at a voxel; 0 if its differences are only rounding.
    fn gradient(&self, medium: &SampledMedium, point: [i64; 3]) -> DVec3 {
        let [distance, differences @ ..] = self.slopes(medium, point);
        self.to_world * DVec3::from_array(medium.resolution.resolved(differences, distance))
    }

    /// Returns whether the mask of a medium hides a voxel.
    fn is_hidden(medium: &SampledMedium, index: usize) -> bool {
        medium.mask.as_ref().is_some_and(|(values, shown)| !shown.contains(&(values.at(index) as i64)))
    }

    /// Returns colour and extinction of a medium by the value of a voxel alone, before gradient opacity.
    fn flat(&self, medium: &SampledMedium, index: usize) -> ([f64; 3], f64) {
        if Self::is_hidden(medium, index) {
            return ([0.0; 3], 0.0);
        }
        let value = medium.scalar(index);
        let (color, opacity) = match &medium.optics {
            Optics::Colors(transfer, _, white) => {
                let color = medium.channels(index).map(|channel| (channel / white).clamp(0.0, 1.0));
                (color, transfer.sample(value).1)
            }
            Optics::Transfer(transfer) => transfer.sample(value),
            Optics::Labels(looks) => look_of(looks, value).map_or(([0.0; 3], 0.0), |look| (look.color, look.opacity)),
        };
        (color, TransferFunction::extinction(opacity, medium.unit))
    }

    /// Returns colour and extinction of a medium by the values around a voxel, before gradient opacity.
    fn band_limited(&self, medium: &SampledMedium, transfer: &TransferFunction, point: [i64; 3]) -> ([f64; 3], f64) {
        let index = self.index(point);
        if Self::is_hidden(medium, index) {
            return ([0.0; 3], 0.0);
        }
        let value = medium.scalar(index);
        let (mut range, mut square) = ([value; 2], 0.0);
        for axis in 0..3 {
            let [a, b] = [-1, 1].map(|step| {
                let mut beside = point;
                beside[axis] += step;
                medium.scalar(self.index(beside))
            });
            range = [range[0].min(a).min(b), range[1].max(a).max(b)];
            square += (b / 2.0 - a / 2.0).powi(2);
        }
        let [r, g, b, tau] = emission::band_limited(transfer, medium.unit, value, range, square.sqrt());
        ([r, g, b].map(|channel| if tau > 0.0 { channel / tau } else { 0.0 }), tau)
    }

    fn absorbed(&self, medium: &SampledMedium, point: [i64; 3]) -> ([f64; 3], f64) {
        let (color, tau) = match &medium.optics {
            Optics::Transfer(transfer) if self.is_pre_shaded && transfer.is_band_limited() => {
                self.band_limited(medium, transfer, point)
            }
            _ => self.flat(medium, self.index(point)),
        };
        match &medium.optics {
            Optics::Transfer(transfer) if tau > 0.0 && !transfer.gradient_opacity().is_empty() => {
                (color, tau * transfer.gradient_share(self.gradient(medium, point).length()))
            }
            _ => (color, tau),
        }
    }

    /// Returns the extinction of a voxel, per world unit, without isosurfaces.
    fn splatted(&self, point: [usize; 3]) -> f64 {
        let point = point.map(|p| p as i64);
        self.media.iter().map(|medium| self.absorbed(medium, point).1).sum()
    }

    /// Returns the extinction of a voxel that casts shadows, per world unit, with that of the isosurfaces near it.
    pub(super) fn tau(&self, point: [usize; 3]) -> f64 {
        let tau = self.splatted(point);
        let (number, surfaces) = &self.surfaces;
        if surfaces.is_empty() {
            return tau;
        }
        let point = point.map(|p| p as i64);
        let medium = &self.media[*number];
        let [_, slopes @ ..] = self.smooth_slopes(medium, point);
        let slopes = DVec3::from_array(slopes);
        let steepness = [slopes.length(), (self.to_world * slopes).length()];
        tau + isosurface::casting(surfaces, medium.scalar(self.index(point)), steepness)
    }

    /// Returns colour, extinction, and a normal of any length of a voxel.
    pub(super) fn voxel(&self, point: [usize; 3], lit: bool) -> ([f64; 3], f64, DVec3) {
        let point = point.map(|p| p as i64);
        let (mut emission, mut tau, mut most) = ([0.0; 3], 0.0, (0.0, None));
        for medium in &self.media {
            let (color, absorbed) = self.absorbed(medium, point);
            tau += absorbed;
            emission.iter_mut().zip(color).for_each(|(sum, channel)| *sum += channel * absorbed);
            if absorbed > most.0 {
                most = (absorbed, Some(medium));
            }
        }
        let normal = |medium| self.normal(medium, point);
        let normal = most.1.filter(|_| lit).map_or(DVec3::ZERO, normal);
        (emission.map(|channel| if tau > 0.0 { channel / tau } else { 0.0 }), tau, normal)
    }

    /// Returns the world gradient of a scalar by the filter of normals; 0 if its slopes are only rounding.
    fn scalar_normal(&self, medium: &SampledMedium, point: [i64; 3]) -> DVec3 {
        let slope = |axis: usize| {
            let [across, down] = [(axis + 1) % 3, (axis + 2) % 3];
            let mut sum = 0.0;
            for (step, j, k) in (1..=2).flat_map(|s| (-2..=2).flat_map(move |j| (-2..=2).map(move |k| (s, j, k)))) {
                let half = |step: i64| {
                    let mut beside = point;
                    (beside[axis], beside[across], beside[down]) =
                        (point[axis] + step, point[across] + j, point[down] + k);
                    medium.scalar(self.index(beside)) / 2.0
                };
                let smooth = |steps: i64| SMOOTH[steps.unsigned_abs() as usize];
                sum += SLOPE[step as usize] * 2.0 * smooth(j) * smooth(k) * (half(step) - half(-step));
            }
            sum
        };
        let distance = medium.scalar(self.index(point)) - medium.base;
        self.to_world * DVec3::from_array(medium.resolution.resolved([0, 1, 2].map(slope), distance))
    }

    /// Returns a vector along the dominant axis of the structure tensor at a voxel, on the side of its gradient: the
    /// 8th power of the tensor, times the gradient.
    fn tensor_normal(&self, medium: &SampledMedium, point: [i64; 3]) -> DVec3 {
        let own = self.scalar_normal(medium, point);
        if own == DVec3::ZERO {
            return own;
        }
        let beside = (0..3).flat_map(|axis| [-1, 1].map(|step| (axis, step))).map(|(axis, step)| {
            let mut beside = point;
            beside[axis] += step;
            // Beyond the faces, as everywhere, samples repeat.
            self.scalar_normal(medium, beside)
        });
        let beside: Vec<DVec3> = beside.collect();
        let largest = beside.iter().chain([&own]).map(|g| g.abs().max_element()).fold(0.0, f64::max);
        let outer = |g: DVec3| {
            let g = g / largest;
            DMat3::from_cols(g * g.x, g * g.y, g * g.z)
        };
        let mut tensor = beside.into_iter().fold(outer(own), |sum, g| sum + outer(g) * 0.125);
        for _ in 0..3 {
            tensor = tensor * tensor;
        }
        tensor * (own / largest)
    }

    fn normal(&self, medium: &SampledMedium, point: [i64; 3]) -> DVec3 {
        if !matches!(medium.optics, Optics::Labels(_)) && medium.mask.is_none() {
            return match self.normals {
                Normals::Gradient => self.scalar_normal(medium, point),
                Normals::Tensor => self.tensor_normal(medium, point),
            };
        }
        let weight = |d: i64| (-((d * d) as f64) / SPREAD).exp();
        let (mut slope, mut moment) = (DVec3::ZERO, 0.0);
        let around = || (-REACH..=REACH).flat_map(|z| (-REACH..=REACH).map(move |y| (y, z)));
        for (x, (y, z)) in (-REACH..=REACH).flat_map(|x| around().map(move |rest| (x, rest))) {
            let beside = [point[0] + x, point[1] + y, point[2] + z];
            let weight = weight(x) * weight(y) * weight(z);
            moment += weight * (x * x) as f64;
            let tau = self.flat(medium, self.index(beside)).1;
            slope += weight * tau * DVec3::from_array([x, y, z].map(|d| d as f64));
        }
        let slope = slope / moment;
        if slope.abs().max_element() > FLAT * medium.most { self.to_world * slope } else { DVec3::ZERO }
    }
}
