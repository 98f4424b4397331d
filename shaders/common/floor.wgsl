// The floor under which a gradient is noise, and the resolution under which its differences are rounding.

// There is one.
override GRADIENT_FLOOR: bool = false;

// The weight with which a surface is lit, given the length of its gradient over the floor: g^2 / (g^2 + 1). The rest is
// shown as if there were no surface.
fn surface_share(steepness: f32) -> f32 {
    if !GRADIENT_FLOOR {
        return 1.0;
    }
    // Squares stay in the range of f32.
    let g = min(steepness, 1e9);
    return g * g / (g * g + 1.0);
}

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

// The weight with which what has been reconstructed is lit as a surface: that of its differences along the axes of the
// lattice beside rounding, times that of the length of its gradient if there is a floor, of which `inverse_floor` is
// one over.
fn reconstructed_share(
    differences: vec3f,
    scalar: f32,
    faintest: f32,
    magnitude: f32,
    inverse_floor: f32,
) -> f32 {
    let g = min(largest_difference(differences) / resolution_at(scalar, faintest), 1e4);
    let g4 = g * g * g * g;
    let over_floor = select(surface_share(magnitude * inverse_floor), 1.0, inverse_floor <= 0.0);
    return g4 / (g4 + 1.0) * over_floor;
}
