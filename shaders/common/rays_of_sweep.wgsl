// The rays of sweeps: they read `planes`, the filtered planes of a part, and voxels read their sums from `arrived`,
// the neighbours of voxels from `field` with the `weights` of a `stencil`. The stage binds them.
// uses: common/sweep

// The weights of a quadratic B-spline for the nearest point and its neighbours, given the place relative to it.
fn spline(x: f32) -> vec3f {
    return vec3f(0.5 * (0.5 - x) * (0.5 - x), 0.75 - x * x, 0.5 * (0.5 + x) * (0.5 + x));
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

// A filtered plane at a place between its rows and columns: the nearest ones, and the distance from them.
fn plane_at(plane: u32, nearest: vec2i, distance: vec2f) -> f32 {
    if any(nearest < vec2i(-1)) || any(nearest > vec2i(sweep.dims.yz)) {
        return 0.0;
    }
    let down = spline(distance.x);
    let right = spline(distance.y);
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

fn four_sums(at: u32) -> vec4f {
    return vec4f(arrived[at], arrived[at + 1u], arrived[at + 2u], arrived[at + 3u]);
}

// The sum of planes between rays: `at` is the first of 4 x 4, the place lies so far beyond the second.
fn sum_at(at: u32, beyond: vec2f) -> f32 {
    let right = catmull_rom(beyond.y);
    let pitch = sweep.rays.y;
    let across = vec4f(
        dot(right, four_sums(at)),
        dot(right, four_sums(at + pitch)),
        dot(right, four_sums(at + 2u * pitch)),
        dot(right, four_sums(at + 3u * pitch)),
    );
    return max(dot(catmull_rom(beyond.x), across), 0.0);
}

// The weighted neighbours of a voxel (plane from the light, row, column), by some rows of stencils with weights from
// `first` on. `down` is -1 if rows are counted the other way.
fn neighbours(voxel: vec3u, rows: vec2u, first_weight: u32, down: i32) -> f32 {
    var sum = 0.0;
    var first = first_weight;
    for (var i = rows.x; i < rows.y; i++) {
        let of_row = stencil[i];
        let count = u32(of_row.w);
        // Towards the light numbers fall. Places outside wrap around to large numbers.
        let source = vec2u(vec2i(voxel.xy) + vec2i(-of_row.x, down * of_row.y));
        if all(source < sweep.dims.xy) {
            let left = u32(i32(voxel.z) + of_row.z);
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
