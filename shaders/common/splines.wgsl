// The splines by which sweeps read planes, and the sums of planes.

// The weights of a quadratic B-spline for the nearest point and its neighbours, given the place relative to it.
fn spline(x: f32) -> vec3f {
    return vec3f(0.5 * (0.5 - x) * (0.5 - x), 0.75 - x * x, 0.5 * (0.5 + x) * (0.5 + x));
}

// The weights of the Catmull-Rom spline for the two points on either side of a place.
fn catmull_rom(f: f32) -> vec4f {
    let f2 = f * f;
    let f3 = f2 * f;
    return vec4f(
        -0.5 * f + f2 - 0.5 * f3,
        1.0 - 2.5 * f2 + 1.5 * f3,
        0.5 * f + 2.0 * f2 - 1.5 * f3,
        -0.5 * f2 + 0.5 * f3,
    );
}
