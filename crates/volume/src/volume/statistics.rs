//! Statistics of a volume's values: range, mean, histogram, and the end of the background.

use super::Volume;
use super::counts::{Counts, Occupied, scale_for};
use crate::error::Result;

/// The largest number of bins of [`Statistics::histogram`]: as many as a page or a terminal can show.
const SHOWN_BINS: usize = 256;
/// The quantile over which values do not count for thresholds: a few very bright voxels would stretch the classes.
const NOT_OUTLIERS: f64 = 0.9995;

/// The distribution of a volume's values, after rescaling. NaN and infinite samples are only counted.
#[derive(Debug, Clone, PartialEq)]
pub struct Statistics {
    /// The smallest value. If no sample is finite, this and all other figures are NaN.
    pub min: f64,
    /// The largest value.
    pub max: f64,
    /// The mean of the values.
    pub mean: f64,
    /// The standard deviation of the values, taken as the whole population.
    pub std_dev: f64,
    /// The number of finite samples.
    pub count: u64,
    /// The number of NaN and infinite samples.
    pub non_finite: u64,
    /// The numbers of samples in bins: bin i counts the values nearest to `(first + i * step) / scale`.
    bins: Vec<u64>,
    first: f64,
    step: f64,
    scale: f64,
}

/// The background: the darker class of values, taken to be the air or void around an object.
#[derive(Debug, Clone, Copy, PartialEq)]
#[doc(hidden)]
pub struct BackgroundEstimate {
    /// The largest value that is still background.
    pub limit: f64,
    /// The share of the samples that are background, 0..1.
    pub fraction: f64,
}

impl Statistics {
    /// Counts the samples on all cores. The result does not depend on the number of cores.
    ///
    /// # Errors
    /// [`Error::Read`](crate::error::Error::Read) and [`Error::Memory`](crate::error::Error::Memory) if samples left in
    /// a file cannot be read.
    pub fn of(volume: &Volume) -> Result<Self> {
        let first = Counts::of(volume)?;
        let counts = if first.is_complete() { first } else { first.refined(volume)? };
        Ok(Self::of_counts(&counts, volume.rescale()))
    }

    /// Makes statistics of the counts of all samples, in values of slope and intercept. If the counts are not complete,
    /// the histogram is empty, and mean and standard deviation are NaN.
    #[must_use]
    pub fn of_counts(counts: &Counts, (slope, intercept): (f64, f64)) -> Self {
        let (&Counts { range, count, non_finite, .. }, binned) = (counts, counts.occupied());
        let [min, max] = range.unwrap_or([f64::NAN; 2]);
        let Occupied { bins, first, step, scale, mean, squares } = binned.unwrap_or_default();
        let (mean, std_dev) = (mean / scale, (squares / count as f64).sqrt() / scale);
        Self { min, max, mean, std_dev, count, non_finite, bins, first, step, scale }.rescaled((slope, intercept))
    }

    fn rescaled(mut self, (slope, intercept): (f64, f64)) -> Self {
        if slope < 0.0 {
            self.bins.reverse();
            self.first += self.step * self.bins.len().saturating_sub(1) as f64;
            (self.min, self.max) = (self.max, self.min);
        }
        let value = |raw: f64| slope * raw + intercept;
        (self.min, self.max, self.mean) = (value(self.min), value(self.max), value(self.mean));
        self.std_dev *= slope.abs();
        let scale = scale_for(self.min, self.max);
        self.first = value(self.first / self.scale) * scale;
        self.step *= slope.abs() / self.scale * scale;
        self.scale = scale;
        self
    }

    fn value_of(&self, bin: usize) -> f64 {
        ((self.first + self.step * bin as f64) / self.scale).clamp(self.min, self.max)
    }

    fn bin_of(&self, value: f64) -> usize {
        let bin = ((value * self.scale - self.first) / self.step).round().max(0.0) as usize;
        bin.min(self.bins.len().saturating_sub(1))
    }

    /// Returns the numbers of samples in equal bins over min..max: 256 bins, or one per value if there are fewer
    /// values.
    #[must_use]
    pub fn histogram(&self) -> Vec<u64> {
        let len = self.bins.len().min(SHOWN_BINS);
        let mut shown = vec![0; len];
        for (i, n) in self.bins.iter().enumerate() {
            shown[i * len / self.bins.len()] += n;
        }
        shown
    }

    /// Returns the value below which a share `q` (0..1) of the samples lies. It is exact for 8 and 16 bit samples, and
    /// to 1/65536 of the range for others.
    #[must_use]
    pub fn quantile(&self, q: f64) -> f64 {
        self.quantile_above(f64::NEG_INFINITY, q)
    }

    /// Returns the value below which a share `q` (0..1) of the samples over `limit` lies, as exact as
    /// [`Self::quantile`].
    #[must_use]
    pub fn quantile_above(&self, limit: f64, q: f64) -> f64 {
        let start = self.first_above(limit);
        let total: u64 = self.bins[start..].iter().sum();
        let wanted = (q.clamp(0.0, 1.0) * total as f64).ceil().max(1.0) as u64;
        let mut seen = 0;
        for (i, n) in self.bins.iter().enumerate().skip(start) {
            seen += n;
            if seen >= wanted {
                return self.value_of(i);
            }
        }
        self.max
    }

    /// Returns the share of the samples over `limit`, 0..1.
    #[must_use]
    pub fn fraction_above(&self, limit: f64) -> f64 {
        self.bins[self.first_above(limit)..].iter().sum::<u64>() as f64 / self.count.max(1) as f64
    }

    /// Returns the first bin with a value over `limit`.
    fn first_above(&self, limit: f64) -> usize {
        if self.bins.is_empty() || limit < self.min {
            return 0;
        }
        let bin = self.bin_of(limit);
        if self.value_of(bin) > limit { bin } else { (bin + 1).min(self.bins.len()) }
    }

    /// Returns the threshold that splits the values over `above` into two classes with the largest variance between
    /// them (Otsu 1979, "A threshold selection method from gray-level histograms"). `f64::NEG_INFINITY` includes all
    /// values.
    ///
    /// Outliers do not count, unless all other values are the same: a few bright voxels alone are a class.
    ///
    /// `None` if there are no two classes. With its own result as `above` it splits the brighter class.
    #[must_use]
    pub fn otsu(&self, above: f64) -> Option<f64> {
        let start = self.first_above(above);
        let end = self.bin_of(self.quantile(NOT_OUTLIERS)) + 1;
        let everything = || (above == f64::NEG_INFINITY).then(|| self.split(start, self.bins.len())).flatten();
        self.split(start, end).or_else(everything)
    }

    /// Returns the threshold between the two classes of the values of some bins.
    fn split(&self, start: usize, end: usize) -> Option<f64> {
        let bins = self.bins.get(start..end)?;
        let total: f64 = bins.iter().map(|&n| n as f64).sum();
        let sum: f64 = bins.iter().enumerate().map(|(i, &n)| n as f64 * i as f64).sum();
        let (mut best, mut from, mut to) = (0.0, 0, 0);
        let (mut below, mut sum_below) = (0.0, 0.0);
        for (i, &n) in bins.iter().enumerate() {
            below += n as f64;
            sum_below += n as f64 * i as f64;
            let variance = (sum * below - sum_below * total).powi(2) / (below * (total - below));
            if variance > best {
                (best, from, to) = (variance, i, i);
            } else if variance == best && n == 0 {
                // In an empty gap between the classes every threshold is equally good; the middle is the safest.
                to = i;
            }
        }
        (best > 0.0).then(|| self.value_of(start + (from + to) / 2))
    }

    /// Returns the background: all values below the foot of the highest peak in the darker of Otsu's two classes. The
    /// foot is the bin farthest below the line from the peak to the threshold (Zack, Rogers and Latt 1977, the triangle
    /// method).
    ///
    /// `None` if all values are the same. A bright background is not recognised.
    #[must_use]
    pub fn background(&self) -> Option<BackgroundEstimate> {
        let threshold = self.otsu(f64::NEG_INFINITY)?;
        let shown = self.histogram();
        let width = self.bins.len() as f64 / shown.len() as f64;
        let end = ((self.bin_of(threshold) as f64 / width) as usize).min(shown.len() - 1);
        let peak = (0..=end).rev().max_by_key(|&i| shown[i])?;
        let (top, bottom) = (shown[peak] as f64, shown[end] as f64);
        let depth = |i: usize| {
            let line = top + (bottom - top) * (i - peak) as f64 / (end - peak).max(1) as f64;
            line - shown[i] as f64
        };
        let foot = (peak + 1..=end).rev().max_by(|&a, &b| depth(a).total_cmp(&depth(b))).unwrap_or(peak + 1);
        // The foot is not background: the limit is the last value before it.
        let first_of_foot = (foot as f64 * width).ceil() as usize;
        let limit = self.value_of(first_of_foot.saturating_sub(1));
        Some(BackgroundEstimate { limit, fraction: 1.0 - self.fraction_above(limit) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::Volume;

    fn of(values: &[f64]) -> Statistics {
        Statistics::of(&Volume::from_slice([values.len() as u32, 1, 1], [1.0; 3], values).unwrap()).unwrap()
    }

    #[test]
    fn a_bright_voxel_alone_is_a_class() {
        let mut values = vec![0.0; 4913];
        values[2456] = 255.0;
        let threshold = of(&values).otsu(f64::NEG_INFINITY).unwrap();
        assert!((1.0..255.0).contains(&threshold), "{threshold}");
        assert_eq!(of(&[7.0; 100]).otsu(f64::NEG_INFINITY), None);
    }

    #[test]
    fn figures_scale_with_the_values() {
        let values = [-3.0, 0.0, 0.0, 0.5, 1.0, 3.0, 3.0, 3.5];
        let usual = of(&values);
        for exponent in [-1060, -1000, 1000, 1022] {
            let scale = f64::from(exponent).exp2();
            let scaled = of(&values.map(|v| v * scale));
            assert_eq!([scaled.min, scaled.max], [-3.0, 3.5].map(|v| v * scale));
            // Subnormal numbers are rounded to 2^-1074.
            let near = |a: f64, b: f64| (a / scale - b).abs() < 1e-4;
            assert!(near(scaled.mean, usual.mean) && near(scaled.std_dev, usual.std_dev), "2^{exponent}: {scaled:?}");
            assert_eq!(scaled.histogram(), usual.histogram(), "2^{exponent}");
            for q in [0.0, 0.2, 0.5, 0.9, 1.0] {
                assert!(near(scaled.quantile(q), usual.quantile(q)), "2^{exponent}, {q}");
            }
            assert!(near(scaled.otsu(f64::NEG_INFINITY).unwrap(), usual.otsu(f64::NEG_INFINITY).unwrap()));
        }
    }

    #[test]
    fn the_ends_of_the_range_have_figures() {
        let ends = of(&[f64::MIN, f64::MIN, 0.0, f64::MAX]);
        assert_eq!([ends.min, ends.max], [f64::MIN, f64::MAX]);
        assert!((ends.mean / f64::MAX + 0.25).abs() < 1e-12, "{}", ends.mean);
        assert!((ends.std_dev / f64::MAX - 0.6875_f64.sqrt()).abs() < 1e-12, "{}", ends.std_dev);
        assert!(ends.otsu(f64::NEG_INFINITY).unwrap().is_finite());
        let constant = of(&[f64::MAX; 4]);
        assert_eq!([constant.mean, constant.std_dev], [f64::MAX, 0.0]);
    }
}
