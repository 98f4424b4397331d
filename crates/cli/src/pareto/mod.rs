//! `voxsplat pareto`.

mod page;

use std::path::Path;

use clap::ArgMatches;
use flate2::Crc;
use serde::{Deserialize, Serialize};
use voxsplat::camera::{Camera, View};
use voxsplat::figure::Shown;
use voxsplat::formats::read_json;
use voxsplat::image::{Background, Image};
use voxsplat::layers::Layers;
use voxsplat::report::{
    Errors, Marker, Measurement, Point, Study, Variant, difference_picture, front, plot, today, variants, write_file,
};
use voxsplat::transfer::TransferFunction;
use voxsplat::volume::{Statistics, Volume};
use voxsplat::{Renderer, RendererOptions, formats};

use super::clip::intersection;
use super::draw::{framed, with_units};
use super::failure::Failure;
use super::fitted::transfer;
use super::job::ParetoJob;
use super::options::{command_line, file_name, options_of, without, without_folders};
use super::output;
use super::progress::{Progress, Remaining};
use super::session::say_choice;
use super::stages::Stages;
use super::stderr::silenced;

/// What is measured, and of what: an interrupted run is gone on with only if all of it is the same.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Subject {
    /// The arguments that say what is drawn, as those of `voxsplat render`, with names of files for their paths.
    command: String,
    volume: [u32; 3],
    /// A checksum of the distribution of the values and of the transfer function: files of one name may differ.
    content: String,
    views: u32,
    size: [u32; 2],
    sample: u32,
    adapter: String,
    driver: String,
    version: String,
}

/// All that a run keeps.
#[derive(Debug, Serialize, Deserialize)]
struct Kept {
    #[serde(flatten)]
    subject: Subject,
    /// The day of the last measurement.
    date: String,
    measurements: Vec<Measurement>,
}

/// Another renderer's picture of the same scene.
#[derive(Debug, Deserialize)]
struct Rival {
    name: String,
    /// Of a frame.
    seconds: f64,
    /// Error against its own truth, of 1.
    rms: f64,
}

/// Options of `voxsplat pareto` alone, and options that a study varies.
const OWN: [&str; 10] =
    ["-o", "--output", "--views", "--repeats", "--patience", "--rivals", "--shading", "--kernel", "--level", "--tune"];

pub(crate) fn run(mut job: ParetoJob, matches: &ArgMatches) -> Result<(), Failure> {
    let rivals =
        job.rivals.as_deref().map(|path| read_json::<Vec<Rival>>(path, MAX_JSON)).transpose()?.unwrap_or_default();
    let (volume, transfer) = {
        let _progress = Progress::spinner("reading");
        let volume = with_units(formats::load(&job.source, &job.load)?, &job.units);
        say_choice(&volume, &job.load);
        let fitted = transfer(&job.source, &job.transfer, &volume, false, &mut Stages::default())?;
        fitted.notes().for_each(|note| output::say(note));
        (volume, fitted.transfer)
    };
    job.settings.clip = intersection(&job.clip, &volume)?;
    let around = framed(job.frame, &Layers::of_volume(&volume, &transfer), &job.settings.clip)?;
    let views = job.views.iter().map(|view| View { around: around.clone(), ..view.clone() });
    let cameras: Vec<Camera> =
        views.map(|view| Camera::new(&view, volume.grid(), job.size)).collect::<Result<_, _>>()?;
    let options = RendererOptions { adapter: job.adapter.clone(), ..RendererOptions::default() };
    let renderer = silenced(|| Renderer::new(&options))?;
    let study = Study::new(&renderer, &volume, &transfer, &cameras, job.sample)?.with_patience(job.patience);
    let words = std::env::args_os().skip(2).map(|word| word.to_string_lossy().into_owned());
    let mut base = without_folders(without(words, &OWN, &["--resume", "--quiet", "-q"]), matches);
    base.extend(job.tune.iter().flat_map(|pairs| ["--tune".to_owned(), pairs.clone()]));
    let adapter = renderer.adapter();
    let subject = Subject {
        command: command_line(&base),
        volume: volume.grid().dims(),
        content: content(&volume, &transfer)?,
        views: cameras.len() as u32,
        size: job.size,
        sample: job.sample,
        adapter: adapter.name.clone(),
        driver: adapter.driver.clone(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
    };
    make_directory(&job.directory)?;
    let mut run = Run::new(&job, study, subject)?;
    run.measure()?;
    run.time(&job)?;
    let shown = Shown { volume: &volume, transfer: &transfer, camera: &cameras[0], model: job.settings.model };
    run.write(&job, &shown, &rivals)
}

/// A checksum of the distribution of the values and of the transfer function.
fn content(volume: &Volume, transfer: &TransferFunction) -> Result<String, Failure> {
    let values = Statistics::of(volume)?;
    let mut sum = Crc::new();
    [values.min, values.max].iter().for_each(|value| sum.update(&value.to_le_bytes()));
    values.histogram().iter().for_each(|count| sum.update(&count.to_le_bytes()));
    sum.update(transfer.to_json().as_bytes());
    Ok(format!("{:08x}", sum.sum()))
}

fn make_directory(path: &Path) -> Result<(), Failure> {
    let failed = |e| Failure::Failed(format!("{}: the directory cannot be made: {e}", path.display()));
    std::fs::create_dir_all(path).map_err(failed)
}

/// The largest JSON file that is read, in bytes.
const MAX_JSON: u64 = 64 << 20;

/// A study under way.
struct Run<'a> {
    directory: &'a Path,
    study: Study<'a>,
    variants: Vec<Variant>,
    kept: Kept,
    /// The truths of the models, each of all views.
    truths: Vec<(String, Vec<Image>)>,
}

impl<'a> Run<'a> {
    fn new(job: &'a ParetoJob, study: Study<'a>, subject: Subject) -> Result<Self, Failure> {
        let directory = job.directory.as_path();
        let numbers = directory.join("pareto.json");
        let mut kept = Kept { subject, date: today(), measurements: Vec::new() };
        if job.resume && numbers.exists() {
            let found: Kept = read_json(&numbers, MAX_JSON)?;
            if found.subject != kept.subject {
                return Err(Failure::Failed(format!(
                    "{}: it was measured by another command, of other data, on another adapter or by another version: \
                     give another directory, or leave out --resume",
                    numbers.display()
                )));
            }
            kept.measurements = found.measurements;
        }
        Ok(Self { directory, study, variants: variants(&job.settings), kept, truths: Vec::new() })
    }

    fn save(&mut self) -> Result<(), Failure> {
        self.kept.date = today();
        let text = serde_json::to_string_pretty(&self.kept).map_err(|e| Failure::Failed(e.to_string()))?;
        Ok(write_file(self.directory.join("pareto.json"), text.as_bytes())?)
    }

    fn measurement(&self, variant: &Variant) -> Option<usize> {
        self.kept.measurements.iter().position(|m| m.model == variant.model && m.name == variant.name)
    }

    /// The errors of all variants.
    fn measure(&mut self) -> Result<(), Failure> {
        let progress = Remaining::new("measuring errors", self.variants.len());
        for (done, variant) in self.variants.clone().iter().enumerate() {
            progress.at(done, &format!("{}: {}", variant.model, variant.name));
            if self.measurement(variant).is_none() {
                let truth = self.truth(variant)?;
                let measured = self.study.measure(variant, &self.truths[truth].1)?;
                self.kept.measurements.push(measured);
                self.save()?;
            }
        }
        Ok(())
    }

    /// The place of a model's truth, which is traced at most once: it is kept for an interrupted run.
    fn truth(&mut self, variant: &Variant) -> Result<usize, Failure> {
        if let Some(known) = self.truths.iter().position(|(model, _)| *model == variant.model) {
            return Ok(known);
        }
        let models: Vec<&str> = self.variants.iter().map(|v| v.model.as_str()).collect();
        let number = models.iter().position(|model| *model == variant.model).unwrap_or(0);
        let file = |view: usize| self.directory.join("truth").join(format!("{number}-{view}.exr"));
        let views = self.kept.subject.views as usize;
        let truth = if self.kept.measurements.iter().any(|m| m.model == variant.model) && file(views - 1).exists() {
            (0..views).map(|view| Image::load(file(view))).collect::<Result<Vec<Image>, _>>()?
        } else {
            let truth = self.study.truth(variant)?;
            let folder = self.directory.join("truth");
            make_directory(&folder)?;
            for (view, image) in truth.iter().enumerate() {
                image.save(file(view), Background::Transparent)?;
            }
            truth
        };
        self.truths.push((variant.model.clone(), truth));
        Ok(self.truths.len() - 1)
    }

    /// The times of all variants: rounds, so that a busy moment of the machine does not meet one variant alone.
    fn time(&mut self, job: &ParetoJob) -> Result<(), Failure> {
        let views = self.kept.subject.views as usize;
        let progress = Remaining::new("timing frames", self.variants.len() * job.repeats as usize);
        for round in 1..=job.repeats as usize {
            for (done, variant) in self.variants.clone().iter().enumerate() {
                progress.at((round - 1) * self.variants.len() + done, &format!("{}: {}", variant.model, variant.name));
                let Some(at) = self.measurement(variant) else { continue };
                let measured = &mut self.kept.measurements[at];
                let slow = measured.seconds().is_some_and(|seconds| seconds > job.patience);
                let all = round * views.min(measured.views as usize);
                if measured.refused.is_none() && !slow && measured.frames.len() < all {
                    self.study.time(variant, measured)?;
                    self.save()?;
                }
            }
        }
        Ok(())
    }

    /// The report: numbers, plots and the page.
    fn write(&mut self, job: &ParetoJob, shown: &Shown<'_>, rivals: &[Rival]) -> Result<(), Failure> {
        self.save()?;
        let front = front(&self.kept.measurements, |errors| errors.rms);
        let commands: Vec<String> = self.kept.measurements.iter().map(|measured| self.command(measured)).collect();
        let name = file_name(&job.source.to_string_lossy());
        write_file(self.directory.join("pareto.csv"), csv(&self.kept.measurements, &front, &commands).as_bytes())?;
        let title = format!("{name}, {} x {} pixels", job.size[0], job.size[1]);
        let mut plots = Vec::new();
        for (file, name, error) in ERRORS {
            let points = points(&self.kept.measurements, error, if file == "rms" { rivals } else { &[] });
            let svg = plot(&title, name, &points)?;
            write_file(self.directory.join(format!("time-{file}.svg")), svg.as_bytes())?;
            plots.push(svg);
        }
        let mut pictures = Vec::new();
        let best = |of: &dyn Fn(&Measurement) -> f64| {
            let measurements = front.iter().map(|&index| &self.kept.measurements[index]);
            measurements.min_by(|a, b| of(a).total_cmp(&of(b))).cloned()
        };
        let exact = (best(&|m| m.errors.rms), "The most exact of the front");
        let fast = (best(&|m| m.seconds().unwrap_or(f64::INFINITY)), "The fastest of the front");
        for (measured, title) in [exact, fast] {
            let Some(measured) = measured else { continue };
            let found = self.variants.iter().find(|v| v.model == measured.model && v.name == measured.name).cloned();
            let Some(variant) = found else { continue };
            let truth = self.truth(&variant)?;
            let image = self.study.picture(&variant)?;
            let sampled = self.study.sample().of(&image)?;
            let difference = difference_picture(&sampled, &self.truths[truth].1[0], page::GAIN)?;
            let image =
                if job.figure.is_empty() { image } else { job.figure.draw(&image, Background::default(), shown)? };
            pictures.push(page::Pictures { title: title.to_owned(), of: variant, image, difference });
        }
        let page = page::page(&page::Report {
            name: &name,
            caption: job.figure.caption.as_deref(),
            volume: shown.volume,
            kept: &self.kept,
            front: &front,
            commands: &commands,
            plots: &plots,
            pictures: &pictures,
        })?;
        let path = self.directory.join("report.html");
        write_file(&path, page.as_bytes())?;
        output::print(&summary(&self.kept.measurements, &front, &path))
    }

    /// The command that draws one picture of a measurement.
    fn command(&self, measured: &Measurement) -> String {
        let base = &self.kept.subject.command;
        let variant = self.variants.iter().find(|v| v.model == measured.model && v.name == measured.name);
        let options = variant.map(|v| command_line(&options_of(&v.settings))).unwrap_or_default();
        format!("voxsplat render {base} -o picture.png {options}")
    }
}

type ErrorOf = fn(&Errors) -> f64;

/// The errors that are plotted: the name of the file and of the axis.
const ERRORS: [(&str, &str, ErrorOf); 2] = [
    ("rms", "rms error of covered pixels", |errors| errors.rms),
    ("p999", "error that 99.9 % of covered pixels keep", |errors| errors.p999),
];

/// The points of a plot. Points of the front are numbered as in the tables.
fn points(measurements: &[Measurement], error: ErrorOf, rivals: &[Rival]) -> Vec<Point> {
    let front = front(measurements, error);
    let own = measurements.iter().enumerate().filter_map(|(index, m)| {
        let number = front.iter().position(|&at| at == index);
        Some(Point {
            series: m.model.clone(),
            label: number.map(|number| (number + 1).to_string()),
            seconds: m.seconds()?,
            error: error(&m.errors),
            front: number.is_some(),
            marker: if m.painter == "quads" { Marker::Triangle } else { Marker::Disc },
        })
    });
    let others = rivals.iter().map(|rival| Point {
        series: "other renderers".to_owned(),
        label: Some(rival.name.clone()),
        seconds: rival.seconds,
        error: rival.rms,
        front: false,
        marker: Marker::Square,
    });
    own.chain(others).collect()
}

fn csv(measurements: &[Measurement], front: &[usize], commands: &[String]) -> String {
    let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
    let mut text =
        "model,name,painter,front,views,frame_s,first_s,frames,max,p999,rms,psnr_db,alpha_max,color_max,refused,\
         command\n"
            .to_owned();
    for (index, (m, command)) in measurements.iter().zip(commands).enumerate() {
        let number = front.iter().position(|&at| at == index).map(|number| (number + 1).to_string());
        let seconds = m.seconds().map(|seconds| seconds.to_string()).unwrap_or_default();
        let Errors { max, p999, rms, psnr, alpha, color } = m.errors;
        text += &format!(
            "{},{},{},{},{},{seconds},{},{},{max},{p999},{rms},{psnr},{alpha},{color},{},{}\n",
            quoted(&m.model),
            quoted(&m.name),
            m.painter,
            number.unwrap_or_default(),
            m.views,
            m.first,
            m.frames.len(),
            quoted(m.refused.as_deref().unwrap_or_default()),
            quoted(command)
        );
    }
    text
}

/// The front as a table on stdout.
fn summary(measurements: &[Measurement], front: &[usize], page: &Path) -> String {
    let mut text = format!("{:>3}  {:>10}  {:>9}  {:>9}  way\n", "", "frame, ms", "rms", "99.9 %");
    for (number, m) in front.iter().filter_map(|&index| measurements.get(index)).enumerate() {
        let milliseconds = m.seconds().unwrap_or(f64::NAN) * 1e3;
        let Errors { rms, p999, .. } = m.errors;
        text +=
            &format!("{:>3}  {milliseconds:>10.1}  {rms:>9.2e}  {p999:>9.2e}  {}: {}\n", number + 1, m.model, m.name);
    }
    text + &format!("\nreport: {}\n", page.display())
}
