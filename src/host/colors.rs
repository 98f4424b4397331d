//! Pre-shading along rays: fields of colour times extinction, and extinction, are composited.

use pulp::{Simd, WithSimd};
use rayon::prelude::*;
use voxsplat_volume::memory::zeroed;

use super::blend::{Along, Blend};
use super::field::{self, CELL};
use super::filter::{Around, MAX_REACH, RowFilter, add_rows};
use super::lanes::{Lanes, WIDTH, dispatch, three};
use super::light::Vector;
use super::plane::{Area, CHANNELS, Plane, Reach};
use super::rays::{Axes, Rays};
use super::rule::{RECENT, Rule};
use crate::error::Result;
use crate::kernel::SplineFilter;
use crate::progress::Progress;

/// A coefficient: four f16.
type Halves = [u16; CHANNELS];

/// Planes of coefficients that a thread makes at a time: whole cells.
const PLANES: usize = 2 * CELL;

/// An f16 that is normal or 0, as f32.
#[inline(always)]
pub(super) fn from_half(half: u16) -> f32 {
    // The exponents of f32 are larger by 112.
    const FACTOR: f32 = f32::from_bits((112 + 127) << 23);
    let size = f32::from_bits(u32::from(half & 0x7fff) << 13) * FACTOR;
    f32::from_bits(size.to_bits() | u32::from(half & 0x8000) << 16)
}

/// The f16 nearest to a number; numbers under the least normal f16 are 0.
#[inline(always)]
fn half(value: f32) -> u16 {
    let bits = value.to_bits().wrapping_add(0x1000);
    let size = bits & 0x7fff_ffff;
    let normal = size.wrapping_sub(0x3800_0000) >> 13;
    let size = if size < 0x3880_0000 { 0 } else { normal };
    (bits >> 16 & 0x8000 | size) as u16
}

/// Planes of voxels of four channels, side by side in rows: what coefficients are made from.
pub(super) struct Voxels {
    /// Numbers of a row of one channel, with the margins.
    width: usize,
    margin: usize,
    rows: Vec<f32>,
    /// The first and the last column with a voxel of each row; the first is larger if there is none.
    extents: Vec<[usize; 2]>,
}

impl Voxels {
    const EMPTY: [usize; 2] = [usize::MAX, 0];

    pub(super) fn new([nx, ny]: [usize; 2], margin: usize) -> Result<Self> {
        // Vectors reach beyond the end of a row.
        let width = (nx + 2 * margin).next_multiple_of(WIDTH) + WIDTH;
        let rows = planes_of(width, ny)?;
        Ok(Self { width, margin, rows, extents: vec![Self::EMPTY; ny] })
    }

    fn clear(&mut self) {
        let Self { width, margin, rows, extents, .. } = self;
        for (row, extent) in rows.chunks_exact_mut(CHANNELS * *width).zip(extents) {
            if extent[0] <= extent[1] {
                row.chunks_exact_mut(*width).for_each(|row| row[*margin + extent[0]..=*margin + extent[1]].fill(0.0));
            }
            *extent = Self::EMPTY;
        }
    }

    /// Puts a voxel into a row.
    #[inline]
    pub(super) fn put(&mut self, row: usize, column: usize, channels: [f32; CHANNELS]) {
        let at = row * CHANNELS * self.width + self.margin + column;
        for (channel, value) in channels.into_iter().enumerate() {
            self.rows[at + channel * self.width] = value;
        }
        let [first, last] = self.extents[row];
        self.extents[row] = [first.min(column), last.max(column)];
    }

    /// The voxels of a plane of `columns` columns without margins, x fastest.
    pub(super) fn plane(&self, columns: usize) -> Vec<[f32; CHANNELS]> {
        let voxel = |row: usize, column: usize| {
            let at = row * CHANNELS * self.width + self.margin + column;
            [0, 1, 2, 3].map(|channel| self.rows[at + channel * self.width])
        };
        (0..self.extents.len()).flat_map(|row| (0..columns).map(move |column| voxel(row, column))).collect()
    }

    /// Whether a row has a voxel.
    #[inline(always)]
    fn has(&self, row: usize) -> bool {
        self.extents[row][0] <= self.extents[row][1]
    }

    /// The rows of the channels.
    #[inline(always)]
    fn row(&self, row: usize) -> &[f32] {
        &self.rows[row * CHANNELS * self.width..][..CHANNELS * self.width]
    }
}

/// Zeros for a plane of rows of each channel, and for a vector more.
fn planes_of(width: usize, rows: usize) -> Result<Vec<f32>> {
    let count = CHANNELS * width * rows + WIDTH;
    Ok(zeroed(count as u64, || "planes of voxels".to_owned())?)
}

/// Coefficients over a lattice and some points around it, x fastest. Voxels beyond the lattice are empty.
pub(super) struct ColorField {
    padded: [usize; 3],
    /// Coefficients beyond each face.
    pad: usize,
    coefficients: Vec<Halves>,
    cells: [usize; 3],
    /// Whether a cell has a coefficient other than 0.
    shows: Vec<bool>,
    /// The reach of the filter.
    filter_reach: usize,
}

/// Bytes of the coefficients of a lattice.
pub(super) fn bytes(dims: [u32; 3]) -> u64 {
    field::bytes(dims) / size_of::<f32>() as u64 * size_of::<Halves>() as u64
}

impl ColorField {
    /// Filters voxels, which `plane` puts into empty planes.
    ///
    /// # Errors
    /// [`Error::Memory`](crate::Error::Memory) if the coefficients cannot be allocated.
    pub(super) fn new(
        (dims, pad): ([usize; 3], usize),
        filter: &SplineFilter,
        plane: &(dyn Fn(usize, &mut Voxels) + Sync),
        progress: &Progress,
    ) -> Result<Self> {
        let padded = dims.map(|d| d + 2 * pad);
        let area = padded[0] * padded[1];
        let count = area * padded[2];
        // Zeros that nothing is written over take no memory.
        let mut coefficients: Vec<Halves> = zeroed(count as u64, || "the coefficients of colours".to_owned())?;
        let cells = padded.map(|d| d.div_ceil(CELL));
        let mut shows = vec![false; cells.iter().product()];
        let filter = RowFilter::new(filter);
        let reach = filter.reach;
        let slabs = coefficients.par_chunks_mut(PLANES * area);
        let slabs = slabs.zip(shows.par_chunks_mut(PLANES / CELL * cells[0] * cells[1])).enumerate();
        slabs.try_for_each(|(slab, (coefficients, shows))| {
            progress.check()?;
            // The planes of voxels around a plane, at the remainder of their number.
            let kept = 2 * reach + 1;
            let make = |_| Voxels::new([dims[0], dims[1]], 2 * reach);
            let mut planes = (0..kept).map(make).collect::<Result<Vec<_>>>()?;
            let width = planes[0].width;
            let pair = |_| Ok((planes_of(width, dims[1])?, vec![false; dims[1]]));
            let mut pairs = (0..reach).map(pair).collect::<Result<Vec<_>>>()?;
            let mut next = isize::MIN;
            for (number, coefficients) in coefficients.chunks_exact_mut(area).enumerate() {
                let z = (slab * PLANES + number) as isize - pad as isize;
                let (first, last) = (z - reach as isize, z + reach as isize);
                if last < 0 || first >= dims[2] as isize {
                    continue;
                }
                for z in next.max(first)..=last {
                    let voxels = &mut planes[z.rem_euclid(kept as isize) as usize];
                    voxels.clear();
                    if let Ok(z) = usize::try_from(z)
                        && z < dims[2]
                    {
                        plane(z, voxels);
                    }
                }
                next = last + 1;
                let shows = &mut shows[number / CELL * cells[0] * cells[1]..][..cells[0] * cells[1]];
                let at = z.rem_euclid(kept as isize) as usize;
                let (planes, pairs, across) = (&planes, &mut pairs, cells[0]);
                dispatch(Filtering { filter: &filter, padded, pad, planes, at, pairs, coefficients, shows, across });
            }
            Ok::<_, crate::error::Error>(())
        })?;
        Ok(Self { padded, pad, coefficients, cells, shows, filter_reach: reach })
    }

    /// Bytes of memory.
    pub(super) fn bytes(&self) -> u64 {
        size_of_val(self.coefficients.as_slice()) as u64
    }

    /// Whether a coefficient in a box, ends included, is not 0.
    pub(super) fn shows(&self, low: [isize; 3], high: [isize; 3]) -> bool {
        let cell =
            |place: isize, axis: usize| ((place + self.pad as isize).max(0) as usize / CELL).min(self.cells[axis] - 1);
        let [x, y, z] = [0, 1, 2].map(|axis| cell(low[axis], axis)..cell(high[axis], axis) + 1);
        z.clone().any(|z| {
            y.clone().any(|y| {
                let row = (z * self.cells[1] + y) * self.cells[0];
                self.shows[row + x.start..row + x.end].contains(&true)
            })
        })
    }

    /// The distances of neighbouring coefficients along the axes.
    fn steps(&self) -> [usize; 3] {
        [1, self.padded[0], self.padded[0] * self.padded[1]]
    }

    /// The place of the coefficient of a lattice point; points farther than all coefficients count as the farthest.
    fn index(&self, point: [isize; 3]) -> usize {
        let steps = self.steps();
        let place = |axis: usize| (point[axis] + self.pad as isize).clamp(0, self.padded[axis] as isize - 1) as usize;
        (0..3).map(|axis| place(axis) * steps[axis]).sum()
    }
}

/// Sums planes of coefficients at plane `number` of a tile: weights 1, 4, 1 over 6.
#[inline(always)]
fn make(
    plane: &mut Plane,
    (blend, along): (&Blend<'_, ColorField>, &Along),
    (axes, area): (&Axes, &Area),
    number: isize,
) {
    let [width, height] = area.size();
    let stride = plane.resize(area);
    if plane.rows.len() < (CHANNELS + 1) * stride {
        plane.rows.resize((CHANNELS + 1) * stride, 0.0);
    }
    let field = blend.levels[0].1;
    let steps = field.steps();
    let [step_a, step_b] = [steps[axes.axes[0]], steps[axes.axes[1]]];
    let mut starts = [0; 3];
    for (offset, start) in starts.iter_mut().enumerate() {
        let mut point = [0; 3];
        point[axes.axes[0]] = area.low[0];
        point[axes.axes[1]] = area.low[1];
        point[axes.axes[2]] = axes.plane(number + offset as isize - 1);
        *start = field.index(point);
    }
    let [first, last] = blend.needed(along, [area.low, area.high], number as f64);
    let (weights, part) = plane.rows.split_at_mut(stride);
    for row in 0..height {
        let channels = &mut plane.channels[CHANNELS * row * stride..][..CHANNELS * width];
        for level in first..=last {
            let coefficients = &blend.levels[level].1.coefficients;
            let planes = starts.map(|start| &coefficients[start + row * step_b..]);
            if first == last {
                sum_planes(planes, step_a, channels);
                continue;
            }
            sum_planes(planes, step_a, &mut part[..CHANNELS * width]);
            let from = [area.low[0] as f64, (area.low[1] + row as isize) as f64, number as f64];
            blend.weights(along, level, from, &mut weights[..width]);
            let (channels, part) = (channels.as_chunks_mut::<CHANNELS>().0, part.as_chunks::<CHANNELS>().0);
            for x in 0..width {
                for channel in 0..CHANNELS {
                    let before = if level == first { 0.0 } else { channels[x][channel] };
                    channels[x][channel] = weights[x].mul_add(part[x][channel], before);
                }
            }
        }
    }
}

/// Sums rows of three planes, whose points lie `step` apart.
#[inline(always)]
fn sum_planes([b, m, a]: [&[Halves]; 3], step: usize, channels: &mut [f32]) {
    let count = channels.len();
    let width = count / CHANNELS;
    if step == 1 {
        let (b, m, a) = (b[..width].as_flattened(), m[..width].as_flattened(), a[..width].as_flattened());
        let (b, m, a) = (&b[..count], &m[..count], &a[..count]);
        for x in 0..count {
            let sum = from_half(b[x]) + from_half(a[x]);
            channels[x] = sum.mul_add(1.0 / 6.0, from_half(m[x]) * (4.0 / 6.0));
        }
    } else {
        let (channels, _) = channels.as_chunks_mut::<CHANNELS>();
        for x in 0..width {
            let at = x * step;
            for channel in 0..CHANNELS {
                let sum = from_half(b[at][channel]) + from_half(a[at][channel]);
                channels[x][channel] = sum.mul_add(1.0 / 6.0, from_half(m[at][channel]) * (4.0 / 6.0));
            }
        }
    }
}

/// The filter of a plane.
struct Filtering<'a> {
    filter: &'a RowFilter,
    padded: [usize; 3],
    pad: usize,
    /// The planes of voxels around it, and which of them is its own.
    planes: &'a [Voxels],
    at: usize,
    /// Planes at each distance before and behind it, added up, and whether a row has voxels.
    pairs: &'a mut [(Vec<f32>, Vec<bool>)],
    coefficients: &'a mut [Halves],
    /// The marks of its cells, `across` in a row.
    shows: &'a mut [bool],
    across: usize,
}

impl WithSimd for Filtering<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { filter, padded, pad, planes, at, pairs, coefficients, shows, across } = self;
        let (reach, kept) = (filter.reach, planes.len());
        let Voxels { width, margin, .. } = planes[0];
        let ny = planes[0].extents.len();
        for (number, (sums, has)) in pairs.iter_mut().enumerate() {
            let [before, behind] = [(at + kept - number - 1) % kept, (at + number + 1) % kept].map(|at| &planes[at]);
            for row in 0..ny {
                has[row] = before.has(row) || behind.has(row);
                if has[row] {
                    let sums = &mut sums[CHANNELS * width * row..][..CHANNELS * width];
                    add_rows(before.row(row), behind.row(row), sums);
                }
            }
        }
        let empty = vec![0.0_f32; width];
        let mut sums = vec![0.0_f32; (MAX_REACH + 1) * (width + WIDTH)];
        let mut filtered = vec![0.0_f32; CHANNELS * width];
        for row in 0..ny + 2 * reach {
            let y = row as isize - reach as isize;
            let rows = (y - reach as isize).max(0) as usize..((y + reach as isize + 1).min(ny as isize)) as usize;
            let mut extent = Voxels::EMPTY;
            for voxels in planes {
                for row in rows.clone() {
                    let [first, last] = voxels.extents[row];
                    extent = [extent[0].min(first), extent[1].max(last)];
                }
            }
            let [first, last] = extent;
            if first > last {
                continue;
            }
            // Coefficients reach as far as the filter beyond voxels; margins are twice as wide.
            let from = margin + first - reach;
            let count = last - first + 1 + 2 * reach;
            for channel in 0..CHANNELS {
                let begin = channel * width + from - reach;
                let mut around: Around<'_> = Default::default();
                for (k, around) in around.iter_mut().take(reach + 1).enumerate() {
                    for (j, place) in around.iter_mut().take(2 * reach + 1).enumerate() {
                        let row = y + j as isize - reach as isize;
                        *place = &empty[from - reach..];
                        if row < 0 || row >= ny as isize {
                            continue;
                        }
                        let row = row as usize;
                        if k == 0 && planes[at].has(row) {
                            *place = &planes[at].row(row)[begin..];
                        } else if k > 0 && pairs[k - 1].1[row] {
                            *place = &pairs[k - 1].0[CHANNELS * width * row + begin..];
                        }
                    }
                }
                filter.apply(simd, &around, &mut sums, &mut filtered[channel * width..][..count]);
            }
            let y = (y + pad as isize) as usize;
            let column = pad + first - reach;
            let out = &mut coefficients[y * padded[0] + column..][..count];
            let (r, g) = (&filtered[..count], &filtered[width..][..count]);
            let (b, a) = (&filtered[2 * width..][..count], &filtered[3 * width..][..count]);
            for x in 0..count {
                out[x] = [half(r[x]), half(g[x]), half(b[x]), half(a[x])];
            }
            shows[y / CELL * across..][column / CELL..=(column + count - 1) / CELL].fill(true);
        }
    }
}

/// What pre-shaded pictures are made of.
pub(super) struct Colors<'a> {
    pub(super) blend: Blend<'a, ColorField>,
    /// Whether optical depths are wanted alone.
    pub(super) is_xray: bool,
}

impl Colors<'_> {
    /// Splines reach 2 voxels, coefficients as far as the filter.
    pub(super) fn reach(&self) -> Reach {
        let reach = self.blend.levels.iter().map(|(_, field)| field.filter_reach).max().unwrap_or_default();
        Reach { beyond: (reach + 2) as f64, around: 0 }
    }

    /// Whether a coefficient in a box of the lattice, ends included, is not 0.
    pub(super) fn shows(&self, low: [isize; 3], high: [isize; 3]) -> bool {
        self.blend.levels.iter().any(|(_, field)| field.shows(low, high))
    }
}

/// A group on its way.
#[derive(Clone, Copy)]
pub(super) struct State<S: Simd> {
    color: Vector<S>,
    depth: Lanes<S>,
    transmittance: Lanes<S>,
    /// The last samples: of sample n at n modulo 4.
    samples: [[Lanes<S>; CHANNELS]; RECENT],
    /// The numbers of the last two samples.
    last: [isize; 2],
}

/// The compositing of the rays of a tile.
pub(super) struct Blending<'a, S: Simd> {
    colors: &'a Colors<'a>,
    axes: Axes,
    along: Along,
    zero: Lanes<S>,
}

impl<'a, S: Simd> Blending<'a, S> {
    #[inline(always)]
    pub(super) fn new(simd: S, colors: &'a Colors<'a>, axes: &Axes) -> Self {
        Self { colors, axes: *axes, along: colors.blend.along(axes), zero: Lanes::all(simd, 0.0) }
    }
}

impl<S: Simd> Rule<S> for Blending<'_, S> {
    type State = State<S>;

    const BEHIND: usize = 1;
    const STEP: f64 = 1.0;
    const AROUND: [isize; 2] = [0, 0];

    #[inline(always)]
    fn start(&self, simd: S) -> State<S> {
        let zero = self.zero;
        State {
            color: [zero; 3],
            depth: zero,
            transmittance: Lanes::all(simd, 1.0),
            samples: [[zero; CHANNELS]; RECENT],
            last: [isize::MIN / 2; 2],
        }
    }

    #[inline(always)]
    fn make(&self, _: S, plane: &mut Plane, area: &Area, number: usize) {
        let before = self.colors.reach().beyond as isize;
        make(plane, (&self.colors.blend, &self.along), (&self.axes, area), number as isize - before);
    }

    #[inline(always)]
    fn sampled(&self, state: &mut State<S>, number: usize, channels: [Lanes<S>; CHANNELS]) {
        if state.last[0] < number as isize - 1 {
            state.samples[(number + RECENT - 1) % RECENT] = [self.zero; CHANNELS];
        }
        state.samples[number % RECENT] = channels;
        state.last = [number as isize, state.last[0]];
    }

    #[inline(always)]
    fn passed(&self, _: S, state: &mut State<S>, number: usize) {
        if state.last[0] >= number as isize - 1 {
            state.samples[number % RECENT] = [self.zero; CHANNELS];
        }
    }

    /// Colour is linear in optical depth within a slab, as `advance` in shaders/common/march.wgsl has it.
    #[inline(always)]
    fn slab(&self, simd: S, state: &mut State<S>, rays: &Rays<S>, (number, z): (usize, f32), _: bool) -> bool {
        if !state.last.contains(&(number as isize)) {
            return false;
        }
        let zero = self.zero;
        let before = state.samples[(number + RECENT - 1) % RECENT];
        let mut own = state.samples[number % RECENT];
        let behind = state.samples[(number + 1) % RECENT];
        let mut length = rays.length;
        let (low, high) = (Lanes::all(simd, z - 0.5), Lanes::all(simd, z + 0.5));
        if low.less(simd, rays.ends[0]).any(simd) || rays.ends[1].less(simd, high).any(simd) {
            // The part that counts, by the parabola at its middle.
            let first = rays.ends[0].max(simd, low).min(simd, high);
            let last = rays.ends[1].min(simd, high).max(simd, low);
            let half = Lanes::all(simd, 0.5);
            length = length.mul(simd, last.sub(simd, first).max(simd, zero));
            let place = first.add(simd, last).mul(simd, half).sub(simd, Lanes::all(simd, z));
            for channel in 0..CHANNELS {
                let (b, m, a) = (before[channel], own[channel], behind[channel]);
                let slope = a.sub(simd, b).mul(simd, half);
                let bend = m.fma(simd, Lanes::all(simd, -2.0), a.add(simd, b)).mul(simd, half);
                own[channel] = place.fma(simd, bend, slope).fma(simd, place, m);
            }
        }
        let depth = own[3].mul(simd, length).max(simd, zero);
        if depth.largest(simd) <= 0.0 {
            return false;
        }
        state.depth = state.depth.add(simd, depth);
        if self.colors.is_xray {
            return true;
        }
        let all = |value: f32| Lanes::all(simd, value);
        let one = all(1.0);
        let left = state.transmittance;
        let passed = left.mul(simd, depth.exp_neg(simd));
        let series = one.sub(simd, depth.mul(simd, all(0.25)));
        let series = one.sub(simd, depth.mul(simd, all(1.0 / 3.0)).mul(simd, series));
        let series = one.sub(simd, depth.mul(simd, all(0.5)).mul(simd, series));
        let is_thin = depth.less(simd, all(0.06));
        let mean = left.sub(simd, passed).div(simd, depth.max(simd, all(1e-30)));
        let mean = left.mul(simd, series).or(simd, is_thin, mean).mul(simd, length);
        let denominator = depth.fma(simd, depth.fma(simd, all(2.0), all(6.0)), all(12.0));
        let bend = left.mul(simd, all(0.5)).div(simd, denominator).mul(simd, length);
        let change = behind[3].sub(simd, before[3]).mul(simd, rays.length);
        state.color = three!(channel => {
            let differs = behind[channel].sub(simd, before[channel]).mul(simd, depth);
            let bent = own[channel].mul(simd, change).sub(simd, differs);
            own[channel].fma(simd, mean, bend.fma(simd, bent, state.color[channel]))
        });
        state.transmittance = passed;
        true
    }

    #[inline(always)]
    fn most_left(&self, simd: S, state: &State<S>) -> f32 {
        state.transmittance.largest(simd)
    }

    /// The colours and the alpha; of an X-ray the optical depth four times.
    #[inline(always)]
    fn pixel(&self, simd: S, state: &State<S>) -> [Lanes<S>; 4] {
        if self.colors.is_xray {
            return [state.depth; 4];
        }
        let [r, g, b] = state.color;
        [r, g, b, Lanes::all(simd, 1.0).sub(simd, state.depth.exp_neg(simd))]
    }
}
