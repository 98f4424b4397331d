// The marks of cells of 2^3 voxels, see common/packing.wgsl. The stage binds `pack`.
// uses: common/packing

@group(0) @binding(3) var<storage, read_write> marks: array<atomic<u32>>;

// The first and the last cell that a splat marks, `place` voxels along a, b and m from the first packed voxel.
fn first_marked(place: vec3u) -> vec3u {
    return (place + pack.mark_shift - pack.mark_reach) / u32(CELL);
}

fn last_marked(place: vec3u) -> vec3u {
    return (place + pack.mark_shift + pack.mark_reach) / u32(CELL);
}

// The cells from `first` to `last` of macrocell number `number` along an axis, as bits of marks. `behind` are the bits
// of its second cell.
fn cells_between(first: u32, last: u32, number: u32, behind: u32) -> u32 {
    return select(0u, ~behind, first <= 2u * number) | select(0u, behind, last > 2u * number);
}

fn mark(place: vec3u) {
    let first = first_marked(place);
    let last = last_marked(place);
    for (var z = first.z / 2u; z <= last.z / 2u; z++) {
        let in_slab = cells_between(first.z, last.z, z, 0xf0u) & 0xffu;
        for (var y = first.y / 2u; y <= last.y / 2u; y++) {
            let in_row = in_slab & cells_between(first.y, last.y, y, 0xccu);
            for (var x = first.x / 2u; x <= last.x / 2u; x++) {
                let cells = in_row & cells_between(first.x, last.x, x, 0xaau);
                let number = dot(vec3u(x, y, z), pack.mark_steps);
                atomicOr(&marks[number / 4u], cells << (number % 4u * 8u));
            }
        }
    }
}
