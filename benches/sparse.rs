//! Writes a sparse u8 volume as bare samples: balls in empty space, a plane at a time.
//!
//! ```text
//! cargo bench --bench sparse -- FILE.raw SIZE FRACTION
//! ```
//!
//! SIZE^3 voxels; about FRACTION of them are over 0 (0.01 is 1 %). The radius of the balls is 1/25 of SIZE, so files
//! of one FRACTION show the same scene at every SIZE. Prints the command that renders the file.

#![allow(clippy::print_stdout, reason = "printing how to render the file is what this program is for")]

mod common;

use std::io::Write as _;

use common::{Arguments, Outcome};
use glam::DVec3;
use rayon::prelude::*;

/// Steele, Lea and Flood, "Fast splittable pseudorandom number generators" (2014): splitmix64, in 0..1.
fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (*state ^ (*state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

fn main() -> Outcome {
    let arguments = Arguments::of_process();
    let [file, size, fraction] = arguments.positional()? else {
        return Err("arguments: FILE.raw SIZE FRACTION".into());
    };
    let (size, fraction): (usize, f64) = (size.parse()?, fraction.parse()?);
    let n = size as f64;
    let radius = n / 25.0;
    let ball = 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
    let count = (fraction * n.powi(3) / ball).round().max(1.0) as usize;
    let mut state = 7;
    let mut place = || radius + random(&mut state) * (n - 2.0 * radius);
    let balls: Vec<DVec3> = (0..count).map(|_| DVec3::new(place(), place(), place())).collect();
    let mut out = std::io::BufWriter::with_capacity(1 << 20, std::fs::File::create(file)?);
    let mut plane = vec![0_u8; size * size];
    for z in 0..size {
        let near: Vec<&DVec3> = balls.iter().filter(|b| (b.z - z as f64).abs() < radius).collect();
        plane.par_chunks_mut(size).enumerate().for_each(|(y, row)| {
            row.fill(0);
            for b in &near {
                // Brightest in the middle, 40 at the rim.
                let rest = radius * radius - (b.y - y as f64).powi(2) - (b.z - z as f64).powi(2);
                if rest > 0.0 {
                    let half = rest.sqrt();
                    let from = (b.x - half).ceil() as usize;
                    for (x, sample) in (from..).zip(&mut row[from..=(b.x + half).floor() as usize]) {
                        let inside = 1.0 - ((b.x - x as f64).powi(2) + radius * radius - rest) / (radius * radius);
                        *sample = (*sample).max((40.0 + 215.0 * inside) as u8);
                    }
                }
            }
        });
        out.write_all(&plane)?;
    }
    out.flush()?;
    println!(
        "voxsplat render {file} -o sparse.png --dims {size},{size},{size} --type u8 --transfer benches/sparse.json"
    );
    Ok(())
}
