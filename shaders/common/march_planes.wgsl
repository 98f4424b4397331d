// The march of one ray from voxel plane to voxel plane, run after run. Each stage of rays defines `Slabs`, the slabs
// that are not complete, `feed`, which adds a plane to them, `begin_run`, `is_opaque`, which ends rays, and FLUSH, the
// number of planes after the last of a run until every slab that the run feeds has been composited.
// uses: common/plane, common/ray_geometry

// Marches a ray on from the state `start`.
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
        for (var plane = planes.x; plane < planes.z; plane++) {
            feed(&ray, &slabs, gathered(geometry, footprints, plane, planes.y), geometry, plane, planes.y);
            if is_opaque(ray) {
                break;
            }
        }
    }
    return ray;
}
