// gradients: from the packed scalars of a volume, a second texture of f16: the gradient by central differences, and the
// scalar. Gradients are per lattice step, along the axes of the lattice.

@group(0) @binding(0) var<uniform> pack: Pack;
@group(0) @binding(1) var scalars: texture_2d<u32>;
@group(0) @binding(2) var volume: texture_storage_2d<rgba32uint, write>;

// The two scalars of a texel; the margins around rows and shelves hold zeros.
fn scalars_at(texel: vec2i) -> vec2f {
    return bitcast<vec2f>(textureLoad(scalars, texel, 0).xy);
}

// The two words of a voxel, from its scalar and its differences along a, b and m.
fn packed_gradient(scalar: f32, a: f32, b: f32, m: f32) -> vec2u {
    var gradient: vec3f;
    gradient[pack.axes.x] = a;
    gradient[pack.axes.y] = b;
    gradient[pack.axes.z] = m;
    let v = rounded(vec4f(gradient, scalar) * pack.scale);
    return vec2u(pack2x16float(v.xy), pack2x16float(v.zw));
}

// One invocation for each texel.
@compute @workgroup_size(64)
fn gradients(@builtin(global_invocation_id) id: vec3u) {
    let at = vec2i(id.xy);
    let column_texels = i32(pack.row_texels) + MARGIN;
    let shelf_rows = i32(pack.rows) + 1;
    let column = (at.x - MARGIN) / column_texels;
    let shelf = (at.y - 1) / shelf_rows;
    let plane = shelf * i32(pack.columns) + column;
    // Margins stay as they are: zeros.
    let in_row = (at.x - MARGIN) % column_texels < i32(pack.row_texels) && (at.y - 1) % shelf_rows < i32(pack.rows);
    if at.x < MARGIN || at.y < 1 || column >= i32(pack.columns) || plane >= i32(pack.planes) || !in_row {
        return;
    }
    let f = scalars_at(at);
    let left = scalars_at(at - vec2i(1, 0));
    let right = scalars_at(at + vec2i(1, 0));
    let b = scalars_at(at + vec2i(0, 1)) - scalars_at(at - vec2i(0, 1));
    var m = vec2f(0.0);
    let in_shelf = at - vec2i(column * column_texels, shelf * shelf_rows);
    let columns = i32(pack.columns);
    if plane > 0 {
        let before = plane - 1;
        m -= scalars_at(in_shelf + vec2i(before % columns * column_texels, before / columns * shelf_rows));
    }
    if plane + 1 < i32(pack.planes) {
        let behind = plane + 1;
        m += scalars_at(in_shelf + vec2i(behind % columns * column_texels, behind / columns * shelf_rows));
    }
    let first = packed_gradient(f.x, 0.5 * (f.y - left.y), 0.5 * b.x, 0.5 * m.x);
    let second = packed_gradient(f.y, 0.5 * (right.x - f.x), 0.5 * b.y, 0.5 * m.y);
    textureStore(volume, at, vec4u(first, second));
}
