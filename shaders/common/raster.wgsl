// The raster of the painter `tiles`, its volume, and the way from one to the other.
//
// The lattice is looked at along the axis m that the rays follow most; a and b are the other two, a the first of them that
// rays do not lean to too much for six voxels of a row to hold what reaches them. Voxel planes are numbered front to back.
// Base coordinates are the (a, b) at which a ray meets plane 0; it meets plane k further on by k times its shear. Rays
// through one eye are followed along up to three axes, either way: each ray along its own.

override PERSPECTIVE: bool = false;

// Steps of the table of sections, over how far rays lean, the length of their shear, from 0 to that of a ray that follows
// all axes alike, sqrt(2).
const SECTIONS: u32 = 9u;
const SECTION_STEPS: f32 = 8.0 / 1.4142136;

struct Raster {
    // Base coordinates of raster point (0, 0), and the steps from there to its neighbours in x and y, of parallel rays.
    origin: vec2f,
    step_x: vec2f,
    step_y: vec2f,
    shear: vec2f,
    // Unit vector of parallel rays in (a, b, m).
    direction: vec3f,
    // World length per lattice length along parallel rays.
    stretch: f32,
    // Lattice directions of rays through one eye in (a, b, m): of raster point (0, 0), and the steps from there to its
    // neighbours in x and y.
    heading: vec3f,
    // Optical depth per world length and stored density, or scalar per lattice length and stored scalar.
    density_scale: f32,
    heading_x: vec3f,
    // Optical depth at which a ray counts as opaque.
    opaque_depth: f32,
    heading_y: vec3f,
    // Square of the kernel's radius.
    radius2: f32,
    // Where the eye is, in (a, b) and planes.
    eye: vec3f,
    // Of parallel rays: of a row of voxels at distance v along b, kernels within row_half of row_slope v along a reach them.
    row_half: f32,
    // The box that scalars fill, in (a, b) and planes.
    box_low: vec3f,
    row_slope: f32,
    box_high: vec3f,
    // Places at which a slab of scalars is classified.
    samples: u32,
    // View coordinates of a gradient of 1 along each axis of the lattice.
    gradient_x: vec3f,
    // Whether no cell is skipped: 1 or 0.
    everything: u32,
    gradient_y: vec3f,
    // Places for the runs of a tile.
    run_slots: u32,
    gradient_z: vec3f,
    // Whether plane 0 is the last of the volume: 1 or 0.
    flipped: i32,
    // Voxels along a, b and m.
    voxels: vec3i,
    // Columns of planes in the volume's texture.
    columns: i32,
    // How far from a ray's place in a plane kernels reach it along a and b, of parallel rays.
    half: vec2f,
    // Rays of a tile are so many raster points apart, a voxel where rays are shared; tiles of as many phases lie between
    // each other.
    phases: vec2u,
    // Footprint at squared half chord c2: sqrt(c2) times the polynomial in c2 of these eight coefficients.
    footprint: vec4f,
    footprint_high: vec4f,
    // Slopes dx/dz and dy/dz of the ray through raster point (0, 0), and the step to the next, through one eye.
    plane_origin: vec2f,
    plane_step: vec2f,
    // The scalars around 0 at which nothing shows, and the place of a scalar in the table: see common/transfer.wgsl.
    clear: vec2f,
    lookup: vec2f,
    // Raster points.
    size: vec2u,
    // Tiles of 8 x 8 rays across and down, of each phase.
    tiles: vec2u,
    // Raster coordinates of the middle of the picture's first pixel, and the steps to its neighbours in x and y.
    pixel_origin: vec2f,
    pixel_x: vec2f,
    pixel_y: vec2f,
    // Pixels.
    picture: vec2u,
    // Texels of a row of voxels in the volume's texture: two voxels each.
    row_texels: i32,
    // For parallel rays the first; for others at steps of how far they lean, with s in units of that.
    sections: array<Section, SECTIONS>,
}

// Parts of a kernel in the slabs before its middle: its footprint times x + y s + z s^2, s the place of its centre along the
// ray from where the ray meets its plane. The slabs behind get theirs by symmetry. Colours have slabs a plane thick: here
// are those one, two and three before its own, which has the rest, and z is not used.
struct Section {
    x: vec4f,
    y: vec4f,
    z: vec4f,
}

// Tiles in a row of the texture of runs.
const RUN_ROW: u32 = 4096u;

// Where the runs of a tile are kept.
fn runs_of(tile: vec3u, slot: u32) -> vec2u {
    let index = (tile.z * raster.tiles.y + tile.y) * raster.tiles.x + tile.x;
    return vec2u(index % RUN_ROW, index / RUN_ROW * raster.run_slots + slot);
}

// The first ray of a tile.
fn first_ray(tile: vec3u) -> vec2u {
    return tile.xy * 8u * raster.phases + vec2u(tile.z % raster.phases.x, tile.z / raster.phases.x);
}

// Where a ray meets the planes.
struct Line {
    base: vec2f,
    shear: vec2f,
    // Its lattice direction, of any length.
    heading: vec3f,
}

fn line_of(ray: vec2u) -> Line {
    let x = f32(ray.x);
    let y = f32(ray.y);
    if PERSPECTIVE {
        let heading = raster.heading + x * raster.heading_x + y * raster.heading_y;
        let shear = heading.xy / heading.z;
        return Line(raster.eye.xy - shear * raster.eye.z, shear, heading);
    }
    return Line(raster.origin + x * raster.step_x + y * raster.step_y, raster.shear, raster.direction);
}

// How far from a ray's place in a plane kernels reach it along a and b.
fn half_of(shear: vec2f) -> vec2f {
    return sqrt(raster.radius2 * (1.0 + shear * shear));
}

// Whether a ray is followed along this axis and this way. Where it follows two alike, it is followed along both.
fn is_followed(ray: vec2u) -> bool {
    let heading = line_of(ray).heading;
    return !PERSPECTIVE || heading.z >= max(abs(heading.x), abs(heading.y));
}
