// gather: rays of the painter `tiles` through classified voxels. A ray goes from voxel plane to voxel plane and gathers
// the kernels of each plane that reach it. Each plane has a slab, from half way to the plane before it to half way to
// the plane behind it. The planes between slabs cut every kernel; a slab is composited when all kernels that reach it
// are known.
//
// A kernel reaches two or three slabs on either side of its own. Its part in each is nearly its footprint times a
// linear function of s, the place of its centre along the ray. So a plane needs two sums, its moments: footprints m0,
// and footprints times s, m1. In dense material, which shows where parts are off by little, it is a parabola, of a
// third moment m2. The slabs around a plane get their parts from these. The parts of a kernel add up to its footprint,
// so a ray has the optical depth of whole kernels.
//
// `single` marches one ray. `eight` marches eight: rays a voxel apart, which meet a plane at the same place between its
// voxels and share the six footprints of a row; or rays of neighbouring pixels along m, which share the voxels that
// they meet and find their footprints once. Its rays are written out eight times, because loops over arrays stay in
// memory on drivers that do not unroll them: a line with a number sign stands for itself with 0 to 7 in its place
// (src/gpu/shaders.rs).
// uses: common/absorbed, common/march_planes, common/response

@group(0) @binding(0) var<uniform> uniform_rays: Rays;
@group(0) @binding(2) var<storage, read> runs: array<vec2u>;
// Written if rays go through an intermediate image; read by `prefilter`.
@group(0) @binding(3) var intermediate: texture_storage_2d<rgba32float, write>;
// The picture, to which the rays of pixels add.
@group(0) @binding(4) var<storage, read_write> pixels: array<vec4f>;
// The share of its own ray in each pixel, and the tiles with such pixels.
@group(0) @binding(3) var<storage, read> refinement: array<f32>;
@group(0) @binding(5) var<storage, read> refined: Refined;
// For each pixel, the state of its ray behind the layers before: premultiplied colour and optical depth.
@group(0) @binding(3) var<storage, read_write> gathered_before: array<vec4f>;
@group(0) @binding(5) var<storage, read> solid_depths: array<f32>;
@group(0) @binding(6) var<uniform> tables: Tables;
// See common/pages.wgsl.
@group(0) @binding(7) var<storage, read> page_table: array<u32>;

// Rays go through an intermediate image.
override RESAMPLED: bool = false;

// Parts are parabolas in s.
override CURVED: bool = false;

// Planes that kernels reach before and behind their own: 2 to 4; along `eight`, 2.
override REACH: i32 = 3;

// Sums in the slabs around a plane, from four planes before its own, which is number 4, to four behind it.
alias Slabs = array<vec4f, 9>;

// Sets the parts of kernels in the slabs `distance` planes before their own and behind it, which differ in the sign of
// m1. `section` are the factors of m0, m1 and m2. Returns the mean of both parts.
fn set_parts(parts: ptr<function, Slabs>, distance: i32, section: vec3f, sums: Moments) -> vec4f {
    var even = section.x * sums.m0;
    if CURVED {
        even += section.z * sums.m2;
    }
    let odd = section.y * sums.m1;
    (*parts)[4 - distance] = even + odd;
    (*parts)[4 + distance] = even - odd;
    return even;
}

// The parts of the kernels of a plane in the slabs around it. Their own slab has the rest.
fn parts_of(section: Section, sums: Moments) -> Slabs {
    let x = section.by_m0;
    let y = section.by_m1;
    let z = section.by_m2;
    var parts = Slabs();
    var others = set_parts(&parts, 1, vec3f(x.x, y.x, z.x), sums);
    others += set_parts(&parts, 2, vec3f(x.y, y.y, z.y), sums);
    if REACH > 2 {
        others += set_parts(&parts, 3, vec3f(x.z, y.z, z.z), sums);
    }
    if REACH > 3 {
        others += set_parts(&parts, 4, vec3f(x.w, y.w, z.w), sums);
    }
    parts[4] = sums.m0 - 2.0 * others;
    return parts;
}

// The part of the slabs before a border: `part`, unless the border is clipped.
fn up_to(border: f32, part: vec4f, ends: vec2f, first: vec4f, last: vec4f) -> vec4f {
    return select(select(part, first, border <= ends.x), last, border >= ends.y);
}

// The places where a ray is cut, in planes from a plane of voxels, and the sums of the kernels of that plane before
// each place; 0 if the place is out of their reach.
struct Cut {
    ends: vec2f,
    first: vec4f,
    last: vec4f,
}

// How far from their plane kernels reach along a ray, in planes: with a radius R at most R (1 + tan) cos, of the angle
// between the ray and m.
fn reach_along() -> f32 {
    return sqrt(2.0 * rays.radius2) * rays.growth_most;
}

// The cut of the ray that meets plane 0 at `base`, between two places, in planes.
fn cut_at(places: vec2f, base: vec2f, geometry: RayGeometry, plane: i32, end: i32) -> Cut {
    let ends = vec2f(places.x, max(places.x, places.y)) - f32(plane);
    let reach = reach_along();
    var cut = Cut(ends, vec4f(0.0), vec4f(0.0));
    if abs(ends.x) < reach {
        cut.first = gathered_up_to(ends.x, base, geometry, plane, end);
    }
    if abs(ends.y) < reach {
        cut.last = gathered_up_to(ends.y, base, geometry, plane, end);
    }
    return cut;
}

// The part of whole kernels, `all`, before a place.
fn before(place: f32, near: vec4f, all: vec4f) -> vec4f {
    let reach = reach_along();
    return select(select(near, all, place >= reach), vec4f(0.0), place <= -reach);
}

// The rests of the parts of the kernels of a plane after the cuts, at which slabs end. The sums before each cut have
// been added up voxel by voxel, so the optical depth of the rests is exact.
fn cut_parts(parts: Slabs, all: vec4f, cut: Cut) -> Slabs {
    let ends = cut.ends;
    let reach = reach_along();
    if ends.x <= -reach && ends.y >= reach {
        return parts;
    }
    let first = before(ends.x, cut.first, all);
    let last = before(ends.y, cut.last, all);
    // The rests up to the border behind each slab, then the differences between borders.
    var sum = vec4f(0.0);
    var left: Slabs;
    sum += parts[#]; left[#] = up_to(f32(#) - 3.5, sum, ends, first, last);
    left[8] = last;
    left[8 - #] -= left[7 - #];
    left[0] -= first;
    return left;
}

// The tolerated deficit of optical depth, or surplus of colour, of a slab. The fit of parts has small errors around
// zero. While they are small in optical depth, errors of neighbours cancel. Settling them would increase the error of
// colours in ordinary material up to fourfold.
const LEEWAY: f32 = 0.03;
// The largest slope of a slab's neighbour that shapes the slab, as a multiple of the slab's optical depth, beside an
// optical depth of 1. If extinction rises more steeply, only light from the front of the slab counts.
const STEEPEST: f32 = 3.0;

// A slab (`x`) and the slab behind it (`y`) in optical depth, settled such that neither lacks much. But for the leeway,
// a settled slab holds no less than nothing, and no more of a colour than its extinction allows. The slab pays for the
// lack of the slab behind it, and leaves its own lack or surplus to the slab behind it. So sums over all slabs remain
// sums of whole kernels.
struct Pair {
    x: vec4f,
    y: vec4f,
}

// The part of a slab within the leeway: it lacks extinction and colours alike, and no colour by more.
fn within_leeway(slab: vec4f) -> vec4f {
    let kept = slab * (LEEWAY / max(-slab.w, LEEWAY));
    return vec4f(max(kept.rgb, vec3f(-LEEWAY)), kept.w);
}

fn settled(slab: vec4f, behind: vec4f) -> Pair {
    let kept = within_leeway(behind);
    let paid = slab + (behind - kept);
    var x = within_leeway(paid);
    x = vec4f(min(x.rgb, max(x.w, 0.0) * rays.brightest + LEEWAY), x.w);
    return Pair(x, kept + (paid - x));
}

// Composites the slab of plane `place`, which waits in `ray`, now that the slab behind it is known.
//
// Its colour changes with optical depth u as c(u) = mean + g (u / depth - 1/2), with g from its neighbours: exact to
// second order. The integral of c(u) exp(-u) is mean (1 - exp(-depth)) - g f(depth), f(depth) = 1/2 + exp(-depth) / 2 -
// (1 - exp(-depth)) / depth. The fraction below, for f(depth) / depth^2, errs by at most 0.04 / depth^2, and is exact
// for small depths.
fn advance(ray: ptr<function, RayState>, behind: vec4f, geometry: RayGeometry, place: f32) {
    let pair = settled((*ray).slab, behind * (rays.density_scale * geometry.stretch));
    let before = (*ray).before;
    (*ray).before = pair.x;
    (*ray).slab = pair.y;
    if BRICK {
        (*ray).place = place + 1.0;
        if !is_owned(geometry, place) {
            return;
        }
    }
    let most = STEEPEST * max(pair.x.w, 0.0) + 1.0;
    var x = pair.x;
    var slope = pair.y * (most / max(pair.y.w, most)) - before * (most / max(before.w, most));
    // The light that arrives times 1 - exp(-depth). The relative error of the series is depth^4 / 120 < 2e-7.
    let depth = x.w;
    let passed = exp(-(*ray).depth - depth);
    // Over the depth, or over 1 if the depth is less: squares would leave the range of f32.
    let unit = 1.0 / max(depth, 1.0);
    x *= unit;
    slope *= unit;
    let series = 1.0 - depth * (1.0 / 2.0) * (1.0 - depth * (1.0 / 3.0) * (1.0 - depth * (1.0 / 4.0)));
    let mean = select(((*ray).transmittance - passed) / x.w, (*ray).transmittance * series, abs(depth) < 0.06);
    let bend = 0.5 * (*ray).transmittance / (12.0 * unit * unit + x.w * (6.0 * unit + 2.0 * x.w));
    let color = x.rgb * mean + bend * (x.rgb * slope.w - x.w * slope.rgb);
    let absorbed = x.w * mean;
    if HALF_DEPTH {
        let ends = clamp(place + vec2f(-0.5, 0.5), vec2f(geometry.cut.x), vec2f(geometry.cut.y));
        let depths = vec2f(depth_of(geometry, ends.x), depth_of(geometry, ends.y));
        (*ray).color = half_depth((*ray).color, (*ray).depth, (*ray).depth + depth, depths);
    } else {
        let leeway = LEEWAY * (*ray).transmittance;
        (*ray).color += clamp(
            color,
            rays.brightest * min(absorbed, 0.0) - leeway,
            rays.brightest * max(absorbed, 0.0) + leeway,
        );
    }
    (*ray).depth += depth;
    (*ray).transmittance = passed;
}

// A run of planes begins. Nothing of the run before is pending but the lack of its last slab.
fn begin_run(ray: ptr<function, RayState>) {
    (*ray).before = vec4f(0.0);
}

// The premultiplied colour and the optical depth of a finished ray in a brick.
fn partial(ray: RayState, geometry: RayGeometry) -> vec4f {
    let lack = select(0.0, min(ray.slab.w, 0.0), is_owned(geometry, ray.place));
    return vec4f(ray.color, ray.depth + lack);
}

// The optical depth of a ray that has ended. The lack of the last slab is subtracted.
fn final_depth(ray: RayState) -> f32 {
    return max(ray.depth + min(ray.slab.w, 0.0), 0.0);
}

// The premultiplied colour of a finished ray.
fn finished(ray: RayState) -> vec4f {
    let depth = final_depth(ray);
    if RESPONSE > 0u {
        return response(depth, rays.model);
    }
    let alpha = absorbed(depth);
    if HALF_DEPTH {
        return vec4f(ray.color, alpha);
    }
    let color = ray.color * min(alpha / max(absorbed(ray.depth), 1e-30), 1.0);
    return vec4f(clamp(color, vec3f(0.0), rays.brightest * alpha), alpha);
}

// Planes after the last of a run: kernels reach REACH slabs beyond it, and slabs wait for REACH planes and one more.
override FLUSH: i32 = 2 * REACH + 1;

fn is_opaque(ray: RayState) -> bool {
    return ray.depth > rays.opaque_depth;
}

// Adds the parts of plane `plane` to the slabs around it, composites the slab that no later plane reaches, and goes on
// to the next plane.
fn add_parts(
    ray: ptr<function, RayState>,
    slabs: ptr<function, Slabs>,
    of_plane: Slabs,
    geometry: RayGeometry,
    plane: i32,
) {
    var parts = of_plane;
    let complete = (*slabs)[4 - REACH] + parts[4 - REACH];
    advance(ray, complete, geometry, f32(plane - REACH - 1));
    if # >= 4 - REACH && # < 4 + REACH { (*slabs)[#] = (*slabs)[# + 1] + parts[# + 1]; }
}

// Adds a plane to the slabs that its kernels reach.
fn feed(
    ray: ptr<function, RayState>,
    slabs: ptr<function, Slabs>,
    all: Moments,
    geometry: RayGeometry,
    plane: i32,
    end: i32,
) {
    var sums = all;
    var share = 1.0;
    if LAYERED {
        share = layer_share(geometry, f32(plane));
        sums = Moments(share * all.m0, share * all.m1, share * all.m2);
    }
    var parts = parts_of(section_at(geometry.near, geometry, plane), sums);
    if CUT {
        let cut = cut_at(geometry.cut, geometry.base, geometry, plane, end);
        parts = cut_parts(parts, sums.m0, Cut(cut.ends, share * cut.first, share * cut.last));
    }
    add_parts(ray, slabs, parts, geometry, plane);
}

// Stores the value of a point of the intermediate image, or adds it to its pixel.
fn put(at: vec2u, value: vec4f) {
    if RESAMPLED {
        textureStore(intermediate, at, value);
    } else {
        add_to_pixel(at, value);
    }
}

@compute @workgroup_size(64)
fn single(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    rays = uniform_rays;
    let at = point_of(tile, lane);
    let share = share_of(line_of(at));
    if PERSPECTIVE && share == 0.0 {
        return;
    }
    let geometry = geometry_of_pixel(at);
    let ray = march_planes(tile, geometry, new_ray());
    if BRICK {
        put(at, partial(ray, geometry));
    } else {
        put(at, share * finished(ray));
    }
}

// The rays of pixels through one of several layers, which are marched front to back. Each layer adds to the pixels the
// change of their rays' colours.
@compute @workgroup_size(64)
fn layer(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    rays = uniform_rays;
    let at = point_of(tile, lane);
    let share = share_of(line_of(at));
    if any(at >= rays.picture) || share == 0.0 {
        return;
    }
    let geometry = geometry_of_pixel(at);
    let index = at.y * rays.picture.x + at.x;
    let before = gathered_before[index];
    let ray = march_planes(tile, geometry, ray_behind(before));
    let value = finished(ray);
    gathered_before[index] = vec4f(value.rgb, final_depth(ray));
    var shown = vec4f(before.rgb, absorbed(before.w));
    if RESPONSE > 0u {
        shown = response(before.w, rays.model);
    }
    add_to_pixel(at, share * (value - shown));
}

// The rays of pixels that the intermediate images reproduce too poorly: a workgroup for each tile of the list.
@compute @workgroup_size(64)
fn refine(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) group: vec3u) {
    rays = uniform_rays;
    let index = group.y * REFINED_ROW + group.x;
    if index >= refined.count {
        return;
    }
    let number = refined.tiles[index];
    let tile = vec3u(number % rays.tiles.x, number / rays.tiles.x, 0u);
    let at = point_of(tile, lane);
    if any(at >= rays.picture) {
        return;
    }
    let share = refinement[at.y * rays.picture.x + at.x] * share_of(line_of(at));
    if share > 0.0 {
        let geometry = geometry_of(at);
        add_to_pixel(at, share * finished(march_planes(tile, geometry, new_ray())));
    }
}

// Rays across a block of eight: 8 rays in a row, a voxel apart; or 2 or 4 pixels.
override ACROSS: u32 = 8u;
// Rows of voxels that reach a ray of a block of pixels: 5 to 7. Along a row it is five voxels.
override ROWS: u32 = 5u;

// Adds a plane to the slabs of ray `number` of eight; `is_cut` says whether the plane is near a cut.
fn feed_eight(
    ray: ptr<function, RayState>,
    slabs: ptr<function, Slabs>,
    sums: Moments,
    geometry: RayGeometry,
    eight: ptr<function, EightCuts>,
    number: u32,
    is_cut: bool,
) {
    var parts = parts_of(geometry.near.as_asked, sums);
    if CLIP_PLANES > 0u && is_cut {
        parts = cut_parts(parts, sums.m0, (*eight).cuts[number]);
    }
    // The rays of a brick march one by one: no slab has an owner here.
    add_parts(ray, slabs, parts, geometry, 0);
}

// The cuts of eight rays.
struct EightCuts {
    // The base coordinates of each ray, and the planes between which it is unclipped.
    bases: array<vec2f, 8>,
    places: array<vec2f, 8>,
    // The least and the largest of their beginnings, and of their ends.
    begin: vec2f,
    end: vec2f,
    // For one plane.
    cuts: array<Cut, 8>,
}

fn eight_cuts(geometry: RayGeometry) -> EightCuts {
    var eight = EightCuts();
    if CLIP_PLANES > 0u {
        eight.begin = vec2f(FAR, -FAR);
        eight.end = vec2f(FAR, -FAR);
        for (var i = 0u; i < 8u; i++) {
            let number = vec2f(vec2u(i % ACROSS, i / ACROSS) * rays.phases);
            let base = geometry.base + number.x * rays.step_x + number.y * rays.step_y;
            let places = cut_of(base, geometry.shear);
            eight.bases[i] = base;
            eight.places[i] = places;
            eight.begin = vec2f(min(eight.begin.x, places.x), max(eight.begin.y, places.x));
            eight.end = vec2f(min(eight.end.x, places.y), max(eight.end.y, places.y));
        }
    }
    return eight;
}

// The planes of a run that can matter to one of the rays.
fn planes_of_eight(run: vec2i, eight: ptr<function, EightCuts>) -> vec2i {
    let planes = run_planes(run);
    if CLIP_PLANES == 0u {
        return planes;
    }
    let beyond = REACH + 2;
    return vec2i(max(planes.x, i32((*eight).begin.x) - beyond), min(planes.y, i32((*eight).end.y) + beyond + 1));
}

// Computes the cuts for a plane. False if every ray is unclipped within the reach of the kernels of the plane.
fn find_cuts(eight: ptr<function, EightCuts>, geometry: RayGeometry, plane: i32, end: i32) -> bool {
    if CLIP_PLANES == 0u {
        return false;
    }
    let reach = reach_along();
    if (*eight).begin.y - f32(plane) <= -reach && (*eight).end.x - f32(plane) >= reach {
        return false;
    }
    for (var i = 0u; i < 8u; i++) {
        (*eight).cuts[i] = cut_at((*eight).places[i], (*eight).bases[i], geometry, plane, end);
    }
    return true;
}

// The least optical depth of eight rays.
fn least(a: vec4f, b: vec4f) -> f32 {
    let m = min(a, b);
    return min(min(m.x, m.y), min(m.z, m.w));
}

// Footprints of the voxels of a row.
struct FiveWeights {
    first_four: vec4f,
    last: f32,
}

fn five_weights(d: vec2f) -> FiveWeights {
    let x = d.x + vec4f(0.0, 1.0, 2.0, 3.0);
    let square = x * x + d.y * d.y;
    return FiveWeights(
        vec4f(footprint(square.x), footprint(square.y), footprint(square.z), footprint(square.w)),
        footprint((d.x + 4.0) * (d.x + 4.0) + d.y * d.y),
    );
}

struct FiveVoxels {
    v0: vec4f,
    v1: vec4f,
    v2: vec4f,
    v3: vec4f,
    v4: vec4f,
}

// Five voxels of a row from the first or, if `odd`, from the second voxel of a texel.
fn five_voxels(texel: vec2i, odd: bool, origin: Texel) -> FiveVoxels {
    let at = texel_at(texel, origin);
    let t0 = voxels_at(at);
    let t1 = voxels_at(along_row(at, 1));
    let t2 = voxels_at(along_row(at, 2));
    let u0 = select(t0, vec4u(t0.zw, t1.xy), odd);
    let u1 = select(t1, vec4u(t1.zw, t2.xy), odd);
    let u2 = select(t2, t2.zwzw, odd);
    return FiveVoxels(first_of(u0), second_of(u0), first_of(u1), second_of(u1), first_of(u2));
}

fn weighed(w: FiveWeights, v: FiveVoxels) -> vec4f {
    let f = w.first_four;
    return f.x * v.v0 + f.y * v.v1 + f.z * v.v2 + f.w * v.v3 + w.last * v.v4;
}

// The footprints and the voxels of the rows that reach a block of pixels: ROWS of them.
struct RowsOfWeights {
    r#: FiveWeights,
}
struct RowsOfVoxels {
    r#: FiveVoxels,
}

fn rows_of_weights(d: vec2f) -> RowsOfWeights {
    var w: RowsOfWeights;
    if #u < ROWS { w.r# = five_weights(d + vec2f(0.0, f32(#))); }
    return w;
}

// The sum over the rows for one ray.
fn sum_of_rows(weights: RowsOfWeights, voxels: RowsOfVoxels) -> vec4f {
    var sum = vec4f(0.0);
    if #u < ROWS { sum += weighed(weights.r#, voxels.r#); }
    return sum;
}

@compute @workgroup_size(8)
fn eight(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    rays = uniform_rays;
    // Blocks across a tile of 8 x 8 rays, and rays down a block.
    let down = 8u / ACROSS;
    let at = first_ray(tile) + vec2u(lane % down * ACROSS, lane / down * down) * rays.phases;
    let geometry = geometry_of(at);
    let direction = geometry.direction.xy;
    // Of a block of pixels: the least place of a ray along a and b, and the first voxel that reaches a ray.
    let low = geometry.base + min(vec2f(0.0), f32(ACROSS - 1u) * rays.step_x)
        + min(vec2f(0.0), f32(down - 1u) * rays.step_y);
    let first = vec2i(ceil(low - geometry.footprint_half)) - rays.first.xy;
    let odd = (first.x & 1) == 1;
    let voxel = rays.first.xy;
    var weights: array<RowsOfWeights, 8>;
    if ACROSS < 8u {
        // A loop over an array, which compiles faster: 280 numbers stay in memory anyway.
        for (var number = 0u; number < 8u; number++) {
            let d = vec2f(rays.first.xy + first) - geometry.base - f32(number % ACROSS) * rays.step_x
                - f32(number / ACROSS) * rays.step_y;
            weights[number] = rows_of_weights(d);
        }
    }
    var cuts = eight_cuts(geometry);
    var ray# = new_ray();
    var slabs#: Slabs;
    var depth = 0.0;
    for (var slot = 0u; ; slot++) {
        let run = run_at(tile, slot, depth);
        if run.y == 0 {
            break;
        }
        let planes = planes_of_eight(run, &cuts);
        begin_run(&ray#); slabs# = Slabs();
        for (var plane = planes.x; plane < planes.y + FLUSH; plane++) {
            let origin = plane_texel(plane);
            var sums# = Moments();
            if ACROSS == 8u {
                let center = geometry.base + geometry.shear * f32(plane);
                let rows = rows_of(plane, planes.y, center.y, geometry.footprint_half.y);
                for (var row = rows.x; row <= rows.y; row++) {
                    let at_row = voxel_row(geometry, center, row, origin, geometry.row_half, voxel);
                    let w = row_weights(at_row, direction, 1.0);
                    // Voxels a0, b0, a1, b1 ... a6 of the row, from a0 on for the first ray.
                    let t# = voxels_at(along_row(at_row.texel, #));
                    let a# = first_of(t#);
                    let b# = second_of(t#);
                    add_row(&sums0, w, a0, b0, a1, b1, a2, b2);
                    add_row(&sums1, w, b0, a1, b1, a2, b2, a3);
                    add_row(&sums2, w, a1, b1, a2, b2, a3, b3);
                    add_row(&sums3, w, b1, a2, b2, a3, b3, a4);
                    add_row(&sums4, w, a2, b2, a3, b3, a4, b4);
                    add_row(&sums5, w, b2, a3, b3, a4, b4, a5);
                    add_row(&sums6, w, a3, b3, a4, b4, a5, b5);
                    add_row(&sums7, w, b3, a4, b4, a5, b5, a6);
                }
            } else {
                // Behind the run the rows before the plane, which are zeros. Every kernel has its centre where the ray
                // meets its plane: s is 0.
                let top = vec2i(first.x >> 1u, select(-i32(ROWS), first.y, plane < planes.y));
                var voxels: RowsOfVoxels;
                if #u < ROWS { voxels.r# = five_voxels(top + vec2i(0, #), odd, origin); }
                sums#.m0 = sum_of_rows(weights[#], voxels);
            }
            let is_cut = find_cuts(&cuts, geometry, plane, planes.y);
            feed_eight(&ray#, &slabs#, sums#, geometry, &cuts, #u, is_cut);
            depth = least(
                vec4f(ray0.depth, ray1.depth, ray2.depth, ray3.depth),
                vec4f(ray4.depth, ray5.depth, ray6.depth, ray7.depth),
            );
            if depth > rays.opaque_depth {
                break;
            }
        }
    }
    // The shares of intermediate images count when they are resampled.
    let share = select(rays.share, 1.0, RESAMPLED);
    put(at + vec2u(#u % ACROSS, #u / ACROSS) * rays.phases, share * finished(ray#));
}
