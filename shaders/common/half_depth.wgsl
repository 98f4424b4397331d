// The depth at which a ray has lost half of its light.

// A picture holds depths in place of colours: its channels are the depth, 1 if a ray loses half of its light and 0
// otherwise, 0, and alpha. Depths are from the plane of the camera's target, as those of solids in common/clip.wgsl.
override HALF_DEPTH: bool = false;

// The optical depth at which half of the light is left.
const HALF: f32 = 0.6931472;

// The depth so far (x; y is 1 once there is one), behind matter between two depths that increases the optical depth of
// the ray from `before` to `after`.
fn half_depth(so_far: vec3f, before: f32, after: f32, ends: vec2f) -> vec3f {
    let share = saturate((HALF - before) / max(after - before, 1e-30));
    return select(vec3f(mix(ends.x, ends.y, share), 1.0, 0.0), so_far, so_far.y > 0.0 || after < HALF);
}
