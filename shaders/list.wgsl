// list: visible voxels as splats, for the painter `quads`. An invocation for each voxel of some bricks.
// uses: common/arriving, common/dispatch, common/sampled

struct List {
    // The first brick of the list among those of the buffer of samples, and its first splat among the visible voxels.
    first_brick: u32,
    first_splat: u32,
}

// See common/splat.wgsl.
@group(0) @binding(3) var<storage, read_write> splats: array<vec2u>;
@group(0) @binding(4) var<uniform> list: List;

@compute @workgroup_size(WORKGROUP)
fn splats_of_voxels(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    let row = row_of_voxel(index);
    let x = index % EDGE;
    if index >= classify.bricks * EDGE * EDGE * EDGE || !is_seen(row, x) {
        return;
    }
    let number = number_of(row, x);
    let appearance = appearance_of(brick_voxel(index));
    let first = select(2u, 3u, SHADOWS) * (number - list.first_splat);
    let brick = row / (EDGE * EDGE) - list.first_brick;
    splats[first] = vec2u(splat_place(x, row % EDGE, row / EDGE % EDGE, brick), appearance.x);
    var normal = 0u;
    if LIT {
        normal = packed_normal(number, sample_of(row, x));
    }
    splats[first + 1u] = vec2u(appearance.y, normal);
    if SHADOWS {
        splats[first + 2u] = kept[number];
    }
}
