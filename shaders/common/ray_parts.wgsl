// The part of a pixel's ray that counts in the painter `quads`: what clipping planes and solids leave, and what a brick
// owns.
// uses: common/clip, common/frame, common/owned

// The part of a ray between two view depths that is not cut away. `plane` are the ray's plane coordinates.
fn clipped(part: vec2f, plane: vec2f) -> vec2f {
    var inside = part;
    for (var i = 0u; i < CLIP_PLANES; i++) {
        let side = frame.clip_planes[i];
        let across = side.x * plane.x + side.y * plane.y;
        if PERSPECTIVE {
            inside = on_inner_side(inside, across * frame.eye_depth + side.w, across + side.z);
        } else {
            inside = on_inner_side(inside, across + side.w, side.z);
        }
    }
    return inside;
}

// The part of a ray before the solid of its pixel. `solid` is its depth.
fn before_solid(part: vec2f, solid: f32) -> vec2f {
    return vec2f(part.x, min(part.y, (solid - frame.solid_depth.y) / frame.solid_depth.x));
}

// Whether a ball around a point is clipped as a whole: `center` in view coordinates, `radius` in voxels.
fn is_cut_away(center: vec3f, radius: f32) -> bool {
    var least = BEYOND;
    for (var i = 0u; i < CLIP_PLANES; i++) {
        let side = frame.clip_planes[i];
        least = min(least, dot(side.xyz, center) + side.w);
    }
    return least < -radius;
}

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
