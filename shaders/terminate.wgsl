// terminate: early splat termination (Mueller, Shareef, Huang and Crawfis 1999, "High-quality splatting on rectilinear
// grids with efficient culling of occluded voxels"). `tile` takes the least optical depth of each tile of the frame;
// `mark` marks the entries of a batch whose bounds lie in opaque tiles alone. A pixel that lets through the fraction e
// of light can change by no more than e, whatever comes behind.

// Entries of one invocation.
const RUN: u32 = 16u;
// A splat over more tiles than this along a side is not looked at.
const MAX_SPAN: i32 = 16;

struct Terminate {
    // The batch's entries.
    first: u32,
    count: u32,
    // Pixels beside a splat whose shading its scalars take part in.
    margin: f32,
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

@compute @workgroup_size(WORKGROUP)
fn tile(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if index >= arrayLength(&tiles) {
        return;
    }
    // Opaque stays opaque.
    if tiles[index] >= frame.opaque_depth {
        return;
    }
    let corner = vec2u(index % frame.tiles, index / frame.tiles) * frame.tile_size;
    let end = min(corner + frame.tile_size, frame.region);
    var least = frame.opaque_depth;
    for (var y = corner.y; y < end.y; y++) {
        for (var x = corner.x; x < end.x; x++) {
            least = min(least, pixels[y * frame.region.x + x].a);
        }
        // One clear pixel settles it.
        if least < frame.opaque_depth {
            return;
        }
    }
    tiles[index] = least;
    atomicOr(&tally.opaque_tiles, 1u);
}

// Whether all pixels that a splat can touch, and those beside them, are opaque.
fn is_hidden(index: u32) -> bool {
    let center = view_center(splat_lattice(splat_words(index)));
    let growth = growth_at(center.z);
    if !bounded(center, growth) {
        return false;
    }
    let box = bounds(center, growth);
    let middle = (box.xy - frame.pixel_offset) / frame.pixel_scale;
    let half = box.zw / abs(frame.pixel_scale) + 1.5 + terminate.margin;
    let size = f32(frame.tile_size);
    let last = vec2i((frame.region - 1u) / frame.tile_size);
    // Clamped as floats: a splat may lie far outside the region.
    let low = vec2i(clamp(floor((middle - half) / size), vec2f(0.0), vec2f(last)));
    let high = vec2i(clamp(floor((middle + half) / size), vec2f(0.0), vec2f(last)));
    if any(high - low >= vec2i(MAX_SPAN)) {
        return false;
    }
    for (var y = low.y; y <= high.y; y++) {
        for (var x = low.x; x <= high.x; x++) {
            if tiles[u32(y) * frame.tiles + u32(x)] < frame.opaque_depth {
                return false;
            }
        }
    }
    return true;
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
        if is_hidden(entry) {
            entries[terminate.first + i] = entry | TERMINATED;
            marked += 1u;
        }
    }
    if marked > 0u {
        atomicAdd(&tally.terminated, marked);
    }
}
