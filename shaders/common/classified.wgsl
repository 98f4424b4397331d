// The samples of bricks, classified by a transfer function, and their gradients.
// uses: common/resolution, common/samples, common/words

// Whether splats get normals.
override LIT: bool = false;
// Whether normals are the dominant axes of structure tensors.
override TENSOR: bool = false;
// Whether extinction depends on gradients.
override GRADIENT_OPACITY: bool = false;
// Whether a voxel is classified by the values that occur around it. The control points are then nodes, between which
// emission, in `color` colour times density and in `opacity` density, is a parabola: five columns of them, see
// `column`.
override BAND_LIMITED: bool = false;
struct Classify {
    // Lattice size.
    dims: vec3u,
    // Bricks in this batch.
    bricks: u32,
    // World gradients of the lattice coordinates.
    gradient_x: vec3f,
    // Control points or nodes of the transfer function.
    points: u32,
    gradient_y: vec3f,
    // Subtracted from a sample before it is compared with the control points.
    sample_origin: f32,
    gradient_z: vec3f,
    // Number of the first brick of this batch among the bricks of the buffer of samples.
    first_brick: u32,
    // Control points of gradient opacity, after the other points: `sample` is the length of a gradient of samples.
    gradient_points: u32,
    // The base of the transfer function in the units of the samples, and the resolution there, see
    // common/resolution.wgsl.
    base: f32,
    faintest: f32,
}

struct ControlPoint {
    color: vec3f,
    // Value in the units of the samples, minus sample_origin.
    sample: f32,
    opacity: f32,
}

@group(0) @binding(0) var<uniform> classify: Classify;
@group(0) @binding(2) var<storage, read> control_points: array<ControlPoint>;

// The number of control points, of `count` from number `first` on, that are not above a sample.
fn points_below(sample: f32, first: u32, count: u32) -> u32 {
    var above = 0u;
    var end = count;
    while above < end {
        let middle = (above + end) / 2u;
        if control_points[first + middle].sample <= sample {
            above = middle + 1u;
        } else {
            end = middle;
        }
    }
    return above;
}

// Colour and opacity of a sample by `count` control points from number `first` on: linear between points, constant
// beyond the first and the last. If several points have the same value, the last of them holds from there on.
fn looked_up(sample: f32, first: u32, count: u32) -> vec4f {
    let below = points_below(sample, first, count);
    // The last point that is not above the sample, or the first point; and the point after it.
    let a = control_points[first + max(below, 1u) - 1u];
    let b = control_points[first + min(below, count - 1u)];
    let width = b.sample - a.sample;
    var f = 0.0;
    if width > 0.0 {
        f = clamp((sample - a.sample) / width, 0.0, 1.0);
    }
    return vec4f(a.color + (b.color - a.color) * f, a.opacity + (b.opacity - a.opacity) * f);
}

// Colour and opacity of a sample.
fn transfer(i: u32) -> vec4f {
    return looked_up(sample_at(i) - classify.sample_origin, 0u, classify.points);
}

// A column of a node: emission where its piece begins, slope and bend across the piece, the integral of emission from
// the first node and the rounding of that.
fn column(number: u32, node: u32) -> vec4f {
    let point = control_points[number * classify.points + node];
    return vec4f(point.color, point.opacity);
}

// The mean emission between two samples of a piece, given the number of nodes that are not above them.
fn within_piece(below: u32, low: f32, high: f32) -> vec4f {
    let node = max(below, 1u) - 1u;
    let emission = column(0u, node);
    if below == 0u || below == classify.points {
        return emission;
    }
    let first = control_points[node].sample;
    let t = vec2f(low - first, high - first) / (control_points[below].sample - first);
    return emission + (0.5 * (t.x + t.y)) * column(1u, node) + (dot(t, t) + t.x * t.y) / 3.0 * column(2u, node);
}

// The mean emission between two samples with the numbers of nodes that are not above them; of equal samples the
// emission there.
fn mean_emission(low: f32, before: u32, high: f32, after: u32) -> vec4f {
    if before == after {
        return within_piece(before, low, high);
    }
    let a = control_points[before].sample;
    let b = control_points[after - 1u].sample;
    let start = within_piece(before, low, a) * (a - low);
    let end = within_piece(after, b, high) * (high - b);
    let whole = column(3u, after - 1u) - column(3u, before) + (column(4u, after - 1u) - column(4u, before));
    return (start + whole + end) / (high - low);
}

// The emission of sample number `i`, colour times density and density, as the mean over two boxes of values around it:
// `TransferFunction::with_classification` of the host.
fn band_limited(i: u32) -> vec4f {
    let row = stored_edge();
    let plane = row * row;
    let sample = sample_at(i);
    let before = vec3f(sample_at(i - 1u), sample_at(i - row), sample_at(i - plane));
    let after = vec3f(sample_at(i + 1u), sample_at(i + row), sample_at(i + plane));
    let differences = 0.5 * (after - before);
    // Its square may leave the range of f32.
    let largest = largest_difference(differences);
    let rise = largest * length(differences / select(1.0, largest, largest > 0.0));
    let low = min(before, after);
    let high = max(before, after);
    let lowest = min(sample, max(sample - rise, min(low.x, min(low.y, low.z)))) - classify.sample_origin;
    let highest = max(sample, min(sample + rise, max(high.x, max(high.y, high.z)))) - classify.sample_origin;
    let place = sample - classify.sample_origin;
    let below = points_below(place, 0u, classify.points);
    let under = mean_emission(lowest, points_below(lowest, 0u, classify.points), place, below);
    return 0.5 * (under + mean_emission(place, below, highest, points_below(highest, 0u, classify.points)));
}

// -ln(1 - opacity). Below 0.1, where the subtraction would cancel, by its series to opacity^6: the next term is 1.4e-7
// of it there. The largest opacity is TransferFunction::MAX_OPACITY, 1 - 2^-16.
fn density(opacity: f32) -> f32 {
    let a = min(opacity, 0.9999847412109375);
    if a < 0.1 {
        return a * (1.0 + a * (1.0 / 2.0 + a * (1.0 / 3.0 + a * (1.0 / 4.0 + a * (1.0 / 5.0 + a * (1.0 / 6.0))))));
    }
    return -log(1.0 - a);
}

// Layers of neighbouring voxels around a brick: two or three for normals, one for central differences alone.
fn halo() -> u32 {
    return select(u32(GRADIENT_OPACITY || BAND_LIMITED), 2u + u32(TENSOR), LIT);
}

// Voxels along the side of a stored brick.
fn stored_edge() -> u32 {
    return EDGE + 2u * halo();
}

// Index of the first sample of a row of a brick of this batch.
fn first_sample(brick: u32, y: u32, z: u32) -> u32 {
    let edge = stored_edge();
    return ((brick * edge + z + halo()) * edge + y + halo()) * edge + halo();
}

// The world gradient at a sample, given the slopes along the axes of the lattice: a vector of moderate length (xyz) and
// its factor (w); 0 if the slopes are rounding.
fn world_gradient(slopes: vec3f, i: u32) -> vec4f {
    let largest = largest_difference(slopes);
    if largest < resolution_at(sample_at(i) - classify.base, classify.faintest) {
        return vec4f(0.0);
    }
    // Neither the unit of the samples nor the unit of the world moves it out of the range of f32.
    let d = slopes / largest;
    let direction = classify.gradient_x * d.x + classify.gradient_y * d.y + classify.gradient_z * d.z;
    return vec4f(direction, largest);
}

// The gradient at a sample by central differences, on which gradient opacity depends.
fn gradient(i: u32) -> vec4f {
    let row = stored_edge();
    let plane = row * row;
    let x = sample_at(i + 1u) - sample_at(i - 1u);
    let y = sample_at(i + row) - sample_at(i - row);
    let z = sample_at(i + plane) - sample_at(i - plane);
    return world_gradient(0.5 * vec3f(x, y, z), i);
}

// The filters of normals, `DerivativeFilter::of_normals` of the host, on five samples of a line.
fn smoothed(a: f32, b: f32, c: f32, d: f32, e: f32) -> f32 {
    return 0.426375 * c + 0.249153 * (d + b) + 0.037659 * (e + a);
}

fn slope(a: f32, b: f32, d: f32, e: f32) -> f32 {
    return 0.278979 * (d - b) + 0.11051 * (e - a);
}

// The smoothed sample (x) and the slope (y) of the row around sample number `i`.
fn along_row(i: u32) -> vec2f {
    let a = sample_at(i - 2u) - classify.base;
    let b = sample_at(i - 1u) - classify.base;
    let c = sample_at(i) - classify.base;
    let d = sample_at(i + 1u) - classify.base;
    let e = sample_at(i + 2u) - classify.base;
    return vec2f(smoothed(a, b, c, d, e), slope(a, b, d, e));
}

// The smoothed sample (x) and the slopes along x and y (yz) of the plane around sample number `i`.
fn across_plane(i: u32) -> vec3f {
    let row = stored_edge();
    let a = along_row(i - 2u * row);
    let b = along_row(i - row);
    let c = along_row(i);
    let d = along_row(i + row);
    let e = along_row(i + 2u * row);
    let across = smoothed(a.y, b.y, c.y, d.y, e.y);
    return vec3f(smoothed(a.x, b.x, c.x, d.x, e.x), across, slope(a.x, b.x, d.x, e.x));
}

// The world gradient at a sample by the filters of normals.
fn filtered_gradient(i: u32) -> vec4f {
    let plane = stored_edge() * stored_edge();
    let a = across_plane(i - 2u * plane);
    let b = across_plane(i - plane);
    let c = across_plane(i);
    let d = across_plane(i + plane);
    let e = across_plane(i + 2u * plane);
    let x = smoothed(a.y, b.y, c.y, d.y, e.y);
    let y = smoothed(a.z, b.z, c.z, d.z, e.z);
    return world_gradient(vec3f(x, y, slope(a.x, b.x, d.x, e.x)), i);
}

// A vector along the normal at a sample (xyz), which is 0 if there is none.
fn normal(i: u32) -> vec4f {
    let own = filtered_gradient(i);
    if !TENSOR || !(own.w > 0.0) {
        return own;
    }
    // The structure tensor over the square of the largest factor of a gradient so far.
    var largest = own.w;
    var tensor = mat3x3f(own.xyz * own.x, own.xyz * own.y, own.xyz * own.z);
    let row = stored_edge();
    for (var n = 0u; n < 6u; n++) {
        let step = select(select(row, 1u, n < 2u), row * row, n >= 4u);
        let beside = filtered_gradient(select(i - step, i + step, (n & 1u) == 1u));
        let before = largest;
        largest = max(largest, beside.w);
        let g = beside.xyz * (beside.w / largest);
        let outer = mat3x3f(g * g.x, g * g.y, g * g.z);
        tensor = tensor * (before / largest * (before / largest)) + outer * 0.125;
    }
    // Its 8th power is nearly its dominant axis, and keeps the side of its own gradient.
    for (var n = 0u; n < 3u; n++) {
        let scaled = tensor * (1.0 / (tensor[0].x + tensor[1].y + tensor[2].z));
        tensor = scaled * scaled;
    }
    return vec4f(tensor * own.xyz, own.w);
}

// The length of a gradient.
fn magnitude_of(gradient: vec4f) -> f32 {
    return min(length(gradient.xyz) * gradient.w, FAR);
}

// The share of extinction that stays at a gradient.
fn gradient_share(gradient: vec4f) -> f32 {
    let first = classify.points * select(1u, 5u, BAND_LIMITED);
    return looked_up(magnitude_of(gradient), first, classify.gradient_points).a;
}

// Colour and density of sample number `i`, thinned by gradient opacity.
fn classified(i: u32) -> vec4f {
    var found: vec4f;
    if BAND_LIMITED {
        found = band_limited(i);
        found = vec4f(found.rgb / select(1.0, found.a, found.a > 0.0), found.a);
    } else {
        found = transfer(i);
        found.a = density(found.a);
    }
    if GRADIENT_OPACITY {
        found.a *= gradient_share(gradient(i));
    }
    return found;
}
