//! Zarr 2 and 3, and OME-Zarr 0.4 and 0.5: a folder of chunks (<https://zarr-specs.readthedocs.io>,
//! <https://ngff.openmicroscopy.org>).
//!
//! An image of OME is a pyramid: the same volume at several resolutions. The coarsest that is fine enough is read,
//! chunk by chunk; of shards, which are files of many chunks, only the chunks that are needed.
//!
//! The crate `zarrs` is not used: it adds 133 packages. Zarr needs little: JSON, and codecs, which are crates
//! except for Blosc's container.

mod blosc;
mod codecs;
mod content;
mod metadata;

use std::ops::Range;
use std::path::{Component, Path, PathBuf};

use glam::DVec3;
use rayon::prelude::*;
use serde_json::Value;

use self::codecs::{Bytes, ChunkTarget, Part, parts, strides_of};
use self::metadata::{Array, Node};
use super::decode::{Kind, of_halves};
use super::folder::is_zarr;
use super::placement::{Placement, named_unit, plain_name};
use super::selection::{Axes, Role, guessed, indices, sized};
use super::{LoadOptions, PyramidLevel};
use crate::error::{Error, Result, Subject, refuse, refuse_if};
use crate::files;
use crate::memory::{reserved, samples_in, zeroed};
use crate::volume::{Channel, Contents, Endian, Number, Samples, Units, Volume, with_type};

/// The most levels of a pyramid.
const MAX_LEVELS: usize = 64;

/// The most chunks that are looked for.
const MAX_CHUNKS: u64 = 1 << 22;

/// The most bytes of chunks that are decompressed at once.
const AT_ONCE: u64 = 1 << 28;

/// An axis, as OME names it.
struct Axis {
    name: String,
    role: Role,
    unit: Option<String>,
}

/// A level of a pyramid.
struct Level {
    folder: PathBuf,
    array: Array,
    /// For each axis of the array, the distance between samples and the place of the first.
    scale: Vec<f64>,
    translation: Vec<f64>,
}

/// Reads the volume of a folder.
pub(super) fn read(folder: &Path, options: &LoadOptions) -> Result<Volume> {
    let mut node = Node::read(folder)?;
    // Bio-Formats puts images in folders with numbers.
    if node.array.is_none() && pyramid(&node.attributes).is_none() && first_of(&node, "bioformats2raw.layout").is_some()
    {
        let series = options.series.unwrap_or(1);
        let Some(index) = series.checked_sub(1).filter(|n| is_zarr(&folder.join(n.to_string()))) else {
            return Err(Error::setting("series", format!("{series}, but {} has no such image", folder.display())));
        };
        node = Node::read(&folder.join(index.to_string()))?;
    }
    if let Some(array) = node.array {
        let axes = axes_of_array(&node.folder, &array)?;
        let ones = vec![1.0; array.shape.len()];
        let translation = vec![0.0; array.shape.len()];
        let level = Level { folder: node.folder, array, scale: ones, translation };
        return level.read(&axes, Contents::default(), options);
    }
    let Some(image) = pyramid(&node.attributes) else { return Err(no_image(&node)) };
    let axes = axes_of_image(&node.folder, image)?;
    let levels = levels(&node.folder, image, axes.len())?;
    let index = chosen_level(&node.folder, &levels, &axes, options.level)?;
    let contents =
        Contents { labels: labels(&node), level: index as u32, levels: levels.len() as u32, ..Contents::default() };
    let Some(level) = levels.into_iter().nth(index) else { return Err(no_image(&node)) };
    level.read(&axes, contents, options)
}

/// The value of a key among the attributes of OME, or among all attributes.
fn first_of<'a>(node: &'a Node, key: &str) -> Option<&'a Value> {
    [&node.attributes["ome"][key], &node.attributes[key]].into_iter().find(|value| !value.is_null())
}

/// The first pyramid of attributes: of OME-Zarr 0.5, or of those before.
fn pyramid(attributes: &Value) -> Option<&Value> {
    [&attributes["ome"]["multiscales"][0], &attributes["multiscales"][0]].into_iter().find(|value| value.is_object())
}

/// The error about a group that is no image.
fn no_image(node: &Node) -> Error {
    if first_of(node, "plate").is_some() {
        let reason = "is a plate with many images: give the folder of one, such as PLATE/A/1/0";
        return Error::format(&node.folder, reason);
    }
    let inside = std::fs::read_dir(&node.folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let name = |path: PathBuf| plain_name(&path.file_name()?.to_string_lossy());
    let mut names: Vec<String> = inside.filter(|path| is_zarr(path)).filter_map(name).take(20).collect();
    names.sort();
    let found = match names.is_empty() {
        true => String::new(),
        false => format!(": give one of the folders in it: {}", names.join(", ")),
    };
    node.folder.error(format!("is a group of Zarr without an image{found}"))
}

/// The axes of an array by their names; without names, roles are guessed.
fn axes_of_array(folder: &Path, array: &Array) -> Result<Vec<Axis>> {
    let named = |name: &str| Axis { name: name.to_owned(), role: role_of(name, ""), unit: None };
    if array.names.len() == array.shape.len() && array.names.iter().any(|name| !name.is_empty()) {
        return Ok(array.names.iter().map(|name| named(name)).collect());
    }
    let sizes: Vec<i64> = array.shape.iter().rev().map(|&n| sized(n)).collect();
    let axes: Axes = guessed(&sizes);
    if axes.iter().filter(|(role, _)| *role == Role::Space).count() > 3 {
        refuse!(folder, "has {} axes without names, expected at most 5", array.shape.len());
    }
    Ok(axes.into_iter().rev().map(|(role, _)| Axis { name: String::new(), role, unit: None }).collect())
}

fn role_of(name: &str, kind: &str) -> Role {
    match (kind, name) {
        ("space", _) => Role::Space,
        ("time", _) | ("", "t" | "time") => Role::Time,
        ("channel", _) | ("", "c" | "channel") => Role::Channel,
        ("", _) => Role::Space,
        _ => Role::Channel,
    }
}

/// The axes of an image: objects since OME-Zarr 0.4, names in 0.3, and all five before.
fn axes_of_image(folder: &Path, image: &Value) -> Result<Vec<Axis>> {
    let Some(list) = image["axes"].as_array() else {
        return Ok(["t", "c", "z", "y", "x"]
            .map(|name| Axis { name: name.into(), role: role_of(name, ""), unit: None })
            .into());
    };
    let axis = |value: &Value| {
        let name = value.as_str().or(value["name"].as_str()).unwrap_or_default();
        let role = role_of(name, value["type"].as_str().unwrap_or_default());
        let unit = value["unit"].as_str().and_then(|unit| match unit {
            "angstrom" => Some("Å".to_owned()),
            "nanometer" => Some("nm".to_owned()),
            "micrometer" => Some("µm".to_owned()),
            "millimeter" => Some("mm".to_owned()),
            "centimeter" => Some("cm".to_owned()),
            "meter" => Some("m".to_owned()),
            other => named_unit(other),
        });
        Axis { name: name.to_owned(), role, unit }
    };
    refuse_if!(list.len() > 16, folder, "has {} axes", list.len());
    Ok(list.iter().map(axis).collect())
}

/// The levels of a pyramid, the finest first.
fn levels(folder: &Path, image: &Value, axes: usize) -> Result<Vec<Level>> {
    let list = image["datasets"].as_array().map(Vec::as_slice).unwrap_or_default();
    refuse_if!(list.is_empty() || list.len() > MAX_LEVELS, folder, "has a pyramid of {} levels", list.len());
    let mut levels = Vec::new();
    for dataset in list {
        let name = dataset["path"].as_str().unwrap_or_default();
        if !Path::new(name).components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir)) {
            refuse!(folder, "has a dataset at {name:?}, outside of its folder");
        }
        let node = Node::read(&folder.join(name))?;
        let Some(array) = node.array else { refuse!(node.folder, "is no array") };
        refuse_if!(array.shape.len() != axes, node.folder, "has {} axes, but its image has {axes}", array.shape.len());
        let (mut scale, mut translation) = (vec![1.0; axes], vec![0.0; axes]);
        // Transformations of the level come first, then the transformations of all levels.
        for value in [dataset, image].iter().flat_map(|of| of["coordinateTransformations"].as_array()).flatten() {
            match value["type"].as_str() {
                Some(kind @ ("scale" | "translation")) => {
                    let by: Option<Vec<f64>> =
                        value[kind].as_array().and_then(|by| by.iter().map(Value::as_f64).collect());
                    let by = by.filter(|by| by.len() == axes && by.iter().all(|n| n.is_finite()));
                    let Some(by) = by else { refuse!(folder, "has no {kind} of {axes} numbers") };
                    if kind == "scale" {
                        scale.iter_mut().chain(&mut translation).zip(by.iter().cycle()).for_each(|(n, by)| *n *= by);
                    } else {
                        translation.iter_mut().zip(by).for_each(|(n, by)| *n += by);
                    }
                }
                Some("identity") => {}
                other => refuse!(folder, "has a transformation of the type {:?}", other.unwrap_or_default()),
            }
        }
        levels.push(Level { folder: node.folder, array, scale, translation });
    }
    Ok(levels)
}

/// The names, colours and windows of the image's channels.
fn labels(node: &Node) -> Vec<Channel> {
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
    list.into_iter().flatten().take(4096).map(label).collect()
}

/// The number of the requested level.
fn chosen_level(folder: &Path, levels: &[Level], axes: &[Axis], asked: PyramidLevel) -> Result<usize> {
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

impl Level {
    fn read(&self, axes: &[Axis], contents: Contents, options: &LoadOptions) -> Result<Volume> {
        let Self { folder, array, .. } = self;
        // Axes of space, the fastest first.
        let space: Vec<usize> = (0..axes.len()).rev().filter(|&axis| axes[axis].role == Role::Space).collect();
        refuse_if!(!(2..=3).contains(&space.len()), folder, "has {} axes of space, expected 2 or 3", space.len());
        let sizes: Vec<i64> = space.iter().map(|&axis| sized(array.shape[axis])).collect();
        let placement = self.placement(axes, &space);
        let grid = placement.grid(folder, &sizes, options.spacing)?;
        let all: Axes = axes.iter().zip(&array.shape).rev().map(|(axis, size)| (axis.role, sized(*size))).collect();
        let (indices, taken) = indices(folder, &all, options)?;
        let mut contents =
            Contents { labels: contents.labels, level: contents.level, levels: contents.levels, ..taken };
        if contents.labels.len() != contents.channels as usize {
            contents.labels.clear();
        }
        let part = |(size, index): (&u64, Option<u64>)| index.map_or(0..*size, |index| index..index + 1);
        let want: Vec<Range<u64>> = array.shape.iter().zip(indices.into_iter().rev()).map(part).collect();
        let mut strides = vec![0; axes.len()];
        space.iter().fold(1, |stride, &axis| {
            strides[axis] = stride;
            stride * array.shape[axis] as usize
        });
        let samples = match array.kind {
            Kind::Whole(sample_type) => {
                with_type!(sample_type, T => T::collected(self.samples::<T>(&want, &strides, array.fill())?))
            }
            Kind::Half => {
                let fill = half::f16::from_f32(array.fill()).to_bits();
                Samples::F32(of_halves(self.samples(&want, &strides, fill)?, folder)?)
            }
        };
        let unit = space.first().and_then(|&axis| axes[axis].unit.clone());
        let length = unit.filter(|unit| space.iter().all(|&axis| axes[axis].unit.as_ref() == Some(unit)));
        let volume = placement.volume(grid, samples.into())?;
        Ok(volume.with_units(Units { length, value: None }).with_contents(contents))
    }

    /// The position of the lattice with these axes of space, the fastest first.
    fn placement(&self, axes: &[Axis], space: &[usize]) -> Placement {
        let named = |axis: usize| ["x", "y", "z"].iter().position(|name| *name == axes[axis].name);
        let mut of_world: Vec<usize> = space.iter().filter_map(|&axis| named(axis)).collect();
        of_world.dedup();
        if of_world.len() != space.len() || (1..space.len()).any(|n| of_world[..n].contains(&of_world[n])) {
            of_world = (0..space.len()).collect();
        }
        let left = (0..3).find(|axis| !of_world.contains(axis)).unwrap_or(2);
        let mut placement = Placement::axis_parallel([1.0; 3]);
        // A plane has one section.
        for n in 0..3 {
            let direction = DVec3::AXES[of_world.get(n).copied().unwrap_or(left)];
            let Some(&axis) = space.get(n) else {
                placement.directions[n] = direction;
                continue;
            };
            placement.directions[n] = direction * self.scale[axis].signum();
            placement.spacing[n] = self.scale[axis].abs();
            placement.origin += direction * self.translation[axis];
        }
        placement
    }

    /// The part `want` of the array, placed by strides: samples from one index of an axis to the next.
    fn samples<T: Number>(&self, want: &[Range<u64>], strides: &[usize], fill: T) -> Result<Vec<T>> {
        let Self { folder, array, .. } = self;
        let count = want.iter().fold(1_u64, |count, range| count.saturating_mul(range.end - range.start));
        let counts = want.iter().zip(&array.chunks).map(|(range, size)| range.end.div_ceil(*size) - range.start / size);
        let chunks = counts.fold(1, u64::saturating_mul);
        refuse_if!(chunks > MAX_CHUNKS, folder, "is in {chunks} chunks, expected at most {MAX_CHUNKS}");
        let mut samples: Vec<T> = zeroed(count, || samples_in(folder))?;
        let largest = array.chunks.iter().product::<u64>() * size_of::<T>() as u64;
        let at_once = (AT_ONCE / largest.max(1)).clamp(1, rayon::current_num_threads() as u64) as usize;
        let mut all = parts(want, &array.chunks);
        loop {
            let batch: Vec<Part> = all.by_ref().take(at_once).collect();
            if batch.is_empty() {
                return Ok(samples);
            }
            let read = |(chunk, inner, at): Part| {
                let file = array.file(folder, &chunk);
                let region: Option<Vec<T>> = self.chunk(&file, &inner, fill)?;
                Ok::<_, Error>(region.map(|region| (region, inner, at)))
            };
            let batch: Vec<_> = batch.into_par_iter().map(read).collect::<Result<_>>()?;
            for (region, inner, at) in batch.into_iter().flatten() {
                let shape: Vec<u64> = inner.iter().map(|range| range.end - range.start).collect();
                let all: Vec<Range<u64>> = shape.iter().map(|size| 0..*size).collect();
                let first = at.iter().zip(strides).map(|(n, stride)| *n as usize * stride).sum();
                let mut target = ChunkTarget { samples: &mut samples, first, strides: strides.to_vec() };
                target.place(bytemuck::cast_slice(&region), Endian::NATIVE, &shape, &all);
            }
        }
    }

    /// A part of a chunk; `None` if the chunk is not there and would hold zeros.
    fn chunk<T: Number>(&self, path: &Path, inner: &[Range<u64>], fill: T) -> Result<Option<Vec<T>>> {
        let shape: Vec<u64> = inner.iter().map(|range| range.end - range.start).collect();
        let count: u64 = shape.iter().product();
        let filled = || {
            let mut region: Vec<T> = reserved(count, || samples_in(path))?;
            region.resize(count as usize, fill);
            Ok::<_, Error>(region)
        };
        let (file, length) = match files::open(path) {
            Err(Error::Read { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => {
                let is_zero = bytemuck::bytes_of(&fill).iter().all(|byte| *byte == 0);
                return if is_zero { Ok(None) } else { filled().map(Some) };
            }
            Err(error) => return Err(error),
            Ok((_, None)) => refuse!(path, "is not a regular file"),
            Ok((file, Some(length))) => (file, length),
        };
        let mut region = filled()?;
        let mut target = ChunkTarget { samples: &mut region, first: 0, strides: strides_of(&shape) };
        let read = self.array.chain.read(&Bytes::File(&file, length), (&self.array.chunks, inner), &mut target);
        read.map_err(|source| Error::of_content(path, source))?;
        Ok(Some(region))
    }
}
