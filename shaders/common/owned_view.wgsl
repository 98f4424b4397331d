// The part of a pixel's ray that a brick owns, in the painter `quads`.
// uses: common/frame, common/owned

// The view depths between which a brick owns the ray of a pixel of the region. Places belong to the whole picture,
// because bricks have different regions.
fn owned_depths(pixel: vec2u, is_perspective: bool) -> vec2f {
    let plane = (vec2f(pixel + frame.picture_corner) + 0.5) * frame.pixel_scale + frame.picture_offset;
    var direction = frame.grid_forward;
    var at = plane;
    if is_perspective {
        direction += frame.grid_right * plane.x + frame.grid_up * plane.y;
        at = plane * frame.eye_depth;
    }
    let start = frame.grid_right * (at.x - frame.offset_x) + frame.grid_up * (at.y - frame.offset_y);
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
