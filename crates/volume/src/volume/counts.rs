//! Histograms of samples that are read in parts, from which the statistics of a volume follow.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::{ToF64, Volume, with_samples};
use crate::error::Result;
use crate::parallel::try_map;

/// The largest number of bins: one per value of 8 and 16 bit samples.
const MAX_BINS: usize = 65_536;
/// The least number of samples per task. A task owns up to 512 KiB of bins, so small tasks would mostly clear and add
/// bins.
const MIN_CHUNK: usize = 1 << 20;

/// Counts of samples before rescaling. Counts of the parts of a volume add up to the counts of the volume: in the same
/// bins, whatever the parts. NaN and infinite samples are only counted.
///
/// Integers of up to 16 bits are counted by value in one pass. Samples of other types take two: the first finds their
/// range, the second counts them in bins of the range of all parts.
///
/// ```
/// use voxsplat_volume::volume::{Counts, Statistics, Volume};
///
/// # fn main() -> Result<(), voxsplat_volume::Error> {
/// let parts = [[0.0, 0.5], [3.0, 1.5]];
/// let left = Volume::from_slice([2, 1, 1], [1.0; 3], &parts[0])?;
/// let right = Volume::from_slice([2, 1, 1], [1.0; 3], &parts[1])?;
/// let mut counts = Counts::of(&left)?.plus(Counts::of(&right)?);
/// if !counts.is_complete() {
///     counts = counts.refined(&left)?.plus(counts.refined(&right)?);
/// }
/// let whole = Volume::from_slice([4, 1, 1], [1.0; 3], parts.as_flattened())?;
/// assert_eq!(Statistics::of_counts(&counts, (1.0, 0.0)).histogram(), Statistics::of(&whole)?.histogram());
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Counts {
    /// The smallest and the largest finite sample; `None`: there is none.
    pub(super) range: Option<[f64; 2]>,
    /// The number of finite samples.
    pub(super) count: u64,
    /// The number of NaN and infinite samples.
    pub(super) non_finite: u64,
    binned: Option<Binned>,
}

/// The numbers of samples in bins.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Binned {
    bins: SampleBins,
    counts: Vec<u64>,
    /// The moments of the samples; `None` for bins of one value each, whose counts have them.
    moments: Option<Moments>,
}

/// The bins of samples that are multiplied by `scale`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct SampleBins {
    /// The value at which the first bin begins, or its only value.
    least: f64,
    step: f64,
    len: usize,
    scale: f64,
    /// Whether a bin has one value.
    is_exact: bool,
}

/// The mean of samples, and the sum of the squares of their distances from it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Moments {
    count: u64,
    mean: f64,
    squares: f64,
}

/// The bins from the smallest to the largest sample.
#[derive(Debug, Clone)]
pub(super) struct Occupied {
    pub(super) bins: Vec<u64>,
    /// The value of the first bin times `scale`: bin i counts the values nearest to `(first + i * step) / scale`.
    pub(super) first: f64,
    pub(super) step: f64,
    pub(super) scale: f64,
    /// The mean of the samples times `scale`.
    pub(super) mean: f64,
    /// The sum of squared distances of the samples from their mean, times the square of `scale`.
    pub(super) squares: f64,
}

impl Default for Occupied {
    fn default() -> Self {
        let [first, step, mean, squares] = [f64::NAN; 4];
        Self { bins: Vec::new(), first, step, scale: 1.0, mean, squares }
    }
}

/// Returns a power of two that scales values of a range so that f64 holds their squares and sums; 1 for values of usual
/// size.
pub(super) fn scale_for(min: f64, max: f64) -> f64 {
    let largest = min.abs().max(max.abs());
    if largest == 0.0 || !largest.is_finite() || (1e-100..1e100).contains(&largest) {
        return 1.0;
    }
    libm::exp2(-libm::log2(largest).floor().clamp(-1000.0, 1000.0))
}

impl SampleBins {
    /// Returns the bins of a range: one per integer if they are few.
    fn of_range([least, largest]: [f64; 2], integers: bool) -> Self {
        let scale = scale_for(least, largest);
        let [least, range] = [least * scale, largest * scale - least * scale];
        let is_exact = range == 0.0 || integers && range < MAX_BINS as f64;
        let (len, step) = if is_exact { (range as usize + 1, 1.0) } else { (MAX_BINS, range / MAX_BINS as f64) };
        Self { least, step, len, scale, is_exact }
    }

    /// Counts the finite samples of a slice.
    fn count<T: ToF64>(self, samples: &[T], into: &mut Binned) {
        let finite = || samples.iter().map(|v| v.to_f64()).filter(|v| v.is_finite()).map(|v| v * self.scale);
        let bin = |v: f64| (((v - self.least) / self.step) as usize).min(self.len - 1);
        if self.is_exact {
            finite().for_each(|v| into.counts[bin(v)] += 1);
            return;
        }
        let (count, sum) = finite().fold((0_u64, 0.0), |(count, sum), v| (count + 1, sum + v));
        let mean = if count > 0 { sum / count as f64 } else { 0.0 };
        let add = |squares: f64, v: f64| {
            into.counts[bin(v)] += 1;
            squares + (v - mean) * (v - mean)
        };
        let squares = finite().fold(0.0, add);
        let moments = Moments { count, mean, squares };
        into.moments = Some(into.moments.map_or(moments, |before| before.plus(moments)));
    }
}

impl Moments {
    /// Returns the moments of two sets of samples together (Chan, Golub and LeVeque 1983, "Algorithms for computing the
    /// sample variance").
    fn plus(self, other: Self) -> Self {
        let count = self.count + other.count;
        let share = other.count as f64 / count.max(1) as f64;
        let apart = other.mean - self.mean;
        let squares = self.squares + other.squares + apart * apart * self.count as f64 * share;
        Self { count, mean: self.mean + apart * share, squares }
    }
}

impl Binned {
    fn empty(bins: SampleBins) -> Self {
        Self { bins, counts: vec![0; bins.len], moments: None }
    }

    /// Returns the counts of two sets of samples together; `None` if they are in different bins.
    fn plus(mut self, other: &Self) -> Option<Self> {
        self.counts.iter_mut().zip(&other.counts).for_each(|(count, more)| *count += more);
        self.moments = match (self.moments, other.moments) {
            (Some(one), Some(other)) => Some(one.plus(other)),
            (one, other) => one.or(other),
        };
        (self.bins == other.bins).then_some(self)
    }
}

impl Counts {
    const NONE: Self = Self { range: None, count: 0, non_finite: 0, binned: None };

    /// Counts the samples of a volume, or of a part of it, on all cores.
    ///
    /// # Errors
    /// [`Error::Read`](crate::error::Error::Read) and [`Error::Memory`](crate::error::Error::Memory) if samples left in
    /// a file cannot be read.
    pub fn of(volume: &Volume) -> Result<Self> {
        match volume.sample_type().few() {
            Some(range) => Self::binned(volume, SampleBins::of_range(range.map(f64::from), true), None),
            None => Self::summed(volume, |part| Self::ranged(volume, part)),
        }
    }

    /// Counts the samples of a volume again, or of a part of it, in bins of the range of these counts.
    ///
    /// # Errors
    /// The errors of [`Self::of`].
    pub fn refined(&self, volume: &Volume) -> Result<Self> {
        // Without a finite sample there is nothing to count.
        let bins = SampleBins::of_range(self.range.unwrap_or_default(), !volume.sample_type().is_float());
        Self::binned(volume, bins, self.range)
    }

    /// Returns whether all samples are in bins. Otherwise their range is known, and [`Self::refined`] counts them.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.binned.is_some()
    }

    /// Returns the counts of two sets of samples together. They are not complete unless both are, in bins of the same
    /// range.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        let range = match (self.range, other.range) {
            (Some([a, b]), Some([c, d])) => Some([a.min(c), b.max(d)]),
            (one, other) => one.or(other),
        };
        let binned = self.binned.zip(other.binned).and_then(|(one, other)| one.plus(&other));
        let (count, non_finite) = (self.count + other.count, self.non_finite + other.non_finite);
        Self { range, count, non_finite, binned }
    }

    /// Returns the number of finite samples.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Returns the bins from the smallest to the largest sample; `None` if the counts are not complete or there is no
    /// sample.
    pub(super) fn occupied(&self) -> Option<Occupied> {
        let ([least, largest], Binned { bins, counts, moments }) = (self.range?, self.binned.as_ref()?);
        let &SampleBins { step, scale, is_exact, .. } = bins;
        if !is_exact {
            let Moments { mean, squares, .. } = (*moments)?;
            let first = bins.least + step / 2.0;
            return Some(Occupied { bins: counts.clone(), first, step, scale, mean, squares });
        }
        let [from, to] = [least, largest].map(|value| (value * scale - bins.least) as usize);
        let first = bins.least + from as f64;
        let counts = counts.get(from..=to)?;
        let sum_of = |of: &dyn Fn(f64) -> f64| -> f64 {
            counts.iter().enumerate().map(|(i, &n)| n as f64 * of(first + i as f64)).sum()
        };
        let mean = sum_of(&|value| value) / self.count as f64;
        let squares = sum_of(&|value| (value - mean) * (value - mean));
        Some(Occupied { bins: counts.to_vec(), first, step, scale, mean, squares })
    }

    /// Counts samples in bins, whose range may be known.
    fn binned(volume: &Volume, bins: SampleBins, known: Option<[f64; 2]>) -> Result<Self> {
        Self::summed(volume, |part| {
            let mut binned = Binned::empty(bins);
            let count = |before: Self, range: Range<usize>| {
                let len = range.len() as u64;
                with_samples!(&volume.read(range)?, s => bins.count(s, &mut binned));
                Ok(Self { non_finite: before.non_finite + len, ..before })
            };
            let Self { non_finite: len, .. } = pieces(part).try_fold(Self::NONE, count)?;
            let (count, used) = (binned.counts.iter().sum(), |n: &u64| *n > 0);
            let ends = binned.counts.iter().position(used).zip(binned.counts.iter().rposition(used));
            let range = known.or(ends.map(|(first, last)| [first, last].map(|at| bins.least + at as f64)));
            Ok(Self { range, count, non_finite: len - count, binned: Some(binned) })
        })
    }

    fn ranged(volume: &Volume, part: Range<usize>) -> Result<Self> {
        pieces(part).try_fold(Self::NONE, |before, range| {
            let len = range.len() as u64;
            let add = |(n, least, largest): (u64, f64, f64), v: f64| (n + 1, least.min(v), largest.max(v));
            let finite = with_samples!(&volume.read(range)?, s => s
                .iter()
                .map(|v| v.to_f64())
                .filter(|v| v.is_finite())
                .fold((0, f64::INFINITY, f64::NEG_INFINITY), add));
            let (count, least, largest) = finite;
            let range = (count > 0).then_some([least, largest]);
            Ok(before.plus(Self { range, count, non_finite: len - count, binned: None }))
        })
    }

    /// Returns the counts of all parts of a volume. Parts depend on the length alone and are added in order, so all
    /// machines compute the same figures.
    fn summed(volume: &Volume, of: impl Fn(Range<usize>) -> Result<Self> + Sync) -> Result<Self> {
        let len = volume.grid().len() as usize;
        let part = MIN_CHUNK.max(len.div_ceil(64));
        let parts = try_map(len.div_ceil(part), |n| of(n * part..len.min((n + 1) * part)))?;
        Ok(parts.into_iter().reduce(Self::plus).unwrap_or(Self::NONE))
    }
}

/// Returns the pieces of a range of samples that are in memory at a time.
fn pieces(range: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    let end = range.end;
    range.step_by(MIN_CHUNK).map(move |start| start..end.min(start + MIN_CHUNK))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::{Sample, Statistics};

    fn volume<T: Sample>(values: &[T]) -> Volume {
        Volume::from_slice([values.len() as u32, 1, 1], [1.0; 3], values).unwrap()
    }

    fn in_parts<T: Sample>(values: &[T], ends: &[usize]) -> Statistics {
        let starts = std::iter::once(0).chain(ends.iter().copied());
        let parts: Vec<Volume> = starts.zip(ends).map(|(start, &end)| volume(&values[start..end])).collect();
        let sum = |of: &dyn Fn(&Volume) -> Counts| parts.iter().map(of).reduce(Counts::plus).unwrap();
        let first = sum(&|part| Counts::of(part).unwrap());
        let complete = if first.is_complete() { first } else { sum(&|part| first.refined(part).unwrap()) };
        // As a task sends them.
        let sent: Counts = serde_json::from_str(&serde_json::to_string(&complete).unwrap()).unwrap();
        assert_eq!(sent, complete);
        Statistics::of_counts(&sent, (-0.5, 10.0))
    }

    fn whole<T: Sample>(values: &[T]) -> Statistics {
        Statistics::of(&volume(values).with_rescale(-0.5, 10.0).unwrap()).unwrap()
    }

    #[test]
    fn integers_have_the_same_statistics_in_parts() {
        let numbers: Vec<u32> = (0..5000_u32).map(|i| i * i % 4099 + 70_000).collect();
        let ends = [1, 2, 77, 3000, 5000];
        assert_eq!(in_parts(&numbers, &ends), whole(&numbers));
        let few: Vec<i16> = numbers.iter().map(|&n| (i64::from(n) - 70_300) as i16).collect();
        assert_eq!(in_parts(&few, &ends), whole(&few));
        assert_eq!(whole(&few).count, 5000);
        let ends_of = |v: &i16| 10.0 - 0.5 * f64::from(*v);
        let [least, largest] = [few.iter().min(), few.iter().max()].map(|v| v.map(ends_of));
        assert_eq!([Some(whole(&few).max), Some(whole(&few).min)], [least, largest]);
        let wide: Vec<u32> = numbers.iter().map(|n| n * 5_000).collect();
        assert_eq!(in_parts(&wide, &ends).histogram(), whole(&wide).histogram());
    }

    #[test]
    fn real_numbers_are_in_the_same_bins_in_parts() {
        let mut numbers: Vec<f32> = (0..5000).map(|i| (i as f32 * 0.37).sin().exp() - 3.0).collect();
        (numbers[0], numbers[1], numbers[100]) = (f32::NAN, f32::INFINITY, f32::NEG_INFINITY);
        // The first part has no finite sample.
        let (parts, one) = (in_parts(&numbers, &[2, 150, 151, 4000, 5000]), whole(&numbers));
        let bins = |of: &Statistics| (of.min, of.max, of.count, of.non_finite, of.histogram(), of.quantile(0.3));
        assert_eq!(bins(&parts), bins(&one));
        assert_eq!((one.count, one.non_finite), (4997, 3));
        assert!((parts.mean - one.mean).abs() < 1e-12 && (parts.std_dev - one.std_dev).abs() < 1e-12);
        let finite: Vec<f64> = numbers.iter().filter(|v| v.is_finite()).map(|&v| 10.0 - 0.5 * f64::from(v)).collect();
        let mean = finite.iter().sum::<f64>() / finite.len() as f64;
        let variance = finite.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / finite.len() as f64;
        assert!((one.mean - mean).abs() < 1e-12 && (one.std_dev - variance.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn counts_in_other_bins_are_not_complete() {
        let [one, other] = [[0.0, 1.0], [0.0, 2.0]].map(|values| volume(&values));
        let counts = |volume: &Volume| Counts::of(volume).unwrap().refined(volume).unwrap();
        assert!(counts(&one).is_complete() && counts(&one).plus(counts(&one)).is_complete());
        assert!(!counts(&one).plus(counts(&other)).is_complete());
        assert!(!counts(&one).plus(Counts::of(&one).unwrap()).is_complete());
    }
}
