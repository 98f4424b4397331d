// Classification of scalars along a ray: a parabola through the means of three consecutive slabs, and `transfer`, the
// transfer function and its integral. Scalars are relative to the transfer function's base, so that the space between
// splats is 0, and multiplied by a power of two.

// A difference of means beyond all visible ones: control points are at most 2 from the base.
const JUMP: f32 = 64.0;

// The parabola x + y u + z u^2 whose means over three slabs are `m`; the middle slab is from u = -1/2 to 1/2.
//
// If one neighbour is far away and the other is not, as beside a voxel without data, the scalar jumps there, and the
// far one tells nothing of the slab: the difference to it is replaced by the other difference.
fn parabola(m: vec3f) -> vec3f {
    let before = m.y - m.x;
    let behind = m.z - m.y;
    let sizes = abs(vec2f(before, behind));
    let jumps = max(sizes.x, sizes.y) > max(JUMP, 16.0 * min(sizes.x, sizes.y));
    let first = select(before, behind, jumps && sizes.x > sizes.y);
    let last = select(behind, before, jumps && sizes.y > sizes.x);
    let second = (last - first) * 0.5;
    return vec3f(m.y - second / 12.0, (first + last) * 0.5, second);
}

// Whether all scalars from `low` to `high` are among the invisible scalars around 0, from invisible.x to invisible.y,
// ends included. There are none if invisible.x > invisible.y.
//
// If three means are invisible, so is the slab. The parabola may leave the range of its means by a sixth of the range.
// But beside voxels that were skipped as invisible only the parabola leaves it, and no visible matter is there.
fn is_invisible_range(low: f32, high: f32, invisible: vec2f) -> bool {
    return low >= invisible.x && high <= invisible.y;
}

// Whether three means are all among them.
fn is_invisible(m: vec3f, invisible: vec2f) -> bool {
    return is_invisible_range(min(m.x, min(m.y, m.z)), max(m.x, max(m.y, m.z)), invisible);
}

// The integral of the parabola over a part of the slab.
fn integral_over(m: vec3f, part: vec2f) -> f32 {
    let p = parabola(m);
    let squares = dot(part, part) + part.x * part.y;
    return (p.x + 0.5 * p.y * (part.x + part.y) + p.z * squares / 3.0) * (part.y - part.x);
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

// The place of that value.
fn place_of_largest(m: vec3f, part: vec2f) -> f32 {
    let p = parabola(m);
    let end = select(part.x, part.y, p.y + p.z * (part.x + part.y) > 0.0);
    let top = clamp(-0.5 * p.y / select(-1.0, p.z, p.z < 0.0), part.x, part.y);
    return select(end, top, p.z < 0.0);
}

// A maximum is attenuated by its depth.
override ATTENUATED: bool = false;

// A value at a share of the depth of the box: values over the base fade with depth.
fn faded(value: f32, depth: f32, attenuation: f32) -> f32 {
    return select(value, value * exp(-attenuation * depth), value > 0.0);
}

// The largest value of a slab with means `m`. If no mean is visible, it is clamped to the invisible values, which only
// the parabola exceeds.
fn shown(largest: f32, m: vec3f, invisible: vec2f) -> f32 {
    let end = select(-3e38, invisible.y, invisible.x <= invisible.y);
    return select(largest, min(largest, end), max(m.x, max(m.y, m.z)) <= end);
}

// The transfer function is linear within equal bins of scalars: colour times extinction, and extinction; for maxima and
// means, colour and alpha. The rows of `transfer` are the function at the beginning of each bin and behind the last
// one, and its integral up to the beginning of each bin, in bins. The first and the last bin are constant: they stand
// for all scalars beyond.
const VALUES: u32 = 0u;
const INTEGRALS: u32 = 1u;
const BIN_COUNT: u32 = 1600u;
// Equal bins of gradient lengths: gradient opacity at the beginning (x) and at the end (y) of a bin.
const GRADIENTS: u32 = 2u;
const GRADIENT_BIN_COUNT: u32 = 4096u;

// Whether extinction depends on gradients.
override GRADIENT_OPACITY: bool = false;

// Gradient opacity: the share of extinction at a gradient. length * lookup is the place of its length among the bins.
fn gradient_share(gradient: vec3f, lookup: f32) -> f32 {
    if !GRADIENT_OPACITY {
        return 1.0;
    }
    let place = clamp(length(gradient) * lookup, 0.0, f32(GRADIENT_BIN_COUNT) - 0.5);
    let bin = textureLoad(transfer, vec2u(u32(place), GRADIENTS));
    return mix(bin.x, bin.y, min(fract(place), 1.0));
}

// Isosurfaces, scalars ascending, two texels each: colour and optical depth, and the scalar (x).
const SURFACES: u32 = 3u;

// The number of isosurfaces; without any the row is missing.
override ISOSURFACES: u32 = 0u;

// The scalar of an isosurface.
fn surface_scalar(number: u32) -> f32 {
    return textureLoad(transfer, vec2u(2u * number + 1u, SURFACES)).x;
}

// The colour and the optical depth of an isosurface.
fn surface_texel(number: u32) -> vec4f {
    return textureLoad(transfer, vec2u(2u * number, SURFACES));
}

// The transfer function at a scalar.
struct Classified {
    scalar: f32,
    // The place of the scalar among the bins.
    place: f32,
    value: vec4f,
    // The integral of the function up to the scalar.
    integral: vec4f,
}

// The place of a scalar among the bins is (scalar - lookup.x) * lookup.y + 2.
fn classified(scalar: f32, lookup: vec2f) -> Classified {
    let place = (scalar - lookup.x) * lookup.y + 2.0;
    let bin = u32(clamp(place, 0.0, f32(BIN_COUNT - 1u)));
    let beyond = place - f32(bin);
    let value = textureLoad(transfer, vec2u(bin, VALUES));
    let integral = textureLoad(transfer, vec2u(bin, INTEGRALS));
    let rise = (textureLoad(transfer, vec2u(bin + 1u, VALUES)) - value) * beyond;
    return Classified(scalar, place, value + rise, integral + (value + 0.5 * rise) * beyond);
}

// The mean of the transfer function between two scalars. Steps and peaks of any width between them count.
fn mean_between(a: Classified, b: Classified) -> vec4f {
    let apart = b.place - a.place;
    // If the scalars are nearly equal, rounding loses the difference of integrals.
    let alike = abs(apart) < 0.25 + 1e-4 * (abs(a.place) + abs(b.place));
    let per_bin = 1.0 / select(apart, 1.0, alike);
    return select((b.integral - a.integral) * per_bin, 0.5 * (a.value + b.value), alike);
}

// The hue shows the depth of the scalar that a projection keeps, and the transfer function sets its brightness.
override DEPTH_CODED: bool = false;

// The hue of a depth: red at 0, through yellow, green, cyan and blue, to violet at 1.
fn hue(depth: f32) -> vec3f {
    let h = 4.5 * saturate(depth);
    return saturate(vec3f(abs(h - 3.0) - 1.0, 2.0 - abs(h - 2.0), 2.0 - abs(h - 4.0)));
}

// The premultiplied pixel of the scalar that a projection keeps.
fn projected(scalar: f32, depth: f32, lookup: vec2f) -> vec4f {
    let c = classified(scalar, lookup).value;
    var color = c.rgb;
    if DEPTH_CODED {
        color = max(c.r, max(c.g, c.b)) * hue(depth);
    }
    return vec4f(color * c.a, c.a);
}
