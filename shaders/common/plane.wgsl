// What a ray of the painter `tiles` gathers of a voxel plane.

// Terms of the footprint's polynomial: 6 or 8.
override TERMS: u32 = 6u;
// Texels of a row of voxels that are looked at: 3 where kernels reach less than 2.5 voxels along it, as of six voxels the
// first may begin one too early, 4 up to 3.5 and 5 up to 4.5.
override TEXELS: u32 = 3u;
// Rays run along m, and meet all planes at the same place: their footprints are found once.
override STRAIGHT: bool = false;

// Footprint at a squared distance.
fn footprint(square: f32) -> f32 {
    let c2 = max(raster.radius2 - square, 0.0);
    let f = raster.footprint;
    let g = raster.footprint_high;
    var high = g.y * c2 + g.x;
    if TERMS > 6u {
        high += (g.w * c2 + g.z) * c2 * c2;
    }
    return sqrt(c2) * ((((high * c2 + f.w) * c2 + f.z) * c2 + f.y) * c2 + f.x);
}

// Footprint of a voxel (du, dv) from where a ray of that direction meets its plane, and that times its place along the ray,
// and again.
fn weights(du: f32, dv: f32, direction: vec2f) -> vec3f {
    let s = du * direction.x + dv * direction.y;
    let w = footprint(du * du + dv * dv - s * s);
    return vec3f(w, w * s, w * s * s);
}

// The texel before the first of a plane's voxels.
fn place_of(plane: i32) -> vec2i {
    let k = select(plane, raster.voxels.z - 1 - plane, raster.flipped == 1);
    return vec2i(
        k % raster.columns * (raster.row_texels + MARGIN) + MARGIN,
        k / raster.columns * (raster.voxels.y + 1) + 1,
    );
}

// A texel of a plane, or one of the zeros beside it.
fn texel_at(texel: vec2i, place: vec2i) -> vec2i {
    return vec2i(clamp(texel.x, -MARGIN, raster.row_texels), clamp(texel.y, -1, raster.voxels.y)) + place;
}

// The rows of a plane that reach a ray, none past the last plane of a run.
fn rows_of(plane: i32, end: i32, b: f32, half: f32) -> vec2i {
    let first = i32(ceil(b - half));
    return vec2i(first, select(first - 1, i32(floor(b + half)), plane < end));
}

// Sums of a plane's voxels over the kernels that reach a ray: of footprints, of these times places, and of scalars again.
struct Moments {
    m: vec4f,
    n: vec4f,
    o: f32,
}

// What a straight ray meets in every plane: the footprints of 6 voxels in each of 4 rows, which is all that kernels of 2 voxels
// and less reach.
struct Footprints {
    // The texel in which the first of them is, from the texel before a plane's voxels.
    texel: vec2i,
    a: mat4x4f,
    b: mat4x2f,
}

fn footprints_of(course: Course) -> Footprints {
    var footprints: Footprints;
    if STRAIGHT {
        let first = vec2i(ceil(course.base - course.half)) & vec2i(-2, -1);
        footprints.texel = vec2i(first.x >> 1u, first.y);
        for (var row = 0; row < 4; row++) {
            let d = vec2f(first + vec2i(0, row)) - course.base;
            let x = d.x + vec4f(0.0, 1.0, 2.0, 3.0);
            let square = x * x + d.y * d.y;
            let y = d.x + vec2f(4.0, 5.0);
            let beyond = y * y + d.y * d.y;
            footprints.a[row] = vec4f(footprint(square.x), footprint(square.y), footprint(square.z), footprint(square.w));
            footprints.b[row] = vec2f(footprint(beyond.x), footprint(beyond.y));
        }
    }
    return footprints;
}

// The sum of one of their rows.
fn row_sum(texel: vec2i, place: vec2i, a: vec4f, b: vec2f) -> vec4f {
    let at = texel_at(texel, place);
    let t0 = textureLoad(volume, at);
    let t1 = textureLoad(volume, at + vec2i(1, 0));
    let t2 = textureLoad(volume, at + vec2i(2, 0));
    return a.x * first_of(t0) + a.y * second_of(t0) + a.z * first_of(t1) + a.w * second_of(t1) + b.x * first_of(t2)
        + b.y * second_of(t2);
}

fn gathered_straight(footprints: Footprints, plane: i32, end: i32) -> vec4f {
    if plane >= end {
        return vec4f(0.0);
    }
    let place = place_of(plane);
    let texel = footprints.texel;
    let a = footprints.a;
    let b = footprints.b;
    return row_sum(texel, place, a[0], b[0]) + row_sum(texel + vec2i(0, 1), place, a[1], b[1])
        + row_sum(texel + vec2i(0, 2), place, a[2], b[2]) + row_sum(texel + vec2i(0, 3), place, a[3], b[3]);
}

// A row of voxels, from the first texel that reaches a ray: where its first voxel is from where the ray meets the plane.
struct Row {
    texel: vec2i,
    du: f32,
    dv: f32,
}

fn row_at(course: Course, center: vec2f, row: i32, place: vec2i) -> Row {
    let dv = f32(row) - center.y;
    let first = i32(ceil(center.x + dv * course.row_slope - course.row_half)) & -2;
    return Row(texel_at(vec2i(first >> 1u, row), place), f32(first) - center.x, dv);
}

// Weights of the first six voxels of a row.
struct RowWeights {
    w0: vec3f,
    w1: vec3f,
    w2: vec3f,
    w3: vec3f,
    w4: vec3f,
    w5: vec3f,
}

fn row_weights(row: Row, direction: vec2f) -> RowWeights {
    return RowWeights(
        weights(row.du, row.dv, direction),
        weights(row.du + 1.0, row.dv, direction),
        weights(row.du + 2.0, row.dv, direction),
        weights(row.du + 3.0, row.dv, direction),
        weights(row.du + 4.0, row.dv, direction),
        weights(row.du + 5.0, row.dv, direction),
    );
}

// Adds six voxels of a row. At once: pair by pair takes a tenth longer on software Vulkan.
fn add_row(sums: ptr<function, Moments>, w: RowWeights, a: vec4f, b: vec4f, c: vec4f, d: vec4f, e: vec4f, f: vec4f) {
    (*sums).m += w.w0.x * a + w.w1.x * b + w.w2.x * c + w.w3.x * d + w.w4.x * e + w.w5.x * f;
    (*sums).n += w.w0.y * a + w.w1.y * b + w.w2.y * c + w.w3.y * d + w.w4.y * e + w.w5.y * f;
    (*sums).o += w.w0.z * a.w + w.w1.z * b.w + w.w2.z * c.w + w.w3.z * d.w + w.w4.z * e.w + w.w5.z * f.w;
}

// Adds the two voxels of a texel of a row.
fn add_pair(sums: ptr<function, Moments>, row: Row, texel: i32, direction: vec2f) {
    let t = textureLoad(volume, row.texel + vec2i(texel, 0));
    let v = first_of(t);
    let u = second_of(t);
    let du = row.du + f32(2 * texel);
    let w = weights(du, row.dv, direction);
    let x = weights(du + 1.0, row.dv, direction);
    (*sums).m += w.x * v + x.x * u;
    (*sums).n += w.y * v + x.y * u;
    (*sums).o += w.z * v.w + x.z * u.w;
}

fn gathered(course: Course, footprints: Footprints, plane: i32, end: i32) -> Moments {
    if STRAIGHT {
        return Moments(gathered_straight(footprints, plane, end), vec4f(0.0), 0.0);
    }
    let direction = course.direction.xy;
    let center = course.base + course.shear * f32(plane);
    let rows = rows_of(plane, end, center.y, course.half.y);
    let place = place_of(plane);
    var sums = Moments(vec4f(0.0), vec4f(0.0), 0.0);
    for (var row = rows.x; row <= rows.y; row++) {
        let at = row_at(course, center, row, place);
        let t0 = textureLoad(volume, at.texel);
        let t1 = textureLoad(volume, at.texel + vec2i(1, 0));
        let t2 = textureLoad(volume, at.texel + vec2i(2, 0));
        let w = row_weights(at, direction);
        add_row(&sums, w, first_of(t0), second_of(t0), first_of(t1), second_of(t1), first_of(t2), second_of(t2));
        if TEXELS > 3u {
            add_pair(&sums, at, 3, direction);
        }
        if TEXELS > 4u {
            add_pair(&sums, at, 4, direction);
        }
    }
    return sums;
}
