// filter: the field of extinctions, filtered by symmetric weights for sweeps: `across` planes, then `within` planes
// along rows and columns. An invocation a voxel of the planes with their zeros.
// uses: common/sweep

@group(0) @binding(0) var<uniform> sweep: Sweep;
// The middle one first.
@group(0) @binding(1) var<storage, read> weights: array<f32>;
// The field, or planes that are filtered across.
@group(0) @binding(2) var<storage, read> values: array<f32>;
@group(0) @binding(3) var<storage, read_write> planes: array<f32>;

@compute @workgroup_size(LANES)
fn across(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let size = padded();
    // Column, plane, and row.
    let id = vec3u(column_and_plane(group, lane), group.z);
    if id.x >= size.y || id.y >= sweep.filtered || id.z >= size.x {
        return;
    }
    // Places before the first wrap around to large numbers.
    let row = id.z - ENDS;
    let column = id.x - ENDS;
    let number = i32(sweep.first + id.y) - i32(sweep.before);
    let reach = i32(arrayLength(&weights)) - 1;
    var sum = 0.0;
    if row < sweep.dims.y && column < sweep.dims.z {
        for (var offset = -reach; offset <= reach; offset++) {
            let source = u32(number + offset);
            if source < sweep.dims.x {
                sum += weights[abs(offset)] * values[in_field(source, row, column)];
            }
        }
    }
    planes[in_plane(id.y, id.z, id.x)] = sum;
}

@compute @workgroup_size(32, 2)
fn within(@builtin(global_invocation_id) id: vec3u) {
    let size = padded();
    if id.x >= size.y || id.y >= size.x {
        return;
    }
    let reach = i32(arrayLength(&weights)) - 1;
    var sum = 0.0;
    for (var down = -reach; down <= reach; down++) {
        let row = u32(i32(id.y) + down);
        if row >= size.x {
            continue;
        }
        var of_row = 0.0;
        for (var right = -reach; right <= reach; right++) {
            let column = u32(i32(id.x) + right);
            if column < size.y {
                of_row += weights[abs(right)] * values[in_plane(id.z, row, column)];
            }
        }
        sum += weights[abs(down)] * of_row;
    }
    planes[in_plane(id.z, id.y, id.x)] = sum;
}
