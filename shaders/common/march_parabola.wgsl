// The march through one slab of scalars, the same for both painters: the parabola through the means of the slab and of
// its two neighbours, in pieces of equal length. Along a piece the scalar is linear and the transfer function is
// integrated exactly. Each stage defines the sum over pieces: the type `Marched` and `add_sample`. (Between batches
// `shade` keeps only optical depth; `gather` also keeps transmittance.)
// uses: common/lighting, common/transfer

// The state in front of a slab:
// an invisible slab, or skipped space;
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

// The parabola whose values at the ends of pieces give each piece the mean of the original parabola; it lies a little
// below.
fn marched_parabola(means: vec3f, step: f32) -> vec3f {
    let p = parabola(means);
    return vec3f(p.x - p.z * step * step / 6.0, p.yz);
}

// Marches through a slab. `means` are the means of the slab before, of the slab and of the slab behind. `part` is the
// part of the slab that counts, its ends from -1/2 to 1/2; `length` is the length along the ray of a piece. The
// parabola of the slab before ends near the beginning of this parabola; the scalar is made continuous, so that values
// between the two are not lost. Returns the state in front of the next slab.
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
