// scalar_sums: sums along an axis of sums of scalars along others. An invocation makes a sum.
// uses: common/dispatch, common/scalar_sums

@group(0) @binding(0) var<uniform> along: ScalarSums;
@group(0) @binding(1) var<storage, read> values: array<f32>;
// For as many cells as the divisor of the values along a cell.
@group(0) @binding(2) var<storage, read> weights: array<f32>;
// x fastest.
@group(0) @binding(3) var<storage, read_write> sums: array<f32>;

fn value_at(i: u32) -> Sum {
    if RANGES {
        return Sum(values[3u * i], values[3u * i + 1u], values[3u * i + 2u]);
    }
    return Sum(values[i], 0.0, 0.0);
}

@compute @workgroup_size(WORKGROUP)
fn along_axis(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if index >= along.dims.x * along.dims.y * along.dims.z {
        return;
    }
    let row = index / along.dims.x;
    let place = vec3u(index % along.dims.x, row % along.dims.y, row / along.dims.y);
    let other = dot(place * (1u - along.axis), along.steps);
    let step = dot(along.axis, along.steps);
    let number = dot(place, along.axis);
    let low = along.low + i32(number * along.over / along.under);
    let taps = i32(arrayLength(&weights) / along.under);
    let own = i32(number % along.under) * taps;
    var sum = NO_SUM;
    for (var at = low; at < low + taps; at++) {
        let value = value_at(other + step * u32(clamp(at, 0, i32(along.count) - 1)));
        let in_block = at - low >= along.first_in_block && at - low < along.end_of_block;
        sum = with_value(sum, weights[own + at - low], value, in_block);
    }
    keep(index, sum);
}
