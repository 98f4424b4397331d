//! Half of a nautilus shell, cut open along its plane of symmetry.
//!
//! The outer edge of the shell is a logarithmic spiral (Thompson, "On Growth and Form", 1917, chapter 11) that grows by
//! [`EXPANSION`] per turn. Lengths are in units of its radius at the aperture. The spiral lies in the plane of x and z,
//! and y points away from the cut at y = 0. Values are materials, so that edges of all of them are smooth ramps from 0:
//! [`SHELL`] to [`NACRE`] for wall and septa, [`SIPHUNCLE`], and [`PIGMENT`] in the outer half of the wall.

use std::f64::consts::TAU;

use rayon::prelude::*;

/// The box that the samples fill, per unit of its longest side.
pub(super) const PROPORTIONS: [f64; 3] = [1.0, EXTENT[1] / EXTENT[0], EXTENT[2] / EXTENT[0]];

/// The sides of the box, and the place of its low corner as seen from the pole of the spiral.
const EXTENT: [f64; 3] = [1.56, 0.48, 1.19];
const CORNER: [f64; 3] = [-0.56, -0.045, -0.745];

/// The values of the materials, of 255.
const SHELL: f64 = 118.0;
const NACRE: f64 = 141.0;
const SIPHUNCLE: f64 = 180.0;
const PIGMENT: f64 = 236.0;

/// The growth of the radius per turn: 3.2 in adult Nautilus pompilius.
const EXPANSION: f64 = 3.2;
/// The angle of the spiral at the aperture, radians from +x towards +z.
const APERTURE: f64 = 0.35;
const TURNS: f64 = 3.0;
/// The angle of the last chamber, in which the animal lives.
const LIVING_CHAMBER: f64 = 2.25;
/// The angle between septa: 17 chambers per turn.
const CHAMBER: f64 = TAU / 17.0;
/// The sag of septa towards the apex, radians.
const SAG: f64 = 0.5;

/// The cross-section of the tube, of the radius of its outer edge: centre and half axis along the radius, half axis
/// along y. It overlaps the turn before.
const CENTER: f64 = 0.60;
const HALF_HEIGHT: f64 = 0.40;
const HALF_WIDTH: f64 = 0.41;

/// A turn of the spiral that passes through the plane at a place (x, z).
#[derive(Clone, Copy)]
struct Turn {
    /// The angle of the turn at the place.
    theta: f64,
    /// The radius of the turn's outer edge at the place.
    outer: f64,
    /// The place along the turn's cross-section: -1 at the inner edge of the tube, 1 at the outer edge.
    along: f64,
}

/// Samples the shell at the centres of the cells of a lattice over its box, x fastest.
pub(super) fn samples(dims: [u32; 3]) -> Vec<u8> {
    let [nx, ny, nz] = dims;
    let cell = [0, 1, 2].map(|axis| EXTENT[axis] / f64::from(dims[axis]));
    let at = |axis: usize, i: u32| CORNER[axis] + (f64::from(i) + 0.5) * cell[axis];
    let spacing = cell[0];
    let row = nx as usize;
    let mut samples = vec![0_u8; row * ny as usize * nz as usize];
    samples.par_chunks_exact_mut(row * ny as usize).zip(0..nz).for_each(|(slice, z)| {
        let columns: Vec<Column> = (0..nx).map(|x| Column::new(at(0, x), at(2, z))).collect();
        for (row, y) in slice.chunks_exact_mut(row).zip(0..ny) {
            let y = at(1, y);
            for (sample, column) in row.iter_mut().zip(&columns) {
                *sample = column.value(y, spacing).round() as u8;
            }
        }
    });
    samples
}

/// The turns through a place (x, z), from the apex outwards.
struct Column {
    /// The distance from the pole of the spiral.
    radius: f64,
    turns: Vec<Turn>,
}

impl Column {
    fn new(x: f64, z: f64) -> Self {
        let (radius, angle) = (libm::hypot(x, z), libm::atan2(z, x));
        let growth = libm::log(EXPANSION) / TAU;
        let first = angle + TAU * ((APERTURE - TAU * TURNS - angle) / TAU).ceil();
        let turn = |n: i32| {
            let theta = first + TAU * f64::from(n);
            let outer = libm::exp(growth * (theta - APERTURE));
            Turn { theta, outer, along: (radius / outer - CENTER) / HALF_HEIGHT }
        };
        let turns = (0..=TURNS as i32 + 1).map(turn).filter(|turn| turn.theta < APERTURE + 0.3 && turn.along < 1.3);
        Self { radius, turns: turns.collect() }
    }

    /// Returns the value at a distance from the cut; samples are `spacing` apart.
    fn value(&self, y: f64, spacing: f64) -> f64 {
        // Ramps of two to four voxels, so that gradients are smooth.
        let (edge, soft) = (1.3 * spacing, 1.9 * spacing);
        let kept = step(-edge, edge, y);
        // The part that is not inside a turn before: a later turn grows around it.
        let mut free = 1.0;
        let mut value = 0.0_f64;
        for turn in &self.turns {
            let &Turn { theta, outer, along } = turn;
            let across = y / (HALF_WIDTH * outer);
            // Not `hypot`, which takes four times as long and only matters where squares overflow.
            let place = (along * along + across * across).sqrt();
            // About the distance from the outside of the tube, negative inside.
            let smooth = (place - 1.0) * HALF_HEIGHT * outer;
            let wall = (0.038 * outer).max(3.2 * spacing);
            if smooth < soft + 0.01 {
                let lip = step(spacing, -spacing, turn.angle_to_lip(across, along) * outer);
                if smooth > -wall - soft {
                    let side = libm::atan2(across, along);
                    let ribs =
                        libm::sin(60.0 * theta + 1.2 * libm::cos(2.0 * side)) * step(1.6, -0.3, APERTURE - theta);
                    let outside = smooth - 0.0022 * outer * ribs;
                    let part = step(soft, -soft, outside) * step(-wall - soft, -wall + soft, smooth);
                    value = value.max(part * lip * free * kept * turn.wall_value(-outside / wall, side, place));
                }
                let hollow = step(edge, -edge, smooth + wall) * lip * free;
                if hollow > 0.0 {
                    value = value.max(hollow * turn.chamber_value(self.radius, place, kept, spacing));
                }
            }
            free *= 1.0 - step(edge, -edge, smooth);
            if free <= 0.0 {
                break;
            }
        }
        value
    }
}

impl Turn {
    /// Returns the angle from the lip to a place of the cross-section, negative within the shell: the lip is a wave.
    fn angle_to_lip(&self, across: f64, along: f64) -> f64 {
        let (a, b) = (across * across, along * along);
        // (b - a) / (a + b) is the cosine of twice the angle around the tube.
        let wave = if a + b > 0.0 { 0.05 * (b - a) / (a + b) } else { 0.0 };
        self.theta + 0.16 * (1.0 - a) + wave - APERTURE
    }

    /// Returns the value of the wall at a depth, 0 outside to 1 inside, and an angle around the tube.
    fn wall_value(&self, depth: f64, side: f64, place: f64) -> f64 {
        let theta = self.theta;
        let gloss = 0.5 + 0.5 * libm::sin(6.0 * theta + 2.2 * libm::sin(side) + 8.0 * place);
        let base = SHELL + (NACRE - SHELL) * gloss * step(0.0, 0.6, depth);
        let wave = 1.6 * libm::sin(2.0 * side + 0.6) + 0.9 * libm::sin(5.0 * side + 2.0 * theta);
        let flames = libm::sin(10.0 * theta + wave + 0.5 * libm::sin(11.0 * side - 5.0 * theta));
        let young = step(0.3, -0.5, theta - APERTURE + 1.9 + 0.3 * libm::cos(side));
        let pigment = step(-0.1, 0.25, flames) * step(0.62, 0.32, depth) * young;
        base + (PIGMENT - base) * pigment
    }

    /// Returns the value within the wall: septa, and the siphuncle, a tube through their middle that the cut leaves
    /// whole.
    fn chamber_value(&self, radius: f64, place: f64, kept: f64, spacing: f64) -> f64 {
        let (edge, place) = (1.3 * spacing, place.min(1.0));
        // Septa stand at whole numbers.
        let chamber = (self.theta + SAG * (1.0 - place * place) - APERTURE + LIVING_CHAMBER) / CHAMBER;
        let (nearest, from_septum) = (chamber.round(), chamber - chamber.round());
        let slope = SAG * 2.0 * place / HALF_HEIGHT * radius / self.outer;
        let distance = from_septum.abs() * CHAMBER * radius / (1.0 + slope * slope).sqrt();
        let septum = (0.016 * self.outer).max(2.2 * spacing) / 2.0;
        let mut value = 0.0_f64;
        if chamber < 0.5 && distance < septum + edge {
            let gloss = 0.5 + 0.5 * libm::sin(7.0 * place + 1.3 * nearest);
            let material = SHELL + (NACRE - SHELL) * gloss;
            value = material * step(septum + edge, septum - edge, distance) * kept;
        }
        if chamber < 0.85 {
            let tube = (0.030 * self.outer).max(1.9 * spacing);
            let from_axis = place * HALF_HEIGHT * self.outer;
            if from_axis < 1.5 * tube + edge {
                let beads = tube * (1.1 - 0.4 * libm::cos(TAU * from_septum));
                value = value.max(SIPHUNCLE * step(beads + edge, beads - edge, from_axis));
            }
        }
        value
    }
}

/// Returns a cubic that rises from 0 at `low` to 1 at `high`, or falls if `low` is above `high`; constant beyond.
fn step(low: f64, high: f64, at: f64) -> f64 {
    let t = ((at - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_nautilus_is_the_same_on_any_number_of_threads() {
        let dims = [64, 20, 49];
        let all = samples(dims);
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert!(all == one.install(|| samples(dims)));
        let sum: u64 = all.iter().map(|&sample| u64::from(sample)).sum();
        assert_eq!(sum, 1_372_226);
    }

    #[test]
    fn a_nautilus_touches_no_face_of_its_box() {
        let dims = [192, 59, 146];
        let samples = samples(dims);
        let [nx, ny, nz] = dims.map(|n| n as usize);
        for (index, &sample) in samples.iter().enumerate() {
            let place = [index % nx, index / nx % ny, index / nx / ny];
            let on_face = place.iter().zip([nx, ny, nz]).any(|(&at, n)| at == 0 || at == n - 1);
            assert!(!on_face || sample == 0, "{place:?}: {sample}");
        }
    }

    #[test]
    fn every_material_of_a_nautilus_is_there() {
        let samples = samples([192, 59, 146]);
        let share = |low: f64, high: f64| {
            let inside = samples.iter().filter(|&&sample| (low..high).contains(&f64::from(sample))).count();
            inside as f64 / samples.len() as f64
        };
        // Wall and septa, the siphuncle with the edges of flames, the flames, and air.
        let shares = [
            share(SHELL, NACRE + 1.0),
            share(SIPHUNCLE - 1.0, SIPHUNCLE + 1.0),
            share(SIPHUNCLE + 6.0, PIGMENT + 1.0),
            share(0.0, 1.0),
        ];
        let least = [0.015, 4e-4, 1e-3, 0.8];
        assert!(shares.iter().zip(least).all(|(share, least)| *share > least), "{shares:?}");
    }
}
