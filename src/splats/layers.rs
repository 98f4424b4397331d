//! Layers on one lattice to splats. The emissions of all layers are added up voxel by voxel; the normal is the normal
//! of the layer with the largest density there.

use std::cell::OnceCell;

use super::brick::MadeBrick;
use super::classification::{ColorSource, Emission, SampleClassifier};
use super::gradients::{RowVectors, gradient_of, gradients, steepness_of, tensor_normals};
use super::words::{packed_appearance, packed_normal, resolution_at};
use crate::error::Result;
use crate::kernel::DerivativeFilter;
use crate::layers::{Layer, Layers, Mask, Matter, luminance};
use crate::lighting::Normals;
use crate::transfer::scalars::{Reduction, Relative};
use crate::transfer::{Pieces, Resolution, TransferFunction, scaled_share};
use crate::volume::{BRICK_EDGE as EDGE, Number, RowCoding, Strip, Volume};

/// The number of voxels, to either side, on which a smoothed normal depends: labels and masks jump, and gradients of
/// samples would be blocky.
const REACH: usize = 4;
/// The standard deviation of the Gaussian of smoothed normals, in voxels.
const DEVIATION: f64 = 1.5;
/// The least gradient of the smoothed field that is a surface, per voxel, as a share of the largest extinction of the
/// layer.
const FLAT: f32 = 1e-4;

/// A layer with its classification.
struct Painted<'a> {
    /// The volumes that are read: one, or if voxels have colours, red, green, blue and perhaps alpha.
    volumes: Vec<&'a Volume>,
    /// The value of white, if voxels have colours.
    white: Option<f64>,
    classification: SampleClassifier<'a>,
    scalars: Option<Relative>,
    /// The emission of scalars, if classification is band-limited.
    pieces: Option<Pieces>,
    /// The factor from a unit of optical depth to densities.
    unit: f64,
    /// The points of gradient opacity, for gradients of scalars; empty: extinction does not depend on gradients.
    thinning: Vec<[f32; 2]>,
    /// The resolution of a scalar of 0; `None`: every gradient of scalars is a surface.
    faintest: Option<f32>,
    mask: Option<&'a Mask>,
    /// Whether normals are gradients of the smoothed extinction, not of scalars.
    smoothed: bool,
    /// The least gradient of the smoothed extinction that is a surface.
    flat: f32,
    /// Whether each brick, x fastest, may have visible voxels.
    shows: Vec<bool>,
}

impl<'a> Painted<'a> {
    fn new(layer: &'a Layer, unit: f64, keep: bool) -> Result<Self> {
        let volume = layer.volume();
        let unit = unit / layer.unit();
        let (mut volumes, mut white) = (vec![volume], None);
        let (mut faintest, mut pieces) = (None, None);
        let (looks, scalars, thinning) = match &layer.matter {
            Matter::Scalars { transfer, .. } => {
                let reduction = Reduction::new(transfer, 1.0);
                let scale = reduction.factor() * volume.grid().unit();
                let thinning = transfer.scaled_gradient_opacity(scale);
                let place = |value: f64| reduction.length(value - reduction.base());
                pieces = transfer.is_band_limited().then(|| Pieces::new(transfer, place));
                faintest = Some(reduction.faintest(&Resolution::new(transfer, volume)?));
                (ColorSource::Transfer(transfer), Some(Relative::new(volume, reduction)), thinning)
            }
            Matter::Labels { looks, .. } => (ColorSource::Labels(looks), None, Vec::new()),
            Matter::Colors(colors) => {
                volumes = colors.channels.iter().chain(&colors.alpha).collect();
                white = Some(colors.white);
                let reduction = Reduction::new(&colors.transfer, 1.0);
                (ColorSource::Transfer(&colors.transfer), Some(Relative::of_values(reduction)), Vec::new())
            }
        };
        let ranges = volumes.iter().map(|volume| value_ranges(volume)).collect::<Result<Vec<_>>>()?;
        let range = |brick: usize| match ranges.as_slice() {
            [red, green, blue] => [0, 1].map(|end| luminance([red, green, blue].map(|c| c[brick][end]))),
            [.., last] => last[brick],
            [] => [f64::NEG_INFINITY, f64::INFINITY],
        };
        let bricks = ranges.first().map_or(0, Vec::len);
        let mut shows: Vec<bool> = (0..bricks).map(|brick| keep || looks.show(range(brick))).collect();
        if let Some(Mask { volume, shown }) = &layer.mask {
            for (shows, [low, high]) in shows.iter_mut().zip(value_ranges(volume)?) {
                let from = shown.partition_point(|&label| (label as f64) < low);
                *shows &= shown.get(from).is_some_and(|&label| label as f64 <= high);
            }
        }
        Ok(Self {
            classification: match white {
                // Values are luminance or alpha.
                Some(_) => SampleClassifier::of_values(looks, unit),
                None => SampleClassifier::new(volume, looks, unit),
            },
            volumes,
            white,
            smoothed: scalars.is_none() || layer.mask.is_some(),
            scalars,
            pieces,
            unit,
            thinning,
            faintest,
            mask: layer.mask.as_ref(),
            flat: FLAT * (TransferFunction::extinction(layer.max_opacity(), 1.0) * unit) as f32,
            shows,
        })
    }

    /// Returns the slope under which slopes of scalars are rounding, at a voxel of this scalar.
    fn resolution(&self, scalar: f32) -> f32 {
        self.faintest.map_or(0.0, |faintest| resolution_at(scalar, faintest))
    }

    /// Returns whether voxels are classified one by one.
    fn is_by_value(&self) -> bool {
        self.pieces.is_none() || self.smoothed
    }

    /// Reads the voxels of a brick with the halo around it. `normals` if their normals are needed.
    fn voxels(&self, at: [usize; 3], (samples, mask): &Strips, normals: bool) -> Part<'_> {
        let at = at.map(|c| c as i64);
        let (mut emissions, mut scalars) = (Vec::new(), Vec::new());
        match (samples.as_slice(), &self.scalars, self.white) {
            ([samples], of_scalars, _) => {
                if self.is_by_value() {
                    emissions = bytemuck::pod_collect_to_vec(&samples.brick(at, self));
                }
                let differs = normals && !self.smoothed || self.pieces.is_some() || !self.thinning.is_empty();
                if let Some(relative) = of_scalars.as_ref().filter(|_| differs) {
                    scalars = bytemuck::pod_collect_to_vec(&samples.brick(at, relative));
                }
            }
            (channels, of_scalars, white) => {
                let values = |(strip, volume): (&Strip, &&Volume)| -> Vec<f32> {
                    bytemuck::pod_collect_to_vec(&strip.brick(at, &Values(volume)))
                };
                let channels: Vec<Vec<f32>> = channels.iter().zip(&self.volumes).map(values).collect();
                for i in 0..channels.iter().map(Vec::len).min().unwrap_or_default() {
                    let (emission, value) = self.colored(channels.iter().map(|c| c[i]), white.unwrap_or(1.0));
                    emissions.push(emission);
                    scalars.push(of_scalars.as_ref().map_or(0.0, |relative| relative.to(value)));
                }
            }
        }
        let mut shares = Vec::new();
        if let (Some(strip), Some(mask)) = (mask, self.mask) {
            shares = strip.brick(at, mask);
            for (emission, &shown) in emissions.iter_mut().zip(&shares) {
                let share = f32::from(shown);
                emission.iter_mut().for_each(|channel: &mut f32| *channel *= share);
            }
        }
        Part { layer: self, emissions, scalars, shares, gradients: OnceCell::new() }
    }

    /// Returns the emission of a voxel of red, green, blue and perhaps alpha, and the value of its scalar.
    fn colored(&self, mut channels: impl Iterator<Item = f32>, white: f64) -> (Emission, f64) {
        let color: [f64; 3] = std::array::from_fn(|_| channels.next().map_or(0.0, f64::from));
        let value = channels.next().map_or_else(|| luminance(color), f64::from);
        let [.., density] = self.classification.classified(value);
        let [r, g, b] = color.map(|channel| (channel / white).clamp(0.0, 1.0) as f32 * density);
        ([r, g, b, density], value)
    }
}

/// Strips of the volumes of a layer, and of its mask.
type Strips = (Vec<Strip>, Option<Strip>);

/// The values of a volume in f32.
struct Values<'a>(&'a Volume);

impl RowCoding for Values<'_> {
    fn append<T: Number>(&self, samples: &[T], bytes: &mut Vec<u8>) {
        let (slope, intercept) = self.0.rescale();
        bytes.extend(samples.iter().flat_map(|s| ((slope * s.to_f64() + intercept) as f32).to_ne_bytes()));
    }
}

/// Returns the ranges of values of the bricks of a volume.
fn value_ranges(volume: &Volume) -> Result<Vec<[f64; 2]>> {
    let (slope, intercept) = volume.rescale();
    let values = |range: &[f64; 2]| {
        let [a, b] = range.map(|raw| slope * raw + intercept);
        [a.min(b), a.max(b)]
    };
    Ok(volume.ranges()?.iter().map(values).collect())
}

impl RowCoding for Painted<'_> {
    fn append<T: Number>(&self, samples: &[T], bytes: &mut Vec<u8>) {
        // Labels come in runs.
        let mut last: Option<(f64, Emission)> = None;
        for &sample in samples {
            let raw = sample.to_f64();
            let emission = match last {
                Some((of, emission)) if of == raw => emission,
                _ => self.classification.emission(sample),
            };
            last = Some((raw, emission));
            bytes.extend_from_slice(bytemuck::bytes_of(&emission));
        }
    }
}

impl RowCoding for Mask {
    fn append<T: Number>(&self, samples: &[T], bytes: &mut Vec<u8>) {
        let (slope, intercept) = self.volume.rescale();
        let mut last = (f64::NAN, 0);
        bytes.extend(samples.iter().map(|sample| {
            let raw = sample.to_f64();
            if last.0 != raw {
                let label = (slope * raw + intercept) as i64;
                last = (raw, u8::from(self.shown.binary_search(&label).is_ok()));
            }
            last.1
        }));
    }
}

/// A classifier of layers, which makes splats of their visible voxels, brick by brick.
pub(crate) struct LayerClassifier<'a> {
    layers: Vec<Painted<'a>>,
    dims: [u32; 3],
    /// The number of bricks along each axis.
    pub(crate) counts: [usize; 3],
    gradients: [[f32; 3]; 3],
    /// The kind of normals; `None`: there is no light.
    normals: Option<Normals>,
    keep_invisible: bool,
    /// The number of voxels around a brick on which its splats depend.
    pub(crate) halo: usize,
    /// The filter of the normals of scalars, and the filter of smoothed normals.
    filters: [DerivativeFilter; 2],
}

/// The savings of the classification: work that is left out.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LeftOut {
    /// Whether invisible voxels are left out.
    pub(crate) voxels: bool,
    /// Whether bricks without visible voxels are left out, unread.
    pub(crate) bricks: bool,
}

impl<'a> LayerClassifier<'a> {
    /// Prepares the classification of layers, with these normals if there is light.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if samples cannot be read.
    pub(crate) fn new(layers: &'a Layers, normals: Option<Normals>, left_out: LeftOut) -> Result<Self> {
        let keep = !left_out.voxels || !left_out.bricks;
        let painted = layers.all().iter().map(|layer| Painted::new(layer, layers.unit(), keep));
        let painted = painted.collect::<Result<Vec<Painted<'_>>>>()?;
        let halo = match (normals, painted.iter().any(|layer| layer.smoothed)) {
            (Some(_), true) => REACH,
            (Some(normals), false) => normals.reach(),
            (None, _) => usize::from(painted.iter().any(|layer| layer.pieces.is_some() || !layer.thinning.is_empty())),
        };
        let volume = layers.volume();
        Ok(Self {
            layers: painted,
            dims: volume.grid().dims(),
            counts: volume.bricks().map(|n| n as usize),
            gradients: gradients(volume),
            normals,
            keep_invisible: !left_out.voxels,
            halo,
            filters: [DerivativeFilter::of_normals(), DerivativeFilter::gaussian(DEVIATION, REACH)],
        })
    }
}

impl LayerClassifier<'_> {
    /// Makes the bricks with splats along x, with these numbers in y and z.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if samples cannot be read.
    pub(crate) fn row(&self, [j, k]: [usize; 2]) -> Result<Vec<MadeBrick>> {
        let [across, down, _] = self.counts;
        let first = (k * down + j) * across;
        let (y, z) = (j * EDGE, k * EDGE);
        let strip = |volume: &Volume| volume.strip([y, z].map(|c| c as i64), self.halo);
        let strips = self.layers.iter().map(|layer| {
            if !layer.shows[first..first + across].contains(&true) {
                return Ok(None);
            }
            let samples = layer.volumes.iter().map(|volume| strip(volume)).collect::<Result<Vec<Strip>, _>>()?;
            Ok(Some((samples, layer.mask.map(|mask| strip(&mask.volume)).transpose()?)))
        });
        let strips: Vec<Option<Strips>> = strips.collect::<Result<_>>()?;
        let mut bricks = Vec::new();
        for i in 0..across {
            let at = [i * EDGE, y, z];
            let showing = self.layers.iter().zip(&strips).filter(|(layer, _)| layer.shows[first + i]);
            let lit = self.normals.is_some();
            let showing = showing.filter_map(|(layer, strips)| Some(layer.voxels(at, strips.as_ref()?, lit)));
            let showing: Vec<_> = showing.collect();
            bricks.push(self.brick(at, &showing)?);
        }
        bricks.retain(|made| made.splats.count() > 0);
        Ok(bricks)
    }

    /// Returns the world gradients of the scalar of a layer, or of its smoothed extinction, in a brick and in the
    /// voxels around it that [`Self::beside`] counts; `None` if voxels are equal.
    fn gradients(&self, Part { layer, emissions, scalars, .. }: &Part<'_>) -> Option<[Vec<f32>; 3]> {
        let extinctions: Vec<f32>;
        let field = if layer.smoothed {
            extinctions = emissions.iter().map(|emission| emission[3]).collect();
            &extinctions
        } else {
            scalars
        };
        if field.iter().all(|value| *value == field[0]) {
            return None;
        }
        let beside = self.beside(layer);
        let (wide, edge, first) = (EDGE + 2 * beside, EDGE + 2 * self.halo, self.halo - beside);
        let slopes = self.filters[usize::from(layer.smoothed)].slopes(field, wide, first);
        let [x, y, z] = self.gradients;
        let mut gradients = slopes;
        for row in 0..wide * wide {
            let field = &field[first + edge * (row % wide + first + edge * (row / wide + first))..][..wide];
            let [a, b, c] = gradients.each_mut().map(|slopes| &mut slopes[wide * row..][..wide]);
            for i in 0..wide {
                let resolution = if layer.smoothed { layer.flat } else { layer.resolution(field[i]) };
                let is_surface = a[i].abs().max(b[i].abs()).max(c[i].abs()) >= resolution;
                let share = if is_surface { 1.0 } else { 0.0 };
                let along = |axis: usize| share * (x[axis] * a[i] + y[axis] * b[i] + z[axis] * c[i]);
                [a[i], b[i], c[i]] = [along(0), along(1), along(2)];
            }
        }
        Some(gradients)
    }

    /// Returns the number of voxels around a brick on whose gradients its normals depend.
    fn beside(&self, layer: &Painted<'_>) -> usize {
        usize::from(self.normals == Some(Normals::Tensor) && !layer.smoothed)
    }

    /// Makes the splats of the brick that begins at a lattice point.
    fn brick(&self, origin: [usize; 3], parts: &[Part<'_>]) -> Result<MadeBrick> {
        let edge = EDGE + 2 * self.halo;
        let each = if self.normals.is_some() { 3 } else { 2 };
        MadeBrick::of_rows(origin.map(|c| c as u32), self.dims, each, |[y, z], count, words| {
            let start = self.halo + edge * (y + self.halo + edge * (z + self.halo));
            let mut bits = 0;
            let mut normals = vec![None; parts.len()];
            for x in 0..count {
                let mut sum: Emission = [0.0; 4];
                let mut densest = (0.0, None);
                for (number, part) in parts.iter().enumerate() {
                    let emission = self.emission(part, start + x);
                    if emission[3] > densest.0 {
                        densest = (emission[3], Some(number));
                    }
                    sum.iter_mut().zip(emission).for_each(|(sum, channel)| *sum += channel);
                }
                let [r, g, b, density] = sum;
                if density <= 0.0 && !self.keep_invisible {
                    continue;
                }
                bits |= 1 << x;
                let color = [r, g, b].map(|channel| if density > 0.0 { channel / density } else { 0.0 });
                words.extend(packed_appearance(color, density));
                if self.normals.is_some() {
                    let normal = densest.1.map_or([0.0; 3], |number: usize| {
                        let row = normals[number].get_or_insert_with(|| self.normals(&parts[number], [y, z]));
                        row.map(|row| row[x])
                    });
                    words.push(packed_normal(normal));
                }
            }
            bits
        })
    }

    /// Returns the band-limited emission of a layer at a voxel of its brick.
    fn band_limited(&self, pieces: &Pieces, Part { layer, scalars, shares, .. }: &Part<'_>, index: usize) -> Emission {
        if shares.get(index) == Some(&0) {
            return [0.0; 4];
        }
        let edge = EDGE + 2 * self.halo;
        let own = scalars[index];
        let (mut range, mut differences) = ([own; 2], [0.0; 3]);
        for (difference, step) in differences.iter_mut().zip([1, edge, edge * edge]) {
            let [a, b] = [scalars[index - step], scalars[index + step]];
            range = [range[0].min(a).min(b), range[1].max(a).max(b)];
            *difference = f64::from(b) - f64::from(a);
        }
        let range = range.map(f64::from);
        if pieces.is_clear(range) {
            return [0.0; 4];
        }
        let rise = || 0.5 * differences.iter().map(|d| d * d).sum::<f64>().sqrt();
        pieces.emission(f64::from(own), range, rise()).map(|channel| (channel * layer.unit) as f32)
    }

    fn emission(&self, part: &Part<'_>, index: usize) -> Emission {
        let Part { layer, scalars, .. } = part;
        let [r, g, b, density] = match &layer.pieces {
            Some(pieces) => self.band_limited(pieces, part, index),
            None => part.emissions[index],
        };
        if layer.thinning.is_empty() || density <= 0.0 {
            return [r, g, b, density];
        }
        let edge = EDGE + 2 * self.halo;
        let differences = [1, edge, edge * edge].map(|step| 0.5 * (scalars[index + step] - scalars[index - step]));
        let gradient = gradient_of(&self.gradients, differences, layer.resolution(scalars[index]));
        let share = scaled_share(&layer.thinning, steepness_of(gradient));
        [r, g, b, density].map(|channel| channel * share)
    }

    /// Returns the normals of a layer in a row of its brick, of any length.
    fn normals(&self, part: &Part<'_>, [y, z]: [usize; 2]) -> RowVectors {
        let Some(gradients) = part.gradients.get_or_init(|| self.gradients(part)) else { return [[0.0; EDGE]; 3] };
        let beside = self.beside(part.layer);
        let wide = EDGE + 2 * beside;
        let at = beside + wide * (y + beside + wide * (z + beside));
        let row = |at: usize| gradients.each_ref().map(|gradients| &gradients[at..][..EDGE]);
        if beside == 0 {
            return row(at).map(|row| row.try_into().unwrap_or([0.0; EDGE]));
        }
        let neighbours = [1, wide, wide * wide].map(|step| [row(at - step), row(at + step)]);
        let [[a, b], [c, d], [e, f]] = neighbours;
        tensor_normals(row(at), [a, b, c, d, e, f])
    }
}

/// The voxels of a layer in a brick, with the halo around it.
struct Part<'a> {
    layer: &'a Painted<'a>,
    /// The emissions of voxels; empty if voxels are not classified one by one.
    emissions: Vec<Emission>,
    /// The scalars of voxels; empty if nothing depends on them.
    scalars: Vec<f32>,
    /// The mask: 1 where it shows the voxel, otherwise 0; empty without a mask.
    shares: Vec<u8>,
    /// The gradients in the brick, found when needed; see [`LayerClassifier::gradients`].
    gradients: OnceCell<Option<[Vec<f32>; 3]>>,
}
