// The march of one ray from plane to plane. The stage says what a plane adds: `Slabs`, `feed` and FLUSH.

fn march_planes(tile: vec3u, course: Course) -> Ray {
    let footprints = footprints_of(course);
    var ray = clear_ray();
    for (var slot = 0u; slot < raster.run_slots; slot++) {
        let run = run_of(tile, slot, ray.depth);
        if run.y == 0 {
            break;
        }
        let planes = planes_of(run, course);
        var slabs = Slabs();
        ray.before = vec4f(0.0);
        ray.slab = vec4f(0.0);
        for (var plane = planes.x; plane < planes.y + FLUSH; plane++) {
            feed(&ray, &slabs, gathered(course, footprints, plane, planes.y), course, plane);
            if ray.depth > raster.opaque_depth {
                break;
            }
        }
    }
    return ray;
}
