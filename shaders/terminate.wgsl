// terminate: early splat termination (Mueller, Shareef, Huang and Crawfis 1999, "High-quality splatting on rectilinear
// grids with efficient culling of occluded voxels"). `tile` finds the opaque tiles of the frame, `mark` marks the
// entries of a batch whose bounds lie in opaque tiles alone. A pixel with a transmittance of e can change by at most e,
// whatever lies behind.
// uses: common/bounds, common/dispatch, common/frame, common/splat

// Entries of one invocation.
const RUN: u32 = 16u;
// The largest number of tiles along a side for which bounds are tested. A tile is half as wide as a splat in the middle
// of the volume, so only splats near the eye span more tiles; they are drawn.
const MAX_SPAN: u32 = 8u;

struct Terminate {
    // The batch's entries.
    first: u32,
    count: u32,
}

struct Tally {
    // Whether any tile is opaque.
    opaque_tiles: atomic<u32>,
    // Entries marked so far.
    terminated: atomic<u32>,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> terminate: Terminate;
@group(0) @binding(2) var<storage, read> pixels: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> tiles: array<f32>;
@group(0) @binding(4) var<storage, read> splats: array<vec2u>;
@group(0) @binding(5) var<storage, read_write> entries: array<u32>;
@group(0) @binding(6) var<storage, read_write> tally: Tally;
@group(0) @binding(7) var<storage, read> origins: array<vec4u>;

// Tiles across and down the frame.
fn tiles_of_frame() -> vec2u {
    return (frame.region + frame.tile_size - 1u) / frame.tile_size;
}

@compute @workgroup_size(WORKGROUP)
fn tile(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    let size = tiles_of_frame();
    if index >= size.x * size.y {
        return;
    }
    // An opaque tile stays opaque.
    if tiles[index] >= frame.opaque_depth {
        return;
    }
    let corner = vec2u(index % size.x, index / size.x) * frame.tile_size;
    let end = min(corner + frame.tile_size, frame.region);
    var least = frame.opaque_depth;
    for (var y = corner.y; y < end.y; y++) {
        for (var x = corner.x; x < end.x; x++) {
            least = min(least, pixels[y * frame.region.x + x].a);
        }
        // One pixel that is not opaque suffices.
        if least < frame.opaque_depth {
            return;
        }
    }
    tiles[index] = least;
    atomicOr(&tally.opaque_tiles, 1u);
}

// Whether all pixels within bounds, as (middle, half extent) in plane coordinates, and those beside them, are opaque.
fn is_hidden(box: vec4f) -> bool {
    let middle = (box.xy - frame.pixel_offset) / frame.pixel_scale;
    let half = box.zw / abs(frame.pixel_scale) + 1.5;
    // Clamped as floats: bounds may lie far outside the region.
    let last = vec2f(frame.region - 1u);
    let from_pixel = vec2u(clamp(middle - half, vec2f(0.0), last));
    let to_pixel = vec2u(clamp(middle + half, vec2f(0.0), last));
    let low = from_pixel / frame.tile_size;
    let high = to_pixel / frame.tile_size;
    if any(high - low >= vec2u(MAX_SPAN)) {
        return false;
    }
    let across = tiles_of_frame().x;
    for (var y = low.y; y <= high.y; y++) {
        for (var x = low.x; x <= high.x; x++) {
            if tiles[y * across + x] < frame.opaque_depth {
                return false;
            }
        }
    }
    return true;
}

fn is_behind_opaque_tiles(index: u32) -> bool {
    let words = splat_words(index);
    let center = view_center(splat_lattice(words));
    let growth = growth_at(center.z, splat_level(words));
    return bounded(center, growth) && is_hidden(bounds(center, growth));
}

@compute @workgroup_size(WORKGROUP)
fn mark(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let run = invocation_index(id, groups) * RUN;
    if run >= terminate.count || atomicLoad(&tally.opaque_tiles) == 0u {
        return;
    }
    var marked = 0u;
    for (var i = run; i < min(run + RUN, terminate.count); i++) {
        let entry = entries[terminate.first + i];
        if is_behind_opaque_tiles(entry) {
            entries[terminate.first + i] = entry | TERMINATED;
            marked += 1u;
        }
    }
    if marked > 0u {
        atomicAdd(&tally.terminated, marked);
    }
}
