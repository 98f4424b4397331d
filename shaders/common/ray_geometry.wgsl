// The geometry and the state of a ray of the painter `tiles`, shared by gather.wgsl and gather_scalars.wgsl.
// Both declare `solid_depths`, the depth of the solid of each pixel.
// uses: common/half_depth, common/rays

// Voxels are scalars.
override SCALARS: bool = false;

// A section of kernels that have not grown, and its coefficients of the growth less 1 and of the square of that.
struct GrowingSection {
    as_asked: Section,
    once: Section,
    twice: Section,
}

// The constants of a ray. Lengths are in voxels unless a name says otherwise; axes (a, b, m) as in
// common/rays.wgsl.
struct RayGeometry {
    // The ray meets plane k at base + k shear.
    base: vec2f,
    shear: vec2f,
    // Unit vector in (a, b, m).
    direction: vec3f,
    // World length per lattice length.
    stretch: f32,
    // See Rays.
    footprint_half: vec2f,
    row_half: f32,
    row_slope: f32,
    // The parts of kernels in near slabs, and in far ones.
    near: GrowingSection,
    far: GrowingSection,
    // The growth of a kernel where the ray meets plane 0, and its change from plane to plane.
    growth: vec2f,
    // The planes, as real numbers, between which the ray counts: of scalars in front of the eye and inside the box; of
    // colours all or, if the volume along the ray is behind the eye, none.
    inside: vec2f,
    // The planes between which the ray is unclipped.
    cut: vec2f,
    // The planes between which a brick owns the ray: borders of slabs.
    owned: vec2f,
    // Unit vector to the eye, view coordinates.
    to_eye: vec3f,
}

// The state of a ray.
struct RayState {
    // Premultiplied colour. For the largest scalar: color.x is the scalar, color.y is 1 once there is one, and color.z
    // is its place, in planes. For the mean: color.x is the sum over slabs.
    color: vec3f,
    // Optical depth, and exp of minus it.
    depth: f32,
    transmittance: f32,
    // Sums of the last two complete slabs: `slab` is composited when the next slab is complete.
    before: vec4f,
    slab: vec4f,
    // Of a brick: the plane in the middle of the slab that waits.
    place: f32,
}

fn new_ray() -> RayState {
    return RayState(vec3f(0.0), 0.0, 1.0, vec4f(0.0), vec4f(0.0), -FAR);
}

// A ray behind the layers before, given the premultiplied colour and the optical depth that it has collected there.
fn ray_behind(before: vec4f) -> RayState {
    var ray = new_ray();
    ray.color = before.rgb;
    ray.depth = before.w;
    ray.transmittance = exp(-before.w);
    return ray;
}

struct Tables {
    // Parallel rays use the first section. Other rays interpolate, with s in units of the length of their shear.
    sections: array<Section, 2u * FAR_SECTIONS>,
}

// Between two entries of the table of sections.
fn section_between(step: u32, fraction: f32, lean: f32) -> Section {
    let low = tables.sections[step];
    let high = tables.sections[step + 1u];
    return Section(
        mix(low.by_m0, high.by_m0, fraction),
        mix(low.by_m1, high.by_m1, fraction) / lean,
        mix(low.by_m2, high.by_m2, fraction) / (lean * lean),
    );
}

// A section that grows, between two entries of each table.
fn sections_between(step: u32, fraction: f32, lean: f32) -> GrowingSection {
    return GrowingSection(
        section_between(step, fraction, lean),
        section_between(step + SECTIONS, fraction, lean),
        section_between(step + 2u * SECTIONS, fraction, lean),
    );
}

fn geometry_of(pixel: vec2u) -> RayGeometry {
    let line = line_of(pixel);
    var geometry = RayGeometry(line.base, line.shear, rays.direction, rays.stretch, rays.footprint_half, rays.row_half,
        rays.row_slope, GrowingSection(tables.sections[0], Section(), Section()),
        GrowingSection(tables.sections[FAR_SECTIONS], Section(), Section()), vec2f(1.0, 0.0), vec2f(-FAR, FAR),
        vec2f(-FAR, FAR), vec2f(-FAR, FAR), vec3f(0.0, 0.0, -1.0));
    if PERSPECTIVE {
        let per_length = inverseSqrt(dot(line.heading, line.heading));
        let d = line.heading * per_length;
        let slope = rays.slope_origin + vec2f(pixel + rays.corner) * rays.slope_step;
        let slant = sqrt(1.0 + dot(slope, slope));
        geometry.direction = d;
        geometry.stretch = slant * per_length;
        geometry.footprint_half = footprint_half_of(line.shear);
        let square = 1.0 - d.x * d.x;
        geometry.row_half = sqrt(rays.radius2 / square);
        geometry.row_slope = d.x * d.y / square;
        // A ray along m has lean 0 and meets every kernel at s = 0. 1e-4 keeps the quotients finite; if the lean is
        // less, s is below 2e-4 and its terms are negligible.
        let lean = max(length(line.shear), 1e-4);
        // The last step ends just before the last entry, so that step + 1 is an entry.
        let place = clamp(lean * SECTION_STEPS, 0.0, f32(SECTIONS) - 1.001);
        let step = u32(place);
        geometry.near = sections_between(step, place - f32(step), lean);
        geometry.far = sections_between(step + FAR_SECTIONS, place - f32(step), lean);
        let slope_along = dot(rays.growth_slope, vec3f(line.shear, 1.0));
        let at_first = rays.growth_middle + dot(rays.growth_slope.xy, line.base - rays.middle);
        geometry.growth = vec2f(at_first, slope_along);
        geometry.to_eye = -vec3f(slope, 1.0) / slant;
    }
    if SCALARS || PERSPECTIVE {
        // The ray against the sides of the box (Kay and Kajiya 1986, "Ray tracing complex scenes"). A component of 0 is
        // replaced by a tiny one, whose ends lie far outside.
        let shear = select(line.shear, vec2f(1e-20), abs(line.shear) < vec2f(1e-20));
        let a = (rays.box_low.xy - line.base) / shear;
        let b = (rays.box_high.xy - line.base) / shear;
        let near = min(a, b);
        let far = max(a, b);
        let eye = select(-FAR, rays.eye_plane, PERSPECTIVE);
        geometry.inside = vec2f(
            max(max(near.x, near.y), rays.box_low.z),
            min(min(far.x, far.y), rays.box_high.z),
        );
        if SCALARS {
            geometry.inside.x = max(geometry.inside.x, eye);
        } else {
            // The eye is outside the box, so the box part of a ray lies wholly in front of the eye or wholly behind.
            let in_front = 0.5 * geometry.inside.x + 0.5 * geometry.inside.y > eye;
            geometry.inside = select(vec2f(FAR, -FAR), vec2f(-FAR, FAR), in_front);
        }
    }
    if CUT {
        geometry.cut = cut_of(line.base, line.shear);
        geometry.inside = vec2f(max(geometry.inside.x, geometry.cut.x), min(geometry.inside.y, geometry.cut.y));
    }
    if BRICK {
        // The middles of slabs of colours are planes, and slabs of scalars are half a plane thick.
        let owned = owned_of(line);
        geometry.owned = select(ceil(owned) - 0.5, 0.5 * ceil(2.0 * owned - 0.5), SCALARS);
    }
    if LAYERED {
        // Growth increases along a ray: it follows depth.
        let per_plane = max(geometry.growth.y, 1e-20);
        let ends = (vec2f(rays.fade_in.x, rays.fade_out.x) - geometry.growth.x) / per_plane;
        geometry.inside = vec2f(max(geometry.inside.x, ends.x), min(geometry.inside.y, ends.y));
    }
    return geometry;
}

// The geometry of the ray of a pixel, which ends at the pixel's solid.
fn geometry_of_pixel(at: vec2u) -> RayGeometry {
    var geometry = geometry_of(at);
    if SOLIDS {
        let pixel = min(at, rays.picture - 1u);
        let solid = solid_depths[pixel.y * rays.picture.x + pixel.x];
        let in_front = solid - depth_of(geometry, 0.0);
        geometry.cut = on_inner_side(geometry.cut, in_front, depth_of(geometry, 0.0) - depth_of(geometry, 1.0));
        geometry.cut = clamp(geometry.cut, vec2f(-FAR), vec2f(FAR));
        geometry.inside.y = min(geometry.inside.y, geometry.cut.y);
    }
    return geometry;
}

// The depth of a place on a ray, `plane` planes from plane 0, as solids have it.
fn depth_of(geometry: RayGeometry, plane: f32) -> f32 {
    return dot(rays.view_depth, vec4f(geometry.base + geometry.shear * plane, plane, 1.0));
}

// The share of the layer `plane` planes from plane 0 along a ray. The shares of all layers add up to 1.
fn layer_share(geometry: RayGeometry, plane: f32) -> f32 {
    let growth = geometry.growth.x + geometry.growth.y * plane;
    let near = saturate((growth - rays.fade_in.x) * rays.fade_in.y);
    return near * saturate((rays.fade_out.x - growth) * rays.fade_out.y);
}

// The pixel of an invocation, in a tile of 8 x 8 neighbours. Eight invocations in a row, which software marches
// together, are a block of 4 x 2 pixels: their rays end at more nearly the same depth than the rays of a row.
fn pixel_of(tile: vec3u, lane: u32) -> vec2u {
    let x = (lane & 3u) | ((lane >> 1u) & 4u);
    let y = ((lane >> 2u) & 1u) | ((lane >> 3u) & 6u);
    return tile.xy * 8u + vec2u(x, y);
}

// Run number `slot` of a tile: its first plane, and the plane after its last, from the first plane of the foremost
// macrocells on. (0, 0) if there are no more runs, or if the ray is opaque.
fn run_at(tile: vec3u, slot: u32, depth: f32) -> vec2i {
    let run = vec2i(runs[run_index(tile, slot)]);
    return select(run, vec2i(0), depth > rays.opaque_depth);
}

// The planes of a run that are packed: the first, and the plane after the last.
fn run_planes(run: vec2i) -> vec2i {
    return clamp(run - rays.lead, vec2i(0), vec2i(rays.voxels.z)) + rays.first.z;
}

// Whether a brick owns the slab in the middle of which this plane is.
fn is_owned(geometry: RayGeometry, plane: f32) -> bool {
    return plane > geometry.owned.x && plane < geometry.owned.y;
}

// Adds a share of the colour of a pixel, or of a brick's partial picture, which starts at 0.
fn add_to_pixel(at: vec2u, value: vec4f) {
    if all(at < rays.picture) {
        let index = at.y * rays.picture.x + at.x;
        if BRICK {
            pixels[index] += value;
        } else {
            pixels[index] = with_share(pixels[index], value);
        }
    }
}

// Sections of kernels as large as those around the place where the ray meets a plane.
fn section_at(sections: GrowingSection, geometry: RayGeometry, plane: i32) -> Section {
    if GROWN {
        let t = clamp(growth_at(geometry, plane), 1.0, rays.growth_most) - 1.0;
        let once = sections.once;
        let twice = sections.twice;
        return Section(
            sections.as_asked.by_m0 + t * (once.by_m0 + t * twice.by_m0),
            sections.as_asked.by_m1 + t * (once.by_m1 + t * twice.by_m1),
            sections.as_asked.by_m2 + t * (once.by_m2 + t * twice.by_m2),
        );
    }
    return sections.as_asked;
}
