//! Voxels from the samples of a volume: classified, thinned by gradient opacity and lit, a few planes of rows at a
//! time.

use std::ops::Range;

use glam::Vec3;
use rayon::prelude::*;

use super::filled;
use crate::error::Result;
use crate::gpu::splat::SplatLight;
use crate::kernel::{DerivativeFilter, NORMAL_REACH};
use crate::splats::brick::places;
use crate::splats::classification::{Classification, ColorSource, Emission};
use crate::splats::gradients::gradients;
use crate::splats::words::{LANES, NO_NORMAL, packed_normal};
use crate::transfer::scalars::{Reduction, Relative};
use crate::transfer::{TransferFunction, scaled_share};
use crate::volume::{Number, Samples, ToF64, Volume, with_samples};
use voxsplat_volume::memory::reserved;

/// A volume whose samples become voxels.
pub(crate) struct Source<'a> {
    volume: &'a Volume,
    classification: Classification<'a>,
    /// The light on voxels, all of which arrives; `None`: voxels are unlit.
    light: Option<&'a SplatLight>,
    /// The normals of voxels; `None`: they are found.
    kept: Option<&'a KeptNormals>,
    /// Gradients, if light or opacity depends on them.
    steepness: Option<Steepness>,
}

/// The inputs of gradients and what depends on them.
struct Steepness {
    scalars: Relative,
    /// World gradients of the lattice coordinates.
    gradients: [Vec3; 3],
    /// Gradient opacity, of gradients of scalars; empty: extinction does not depend on them.
    thinning: Vec<[f32; 2]>,
    /// The filter of normals, if they are found.
    normals: Option<DerivativeFilter>,
}

impl Steepness {
    /// The rows and planes to either side that a voxel depends on.
    fn reach(&self) -> usize {
        if self.normals.is_some() { NORMAL_REACH } else { 1 }
    }
}

impl<'a> Source<'a> {
    pub(crate) fn new(
        volume: &'a Volume,
        transfer: &'a TransferFunction,
        light: Option<&'a SplatLight>,
        kept: Option<&'a KeptNormals>,
    ) -> Self {
        Self { light, kept, ..Self::with_normals(volume, transfer, light.is_some() && kept.is_none()) }
    }

    /// An unlit source, which can find normals.
    fn with_normals(volume: &'a Volume, transfer: &'a TransferFunction, finds_normals: bool) -> Self {
        let reduction = Reduction::new(transfer, 1.0);
        let scale = reduction.factor() * volume.grid().unit();
        let thinning = transfer.scaled_gradient_opacity(scale);
        let steep = finds_normals || !thinning.is_empty();
        let gradients = gradients(volume).map(Vec3::from_array);
        Self {
            volume,
            classification: Classification::new(volume, ColorSource::Transfer(transfer), 1.0),
            light: None,
            kept: None,
            steepness: steep.then(|| Steepness {
                scalars: Relative::new(volume, reduction),
                gradients,
                thinning,
                normals: finds_normals.then(DerivativeFilter::of_normals),
            }),
        }
    }

    /// These rows of planes.
    pub(super) fn slices(&self, rows: Range<i64>) -> Slices<'_> {
        Slices { source: self, rows, slices: Vec::new(), along_x: Default::default() }
    }
}

/// A few planes of some rows of voxels; for gradients also the rows and planes beside them.
pub(super) struct Slices<'a> {
    source: &'a Source<'a>,
    rows: Range<i64>,
    slices: Vec<Slice>,
    /// Slopes along x and smoothed values of the plane that is being filtered.
    along_x: [Vec<f32>; 2],
}

struct Slice {
    z: i64,
    /// The first row.
    first: i64,
    samples: Samples,
    /// Scalars of all rows for gradient opacity, with the outermost of a row repeated as far as gradients reach.
    scalars: Vec<f32>,
    /// Scalars of the rows that are lit: slopes along x, slopes along y, and smoothed, each smoothed along the other
    /// axis of the plane.
    filtered: [Vec<f32>; 3],
}

impl Slice {
    /// The samples of a row of `count` voxels.
    fn row(&self, y: i64, count: usize) -> Range<usize> {
        let start = (y - self.first) as usize * count;
        start..start + count
    }
}

impl Slices<'_> {
    /// Reads the plane `z`: the first, or the one after the plane before.
    pub(super) fn advance(&mut self, z: i64) -> Result<()> {
        let Source { volume, steepness, .. } = self.source;
        let [nx, ny, nz] = volume.grid().dims().map(i64::from);
        let reach = steepness.as_ref().map_or(0, Steepness::reach);
        let beside = reach as i64;
        let (slices, mut spare): (Vec<_>, Vec<_>) =
            std::mem::take(&mut self.slices).into_iter().partition(|slice| slice.z >= z - beside);
        self.slices = slices;
        let first = (self.rows.start - beside).max(0);
        let end = (self.rows.end + beside).min(ny);
        for z in (z - beside).max(0)..=(z + beside).min(nz - 1) {
            if self.slices.iter().any(|slice| slice.z == z) {
                continue;
            }
            let samples = volume.read(((z * ny + first) * nx) as usize..((z * ny + end) * nx) as usize)?;
            // In the memory of a plane that is done with.
            let (mut scalars, mut filtered) =
                spare.pop().map(|slice| (slice.scalars, slice.filtered)).unwrap_or_default();
            if let Some(Steepness { scalars: of, normals, .. }) = steepness {
                let width = nx as usize + 2 * reach;
                resize(&mut scalars, (end - first) as usize * width)?;
                let rows = scalars.chunks_exact_mut(width);
                with_samples!(&samples, s => for (row, scalars) in s.chunks_exact(nx as usize).zip(rows) {
                    let inside = &mut scalars[reach..width - reach];
                    inside.iter_mut().zip(row).for_each(|(scalar, sample)| *scalar = of.to(sample.to_f64()));
                    let [low, high] = [scalars[reach], scalars[width - reach - 1]];
                    scalars[..reach].fill(low);
                    scalars[width - reach..].fill(high);
                });
                if let Some(normals) = normals {
                    self.filter(normals, &scalars, (nx as usize, first), &mut filtered)?;
                }
            }
            self.slices.push(Slice { z, first, samples, scalars, filtered });
        }
        Ok(())
    }

    /// Filters the rows of a plane that are lit along x and y. `scalars` has rows of `nx` voxels from `first` on.
    fn filter(
        &mut self,
        normals: &DerivativeFilter,
        scalars: &[f32],
        (nx, first): (usize, i64),
        filtered: &mut [Vec<f32>; 3],
    ) -> Result<()> {
        let width = nx + 2 * NORMAL_REACH;
        let rows = scalars.len() / width;
        let [sloping, smooth] = &mut self.along_x;
        resize(sloping, rows * nx)?;
        resize(smooth, rows * nx)?;
        let each = sloping.chunks_exact_mut(nx).zip(smooth.chunks_exact_mut(nx));
        for (row, (sloping, smooth)) in scalars.chunks_exact(width).zip(each) {
            let taps = |k: isize| &row[NORMAL_REACH.saturating_add_signed(k)..][..nx];
            normals.slope(taps, sloping);
            normals.smooth(taps, smooth);
        }
        let count = (self.rows.end - self.rows.start) as usize * nx;
        filtered.iter_mut().try_for_each(|values| resize(values, count))?;
        let [x, y, smoothed] = filtered;
        let each = x.chunks_exact_mut(nx).zip(y.chunks_exact_mut(nx)).zip(smoothed.chunks_exact_mut(nx));
        for (row, ((x, y), smoothed)) in self.rows.clone().zip(each) {
            // Rows beyond the faces are copies of the outermost.
            let at = |k: isize| (row - first + k as i64).clamp(0, rows as i64 - 1) as usize * nx;
            normals.smooth(|k| &sloping[at(k)..][..nx], x);
            normals.slope(|k| &smooth[at(k)..][..nx], y);
            normals.smooth(|k| &smooth[at(k)..][..nx], smoothed);
        }
        Ok(())
    }

    /// The voxels of a row of the last plane between two columns; others are arbitrary. Returns a range outside which
    /// all of these are transparent.
    pub(super) fn row(&self, place: [i64; 2], columns: &Range<usize>, voxels: &mut [Emission]) -> Range<usize> {
        let Some(slice) = self.slice(place[1]) else { return 0..0 };
        let row = slice.row(place[0], voxels.len());
        with_samples!(&slice.samples, samples => self.row_of(&samples[row], place, columns, voxels))
    }

    /// These voxels of a row, given its samples.
    fn row_of<T: Number>(
        &self,
        samples: &[T],
        place: [i64; 2],
        columns: &Range<usize>,
        voxels: &mut [Emission],
    ) -> Range<usize> {
        let Source { classification, light, kept, steepness, .. } = self.source;
        let mut kept = kept.map(|kept| kept.row(place, columns.start));
        let thinning = steepness.as_ref().filter(|steepness| !steepness.thinning.is_empty());
        let mut shown: Option<Range<usize>> = None;
        for run in runs(columns.clone(), samples.len()) {
            let seen = kept.as_mut().map(KeptRow::next_run);
            let voxels = &mut voxels[run.clone()];
            if matches!(seen, Some((0, _))) {
                voxels.fill([0.0; 4]);
                continue;
            }
            let (mut colors, mut densities) = classification.run(&samples[run.clone()]);
            if densities.iter().all(|&density| density == 0.0) {
                voxels.fill([0.0; 4]);
                continue;
            }
            if let Some(steepness) = thinning {
                let (_, magnitudes) = directions(steepness.gradients, self.differences(steepness, place, &run));
                for (density, magnitude) in densities.iter_mut().zip(magnitudes) {
                    *density *= scaled_share(&steepness.thinning, magnitude);
                }
            }
            if let Some(light) = light {
                let normals = seen.map(|(_, normals)| normals).or_else(|| self.normals(place, &run));
                let xs = std::array::from_fn(|at| (run.start + at) as u32);
                let at = place.map(|place| place as u32);
                light.apply((&xs, at), &mut colors, &normals.unwrap_or([NO_NORMAL; RUN]), None);
            }
            for (at, voxel) in voxels.iter_mut().enumerate() {
                let density = densities[at];
                *voxel = [colors[0][at] * density, colors[1][at] * density, colors[2][at] * density, density];
            }
            shown = Some(shown.map_or(run.start, |shown| shown.start)..run.end);
        }
        let shown = shown.unwrap_or_default();
        shown.start.max(columns.start)..shown.end.min(columns.end)
    }

    /// The words of the normals of a run of a row; `None`: this source finds none. Beyond the faces voxels are copies
    /// of the outermost.
    fn normals(&self, place: [i64; 2], run: &Range<usize>) -> Option<[u32; RUN]> {
        let steepness = self.source.steepness.as_ref()?;
        let [nx, ..] = self.source.volume.grid().dims();
        let slopes = self.slopes(steepness.normals.as_ref()?, place, run, nx as usize);
        let (directions, _) = directions(steepness.gradients, slopes);
        Some(std::array::from_fn(|at| packed_normal([0, 1, 2].map(|axis| directions[axis][at]))))
    }

    /// Adds the normals of a row of `count` voxels of the last plane.
    fn keep(&self, place: [i64; 2], count: usize, plane: &mut KeptPlane) {
        let Some(slice) = self.slice(place[1]) else { return };
        let row = slice.row(place[0], count);
        with_samples!(&slice.samples, samples => for run in runs(0..count, count) {
            let (_, densities) = self.source.classification.run(&samples[row.clone()][run.clone()]);
            let bits = (0..RUN).filter(|&at| densities[at] != 0.0).fold(0, |bits, at| bits | 1_u16 << at);
            plane.seen.push(bits);
            if let Some(normals) = (bits != 0).then(|| self.normals(place, &run)).flatten() {
                plane.words.extend(places(bits.into()).map(|at| normals[at]));
            }
        });
    }

    /// The plane at `z`, or the outermost beyond the faces.
    fn slice(&self, z: i64) -> Option<&Slice> {
        let [.., nz] = self.source.volume.grid().dims().map(i64::from);
        let z = z.clamp(0, nz - 1);
        self.slices.iter().find(|slice| slice.z == z)
    }

    /// Central differences of a run of a row, on which gradient opacity depends.
    fn differences(&self, steepness: &Steepness, [y, z]: [i64; 2], run: &Range<usize>) -> [[f32; RUN]; 3] {
        let [nx, ny, _] = self.source.volume.grid().dims().map(i64::from);
        let reach = steepness.reach();
        let width = nx as usize + 2 * reach;
        let row = |y: i64, z: i64| {
            let y = y.clamp(0, ny - 1);
            self.slice(z).map_or(&[][..], |slice| &slice.scalars[(y - slice.first) as usize * width..][..width])
        };
        let difference = |high: &[f32], low: &[f32], step: usize| {
            let mut differences = [0.0; RUN];
            let start = run.start + reach;
            let pairs = high[start + step..].iter().zip(&low[start - step..]);
            differences[..run.len()].iter_mut().zip(pairs).for_each(|(d, (high, low))| *d = 0.5 * (high - low));
            differences
        };
        let here = row(y, z);
        [
            difference(here, here, 1),
            difference(row(y + 1, z), row(y - 1, z), 0),
            difference(row(y, z + 1), row(y, z - 1), 0),
        ]
    }

    /// Slopes of a run of a row of `nx` voxels by the filter of normals.
    fn slopes(&self, normals: &DerivativeFilter, [y, z]: [i64; 2], run: &Range<usize>, nx: usize) -> [[f32; RUN]; 3] {
        let start = (y - self.rows.start) as usize * nx + run.start;
        let tap = |axis: usize| {
            move |k: isize| {
                let plane = self.slice(z + k as i64);
                plane.map_or(&[][..], |plane| &plane.filtered[axis][start..start + run.len()])
            }
        };
        let mut slopes = [[0.0; RUN]; 3];
        let [along_x, along_y, along_z] = slopes.each_mut().map(|slopes| &mut slopes[..run.len()]);
        normals.smooth(tap(0), along_x);
        normals.smooth(tap(1), along_y);
        normals.slope(tap(2), along_z);
        slopes
    }
}

/// Gives a vector another length, or returns an error if there is no memory. Values are arbitrary.
fn resize(values: &mut Vec<f32>, count: usize) -> Result<()> {
    if values.len() != count {
        *values = filled(count, 0.0)?;
    }
    Ok(())
}

/// The runs of a row of `count` voxels that have voxels between two columns. Runs begin at multiples of their length.
fn runs(columns: Range<usize>, count: usize) -> impl Iterator<Item = Range<usize>> {
    let first = columns.start / RUN * RUN;
    (first..columns.end.max(first)).step_by(RUN).map(move |start| start..count.min(start + RUN))
}

/// The normals of the voxels that show, kept for lights that move: 4 bytes each, and a bit for each voxel.
pub(crate) struct KeptNormals {
    planes: Vec<KeptPlane>,
    /// Runs of a row.
    runs: usize,
}

/// The normals of the voxels of a plane that show.
struct KeptPlane {
    /// For each run of each row, the bits of the voxels that show.
    seen: Vec<u16>,
    /// The place of the first word of each row.
    starts: Vec<u32>,
    /// The words.
    words: Vec<u32>,
}

/// The normals of some voxels of a row, from a run on.
struct KeptRow<'a> {
    seen: &'a [u16],
    words: &'a [u32],
}

impl KeptRow<'_> {
    /// The bits of the voxels of the next run that show, and their normals; arbitrary beside them.
    fn next_run(&mut self) -> (u16, [u32; RUN]) {
        let Some((&bits, seen)) = self.seen.split_first() else { return (0, [NO_NORMAL; RUN]) };
        let (words, rest) = self.words.split_at(bits.count_ones() as usize);
        (self.seen, self.words) = (seen, rest);
        let mut normals = [NO_NORMAL; RUN];
        if bits == u16::MAX {
            normals.copy_from_slice(words);
        } else {
            places(bits.into()).zip(words).for_each(|(at, &word)| normals[at] = word);
        }
        (bits, normals)
    }
}

/// Planes whose normals a thread finds one after the other.
const PLANES: usize = 16;

impl KeptNormals {
    pub(crate) fn new(volume: &Volume, transfer: &TransferFunction) -> Result<Self> {
        let source = Source::with_normals(volume, transfer, true);
        let [nx, _, nz] = volume.grid().dims().map(i64::from);
        let starts: Vec<i64> = (0..nz).step_by(PLANES).collect();
        let planes = starts.into_par_iter().map(|start| Self::planes(&source, start..nz.min(start + PLANES as i64)));
        let planes = planes.collect::<Result<Vec<_>>>()?.into_iter().flatten().collect();
        Ok(Self { planes, runs: (nx as usize).div_ceil(RUN) })
    }

    fn planes(source: &Source<'_>, planes: Range<i64>) -> Result<Vec<KeptPlane>> {
        let [nx, ny, _] = source.volume.grid().dims();
        let mut slices = source.slices(0..i64::from(ny));
        let plane = |z| {
            slices.advance(z)?;
            let subject = || "normals of voxels".to_owned();
            let mut plane = KeptPlane {
                seen: reserved(u64::from(ny) * u64::from(nx).div_ceil(RUN as u64), subject)?,
                starts: reserved(u64::from(ny), subject)?,
                words: reserved(u64::from(nx) * u64::from(ny), subject)?,
            };
            for y in 0..i64::from(ny) {
                plane.starts.push(plane.words.len() as u32);
                slices.keep([y, z], nx as usize, &mut plane);
            }
            plane.words.shrink_to_fit();
            Ok(plane)
        };
        planes.map(plane).collect()
    }

    /// The normals of a row from the run of a column on.
    fn row(&self, [y, z]: [i64; 2], column: usize) -> KeptRow<'_> {
        let Some(KeptPlane { seen, starts, words }) = self.planes.get(z as usize) else {
            return KeptRow { seen: &[], words: &[] };
        };
        let seen = &seen[y as usize * self.runs..][..self.runs];
        let (before, seen) = seen.split_at(column / RUN);
        let before: u32 = before.iter().map(|bits| bits.count_ones()).sum();
        KeptRow { seen, words: &words[(starts[y as usize] + before) as usize..] }
    }
}

/// Voxels whose gradients are computed together.
const RUN: usize = LANES;

/// Converts slopes along the axes of the lattice to gradients in the world: directions of length 1 or 0, and
/// magnitudes.
fn directions([gx, gy, gz]: [Vec3; 3], [dx, dy, dz]: [[f32; RUN]; 3]) -> ([[f32; RUN]; 3], [f32; RUN]) {
    let mut directions = [[0.0; RUN]; 3];
    let mut magnitudes = [0.0; RUN];
    for at in 0..RUN {
        // Divided by the largest, no square leaves the range of f32.
        let most = dx[at].abs().max(dy[at].abs()).max(dz[at].abs());
        let scale = if most > f32::MIN_POSITIVE && most < f32::MAX { 1.0 / most } else { 0.0 };
        let gradient = gx * (scale * dx[at]) + gy * (scale * dy[at]) + gz * (scale * dz[at]);
        let square = gradient.length_squared();
        let length = square.sqrt();
        let unit = if length > 0.0 { gradient / length } else { Vec3::ZERO };
        magnitudes[at] = length * most;
        directions[0][at] = unit.x;
        directions[1][at] = unit.y;
        directions[2][at] = unit.z;
    }
    (directions, magnitudes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::layout::Lighting;
    use crate::gpu::splat::ToEye;
    use crate::transfer::{ControlPoint, GradientPoint};

    #[test]
    fn rows_with_kept_normals_are_rows_without() {
        // Runs that show wholly, in part and not at all; the last one is cut.
        let dims = [45, 7, 6];
        let points = (0..45 * 7 * 6_u32).map(|i| (i % 45, i / 45 % 7, i / (45 * 7)));
        let samples =
            points.map(|(x, y, z)| if x / 9 % 3 == 1 { 0.0 } else { ((x * 37 + y * 11 + z * 5) % 97) as f32 });
        let volume = Volume::from_slice(dims, [1.0, 1.0, 2.0], &samples.collect::<Vec<_>>()).unwrap();
        let point = |value, color, opacity| ControlPoint { value, color, opacity };
        let shown = [point(0.0, [0.2, 0.9, 0.4], 0.0), point(30.0, [0.8; 3], 0.0), point(97.0, [1.0, 0.3, 0.1], 0.6)];
        let plain = TransferFunction::new(shown.to_vec(), None).unwrap();
        let ramp = [(0.0, 0.0), (40.0, 1.0)].map(|(magnitude, opacity)| GradientPoint { magnitude, opacity });
        let thinned = plain.clone().with_gradient_opacity(ramp.to_vec()).unwrap();
        let lighting = Lighting {
            right: [1.0, 0.0, 0.0],
            up: [0.0, 1.0, 0.0],
            forward: [0.0, 0.0, 1.0],
            ambient: 0.1,
            diffuse: 0.7,
            specular: 0.3,
            shininess: 20.0,
            lights: [[0.6, 0.0, -0.8, 0.0]; 4],
            colors: [[1.0, 0.9, 0.8, 0.0]; 4],
            ..Lighting::default()
        };
        let light = SplatLight { lighting, lights: 1, points: false, to_eye: ToEye::PARALLEL };
        for transfer in [plain, thinned] {
            let kept = KeptNormals::new(&volume, &transfer).unwrap();
            let [found, kept] = [None, Some(&kept)].map(|kept| Source::new(&volume, &transfer, Some(&light), kept));
            let [mut found, mut kept] = [&found, &kept].map(|source| source.slices(1..6));
            let mut lit = 0;
            for (z, columns) in (0..6).zip([0..45, 3..20, 16..32, 44..45, 0..16, 31..40]) {
                found.advance(z).unwrap();
                kept.advance(z).unwrap();
                for y in 1..6 {
                    let voxels = [&found, &kept].map(|slices| {
                        let mut voxels = vec![[f32::NAN; 4]; 45];
                        let shown = slices.row([y, z], &columns, &mut voxels);
                        assert!(shown.is_empty() || shown.start >= columns.start && shown.end <= columns.end);
                        let of = |x: usize| if shown.contains(&x) { voxels[x] } else { [0.0; 4] };
                        // Transparent voxels beside those that show are written too.
                        assert!(columns.clone().all(|x| of(x) == voxels[x] || shown.is_empty()), "{y} {z} {shown:?}");
                        columns.clone().map(of).collect::<Vec<_>>()
                    });
                    assert_eq!(voxels[0], voxels[1], "{y} {z}");
                    lit += voxels[0].iter().filter(|[.., density]| *density > 0.0).count();
                }
            }
            assert!(lit > 100, "{lit}");
        }
    }
}
