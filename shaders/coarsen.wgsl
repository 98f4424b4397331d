// coarsen: weighted sums along an axis, from voxels to cells. Each invocation makes a sum; sums along one axis after
// the other are cells.
// uses: common/dispatch

struct Coarsen {
    // Sums along each axis.
    dims: vec3u,
    // The values that a sum is of.
    taps: u32,
    // The places in `values` between the first values of sums that are neighbours along each axis; 0 along `axis`.
    steps: vec3u,
    // The places between the values of a sum.
    stride: u32,
    // The place of the first sum in `sums`.
    first: u32,
    // The axis that is summed along.
    axis: u32,
    // Values between neighbouring sums along it, as a fraction in lowest terms. Sum number c begins that many whole
    // values behind the first. As many sums as the divisor have weights of their own.
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
    let number = place[coarsen.axis];
    let steps = place * coarsen.steps;
    var at = steps.x + steps.y + steps.z + number * coarsen.over / coarsen.under * coarsen.stride;
    let own = number % coarsen.under * coarsen.taps;
    var sum = vec4f(0.0);
    for (var tap = 0u; tap < coarsen.taps; tap++) {
        sum += weights[own + tap] * values[at];
        at += coarsen.stride;
    }
    sums[coarsen.first + index] = sum;
}
