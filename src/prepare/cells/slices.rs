//! Voxels from the samples of a volume: classified, thinned by gradient opacity and lit, a few planes of rows at a
//! time.

use std::ops::Range;

use glam::Vec3;
use rayon::prelude::*;

use super::classification::{Classification, ColorSource, Emission};
use super::filled;
use crate::error::Result;
use crate::gpu::classify::gradients;
use crate::gpu::splat::{LANES, NO_NORMAL, SplatLight, packed_normal};
use crate::gpu::transfer::{Reduction, Relative};
use crate::kernel::{DerivativeFilter, NORMAL_REACH};
use crate::transfer::{TransferFunction, scaled_share};
use crate::volume::{Samples, ToF64, Volume, with_samples};
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
    /// all are transparent.
    pub(super) fn row(&self, place: [i64; 2], columns: &Range<usize>, voxels: &mut [Emission]) -> Range<usize> {
        let all = self.classify(place, voxels);
        let shown = all.start.max(columns.start)..all.end.min(columns.end);
        if shown.is_empty() {
            return 0..0;
        }
        let before = || voxels[all.start..shown.start].iter().filter(|voxel| shows(voxel)).count();
        let mut kept = self.source.kept.map(|kept| kept.row(place).skip(before()));
        for run in runs(shown.clone(), voxels) {
            // The voxels to be lit, and their normals.
            let (mut xs, mut normals, mut count) = ([0; RUN], [0; RUN], 0);
            if let Some(kept) = &mut kept {
                let shown = run.clone().filter(|&x| shows(&voxels[x]));
                for ((x, to), normal) in shown.zip(&mut xs).zip(&mut normals) {
                    *to = x as u32;
                    *normal = kept.next().unwrap_or(NO_NORMAL);
                    count += 1;
                }
            } else if let Some(found) = self.normals(place, &run) {
                normals = found;
                xs = std::array::from_fn(|at| (run.start + at) as u32);
                count = run.len();
            }
            let steepness = self.source.steepness.as_ref();
            if let Some(steepness) = steepness.filter(|steepness| !steepness.thinning.is_empty()) {
                let (_, magnitudes) = directions(steepness.gradients, self.differences(steepness, place, &run));
                for (voxel, magnitude) in voxels[run].iter_mut().zip(magnitudes) {
                    let share = scaled_share(&steepness.thinning, magnitude);
                    voxel.iter_mut().for_each(|channel| *channel *= share);
                }
            }
            if let Some(light) = self.source.light {
                shine(light, place, (&xs, &normals, count), voxels);
            }
        }
        shown
    }

    /// Classifies a row. Returns a range outside which all voxels are transparent.
    fn classify(&self, [y, z]: [i64; 2], voxels: &mut [Emission]) -> Range<usize> {
        let Some(slice) = self.slices.iter().find(|slice| slice.z == z) else { return 0..0 };
        let count = voxels.len();
        let start = (y - slice.first) as usize * count;
        with_samples!(&slice.samples, s => self.source.classification.row(&s[start..start + count], voxels))
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

/// The runs of a row in which some voxel shows, given a range outside which none does.
fn runs(shown: Range<usize>, voxels: &[Emission]) -> Vec<Range<usize>> {
    let runs = shown.clone().step_by(RUN).map(|start| start..shown.end.min(start + RUN));
    runs.filter(|run| voxels[run.clone()].iter().any(shows)).collect()
}

fn shows(voxel: &Emission) -> bool {
    voxel[3] != 0.0
}

/// Lights `count` voxels of a row, given their places along it and their normals.
fn shine(
    light: &SplatLight,
    place: [i64; 2],
    (xs, normals, count): (&[u32; RUN], &[u32; RUN], usize),
    voxels: &mut [Emission],
) {
    let mut colors = [[0.0; RUN]; 3];
    for (at, &x) in xs[..count].iter().enumerate() {
        let [r, g, b, density] = voxels[x as usize];
        if density > 0.0 {
            [colors[0][at], colors[1][at], colors[2][at]] = [r / density, g / density, b / density];
        }
    }
    light.apply((xs, place.map(|place| place as u32)), &mut colors, normals, None);
    for (at, &x) in xs[..count].iter().enumerate() {
        let voxel = &mut voxels[x as usize];
        (0..3).for_each(|channel| voxel[channel] = colors[channel][at] * voxel[3]);
    }
}

/// The normals of the voxels that show, kept for lights that move: 4 bytes each.
pub(crate) struct KeptNormals {
    /// By plane: the place of the first word of each row, and the words.
    planes: Vec<(Vec<u32>, Vec<u32>)>,
}

/// Planes whose normals a thread finds one after the other.
const PLANES: usize = 16;

impl KeptNormals {
    pub(crate) fn new(volume: &Volume, transfer: &TransferFunction) -> Result<Self> {
        let source = Source::with_normals(volume, transfer, true);
        let [.., nz] = volume.grid().dims().map(i64::from);
        let starts: Vec<i64> = (0..nz).step_by(PLANES).collect();
        let planes = starts.into_par_iter().map(|start| Self::planes(&source, start..nz.min(start + PLANES as i64)));
        Ok(Self { planes: planes.collect::<Result<Vec<_>>>()?.into_iter().flatten().collect() })
    }

    fn planes(source: &Source<'_>, planes: Range<i64>) -> Result<Vec<(Vec<u32>, Vec<u32>)>> {
        let [nx, ny, _] = source.volume.grid().dims();
        let mut slices = source.slices(0..i64::from(ny));
        let mut voxels = filled(nx as usize, [0.0; 4])?;
        let plane = |z| {
            slices.advance(z)?;
            let subject = || "normals of voxels".to_owned();
            let mut starts = reserved(u64::from(ny), subject)?;
            let mut words = reserved(u64::from(nx) * u64::from(ny), subject)?;
            for y in 0..i64::from(ny) {
                starts.push(words.len() as u32);
                let shown = slices.classify([y, z], &mut voxels);
                for run in runs(shown, &voxels) {
                    let normals = slices.normals([y, z], &run).into_iter().flatten();
                    words.extend(voxels[run].iter().zip(normals).filter(|(voxel, _)| shows(voxel)).map(|(_, n)| n));
                }
            }
            words.shrink_to_fit();
            Ok((starts, words))
        };
        planes.map(plane).collect()
    }

    /// The words of the voxels of a row that show, followed by others.
    fn row(&self, [y, z]: [i64; 2]) -> impl Iterator<Item = u32> {
        let plane = self.planes.get(z as usize);
        let words = plane.map_or(&[][..], |(starts, words)| &words[starts[y as usize] as usize..]);
        words.iter().copied()
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
