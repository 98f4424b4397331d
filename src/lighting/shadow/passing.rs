//! Light on its way through a whole lattice, slab after slab away from the light, to the parts of the lattice: their
//! [`Incoming`](super::incoming::Incoming) light.

use std::ops::Range;

use rayon::prelude::*;

use super::incoming::{PointRanges, RayDepths, common};
use super::response::SweepResponse;
use super::sweep::{Direction, RaySet, RowScratch, Swept};
use super::{Arrival, LightRays, LitBox, ShadowLattice, axes_across};
use crate::error::Result;
use crate::kernel::Kernel;
use crate::lighting::{Casting, MAX_CASTING};
use crate::vectors::dispatch;
use voxsplat_volume::memory::zeroed;

/// The number of rows and columns of rays beside the lattice and its margins.
const BESIDE: i64 = 8;

/// A number of points that no lattice has: windows are open at the faces of the lattice.
pub(crate) const OPEN: i64 = 1 << 40;

/// Returns the distance in voxels of the farthest voxels on which the light of a voxel depends beside the light that
/// enters; `None`: sweeps do not serve the kernel.
pub(crate) fn reach(kernel: &Kernel, bias: f64) -> Option<u32> {
    SweepResponse::new(kernel, 1.0).map(|response| {
        let planes = SweepResponse::planes(bias, 1.0);
        // Neighbours of the stencil; rays beside the voxel at the first plane that they take from the sweep.
        let wide = (3.0_f64.sqrt() * kernel.radius()).max(response.within.len() as f64 + 2.5).ceil() as usize;
        (planes + wide.max(3 + 1) + response.margin() + 1) as u32
    })
}

/// Returns the number of points at the faces of a part at which its filtered field, or a spline in it, lacks voxels.
pub(crate) fn margin(kernel: &Kernel) -> u32 {
    SweepResponse::new(kernel, 1.0).map_or(0, |response| response.margin() as u32 + 1)
}

/// Returns the window of a part that knows the extinctions of these voxels of a lattice.
pub(crate) fn window(known: &[Range<u32>; 3], dims: [u32; 3], kernel: &Kernel) -> PointRanges {
    let margin = i64::from(margin(kernel));
    std::array::from_fn(|axis| {
        let Range { start, end } = known[axis];
        let low = if start == 0 { -OPEN } else { i64::from(start) + margin };
        low..if end == dims[axis] { OPEN } else { i64::from(end) - margin }
    })
}

/// Returns the sums of rays that have passed nothing.
fn sums_of(count: u64) -> Result<Vec<f32>> {
    Ok(zeroed(count, || "the light on its way".to_owned())?)
}

/// A direction of light on its way through a lattice.
struct Passing {
    light: usize,
    axes: [usize; 3],
    direction: Direction,
    /// The planes of the lattice and its margins.
    planes: Range<i64>,
    /// The first row and the first column of the rays.
    first: [i64; 2],
    rows: Vec<PassingRow>,
}

/// A row of rays on their way through a lattice.
struct PassingRow {
    sums: Vec<f32>,
    /// The sums of the rays that enter each window, from the window's first column on; empty if none of the row does.
    entered: Vec<Vec<f32>>,
}

/// The light of all directions on its way through a lattice to the windows of its parts.
pub(crate) struct LightPass {
    windows: Vec<PointRanges>,
    /// The rows and the columns of rays that enter each window, for each direction.
    entries: Vec<Vec<[Range<i64>; 2]>>,
    passing: Vec<Passing>,
}

/// A way of light through a lattice: the axis across which it is swept, and whether it comes from the last plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Way {
    pub(crate) axis: usize,
    pub(crate) ahead: bool,
}

impl LightPass {
    /// Begins to pass light through a lattice.
    ///
    /// # Errors
    /// [`Error::Memory`](crate::Error::Memory) if 4 bytes for each ray, and for each that enters a window, cannot be
    /// allocated.
    pub(crate) fn new(casting: &Casting, lattice: &ShadowLattice, windows: Vec<PointRanges>) -> Result<Self> {
        let margin = SweepResponse::new(&lattice.kernel, lattice.divisor).map_or(0, |response| response.margin());
        let wide = lattice.dims.map(|count| -(margin as i64) - BESIDE..count as i64 + margin as i64 + BESIDE);
        let lit = LitBox::new(casting, lattice, [[0; 3], lattice.dims], None);
        let (mut entries, mut passing) = (Vec::new(), Vec::new());
        for light in 0..MAX_CASTING {
            let Some(LightRays::Parallel(bundles)) = lit.rays(light) else { continue };
            for (axis, direction) in bundles.iter().flat_map(|of| of.directions.iter().map(|each| (of.axis, *each))) {
                let axes = axes_across(axis);
                let rays_in = |window: &PointRanges| {
                    let [planes, rows, columns] = axes.map(|axis| common(&window[axis], &wide[axis]));
                    direction.places_in(&planes, [rows, columns])
                };
                let [rows, columns] = rays_in(&wide);
                let entered: Vec<_> = windows.iter().map(rays_in).collect();
                let sums = |columns: &Range<i64>| sums_of((columns.end - columns.start).max(0) as u64);
                let row = |row: i64| {
                    let enters = |[rows, columns]: &[Range<i64>; 2]| match rows.contains(&row) {
                        true => sums(columns),
                        false => Ok(Vec::new()),
                    };
                    Ok(PassingRow {
                        sums: sums(&columns)?,
                        entered: entered.iter().map(enters).collect::<Result<_>>()?,
                    })
                };
                let (planes, first) = (wide[axis].clone(), [rows.start, columns.start]);
                let rows = rows.map(row).collect::<Result<_>>()?;
                passing.push(Passing { light, axes, direction, planes, first, rows });
                entries.push(entered);
            }
        }
        Ok(Self { windows, entries, passing })
    }

    /// Returns the ways of all directions.
    pub(crate) fn ways(&self) -> Vec<Way> {
        let mut ways: Vec<Way> = Vec::new();
        for Passing { axes, direction, .. } in &self.passing {
            let way = Way { axis: axes[0], ahead: direction.is_ahead() };
            if !ways.contains(&way) {
                ways.push(way);
            }
        }
        ways
    }

    /// Returns the light that enters each window.
    ///
    /// # Errors
    /// [`Error::Memory`](crate::Error::Memory) if 4 bytes for each ray that enters cannot be allocated.
    pub(crate) fn finish(self) -> Result<Vec<Vec<RayDepths>>> {
        let mut all: Vec<Vec<RayDepths>> = self.windows.iter().map(|_| Vec::new()).collect();
        for (Passing { light, direction, first, rows, .. }, entries) in self.passing.into_iter().zip(self.entries) {
            for (number, [_, columns]) in entries.into_iter().enumerate() {
                let of_window = rows.iter().zip(first[0]..).map(|(row, place)| (&row.entered[number], place));
                let shaded: Vec<_> = of_window.filter(|(sums, _)| sums.iter().any(|&sum| sum != 0.0)).collect();
                let (Some((_, low)), Some((_, high))) = (shaded.first(), shaded.last()) else { continue };
                let width = (columns.end - columns.start) as usize;
                let mut sums = sums_of(width as u64 * (high - low + 1) as u64)?;
                for (row, place) in &shaded {
                    sums[width * (place - low) as usize..][..width].copy_from_slice(row);
                }
                all[number].push(RayDepths {
                    of: [light, direction.number],
                    first: [*low, columns.start],
                    width,
                    sums,
                });
            }
        }
        Ok(all)
    }
}

impl Arrival {
    /// Passes the light of a way through some planes of the lattice.
    ///
    /// # Errors
    /// [`Error::Memory`](crate::Error::Memory) if 8 bytes for each voxel cannot be allocated.
    pub(crate) fn pass(&self, way: Way, own: &Range<i64>, pass: &mut LightPass) -> Result<()> {
        let Some(response) = &self.lit.response else { return Ok(()) };
        let LightPass { windows, entries, passing } = pass;
        self.planes(way.axis, response, &mut |swept, axes| {
            for (passing, entries) in passing.iter_mut().zip(&*entries) {
                if passing.axes == axes && passing.direction.is_ahead() == way.ahead {
                    passing.pass(swept, own, windows, entries);
                }
            }
            Ok(())
        })
    }
}

impl Passing {
    /// Adds the planes of a box that lie within `own`, and keeps the sums of the rays that enter windows.
    fn pass(&mut self, swept: &Swept<'_>, own: &Range<i64>, windows: &[PointRanges], entries: &[[Range<i64>; 2]]) {
        let Self { axes, direction, planes, first, rows, .. } = self;
        let own = &common(own, planes);
        let windows: Vec<PointRanges> = windows.iter().map(|window| axes.map(|axis| window[axis].clone())).collect();
        let rays = &direction.rays(swept.planes, swept.first);
        rows.par_iter_mut().enumerate().for_each_init(RowScratch::default, |scratch, (number, row)| {
            scratch.resize(swept.planes.columns, rays.width);
            let place = [first[0] + number as i64, first[1]];
            dispatch(RowPass { swept, own, windows: &windows, entries, direction, rays, place, row, scratch });
        });
    }
}

/// The way of a row of rays through the planes of a box. A type so that it is compiled for the widest vectors of the
/// machine.
struct RowPass<'a> {
    swept: &'a Swept<'a>,
    own: &'a Range<i64>,
    /// The windows, in planes, rows and columns.
    windows: &'a [PointRanges],
    entries: &'a [[Range<i64>; 2]],
    direction: &'a Direction,
    rays: &'a RaySet<'a>,
    /// The number of the row, and its first column.
    place: [i64; 2],
    row: &'a mut PassingRow,
    scratch: &'a mut RowScratch,
}

impl pulp::WithSimd for RowPass<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { swept, own, windows, entries, direction, rays, place: [row, first], .. } = self;
        let PassingRow { sums, entered } = self.row;
        let Some(origin) = rays.origin else { return };
        let count = swept.planes.planes;
        for place in 0..own.end - own.start {
            let in_lattice = if direction.is_ahead() { own.end - 1 - place } else { own.start + place };
            // Rays also enter windows at planes without matter, beside the box.
            for ((window, [_, columns]), entered) in windows.iter().zip(entries).zip(&mut *entered) {
                if entered.is_empty() {
                    continue;
                }
                for columns_of in direction.entering(window, in_lattice, row) {
                    let Range { start, end } = common(&columns_of, columns);
                    if start < end {
                        let places = |first: i64| (start - first) as usize..(end - first) as usize;
                        entered[places(columns.start)].copy_from_slice(&sums[places(first)]);
                    }
                }
            }
            let plane = usize::try_from(in_lattice - swept.first[0]).ok().filter(|&plane| plane < count);
            if let Some(plane) = plane {
                let number = if direction.is_ahead() { count - 1 - plane } else { plane };
                let sums = &mut sums[(origin[1] - first) as usize..][..rays.width];
                self.scratch.add(swept, rays, [number, plane], row - origin[0], sums);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DVec3;

    use super::*;
    use crate::lighting::shadow::incoming::Incoming;
    use crate::lighting::shadow::{Reusable, field};
    use crate::lighting::{Light, Lighting};
    use crate::volume::Grid;

    const DIMS: [u32; 3] = [47, 60, 53];

    /// The extinctions of a lattice; a twentieth of its voxels has none.
    fn tau([x, y, z]: [usize; 3]) -> f32 {
        let hash = (x * 7_919 + y * 104_729 + z * 1_299_709) % 1_013;
        if hash % 20 == 0 { 0.0 } else { hash as f32 * 2e-5 }
    }

    /// The light that arrives at a part of the lattice.
    fn arrival(casting: &Casting, lattice: &ShadowLattice, part: &[Range<u32>; 3]) -> Arrival {
        let first = [0, 1, 2].map(|axis| part[axis].start);
        let lattice = ShadowLattice { first, ..lattice.clone() };
        let dims = [0, 1, 2].map(|axis| part[axis].len());
        let first = first.map(|n| n as usize);
        Arrival::new(casting, &lattice, [[0; 3], dims], &mut Reusable::default(), |[y, z], row| {
            let value = |x: usize| tau([x + first[0], y + first[1], z + first[2]]).max(field::CLIPPED);
            row.iter_mut().enumerate().for_each(|(x, extinction)| *extinction = value(x));
        })
        .unwrap()
    }

    /// Lights above, beside, along a diagonal, wide and across the lattice's corner: the light in a part is the light
    /// in the whole, to the last bit, and differs from it without the light that enters.
    #[test]
    fn light_in_parts_of_a_lattice_is_the_light_in_the_whole() {
        let grid = Grid::axis_parallel(DIMS, [1.0, 1.1, 0.9]).unwrap();
        let kernel = Kernel::default();
        let lattice = ShadowLattice::new(&grid, kernel, kernel.integral(), 1.0, 1.0);
        let wide = |light: Light, size: f64| Light { size, ..light };
        for (towards, size) in [
            ([0.0, 0.0, 1.0], 0.0),
            ([0.0, -1.0, 0.0], 0.0),
            ([1.0, 1.0, 0.0], 0.0),
            ([-0.6, 0.31, 0.4], 0.0),
            ([0.1, 0.2, -1.0], 10.0),
            ([1.0, 1.0, 1.0], 60.0),
        ] {
            let light = wide(Light::directional(DVec3::from_array(towards)), size);
            let lighting = Lighting { lights: vec![light], shadows: 1.0, ..Lighting::default() };
            let casting = lighting.casting().unwrap();
            let reach = reach(&kernel, casting.bias()).unwrap();
            let whole_arrival = arrival(&casting, &lattice, &DIMS.map(|n| 0..n));
            let whole = whole_arrival.shares(0, &|_| ()).unwrap().unwrap();
            // Two parts that meet at a cut across each axis, with their halos.
            let cuts = [20, 31, 27];
            let owned: Vec<[Range<u32>; 3]> = (0..8)
                .map(|n| {
                    let side = |axis: usize| if n >> axis & 1 == 0 { 0..cuts[axis] } else { cuts[axis]..DIMS[axis] };
                    [0, 1, 2].map(side)
                })
                .collect();
            let wider = |range: &Range<u32>, axis: usize, by: u32| {
                range.start.saturating_sub(by)..(range.end + by).min(DIMS[axis])
            };
            let held: Vec<[Range<u32>; 3]> =
                owned.iter().map(|of| [0, 1, 2].map(|axis| wider(&of[axis], axis, reach))).collect();
            let windows: Vec<PointRanges> = held.iter().map(|of| window(of, DIMS, &kernel)).collect();
            let mut pass = LightPass::new(&casting, &lattice, windows.clone()).unwrap();
            for way in pass.ways() {
                let count = DIMS[way.axis];
                let mut slabs: Vec<Range<u32>> =
                    (0..count).step_by(9).map(|start| start..(start + 9).min(count)).collect();
                if way.ahead {
                    slabs.reverse();
                }
                for slab in slabs {
                    let mut part = DIMS.map(|n| 0..n);
                    part[way.axis] = wider(&slab, way.axis, 4);
                    let [start, end] = [i64::from(slab.start), i64::from(slab.end)];
                    let own = if start == 0 { -OPEN } else { start }..if slab.end == count { OPEN } else { end };
                    arrival(&casting, &lattice, &part).pass(way, &own, &mut pass).unwrap();
                }
            }
            let mut lost = 0;
            for (((rays, window), held), owned) in pass.finish().unwrap().into_iter().zip(windows).zip(held).zip(owned)
            {
                let incoming = Incoming { window, rays: Arc::new(rays) };
                let arrival = arrival(&casting, &lattice, &held);
                let alone = arrival.shares(0, &|_| ()).unwrap().unwrap();
                let count = |arrival: &crate::lighting::shadow::Arriving<'_>| {
                    let [xs, ys, zs] = owned.clone();
                    let rows = zs.flat_map(|z| ys.clone().map(move |y| (y, z)));
                    rows.map(|(y, z)| {
                        let in_whole = whole.from([xs.start, y, z].map(|n| n as usize));
                        let first = [xs.start - held[0].start, y - held[1].start, z - held[2].start];
                        let in_part = arrival.from(first.map(|n| n as usize));
                        (0..xs.len()).filter(|&x| in_whole(x) != in_part(x)).count()
                    })
                    .sum::<usize>()
                };
                lost += count(&alone);
                drop(alone);
                let arrival = arrival.entered_by(Some(incoming));
                let entered = arrival.shares(0, &|_| ()).unwrap().unwrap();
                assert_eq!(count(&entered), 0, "{towards:?} {size}, {owned:?}");
            }
            assert!(lost > 10_000, "{towards:?} {size}: {lost}");
        }
    }
}
