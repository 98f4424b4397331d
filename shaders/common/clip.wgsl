// Rays against clipping planes: the part of each ray on the inner side of all planes (Cyrus and Beck 1978, "Generalized
// two- and three-dimensional clipping").

// The number of planes; 0 clips nothing.
override CLIP_PLANES: u32 = 0u;
const MAX_CLIP_PLANES: u32 = 8u;

// Each pixel has a solid, which ends its ray. Its depth is the view depth from the plane of the camera's target, in
// units that all lattices of a picture share; BEYOND without a solid.
override SOLIDS: bool = false;

// Clipping planes or solids cut rays.
override CUT: bool = false;

// Beyond every place on a ray, but not infinite.
const BEYOND: f32 = 1e30;

// The part of a ray between two places that is on the inner side of a plane: where at + slope * place >= 0. Nothing is
// left if x >= y. A plane and its opposite cut at the same place, to the bit.
fn on_inner_side(part: vec2f, at: f32, slope: f32) -> vec2f {
    // The ray is parallel to the plane, to rounding: all of it is inside, or nothing.
    let along = abs(slope) < 1e-20;
    let place = -at / select(slope, 1.0, along);
    let first = select(part.x, max(part.x, place), !along && slope > 0.0);
    let last = select(part.y, min(part.y, place), !along && slope < 0.0);
    return vec2f(first, select(last, -BEYOND, along && at < 0.0));
}
