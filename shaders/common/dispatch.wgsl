// The invocation's place in a dispatch that is folded into rows of workgroups where one row would be too long.
const WORKGROUP: u32 = 64u;

fn invocation_index(id: vec3u, groups: vec3u) -> u32 {
    return id.x + id.y * groups.x * WORKGROUP;
}
