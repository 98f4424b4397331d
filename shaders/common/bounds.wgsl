// The part of the image that a splat can touch.

override PERSPECTIVE: bool = false;
// Whether kernels may grow in this frame, because voxels are closer together than pixels.
override GROWN: bool = false;

// View coordinates of a lattice point.
fn view_center(lattice: vec3f) -> vec3f {
    let p = lattice - frame.lattice_center;
    return vec3f(
        dot(frame.view_x, p) + frame.offset_x,
        dot(frame.view_y, p) + frame.offset_y,
        dot(frame.view_z, p),
    );
}

// How many times as large as asked for the kernel of a splat at view depth `z` is. Cells of levels have spread their
// voxels already: their kernels are so much narrower that the variances add up to that of the kernel of a voxel.
fn growth_at(z: f32, level: u32) -> f32 {
    if !GROWN {
        return 1.0;
    }
    let growth = max(1.0, frame.growth.x + frame.growth.y * z);
    if level == 0u {
        return growth;
    }
    return sqrt(max(growth * growth - frame.level_spread * (ldexp(1.0, i32(2u * level)) - 1.0), 1.0));
}

// Bounds of a splat in one plane coordinate, as (middle, half extent). Its support is a ball in the lattice, of
// `radius` voxels around a centre at view coordinate `center` and at distance `z` in front of the eye. `axis` and
// `depth` are the gradients in the lattice of the view coordinate and of depth.
fn bounds_along(axis: vec3f, center: f32, depth: vec3f, z: f32, radius: f32) -> vec2f {
    if !PERSPECTIVE {
        return vec2f(center, radius * length(axis));
    }
    // Planes through the eye, of slope k = x / z, touch the support if (center - k z)^2 = R^2 |axis - k depth|^2. With
    // s = center / z, e = R depth / z and g = R axis: (s - k)^2 = |g / z - k e|^2. The middle and the half extent of
    // the roots are formed without the square of s, beside which a small support would be rounded away, and without the
    // square of z, which may be 1e30.
    let e = depth * (radius / z);
    let g = axis * radius;
    let s = center / z;
    let a = 1.0 - dot(e, e);
    let w = g - s * (depth * radius);
    let n = cross(g, e);
    return vec2f(s - dot(g, e) / z, sqrt(max(dot(w, w) - dot(n, n), 0.0)) / z) / a;
}

// Whether a splat has bounds: it has none if the plane of the eye cuts its support. 1.001 keeps the division in
// bounds_along() away from 0. `center` is in view coordinates, `growth` comes from growth_at().
fn bounded(center: vec3f, growth: f32) -> bool {
    return !PERSPECTIVE || center.z + frame.eye_depth > frame.depth_extent * growth * 1.001;
}

// Bounds of such a splat in plane coordinates: their middle (xy) and half extent (zw).
fn bounds(center: vec3f, growth: f32) -> vec4f {
    let z = center.z + frame.eye_depth;
    let x = bounds_along(frame.view_x, center.x, frame.view_z, z, frame.radius * growth);
    let y = bounds_along(frame.view_y, center.y, frame.view_z, z, frame.radius * growth);
    return vec4f(x.x, y.x, vec2f(x.y, y.y) + frame.quad_pad);
}

// The slopes from `low` to `high` at which rays can meet a support that the plane of the eye cuts, in one plane
// coordinate; the parameters are the same as in bounds_along().
fn cut_along(axis: vec3f, center: f32, depth: vec3f, z: f32, radius: f32, low: f32, high: f32) -> vec2f {
    let r2 = radius * radius;
    let a = z * z - r2 * dot(depth, depth);
    let b = center * z - r2 * dot(axis, depth);
    let c = center * center - r2 * dot(axis, axis);
    let d = b * b - a * c;
    if a >= 0.0 || d <= 0.0 {
        return vec2f(low, high);
    }
    // Planes of slopes between the roots of a k^2 - 2 b k + c miss the support. The part of the support in front of the
    // eye lies on the same side of them as its centre.
    let q = b + select(-1.0, 1.0, b >= 0.0) * sqrt(d);
    let near = c / q;
    let far = q / a;
    let margin = 1e-3 * (1.0 + abs(near));
    if center - near * z >= 0.0 {
        return vec2f(clamp(select(near, far, far > near) - margin, low, high), high);
    }
    return vec2f(low, clamp(select(near, far, far < near) + margin, low, high));
}

// The least (xy) and the largest (zw) slopes of the region's rays, a little beyond its outermost pixels.
fn region_slopes() -> vec4f {
    let a = frame.pixel_offset;
    let b = vec2f(frame.region) * frame.pixel_scale + frame.pixel_offset;
    return vec4f(min(a, b) - frame.quad_pad, max(a, b) + frame.quad_pad);
}

// Bounds of such a support within the region, in the form of bounds().
fn cut_bounds(center: vec3f, growth: f32) -> vec4f {
    let ends = region_slopes();
    let low = ends.xy;
    let high = ends.zw;
    let z = center.z + frame.eye_depth;
    let radius = frame.radius * growth;
    let x = cut_along(frame.view_x, center.x, frame.view_z, z, radius, low.x, high.x);
    let y = cut_along(frame.view_y, center.y, frame.view_z, z, radius, low.y, high.y);
    return vec4f(x.x + x.y, y.x + y.y, x.y - x.x, y.y - y.x) * 0.5;
}

// Whether the support of a splat may reach into the pyramid of the region's rays: false if it lies beyond one of the
// four sides, which are planes through the eye.
fn in_view(center: vec3f, growth: f32) -> bool {
    let ends = region_slopes();
    let low = ends.xy;
    let high = ends.zw;
    let z = center.z + frame.eye_depth;
    let radius = frame.radius * growth;
    return center.x - low.x * z >= -radius * length(frame.view_x - low.x * frame.view_z)
        && high.x * z - center.x >= -radius * length(high.x * frame.view_z - frame.view_x)
        && center.y - low.y * z >= -radius * length(frame.view_y - low.y * frame.view_z)
        && high.y * z - center.y >= -radius * length(high.y * frame.view_z - frame.view_y);
}
