//! pack, skip, prefilter and resample on the device, against plain twins.

use std::collections::BTreeSet;

use bytemuck::Zeroable;
use glam::{DVec2, DVec3};
use half::f16;

use super::axis::PrincipalAxis;
use super::march::{find_runs, skip};
use super::pack::{Layout, Marking, Packed, Packer, Packing, Voxel, boxes};
use super::parts::Footprint;
use super::rays::{RaySetup, Rays};
use super::resample::{ESTIMATES, FORMAT, IntermediateImage, Resampler};
use crate::camera::{Camera, ProjectionKind, View};
use crate::gpu::adapter_test::adapter;
use crate::gpu::cache::Cache;
use crate::gpu::context::Context;
use crate::gpu::layout::{self, CELL, Lighting, MACROCELL, MARGIN, Splat, TILE, packed_gradient};
use crate::gpu::pipeline::{Binding, bind, compute, layout as group_layout, texture_view};
use crate::gpu::recorder::Recorder;
use crate::gpu::savings::Savings;
use crate::gpu::splat::{SplatLight, ToEye};
use crate::gpu::stage::Constant;
use crate::gpu::store::{Splats, Store};
use crate::gpu::twins_test as twins;
use crate::gpu::view::{ViewGeometry, Weights};
use crate::image::Region;
use crate::kernel::Kernel;
use crate::painters::painter::{Depths, Job};
use crate::settings::Settings;
use crate::splats::brick::BrickSplats;
use crate::stats::RaySpacing;
use crate::volume::Grid;

fn context() -> Context {
    Context::new(Some(&adapter())).unwrap()
}

/// With the stages that the adapter runs, and with those of GPUs.
fn contexts() -> [Context; 2] {
    [context(), context().with_device_stages()]
}

/// The texels of a texture, x fastest, as four words each. `ty` is its type in WGSL, `load` the expression that reads
/// `p`.
fn texels(context: &Context, view: &wgpu::TextureView, binding: Binding, ty: &str, load: &str) -> Vec<[u32; 4]> {
    let source = format!(
        "@group(0) @binding(0) var texels: {ty};
        @group(0) @binding(1) var<storage, read_write> words: array<vec4u>;
        @compute @workgroup_size(1)
        fn copy(@builtin(global_invocation_id) p: vec3u, @builtin(num_workgroups) size: vec3u) {{
            words[(p.z * size.y + p.y) * size.x + p.x] = bitcast<vec4u>({load});
        }}"
    );
    let module = context.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("test.read"),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let layout = group_layout(context, "test", wgpu::ShaderStages::COMPUTE, &[binding, Binding::Write]);
    let pipeline = compute(context, &module, "test", "copy", &layout, &[]);
    let size = view.texture().size();
    let [width, height, depth] = [size.width, size.height, size.depth_or_array_layers];
    let bytes = u64::from(width * height * depth) * 16;
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
    let words = context.buffer("test.words", bytes, usage).unwrap();
    let group = bind(context, "test", &layout, &[texture_view(view), words.as_entire_binding()]);
    let mut recorder = Recorder::untimed(context);
    recorder.dispatch("test", &pipeline, &group, &[], [width, height, depth]);
    let read = recorder.read_back("test", &words, bytes).unwrap();
    recorder.submit();
    let words = read.values(context, "test").unwrap();
    context.guarded("test", || Ok(())).unwrap();
    words
}

/// The texels of a packed volume: pairs of voxels in rows, or voxels in a box.
fn read_volume(context: &Context, packed: &Packed) -> Vec<[u32; 4]> {
    let (dimension, kind, load) = match packed.packing.layout {
        Layout::Rows => (wgpu::TextureViewDimension::D2, "texture_2d<u32>", "textureLoad(texels, p.xy, 0)"),
        Layout::Box | Layout::Pages => (wgpu::TextureViewDimension::D3, "texture_3d<u32>", "textureLoad(texels, p, 0)"),
    };
    texels(context, &packed.volume, Binding::IntegerTexture(dimension), kind, load)
}

/// The words of all voxels of these texels, margins too.
fn all_words(packed: &Packed, texels: &[[u32; 4]]) -> impl Iterator<Item = [u32; 2]> {
    let Packing { layout, voxel, .. } = packed.packing;
    texels.iter().flat_map(move |&[a, b, c, d]| match (layout, voxel) {
        (Layout::Rows, Voxel::Scalar) => vec![[a, 0], [b, 0]],
        (Layout::Rows, _) => vec![[a, b], [c, d]],
        (Layout::Box | Layout::Pages, Voxel::Scalar) => vec![[a, 0]],
        (Layout::Box | Layout::Pages, _) => vec![[a, b]],
    })
}

// ---------------------------------------------------------------------------------------------------------------------
// prefilter, resample

const SIZE: [u32; 2] = [48, 40];

fn image(context: &Context, rays: &layout::Rays, values: impl Fn(f64, f64) -> [f64; 4]) -> IntermediateImage {
    let usage =
        wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::COPY_DST;
    let [width, height] = SIZE;
    let textures =
        [0, 1].map(|_| context.texture("test.image", FORMAT, [width, height, 1], wgpu::TextureDimension::D2, usage));
    let points = (0..height).flat_map(|y| (0..width).map(move |x| (f64::from(x), f64::from(y))));
    let data: Vec<[f32; 4]> = points.map(|(x, y)| values(x, y).map(|v| v as f32)).collect();
    context.queue.write_texture(
        textures[0].as_image_copy(),
        bytemuck::cast_slice(&data),
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(width * 16), rows_per_image: None },
        textures[0].size(),
    );
    let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::STORAGE_BINDING;
    let estimates = context.texture("test.estimates", ESTIMATES, [width, height, 1], wgpu::TextureDimension::D2, usage);
    IntermediateImage {
        rays: context.upload("test.rays", bytemuck::bytes_of(rays), wgpu::BufferUsages::UNIFORM).unwrap(),
        size: SIZE,
        textures: textures.map(|texture| texture.create_view(&Default::default())),
        estimates: estimates.create_view(&Default::default()),
    }
}

/// Coefficients of an image, by (x, y).
fn coefficients<V: Fn(f64, f64) -> [f64; 4]>(
    context: &Context,
    values: V,
) -> impl Fn(usize, usize) -> [f64; 4] + use<V> {
    let image = image(context, &layout::Rays::zeroed(), values);
    let mut recorder = Recorder::untimed(context);
    Resampler::new(context).prefilter(&mut recorder, &image);
    recorder.submit();
    let binding = Binding::Texture(wgpu::TextureViewDimension::D2);
    let words = texels(context, &image.textures[0], binding, "texture_2d<f32>", "textureLoad(texels, p.xy, 0)");
    move |x, y| words[y * SIZE[0] as usize + x].map(|word| f64::from(f32::from_bits(word)))
}

/// Points whose coefficients see no end of the image: five taps to either side.
fn inner() -> impl Iterator<Item = (usize, usize)> {
    (5..SIZE[1] as usize - 5).flat_map(|y| (5..SIZE[0] as usize - 5).map(move |x| (x, y)))
}

#[test]
fn splines_keep_constants_and_ramps() {
    let value = |x: f64, y: f64| [0.7, 0.1 + 0.01 * x, 0.9 - 0.02 * y, 0.01 * x + 0.005 * y];
    let got = coefficients(&context(), value);
    for (x, y) in inner() {
        for (got, expected) in got(x, y).into_iter().zip(value(x as f64, y as f64)) {
            assert!((got - expected).abs() < 1e-6, "{x}, {y}: {got} for {expected}");
        }
    }
}

#[test]
fn coefficients_of_a_point_are_those_of_the_inverse_filter() {
    let got = coefficients(&context(), |x, y| if (x, y) == (24.0, 20.0) { [1.0, -2.0, 0.5, 1.0] } else { [0.0; 4] });
    for (x, y) in inner() {
        let tap = twins::spline_tap(x as i32 - 24) * twins::spline_tap(y as i32 - 20);
        for (got, expected) in got(x, y).into_iter().zip([1.0, -2.0, 0.5, 1.0]) {
            assert!((got - expected * tap).abs() < 1e-6, "{x}, {y}: {got} for {expected} of {tap}");
        }
    }
}

#[test]
fn resampling_is_that_of_cubic_splines() {
    let context = context();
    // Pixels across a turned and stretched grid, all inside the image.
    let [across, down] = [30, 22];
    let (origin, step_x, step_y) = (DVec2::new(9.25, 4.5), DVec2::new(0.83, 0.31), DVec2::new(-0.27, 0.9));
    let rays = layout::Rays {
        brightest: [1.0; 3],
        size: SIZE,
        picture: [across, down],
        pixel_origin: origin.as_vec2().to_array(),
        pixel_x: step_x.as_vec2().to_array(),
        pixel_y: step_y.as_vec2().to_array(),
        share: 0.75,
        least_refined: 0.2,
        ..layout::Rays::zeroed()
    };
    // Neighbours that differ, colours below alpha, some of them outside what a picture can hold.
    let value = |x: f64, y: f64| {
        let alpha = 0.5 + 0.6 * (1.3 * x + 0.4 * y).sin();
        [0.6 * alpha, alpha * (0.5 + 0.4 * (2.1 * y).cos()), 0.1 - 0.2 * (x * y).sin(), alpha]
    };
    let image = image(&context, &rays, value);
    let pixels = context.pixels("test.pixels", [across, down]).unwrap();
    let mut recorder = Recorder::untimed(&context);
    let count = u64::from(across * down);
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
    let refinement = context.buffer("test.refinement", count * 4, usage).unwrap();
    Resampler::new(&context).resample(&mut recorder, &image, &pixels, &refinement, [across, down]);
    let read = recorder.read_back("test", &pixels, count * 16).unwrap();
    let own = recorder.read_back("test", &refinement, count * 4).unwrap();
    recorder.submit();
    let got: Vec<[f32; 4]> = read.values(&context, "test").unwrap();
    // Of the share of the image, pixels leave the least that may be to their own rays: the estimates are 0.
    let own: Vec<f32> = own.values(&context, "test").unwrap();
    assert!(own.iter().all(|share| (share - 0.75 * 0.2).abs() < 1e-6));
    let allowed = 2e-5;
    for (index, got) in (0..).zip(got) {
        let at = origin + step_x * f64::from(index % across) + step_y * f64::from(index / across);
        let sum = twins::spline(at, |x, y| value(f64::from(x), f64::from(y)));
        let alpha = sum[3].clamp(0.0, 1.0);
        let expected = [sum[0].clamp(0.0, alpha), sum[1].clamp(0.0, alpha), sum[2].clamp(0.0, alpha), alpha];
        for (got, expected) in got.into_iter().zip(expected.map(|value| value * 0.75 * 0.8)) {
            assert!((f64::from(got) - expected).abs() < allowed, "{at}: {got} for {expected}");
        }
    }
}

// ---------------------------------------------------------------------------------------------------------------------
// pack

const DIMS: [u32; 3] = [45, 38, 20];

/// Lattice points of some splats: a ball, a few voxels by themselves, and nothing between.
fn points() -> BTreeSet<[u32; 3]> {
    let all = (0..DIMS[2]).flat_map(|z| (0..DIMS[1]).flat_map(move |y| (0..DIMS[0]).map(move |x| [x, y, z])));
    let ball = |[x, y, z]: [u32; 3]| x.abs_diff(14).pow(2) + y.abs_diff(20).pow(2) + z.abs_diff(6).pow(2) < 30;
    all.filter(|&p| ball(p) || [[43, 3, 18], [32, 31, 3], [33, 31, 3], [31, 32, 19]].contains(&p)).collect()
}

/// A store of the points, brick after brick; `words` returns the words of a splat after its place.
fn store<const N: usize>(context: &Context, words: impl Fn([u32; 3]) -> [u32; N]) -> Store {
    let (mut splats, mut bricks): (Vec<u32>, Vec<BrickSplats>) = (Vec::new(), Vec::new());
    // In the order of the lattice, x fastest.
    let mut all: Vec<[u32; 3]> = points().into_iter().collect();
    all.sort_by_key(|&[x, y, z]| [z, y, x]);
    for (bx, by) in [(0, 0), (32, 0), (0, 32), (32, 32)] {
        let inside = |p: &[u32; 3]| p[0] / 32 * 32 == bx && p[1] / 32 * 32 == by;
        let rows = (0..32_u32).flat_map(|z| (0..32_u32).map(move |y| (y, z)));
        let bits = rows.map(|(y, z)| {
            let row = all.iter().filter(|p| inside(p) && p[1] == by + y && p[2] == z);
            row.fold(0, |bits, p| bits | 1 << (p[0] - bx))
        });
        let number = bricks.len() as u32;
        bricks.push(BrickSplats::new([bx, by, 0], splats.len() as u32 / (N as u32 + 1), bits));
        for p in all.iter().copied().filter(inside) {
            splats.push(layout::place([p[0] - bx, p[1] - by, p[2]], number));
            splats.extend(words(p));
        }
    }
    let count = splats.len() as u32 / (N as u32 + 1);
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
    let buffer = context.upload("test.splats", bytemuck::cast_slice(&splats), usage).unwrap();
    Store::new(context, (Splats::Device(buffer), None), 4 * (N as u64 + 1), count, bricks).unwrap()
}

/// The override constants of the packing of voxels; `points`: some light is at a place.
fn constants(voxel: Voxel, perspective: bool, points: bool) -> Vec<Constant> {
    let (lights, shadows) = match voxel {
        Voxel::Color { lights, shadows } => (lights, shadows),
        _ => (0, false),
    };
    vec![
        ("LIGHTS", lights),
        ("POINT_LIGHTS", points.into()),
        ("SHADOWS", shadows.into()),
        ("SCALARS", (!matches!(voxel, Voxel::Color { .. })).into()),
        ("GRADIENTS", (voxel == Voxel::Gradient).into()),
        ("PERSPECTIVE", perspective.into()),
    ]
}

fn packed(context: &Context, store: Store, axes: [usize; 3], voxel: Voxel, max_weight: f64) -> Packed {
    let layout = Layout::of(context, DIMS);
    let packer =
        (!context.is_software()).then(|| Packer::new(context, &constants(voxel, false, false), (voxel, layout), None));
    packed_by(context, (packer.as_ref(), false, false), store, axes, voxel, max_weight, |_| true)
}

fn packed_by(
    context: &Context,
    (packer, perspective, points): (Option<&Packer>, bool, bool),
    store: Store,
    axes: [usize; 3],
    voxel: Voxel,
    max_weight: f64,
    seen: impl Fn([[u32; 3]; 2]) -> bool,
) -> Packed {
    let stores = [store];
    let packing = Packing::new(
        context,
        boxes(&stores).filter(|&brick| seen(brick)),
        (DIMS, false),
        None,
        (axes, true),
        (voxel, marking(voxel)),
    )
    .unwrap();
    let lighting = Lighting {
        right: [0.9, 0.1, -0.2],
        up: [-0.1, 0.8, 0.3],
        forward: [0.2, -0.3, 0.7],
        ambient: 0.3,
        diffuse: 0.6,
        specular: 0.4,
        // The first light is at the eye, the last may be at a place.
        lights: [[0.0; 4], [0.6, 0.0, -0.8, 0.0], [-0.6, 0.64, 0.48, 0.0], [4.0, -7.0, 2.0, 1.0]],
        from_lattice: [[1.0, 0.1, -0.2, 0.0], [0.0, 0.9, 0.3, 0.0], [0.2, -0.3, 1.1, 0.0], [-9.0, -7.0, 4.0, 0.0]],
        shininess: 24.0,
        ..Lighting::default()
    };
    let view = [[1.0, 0.1, -0.2], [0.0, 0.9, 0.3], [0.2, -0.3, 1.1]];
    let to_eye = ToEye { perspective, eye: [20.0, 3.0, -60.0], view };
    let lights = if let Voxel::Color { lights, .. } = voxel { lights } else { 0 };
    let light = SplatLight { lighting, lights, points, to_eye };
    let mut recorder = Recorder::untimed(context);
    let packed =
        packing.stored().pack(&mut recorder, (packer, None), (&stores, &None, None), &light, max_weight, None).unwrap();
    recorder.submit();
    packed
}

/// Without room for the whole texture in a buffer, it is packed in bands: the same bytes, in one submission and without
/// a wait. A band of whole shelves has each splat once, but for bricks that reach into the next band.
#[test]
fn bands_hold_each_splat_about_once_and_wait_for_nothing() {
    let mut context = context();
    if Layout::of(&context, DIMS) == Layout::Box {
        return;
    }
    let voxel = Voxel::Color { lights: 0, shadows: false };
    let packer = Packer::new(&context, &constants(voxel, false, false), (voxel, Layout::Rows), None);
    let packed = |context: &Context, axes| {
        let store = store(context, words_of);
        packed_by(context, (Some(&packer), false, false), store, axes, voxel, 30.0, |_| true)
    };
    for axes in ORDERS {
        let whole = read_volume(&context, &packed(&context, axes));
        let stores = [store(&context, words_of)];
        let visits = |context: &Context| {
            let packing =
                Packing::new(context, boxes(&stores), (DIMS, false), None, (axes, true), (voxel, marking(voxel)))
                    .unwrap();
            packing.bands(context, &stores, &None).unwrap().visits()
        };
        let count = u64::from(stores[0].count);
        assert_eq!(visits(&context), (1, count));
        let unlimited = context.limits.max_storage_buffer_binding_size;
        for binding in [1 << 17, 1 << 16, 1 << 14] {
            context.limits.max_storage_buffer_binding_size = binding;
            let (bands, visited) = visits(&context);
            assert!(bands > 1 && visited <= bands as u64 * count, "{axes:?}: {visited} of {count} in {bands} bands");
            let before = context.traffic();
            let banded = packed(&context, axes);
            let after = context.traffic();
            assert_eq!((after.submissions - before.submissions, after.waits - before.waits), (1, 0));
            assert!(read_volume(&context, &banded) == whole, "{axes:?} in {bands} bands");
            assert_marks(&context, &banded);
        }
        context.limits.max_storage_buffer_binding_size = unlimited;
    }
}

/// The stage on the host gives the same texels as the one on the device: to the last bit, but where colours are lit.
#[test]
fn packing_on_the_host_matches_the_device() {
    let [context, gpu] = contexts();
    for (axes, voxel, number) in ORDERS.into_iter().flat_map(|axes| {
        let lit = [1, 4].map(|lights| Voxel::Color { lights, shadows: false });
        let plain = Voxel::Color { lights: 0, shadows: false };
        let all = [plain, Voxel::Scalar, Voxel::Gradient, lit[0], lit[1], lit[1]];
        all.into_iter().enumerate().map(move |(number, voxel)| (axes, voxel, number))
    }) {
        let made = |p: [u32; 3]| match voxel {
            Voxel::Color { .. } => {
                let [density_blue, color, _] = words_of(p);
                [density_blue, color, p[0].wrapping_mul(0x9e37_79b9) ^ p[1] << 9 ^ p[2] << 21]
            }
            _ => {
                let [low, high] = packed_gradient(gradient_of(p));
                [scalar_of(p).to_bits(), low, high]
            }
        };
        let perspective = number == 5;
        // A part of the bricks: splats of others are left out.
        let seen = |[low, _]: [[u32; 3]; 2]| number % 2 == 0 || low[0] >= 32;
        let points = number == 4;
        let run = |context: &Context, on_device: bool| {
            let stored = match voxel {
                Voxel::Scalar => store(context, |p| [made(p)[0]]),
                _ => store(context, made),
            };
            let layout = Layout::of(context, DIMS);
            let packer =
                on_device.then(|| Packer::new(context, &constants(voxel, perspective, points), (voxel, layout), None));
            let packed = packed_by(context, (packer.as_ref(), perspective, points), stored, axes, voxel, 30.0, seen);
            assert_marks(context, &packed);
            let read = read_volume(context, &packed);
            let mut voxels: Vec<_> =
                places(packed.packing).map(|(at, point)| (point, voxel_words(&packed, &read, at))).collect();
            voxels.sort_by_key(|(point, _)| *point);
            (read, voxels)
        };
        let (_, stored) = run(&gpu, true);
        if !context.is_software() {
            // The host packs for software only.
            continue;
        }
        let (device, voxels) = run(&context, true);
        assert_eq!(voxels, stored, "{axes:?} {voxel:?}");
        let (host, _) = run(&context, false);
        if !matches!(voxel, Voxel::Color { lights: 1.., .. }) {
            assert_eq!(host, device, "{axes:?} {voxel:?}");
            continue;
        }
        let voxels = |texels: &[[u32; 4]]| -> Vec<[f64; 4]> {
            texels.iter().flat_map(|t| [halves([t[0], t[1]]), halves([t[2], t[3]])]).collect()
        };
        for (host, device) in voxels(&host).into_iter().zip(voxels(&device)) {
            // A step of 11 bits, for what shaders round otherwise; of the density, because the colour is up to that.
            let step = device[3] / 1024.0;
            assert!(host.iter().zip(device).all(|(h, d)| (h - d).abs() <= step), "{voxel:?}: {host:?} {device:?}");
            assert_eq!(host[3], device[3]);
        }
    }
}

/// Textures of most GPUs have 16384 texels a side at most.
#[test]
fn a_scan_of_512_fits_into_the_textures_of_most_gpus() {
    for mut context in contexts() {
        context.limits.max_texture_dimension_2d = 16_384;
        for voxel in [Voxel::Color { lights: 0, shadows: false }, Voxel::Scalar, Voxel::Gradient] {
            let packing = |context: &Context, dims| {
                Packing::new(context, boxes(&[]), (dims, true), None, ([0, 1, 2], true), (voxel, marking(voxel)))
            };
            let fits = |dims| packing(&context, dims).is_some();
            assert!(fits([512; 3]) && fits([1024, 512, 200]), "{voxel:?}");
            assert!(!fits([70_000, 2, 2]), "{voxel:?}");
            let binding = std::mem::replace(&mut context.limits.max_storage_buffer_binding_size, 1 << 20);
            assert!(packing(&context, [512; 3]).is_none(), "{voxel:?}: 2 MiB of marks");
            context.limits.max_storage_buffer_binding_size = binding;
        }
    }
}

/// The words of a packed voxel at (a, b, plane) of the box: two, or one of a scalar.
fn voxel_words(packed: &Packed, texels: &[[u32; 4]], [a, b, m]: [u32; 3]) -> [u32; 2] {
    let Packing { columns, row_texels, dims, voxel, layout, .. } = packed.packing;
    if layout == Layout::Box {
        let [x, y, _] = dims.map(|n| n + 1);
        let texel = texels[(a + x * (b + y * m)) as usize];
        return if voxel == Voxel::Scalar { [texel[0], 0] } else { [texel[0], texel[1]] };
    }
    let x = m % columns * (row_texels + MARGIN) + MARGIN + a / 2;
    let y = m / columns * (dims[1] + 1) + 1 + b;
    let texel = texels[(y * packed.packing.size[0] + x) as usize];
    match (voxel, a % 2) {
        (Voxel::Scalar, half) => [texel[half as usize], 0],
        (_, 0) => [texel[0], texel[1]],
        _ => [texel[2], texel[3]],
    }
}

fn halves(words: [u32; 2]) -> [f64; 4] {
    let half = |bits: u32| f16::from_bits(bits as u16).to_f64();
    [half(words[0]), half(words[0] >> 16), half(words[1]), half(words[1] >> 16)]
}

/// Every (a, b, plane) of the box with its lattice point.
fn places(packing: Packing) -> impl Iterator<Item = ([u32; 3], [u32; 3])> {
    let Packing { axes, low, dims, .. } = packing;
    let [na, nb, nm] = dims;
    let all = (0..nm).flat_map(move |m| (0..nb).flat_map(move |b| (0..na).map(move |a| [a, b, m])));
    all.map(move |place| {
        let mut point = [0; 3];
        (0..3).for_each(|i| point[axes[i]] = low[i] + place[i]);
        (place, point)
    })
}

const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [1, 0, 2], [0, 2, 1], [2, 0, 1], [1, 2, 0], [2, 1, 0]];

/// A splat whose words tell points apart.
fn words_of(point: [u32; 3]) -> [u32; 3] {
    let [x, y, z] = point;
    let density = 0.01 + 0.03 * f64::from(x) + 0.001 * f64::from(y * z);
    let color = ((x * 91) & 0x1fff) | (((y * 211) & 0x3fff) << 13) | ((z & 31) << 27);
    [(density as f32).to_bits() & 0xffff_ff00 | ((x + y) & 0xff), color, 0]
}

#[test]
fn voxels_are_packed_where_rays_look_for_them() {
    for (context, axes) in contexts().iter().flat_map(|context| ORDERS.map(|axes| (context, axes))) {
        let packed = packed(context, store(context, words_of), axes, Voxel::Color { lights: 0, shadows: false }, 3.0);
        let volume = read_volume(context, &packed);
        let shown = points();
        let mut found = 0;
        for (place, point) in places(packed.packing) {
            let got = halves(voxel_words(&packed, &volume, place));
            let expected = if shown.contains(&point) {
                found += 1;
                let [density_blue, color, normal] = words_of(point);
                let splat = Splat { place: layout::place([0; 3], 0), density_blue, color, normal };
                let splat = twins::unpack(&splat, &[[0; 3]]);
                let density = splat.density * packed.scale;
                [0, 1, 2].map(|c| splat.color[c] * density).into_iter().chain([density]).collect::<Vec<_>>()
            } else {
                vec![0.0; 4]
            };
            for (got, expected) in got.into_iter().zip(expected) {
                // 11 bits, and the rounding of f32 before them.
                assert!(
                    (got - expected).abs() <= expected * (0.5 / 1024.0 + 1e-6),
                    "{axes:?} {point:?} {got} {expected}"
                );
            }
        }
        assert_eq!(found, shown.len());
        // Around the rows there is nothing.
        let words = |p: [u32; 3]| voxel_words(&packed, &volume, p);
        let inside: usize = places(packed.packing).filter(|&(place, _)| words(place) != [0, 0]).count();
        let all = all_words(&packed, &volume);
        assert_eq!(all.filter(|&voxel| voxel != [0, 0]).count(), inside, "{axes:?}");
        assert_marks(context, &packed);
    }
}

/// Colours mark their cells, scalars the cells around them; macrocells begin before the lattice.
fn marking(voxel: Voxel) -> Marking {
    let own = Marking { offset: [1, 2, 3], ..Marking::OWN };
    if matches!(voxel, Voxel::Color { .. }) { own } else { Marking { reach: 2, invisible: [-4.0, 2.5], ..own } }
}

/// Asserts that the marked cells are those with splats, of scalars those near visible ones.
fn assert_marks(context: &Context, packed: &Packed) {
    let Packing { voxel, axes, low, .. } = packed.packing;
    let Marking { reach, invisible: [least, largest], offset } = marking(voxel);
    let [na, nb, nm] = packed.packing.macrocells();
    let bytes = u64::from(na * nb * nm).next_multiple_of(4);
    let mut recorder = Recorder::untimed(context);
    let read = recorder.read_back("test", &packed.marks, bytes).unwrap();
    recorder.submit();
    let marks: Vec<u8> = read.values(context, "test").unwrap();
    let is_marking = |p: [u32; 3]| {
        let is_color = matches!(voxel, Voxel::Color { .. });
        is_color || !(least..=largest).contains(&scalar_of(p))
    };
    let packed_points = places(packed.packing).map(|(_, point)| point).collect::<BTreeSet<_>>();
    let marking: Vec<[u32; 3]> = packed_points.intersection(&points()).copied().filter(|&p| is_marking(p)).collect();
    let shift = packed.packing.mark_shift();
    // Cells are numbered in the whole lattice.
    (0..3).for_each(|i| assert_eq!((shift[i] + 64 * MACROCELL - low[i] - offset[axes[i]]) % MACROCELL, 0));
    let mut count = 0;
    for (number, &of_macrocell) in (0..na * nb * nm).zip(&marks) {
        let macrocell = [number % na, number / na % nb, number / na / nb];
        for cell in 0..8_u32 {
            // Along each axis the cell has two voxels, and splats mark it from `reach` voxels beyond.
            let near = |p: &[u32; 3]| {
                (0..3).all(|i| {
                    let place = p[axes[i]] - low[i] + shift[i] + reach;
                    let first = MACROCELL * macrocell[i] + CELL * (cell >> i & 1);
                    (first..first + CELL + 2 * reach).contains(&place)
                })
            };
            let expected = marking.iter().any(near);
            assert_eq!(of_macrocell >> cell & 1 == 1, expected, "{voxel:?} {axes:?} {macrocell:?} {cell}");
            count += u32::from(expected);
        }
    }
    assert!(count > 0 && count < 6 * na * nb * nm, "{count} of {} marked", 8 * na * nb * nm);
}

fn scalar_of([x, y, z]: [u32; 3]) -> f32 {
    0.25 * x as f32 - 0.5 * y as f32 + 0.125 * (z * z) as f32
}

/// From large to small, with either sign, and 0 in some places.
fn gradient_of([x, y, z]: [u32; 3]) -> [f32; 3] {
    let size = (0.5 * f64::from((x + y + z) % 20) - 8.0).exp2() as f32;
    [(x % 5) as f32 - 2.0, 1.0 - (y % 3) as f32, 0.37 * (z % 4) as f32 - 0.37].map(|c| c * size)
}

#[test]
fn scalars_keep_their_bits_and_gradients_half_of_them() {
    let shown = points();
    for (context, axes) in contexts().iter().flat_map(|context| ORDERS.map(|axes| (context, axes))) {
        let stored = store(context, |p| [scalar_of(p).to_bits()]);
        let scalars = packed(context, stored, axes, Voxel::Scalar, 30.0);
        let volume = read_volume(context, &scalars);
        for (place, point) in places(scalars.packing) {
            let [got, _] = voxel_words(&scalars, &volume, place);
            let expected = if shown.contains(&point) { scalar_of(point).to_bits() } else { 0 };
            assert_eq!(got, expected, "{axes:?} {point:?}");
        }
        let stored = store(context, |p| {
            let [low, high] = packed_gradient(gradient_of(p));
            [scalar_of(p).to_bits(), low, high]
        });
        let vectors = packed(context, stored, axes, Voxel::Gradient, 30.0);
        let volume = read_volume(context, &vectors);
        for (place, point) in places(vectors.packing) {
            let [x, y, z] = gradient_of(point);
            let mut expected = [x, y, z, scalar_of(point)].map(f64::from);
            if !shown.contains(&point) {
                expected = [0.0; 4];
            }
            let largest = expected[..3].iter().fold(0.0_f64, |largest, c| largest.max(c.abs())) * vectors.scale;
            let got = halves(voxel_words(&vectors, &volume, place));
            for (got, expected) in got.into_iter().zip(expected.map(|v| v * vectors.scale)) {
                // 11 bits, and 18 of the largest component of a gradient.
                let allowed = expected.abs() * (0.5 / 1024.0 + 1e-6) + largest * 8e-6;
                assert!((got - expected).abs() <= allowed, "{axes:?} {point:?}: {got} for {expected}");
            }
        }
    }
}

// ---------------------------------------------------------------------------------------------------------------------
// skip

/// Per tile, phase after phase: its runs.
fn runs(context: &Context, packed: &Packed, uniforms: &layout::Rays, perspective: bool) -> Vec<Vec<[u32; 2]>> {
    let skip = skip(context, &[("PERSPECTIVE", perspective.into())]);
    let rays = context.upload("test.rays", bytemuck::bytes_of(uniforms), wgpu::BufferUsages::UNIFORM).unwrap();
    let mut recorder = Recorder::untimed(context);
    let runs = find_runs(&mut recorder, &skip, packed, uniforms, &rays, &[]).unwrap();
    let runs = recorder.read_back("test.runs", &runs, runs.size()).unwrap();
    recorder.submit();
    let runs: Vec<[u32; 2]> = runs.values(context, "test").unwrap();
    let tiles = uniforms.tiles[0] * uniforms.tiles[1] * uniforms.phases[0] * uniforms.phases[1];
    let of = |tile: u32| {
        let slots = (0..uniforms.run_slots).map(|slot| runs[(tile * uniforms.run_slots + slot) as usize]);
        slots.take_while(|run| run[1] > 0).collect::<Vec<_>>()
    };
    (0..tiles).map(of).collect()
}

/// Where a ray meets a plane, both from the first of the packed volume; nothing if it is not marched along this axis.
fn line(uniforms: &layout::Rays, perspective: bool, [x, y]: [u32; 2]) -> Option<impl Fn(f64) -> DVec2> {
    let v2 = |v: [f32; 2]| DVec2::from_array(v.map(f64::from));
    let v3 = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
    let (x, y) = (f64::from(x), f64::from(y));
    let mut base = v2(uniforms.origin) + v2(uniforms.step_x) * x + v2(uniforms.step_y) * y;
    let mut shear = v2(uniforms.shear);
    if perspective {
        let heading = v3(uniforms.heading) + v3(uniforms.heading_x) * x + v3(uniforms.heading_y) * y;
        if heading.z < heading.x.abs().max(heading.y.abs()) - 0.05 * heading.length() {
            return None;
        }
        shear = heading.truncate() / heading.z;
        base = v2(uniforms.middle) + base / heading.z;
    }
    let first = DVec3::from_array(uniforms.first.map(f64::from));
    Some(move |plane: f64| base + shear * (plane + first.z) - first.truncate())
}

/// Runs that invocations find, and runs that workgroups find.
#[test]
fn rays_meet_no_voxel_between_runs() {
    contexts().iter().for_each(assert_runs_hold_voxels);
}

fn assert_runs_hold_voxels(context: &Context) {
    let grid = Grid::axis_parallel(DIMS, [1.0; 3]).unwrap();
    let kernel = Kernel::default();
    let footprint = Footprint::new(&kernel).unwrap();
    let settings = Settings { antialiasing: false, ..Settings::default() };
    let shown = points();
    let size = [90, 70];
    let region = Region { x: 0, y: 0, width: size[0], height: size[1] };
    let (mut planes_in_runs, mut planes_of_tiles, mut shared) = (0, 0, false);
    for (projection, azimuth, elevation) in [
        (ProjectionKind::Orthographic, 20.0, 10.0),
        (ProjectionKind::Orthographic, 160.0, -30.0),
        (ProjectionKind::Orthographic, 0.0, 0.0),
        (ProjectionKind::Perspective { fov: 40.0 }, 40.0, 15.0),
        (ProjectionKind::Perspective { fov: 70.0 }, 100.0, 60.0),
    ] {
        let view = View { projection, azimuth, elevation, ..View::default() };
        let camera = Camera::new(&view, &grid, size).unwrap();
        let perspective = projection != ProjectionKind::Orthographic;
        let view = ViewGeometry::new(&camera, &grid, &settings, Savings::default());
        for axis in &PrincipalAxis::all(&view.camera, &view.grid) {
            let voxel = Voxel::Color { lights: 0, shadows: false };
            let packed = packed(context, store(context, words_of), axis.axes, voxel, 3.0);
            let job = Job {
                context,
                pipelines: &Cache::default(),
                kept: &Cache::default(),
                view: &view,
                settings: &settings,
                stores: &[],
                scalars: None,
                weights: Weights { max: 0.1, unit: 1.0, brightest: [1.0; 3] },
                post: None,
                magnification: None,
                padding: 0,
                depths: Depths::default(),
                most_fragments: f64::INFINITY,
            };
            let marking = (voxel, marking(voxel));
            let packing = Packing::new(
                context,
                boxes(&[store(context, words_of)]),
                (DIMS, false),
                None,
                (axis.axes, true),
                marking,
            );
            let (packing, footprint) = (packing.unwrap(), &footprint);
            let setup = RaySetup { job: &job, axis, packing, kernel, footprint };
            let images = setup.image_rays(region);
            let pixels = (setup.pixel_share() > 0.0).then(|| setup.pixel_rays(region));
            for Rays { uniforms, spacing } in images.into_iter().chain(pixels) {
                shared |= matches!(spacing, RaySpacing::PerVoxel(_));
                let voxels: Vec<[u32; 3]> =
                    places(packing).filter(|(_, p)| shown.contains(p)).map(|(at, _)| at).collect();
                let last = packing.dims[2] - 1;
                let runs = runs(context, &packed, &uniforms, perspective);
                let [across, down] = uniforms.tiles;
                for (number, runs) in (0..).zip(&runs) {
                    planes_of_tiles += u64::from(last + 1);
                    planes_in_runs += runs.iter().map(|[first, end]| u64::from(end - first)).sum::<u64>();
                    let [tile_x, tile_y, phase] = [number % across, number / across % down, number / across / down];
                    let [px, py] = uniforms.phases;
                    for ray in 0..TILE * TILE {
                        let x = (tile_x * TILE + ray % TILE) * px + phase % px;
                        let y = (tile_y * TILE + ray / TILE) * py + phase / px;
                        let Some(line) = line(&uniforms, perspective, [x, y]) else { continue };
                        for &[a, b, m] in &voxels {
                            let plane = if axis.flipped { last - m } else { m };
                            let at = line(f64::from(plane));
                            let next = line(f64::from(plane) + 1.0) - at;
                            // The squared distance of the voxel from the ray, less than the kernel's.
                            let d = DVec3::new(f64::from(a) - at.x, f64::from(b) - at.y, 0.0);
                            let distance2 = d.cross(next.extend(1.0).normalize()).length_squared();
                            if distance2 > kernel.radius().powi(2) - 1e-3 {
                                continue;
                            }
                            let from_first = plane + uniforms.lead as u32;
                            let inside = runs.iter().any(|&[first, end]| (first..end).contains(&from_first));
                            assert!(inside, "{projection:?} ray {x}, {y} misses {a}, {b} of plane {plane}: {runs:?}");
                        }
                    }
                }
            }
        }
    }
    // The stage does skip: here three quarters of the planes.
    assert!(shared && 2 * planes_in_runs < planes_of_tiles, "{planes_in_runs} of {planes_of_tiles}");
}
