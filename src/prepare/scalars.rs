//! scalars: a volume to splats of scalars, for post-shading. On the host, brick by brick: whether a voxel can be
//! visible depends on its surroundings. If kernels have grown, cells stand for voxels (scalar_cells.rs), by
//! `quads` through one eye cells of several levels (levels.rs).

use rayon::prelude::*;

use super::cells::CellSize;
use super::levels::{Cut, ScalarNeed};
use super::scalar_cells::{Coarse, Filters};
use crate::error::{Error, Result};
use crate::gpu::cache::Cache;
use crate::gpu::context::Context;
use crate::gpu::drawable::Drawable;
use crate::gpu::held_samples::HeldSamples;
use crate::gpu::layout::{LIT_SCALAR_WORDS, SCALAR_WORDS, packed_gradient};
use crate::gpu::sampled_scalars::SampledScalars;
use crate::gpu::samples::{Bricks, Input};
use crate::gpu::savings::Savings;
use crate::gpu::store::StoreBuilder;
use crate::kernel::{Kernel, Normalization, Slopes};
use crate::progress::Progress;
use crate::settings::budget::{MAX_GROWTH, MAX_PLACES, too_much};
use crate::splats::brick::MadeBrick;
use crate::transfer::TransferFunction;
use crate::transfer::bins::VisibleValues;
use crate::transfer::scalars::{Reduction, Relative};
use crate::volume::{BRICK_EDGE as EDGE, ToF64, Volume, with_samples};

/// The largest influence, in voxels, within which single voxels are searched: a row of a brick with its halo is 64
/// bits. If the influence is larger, bricks are kept whole.
const MAX_HALO: usize = 16;

/// The settings on which splats of scalars depend, besides volume and transfer function.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct EmissionKey {
    pub(crate) kernel: Kernel,
    pub(crate) normalization: Normalization,
    pub(crate) need: ScalarNeed,
    /// Whether splats have gradients.
    pub(crate) lit: bool,
    /// The cells of the lattice; `None`: voxels, or the cells of [`ScalarNeed::cut`].
    pub(crate) coarse: Option<Coarse>,
    /// Whether invisible voxels become splats too, for other transfer functions.
    pub(crate) whole: bool,
    /// The reduction of values to scalars.
    pub(crate) reduction: Reduction,
}

impl EmissionKey {
    /// Returns the number of words of a splat.
    fn words(&self) -> usize {
        if self.lit { LIT_SCALAR_WORDS } else { SCALAR_WORDS }
    }

    /// Returns whether splats made for `self` serve `other`. They must reach at least as far; reaching up to 1.5 times
    /// as far changes no pixel and costs only time.
    pub(crate) fn serves(&self, other: &Self) -> bool {
        let influence = other.need.influence..=1.5 * other.need.influence;
        let ScalarNeed { influence: held, growth, .. } = self.need;
        let need = ScalarNeed { influence: held, growth, ..other.need };
        influence.contains(&held) && *self == Self { need, ..*other }
    }
}

/// Returns the largest sum of kernels over the lattice, divided by the normalisation: reconstruction magnifies
/// differences by no more.
///
/// Searched on a grid of a quarter of a voxel, for this kernel and for a broad one; a tenth is added for places
/// between.
pub(crate) fn magnification(kernel: &Kernel, normalization: Normalization) -> f64 {
    let reach = kernel.radius().ceil() as i32;
    let cube = |along: &[f64]| -> Vec<[f64; 3]> {
        let plane = |z: f64| along.iter().flat_map(move |&y| along.iter().map(move |&x| [x, y, z]));
        along.iter().flat_map(|&z| plane(z)).collect()
    };
    let points = cube(&(-reach..=reach + 1).map(f64::from).collect::<Vec<f64>>());
    let sum = |offset: [f64; 3]| -> f64 {
        let square = |point: &[f64; 3]| (0..3).map(|axis| (point[axis] - offset[axis]).powi(2)).sum();
        points.iter().map(|point| kernel.value(square(point))).sum()
    };
    let worst = cube(&[0.0, 0.25, 0.5]).into_iter().map(sum).fold(kernel.integral(), f64::max);
    1.1 * worst / normalization.divisor(kernel)
}

/// The scalars, relative to the base, that are invisible however kernels add them up.
///
/// The interval holds 0, so sums of some of its scalars are invisible too, whether or not others are left out.
#[derive(Debug, Clone, Copy)]
struct Invisible([f64; 2]);

impl Invisible {
    fn new(transfer: &TransferFunction, reduction: &Reduction, shows: VisibleValues, magnification: f64) -> Self {
        let base = reduction.base();
        let around = transfer.invisible_around(base);
        let ends = match shows {
            VisibleValues::Opaque => around,
            VisibleValues::Largest => around
                .filter(|_| transfer.is_invisible([f64::NEG_INFINITY, base]))
                .map(|[_, high]| [f64::NEG_INFINITY, high]),
            VisibleValues::Mean => None,
        };
        // Empty if every value is visible.
        let ends = ends.unwrap_or([f64::INFINITY, f64::NEG_INFINITY]);
        Self(ends.map(|end| reduction.length((end - base) / magnification)))
    }

    fn holds(self, scalar: f64) -> bool {
        let Self([low, high]) = self;
        low <= scalar && scalar <= high
    }
}

/// Returns the places of a brick, as bits of each row along x, that are within `reach` of an active place of the brick
/// or of its halo.
fn within_reach(active: &[bool], halo: usize, reach: f64) -> Vec<u32> {
    let edge = EDGE + 2 * halo;
    let bits = |row: &[bool]| row.iter().rev().fold(0_u64, |bits, &active| bits << 1 | u64::from(active));
    let rows: Vec<u64> = active.chunks_exact(edge).map(bits).collect();
    // The places within 0, 1, 2, .. places of an active one along x.
    let wider = |rows: &Vec<u64>| Some(rows.iter().map(|row| row | row << 1 | row >> 1).collect());
    let widened: Vec<Vec<u64>> = std::iter::successors(Some(rows), wider).take(halo + 1).collect();
    let square = (reach * reach).floor() as usize;
    let offsets = (0..edge - EDGE + 1).flat_map(|z| (0..edge - EDGE + 1).map(move |y| (y, z)));
    let offsets: Vec<(usize, usize)> = offsets
        .filter_map(|(y, z)| {
            let left = square.checked_sub(y.abs_diff(halo).pow(2) + z.abs_diff(halo).pow(2))?;
            Some((left.isqrt().min(halo), y + edge * z))
        })
        .collect();
    let near = |row: usize| {
        let start = row % EDGE + edge * (row / EDGE);
        let bits = offsets.iter().fold(0, |bits, &(along, offset)| bits | widened[along][start + offset]);
        (bits >> halo) as u32
    };
    (0..EDGE * EDGE).map(near).collect()
}

/// The scalars of a volume as samples on the device, or the reason why it has none.
pub(crate) enum Samples {
    Held(Drawable),
    /// No samples: the device has no room for them, or the lattice has several levels.
    Outgrown,
    /// No samples, because no scalar is visible.
    Invisible,
}

/// The scalars of a volume that become splats: voxels that can take part in anything visible, and copies beyond the
/// faces of the volume.
///
/// A place is visible only if a voxel outside [`Invisible`] reaches it. So a voxel is kept if such a voxel is within
/// the influence of the two. The other voxels change nothing: neither visible places nor invisible ones.
pub(crate) struct Emission<'a> {
    volume: &'a Volume,
    relative: Relative,
    invisible: Invisible,
    savings: Savings,
    key: EmissionKey,
    /// The voxels, or the cells of each level that has a share in the picture.
    lattices: Vec<ScalarLattice>,
    /// Whether each brick of the volume, x fastest, has a voxel that can be visible.
    active: Vec<bool>,
    /// Whether voxels are kept one by one; otherwise bricks are kept whole.
    singly: bool,
}

/// The cells of a level, or the voxels as level 0, with the copies beyond the faces.
struct ScalarLattice {
    level: u32,
    /// The filters that make cells; `None`: the lattice is the lattice of the voxels.
    filters: Option<Filters>,
    /// The filter of gradients.
    slopes: Slopes,
    /// The number of cells around a brick that are searched for voxels that can be visible, or that gradients depend
    /// on.
    halo: usize,
    /// The numbers of cells that cover the volume along each axis.
    dims: [usize; 3],
    /// The number of cells of copies beyond each face.
    padding: usize,
    /// The lattice point at which the first copy begins, in the lattice extended by [`ScalarNeed::padding`].
    origin: u32,
    /// The numbers of cells along each axis, copies included.
    extended: [usize; 3],
    /// The numbers of bricks of the extended cells along each axis.
    counts: [usize; 3],
}

impl ScalarLattice {
    fn new(
        volume: &Volume,
        level: u32,
        EmissionKey { kernel, need, coarse, lit, .. }: &EmissionKey,
        halo: usize,
    ) -> Self {
        let grid = volume.grid();
        let filters = match coarse {
            Some(coarse) => Some(coarse.filters(kernel, grid)),
            None => (level > 0).then(|| Filters::new(CellSize::of_level(level), [0.0; 3], &[1.0])),
        };
        // Cells that have a lattice of their own are of level 0 in it.
        let cells = coarse.map_or(CellSize::of_level(level), |coarse| coarse.cells);
        let slopes = Slopes::of_cells(cells.voxels());
        let padding = need.cut.map_or(need.padding, |cut| cut.padding(level).min(need.padding >> level));
        let dims = grid.dims().map(|d| cells.cells(d) as usize);
        let extended = dims.map(|d| d + 2 * padding as usize);
        Self {
            level,
            filters,
            slopes,
            halo: if *lit { halo.max(slopes.reach()) } else { halo },
            dims,
            padding: padding as usize,
            origin: need.padding - (padding << level),
            extended,
            counts: extended.map(|n| n.div_ceil(EDGE)),
        }
    }

    /// Returns the first cell of a brick; negative among the copies.
    fn first(&self, brick: [usize; 3]) -> [i64; 3] {
        brick.map(|b| (b * EDGE) as i64 - self.padding as i64)
    }
}

impl<'a> Emission<'a> {
    pub(crate) fn new(
        context: &Context,
        volume: &'a Volume,
        transfer: &TransferFunction,
        shows: VisibleValues,
        key: &EmissionKey,
    ) -> Result<Self> {
        let (savings, need, reduction) = (context.savings, key.need, &key.reduction);
        let halo = need.influence.floor() as usize;
        let singly = savings.voxels && !key.whole && halo <= MAX_HALO && need.cut.is_none();
        let [finest, coarsest] = need.cut.map_or([0, 0], |cut| cut.levels);
        let lattice = |level| ScalarLattice::new(volume, level, key, if singly { halo } else { 0 });
        let lattices: Vec<ScalarLattice> = (finest..=coarsest).map(lattice).collect();
        let places =
            |lattice: &ScalarLattice| lattice.extended.into_iter().fold(1_u64, |n, d| n.saturating_mul(d as u64));
        let places = lattices.iter().map(places).fold(0, u64::saturating_add);
        if need.growth > MAX_GROWTH || places > MAX_PLACES.max(2 * volume.grid().len()) {
            let what = format!("post-shading would copy {} layers of voxels beyond the faces", need.padding);
            return Err(too_much(&what, need.growth));
        }
        let relative = Relative::new(volume, *reduction);
        let invisible = Invisible::new(transfer, reduction, shows, magnification(&key.kernel, key.normalization));
        let mut emission =
            Self { volume, relative, invisible, savings, key: *key, lattices, active: Vec::new(), singly };
        let ranges = volume.ranges()?.iter();
        emission.active =
            ranges.map(|range| range.iter().any(|&raw| emission.is_active(emission.relative.to(raw)))).collect();
        Ok(emission)
    }

    /// Returns the scalars as samples on the device. `held` holds the samples of the whole volume, with the voxels
    /// around each brick if pictures are lit.
    pub(crate) fn sampled(
        &self,
        (context, pipelines): (&Context, &Cache),
        transfer: &TransferFunction,
        (held, around): (&HeldSamples, bool),
        progress: &Progress,
    ) -> Result<Samples> {
        /// The largest number of bytes of the box that painters pack.
        const MOST: u64 = 4 << 30;
        let EmissionKey { lit, reduction, .. } = self.key;
        let input = Input::of_scalars(context, self.volume, (transfer, reduction), around, progress);
        let [lattice] = self.lattices.as_slice() else { return Ok(Samples::Outgrown) };
        let Some(bounds) = self.bounds(lattice)? else { return Ok(Samples::Invisible) };
        let places = |end: u64, axis: usize| end * u64::from(bounds[1][axis] - bounds[0][axis] + 1);
        let texel = if lit { 8 } else { 4 };
        let deepest = context.limits.max_texture_dimension_3d as usize;
        let all = input.all_bricks();
        let fits = HeldSamples::fits(&input, &all)
            && lattice.extended.iter().all(|&n| n < deepest)
            && (0..3).fold(texel, places) <= MOST;
        let shown = self.active.iter().filter(|&&active| active).count();
        if !fits {
            return Ok(Samples::Outgrown);
        }
        let dims = lattice.dims.map(|n| n as u32);
        let filters = lattice.filters.as_ref().map(|filters| filters.on_device(dims, lattice.slopes));
        let part = (lattice.padding as u32, bounds);
        let (scalars, bytes) =
            SampledScalars::new((&input, pipelines), &reduction, held, part, (filters.as_ref(), lit))?;
        let bricks = |bytes| Bricks { all: self.active.len() as u32, uploaded: shown as u32, bytes };
        Ok(Samples::Held(Drawable::of_scalars(scalars, bricks(bytes))))
    }

    /// Returns the hull of the places within the influence of voxels that can be visible, in the extended lattice;
    /// `None` if there are none.
    fn bounds(&self, lattice: &ScalarLattice) -> Result<Option<[[u32; 3]; 2]>> {
        let Some([start, end]) = self.hull()? else { return Ok(None) };
        let padding = lattice.padding as i64;
        let reach = self.key.need.influence.ceil().min(f64::from(u32::MAX >> 1)) as i64;
        let ends = [0, 1, 2].map(|axis| {
            let voxels = start[axis] as i64..end[axis] as i64;
            // At a face the copies beyond it show too.
            let (first, last) = (voxels.start == 0, voxels.end == i64::from(self.volume.grid().dims()[axis]));
            let near = match &lattice.filters {
                Some(filters) => filters.cells(axis, voxels),
                None => voxels,
            };
            let extended = lattice.extended[axis] as i64;
            let low = if first { 0 } else { (near.start - reach + padding).clamp(0, extended) };
            let high = if last { extended } else { (near.end + reach + padding).clamp(0, extended) };
            [low as u32, high as u32]
        });
        Ok(Some([ends.map(|[low, _]| low), ends.map(|[_, high]| high)]))
    }

    /// Returns the hull of the voxels that can be visible, the first and the one after the last along each axis; `None`
    /// if there are none. Samples in a file are read for light alone, whose time follows the hull; for pictures it is
    /// the hull of bricks then.
    fn hull(&self) -> Result<Option<[[usize; 3]; 2]>> {
        let [across, down, _] = self.volume.bricks().map(|n| n as usize);
        let dims = self.volume.grid().dims().map(|n| n as usize);
        let joined = |[a, b]: [[usize; 3]; 2], [c, d]: [[usize; 3]; 2]| {
            [[0, 1, 2].map(|axis| a[axis].min(c[axis])), [0, 1, 2].map(|axis| b[axis].max(d[axis]))]
        };
        let active = (0..self.active.len()).filter(|&brick| self.active[brick]);
        let bricks = active.map(|n| [n % across, n / across % down, n / (across * down)].map(|brick| brick * EDGE));
        let of_bricks = bricks.map(|low| [low, [0, 1, 2].map(|axis| dims[axis].min(low[axis] + EDGE))]);
        let Some([low, high]) = of_bricks.reduce(joined) else { return Ok(None) };
        if self.volume.held().is_none() && !self.key.need.zeros {
            return Ok(Some([low, high]));
        }
        let of_plane = |z: usize| {
            let at = |y: usize| dims[0] * (y + dims[1] * z);
            let samples = self.volume.read(at(low[1])..at(high[1]))?;
            with_samples!(&samples, s => {
                let of_row = |(y, row): (usize, &[_])| {
                    let is_active = |sample: &_| self.is_active(self.relative.to(ToF64::to_f64(*sample)));
                    let first = row.iter().position(is_active)?;
                    let last = row.iter().rposition(is_active)?;
                    Some([[first, y, z], [last + 1, y + 1, z + 1]])
                };
                Ok::<_, Error>((low[1]..).zip(s.chunks_exact(dims[0])).filter_map(of_row).reduce(joined))
            })
        };
        let planes = (low[2]..high[2]).into_par_iter().map(of_plane).collect::<Result<Vec<_>>>()?;
        Ok(planes.into_iter().flatten().reduce(joined))
    }

    /// Makes the splats of the chosen scalars.
    pub(crate) fn emit(&self, context: &Context, progress: &Progress) -> Result<Drawable> {
        let mut stores = StoreBuilder::new(context, 4 * self.key.words() as u64);
        for lattice in &self.lattices {
            let row = |j: usize, k: usize| self.row(lattice, j, k);
            stores.push_rows(self.volume, lattice.counts, lattice.halo, (progress, "emitting scalars"), &row)?;
        }
        let scalars = stores.finish()?;
        context.wait("emitting scalars")?;
        Ok(Drawable::of_lists(scalars))
    }

    /// Returns whether a scalar can be visible.
    fn is_active(&self, scalar: f32) -> bool {
        !self.savings.voxels || self.key.whole || !self.invisible.holds(f64::from(scalar))
    }

    /// Returns whether an active brick of the volume has voxels within the influence of this brick.
    fn is_near(&self, lattice: &ScalarLattice, brick: [usize; 3]) -> bool {
        let [across, down, deep] = self.volume.bricks().map(|n| n as usize);
        let reach = (self.key.need.influence / libm::exp2(f64::from(lattice.level))).ceil() as i64;
        let start = lattice.first(brick);
        let bricks = |axis: usize, n: usize| {
            let at = |place: i64| place.div_euclid(EDGE as i64).clamp(0, n as i64 - 1) as usize;
            let cells = start[axis] - reach..start[axis] + EDGE as i64 + reach;
            let voxels = lattice.filters.as_ref().map_or(cells.clone(), |filters| filters.voxels(axis, cells));
            at(voxels.start)..=at(voxels.end - 1)
        };
        let active = |[x, y, z]: [usize; 3]| self.active[x + across * (y + down * z)];
        bricks(2, deep).any(|z| bricks(1, down).any(|y| bricks(0, across).any(|x| active([x, y, z]))))
    }

    /// Makes the bricks along x with these numbers in y and z that can hold splats.
    fn row(&self, lattice: &ScalarLattice, j: usize, k: usize) -> Result<Vec<MadeBrick>> {
        let takes_part = |i| {
            (self.key.need.cut).is_none_or(|cut: Cut| cut.takes_part(lattice.level, lattice.first([i, j, k]), EDGE))
                && (!self.savings.bricks || self.is_near(lattice, [i, j, k]))
        };
        let bricks: Vec<[usize; 3]> = (0..lattice.counts[0]).filter(|&i| takes_part(i)).map(|i| [i, j, k]).collect();
        let (Some(&leftmost), Some(&rightmost)) = (bricks.first(), bricks.last()) else { return Ok(Vec::new()) };
        let (first, last) = (lattice.first(leftmost), lattice.first(rightmost));
        let made = |scalars: &dyn Fn([i64; 3]) -> (Vec<f32>, Vec<bool>)| {
            let brick = |&brick: &[usize; 3]| {
                let (scalars, flat) = scalars(lattice.first(brick));
                self.brick(lattice, brick, &scalars, &flat)
            };
            bricks.iter().map(brick).collect()
        };
        let Some(filters) = &lattice.filters else {
            let strip = self.volume.strip([first[1], first[2]], lattice.halo)?;
            let scalars = |first| bytemuck::pod_collect_to_vec(&strip.brick(first, &self.relative));
            return made(&|first| (scalars(first), Vec::new()));
        };
        let halo = lattice.halo as i64;
        let ends = [first.map(|cell| cell - halo), last.map(|cell| cell + EDGE as i64 + halo)];
        let strip = filters.strip(self.volume, &self.relative, ends, self.key.lit)?;
        made(&|first| (strip.brick(first, lattice.halo), strip.flat(first)))
    }

    /// Returns the number of voxels that a cell counts for; 0: it has no share in the picture.
    fn count(&self, lattice: &ScalarLattice, cell: [i64; 3]) -> f64 {
        match self.key.need.cut {
            None => 1.0,
            Some(cut) if cut.reaches(lattice.level, cell, self.volume.grid().dims()) => {
                libm::exp2(f64::from(3 * lattice.level)) * cut.part(lattice.level, cell)
            }
            Some(_) => 0.0,
        }
    }

    /// Makes the splats of a brick, given its scalars with the halo around them, and the cells that have no gradient,
    /// if any.
    fn brick(&self, lattice: &ScalarLattice, brick: [usize; 3], scalars: &[f32], flat: &[bool]) -> Result<MadeBrick> {
        let (halo, lit) = (lattice.halo, self.key.lit);
        let kept = self.singly.then(|| {
            let active: Vec<bool> = scalars.iter().map(|&s| self.is_active(s)).collect();
            within_reach(&active, halo, self.key.need.influence)
        });
        let first = lattice.first(brick);
        let edge = EDGE + 2 * halo;
        // Cells are 2^level voxels apart, and gradients are per voxel.
        let steepness = libm::exp2(-f64::from(lattice.level));
        let mut copies = 0;
        let (origin, dims) = (brick.map(|b| (b * EDGE) as u32), lattice.extended.map(|n| n as u32));
        let made = MadeBrick::of_rows(origin, dims, self.key.words() - 1, |[y, z], count, words| {
            let start = halo + edge * (y + halo + edge * (z + halo));
            let kept = kept.as_ref().map_or(u32::MAX, |kept| kept[y + EDGE * z]);
            let mut bits = 0;
            for (x, &scalar) in scalars[start..][..count].iter().enumerate().filter(|(x, _)| kept >> x & 1 == 1) {
                let slopes = lit && !flat.get(x + EDGE * (y + EDGE * z)).is_some_and(|&flat| flat);
                let gradient = || lattice.slopes.gradient(scalars, start + x, edge);
                let gradient = if slopes { gradient() } else { [0.0; 3] };
                let cell = [0, 1, 2].map(|axis| first[axis] + [x, y, z][axis] as i64);
                let count = self.count(lattice, cell);
                if count > 0.0 && (self.key.need.zeros || scalar != 0.0 || gradient != [0.0; 3]) {
                    bits |= 1 << x;
                    words.push(((f64::from(scalar) * count) as f32).to_bits());
                    if lit {
                        let gradient = gradient.map(|c| (f64::from(c) * steepness * count) as f32);
                        words.extend(packed_gradient(gradient));
                    }
                    let is_voxel = |axis: usize| (0..lattice.dims[axis] as i64).contains(&cell[axis]);
                    copies += u64::from(!(0..3).all(is_voxel));
                }
            }
            bits
        })?;
        Ok(MadeBrick { brick: made.brick.of_level(lattice.level, lattice.origin), copies, ..made })
    }
}
