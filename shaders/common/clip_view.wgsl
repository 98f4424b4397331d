// The clipping planes of the painter `quads`.
// uses: common/clip

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
