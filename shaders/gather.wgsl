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
// uses: common/absorbed, common/plane, common/ray_geometry, common/response

@group(0) @binding(0) var<uniform> uniform_rays: Rays;
@group(0) @binding(2) var<storage, read> runs: array<vec2u>;
// The picture, to which rays add.
@group(0) @binding(3) var<storage, read_write> pixels: array<vec4f>;
@group(0) @binding(4) var<storage, read> solid_depths: array<f32>;
@group(0) @binding(5) var<uniform> tables: Tables;
// See common/pages.wgsl.
@group(0) @binding(6) var<storage, read> page_table: array<u32>;
// For each pixel, the state of its ray behind the layers before: premultiplied colour and optical depth.
@group(0) @binding(7) var<storage, read_write> gathered_before: array<vec4f>;

// Parts are parabolas in s.
override CURVED: bool = false;

// Planes that kernels reach before and behind their own: 2 to 4.
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

// Marches a ray on from the state `start`.
fn march_planes(tile: vec3u, geometry: RayGeometry, start: RayState) -> RayState {
    let footprints = footprints_of(geometry);
    var ray = start;
    for (var slot = 0u; ; slot++) {
        let run = run_at(tile, slot, ray.depth);
        if run.y == 0 {
            break;
        }
        let planes = planes_of(run, geometry);
        var slabs = Slabs();
        begin_run(&ray);
        for (var plane = planes.x; plane < planes.z; plane++) {
            feed(&ray, &slabs, gathered(geometry, footprints, plane, planes.y), geometry, plane, planes.y);
            if is_opaque(ray) {
                break;
            }
        }
    }
    return ray;
}

// The planes of a run of colours that can matter to a ray: the first, the plane after the last, and the plane after the
// last that completes a slab.
fn planes_of(run: vec2i, geometry: RayGeometry) -> vec3i {
    let ends = run_planes(run);
    var first = ends.x;
    var end = ends.y;
    if PERSPECTIVE || CUT {
        // Planes beyond the counting part: the planes that kernels reach over, one because the next slab shapes the
        // curve in the last slab, and one because the conversion to i32 truncates, towards 0. One more because the
        // second plane is the plane after the last.
        let beyond = REACH + 2;
        first = max(first, i32(max(geometry.inside.x, -FAR)) - beyond);
        end = min(end, i32(min(geometry.inside.y, FAR)) + beyond + 1);
    }
    var last = end + FLUSH;
    if BRICK {
        // The slab before the first that a brick owns shapes it. The lack of colours of two slabs before moves on to
        // it.
        let owned = vec2i(floor(geometry.owned));
        first = max(first, owned.x - 2 - REACH);
        last = min(last, owned.y + FLUSH - REACH + 1);
        end = min(end, last);
    }
    return vec3i(first, end, last);
}

@compute @workgroup_size(64)
fn gather(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    rays = uniform_rays;
    let at = pixel_of(tile, lane);
    let share = share_of(line_of(at));
    if PERSPECTIVE && share == 0.0 {
        return;
    }
    let geometry = geometry_of_pixel(at);
    let ray = march_planes(tile, geometry, new_ray());
    if BRICK {
        add_to_pixel(at, partial(ray, geometry));
    } else {
        add_to_pixel(at, share * finished(ray));
    }
}

// The rays of pixels through one of several layers, which are marched front to back. Each layer adds to the pixels the
// change of their rays' colours.
@compute @workgroup_size(64)
fn layer(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) tile: vec3u) {
    rays = uniform_rays;
    let at = pixel_of(tile, lane);
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
