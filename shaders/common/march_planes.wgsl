// The march of one ray from voxel plane to voxel plane, run after run. Each stage of rays defines how a plane adds to
// incomplete slabs: the struct `Slabs`, and the functions `feed` and `begin_run`. FLUSH is the number of planes marched
// after the last plane of a run, until every slab of the run has been composited. `is_opaque` ends a ray.
// uses: common/plane, common/ray_geometry

// `start` is the state of the ray before this march.
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
