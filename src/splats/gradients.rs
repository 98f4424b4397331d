//! Gradients of scalars in the world.

use crate::volume::{BRICK_EDGE as EDGE, Volume};

/// The limit of control points, samples and slopes: differences stay in the range of f32.
pub(crate) const FAR: f64 = 1e36;

/// Returns the world gradients of the lattice coordinates.
pub(crate) fn gradients(volume: &Volume) -> [[f32; 3]; 3] {
    let gradients = volume.grid().local().to_lattice().matrix3.transpose();
    [0, 1, 2].map(|axis| gradients.col(axis).as_vec3().to_array())
}

/// Returns the world gradient for slopes along the axes of the lattice, as `world_gradient` in
/// shaders/common/classified.wgsl: a vector and its factor; 0 if the slopes are under their resolution.
pub(crate) fn gradient_of([x, y, z]: &[[f32; 3]; 3], slopes: [f32; 3], resolution: f32) -> ([f32; 3], f32) {
    let largest = slopes.iter().fold(0.0_f32, |largest, slope| largest.max(slope.abs()));
    if largest <= 0.0 || largest < resolution {
        return ([0.0; 3], 0.0);
    }
    let d = slopes.map(|slope| slope / largest);
    ([0, 1, 2].map(|i| x[i] * d[0] + y[i] * d[1] + z[i] * d[2]), largest)
}

/// A vector for each voxel of a row of a brick.
pub(crate) type RowVectors = [[f32; EDGE]; 3];

/// Returns the normals of a row, as `normal` in shaders/common/classified.wgsl: vectors along the dominant axes of the
/// structure tensors of the gradients of voxels and of their six neighbours, on the sides of the voxels' own gradients:
/// the 8th power of the tensor, times the gradient. Loops over the row vectorise.
pub(crate) fn tensor_normals(own: [&[f32]; 3], neighbours: [[&[f32]; 3]; 6]) -> RowVectors {
    let mut scale = [0.0_f32; EDGE];
    for component in neighbours.iter().chain([&own]).flatten() {
        scale.iter_mut().zip(*component).for_each(|(most, c)| *most = most.max(c.abs()));
    }
    scale.iter_mut().for_each(|most| *most = if *most > 0.0 { most.recip() } else { 0.0 });
    let mut tensor = [[0.0_f32; EDGE]; 6];
    let weighted = neighbours.into_iter().map(|gradient| (gradient, 0.125)).chain([(own, 1.0)]);
    for ([x, y, z], weight) in weighted {
        for i in 0..EDGE {
            let [x, y, z] = [x[i] * scale[i], y[i] * scale[i], z[i] * scale[i]];
            let [of_x, of_y, of_z] = [weight * x, weight * y, weight * z];
            tensor[0][i] += of_x * x;
            tensor[1][i] += of_y * y;
            tensor[2][i] += of_z * z;
            tensor[3][i] += of_x * y;
            tensor[4][i] += of_x * z;
            tensor[5][i] += of_y * z;
        }
    }
    let mut vectors = [[0.0; EDGE]; 3];
    for i in 0..EDGE {
        let mut power = [0, 1, 2, 3, 4, 5].map(|entry| tensor[entry][i]);
        // Its trace is 1/8 to 6, so its powers stay in the range of f32.
        for _ in 0..2 {
            let [a, b, c, d, e, f] = power;
            power = [
                a * a + d * d + e * e,
                d * d + b * b + f * f,
                e * e + f * f + c * c,
                a * d + d * b + e * f,
                a * e + d * f + e * c,
                d * e + b * f + f * c,
            ];
        }
        let [a, b, c, d, e, f] = power;
        let times = |[x, y, z]: [f32; 3]| [a * x + d * y + e * z, d * x + b * y + f * z, e * x + f * y + c * z];
        let [x, y, z] = times(times([own[0][i] * scale[i], own[1][i] * scale[i], own[2][i] * scale[i]]));
        [vectors[0][i], vectors[1][i], vectors[2][i]] = [x, y, z];
    }
    vectors
}

/// Returns the length of a gradient given by [`gradient_of`].
pub(crate) fn steepness_of(([x, y, z], times): ([f32; 3], f32)) -> f32 {
    ((x * x + y * y + z * z).sqrt() * times).min(FAR as f32)
}
