// cell_rows: sums along x of the scalars of voxels, which are found of samples on the way. An invocation makes a sum.
// scalar_sums.wgsl sums along y and z.
// uses: common/dispatch, common/scalar_sums, common/scalars

@group(0) @binding(2) var<uniform> rows: ScalarSums;
// For as many cells as the divisor of the voxels along a cell.
@group(0) @binding(3) var<storage, read> weights: array<f32>;
// x fastest.
@group(0) @binding(4) var<storage, read_write> sums: array<f32>;

@compute @workgroup_size(WORKGROUP)
fn along_x(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if index >= rows.dims.x * rows.dims.y * rows.dims.z {
        return;
    }
    let number = index % rows.dims.x;
    let row = index / rows.dims.x;
    let y = rows.first_y + row % rows.dims.y;
    let z = rows.first_z + row / rows.dims.y;
    if !is_bound(brick_of(vec3u(0u, y, z))) {
        return;
    }
    let low = rows.low + i32(number * rows.over / rows.under);
    let taps = i32(arrayLength(&weights) / rows.under);
    let own = i32(number % rows.under) * taps;
    var sum = NO_SUM;
    for (var x = low; x < low + taps; x++) {
        let voxel = vec3u(u32(clamp(x, 0, i32(scalars.dims.x) - 1)), y, z);
        let scalar = scalar_at(sample_number(brick_of(voxel), voxel));
        let in_block = x - low >= rows.first_in_block && x - low < rows.end_of_block;
        sum = with_value(sum, weights[own + x - low], Sum(scalar, scalar, scalar), in_block);
    }
    keep(index, sum);
}
