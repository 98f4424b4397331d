//! Built-in volumes with known shapes.
//!
//! Wherever a file is expected, `demo:NAME` or `demo:NAME:SIZE` names one of them.

use std::f64::consts::PI;
use std::fmt;
use std::path::Path;

use glam::{DAffine3, DMat3, DVec3};
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::volume::{Grid, Samples, Volume};

mod nautilus;

/// A built-in volume.
#[derive(Debug, Clone, Copy)]
pub struct Demo {
    /// The name of the built-in volume, as in `demo:NAME`.
    pub name: &'static str,
    /// The description of the built-in volume in one line.
    pub description: &'static str,
    /// The number of voxels along the longest axis, if none is requested.
    pub default_size: u32,
    /// The proportions of the sides, the longest 1.
    proportions: [f64; 3],
    make: fn([u32; 3]) -> Samples,
}

impl Demo {
    /// Returns the numbers of voxels along x, y and z, if the longest axis has `size`.
    fn dims(&self, size: u32) -> [u32; 3] {
        self.proportions.map(|side| ((side * f64::from(size)).round() as u32).max(2))
    }
}

/// The numbers of voxels along the longest axis: one has no extent, and 1024^3 samples of f32 are 4 GiB.
const SIZES: std::ops::RangeInclusive<u32> = 2..=1024;

static DEMOS: [Demo; 6] = [
    Demo {
        name: "nautilus",
        description: "half of a nautilus shell with chambers, nacre and flames, u8",
        default_size: 320,
        proportions: nautilus::PROPORTIONS,
        make: |dims| Samples::U8(nautilus::samples(dims)),
    },
    cube("marschner-lobb", "the resolution test of Marschner and Lobb (1994), f32 in 0..1", |[size, ..]| {
        Samples::F32(sampled(size, |p| marschner_lobb_at(p) as f32))
    }),
    cube("sphere", "a sphere of two tones, left and right halves, u8: the colour is known wherever a ray goes", sphere),
    cube("vessels", "a branching vessel tree, sparse, u8", |[size, ..]| vessels(size)),
    cube("shepp-logan", "the 3-D Shepp-Logan head with Toft's contrast, f32 in 0..1", |[size, ..]| {
        Samples::F32(sampled(size, |p| shepp_logan_at(p) as f32))
    }),
    cube("shell", "a soft shell around a soft core with a narrow peak in the transfer function, f32 in 0..1", shell),
];

/// Describes a built-in volume with as many voxels along each axis.
const fn cube(name: &'static str, description: &'static str, make: fn([u32; 3]) -> Samples) -> Demo {
    Demo { name, description, default_size: 128, proportions: [1.0; 3], make }
}

/// Returns the built-in volumes.
#[must_use]
pub fn demos() -> &'static [Demo] {
    &DEMOS
}

/// Makes the built-in volume `name` with `size` voxels along its longest axis, 1 world unit apart, centred on the
/// world's origin. All are cubes except `nautilus`.
///
/// ```
/// let volume = voxsplat_volume::demos::volume("sphere", 32)?;
/// assert_eq!(volume.grid().dims(), [32; 3]);
/// # Ok::<(), voxsplat_volume::Error>(())
/// ```
///
/// # Errors
/// [`Error::Volume`] if no built-in volume has that name, or if `size` is not 2 to 1024.
pub fn volume(name: &str, size: u32) -> Result<Volume> {
    spaced(name, Some(size), [1.0; 3])
}

/// Returns the text behind `demo:` in a source; `None` if the source is a file.
pub fn name_in(source: &Path) -> Option<&str> {
    source.to_str()?.strip_prefix("demo:")
}

/// Makes the built-in volume `NAME` or `NAME:SIZE`, its voxels 1 world unit apart unless a spacing is given.
pub fn parsed(name_and_size: &str, spacing: Option<[f64; 3]>) -> Result<Volume> {
    let spacing = spacing.unwrap_or([1.0; 3]);
    let Some((name, size)) = name_and_size.split_once(':') else {
        return spaced(name_and_size, None, spacing);
    };
    let size = size.parse().map_err(|_| wrong_size(name, format_args!("{size:?}")))?;
    spaced(name, Some(size), spacing)
}

fn wrong_size(name: &str, size: impl fmt::Display) -> Error {
    Error::Volume(format!("demo:{name}: size {size}, expected {} to {}", SIZES.start(), SIZES.end()))
}

fn spaced(name: &str, size: Option<u32>, spacing: [f64; 3]) -> Result<Volume> {
    let demo = DEMOS.iter().find(|d| d.name == name).ok_or_else(|| {
        let known: Vec<_> = DEMOS.iter().map(|d| d.name).collect();
        Error::Volume(format!("there is no demo:{name}; there are: {}", known.join(", ")))
    })?;
    let size = size.unwrap_or(demo.default_size);
    if !SIZES.contains(&size) {
        return Err(wrong_size(name, size));
    }
    let dims = demo.dims(size);
    let spacing = DVec3::from_array(spacing);
    let origin = -spacing * DVec3::from_array(dims.map(|n| f64::from(n - 1) / 2.0));
    let grid = Grid::new(dims, DAffine3::from_mat3_translation(DMat3::from_diagonal(spacing), origin))?;
    Volume::new(grid, (demo.make)(dims))
}

/// Samples a field over the cube [-1, 1]^3 at the centres of size^3 cells, x fastest.
pub fn sampled<T: Send>(size: u32, field: impl Fn(DVec3) -> T + Sync) -> Vec<T> {
    let at = |i: u32| (f64::from(i) + 0.5) / f64::from(size) * 2.0 - 1.0;
    (0..size)
        .into_par_iter()
        .flat_map_iter(|z| {
            let field = &field;
            (0..size).flat_map(move |y| (0..size).map(move |x| field(DVec3::new(at(x), at(y), at(z)))))
        })
        .collect()
}

/// Returns the signal of Marschner and Lobb, "An evaluation of reconstruction filters for volume rendering" (1994),
/// equation 2, with f_M = 6 and alpha = 0.25, at a point of the cube [-1, 1]^3.
pub fn marschner_lobb_at(p: DVec3) -> f64 {
    let (frequency, alpha) = (6.0, 0.25);
    let rho = libm::cos(2.0 * PI * frequency * libm::cos(PI * libm::hypot(p.x, p.y) / 2.0));
    (1.0 - libm::sin(PI * p.z / 2.0) + alpha * (1.0 + rho)) / (2.0 * (1.0 + alpha))
}

fn shell([size, ..]: [u32; 3]) -> Samples {
    Samples::F32(sampled(size, |p| {
        let value =
            libm::exp(-((p.length() - 0.65) / 0.1).powi(2)) + 0.9 * libm::exp(-p.length_squared() / (0.18 * 0.18));
        if value < 1e-6 { 0.0 } else { value.min(1.0) as f32 }
    }))
}

fn sphere([size, ..]: [u32; 3]) -> Samples {
    Samples::U8(sampled(size, |p| match p {
        p if p.length_squared() > 0.64 => 0,
        p if p.x < 0.0 => 100,
        _ => 200,
    }))
}

/// The ellipsoids of the 3-D Shepp-Logan phantom (Kak and Slaney, "Principles of Computerized Tomographic Imaging",
/// table 3.1 extended to 3-D by Schabel), with Toft's contrast ("The Radon Transform", 1996, table B.3): density, half
/// axes, centre, turn about z in degrees.
const ELLIPSOIDS: [(f64, [f64; 3], [f64; 3], f64); 10] = [
    (1.0, [0.69, 0.92, 0.81], [0.0, 0.0, 0.0], 0.0),
    (-0.8, [0.6624, 0.874, 0.78], [0.0, -0.0184, 0.0], 0.0),
    (-0.2, [0.11, 0.31, 0.22], [0.22, 0.0, 0.0], -18.0),
    (-0.2, [0.16, 0.41, 0.28], [-0.22, 0.0, 0.0], 18.0),
    (0.1, [0.21, 0.25, 0.41], [0.0, 0.35, -0.15], 0.0),
    (0.1, [0.046, 0.046, 0.05], [0.0, 0.1, 0.25], 0.0),
    (0.1, [0.046, 0.046, 0.05], [0.0, -0.1, 0.25], 0.0),
    (0.1, [0.046, 0.023, 0.05], [-0.08, -0.605, 0.0], 0.0),
    (0.1, [0.023, 0.023, 0.02], [0.0, -0.606, 0.0], 0.0),
    (0.1, [0.023, 0.046, 0.02], [0.06, -0.605, 0.0], 0.0),
];

/// Returns a point or a direction in the coordinates in which an ellipsoid is the unit ball around the origin.
fn unit_ball((_, axes, _, turn): &(f64, [f64; 3], [f64; 3], f64), d: DVec3) -> DVec3 {
    let (sin, cos) = libm::sincos(turn.to_radians());
    DVec3::new(cos * d.x + sin * d.y, cos * d.y - sin * d.x, d.z) / DVec3::from_array(*axes)
}

/// Returns the density of the 3-D Shepp-Logan head at a point of the cube [-1, 1]^3.
pub fn shepp_logan_at(p: DVec3) -> f64 {
    let inside = |ellipsoid: &(f64, [f64; 3], [f64; 3], f64)| {
        let (density, _, center, _) = *ellipsoid;
        if unit_ball(ellipsoid, p - DVec3::from_array(center)).length_squared() <= 1.0 { density } else { 0.0 }
    };
    // Densities such as 1 - 0.8 - 0.2 sum to 5e-17 instead of 0, the density of air.
    let sum: f64 = ELLIPSOIDS.iter().map(inside).sum();
    if sum < 1e-9 { 0.0 } else { sum }
}

/// Returns the integral of the 3-D Shepp-Logan head from `origin` over `length` along a unit vector.
pub fn shepp_logan_chord(origin: DVec3, direction: DVec3, length: f64) -> f64 {
    let chord = |ellipsoid: &(f64, [f64; 3], [f64; 3], f64)| {
        let (density, _, center, _) = *ellipsoid;
        let from = unit_ball(ellipsoid, origin - DVec3::from_array(center));
        let along = unit_ball(ellipsoid, direction);
        let (square, half) = (along.length_squared(), from.dot(along));
        let root = (half * half - square * (from.length_squared() - 1.0)).max(0.0).sqrt();
        let [enter, leave] = [-root, root].map(|root| ((root - half) / square).clamp(0.0, length));
        density * (leave - enter)
    };
    ELLIPSOIDS.iter().map(chord).sum()
}

/// A generator of random numbers: splitmix64 (Steele, Lea and Flood 2014, "Fast splittable pseudorandom number
/// generators").
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Returns a number with uniform distribution in -1..1.
    fn symmetric(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn direction(&mut self) -> DVec3 {
        DVec3::new(self.symmetric(), self.symmetric(), self.symmetric())
    }
}

/// Draws a tree of tapering tubes with soft walls, grown upwards from the bottom and kept inside the volume.
///
/// Seed, lengths, radii and bends are chosen for a tree that fills the volume and stays sparse.
fn vessels(size: u32) -> Samples {
    let n = f64::from(size);
    let mut samples = vec![0_u8; (size as usize).pow(3)];
    let mut random = Random(7);
    // Branches still to grow: position and radius as fractions of the size, direction, generation.
    let mut tips = vec![(DVec3::new(0.5, 0.5, 0.06), DVec3::Z, 0.034, 0_u32)];
    while let Some((mut p, mut direction, radius, generation)) = tips.pop() {
        let length = 0.24 * 0.83_f64.powi(generation as i32);
        let steps = (length * n).ceil().max(1.0) as u32;
        for step in 0..steps {
            direction = (direction + random.direction() * 0.12).normalize();
            let out = p - DVec3::splat(0.5);
            if out.length() > 0.36 {
                direction = (direction - out * 0.3).normalize();
            }
            p += direction * (length / f64::from(steps));
            let taper = 1.0 - 0.2 * f64::from(step) / f64::from(steps);
            stamp(&mut samples, size, p * n, radius * taper * n);
        }
        if generation < 7 {
            for _ in 0..2 {
                let spread = (direction + random.direction() * 0.75).normalize();
                tips.push((p, spread, radius * 0.78, generation + 1));
            }
        }
    }
    Samples::U8(samples)
}

/// Draws a ball with a soft wall, 255 at its centre and 128 at `radius` voxels; larger samples stay.
fn stamp(samples: &mut [u8], size: u32, center: DVec3, radius: f64) {
    // A thinner tube would pass between the lattice points.
    let radius = radius.max(0.7);
    let reach = radius * 2.0;
    let range = |c: f64| {
        let clamp = |v: f64| v.clamp(0.0, f64::from(size)) as usize;
        clamp((c - reach).ceil())..clamp((c + reach).floor() + 1.0)
    };
    for z in range(center.z) {
        for y in range(center.y) {
            for x in range(center.x) {
                let d2 = (DVec3::new(x as f64, y as f64, z as f64) - center).length_squared();
                let value = (255.0 * libm::exp(-d2 / (radius * radius) * std::f64::consts::LN_2)) as u8;
                let sample = &mut samples[(z * size as usize + y) * size as usize + x];
                *sample = value.max(*sample);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vessels_are_sparse_and_the_same_every_time() {
        let (a, b) = (vessels(96), vessels(96));
        assert_eq!(a, b);
        let Samples::U8(samples) = a else { panic!("not u8") };
        let visible = samples.iter().filter(|&&v| v > 70).count() as f64 / samples.len() as f64;
        assert!((0.005..0.04).contains(&visible), "{visible}");
    }

    #[test]
    fn a_size_is_the_number_of_voxels_along_the_longest_axis() {
        let dims = |name: &str| parsed(name, None).unwrap().grid().dims();
        assert_eq!(dims("nautilus"), [320, 98, 244]);
        assert_eq!(dims("nautilus:64"), [64, 20, 49]);
        assert_eq!(dims("nautilus:2"), [2; 3]);
        assert_eq!(dims("vessels:16"), [16; 3]);
    }

    #[test]
    fn bad_names_and_sizes_are_refused() {
        for (name, part) in
            [("cow", "there are: nautilus, marschner-lobb"), ("sphere:1", "2 to 1024"), ("sphere:x", "2 to 1024")]
        {
            let error = parsed(name, None).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
    }
}
