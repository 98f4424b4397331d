//! Sections: the matter in the plane of a picture.

use glam::{DAffine3, DMat3, DVec3};
use rayon::prelude::*;

use super::Image;
use crate::camera::{Camera, Projection, View};
use crate::error::{Error, InputError, Result};
use crate::layers::{Layer, Layers, Matter, absent_value, look_of, luminance, nearest_samples, resampled};
use crate::transfer::TransferFunction;
use crate::volume::{Grid, Samples, Volume, with_samples};

/// A plane through a volume, and the side from which its sections are seen.
#[derive(Debug, Clone, PartialEq)]
pub struct SectionPlane {
    /// The name of the plane; empty if it has none.
    pub name: String,
    /// A point of the plane, in the world.
    pub point: DVec3,
    /// The direction of the view, across the plane.
    pub forward: DVec3,
    /// The direction upwards in the picture, in the world.
    pub up: DVec3,
}

impl SectionPlane {
    /// Returns the camera of a section of `size` pixels, width and height, each `pixel` world units wide, with the
    /// middle of a lattice in the middle of the picture.
    ///
    /// # Errors
    /// The errors of [`Camera::new`].
    pub fn camera(&self, grid: &Grid, pixel: f64, size: [u32; 2]) -> Result<Camera> {
        let forward = self.forward.normalize_or_zero();
        let target = grid.center() + forward * (self.point - grid.center()).dot(forward);
        let view = View { direction: Some(forward), up: self.up, target: Some(target), ..View::default() };
        Camera::new(&View { view_height: Some(pixel * f64::from(size[1])), ..view }, grid, size)
    }

    /// Returns the corners of the plane's part in the box of a lattice, half a voxel around its samples, in order;
    /// none if the plane misses the box.
    #[must_use]
    pub fn outline(&self, grid: &Grid) -> Vec<DVec3> {
        let forward = self.forward.normalize_or_zero();
        let corners = grid.corners(0.5);
        let side = corners.map(|corner| (corner - self.point).dot(forward));
        let edges = (0..8).flat_map(|a: usize| (0..3).map(move |axis| [a, a | 1 << axis])).filter(|[a, b]| a != b);
        let mut crossings: Vec<DVec3> = edges
            .filter(|[a, b]| (side[*a] < 0.0) != (side[*b] < 0.0))
            .map(|[a, b]| corners[a].lerp(corners[b], side[a] / (side[a] - side[b])))
            .collect();
        let middle = crossings.iter().sum::<DVec3>() / crossings.len().max(1) as f64;
        let (right, up) = forward.any_orthonormal_pair();
        let angle = |place: &DVec3| libm::atan2((*place - middle).dot(up), (*place - middle).dot(right));
        crossings.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
        crossings
    }
}

/// The ground of a section: the look of the first layer. Other layers lie over it, as opaque as their looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Ground {
    /// Values from black to white over a range, tinted by the colours of the transfer function as much as values are
    /// opaque relative to its most opaque one. Labels and voxels with colours keep their colours.
    Grey([f64; 2]),
    /// The opaque colours of the transfer function.
    Colors,
    /// Black, to which all layers add their colours, as channels do.
    Black,
}

/// The thickness of a section, pixels: too thin to span several samples.
const THICKNESS: f64 = 1e-3;

/// The width of the line in which a section cuts an isosurface, pixels.
const LINE: f64 = 1.5;

/// A colour, red, green and blue, with its opacity, 0 to 1.
type Colored = (DVec3, f64);

/// Returns the section through the target of a camera of parallel rays, in the plane of its picture: opaque inside the
/// box of the voxels, clear outside and in voxels of the first layer without a finite value.
///
/// A pixel has the value of a cubic spline through the samples, or the mean if it spans several samples; values are
/// classified after that. Labels and masks are those of the nearest voxel. Isosurfaces are lines.
///
/// # Errors
/// [`Error::Camera`] if rays are not parallel, and the errors of reading samples.
pub fn section(layers: &Layers, camera: &Camera, ground: Ground) -> Result<Image> {
    camera.validate()?;
    if !matches!(camera.projection, Projection::Orthographic { .. }) {
        return Err(Error::Camera("a section needs parallel rays".to_owned()));
    }
    let [width, height] = camera.size;
    let mut image = Image::transparent(width, height)?;
    let plane = Plane::new(layers, camera);
    let mut all = layers.all().iter();
    let first = all.next().map(|layer| plane.ground(layer, ground)).transpose()?.unwrap_or_default();
    let others = all.map(|layer| plane.colored(layer)).collect::<Result<Vec<_>>>()?;
    let gaps = plane.gaps(layers.volume())?;
    let draw = |(index, pixel): (usize, &mut [f32; 4])| {
        if !plane.is_inside(index) || gaps.as_ref().is_some_and(|gaps| gaps[index]) {
            return;
        }
        let color = others.iter().fold(first[index], |behind, layer| {
            let (own, opacity) = layer[index];
            let passed = if ground == Ground::Black { 1.0 } else { 1.0 - opacity };
            passed * behind + opacity * own
        });
        let [r, g, b] = color.clamp(DVec3::ZERO, DVec3::ONE).to_array().map(|channel| channel as f32);
        *pixel = [r, g, b, 1.0];
    };
    image.pixels_mut().par_iter_mut().enumerate().for_each(draw);
    Ok(image)
}

/// The pixels of a section as a lattice.
struct Plane {
    /// From pixels to the lattice of the layers.
    map: DAffine3,
    size: [u32; 2],
    /// The places of the lattice's last samples, plus half a voxel.
    end: DVec3,
}

impl Plane {
    fn new(layers: &Layers, camera: &Camera) -> Self {
        let ([across, down], [left, top]) = camera.pixels();
        let axes = [camera.right * across, camera.up * down, camera.forward * across * THICKNESS];
        let corner = camera.right * (left + across / 2.0) + camera.up * (top + down / 2.0);
        // Around the middle of the volume, so that a distant origin costs no digits.
        let place = camera.target - layers.grid().center() + corner;
        let [x, y, z] = axes;
        let map =
            layers.grid().centered().to_lattice() * DAffine3::from_mat3_translation(DMat3::from_cols(x, y, z), place);
        let end = DVec3::from_array(layers.grid().dims().map(f64::from)) - 0.5;
        Self { map, size: camera.size, end }
    }

    fn len(&self) -> usize {
        self.size[0] as usize * self.size[1] as usize
    }

    /// Returns whether a pixel lies in the box of the voxels.
    fn is_inside(&self, index: usize) -> bool {
        let width = self.size[0] as usize;
        let [x, y] = [index % width, index / width].map(|at| at as f64);
        let place = self.map.transform_point3(DVec3::new(x, y, 0.0));
        place.cmpge(DVec3::splat(-0.5)).all() && place.cmple(self.end).all()
    }

    /// Returns the colours of the first layer in front of its ground.
    fn ground(&self, layer: &Layer, ground: Ground) -> Result<Vec<DVec3>> {
        let over_black = |colored: Vec<Colored>| colored.into_iter().map(|(color, opacity)| opacity * color).collect();
        let (volume, transfer) = match (&layer.matter, ground) {
            (Matter::Scalars { volume, transfer }, Ground::Grey(_) | Ground::Colors) => (volume, transfer),
            (Matter::Colors(_), Ground::Grey(_) | Ground::Colors) => {
                return Ok(self.colored(layer)?.into_iter().map(|(color, _)| color).collect());
            }
            _ => return Ok(over_black(self.colored(layer)?)),
        };
        let values = self.values(volume, transfer)?;
        let most = transfer.max_opacity();
        let mask = self.mask(layer)?;
        let surfaces = transfer.isosurfaces();
        let own = |index: usize| {
            let value = f64::from(values[index]);
            let (color, opacity) = transfer.sample(value);
            let color = DVec3::from_array(color);
            let Ground::Grey([low, high]) = ground else { return color };
            let grey = DVec3::splat(((value - low) / (high - low)).clamp(0.0, 1.0));
            if mask.as_ref().is_some_and(|mask| !mask[index]) {
                return grey;
            }
            let hue = color / color.max_element().max(f64::MIN_POSITIVE);
            let shown = if most > 0.0 { grey * DVec3::ONE.lerp(hue, opacity / most) } else { grey };
            surfaces.iter().fold(shown, |shown, surface| {
                shown.lerp(surface.color.into(), self.line(&values, index, surface.value))
            })
        };
        Ok((0..self.len()).into_par_iter().map(own).collect())
    }

    /// Returns the share of a pixel that a line at a value covers: by the distance of the value, in pixels.
    fn line(&self, values: &[f32], index: usize, level: f64) -> f64 {
        let [width, height] = self.size.map(|side| side as usize);
        let [x, y] = [index % width, index / width];
        let at = |x: usize, y: usize| f64::from(values[y * width + x]);
        let slope = |[low, high]: [f64; 2], steps: usize| (high - low) / steps.max(1) as f64;
        let ([left, right], [top, bottom]) =
            ([x.saturating_sub(1), (x + 1).min(width - 1)], [y.saturating_sub(1), (y + 1).min(height - 1)]);
        let across = slope([at(left, y), at(right, y)], right - left);
        let down = slope([at(x, top), at(x, bottom)], bottom - top);
        let distance = (at(x, y) - level).abs() / libm::hypot(across, down);
        if distance.is_nan() { 0.0 } else { (LINE / 2.0 + 0.5 - distance).clamp(0.0, 1.0) }
    }

    /// Returns the colours and the opacities of a layer.
    fn colored(&self, layer: &Layer) -> Result<Vec<Colored>> {
        let mut colored: Vec<Colored> = match &layer.matter {
            Matter::Scalars { volume, transfer } => {
                let own = |value: &f32| transfer.sample(f64::from(*value));
                let values = self.values(volume, transfer)?;
                values.par_iter().map(own).map(|(color, opacity)| (color.into(), opacity)).collect()
            }
            Matter::Labels { volume, looks, .. } => {
                let (slope, intercept) = volume.rescale();
                let labels = self.nearest(volume)?;
                let look = |index| look_of(looks, slope * labels.raw(index) + intercept);
                let own = |index| look(index).map_or_else(Default::default, |look| (look.color.into(), look.opacity));
                (0..self.len()).map(own).collect()
            }
            Matter::Colors(colors) => {
                let channels = colors.channels.iter().map(|channel| self.values(channel, &colors.transfer));
                let channels = channels.collect::<Result<Vec<_>>>()?;
                let alpha = colors.alpha.as_ref().map(|alpha| self.values(alpha, &colors.transfer)).transpose()?;
                let own = |index: usize| {
                    let color = [0, 1, 2].map(|channel: usize| f64::from(channels[channel][index]));
                    let value = alpha.as_ref().map_or_else(|| luminance(color), |alpha| f64::from(alpha[index]));
                    (DVec3::from_array(color) / colors.white, colors.transfer.sample(value).1)
                };
                (0..self.len()).map(own).collect()
            }
        };
        if let Some(mask) = self.mask(layer)? {
            colored.iter_mut().zip(mask).filter(|(_, shown)| !shown).for_each(|((_, opacity), _)| *opacity = 0.0);
        }
        Ok(colored)
    }

    /// Returns the pixels in which the mask of a layer shows it; `None` without a mask.
    fn mask(&self, layer: &Layer) -> Result<Option<Vec<bool>>> {
        let Some(mask) = &layer.mask else { return Ok(None) };
        let (slope, intercept) = mask.volume.rescale();
        let labels = self.nearest(&mask.volume)?;
        let is_shown = |index| mask.shown.contains(&((slope * labels.raw(index) + intercept) as i64));
        Ok(Some((0..self.len()).map(is_shown).collect()))
    }

    /// Returns the value of a volume in each pixel.
    fn values(&self, volume: &Volume, transfer: &TransferFunction) -> Result<Vec<f32>> {
        resampled(volume, &self.map, [self.size[0], self.size[1], 1], absent_value(transfer) as f32)
    }

    /// Returns the pixels whose nearest voxel has no finite value; `None` if all values are finite.
    fn gaps(&self, volume: &Volume) -> Result<Option<Vec<bool>>> {
        match volume.check_finite() {
            Ok(()) => Ok(None),
            Err(InputError::NonFinite { .. }) => {
                let samples = self.nearest(volume)?;
                Ok(Some((0..self.len()).map(|index| !samples.raw(index).is_finite()).collect()))
            }
            Err(error) => Err(error.into()),
        }
    }

    /// Returns the stored sample of the nearest voxel in each pixel.
    fn nearest(&self, volume: &Volume) -> Result<Samples> {
        let stored = volume.shared_samples()?;
        let [width, height] = self.size;
        with_samples!(&*stored, s => nearest_samples(s, &self.map, volume.grid().dims(), [width, height, 1]))
    }
}
