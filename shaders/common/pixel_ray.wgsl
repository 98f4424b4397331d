// The ray of a pixel of the painter `quads`, and its unclipped part inside the box of the volume.
// uses: common/ray_parts

override PERSPECTIVE: bool = false;

struct PixelRay {
    // Slopes dx/dz and dy/dz; 0 in a parallel projection.
    slope: vec2f,
    // View depths between which the ray is in front of the eye, inside the box and unclipped; empty if x >= y.
    inside: vec2f,
    // View depths between which a brick owns the ray.
    owned: vec2f,
    // World length along the ray per unit of view depth.
    stretch: f32,
    // Lattice coordinates from the middle of the box at view depth 0, and their change per unit of view depth.
    start: vec3f,
    direction: vec3f,
}

fn pixel_ray(pixel: vec2u) -> PixelRay {
    let plane = (vec2f(pixel) + 0.5) * frame.pixel_scale + frame.pixel_offset;
    // Lattice coordinates from the middle of the box: start + direction * view depth.
    var direction = frame.grid_forward;
    var at = plane;
    // In front of every view depth, but not infinite.
    var nearest = -3e38;
    var stretch = 1.0;
    var slope = vec2f(0.0);
    if PERSPECTIVE {
        direction += frame.grid_right * plane.x + frame.grid_up * plane.y;
        at = plane * frame.eye_depth;
        nearest = -frame.eye_depth;
        slope = plane + frame.home_slope;
        stretch = sqrt(1.0 + dot(slope, slope));
    }
    let start = frame.grid_right * (at.x - frame.offset_x) + frame.grid_up * (at.y - frame.offset_y);
    // The ray against the sides of the box (Kay and Kajiya 1986, "Ray tracing complex scenes"). A component of 0 is
    // replaced by a tiny one, whose ends lie far outside.
    let inverse = 1.0 / select(direction, vec3f(1e-20), abs(direction) < vec3f(1e-20));
    let a = (-frame.box_half - start) * inverse;
    let b = (frame.box_half - start) * inverse;
    let near = min(a, b);
    let far = max(a, b);
    let inside = vec2f(max(max(near.x, near.y), max(near.z, nearest)), min(far.x, min(far.y, far.z)));
    var owned = vec2f(-BEYOND, BEYOND);
    if BRICK {
        owned = owned_depths(pixel, PERSPECTIVE);
    }
    return PixelRay(slope, clipped(inside, plane), owned, stretch, start, direction);
}
