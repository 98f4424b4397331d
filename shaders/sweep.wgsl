// sweep: the light along some directions that go together. `march` adds up filtered planes along the rays of each
// direction and stores the sums at the places of each plane, `arrive` reads them at voxels and adds the neighbours.
//
// Rays pass through places of a lattice of their own, which is sheared along their direction. A plane stores the sums of
// its own rays: those from a place before its first row and column to two after its last. Rays outside have passed
// nothing yet, or reach no voxel any more.
// uses: common/sweep

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

// The depth beyond which neighbours do not count: less than a thousandth of the light arrives.
const FAINT: f32 = 7.0;

fn place_of(number: u32, direction: u32) -> vec4i {
    return places[number * sweep.directions + direction];
}

// The fractions of a place.
fn fraction(place: vec4i) -> vec2f {
    return bitcast<vec2f>(place.yw);
}

// The weights of a quadratic B-spline for the nearest point and its neighbours.
fn spline(x: f32) -> vec3f {
    return vec3f(0.5 * (0.5 - x) * (0.5 - x), 0.75 - x * x, 0.5 * (0.5 + x) * (0.5 + x));
}

// A filtered plane at the place of a ray: this one from its first row and column, less fractions of a voxel.
fn spline_of_plane(plane: u32, ray: vec2i, behind: vec2f) -> f32 {
    let above = behind > vec2f(0.5);
    let nearest = ray - select(vec2i(0), vec2i(1), above);
    if any(nearest < vec2i(-1)) || any(nearest > vec2i(sweep.dims.yz)) {
        return 0.0;
    }
    let x = select(vec2f(0.0), vec2f(1.0), above) - behind;
    let down = spline(x.x);
    let right = spline(x.y);
    // The row and the column before the nearest.
    let corner = vec2u(nearest + i32(ENDS) - 1);
    let pitch = padded().y;
    var at = in_plane(plane, corner.x, corner.y);
    var sum = down.x * dot(right, vec3f(planes[at], planes[at + 1u], planes[at + 2u]));
    at += pitch;
    sum += down.y * dot(right, vec3f(planes[at], planes[at + 1u], planes[at + 2u]));
    at += pitch;
    return sum + down.z * dot(right, vec3f(planes[at], planes[at + 1u], planes[at + 2u]));
}

// Whether a plane stores a ray at this place, counted from a place before its first row and column.
fn is_stored(at: vec2i) -> bool {
    return all(at >= vec2i(0)) && all(at < vec2i(sweep.dims.yz) + 3);
}

@compute @workgroup_size(8, 8)
fn march(@builtin(global_invocation_id) id: vec3u) {
    let direction = id.z;
    let begin = place_of(sweep.first, direction).xz;
    let end = place_of(sweep.first + sweep.count - 1u, direction).xz;
    let ray = vec2i(id.yx) + min(begin, end) - 1;
    if any(ray > max(begin, end) + vec2i(sweep.dims.yz) + 1) {
        return;
    }
    let rows = padded().x;
    var sum = 0.0;
    if sweep.first > 0u {
        let at = ray - place_of(sweep.first - 1u, direction).xz + 1;
        if is_stored(at) {
            sum = carried[in_plane(direction, u32(at.x), u32(at.y))];
        }
    }
    for (var plane = 0u; plane < sweep.count; plane++) {
        let number = sweep.first + plane;
        if number >= sweep.before {
            let place = place_of(number - sweep.before, direction);
            sum += spline_of_plane(plane, ray - place.xz, fraction(place));
        }
        let at = ray - place_of(number, direction).xz + 1;
        if is_stored(at) {
            let slot = (sweep.count - 1u - plane) * sweep.directions + direction;
            sums[in_plane(slot, u32(at.x), u32(at.y))] = sum;
        }
    }
}

// The weights of the Catmull-Rom spline for the two points on either side of a place.
fn catmull_rom(f: f32) -> vec4f {
    let f2 = f * f;
    let f3 = f2 * f;
    return vec4f(
        -0.5 * f + f2 - 0.5 * f3,
        1.0 - 2.5 * f2 + 1.5 * f3,
        0.5 * f + 2.0 * f2 - 1.5 * f3,
        -0.5 * f2 + 0.5 * f3,
    );
}

fn four(at: u32) -> vec4f {
    return vec4f(arrived[at], arrived[at + 1u], arrived[at + 2u], arrived[at + 3u]);
}

// The sum of planes at a voxel.
fn sum_at(slot: u32, row: u32, column: u32, beyond: vec2f) -> f32 {
    let down = catmull_rom(beyond.x);
    let right = catmull_rom(beyond.y);
    let at = in_plane(slot, row, column);
    let pitch = padded().y;
    let across = vec4f(
        dot(right, four(at)),
        dot(right, four(at + pitch)),
        dot(right, four(at + 2u * pitch)),
        dot(right, four(at + 3u * pitch)),
    );
    return max(dot(down, across), 0.0);
}

// The weighted neighbours of a voxel.
fn neighbours(number: u32, row: u32, column: u32) -> f32 {
    var sum = 0.0;
    var first = 0u;
    for (var i = 0u; i < arrayLength(&stencil); i++) {
        let of_row = stencil[i];
        let count = u32(of_row.w);
        // Towards the light numbers fall. Places outside wrap around to large numbers.
        let source = vec2u(vec2i(vec2u(number, row)) + vec2i(-of_row.x, of_row.y));
        if all(source < sweep.dims.xy) {
            let left = u32(i32(column) + of_row.z);
            for (var k = 0u; k < count; k++) {
                if left + k < sweep.dims.z {
                    sum += weights[first + k] * field[in_field(source.x, source.y, left + k)];
                }
            }
        }
        first += count;
    }
    return sum;
}

// Workgroups are columns by planes, see `across` in filter.wgsl.
@compute @workgroup_size(8, 8)
fn arrive(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= sweep.dims.z || id.y >= sweep.count || id.z >= sweep.dims.y {
        return;
    }
    let number = sweep.first + id.y;
    let at = in_field(number, id.z, id.x);
    if field[at] <= 0.0 {
        return;
    }
    var near = 0.0;
    var is_found = false;
    var light = 0.0;
    for (var direction = 0u; direction < sweep.directions; direction++) {
        let slot = (sweep.count - 1u - id.y) * sweep.directions + direction;
        let factor = factors[direction];
        let far = factor.x * sum_at(slot, id.z, id.x, fraction(place_of(number, direction)));
        if !is_found && far * factor.y < FAINT {
            near = neighbours(number, id.z, id.x);
            is_found = true;
        }
        light += factor.z * transmitted((far + near) * factor.y);
    }
    shares[at] = shares[at] * sweep.adds + u32(light + 0.5);
}
