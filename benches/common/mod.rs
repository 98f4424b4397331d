//! Shared parts of the benches: arguments, medians, the transfer function of a volume, and a report.

#![allow(dead_code, reason = "each harness is a program of its own and takes what it needs")]

#[allow(unused_imports, reason = "a bench has no tests")]
#[path = "../../crates/cli/src/pareto/date.rs"]
mod date;

use std::error::Error;
use std::fmt::Display;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::str::FromStr;
use std::time::{Duration, Instant};

use voxsplat::adapter::AdapterInfo;
use voxsplat::appearance::suggest;
use voxsplat::demos::own_transfer;
use voxsplat::image::compare;
use voxsplat::volume::Statistics;
use voxsplat::{Image, TransferFunction, Volume};

/// The result of a bench or of a part of it.
pub(crate) type Outcome<T = ()> = Result<T, Box<dyn Error>>;

/// The arguments of a bench. Options are `--name VALUE` and may stand anywhere.
pub(crate) struct Arguments {
    left: Vec<String>,
    /// The original arguments, for the report.
    given: Vec<String>,
    write: bool,
}

impl Arguments {
    /// The arguments of this process.
    ///
    /// `cargo bench` adds `--bench`. Without it the process ends at once: `cargo test --all-targets` runs benches
    /// too, and must not wait for measurements.
    pub(crate) fn of_process() -> Self {
        let mut left: Vec<String> = std::env::args().skip(1).collect();
        if !take_flag(&mut left, "--bench") {
            std::process::exit(0);
        }
        let given = left.clone();
        let write = take_flag(&mut left, "--write");
        Self { left, given, write }
    }

    /// Whether the arguments contain a flag.
    #[allow(dead_code, reason = "not every harness has flags of its own")]
    pub(crate) fn flag(&mut self, name: &str) -> bool {
        take_flag(&mut self.left, name)
    }

    /// The value of an option; `None` without the option.
    pub(crate) fn option<T: FromStr<Err: Error + 'static>>(&mut self, name: &str) -> Outcome<Option<T>> {
        let Some(at) = self.left.iter().position(|a| a == name) else { return Ok(None) };
        self.left.remove(at);
        if at == self.left.len() {
            return Err(format!("{name} takes a value").into());
        }
        Ok(Some(self.left.remove(at).parse()?))
    }

    /// The arguments that remain after all options have been read.
    pub(crate) fn positional(&self) -> Outcome<&[String]> {
        match self.left.iter().find(|a| a.starts_with("--")) {
            Some(unknown) => Err(format!("unknown option {unknown}").into()),
            None => Ok(&self.left),
        }
    }
}

fn take_flag(arguments: &mut Vec<String>, name: &str) -> bool {
    let before = arguments.len();
    arguments.retain(|a| a != name);
    arguments.len() < before
}

/// The report of a bench: printed line by line, and written to `docs/measurements` with `--write`.
pub(crate) struct Report {
    name: &'static str,
    arguments: Vec<String>,
    text: String,
    /// Whether the report becomes a file.
    pub(crate) write: bool,
}

impl Report {
    pub(crate) fn new(name: &'static str, arguments: &Arguments) -> Self {
        Self { name, arguments: arguments.given.clone(), text: String::new(), write: arguments.write }
    }

    /// Prints a line and keeps it.
    pub(crate) fn line(&mut self, line: impl Display) {
        println!("{line}");
        self.text.push_str(&format!("{line}\n"));
    }

    /// Writes `docs/measurements/DATE-NAME.md` with `--write`: the command, the adapter, and all lines so far.
    pub(crate) fn save(&self, adapter: &AdapterInfo) -> Outcome<Option<PathBuf>> {
        if !self.write {
            return Ok(None);
        }
        let date = date::today();
        let Self { name, arguments, text, .. } = self;
        let arguments: String = arguments.iter().map(|a| format!(" {a}")).collect();
        let cores = std::thread::available_parallelism()?;
        let AdapterInfo { name: device, driver, kind, backend, .. } = adapter;
        let page = format!(
            "# {name}, {date}\n\n\
             - command: `cargo bench --bench {name} --{arguments}`\n\
             - version: {}\n\
             - adapter: {device} ({kind}, {backend})\n\
             - driver: {driver}\n\
             - processor cores: {cores}\n\n\
             {}\n",
            version(),
            text.trim()
        );
        let package = Path::new(env!("CARGO_MANIFEST_DIR"));
        let folder = package.ancestors().map(|folder| folder.join("docs/measurements")).find(|folder| folder.is_dir());
        let folder = folder.ok_or("there is no folder docs/measurements")?;
        std::fs::create_dir_all(&folder)?;
        let file = folder.join(format!("{date}-{name}.md"));
        std::fs::write(&file, page)?;
        Ok(Some(file))
    }

    /// Saves the report and prints the name of its file.
    pub(crate) fn finish(self, adapter: &AdapterInfo) -> Outcome {
        if let Some(file) = self.save(adapter)? {
            println!("\nwritten: {}", file.display());
        }
        Ok(())
    }
}

/// The version of the crate and, in a checkout, the commit.
fn version() -> String {
    let described = Command::new("git").args(["describe", "--always", "--dirty"]).output();
    let commit = described.ok().filter(|o| o.status.success()).and_then(|o| String::from_utf8(o.stdout).ok());
    let commit = commit.map(|c| format!(", commit {}", c.trim())).unwrap_or_default();
    format!("{}{commit}", env!("CARGO_PKG_VERSION"))
}

/// Wall seconds and peak MiB of a command, and the JSON object of its last line.
pub(crate) fn measured(command: &mut Command) -> Outcome<(f64, f64, serde_json::Value)> {
    let start = Instant::now();
    let mut child =
        command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().map_err(|e| format!("{command:?}: {e}"))?;
    // The kernel's own high-water mark, read while the process lives.
    let status = PathBuf::from(format!("/proc/{}/status", child.id()));
    let mut peak = 0.0_f64;
    let ended = loop {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let mark = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        peak = peak.max(mark.and_then(|m| m.trim().trim_end_matches(" kB").parse().ok()).unwrap_or(0.0) / 1024.0);
        if let Some(ended) = child.try_wait()? {
            break ended;
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    let wall = start.elapsed().as_secs_f64();
    let mut text = String::new();
    if let Some(mut out) = child.stdout.take() {
        out.read_to_string(&mut text)?;
    }
    if !ended.success() {
        return Err(format!("{command:?} failed").into());
    }
    let json = text.lines().rev().find_map(|line| serde_json::from_str(line).ok());
    Ok((wall, peak, json.unwrap_or_default()))
}

/// The median; NaN without values.
pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Root mean square of the difference over all four channels of the pixels that either picture covers, of 255.
pub(crate) fn rms_of_255(a: &Image, b: &Image) -> voxsplat::Result<f64> {
    Ok(255.0 * compare(a, b, 0.0)?.rms_covered)
}

/// The transfer function of a built-in volume, or the preset that the data of a file suggests.
pub(crate) fn own_or_suggested(source: &str, volume: &Volume) -> voxsplat::Result<TransferFunction> {
    match own_transfer(source) {
        Some(transfer) => Ok(transfer),
        None => Ok(TransferFunction::preset(suggest(volume, &Statistics::of(volume)?).name, volume)?),
    }
}
