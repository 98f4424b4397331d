//! Labels on the lattice of another volume.

use std::sync::Arc;

use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::volume::{Grid, Number, Samples, ToF64, Volume, with_samples};
use voxsplat_volume::memory::reserved;

/// How labels came onto the lattice of another volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fit {
    /// They are on it: the voxels of both lie in the same places, to less than half a voxel.
    Same,
    /// The lattices have as many voxels along each axis, and one of the files does not say where its own lies: voxels
    /// of the same numbers belong together.
    Unplaced,
    /// Every voxel took the label of the nearest voxel.
    Nearest {
        /// The share, 0 to 1, of the voxels with a label other than 0 that lie outside of the other volume.
        outside: f64,
    },
}

/// Whether a file says where its lattice lies, or how far its samples are apart.
fn is_placed(volume: &Volume) -> bool {
    volume.is_oriented() || volume.grid().to_world() != DAffine3::IDENTITY
}

/// Whether the places of two volumes are of one world.
fn are_comparable(a: &Volume, b: &Volume) -> bool {
    a.is_oriented() == b.is_oriented() && is_placed(a) && is_placed(b)
}

/// The map from the places of one lattice to those of another.
fn between(from: &Grid, to: &Grid) -> DAffine3 {
    // Around the middle of the first: a distant origin takes no digits.
    let shift = to.to_lattice().matrix3 * (from.center() - to.center());
    let half = |grid: &Grid| DVec3::from_array(grid.dims().map(|d| f64::from(d - 1))) / 2.0;
    let matrix = to.to_lattice().matrix3 * from.to_world().matrix3;
    DAffine3::from_mat3_translation(matrix, half(to) + shift - matrix * half(from))
}

/// The corners of a lattice, `margin` voxels outside of its outermost samples.
fn corners(grid: &Grid, margin: f64) -> [DVec3; 8] {
    let ends = grid.dims().map(|d| [-margin, f64::from(d - 1) + margin]);
    std::array::from_fn(|c| DVec3::from_array(std::array::from_fn(|axis| ends[axis][c >> axis & 1])))
}

/// How far voxels of lattices with as many of them lie apart, in voxels along the axis along which that is most.
fn apart(grid: &Grid, other: &Grid) -> f64 {
    let map = between(other, grid);
    // Displacements are linear, so the largest is at a corner.
    let displaced = corners(other, 0.0).map(|corner| (map.transform_point3(corner) - corner).abs().max_element());
    displaced.into_iter().fold(0.0, f64::max)
}

/// Of voxels less than this apart, each is the other's nearest.
const APART: f64 = 0.5;

/// How a volume of labels lies to another, unless voxel by voxel it does not; then, why not.
pub(super) fn fit(labels: &Volume, of: &Volume) -> Result<Fit, String> {
    let (grid, own) = (of.grid(), labels.grid());
    let as_many = own.dims() == grid.dims();
    if as_many && apart(grid, own) < APART {
        return Ok(Fit::Same);
    }
    let comparable = are_comparable(labels, of);
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

/// A volume of labels on the lattice of another. If its own is another one, each voxel takes the label of the nearest
/// of its voxels, and 0 if there is none within half a voxel of its lattice; so no label is made up. Places are
/// compared in the world of the files. Reads the labels if they lie elsewhere.
///
/// Labels finer than the other volume lose what lies between its voxels.
///
/// # Errors
/// [`Error::Setting`] if nothing of it lies in the other volume, and if the lattices have other numbers of voxels while
/// not both files, or neither, state an orientation in patient space, or one states no place at all;
/// [`Error::Input`](crate::Error::Input) and [`Error::Memory`].
pub fn on_lattice(labels: &Volume, of: &Volume) -> Result<(Volume, Fit)> {
    let refused = |reason: String| Err(Error::Setting { name: "labels", reason });
    let (grid, own) = (*of.grid(), *labels.grid());
    match fit(labels, of) {
        Ok(fit) => return Ok((labels.clone(), fit)),
        Err(reason) if !are_comparable(labels, of) => return refused(reason),
        Err(_) => {}
    }
    let (slope, intercept) = labels.rescale();
    let stored = labels.shared_samples()?;
    // As values, the label 0 is a number of every type.
    let stored = match (slope, intercept) {
        (1.0, 0.0) => stored,
        _ => Arc::new(Samples::F64(with_samples!(&*stored, s => values(s, slope, intercept))?)),
    };
    let outside = match inside(&between(&own, &grid), &own, &grid) {
        true => 0.0,
        false => with_samples!(&*stored, s => share_outside(s, &own, &grid)),
    };
    let map = between(&grid, &own);
    let nothing = "nothing of it lies in the volume: the two are of other places, or one states a wrong place";
    if !meets(&map, &grid, &own) {
        return refused(nothing.to_owned());
    }
    let samples = with_samples!(&*stored, s => nearest(s, &map, own.dims(), grid.dims()))?;
    // Cells of coarse labels may reach into it, though their middles do not.
    if outside >= 1.0 && with_samples!(&samples, s => s.par_iter().all(|sample| sample.to_f64() == 0.0)) {
        return refused(nothing.to_owned());
    }
    let placed = Volume::new(grid, samples)?.with_units(labels.units().clone());
    let placed = placed.with_contents(labels.contents().clone());
    Ok((if of.is_oriented() { placed.with_orientation_known() } else { placed }, Fit::Nearest { outside }))
}

fn values<T: ToF64>(samples: &[T], slope: f64, intercept: f64) -> Result<Vec<f64>> {
    let mut values = reserved(samples.len() as u64, || "labels".to_owned())?;
    values.extend(samples.iter().map(|sample| slope * sample.to_f64() + intercept));
    Ok(values)
}

/// Whether a place lies in the cells of a lattice, half a voxel around each sample.
fn is_within(place: DVec3, grid: &Grid) -> bool {
    let end = DVec3::from_array(grid.dims().map(f64::from)) - 0.5;
    place.cmpge(DVec3::splat(-0.5)).all() && place.cmple(end).all()
}

/// Whether all samples of a lattice lie in another.
fn inside(map: &DAffine3, from: &Grid, to: &Grid) -> bool {
    corners(from, 0.0).into_iter().all(|corner| is_within(map.transform_point3(corner), to))
}

/// Whether the boxes of two lattices have more than a face in common: no face of either parts them, nor an edge of each
/// (Gottschalk, Lin and Manocha 1996, "OBBTree").
fn meets(map: &DAffine3, from: &Grid, to: &Grid) -> bool {
    let [a, b] = [corners(from, 0.5).map(|corner| map.transform_point3(corner)), corners(to, 0.5)];
    let m = map.matrix3;
    let edges = [m.x_axis, m.y_axis, m.z_axis];
    let faces = [edges[0].cross(edges[1]), edges[1].cross(edges[2]), edges[2].cross(edges[0])];
    // Edges that run alike have no normal in common, and part nothing.
    let is_normal = |normal: &DVec3, edge: DVec3| normal.length_squared() > 1e-18 * edge.length_squared();
    let of_edge =
        |edge: DVec3| DVec3::AXES.map(|axis| edge.cross(axis)).into_iter().filter(move |n| is_normal(n, edge));
    let pairs = edges.into_iter().flat_map(of_edge);
    let parts = |normal: DVec3| {
        let range = |corners: &[DVec3; 8]| {
            let along = corners.map(|corner| normal.dot(corner));
            along.into_iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], d| [low.min(d), high.max(d)])
        };
        let ([a0, a1], [b0, b1]) = (range(&a), range(&b));
        let rounding = 1e-9 * (a1 - a0 + b1 - b0);
        a1 <= b0 + rounding || b1 <= a0 + rounding
    };
    !DVec3::AXES.into_iter().chain(faces).chain(pairs).any(parts)
}

/// The share, of the samples other than 0, of those that lie outside of another lattice.
fn share_outside<T: ToF64>(samples: &[T], from: &Grid, to: &Grid) -> f64 {
    let map = between(from, to);
    let [nx, ny, _] = from.dims().map(|d| d as usize);
    let rows = samples.par_chunks(nx).enumerate().map(|(row, samples)| {
        let [y, z] = [row % ny, row / ny].map(|at| at as f64);
        let mut counts = [0_u64; 2];
        for x in (0..nx).filter(|&x| samples[x].to_f64() != 0.0) {
            let out = !is_within(map.transform_point3(DVec3::new(x as f64, y, z)), to);
            counts[usize::from(out)] += 1;
        }
        counts
    });
    let [within, out] = rows.reduce(|| [0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
    if out == 0 { 0.0 } else { out as f64 / (within + out) as f64 }
}

/// What is added to the middle between voxels: from there on the next is the nearest. The samples of a lattice twice as
/// fine lie there, and rounding is not to choose.
const TIE: f64 = 1e-6;

/// Samples at the places of another lattice, by the nearest; 0 where there is none.
fn nearest<T: Number>(samples: &[T], map: &DAffine3, from: [u32; 3], to: [u32; 3]) -> Result<Samples> {
    let [nx, ny, nz] = to.map(|d| d as usize);
    let [fx, fy, _] = from.map(|d| d as usize);
    let count = nx as u64 * ny as u64 * nz as u64;
    let mut placed: Vec<T> = reserved(count, || "labels on the lattice of the volume".to_owned())?;
    placed.resize(count as usize, T::zeroed());
    let end = DVec3::from_array(from.map(f64::from));
    placed.par_chunks_mut(nx).enumerate().for_each(|(row, out)| {
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
    fn boxes_meet_or_not() {
        let still = grid([10, 10, 10], DVec3::AXES, DVec3::ZERO);
        let at = |origin: DVec3| {
            let other = grid([10, 10, 10], DVec3::AXES, origin);
            meets(&between(&other, &still), &other, &still)
        };
        assert!(at(DVec3::splat(9.0)) && at(DVec3::new(-9.5, 3.0, 0.0)));
        assert!(!at(DVec3::new(10.0, 0.0, 0.0)) && !at(DVec3::new(0.0, -10.5, 0.0)));
        // A turned box whose corner comes near an edge, with no face of the first between them.
        let turn = DMat3::from_rotation_z(std::f64::consts::FRAC_PI_4);
        let turned = |distance: f64| {
            let axes = [turn.x_axis, turn.y_axis, turn.z_axis];
            let middle = DVec3::splat(4.5) + DVec3::new(distance, distance, 0.0);
            let other = grid([10, 10, 10], axes, middle - turn * DVec3::splat(4.5));
            meets(&between(&other, &still), &other, &still)
        };
        // From the middle to the edge sqrt(50), and 5 from the other middle to its face.
        let touching = (50.0_f64.sqrt() + 5.0) / 2.0_f64.sqrt();
        assert!(turned(touching - 0.1) && !turned(touching + 0.1));
    }
}
