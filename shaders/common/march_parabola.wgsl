// The march through a slab of scalars, which both painters make: the parabola through the means of the slab and its neighbours
// is classified at equal steps. The stage says what a sample adds: `Marched` and `add_sample`.

// From part.x to part.y of the slab; `length` is the world length of a step.
fn march_parabola(
    so_far: ptr<function, Marched>,
    means: vec3f,
    part: vec2f,
    samples: u32,
    length: f32,
    lookup: vec2f,
    light: vec2f,
) {
    let p = parabola(means);
    let step = (part.y - part.x) / f32(samples);
    for (var i = 0u; i < samples; i++) {
        let u = part.x + (f32(i) + 0.5) * step;
        let c = classified(select(p.x + (p.y + p.z * u) * u, means.y, samples == 1u), lookup);
        if c.a > 0.0 {
            var color = c.rgb;
            if LIGHTS > 0u {
                color = lit(color, light);
            }
            add_sample(so_far, color, c.a * length);
        }
    }
}
