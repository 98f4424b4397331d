// The light on a splat as it is stored.

// The colour of a splat with a packed world gradient under the lights, of which the shares `kept` arrive. `to_eye` is
// the unit vector from the splat to the eye, in view coordinates.
fn lit_splat(color: vec3f, normal: u32, kept: vec4f, to_eye: vec3f) -> vec3f {
    let n = unpack_normal(normal);
    let gradient = vec3f(dot(lighting.right, n), dot(lighting.up, n), dot(lighting.forward, n));
    return lit(color, light_on(gradient, to_eye, kept));
}
