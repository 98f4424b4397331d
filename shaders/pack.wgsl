// pack: splats into the texture that the painter `tiles` marches through (see common/packing.wgsl), and a mark for each
// cell of 2^3 voxels that has a splat, of scalars one near a visible splat. Classified voxels become f16 of (colour, 1)
// times density, lit scalars f16 of (gradient, scalar), other scalars stay f32. A file of `packed` stores them.
// uses: common/dispatch, common/lit_splat, common/marking, common/packing, common/paged, common/splat

override PERSPECTIVE: bool = false;

@group(0) @binding(0) var<uniform> pack: Pack;
@group(0) @binding(1) var<uniform> lighting: Lighting;
@group(0) @binding(2) var<storage, read> splats: array<vec2u>;
@group(0) @binding(5) var<storage, read> origins: array<vec4u>;
// Runs of splats, a workgroup each: the first one, and the one after the last.
@group(0) @binding(6) var<storage, read> runs: array<vec2u>;
// See common/pages.wgsl.
@group(0) @binding(7) var<storage, read> page_table: array<u32>;

// Whether a splat marks cells.
fn is_marking(words: vec2u) -> bool {
    let weight = splat_weight(words);
    return !SCALARS || weight < pack.least_invisible || weight > pack.largest_invisible;
}

// Whether the splat before splat `index` is its neighbour along x and marks the same cells: atomics are slow.
// `first_word` is the splat's first word, and `before` is the place of a neighbour along x.
fn follows_in_cells(index: u32, first_word: u32, place: vec3u, before: vec3u) -> bool {
    // In the first word the place along x in the brick is the lowest 5 bits.
    if index == 0u || (first_word & 31u) == 0u || any(before > place) {
        return false;
    }
    let words = splat_words(index - 1u);
    return words.x + 1u == first_word && is_marking(words) && all(first_marked(before) == first_marked(place))
        && all(last_marked(before) == last_marked(place));
}

// The colour of a classified voxel under the lights.
fn shaded_color(index: u32, words: vec2u) -> vec3f {
    let appearance = splats[splat_at(index) + 1u];
    let color = splat_color(words.y, appearance.x);
    if LIGHTS == 0u {
        return color;
    }
    var to_eye = vec3f(0.0, 0.0, -1.0);
    if PERSPECTIVE {
        to_eye = towards_eye(splat_lattice(words) - pack.eye, pack.view_x, pack.view_y, pack.view_z);
    }
    return lit_splat(color, appearance.y, splat_kept(index), splat_lattice(words), to_eye);
}

// Packs a splat.
fn pack_splat(index: u32) {
    let words = splat_words(index);
    let place = splat_point(words) - pack.low;
    // A difference below 0 wraps around to a large number.
    if any(place >= vec3u(pack.across, pack.rows, pack.planes)) {
        return;
    }
    let before = place - vec3u(1u, 0u, 0u);
    if is_marking(words) && !follows_in_cells(index, words.x, place, before) {
        mark(place);
    }
    if SCALARS && !GRADIENTS {
        store(place, vec2u(words.y, 0u));
        return;
    }
    var v = vec4f(0.0, 0.0, 0.0, splat_weight(words) * pack.scale);
    if SCALARS {
        v = vec4f(splat_gradient(index) * pack.scale, v.w);
    } else {
        v = vec4f(shaded_color(index, words) * v.w, v.w);
    }
    v = rounded(v);
    store(place, vec2u(pack2x16float(v.xy), pack2x16float(v.zw)));
}

@compute @workgroup_size(WORKGROUP)
fn voxels(
    @builtin(workgroup_id) id: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let number = id.x + id.y * groups.x;
    if number >= pack.run_count {
        return;
    }
    let run = runs[pack.first_run + number];
    for (var index = run.x + lane; index < run.y; index += WORKGROUP) {
        pack_splat(index);
    }
}
