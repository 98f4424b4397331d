//! Lattices whose axes have names and coordinates: NetCDF, and Zarr written by OME and xarray
//! (<https://cfconventions.org>, chapters 4 and 5).

use glam::DVec3;

use super::placement::{Placement, named_unit, plain_name};
use super::selection::Role;

/// An axis of samples, as a file describes it.
pub(super) struct Axis {
    pub(super) name: String,
    pub(super) size: u64,
    pub(super) role: Role,
    pub(super) unit: Option<String>,
    /// The steps between coordinates; `None` if no coordinates are stated.
    pub(super) steps: Option<Steps>,
    /// The axis of the world along the axis of samples, 0 for x; `None` if its description does not state it.
    world: Option<usize>,
    /// Whether the coordinates grow downwards, as depths and pressures do.
    is_down: bool,
}

/// The distances of the coordinates along an axis.
pub(super) enum Steps {
    /// Even steps: the first coordinate, and the distance to the next; negative if they descend.
    Even { first: f64, step: f64 },
    /// Uneven steps: the smallest and the largest distance of neighbours.
    Uneven { least: f64, most: f64, descending: bool },
}

impl Axis {
    /// Makes an axis of which only the name is known.
    pub(super) fn named(name: &str, size: u64) -> Self {
        Self::described(name, size, &|_| None, || None)
    }

    /// Makes an axis with the attributes of its coordinates, which are read if it is an axis of space.
    pub(super) fn described(
        name: &str,
        size: u64,
        attribute: &dyn Fn(&str) -> Option<String>,
        coordinates: impl FnOnce() -> Option<Vec<f64>>,
    ) -> Self {
        let of = |name: &str| attribute(name).unwrap_or_default().to_ascii_lowercase();
        let [letter, positive, standard, unit] = ["axis", "positive", "standard_name", "units"].map(of);
        let lower = name.to_ascii_lowercase();
        let is_time = letter == "t" || standard == "time" || unit.contains(" since ");
        let role = if is_time { Role::Time } else { role_of_name(&lower) };
        let worlds =
            [letter.as_str(), &standard, &unit, lower.split(|c: char| !c.is_alphabetic()).next().unwrap_or("")];
        let steps = if role == Role::Space { coordinates().as_deref().and_then(Steps::of) } else { None };
        Self {
            name: name.to_owned(),
            size,
            role,
            unit: attribute("units").and_then(|unit| named_unit(&unit)),
            steps,
            world: if positive.is_empty() { worlds.into_iter().find_map(world_of) } else { Some(2) },
            is_down: positive == "down"
                || (positive.is_empty() && ["depth", "air_pressure"].contains(&standard.as_str())),
        }
    }

    /// Returns 1 if the world's coordinates grow along the axis, else -1.
    fn sign(&self) -> f64 {
        let descends = match self.steps {
            Some(Steps::Even { step, .. }) => step < 0.0,
            Some(Steps::Uneven { descending, .. }) => descending,
            None => false,
        };
        if descends == self.is_down { 1.0 } else { -1.0 }
    }
}

impl Steps {
    /// Returns the steps between some coordinates; even if all are the same within a thousandth.
    fn of(values: &[f64]) -> Option<Self> {
        let ([first, .., last], count) = (values, values.len()) else { return None };
        let step = (last - first) / (count - 1) as f64;
        let is_even = |pair: &[f64]| (pair[1] - pair[0] - step).abs() <= 1e-3 * step.abs();
        if step.is_finite() && step != 0.0 && values.windows(2).all(is_even) {
            return Some(Self::Even { first: *first, step });
        }
        let steps = values.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        let [least, most] =
            steps.fold([f64::INFINITY, 0.0], |[least, most]: [f64; 2], step| [least.min(step), most.max(step)]);
        (least.is_finite() && most.is_finite()).then_some(Self::Uneven { least, most, descending: last < first })
    }
}

/// Returns the role of an axis by its name in lower case.
fn role_of_name(name: &str) -> Role {
    match name {
        "t" | "time" => Role::Time,
        "c" | "channel" | "channels" | "component" | "band" => Role::Channel,
        _ => Role::Space,
    }
}

/// Returns the axis of the world that a word names: the letter or the name of an axis, a standard name, or a unit.
fn world_of(word: &str) -> Option<usize> {
    let words: [&[&str]; 3] = [
        &[
            "x",
            "xc",
            "lon",
            "long",
            "longitude",
            "rlon",
            "easting",
            "projection_x_coordinate",
            "grid_longitude",
            "degrees_east",
            "degree_east",
            "degrees_e",
            "degree_e",
        ],
        &[
            "y",
            "yc",
            "lat",
            "latitude",
            "rlat",
            "northing",
            "projection_y_coordinate",
            "grid_latitude",
            "degrees_north",
            "degree_north",
            "degrees_n",
            "degree_n",
        ],
        &["z", "zc", "depth", "height", "altitude", "elevation", "level", "lev", "plev", "air_pressure"],
    ];
    words.iter().position(|words| words.contains(&word))
}

/// Returns the axes of space, each with the axis of the world along it, x first. Axes whose world axis is not stated
/// get the remaining ones, the fastest first. If there are more than three, axes of one sample do not count. Files have
/// the slowest axis first.
pub(super) fn space(axes: &[Axis]) -> Vec<(usize, usize)> {
    let mut space: Vec<usize> = (0..axes.len()).rev().filter(|&axis| axes[axis].role == Role::Space).collect();
    while let Some(single) = space.iter().position(|&axis| axes[axis].size == 1).filter(|_| space.len() > 3) {
        space.remove(single);
    }
    let told = |world: usize| space.iter().filter(move |&&axis| axes[axis].world == Some(world)).count();
    let is_told = (0..3).all(|world| told(world) <= 1);
    let world = |axis: usize| axes[axis].world.filter(|_| is_told);
    let mut left = (0..).filter(|&n| space.iter().all(|&axis| world(axis) != Some(n)));
    let mut placed: Vec<(usize, usize)> =
        space.iter().filter_map(|&axis| Some((axis, world(axis).or_else(|| left.next())?))).collect();
    placed.sort_by_key(|(_, world)| *world);
    placed
}

/// Returns the position of the lattice with these axes of space, the unit of lengths, and a note if the coordinates
/// give no position: they are unequally spaced, in unlike units, or missing along some axes.
pub(super) fn placement(axes: &[Axis], space: &[(usize, usize)]) -> (Placement, Option<String>, Option<String>) {
    let mut placement = Placement::axis_parallel([1.0; 3]);
    let left = (0..3).filter(|n| space.iter().all(|(_, world)| world != n));
    let worlds = space.iter().map(|&(axis, world)| (axes[axis].sign(), world)).chain(left.map(|world| (1.0, world)));
    placement.directions.iter_mut().zip(worlds).for_each(|(direction, (sign, world))| {
        *direction = DVec3::AXES[world] * sign + DVec3::ZERO;
    });
    let of_space = || space.iter().map(|&(axis, _)| &axes[axis]);
    let name = |axis: &Axis| plain_name(&axis.name).unwrap_or_default();
    let noted = |what: String| Some(format!("{what}: samples are taken to be 1 apart unless a spacing is given"));
    let uneven = |axis: &Axis| match axis.steps {
        Some(Steps::Uneven { least, most, .. }) => {
            Some(format!("coordinates of {} are {least:.4} to {most:.4} apart", name(axis)))
        }
        _ => None,
    };
    let uneven: Vec<String> = of_space().filter_map(uneven).collect();
    if !uneven.is_empty() {
        return (placement, None, noted(uneven.join(", ")));
    }
    let unknown: Vec<String> = of_space().filter(|axis| axis.steps.is_none() && axis.size > 1).map(name).collect();
    if !unknown.is_empty() {
        let some = of_space().any(|axis| axis.steps.is_some());
        return (
            placement,
            None,
            noted(format!("no coordinates along {} are stated", unknown.join(", "))).filter(|_| some),
        );
    }
    // Degrees along two axes and metres along the third are no lengths in one space.
    let unit = of_space().next().and_then(|axis| axis.unit.clone());
    let Some(factors) = of_space().map(|axis| factor(&axis.unit, &unit)).collect::<Option<Vec<f64>>>() else {
        let unit = |axis: &Axis| format!("{} in {}", name(axis), axis.unit.as_deref().unwrap_or("no unit"));
        let units: Vec<String> = of_space().map(unit).collect();
        return (placement, None, noted(format!("coordinates are {}", units.join(", "))));
    };
    for (n, (&(axis, world), factor)) in space.iter().zip(factors).enumerate() {
        let Some(Steps::Even { first, step }) = axes[axis].steps else { continue };
        placement.spacing[n] = step.abs() * factor;
        // Adding 0 turns -0 into 0.
        placement.origin[world] = if axes[axis].is_down { -first } else { first } * factor + 0.0;
    }
    (placement, unit, None)
}

/// The units of length by their names, and their metres.
const LENGTHS: [(&[&str], f64); 7] = [
    (&["Å", "angstrom"], 1e-10),
    (&["nm", "nanometer", "nanometre"], 1e-9),
    (&["µm", "um", "micron", "micrometer", "micrometre"], 1e-6),
    (&["mm", "millimeter", "millimetre"], 1e-3),
    (&["cm", "centimeter", "centimetre"], 1e-2),
    (&["m", "meter", "metre"], 1.0),
    (&["km", "kilometer", "kilometre"], 1e3),
];

/// Returns the number of one unit in another; `None` if they differ and are not both lengths.
fn factor(unit: &Option<String>, other: &Option<String>) -> Option<f64> {
    let metres = |unit: &Option<String>| {
        let name = unit.as_deref()?;
        let is_name = |known: &&str| name == *known || (known.len() > 2 && name.strip_suffix('s') == Some(known));
        LENGTHS.iter().find(|(names, _)| names.iter().any(is_name)).map(|(_, metres)| *metres)
    };
    if unit == other { Some(1.0) } else { Some(metres(unit)? / metres(other)?) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Makes an axis of space with attributes and coordinates.
    fn axis(name: &str, attributes: &[(&str, &str)], coordinates: &[f64]) -> Axis {
        let attribute = |name: &str| Some(attributes.iter().find(|(key, _)| *key == name)?.1.to_owned());
        let values = (!coordinates.is_empty()).then(|| coordinates.to_vec());
        Axis::described(name, coordinates.len().max(3) as u64, &attribute, || values)
    }

    #[test]
    fn axes_that_do_not_tell_their_direction_get_what_is_left() {
        let named = |names: [&str; 3]| space(&names.map(|name| axis(name, &[], &[])));
        assert_eq!(named(["slice", "row", "column"]), [(2, 0), (1, 1), (0, 2)]);
        assert_eq!(named(["x", "y", "z"]), [(0, 0), (1, 1), (2, 2)]);
        assert_eq!(named(["line", "trace", "depth"]), [(1, 0), (0, 1), (2, 2)]);
        assert_eq!(named(["Lon", "scan", "lat_rho"]), [(0, 0), (2, 1), (1, 2)]);
        // Two of one name tell nothing.
        assert_eq!(named(["x", "row", "x"]), [(2, 0), (1, 1), (0, 2)]);
        let told = [axis("i", &[("axis", "X")], &[]), axis("k", &[("positive", "up")], &[]), axis("j", &[], &[])];
        assert_eq!(space(&told), [(0, 0), (2, 1), (1, 2)]);
        // Of five axes the single ones do not count, and time is none of space.
        let mut five = ["time", "ensemble", "z", "y", "x"].map(|name| axis(name, &[], &[]));
        five[1].size = 1;
        assert_eq!(space(&five), [(4, 0), (3, 1), (2, 2)]);
    }

    #[test]
    fn depths_and_descending_coordinates_keep_their_direction_without_equal_steps() {
        let down = [("positive", "down"), ("units", "m")];
        let y = [("units", "degrees_north")];
        let placed = |depths: &[f64], attributes: &[(&str, &str)]| {
            let axes = [axis("depth", attributes, depths), axis("y", &y, &[3.0, 2.0, 1.0]), axis("x", &y, &[0.0, 1.0])];
            let (placement, unit, note) = placement(&axes, &space(&axes));
            assert_eq!((placement.spacing, placement.origin, unit), ([1.0; 3], DVec3::ZERO, None));
            assert_eq!(placement.directions[..2], [DVec3::X, -DVec3::Y]);
            (placement.directions[2].z, note.unwrap())
        };
        let taken = "samples are taken to be 1 apart unless a spacing is given";
        let uneven = format!("coordinates of depth are 5.0000 to 20.0000 apart: {taken}");
        assert_eq!(placed(&[0.0, 5.0, 25.0], &down), (-1.0, uneven.clone()));
        assert_eq!(placed(&[25.0, 5.0, 0.0], &down), (1.0, uneven));
        let unlike = format!("coordinates are x in degrees_north, y in degrees_north, depth in m: {taken}");
        assert_eq!(placed(&[0.0, 5.0, 10.0], &down), (-1.0, unlike.clone()));
        assert_eq!(placed(&[0.0, 5.0, 10.0], &[("standard_name", "depth"), ("units", "m")]), (-1.0, unlike.clone()));
        assert_eq!(placed(&[0.0, 5.0, 10.0], &[("positive", "up"), ("units", "m")]), (1.0, unlike));
        let missing = format!("no coordinates along depth are stated: {taken}");
        assert_eq!(placed(&[], &down), (-1.0, missing));
    }

    #[test]
    fn lengths_in_several_units_are_in_the_unit_of_x() {
        let unit = |unit| [("units", unit)];
        let axes = [
            axis("z", &unit("nanometers"), &[100.0, 300.0, 500.0]),
            axis("y", &unit("um"), &[0.0, 0.5]),
            axis("x", &unit("mm"), &[1.0, 1.5]),
        ];
        let (placement, length, note) = placement(&axes, &space(&axes));
        let near = |found: [f64; 3], expected: [f64; 3]| {
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-15), "{found:?}");
        };
        near(placement.spacing, [0.5, 0.0005, 0.0002]);
        near(placement.origin.to_array(), [1.0, 0.0, 0.0001]);
        assert_eq!((length.as_deref(), note), (Some("mm"), None));
    }
}
