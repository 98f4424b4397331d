//! The grain of lit surfaces in noisy scans.

use voxsplat::settings::{Settings, Shading};

use self::ball::{Ball, Grain};
use crate::support::renderer;

#[path = "../../../benches/grain/ball.rs"]
mod ball;

/// Limits are 1.3 times the measured grain. By central differences the grain of cubic voxels was 2 to 3 times as large:
/// docs/measurements/2026-11-24-grain.md.
#[test]
fn lit_surfaces_show_little_noise_and_no_lattice() {
    let settings = Settings { shading: Shading::Pre, sharpness: 0.5, ..Settings::default() };
    for (slices, signal_to_noise, limit) in
        [(1.0, None, 0.11), (1.0, Some(50.0), 1.5), (1.0, Some(20.0), 3.3), (3.0, None, 1.4), (3.0, Some(20.0), 3.3)]
    {
        let ball = Ball { voxels: 40, slices, signal_to_noise };
        let Grain { all, fine } = ball.grain(&renderer(), &settings, 200).unwrap();
        println!("{ball:?}: {all:.2}, {fine:.2} of 255");
        assert!(fine < limit && fine <= all, "{ball:?}: {all} {fine}");
    }
}
