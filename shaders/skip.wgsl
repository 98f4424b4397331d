// skip: for each tile of the painter `tiles` the runs of planes in which voxels are that its rays can reach.

@group(0) @binding(0) var<uniform> raster: Raster;
@group(0) @binding(1) var occupied: texture_3d<u32>;
@group(0) @binding(2) var runs: texture_storage_2d<rg32uint, write>;

// The rays at the corners of a tile.
struct Corners {
    bases: array<vec2f, 4>,
    shears: array<vec2f, 4>,
    // How far kernels reach.
    half: vec2f,
    // Whether all of them follow the axis well enough to bound those between.
    bounded: bool,
}

// Whether a cell of any of the planes from `first` to `last` that rays between the corners meet, with the kernels' reach,
// is occupied.
fn is_occupied(corners: ptr<function, Corners>, first: i32, last: i32) -> bool {
    if raster.everything == 1u || !(*corners).bounded {
        return true;
    }
    var low = vec2f(3e38);
    var high = vec2f(-3e38);
    for (var i = 0u; i < 4u; i++) {
        let at_first = (*corners).bases[i] + (*corners).shears[i] * f32(first);
        let at_last = (*corners).bases[i] + (*corners).shears[i] * f32(last);
        low = min(low, min(at_first, at_last));
        high = max(high, max(at_first, at_last));
    }
    let a = max(vec2i(ceil(low - (*corners).half)), vec2i(0));
    let b = min(vec2i(floor(high + (*corners).half)), raster.voxels.xy - 1);
    if any(a > b) {
        return false;
    }
    let planes = select(vec2i(first, last), raster.voxels.z - 1 - vec2i(last, first), raster.flipped == 1) / CELL;
    for (var z = planes.x; z <= planes.y; z++) {
        for (var y = a.y / CELL; y <= b.y / CELL; y++) {
            for (var x = a.x / CELL; x <= b.x / CELL; x++) {
                if textureLoad(occupied, vec3i(x, y, z), 0).r != 0u {
                    return true;
                }
            }
        }
    }
    return false;
}

@compute @workgroup_size(8, 8)
fn skip(@builtin(global_invocation_id) tile: vec3u) {
    if any(tile.xy >= raster.tiles) {
        return;
    }
    let from_ray = first_ray(tile);
    let to_ray = from_ray + 7u * raster.phases;
    let rays = array<vec2u, 4>(from_ray, to_ray, vec2u(to_ray.x, from_ray.y), vec2u(from_ray.x, to_ray.y));
    var corners: Corners;
    corners.half = raster.half;
    corners.bounded = true;
    for (var i = 0u; i < 4u; i++) {
        let line = line_of(rays[i]);
        corners.bases[i] = line.base;
        corners.shears[i] = line.shear;
        if PERSPECTIVE {
            corners.half = max(corners.half, half_of(line.shear));
            corners.bounded = corners.bounded && line.heading.z > 0.2 * length(line.heading);
        }
    }
    var slot = 0u;
    // Planes from start to end are occupied; none yet where there is no end. A gap of one cell is not skipped: slabs look
    // at those on either side.
    var start = 0;
    var end = 0;
    for (var first = 0; first < raster.voxels.z; first += CELL) {
        let last = min(first + CELL, raster.voxels.z) - 1;
        if is_occupied(&corners, first, last) {
            if end == 0 {
                start = first;
            } else if first > end + CELL {
                textureStore(runs, runs_of(tile, slot), vec4u(u32(start), u32(end), 0u, 0u));
                slot++;
                start = first;
            }
            end = last + 1;
        }
    }
    if end > 0 {
        textureStore(runs, runs_of(tile, slot), vec4u(u32(start), u32(end), 0u, 0u));
        slot++;
    }
    // An empty run ends them.
    textureStore(runs, runs_of(tile, slot), vec4u(0u));
}
