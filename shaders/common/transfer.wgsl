// Classification of scalars along a ray: a parabola through the means of three consecutive slabs, and `transfer`, the
// table of the transfer function. Scalars are relative to the transfer function's base, so that the space between
// splats is 0.

// The parabola x + y u + z u^2 whose means over three slabs are `m`; the middle slab is from u = -1/2 to 1/2.
fn parabola(m: vec3f) -> vec3f {
    let second = (m.x + m.z - 2.0 * m.y) * 0.5;
    return vec3f(m.y - second / 12.0, (m.z - m.x) * 0.5, second);
}

// Whether all scalars from `low` to `high` are among those around 0 at which nothing shows, from invisible.x to
// invisible.y, ends included. There are none if invisible.x > invisible.y.
//
// If three means are invisible, so is the slab. The parabola may leave the range of its means, by a sixth of it; but
// beside voxels that were left out because they show nothing, only the parabola leaves it, and nothing is there to
// show.
fn is_invisible_range(low: f32, high: f32, invisible: vec2f) -> bool {
    return low >= invisible.x && high <= invisible.y;
}

// The same of three means.
fn is_invisible(m: vec3f, invisible: vec2f) -> bool {
    return is_invisible_range(min(m.x, min(m.y, m.z)), max(m.x, max(m.y, m.z)), invisible);
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

// The largest value of a slab with means `m`, clamped to what is invisible if no mean is larger: then only the parabola
// is.
fn shown(largest: f32, m: vec3f, invisible: vec2f) -> f32 {
    let only_parabola = is_invisible_range(invisible.x, max(m.x, max(m.y, m.z)), invisible);
    return select(largest, min(largest, invisible.y), only_parabola);
}

// The table at a scalar, linear between its entries; scalar * lookup.x + lookup.y is the place in it.
fn classified(scalar: f32, lookup: vec2f) -> vec4f {
    let size = textureDimensions(transfer).x;
    let at = clamp(scalar * lookup.x + lookup.y, 0.0, f32(size - 1u));
    let index = min(u32(at), size - 2u);
    let a = textureLoad(transfer, vec2u(index, 0u));
    let b = textureLoad(transfer, vec2u(index + 1u, 0u));
    return a + (b - a) * (at - f32(index));
}
