// skip: for each tile of 8 x 8 rays of the painter `tiles`, the runs of voxel planes in which its rays can meet used
// voxels; of scalars, the runs of planes in which its rays pass marked cells. Planes are tested four at a time, of
// scalars two at a time, against the marks of macrocells.
// uses: common/packing, common/rays

@group(0) @binding(0) var<uniform> uniform_rays: Rays;
// The marks of macrocells: see common/packing.wgsl.
@group(0) @binding(1) var<storage, read> marks: array<u32>;
// Runs as (first plane, plane after the last), counted from the first plane of the first macrocells, at
// run_index(tile, slot); (0, 0) ends the list of a tile.
@group(0) @binding(2) var<storage, read_write> runs: array<vec2u>;

// Voxels are scalars.
override SCALARS: bool = false;

// Planes that are tested together, a slab.
fn slab_planes() -> i32 {
    return select(MACROCELL, CELL, SCALARS);
}

// The rays at the corners of a tile, as lines through the planes.
struct Corners {
    bases: array<vec2f, 4>,
    shears: array<vec2f, 4>,
    // The largest distance along a and b at which a kernel reaches one of them.
    footprint_half: vec2f,
    // Whether the rays between the corners stay between them.
    bounded: bool,
}

// Whether a marked cell of a slab lies where a ray of the tile can meet kernels; of scalars, where a ray can pass.
fn is_occupied(corners: ptr<function, Corners>, slab: u32) -> bool {
    let first = i32(slab) * slab_planes() - rays.lead;
    if first < rays.unskipped || !(*corners).bounded {
        return true;
    }
    // The rectangle around the corners in all these planes: rays are straight, so the first and the last plane suffice.
    // The initial values are beyond every place, but not infinite.
    var low = vec2f(3e38);
    var high = vec2f(-3e38);
    for (var i = 0u; i < 4u; i++) {
        let at_first = (*corners).bases[i] + (*corners).shears[i] * f32(first);
        let at_last = (*corners).bases[i] + (*corners).shears[i] * f32(first + slab_planes() - 1);
        low = min(low, min(at_first, at_last));
        high = max(high, max(at_first, at_last));
    }
    var a = vec2i(ceil(low - (*corners).footprint_half));
    var b = vec2i(floor(high + (*corners).footprint_half));
    if SCALARS {
        // `is_marked` of gather_scalars.wgsl rounds places, which may differ by rounding.
        a = vec2i(floor(low + 0.49));
        b = vec2i(floor(high + 0.51));
    }
    a = max(a + rays.mark_shift.xy, vec2i(0));
    b = min(b + rays.mark_shift.xy, rays.macrocells.xy * MACROCELL - 1);
    if any(a > b) {
        return false;
    }
    let plane = i32(slab) * slab_planes();
    let z = select(plane, rays.macrocells.z * MACROCELL - slab_planes() - plane, rays.flipped == 1);
    let in_slab = cells_between(z, z + slab_planes() - 1, z / MACROCELL, rays.mark_bits.z) & 0xffu;
    for (var y = a.y / MACROCELL; y <= b.y / MACROCELL; y++) {
        let in_row = in_slab & cells_between(a.y, b.y, y, rays.mark_bits.y);
        for (var x = a.x / MACROCELL; x <= b.x / MACROCELL; x++) {
            let at = marks_at(vec3i(x, y, z / MACROCELL));
            if ((marks[at.x] >> at.y) & in_row & cells_between(a.x, b.x, x, rays.mark_bits.x)) != 0u {
                return true;
            }
        }
    }
    return false;
}

// The cells of macrocell number `number` along an axis in which there are voxels between two, as bits of marks. `axis`
// is the bit of a cell that is not the first along the axis.
fn cells_between(first: i32, last: i32, number: i32, axis: u32) -> u32 {
    let start = number * MACROCELL;
    let behind = select(0xf0u, select(0xccu, 0xaau, axis == 1u), axis < 4u);
    return select(0u, ~behind, first < start + CELL) | select(0u, behind, last >= start + CELL);
}

fn is_wanted(tile: vec3u) -> bool {
    return all(tile.xy >= rays.clip_low) && all(tile.xy < rays.clip_high);
}

// The slabs of a tile that are marked by the invocations of a workgroup, a bit each: a volume has at most 2048
// macrocells along an axis, and a macrocell two slabs.
var<workgroup> marked: array<atomic<u32>, 128>;

// A workgroup for each tile, whose invocations test slabs of macrocells side by side: there are fewer tiles than a GPU
// runs invocations at a time.
@compute @workgroup_size(64)
fn skip(@builtin(workgroup_id) tile: vec3u, @builtin(local_invocation_index) lane: u32) {
    rays = uniform_rays;
    atomicStore(&marked[lane], 0u);
    atomicStore(&marked[lane + 64u], 0u);
    workgroupBarrier();
    let slabs = slab_count();
    if is_wanted(tile) {
        var corners = corners_of(tile);
        for (var slab = lane; slab < slabs; slab += 64u) {
            if is_occupied(&corners, slab) {
                atomicOr(&marked[slab / 32u], 1u << (slab % 32u));
            }
        }
    }
    workgroupBarrier();
    if lane > 0u {
        return;
    }
    // No slab is marked in a tile that is not wanted.
    var list = RunList();
    for (var slab = 0u; slab < slabs; slab++) {
        if (atomicLoad(&marked[slab / 32u]) & (1u << (slab % 32u))) != 0u {
            add_slab(&list, tile, slab);
        }
    }
    end_list(&list, tile);
}

// Slabs along m, from the size of the buffer: Mesa 22 compiles and leaks a shader for each value of a loop's end that
// depends on uniforms alone.
fn slab_count() -> u32 {
    let layer = u32(max(rays.macrocells.x * rays.macrocells.y, 1));
    // The last word may have room for up to three macrocells more than there are, and a layer has at least four.
    return 4u * arrayLength(&marks) / layer * u32(MACROCELL / slab_planes());
}

fn corners_of(tile: vec3u) -> Corners {
    let low = tile.xy * 8u;
    let high = low + 7u;
    let points = array<vec2u, 4>(low, high, vec2u(high.x, low.y), vec2u(low.x, high.y));
    var corners: Corners;
    corners.footprint_half = rays.footprint_half;
    corners.bounded = true;
    for (var i = 0u; i < 4u; i++) {
        let line = line_of(points[i]);
        // Here voxels are numbered from the first of the packed volume.
        corners.bases[i] = line.base + line.shear * f32(rays.first.z) - vec2f(rays.first.xy);
        corners.shears[i] = line.shear;
        if PERSPECTIVE {
            let half = rays.growth_most * footprint_half_of(line.shear);
            corners.footprint_half = max(corners.footprint_half, half);
            // Corners bound the rays between them if all four run along m, so that no shear between them is infinite. A
            // ray that is marched has a cosine to m of at least 1 / sqrt(3) = 0.58; at 0.2 shears are below 5.
            corners.bounded = corners.bounded && line.heading.z > 0.2 * length(line.heading);
        }
    }
    return corners;
}

// The runs of a tile so far: the number of those that are listed, and the run from plane `start` to before plane `end`;
// none yet if `end` is 0.
struct RunList {
    slot: u32,
    start: i32,
    end: i32,
}

// Adds an occupied slab. A gap of one macrocell does not end a run of colours: the slab next to a run
// shapes the curve in its last slab.
fn add_slab(list: ptr<function, RunList>, tile: vec3u, slab: u32) {
    let first = i32(slab) * slab_planes();
    if (*list).end == 0 {
        (*list).start = first;
    } else if first > (*list).end + select(MACROCELL, 0, SCALARS) {
        list_run(list, tile);
        (*list).start = first;
    }
    (*list).end = first + slab_planes();
}

fn list_run(list: ptr<function, RunList>, tile: vec3u) {
    runs[run_index(tile, (*list).slot)] = vec2u(u32((*list).start), u32((*list).end));
    (*list).slot++;
}

fn end_list(list: ptr<function, RunList>, tile: vec3u) {
    if (*list).end > 0 {
        list_run(list, tile);
    }
    runs[run_index(tile, (*list).slot)] = vec2u(0u);
}
