//! A volume in memory and a device, for one picture after another.

use std::path::{Path, PathBuf};
use voxsplat::Frame;

use voxsplat::accuracy::Estimate;
use voxsplat::appearance::{Choice, Framing};
use voxsplat::camera::{Camera, Hull, View};
use voxsplat::clip::Clip;
use voxsplat::demos;
use voxsplat::engine::Engine;
use voxsplat::figure::{Figure, LegendEntry, Shown};
use voxsplat::formats::{LoadOptions, PyramidLevel, TimeSeries};
use voxsplat::image::{DepthMap, Ground, Image, Note};
use voxsplat::layers::{Layer, Layers};
use voxsplat::program::{
    ChoiceContext, ClipSpec, Loaded, Overlays, PlacedOverlay, TransferChoice, load_channels, place_studio,
};
use voxsplat::reference::Reference;
use voxsplat::renderer::RendererOptions;
use voxsplat::settings::{Model, Settings};
use voxsplat::solids::Solids;
use voxsplat::stats::Stats;
use voxsplat::transfer::{TransferFunction, Window};
use voxsplat::volume::{Contents, Units, Volume};
use voxsplat_volume::names::readable;

use super::draw::{Prepared, draw, in_words, notes, with_units};
use super::failure::{Failure, fail, refuse};
use super::fitted::{Fitted, transfer};
use super::job::{Maker, NO_LEGEND, RenderJob};
use super::progress::{self, ProgressLine, Remaining};
use super::solids::HeldSolids;
use super::stages::Stages;
use super::{layers, output};

/// The state that pictures of one volume share.
pub(crate) struct Session {
    pub(crate) volume: Volume,
    /// The engine that makes the pictures; `None` if the reference does.
    engine: Option<Engine>,
    /// The scene of the last picture.
    prepared: Option<Prepared>,
    /// The hull to which the last picture was fitted.
    framed: Held<(Framing, Clip, Layers), Option<Hull>>,
    /// The hull to which all pictures are fitted, if it was found before them; `Some(None)` if no voxel is visible.
    steady: Option<Option<Hull>>,
    /// The layers in place of the volume's values, if it has several channels.
    channels: Vec<Layer>,
    /// Further labels of the volume's file, which overlap with its own.
    more: Vec<Volume>,
    /// The volumes of labels on the volume's lattice, by their files.
    labels: Vec<(PathBuf, Vec<Volume>)>,
    /// The meshes of the last job.
    solids: HeldSolids,
    /// The overlays on the lattice of the pictures.
    pub(crate) overlays: Option<Overlays>,
    /// The last legend.
    legend: Held<(Layers, Clip), Vec<LegendEntry>>,
    /// The least and the largest value of the first volume, once a colour bar needs them.
    values: Option<[f64; 2]>,
    /// The look of the volume in sections.
    ground: Held<(Layers, Option<Window>), Ground>,
    /// The notes that have been printed.
    said: Vec<String>,
}

/// The last value, with its key.
type Held<K, V> = Option<(K, V)>;

/// Returns the held value, or makes another if the key has changed.
fn held<K: PartialEq, V: Clone>(
    last: &mut Held<K, V>,
    key: K,
    make: impl FnOnce(&K) -> Result<V, Failure>,
) -> Result<V, Failure> {
    let (key, value) = match last.take() {
        Some((held, value)) if held == key => (held, value),
        _ => {
            let value = make(&key)?;
            (key, value)
        }
    };
    Ok(last.insert((key, value)).1.clone())
}

/// A finished picture, with its settings and measurements.
pub(crate) struct Drawing {
    /// The picture as rendered, without figure.
    pub(crate) image: Image,
    /// The picture with the figure, if there is one.
    drawn: Option<Image>,
    pub(crate) camera: Camera,
    pub(crate) settings: Settings,
    pub(crate) notes: Vec<Note>,
    pub(crate) estimate: Option<Estimate>,
    /// The statistics of the renderer; `None` if the reference made the picture.
    pub(crate) stats: Option<Stats>,
    /// The surfaces in the picture.
    pub(crate) solids: Option<Solids>,
}

impl Drawing {
    /// Returns the name of the painter that drew the picture.
    pub(crate) fn painter(&self) -> &'static str {
        self.stats.as_ref().map_or("reference", |stats| stats.painter.name())
    }

    /// Returns the picture with its figure, as it is written to a file.
    pub(crate) fn image(&self) -> &Image {
        self.drawn.as_ref().unwrap_or(&self.image)
    }
}

/// Prints a note that `--pyramid` has no effect, if the volume has one level.
pub(crate) fn say_level(volume: &Volume, options: &LoadOptions) {
    if volume.contents().levels <= 1 && matches!(options.level, PyramidLevel::At(level) if level > 0) {
        output::say("note: --pyramid has no effect because the volume has one level");
    }
}

/// The note on an empty picture.
const EMPTY: &str = "note: the picture is empty because nothing in view is visible; see --transfer, --clip and --mask";

/// Prints a note on the time point and the level of a file that are used, if no option requests them.
pub(crate) fn say_choice(volume: &Volume, options: &LoadOptions) {
    let Contents { times, level, levels, notes, .. } = volume.contents();
    notes.iter().for_each(|note| output::say(&format!("note: {note}")));
    if *times > 1 && options.time.is_none() {
        let (last, all) = (times - 1, "all of them: turntable --time all");
        output::say(&format!("note: using --time 0 of 0 to {last} ({all})"));
    }
    say_level(volume, options);
    if *levels > 1 && !matches!(options.level, PyramidLevel::At(_)) {
        let [x, y, z] = volume.grid().dims();
        let most = levels - 1;
        output::say(&format!(
            "note: using --pyramid {level} of 0 to {most} because its {x} x {y} x {z} samples are as fine as pixels"
        ));
    }
}

impl Session {
    /// Reads the volume of a job and opens its device. Returns the transfer function of the job too.
    pub(crate) fn open(job: &RenderJob, stages: &mut Stages) -> Result<(Self, Fitted), Failure> {
        let mut opening = Stages::default();
        if matches!(job.maker, Maker::Engine { .. }) {
            Engine::check_memory()?;
        }
        let progress = ProgressLine::spinner("reading");
        // Opening the driver takes about as long as reading a small volume, so both run at once.
        let (read, opened) = std::thread::scope(|scope| {
            let adapter = match &job.maker {
                Maker::Engine { adapter } => Some(adapter.clone()),
                Maker::Reference => None,
            };
            let device = adapter.map(|adapter| {
                let (opening, settings) = (&mut opening, &job.settings);
                let options = RendererOptions { adapter, progress: progress::reporter(), ..RendererOptions::default() };
                scope.spawn(move || opening.time("device", || Engine::open(&options, settings)))
            });
            let mut read = || {
                let load = || load_channels(&job.source, &job.load, &job.channels, job.transfer.values());
                let loaded = stages.time("load", load)?;
                let mut fitted = fitted(job, &loaded.volume, &loaded.layers, stages)?;
                let loaded = match job.reduced && !fitted.labels {
                    true => stages.time("reduce", || loaded.reduced(job.size))?,
                    false => loaded,
                };
                let Loaded { volume, layers, labels, channels } = loaded;
                if !channels.is_empty() {
                    let channels: Vec<String> = channels.iter().map(|look| format!("--channel {look}")).collect();
                    fitted.notes.push(format!("note: using {} (draw one: --channel N)", channels.join(", ")));
                }
                let colors = channels.len().max(usize::from(fitted.is_channel));
                let overlays = stages.time("overlays", || layers::overlays(&job.layers.overlays, &volume, colors))?;
                if let Some(overlays) = &overlays {
                    fitted.notes.extend(layers::notes_on(overlays, &volume));
                }
                Ok::<_, Failure>((volume, layers, labels, overlays, fitted))
            };
            (read(), device.map(|thread| thread.join()))
        });
        drop(progress);
        let (volume, channels, more, overlays, fitted) = read?;
        say_choice(&volume, &job.load);
        stages.append(opening);
        let opened = opened.map(|opened| opened.unwrap_or_else(|panic| std::panic::resume_unwind(panic)));
        let mut session = Self {
            volume,
            engine: opened.transpose()?,
            prepared: None,
            framed: None,
            steady: None,
            channels,
            more,
            labels: Vec::new(),
            solids: HeldSolids::default(),
            overlays,
            legend: None,
            values: None,
            ground: None,
            said: Vec::new(),
        };
        session.values(&job.figure.drawn)?;
        Ok((session, fitted))
    }

    /// Prints a note once.
    fn say(&mut self, note: String) {
        if !self.said.contains(&note) {
            output::say(&note);
            self.said.push(note);
        }
    }

    /// Prints the notes of a job, and completes it with the view, the light and the sharpness that suit it.
    ///
    /// Refuses options for which the volume has no content.
    pub(crate) fn complete(&mut self, job: &mut RenderJob, fitted: &Fitted) -> Result<(), Failure> {
        let has_labels = fitted.labels || job.layers.has_labels();
        if !self.channels.is_empty() && (job.figure.drawn.color_bar || job.output.transfer.is_some()) {
            let message = "--colour-bar and --save-transfer are for one transfer function, not for several channels";
            return refuse(message);
        }
        let has_names = self.overlays.is_some() || self.channels.iter().any(|layer| layer.entry().is_some());
        if job.figure.legend && !has_labels && !has_names {
            return refuse(NO_LEGEND);
        }
        fitted.notes.iter().for_each(|note| self.say(note.clone()));
        if let TransferChoice::Given(imported) = &job.transfer.choice
            && let Some(material) =
                imported.material.filter(|_| job.choices.open.light && job.settings.model == Model::Composite)
        {
            let material = material.map(readable).join(",");
            self.say(format!(
                "note: the transfer function is for lit surfaces: add --light headlight --material {material}"
            ));
        }
        job.settings.clip = ClipSpec::intersection(&job.clip, &self.volume)?;
        let context = ChoiceContext {
            volume: &self.volume,
            view: demos::own_look(&job.source).map(|look| look.view),
            material: fitted.material,
            channels: self.channels.iter().any(|layer| layer.entry().is_some()),
            labels: has_labels,
            overlays: self.overlays.is_some(),
            plain: job.layers.is_plain() || !job.transfer.isosurfaces.is_empty(),
        };
        let choices = context.make_choices(job.choices.open, &mut job.view, &mut job.settings)?;
        // Studio light that was requested stands around the view.
        let is_turned = choices.iter().any(|choice| matches!(choice, Choice::Side { .. }));
        if job.studio.requested
            && (job.studio.follows || is_turned)
            && let Some(lighting) = &mut job.settings.lighting
        {
            place_studio(lighting, &job.view)?;
        }
        choices.iter().for_each(|choice| self.say(note_on(choice, job.studio.follows)));
        Ok(())
    }

    /// Replaces the samples by the samples of another time point.
    pub(crate) fn go_to(&mut self, series: &mut TimeSeries, time: u32) -> Result<(), Failure> {
        let Contents { channel, time: now, .. } = *self.volume.contents();
        if time == now {
            return Ok(());
        }
        // The last scene leaves memory before the next samples are read.
        (self.prepared, self.framed) = (None, None);
        let next = series.channel(time, channel)?;
        for layer in &mut self.channels {
            *layer = layer.with_samples(|of| match of.contents().channel {
                same if same == channel => Ok(next.clone()),
                other => Ok(series.channel(time, other)?),
            })?;
        }
        for labels in &mut self.more {
            *labels = series.channel(time, labels.contents().channel)?;
        }
        self.volume = next;
        Ok(())
    }

    /// Fits all pictures of a job to the voxels that are visible at any of some time points, so that no picture moves
    /// or changes its size.
    pub(crate) fn frame_all(
        &mut self,
        job: &RenderJob,
        fitted: &Fitted,
        series: &mut TimeSeries,
        times: &[u32],
    ) -> Result<(), Failure> {
        let progress = Remaining::new("times", times.len());
        let mut around: Option<Hull> = None;
        for (done, &time) in times.iter().enumerate().filter(|_| job.frame != Framing::Volume) {
            progress.at(done, &format!("framing {} of {} time points", done + 1, times.len()));
            self.go_to(series, time)?;
            let layers = self.layers(job, fitted, &mut Stages::default())?;
            let hull = job.frame.hull(&layers, &job.settings.clip)?;
            around = match (around, hull) {
                (Some(all), Some(hull)) => Some(all.joined(&hull)),
                (all, hull) => all.or(hull),
            };
        }
        self.solids.read(&job.solids, &self.volume)?;
        self.steady = Some(around.map(|hull| self.solids.around(hull)));
        Ok(())
    }

    /// Returns the transfer function of a job of the same volume.
    pub(crate) fn fitted(&self, job: &RenderJob, stages: &mut Stages) -> Result<Fitted, Failure> {
        fitted(job, &self.volume, &self.channels, stages)
    }

    /// Returns the layers of a job. Files of labels are read once.
    pub(crate) fn layers(&mut self, job: &RenderJob, fitted: &Fitted, stages: &mut Stages) -> Result<Layers, Failure> {
        let (held, lattice) = (&mut self.labels, &self.volume);
        let read = |option: &'static str, path: &Path| match held.iter().find(|(of, _)| of == path) {
            Some((_, volumes)) => Ok(volumes.clone()),
            None => {
                let (volumes, note) = layers::placed(option, path, layers::read(path)?, lattice)?;
                note.iter().for_each(|note| output::say(note));
                held.push((path.to_owned(), volumes.clone()));
                Ok(volumes)
            }
        };
        let transfer = &fitted.transfer;
        if self.channels.is_empty() && job.layers.is_plain() && !fitted.labels {
            return Ok(Layers::of_volume(&self.volume, transfer));
        }
        let base = match (&*self.channels, fitted.labels) {
            (_, true) => {
                let all = std::iter::once(&self.volume).chain(&self.more);
                all.map(|volume| job.layers.of_labels(volume)).collect::<Result<_, _>>()?
            }
            ([], false) => vec![Layer::scalars(&self.volume, transfer)],
            (channels, false) => channels.to_vec(),
        };
        let layers = stages.time("labels", || job.layers.over(base, read))?;
        job.layers.looks.notes_on(&layers).into_iter().for_each(|reason| self.say(format!("note: {reason}")));
        match &self.overlays {
            Some(overlays) => Ok(overlays.over(layers)?),
            None => Ok(layers),
        }
    }

    /// Makes the camera of a job.
    pub(crate) fn camera(
        &mut self,
        job: &RenderJob,
        layers: &Layers,
        transfer: &TransferFunction,
        stages: &mut Stages,
    ) -> Result<Camera, Failure> {
        if self.solids.read(&job.solids, &self.volume)? {
            self.framed = None;
        }
        let solids = &self.solids;
        let around = match &self.steady {
            Some(steady) => steady.clone(),
            None => held(
                &mut self.framed,
                (job.frame, job.settings.clip.clone(), layers.clone()),
                |(frame, clip, layers)| {
                    stages.time("framing", || Ok(frame.hull(layers, clip)?.map(|hull| solids.around(hull))))
                },
            )?,
        };
        let figure = self.figure(job, layers)?;
        let values = self.values(&figure)?;
        let transfer = self.bar().and_then(|overlay| overlay.transfer.as_ref()).unwrap_or(transfer);
        let reserved = if job.choices.space { figure.reserved(job.size, transfer, values)? } else { job.view.reserved };
        if reserved != job.view.reserved {
            self.say(note_on_space(&figure, job.frame));
        }
        Ok(Camera::new(&View { around, reserved, ..job.view.clone() }, layers.grid(), job.size)?)
    }

    /// Makes the picture of a job.
    pub(crate) fn picture(
        &mut self,
        job: &RenderJob,
        layers: &Layers,
        transfer: &TransferFunction,
        stages: &mut Stages,
    ) -> Result<Drawing, Failure> {
        if let Some(sections) = &job.sections {
            sections.planes(&self.volume)?;
        }
        let camera = self.camera(job, layers, transfer, stages)?;
        let figure = self.figure(job, layers)?;
        let values = self.values(&figure)?;
        let ground = self.ground(job, layers)?;
        let solids = self.solids.seen(&camera, job.settings.lighting.as_ref(), (layers, ground))?;
        let (image, settings, estimate, stats) = match &self.engine {
            Some(engine) => {
                let prepared = self.prepared.take().filter(|prepared| prepared.serves(layers, &job.settings));
                let (drawn, prepared) = draw(engine, layers, &camera, job, solids.as_ref(), prepared)?;
                self.prepared = prepared;
                drawn
            }
            None => {
                let image = stages.time("integrate", || {
                    Reference::of_layers(layers, &job.settings)?
                        .with_tolerance(Reference::TOLERANCE)
                        .with_progress(progress::reporter())
                        .render_region(&camera, job.region)
                })?;
                (image, job.settings.clone(), None, None)
            }
        };
        if image.pixels().iter().all(|pixel| pixel[3] <= 0.0) {
            self.say(EMPTY.to_owned());
        }
        let estimated = estimate.map(|e| Note { name: "Estimated error", text: in_words(&e) });
        let texts = job.sections.as_ref().map_or(&figure, |sections| &sections.texts);
        let notes = notes(&settings, texts, estimated);
        let mut volume = with_units(&self.volume, &job.figure.units);
        let mut transfer = transfer;
        if let Some(PlacedOverlay { transfer: Some(own), volume: of, .. }) = self.bar() {
            let Units { length, value } = volume.units().clone();
            let value = if job.figure.units.value.is_some() { value } else { of.units().value.clone() };
            (transfer, volume) = (own, volume.with_units(Units { length, value }));
        }
        let shown = Shown { volume: &volume, transfer, values, camera: &camera, model: job.settings.model };
        let draw = || figure.draw_region(&image, job.region, job.output.background, &shown);
        let mut drawn = if figure.is_empty() { None } else { Some(stages.time("figure", draw)?) };
        if let Some(sections) = &job.sections {
            let (picture, background) = (drawn.as_ref().unwrap_or(&image), job.output.background);
            let around = || sections.draw(picture, (layers, ground), background, &shown);
            drawn = Some(stages.time("slices", around)?);
        }
        Ok(Drawing { image, drawn, camera, settings, notes, estimate, stats, solids })
    }

    /// Returns the depths of a picture for its file: of the solids, or nearer ones at which matter has kept half of the
    /// light. `None` if the file or the model has no depths.
    pub(crate) fn depths(
        &mut self,
        job: &RenderJob,
        layers: &Layers,
        picture: &Drawing,
        stages: &mut Stages,
    ) -> Result<Option<DepthMap>, Failure> {
        let Some(engine) = &self.engine else { return Ok(None) };
        if !job.output.picture.keeps_values() || !picture.settings.has_depths() {
            return Ok(None);
        }
        let Drawing { camera, settings, solids, .. } = picture;
        stages.time("depths", || {
            let prepared = match self.prepared.take() {
                Some(prepared) => prepared,
                None => Prepared::new(layers, settings, engine.prepare_layers(layers, settings)?),
            };
            let solids = solids.as_ref().map(|solids| &solids.depths);
            let depths =
                engine.depths(&prepared.scene, &Frame::new(camera, settings).region(job.region).before(solids))?;
            self.prepared = Some(prepared);
            Ok(Some(match solids {
                Some(solids) => depths.nearest(&solids.part(job.region)?)?,
                None => depths,
            }))
        })
    }

    /// Returns the look of the volume in the sections of a job.
    fn ground(&mut self, job: &RenderJob, layers: &Layers) -> Result<Ground, Failure> {
        if job.sections.is_none() && job.solids.planes.is_empty() {
            return Ok(Ground::Colors);
        }
        let (volume, channels) = (&self.volume, self.channels.len());
        held(&mut self.ground, (layers.clone(), job.transfer.window), |_| Ok(job.transfer.ground(volume, channels)?))
    }

    /// Returns the overlay whose values a colour bar shows: the first one with values.
    fn bar(&self) -> Option<&PlacedOverlay> {
        self.overlays.as_ref()?.all.iter().find(|overlay| overlay.transfer.is_some())
    }

    /// Returns the range of values for the colour bar of a figure, of the first time point for all.
    fn values(&mut self, figure: &Figure) -> Result<Option<[f64; 2]>, Failure> {
        if figure.color_bar && self.values.is_none() {
            self.values = Some(self.bar().map_or(&self.volume, |overlay| &overlay.volume).value_range()?);
        }
        Ok(self.values)
    }

    /// Returns the figure of a job, with the names of its legend.
    fn figure(&mut self, job: &RenderJob, layers: &Layers) -> Result<Figure, Failure> {
        if !job.figure.legend {
            return Ok(job.figure.drawn.clone());
        }
        let key = (layers.clone(), job.settings.clip.clone());
        let legend = held(&mut self.legend, key, |(layers, clip)| Ok(layers.legend(clip)?))?;
        if legend.is_empty() {
            return fail("--legend: no label is visible");
        }
        let figure = Figure { legend, ..job.figure.drawn.clone() };
        figure.validate(job.size, job.settings.model)?;
        Ok(figure)
    }
}

/// Returns the transfer function of a job; `None` if the values of its volume are labels.
fn fitted(job: &RenderJob, volume: &Volume, channels: &[Layer], stages: &mut Stages) -> Result<Fitted, Failure> {
    if !channels.is_empty() {
        return Fitted::clear();
    }
    transfer(&job.source, &job.transfer, volume, may_be_labels(job), job.layers.overlays.len(), stages)
}

/// Returns whether a job leaves the meaning of values open, and requests nothing that labels lack.
fn may_be_labels(job: &RenderJob) -> bool {
    let for_values = job.figure.drawn.color_bar || job.output.transfer.is_some();
    let is_alone = job.channels.is_empty() && !job.layers.has_labels();
    !for_values && is_alone && job.transfer.may_be_labels(&job.settings)
}

/// Returns the note on a choice, with the option that undoes it.
fn note_on(choice: &Choice, follows: bool) -> String {
    let text = match choice {
        Choice::Side { azimuth, elevation, reason } => {
            format!("--azimuth {azimuth} --elevation {elevation} because {reason} (front view: --azimuth 0)")
        }
        Choice::Light { shadow_bias, surfaces } => {
            let name = if follows { "studio:eye" } else { "studio" };
            let bias = shadow_bias.map(|bias| format!(" --tune shadow-bias={bias}")).unwrap_or_default();
            format!("--light {name}{bias} because {surfaces} (disable: --light off)")
        }
        Choice::Sharpness(sharpness) => {
            format!("--sharpness {sharpness} because the transfer function shows surfaces (disable: --sharpness 0)")
        }
        other => other.to_string(),
    };
    format!("note: using {text}")
}

/// Returns the note on a frame beside the parts of a figure, with the option that undoes it.
fn note_on_space(figure: &Figure, frame: Framing) -> String {
    let parts =
        [(figure.title.is_some(), "title"), (figure.caption.is_some(), "caption"), (figure.color_bar, "colour bar")];
    let parts: Vec<&str> = parts.into_iter().filter_map(|(drawn, name)| drawn.then_some(name)).collect();
    let parts = parts.join(" and the ");
    format!("note: using a smaller frame because the {parts} would lie over the volume (same frame: --frame {frame})")
}
