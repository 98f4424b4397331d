//! The splats of a picture, made when a picture needs them and kept for the next one.

use std::sync::{Arc, Mutex, PoisonError};

use super::cells::{CellSize, Shape};
use super::lattice::Lattice;
use super::levels::ScalarNeed;
use super::light_on_host;
use super::light_volume::FallenLight;
use super::scalar_cells;
use super::scalars::{Emission, EmissionKey, Samples};
use super::shadows::{Occluders, Shadows, shaded};
use crate::error::{Error, Result};
use crate::gpu::cache::Cache;
use crate::gpu::cells;
use crate::gpu::context::Context;
use crate::gpu::drawable::Drawable;
use crate::gpu::held_samples::HeldSamples;
use crate::gpu::kept_voxels::KeptVoxels;
use crate::gpu::samples::{Bricks, Input};
use crate::gpu::splat::SplatLight;
use crate::gpu::voxels::Voxels;
use crate::kernel::Kernel;
use crate::layers::Layers;
use crate::lighting::Normals;
use crate::progress::Progress;
use crate::settings::Model;
use crate::splats::layers::{self, LeftOut};
use crate::stats::on_host;
use crate::transfer::bins::VisibleValues;
use crate::transfer::scalars::Reduction;
use crate::transfer::{Resolution, TransferFunction};
use crate::volume::{BRICK_EDGE, Volume};

/// Classifies layers on the host: returns their visible voxels, with normals if there is light.
pub(crate) fn classified(
    context: &Context,
    layers: &Layers,
    normals: Option<Normals>,
    progress: &Progress,
) -> Result<(Arc<Voxels>, Bricks)> {
    let left_out = LeftOut { voxels: context.savings.voxels, bricks: context.savings.bricks };
    let classifier = layers::LayerClassifier::new(layers, normals, left_out)?;
    let row = |j: usize, k: usize| classifier.row([j, k]);
    let [across, down, deep] = classifier.counts;
    let (volume, mut made, mut rows) = (layers.volume(), Vec::new(), 0);
    volume.for_each_row([down, deep], classifier.halo, &row, &mut |bricks| {
        made.extend(bricks);
        rows += 1;
        progress.report("classifying", f64::from(rows) / (down * deep) as f64);
        progress.check()
    })?;
    let voxels = Voxels::send(context, volume.grid().dims(), &made, normals)?;
    let bricks = Bricks { all: (across * down * deep) as u32, uploaded: made.len() as u32, bytes: voxels.bytes() };
    Ok((voxels, bricks))
}

/// The last value made, with its key.
pub(super) struct LastValue<K, V>(Mutex<Option<(K, Arc<V>)>>);

impl<K, V> Default for LastValue<K, V> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<K, V> LastValue<K, V> {
    /// Returns the held value if its key serves, otherwise the value that `make` makes for `key`, given the held one.
    /// Also returns the seconds that making it took, 0 for a held value.
    pub(super) fn get_or_make(
        &self,
        key: K,
        serves: impl Fn(&K, &K) -> bool,
        make: impl FnOnce(Option<(K, Arc<V>)>) -> Result<Arc<V>>,
    ) -> Result<(Arc<V>, f64)> {
        let lock = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let held = {
            let mut held = lock();
            match &*held {
                Some((of, value)) if serves(of, &key) => return Ok((Arc::clone(value), 0.0)),
                _ => held.take(),
            }
        };
        // Not made under the lock: the maker waits for a pool of threads, which may hand it work that takes the lock.
        let (made, seconds) = on_host(|| make(held));
        let made = made?;
        *lock() = Some((key, Arc::clone(&made)));
        Ok((made, seconds))
    }

    pub(super) fn clear(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }
}

/// The key of cells: the light on their voxels, and the shadows.
type CellsKey = (Option<SplatLight>, Option<Shadows>);

/// The key of visible voxels: the shadows on them, and the number of earlier changes of the transfer function.
type ClassifiedKey = (Option<Shadows>, u32);

/// A volume prepared for pre-shading.
pub(super) struct PreShaded {
    pub(super) layers: Layers,
    /// The kind of the splats' normals; `None`: splats have no normals.
    pub(super) normals: Option<Normals>,
    /// The visible voxels, with the shadows on them.
    pub(super) classified: LastValue<ClassifiedKey, Drawable>,
    /// The occluders of shadows.
    occluders: Occluders,
    /// The samples on the device, held from the first picture on.
    samples: HeldSamples,
    /// The number of changes of the transfer function.
    edits: u32,
    /// The visible voxels among the samples on the device, and their normals.
    visible: KeptVoxels,
    /// The cells of each size.
    pub(super) cells: [LastValue<CellsKey, Drawable>; CellSize::COUNT],
}

/// A volume prepared for post-shading.
pub(super) struct PostShaded {
    /// The samples, filtered if the picture is sharpened.
    pub(super) volume: Volume,
    /// The kernel and the sharpness for which the samples are filtered.
    pub(super) sharpened: Option<(Kernel, f64)>,
    pub(super) transfer: TransferFunction,
    pub(super) reduction: Reduction,
    /// The resolution of values: smaller differences are rounding.
    pub(super) resolution: Resolution,
    /// The model for which the volume was prepared.
    pub(super) model: Model,
    pub(super) shows: VisibleValues,
    /// The tables by which scalars are classified, and whether the volume has plateaus.
    pub(super) kept: Cache,
    /// The light that arrives in the volume.
    pub(super) light: LastValue<Shadows, FallenLight>,
    /// The splats for each size of cells.
    pub(super) emitted: [LastValue<EmissionKey, Drawable>; CellSize::COUNT],
    /// The samples on the device, held from the first picture of the painter `tiles` on.
    pub(super) samples: HeldSamples,
    /// Whether the splats serve other transfer functions too.
    pub(super) whole: bool,
}

impl PostShaded {
    /// Returns the scalars of a key as samples on the device. `lit` if pictures are lit.
    pub(super) fn sampled(
        &self,
        (context, pipelines): (&Context, &Cache),
        (key, lit): (&EmissionKey, bool),
        progress: &Progress,
    ) -> Result<Samples> {
        let Self { volume, transfer, shows, samples, .. } = self;
        let emission = Emission::new(context, volume, transfer, *shows, key)?;
        emission.sampled((context, pipelines), transfer, (samples, lit), progress)
    }

    /// Lists scalars, or uses samples in their place if the key permits it. `lit` if pictures are lit.
    pub(super) fn emit(
        &self,
        (context, pipelines): (&Context, &Cache),
        (key, lit): (&EmissionKey, bool),
        progress: &Progress,
    ) -> Result<Drawable> {
        let Self { volume, transfer, shows, samples, .. } = self;
        let emission = Emission::new(context, volume, transfer, *shows, key)?;
        if key.need.samples {
            let sampled = || emission.sampled((context, pipelines), transfer, (samples, lit), progress);
            return match context.guarded("holding samples", sampled)? {
                Samples::Held(made) => Ok(made),
                Samples::Outgrown => Ok(Drawable::outgrown()),
                Samples::Invisible => Ok(Drawable::default()),
            };
        }
        context.guarded("emitting scalars", || emission.emit(context, progress))
    }

    /// Returns the splats of scalars of a lattice, and the seconds that it took to make them.
    pub(super) fn emitted(
        &self,
        (context, pipelines): (&Context, &Cache),
        lattice: &Lattice,
        need: ScalarNeed,
        progress: &Progress,
    ) -> Result<(Arc<Drawable>, f64)> {
        let (kernel, normalization) = lattice.kernel_of_voxels();
        let coarse = lattice.coarse.map(|(coarse, ..)| coarse);
        let (lit, whole, reduction) = (lattice.settings.lighting.is_some(), self.whole, self.reduction);
        let emitted = &self.emitted[lattice.size.number()];
        let key = EmissionKey { kernel, normalization, need, lit, coarse, whole, reduction };
        emitted.get_or_make(key, EmissionKey::serves, |held| {
            // Samples are packed over those before.
            let kept = held.filter(|_| need.samples).map(|(_, before)| Arc::clone(&before.kept)).unwrap_or_default();
            Ok(Arc::new(self.emit((context, pipelines), (&key, lit), progress)?.with_kept(kept)))
        })
    }

    /// Replaces the transfer function. From the first change on there are splats of all voxels, which serve further
    /// functions.
    pub(super) fn set_transfer(&mut self, transfer: TransferFunction) -> Result<()> {
        let range = self.volume.value_range()?;
        if !(self.whole && self.reduction.serves(&transfer, range)) {
            self.reduction = Reduction::for_edits(&transfer, range);
            self.whole = true;
        }
        self.resolution = Resolution::new(&transfer, &self.volume)?;
        self.transfer = transfer;
        self.kept = Cache::default();
        self.light.clear();
        Ok(())
    }

    /// Returns whether regions of one value are visible.
    pub(super) fn has_plateaus(&self) -> Result<bool> {
        let found = || scalar_cells::has_plateaus(&self.volume, &self.transfer);
        Ok(*self.kept.get_or_make((), found)?)
    }
}

impl PreShaded {
    pub(super) fn new(layers: Layers, normals: Option<Normals>) -> Self {
        Self {
            layers,
            normals,
            classified: LastValue::default(),
            occluders: Occluders::default(),
            samples: HeldSamples::default(),
            edits: 0,
            visible: KeptVoxels::default(),
            cells: std::array::from_fn(|_| LastValue::default()),
        }
    }

    /// Replaces the transfer function. From now on the device holds the samples.
    pub(super) fn set_transfer(&mut self, transfer: &TransferFunction) -> Result<()> {
        let Some((volume, _)) = self.layers.plain() else {
            return Err(Error::setting(
                "transfer",
                "several layers have no single transfer function: prepare them anew",
            ));
        };
        self.layers = Layers::of_volume(volume, transfer);
        self.occluders.clear();
        self.visible.clear();
        self.cells.iter().for_each(LastValue::clear);
        self.edits += 1;
        Ok(())
    }

    /// Returns the visible voxels, and the seconds that it took to make them.
    pub(super) fn classified(
        &self,
        context: &Context,
        pipelines: &Cache,
        shadows: Option<&Shadows>,
        progress: &Progress,
    ) -> Result<(Arc<Drawable>, f64)> {
        let classify = || {
            let (voxels, bricks) = match self.layers.plain() {
                None => classified(context, &self.layers, self.normals, progress)?,
                Some((volume, transfer)) => {
                    let input = Input::new(context, volume, transfer, self.normals, progress)?;
                    Voxels::of_samples(pipelines, &input, &self.samples, &self.visible)?
                }
            };
            Ok::<_, Error>(Drawable::of_voxels(voxels, bricks))
        };
        self.classified.get_or_make((shadows.cloned(), self.edits), PartialEq::eq, |held| {
            context.guarded("classifying the volume", || {
                // Voxels are packed over those before.
                let kept = held.as_ref().map(|(_, before)| Arc::clone(&before.kept)).unwrap_or_default();
                let Some(shadows) = shadows else {
                    self.occluders.clear();
                    drop(held);
                    return Ok(Arc::new(classify()?.with_kept(kept)));
                };
                // Other shadows lie on the same voxels.
                let (held, mut unlit) = match held.filter(|((_, edits), _)| *edits == self.edits) {
                    Some(((held, _), classified)) => (held, classified),
                    None => (None, Arc::new(classify()?)),
                };
                let over = Arc::get_mut(&mut unlit).is_some();
                let Some(voxels) = &unlit.voxels else { return Ok(unlit) };
                let (of, held, occluders) = ((context, pipelines), held.as_ref(), &self.occluders);
                let swept = shaded(of, (voxels, over), held, occluders, shadows, progress)?;
                let on_host = || light_on_host::shaded(of, voxels, shadows, progress);
                let voxels = Arc::new(swept.map_or_else(on_host, Ok)?);
                Ok(Arc::new(Drawable::of_voxels(voxels, unlit.bricks).with_kept(kept)))
            })
        })
    }

    /// Returns the cells of a lattice, and the seconds that it took to make them.
    pub(super) fn cells(
        &self,
        context: &Context,
        pipelines: &Cache,
        Lattice { size, light, shadows, .. }: &Lattice,
        progress: &Progress,
    ) -> Result<(Arc<Drawable>, f64)> {
        let Some((volume, transfer)) = self.layers.plain() else {
            return Err(Error::volume("several layers have no cells"));
        };
        self.cells[size.number()].get_or_make((light.clone(), shadows.clone()), PartialEq::eq, |held| {
            let shaded = shadows.as_ref().map(|shadows| self.classified(context, pipelines, Some(shadows), progress));
            let shaded = shaded.transpose()?;
            context.guarded("classifying the volume", || {
                let light = light.as_ref();
                let shape = Shape::new(volume.grid(), transfer, *size);
                // Cells of another light: their memory serves these, or they are dropped before. Shadows lie on voxels
                // whose densities are rounded, so that other cells may be faint.
                let before = held.and_then(|((_, of), cells)| {
                    let serves = of.is_some() == shadows.is_some();
                    Arc::into_inner(cells).filter(|_| serves)
                });
                let before = before.and_then(|Drawable { voxels, bricks, .. }| Some((voxels?, bricks)));
                let (sampled, sent) = match shaded.and_then(|(shaded, _)| shaded.voxels.clone()) {
                    Some(voxels) => (voxels, 0),
                    None => {
                        let input = Input::new(context, volume, transfer, self.normals, progress)?;
                        let (voxels, held) = Voxels::of_samples(pipelines, &input, &self.samples, &self.visible)?;
                        (voxels, held.bytes)
                    }
                };
                let (before, bricks) = before.unzip();
                let made = cells::run(context, pipelines, (&sampled, light), &shape.on_device(), before, progress)?;
                let all = || shape.on_device().dims.map(|n| n.div_ceil(BRICK_EDGE) as u32).into_iter().product();
                let bricks =
                    bricks.unwrap_or_else(|| Bricks { all: all(), uploaded: made.bricks().count() as u32, bytes: 0 });
                Ok(Arc::new(Drawable::of_voxels(made, Bricks { bytes: bricks.bytes + sent, ..bricks })))
            })
        })
    }
}
