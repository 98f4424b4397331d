// sort: a stable counting sort of splats by batch. A batch is the consecutive sheets that one pass feeds; a splat goes
// into every batch that its kernel reaches. Each invocation owns a block of consecutive splats and one counter for each
// batch. So no atomics are needed, and a batch keeps the order of the splats.
// uses: common/bounds, common/dispatch, common/frame, common/splat

// Sheets are voxel planes (axis-aligned), not slabs.
override AXIS: bool = false;

struct Sort {
    // Number of blocks.
    blocks: u32,
    // Number of batches.
    batches: u32,
    // Sheets of a batch.
    sheets_per_batch: u32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> sort: Sort;
@group(0) @binding(2) var<storage, read> splats: array<vec2u>;
// places[batch * blocks + block]: the number of splats of the block in the batch; after the scan, the place of the
// first of them. One more element at the end becomes the total.
@group(0) @binding(3) var<storage, read_write> places: array<u32>;
// By batch: the place of its first entry; then the total.
@group(0) @binding(4) var<storage, read_write> starts: array<u32>;
// Indices of splats, batch after batch.
@group(0) @binding(5) var<storage, read_write> entries: array<u32>;
@group(0) @binding(6) var<storage, read> origins: array<vec4u>;
// First splat of each block, and the one after its last.
@group(0) @binding(7) var<storage, read> blocks: array<vec2u>;

// The first and the last batch that a splat reaches; first > last if it reaches none.
fn batches_of(index: u32) -> vec2i {
    let words = splat_words(index);
    let lattice = splat_lattice(words);
    let z = dot(frame.view_z, lattice - frame.lattice_center);
    let extent = frame.depth_extent * growth_at(z, splat_level(words));
    let first = floor((z - extent - frame.sheet_origin) * frame.inverse_sheet_step);
    let last = floor((z + extent - frame.sheet_origin) * frame.inverse_sheet_step);
    let n = i32(sort.sheets_per_batch);
    if AXIS {
        // A splat that ends before the first sheet plane adds nothing; through one eye that plane may be the plane of
        // the eye.
        let batch = i32(round(dot(frame.plane_axis, lattice) + frame.plane_offset)) / n;
        return vec2i(batch, select(-1, batch, last >= 0.0));
    }
    if last < 0.0 || first >= f32(frame.sheets) {
        return vec2i(0, -1);
    }
    return vec2i(max(i32(first), 0) / n, min(i32(last), i32(frame.sheets) - 1) / n);
}

@compute @workgroup_size(WORKGROUP)
fn count(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let block = invocation_index(id, groups);
    if block >= sort.blocks {
        return;
    }
    for (var i = blocks[block].x; i < blocks[block].y; i++) {
        let range = batches_of(i);
        for (var batch = range.x; batch <= range.y; batch++) {
            places[u32(batch) * sort.blocks + block] += 1u;
        }
    }
}

// Copies the places where batches start, and the total, before `emit` advances the places.
@compute @workgroup_size(WORKGROUP)
fn mark(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let batch = invocation_index(id, groups);
    if batch <= sort.batches {
        starts[batch] = places[batch * sort.blocks];
    }
}

@compute @workgroup_size(WORKGROUP)
fn emit(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let block = invocation_index(id, groups);
    if block >= sort.blocks {
        return;
    }
    for (var i = blocks[block].x; i < blocks[block].y; i++) {
        let range = batches_of(i);
        for (var batch = range.x; batch <= range.y; batch++) {
            let place = u32(batch) * sort.blocks + block;
            entries[places[place]] = i;
            places[place] += 1u;
        }
    }
}
