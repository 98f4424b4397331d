// The march through one slab of scalars, the same for both painters: the parabola through the means of the slab and of
// its two neighbours in pieces of equal length, along each of which the scalar is linear and the transfer function is
// integrated exactly. Each stage defines the effect of a piece: the type `Marched` and `add_sample`. (`shade` keeps
// optical depth alone between batches, `gather` keeps transmittance beside it.)
// uses: common/lighting, common/transfer

// The matter before a slab:
// a slab that shows nothing, or skipped space;
const INVISIBLE: u32 = 0u;
// nothing, if the slab is the first at a face of the volume or at the eye;
const AT_THE_FACE: u32 = 1u;
// a slab that ends with a known scalar;
const SCALAR: u32 = 2u;
// a slab that has been classified up to its end.
const CLASSIFIED: u32 = 3u;

struct Before {
    kind: u32,
    end: Classified,
}

// The parabola for the scalars at the ends of pieces: a little below the parabola through the means, so that both have
// the same mean in each piece.
fn marched_parabola(means: vec3f, step: f32) -> vec3f {
    let p = parabola(means);
    return vec3f(p.x - p.z * step * step / 6.0, p.yz);
}

// Marches the part of a slab that counts, with its ends from -1/2 to 1/2. `means` belong to the slab before, the slab
// and the slab behind; `length` is the length along the ray of a piece. The parabola of the slab before ends nearly
// where this one begins; the scalar is made continuous, so that visible scalars between the two are not lost. Returns
// the matter before the slab behind.
fn march_parabola(
    so_far: ptr<function, Marched>,
    means: vec3f,
    part: vec2f,
    before: Before,
    samples: u32,
    length: f32,
    lookup: vec2f,
    invisible: vec2f,
    light: Shine,
) -> Before {
    let step = (part.y - part.x) / f32(samples);
    let p = marched_parabola(means, step);
    // A slab of one sample is classified at its mean.
    let is_whole = samples == 1u;
    var first = p.x + (p.y + p.z * part.x) * part.x;
    first = select(first, clamp(first, invisible.x, invisible.y), before.kind == INVISIBLE);
    first = select(first, before.end.scalar, before.kind >= SCALAR);
    first = select(first, means.y, is_whole);
    var begin = before.end;
    // Piece 0 stands for the end of the slab before: it is where the first piece begins.
    var piece = select(0u, 1u, before.kind == CLASSIFIED && !is_whole);
    loop {
        let u = part.x + f32(piece) * step;
        let scalar = select(p.x + (p.y + p.z * u) * u, means.y, is_whole);
        let end = classified(select(scalar, first, piece == 0u), lookup);
        let c = mean_between(begin, end);
        if c.a > 0.0 && piece > 0u {
            var color = c.rgb / c.a;
            if LIGHTS > 0u {
                color = lit(color, light);
            }
            add_sample(so_far, color, c.a * length);
        }
        begin = end;
        continuing {
            piece++;
            break if piece > samples;
        }
    }
    return Before(CLASSIFIED, begin);
}
