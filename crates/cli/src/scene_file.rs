//! Written scene files: the options of a picture by their names, as JSON.

use std::ffi::{OsStr, OsString};
use std::path::{Component, Path, PathBuf};

use serde_json::Value;
use voxsplat::formats::without_credentials;
use voxsplat::image::{check_writable, write_file};
use voxsplat::program::{IsosurfaceSpec, LABELS, OverlaySpec, TransferChoice};
use voxsplat::transfer::TransferFunction;

use super::failure::{Failure, refuse};
use super::fitted::Fitted;
use super::layers;
use super::options::OptionValues;

/// The key of the volume, which has no option.
pub(crate) const VOLUME: &str = "volume";
/// The key of the version that wrote the scene.
pub(crate) const VERSION: &str = "voxsplat";
/// The options of a run, which do not change the picture.
const OF_A_RUN: [&str; 7] = ["output", "save-scene", "save-transfer", "stats", "json", "quiet", "help"];
/// The options that make the transfer function.
pub(crate) const OF_TRANSFER: [&str; 4] = ["transfer", "window", "gradient-opacity", "classification"];

/// The options that name files, which may have labels or a colour behind them.
const OF_FILES: [&str; 5] = ["labels", "label-table", "mask", "mesh", "depth"];
/// The option that names files with looks behind them.
const OVERLAY: &str = "overlay";

/// A scene to be written when its picture is done.
#[derive(Debug, Clone)]
pub(crate) struct SceneFile {
    path: PathBuf,
    options: Vec<OptionValues>,
}

/// Returns whether a path names a scene, not a volume.
pub(crate) fn is_scene(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"))
}

impl SceneFile {
    /// Makes a scene for a file that can be written, and that `render` takes for a scene.
    pub(crate) fn new(path: PathBuf, options: Vec<OptionValues>) -> Result<Self, Failure> {
        if !is_scene(&path) {
            return refuse(format!("--save-scene: {path:?}, expected a name that ends in .json"));
        }
        check_writable(&path).map_err(|e| Failure::usage(format!("--save-scene: {e:#}")))?;
        Ok(Self { path, options })
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Writes the scene of a job whose transfer function has been found.
    pub(crate) fn save(&self, source: &Path, choice: &TransferChoice, fitted: &Fitted) -> Result<(), Failure> {
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let volume = relative(folder, source);
        let volume = text(volume.as_os_str())?;
        let mut fields = vec![
            (VERSION.to_owned(), Value::from(env!("CARGO_PKG_VERSION")).to_string()),
            (VOLUME.to_owned(), Value::from(volume).to_string()),
        ];
        // A file may change or vanish, so its transfer function is kept. Presets adapt to the data again.
        let inlined = matches!(choice, TransferChoice::Given(_));
        if fitted.labels {
            fields.push((OF_TRANSFER[0].to_owned(), Value::from(LABELS).to_string()));
        }
        match fitted.preset {
            _ if inlined => {
                // The option adds its isosurfaces again.
                let isosurfaces = self.options.iter().filter(|(name, _)| name == "iso").flat_map(|(_, values)| values);
                let specs = isosurfaces.map(|value| text(value)?.parse().map_err(Failure::from));
                let isosurfaces = IsosurfaceSpec::points(&specs.collect::<Result<Vec<_>, Failure>>()?);
                let transfer = fitted.transfer.clone().without_isosurfaces(&isosurfaces);
                fields.push((OF_TRANSFER[0].to_owned(), indented(&transfer)));
            }
            Some(preset) => fields.push((OF_TRANSFER[0].to_owned(), Value::from(preset.name).to_string())),
            None => {}
        }
        let kept = |name: &str| match OF_TRANSFER.contains(&name) {
            true => !inlined && name != OF_TRANSFER[0],
            false => !OF_A_RUN.contains(&name),
        };
        for (name, values) in self.options.iter().filter(|(name, _)| kept(name)) {
            let placed = |value: &OsString| match OF_FILES.contains(&name.as_str()) {
                true => moved(folder, layers::parted(Path::new(value))),
                false if name == OVERLAY => moved(folder, OverlaySpec::parted(Path::new(value))),
                false => Ok(text(value)?.to_owned()),
            };
            let values = values.iter().map(|value| Ok(literal(&placed(value)?)));
            let mut values = values.collect::<Result<Vec<Value>, Failure>>()?;
            let value = match values.len() {
                0 => Value::Bool(true),
                1 => values.swap_remove(0),
                _ => Value::Array(values),
            };
            fields.push((name.clone(), value.to_string()));
        }
        let fields: Vec<String> = fields.iter().map(|(name, value)| format!("  \"{name}\": {value}")).collect();
        // Passwords and tokens are no part of a scene.
        let scene = format!("{{\n{}\n}}\n", fields.join(",\n"));
        Ok(write_file(&self.path, without_credentials(&scene).as_bytes())?)
    }
}

/// Returns a transfer function as a value in a scene.
fn indented(transfer: &TransferFunction) -> String {
    transfer.to_json().trim_end().replace('\n', "\n  ")
}

/// Returns a value of an option as a number, if it reads back as the same text.
fn literal(text: &str) -> Value {
    match serde_json::from_str::<serde_json::Number>(text) {
        Ok(number) if number.to_string() == text => Value::Number(number),
        _ => Value::from(text),
    }
}

/// Returns the name of a file relative to a folder, with the text behind it.
fn moved(folder: &Path, (file, behind): (PathBuf, &str)) -> Result<String, Failure> {
    let file = relative(folder, &file);
    Ok(text(file.as_os_str())?.to_owned() + behind)
}

fn text(value: &OsStr) -> Result<&str, Failure> {
    value.to_str().ok_or_else(|| Failure::failed(format!("--save-scene: {value:?} is not Unicode, as JSON is")))
}

/// Returns a path relative to a folder, if both are on one drive.
fn relative(folder: &Path, path: &Path) -> PathBuf {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let (Ok(folder), Ok(file)) = (folder.canonicalize(), path.canonicalize()) else { return path.to_owned() };
    let shared = folder.components().zip(file.components()).take_while(|(a, b)| a == b).count();
    if shared == 0 {
        return file;
    }
    let up = folder.components().skip(shared).map(|_| Component::ParentDir);
    up.chain(file.components().skip(shared)).collect()
}
