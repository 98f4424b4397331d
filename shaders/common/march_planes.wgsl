// The march of one ray of colours from voxel plane to voxel plane, run after run. The stage defines `Slabs`, the slabs
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

// The planes of a run of colours that can matter to a ray: the first, the plane after the last, and the plane after the
// last that completes a slab.
fn planes_of(run: vec2i, geometry: RayGeometry) -> vec3i {
    let ends = run_planes(run);
    var first = ends.x;
    var end = ends.y;
    if PERSPECTIVE || CUT {
        // Planes beyond the counting part: the planes that kernels reach over, one because the next slab shapes the
        // curve in the last slab, and one because the conversion to i32 truncates, towards 0. One more because the
        // second plane is the plane after the last.
        let beyond = REACH + 2;
        first = max(first, i32(max(geometry.inside.x, -FAR)) - beyond);
        end = min(end, i32(min(geometry.inside.y, FAR)) + beyond + 1);
    }
    var last = end + FLUSH;
    if BRICK {
        // The slab before the first that a brick owns shapes it. The lack of colours of two slabs before moves on to
        // it.
        let owned = vec2i(floor(geometry.owned));
        first = max(first, owned.x - 2 - REACH);
        last = min(last, owned.y + FLUSH - REACH + 1);
        end = min(end, last);
    }
    return vec3i(first, end, last);
}
