//! Built-in volumes with known shapes, each with its transfer function, view and light.
//!
//! Everywhere that a file is expected, `demo:NAME` or `demo:NAME:SIZE` names a built-in volume.

use std::path::Path;

pub use voxsplat_volume::demos::{
    Demo, demos, marschner_lobb_at, name_in, sampled, shepp_logan_at, shepp_logan_chord, volume,
};

use crate::transfer::presets::Material;
use crate::transfer::{ControlPoint, TransferFunction};

/// The appearance that a built-in volume suggests, beside its transfer function.
#[derive(Debug, Clone, Copy, PartialEq)]
#[doc(hidden)]
pub struct DemoLook {
    /// The [`View::azimuth`](crate::View::azimuth) and [`View::elevation`](crate::View::elevation), degrees.
    pub view: [f64; 2],
    /// The material of the lit surfaces of the built-in volume; `None`: its transfer function shows translucent matter,
    /// without light.
    pub material: Option<Material>,
}

/// A control point: value, colour as red, green and blue in 0..1, and opacity per voxel.
type Row = (f64, [f64; 3], f64);

/// Looks and transfer functions, by name.
static LOOKS: [(&str, DemoLook, &[Row]); 6] = [
    ("nautilus", lit([22.0, 12.0], [0.4, 0.7, 0.35, 40.0]), &NAUTILUS),
    (
        "marschner-lobb",
        unlit([30.0, 20.0]),
        &[
            (0.15, [0.10, 0.20, 0.80], 0.00),
            (0.35, [0.10, 0.50, 0.90], 0.02),
            (0.55, [0.90, 0.80, 0.20], 0.06),
            (0.80, [1.00, 0.30, 0.10], 0.15),
            (1.00, [1.00, 1.00, 1.00], 0.30),
        ],
    ),
    (
        "sphere",
        unlit([0.0, 0.0]),
        &[
            (50.0, [0.95, 0.55, 0.15], 0.00),
            (100.0, [0.95, 0.55, 0.15], 0.06),
            (150.0, [0.15, 0.45, 0.95], 0.06),
            (200.0, [0.15, 0.45, 0.95], 0.06),
        ],
    ),
    (
        "vessels",
        lit([30.0, 10.0], [0.4, 0.8, 0.3, 30.0]),
        &[
            (70.0, [0.30, 0.02, 0.04], 0.00),
            (120.0, [0.62, 0.06, 0.05], 0.12),
            (190.0, [0.95, 0.35, 0.15], 0.45),
            (255.0, [1.00, 0.88, 0.62], 0.80),
        ],
    ),
    (
        "shepp-logan",
        unlit([30.0, 20.0]),
        &[
            (0.02, [0.05, 0.10, 0.30], 0.000),
            (0.12, [0.10, 0.35, 0.75], 0.010),
            (0.22, [0.20, 0.75, 0.70], 0.020),
            (0.32, [0.95, 0.85, 0.35], 0.120),
            (0.45, [0.95, 0.45, 0.20], 0.060),
            (1.00, [1.00, 0.95, 0.90], 0.030),
        ],
    ),
    (
        "shell",
        unlit([0.0, 0.0]),
        &[
            (0.00, [0.00, 0.00, 0.00], 0.00),
            (0.40, [0.20, 0.40, 1.00], 0.00),
            (0.50, [1.00, 0.80, 0.30], 0.25),
            (0.60, [0.20, 0.40, 1.00], 0.00),
            (0.85, [1.00, 0.20, 0.10], 0.00),
            (1.00, [1.00, 0.20, 0.10], 0.35),
        ],
    ),
];

/// Pearl, which is nacre of rose and lilac at 130 and 141; gold, the siphuncle; then the flames of the outside, from
/// orange to rust. Opacity rises over the whole soft edge, so that lattice planes leave no rings on the surface.
static NAUTILUS: [Row; 10] = [
    (28.0, [0.878, 0.675, 0.565], 0.00),
    (80.0, [0.894, 0.706, 0.612], 0.20),
    (118.0, [0.957, 0.831, 0.659], 0.45),
    (130.0, [0.902, 0.612, 0.596], 0.50),
    (141.0, [0.675, 0.604, 0.808], 0.60),
    (150.0, [0.863, 0.612, 0.471], 0.75),
    (160.0, [0.957, 0.659, 0.157], 0.85),
    (180.0, [0.910, 0.541, 0.078], 0.85),
    (200.0, [0.706, 0.314, 0.055], 0.90),
    (236.0, [0.486, 0.125, 0.024], 0.95),
];

const fn unlit(view: [f64; 2]) -> DemoLook {
    DemoLook { view, material: None }
}

const fn lit(view: [f64; 2], [ambient, diffuse, specular, shininess]: [f64; 4]) -> DemoLook {
    DemoLook { view, material: Some(Material { ambient, diffuse, specular, shininess }) }
}

fn found(name: &str) -> Option<&'static (&'static str, DemoLook, &'static [Row])> {
    let name = name.split(':').next()?;
    LOOKS.iter().find(|(known, ..)| *known == name)
}

/// Returns the transfer function of a built-in volume, by `NAME` or `NAME:SIZE`; `None` if there is no such volume.
#[must_use]
pub fn demo_transfer(name: &str) -> Option<TransferFunction> {
    let (.., points) = found(name)?;
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

/// Returns the view and the light that the built-in volume of `source` suggests; `None` if `source` is a file.
#[must_use]
pub fn own_look(source: impl AsRef<Path>) -> Option<DemoLook> {
    found(name_in(source.as_ref())?).map(|(_, look, _)| *look)
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
            assert_eq!(volume.grid().dims().into_iter().max(), Some(32));
            assert!(volume.grid().center().length() < 1e-12);
            assert!(own_look(format!("demo:{}", d.name)).is_some());
            let visible =
                (0..volume.grid().len() as usize).filter(|&i| transfer.sample(memory.value(i)).1 > 0.0).count();
            assert!(visible > 300, "{}: {visible}", d.name);
        }
    }
}
