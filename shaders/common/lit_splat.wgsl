// The light on a stored splat.
// uses: common/lighting, common/normal

// The colour of a splat with a packed world gradient under the lights, whose shares `kept` arrive. `point` is its place
// in the lattice, `to_eye` the unit vector from there to the eye, in view coordinates.
fn lit_splat(color: vec3f, normal: u32, kept: vec4f, point: vec3f, to_eye: vec3f) -> vec3f {
    let n = unpack_normal(normal);
    let gradient = vec3f(dot(lighting.right, n), dot(lighting.up, n), dot(lighting.forward, n));
    return lit(color, light_on(gradient, 1.0, point, to_eye, kept));
}
