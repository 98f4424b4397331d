// The number of an invocation in a one-dimensional dispatch. A dispatch with more workgroups than fit along x is folded
// into rows of `groups.x` workgroups.
const WORKGROUP: u32 = 64u;

fn invocation_index(id: vec3u, groups: vec3u) -> u32 {
    return id.x + id.y * groups.x * WORKGROUP;
}
