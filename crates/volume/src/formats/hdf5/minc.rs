//! MINC 1, which is NetCDF, and MINC 2, which is HDF5 (<https://en.wikibooks.org/wiki/MINC>).
//!
//! Integers stand for values: the valid range of an image is mapped to the range from `image-min` to `image-max`. These
//! two are numbers of the whole image or of each section. The reader does as nibabel does: integers beyond the valid
//! range are clipped, and floats are values already.

use std::path::Path;

use glam::DVec3;
use netcdf_reader::{NcAttribute, NcFile, NcGroup, NcSliceInfoElem, NcType, NcVariable};

use super::slabs::{Slabs, attribute, text};
use crate::error::{Result, Subject, refuse, refuse_if};
use crate::formats::LoadOptions;
use crate::formats::placement::{Placement, RAS_TO_LPS, named_unit, plain_name};
use crate::formats::selection::{Axes, Role, indices, sized};
use crate::memory::{reserved, samples_in};
use crate::volume::{Samples, ToF64, Units, Volume, with_samples};

/// The largest number of axes, the slowest ones, along which ranges may differ.
const MAX_SCALED: usize = 2;

/// The axes of space by the ends of their names, with their default directions in RAS.
const SPACE: [(&str, DVec3); 3] = [("xspace", DVec3::X), ("yspace", DVec3::Y), ("zspace", DVec3::Z)];

/// The image of a file with the variables that describe it.
pub(super) struct Image<'a> {
    /// The group of the image; `path` is its path.
    group: &'a NcGroup,
    path: &'static str,
    variable: &'a NcVariable,
    /// The group of the variables of axes.
    axes: &'a NcGroup,
}

/// Returns the image of a file of MINC, unless another data set of it is requested.
pub(super) fn image<'a>(root: &'a NcGroup, inside: Option<&str>) -> Option<Image<'a>> {
    let (group, path, axes) = match root.group("minc-2.0") {
        Some(_) => (root.group("minc-2.0/image/0")?, "/minc-2.0/image/0", root.group("minc-2.0/dimensions")?),
        None => (root, "", root),
    };
    let has = |name: &str| variable(group, name).is_some();
    let is_requested =
        inside.is_none_or(|inside| format!("{path}/image") == format!("/{}", inside.trim_start_matches('/')));
    let is_minc = !path.is_empty() || has("image-max") || has("image-min");
    variable(group, "image").filter(|_| is_requested && is_minc).map(|variable| Image { group, path, variable, axes })
}

fn variable<'a>(group: &'a NcGroup, name: &str) -> Option<&'a NcVariable> {
    group.variables.iter().find(|variable| variable.name == name)
}

/// An axis of an image.
struct ImageAxis<'a> {
    name: String,
    size: u64,
    role: Role,
    /// The direction along the axis in RAS, with its default.
    direction: DVec3,
    attributes: &'a [NcAttribute],
}

impl ImageAxis<'_> {
    fn number(&self, name: &str) -> Option<f64> {
        attribute(self.attributes, name)?.value.as_f64()
    }
}

/// Reads the volume of an image.
pub(super) fn read(file: &NcFile, image: &Image<'_>, path: &Path, options: &LoadOptions) -> Result<Volume> {
    let axes = axes(image, path)?;
    // The slowest axis comes first in the file.
    let space: Vec<&ImageAxis<'_>> = axes.iter().rev().filter(|axis| axis.role == Role::Space).collect();
    let sizes: Vec<i64> = space.iter().map(|axis| sized(axis.size)).collect();
    let [x, y, z] = space[..] else { refuse!(path, "has {} axes of space, expected 3", space.len()) };
    let placement = placement([x, y, z]);
    let grid = placement.grid(path, &sizes, options.spacing)?;
    let all: Axes = axes.iter().rev().map(|axis| (axis.role, sized(axis.size))).collect();
    let (indices, contents) = indices(path, &all, options)?;
    let selected = |(axis, index): (&ImageAxis<'_>, Option<u64>)| index.map_or(0..axis.size, |index| index..index + 1);
    let ranges: Vec<_> = axes.iter().zip(indices.into_iter().rev()).map(selected).collect();
    let element = |range: &std::ops::Range<u64>| NcSliceInfoElem::Slice { start: range.start, end: range.end, step: 1 };
    let name = format!("{}/image", image.path);
    let slowest = axes.iter().position(|axis| axis.role == Role::Space);
    let selections = ranges.iter().map(element).collect();
    let slabs = Slabs { file, name: &name, kind: &image.variable.dtype, selections, slowest, path };
    let attributes = &image.variable.attributes;
    let is_byte = matches!(image.variable.dtype, NcType::Byte) && image.path.is_empty();
    // Bytes of MINC 1 are unsigned by default, and larger integers are signed.
    let unsigned = text(attributes, "signtype").map_or(is_byte, |text| text.trim_end_matches('_') == "unsigned");
    let samples = slabs.samples(unsigned, grid.len())?;
    let units = Units { length: text(x.attributes, "units").and_then(|unit| named_unit(&unit)), value: None };
    let finished = |samples: Samples, (slope, intercept): (f64, f64)| {
        let volume = placement.volume(grid, samples.into())?.with_units(units).with_contents(contents);
        volume.with_rescale(slope, intercept).map_err(|error| path.error(format!("{name}: {error}")))
    };
    let Some([least, most]) = valid_range(&samples, attributes, path)? else { return finished(samples, (1.0, 0.0)) };
    let (low_sizes, low) = extents(file, image, "image-min", 0.0, path)?;
    let (high_sizes, high) = extents(file, image, "image-max", 1.0, path)?;
    let own: Vec<u64> = axes.iter().take(low_sizes.len()).map(|axis| axis.size).collect();
    if low_sizes != high_sizes || low_sizes != own || own.len() > MAX_SCALED {
        refuse!(
            path,
            "has image-min of {low_sizes:?} and image-max of {high_sizes:?}, expected one for each of {own:?}"
        );
    }
    let map = |n: usize| {
        let slope = (high[n] - low[n]) / (most - least);
        (slope, low[n] - least * slope)
    };
    // The ranges of the samples, in their order: samples with the same index along the slowest axes share one.
    let mut places = vec![0_u64];
    for (range, size) in ranges.iter().zip(&own) {
        places = places.into_iter().flat_map(|place| range.clone().map(move |at| place * size + at)).collect();
    }
    let maps: Vec<(f64, f64)> = places.into_iter().map(|place| map(place as usize)).collect();
    let is_valid = with_samples!(&samples, s => s.iter().all(|s| (least..=most).contains(&s.to_f64())));
    match maps[..] {
        [first, ref others @ ..] if is_valid && first.0 != 0.0 && others.iter().all(|map| *map == first) => {
            finished(samples, first)
        }
        _ => finished(mapped(&samples, &maps, [least, most], path)?, (1.0, 0.0)),
    }
}

/// Returns the axes of an image, the slowest first.
fn axes<'a>(image: &Image<'a>, path: &Path) -> Result<Vec<ImageAxis<'a>>> {
    let dimensions = &image.variable.dimensions;
    // HDF5 has no names of axes of its own.
    let order = text(&image.variable.attributes, "dimorder").filter(|_| !image.path.is_empty());
    let named: Vec<String> = match order {
        Some(order) => order.split(',').map(|name| name.trim().to_owned()).take(dimensions.len()).collect(),
        None => dimensions.iter().map(|axis| axis.name.clone()).collect(),
    };
    refuse_if!(named.len() < dimensions.len(), path, "its dimorder names {} of {} axes", named.len(), dimensions.len());
    let axis = |(name, size): (String, u64)| {
        let attributes = variable(image.axes, &name).map_or(&[][..], |variable| &variable.attributes);
        let (role, default) = match SPACE.iter().find(|(known, _)| *known == name) {
            Some((_, default)) => (Role::Space, *default),
            None if name == "time" => (Role::Time, DVec3::ZERO),
            None if name == "vector_dimension" => (Role::Channel, DVec3::ZERO),
            None => {
                let name = plain_name(&name).unwrap_or_default();
                refuse!(path, "has the axis {name:?}, expected xspace, yspace, zspace, time or vector_dimension");
            }
        };
        let is_irregular = text(attributes, "spacing").is_some_and(|spacing| spacing.starts_with("irregular"));
        refuse_if!(is_irregular && role == Role::Space, path, "has sections at irregular distances along {name}");
        let cosines = attribute(attributes, "direction_cosines").and_then(|cosines| cosines.value.as_f64_vec());
        let direction =
            cosines.and_then(|cosines| <[f64; 3]>::try_from(cosines).ok()).map_or(default, DVec3::from_array);
        Ok(ImageAxis { name, size, role, direction, attributes })
    };
    let axes = named.into_iter().zip(dimensions.iter().map(|axis| axis.size)).map(axis);
    let axes = axes.collect::<Result<Vec<_>>>()?;
    let is_twice = |axis: &ImageAxis<'_>| axes.iter().filter(|other| other.name == axis.name).count() > 1;
    match axes.iter().find(|axis| is_twice(axis)) {
        Some(axis) => refuse!(path, "has the axis {} twice", axis.name),
        None => Ok(axes),
    }
}

/// Returns the position of a lattice with these axes of space, the fastest first.
fn placement(axes: [&ImageAxis<'_>; 3]) -> Placement {
    let step = |axis: &ImageAxis<'_>| axis.number("step").unwrap_or(1.0);
    let origin = axes.iter().map(|axis| axis.direction * axis.number("start").unwrap_or(0.0)).sum();
    let directions = axes.map(|axis| if step(axis) < 0.0 { -axis.direction } else { axis.direction });
    let spacing = axes.map(|axis| step(axis).abs());
    Placement { directions, spacing, origin, oriented: true }.flipped(RAS_TO_LPS)
}

/// Returns the integers that represent the ends of the range of values; `None` for floats.
fn valid_range(samples: &Samples, attributes: &[NcAttribute], path: &Path) -> Result<Option<[f64; 2]>> {
    let [least, most] = match samples {
        Samples::F32(_) | Samples::F64(_) => return Ok(None),
        Samples::U8(_) => [0.0, f64::from(u8::MAX)],
        Samples::I8(_) => [f64::from(i8::MIN), f64::from(i8::MAX)],
        Samples::U16(_) => [0.0, f64::from(u16::MAX)],
        Samples::I16(_) => [f64::from(i16::MIN), f64::from(i16::MAX)],
        Samples::U32(_) => [0.0, f64::from(u32::MAX)],
        Samples::I32(_) => [f64::from(i32::MIN), f64::from(i32::MAX)],
        Samples::U64(_) | Samples::I64(_) => {
            refuse!(path, "its image has integers of 64 bits, which MINC does not have")
        }
    };
    let number = |name: &str| attribute(attributes, name).and_then(|attribute| attribute.value.as_f64());
    let stated = match attribute(attributes, "valid_range").and_then(|range| range.value.as_f64_vec()).as_deref() {
        Some([low, high]) => [low.min(*high), low.max(*high)],
        _ => [number("valid_min").unwrap_or(least), number("valid_max").unwrap_or(most)],
    };
    let [low, high] = stated;
    let is_range = low >= least && high <= most && low < high;
    refuse_if!(!is_range, path, "its valid range is {low} to {high}, expected numbers from {least} to {most}");
    Ok(Some(stated))
}

/// Returns the sizes of `image-min` or `image-max`, and its numbers; `default` if it does not exist.
fn extents(file: &NcFile, image: &Image<'_>, name: &str, default: f64, path: &Path) -> Result<(Vec<u64>, Vec<f64>)> {
    let Some(found) = variable(image.group, name) else { return Ok((Vec::new(), vec![default])) };
    let sizes: Vec<u64> = found.dimensions.iter().map(|axis| axis.size).collect();
    let read = file.read_variable_as_f64(&format!("{}/{name}", image.path));
    let read = read.map_err(|error| path.error(format!("{name} is damaged: {error}")))?;
    let numbers: Vec<f64> = read.iter().copied().collect();
    let count = sizes.iter().try_fold(1_u64, |count, size| count.checked_mul(*size));
    let is_whole = count == Some(numbers.len() as u64) && numbers.iter().all(|number| number.is_finite());
    refuse_if!(!is_whole, path, "{name} has {} numbers, expected {sizes:?} that are finite", numbers.len());
    Ok((sizes, numbers))
}

/// Converts samples to values; equal shares of the samples have these slopes and intercepts in turn. Integers beyond
/// the range are clipped.
fn mapped(samples: &Samples, maps: &[(f64, f64)], [least, most]: [f64; 2], path: &Path) -> Result<Samples> {
    let share = (samples.len() / maps.len().max(1)).max(1);
    with_samples!(samples, s => {
        let mut values = reserved(s.len() as u64, || samples_in(path))?;
        for (samples, (slope, intercept)) in s.chunks(share).zip(maps) {
            values.extend(samples.iter().map(|sample| {
                (slope * sample.to_f64().clamp(least, most) + intercept) as f32
            }));
        }
        Ok(Samples::F32(values))
    })
}
