// Blinn-Phong shading (Blinn 1977) of two-sided surfaces across gradients: `Lighting::shade` of the host in f32. All
// vectors are in view coordinates.

// Number of lights; with 0 colours stay as they are.
override LIGHTS: u32 = 0u;
// Some light is at a place.
override POINT_LIGHTS: bool = false;

struct Lighting {
    // World axes of the view.
    right: vec3f,
    ambient: f32,
    up: vec3f,
    diffuse: f32,
    forward: vec3f,
    specular: f32,
    // Unit vectors towards the lights. 0: the light is at the eye. With w = 1: its place, in view coordinates from the
    // middle of the lattice.
    lights: array<vec4f, 4>,
    // Their red, green and blue.
    colors: array<vec4f, 4>,
    // From the lattice to view coordinates from its middle.
    from_lattice: mat4x3f,
    shininess: f32,
    // Post-shaded: the resolution of a scalar of 0 (see common/resolution.wgsl).
    faintest: f32,
}

// Light on a colour: the colour times `diffuse`, plus `specular`, has the weight `surface`; the original colour has the
// weight `plain`.
struct Shine {
    diffuse: vec3f,
    specular: vec3f,
    surface: f32,
    plain: f32,
}

// Light that does not change a colour.
fn no_shine() -> Shine {
    return Shine(vec3f(1.0), vec3f(0.0), 1.0, 0.0);
}

// All light arrives: of the lights that cast shadows (xyz), and the ambient light (w).
const UNSHADED = vec4f(1.0);

// The unit vector from a place towards a light.
fn towards_light(index: u32, place: vec3f, to_eye: vec3f) -> vec3f {
    let light = lighting.lights[index];
    var towards = light.xyz;
    if POINT_LIGHTS {
        let way = light.xyz - place;
        let square = dot(way, way);
        // At the place of the light, light comes from the eye.
        let unit = select(to_eye, way * inverseSqrt(square), square > 1e-20);
        towards = select(towards, unit, light.w > 0.0);
    }
    return select(towards, to_eye, all(light == vec4f(0.0)));
}

// Diffuse (x) and specular (y) share of a light on a surface with a unit normal.
fn light_from(index: u32, normal: vec3f, place: vec3f, to_eye: vec3f) -> vec2f {
    let towards = towards_light(index, place, to_eye);
    let cosine = dot(normal, towards);
    if cosine <= 0.0 {
        return vec2f(0.0);
    }
    let between = to_eye + towards;
    // 1e-20: the two directions may be opposite.
    let highlight = dot(normal, between) * inverseSqrt(max(dot(between, between), 1e-20));
    return vec2f(cosine, pow(max(highlight, 0.0), lighting.shininess));
}

// The light number `index`, whose share `kept` arrives.
fn shine_of(index: u32, normal: vec3f, place: vec3f, to_eye: vec3f, kept: f32) -> Shine {
    let shares = light_from(index, normal, place, to_eye) * kept;
    let color = lighting.colors[index].rgb;
    return Shine(color * shares.x, color * shares.y, 1.0, 0.0);
}

fn sum_of(a: Shine, b: Shine) -> Shine {
    return Shine(a.diffuse + b.diffuse, a.specular + b.specular, 1.0, 0.0);
}

// The factor of a colour without a surface: the light that arrives.
fn light_without_surface(kept: vec4f) -> f32 {
    let lost = dot(vec3f(1.0) - kept.xyz, vec3f(1.0)) / f32(max(LIGHTS, 1u));
    return 1.0 - lighting.ambient * (1.0 - kept.w) - (1.0 - lighting.ambient) * lost;
}

// The light on a surface across a gradient of any length; `kept` are the shares of light that arrive. Without a
// gradient there is no surface, and the light that arrives sets the brightness. `surface` is the weight of the surface
// (common/resolution.wgsl), `point` its place in the lattice.
fn light_on(gradient: vec3f, surface: f32, point: vec3f, to_eye: vec3f, kept: vec4f) -> Shine {
    let largest = max(abs(gradient.x), max(abs(gradient.y), abs(gradient.z)));
    let ambient = lighting.ambient * kept.w;
    if largest <= 0.0 {
        return Shine(vec3f(light_without_surface(kept)), vec3f(0.0), 1.0, 0.0);
    }
    // Divided by its largest component first: squares of large and of small numbers leave the range of f32.
    let direction = gradient / largest;
    let facing = select(1.0, -1.0, dot(direction, to_eye) < 0.0);
    let normal = direction * (inverseSqrt(dot(direction, direction)) * facing);
    let place = lighting.from_lattice * vec4f(point, 1.0);
    var sum = shine_of(0u, normal, place, to_eye, kept.x);
    if LIGHTS > 1u {
        sum = sum_of(sum, shine_of(1u, normal, place, to_eye, kept.y));
    }
    if LIGHTS > 2u {
        sum = sum_of(sum, shine_of(2u, normal, place, to_eye, kept.z));
    }
    if LIGHTS > 3u {
        sum = sum_of(sum, shine_of(3u, normal, place, to_eye, 1.0));
    }
    let plain = (1.0 - surface) * light_without_surface(kept);
    return Shine(ambient + lighting.diffuse * sum.diffuse, lighting.specular * sum.specular, surface, plain);
}

// A colour under a light from light_on().
fn lit(color: vec3f, light: Shine) -> vec3f {
    let shaded = clamp(color * light.diffuse + light.specular, vec3f(0.0), vec3f(1.0));
    return light.surface * shaded + light.plain * color;
}
