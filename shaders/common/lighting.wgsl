// Blinn-Phong shading (Blinn 1977) of two-sided surfaces across gradients: `Lighting::shade` of the host in f32. All
// vectors are in view coordinates.

// Number of lights; with 0 colours stay as they are.
override LIGHTS: u32 = 0u;

struct Lighting {
    // World axes of the view.
    right: vec3f,
    ambient: f32,
    up: vec3f,
    diffuse: f32,
    forward: vec3f,
    specular: f32,
    // Unit vectors towards the lights. 0: the light is at the eye.
    lights: array<vec4f, 4>,
    shininess: f32,
}

// Diffuse (x) and specular (y) share of one light on a surface with a unit normal.
fn light_from(light: vec3f, normal: vec3f, to_eye: vec3f) -> vec2f {
    let towards = select(light, to_eye, all(light == vec3f(0.0)));
    let cosine = dot(normal, towards);
    if cosine <= 0.0 {
        return vec2f(0.0);
    }
    let between = to_eye + towards;
    // 1e-20: the two directions may be opposite.
    let highlight = dot(normal, between) * inverseSqrt(max(dot(between, between), 1e-20));
    return vec2f(cosine, pow(max(highlight, 0.0), lighting.shininess));
}

// Of a surface across a gradient of any length: x, the factor of its colour, and y, the white that is added. Without a
// gradient the colour stays as it is.
fn light_on(gradient: vec3f, to_eye: vec3f) -> vec2f {
    let largest = max(abs(gradient.x), max(abs(gradient.y), abs(gradient.z)));
    if largest <= 0.0 {
        return vec2f(1.0, 0.0);
    }
    // By its largest component first: squares of large and of small numbers leave the range of f32.
    let direction = gradient / largest;
    let facing = select(1.0, -1.0, dot(direction, to_eye) < 0.0);
    let normal = direction * (inverseSqrt(dot(direction, direction)) * facing);
    var sum = light_from(lighting.lights[0].xyz, normal, to_eye);
    if LIGHTS > 1u {
        sum += light_from(lighting.lights[1].xyz, normal, to_eye);
    }
    if LIGHTS > 2u {
        sum += light_from(lighting.lights[2].xyz, normal, to_eye);
    }
    if LIGHTS > 3u {
        sum += light_from(lighting.lights[3].xyz, normal, to_eye);
    }
    return vec2f(lighting.ambient + lighting.diffuse * sum.x, lighting.specular * sum.y);
}

// A colour under a light that light_on() gave.
fn lit(color: vec3f, light: vec2f) -> vec3f {
    return clamp(color * light.x + light.y, vec3f(0.0), vec3f(1.0));
}
