// The march through one slab of scalars, the same for both painters: the parabola through the means of the slab and of
// its two neighbours is classified at equal steps. Each stage says what a sample adds: the type `Marched` and
// `add_sample`. (`shade` keeps optical depth alone between batches, `gather` keeps transmittance beside it.)

// `means` are those of the slab before, of the slab and of the slab behind. `part` is the part of the slab that counts,
// its ends from -1/2 to 1/2; `length` is the world length along the ray between two samples.
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
