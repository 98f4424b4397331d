// coarsen: weighted sums along an axis, on the way from voxels to cells. Each invocation makes a sum; sums along one
// axis after the other are cells. cells.wgsl sums along z.
// uses: common/dispatch

struct Coarsen {
    // Sums along each axis.
    dims: vec3u,
    // The place of the first sum in `sums`.
    first: u32,
    // The places in `values` between values that are neighbours along each axis.
    steps: vec3u,
    // Values along the axis of the sums; beyond them all are 0.
    count: u32,
    // 1 along the axis of the sums.
    axis: vec3u,
    // The value with the first weight in the first sum: below 0 before the first value.
    low: i32,
    // Values between sums, as a fraction in lowest terms: sum number c begins that many whole values behind the first.
    // As many sums as the divisor have weights of their own.
    over: u32,
    under: u32,
}

@group(0) @binding(0) var<uniform> coarsen: Coarsen;
@group(0) @binding(1) var<storage, read> weights: array<f32>;
@group(0) @binding(2) var<storage, read> values: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> sums: array<vec4f>;

@compute @workgroup_size(WORKGROUP)
fn along_axis(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if index >= coarsen.dims.x * coarsen.dims.y * coarsen.dims.z {
        return;
    }
    let row = index / coarsen.dims.x;
    let place = vec3u(index % coarsen.dims.x, row % coarsen.dims.y, row / coarsen.dims.y);
    let others = place * coarsen.steps * (1u - coarsen.axis);
    let step = coarsen.steps * coarsen.axis;
    let along = place * coarsen.axis;
    let number = along.x + along.y + along.z;
    let low = coarsen.low + i32(number * coarsen.over / coarsen.under);
    let taps = arrayLength(&weights) / coarsen.under;
    let own = number % coarsen.under * taps;
    let end = min(i32(taps), i32(coarsen.count) - low);
    var sum = vec4f(0.0);
    for (var tap = max(0, -low); tap < end; tap++) {
        let place = others.x + others.y + others.z + u32(low + tap) * (step.x + step.y + step.z);
        sum += weights[own + u32(tap)] * values[place];
    }
    sums[coarsen.first + index] = sum;
}
