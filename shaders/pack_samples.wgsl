// pack_samples: samples into the box of voxels that the painter `tiles` marches through (see common/packing.wgsl), and a
// mark for each cell of 2^3 voxels that has a visible one. Samples are classified, thinned by gradient opacity, rounded
// as splats are, and lit. An invocation for each voxel of some bricks.
// uses: common/appearance, common/classified, common/dispatch, common/lit_splat, common/marking, common/packing

override PERSPECTIVE: bool = false;
// Whether the normals of visible voxels are kept: if not, they are found.
override KEPT_NORMALS: bool = false;

@group(0) @binding(5) var<uniform> pack: Pack;
@group(0) @binding(6) var<uniform> lighting: Lighting;
// For each row of a brick: the number of its first visible voxel among those of all bricks of a buffer of samples.
@group(0) @binding(7) var<storage, read> places: array<u32>;
// For each row of a brick: a bit for each voxel, set if it is visible.
@group(0) @binding(8) var<storage, read> seen: array<u32>;
// The packed normals of these visible voxels, if they are kept.
@group(0) @binding(9) var<storage, read> normals: array<u32>;

// Colour and density of a visible voxel as a splat holds them, lit.
fn lit_voxel(row: u32, x: u32, point: vec3f) -> vec4f {
    let i = first_sample(row / (EDGE * EDGE), row % EDGE, row / EDGE % EDGE) + x;
    let classified = transfer(i);
    var density = density(classified.a);
    if GRADIENT_OPACITY {
        density *= gradient_share(gradient(i));
    }
    let appearance = packed_appearance(classified.rgb, density);
    var color = splat_color(appearance.x, appearance.y);
    if LIGHTS > 0u {
        var packed: u32;
        if KEPT_NORMALS {
            packed = normals[places[row] + countOneBits(seen[row] & ((1u << x) - 1u))];
        } else {
            packed = pack_normal(normal(i).xyz);
        }
        var to_eye = vec3f(0.0, 0.0, -1.0);
        if PERSPECTIVE {
            to_eye = towards_eye(point - pack.eye, pack.view_x, pack.view_y, pack.view_z);
        }
        color = lit_splat(color, packed, UNSHADED, point, to_eye);
    }
    return vec4f(color, splat_density(appearance.x));
}

@compute @workgroup_size(WORKGROUP)
fn voxels(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if index >= classify.bricks * EDGE * EDGE * EDGE {
        return;
    }
    let row = index / EDGE;
    let x = index % EDGE;
    let bits = seen[row];
    let is_visible = (bits >> x & 1u) != 0u;
    if !is_visible && pack.clears == 0u {
        return;
    }
    let bricks = (classify.dims + EDGE - 1u) / EDGE;
    let number = classify.first_brick + row / (EDGE * EDGE);
    let brick = vec3u(number % bricks.x, number / bricks.x % bricks.y, number / (bricks.x * bricks.y));
    let point = brick * EDGE + vec3u(x, row % EDGE, row / EDGE % EDGE);
    // A difference below 0 wraps around to a large number.
    let place = point - pack.low;
    if any(place >= vec3u(pack.across, pack.rows, pack.planes)) {
        return;
    }
    if !is_visible {
        store(place, vec2u(0u));
        return;
    }
    // The voxel before it in the row may mark the same cell: atomics are slow.
    let follows = x > 0u && (bits >> (x - 1u) & 1u) != 0u && ((place.x + pack.mark_shift.x) & 1u) != 0u;
    if !follows || place.x == 0u {
        mark(place);
    }
    let voxel = lit_voxel(row, x, vec3f(point));
    let density = voxel.w * pack.scale;
    let v = rounded(vec4f(voxel.rgb * density, density));
    store(place, vec2u(pack2x16float(v.xy), pack2x16float(v.zw)));
}
