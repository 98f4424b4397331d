//! Files that a command line names: no output takes the place of an input or of another output.
//!
//! Data files that a header names, the slices in a folder and the files of a Zarr are inputs too. On Unix device and
//! inode tell files apart. Elsewhere their paths without links do: on Windows two hard links of one file count as
//! different files.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use clap::builder::ValueHint;
use clap::{ArgMatches, Command};
use voxsplat::formats::data_files;
use voxsplat::program::MAP;

use super::destination::STREAM;
use super::failure::{Failure, refuse};

/// The arguments that name outputs. All others that take a path name inputs.
const OUTPUTS: [&str; 5] = ["output", "save_scene", "save_transfer", "difference", "each"];

/// The files that a study writes into its folder, apart from the truths.
pub(crate) const STUDY_FILES: [&str; 5] = ["pareto.json", "pareto.csv", "time-rms.svg", "time-p999.svg", "report.html"];

/// The argument whose file the pictures of a scene may share, because its content is equal.
const SHARED: &str = "--save-transfer";

/// The identity of a file, however its path is spelt.
#[derive(Debug, PartialEq, Eq)]
enum Identity {
    #[cfg(unix)]
    Node(u64, u64),
    Path(PathBuf),
}

impl Identity {
    /// Returns the identity of a regular file, or of the file that would be created; `None` for folders and devices.
    fn of(path: &Path) -> Option<Self> {
        match path.metadata() {
            Ok(meta) if !meta.is_file() => None,
            #[cfg(unix)]
            Ok(meta) => {
                use std::os::unix::fs::MetadataExt;
                Some(Self::Node(meta.dev(), meta.ino()))
            }
            #[cfg(not(unix))]
            Ok(_) => path.canonicalize().ok().map(Self::Path),
            Err(_) => {
                let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
                Some(Self::Path(folder.canonicalize().ok()?.join(path.file_name()?)))
            }
        }
    }
}

/// A file with the argument that names it.
struct Named {
    argument: String,
    path: PathBuf,
    identity: Identity,
}

impl Named {
    fn new(argument: &str, path: &Path) -> Option<Self> {
        Some(Self { argument: argument.to_owned(), path: path.to_owned(), identity: Identity::of(path)? })
    }
}

/// The inputs and outputs of a run.
#[derive(Default)]
pub(crate) struct Files {
    inputs: Vec<Named>,
    outputs: Vec<Named>,
    /// Files and folders that may name further inputs, with their arguments.
    sources: Vec<(String, PathBuf)>,
}

impl Files {
    /// Adds the files that the arguments of a command name.
    pub(crate) fn add(&mut self, command: &Command, matches: &ArgMatches) {
        for arg in command.get_arguments().filter(|arg| arg.get_value_hint() == ValueHint::AnyPath) {
            let id = arg.get_id().as_str();
            let argument = arg.get_long().map_or_else(|| id.to_uppercase(), |name| format!("--{name}"));
            for value in matches.get_raw(id).into_iter().flatten().filter(|value| *value != STREAM) {
                if !OUTPUTS.contains(&id) {
                    let paths = readings(value).into_iter().filter(|path| path.is_file() || path.is_dir());
                    self.sources.extend(paths.map(|path| (argument.clone(), path)));
                } else if command.get_name() == "pareto" {
                    let files = STUDY_FILES.iter().map(|name| Path::new(value).join(name));
                    self.outputs.extend(files.filter_map(|path| Named::new(&argument, &path)));
                } else {
                    self.outputs.extend(Named::new(&argument, Path::new(value)));
                }
            }
        }
    }

    /// Adds only the inputs that the arguments of a command name.
    pub(crate) fn add_inputs(&mut self, command: &Command, matches: &ArgMatches) {
        let mut files = Self::default();
        files.add(command, matches);
        self.sources.append(&mut files.sources);
    }

    /// Refuses outputs that equal an input or each other.
    pub(crate) fn check(&mut self) -> Result<(), Failure> {
        // Headers are read only if there is something to overwrite.
        let replaces = self.outputs.iter().any(|output| output.path.is_file());
        for (argument, path) in self.sources.drain(..) {
            self.inputs.extend(Named::new(&argument, &path));
            if replaces {
                let of = format!("a data file of {argument} {}:", path.display());
                self.inputs.extend(data_files(&path).iter().filter_map(|file| Named::new(&of, file)));
            }
        }
        for (index, output) in self.outputs.iter().enumerate() {
            let is_same = |other: &&Named| other.identity == output.identity;
            let shares = |other: &&Named| other.argument == SHARED && output.argument == SHARED;
            let earlier = self.outputs[..index].iter().filter(|other| !shares(other));
            if let Some(other) = self.inputs.iter().chain(earlier).find(is_same) {
                let [one, two] = [output, other].map(|file| format!("{} {}", file.argument, file.path.display()));
                return refuse(format!(
                    "{one}: it is the same file as {two}, which it would overwrite; give another name"
                ));
            }
        }
        Ok(())
    }
}

/// Returns the paths that a value may mean: labels, a data set, a name or a look may stand behind the file.
fn readings(value: &OsStr) -> Vec<PathBuf> {
    let value = value.to_str().and_then(|text| text.strip_prefix(MAP)).map_or(value, OsStr::new);
    let ends =
        value.to_str().into_iter().flat_map(|text| text.match_indices(['#', ':', '@']).map(|(at, _)| &text[..at]));
    std::iter::once(PathBuf::from(value)).chain(ends.map(PathBuf::from)).collect()
}
