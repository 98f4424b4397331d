// The texels of a box of scalars (common/box.wgsl), and their marks.
// uses: common/marking, common/packing

// Texels have gradients.
override GRADIENTS: bool = false;

@group(0) @binding(2) var<uniform> pack: Pack;

// Whether a scalar marks cells.
fn is_visible(scalar: f32) -> bool {
    return scalar < pack.least_invisible || scalar > pack.largest_invisible;
}

// Whether a texel marks the same cells as the one before it in its row, which then marks them alone: atomics are slow.
fn marks_as_before(place: vec3u) -> bool {
    let before = place - vec3u(1u, 0u, 0u);
    return place.x > 0u && all(first_marked(before) == first_marked(place))
        && all(last_marked(before) == last_marked(place));
}

fn store_scalar(place: vec3u, gradient: vec3f, scalar: f32) {
    if !GRADIENTS {
        store(place, vec2u(bitcast<u32>(scalar), 0u));
        return;
    }
    let v = rounded(vec4f(gradient, scalar) * pack.scale);
    store(place, vec2u(pack2x16float(v.xy), pack2x16float(v.zw)));
}

// Scalars from samples lie in a whole box.
fn stored_place(place: vec3u) -> vec3u {
    return place;
}
