// The light on a stored splat.
// uses: common/lighting, common/words

// The colour of a splat with a packed world gradient, if the shares `kept` of each light arrive. `point` is
// its place in the lattice, `to_eye` the unit vector from there to the eye, in view coordinates.
fn lit_splat(color: vec3f, normal: u32, kept: vec4f, point: vec3f, to_eye: vec3f) -> vec3f {
    let n = unpack_normal(normal);
    let gradient = vec3f(dot(lighting.right, n), dot(lighting.up, n), dot(lighting.forward, n));
    return lit(color, light_on(gradient, 1.0, point, to_eye, kept));
}

// The unit vector to the eye from a lattice point at this offset from it, in view coordinates, given those of a step
// along each axis of the lattice.
fn towards_eye(offset: vec3f, view_x: vec3f, view_y: vec3f, view_z: vec3f) -> vec3f {
    return -normalize(view_x * offset.x + view_y * offset.y + view_z * offset.z);
}
