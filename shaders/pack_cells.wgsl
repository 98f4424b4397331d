// pack_cells: scalars of cells into the box that the painter `tiles` marches through (see common/packing.wgsl), and
// marks of cells near visible scalars. An invocation for each texel of some rows of some planes.
// uses: common/cell_texels, common/dispatch, common/scalar_texels

@compute @workgroup_size(WORKGROUP)
fn texels(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if !is_in_part(index) {
        return;
    }
    let i = cell_number(index);
    let scalar = cell_at(i);
    let place = place_in_box(index);
    if is_visible(scalar) {
        let has_before = marks_as_before(place);
        if !has_before || !is_visible(cell_at(i - u32(has_before))) {
            mark(place);
        }
    }
    store_scalar(place, cell_gradient(i), scalar);
}
