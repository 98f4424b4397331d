// The part of a pixel's ray that a brick owns, in the painter `quads`.
// uses: common/frame, common/owned

// The view depths between which a brick owns a ray, given in the lattice from its middle.
fn owned_on(start: vec3f, direction: vec3f) -> vec2f {
    let low = frame.owned_low;
    let high = frame.owned_high;
    let x = owned_along(vec2f(-1e30, 1e30), start.x, direction.x, low.x, high.x);
    let y = owned_along(x, start.y, direction.y, low.y, high.y);
    return owned_along(y, start.z, direction.z, low.z, high.z);
}

// Whether a brick owns the sheet that begins at view depth `depth` on a ray that it owns between two view depths.
fn owns_sheet(owned: vec2f, depth: f32) -> bool {
    let middle = depth + 0.5 * frame.sheet_step;
    return owned.x <= middle && middle < owned.y;
}
