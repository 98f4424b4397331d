// skip: for each tile of the painter `tiles` the runs of planes in which voxels are that its rays can reach.

@group(0) @binding(0) var<uniform> raster: Raster;
@group(0) @binding(1) var occupied: texture_3d<u32>;
@group(0) @binding(2) var runs: texture_storage_2d<rg32uint, write>;

// Whether a cell of any of the planes from `first` to `last` that rays meet between base coordinates low and high, with the
// kernels' reach, is occupied.
fn is_occupied(low: vec2f, high: vec2f, first: i32, last: i32) -> bool {
    let at_first = raster.shear * f32(first);
    let at_last = raster.shear * f32(last);
    let a = max(vec2i(ceil(low + min(at_first, at_last))), vec2i(0));
    let b = min(vec2i(floor(high + max(at_first, at_last))), raster.voxels.xy - 1);
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
    let to_ray = from_ray + vec2u(7u * raster.phases, 7u);
    let corners = array<vec2f, 4>(
        base_of(from_ray),
        base_of(to_ray),
        base_of(vec2u(to_ray.x, from_ray.y)),
        base_of(vec2u(from_ray.x, to_ray.y)),
    );
    let low = min(min(corners[0], corners[1]), min(corners[2], corners[3])) - raster.half;
    let high = max(max(corners[0], corners[1]), max(corners[2], corners[3])) + raster.half;
    var slot = 0u;
    // Planes from start to end are occupied; none yet where there is no end.
    var start = 0;
    var end = 0;
    for (var first = 0; first < raster.voxels.z; first += CELL) {
        let last = min(first + CELL, raster.voxels.z) - 1;
        if is_occupied(low, high, first, last) {
            if end == 0 {
                start = first;
            } else if first > end {
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
