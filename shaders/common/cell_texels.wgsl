// The scalars of the cells of some rows of some planes of a box, in `cells`, with those that gradients depend on.

// Cells have gradients.
override RANGES: bool = false;

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
    // Cells of a row of the box.
    across: u32,
    // In gradients, the weight of the slopes to either side along each of the other axes, over that of the own slope,
    // and that of the own slope.
    beside: f32,
    own: f32,
}

@group(0) @binding(0) var<uniform> part: CellTexels;
// Scalars, x fastest; with gradients, the range of the voxels in the middle of each too.
@group(0) @binding(1) var<storage, read> cells: array<f32>;

fn is_in_part(index: u32) -> bool {
    return index < part.across * part.rows * part.planes;
}

// The place of texel number `index` in the part.
fn place_in_part(index: u32) -> vec3u {
    return vec3u(index % part.across, index / part.across % part.rows, index / (part.across * part.rows));
}

fn place_in_box(index: u32) -> vec3u {
    return place_in_part(index) + vec3u(0u, part.first_row, part.first_plane);
}

// The number of the cell of texel number `index` among all cells.
fn cell_number(index: u32) -> u32 {
    let cell = part.first + place_in_part(index);
    return cell.x + part.dims.x * (cell.y + part.dims.y * cell.z);
}

fn cell_at(i: u32) -> f32 {
    return cells[select(i, 3u * i, RANGES)];
}

// The difference of the cells before and behind one.
fn difference(i: u32, step: u32) -> f32 {
    return cell_at(i + step) - cell_at(i - step);
}

// The slope at a cell along the axis along which cells have this step.
fn slope(i: u32, step: u32) -> f32 {
    let differences = vec3f(difference(i, step), difference(i, 2u * step), difference(i, 3u * step));
    return dot(part.differences, differences);
}

// The slope at a cell with the slopes to either side along another axis.
fn line(i: u32, step: u32, across: u32) -> f32 {
    return slope(i, step) + part.beside * (slope(i - across, step) + slope(i + across, step));
}

// A component of the gradient of a cell: slopes, smoothed along the other two axes.
fn component(i: u32, step: u32, across: u32, down: u32) -> f32 {
    let sides = line(i - down, step, across) + line(i + down, step, across);
    return part.own * (line(i, step, across) + part.beside * sides);
}

// The gradient of a cell; 0 where all voxels around it are equal: negative weights would leave a remainder of farther
// ones, and light shows the direction of the smallest gradient.
fn cell_gradient(i: u32) -> vec3f {
    if RANGES && cells[3u * i + 1u] != cells[3u * i + 2u] {
        let steps = vec3u(1u, part.dims.x, part.dims.x * part.dims.y);
        return vec3f(
            component(i, steps.x, steps.y, steps.z),
            component(i, steps.y, steps.z, steps.x),
            component(i, steps.z, steps.x, steps.y),
        );
    }
    return vec3f(0.0);
}
