// field_of_cells: scalars of cells to their extinctions, in the box of voxels that casts shadows. An invocation for
// each cell of a part of the box. Voxels are cells too.
// uses: common/casting, common/cell_texels, common/dispatch, common/transfer

struct Occluders {
    // Gradients of the lattice coordinates, per local unit.
    gradient_x: vec3f,
    // The place of the length of such a gradient among its bins: length times this.
    gradient_lookup: f32,
    gradient_y: vec3f,
    gradient_z: vec3f,
    // Lattice point of the first cell of the box.
    low: vec3u,
    // The place of scalars among their bins.
    lookup: vec2f,
    // Local units in the unit that extinctions are per.
    per_unit: f32,
}

@group(0) @binding(2) var<uniform> light_box: LightBox;
@group(0) @binding(3) var<storage, read_write> field: array<f32>;
// See common/transfer.wgsl.
@group(0) @binding(4) var transfer: texture_storage_2d<rgba32float, read>;
@group(0) @binding(5) var<uniform> occluders: Occluders;

// The extinction of isosurfaces in a cell with a gradient, per local unit: `casting` of the host.
fn casting_surfaces(scalar: f32, gradient: vec3f, local: vec3f) -> f32 {
    let per_cell = max(length(gradient), 1e-18);
    var depth = 0.0;
    for (var number = 0u; number < ISOSURFACES; number++) {
        let share = 1.0 - abs(scalar - surface_scalar(number)) / per_cell;
        depth += surface_texel(number).a * max(share, 0.0);
    }
    return depth * length(local) / per_cell;
}

@compute @workgroup_size(WORKGROUP)
fn field_of_cells(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = invocation_index(id, groups);
    if !is_in_part(index) {
        return;
    }
    let i = cell_number(index);
    let gradient = cell_gradient(i);
    let local = occluders.gradient_x * gradient.x + occluders.gradient_y * gradient.y
        + occluders.gradient_z * gradient.z;
    let share = gradient_share(local, occluders.gradient_lookup);
    var density = classified(cell_at(i), occluders.lookup).value.a * share;
    if ISOSURFACES > 0u {
        density += casting_surfaces(cell_at(i), gradient, local) / occluders.per_unit;
    }
    let point = place_in_box(index) + occluders.low;
    field[index_in_box(point)] = occluder(density, point);
}
