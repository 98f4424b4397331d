// The resolution of gradients: smaller central differences of samples are rounding, not a surface.

// `Resolution` of the host: the share of the distance of a scalar from the base that counts as rounding, 2^-18.
const RESOLUTION: f32 = 3.814697265625e-6;

// The central difference that counts half as a surface, at a scalar relative to the base. `faintest` is over 0.
fn resolution_at(scalar: f32, faintest: f32) -> f32 {
    return RESOLUTION * abs(scalar) + faintest;
}

// The largest of three differences.
fn largest_difference(differences: vec3f) -> f32 {
    return max(abs(differences.x), max(abs(differences.y), abs(differences.z)));
}

// The weight of a reconstructed scalar as a surface, given its differences along the axes of the lattice:
// g^4 / (g^4 + 1), with g the largest of them over the resolution.
fn reconstructed_share(differences: vec3f, scalar: f32, faintest: f32) -> f32 {
    let g = min(largest_difference(differences) / resolution_at(scalar, faintest), 1e4);
    let g4 = g * g * g * g;
    return g4 / (g4 + 1.0);
}
