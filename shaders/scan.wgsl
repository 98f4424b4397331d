// scan: exclusive prefix sums, one level at a time. `reduce` sums each block of RUN values. After these sums have been
// scanned in the same way, `spread` replaces each value by the sum of all values before it.
// uses: common/dispatch

// Values that one invocation sums; see RUN in src/gpu/scan.rs.
const RUN: u32 = 128u;

@group(0) @binding(0) var<storage, read_write> values: array<u32>;
@group(0) @binding(1) var<storage, read_write> sums: array<u32>;

@compute @workgroup_size(WORKGROUP)
fn reduce(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let block = invocation_index(id, groups);
    if block >= arrayLength(&sums) {
        return;
    }
    var sum = 0u;
    for (var i = block * RUN; i < min((block + 1u) * RUN, arrayLength(&values)); i++) {
        sum += values[i];
    }
    sums[block] = sum;
}

@compute @workgroup_size(WORKGROUP)
fn spread(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let block = invocation_index(id, groups);
    if block >= arrayLength(&sums) {
        return;
    }
    var sum = sums[block];
    for (var i = block * RUN; i < min((block + 1u) * RUN, arrayLength(&values)); i++) {
        let value = values[i];
        values[i] = sum;
        sum += value;
    }
}
