//! Gradients of scalars in the world.

use crate::volume::Volume;

/// The limit of control points, samples and slopes: differences stay in the range of f32.
pub(crate) const FAR: f64 = 1e36;

/// World gradients of the lattice coordinates.
pub(crate) fn gradients(volume: &Volume) -> [[f32; 3]; 3] {
    let gradients = volume.grid().local().to_lattice().matrix3.transpose();
    [0, 1, 2].map(|axis| gradients.col(axis).as_vec3().to_array())
}

/// `world_gradient` in shaders/common/classified.wgsl, of the slopes along the axes of the lattice: a vector and its
/// factor; 0 if the slopes are under their resolution.
pub(crate) fn gradient_of([x, y, z]: &[[f32; 3]; 3], slopes: [f32; 3], resolution: f32) -> ([f32; 3], f32) {
    let largest = slopes.iter().fold(0.0_f32, |largest, slope| largest.max(slope.abs()));
    if largest <= 0.0 || largest < resolution {
        return ([0.0; 3], 0.0);
    }
    let d = slopes.map(|slope| slope / largest);
    ([0, 1, 2].map(|i| x[i] * d[0] + y[i] * d[1] + z[i] * d[2]), largest)
}

/// The length of such a gradient.
pub(crate) fn steepness_of(([x, y, z], times): ([f32; 3], f32)) -> f32 {
    ((x * x + y * y + z * z).sqrt() * times).min(FAR as f32)
}
