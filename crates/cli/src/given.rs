//! The options that a command line gives, and conditions on them.

use std::path::Path;

use clap::parser::ValueSource;
use clap::{ArgMatches, Command};
use serde_json::{Map, Value};
use voxsplat::formats::{Format, data_files, is_zarr, read_json};
use voxsplat::program::LABELS;

/// The largest file of key frames that is read, bytes.
pub(crate) const MAX_KEY_FRAMES: u64 = 64 << 20;

/// The options of a command line; of a scene, the options of its picture first and then the program's.
pub(crate) struct Given<'a> {
    pub(crate) command: &'a Command,
    pub(crate) lines: Vec<&'a ArgMatches>,
}

impl Given<'_> {
    pub(crate) fn is_for(&self, command: &str) -> bool {
        self.command.get_name() == command
    }

    /// Returns the identifier of an option, if the command has it.
    fn id(&self, option: &str) -> Option<&str> {
        let found = self.command.get_arguments().find(|arg| arg.get_long() == Some(option));
        found.map(|arg| arg.get_id().as_str())
    }

    /// Returns the command lines that give an option.
    fn giving<'b>(&'b self, id: &'b str) -> impl Iterator<Item = &'b ArgMatches> {
        self.lines.iter().copied().filter(move |line| {
            line.try_contains_id(id).is_ok() && line.value_source(id) == Some(ValueSource::CommandLine)
        })
    }

    pub(crate) fn has(&self, option: &str) -> bool {
        self.id(option).is_some_and(|id| self.giving(id).next().is_some())
    }

    /// Returns whether an option is given; `tune:KEY` is a key of `--tune`.
    pub(crate) fn sets(&self, option: &str) -> bool {
        option.strip_prefix("tune:").map_or_else(|| self.has(option), |key| self.tuned(key).is_some())
    }

    /// Returns the values of an option or its default.
    fn values(&self, id: &str) -> Vec<String> {
        let line = self.giving(id).next().or(self.lines.first().copied());
        let raw = line.and_then(|line| line.try_get_raw(id).ok().flatten());
        raw.into_iter().flatten().map(|value| value.to_string_lossy().into_owned()).collect()
    }

    /// Returns the last value of an option or its default; empty without.
    pub(crate) fn text(&self, option: &str) -> String {
        self.id(option).and_then(|id| self.values(id).pop()).unwrap_or_default()
    }

    pub(crate) fn is(&self, option: &str, value: &str) -> bool {
        self.text(option) == value
    }

    pub(crate) fn all(&self, option: &str, holds: impl Fn(&str) -> bool) -> bool {
        self.id(option).is_some_and(|id| self.values(id).iter().all(|value| holds(value)))
    }

    /// Returns the value that `--tune` gives to a key.
    pub(crate) fn tuned(&self, key: &str) -> Option<String> {
        let texts = self.id("tune").filter(|id| self.giving(id).next().is_some()).map(|id| self.values(id));
        let pairs = texts?.join(",");
        let mut pairs = pairs.split(',').filter_map(|pair| pair.split_once('=')).rev();
        pairs.find_map(|(name, value)| (name.trim() == key).then(|| value.trim().to_owned()))
    }

    /// Returns the volume in the spelling of the command line.
    pub(crate) fn source(&self) -> String {
        self.values("source").pop().unwrap_or_default()
    }

    /// Returns whether a key frame sets the value `name`, and so all of them do.
    pub(crate) fn keys_set(&self, name: &str) -> bool {
        let keys = || read_json::<Vec<Map<String, Value>>>(Path::new(&self.text("key-frames")), MAX_KEY_FRAMES);
        self.has("key-frames") && keys().is_ok_and(|keys| keys.iter().any(|key| key.contains_key(name)))
    }

    /// Returns whether the volume is a file outside of folders whose files belong together, or built in.
    pub(crate) fn reads_one_file(&self) -> bool {
        let source = self.source();
        let path = Path::new(&source);
        source.starts_with("demo:") || (path.is_file() && !path.parent().is_some_and(is_zarr))
    }

    /// Returns whether the volume is built in, or a file that has the name of another format than DICOM.
    pub(crate) fn reads_no_dicom_file(&self) -> bool {
        let source = self.source();
        self.reads_one_file() && (source.starts_with("demo:") || Format::of_name(Path::new(&source)).is_some())
    }

    /// Returns whether the volume is a TIFF file by its name.
    pub(crate) fn reads_tiff(&self) -> bool {
        is_tiff(Path::new(&self.source()))
    }

    /// Returns whether the volume is a Zarr or a folder of TIFF files. DICOM files do not go with TIFF files.
    pub(crate) fn reads_no_dicom(&self) -> bool {
        let source = self.source();
        let path = Path::new(&source);
        is_zarr(path)
            || path.parent().is_some_and(|folder| path.is_file() && is_zarr(folder))
            || (path.is_dir() && data_files(path).first().is_some_and(|file| is_tiff(file)))
    }
}

fn is_tiff(file: &Path) -> bool {
    let extension = file.extension();
    extension.is_some_and(|extension| ["tif", "tiff", "lsm"].iter().any(|end| extension.eq_ignore_ascii_case(end)))
}

/// Returns whether the picture is an `.exr`.
pub(crate) fn keeps_values(given: &Given<'_>) -> bool {
    !given.is_for("pareto") && given.text("output").to_lowercase().ends_with(".exr")
}

pub(crate) fn is_frames(given: &Given<'_>) -> bool {
    given.is_for("turntable") && given.text("output").contains("{frame}")
}

pub(crate) fn is_film(given: &Given<'_>) -> bool {
    given.is_for("turntable") && given.has("output") && !is_frames(given)
}

pub(crate) fn is_parallel(given: &Given<'_>) -> bool {
    given.is("projection", "orthographic")
}

/// Returns whether the size of the picture is given in the world, so that nothing is fitted.
pub(crate) fn is_sized(given: &Given<'_>) -> bool {
    given.has("view-height") || given.has("distance")
}

pub(crate) fn shows_labels(given: &Given<'_>) -> bool {
    given.is("transfer", LABELS)
}

pub(crate) fn shows_intensity(given: &Given<'_>) -> bool {
    ["mip", "minip", "average"].iter().any(|model| given.is("model", model))
}

pub(crate) fn is_post_shaded(given: &Given<'_>) -> bool {
    let is_alone = !given.has("overlay") && !given.has("labels");
    given.is("model", "composite") && (given.is("shading", "post") || given.has("iso") && is_alone)
}

pub(crate) fn is_lit(given: &Given<'_>) -> bool {
    given.has("light") && !given.all("light", |light| light == "off")
}

fn is_studio(given: &Given<'_>) -> bool {
    given.text("light").starts_with("studio")
}

pub(crate) fn casts(given: &Given<'_>) -> bool {
    match given.text("shadows").as_str() {
        "" => is_studio(given),
        "off" => false,
        strength => !matches!(strength.trim_start_matches("exact:").parse(), Ok(0.0)),
    }
}

pub(crate) fn occludes(given: &Given<'_>) -> bool {
    match given.text("occlusion").as_str() {
        "" => is_studio(given),
        radius => radius != "off",
    }
}
