// Parameters of all stages of one frame of the painter `quads`. World lengths are in a unit of about a voxel
// (Grid::local in crates/volume/src/volume/grid.rs).
//
// View coordinates are x right, y up and z forward. x and y are offsets at the same depth from the home ray, the ray of
// the picture that passes nearest to the middle of the lattice. So numbers stay small even if the volume is far off the
// axis. z = 0 is the depth of the middle of the lattice, so depths stay small even if the eye is far away. Plane
// coordinates belong to a ray: in a parallel projection its offset from the home ray, in perspective the difference of
// its slopes dx/dz and dy/dz from the slopes of the home ray.
// uses: common/clip

struct Frame {
    // Lattice coordinates of the middle of the lattice.
    lattice_center: vec3f,
    // Support radius of the kernel, voxels.
    radius: f32,
    // View coordinates of lattice point p: x = dot(view_x, p - lattice_center) + offset_x, y likewise, z without an
    // offset.
    view_x: vec3f,
    offset_x: f32,
    view_y: vec3f,
    offset_y: f32,
    view_z: vec3f,
    // Depth of the middle of the lattice in front of the eye; 0 and unused for a parallel projection.
    eye_depth: f32,
    // Lattice coordinates of the world vectors right, up and along the home ray (per unit of depth).
    grid_right: vec3f,
    // Half the view depth that a kernel extends over, radius * |view_z|.
    depth_extent: f32,
    grid_up: vec3f,
    // View depth at which the first sheet begins.
    sheet_origin: f32,
    grid_forward: vec3f,
    // Thickness of a sheet.
    sheet_step: f32,
    // Plane coordinates of a point of the image in pixels: pixel * scale + offset.
    pixel_scale: vec2f,
    pixel_offset: vec2f,
    // Clip coordinates from plane coordinates.
    clip_scale: vec2f,
    clip_offset: vec2f,
    // Half extent added to a quad, in plane coordinates: absorbs the rounding of its corners.
    quad_pad: vec2f,
    // The value of a sheet per density and world length of a section: sheet_scale / (N unit_distance), N the integral
    // of the kernel.
    section_scale: f32,
    // Optical depth per accumulated value, 1 / sheet_scale.
    inverse_sheet_scale: f32,
    // Width and height of the region of the image that is rendered, pixels.
    region: vec2u,
    // Number of sheets.
    sheets: u32,
    // 1 / sheet_step.
    inverse_sheet_step: f32,
    // Axis-aligned sheets: number of the sheet, front to back, of lattice point p: dot(plane_axis, p) + plane_offset.
    plane_axis: vec3f,
    plane_offset: f32,
    // Half the size of the box in which the field of scalars is reconstructed, voxels.
    box_half: vec3f,
    // Optical depth at which a pixel counts as opaque: minus the logarithm of the tolerated transmittance.
    opaque_depth: f32,
    // Growth of a kernel centred at view depth z: max(1, growth.x + growth.y z).
    growth: vec2f,
    // Slopes dx/dz and dy/dz of the home ray; 0 in a parallel projection.
    home_slope: vec2f,
    // Tiles of early splat termination across and down the region, and pixels along the side of one.
    tiles: u32,
    tile_size: u32,
    // The depth at view depth z, as solids have it: x z + y.
    solid_depth: vec2f,
    // What the model takes. X-ray: `curve` of common/response.wgsl. Coded or attenuated by depth: the share of
    // view depth z in the depth of the box is model.x z + model.y, and model.z is the attenuation.
    model: vec4f,
    // The part of the lattice that a brick owns, from its middle, in voxels. See common/owned.wgsl.
    owned_low: vec3f,
    owned_high: vec3f,
    // `pixel_offset` of the whole picture, and the place of the region's first pixel in the picture.
    picture_offset: vec2f,
    picture_corner: vec2u,
    // The inner side of a clipping plane are the view coordinates (x, y, z) with dot(xyz, (x, y, z)) + w >= 0, in
    // voxels. See common/clip.wgsl.
    clip_planes: array<vec4f, MAX_CLIP_PLANES>,
}
