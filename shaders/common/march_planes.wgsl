// The march of one ray from voxel plane to voxel plane, run after run. Each stage of rays says what a plane adds to the
// slabs that are not complete: the struct `Slabs`, the functions `feed` and `begin_run`, and FLUSH, the planes that are
// marched after the last of a run until every slab that the run feeds has been composited; and by `is_opaque` whether a
// ray ends.
// uses: common/plane, common/ray_geometry

// `start` is what the ray has gathered before.
fn march_planes(tile: vec3u, geometry: RayGeometry, start: RayState) -> RayState {
    let footprints = footprints_of(geometry);
    var ray = start;
    for (var slot = 0u; ; slot++) {
        let run = run_at(tile, slot, ray.depth);
        if run.y == 0 {
            break;
        }
        let planes = planes_of(run, geometry);
        var slabs = Slabs();
        begin_run(&ray);
        for (var plane = planes.x; plane < planes.y + FLUSH; plane++) {
            feed(&ray, &slabs, gathered(geometry, footprints, plane, planes.y), geometry, plane, planes.y);
            if is_opaque(ray) {
                break;
            }
        }
    }
    return ray;
}
