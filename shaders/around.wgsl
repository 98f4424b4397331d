// around: ambient occlusion, from the extinctions along the rays of each voxel to its 26 neighbours, at the lattice
// points that they pass. An invocation a voxel.
// uses: common/sweep

@group(0) @binding(0) var<uniform> sweep: Sweep;
@group(0) @binding(1) var<storage, read> field: array<f32>;
@group(0) @binding(2) var<storage, read> planes: array<f32>;
// For each ray the step to its next point, columns, rows and planes, and the number of points.
@group(0) @binding(3) var<storage, read> rays: array<vec4i>;
// For each ray the factor of its light.
@group(0) @binding(4) var<storage, read> factors: array<f32>;
// The weights of the points, ray after ray.
@group(0) @binding(5) var<storage, read> weights: array<f32>;
@group(0) @binding(6) var<storage, read_write> shares: array<u32>;

@compute @workgroup_size(32, 2)
fn around(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= sweep.dims.z || id.y >= sweep.dims.y {
        return;
    }
    let voxel = vec3i(vec3u(id.x, id.y, sweep.first + id.z));
    let at = in_field(u32(voxel.z), id.y, id.x);
    if field[at] <= 0.0 {
        return;
    }
    var light = 0.0;
    var first = 0u;
    for (var ray = 0u; ray < arrayLength(&rays); ray++) {
        let step = rays[ray];
        var depth = 0.0;
        for (var k = 0; k < step.w; k++) {
            let point = vec3u(voxel + k * step.xyz);
            // A place before the first wraps around to a large number.
            if any(point >= sweep.dims.zyx) {
                break;
            }
            let plane = point.z + sweep.before - sweep.first;
            depth += weights[first + u32(k)] * planes[in_plane(plane, point.y + ENDS, point.x + ENDS)];
        }
        light += factors[ray] * transmitted(depth);
        first += u32(step.w);
    }
    // Half of the surroundings of a point on a plane lie behind the plane.
    shares[at] = u32(min(2.0 * light, 1.0) * 65535.0 + 0.5);
}
