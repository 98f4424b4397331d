//! Built-in volumes against their known properties.

use glam::DVec3;
use voxsplat::camera::View;
use voxsplat::settings::{Model, Settings};
use voxsplat::transfer::Classification;

use crate::support::{coordinates, demo, exact_quads, look, render, transfer};

/// The ellipsoids of the 3-D Shepp-Logan phantom: density, half axes, centre, turn about z in degrees. A second copy,
/// so that the test finds a wrong number in the library's table.
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

/// Length of a ray inside each ellipsoid times its density, summed: the line integral of the phantom.
fn projected(origin: DVec3, direction: DVec3) -> f64 {
    let chord = |&(density, axes, center, turn): &(f64, [f64; 3], [f64; 3], f64)| {
        let (sin, cos) = turn.to_radians().sin_cos();
        // Into the space in which the ellipsoid is the unit ball.
        let into = |v: DVec3| DVec3::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x, v.z) / DVec3::from_array(axes);
        let (o, d) = (into(origin - DVec3::from_array(center)), into(direction));
        let (a, b, c) = (d.length_squared(), o.dot(d), o.length_squared() - 1.0);
        density * 2.0 * (b * b - a * c).max(0.0).sqrt() / a
    };
    ELLIPSOIDS.iter().map(chord).sum()
}

#[test]
fn xray_of_shepp_logan_approaches_its_analytic_projection() {
    // So thin that opacity is the line integral; the density of the phantom is between 0 and 1.
    let thin = 1e-6;
    let transfer = transfer(&[(0.0, [1.0; 3], 0.0), (1.0, [1.0; 3], thin)], Some(1.0));
    let transfer = transfer.with_classification(Classification::Point);
    let settings = Settings { model: Model::Xray, antialiasing: false, ..exact_quads() };
    let error = |size: u32| {
        let (volume, _) = demo("shepp-logan", size);
        let view = View { azimuth: 33.0, elevation: 12.0, ..View::default() };
        let camera = look(&view, &volume, [64; 2]);
        let image = render(&volume, &transfer, &camera, &settings);
        let (mut squares, mut peak) = (0.0, 0.0_f64);
        for (index, pixel) in image.pixels().iter().enumerate() {
            let (sx, sy) = coordinates(index, &camera);
            let (origin, direction) = camera.ray(sx, sy);
            // The phantom spans -1..1, the volume `size` voxels.
            let half = f64::from(size) / 2.0;
            let expected = projected(origin / half, direction) * half;
            squares += (f64::from(pixel[3]) / thin - expected).powi(2);
            peak = peak.max(expected);
        }
        (squares / (64.0 * 64.0)).sqrt() / peak
    };
    // The lattice samples the sharp edges of the phantom and the kernel blurs them: the remaining error falls with the
    // spacing, because footprints are exact.
    let [coarse, fine] = [error(36), error(144)];
    assert!(fine < 0.4 * coarse && fine < 0.02, "{coarse:e} {fine:e}");
}
