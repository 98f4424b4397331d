//! Recognition of labels by the values of a volume.

use std::collections::BTreeSet;

use rayon::prelude::*;

use super::labels;
use crate::error::Result;
use crate::volume::{Volume, with_samples};

/// The largest number of samples that are inspected, in rows spread over the volume.
const SAMPLES: usize = 1 << 22;
/// The number of samples of rows that are read together.
const PIECE: usize = 1 << 18;
/// The largest number of different values of labels.
const VALUES: usize = 4096;
/// The smallest number of samples outside the background.
const FEWEST: u64 = 100;
/// The largest share of unequal pairs among pairs of neighbours that are not both background. Scans of 8 bits have 0.4
/// to 0.9, organs 0.02 to 0.1, cells of 2 to 6 voxels 0.3.
const DIFFERENT: f64 = 0.35;
/// The largest share of borders followed by a single sample whose value lies between its two neighbours' values, as on
/// an edge in a scan. Scans rounded to 4 values have 0.08 to 0.4, to more values 0.2 to 0.8; organs 0.004 to 0.02.
const BETWEEN: f64 = 0.05;
/// The smallest share of borders between values that do not follow each other, for up to 8 values and for more: a field
/// without jumps passes through all values.
const JUMPS: [f64; 2] = [0.05, 0.3];

/// A row of samples as runs of one value, and their lengths.
type Runs = Vec<(f64, u64)>;

/// Returns why the values of a volume are taken for labels; `None` if they are not. Either the file says so, or the
/// values are whole numbers from 0 up, mostly 0, that fill regions with sharp borders; scans and fields do not, even if
/// they are rounded to few values. Inspects at most 4 Mi samples, along the first axis. Bounds are rules of thumb.
///
/// # Errors
/// [`Error::Input`](crate::Error::Input) and [`Error::Memory`](crate::error::Error::Memory) if samples left in a
/// file cannot be read.
pub fn recognised(volume: &Volume) -> Result<Option<String>> {
    match &volume.contents().segments {
        Some(segments) if segments.is_empty() => {
            return Ok(Some("the file says that its values are labels".to_owned()));
        }
        Some(_) => return Ok(Some("the file names its labels".to_owned())),
        None if volume.sample_type().is_float() => return Ok(None),
        None => {}
    }
    let [nx, ny, nz] = volume.grid().dims().map(|d| d as usize);
    let (slope, intercept) = volume.rescale();
    let step = (nx * ny * nz).div_ceil(SAMPLES);
    // A step along y and z that have a factor in common would miss most of the slices.
    let rows: Vec<usize> = (0..ny * nz).filter(|row| (row % ny + row / ny) % step == 0).collect();
    let (mut values, mut all) = (BTreeSet::new(), Vec::new());
    let (mut samples, mut runs) = (0, 0);
    for piece in rows.chunks(PIECE.div_ceil(nx)) {
        let row = |row: &usize| -> Result<Runs> {
            let samples = volume.read(row * nx..(row + 1) * nx)?;
            Ok(with_samples!(&samples, s => labels::runs(s).collect()))
        };
        for row in piece.par_iter().map(row).collect::<Result<Vec<Runs>>>()? {
            values.extend(row.iter().map(|(raw, _)| (slope * raw + intercept).to_bits()));
            samples += nx;
            runs += row.len();
            all.push(row);
        }
        // Bits of positive numbers are sorted like the numbers. Whole samples have no -0, and bits of negative numbers
        // are larger.
        let are_whole = values.iter().all(|&bits| f64::from_bits(bits) >= 0.0 && f64::from_bits(bits).fract() == 0.0);
        if !are_whole || values.len() > VALUES || runs > samples / 2 + 1000 {
            return Ok(None);
        }
    }
    let values: Vec<f64> = values.into_iter().map(f64::from_bits).collect();
    let mut found = Borders::default();
    for row in &all {
        let rank = |raw: f64| values.partition_point(|&other| other < slope * raw + intercept);
        found.add(&row.iter().map(|&(raw, length)| (rank(raw), length)).collect::<Vec<_>>());
    }
    let background = values.first() == Some(&0.0) && found.background > found.labelled / 4;
    let jumps = JUMPS[usize::from(values.len() > 8)];
    let are_labels = background
        && values.len() > 1
        && found.labelled >= FEWEST
        && share(found.different, found.pairs) < DIFFERENT
        && share(found.between, found.starts) < BETWEEN
        && (values.len() == 2 || share(found.jumps, found.different) >= jumps);
    let reason = || match values.as_slice() {
        [_, label] => format!("its values are 0 and {label}, as in a mask"),
        _ => format!("{} whole numbers fill regions with sharp borders, as in a segmentation", values.len() - 1),
    };
    Ok(are_labels.then(reason))
}

/// Counts at the borders between values in rows. The background is the lowest value, 0.
#[derive(Default)]
struct Borders {
    background: u64,
    labelled: u64,
    /// The number of pairs of neighbours that are not both background.
    pairs: u64,
    /// The number of pairs of neighbours with different values.
    different: u64,
    /// The number of pairs of neighbours with values that do not follow each other.
    jumps: u64,
    /// The number of borders with a label behind them.
    starts: u64,
    /// The number of borders followed by a single sample whose value lies between its neighbours' values.
    between: u64,
}

impl Borders {
    /// Adds a row, given by runs of values, which are ranks among all values.
    fn add(&mut self, row: &[(usize, u64)]) {
        for &(value, length) in row {
            if value == 0 {
                self.background += length;
            } else {
                self.labelled += length;
                self.pairs += length - 1;
            }
        }
        for pair in row.windows(2) {
            self.pairs += 1;
            self.different += 1;
            self.jumps += u64::from(pair[0].0.abs_diff(pair[1].0) > 1);
            self.starts += u64::from(pair[1].0 != 0);
        }
        for three in row.windows(3) {
            let [(a, _), (b, length), (c, _)] = [three[0], three[1], three[2]];
            self.between += u64::from(length == 1 && b != 0 && (a < b) == (b < c));
        }
    }
}

fn share(part: u64, whole: u64) -> f64 {
    part as f64 / whole.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 40;

    /// Returns whether a volume of these values at places -1 to 1 is taken for labels.
    fn taken(value: impl Fn([f64; 3]) -> u16) -> bool {
        let place = |i: usize| [i % N, i / N % N, i / N / N].map(|p| p as f64 / (N - 1) as f64 * 2.0 - 1.0);
        let samples: Vec<u16> = (0..N * N * N).map(|i| value(place(i))).collect();
        recognised(&Volume::from_slice([N as u32; 3], [1.0; 3], &samples).unwrap()).unwrap().is_some()
    }

    fn radius([x, y, z]: [f64; 3]) -> f64 {
        (x * x + y * y + z * z).sqrt()
    }

    /// Returns noise from -1 to 1 that depends on the place alone.
    fn noise(place: [f64; 3]) -> f64 {
        let bits =
            place.iter().fold(7_u64, |h, p| (h ^ p.to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29));
        (bits >> 40) as f64 / f64::from(1 << 23) - 1.0
    }

    #[test]
    fn segmentations_are_recognised() {
        let organs = |p: [f64; 3]| match radius(p) {
            r if r > 0.9 => 0,
            r if r < 0.3 => 40,
            _ if p[0] > 0.1 => 3,
            _ => 11,
        };
        assert!(taken(organs));
        assert!(taken(|p| u16::from(organs(p) == 3)));
        assert!(taken(|p| 255 * u16::from(organs(p) == 3)));
        // Parcels of many labels.
        assert!(taken(|p| {
            let parcel = p.iter().fold(0, |n, c| 5 * n + ((c + 1.0) * 2.49) as u16);
            if radius(p) < 0.9 { 1001 + parcel * 37 % 101 } else { 0 }
        }));
    }

    #[test]
    fn scans_and_fields_are_not_taken_for_labels() {
        // CT, as it comes and rounded to few values: flesh, a shell of bone, an insert, edges two voxels wide.
        let ct = |p: [f64; 3], noisy: f64| {
            let edge = |at: f64| 1.0 / (1.0 + ((radius(p) - at) * 12.0).exp());
            let value = 90.0 * edge(0.9) + 150.0 * (edge(0.8) - edge(0.6)) + 60.0 * edge(0.3);
            (value + noisy * noise(p)).clamp(0.0, 255.0)
        };
        for steps in [255.0, 64.0, 32.0, 16.0, 8.0, 6.0, 4.0] {
            for noisy in [0.0, 5.0, 15.0] {
                assert!(!taken(|p| (ct(p, noisy) * steps / 255.0) as u16), "{steps} {noisy}");
            }
        }
        // Smooth fields, rounded.
        for steps in [4.0, 10.0, 100.0, 1000.0] {
            assert!(!taken(|p| (steps * (1.0 - radius(p)).max(0.0)) as u16), "{steps}");
            assert!(!taken(|p| (steps * (0.5 + 0.5 * (3.0 * p[0]).sin() * p[1].cos())) as u16), "{steps}");
        }
        // Noise, alone and cut off; nothing; what has no background.
        assert!(!taken(|p| (100.0 + 50.0 * noise(p)) as u16));
        assert!(!taken(|p| u16::from(noise(p) > 0.0)));
        assert!(!taken(|_| 0) && !taken(|_| 7));
        assert!(!taken(|p| 1 + u16::from(p[0] > 0.0)));
    }

    #[test]
    fn what_the_file_says_counts() {
        let noisy: Vec<i16> = (0..1000).map(|i| (i * 7919 % 331) as i16 - 5).collect();
        let volume = Volume::from_slice([10; 3], [1.0; 3], &noisy).unwrap();
        assert_eq!(recognised(&volume).unwrap(), None);
        let contents = crate::volume::Contents { segments: Some(Vec::new()), ..Default::default() };
        assert!(recognised(&volume.with_contents(contents)).unwrap().unwrap().contains("the file says"));
    }
}
