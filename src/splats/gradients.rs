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

/// `normal` in shaders/common/classified.wgsl: a vector along the dominant axis of the structure tensor of the gradients
/// of a voxel and of its six neighbours, on the side of its own: the 8th power of the tensor, times the gradient.
#[inline(always)]
pub(crate) fn tensor_normal(own: [f32; 3], neighbours: [[f32; 3]; 6]) -> [f32; 3] {
    let largest = |largest: f32, [x, y, z]: [f32; 3]| largest.max(x.abs()).max(y.abs()).max(z.abs());
    let most = neighbours.into_iter().fold(largest(0.0, own), largest);
    if most <= 0.0 {
        return own;
    }
    let mut tensor = [0.0; 6];
    let scale = most.recip();
    let mut add = |vector: [f32; 3], weight: f32| {
        let [x, y, z] = vector.map(|c| c * scale);
        let products = [x * x, y * y, z * z, x * y, x * z, y * z];
        tensor.iter_mut().zip(products).for_each(|(sum, product)| *sum += weight * product);
    };
    add(own, 1.0);
    neighbours.into_iter().for_each(|gradient| add(gradient, 0.125));
    // Its trace is 1/8 to 6, so its powers stay in the range of f32.
    for _ in 0..2 {
        let [a, b, c, d, e, f] = tensor;
        tensor = [
            a * a + d * d + e * e,
            d * d + b * b + f * f,
            e * e + f * f + c * c,
            a * d + d * b + e * f,
            a * e + d * f + e * c,
            d * e + b * f + f * c,
        ];
    }
    let [a, b, c, d, e, f] = tensor;
    let times = |[x, y, z]: [f32; 3]| [a * x + d * y + e * z, d * x + b * y + f * z, e * x + f * y + c * z];
    times(times(own.map(|c| c * scale)))
}

/// The length of such a gradient.
pub(crate) fn steepness_of(([x, y, z], times): ([f32; 3], f32)) -> f32 {
    ((x * x + y * y + z * z).sqrt() * times).min(FAR as f32)
}
