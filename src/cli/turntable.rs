//! `voxsplat turntable`: many views of one volume, as pictures or as a film.

use std::cell::RefCell;
use std::io::{BufWriter, stdout};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use clap::ArgMatches;
use serde::Deserialize;
use voxsplat::camera::View;
use voxsplat::film::{Film, FilmFile, Format};
use voxsplat::image::{Background, Image, Note};

use super::args::{RenderArgs, TurntableArgs};
use super::destination::{Destination, STREAM};
use super::job::RenderJob;
use super::options::command_line;
use super::progress::Remaining;
use super::render::{Fitted, Stages};
use super::session::Session;
use super::{Failure, output, scene};

/// What stands for the number of a frame in the name of its file.
const FRAME: &str = "{frame}";

/// A point in a film, in a list of them as JSON. What it leaves out is as the options say.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct KeyFrame {
    /// The first frame is 0.
    frame: u32,
    azimuth: Option<f64>,
    elevation: Option<f64>,
    roll: Option<f64>,
    zoom: Option<f64>,
}

/// Where frames go.
#[derive(Debug)]
enum Target {
    /// A file for each, by a name with a place for the number.
    Files(String),
    /// One file.
    Film(PathBuf, Format),
    /// Standard output.
    Stream(Format),
}

/// A turntable to be made.
#[derive(Debug)]
pub(super) struct TurntableJob {
    /// The first frame, without a destination of its own.
    first: RenderJob,
    views: Vec<View>,
    /// The frames that are wanted now.
    part: Range<u32>,
    rate: f64,
    resume: bool,
    target: Target,
}

impl Target {
    fn new(path: Option<PathBuf>, format: Option<Format>) -> Result<Self, Failure> {
        let usage = |reason: String| Err(Failure::Usage(reason));
        let Some(path) = path else {
            return usage("--output is missing: DIR/{frame}.png, FILE.gif, FILE.html or -".to_owned());
        };
        if path == Path::new(STREAM) {
            Destination::stdout()?;
            return Ok(Self::Stream(format.unwrap_or(Format::Y4m)));
        }
        match (path.to_str().filter(|name| name.contains(FRAME)), format.or(Format::of(&path))) {
            (Some(_), _) if format.is_some() => usage(format!("--format: {FRAME} asks for a file for each frame")),
            (Some(name), _) => {
                let first = PathBuf::from(numbered(name, 0, 1));
                // A folder for the frames is made. If it cannot be, the check says what is wrong.
                if let Some(folder) = first.parent().filter(|folder| !folder.as_os_str().is_empty()) {
                    let _ = std::fs::create_dir(folder);
                }
                Destination::checked(first)?;
                Ok(Self::Files(name.to_owned()))
            }
            (None, Some(format)) => {
                FilmFile::check(&path).map_err(|e| Failure::Usage(format!("{e:#}")))?;
                Ok(Self::Film(path, format))
            }
            (None, None) => usage(format!(
                "--output: {path:?}, expected a name with {FRAME} such as frames/{FRAME}.png, FILE.gif, FILE.apng, \
                 FILE.y4m, FILE.html, or - for standard output"
            )),
        }
    }
}

/// The name of the file of a frame, with as many digits as the last has.
fn numbered(name: &str, frame: u32, frames: u32) -> String {
    let digits = (frames.saturating_sub(1)).to_string().len().max(4);
    name.replace(FRAME, &format!("{frame:0digits$}"))
}

impl TurntableJob {
    pub(super) fn new(args: TurntableArgs, matches: &ArgMatches) -> Result<Self, Failure> {
        let usage = |reason: &str| Err(Failure::Usage(reason.to_owned()));
        let TurntableArgs { render, frames, turn, key_frames, rate, format, part, resume } = args;
        // A scene may have an output too.
        let path = RefCell::new(None);
        let first = |args: RenderArgs| {
            let output = args.output.clone().unwrap_or_default();
            path.replace(args.output.clone());
            RenderJob::with_output(args, Destination::File(output))
        };
        let mut jobs = scene::jobs(render, matches, first)?;
        let Some(mut first) = jobs.pop().filter(|_| jobs.is_empty()) else {
            return usage("a turntable takes a scene of one picture");
        };
        if first.stats.is_some() || first.verify || first.save_scene.is_some() || first.preview.is_some() {
            return usage("--stats, --verify, --preview and --save-scene are for a picture, not for a turntable");
        }
        // It looks from all sides.
        first.chooses_view = false;
        first.light_follows |= first.chooses_light;
        let target = Target::new(path.take(), format)?;
        if !matches!(target, Target::Files(_)) {
            if first.background == Background::Transparent {
                return usage("--background: films have no alpha, expected a colour");
            }
            if resume || part.is_some() {
                return usage("--resume and --part need a file for each frame, such as -o frames/{frame}.png");
            }
        }
        let views = match &key_frames {
            Some(path) => views_of(&first.view, &read_key_frames(path)?, frames),
            None => {
                let step = turn / f64::from(frames);
                let turned =
                    |frame| View { azimuth: first.view.azimuth + step * f64::from(frame), ..first.view.clone() };
                (0..frames).map(turned).collect()
            }
        };
        if first.view.direction.is_some() {
            return usage("--direction: a turntable turns the azimuth");
        }
        let [part, parts] = part.unwrap_or([1, 1]).map(u64::from);
        let end = |part: u64| (u64::from(frames) * part / parts) as u32;
        Ok(Self { first, views, part: end(part - 1)..end(part), rate, resume, target })
    }
}

/// The key frames of a file, in the order of frames.
fn read_key_frames(path: &Path) -> Result<Vec<KeyFrame>, Failure> {
    let failed = |e: String| Failure::Failed(format!("{}: {e}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|e| failed(e.to_string()))?;
    let mut keys: Vec<KeyFrame> = serde_json::from_str(&text).map_err(|e| failed(e.to_string()))?;
    keys.sort_by_key(|key| key.frame);
    Ok(keys)
}

/// The views of frames: straight from one key frame to the next, and as the nearest before the first and after the
/// last.
fn views_of(base: &View, keys: &[KeyFrame], frames: u32) -> Vec<View> {
    let of = |value: fn(&KeyFrame) -> Option<f64>, default: f64| {
        let known: Vec<(f64, f64)> = keys.iter().filter_map(|k| Some((f64::from(k.frame), value(k)?))).collect();
        move |frame: u32| {
            let frame = f64::from(frame);
            let above = known.partition_point(|(at, _)| *at <= frame);
            match (above.checked_sub(1).map(|below| known[below]), known.get(above)) {
                (Some(a), Some(b)) => a.1 + (b.1 - a.1) * (frame - a.0) / (b.0 - a.0),
                (Some(end), None) => end.1,
                (None, Some(end)) => end.1,
                (None, None) => default,
            }
        }
    };
    let azimuth = of(|key| key.azimuth, base.azimuth);
    let elevation = of(|key| key.elevation, base.elevation);
    let (roll, zoom) = (of(|key| key.roll, base.roll), of(|key| key.zoom, base.zoom));
    let view = |frame| View {
        azimuth: azimuth(frame),
        elevation: elevation(frame),
        roll: roll(frame),
        zoom: zoom(frame),
        ..base.clone()
    };
    (0..frames).map(view).collect()
}

/// A frame on its way to its file.
struct Done {
    frame: u32,
    image: Image,
    notes: Vec<Note>,
}

pub(super) fn run(job: TurntableJob) -> Result<(), Failure> {
    let TurntableJob { first, views, part, rate, resume, target } = job;
    let frames = views.len() as u32;
    let exists = |frame: u32| match &target {
        Target::Files(name) => resume && Path::new(&numbered(name, frame, frames)).is_file(),
        _ => false,
    };
    let wanted: Vec<u32> = part.filter(|&frame| !exists(frame)).collect();
    if wanted.is_empty() {
        output::say("note: all frames are there");
        return Ok(());
    }
    let mut stages = Stages::default();
    let (mut session, fitted) = Session::open(&first, &mut stages)?;
    let mut completed = first.clone();
    session.complete(&mut completed, &fitted)?;
    if let Some(path) = &first.save_transfer {
        fitted.transfer.save(path, session.volume.grid())?;
    }
    let (size, background) = ([first.region.width, first.region.height], first.background);
    // The next frame is made while the last one is encoded and written.
    let (sender, receiver) = sync_channel::<Done>(1);
    std::thread::scope(|scope| {
        let writer = scope.spawn(|| write(&target, receiver, (size, frames, rate), background));
        let made = make(&mut session, &first, &fitted, (&views, &wanted), &sender);
        drop(sender);
        let written = writer.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        // If writing failed, that is why no more frames were taken.
        written.and(made)
    })
}

/// Makes the frames that are wanted.
fn make(
    session: &mut Session,
    first: &RenderJob,
    fitted: &Fitted,
    (views, wanted): (&[View], &[u32]),
    sender: &SyncSender<Done>,
) -> Result<(), Failure> {
    let progress = Remaining::new("frames", wanted.len());
    let layers = session.layers(first, fitted, &mut Stages::default())?;
    for (done, &frame) in wanted.iter().enumerate() {
        progress.at(done, &format!("frame {} of {}", frame + 1, views.len()));
        // Studio light may come with the eye.
        let mut job = RenderJob { view: views[frame as usize].clone(), ..first.clone() };
        session.complete(&mut job, fitted)?;
        let picture = session.picture(&job, &layers, &fitted.transfer, &mut Stages::default())?;
        let image = picture.image().clone();
        if sender.send(Done { frame, image, notes: picture.notes }).is_err() {
            break;
        }
    }
    Ok(())
}

/// Writes frames as they come.
fn write(
    target: &Target,
    frames: Receiver<Done>,
    (size, count, rate): ([u32; 2], u32, f64),
    background: Background,
) -> Result<(), Failure> {
    match target {
        Target::Files(name) => {
            for Done { frame, image, notes } in frames {
                let file = Destination::File(PathBuf::from(numbered(name, frame, count)));
                file.write(&image, background, &notes)?;
            }
        }
        Target::Film(path, format) => {
            let mut film = FilmFile::new(*format, size, count, rate)?;
            for Done { image, notes, .. } in frames {
                film.add(&image, background)?;
                film.describe(described(notes));
            }
            film.save(path)?;
        }
        Target::Stream(format) => {
            let mut film = Film::new(BufWriter::new(stdout()), *format, size, count, rate)?;
            for Done { image, notes, .. } in frames {
                film.add(&image, background)?;
                film.describe(described(notes));
            }
            film.finish()?;
        }
    }
    Ok(())
}

/// What a page says of its frames: the command, and what the file of the last picture would say.
fn described(notes: Vec<Note>) -> Vec<String> {
    let words: Vec<String> = std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned()).collect();
    let command = format!("voxsplat {}", command_line(&words));
    std::iter::once(command).chain(notes.into_iter().map(|Note { name, text }| format!("{name}: {text}"))).collect()
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
    fn frames_have_as_many_digits_as_the_last() {
        assert_eq!(numbered("a/{frame}.png", 7, 10), "a/0007.png");
        assert_eq!(numbered("{frame}-{frame}.png", 7, 100_000), "00007-00007.png");
    }
}
