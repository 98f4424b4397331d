// gather: rays of the painter `tiles` through classified voxels. A ray goes from voxel plane to voxel plane and gathers
// the kernels of each plane that reach it. Each plane has a slab, from half way to the plane before it to half way to
// the plane behind it. The planes between slabs cut every kernel; a slab is composited when all kernels that reach it
// are known.
//
// A kernel reaches two or three slabs on either side of its own slab. Its part in each slab is nearly its footprint
// times a linear function of s, the place of its centre along the ray. So a plane needs two sums, its moments:
// footprints m0, and footprints times s, m1. Dense material makes small errors of parts visible, so there the function
// is a parabola, with a third moment m2. The slabs around a plane get their parts from the moments. The parts of a
// kernel add up to its footprint, so the optical depth of a ray is the depth of whole kernels.
//
// `single` marches one ray. `blocked` marches eight rays a voxel apart: they meet a plane at the same place between its
// voxels and share the six footprints of a row. `straight` marches the rays of eight neighbouring pixels along m: they
// share voxels, and compute their footprints once. Both are written out eight times, because drivers that do not unroll
// loops keep arrays in memory: a line with a number sign is repeated with 0 to 7 in its place (src/gpu/shaders.rs).
// uses: common/absorbed, common/march_planes, common/response, voxels/vectors

@group(0) @binding(0) var<uniform> rays: Rays;
@group(0) @binding(2) var<storage, read> runs: array<vec2u>;
// Written by `single` if rays go through an intermediate image, and by `blocked`; read by `prefilter`.
@group(0) @binding(3) var intermediate: texture_storage_2d<rgba32float, write>;
// The picture: `single`, `refine`, `layer` and `straight` add to it.
@group(0) @binding(4) var<storage, read_write> pixels: array<vec4f>;
// The share of its own ray in each pixel, and the tiles with such pixels.
@group(0) @binding(3) var<storage, read> refinement: array<f32>;
@group(0) @binding(5) var<storage, read> refined: Refined;
// For each pixel, the state of its ray after the nearer lattices: premultiplied colour and optical depth.
@group(0) @binding(3) var<storage, read_write> gathered_before: array<vec4f>;

// The rays of `single` go through an intermediate image.
override RESAMPLED: bool = false;

// Parts are parabolas in s.
override CURVED: bool = false;

// Planes that kernels reach before and behind their own: 3, or 4.
override REACH: i32 = 3;

// The parts of the kernels of a plane in the slabs one to four planes before their own (`ahead`) and behind it, which
// differ in the sign of m1; the third is 0 for kernels with a radius of at most 2 voxels. Their own slab has the rest.
struct Parts {
    own: vec4f,
    ahead1: vec4f,
    ahead2: vec4f,
    ahead3: vec4f,
    ahead4: vec4f,
    behind1: vec4f,
    behind2: vec4f,
    behind3: vec4f,
    behind4: vec4f,
}

fn parts_of(section: Section, sums: Moments) -> Parts {
    var even1 = section.by_m0.x * sums.m0;
    var even2 = section.by_m0.y * sums.m0;
    var even3 = section.by_m0.z * sums.m0;
    var even4 = vec4f(0.0);
    var odd4 = vec4f(0.0);
    if REACH > 3 {
        even4 = section.by_m0.w * sums.m0;
        odd4 = section.by_m1.w * sums.m1;
    }
    if CURVED {
        even1 += section.by_m2.x * sums.m2;
        even2 += section.by_m2.y * sums.m2;
        even3 += section.by_m2.z * sums.m2;
        if REACH > 3 {
            even4 += section.by_m2.w * sums.m2;
        }
    }
    let odd1 = section.by_m1.x * sums.m1;
    let odd2 = section.by_m1.y * sums.m1;
    let odd3 = section.by_m1.z * sums.m1;
    return Parts(
        sums.m0 - 2.0 * (even1 + even2 + even3 + even4),
        even1 + odd1,
        even2 + odd2,
        even3 + odd3,
        even4 + odd4,
        even1 - odd1,
        even2 - odd2,
        even3 - odd3,
        even4 - odd4,
    );
}

// The part of the slabs before a border: `part`, unless the border is clipped.
fn up_to(border: f32, part: vec4f, ends: vec2f, first: vec4f, last: vec4f) -> vec4f {
    return select(select(part, first, border <= ends.x), last, border >= ends.y);
}

// The cuts of a ray, in planes from a plane of voxels, and the parts of the kernels of that plane before each cut. They
// are not computed for cuts beyond the reach of the kernels.
struct Cut {
    ends: vec2f,
    first: vec4f,
    last: vec4f,
}

// The reach of kernels from their plane along a ray, in planes: at most R (1 + tan) cos, for a radius R and the angle
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

// The parts of the kernels of a plane between the cuts of the ray: slabs end at a cut. The parts before each cut have
// been added up voxel by voxel, so the optical depth of the rest is exact.
fn cut_parts(parts: Parts, all: vec4f, cut: Cut) -> Parts {
    let ends = cut.ends;
    let reach = reach_along();
    if ends.x <= -reach && ends.y >= reach {
        return parts;
    }
    let first = before(ends.x, cut.first, all);
    let last = before(ends.y, cut.last, all);
    let b0 = parts.ahead4;
    let b1 = b0 + parts.ahead3;
    let b2 = b1 + parts.ahead2;
    let b3 = b2 + parts.ahead1;
    let b4 = b3 + parts.own;
    let b5 = b4 + parts.behind1;
    let b6 = b5 + parts.behind2;
    let b7 = b6 + parts.behind3;
    let c0 = up_to(-3.5, b0, ends, first, last);
    let c1 = up_to(-2.5, b1, ends, first, last);
    let c2 = up_to(-1.5, b2, ends, first, last);
    let c3 = up_to(-0.5, b3, ends, first, last);
    let c4 = up_to(0.5, b4, ends, first, last);
    let c5 = up_to(1.5, b5, ends, first, last);
    let c6 = up_to(2.5, b6, ends, first, last);
    let c7 = up_to(3.5, b7, ends, first, last);
    return Parts(c4 - c3, c3 - c2, c2 - c1, c1 - c0, c0 - first, c5 - c4, c6 - c5, c7 - c6, last - c7);
}

// The tolerated deficit of optical depth, or surplus of colour, of a slab. The fit of parts has small errors around
// zero. While they are small in optical depth, errors of neighbours cancel. Settling them would increase the error of
// colours in ordinary material up to fourfold.
const LEEWAY: f32 = 0.03;
// The largest slope of a neighbour that shapes a slab, as a multiple of the slab's own optical depth plus 1: if
// extinction rises more steeply, only light from the front of the slab counts.
const STEEPEST: f32 = 3.0;

// A slab and the slab behind it after settling. Up to the leeway, a settled slab has no negative optical depth, and no
// more of a colour than its extinction can have. The slab pays the deficit of the slab behind it, and leaves its own
// deficit or surplus to that slab. So the sums over all slabs are the sums of whole kernels. `x` is the slab, `y` the
// slab behind it, in optical depth.
struct Pair {
    x: vec4f,
    y: vec4f,
}

// A slab within the leeway: extinction and colours are reduced alike, and no colour has a larger deficit.
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

// Composites the slab of plane `plane`, which waits in `ray`, now that the slab behind it is known.
//
// Its colour changes with optical depth u as c(u) = mean + g (u / depth - 1/2), with g from its neighbours: exact to
// second order. The integral of c(u) exp(-u) is mean (1 - exp(-depth)) - g f(depth), f(depth) = 1/2 + exp(-depth) / 2 -
// (1 - exp(-depth)) / depth. The fraction below, for f(depth) / depth^2, errs by at most 0.04 / depth^2, and is exact
// for small depths.
fn advance(ray: ptr<function, RayState>, behind: vec4f, geometry: RayGeometry) {
    let pair = settled((*ray).slab, behind * (rays.density_scale * geometry.stretch));
    let before = (*ray).before;
    (*ray).before = pair.x;
    (*ray).slab = pair.y;
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
    let leeway = LEEWAY * (*ray).transmittance;
    (*ray).color += clamp(
        color,
        rays.brightest * min(absorbed, 0.0) - leeway,
        rays.brightest * max(absorbed, 0.0) + leeway,
    );
    (*ray).depth += depth;
    (*ray).transmittance = passed;
}

// A run of planes begins. Only the deficit of the last slab of the previous run is pending.
fn begin_run(ray: ptr<function, RayState>) {
    (*ray).before = vec4f(0.0);
}

// The optical depth of a finished ray, less the remaining deficit of the last slab.
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
    let color = ray.color * min(alpha / max(absorbed(ray.depth), 1e-30), 1.0);
    return vec4f(clamp(color, vec3f(0.0), rays.brightest * alpha), alpha);
}

// Planes marched after the last plane of a run: kernels reach 2 REACH slabs beyond it, and slabs are composited a plane
// later. Kernels of eight rays that share voxels reach 2.
override FLUSH: i32 = 2 * REACH + 1;
const FLUSH_EIGHT: i32 = 5;

fn is_opaque(ray: RayState) -> bool {
    return ray.depth > rays.opaque_depth;
}

// The incomplete slabs, the foremost first: from four before the next plane to three behind it. If kernels reach 3
// planes, the first has been composited and the last is empty.
struct Slabs {
    s#: vec4f,
}

// The share of the lattice around the point where a ray meets a plane. The shares of all lattices add up to 1.
fn layer_share(geometry: RayGeometry, plane: i32) -> f32 {
    let growth = growth_at(geometry, plane);
    let near = saturate((growth - rays.fade_in.x) * rays.fade_in.y);
    return near * saturate((rays.fade_out.x - growth) * rays.fade_out.y);
}

// Adds a plane to the slabs that its kernels reach, and composites the slab before the foremost of these.
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
        share = layer_share(geometry, plane);
        sums = Moments(share * all.m0, share * all.m1, share * all.m2);
    }
    var parts = parts_of(section_at(geometry.near, geometry, plane), sums);
    if CLIP_PLANES > 0u {
        let cut = cut_at(geometry.cut, geometry.base, geometry, plane, end);
        parts = cut_parts(parts, sums.m0, Cut(cut.ends, share * cut.first, share * cut.last));
    }
    let pending = *slabs;
    var complete = pending.s1 + parts.ahead3;
    if REACH > 3 {
        complete = pending.s0 + parts.ahead4;
    }
    advance(ray, complete, geometry);
    *slabs = Slabs(
        pending.s1 + parts.ahead3,
        pending.s2 + parts.ahead2,
        pending.s3 + parts.ahead1,
        pending.s4 + parts.own,
        pending.s5 + parts.behind1,
        pending.s6 + parts.behind2,
        pending.s7 + parts.behind3,
        parts.behind4,
    );
}

@compute @workgroup_size(64)
fn single(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    let at = point_of(tile, lane);
    let share = share_of(line_of(at));
    if PERSPECTIVE && share == 0.0 {
        return;
    }
    let geometry = geometry_of(at);
    let value = share * finished(march_planes(tile, geometry, new_ray()));
    if RESAMPLED {
        textureStore(intermediate, at, value);
    } else {
        add_to_pixel(at, value);
    }
}

// The rays of pixels through one of several lattices, which are marched front to back. Each adds its change of a ray's
// colour to the pixel.
@compute @workgroup_size(64)
fn layer(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    let at = point_of(tile, lane);
    let share = share_of(line_of(at));
    if any(at >= rays.picture) || share == 0.0 {
        return;
    }
    let geometry = geometry_of(at);
    let index = at.y * rays.picture.x + at.x;
    let before = gathered_before[index];
    var ray = new_ray();
    ray.color = before.rgb;
    ray.depth = before.w;
    ray.transmittance = exp(-before.w);
    ray = march_planes(tile, geometry, ray);
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

// `Slabs` of kernels with a radius of at most 2 voxels.
struct NearSlabs {
    s0: vec4f,
    s1: vec4f,
    s2: vec4f,
    s3: vec4f,
}

// `feed` for kernels with a radius of at most 2 voxels, for ray `number` of eight. `is_cut`: the plane is near a cut.
fn feed_near(
    ray: ptr<function, RayState>,
    slabs: ptr<function, NearSlabs>,
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
    let pending = *slabs;
    advance(ray, pending.s0 + parts.ahead2, geometry);
    *slabs = NearSlabs(
        pending.s1 + parts.ahead1,
        pending.s2 + parts.own,
        pending.s3 + parts.behind1,
        parts.behind2,
    );
}

// A run begins: see `begin_run`.
fn restart(ray: ptr<function, RayState>, slabs: ptr<function, NearSlabs>) {
    begin_run(ray);
    *slabs = NearSlabs();
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

// The cuts of eight rays: `across` in a row, a step `x` apart, in rows a step `y` apart.
fn eight_cuts(geometry: RayGeometry, across: u32, x: vec2f, y: vec2f) -> EightCuts {
    var eight = EightCuts();
    if CLIP_PLANES > 0u {
        eight.begin = vec2f(FAR, -FAR);
        eight.end = vec2f(FAR, -FAR);
        for (var i = 0u; i < 8u; i++) {
            let base = geometry.base + f32(i % across) * x + f32(i / across) * y;
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
    if CLIP_PLANES == 0u {
        return run;
    }
    let beyond = REACH + 1;
    return vec2i(max(run.x, i32((*eight).begin.x) - beyond), min(run.y, i32((*eight).end.y) + beyond + 1));
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

@compute @workgroup_size(8)
fn blocked(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    let at = first_ray(tile) + vec2u(0u, lane * rays.phases.y);
    let geometry = geometry_of(at);
    let direction = geometry.direction.xy;
    var eight = eight_cuts(geometry, 8u, vec2f(1.0, 0.0), vec2f(0.0));
    var ray# = new_ray();
    var slabs#: NearSlabs;
    var depth = 0.0;
    for (var slot = 0u; ; slot++) {
        let run = run_at(tile, slot, depth);
        if run.y == 0 {
            break;
        }
        let planes = planes_of_eight(run, &eight);
        let end = min(planes.y, rays.voxels.z);
        restart(&ray#, &slabs#);
        for (var plane = planes.x; plane < planes.y + FLUSH_EIGHT; plane++) {
            let center = geometry.base + geometry.shear * f32(plane);
            let rows = rows_of(plane, end, center.y, geometry.footprint_half.y);
            let origin = plane_texel(plane);
            var sums# = Moments();
            for (var row = rows.x; row <= rows.y; row++) {
                let at_row = voxel_row(geometry, center, row, origin, geometry.row_half);
                let w = row_weights(at_row, direction, 1.0);
                let t0 = voxels_at(at_row.texel + vec2i(0, 0));
                let t1 = voxels_at(at_row.texel + vec2i(1, 0));
                let t2 = voxels_at(at_row.texel + vec2i(2, 0));
                let t3 = voxels_at(at_row.texel + vec2i(3, 0));
                let t4 = voxels_at(at_row.texel + vec2i(4, 0));
                let t5 = voxels_at(at_row.texel + vec2i(5, 0));
                let t6 = voxels_at(at_row.texel + vec2i(6, 0));
                let v0 = first_of(t0);
                let v1 = second_of(t0);
                let v2 = first_of(t1);
                let v3 = second_of(t1);
                let v4 = first_of(t2);
                let v5 = second_of(t2);
                let v6 = first_of(t3);
                let v7 = second_of(t3);
                let v8 = first_of(t4);
                let v9 = second_of(t4);
                let v10 = first_of(t5);
                let v11 = second_of(t5);
                let v12 = first_of(t6);
                add_row(&sums0, w, v0, v1, v2, v3, v4, v5);
                add_row(&sums1, w, v1, v2, v3, v4, v5, v6);
                add_row(&sums2, w, v2, v3, v4, v5, v6, v7);
                add_row(&sums3, w, v3, v4, v5, v6, v7, v8);
                add_row(&sums4, w, v4, v5, v6, v7, v8, v9);
                add_row(&sums5, w, v5, v6, v7, v8, v9, v10);
                add_row(&sums6, w, v6, v7, v8, v9, v10, v11);
                add_row(&sums7, w, v7, v8, v9, v10, v11, v12);
            }
            let is_cut = find_cuts(&eight, geometry, plane, end);
            feed_near(&ray#, &slabs#, sums#, geometry, &eight, #u, is_cut);
            depth = least(
                vec4f(ray0.depth, ray1.depth, ray2.depth, ray3.depth),
                vec4f(ray4.depth, ray5.depth, ray6.depth, ray7.depth),
            );
            if depth > rays.opaque_depth {
                break;
            }
        }
    }
    textureStore(intermediate, at + vec2u(#u * rays.phases.x, 0u), finished(ray#));
}

// The pixels across a block of `straight`, 2 or 4, of eight in all.
override ACROSS: u32 = 2u;
// Rows of voxels that reach a ray of a block: 5 to 7, five voxels of each.
override ROWS: u32 = 5u;

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
fn five_voxels(texel: vec2i, odd: bool, origin: vec2i) -> FiveVoxels {
    let at = texel_at(texel, origin);
    let t0 = voxels_at(at);
    let t1 = voxels_at(at + vec2i(1, 0));
    let t2 = voxels_at(at + vec2i(2, 0));
    let u0 = select(t0, vec4u(t0.zw, t1.xy), odd);
    let u1 = select(t1, vec4u(t1.zw, t2.xy), odd);
    let u2 = select(t2, t2.zwzw, odd);
    return FiveVoxels(first_of(u0), second_of(u0), first_of(u1), second_of(u1), first_of(u2));
}

fn weighed(w: FiveWeights, v: FiveVoxels) -> vec4f {
    let f = w.first_four;
    return f.x * v.v0 + f.y * v.v1 + f.z * v.v2 + f.w * v.v3 + w.last * v.v4;
}

// The footprints that a ray of a block meets in every plane.
struct BlockWeights {
    r0: FiveWeights,
    r1: FiveWeights,
    r2: FiveWeights,
    r3: FiveWeights,
    r4: FiveWeights,
    r5: FiveWeights,
    r6: FiveWeights,
}

// The footprints of ray `number` of a block. `first` is the first voxel relative to the first ray.
fn block_weights(first: vec2f, number: u32) -> BlockWeights {
    let d = first - f32(number % ACROSS) * rays.step_x - f32(number / ACROSS) * rays.step_y;
    var w: BlockWeights;
    w.r0 = five_weights(d);
    w.r1 = five_weights(d + vec2f(0.0, 1.0));
    w.r2 = five_weights(d + vec2f(0.0, 2.0));
    w.r3 = five_weights(d + vec2f(0.0, 3.0));
    w.r4 = five_weights(d + vec2f(0.0, 4.0));
    if ROWS > 5u {
        w.r5 = five_weights(d + vec2f(0.0, 5.0));
    }
    if ROWS > 6u {
        w.r6 = five_weights(d + vec2f(0.0, 6.0));
    }
    return w;
}

// The voxels that the rays of a block meet in a plane.
struct BlockVoxels {
    r0: FiveVoxels,
    r1: FiveVoxels,
    r2: FiveVoxels,
    r3: FiveVoxels,
    r4: FiveVoxels,
    r5: FiveVoxels,
    r6: FiveVoxels,
}

fn block_voxels(texel: vec2i, odd: bool, origin: vec2i) -> BlockVoxels {
    var v: BlockVoxels;
    v.r0 = five_voxels(texel, odd, origin);
    v.r1 = five_voxels(texel + vec2i(0, 1), odd, origin);
    v.r2 = five_voxels(texel + vec2i(0, 2), odd, origin);
    v.r3 = five_voxels(texel + vec2i(0, 3), odd, origin);
    v.r4 = five_voxels(texel + vec2i(0, 4), odd, origin);
    if ROWS > 5u {
        v.r5 = five_voxels(texel + vec2i(0, 5), odd, origin);
    }
    if ROWS > 6u {
        v.r6 = five_voxels(texel + vec2i(0, 6), odd, origin);
    }
    return v;
}

// The moments of a plane for one ray. Every kernel has its centre where the ray meets its plane: s is 0.
fn block_moments(w: BlockWeights, v: BlockVoxels) -> Moments {
    var sum = weighed(w.r0, v.r0) + weighed(w.r1, v.r1) + weighed(w.r2, v.r2) + weighed(w.r3, v.r3)
        + weighed(w.r4, v.r4);
    if ROWS > 5u {
        sum += weighed(w.r5, v.r5);
    }
    if ROWS > 6u {
        sum += weighed(w.r6, v.r6);
    }
    return Moments(sum, vec4f(0.0), vec4f(0.0));
}

fn add_ray(first: vec2u, number: u32, ray: RayState) {
    add_to_pixel(first + vec2u(number % ACROSS, number / ACROSS), rays.share * finished(ray));
}

@compute @workgroup_size(8)
fn straight(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    // Blocks across a tile of 8 x 8 pixels, and pixels down a block.
    let down = 8u / ACROSS;
    let at = tile.xy * 8u + vec2u(lane % down * ACROSS, lane / down * down);
    let geometry = geometry_of(at);
    // The least coordinates of a ray along a and b.
    let low = geometry.base + min(vec2f(0.0), f32(ACROSS - 1u) * rays.step_x)
        + min(vec2f(0.0), f32(down - 1u) * rays.step_y);
    let first = vec2i(ceil(low - geometry.footprint_half));
    let odd = (first.x & 1) == 1;
    let d = vec2f(first) - geometry.base;
    // A loop over an array compiles faster, and so many numbers stay in memory anyway.
    var weights: array<BlockWeights, 8>;
    for (var number = 0u; number < 8u; number++) {
        weights[number] = block_weights(d, number);
    }
    var eight = eight_cuts(geometry, ACROSS, rays.step_x, rays.step_y);
    var ray# = new_ray();
    var slabs#: NearSlabs;
    var depth = 0.0;
    for (var slot = 0u; ; slot++) {
        let run = run_at(tile, slot, depth);
        if run.y == 0 {
            break;
        }
        let planes = planes_of_eight(run, &eight);
        let end = min(planes.y, rays.voxels.z);
        restart(&ray#, &slabs#);
        for (var plane = planes.x; plane < planes.y + FLUSH_EIGHT; plane++) {
            // After the run: the rows before the plane, which are zeros.
            let row = select(-i32(ROWS), first.y, plane < end);
            let v = block_voxels(vec2i(first.x >> 1u, row), odd, plane_texel(plane));
            let is_cut = find_cuts(&eight, geometry, plane, end);
            feed_near(&ray#, &slabs#, block_moments(weights[#], v), geometry, &eight, #u, is_cut);
            depth = least(
                vec4f(ray0.depth, ray1.depth, ray2.depth, ray3.depth),
                vec4f(ray4.depth, ray5.depth, ray6.depth, ray7.depth),
            );
            if depth > rays.opaque_depth {
                break;
            }
        }
    }
    add_ray(at, #u, ray#);
}
