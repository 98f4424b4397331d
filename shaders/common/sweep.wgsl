// Sweeps of light through a box of voxels, plane after plane away from the light, a few planes at a time: a part.

struct Sweep {
    // The places in the field between neighbours across planes, rows and columns.
    steps: vec3u,
    // Planes of the part.
    count: u32,
    // Planes, rows and columns of the box.
    dims: vec3u,
    // The first plane of the part, counted from the light.
    first: u32,
    // Filtered planes begin so many planes nearer to the light, and so many there are.
    before: u32,
    filtered: u32,
    directions: u32,
    // 1: the light lies at the end of the last plane; 0: of the first.
    ahead: u32,
    // 1: the light is added to the light that has arrived already.
    adds: u32,
    // The base 2 logarithm of the columns of a workgroup of columns and planes.
    lanes: u32,
    // Rows and columns of the rays whose sums a plane stores.
    rays: vec2u,
}

// Invocations of a workgroup. Workgroups of columns and rows are 32 x 2: neighbours in memory are read together.
const LANES: u32 = 64u;

// The column and the plane of an invocation, given its workgroup and its number. Workgroups are 32 columns by 2 planes;
// of planes across x, which are neighbours in memory, 8 by 8.
fn column_and_plane(group: vec3u, lane: u32) -> vec2u {
    let within = vec2u(lane & ((1u << sweep.lanes) - 1u), lane >> sweep.lanes);
    return (group.xy << vec2u(sweep.lanes, 6u - sweep.lanes)) + within;
}

// Rows and columns of zeros at either end of a filtered plane.
const ENDS: u32 = 2u;

fn padded() -> vec2u {
    return sweep.dims.yz + 2u * ENDS;
}

// The place of a row and a column, counted with the zeros, in the planes of a buffer.
fn in_plane(plane: u32, row: u32, column: u32) -> u32 {
    let size = padded();
    return (plane * size.x + row) * size.y + column;
}

// The place of a ray among the sums of a plane.
fn in_rays(plane: u32, row: u32, column: u32) -> u32 {
    return (plane * sweep.rays.x + row) * sweep.rays.y + column;
}

// The place in the field of a voxel in a plane counted from the light.
fn in_field(number: u32, row: u32, column: u32) -> u32 {
    let plane = select(number, sweep.dims.x - 1u - number, sweep.ahead == 1u);
    return dot(vec3u(plane, row, column), sweep.steps);
}

// The depth beyond which the neighbours of a voxel do not count: less than a thousandth of the light arrives. The host
// has 5.5, because it finds the neighbours of a vector of voxels if one of them is lit more. With 5.5 here, three times
// as many voxels of a noisy lattice differed from the host's by over a thousandth.
const FAINT: f32 = 7.0;

// exp(-depth), 1 below depth 0.
fn transmitted(depth: f32) -> f32 {
    return exp(-clamp(depth, 0.0, 16.0));
}
