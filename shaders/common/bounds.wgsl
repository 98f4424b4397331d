// What of the image a splat can touch.

override PERSPECTIVE: bool = false;
// Whether kernels grow in this frame.
override GROWN: bool = false;

// View coordinates of the centre of a splat.
fn view_center(lattice: vec3f) -> vec3f {
    let p = lattice - frame.lattice_center;
    return vec3f(
        dot(frame.view_x, p) + frame.offset_x,
        dot(frame.view_y, p) + frame.offset_y,
        dot(frame.view_z, p),
    );
}

// How many times larger than the kernel the splat at view depth `z` is.
fn growth_at(z: f32) -> f32 {
    if !GROWN {
        return 1.0;
    }
    return max(1.0, frame.growth.x + frame.growth.y * z);
}

// Bounds of the splat in one plane coordinate, as (middle, half extent).
//
// `axis` and `depth` are the gradients of the view coordinate and of depth in the lattice; the support is the lattice
// ball of radius `radius` around the centre at view coordinate `center` and distance `z` in front of the eye.
fn bounds_along(axis: vec3f, center: f32, depth: vec3f, z: f32, radius: f32) -> vec2f {
    if !PERSPECTIVE {
        return vec2f(center, radius * length(axis));
    }
    // The planes through the eye of slope k = x / z that touch the support: (center - k z)^2 = R^2 |axis - k depth|^2.
    let r2 = radius * radius;
    let a = z * z - r2 * dot(depth, depth);
    let b = center * z - r2 * dot(axis, depth);
    let c = center * center - r2 * dot(axis, axis);
    return vec2f(b / a, sqrt(max(b * b - a * c, 0.0)) / a);
}

// Middle (xy) and half extent (zw) of a splat in plane coordinates, for a centre at view coordinates `center` and kernels
// `growth` times as large. A support that the plane of the eye cuts has no bounds: `bounded` tells.
fn bounded(center: vec3f, growth: f32) -> bool {
    return !PERSPECTIVE || center.z + frame.eye_depth > frame.depth_extent * growth * 1.001;
}

fn bounds(center: vec3f, growth: f32) -> vec4f {
    let z = center.z + frame.eye_depth;
    let x = bounds_along(frame.view_x, center.x, frame.view_z, z, frame.radius * growth);
    let y = bounds_along(frame.view_y, center.y, frame.view_z, z, frame.radius * growth);
    return vec4f(x.x, y.x, vec2f(x.y, y.y) + frame.quad_pad);
}

// Whether a support may reach into the pyramid of rays: false where it lies beyond one of its four sides, which are planes
// through the eye.
fn in_view(center: vec3f, growth: f32) -> bool {
    let a = frame.pixel_offset;
    let b = vec2f(frame.region) * frame.pixel_scale + frame.pixel_offset;
    let low = min(a, b) - frame.quad_pad;
    let high = max(a, b) + frame.quad_pad;
    let z = center.z + frame.eye_depth;
    let radius = frame.radius * growth;
    return center.x - low.x * z >= -radius * length(frame.view_x - low.x * frame.view_z)
        && high.x * z - center.x >= -radius * length(high.x * frame.view_z - frame.view_x)
        && center.y - low.y * z >= -radius * length(frame.view_y - low.y * frame.view_z)
        && high.y * z - center.y >= -radius * length(high.y * frame.view_z - frame.view_y);
}
