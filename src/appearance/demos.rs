//! Built-in volumes with known shapes, each with its transfer function.
//!
//! Everywhere that a file is expected, `demo:NAME` or `demo:NAME:SIZE` names a built-in volume.

use std::path::Path;

pub use voxsplat_volume::demos::{
    Demo, demos, marschner_lobb_at, name_in, sampled, shepp_logan_at, shepp_logan_chord, volume,
};

use crate::transfer::{ControlPoint, TransferFunction};

/// Returns the transfer function of a built-in volume, by `NAME` or `NAME:SIZE`; `None` if there is no such volume.
#[must_use]
pub fn demo_transfer(name: &str) -> Option<TransferFunction> {
    // Value, colour as red, green and blue in 0..1, and opacity per voxel.
    let points: &[(f64, [f64; 3], f64)] = match name.split(':').next()? {
        "marschner-lobb" => &[
            (0.15, [0.10, 0.20, 0.80], 0.00),
            (0.35, [0.10, 0.50, 0.90], 0.02),
            (0.55, [0.90, 0.80, 0.20], 0.06),
            (0.80, [1.00, 0.30, 0.10], 0.15),
            (1.00, [1.00, 1.00, 1.00], 0.30),
        ],
        "sphere" => &[
            (50.0, [0.95, 0.55, 0.15], 0.00),
            (100.0, [0.95, 0.55, 0.15], 0.06),
            (150.0, [0.15, 0.45, 0.95], 0.06),
            (200.0, [0.15, 0.45, 0.95], 0.06),
        ],
        "vessels" => &[
            (70.0, [0.30, 0.02, 0.04], 0.00),
            (120.0, [0.62, 0.06, 0.05], 0.12),
            (190.0, [0.95, 0.35, 0.15], 0.45),
            (255.0, [1.00, 0.88, 0.62], 0.80),
        ],
        "shepp-logan" => &[
            (0.02, [0.05, 0.10, 0.30], 0.000),
            (0.12, [0.10, 0.35, 0.75], 0.010),
            (0.22, [0.20, 0.75, 0.70], 0.020),
            (0.32, [0.95, 0.85, 0.35], 0.120),
            (0.45, [0.95, 0.45, 0.20], 0.060),
            (1.00, [1.00, 0.95, 0.90], 0.030),
        ],
        "shell" => &[
            (0.00, [0.00, 0.00, 0.00], 0.00),
            (0.40, [0.20, 0.40, 1.00], 0.00),
            (0.50, [1.00, 0.80, 0.30], 0.25),
            (0.60, [0.20, 0.40, 1.00], 0.00),
            (0.85, [1.00, 0.20, 0.10], 0.00),
            (1.00, [1.00, 0.20, 0.10], 0.35),
        ],
        _ => return None,
    };
    let points = points.iter().map(|&(value, color, opacity)| ControlPoint { value, color, opacity }).collect();
    TransferFunction::new(points, None).ok()
}

/// Returns the transfer function of the built-in volume that `source` names; `None` if `source` is a file.
///
/// `source` is an argument of [`load`](crate::formats::load): `demo:NAME`, `demo:NAME:SIZE` or the path of a file.
#[must_use]
pub fn own_transfer(source: impl AsRef<Path>) -> Option<TransferFunction> {
    demo_transfer(name_in(source.as_ref())?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_demo_has_a_transfer_function_that_shows_it() {
        for d in demos() {
            let volume = volume(d.name, 32).unwrap();
            let memory = volume.in_memory().unwrap();
            let transfer = demo_transfer(&format!("{}:32", d.name)).unwrap();
            assert_eq!(volume.grid().dims(), [32; 3]);
            assert!(volume.grid().center().length() < 1e-12);
            let visible = (0..32_usize.pow(3)).filter(|&i| transfer.sample(memory.value(i)).1 > 0.0).count();
            assert!(visible > 300, "{}: {visible}", d.name);
        }
    }
}
