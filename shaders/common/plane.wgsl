// The sums over one voxel plane along a ray of the painter `tiles`.
// uses: common/box, common/packing, common/ray_geometry

// Terms of the footprint's polynomial: 6 or 8.
override TERMS: u32 = 6u;
// Texels that are read of a row of voxels, two voxels each. The first voxel may lie one before the kernels that reach
// the ray, because a texel begins at an even one: n texels do if kernels reach less than n - 1/2 voxels along the row.
// 3 to 7.
override TEXELS: u32 = 3u;
// Kernels have grown in proportion to their depth before the eye.
override GROWN: bool = false;
// Rays run along m and meet every plane at the same place: footprints are evaluated once for all planes.
override STRAIGHT: bool = false;

// The kernel's integral along a ray that passes its centre at a squared distance; lengths in voxels.
fn footprint(square: f32) -> f32 {
    let c2 = max(rays.radius2 - square, 0.0);
    let f = rays.footprint;
    let g = rays.footprint_high;
    var high = g.y * c2 + g.x;
    if TERMS > 6u {
        high += (g.w * c2 + g.z) * c2 * c2;
    }
    return sqrt(c2) * ((((high * c2 + f.w) * c2 + f.z) * c2 + f.y) * c2 + f.x);
}

// The factors of the powers in footprint_before(): 1 / ((2 k + 1) times the unit of J(k)).
const FACTORS = array<f32, 8>(1.0, 1.0 / 2.0, 3.0 / 8.0, 5.0 / 16.0, 35.0 / 128.0, 63.0 / 256.0, 231.0 / 1024.0,
    429.0 / 2048.0);

// The part of that integral before a place `t` on the ray, from the point that is nearest to the centre.
//
// With c the half chord, the integral of (c^2 - u^2)^k over u from 0 to t is one of the power k - 1 by parts. The
// kernel is the polynomial in c^2 - u^2 whose footprint is footprint(). So its integrals J have the factors of the
// footprint's powers, in units of the integrals over the half chord for c = 1: J(0) = t, J(k) = c^2
// J(k - 1) + t (c^2 - t^2)^k / ((2 k + 1) times that unit).
fn footprint_before(square: f32, t: f32) -> f32 {
    let c2 = max(rays.radius2 - square, 0.0);
    let c = sqrt(c2);
    let p = clamp(t, -c, c);
    let y = max(c2 - p * p, 0.0);
    let f = rays.footprint;
    let g = rays.footprint_high;
    let a = array<f32, 8>(f.x, f.y, f.z, f.w, g.x, g.y, g.z, g.w);
    var power = p;
    var j = 0.0;
    var sum = 0.0;
    if #u < TERMS { j = c2 * j + power * FACTORS[#]; sum += a[#] * j; power *= y; }
    return 0.5 * (footprint(square) + sum);
}

// The part of the footprint of the voxel at (du, dv) from where a ray meets its plane that lies before a place along
// the ray from there; see weights() for the other parameters.
fn weight_before(du: f32, dv: f32, place: f32, direction: vec2f, growth: f32) -> f32 {
    let s = du * direction.x + dv * direction.y;
    let square = du * du + dv * dv - s * s;
    if GROWN {
        let own = 1.0 / max(growth + du * rays.growth_slope.x + dv * rays.growth_slope.y, 1.0);
        return footprint_before(square * own * own, (place - s) * own) * own * own;
    }
    return footprint_before(square, place - s);
}

// Footprint w of the voxel at (du, dv) from where a ray meets its plane, w s and w s^2, s the voxel's place along the
// ray. `direction` is the ray's unit vector, without its component along m. `growth` is the growth of a kernel at
// the ray's place, see growth_at().
fn weights(du: f32, dv: f32, direction: vec2f, growth: f32) -> vec3f {
    let s = du * direction.x + dv * direction.y;
    let square = du * du + dv * dv - s * s;
    var w: f32;
    if GROWN {
        // h(x / g) / g^3 has the footprint of h at r / g, over g^2.
        let own = max(growth + du * rays.growth_slope.x + dv * rays.growth_slope.y, 1.0);
        let shrunk = 1.0 / (own * own);
        w = footprint(square * shrunk) * shrunk;
    } else {
        w = footprint(square);
    }
    return vec3f(w, w * s, w * s * s);
}

// The growth of a kernel where a ray meets a plane; below 1 kernels do not grow.
fn growth_at(geometry: RayGeometry, plane: i32) -> f32 {
    return geometry.growth.x + geometry.growth.y * f32(plane);
}

// The factor of the reach of kernels around there: the growth of the largest of them.
fn reach_at(growth: f32) -> f32 {
    if GROWN {
        return clamp(growth + rays.growth_around, 1.0, rays.growth_most);
    }
    return 1.0;
}

// The first and the last row of a plane within `half` of a ray at `b`; none if the plane is not before `end`.
fn rows_of(plane: i32, end: i32, b: f32, half: f32) -> vec2i {
    let first = i32(ceil(b - half));
    return vec2i(first, select(first - 1, i32(floor(b + half)), plane < end));
}

// Sums over the voxels of a plane: of footprint times voxel, and of this product times s and times s^2.
struct Moments {
    m0: vec4f,
    m1: vec4f,
    m2: vec4f,
}

// The footprints that a straight ray meets in every plane: of 6 voxels in each of 4 rows, all that kernels with a
// radius of at most 2 voxels can reach.
struct Footprints {
    // The texel of the first voxel, from the first texel of a plane.
    texel: vec2i,
    // By row: the footprints of the first four voxels, and of the last two.
    first_four: mat4x4f,
    last_two: mat4x2f,
}

fn footprints_of(geometry: RayGeometry) -> Footprints {
    var footprints: Footprints;
    if STRAIGHT {
        // An even voxel of the packed volume, where a texel begins.
        let first = (vec2i(ceil(geometry.base - geometry.footprint_half)) - rays.first.xy) & vec2i(-2, -1);
        footprints.texel = vec2i(first.x >> 1u, first.y);
        for (var row = 0; row < 4; row++) {
            let d = vec2f(rays.first.xy + first + vec2i(0, row)) - geometry.base;
            let x = d.x + vec4f(0.0, 1.0, 2.0, 3.0);
            let square = x * x + d.y * d.y;
            let y = d.x + vec2f(4.0, 5.0);
            let beyond = y * y + d.y * d.y;
            footprints.first_four[row] =
                vec4f(footprint(square.x), footprint(square.y), footprint(square.z), footprint(square.w));
            footprints.last_two[row] = vec2f(footprint(beyond.x), footprint(beyond.y));
        }
    }
    return footprints;
}

// The sum over six voxels of a row, with weights `a` and `b`.
fn row_sum(texel: vec2i, origin: Texel, a: vec4f, b: vec2f) -> vec4f {
    let at = texel_at(texel, origin);
    let t0 = voxels_at(at);
    let t1 = voxels_at(along_row(at, 1));
    let t2 = voxels_at(along_row(at, 2));
    return a.x * first_of(t0) + a.y * second_of(t0) + a.z * first_of(t1) + a.w * second_of(t1) + b.x * first_of(t2)
        + b.y * second_of(t2);
}

fn gathered_straight(footprints: Footprints, plane: i32, end: i32) -> vec4f {
    if plane >= end {
        return vec4f(0.0);
    }
    let origin = plane_texel(plane);
    let texel = footprints.texel;
    let a = footprints.first_four;
    let b = footprints.last_two;
    return row_sum(texel, origin, a[0], b[0]) + row_sum(texel + vec2i(0, 1), origin, a[1], b[1])
        + row_sum(texel + vec2i(0, 2), origin, a[2], b[2]) + row_sum(texel + vec2i(0, 3), origin, a[3], b[3]);
}

// The voxels of a row from the first texel that reaches a ray, and the place of the first voxel relative to the point
// where the ray meets the plane.
struct VoxelRow {
    texel: Texel,
    du: f32,
    dv: f32,
}

// `voxel` is the first voxel of the packed volume: it is read once for all rows.
fn voxel_row(geometry: RayGeometry, center: vec2f, row: i32, origin: Texel, half: f32, voxel: vec2i) -> VoxelRow {
    let dv = f32(row) - center.y;
    let first = (i32(ceil(center.x + dv * geometry.row_slope - half)) - voxel.x) & -2;
    let texel = texel_at(vec2i(first >> 1u, row - voxel.y), origin);
    return VoxelRow(texel, f32(voxel.x + first) - center.x, dv);
}

// Weights of the first six voxels of a row.
alias RowWeights = array<vec3f, 6>;

fn row_weights(row: VoxelRow, direction: vec2f, growth: f32) -> RowWeights {
    return RowWeights(
        weights(row.du, row.dv, direction, growth),
        weights(row.du + 1.0, row.dv, direction, growth),
        weights(row.du + 2.0, row.dv, direction, growth),
        weights(row.du + 3.0, row.dv, direction, growth),
        weights(row.du + 4.0, row.dv, direction, growth),
        weights(row.du + 5.0, row.dv, direction, growth),
    );
}

// Adds six voxels of a row in one expression, because addition pair by pair takes a tenth longer on software Vulkan.
fn add_row(sums: ptr<function, Moments>, w: RowWeights, a: vec4f, b: vec4f, c: vec4f, d: vec4f, e: vec4f, f: vec4f) {
    (*sums).m0 += w[0].x * a + w[1].x * b + w[2].x * c + w[3].x * d + w[4].x * e + w[5].x * f;
    (*sums).m1 += w[0].y * a + w[1].y * b + w[2].y * c + w[3].y * d + w[4].y * e + w[5].y * f;
    (*sums).m2 += w[0].z * a + w[1].z * b + w[2].z * c + w[3].z * d + w[4].z * e + w[5].z * f;
}

// Adds the two voxels of texel number `texel` of a row.
fn add_pair(sums: ptr<function, Moments>, row: VoxelRow, texel: i32, direction: vec2f, growth: f32) {
    let t = voxels_at(along_row(row.texel, texel));
    let v = first_of(t);
    let u = second_of(t);
    let du = row.du + f32(2 * texel);
    let w = weights(du, row.dv, direction, growth);
    let x = weights(du + 1.0, row.dv, direction, growth);
    (*sums).m0 += w.x * v + x.x * u;
    (*sums).m1 += w.y * v + x.y * u;
    (*sums).m2 += w.z * v + x.z * u;
}

// The sum of the kernels of a plane before a place on the ray that meets plane 0 at `base`. The place is in planes from
// that plane; the sum is 0 if the plane is not before `end`.
fn gathered_up_to(place: f32, base: vec2f, geometry: RayGeometry, plane: i32, end: i32) -> vec4f {
    let direction = geometry.direction;
    let center = base + geometry.shear * f32(plane);
    let growth = growth_at(geometry, plane);
    let reach = reach_at(growth);
    let rows = rows_of(plane, end, center.y, geometry.footprint_half.y * reach);
    let half = geometry.row_half * reach;
    let origin = plane_texel(plane);
    let along = place / direction.z;
    let voxel = rays.first.xy;
    var sum = vec4f(0.0);
    for (var row = rows.x; row <= rows.y; row++) {
        let at = voxel_row(geometry, center, row, origin, half, voxel);
        for (var texel = 0; texel < i32(TEXELS); texel++) {
            let t = voxels_at(along_row(at.texel, texel));
            let du = at.du + f32(2 * texel);
            sum += weight_before(du, at.dv, along, direction.xy, growth) * first_of(t)
                + weight_before(du + 1.0, at.dv, along, direction.xy, growth) * second_of(t);
        }
    }
    return sum;
}

// The moments of a plane for one ray; 0 if the plane is not before `end`.
fn gathered(geometry: RayGeometry, footprints: Footprints, plane: i32, end: i32) -> Moments {
    if STRAIGHT {
        return Moments(gathered_straight(footprints, plane, end), vec4f(0.0), vec4f(0.0));
    }
    let direction = geometry.direction.xy;
    let center = geometry.base + geometry.shear * f32(plane);
    let growth = growth_at(geometry, plane);
    let reach = reach_at(growth);
    let rows = rows_of(plane, end, center.y, geometry.footprint_half.y * reach);
    let half = geometry.row_half * reach;
    let origin = plane_texel(plane);
    let voxel = rays.first.xy;
    var sums = Moments();
    for (var row = rows.x; row <= rows.y; row++) {
        let at = voxel_row(geometry, center, row, origin, half, voxel);
        let t0 = voxels_at(at.texel);
        let t1 = voxels_at(along_row(at.texel, 1));
        let t2 = voxels_at(along_row(at.texel, 2));
        let w = row_weights(at, direction, growth);
        add_row(&sums, w, first_of(t0), second_of(t0), first_of(t1), second_of(t1), first_of(t2), second_of(t2));
        if TEXELS > 3u {
            add_pair(&sums, at, 3, direction, growth);
        }
        if TEXELS > 4u {
            add_pair(&sums, at, 4, direction, growth);
        }
        if TEXELS > 5u {
            add_pair(&sums, at, 5, direction, growth);
        }
        if TEXELS > 6u {
            add_pair(&sums, at, 6, direction, growth);
        }
    }
    return sums;
}
