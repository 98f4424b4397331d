// splat: one instanced quad for each splat and batch. A fragment evaluates the sections of its splat's kernel between
// the sheet planes of the batch. It adds (colour, 1) times density times section to each sheet of the batch. If splats
// are scalars, it adds the scalar times the mean of the kernel over the sheet instead, four sheets to a target. If they
// are lit, it adds (gradient, scalar) times that mean, a sheet to a target.
// uses: common/absorbed, common/bounds, common/frame, common/lit_splat, common/ray_parts
// uses: common/ray_parts, common/splat

// Texels of a row of the footprint table, four coefficients each: 1 to 4.
override TEXELS: u32 = 2u;
// Rows of the footprint table, at equal steps of the squared half chord.
override ROWS: u32 = 256u;
// Sheets are voxel planes, which take whole footprints, not slabs, which take sections.
override AXIS: bool = false;
// Sheets add up opacity, not optical depth.
override ADDITIVE: bool = false;
// Kernels end where a brick ends: the one sheet of an X-ray has no owner.
override CUT_OWNED: bool = false;

struct Batch {
    // View depth of the first sheet plane of the batch. If sheets are voxel planes, of the first sheet plane of the
    // frame.
    depth: f32,
    // Number of the first sheet of the batch.
    first_sheet: u32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> batch: Batch;
@group(0) @binding(2) var<storage, read> splats: array<vec2u>;
// The cumulative footprint: the coefficients of a row are the texels (0 .. TEXELS, row).
@group(0) @binding(3) var footprint: texture_storage_2d<rgba32float, read>;
@group(0) @binding(4) var<storage, read> origins: array<vec4u>;
@group(0) @binding(5) var<uniform> lighting: Lighting;
// The depth of the solid of each pixel of the region.
@group(0) @binding(6) var<storage, read> solid_depths: array<f32>;

struct Varyings {
    @builtin(position) position: vec4f,
    // View coordinates of the splat's centre.
    @location(0) @interpolate(flat) center: vec3f,
    // The contribution to a sheet of a section with a world length of 1: (colour, 1) * density * section_scale. Of
    // scalars, the contribution of a mean of 1: (gradient, scalar) * section_scale.
    @location(1) @interpolate(flat) emission: vec4f,
    // 1 / growth of the kernel, see common/bounds.wgsl.
    @location(2) @interpolate(flat) shrink: f32,
    // If sheets are voxel planes: number of the splat's sheet in the batch.
    @location(3) @interpolate(flat) sheet: u32,
}

// Unit vector from a splat's centre to the eye, view coordinates.
fn to_eye_from(center: vec3f) -> vec3f {
    if PERSPECTIVE {
        let z = center.z + frame.eye_depth;
        let v = vec3f(center.xy + frame.home_slope * z, z);
        // Scaled to about 1 before it is squared: the eye may be 1e30 away, or on the splat.
        let size = max(abs(v.x), max(abs(v.y), abs(v.z)));
        if size > 0.0 {
            return -normalize(v / size);
        }
    }
    return vec3f(0.0, 0.0, -1.0);
}

@vertex
fn vertex(@builtin(vertex_index) corner: u32, @location(0) entry: u32) -> Varyings {
    // All corners in one place, so that there are no fragments.
    let nothing = Varyings(vec4f(2.0, 2.0, 0.0, 1.0), vec3f(0.0), vec4f(0.0), 1.0, 0u);
    if is_terminated(entry) {
        return nothing;
    }
    let words = splat_words(entry);
    let lattice = splat_lattice(words);
    let center = view_center(lattice);
    let growth = growth_at(center.z);
    let side = vec2f(f32(corner & 1u), f32(corner >> 1u)) * 2.0 - 1.0;
    // Scalars are cut when they are classified.
    if CLIP_PLANES > 0u && !SCALARS && is_cut_away(center, frame.radius * growth) {
        return nothing;
    }
    var box: vec4f;
    if bounded(center, growth) {
        box = bounds(center, growth);
    } else if in_view(center, growth) {
        box = cut_bounds(center, growth);
    } else {
        return nothing;
    }
    // Clamped to the surroundings of the image: a rasteriser that clips a quad of 1e9 pixels moves its edges.
    let clip = clamp((box.xy + side * box.zw) * frame.clip_scale + frame.clip_offset, vec2f(-2.0), vec2f(2.0));
    var density = splat_weight(words);
    if ADDITIVE {
        density = absorbed(density);
    }
    let scale = frame.section_scale / (growth * growth * growth);
    density *= scale;
    var emission = vec4f(0.0, 0.0, 0.0, density);
    if SCALARS {
        if GRADIENTS {
            emission = vec4f(splat_gradient(entry) * scale, density);
        }
    } else {
        let appearance = splats[splat_at(entry) + 1u];
        var color = splat_color(words.y, appearance.x);
        if LIGHTS > 0u {
            color = lit_splat(color, appearance.y, splat_kept(entry), lattice, to_eye_from(center));
        }
        emission = vec4f(color * density, density);
    }
    var sheet = 0u;
    if AXIS {
        sheet = u32(round(dot(frame.plane_axis, lattice) + frame.plane_offset)) - batch.first_sheet;
    }
    return Varyings(vec4f(clip, 0.0, 1.0), center, emission, 1.0 / growth, sheet);
}

// The chord of a fragment's ray in a splat's support, and the row of the footprint table for its length. Written out,
// without loops and arrays: a compiler that does not unroll loops keeps arrays in memory, which takes five times as
// long on lavapipe.
struct Chord {
    // Place of the batch's first sheet plane. Places are lattice lengths along the ray from the middle of the chord.
    first: f32,
    // Distance between sheet planes.
    step: f32,
    // The ends of the chord: half its length before and behind its middle, or nearer at a cut.
    low: f32,
    high: f32,
    // 1 / half^2.
    inverse_half2: f32,
    // World length per lattice length along the ray; if splats are scalars, 1 / the lattice length of the ray in a
    // sheet.
    scale: f32,
    // If sheets are voxel planes: number of the splat's sheet in the batch.
    sheet: u32,
    // Coefficients 4 n to 4 n + 3 of the row: TEXELS of them.
    a: array<vec4f, 8>,
}

// Coefficients at a fraction `f` of the way from row `row` to the next.
fn coefficients(texel: u32, row: u32, f: f32) -> vec4f {
    let a = textureLoad(footprint, vec2u(texel, row));
    let b = textureLoad(footprint, vec2u(texel, row + 1u));
    return a + (b - a) * f;
}

fn chord(in: Varyings) -> Chord {
    let plane = in.position.xy * frame.pixel_scale + frame.pixel_offset;
    // The ray in lattice coordinates per unit of view depth, and its offset from the splat's centre at the depth of the
    // centre.
    var ray = frame.grid_forward;
    var offset = plane - in.center.xy;
    var world_per_depth = 1.0;
    if PERSPECTIVE {
        ray += frame.grid_right * plane.x + frame.grid_up * plane.y;
        offset = plane * (in.center.z + frame.eye_depth) - in.center.xy;
        let slope = plane + frame.home_slope;
        world_per_depth = sqrt(1.0 + dot(slope, slope));
    }
    // A kernel s times as large is the same kernel in a lattice s times as wide.
    if GROWN {
        ray *= in.shrink;
        offset *= in.shrink;
    }
    let q = frame.grid_right * offset.x + frame.grid_up * offset.y;
    let grid_per_depth = length(ray);
    let along = dot(q, ray) / grid_per_depth;
    // The distance of the ray from the centre. On an anisotropic lattice q may be long and nearly parallel to the ray:
    // |q|^2 - along^2 would cancel.
    let across = cross(q, ray) / grid_per_depth;
    let half2 = frame.radius * frame.radius - dot(across, across);
    if half2 <= 0.0 {
        discard;
    }
    var c: Chord;
    c.first = (batch.depth - in.center.z) * grid_per_depth + along;
    c.step = frame.sheet_step * grid_per_depth;
    let half = sqrt(max(half2, 0.0));
    c.low = -half;
    c.high = half;
    if (CUT || CUT_OWNED) && !SCALARS {
        var part = clipped(vec2f(-BEYOND, BEYOND), plane);
        if SOLIDS {
            let pixel = vec2u(in.position.xy);
            part = before_solid(part, solid_depths[pixel.y * frame.region.x + pixel.x]);
        }
        if CUT_OWNED {
            let owned = owned_depths(vec2u(in.position.xy), PERSPECTIVE);
            part = vec2f(max(part.x, owned.x), min(part.y, owned.y));
        }
        let inside = (part - in.center.z) * grid_per_depth + along;
        c.low = clamp(inside.x, -half, half);
        c.high = clamp(inside.y, c.low, half);
    }
    c.inverse_half2 = 1.0 / half2;
    c.scale = world_per_depth / grid_per_depth;
    if SCALARS {
        c.scale = 1.0 / c.step;
    }
    c.sheet = in.sheet;
    let s = clamp(half2 / (frame.radius * frame.radius), 0.0, 1.0) * f32(ROWS - 1u);
    let row = min(u32(s), ROWS - 2u);
    let f = s - f32(row);
    if #u < TEXELS { c.a[#] = coefficients(#u, row, f); }
    return c;
}

fn horner(sum: f32, q: f32, a: vec4f) -> f32 {
    return (((sum * q + a.w) * q + a.z) * q + a.y) * q + a.x;
}

// The integral of the kernel along the ray, in world length, from the middle of the chord to place `t`.
fn cumulative_to(c: Chord, t: f32) -> f32 {
    let q = max(1.0 - t * t * c.inverse_half2, 0.0);
    var sum = 0.0;
    if 7u - #u < TEXELS { sum = horner(sum, q, c.a[7 - #]); }
    return sum * t * c.scale;
}

// The place of sheet plane `k` of the batch, within the chord behind the eye.
fn place_of_plane(c: Chord, k: f32) -> f32 {
    return clamp(c.first + k * c.step, c.low, c.high);
}

// The footprint behind the first sheet plane of the frame.
fn whole(c: Chord) -> f32 {
    return max(cumulative_to(c, c.high) - cumulative_to(c, place_of_plane(c, 0.0)), 0.0);
}

// The section of sheet `k`. Exactly 0 if no part of the chord is in the sheet, and never below 0: two integrals to the
// same place may differ by rounding, if the compiler contracts one of them otherwise. A scalar on the other side of the
// base would be visible, and a gradient of rounding would light a sheet that has none.
fn section(c: Chord, k: u32) -> f32 {
    if AXIS {
        return select(0.0, whole(c), c.sheet == k);
    }
    let from_plane = place_of_plane(c, f32(k));
    let to_plane = place_of_plane(c, f32(k) + 1.0);
    let part = cumulative_to(c, to_plane) - cumulative_to(c, from_plane);
    return select(0.0, max(part, 0.0), to_plane > from_plane);
}

// The sections of four consecutive sheets, from the five planes around them.
fn sections(c: Chord, first: u32) -> vec4f {
    if AXIS {
        return select(vec4f(0.0), vec4f(whole(c)), vec4u(0u, 1u, 2u, 3u) + first == vec4u(c.sheet));
    }
    let k = f32(first);
    let p = clamp(c.first + (k + vec4f(0.0, 1.0, 2.0, 3.0)) * c.step, vec4f(c.low), vec4f(c.high));
    let end = place_of_plane(c, k + 4.0);
    let g = vec4f(cumulative_to(c, p.x), cumulative_to(c, p.y), cumulative_to(c, p.z), cumulative_to(c, p.w));
    let parts = vec4f(g.yzw, cumulative_to(c, end)) - g;
    return select(vec4f(0.0), max(parts, vec4f(0.0)), vec4f(p.yzw, end) > p);
}

struct Sheets1 {
    @location(0) s0: vec4f,
}

@fragment
fn feed_1(in: Varyings) -> Sheets1 {
    return Sheets1(in.emission * section(chord(in), 0u));
}

// X-ray: optical depth alone.
@fragment
fn feed_depth(in: Varyings) -> @location(0) f32 {
    return in.emission.a * section(chord(in), 0u);
}

struct Sheets4 {
    @location(0) s0: vec4f,
    @location(1) s1: vec4f,
    @location(2) s2: vec4f,
    @location(3) s3: vec4f,
}

@fragment
fn feed_4(in: Varyings) -> Sheets4 {
    let s = sections(chord(in), 0u);
    let e = in.emission;
    return Sheets4(e * s.x, e * s.y, e * s.z, e * s.w);
}

struct Sheets8 {
    @location(#) s#: vec4f,
}

@fragment
fn feed_8(in: Varyings) -> Sheets8 {
    let c = chord(in);
    let s = sections(c, 0u);
    let r = sections(c, 4u);
    let e = in.emission;
    return Sheets8(e * s.x, e * s.y, e * s.z, e * s.w, e * r.x, e * r.y, e * r.z, e * r.w);
}

struct Scalars8 {
    @location(0) s0123: vec4f,
    @location(1) s4567: vec4f,
}

@fragment
fn scalars_4(in: Varyings) -> Sheets1 {
    return Sheets1(in.emission.a * sections(chord(in), 0u));
}

@fragment
fn scalars_8(in: Varyings) -> Scalars8 {
    let c = chord(in);
    return Scalars8(in.emission.a * sections(c, 0u), in.emission.a * sections(c, 4u));
}

// Clears the part of the sheets that a batch reaches: one triangle over all of them.
@vertex
fn cover(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4f {
    return vec4f(f32(corner & 1u) * 4.0 - 1.0, f32(corner >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

@fragment
fn wipe_1() -> Sheets1 {
    return Sheets1();
}

@fragment
fn wipe_4() -> Sheets4 {
    return Sheets4();
}

@fragment
fn wipe_8() -> Sheets8 {
    return Sheets8();
}
