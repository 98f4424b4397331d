//! scalars: a volume to splats of scalars, for post-shading. On the host, brick by brick: which voxels can show depends
//! on their surroundings. If kernels have grown, cells of a pyramid stand for voxels (see levels.rs).

use std::sync::Arc;

use super::levels::{Cut, ScalarNeed};
use super::scalar_cells::{Coarse, Filters};
use crate::budget::{MAX_GROWTH, MAX_PLACES, too_much};
use crate::error::Result;
use crate::gpu::context::Context;
use crate::gpu::layout::{LIT_SCALAR_WORDS, SCALAR_WORDS, packed_gradient};
use crate::gpu::savings::Savings;
use crate::gpu::store::{Drawable, MadeBrick, StoreBuilder};
use crate::gpu::transfer::{Reduction, Relative, Shows};
use crate::kernel::{Kernel, Normalization};
use crate::prepare::pyramid::{Level, Pyramid};
use crate::progress::Progress;
use crate::transfer::TransferFunction;
use crate::volume::{BRICK_EDGE as EDGE, Volume};

/// The largest influence, in voxels, within which single voxels are looked for. If it is larger, bricks are kept whole.
const MAX_HALO: usize = 16;

/// What splats of scalars depend on besides volume and transfer function.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Asked {
    pub(crate) kernel: Kernel,
    pub(crate) normalization: Normalization,
    pub(crate) need: ScalarNeed,
    /// Whether splats have gradients.
    pub(crate) lit: bool,
    /// Which cells stand for voxels along parallel rays; `None`: voxels do, or those of [`ScalarNeed::cut`].
    pub(crate) coarse: Option<Coarse>,
}

impl Asked {
    /// Words of a splat.
    fn words(&self) -> usize {
        if self.lit { LIT_SCALAR_WORDS } else { SCALAR_WORDS }
    }

    /// Whether splats made for `self` can be reused for `other`. They must reach at least as far; reaching up to 1.5
    /// times as far changes no pixel and costs only time.
    pub(crate) fn serves(&self, other: &Self) -> bool {
        let influence = other.need.influence..=1.5 * other.need.influence;
        let ScalarNeed { influence: held, growth, .. } = self.need;
        influence.contains(&held)
            && *self == Self { need: ScalarNeed { influence: held, growth, ..other.need }, ..*other }
    }
}

/// The largest sum of kernels over the lattice, over the divisor: reconstruction magnifies differences by no more.
///
/// Looked for on a grid of a quarter of a voxel, for a kernel as asked and as a broad one has it; a tenth is added for
/// what lies between.
fn magnification(kernel: &Kernel, normalization: Normalization) -> f64 {
    let reach = kernel.radius().ceil() as i32;
    let offsets = [0.0, 0.25, 0.5];
    let mut worst = kernel.integral();
    for x in offsets {
        for y in offsets {
            for z in offsets {
                let mut sum = 0.0;
                for k in -reach..=reach + 1 {
                    for j in -reach..=reach + 1 {
                        for i in -reach..=reach + 1 {
                            let d = [f64::from(i) - x, f64::from(j) - y, f64::from(k) - z];
                            sum += kernel.value(d.iter().map(|c| c * c).sum());
                        }
                    }
                }
                worst = worst.max(sum);
            }
        }
    }
    1.1 * worst / normalization.divisor(kernel)
}

/// Which scalars, relative to the base, show nothing however kernels add them up.
///
/// The interval holds 0, so sums of some of its scalars, be the others left out or not, do not show either.
#[derive(Debug, Clone, Copy)]
struct Invisible([f64; 2]);

impl Invisible {
    fn new(transfer: &TransferFunction, reduction: &Reduction, shows: Shows, magnification: f64) -> Self {
        let base = transfer.base();
        let around = transfer.invisible_around(base);
        let ends = match shows {
            Shows::Opaque => around,
            Shows::Largest => around
                .filter(|_| transfer.is_invisible([f64::NEG_INFINITY, base]))
                .map(|[_, high]| [f64::NEG_INFINITY, high]),
            Shows::Mean => None,
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

/// Places of the lattices that splats are looked for in, copies beyond the faces of the volume included.
fn places(dims: [u32; 3], need: ScalarNeed) -> u64 {
    let of = |level: u32, padding: u32| {
        let along = |d: u32| u64::from(d.div_ceil(1 << level)).saturating_add(2 * u64::from(padding));
        dims.into_iter().map(along).fold(1, u64::saturating_mul)
    };
    let Some(cut) = need.cut else { return of(0, need.padding) };
    let [finest, coarsest] = cut.levels;
    (finest..=coarsest).map(|level| of(level, cut.padding(level))).fold(0, u64::saturating_add)
}

/// Of the places of a brick, x fastest, whether they are within `reach` of an active one of the brick or its halo.
fn within_reach(active: &[bool], halo: usize, reach: f64) -> Vec<bool> {
    // Far enough, and sums of two stay in range.
    const FAR: u16 = 1 << 14;
    let edge = EDGE + 2 * halo;
    let inner = halo..halo + EDGE;
    // Squares of distances, axis by axis (Saito and Toriwaki 1994): along x by a sweep each way, then the least over
    // the neighbours along y and z.
    let mut squares = Vec::with_capacity(EDGE * edge * edge);
    let mut distances = vec![0_u16; edge];
    for row in active.chunks_exact(edge) {
        let mut distance = 127;
        for (d, &active) in distances.iter_mut().zip(row) {
            distance = if active { 0 } else { (distance + 1).min(127) };
            *d = distance;
        }
        distance = 127;
        for (d, &active) in distances.iter_mut().zip(row).rev() {
            distance = if active { 0 } else { (distance + 1).min(127) };
            *d = distance.min(*d);
        }
        squares.extend(distances[inner.clone()].iter().map(|&d| d * d));
    }
    // `stride` apart; `lines` of them after each other are neighbours along the axis.
    let least = |squares: &[u16], stride: usize| {
        let mut result = vec![FAR; squares.len() / edge * EDGE];
        for (result, squares) in result.chunks_exact_mut(EDGE * stride).zip(squares.chunks_exact(edge * stride)) {
            for (i, result) in result.chunks_exact_mut(stride).enumerate() {
                for (offset, line) in squares[i * stride..].chunks_exact(stride).take(2 * halo + 1).enumerate() {
                    let square = (offset as u16).abs_diff(halo as u16).pow(2);
                    result.iter_mut().zip(line).for_each(|(least, &s)| *least = (*least).min(s + square));
                }
            }
        }
        result
    };
    let squares = least(&squares, EDGE);
    let squares = least(&squares, EDGE * EDGE);
    let reach = (reach * reach).floor() as u16;
    squares.into_iter().map(|square| square <= reach).collect()
}

/// What decides which scalars of a volume become splats: the voxels that can take part in something visible, and copies
/// beyond its faces.
///
/// A place shows only if a voxel outside [`Invisible`] reaches it. So a voxel is kept if such a voxel is within the
/// influence of the two. The others change nothing: neither what shows, nor what does not show.
pub(crate) struct Emission<'a> {
    volume: &'a Volume,
    relative: Relative,
    invisible: Invisible,
    savings: Savings,
    need: ScalarNeed,
    /// Words of a splat.
    words: usize,
    /// The lattice of splats: voxels, or cells if there are filters.
    dims: [u32; 3],
    filters: Option<Filters>,
    /// What gradients are sums of: differences of places 1, 2 and 3 to either side, times these.
    differences: [f32; 3],
    /// Of each brick of the volume, x fastest, whether a voxel of it can show.
    active: Vec<bool>,
    /// Layers of voxels around a brick that are searched for voxels that can show, or that gradients take differences
    /// with.
    halo: usize,
    /// Whether they are; otherwise bricks are kept whole.
    singly: bool,
}

/// The cells of a level, or the voxels as level 0, with the copies beyond the faces.
struct Lattice {
    level: u32,
    /// What the cells hold; `None`: the volume is read.
    cells: Option<Arc<Level>>,
    /// Cells that cover the volume along each axis.
    dims: [usize; 3],
    /// Cells of copies beyond each face.
    padding: usize,
    /// The lattice point at which the first of them begins, in the lattice extended by [`ScalarNeed::padding`].
    origin: u32,
    /// Cells along each axis, copies included; below, bricks of them.
    extended: [usize; 3],
    counts: [usize; 3],
}

impl Lattice {
    fn new(dims: [u32; 3], level: u32, need: ScalarNeed, cells: Option<Arc<Level>>) -> Self {
        let padding = need.cut.map_or(need.padding, |cut| cut.padding(level).min(need.padding >> level));
        let dims = dims.map(|d| d.div_ceil(1 << level) as usize);
        let extended = dims.map(|d| d + 2 * padding as usize);
        Self {
            level,
            cells,
            dims,
            padding: padding as usize,
            origin: need.padding - (padding << level),
            extended,
            counts: extended.map(|n| n.div_ceil(EDGE)),
        }
    }

    /// The first cell of a brick; negative among the copies.
    fn first(&self, brick: [usize; 3]) -> [i64; 3] {
        brick.map(|b| (b * EDGE) as i64 - self.padding as i64)
    }
}

impl<'a> Emission<'a> {
    pub(crate) fn new(
        context: &Context,
        volume: &'a Volume,
        transfer: &TransferFunction,
        reduction: &Reduction,
        shows: Shows,
        asked: &Asked,
    ) -> Result<Self> {
        let Asked { need, coarse, .. } = *asked;
        let grid = volume.grid();
        let dims = match coarse {
            Some(coarse) => coarse.grid(grid)?.dims(),
            None => grid.dims(),
        };
        let differences = coarse.map_or([0.5, 0.0, 0.0], Coarse::differences).map(|weight| weight as f32);
        let places = places(dims, need);
        if need.growth > MAX_GROWTH || places > MAX_PLACES.max(2 * volume.grid().len()) {
            let what = format!("post-shading would copy {} layers of voxels beyond the faces", need.padding);
            return Err(too_much(&what, need.growth));
        }
        let mut emission = Self {
            volume,
            relative: Relative::new(volume, *reduction),
            invisible: Invisible::new(transfer, reduction, shows, magnification(&asked.kernel, asked.normalization)),
            savings: context.savings,
            need,
            words: asked.words(),
            dims,
            filters: coarse.map(|coarse| coarse.filters(&asked.kernel, grid)),
            differences,
            active: Vec::new(),
            halo: 0,
            singly: false,
        };
        let halo = need.influence.floor() as usize;
        emission.singly = emission.savings.voxels && halo <= MAX_HALO && need.cut.is_none();
        emission.halo = if emission.singly { halo } else { 0 }.max(if asked.lit { reach_of(differences) } else { 0 });
        let ranges = volume.ranges()?.iter();
        emission.active =
            ranges.map(|range| range.iter().any(|&raw| emission.is_active(emission.relative.to(raw)))).collect();
        Ok(emission)
    }

    /// The splats.
    pub(crate) fn emit(&self, context: &Context, pyramid: &Pyramid, progress: &Progress) -> Result<Drawable> {
        let [finest, coarsest] = self.levels();
        let cells = pyramid.levels(self.volume, &self.relative, coarsest as usize)?;
        let mut stores = StoreBuilder::new(context, 4 * self.words as u64, u32::MAX);
        for level in finest..=coarsest {
            let cells = level.checked_sub(1).and_then(|index| cells.get(index as usize).cloned());
            let lattice = Lattice::new(self.dims, level, self.need, cells);
            let row = |j: usize, k: usize| self.row(&lattice, j, k);
            stores.push_rows(self.volume, lattice.counts, self.halo, (progress, "emitting scalars"), &row)?;
        }
        let scalars = stores.finish()?;
        context.wait("emitting scalars")?;
        Ok(scalars)
    }

    /// Whether a scalar can show.
    fn is_active(&self, scalar: f32) -> bool {
        !self.savings.voxels || !self.invisible.holds(f64::from(scalar))
    }

    /// The finest and the coarsest level that splats are cells of.
    fn levels(&self) -> [u32; 2] {
        self.need.cut.map_or([0, 0], |cut| cut.levels)
    }

    /// Whether any brick of the volume is active that has voxels within the influence of this one.
    fn is_near(&self, lattice: &Lattice, brick: [usize; 3]) -> bool {
        let [across, down, deep] = self.volume.bricks().map(|n| n as usize);
        let reach = self.need.influence.floor() as i64;
        let start = lattice.first(brick);
        let bricks = |axis: usize, n: usize| {
            let at = |place: i64| place.div_euclid(EDGE as i64).clamp(0, n as i64 - 1) as usize;
            let end = start[axis] + EDGE as i64;
            let voxels = match &self.filters {
                Some(filters) => filters.voxels(axis, start[axis] - reach..end + reach),
                None => (start[axis] << lattice.level) - reach..(end << lattice.level) + reach,
            };
            at(voxels.start)..=at(voxels.end - 1)
        };
        let active = |[x, y, z]: [usize; 3]| self.active[x + across * (y + down * z)];
        bricks(2, deep).any(|z| bricks(1, down).any(|y| bricks(0, across).any(|x| active([x, y, z]))))
    }

    /// The bricks along x with these numbers in y and z that can hold splats.
    fn row(&self, lattice: &Lattice, j: usize, k: usize) -> Result<Vec<MadeBrick>> {
        let takes_part = |i| {
            (self.need.cut).is_none_or(|cut: Cut| cut.takes_part(lattice.level, lattice.first([i, j, k]), EDGE))
                && (!self.savings.bricks || self.is_near(lattice, [i, j, k]))
        };
        let bricks: Vec<[usize; 3]> = (0..lattice.counts[0]).filter(|&i| takes_part(i)).map(|i| [i, j, k]).collect();
        let (Some(&leftmost), Some(&rightmost)) = (bricks.first(), bricks.last()) else { return Ok(Vec::new()) };
        let made = |scalars: &dyn Fn([i64; 3]) -> Vec<f32>, flat: &dyn Fn([i64; 3]) -> Vec<bool>| {
            let first = |brick| lattice.first(brick);
            bricks.iter().map(|&b| self.brick(lattice, b, &scalars(first(b)), &flat(first(b)))).collect()
        };
        let some = |_| Vec::new();
        if let Some(cells) = &lattice.cells {
            return Ok(made(&|first| cells.brick(first, self.halo), &some));
        }
        let (first, last) = (lattice.first(leftmost), lattice.first(rightmost));
        if let Some(filters) = &self.filters {
            let halo = self.halo as i64;
            let [first, end] = [first.map(|cell| cell - halo), last.map(|cell| cell + EDGE as i64 + halo)];
            let strip = filters.strip(self.volume, &self.relative, [first, end], self.words == LIT_SCALAR_WORDS)?;
            return Ok(made(&|first| strip.brick(first, self.halo), &|first| strip.flat(first)));
        }
        let strip = self.volume.strip([first[1], first[2]], self.halo)?;
        Ok(made(&|first| bytemuck::pod_collect_to_vec::<u8, f32>(&strip.brick(first, &self.relative)), &some))
    }

    /// How many voxels the scalar of a cell counts for; 0: it takes no part in the picture.
    fn count(&self, lattice: &Lattice, cell: [i64; 3]) -> f64 {
        match self.need.cut {
            None => 1.0,
            Some(cut) if cut.reaches(lattice.level, cell, self.volume.grid().dims()) => {
                f64::from(3 * lattice.level).exp2() * cut.part(lattice.level, cell)
            }
            Some(_) => 0.0,
        }
    }

    /// The splats of a brick, given its scalars with the halo around them, and which have no gradient, if any.
    fn brick(&self, lattice: &Lattice, brick: [usize; 3], scalars: &[f32], flat: &[bool]) -> MadeBrick {
        let (halo, lit) = (self.halo, self.words == LIT_SCALAR_WORDS);
        let kept = self.singly.then(|| {
            let active: Vec<bool> = scalars.iter().map(|&s| self.is_active(s)).collect();
            within_reach(&active, halo, self.need.influence)
        });
        let origin = brick.map(|b| b * EDGE);
        let first = lattice.first(brick);
        let edge = EDGE + 2 * halo;
        let [nx, ny, nz] = [0, 1, 2].map(|axis| EDGE.min(lattice.extended[axis] - origin[axis]));
        // The places along each axis that hold cells of the volume, not copies.
        let voxels = [0, 1, 2].map(|axis| {
            let place = |cell: usize| (cell + lattice.padding).saturating_sub(origin[axis]);
            place(0)..place(lattice.dims[axis])
        });
        // Cells are 2^level voxels apart, and gradients are per voxel.
        let steepness = (-f64::from(lattice.level)).exp2();
        let (mut words, mut copies) = (Vec::new(), 0);
        let mut rows = vec![0; EDGE * EDGE];
        for z in 0..nz {
            for y in 0..ny {
                let start = halo + edge * (y + halo + edge * (z + halo));
                let row = &scalars[start..][..nx];
                let kept = kept.as_ref().map(|kept| &kept[EDGE * (y + EDGE * z)..][..nx]);
                let inside = voxels[1].contains(&y) && voxels[2].contains(&z);
                for (x, &scalar) in row.iter().enumerate() {
                    if kept.is_some_and(|kept| !kept[x]) {
                        continue;
                    }
                    let lit = lit && !flat.get(x + EDGE * (y + EDGE * z)).is_some_and(|&flat| flat);
                    let gradient =
                        if lit { central_differences(scalars, start + x, edge, self.differences) } else { [0.0; 3] };
                    let cell = [0, 1, 2].map(|axis| first[axis] + [x, y, z][axis] as i64);
                    let count = self.count(lattice, cell);
                    if count > 0.0 && (scalar != 0.0 || gradient != [0.0; 3]) {
                        let scalar = (f64::from(scalar) * count) as f32;
                        rows[y + EDGE * z] |= 1 << x;
                        words.push(scalar.to_bits());
                        if self.words == LIT_SCALAR_WORDS {
                            let gradient = gradient.map(|c| (f64::from(c) * steepness * count) as f32);
                            words.extend(packed_gradient(gradient));
                        }
                        copies += u64::from(!inside || !voxels[0].contains(&x));
                    }
                }
            }
        }
        let origin = origin.map(|o| lattice.origin + ((o as u32) << lattice.level));
        let made = MadeBrick::new(origin, &rows, self.words - 1, words);
        MadeBrick { brick: made.brick.of_level(lattice.level), copies, ..made }
    }
}

/// How far from a place gradients take differences.
fn reach_of(weights: [f32; 3]) -> usize {
    weights.iter().rposition(|&weight| weight != 0.0).map_or(0, |last| last + 1)
}

/// The gradient at a place of a brick of `edge` places a side: sums of the differences of places to either side along
/// x, y and z, times these. It is zero where all are equal, so that no light falls there.
fn central_differences(scalars: &[f32], at: usize, edge: usize, weights: [f32; 3]) -> [f32; 3] {
    let weights = &weights[..reach_of(weights)];
    [1, edge, edge * edge].map(|step| {
        // Multiplied first: no difference of numbers overflows.
        let difference = |n: usize, weight: f32| weight * scalars[at + n * step] - weight * scalars[at - n * step];
        (1..).zip(weights).map(|(n, &weight)| difference(n, weight)).sum()
    })
}
