// Scalars that are classified as they are met: three means of consecutive slabs, a curve through them, and `transfer`, the
// table of the transfer function. Scalars are relative to the transfer function's base, so that nothing is 0.

// The parabola whose means over three slabs are given, the middle one from -1/2 to 1/2: x + y u + z u^2.
fn parabola(m: vec3f) -> vec3f {
    let second = (m.x + m.z - 2.0 * m.y) * 0.5;
    return vec3f(m.y - second / 12.0, (m.z - m.x) * 0.5, second);
}

// Whether all means are among the scalars around 0, ends included, at which nothing shows; there are none where clear.x >
// clear.y.
//
// Nothing shows between clear means. The parabola may leave their range, by a sixth of it; but where it does so alone,
// as beside voxels that were left out for showing nothing, there is nothing to show either.
fn between_clear(low: f32, high: f32, clear: vec2f) -> bool {
    return low >= clear.x && high <= clear.y;
}

fn is_clear(m: vec3f, clear: vec2f) -> bool {
    return between_clear(min(m.x, min(m.y, m.z)), max(m.x, max(m.y, m.z)), clear);
}

// The largest value of the parabola in a part of the slab.
fn largest_in(m: vec3f, part: vec2f) -> f32 {
    let p = parabola(m);
    var largest = max(p.x + (p.y + p.z * part.x) * part.x, p.x + (p.y + p.z * part.y) * part.y);
    if p.z < 0.0 {
        let u = clamp(-0.5 * p.y / p.z, part.x, part.y);
        largest = max(largest, p.x + (p.y + p.z * u) * u);
    }
    return largest;
}

// That value, of means that were these, where the curve alone may have left what shows nothing.
fn shown(largest: f32, m: vec3f, clear: vec2f) -> f32 {
    return select(largest, min(largest, clear.y), between_clear(clear.x, max(m.x, max(m.y, m.z)), clear));
}

// What the table has at a scalar: place scalar * lookup.x + lookup.y.
fn classified(scalar: f32, lookup: vec2f) -> vec4f {
    let size = textureDimensions(transfer).x;
    let at = clamp(scalar * lookup.x + lookup.y, 0.0, f32(size - 1u));
    let index = min(u32(at), size - 2u);
    let a = textureLoad(transfer, vec2u(index, 0u));
    let b = textureLoad(transfer, vec2u(index + 1u, 0u));
    return a + (b - a) * (at - f32(index));
}
