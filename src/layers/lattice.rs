//! Volumes on the lattice of another volume.

use std::sync::Arc;

use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use super::resample;
use crate::error::{Error, Result};
use crate::transfer::TransferFunction;
use crate::volume::{Grid, Number, Samples, Volume, with_samples};
use voxsplat_volume::memory::reserved;
use voxsplat_volume::parallel::for_each_chunk;

/// The way in which a volume was put onto the lattice of another volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fit {
    /// A fit voxel by voxel: the voxels of both lie in the same places, to less than half a voxel.
    Same,
    /// A fit voxel by voxel: the lattices have the same numbers of voxels, and one of the files does not state the
    /// place of its lattice.
    Unplaced,
    /// A fit of labels: every voxel got the label of the nearest voxel.
    Nearest {
        /// The share, 0 to 1, of the voxels with a label other than 0 that lie outside of the other volume.
        outside: f64,
    },
    /// A fit of values: every voxel got an interpolated value.
    Interpolated {
        /// The share, 0 to 1, of the visible voxels that lie outside of the other volume.
        outside: f64,
    },
}

/// The lattice of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lattice {
    /// The points of the lattice.
    pub grid: Grid,
    /// Whether the world of the lattice is the space of a patient.
    pub is_oriented: bool,
}

/// The largest number of samples of a lattice that [`Lattice::finest`] makes.
const MOST_SAMPLES: f64 = (1 << 29) as f64;

/// The largest ratio of the cells of a finer lattice to the other's.
const FINER: f64 = 0.95;

impl Lattice {
    /// Returns the lattice of a volume.
    #[must_use]
    pub fn of(volume: &Volume) -> Self {
        Self { grid: *volume.grid(), is_oriented: volume.is_oriented() }
    }

    /// Returns the lattice of a picture of a volume with others over it: the lattice with the smallest cells, because
    /// then the finest volume keeps its samples. It fills the box of the volume. If no lattice is finer, or a finer one
    /// would have over 2^29 samples there, the result is the lattice of the volume; in the latter case the second value
    /// is that number of samples.
    ///
    /// # Errors
    /// The errors of [`Grid::new`].
    pub fn finest<'a>(base: &Volume, others: impl IntoIterator<Item = &'a Volume>) -> Result<(Self, Option<f64>)> {
        let own = Self::of(base);
        let cell = |grid: &Grid| grid.to_world().matrix3.determinant().abs();
        let finer = others.into_iter().filter(|other| {
            let is_elsewhere = !matches!(fit(other, &own), Ok(Fit::Same | Fit::Unplaced));
            is_elsewhere && own.is_comparable(&Self::of(other)) && cell(other.grid()) < FINER * cell(base.grid())
        });
        let Some(finest) = finer.min_by(|a, b| cell(a.grid()).total_cmp(&cell(b.grid()))) else {
            return Ok((own, None));
        };
        // The box of the volume, in voxels of the other lattice.
        let grid = finest.grid();
        let map = between(base.grid(), grid);
        let end = DVec3::from_array(base.grid().dims().map(f64::from)) - 0.5;
        let corner = |c: usize| {
            let side = |axis: usize| if c >> axis & 1 == 1 { end[axis] } else { -0.5 };
            map.transform_point3(DVec3::from_array(std::array::from_fn(side)))
        };
        let corners: [DVec3; 8] = std::array::from_fn(corner);
        let (low, high) = corners.iter().fold((corners[0], corners[0]), |(low, high), c| (low.min(*c), high.max(*c)));
        let (low, high) = ((low - TIE).ceil(), (high + TIE).floor());
        let counts = high - low + 1.0;
        let samples = counts.element_product();
        if counts.min_element() < 1.0 || samples > MOST_SAMPLES {
            return Ok((own, Some(samples)));
        }
        let to_world = grid.to_world() * DAffine3::from_translation(low);
        let grid = Grid::new(counts.to_array().map(|count| count as u32), to_world)?;
        Ok((Self { grid, ..own }, None))
    }

    /// Returns whether a file states the place of the lattice, or the spacing of its samples.
    fn is_placed(&self) -> bool {
        self.is_oriented || self.grid.to_world() != DAffine3::IDENTITY
    }

    /// Returns whether the places of two lattices are in the same world.
    fn is_comparable(&self, other: &Self) -> bool {
        self.is_oriented == other.is_oriented && self.is_placed() && other.is_placed()
    }
}

/// Returns the map from lattice coordinates of one lattice to lattice coordinates of another.
fn between(from: &Grid, to: &Grid) -> DAffine3 {
    // Around the middle of the first, so that a distant origin costs no digits.
    let shift = to.to_lattice().matrix3 * (from.center() - to.center());
    let half = |grid: &Grid| DVec3::from_array(grid.dims().map(|d| f64::from(d - 1))) / 2.0;
    let matrix = to.to_lattice().matrix3 * from.to_world().matrix3;
    DAffine3::from_mat3_translation(matrix, half(to) + shift - matrix * half(from))
}

/// Returns the largest distance of corresponding voxels of two lattices with the same dims, in voxels along any axis.
fn apart(grid: &Grid, other: &Grid) -> f64 {
    let map = between(other, grid);
    // Displacements are linear, so the largest is at a corner.
    let displaced = (0..8).map(|corner| {
        let far = |axis: usize| if corner >> axis & 1 == 1 { f64::from(other.dims()[axis] - 1) } else { 0.0 };
        let place = DVec3::from_array(std::array::from_fn(far));
        (map.transform_point3(place) - place).abs().max_element()
    });
    displaced.fold(0.0, f64::max)
}

/// The distance in voxels below which voxels are each other's nearest.
const APART: f64 = 0.5;

/// Returns how the voxels of a volume correspond to the voxels of a lattice, or the reason why they do not.
pub(super) fn fit(volume: &Volume, of: &Lattice) -> Result<Fit, String> {
    let (grid, own) = (&of.grid, volume.grid());
    let as_many = own.dims() == grid.dims();
    if as_many && apart(grid, own) < APART {
        return Ok(Fit::Same);
    }
    let comparable = of.is_comparable(&Lattice::of(volume));
    if as_many && !comparable {
        return Ok(Fit::Unplaced);
    }
    let by = |dims: [u32; 3]| dims.map(|d| d.to_string()).join(" x ");
    let reason = match as_many {
        true => format!("the lattice lies elsewhere: voxels are up to {:.1} voxels apart", apart(grid, own)),
        false => format!("a lattice of {}, expected that of the volume, {}", by(own.dims()), by(grid.dims())),
    };
    Err(if comparable { reason } else { reason + "; the files do not say where both lie in one space" })
}

/// Puts a volume of labels onto the lattice of another volume. If the lattices differ, each voxel gets the label of the
/// nearest voxel, and 0 if it lies more than half a voxel outside the lattice of the labels. No label is invented.
/// Places are compared in the world of the files. Reads the labels if the lattices differ.
///
/// Labels finer than the other volume lose details between its voxels.
///
/// # Errors
/// [`Error::Setting`] if no label lies in the other volume; and if the numbers of voxels differ while only one of the
/// files states an orientation in patient space, or one states no place; [`Error::Input`](crate::Error::Input) and
/// [`Error::Memory`](crate::Error::Memory).
pub fn on_lattice(labels: &Volume, of: &Volume) -> Result<(Volume, Fit)> {
    put(labels, &Lattice::of(of), "labels", None)
}

/// The transfer function of a volume whose values are interpolated, and the value outside.
#[derive(Clone, Copy)]
pub(super) struct Values<'a> {
    pub(super) transfer: &'a TransferFunction,
    /// The value of a voxel outside of the volume.
    pub(super) absent: f64,
}

/// Puts a volume onto a lattice: labels by [`on_lattice`], values by a cubic spline. `name` is the setting in errors.
pub(super) fn put(
    volume: &Volume,
    of: &Lattice,
    name: &'static str,
    values: Option<Values<'_>>,
) -> Result<(Volume, Fit)> {
    let (grid, own) = (of.grid, *volume.grid());
    match fit(volume, of) {
        Ok(Fit::Unplaced) => return Ok((volume.clone().with_grid(grid)?, Fit::Unplaced)),
        Ok(fit) => return Ok((volume.clone(), fit)),
        Err(reason) if !of.is_comparable(&Lattice::of(volume)) => return Err(Error::setting(name, reason)),
        Err(_) => {}
    }
    let (slope, intercept) = volume.rescale();
    let stored = volume.shared_samples()?;
    let map = between(&grid, &own);
    let (samples, fit, is_out) = if let Some(Values { transfer, absent }) = values {
        let shows = |raw: f64| !transfer.is_invisible([slope * raw + intercept; 2]);
        let outside = share_outside(&stored, &own, &grid, shows);
        let samples = resample::values(volume, &map, grid.dims(), absent as f32)?;
        // Nothing was found inside.
        let is_out = outside >= 1.0 && samples.par_iter().all(|value| transfer.is_invisible([f64::from(*value); 2]));
        (Samples::F32(samples), Fit::Interpolated { outside }, is_out)
    } else {
        // As values, the label 0 is a number of every type.
        let stored = match (slope, intercept) {
            (1.0, 0.0) => stored,
            _ => Arc::new(Samples::F64(rescaled(&stored, slope, intercept)?)),
        };
        let outside = share_outside(&stored, &own, &grid, |label| label != 0.0);
        let samples = with_samples!(&*stored, s => nearest(s, &map, own.dims(), grid.dims()))?;
        // Cells of coarse labels may reach into the volume although their middles do not.
        let is_out = outside >= 1.0 && (0..samples.len()).all(|i| samples.raw(i) == 0.0);
        (samples, Fit::Nearest { outside }, is_out)
    };
    if is_out {
        let reason = "nothing of it lies in the volume: the two are of other places, or one states a wrong place";
        return Err(Error::setting(name, reason));
    }
    let placed = Volume::new(grid, samples)?.with_units(volume.units().clone());
    let placed = placed.with_contents(volume.contents().clone());
    Ok((if of.is_oriented { placed.with_orientation_known() } else { placed }, fit))
}

fn rescaled(samples: &Samples, slope: f64, intercept: f64) -> Result<Vec<f64>> {
    let mut values = reserved(samples.len() as u64, || "labels".to_owned())?;
    values.extend((0..samples.len()).map(|i| slope * samples.raw(i) + intercept));
    Ok(values)
}

/// Returns whether a place lies in the cells of a lattice, half a voxel around each sample.
fn is_within(place: DVec3, grid: &Grid) -> bool {
    let end = DVec3::from_array(grid.dims().map(f64::from)) - 0.5;
    place.cmpge(DVec3::splat(-0.5)).all() && place.cmple(end).all()
}

/// Returns the share of the samples that `counts` accepts that lie outside of another lattice.
fn share_outside(samples: &Samples, from: &Grid, to: &Grid, counts: impl Fn(f64) -> bool + Sync) -> f64 {
    let map = between(from, to);
    let [nx, ny, nz] = from.dims().map(|d| d as usize);
    let rows = (0..ny * nz).into_par_iter().map(|row| {
        let [y, z] = [row % ny, row / ny].map(|at| at as f64);
        let mut found = [0_u64; 2];
        for x in (0..nx).filter(|x| counts(samples.raw(row * nx + x))) {
            let out = !is_within(map.transform_point3(DVec3::new(x as f64, y, z)), to);
            found[usize::from(out)] += 1;
        }
        found
    });
    let [within, out] = rows.reduce(|| [0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
    if out == 0 { 0.0 } else { out as f64 / (within + out) as f64 }
}

/// An offset from the middle between two voxels beyond which the next voxel is the nearest: samples of a lattice twice
/// as fine lie in the middle, and rounding must not choose.
const TIE: f64 = 1e-6;

/// Returns the nearest sample at each place of another lattice, and 0 outside.
pub(crate) fn nearest<T: Number>(samples: &[T], map: &DAffine3, from: [u32; 3], to: [u32; 3]) -> Result<Samples> {
    let [nx, ny, nz] = to.map(|d| d as usize);
    let [fx, fy, _] = from.map(|d| d as usize);
    let count = nx as u64 * ny as u64 * nz as u64;
    let mut placed: Vec<T> = reserved(count, || "labels on the lattice of the volume".to_owned())?;
    placed.resize(count as usize, T::zeroed());
    let end = DVec3::from_array(from.map(f64::from));
    for_each_chunk(&mut placed, nx, |row, out| {
        let [y, z] = [row % ny, row / ny].map(|at| at as f64);
        let start = map.transform_point3(DVec3::new(0.0, y, z)) + 0.5 + TIE;
        for (x, out) in out.iter_mut().enumerate() {
            let place = start + map.matrix3.x_axis * x as f64;
            if place.cmpge(DVec3::ZERO).all() && place.cmplt(end).all() {
                let [i, j, k] = place.to_array().map(|at| at as usize);
                *out = samples[i + fx * (j + fy * k)];
            }
        }
    });
    Ok(T::collected(placed))
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;

    fn grid(dims: [u32; 3], axes: [DVec3; 3], origin: DVec3) -> Grid {
        Grid::new(dims, DAffine3::from_mat3_translation(DMat3::from_cols(axes[0], axes[1], axes[2]), origin)).unwrap()
    }

    #[test]
    fn distant_origins_take_no_digits() {
        let axes = DVec3::AXES.map(|axis| axis * 0.7);
        let far = DVec3::new(1e9, -3e8, 5e8);
        let [a, b] = [far, far + 0.7 * DVec3::X].map(|origin| grid([9, 5, 3], axes, origin));
        let map = between(&a, &b);
        assert!((map.transform_point3(DVec3::ZERO) - DVec3::NEG_X).length() < 1e-5);
        assert!(apart(&a, &a) < 1e-12 && (apart(&a, &b) - 1.0).abs() < 1e-5);
    }

    #[test]
    fn labels_in_the_reach_of_a_cell_are_kept_and_labels_beyond_are_refused() {
        // Coarse labels whose cells are 4 wide, in front of a volume of 3 voxels along x.
        let labels = |x: f64| {
            let grid = grid([2, 3, 3], [4.0 * DVec3::X, DVec3::Y, DVec3::Z], DVec3::X * x);
            Volume::from_slice([2, 3, 3], [1.0; 3], &[7_u8; 18]).unwrap().with_grid(grid).unwrap()
        };
        let volume = Volume::from_slice([3; 3], [0.5, 1.0, 1.0], &[0_u8; 27]).unwrap();
        let (placed, fit) = on_lattice(&labels(2.25), &volume).unwrap();
        assert_eq!(fit, Fit::Nearest { outside: 1.0 });
        let placed = placed.in_memory().unwrap();
        assert_eq!([0, 1, 2].map(|x| placed.value(x)), [0.0, 7.0, 7.0]);
        for x in [3.25, 1e9, -7.0] {
            let refused = on_lattice(&labels(x), &volume).unwrap_err().to_string();
            assert!(refused.starts_with("labels: nothing of it lies in the volume"), "{x}: {refused}");
        }
    }
}
