// What all stages of one frame share. Lengths are world units unless a name says otherwise.
//
// View coordinates (x right, y up, z forward) have their axis through the camera's target and z = 0 at the middle of
// the lattice, so that depths stay small numbers however far the eye is. Plane coordinates are those of a ray: world
// offsets from the axis for a parallel projection, slopes dx/dz and dy/dz for a perspective one.
struct Frame {
    // Lattice coordinates of the middle of the lattice.
    lattice_center: vec3f,
    // Support radius of the kernel, voxels.
    radius: f32,
    // View coordinates of lattice point p: dot(view_x, p - lattice_center) + offset_x, and so on.
    view_x: vec3f,
    offset_x: f32,
    view_y: vec3f,
    offset_y: f32,
    view_z: vec3f,
    // Depth of the middle of the lattice in front of the eye; 0 and unused for a parallel projection.
    eye_depth: f32,
    // Lattice coordinates of the world vectors right, up and forward.
    grid_right: vec3f,
    // Half the depth that a kernel extends over, radius * |view_z|.
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
    // Half extent by which a quad is grown, in plane coordinates: absorbs the rounding of its corners.
    quad_pad: vec2f,
    // What a sheet accumulates per density and world length of a section: sheet_scale / (N unit_distance).
    section_scale: f32,
    // Optical depth per accumulated value, 1 / sheet_scale.
    inverse_sheet_scale: f32,
    // Width and height of the region of the image that is rendered, pixels.
    region: vec2u,
    // Number of sheets.
    sheets: u32,
    // 1 / sheet_step.
    inverse_sheet_step: f32,
}
