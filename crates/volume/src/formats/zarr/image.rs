//! Images of OME-Zarr: axes, pyramids, channels and labels (<https://ngff.openmicroscopy.org>).

use std::path::{Component, Path};

use serde_json::Value;

use super::level::Level;
use super::metadata::ZarrNode;
use super::store::Store;
use crate::error::{Error, Result, Subject, refuse, refuse_if};
use crate::formats::PyramidLevel;
use crate::formats::coordinates::Axis;
use crate::formats::placement::{named_unit, plain_name};
use crate::formats::selection::Role;
use crate::volume::{Channel, Segment};

/// The largest number of levels of a pyramid.
const MAX_LEVELS: usize = 64;

/// The largest number of channels and labels that are described.
const MAX_LABELS: usize = 4096;

/// Returns the value of a key among the attributes of OME, or among all attributes.
pub(super) fn first_of<'a>(node: &'a ZarrNode, key: &str) -> Option<&'a Value> {
    [&node.attributes["ome"][key], &node.attributes[key]].into_iter().find(|value| !value.is_null())
}

/// Returns the first pyramid of attributes: of OME-Zarr 0.5 and later, or of the versions before.
pub(super) fn pyramid(attributes: &Value) -> Option<&Value> {
    [&attributes["ome"]["multiscales"][0], &attributes["multiscales"][0]].into_iter().find(|value| value.is_object())
}

/// Returns the axes of an image without their sizes: objects since OME-Zarr 0.4, in coordinate systems since 0.6, names
/// in 0.3, and all five before.
pub(super) fn axes_of_image(folder: &Path, image: &Value) -> Result<Vec<Axis>> {
    let systems = image["coordinateSystems"].as_array().map(Vec::as_slice).unwrap_or_default();
    // The levels lie in one system, from which transformations lead to the others.
    let output = &image["datasets"][0]["coordinateTransformations"][0]["output"];
    let is_output = |system: &&Value| [output, &output["name"]].contains(&&system["name"]);
    let system = systems.iter().find(is_output).or(systems.first()).unwrap_or(image);
    let Some(list) = system["axes"].as_array() else {
        return Ok(["t", "c", "z", "y", "x"].map(|name| Axis::named(name, 0)).into());
    };
    let axis = |value: &Value| {
        let name = value.as_str().or(value["name"].as_str()).unwrap_or_default();
        let mut axis = Axis::named(name, 0);
        axis.role = match value["type"].as_str() {
            Some("space") => Role::Space,
            Some("time") => Role::Time,
            Some("") | None => axis.role,
            Some(_) => Role::Channel,
        };
        axis.unit = value["unit"].as_str().and_then(|unit| match unit {
            "angstrom" => Some("Å".to_owned()),
            "nanometer" => Some("nm".to_owned()),
            "micrometer" => Some("µm".to_owned()),
            "millimeter" => Some("mm".to_owned()),
            "centimeter" => Some("cm".to_owned()),
            "meter" => Some("m".to_owned()),
            other => named_unit(other),
        });
        axis
    };
    refuse_if!(list.len() > 16, folder, "has {} axes", list.len());
    let mut axes: Vec<Axis> = list.iter().map(axis).collect();
    // An axis of space without a unit has the unit of the others.
    let unit = axes.iter().filter(|axis| axis.role == Role::Space).find_map(|axis| axis.unit.clone());
    axes.iter_mut()
        .filter(|axis| axis.role == Role::Space && axis.unit.is_none())
        .for_each(|a| a.unit.clone_from(&unit));
    Ok(axes)
}

/// Returns the levels of a pyramid, the finest first.
pub(super) fn levels(store: &Store, folder: &Path, image: &Value, axes: usize) -> Result<Vec<Level>> {
    let list = image["datasets"].as_array().map(Vec::as_slice).unwrap_or_default();
    refuse_if!(list.is_empty() || list.len() > MAX_LEVELS, folder, "has a pyramid of {} levels", list.len());
    let mut levels: Vec<Level> = Vec::new();
    for dataset in list {
        let name = dataset["path"].as_str().unwrap_or_default();
        if !Path::new(name).components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir)) {
            refuse!(folder, "has a dataset at {name:?}, outside of its folder");
        }
        let node = ZarrNode::read(store, &folder.join(name))?;
        let Some(array) = node.array else { refuse!(node.folder, "is no array") };
        refuse_if!(array.shape.len() != axes, node.folder, "has {} axes, but its image has {axes}", array.shape.len());
        let mut level = Level { folder: node.folder, array, scale: vec![1.0; axes], translation: vec![0.0; axes] };
        level.transform(folder, &dataset["coordinateTransformations"], 0)?;
        // Before 0.6 these are the transformations of all levels; since then they lead to other coordinate systems.
        if image["coordinateSystems"].is_null() {
            level.transform(folder, &image["coordinateTransformations"], 0)?;
        }
        levels.push(level);
    }
    // Versions before 0.4 state no scales, and some writers state the same for all levels.
    if let Some((first, others)) = levels.split_first_mut()
        && others.iter().all(|level| level.scale == first.scale)
    {
        for level in others {
            let sizes = first.array.shape.iter().zip(&level.array.shape);
            level.scale.iter_mut().zip(sizes).for_each(|(scale, (fine, coarse))| *scale *= reduction(*fine, *coarse));
        }
    }
    Ok(levels)
}

/// Returns the number of samples of a finer level for each sample of a coarser one: a whole number, if a rounded share
/// of the finer size makes the coarser one.
fn reduction(fine: u64, coarse: u64) -> f64 {
    let ratio = fine as f64 / coarse.max(1) as f64;
    let whole = ratio.round().max(1.0) as u64;
    if [fine / whole, fine.div_ceil(whole)].contains(&coarse) { whole as f64 } else { ratio }
}

impl Level {
    /// Applies a list of transformations.
    fn transform(&mut self, folder: &Path, list: &Value, depth: usize) -> Result<()> {
        let axes = self.scale.len();
        for value in list.as_array().into_iter().flatten() {
            match value["type"].as_str() {
                Some(kind @ ("scale" | "translation")) => {
                    let by: Option<Vec<f64>> =
                        value[kind].as_array().and_then(|by| by.iter().map(Value::as_f64).collect());
                    let by = by.filter(|by| by.len() == axes && by.iter().all(|n| n.is_finite()));
                    let Some(by) = by else { refuse!(folder, "has no {kind} of {axes} numbers") };
                    if kind == "scale" {
                        let numbers = self.scale.iter_mut().chain(&mut self.translation);
                        numbers.zip(by.iter().cycle()).for_each(|(n, by)| *n *= by);
                    } else {
                        self.translation.iter_mut().zip(by).for_each(|(n, by)| *n += by);
                    }
                }
                Some("identity") => {}
                Some("sequence") if depth < 8 => self.transform(folder, &value["transformations"], depth + 1)?,
                other => {
                    let (kind, read) =
                        (other.unwrap_or_default(), "expected scale, translation, identity or a sequence");
                    refuse!(folder, "has a transformation of the type {kind:?}, {read} of them");
                }
            }
        }
        Ok(())
    }
}

/// Returns the names, colours and windows of the image's channels.
pub(super) fn labels(node: &ZarrNode) -> Vec<Channel> {
    let list = first_of(node, "omero").and_then(|omero| omero["channels"].as_array());
    let label = |value: &Value| {
        let color = value["color"].as_str().and_then(|text| u32::from_str_radix(text.trim_start_matches('#'), 16).ok());
        let (low, high) = (value["window"]["start"].as_f64(), value["window"]["end"].as_f64());
        Channel {
            name: value["label"].as_str().and_then(plain_name),
            color: color.map(|rgb| {
                let [_, r, g, b] = rgb.to_be_bytes();
                [r, g, b]
            }),
            window: low.zip(high).map(|(low, high)| [low, high]),
        }
    };
    list.into_iter().flatten().take(MAX_LABELS).map(label).collect()
}

/// Returns the colours and the names of labels, if the image is an image of labels.
pub(super) fn segments(node: &ZarrNode) -> Option<Vec<Segment>> {
    let image = first_of(node, "image-label")?;
    let of = |list: &'static str| image[list].as_array().map(Vec::as_slice).unwrap_or_default().iter().take(MAX_LABELS);
    let label = |value: &Value| value["label-value"].as_f64().map(|label| label as i64);
    let mut segments: Vec<Segment> = Vec::new();
    for (value, label) in of("colors").filter_map(|value| Some((value, label(value)?))) {
        let channel = |n: usize| u8::try_from(value["rgba"][n].as_u64()?).ok();
        let color = channel(0).zip(channel(1)).zip(channel(2)).map(|((r, g), b)| [r, g, b]);
        segments.push(Segment { label, color, ..Segment::default() });
    }
    for (value, label) in of("properties").filter_map(|value| Some((value, label(value)?))) {
        let Some(name) = value["name"].as_str().and_then(plain_name) else { continue };
        match segments.iter_mut().find(|segment| segment.label == label) {
            Some(segment) => segment.name = Some(name),
            None => segments.push(Segment { label, name: Some(name), ..Segment::default() }),
        }
    }
    Some(segments)
}

/// Returns the number of the requested level.
pub(super) fn chosen_level(folder: &Path, levels: &[Level], axes: &[Axis], asked: PyramidLevel) -> Result<usize> {
    let steps = |level: &Level| -> Vec<f64> {
        let of = level.scale.iter().zip(axes).filter(|(_, axis)| axis.role == Role::Space);
        of.map(|(step, _)| step.abs()).collect()
    };
    let pixel = match asked {
        PyramidLevel::At(n) if (n as usize) < levels.len() => return Ok(n as usize),
        PyramidLevel::At(n) => {
            let reason = format!("{n}, but {} has the levels 0 to {}", folder.display(), levels.len() - 1);
            return Err(Error::setting("pyramid", reason));
        }
        PyramidLevel::PixelSize(size) => size,
        PyramidLevel::Pixels(pixels) => {
            let finest = &levels[0];
            let extent = |(axis, step): (usize, &f64)| finest.array.shape[axis] as f64 * step.abs();
            let of_space = finest.scale.iter().enumerate().filter(|(axis, _)| axes[*axis].role == Role::Space);
            of_space.map(extent).fold(0.0, f64::max) / pixels.max(1.0)
        }
    };
    // An axis that is coarse at all levels does not count.
    let finest = steps(&levels[0]);
    let fine =
        |level: &Level| steps(level).iter().zip(&finest).all(|(step, first)| *step <= first.max(pixel) * (1.0 + 1e-9));
    Ok(levels.iter().rposition(fine).unwrap_or(0))
}
