// converging: the light from a place, on the voxels from which it lies mainly across planes, on one side of it. The
// lattice of the rays is scaled about the place: `march_to_place` adds up filtered planes along the rays,
// `arrive_from_place` reads the sums at voxels and adds the neighbours. Voxels near the place need no sums of planes.
// uses: common/rays_of_sweep

struct Converging {
    // The place, in planes, rows and columns of the box.
    place: vec3f,
    bias: f32,
    // The world vectors of a step to the next plane, row and column, in the unit that extinctions are per.
    to_world_plane: vec3f,
    radius: f32,
    to_world_row: vec3f,
    // Voxels fewer planes than this from the place add up kernels only.
    direct: f32,
    to_world_column: vec3f,
    // The integral of a kernel in units of the divisor, and the inverse of the divisor.
    integral: f32,
    // The row and the column from which places are counted.
    origin: vec2f,
    inverse_divisor: f32,
    // Stencils for slopes from 0 to 1.
    steps: f32,
    // 1: rays that run as much along rows, or columns, as along planes are left to another axis.
    strict: vec2u,
}

@group(0) @binding(0) var<uniform> sweep: Sweep;
@group(0) @binding(1) var<uniform> converging: Converging;
// Two for each plane from the light. The first: the factor by which distances in the plane are distances among rays,
// the row and the column of `origin` among the rays, and the weight of the plane. The second: the distance of rays in
// the plane, and the row and the column of the first ray from `origin`.
@group(0) @binding(2) var<storage, read> places: array<vec4f>;

// The filtered planes of the part, the sums at the last plane of the part before, and the sums, the last plane first.
@group(0) @binding(3) var<storage, read> planes: array<f32>;
@group(0) @binding(4) var<storage, read> carried: array<f32>;
@group(0) @binding(5) var<storage, read_write> sums: array<f32>;

@group(0) @binding(3) var<storage, read> field: array<f32>;
@group(0) @binding(4) var<storage, read> arrived: array<f32>;
@group(0) @binding(5) var<storage, read_write> shares: array<u32>;
// Neighbours: planes towards the light, rows, the first column and the number of weights.
@group(0) @binding(6) var<storage, read> stencil: array<vec4i>;
@group(0) @binding(7) var<storage, read> weights: array<f32>;
// For each slope of rows and of columns, and once more at the end, the first row of its stencil and the first weight.
@group(0) @binding(8) var<storage, read> stencils: array<vec2u>;
// Sections of kernels: rows of coefficients over the squared half chord.
@group(0) @binding(9) var<storage, read> table: array<f32>;

// Sections below this share of the integral of a kernel are faint: FAINT in src/lighting/shadow/response.rs.
const FAINT_SECTION: f32 = 2e-3;
// Rows of the table, and their terms.
const TABLE_ROWS: u32 = 512u;
const TABLE_TERMS: u32 = 12u;

@compute @workgroup_size(32, 2)
fn march_to_place(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= sweep.rays.y || id.y >= sweep.rays.x {
        return;
    }
    var sum = carried[in_rays(0u, id.y, id.x)];
    for (var plane = 0u; plane < sweep.count; plane++) {
        let number = sweep.first + plane;
        if number >= sweep.before {
            let weight = places[2u * (number - sweep.before)].w;
            let back = places[2u * (number - sweep.before) + 1u];
            let at = converging.origin + (back.yz + back.x * vec2f(id.yx));
            let nearest = floor(at + 0.5);
            // Far rays do not pass the box: their places need not be whole numbers that there are.
            let near = clamp(nearest, vec2f(-2.0), vec2f(sweep.dims.yz) + 1.0);
            sum += weight * plane_at(plane, vec2i(near), at - nearest);
        }
        sums[in_rays(sweep.count - 1u - plane, id.y, id.x)] = sum;
    }
}

// The mean of a kernel from the middle of a chord to a place on it: `mean` in src/kernel/footprint.rs.
fn mean_on_chord(s: f32, q: f32) -> f32 {
    let at = s * f32(TABLE_ROWS - 1u);
    let low = min(u32(at), TABLE_ROWS - 2u);
    let part = at - f32(low);
    let first = low * TABLE_TERMS;
    var sum = 0.0;
    for (var term = TABLE_TERMS; term > 0u; term--) {
        let below = table[first + term - 1u];
        sum = sum * q + below + (table[first + TABLE_TERMS + term - 1u] - below) * part;
    }
    return sum;
}

// The section of a kernel at an offset from a voxel along its ray between two distances.
fn section(offset: vec3f, along: vec3f, between: vec2f) -> f32 {
    let middle = dot(offset, along);
    let radius2 = converging.radius * converging.radius;
    let c2 = radius2 - (dot(offset, offset) - middle * middle);
    if c2 <= 0.0 {
        return 0.0;
    }
    let ends = clamp(between - middle, vec2f(-sqrt(c2)), vec2f(sqrt(c2)));
    let s = min(c2 / radius2, 1.0);
    let q = 1.0 - ends * ends / c2;
    return ends.y * mean_on_chord(s, q.y) - ends.x * mean_on_chord(s, q.x);
}

// The sum of the sections of all kernels from a voxel to a place nearby, `path` away.
fn kernels_to_place(voxel: vec3u, path: vec3f) -> f32 {
    let slopes = path.yz / path.x;
    let steep = length(vec3f(1.0, slopes));
    let along = vec3f(1.0, slopes) / steep;
    let last = i32(floor(path.x + converging.radius));
    let wide = converging.radius * steep;
    // Faint sections are left out, and the others make up for them, as in stencils.
    let faint = FAINT_SECTION * converging.integral / converging.inverse_divisor;
    var sum = 0.0;
    var total = 0.0;
    var taken = 0.0;
    for (var plane = -i32(floor(converging.radius)); plane <= last; plane++) {
        let middle = slopes * f32(plane);
        let low = vec2i(ceil(middle - wide));
        let high = vec2i(floor(middle + wide));
        let number = u32(i32(voxel.x) - plane);
        for (var down = low.x; down <= high.x; down++) {
            let row = u32(i32(voxel.y) + down);
            for (var right = low.y; right <= high.y; right++) {
                let column = u32(i32(voxel.z) + right);
                let between = vec2f(converging.bias, path.x * steep);
                let weight = section(vec3f(vec3i(plane, down, right)), along, between);
                total += weight;
                if weight >= faint {
                    taken += weight;
                    if all(vec3u(number, row, column) < sweep.dims) {
                        sum += weight * field[in_field(number, row, column)];
                    }
                }
            }
        }
    }
    return sum * converging.inverse_divisor * total / max(taken, 1e-30);
}

// The neighbours of a voxel towards the place, by the stencil of the nearest slopes.
fn neighbours_towards(voxel: vec3u, slopes: vec2f) -> f32 {
    let steps = u32(converging.steps);
    let number = vec2u(floor(vec2f(abs(slopes.x), slopes.y + 1.0) * converging.steps + 0.5));
    let at = min(number.x, steps) * (2u * steps + 1u) + min(number.y, 2u * steps);
    let rows = vec2u(stencils[at].x, stencils[at + 1u].x);
    return neighbours(voxel, rows, stencils[at].y, select(1, -1, slopes.x < 0.0));
}

@compute @workgroup_size(LANES)
fn arrive_from_place(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    // Column, plane of the part, and row.
    let id = vec3u(column_and_plane(group, lane), group.z);
    if id.x >= sweep.dims.z || id.y >= sweep.count || id.z >= sweep.dims.y {
        return;
    }
    let voxel = vec3u(sweep.first + id.y, id.z, id.x);
    let at = in_field(voxel.x, voxel.y, voxel.z);
    if field[at] <= 0.0 {
        return;
    }
    let is_ahead = sweep.ahead == 1u;
    let plane = select(voxel.x, sweep.dims.x - 1u - voxel.x, is_ahead);
    // The same numbers for all axes, so that each voxel belongs to one of them.
    let away = converging.place - vec3f(vec3u(plane, voxel.yz));
    let path = vec3f(select(-away.x, away.x, is_ahead), away.yz);
    if all(path == vec3f(0.0)) {
        shares[at] = 65535u;
        return;
    }
    let beside = abs(path.yz);
    let is_left = (beside == vec2f(path.x)) & (converging.strict == vec2u(1u));
    if path.x <= 0.0 || any(beside > vec2f(path.x)) || any(is_left) {
        return;
    }
    let slopes = path.yz / path.x;
    let steep = length(vec3f(1.0, slopes));
    let step = select(-1.0, 1.0, is_ahead) * converging.to_world_plane + slopes.x * converging.to_world_row
        + slopes.y * converging.to_world_column;
    let scale = length(step) / steep;
    var depth = 0.0;
    if path.x < converging.direct {
        if path.x * steep > converging.bias {
            depth = scale * kernels_to_place(voxel, path);
        }
    } else {
        let of_plane = places[2u * voxel.x];
        let ray = of_plane.x * (vec2f(voxel.yz) - converging.origin) + of_plane.yz;
        let below = floor(ray);
        let first = vec2u(max(below - 1.0, vec2f(0.0)));
        let sum = sum_at(in_rays(sweep.count - 1u - id.y, first.x, first.y), ray - below);
        depth = scale * steep * converging.integral * sum;
        if depth < FAINT {
            depth += scale * neighbours_towards(voxel, slopes);
        }
    }
    shares[at] = u32(65535.0 * transmitted(depth) + 0.5);
}
