//! HDF5 and NetCDF: one data set of a file, with the coordinates, fill values and scales that NetCDF states
//! (<https://cfconventions.org>).
//!
//! The crate `netcdf-reader` reads NetCDF of all kinds, and HDF5 as NetCDF whose axes have no names. A data set is read
//! slab by slab. MINC, which is NetCDF or HDF5 with scales and places of its own, has its own module.

mod minc;
mod slabs;
mod vtk;

use std::path::Path;
use std::sync::Arc;

use hdf5_reader::group::Group;
use hdf5_reader::storage::{DynStorage, FileStorage};
use hdf5_reader::{Dataset, Datatype, Hdf5File};
use netcdf_reader::{
    NcAttribute, NcDimension, NcFile, NcGroup, NcMetadataMode, NcOpenOptions, NcSliceInfoElem, NcType, NcVariable,
};

use self::slabs::{SLAB, Slabs, attribute, text, words};
use super::LoadOptions;
use super::coordinates::{Axis, Steps, placement, space};
use super::decode::reordered;
use super::input::Input;
use super::placement::{named_unit, plain_name};
use super::selection::{Axes, Role, guessed, indices, sized};
use crate::error::{Error, Hint, Result, Subject, refuse, refuse_if};
use crate::memory::{reserved, samples_in};
use crate::volume::{MAX_DIM, Samples, ToF64, Units, Volume, with_samples};

/// The largest number of data sets of a file, and the deepest groups.
const MAX_SETS: usize = 4096;
const MAX_DEPTH: usize = 32;

/// The largest chunk and the largest slab, in bytes.
const MAX_CHUNK: usize = 1 << 30;

/// The default fill values of NetCDF for floating point.
const NOT_WRITTEN: [f64; 2] = [9.969_209_968_386_869e36, 9.969_21e36_f32 as f64];

/// A data set, and the groups that contain it, the innermost first.
struct Set<'a> {
    path: String,
    variable: &'a NcVariable,
    groups: Vec<(String, &'a NcGroup)>,
}

/// Reads the volume of a data set, which is named or the only one.
pub(super) fn read(input: &Input, inside: Option<&str>, options: &LoadOptions) -> Result<Volume> {
    let path = input.path();
    let Some((file, _)) = input.plain_file()? else {
        refuse!(input, "is a file of HDF5 or NetCDF in a stream or in gzip: write it to a file, decompressed");
    };
    let storage: DynStorage = Arc::new(FileStorage::from_file(file).map_err(|error| input.error(words(error)))?);
    let failed = |error: netcdf_reader::Error| input.error(words(error));
    let settings = NcOpenOptions {
        chunk_cache_bytes: SLAB as usize,
        metadata_mode: NcMetadataMode::Lossy,
        max_chunk_bytes: MAX_CHUNK,
        max_read_bytes: MAX_CHUNK,
        ..NcOpenOptions::default()
    };
    let file = NcFile::from_storage_with_options(Arc::clone(&storage), settings).map_err(failed)?;
    let mut halves = Vec::new();
    if file.as_classic().is_none() {
        let groups = Hdf5File::from_storage(storage).and_then(|file| file.root_group());
        let groups = groups.map_err(|error| input.error(words(error)))?;
        halves = check_groups(path, &groups)?;
    }
    let root = file.root_group().map_err(failed)?;
    if let Some(image) = minc::image(root, inside) {
        return minc::read(&file, &image, path, options);
    }
    let mut sets = Vec::new();
    collect(root, "", &[], &mut sets);
    let image = vtk::image(root, path)?;
    let active = image.as_ref().and_then(vtk::Image::active).filter(|name| sets.iter().any(|set| set.path == *name));
    let set = one_of(path, &sets, inside.or(active.as_deref())).map_err(|error| {
        // The crate leaves out data sets of types that NetCDF has not.
        let asked = |name: &&String| inside.is_none_or(|asked| asked.trim_start_matches('/') == name.as_str());
        let half = halves.iter().find(asked).and_then(|name| plain_name(name));
        let refused = |name| input.error(format!("/{name} has 16-bit floats, which are not read: convert it to f32"));
        half.map_or(error, refused)
    })?;
    let axes = axes(&file, set);
    let space = space(&axes);
    refuse_if!(space.len() > 3, input, "{} has {} axes of space, expected at most 3", set.path, space.len());
    let sizes: Vec<i64> = space.iter().map(|&(axis, _)| sized(axes[axis].size)).collect();
    let of_vtk = image.map(|image| image.placement(&set.path, path)).transpose()?.flatten();
    let (placement, length, note) =
        of_vtk.map_or_else(|| placement(&axes, &space), |placement| (placement, None, None));
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
    let slowest = space.iter().map(|(axis, _)| *axis).min();
    let kind = &set.variable.dtype;
    let slabs = Slabs { file: &file, name: &set.path, kind, selections, slowest, path };
    let unsigned = text(&set.variable.attributes, "_Unsigned").is_some_and(|text| text == "true");
    let samples = slabs.samples(unsigned, grid.len())?;
    let samples = match space.is_sorted_by(|a, b| a.0 > b.0) {
        true => samples,
        false => reordered(&samples, grid.dims(), strides(&axes, &space), path)?,
    };
    let samples = without_fill(samples, &set.variable.attributes, path)?;
    let number = |name: &str| attribute(&set.variable.attributes, name).and_then(|a| a.value.as_f64());
    let (slope, intercept) = (number("scale_factor").unwrap_or(1.0), number("add_offset").unwrap_or(0.0));
    let units = Units { length, value: text(&set.variable.attributes, "units").and_then(|unit| named_unit(&unit)) };
    let volume = placement.volume(grid, samples.into())?.with_units(units).with_contents(contents);
    volume.with_rescale(slope, intercept).map_err(|error| input.error(format!("{}: {error}", set.path)))
}

/// Refuses groups to which a link leads back, and too many groups: the crate follows each of them, without end. Returns
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

/// Returns the paths of the data sets of 16-bit floats in a group of this path.
fn halves_in(group: &Group, path: &str) -> Vec<String> {
    let is_half = |set: &&Dataset| matches!(set.dtype(), Datatype::FloatingPoint { size: 2, .. });
    let name = |set: &Dataset| format!("{path}{}", set.name().rsplit('/').next().unwrap_or_default());
    group.datasets().unwrap_or_default().iter().filter(is_half).map(name).take(MAX_SETS).collect()
}

/// Collects the data sets of a group and of the groups in it.
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

/// Returns the data set of the path `inside`, or the only one that is a volume, or else a plane.
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

/// Returns the axes of a data set, the slowest first.
fn axes(file: &NcFile, set: &Set<'_>) -> Vec<Axis> {
    let named = |axis: &NcDimension| {
        let coordinate = set.groups.iter().find_map(|(path, group)| {
            let found = group.variables.iter().find(|variable| variable.name == axis.name && variable.ndim() == 1);
            found.map(|variable| (format!("{path}/{}", variable.name), variable))
        });
        let attribute = |name: &str| coordinate.as_ref().and_then(|(_, variable)| text(&variable.attributes, name));
        Axis::described(&axis.name, axis.size, &attribute, || {
            let (path, _) = coordinate.as_ref().filter(|_| axis.size <= u64::from(MAX_DIM))?;
            Some(file.read_variable_as_f64(path).ok()?.iter().copied().collect())
        })
    };
    let mut axes: Vec<Axis> = set.variable.dimensions.iter().map(named).collect();
    // The names of the axes state no role.
    let unknown = axes.iter().all(|axis| axis.role == Role::Space && axis.steps.is_none());
    if unknown && axes.len() > 3 {
        let sizes: Vec<i64> = axes.iter().rev().map(|axis| sized(axis.size)).collect();
        let roles = guessed(&sizes);
        axes.iter_mut().rev().zip(roles).for_each(|(axis, (role, _))| axis.role = role);
    }
    // Luxendo, ilastik and the HDF5 plugin of ImageJ write the size of an element, the slowest axis first.
    let of_space = || axes.iter().filter(|axis| axis.role == Role::Space).count();
    let size = attribute(&set.variable.attributes, "element_size_um").and_then(|size| size.value.as_f64_vec());
    if let Some(size) = size.filter(|size| size.len() == of_space()) {
        for (axis, step) in axes.iter_mut().filter(|axis| axis.role == Role::Space).zip(size) {
            (axis.steps, axis.unit) = (Some(Steps::Even { first: 0.0, step }), Some("µm".to_owned()));
        }
    }
    axes
}

/// Returns the number of samples from one index of an array to the next, along each axis of its lattice; the array's
/// last axis is the fastest.
fn strides(axes: &[Axis], space: &[(usize, usize)]) -> [usize; 3] {
    let behind = |axis: usize| space.iter().filter(move |(other, _)| *other > axis);
    let mut strides = [0; 3];
    for (stride, &(axis, _)) in strides.iter_mut().zip(space) {
        *stride = behind(axis).map(|&(other, _)| axes[other].size as usize).product();
    }
    strides
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

/// Collects `count` values into a vector, or returns an error if there is no memory.
fn filled<T>(count: usize, values: impl Iterator<Item = T>, path: &Path) -> Result<Vec<T>> {
    let mut all = reserved(count as u64, || samples_in(path))?;
    all.extend(values);
    Ok(all)
}
