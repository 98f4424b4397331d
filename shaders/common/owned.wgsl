// The part of a ray that a brick owns. The bricks of a volume share its sheets and slabs: each belongs, on each ray, to
// the brick that holds its middle. All bricks find the places of cuts by the same operations on the same numbers, so
// each sheet or slab has one owner, to the bit.

// The scene holds a brick: pixels are partial pictures, not colours (src/bricks).
override BRICK: bool = false;

// The part of `range` in which low <= at + slope * place < high.
fn owned_along(range: vec2f, at: f32, slope: f32, low: f32, high: f32) -> vec2f {
    // The ray is parallel to the cuts, to rounding: the brick owns all of it, or nothing.
    let along = abs(slope) < 1e-20;
    let places = (vec2f(low, high) - at) / select(slope, 1.0, along);
    let crossed = vec2f(max(range.x, min(places.x, places.y)), min(range.y, max(places.x, places.y)));
    let inside = low <= at && at < high;
    return select(crossed, select(vec2f(1e30, -1e30), range, inside), along);
}
