//! HDF5 and NetCDF: one data set of a file, with the coordinates, fill values and scales that NetCDF states
//! (<https://cfconventions.org>).
//!
//! The crate `netcdf-reader` reads NetCDF of all kinds, and HDF5 as NetCDF whose axes have no names. A data set is read
//! slab by slab. MINC, which is NetCDF or HDF5 with scales and places of its own, has its own module.

mod minc;
mod slabs;

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use hdf5_reader::group::Group;
use hdf5_reader::storage::{DynStorage, FileStorage};
use hdf5_reader::{Dataset, Datatype, Hdf5File};
use netcdf_reader::{
    NcAttribute, NcDimension, NcFile, NcGroup, NcMetadataMode, NcOpenOptions, NcSliceInfoElem, NcType, NcVariable,
};

use self::slabs::{SLAB, Slabs, attribute, text};
use super::LoadOptions;
use super::input::Input;
use super::placement::{Placement, named_unit, plain_name};
use super::selection::{Axes, Role, guessed, indices, sized};
use crate::error::{Error, Hint, Result, Subject, refuse, refuse_if};
use crate::memory::{reserved, samples_in};
use crate::volume::{MAX_DIM, Samples, ToF64, Units, Volume, with_samples};

/// The most data sets of a file, and the deepest groups.
const MAX_SETS: usize = 4096;
const MAX_DEPTH: usize = 32;

/// The largest chunk and the largest slab, in bytes.
const MAX_CHUNK: usize = 1 << 30;

/// The default fill values of NetCDF for floating point.
const NOT_WRITTEN: [f64; 2] = [9.969_209_968_386_869e36, 9.969_21e36_f32 as f64];

/// A data set, and the groups it is in, the innermost first.
struct Set<'a> {
    path: String,
    variable: &'a NcVariable,
    groups: Vec<(String, &'a NcGroup)>,
}

/// An axis of a data set.
struct Axis {
    size: u64,
    role: Role,
    name: String,
    /// The first coordinate and the distance between two, if coordinates are stated and equally spaced.
    place: Option<[f64; 2]>,
    /// The least and the largest distance of neighbouring coordinates, if they are stated and unequally spaced.
    uneven: Option<[f64; 2]>,
    unit: Option<String>,
}

/// Reads the volume of a data set, or of the only one.
pub(super) fn read(input: &Input, inside: Option<&str>, options: &LoadOptions) -> Result<Volume> {
    let path = input.path();
    let Some((file, _)) = input.plain_file()? else {
        refuse!(input, "is a file of HDF5 or NetCDF in a stream or in gzip: write it to a file, decompressed");
    };
    let failed =
        |error: &dyn std::fmt::Display| input.error(format!("is damaged, or of a kind that is not read: {error}"));
    let storage: DynStorage = Arc::new(FileStorage::from_file(file).map_err(|error| failed(&error))?);
    let settings = NcOpenOptions {
        chunk_cache_bytes: SLAB as usize,
        metadata_mode: NcMetadataMode::Lossy,
        max_chunk_bytes: MAX_CHUNK,
        max_read_bytes: MAX_CHUNK,
        ..NcOpenOptions::default()
    };
    let file = NcFile::from_storage_with_options(Arc::clone(&storage), settings).map_err(|error| failed(&error))?;
    let mut halves = Vec::new();
    if file.as_classic().is_none() {
        let groups =
            Hdf5File::from_storage(storage).and_then(|file| file.root_group()).map_err(|error| failed(&error))?;
        halves = check_groups(path, &groups)?;
    }
    let root = file.root_group().map_err(|error| failed(&error))?;
    if let Some(image) = minc::image(root, inside) {
        return minc::read(&file, &image, path, options);
    }
    let mut sets = Vec::new();
    collect(root, "", &[], &mut sets);
    let set = one_of(path, &sets, inside).map_err(|error| {
        // The crate leaves out data sets of types that NetCDF has not.
        let asked = |name: &&String| inside.is_none_or(|asked| asked.trim_start_matches('/') == name.as_str());
        let half = halves.iter().find(asked).and_then(|name| plain_name(name));
        let refused = |name| input.error(format!("/{name} has 16-bit floats, which are not read: convert it to f32"));
        half.map_or(error, refused)
    })?;
    let axes = axes(&file, set);
    // The slowest comes first in the file; axes of one sample do not count if there are more than three of space.
    let mut space: Vec<usize> = (0..axes.len()).rev().filter(|&axis| axes[axis].role == Role::Space).collect();
    while let Some(single) = space.iter().position(|&axis| axes[axis].size == 1).filter(|_| space.len() > 3) {
        space.remove(single);
    }
    refuse_if!(space.len() > 3, input, "{} has {} axes of space, expected at most 3", set.path, space.len());
    let sizes: Vec<i64> = space.iter().map(|&axis| sized(axes[axis].size)).collect();
    let (placement, length, note) = placement(&axes, &space);
    let grid = placement.grid(path, &sizes, options.spacing)?;
    let all: Axes = axes.iter().rev().map(|axis| (axis.role, sized(axis.size))).collect();
    let (indices, mut contents) = indices(path, &all, options)?;
    if options.spacing.is_none() {
        contents.notes.extend(note);
    }
    let selected = |(axis, index): (&Axis, Option<u64>)| {
        let (start, end) = index.map_or((0, axis.size), |index| (index, index + 1));
        NcSliceInfoElem::Slice { start, end, step: 1 }
    };
    let selections = axes.iter().zip(indices.into_iter().rev()).map(selected).collect();
    let slabs = Slabs { file: &file, name: &set.path, selections, slowest: space.last().copied(), path };
    let unsigned = text(&set.variable.attributes, "_Unsigned").is_some_and(|text| text == "true");
    let samples = slabs.samples(&set.variable.dtype, unsigned, grid.len())?;
    let samples = without_fill(samples, &set.variable.attributes, path)?;
    let number = |name: &str| attribute(&set.variable.attributes, name).and_then(|a| a.value.as_f64());
    let (slope, intercept) = (number("scale_factor").unwrap_or(1.0), number("add_offset").unwrap_or(0.0));
    let units = Units { length, value: text(&set.variable.attributes, "units").and_then(|unit| named_unit(&unit)) };
    let volume = placement.volume(grid, samples.into())?.with_units(units).with_contents(contents);
    volume.with_rescale(slope, intercept).map_err(|error| input.error(format!("{}: {error}", set.path)))
}

/// Refuses groups that a link leads back to, and too many: the crate follows each of them, without end. The result is
/// the paths of data sets of 16-bit floats.
fn check_groups(path: &Path, root: &Group) -> Result<Vec<String>> {
    let groups_in = |group: &Group| group.groups().unwrap_or_default();
    let mut left = vec![(groups_in(root), vec![root.address()], String::new())];
    let (mut seen, mut halves) = (0, halves_in(root, ""));
    while let Some((groups, above, outer)) = left.pop() {
        for group in groups {
            seen += 1;
            let address = group.address();
            if above.contains(&address) || above.len() == MAX_DEPTH || seen > MAX_SETS {
                refuse!(path, "has over {MAX_SETS} groups, or some within themselves by a link");
            }
            let mut above = above.clone();
            above.push(address);
            let inside = format!("{outer}{}/", group.name().rsplit('/').next().unwrap_or_default());
            if halves.is_empty() {
                halves = halves_in(&group, &inside);
            }
            left.push((groups_in(&group), above, inside));
        }
    }
    Ok(halves)
}

/// The paths of the data sets of 16-bit floats in a group of this path.
fn halves_in(group: &Group, path: &str) -> Vec<String> {
    let is_half = |set: &&Dataset| matches!(set.dtype(), Datatype::FloatingPoint { size: 2, .. });
    let name = |set: &Dataset| format!("{path}{}", set.name().rsplit('/').next().unwrap_or_default());
    group.datasets().unwrap_or_default().iter().filter(is_half).map(name).take(MAX_SETS).collect()
}

/// Notes the data sets of a group and of those in it.
fn collect<'a>(group: &'a NcGroup, path: &str, outer: &[(String, &'a NcGroup)], sets: &mut Vec<Set<'a>>) {
    let mut groups = vec![(path.to_owned(), group)];
    groups.extend_from_slice(outer);
    for variable in &group.variables {
        if sets.len() < MAX_SETS {
            sets.push(Set { path: format!("{path}/{}", variable.name), variable, groups: groups.clone() });
        }
    }
    if groups.len() < MAX_DEPTH {
        for inner in &group.groups {
            let name = inner.name.rsplit('/').next().unwrap_or_default();
            collect(inner, &format!("{path}/{name}"), &groups, sets);
        }
    }
}

/// The data set of that path, or the only one that is a volume, or else a plane.
fn one_of<'a, 'b>(path: &Path, sets: &'b [Set<'a>], inside: Option<&str>) -> Result<&'b Set<'a>> {
    let axes = |set: &Set<'_>| set.variable.dimensions.iter().filter(|axis| axis.size > 1).count();
    let numeric = |set: &&Set<'_>| is_numeric(&set.variable.dtype) && !set.variable.is_coordinate_variable();
    let of = |least: usize| sets.iter().filter(numeric).filter(|set| axes(set) >= least).collect::<Vec<_>>();
    let listed = |sets: &[&Set<'_>]| {
        let line = |set: &&Set<'_>| {
            let sizes: Vec<String> = set.variable.dimensions.iter().map(|axis| axis.size.to_string()).collect();
            format!("{} of {}", plain_name(&set.path).unwrap_or_default(), sizes.join(" x "))
        };
        sets.iter().take(12).map(line).collect::<Vec<_>>().join(", ")
    };
    if let Some(name) = inside {
        let asked = name.trim_start_matches('/');
        return sets.iter().find(|set| set.path.trim_start_matches('/') == asked).ok_or_else(|| {
            let reason = format!("has no data set {name:?}: there are {}", listed(&of(0)));
            Error::format(path, reason)
        });
    }
    let found = [3, 2].into_iter().map(of).find(|sets| !sets.is_empty()).unwrap_or_default();
    match found[..] {
        [set] => Ok(set),
        [] => Err(Error::format(path, "has no data set of numbers with two axes or three")),
        _ => {
            let reason = format!("holds {} data sets: {}", found.len(), listed(&found));
            Err(Error::format(path, reason).hinted(Hint::ChooseDataset))
        }
    }
}

fn is_numeric(kind: &NcType) -> bool {
    match kind {
        NcType::Char => false,
        NcType::Enum { base, .. } => is_numeric(base),
        _ => kind.is_primitive(),
    }
}

/// The axes of a data set, the slowest first.
fn axes(file: &NcFile, set: &Set<'_>) -> Vec<Axis> {
    let axes = &set.variable.dimensions;
    let named = |axis: &NcDimension| {
        let coordinate = set.groups.iter().find_map(|(path, group)| {
            let found = group.variables.iter().find(|variable| variable.name == axis.name && variable.ndim() == 1);
            found.map(|variable| (format!("{path}/{}", variable.name), variable))
        });
        let of = |name: &str| coordinate.as_ref().and_then(|(_, variable)| text(&variable.attributes, name));
        let unit = of("units").unwrap_or_default();
        let name = axis.name.to_ascii_lowercase();
        let is_time = of("axis").is_some_and(|axis| axis == "T")
            || of("standard_name").is_some_and(|name| name == "time")
            || unit.contains(" since ")
            || ["t", "time"].contains(&name.as_str());
        let role = match () {
            () if is_time => Role::Time,
            () if ["c", "channel", "channels", "component", "band"].contains(&name.as_str()) => Role::Channel,
            () => Role::Space,
        };
        let values = coordinate.filter(|_| axis.size <= u64::from(MAX_DIM) && role == Role::Space);
        let values = values.and_then(|(path, _)| file.read_variable_as_f64(&path).ok());
        let values = values.as_ref().and_then(|values| values.as_slice());
        let place = values.and_then(equal_steps);
        let uneven = values.filter(|_| place.is_none()).and_then(spread);
        Axis { size: axis.size, role, name: axis.name.clone(), place, uneven, unit: named_unit(&unit) }
    };
    let mut axes: Vec<Axis> = axes.iter().map(named).collect();
    // The names of the axes state no role.
    let unknown = axes.iter().all(|axis| axis.role == Role::Space && axis.place.is_none());
    if unknown && axes.len() > 3 {
        let sizes: Vec<i64> = axes.iter().rev().map(|axis| sized(axis.size)).collect();
        let roles = guessed(&sizes);
        axes.iter_mut().rev().zip(roles).for_each(|(axis, (role, _))| axis.role = role);
    }
    axes
}

/// The first of some coordinates and the step between them, if all steps are the same within a thousandth.
fn equal_steps(values: &[f64]) -> Option<[f64; 2]> {
    let ([first, .., last], count) = (values, values.len()) else { return None };
    let step = (last - first) / (count - 1) as f64;
    let equal = |pair: &[f64]| (pair[1] - pair[0] - step).abs() <= 1e-3 * step.abs();
    (step.is_finite() && step != 0.0 && values.windows(2).all(equal)).then_some([*first, step])
}

/// The least and the largest distance of neighbouring coordinates; `None` unless there are two of them.
fn spread(values: &[f64]) -> Option<[f64; 2]> {
    let steps = values.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    let ends = steps.fold([f64::INFINITY, 0.0], |[least, most]: [f64; 2], step| [least.min(step), most.max(step)]);
    ends.iter().all(|end| end.is_finite()).then_some(ends)
}

/// The position of the lattice with these axes of space, the fastest first, the unit of lengths, and a note if the
/// coordinates give no position: they are unequally spaced, or in unlike units.
fn placement(axes: &[Axis], space: &[usize]) -> (Placement, Option<String>, Option<String>) {
    let mut placement = Placement::axis_parallel([1.0; 3]);
    let space: Vec<&Axis> = space.iter().map(|&axis| &axes[axis]).collect();
    let name = |axis: &Axis| plain_name(&axis.name).unwrap_or_default();
    let noted = |what: String| Some(format!("{what}: samples are taken to be 1 apart unless a spacing is given"));
    let uneven = |axis: &&Axis| {
        let [least, most] = axis.uneven?;
        Some(format!("coordinates of {} are {least:.4} to {most:.4} apart", name(axis)))
    };
    let uneven: Vec<String> = space.iter().filter_map(uneven).collect();
    if !uneven.is_empty() {
        return (placement, None, noted(uneven.join(", ")));
    }
    if !space.iter().all(|axis| axis.place.is_some() || axis.size == 1) {
        return (placement, None, None);
    }
    // Degrees along two axes and metres along the third are no lengths in one space.
    if space.windows(2).any(|pair| pair[0].unit != pair[1].unit) {
        let unit = |axis: &&Axis| format!("{} in {}", name(axis), axis.unit.as_deref().unwrap_or("no unit"));
        let units: Vec<String> = space.iter().map(unit).collect();
        return (placement, None, noted(format!("coordinates are {}", units.join(", "))));
    }
    for (n, axis) in space.iter().enumerate() {
        let [first, step] = axis.place.unwrap_or([0.0, 1.0]);
        placement.directions[n] = DVec3::AXES[n] * step.signum();
        placement.spacing[n] = step.abs();
        placement.origin[n] = first;
    }
    (placement, space.first().and_then(|axis| axis.unit.clone()), None)
}

/// Replaces fill values by NaN. Integers become floats if there are fill values.
fn without_fill(mut samples: Samples, attributes: &[NcAttribute], path: &Path) -> Result<Samples> {
    let stated = ["_FillValue", "missing_value"].into_iter().filter_map(|name| attribute(attributes, name));
    let mut fill: Vec<f64> = stated.filter_map(|attribute| attribute.value.as_f64_vec()).flatten().take(16).collect();
    match &mut samples {
        Samples::F32(s) => {
            fill.extend(NOT_WRITTEN);
            s.iter_mut().filter(|s| fill.contains(&f64::from(**s))).for_each(|s| *s = f32::NAN);
        }
        Samples::F64(s) => {
            fill.extend(NOT_WRITTEN);
            s.iter_mut().filter(|s| fill.contains(*s)).for_each(|s| *s = f64::NAN);
        }
        integers => {
            let is_small = integers.sample_type().size() <= 2;
            let value = |sample: f64| if fill.contains(&sample) { f64::NAN } else { sample };
            with_samples!(&*integers, s => {
                if s.iter().any(|sample| fill.contains(&sample.to_f64())) {
                    let values = s.iter().map(|sample| value(sample.to_f64()));
                    samples = match is_small {
                        true => Samples::F32(filled(s.len(), values.map(|value| value as f32), path)?),
                        false => Samples::F64(filled(s.len(), values, path)?),
                    };
                }
            });
        }
    }
    Ok(samples)
}

/// A vector of `count` values.
fn filled<T>(count: usize, values: impl Iterator<Item = T>, path: &Path) -> Result<Vec<T>> {
    let mut all = reserved(count as u64, || samples_in(path))?;
    all.extend(values);
    Ok(all)
}
