// shade: post-shading (Mueller, Moeller and Crawfis 1999, "Splatting without the blur"). Sheets hold means of the
// scalar: all of a batch, and the last three of the batch before. Each sheet is classified and lit for each pixel,
// between its two neighbours, and composited; so shading is one sheet behind splatting. `project` keeps the largest
// scalar instead, or the mean. Scalars are relative to the transfer function's base, so that the space between splats
// is 0.
// uses: common/absorbed, common/frame, common/half_depth, common/light_volume, common/march_parabola
// uses: common/pixel_ray, common/resolution

// Sheets of a batch: 4 or 8. A texture layer holds four sheets, or one lit sheet as (gradient, scalar), with the
// gradient along the axes of the lattice.
override SHEETS: u32 = 8u;
// Pieces in which a whole sheet is classified, along the parabola through the means of the sheet and its neighbours. 1
// classifies the mean of the sheet.
override SAMPLES: u32 = 4u;

struct Shade {
    // View depth of the first plane of the first shaded sheet, which is the last sheet of the batch before.
    depth: f32,
    // 1 if the batch before has splats, otherwise 0.
    previous: f32,
    // 1 if this batch has splats, otherwise 0.
    current: f32,
    // Place of the length of a gradient in the table of the transfer function: length * gradient_lookup.
    gradient_lookup: f32,
    // The invisible scalars around 0, from x to y, ends included; none if x > y.
    invisible: vec2f,
    // Place of a scalar in the table of the transfer function: scalar * x + y.
    lookup: vec2f,
    // The first pixel that the batches can reach.
    low: vec2u,
    // The pixel after the last.
    high: vec2u,
    // Lengths in the unit that extinctions are per: lengths times this.
    per_unit: f32,
    // From lattice coordinates from the middle of the box to the light volume.
    to_light: mat4x3f,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> shading: Shade;
@group(0) @binding(2) var<uniform> lighting: Lighting;
@group(0) @binding(3) var previous: texture_2d_array<f32>;
@group(0) @binding(4) var current: texture_2d_array<f32>;
// The transfer function: see common/transfer.wgsl.
@group(0) @binding(5) var transfer: texture_storage_2d<rgba32float, read>;
@group(0) @binding(6) var<storage, read_write> pixels: array<vec4f>;
// See common/light_volume.wgsl.
@group(0) @binding(7) var light_volume: texture_3d<f32>;
@group(0) @binding(8) var light_sampler: sampler;
// The depth of the solid of each pixel of the region.
@group(0) @binding(9) var<storage, read> solid_depths: array<f32>;

// Means of consecutive sheets at a pixel: the last three of the batch before, then the four or eight of the batch.
alias Means = array<f32, 11>;

// The scalars of sheets `first` to `first` + 3 of the batch, in the units of sheets.
fn scalars_at(at: vec2u, first: i32) -> vec4f {
    if LIGHTS == 0u {
        return textureLoad(current, at, first / 4, 0);
    }
    return vec4f(
        textureLoad(current, at, first, 0).a,
        textureLoad(current, at, first + 1, 0).a,
        textureLoad(current, at, first + 2, 0).a,
        textureLoad(current, at, first + 3, 0).a,
    );
}

fn means_at(at: vec2u) -> Means {
    var before: vec3f;
    if LIGHTS == 0u {
        before = textureLoad(previous, at, i32(SHEETS / 4u) - 1, 0).yzw;
    } else {
        let last = i32(SHEETS) - 1;
        before = vec3f(
            textureLoad(previous, at, last - 2, 0).a,
            textureLoad(previous, at, last - 1, 0).a,
            textureLoad(previous, at, last, 0).a,
        );
    }
    before *= frame.inverse_sheet_scale * shading.previous;
    let a = scalars_at(at, 0) * (frame.inverse_sheet_scale * shading.current);
    var b = vec4f(0.0);
    if SHEETS > 4u {
        b = scalars_at(at, 4) * (frame.inverse_sheet_scale * shading.current);
    }
    return Means(before.x, before.y, before.z, a.x, a.y, a.z, a.w, b.x, b.y, b.z, b.w);
}

fn is_invisible_batch(m: Means) -> bool {
    var least = min(m[1], m[2]);
    var largest = max(m[1], m[2]);
    if #u < SHEETS { least = min(least, m[# + 3]); largest = max(largest, m[# + 3]); }
    return is_invisible_range(least, largest, shading.invisible);
}

// The part inside the box of the sheet that begins at view depth `z`, its ends from -1/2 to 1/2; empty if x >= y.
fn part_of_sheet(ray: PixelRay, z: f32) -> vec2f {
    return clamp((ray.inside - z) * frame.inverse_sheet_step, vec2f(0.0), vec2f(1.0)) - 0.5;
}

// The ray of a pixel, which ends at the pixel's solid.
fn ray_to_solid(pixel: vec2u) -> PixelRay {
    var ray = pixel_ray(pixel);
    if SOLIDS {
        ray.inside = before_solid(ray.inside, solid_depths[pixel.y * frame.region.x + pixel.x]);
    }
    return ray;
}

// The means `m` around a sheet. There is no sheet before the one at the eye: its mean is extrapolated.
fn from_eye(m: vec3f, z: f32) -> vec3f {
    if PERSPECTIVE && z - 0.5 * frame.sheet_step < -frame.eye_depth {
        return vec3f(2.0 * m.y - m.z, m.yz);
    }
    return m;
}

// The mean of the gradient in sheet `sheet` of the batch; -1 and -2 are the last sheets of the batch before.
fn gradient_of(at: vec2u, sheet: i32) -> vec3f {
    if sheet < 0 {
        return textureLoad(previous, at, i32(SHEETS) + sheet, 0).rgb * shading.previous;
    }
    return textureLoad(current, at, sheet, 0).rgb * shading.current;
}

// The effect of a gradient on the matter of a sheet.
struct Surface {
    light: Shine,
    // Gradient opacity: the share of extinction.
    share: f32,
}

// The shares of light that arrive on a ray at view depth `z`.
fn kept_on(ray: PixelRay, z: f32) -> vec4f {
    return kept_at(shading.to_light * vec4f(ray.start + ray.direction * z, 1.0));
}

// The surface across a gradient of the lattice where the mean of a sheet is `scalar`, at view depth `z`.
fn surface_of(gradient: vec3f, scalar: f32, ray: PixelRay, z: f32) -> Surface {
    // The transpose of the map from the view to the lattice takes gradients from the lattice to the view.
    let in_view =
        vec3f(dot(frame.grid_right, gradient), dot(frame.grid_up, gradient), dot(frame.grid_forward, gradient));
    var to_eye = vec3f(0.0, 0.0, -1.0);
    if PERSPECTIVE {
        to_eye = -vec3f(ray.slope, 1.0) / ray.stretch;
    }
    let of_means = in_view * frame.inverse_sheet_scale;
    let differences = gradient * frame.inverse_sheet_scale;
    let surface = reconstructed_share(differences, scalar, lighting.faintest);
    let light = light_on(in_view, surface, ray.start + ray.direction * z, to_eye, kept_on(ray, z));
    return Surface(light, gradient_share(of_means, shading.gradient_lookup));
}

// Pieces of half a sheet, which have the same light; 1 if the mean of the sheet is classified.
fn half_samples() -> u32 {
    return select(max((SAMPLES + 1u) / 2u, 2u), 1u, SAMPLES == 1u);
}

// Pieces of a whole sheet.
fn whole_samples() -> u32 {
    return select(2u * half_samples(), SAMPLES, LIGHTS == 0u || SAMPLES == 1u);
}

// The beginning of the sheet behind the sheet that begins at view depth `z`; `means` are the means around that.
fn before_of(means: vec3f, ray: PixelRay, z: f32) -> Before {
    var before = Before(AT_THE_FACE, Classified());
    if ray.inside.x >= z + frame.sheet_step {
        return before;
    }
    if is_invisible(means, shading.invisible) {
        before.kind = INVISIBLE;
        return before;
    }
    let part = part_of_sheet(ray, z);
    let p = marched_parabola(from_eye(means, z), (part.y - part.x) / f32(whole_samples()));
    before.kind = SCALAR;
    before.end.scalar = p.x + 0.5 * p.y + 0.25 * p.z;
    return before;
}

// The pixel `at` (colour and optical depth) with sheet `sheet` behind it, which begins at view depth `z`. `before` is
// the mean of the last sheet but one.
fn with_sheet(
    pixel: vec4f,
    before: f32,
    means: vec3f,
    at: vec2u,
    sheet: i32,
    ray: PixelRay,
    z: f32,
) -> vec4f {
    let part = part_of_sheet(ray, z);
    if part.x >= part.y || is_invisible(means, shading.invisible) || !owns_sheet(ray.owned, z) {
        return pixel;
    }
    let m = from_eye(means, z);
    let last = before_of(vec3f(before, means.xy), ray, z - frame.sheet_step);
    var result = pixel;
    if LIGHTS == 0u {
        march_part(&result, m, part, last, SAMPLES, ray, Surface(no_shine(), 1.0));
        return behind_sheet(pixel, result, part, z);
    }
    // Half by half, each lit by the gradient in its middle, on the line through the means beside the sheet. A sheet
    // without a gradient is not lit, whatever its neighbours.
    let gradient = gradient_of(at, sheet);
    var quarter = vec3f(0.0);
    if any(gradient != vec3f(0.0)) {
        quarter = (gradient_of(at, sheet + 1) - gradient_of(at, sheet - 1)) * 0.125;
    }
    var middle = last;
    let front = vec2f(part.x, min(part.y, 0.0));
    if front.x < front.y {
        let surface = surface_of(gradient - quarter, m.y, ray, z + 0.25 * frame.sheet_step);
        middle = march_part(&result, m, front, last, half_samples(), ray, surface);
    }
    let rear = vec2f(max(part.x, 0.0), part.y);
    if rear.x < rear.y {
        let surface = surface_of(gradient + quarter, m.y, ray, z + 0.75 * frame.sheet_step);
        march_part(&result, m, rear, middle, half_samples(), ray, surface);
    }
    return behind_sheet(pixel, result, part, z);
}

// A pixel behind a sheet: `result`, or in a picture of depths its half depth in place of colours.
fn behind_sheet(pixel: vec4f, result: vec4f, part: vec2f, z: f32) -> vec4f {
    if HALF_DEPTH {
        let depths = frame.solid_depth.x * (z + (part + 0.5) * frame.sheet_step) + frame.solid_depth.y;
        return vec4f(half_depth(pixel.rgb, pixel.a, result.a, depths), result.a);
    }
    return result;
}

// Composites a part of a sheet, with the means `m` around it, behind the state `before`.
fn march_part(
    pixel: ptr<function, vec4f>,
    m: vec3f,
    part: vec2f,
    before: Before,
    samples: u32,
    ray: PixelRay,
    surface: Surface,
) -> Before {
    let length = (part.y - part.x) / f32(samples) * frame.sheet_step * ray.stretch * shading.per_unit
        * surface.share;
    return march_parabola(pixel, m, part, before, samples, length, shading.lookup, shading.invisible, surface.light);
}

// Colour (rgb) and optical depth (a) so far.
alias Marched = vec4f;

fn add_sample(so_far: ptr<function, Marched>, color: vec3f, depth: f32) {
    let pixel = *so_far;
    *so_far = vec4f(pixel.rgb + color * (exp(-pixel.a) * absorbed(depth)), pixel.a + depth);
}

@compute @workgroup_size(8, 8)
fn shade(@builtin(global_invocation_id) id: vec3u) {
    let pixel_at = shading.low + id.xy;
    if any(pixel_at >= shading.high) {
        return;
    }
    let index = pixel_at.y * frame.region.x + pixel_at.x;
    let m = means_at(pixel_at);
    if is_invisible_batch(m) {
        return;
    }
    var pixel = pixels[index];
    if pixel.a >= frame.opaque_depth {
        return;
    }
    let ray = ray_to_solid(pixel_at);
    var z = shading.depth;
    let m# = vec3f(m[# + 1], m[# + 2], m[# + 3]);
    if #u < SHEETS { pixel = with_sheet(pixel, m[#], m#, pixel_at, # - 1, ray, z); z += frame.sheet_step; }
    pixels[index] = pixel;
}

// Keep the mean instead of the largest scalar.
override MEAN: bool = false;

// The largest scalar so far (x; y is 1 once there is one; z is its view depth), or the integral (x) over a length in
// sheets (y), with one more sheet.
fn updated_projection(so_far: vec3f, means: vec3f, ray: PixelRay, z: f32) -> vec3f {
    let part = part_of_sheet(ray, z);
    if part.x >= part.y || !owns_sheet(ray.owned, z) {
        return so_far;
    }
    if MEAN {
        return so_far + vec3f(integral_over(from_eye(means, z), part), part.y - part.x, 0.0);
    }
    let m = from_eye(means, z);
    var largest = shown(largest_in(m, part), means, shading.invisible);
    var depth = 0.0;
    if DEPTH_CODED || ATTENUATED {
        depth = z + (place_of_largest(m, part) + 0.5) * frame.sheet_step;
        if ATTENUATED {
            largest = faded(largest, frame.model.x * depth + frame.model.y, frame.model.z);
        }
        let is_larger = so_far.y <= 0.0 || largest > so_far.x;
        depth = select(so_far.z, depth, is_larger);
    }
    return vec3f(select(largest, max(largest, so_far.x), so_far.y > 0.0), 1.0, depth);
}

@compute @workgroup_size(8, 8)
fn project(@builtin(global_invocation_id) id: vec3u) {
    let pixel_at = shading.low + id.xy;
    if any(pixel_at >= shading.high) {
        return;
    }
    let ray = ray_to_solid(pixel_at);
    if ray.inside.x >= ray.inside.y {
        return;
    }
    let index = pixel_at.y * frame.region.x + pixel_at.x;
    let m = means_at(pixel_at);
    var z = shading.depth;
    var so_far = pixels[index].xyz;
    let m# = vec3f(m[# + 1], m[# + 2], m[# + 3]);
    if #u < SHEETS { so_far = updated_projection(so_far, m#, ray, z); z += frame.sheet_step; }
    pixels[index] = vec4f(so_far, 0.0);
}

// From the kept scalar to its colour; of a brick to (scalar, 1, depth, 1) or (integral, length, 0, 1).
@compute @workgroup_size(8, 8)
fn resolve_projection(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= frame.region) {
        return;
    }
    let index = id.y * frame.region.x + id.x;
    let kept = pixels[index];
    var color = vec4f(0.0);
    if BRICK {
        let depth = frame.model.x * kept.z + frame.model.y;
        color = vec4f(kept.xy, select(depth, 0.0, MEAN), 1.0) * select(0.0, 1.0, kept.y > 0.0);
    } else if kept.y > 0.0 {
        let depth = frame.model.x * kept.z + frame.model.y;
        color = projected(select(kept.x, kept.x / kept.y, MEAN), depth, shading.lookup);
    }
    pixels[index] = color;
}
