//! The transfer function in the format of shaders: shaders/common/transfer.wgsl.

use super::context::Context;
use crate::transfer::{ControlPoint, Resolution, TransferFunction};
use crate::volume::{RowCoding, ToF64, Volume};

/// Rows of the texture that describe segments, as in shaders/common/transfer.wgsl: before the row of the bins of
/// scalars and the row of the bins of gradients.
const SEGMENT_ROWS: usize = 4;
/// Equal bins of scalars that lead to segments: few enough for the table of a usual function to have less than 64 KiB.
const BINS: usize = 2048;
/// Equal bins of lengths of gradients.
const GRADIENT_BINS: usize = 4096;
/// The largest number of segments: every device has textures of this width.
const MAX_SEGMENTS: usize = 8192;
/// The largest deviation of the function from linear in a segment: a fraction of its value and a fraction of its
/// largest value.
const BEND: [f64; 2] = [3e-4, 1e-5];
/// The largest number of halvings of a segment.
const MAX_HALVINGS: u32 = 10;
/// The share of a bin by which rounding may place a scalar in the bin beside it.
const BIN_ROUNDING: f64 = 0.05;

/// The largest distance of the values of a range from a value.
fn farthest([lowest, highest]: [f64; 2], value: f64) -> f64 {
    (highest - value).abs().max((lowest - value).abs())
}

/// The least scalar of the farthest control point of a function that replaces another one. Smaller ones lose precision,
/// because shaders take differences over 64 for jumps.
const LEAST_EDITED: f64 = 0.125;

/// How values become the scalars of shaders: relative to the transfer function's base, times a power of two that brings
/// the farthest relevant control point to between 1 and 2. Data in any unit give the same scalars.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Reduction {
    base: f64,
    factor: f64,
}

impl Reduction {
    /// The largest scalar. Values beyond are so far from all control points that the field on its way there crosses
    /// these at the same place.
    pub(crate) const LIMIT: f64 = (1_u128 << 64) as f64;

    /// The reduction of values that are at most `largest` from the base.
    pub(crate) fn new(transfer: &TransferFunction, largest: f64) -> Self {
        Self::around(transfer.base(), transfer.extent_or(largest))
    }

    /// The reduction for a function that others replace, given the lowest and the highest value: its base is so far
    /// below the visible values that it serves functions that show lower values too.
    pub(crate) fn for_edits(transfer: &TransferFunction, range: [f64; 2]) -> Self {
        let base = transfer.base();
        let extent = transfer.extent_or(farthest(range, base));
        let below = (base - extent).max(range[0]);
        let base = if below < base && transfer.is_invisible([below, base]) { below } else { base };
        Self::around(base, 2.0 * extent)
    }

    /// Whether scalars serve a function: their base is invisible, and its points are about as far from it as shaders
    /// expect.
    pub(crate) fn serves(&self, transfer: &TransferFunction, range: [f64; 2]) -> bool {
        let base = transfer.base();
        let extent = transfer.extent_or(farthest(range, base));
        let reach = self.length(extent + (self.base - base).abs());
        transfer.is_invisible([self.base.min(base), self.base.max(base)]) && (LEAST_EDITED..=2.0).contains(&reach)
    }

    /// The reduction of values of this extent around a base.
    fn around(base: f64, extent: f64) -> Self {
        let exponent = extent.clamp(f64::MIN_POSITIVE, f64::MAX).log2().floor();
        Self { base, factor: (-exponent).clamp(-1020.0, 1020.0).exp2() }
    }

    /// The value of a scalar of 0.
    pub(crate) fn base(&self) -> f64 {
        self.base
    }

    /// Scalars for each unit of value.
    pub(crate) fn factor(&self) -> f64 {
        self.factor
    }

    /// The value of a scalar.
    pub(crate) fn value(&self, scalar: f32) -> f64 {
        self.base + f64::from(scalar) / self.factor
    }

    /// The scalar of a value.
    #[inline]
    pub(crate) fn scalar(&self, value: f64) -> f32 {
        self.length(value - self.base) as f32
    }

    /// The resolution of a scalar of 0. At least 2^-64, so that no scalar over it leaves the range of f32.
    pub(crate) fn faintest(&self, resolution: &Resolution) -> f32 {
        self.length(resolution.faintest()).max(Self::LIMIT.recip()) as f32
    }

    /// A difference of values in units of scalars.
    #[inline]
    pub(crate) fn length(&self, difference: f64) -> f64 {
        (difference * self.factor).clamp(-Self::LIMIT, Self::LIMIT)
    }
}

/// Samples as scalars.
pub(crate) struct Relative {
    slope: f64,
    intercept: f64,
    reduction: Reduction,
}

impl Relative {
    pub(crate) fn new(volume: &Volume, reduction: Reduction) -> Self {
        let (slope, intercept) = volume.rescale();
        Self { slope, intercept, reduction }
    }

    /// Values as scalars.
    pub(crate) fn of_values(reduction: Reduction) -> Self {
        Self { slope: 1.0, intercept: 0.0, reduction }
    }

    #[inline]
    pub(crate) fn to(&self, raw: f64) -> f32 {
        self.reduction.scalar(self.slope * raw + self.intercept)
    }
}

impl RowCoding for Relative {
    fn append<T: ToF64 + bytemuck::Pod>(&self, samples: &[T], bytes: &mut Vec<u8>) {
        bytes.extend(samples.iter().flat_map(|s| self.to(s.to_f64()).to_ne_bytes()));
    }
}

/// The visible values of a scalar field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum VisibleValues {
    /// All values with opacity.
    Opaque,
    /// The largest value, if it has opacity. Smaller values matter only because they are not larger.
    Largest,
    /// The mean of all values.
    Mean,
}

/// The table by which shaders classify scalars.
pub(crate) struct TransferTable {
    /// Segments between knots, and bins that lead to them.
    pub(crate) texture: wgpu::TextureView,
    /// The range of invisible scalars around 0, ends included; empty if the first is larger.
    pub(crate) invisible: [f32; 2],
    /// The place of a scalar among the bins is the scalar times the first, plus the second.
    pub(crate) lookup: [f32; 2],
    /// Whether a bin lies in more than two segments.
    pub(crate) crowded: bool,
    /// Whether extinction depends on gradients, and the place of a gradient's length among its bins: length times this.
    pub(crate) thins: bool,
    pub(crate) gradient_lookup: f32,
    /// The resolution of a scalar of 0, over 0.
    pub(crate) faintest: f32,
}

impl TransferTable {
    /// Opacities are per `unit`, in local lengths (see [`Grid::local`](crate::volume::Grid)): so is extinction. A value
    /// per world unit is `steepness` as the painters reconstruct gradients of values.
    pub(crate) fn new(
        context: &Context,
        transfer: &TransferFunction,
        reduction: &Reduction,
        shows: VisibleValues,
        unit: f64,
        steepness: f64,
        resolution: &Resolution,
    ) -> Self {
        let value = |color: [f64; 3], opacity: f64| match shows {
            VisibleValues::Opaque => {
                let extinction = TransferFunction::extinction(opacity, unit);
                let [r, g, b] = color.map(|c| c * extinction);
                [r, g, b, extinction]
            }
            VisibleValues::Largest | VisibleValues::Mean => {
                let [r, g, b] = color;
                [r, g, b, opacity / transfer.max_opacity().max(f64::MIN_POSITIVE)]
            }
        };
        let segments = Segments::new(transfer.knots(), reduction, &value);
        let (mut rows, lookup, crowded) = segments.rows();
        let steepest = transfer.gradient_opacity().last().map_or(0.0, |p| p.magnitude);
        let thins = !transfer.gradient_opacity().is_empty();
        let share = |place: usize| transfer.gradient_share(steepest * place as f64 / GRADIENT_BINS as f64) as f32;
        let bin = |bin: usize| [share(bin), share(bin + 1), 0.0, 0.0];
        rows.push(if thins { (0..GRADIENT_BINS).map(bin).collect() } else { Vec::new() });
        let most = steepest * steepness * reduction.factor;
        let gradient_lookup = if most > 0.0 { GRADIENT_BINS as f64 / most } else { 0.0 };
        let around = transfer.invisible_around(reduction.base);
        let end =
            |value: f64| if value.is_finite() { reduction.scalar(value) } else { value.signum() as f32 * f32::MAX };
        Self {
            texture: context.float_rows("shade.transfer", &rows),
            invisible: around.map_or([1.0, -1.0], |ends| ends.map(end)),
            lookup,
            crowded,
            thins,
            gradient_lookup: gradient_lookup.min(f64::from(f32::MAX)) as f32,
            faintest: reduction.faintest(resolution),
        }
    }
}

/// Colour times extinction, and extinction; of maxima and means colour and alpha.
type Value = [f64; 4];

fn mixed(a: Value, b: Value, f: f64) -> Value {
    std::array::from_fn(|c| a[c] + (b[c] - a[c]) * f)
}

/// A piece of the transfer function that counts as linear: from its start to the start of the next.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Segment {
    start: f64,
    /// The function at its start, and at its end.
    values: [Value; 2],
}

/// The whole transfer function, from the lowest scalar to the largest.
struct Segments(Vec<Segment>);

impl Segments {
    fn new(points: &[ControlPoint], reduction: &Reduction, value: &dyn Fn([f64; 3], f64) -> Value) -> Self {
        // At most as many segments as a texture holds; with more, the function between control points is less exact.
        let made = (0..)
            .map(|coarser| Self::within(points, reduction, value, BEND.map(|bend| bend * 4_f64.powi(coarser))))
            .find(|made| made.0.len() <= MAX_SEGMENTS);
        made.unwrap_or(Self(Vec::new()))
    }

    /// Segments in which the function is linear to within `bend`.
    fn within(
        points: &[ControlPoint],
        reduction: &Reduction,
        value: &dyn Fn([f64; 3], f64) -> Value,
        bend: [f64; 2],
    ) -> Self {
        let at = |p: &ControlPoint| value(p.color, p.opacity);
        let scalar = |p: &ControlPoint| f64::from(reduction.scalar(p.value));
        let (Some(first), Some(last)) = (points.first(), points.last()) else { return Self(Vec::new()) };
        let most = points.iter().map(|p| at(p)[3]).fold(0.0, f64::max);
        let mut segments = vec![Segment { start: f64::from(f32::MIN), values: [at(first); 2] }];
        for pair in points.windows(2) {
            let [a, b] = pair else { continue };
            let between = |f: f64| {
                let color = std::array::from_fn(|c| a.color[c] + (b.color[c] - a.color[c]) * f);
                value(color, a.opacity + (b.opacity - a.opacity) * f)
            };
            let allowed = |value: Value| bend[0] * value[3] + bend[1] * most;
            let [from, to] = [scalar(a), scalar(b)];
            let mut pending = vec![(0.0, 1.0, MAX_HALVINGS)];
            while let Some((low, high, halvings)) = pending.pop() {
                let start = from + (to - from) * low;
                let (middle, values) = (f64::midpoint(low, high), [low, high].map(between));
                let (exact, linear) = (between(middle), mixed(values[0], values[1], 0.5));
                let bent = (0..4).any(|c| (exact[c] - linear[c]).abs() > allowed(exact));
                if bent && halvings > 0 && from < to {
                    pending.extend([(middle, high, halvings - 1), (low, middle, halvings - 1)]);
                } else {
                    segments.push(Segment { start: f64::from(start as f32), values });
                }
            }
        }
        segments.push(Segment { start: scalar(last), values: [at(last); 2] });
        // Of knots that are one number in shaders, the last holds from there on.
        let mut kept: Vec<Segment> = Vec::with_capacity(segments.len());
        for segment in segments {
            if kept.last().is_some_and(|before| segment.start <= before.start) {
                kept.pop();
            }
            kept.push(segment);
        }
        Self(kept)
    }

    /// Where each segment ends.
    fn ends(&self) -> impl Iterator<Item = f64> {
        self.0.iter().skip(1).map(|next| next.start).chain([f64::from(f32::MAX)])
    }

    /// The integral of the function from the first knot to the start of each segment.
    fn integrals(&self) -> Vec<Value> {
        let mut sum = [0.0; 4];
        let inner = self.0.iter().zip(self.ends()).skip(1).map(|(segment, end)| {
            let before = sum;
            let mean = mixed(segment.values[0], segment.values[1], 0.5);
            sum = std::array::from_fn(|c| sum[c] + mean[c] * (end - segment.start));
            before
        });
        [[0.0; 4]].into_iter().chain(inner).collect()
    }

    /// The rows of the texture but for gradients, the place of scalars among the bins, and whether a bin lies in more
    /// than two segments.
    fn rows(&self) -> (Vec<Vec<[f32; 4]>>, [f32; 2], bool) {
        let Self(segments) = self;
        // Integrals begin at the base, where scalars are the most precise.
        let integrals = self.integrals();
        // The first segment has no start: its integral begins at its end.
        let start = |index: usize| segments[index.max(1).min(segments.len() - 1)].start;
        let origin = integrals[segments.partition_point(|s| s.start <= 0.0).saturating_sub(1)];
        let mut rows = vec![Vec::new(); SEGMENT_ROWS];
        for (index, (segment, end)) in segments.iter().zip(self.ends()).enumerate() {
            let [value, last] = segment.values;
            let slope = std::array::from_fn(|c| (last[c] - value[c]) / (end - segment.start));
            let integral = std::array::from_fn(|c| integrals[index][c] - origin[c]);
            for (row, texel) in rows.iter_mut().zip([value, slope, integral, [start(index); 4]]) {
                row.push(texel.map(|c| c.clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32));
            }
        }
        let knots: Vec<f64> = segments.iter().skip(1).map(|s| s.start).collect();
        let (low, high) = (knots.first().copied().unwrap_or(0.0), knots.last().copied().unwrap_or(0.0));
        // Bins wide enough for rounding to place scalars in the right one.
        let span = (high - low).max(low.abs().max(high.abs()) / 16.0).max(1e-6);
        let scale = BINS as f64 / span;
        let segment = |place: f64| knots.partition_point(|knot| (knot - low) * scale <= place);
        let mut crowded = false;
        let bin = |bin: usize| {
            let first = if bin == 0 { 0 } else { segment(bin as f64 - BIN_ROUNDING) };
            let last = if bin + 1 == BINS { knots.len() } else { segment(bin as f64 + 1.0 + BIN_ROUNDING) };
            let next = knots.get(first).map_or(f32::MAX, |&knot| knot as f32);
            crowded |= last > first + 1;
            [first as f32, last as f32, start(first) as f32, next]
        };
        rows.push((0..BINS).map(bin).collect());
        (rows, [scale as f32, (-low * scale) as f32], crowded)
    }
}
