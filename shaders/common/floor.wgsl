// The floor under which a gradient is noise.

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
