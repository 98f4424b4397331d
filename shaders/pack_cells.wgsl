// pack_cells: scalars of cells into the box that the painter `tiles` marches through (see common/packing.wgsl), and
// marks of cells near visible scalars. An invocation for each texel of some rows of some planes.
// uses: common/dispatch, common/scalar_texels

struct CellTexels {
    // Cells along each axis.
    dims: vec3u,
    // The first plane of the box.
    first_plane: u32,
    // The cell of its first texel, in its first row.
    first: vec3u,
    // The number of planes.
    planes: u32,
    // The weights of the differences of cells 1, 2 and 3 to either side in gradients.
    differences: vec3f,
    // The rows of each plane: the first, and their number.
    first_row: u32,
    rows: u32,
}

@group(0) @binding(0) var<uniform> part: CellTexels;
// Scalars, x fastest; with gradients, the range of the voxels in the middle of each too.
@group(0) @binding(1) var<storage, read> cells: array<f32>;

fn cell_at(i: u32) -> f32 {
    return cells[select(i, 3u * i, GRADIENTS)];
}

// The difference of the cells before and behind one.
fn difference(i: u32, step: u32) -> f32 {
    return cell_at(i + step) - cell_at(i - step);
}

// A component of the gradient of a cell, of cells with this step between them.
fn slope(i: u32, step: u32) -> f32 {
    let differences = vec3f(difference(i, step), difference(i, 2u * step), difference(i, 3u * step));
    return dot(part.differences, differences);
}

@compute @workgroup_size(WORKGROUP)
fn texels(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    let of_plane = pack.across * part.rows;
    if index >= of_plane * part.planes {
        return;
    }
    let in_part = vec3u(index % pack.across, index / pack.across % part.rows, index / of_plane);
    let place = in_part + vec3u(0u, part.first_row, part.first_plane);
    let cell = part.first + in_part;
    let i = cell.x + part.dims.x * (cell.y + part.dims.y * cell.z);
    let scalar = cell_at(i);
    if is_visible(scalar) {
        let has_before = marks_as_before(place);
        if !has_before || !is_visible(cell_at(i - u32(has_before))) {
            mark(place);
        }
    }
    var gradient = vec3f(0.0);
    // Where all voxels are equal, negative weights would leave a remainder of farther ones, and light shows the
    // direction of the smallest gradient.
    if GRADIENTS && cells[3u * i + 1u] < cells[3u * i + 2u] {
        gradient = vec3f(slope(i, 1u), slope(i, part.dims.x), slope(i, part.dims.x * part.dims.y));
    }
    store_scalar(place, gradient, scalar);
}
