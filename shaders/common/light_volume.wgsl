// The light that arrives at each place of a field of scalars: shares at voxels or cells, linear between them. Each
// stage that uses it declares the bindings.
// uses: common/lighting

// Whether the field has shadows.
override SHADOWS: bool = false;

// The shares of light that arrive at a place of the texture: of the lights that cast shadows (xyz), and of the ambient
// light (w).
fn kept_at(place: vec3f) -> vec4f {
    if !SHADOWS {
        return UNSHADED;
    }
    return textureSampleLevel(light_volume, light_sampler, place, 0.0);
}
