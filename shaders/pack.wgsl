// pack: classified splats into the texture that the painter `tiles` reads: rows of voxels along a, two to a texel, plane
// after plane along m, as f16 of (colour, 1) times density; and which cells of 4^3 voxels are not empty.

struct Pack {
    // First lattice point of the box that is packed.
    low: vec3u,
    // The splats that are looked at, and the one after the last.
    first_splat: u32,
    // Numbers of the lattice axes that a, b and m run along.
    axes: vec3u,
    // Voxels along b.
    rows: u32,
    columns: u32,
    row_texels: u32,
    // Texels of a row of the texture.
    width: u32,
    // Rows of the texture in the buffer: the first, and how many.
    first_row: u32,
    row_count: u32,
    // What densities are multiplied by to stay in the range of f16.
    scale: f32,
    end_splat: u32,
}

@group(0) @binding(0) var<uniform> pack: Pack;
@group(0) @binding(1) var<uniform> lighting: Lighting;
@group(0) @binding(2) var<storage, read> splats: array<vec2u>;
@group(0) @binding(3) var<storage, read> origins: array<vec4u>;
// Voxel by voxel.
@group(0) @binding(4) var<storage, read_write> texels: array<vec2u>;
@group(0) @binding(5) var occupied: texture_storage_3d<r32uint, write>;

// Rounded to 11 bits, which f16 holds exactly: some drivers cut off when they pack.
fn rounded(v: vec4f) -> vec4f {
    return bitcast<vec4f>((bitcast<vec4u>(v) + 0x1000u) & vec4u(0xffffe000u));
}

@compute @workgroup_size(WORKGROUP)
fn voxels(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = pack.first_splat + invocation_index(id, groups);
    if index >= pack.end_splat {
        return;
    }
    let words = splat_words(index);
    let looks = splats[2u * index + 1u];
    var color = splat_color(words.y, looks.x);
    if LIGHTS > 0u {
        let n = unpack_normal(looks.y);
        let gradient = vec3f(dot(lighting.right, n), dot(lighting.up, n), dot(lighting.forward, n));
        color = lit(color, light_on(gradient, vec3f(0.0, 0.0, -1.0)));
    }
    let point = splat_point(words) - pack.low;
    let place = vec3u(point[pack.axes.x], point[pack.axes.y], point[pack.axes.z]);
    textureStore(occupied, place / u32(CELL), vec4u(1u));
    let row = place.z / pack.columns * (pack.rows + 1u) + 1u + place.y;
    // Rows before the first wrap around to large numbers.
    let at = row - pack.first_row;
    if at >= pack.row_count {
        return;
    }
    let texel = place.z % pack.columns * (pack.row_texels + u32(MARGIN)) + u32(MARGIN) + place.x / 2u;
    let density = splat_weight(words) * pack.scale;
    let v = rounded(vec4f(color * density, density));
    texels[2u * (at * pack.width + texel) + place.x % 2u] = vec2u(pack2x16float(v.xy), pack2x16float(v.zw));
}
