//! The command `voxsplat turntable`: many views of one volume, as pictures or as a film.

use std::cell::RefCell;
use std::io::{BufWriter, ErrorKind, Stdout, Write, stdout};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Instant;

use clap::{ArgMatches, Command};
use serde::{Deserialize, Serialize};
use voxsplat::appearance::Framing;
use voxsplat::camera::View;
use voxsplat::film::{Film, FilmFile, Format};
use voxsplat::formats::{TimeSeries, read_json};
use voxsplat::image::{Image, Note};
use voxsplat::program::{TransferChoice, command_line};

use super::args::{RenderArgs, TurntableArgs};
use super::destination::{Destination, STREAM};
use super::failure::{Failure, fail, refuse};
use super::fitted::Fitted;
use super::given::MAX_KEY_FRAMES;
use super::job::RenderJob;
use super::options::{file_name, quoted, words};
use super::parse::TimeArg;
use super::progress::Remaining;
use super::render::{TracedErrors, print_stats};
use super::report::Choices;
use super::session::Session;
use super::stages::Stages;
use super::{output, scene};

/// The place of the number of a frame in the name of its file.
const FRAME: &str = "{frame}";

/// The default number of frames of a turn.
const FRAMES: u32 = 36;

/// A key frame, in a JSON list. Options set the values that it leaves out.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct KeyFrame {
    /// The number of the frame, from 0.
    frame: u32,
    azimuth: Option<f64>,
    elevation: Option<f64>,
    roll: Option<f64>,
    zoom: Option<f64>,
}

/// The destination of frames.
#[derive(Debug)]
enum FilmTarget {
    /// A file for each frame, by a name with a place for the number.
    Files(String),
    /// A film in one file.
    Film(PathBuf, Format),
    /// A film on standard output.
    Stream(Format),
}

/// The course of the view over the frames.
#[derive(Debug)]
enum ViewCourse {
    /// A turn of the eye, in degrees.
    Turn(f64),
    /// Key frames in the order of frames.
    Keys(Vec<KeyFrame>),
}

impl ViewCourse {
    /// Returns the views of frames, beginning with the first.
    fn views(&self, first: &View, frames: u32) -> Vec<View> {
        match self {
            Self::Turn(turn) => {
                let step = turn / f64::from(frames);
                let turned = |frame| View { azimuth: first.azimuth + step * f64::from(frame), ..first.clone() };
                (0..frames).map(turned).collect()
            }
            Self::Keys(keys) => views_of(first, keys, frames),
        }
    }
}

/// A turntable to be made.
#[derive(Debug)]
pub(crate) struct TurntableJob {
    /// The first frame, without a destination of its own.
    first: RenderJob,
    course: ViewCourse,
    /// The number of frames, unless it depends on the file.
    frames: Option<u32>,
    /// The time points that frames go through, if there are several.
    times: Option<TimeArg>,
    /// The part of the frames to render, and the number of parts.
    part: [u32; 2],
    rate: f64,
    resume: bool,
    target: FilmTarget,
    /// The command, with names of files for their paths.
    command: String,
}

/// The totals of a run.
#[derive(Serialize)]
struct Totals {
    frames: usize,
    size: [u32; 2],
    /// The seconds from the start to the last byte.
    seconds: f64,
    seconds_per_frame: f64,
}

impl Totals {
    fn new(frames: usize, size: [u32; 2], since: Instant) -> Self {
        let seconds = since.elapsed().as_secs_f64();
        Self { frames, size, seconds, seconds_per_frame: seconds / frames.max(1) as f64 }
    }

    fn to_text(&self) -> String {
        let Self { frames, size: [width, height], seconds, seconds_per_frame } = self;
        format!("{frames} frames of {width} x {height} px in {seconds:.2} s, {seconds_per_frame:.3} s each\n")
    }
}

impl FilmTarget {
    /// Returns a destination that can be written to, as far as is known before the work.
    fn checked(path: &Path, format: Option<Format>, line: (&Command, &ArgMatches)) -> Result<Self, Failure> {
        if path.as_os_str().is_empty() {
            return refuse("--output is missing: DIR/{frame}.png, FILE.gif, FILE.html or -");
        }
        if path == Path::new(STREAM) {
            Destination::stdout()?;
            return Ok(Self::Stream(format.unwrap_or(Format::Y4m)));
        }
        match (path.to_str().filter(|name| name.contains(FRAME)), format.or(Format::for_path(path))) {
            (Some(name), _) => {
                let first = PathBuf::from(numbered(name, 0, 1));
                // The folder of the frames is made. If that fails otherwise, the check below reports the error.
                if let Some(folder) = first.parent().filter(|folder| !folder.as_os_str().is_empty()) {
                    let made = std::fs::create_dir(folder).map_err(|e| (e.kind(), e));
                    if let Err((ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem, e)) = made {
                        return refuse(format!("--output: the folder {} cannot be made: {e}", folder.display()));
                    }
                }
                Destination::checked(first)?;
                Ok(Self::Files(name.to_owned()))
            }
            (None, Some(format)) => {
                FilmFile::check(path).map_err(|e| Failure::usage(format!("{e:#}")))?;
                Ok(Self::Film(path.to_owned(), format))
            }
            (None, None) if is_video(path) => {
                let words = command_line(&words(line, &["output"], str::to_owned));
                let name = quoted(path.as_os_str());
                refuse(format!(
                    "--output: videos are encoded by ffmpeg: \
                     voxsplat turntable {words} -o - | ffmpeg -i - -pix_fmt yuv420p {name}"
                ))
            }
            (None, None) => refuse(format!(
                "--output: {path:?}, expected a name with {FRAME} such as frames/{FRAME}.png, FILE.gif, FILE.apng, \
                 FILE.y4m, FILE.html, or - for standard output"
            )),
        }
    }
}

impl FilmTarget {
    /// Returns the files of some frames.
    fn files(&self, wanted: &[u32], frames: u32) -> Vec<PathBuf> {
        match self {
            Self::Files(name) => wanted.iter().map(|&frame| numbered(name, frame, frames).into()).collect(),
            Self::Film(path, _) => vec![path.clone()],
            Self::Stream(_) => Vec::new(),
        }
    }
}

/// Returns whether a name is of a video, which other programs encode.
fn is_video(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    ["mp4", "m4v", "mov", "mkv", "webm", "avi", "mpg", "mpeg", "wmv", "ogv"].contains(&extension.as_str())
}

/// Returns the name of the file of a frame, with as many digits as the last has.
fn numbered(name: &str, frame: u32, frames: u32) -> String {
    let digits = (frames.saturating_sub(1)).to_string().len().max(4);
    name.replace(FRAME, &format!("{frame:0digits$}"))
}

impl TurntableJob {
    pub(crate) fn new(args: TurntableArgs, line: (&Command, &ArgMatches)) -> Result<Self, Failure> {
        let TurntableArgs { render, frames, turn, key_frames, rate, format, part, resume } = args;
        let job = |mut args: RenderArgs| {
            args.view.in_series = true;
            let output = Destination::File(args.output.clone().unwrap_or_default());
            RenderJob::with_output(args, output)
        };
        let mut jobs = scene::jobs(render, line, job)?;
        let Some(mut first) = jobs.pop().filter(|_| jobs.is_empty()) else {
            return refuse("the scene has several outputs, a turntable takes a scene of one picture");
        };
        // It looks from all sides.
        first.choices.open.side = false;
        first.studio.follows |= first.choices.open.light;
        let Destination::File(path) = &first.output.picture else { return refuse("--output: expected a file or -") };
        let target = FilmTarget::checked(path, format, line)?;
        let times = first.times.filter(|time| !matches!(time, TimeArg::One(_)));
        if times.is_some() && first.source == Path::new(STREAM) {
            return refuse("--time: standard input is read once, several time points need a file");
        }
        let frames = frames.or(match times {
            None => Some(FRAMES),
            Some(TimeArg::Range(first, last)) => Some(last - first + 1),
            Some(_) => None,
        });
        let course = match &key_frames {
            Some(path) => ViewCourse::Keys(read_key_frames(path)?),
            None => ViewCourse::Turn(turn),
        };
        let command = format!("voxsplat turntable {}", command_line(&words(line, &[], file_name)));
        let part = part.unwrap_or([1, 1]);
        Ok(Self { first, course, frames, times, part, rate, resume, target, command })
    }
}

/// Reads the key frames of a file, in the order of frames.
fn read_key_frames(path: &Path) -> Result<Vec<KeyFrame>, Failure> {
    let mut keys: Vec<KeyFrame> = read_json(path, MAX_KEY_FRAMES)?;
    if keys.is_empty() {
        return fail(format!("{}: has no key frames, expected one or more", path.display()));
    }
    keys.sort_by_key(|key| key.frame);
    Ok(keys)
}

/// Returns the views of frames: linear between key frames, and constant before the first and after the last.
fn views_of(base: &View, keys: &[KeyFrame], frames: u32) -> Vec<View> {
    let at = |frame: u32, value: fn(&KeyFrame) -> Option<f64>, default: f64| {
        let known: Vec<(f64, f64)> = keys.iter().filter_map(|k| Some((f64::from(k.frame), value(k)?))).collect();
        let frame = f64::from(frame);
        let above = known.partition_point(|(at, _)| *at <= frame);
        match (above.checked_sub(1).map(|below| known[below]), known.get(above).copied()) {
            (Some(a), Some(b)) => a.1 + (b.1 - a.1) * (frame - a.0) / (b.0 - a.0),
            (Some((_, end)), None) | (None, Some((_, end))) => end,
            (None, None) => default,
        }
    };
    let view = |frame| View {
        azimuth: at(frame, |key| key.azimuth, base.azimuth),
        elevation: at(frame, |key| key.elevation, base.elevation),
        roll: at(frame, |key| key.roll, base.roll),
        zoom: at(frame, |key| key.zoom, base.zoom),
        ..base.clone()
    };
    (0..frames).map(view).collect()
}

/// A finished frame on its way to its file.
struct Done {
    frame: u32,
    image: Image,
    notes: Vec<Note>,
}

impl TurntableJob {
    /// Returns the frames to render now.
    fn wanted(&self, frames: u32) -> Vec<u32> {
        let [part, parts] = self.part.map(u64::from);
        let end = |part: u64| (u64::from(frames) * part / parts) as u32;
        let exists = |frame: u32| match &self.target {
            FilmTarget::Files(name) => self.resume && Path::new(&numbered(name, frame, frames)).is_file(),
            _ => false,
        };
        (end(part - 1)..end(part)).filter(|&frame| !exists(frame)).collect()
    }

    /// Returns the title of a page: the file, and the caption or else the title of the figure.
    fn title(&self) -> String {
        let file = file_name(&self.first.source.to_string_lossy());
        let text = self.first.figure.drawn.caption.as_ref().or(self.first.figure.drawn.title.as_ref());
        text.map_or_else(|| file.clone(), |text| format!("{file}: {text}"))
    }

    /// Returns the requested time points of a file that has `held` of them.
    fn times_of(&self, asked: TimeArg, held: u32) -> Result<Range<u32>, Failure> {
        let last = match asked {
            TimeArg::One(time) | TimeArg::Range(_, time) => time,
            TimeArg::All => held - 1,
        };
        let source = self.first.source.display();
        match held {
            1 => fail(format!("--time {asked}: {source} has one time point")),
            _ if last >= held => fail(format!("--time {asked}: {source} has the time points 0 to {}", held - 1)),
            _ => Ok(asked.first()..last + 1),
        }
    }
}

pub(crate) fn run(job: TurntableJob) -> Result<(), Failure> {
    let (start, first) = (Instant::now(), &job.first);
    let size = [first.region.width, first.region.height];
    let done = |choices: Choices, files: Vec<PathBuf>, frames: usize| {
        let files = files.into_iter().chain(first.output.transfer.clone().filter(|_| frames > 0)).collect();
        print_stats(
            (choices, files),
            TracedErrors::default(),
            first.output.stats,
            &Totals::new(frames, size, start),
            Totals::to_text,
        )
    };
    let none = |fitted: Option<&Fitted>| {
        output::say("note: all frames are there");
        done(Choices::of(first, &first.settings, fitted, None), Vec::new(), 0)
    };
    if job.frames.is_some_and(|frames| job.wanted(frames).is_empty()) {
        return none(None);
    }
    let (mut session, fitted) = Session::open(first, &mut Stages::default())?;
    let times = job.times.map(|asked| job.times_of(asked, session.volume.contents().times)).transpose()?;
    let frames = job.frames.unwrap_or(times.as_ref().map_or(FRAMES, |times| times.end - times.start));
    let wanted = job.wanted(frames);
    if wanted.is_empty() {
        return none(Some(&fitted));
    }
    let mut completed = first.clone();
    session.complete(&mut completed, &fitted)?;
    if let Some(path) = &first.output.transfer {
        fitted.transfer.save(path, session.volume.grid())?;
    }
    let mut series = match times {
        None => None,
        Some(times) => {
            say_times(&completed, &times);
            let times = spread(&times, frames);
            let mut distinct = times.clone();
            distinct.dedup();
            let mut series = TimeSeries::new(&first.source, &first.load);
            session.frame_all(&completed, &fitted, &mut series, &distinct)?;
            Some((series, times))
        }
    };
    let views = job.course.views(&first.view, frames);
    // The next frame is made while the last one is encoded and written.
    let (sender, receiver) = sync_channel::<Done>(1);
    let painter = std::thread::scope(|scope| {
        let writer = scope.spawn(|| write(&job, receiver, size, frames));
        let made = make(&mut session, first, &fitted, (&views, &wanted), series.as_mut(), &sender);
        drop(sender);
        let written = writer.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        // If a frame could not be made, that is why frames are missing. A failed write ends `make` without an error.
        let painter = made?;
        written.map(|()| painter)
    })?;
    let files = job.target.files(&wanted, frames);
    done(Choices::of(&completed, &completed.settings, Some(&fitted), painter), files, wanted.len())
}

/// Returns the time point of each frame: all for equally many frames, or some at even distances if frames are fewer.
fn spread(times: &Range<u32>, frames: u32) -> Vec<u32> {
    let count = u64::from(times.end - times.start);
    (0..frames).map(|frame| times.start + (u64::from(frame) * count / u64::from(frames)) as u32).collect()
}

/// Prints notes on the properties that all time points share.
fn say_times(job: &RenderJob, times: &Range<u32>) {
    let is_fitted = match &job.transfer.choice {
        TransferChoice::Labels => false,
        TransferChoice::Given(imported) => imported.fits && job.transfer.window.is_none(),
        TransferChoice::Preset(_) | TransferChoice::Suggested => true,
    };
    let fitted = is_fitted.then_some("the transfer function of the first");
    let framed = (job.frame != Framing::Volume).then_some("one framing for all (disable: --frame volume)");
    let shared: Vec<&str> = fitted.into_iter().chain(framed).collect();
    if !shared.is_empty() {
        let (first, last) = (times.start, times.end - 1);
        output::say(&format!("note: time points {first} to {last}: using {}", shared.join(", and ")));
    }
}

/// Renders the wanted frames, each at its time point. Returns the painter of the last frame.
fn make(
    session: &mut Session,
    first: &RenderJob,
    fitted: &Fitted,
    (views, wanted): (&[View], &[u32]),
    mut series: Option<&mut (TimeSeries, Vec<u32>)>,
    sender: &SyncSender<Done>,
) -> Result<Option<&'static str>, Failure> {
    let progress = Remaining::new("frames", wanted.len());
    let (mut layers, mut painter) = (None, None);
    for (done, &frame) in wanted.iter().enumerate() {
        progress.at(done, &format!("frame {} of {}", frame + 1, views.len()));
        if let Some((series, times)) = series.as_deref_mut()
            && let Some(&time) = times.get(frame as usize)
            && time != session.volume.contents().time
        {
            layers = None;
            session.go_to(series, time)?;
        }
        let layers = match &layers {
            Some(layers) => layers,
            None => layers.insert(session.layers(first, fitted, &mut Stages::default())?),
        };
        // Studio light may come with the eye.
        let mut job = RenderJob { view: views[frame as usize].clone(), ..first.clone() };
        session.complete(&mut job, fitted)?;
        let picture = session.picture(&job, layers, &fitted.transfer, &mut Stages::default())?;
        painter = Some(picture.painter());
        let image = picture.image().clone();
        if sender.send(Done { frame, image, notes: picture.notes }).is_err() {
            break;
        }
    }
    Ok(painter)
}

/// Writes frames as they come.
fn write(job: &TurntableJob, frames: Receiver<Done>, size: [u32; 2], count: u32) -> Result<(), Failure> {
    let (rate, background) = (job.rate, job.first.output.background);
    let title = job.title();
    match &job.target {
        FilmTarget::Files(name) => {
            for Done { frame, image, notes } in frames {
                let file = Destination::File(PathBuf::from(numbered(name, frame, count)));
                file.write(&image, None, background, &notes)?;
            }
        }
        FilmTarget::Film(path, format) => {
            let mut file = FilmFile::new(*format, size, count, rate)?;
            let film = &mut file.film;
            film.title(&title);
            for Done { image, notes, .. } in frames {
                film.add(&image, background)?;
                film.describe(described(&job.command, notes));
            }
            file.save(path)?;
        }
        FilmTarget::Stream(format) => {
            let fault = RefCell::new(None);
            let stream = || {
                let out = BufWriter::new(Watched { out: stdout(), fault: &fault });
                let mut film = Film::new(out, *format, size, count, rate)?;
                film.title(&title);
                for Done { image, notes, .. } in frames {
                    film.add(&image, background)?;
                    film.describe(described(&job.command, notes));
                }
                film.finish()
            };
            let result = stream();
            match fault.take() {
                // The reader has closed the pipe, as `| head` does.
                Some(e) if e.kind() == ErrorKind::BrokenPipe => {}
                Some(e) => return fail(format!("cannot write to stdout: {e}")),
                None => result?,
            }
        }
    }
    Ok(())
}

/// Standard output, which keeps its first error: encoders report it in words of their own.
struct Watched<'a> {
    out: Stdout,
    fault: &'a RefCell<Option<std::io::Error>>,
}

impl Watched<'_> {
    fn kept<T>(&self, result: std::io::Result<T>) -> std::io::Result<T> {
        result.map_err(|e| {
            let told = std::io::Error::from(e.kind());
            self.fault.borrow_mut().get_or_insert(e);
            told
        })
    }
}

impl Write for Watched<'_> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let written = self.out.write(bytes);
        self.kept(written)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        let flushed = self.out.flush();
        self.kept(flushed)
    }
}

/// Returns the text of a page below its frames: the command, and the notes of the last picture.
fn described(command: &str, notes: Vec<Note>) -> Vec<String> {
    std::iter::once(command.to_owned())
        .chain(notes.into_iter().map(|Note { name, text }| format!("{name}: {text}")))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_run_straight_between_key_frames() {
        let text = r#"[{"frame": 2, "azimuth": 10, "zoom": 2}, {"frame": 6, "azimuth": 50}]"#;
        let keys: Vec<KeyFrame> = serde_json::from_str(text).unwrap();
        let views = views_of(&View { elevation: 7.0, ..View::default() }, &keys, 8);
        let azimuths: Vec<f64> = views.iter().map(|view| view.azimuth).collect();
        assert_eq!(azimuths, [10.0, 10.0, 10.0, 20.0, 30.0, 40.0, 50.0, 50.0]);
        assert!(views.iter().all(|view| (view.elevation, view.zoom, view.roll) == (7.0, 2.0, 0.0)));
    }

    #[test]
    fn points_in_time_are_spread_over_frames() {
        assert_eq!(spread(&(2..5), 3), [2, 3, 4]);
        assert_eq!(spread(&(2..5), 7), [2, 2, 2, 3, 3, 4, 4]);
        assert_eq!(spread(&(0..10), 4), [0, 2, 5, 7]);
        assert_eq!(spread(&(0..u32::MAX), 2), [0, u32::MAX / 2]);
    }

    #[test]
    fn frames_have_as_many_digits_as_the_last() {
        assert_eq!(numbered("a/{frame}.png", 7, 10), "a/0007.png");
        assert_eq!(numbered("{frame}-{frame}.png", 7, 100_000), "00007-00007.png");
    }
}
