//! Several layers in f64: what each voxel absorbs and emits, and its normal, summed directly.

use std::sync::Arc;

use glam::{DMat3, DVec3};

use crate::error::{Error, Result};
use crate::layers::{Layer, Layers, Look, Matter, look_of, luminance};
use crate::transfer::{Resolution, TransferFunction};
use crate::volume::{Samples, Volume};

/// Voxels to either side of one whose extinctions make its normal, where samples jump.
const REACH: i64 = 4;
/// Twice the variance of the Gaussian that they are weighted by, voxels^2.
const SPREAD: f64 = 2.0 * 1.5 * 1.5;
/// The least slope of the smoothed extinction, per voxel, over the largest of the layer.
const FLAT: f64 = 1e-4;

/// Values of a volume in memory.
struct Values {
    samples: Arc<Samples>,
    slope: f64,
    intercept: f64,
}

impl Values {
    fn new(volume: &Volume) -> Result<Self> {
        let (slope, intercept) = volume.rescale();
        Ok(Self { samples: volume.shared_samples()?, slope, intercept })
    }

    fn at(&self, index: usize) -> f64 {
        self.slope * self.samples.raw(index) + self.intercept
    }
}

enum Looks {
    Transfer(TransferFunction),
    Labels(Arc<[Look]>),
    /// The transfer function of alpha or luminance, the channels beside red, and their largest value.
    Colors(TransferFunction, Vec<Values>, f64),
}

struct Medium {
    values: Values,
    look: Looks,
    unit: f64,
    /// Which differences of values are rounding.
    resolution: Resolution,
    mask: Option<(Values, Arc<[i64]>)>,
    /// The largest extinction.
    most: f64,
}

impl Medium {
    /// Red, green and blue, or three times the value.
    fn channels(&self, index: usize) -> [f64; 3] {
        let red = self.values.at(index);
        match &self.look {
            Looks::Colors(_, others, _) => [red, others[0].at(index), others[1].at(index)],
            _ => [red; 3],
        }
    }

    /// What opacity depends on.
    fn scalar(&self, index: usize) -> f64 {
        match &self.look {
            Looks::Colors(_, others, _) => match others.get(2) {
                Some(alpha) => alpha.at(index),
                None => luminance(self.channels(index)),
            },
            _ => self.values.at(index),
        }
    }
}

/// The media of a lattice.
pub(super) struct Media {
    dims: [usize; 3],
    media: Vec<Medium>,
    to_world: DMat3,
}

impl std::fmt::Debug for Media {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Media")
    }
}

impl Media {
    pub(super) fn new(layers: &Layers) -> Result<Self> {
        let medium = |layer: &Layer| {
            let look = match &layer.matter {
                Matter::Scalars { transfer, .. } => Looks::Transfer(transfer.clone()),
                Matter::Labels { looks, .. } => Looks::Labels(Arc::clone(looks)),
                Matter::Colors(colors) => {
                    let others = colors.channels[1..].iter().chain(&colors.alpha).map(Values::new);
                    Looks::Colors(colors.transfer.clone(), others.collect::<Result<_>>()?, colors.white)
                }
            };
            let mask =
                layer.mask.as_ref().map(|mask| Ok::<_, Error>((Values::new(&mask.volume)?, Arc::clone(&mask.shown))));
            let unit = layer.unit();
            let most = TransferFunction::extinction(layer.max_opacity(), unit);
            if !most.is_finite() {
                return Err(Error::Transfer(format!("opacity per {unit} is more extinction than a number can hold")));
            }
            let resolution = match &layer.matter {
                Matter::Scalars { transfer, .. } => Resolution::new(transfer, layer.volume())?,
                _ => Resolution::NONE,
            };
            Ok(Medium { values: Values::new(layer.volume())?, look, unit, resolution, mask: mask.transpose()?, most })
        };
        Ok(Self {
            dims: layers.grid().dims().map(|d| d as usize),
            media: layers.all().iter().map(medium).collect::<Result<_>>()?,
            to_world: layers.grid().to_lattice().matrix3.transpose(),
        })
    }

    /// The place of the voxel that a lattice point, or the nearest inside, is.
    fn index(&self, point: [i64; 3]) -> usize {
        let [i, j, k] = [0, 1, 2].map(|axis| point[axis].clamp(0, self.dims[axis] as i64 - 1) as usize);
        i + self.dims[0] * (j + self.dims[1] * k)
    }

    /// The gradient, in the world, of the values of a medium at a voxel.
    fn gradient_of_values(&self, medium: &Medium, point: [i64; 3]) -> DVec3 {
        let at = |axis: usize, step: i64| {
            let mut beside = point;
            beside[axis] += step;
            medium.scalar(self.index(beside)) / 2.0
        };
        let differences = [0, 1, 2].map(|axis| at(axis, 1) - at(axis, -1));
        let base = if let Looks::Transfer(transfer) = &medium.look { transfer.base() } else { 0.0 };
        let distance = medium.scalar(self.index(point)) - base;
        self.to_world * DVec3::from_array(medium.resolution.resolved(differences, distance))
    }

    /// Colour and extinction of a medium at a voxel, before gradient opacity.
    fn flat(&self, medium: &Medium, index: usize) -> ([f64; 3], f64) {
        if let Some((values, shown)) = &medium.mask
            && !shown.contains(&(values.at(index) as i64))
        {
            return ([0.0; 3], 0.0);
        }
        let value = medium.scalar(index);
        let (color, opacity) = match &medium.look {
            Looks::Colors(transfer, _, white) => {
                let color = medium.channels(index).map(|channel| (channel / white).clamp(0.0, 1.0));
                (color, transfer.sample(value).1)
            }
            Looks::Transfer(transfer) => transfer.sample(value),
            Looks::Labels(looks) => look_of(looks, value).map_or(([0.0; 3], 0.0), |look| (look.color, look.opacity)),
        };
        (color, TransferFunction::extinction(opacity, medium.unit))
    }

    fn absorbed(&self, medium: &Medium, point: [i64; 3]) -> ([f64; 3], f64) {
        let (color, tau) = self.flat(medium, self.index(point));
        match &medium.look {
            Looks::Transfer(transfer) if tau > 0.0 && !transfer.gradient_opacity().is_empty() => {
                (color, tau * transfer.gradient_share(self.gradient_of_values(medium, point).length()))
            }
            _ => (color, tau),
        }
    }

    /// The extinction of a voxel.
    pub(super) fn tau(&self, point: [usize; 3]) -> f64 {
        let point = point.map(|p| p as i64);
        self.media.iter().map(|medium| self.absorbed(medium, point).1).sum()
    }

    /// Colour, extinction, and a normal of any length, of a voxel.
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

    fn normal(&self, medium: &Medium, point: [i64; 3]) -> DVec3 {
        if !matches!(medium.look, Looks::Labels(_)) && medium.mask.is_none() {
            return self.gradient_of_values(medium, point);
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
