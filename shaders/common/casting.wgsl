// Which matter casts shadows. The stage binds `light_box`.
// uses: common/light_box

// The extinction of an occluder that is lit but casts no shadow.
const CLIPPED: f32 = 1e-30;

// Whether a voxel is inside all clipping planes: clipped matter casts no shadows.
fn casts(point: vec3u) -> bool {
    let from_middle = vec4f(vec3f(point) - light_box.middle, 1.0);
    var inside = true;
    for (var plane = 0u; plane < 8u; plane++) {
        inside = inside && dot(light_box.clip_planes[plane], from_middle) >= 0.0;
    }
    return inside;
}

// The extinction of a voxel in the field of shadows.
fn occluder(density: f32, point: vec3u) -> f32 {
    return select(CLIPPED, max(density, CLIPPED), casts(point));
}
