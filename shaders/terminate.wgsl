// terminate: early splat termination (Mueller, Shareef, Huang and Crawfis 1999, "High-quality splatting on rectilinear
// grids with efficient culling of occluded voxels"). `tile` takes the least optical depth of each tile of the frame and
// `raise` that of blocks of tiles, levels of a pyramid; `group` looks for bricks whose bounds lie in opaque tiles alone,
// and `mark` marks the entries of a batch that are in such bricks or have such bounds themselves. A pixel that lets through
// the fraction e of light can change by no more than e, whatever comes behind.

// Entries of one invocation.
const RUN: u32 = 16u;
// The most tiles of a level along a side that bounds are held against: larger ones are held against the next level, and
// over more tiles of the last level than this not at all.
const MAX_SPAN: u32 = 8u;
// Levels of the pyramid above the tiles, each with blocks of STEP times as many tiles along a side as the one below.
const LEVELS: u32 = 2u;
const STEP: u32 = 4u;

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
    // Bricks found hidden so far.
    bricks: atomic<u32>,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> terminate: Terminate;
@group(0) @binding(2) var<storage, read> pixels: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> tiles: array<f32>;
@group(0) @binding(4) var<storage, read> splats: array<vec2u>;
@group(0) @binding(5) var<storage, read_write> entries: array<u32>;
@group(0) @binding(6) var<storage, read_write> tally: Tally;
@group(0) @binding(7) var<storage, read> origins: array<vec4u>;
// Of each brick, whether it is hidden: 1 or 0.
@group(0) @binding(8) var<storage, read_write> hidden: array<u32>;

// A level of the pyramid: the place of its first tile, and tiles across and down.
struct Level {
    first: u32,
    size: vec2u,
}

fn tiles_of_frame() -> Level {
    return Level(0u, (frame.region + frame.tile_size - 1u) / frame.tile_size);
}

fn above(level: Level) -> Level {
    return Level(level.first + level.size.x * level.size.y, (level.size + STEP - 1u) / STEP);
}

@compute @workgroup_size(WORKGROUP)
fn tile(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    let level = tiles_of_frame();
    if index >= level.size.x * level.size.y {
        return;
    }
    // Opaque stays opaque.
    if tiles[index] >= frame.opaque_depth {
        return;
    }
    let corner = vec2u(index % level.size.x, index / level.size.x) * frame.tile_size;
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

// Both levels from the tiles themselves, so that one dispatch does for them.
@compute @workgroup_size(WORKGROUP)
fn raise(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    var index = invocation_index(id, groups);
    let base = tiles_of_frame();
    var level = base;
    var side = 1u;
    for (var i = 0u; i < LEVELS; i++) {
        level = above(level);
        side *= STEP;
        let count = level.size.x * level.size.y;
        if index < count {
            let place = level.first + index;
            if tiles[place] >= frame.opaque_depth {
                return;
            }
            let corner = vec2u(index % level.size.x, index / level.size.x) * side;
            let end = min(corner + side, base.size);
            for (var y = corner.y; y < end.y; y++) {
                for (var x = corner.x; x < end.x; x++) {
                    if tiles[y * base.size.x + x] < frame.opaque_depth {
                        return;
                    }
                }
            }
            tiles[place] = frame.opaque_depth;
            return;
        }
        index -= count;
    }
}

// Whether all pixels within bounds, as (middle, half extent) in plane coordinates, and those beside them, are opaque.
fn is_hidden(box: vec4f) -> bool {
    let middle = (box.xy - frame.pixel_offset) / frame.pixel_scale;
    let half = box.zw / abs(frame.pixel_scale) + 1.5 + terminate.margin;
    // Clamped as floats: bounds may lie far outside the region.
    let last = vec2f(frame.region - 1u);
    let from_pixel = vec2u(clamp(middle - half, vec2f(0.0), last));
    let to_pixel = vec2u(clamp(middle + half, vec2f(0.0), last));
    var level = tiles_of_frame();
    var low = from_pixel / frame.tile_size;
    var high = to_pixel / frame.tile_size;
    for (var i = 0u; i < LEVELS; i++) {
        if any(high - low >= vec2u(MAX_SPAN)) {
            level = above(level);
            low /= STEP;
            high /= STEP;
        }
    }
    if any(high - low >= vec2u(MAX_SPAN)) {
        return false;
    }
    for (var y = low.y; y <= high.y; y++) {
        for (var x = low.x; x <= high.x; x++) {
            if tiles[level.first + y * level.size.x + x] < frame.opaque_depth {
                return false;
            }
        }
    }
    return true;
}

// Half the distance of the first and the last voxel of a brick.
const HALF_BRICK: f32 = 15.5;

// How far the kernels of a brick, of that radius, reach from its middle along a view coordinate of that gradient.
fn brick_extent(axis: vec3f, radius: f32) -> f32 {
    return HALF_BRICK * dot(abs(axis), vec3f(1.0)) + radius * length(axis);
}

@compute @workgroup_size(WORKGROUP)
fn group(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let brick = invocation_index(id, groups);
    if brick >= arrayLength(&origins) || atomicLoad(&tally.opaque_tiles) == 0u || hidden[brick] != 0u {
        return;
    }
    let center = view_center(vec3f(origins[brick].xyz) + HALF_BRICK);
    let z = center.z + frame.eye_depth;
    let far = center.z + HALF_BRICK * dot(abs(frame.view_z), vec3f(1.0));
    let radius = frame.radius * growth_at(far);
    let half = vec3f(
        brick_extent(frame.view_x, radius),
        brick_extent(frame.view_y, radius),
        brick_extent(frame.view_z, radius),
    );
    var low = center.xy - half.xy;
    var high = center.xy + half.xy;
    if PERSPECTIVE {
        if z <= 1.001 * half.z {
            return;
        }
        low = min(low / (z - half.z), low / (z + half.z));
        high = max(high / (z - half.z), high / (z + half.z));
    }
    if is_hidden(vec4f((low + high) * 0.5, (high - low) * 0.5)) {
        hidden[brick] = 1u;
        atomicAdd(&tally.bricks, 1u);
    }
}

fn in_hidden_brick_or_hidden(index: u32) -> bool {
    let words = splat_words(index);
    if hidden[splat_brick(words)] != 0u {
        return true;
    }
    let center = view_center(splat_lattice(words));
    let growth = growth_at(center.z);
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
        if in_hidden_brick_or_hidden(entry) {
            entries[terminate.first + i] = entry | TERMINATED;
            marked += 1u;
        }
    }
    if marked > 0u {
        atomicAdd(&tally.terminated, marked);
    }
}
