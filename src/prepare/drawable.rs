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
use crate::gpu::classify::{self, Classifier};
use crate::gpu::context::Context;
use crate::gpu::held_samples::HeldSamples;
use crate::gpu::kept_voxels::KeptVoxels;
use crate::gpu::sampled::Sampled;
use crate::gpu::samples::{Bricks, Input};
use crate::gpu::scan::Scan;
use crate::gpu::splat::SplatLight;
use crate::gpu::store::{Drawable, StoreBuilder};
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
use crate::volume::Volume;

/// Classifies layers on the host: returns their visible voxels as splats, brick by brick, with normals if there is
/// light.
pub(crate) fn classified(
    context: &Context,
    layers: &Layers,
    normals: Option<Normals>,
    progress: &Progress,
) -> Result<Drawable> {
    let left_out = LeftOut { voxels: context.savings.voxels, bricks: context.savings.bricks };
    let classifier = layers::LayerClassifier::new(layers, normals, left_out)?;
    let mut stores = StoreBuilder::new(context, classify::STRIDE, u32::MAX);
    let row = |j: usize, k: usize| classifier.row([j, k]);
    let doing = (progress, "classifying");
    stores.push_rows(layers.volume(), classifier.counts, classifier.halo, doing, &row)?;
    stores.finish()
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
        self.keep_if(|_| false);
    }

    /// Drops the held value unless `keep` accepts it.
    fn keep_if(&self, keep: impl FnOnce(&V) -> bool) {
        let mut held = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        *held = held.take().filter(|(_, value)| keep(value));
    }
}

/// The key of cells: the light on their voxels, and the shadows.
type CellsKey = (Option<SplatLight>, Option<Shadows>);

/// The key of visible voxels: the shadows on them, and the number of earlier changes of the transfer function.
type ClassifiedKey = (Option<Shadows>, u32);

/// Returns the resources that painters made of dropped splats: samples may be packed over them.
fn kept_of<K>(held: Option<(K, Arc<Drawable>)>) -> Option<Arc<Cache>> {
    held.map(|(_, before)| Arc::clone(&before.kept))
}

/// A volume prepared for pre-shading.
pub(super) struct PreShaded {
    pub(super) layers: Layers,
    /// The kind of the splats' normals; `None`: splats have no normals.
    pub(super) normals: Option<Normals>,
    /// The visible voxels, with the shadows on them.
    pub(super) classified: LastValue<ClassifiedKey, Drawable>,
    /// The occluders of shadows.
    occluders: Occluders,
    /// The samples on the device, held from the first picture on unless a list of splats takes less memory: then from
    /// the first change of the transfer function or the first cells on.
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
    /// The samples on the device, held from the first picture on unless a list of splats takes less memory.
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

    /// Emits splats of scalars, or uses samples in their place if the key permits it and the device has room for them.
    /// `lit` if pictures are lit.
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
            match context.guarded("holding samples", sampled) {
                Ok(Samples::Held(made)) => return Ok(made),
                Ok(Samples::Outgrown | Samples::Invisible) | Err(Error::OutOfMemory(_)) => {}
                Err(e) => return Err(e),
            }
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
            let kept = kept_of(held).filter(|_| need.samples);
            let made = self.emit((context, pipelines), (&key, lit), progress)?;
            let over = kept.filter(|_| made.scalars.is_some());
            Ok(Arc::new(Drawable { kept: over.unwrap_or_default(), ..made }))
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
        // Samples are packed over those before.
        self.classified.keep_if(|before| Sampled::of(&before.stores).is_some());
        self.occluders.clear();
        self.visible.clear();
        self.cells.iter().for_each(LastValue::clear);
        self.edits += 1;
        Ok(())
    }

    /// Returns the visible voxels, with `lists` as lists of splats, and the seconds that it took to make them.
    pub(super) fn classified(
        &self,
        context: &Context,
        pipelines: &Cache,
        (shadows, lists): (Option<&Shadows>, bool),
        progress: &Progress,
    ) -> Result<(Arc<Drawable>, f64)> {
        let classify = |lists| match self.layers.plain() {
            None => classified(context, &self.layers, self.normals, progress),
            Some((volume, transfer)) => {
                let input = Input::new(context, volume, transfer, self.normals, progress)?;
                self.classified_on_device(pipelines, &input, lists)
            }
        };
        self.classified.get_or_make((shadows.cloned(), self.edits), PartialEq::eq, |held| {
            context.guarded("classifying the volume", || match shadows {
                None => {
                    self.occluders.clear();
                    let kept = kept_of(held);
                    let made = classify(lists)?;
                    let over = kept.filter(|_| Sampled::of(&made.stores).is_some());
                    Ok(Arc::new(Drawable { kept: over.unwrap_or_default(), ..made }))
                }
                Some(shadows) => {
                    // Other shadows lie on the same voxels.
                    let (held, mut classified) = match held.filter(|((_, edits), _)| *edits == self.edits) {
                        Some(((held, _), classified)) => (held, classified),
                        None => (None, Arc::new(classify(lists)?)),
                    };
                    let kept = Arc::clone(&classified.kept);
                    let bricks = classified.bricks;
                    let over = Arc::get_mut(&mut classified).is_some();
                    let (of, held, occluders) = ((context, pipelines), held.as_ref(), &self.occluders);
                    let swept = shaded(of, (&classified.stores, over), held, occluders, shadows, progress)?;
                    let on_host = || light_on_host::shaded(context, &classified.stores, shadows, progress);
                    let stores = swept.map_or_else(on_host, Ok)?;
                    let kept = if Sampled::of(&stores).is_some() { kept } else { Arc::default() };
                    Ok(Arc::new(Drawable { stores, bricks, kept, ..Drawable::default() }))
                }
            })
        })
    }

    /// Classifies the voxels by stages of the device. From the first change of the transfer function on the device
    /// holds the samples, and before if it has room for them: no list of splats is made unless something reads it, or
    /// takes less memory, or the device has no room.
    fn classified_on_device(&self, pipelines: &Cache, input: &Input<'_>, lists: bool) -> Result<Drawable> {
        let context = input.context();
        let is_held = self.edits > 0 || self.samples.is_held();
        if is_held || !lists && Sampled::may_save(input)? {
            let sampled = || Sampled::run(pipelines, input, &self.samples, &self.visible);
            match context.guarded("holding samples", sampled) {
                Ok(made) if is_held || !Sampled::of(&made.stores).is_some_and(|sampled| sampled.is_sparse()) => {
                    return Ok(made);
                }
                Ok(made) => {
                    made.stores.iter().try_for_each(|store| store.on_device(context).map(drop))?;
                    self.visible.clear();
                    self.samples.clear();
                    return Ok(made);
                }
                Err(Error::OutOfMemory(_)) => {}
                Err(e) => return Err(e),
            }
        }
        Classifier::of(pipelines, input)?.run(&*Scan::of(pipelines, context)?, input)
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
            let shaded =
                shadows.as_ref().map(|shadows| self.classified(context, pipelines, (Some(shadows), false), progress));
            let shaded = shaded.transpose()?;
            context.guarded("classifying the volume", || {
                let light = light.as_ref();
                let shape = Shape::new(volume.grid(), transfer, *size);
                // Cells of another light: their memory serves these, or they are dropped before. Shadows lie on splats,
                // whose densities are rounded, so that other cells may be faint.
                let before = held.and_then(|((_, of), cells)| {
                    let serves = of.is_some() == shadows.is_some();
                    Arc::into_inner(cells).filter(|_| serves)
                });
                let mut sent = 0;
                let sampled = match &shaded {
                    Some((shaded, _)) => Sampled::of(&shaded.stores).filter(|sampled| sampled.has_whole_rows()),
                    None => {
                        let input = Input::new(context, volume, transfer, self.normals, progress)?;
                        let hold = || Sampled::hold(pipelines, &input, &self.samples, &self.visible);
                        let fits = HeldSamples::fits(&input, &input.needed_bricks()?);
                        let held = fits.then(hold).transpose()?;
                        held.map(|(sampled, bytes)| {
                            sent = bytes;
                            sampled
                        })
                    }
                };
                let listed = shaded.as_ref().map(|(shaded, _)| cells::Voxels::Splats(&shaded.stores));
                let voxels = sampled.as_deref().map(cells::Voxels::Samples).or(listed).ok_or_else(|| {
                    context.unsupported(
                        "has no room for the samples of which cells are made: draw bricks (voxsplat plan), or use \
                         --painter cpu"
                            .to_owned(),
                    )
                })?;
                let made = cells::run(context, pipelines, (voxels, light), &shape.on_device(), before, progress)?;
                let bricks = Bricks { bytes: made.bricks.bytes + sent, ..made.bricks };
                Ok(Arc::new(Drawable { bricks, ..made }))
            })
        })
    }
}
