// sweep: the light along some directions that go together. `march` adds up filtered planes along the rays of each
// direction and stores the sums at the places of each plane, `arrive` reads them at voxels and adds the neighbours.
//
// Rays pass through places of a lattice of their own, which is sheared along their direction. A plane stores the sums
// of its own rays: those from a place before its first row and column to two after its last. Rays outside have passed
// nothing yet, or reach no voxel any more.
// uses: common/rays_of_sweep

@group(0) @binding(0) var<uniform> sweep: Sweep;
// For each plane and each direction, the place of the first row among the rays, its whole part and the bits of its
// fraction, and the place of the first column.
@group(0) @binding(1) var<storage, read> places: array<vec4i>;

// The filtered planes of the part, the sums at the last plane of the part before, and the sums, the last plane first.
@group(0) @binding(2) var<storage, read> planes: array<f32>;
@group(0) @binding(3) var<storage, read> carried: array<f32>;
@group(0) @binding(4) var<storage, read_write> sums: array<f32>;

@group(0) @binding(2) var<storage, read> field: array<f32>;
@group(0) @binding(3) var<storage, read> arrived: array<f32>;
@group(0) @binding(4) var<storage, read_write> shares: array<u32>;
// Neighbours: planes towards the light, rows, the first column and the number of weights.
@group(0) @binding(5) var<storage, read> stencil: array<vec4i>;
@group(0) @binding(6) var<storage, read> weights: array<f32>;
// For each direction the factor of sums of planes, the factor of all, and the light that an unshadowed voxel gets.
@group(0) @binding(7) var<storage, read> factors: array<vec4f>;

fn place_of(number: u32, direction: u32) -> vec4i {
    return places[number * sweep.directions + direction];
}

// The fractions of a place.
fn fraction(place: vec4i) -> vec2f {
    return bitcast<vec2f>(place.yw);
}

// Whether a plane stores a ray at this place, counted from a place before its first row and column.
fn is_stored(at: vec2i) -> bool {
    return all(at >= vec2i(0)) && all(at < vec2i(sweep.dims.yz) + 3);
}

@compute @workgroup_size(32, 2)
fn march(@builtin(global_invocation_id) id: vec3u) {
    let direction = id.z;
    let begin = place_of(sweep.first, direction).xz;
    let end = place_of(sweep.first + sweep.count - 1u, direction).xz;
    let ray = vec2i(id.yx) + min(begin, end) - 1;
    if any(ray > max(begin, end) + vec2i(sweep.dims.yz) + 1) {
        return;
    }
    var sum = 0.0;
    if sweep.first > 0u {
        let at = ray - place_of(sweep.first - 1u, direction).xz + 1;
        if is_stored(at) {
            sum = carried[in_rays(direction, u32(at.x), u32(at.y))];
        }
    }
    for (var plane = 0u; plane < sweep.count; plane++) {
        let number = sweep.first + plane;
        if number >= sweep.before {
            // The ray lies fractions before a row and a column.
            let place = place_of(number - sweep.before, direction);
            let above = fraction(place) > vec2f(0.5);
            let nearest = ray - place.xz - select(vec2i(0), vec2i(1), above);
            sum += plane_at(plane, nearest, select(vec2f(0.0), vec2f(1.0), above) - fraction(place));
        }
        let at = ray - place_of(number, direction).xz + 1;
        if is_stored(at) {
            let slot = (sweep.count - 1u - plane) * sweep.directions + direction;
            sums[in_rays(slot, u32(at.x), u32(at.y))] = sum;
        }
    }
}

@compute @workgroup_size(LANES)
fn arrive(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
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
    var near = 0.0;
    var is_found = false;
    var light = 0.0;
    for (var direction = 0u; direction < sweep.directions; direction++) {
        let slot = (sweep.count - 1u - id.y) * sweep.directions + direction;
        let factor = factors[direction];
        let beyond = fraction(place_of(voxel.x, direction));
        let far = factor.x * sum_at(in_rays(slot, voxel.y, voxel.z), beyond);
        if !is_found && far * factor.y < FAINT {
            near = neighbours(voxel, vec2u(0u, arrayLength(&stencil)), 0u, 1);
            is_found = true;
        }
        light += factor.z * transmitted((far + near) * factor.y);
    }
    shares[at] = shares[at] * sweep.adds + u32(light + 0.5);
}
