// pack_samples: samples into the box of voxels that the painter `tiles` marches through (see common/packing.wgsl), and
// a mark for each cell of 2^3 voxels that has a visible one. Samples are classified, thinned by gradient opacity,
// rounded as splats are, and lit. An invocation for each voxel of some bricks.
// uses: common/arriving, common/dispatch, common/lit_splat, common/marking, common/paged, common/sampled

override PERSPECTIVE: bool = false;

@group(0) @binding(7) var<uniform> pack: Pack;
@group(0) @binding(8) var<uniform> lighting: Lighting;
// See common/pages.wgsl.
@group(0) @binding(11) var<storage, read> page_table: array<u32>;

// Colour and density of a visible voxel as a splat holds them, lit.
fn lit_voxel(voxel: BrickVoxel) -> vec4f {
    let appearance = appearance_of(voxel);
    var color = splat_color(appearance.x, appearance.y);
    if LIGHTS > 0u {
        let number = number_of(voxel.row, voxel.x);
        let point = vec3f(voxel.point);
        var to_eye = vec3f(0.0, 0.0, -1.0);
        if PERSPECTIVE {
            to_eye = towards_eye(point - pack.eye, pack.view_x, pack.view_y, pack.view_z);
        }
        let normal = packed_normal(number, sample_of(voxel.row, voxel.x));
        color = lit_splat(color, normal, kept_at(number), point, to_eye);
    }
    return vec4f(color, splat_density(appearance.x));
}

@compute @workgroup_size(WORKGROUP)
fn voxels(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if index >= classify.bricks * EDGE * EDGE * EDGE {
        return;
    }
    let voxel = brick_voxel(index);
    let is_visible = is_seen(voxel.row, voxel.x);
    if !is_visible && pack.clears == 0u {
        return;
    }
    // A difference below 0 wraps around to a large number.
    let place = voxel.point - pack.low;
    if any(place >= vec3u(pack.across, pack.rows, pack.planes)) {
        return;
    }
    if !is_visible {
        store(place, vec2u(0u));
        return;
    }
    // The voxel before it in the row may mark the same cell: atomics are slow.
    let follows = voxel.x > 0u && is_seen(voxel.row, voxel.x - 1u) && ((place.x + pack.mark_shift.x) & 1u) != 0u;
    if !follows || place.x == 0u {
        mark(place);
    }
    let lit = lit_voxel(voxel);
    let density = lit.w * pack.scale;
    let v = rounded(vec4f(lit.rgb * density, density));
    store(place, vec2u(pack2x16float(v.xy), pack2x16float(v.zw)));
}
