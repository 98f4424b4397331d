//! pack and skip on the device, against plain twins.

use std::collections::BTreeSet;
use std::sync::Arc;

use glam::{DVec2, DVec3};
use half::f16;

use super::axis::PrincipalAxis;
use super::march::{find_runs, skip};
use super::pack::{Marking, Packable, Packed, Packer, Packing, Voxel};
use super::parts::Footprint;
use super::rays::RaySetup;
use crate::camera::{Camera, ProjectionKind, View};
use crate::gpu::adapter_test::adapter;
use crate::gpu::cache::Cache;
use crate::gpu::context::Context;
use crate::gpu::held_samples::HeldSamples;
use crate::gpu::layout::{self, CELL, Lighting, MACROCELL, Splat, TILE};
use crate::gpu::pipeline::{Binding, bind, compute, layout as group_layout, texture_view};
use crate::gpu::recorder::Recorder;
use crate::gpu::sampled_scalars::SampledScalars;
use crate::gpu::samples::Input;
use crate::gpu::savings::Savings;
use crate::gpu::splat::{SplatLight, ToEye};
use crate::gpu::stage::Constant;
use crate::gpu::twins_test as twins;
use crate::gpu::view::{ViewGeometry, Weights};
use crate::gpu::voxels::Voxels;
use crate::image::Region;
use crate::kernel::{Kernel, Slopes};
use crate::lighting::Normals;
use crate::painters::painter::{Depths, Job};
use crate::progress::Progress;
use crate::settings::Settings;
use crate::splats::brick::MadeBrick;
use crate::transfer::scalars::Reduction;
use crate::transfer::{ControlPoint, TransferFunction};
use crate::volume::{Grid, Volume};

fn context() -> Context {
    Context::new(Some(&adapter())).unwrap()
}

/// Reads the words of the voxels of a packed box, x fastest, and of the layers of zeros behind them.
fn read_volume(context: &Context, packed: &Packed) -> Vec<[u32; 2]> {
    let source = "@group(0) @binding(0) var texels: texture_3d<u32>;
        @group(0) @binding(1) var<storage, read_write> words: array<vec2u>;
        @compute @workgroup_size(1)
        fn copy(@builtin(global_invocation_id) p: vec3u, @builtin(num_workgroups) size: vec3u) {
            words[(p.z * size.y + p.y) * size.x + p.x] = textureLoad(texels, p, 0).xy;
        }";
    let module = context.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("test.read"),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let slots = [Binding::IntegerTexture(wgpu::TextureViewDimension::D3), Binding::Write];
    let layout = group_layout(context, "test", wgpu::ShaderStages::COMPUTE, &slots);
    let pipeline = compute(context, &module, "test", "copy", &layout, &[]);
    let size = packed.volume.texture().size();
    let [width, height, depth] = [size.width, size.height, size.depth_or_array_layers];
    let bytes = u64::from(width * height * depth) * 8;
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
    let words = context.buffer("test.words", bytes, usage).unwrap();
    let group = bind(context, "test", &layout, &[texture_view(&packed.volume), words.as_entire_binding()]);
    let mut recorder = Recorder::untimed(context);
    recorder.dispatch("test", &pipeline, &group, &[], [width, height, depth]);
    let read = recorder.read_back("test", &words, bytes).unwrap();
    recorder.submit();
    let words = read.values(context, "test").unwrap();
    context.guarded("test", || Ok(())).unwrap();
    words
}

// ---------------------------------------------------------------------------------------------------------------------
// pack

const DIMS: [u32; 3] = [45, 38, 20];

/// Colours without light.
const PLAIN: Voxel = Voxel::Color { lights: 0, shadows: false };

/// Returns the lattice points of some splats: a ball, a few voxels by themselves, and no points between.
fn points() -> BTreeSet<[u32; 3]> {
    let all = (0..DIMS[2]).flat_map(|z| (0..DIMS[1]).flat_map(move |y| (0..DIMS[0]).map(move |x| [x, y, z])));
    let ball = |[x, y, z]: [u32; 3]| x.abs_diff(14).pow(2) + y.abs_diff(20).pow(2) + z.abs_diff(6).pow(2) < 30;
    all.filter(|&p| ball(p) || [[43, 3, 18], [32, 31, 3], [33, 31, 3], [31, 32, 19]].contains(&p)).collect()
}

/// Returns the points as voxels on the device; `words` returns the words of a voxel. Lit ones have normals.
fn voxels(context: &Context, lit: bool, words: impl Fn([u32; 3]) -> [u32; 3]) -> Packable {
    // In the order of the lattice, x fastest.
    let mut all: Vec<[u32; 3]> = points().into_iter().collect();
    all.sort_by_key(|&[x, y, z]| [z, y, x]);
    let brick = |(bx, by)| {
        let inside = |p: &[u32; 3]| p[0] / 32 * 32 == bx && p[1] / 32 * 32 == by;
        let rows = (0..32_u32).flat_map(|z| (0..32_u32).map(move |y| (y, z)));
        let bits = rows.map(|(y, z)| {
            let row = all.iter().filter(|p| inside(p) && p[1] == by + y && p[2] == z);
            row.fold(0_u32, |bits, p| bits | 1_u32 << (p[0] - bx))
        });
        let words = all.iter().copied().filter(inside).flat_map(&words).collect();
        MadeBrick::new([bx, by, 0], &bits.collect::<Vec<u32>>(), 3, words)
    };
    let bricks: Vec<MadeBrick> = [(0, 0), (32, 0), (0, 32), (32, 32)].map(brick).into();
    let lit = lit.then(Normals::default);
    Packable::Voxels(Voxels::send(context, DIMS, &bricks, lit).unwrap())
}

/// Returns the scalars of the points as samples on the device, 0 elsewhere; with gradients for lit pictures.
fn scalars(context: &Context, gradients: bool) -> Packable {
    let all = (0..DIMS.into_iter().product()).map(|i| [i % DIMS[0], i / DIMS[0] % DIMS[1], i / (DIMS[0] * DIMS[1])]);
    let volume = Volume::from_slice(DIMS, [1.0; 3], &all.map(shown_scalars()).collect::<Vec<f32>>()).unwrap();
    let point = |value, opacity| ControlPoint { value, color: [1.0; 3], opacity };
    let transfer = TransferFunction::new(vec![point(0.0, 0.0), point(1.0, 0.5)], None).unwrap();
    let reduction = Reduction::new(&transfer, 1.0);
    assert_eq!([reduction.base(), reduction.factor()], [0.0, 1.0]);
    let progress = Progress::default();
    let input = Input::of_scalars(context, &volume, (&transfer, reduction), gradients, &progress);
    let (part, held) = ((0, [[0; 3], DIMS]), HeldSamples::default());
    let of = (&input, &Cache::default());
    let (made, _) = SampledScalars::new(of, &reduction, &held, part, (None, gradients)).unwrap();
    Packable::Scalars(Arc::new(made), 0)
}

/// Returns the override constants of the packing of voxels under a light.
fn constants(voxel: Voxel, light: &SplatLight) -> Vec<Constant> {
    let (lights, shadows) = match voxel {
        Voxel::Color { lights, shadows } => (lights, shadows),
        _ => (0, false),
    };
    vec![
        ("LIGHTS", lights),
        ("POINT_LIGHTS", light.points.into()),
        ("SHADOWS", shadows.into()),
        ("SCALARS", (!matches!(voxel, Voxel::Color { .. })).into()),
        ("GRADIENTS", (voxel == Voxel::Gradient).into()),
        ("PERSPECTIVE", light.to_eye.perspective.into()),
    ]
}

/// Returns this number of lights; with `points`, the last one is at a place.
fn light(lights: u32, perspective: bool, points: bool) -> SplatLight {
    let lighting = Lighting {
        right: [0.9, 0.1, -0.2],
        up: [-0.1, 0.8, 0.3],
        forward: [0.2, -0.3, 0.7],
        ambient: 0.3,
        diffuse: 0.6,
        specular: 0.4,
        // The first light is at the eye.
        lights: [[0.0; 4], [0.6, 0.0, -0.8, 0.0], [-0.6, 0.64, 0.48, 0.0], [4.0, -7.0, 2.0, 1.0]],
        from_lattice: [[1.0, 0.1, -0.2, 0.0], [0.0, 0.9, 0.3, 0.0], [0.2, -0.3, 1.1, 0.0], [-9.0, -7.0, 4.0, 0.0]],
        shininess: 24.0,
        ..Lighting::default()
    };
    let view = [[1.0, 0.1, -0.2], [0.0, 0.9, 0.3], [0.2, -0.3, 1.1]];
    SplatLight { lighting, lights, points, to_eye: ToEye { perspective, eye: [20.0, 3.0, -60.0], view } }
}

/// Returns the packing of voxels for rays along these axes.
fn packing(context: &Context, source: &Packable, axes: [usize; 3], voxel: Voxel) -> Packing {
    Packing::new(context, source.boxes(), (DIMS, false), None, axes, (voxel, marking(voxel))).unwrap()
}

/// Packs voxels for rays along every axis.
fn packed(context: &Context, source: &Packable, voxel: Voxel, light: &SplatLight, max_weight: f64) -> Packed {
    let packing = packing(context, source, [0, 1, 2], voxel).stored();
    let packer = Packer::new(context, &constants(voxel, light), (voxel, packing.layout), source.key());
    let mut recorder = Recorder::untimed(context);
    let packed = packing.pack(&mut recorder, (&packer, source), light, max_weight, None).unwrap();
    recorder.submit();
    packed
}

/// Textures of three dimensions have 2048 texels a side on every GPU.
#[test]
fn a_scan_of_512_fits_into_the_textures_of_every_gpu() {
    let mut context = context();
    context.limits.max_texture_dimension_3d = 2048;
    for voxel in [PLAIN, Voxel::Scalar, Voxel::Gradient] {
        let packing = |context: &Context, dims| {
            Packing::new(context, std::iter::empty(), (dims, true), None, [0, 1, 2], (voxel, marking(voxel)))
        };
        let fits = |dims| packing(&context, dims).is_some();
        assert!(fits([512; 3]) && fits([1024, 512, 200]), "{voxel:?}");
        assert!(!fits([2048, 2, 2]), "{voxel:?}: a layer of zeros lies behind the voxels");
        let binding = std::mem::replace(&mut context.limits.max_storage_buffer_binding_size, 1 << 20);
        assert!(packing(&context, [512; 3]).is_none(), "{voxel:?}: 2 MiB of marks");
        context.limits.max_storage_buffer_binding_size = binding;
    }
}

/// Returns the words of the voxel at (a, b, plane), for a scalar the first word, at the place that rays read.
fn voxel_words(packing: Packing, voxels: &[[u32; 2]], place: [u32; 3]) -> [u32; 2] {
    let steps = packing.steps();
    let [x, y, z] = [0, 1, 2].map(|axis| (0..3).map(|i| place[i] * steps[i][axis] as u32).sum::<u32>());
    let [width, height, _] = packing.stored().dims.map(|n| n + 1);
    voxels[(x + width * (y + height * z)) as usize]
}

fn halves(words: [u32; 2]) -> [f64; 4] {
    let half = |bits: u32| f16::from_bits(bits as u16).to_f64();
    [half(words[0]), half(words[0] >> 16), half(words[1]), half(words[1] >> 16)]
}

/// Returns every (a, b, plane) of the box with its lattice point.
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

/// Returns words of a splat that tell points apart.
fn words_of(point: [u32; 3]) -> [u32; 3] {
    let [x, y, z] = point;
    let density = 0.01 + 0.03 * f64::from(x) + 0.001 * f64::from(y * z);
    let color = ((x * 91) & 0x1fff) | (((y * 211) & 0x3fff) << 13) | ((z & 31) << 27);
    [(density as f32).to_bits() & 0xffff_ff00 | ((x + y) & 0xff), color, 0]
}

#[test]
fn voxels_are_packed_where_rays_look_for_them() {
    let context = context();
    let (source, shown) = (voxels(&context, false, words_of), points());
    let packed = packed(&context, &source, PLAIN, &light(0, false, false), 3.0);
    let volume = read_volume(&context, &packed);
    for axes in ORDERS {
        let packing = packing(&context, &source, axes, PLAIN);
        assert_eq!(packing.stored(), packed.packing);
        let mut found = 0;
        for (place, point) in places(packing) {
            let got = halves(voxel_words(packing, &volume, place));
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
        assert_marks(&context, &packed, packing);
    }
    // Around the voxels there is nothing.
    assert_eq!(volume.iter().filter(|&&voxel| voxel != [0, 0]).count(), shown.len());
}

/// A colour differs from its twin's by a step of 11 bits at most, of its density: colours are up to that.
#[test]
fn colors_are_lit_as_by_the_twin() {
    let context = context();
    let words_of = |point: [u32; 3]| {
        let [density_blue, color, _] = words_of(point);
        let [x, y, z] = point;
        [density_blue, color, x.wrapping_mul(0x9e37_79b9) ^ y << 9 ^ z << 21]
    };
    let source = voxels(&context, true, words_of);
    for (lights, perspective, at_place) in [(1, false, false), (4, false, true), (4, true, false)] {
        let (voxel, light) = (Voxel::Color { lights, shadows: false }, light(lights, perspective, at_place));
        let packed = packed(&context, &source, voxel, &light, 30.0);
        let volume = read_volume(&context, &packed);
        let shown = points();
        for (place, point) in places(packed.packing).filter(|(_, point)| shown.contains(point)) {
            let got = halves(voxel_words(packed.packing, &volume, place));
            let [density_blue, color, normal] = words_of(point);
            let splat = Splat { place: layout::place([0; 3], 0), density_blue, color, normal };
            let splat = twins::unpack(&splat, &[[0; 3]]);
            let density = splat.density * packed.scale;
            let expected = twins::lit(&light, splat.color, normal, point).map(|color| color * density);
            let what = format!("{lights} lights, perspective {perspective}, {point:?}");
            assert!((got[3] - density).abs() <= density * (0.5 / 1024.0 + 1e-6), "{what}: {got:?} {density}");
            let apart = |c: usize| (got[c] - expected[c]).abs();
            assert!((0..3).all(|c| apart(c) <= density / 1024.0), "{what}: {got:?} {expected:?}");
        }
        assert_marks(&context, &packed, packed.packing);
    }
}

/// Returns a rule of marking: colours mark their cells, scalars the cells around them; macrocells begin before the
/// lattice.
fn marking(voxel: Voxel) -> Marking {
    let own = Marking { offset: [1, 2, 3], ..Marking::OWN };
    if matches!(voxel, Voxel::Color { .. }) { own } else { Marking { reach: 2, invisible: [-4.0, 2.5], ..own } }
}

/// Asserts that the marked cells, as rays along these axes find them, are the cells with splats, for scalars the cells
/// near visible ones.
fn assert_marks(context: &Context, packed: &Packed, packing: Packing) {
    let Packing { voxel, axes, low, .. } = packing;
    let Marking { reach, invisible: [least, largest], offset } = marking(voxel);
    let [na, nb, nm] = packing.macrocells();
    let bytes = u64::from(na * nb * nm).next_multiple_of(4);
    let mut recorder = Recorder::untimed(context);
    let read = recorder.read_back("test", &packed.marks, bytes).unwrap();
    recorder.submit();
    let marks: Vec<u8> = read.values(context, "test").unwrap();
    let is_marking = |p: [u32; 3]| {
        let is_color = matches!(voxel, Voxel::Color { .. });
        is_color || !(least..=largest).contains(&scalar_of(p))
    };
    let marking: Vec<[u32; 3]> = points().into_iter().filter(|&p| is_marking(p)).collect();
    let (shift, steps, bits) = (packing.mark_shift(), packing.mark_steps(), packing.mark_bits());
    // Cells are numbered in the whole lattice.
    (0..3).for_each(|i| assert_eq!((shift[i] + 64 * MACROCELL - low[i] - offset[axes[i]]) % MACROCELL, 0));
    let mut count = 0;
    for number in 0..na * nb * nm {
        let macrocell = [number % na, number / na % nb, number / na / nb];
        let of_macrocell = marks[(0..3).map(|i| macrocell[i] * steps[i]).sum::<u32>() as usize];
        for cell in 0..8_u32 {
            // Along each axis the cell has two voxels, and splats mark it from `reach` voxels beyond.
            let near = |p: &[u32; 3]| {
                (0..3).all(|i| {
                    let place = p[axes[i]] - low[i] + shift[i] + reach;
                    let first = MACROCELL * macrocell[i] + if cell & bits[i] == 0 { 0 } else { CELL };
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

/// Returns the scalars of voxels: 0 at places that are no points.
fn shown_scalars() -> impl Fn([u32; 3]) -> f32 {
    let shown = points();
    move |point| if shown.contains(&point) { scalar_of(point) } else { 0.0 }
}

/// Gradients are those of the filter of the host, of the voxels around; beyond a face of the outermost ones.
#[test]
fn scalars_keep_their_bits_and_gradients_half_of_them() {
    let (context, unlit, shown_scalar) = (context(), light(0, false, false), shown_scalars());
    for voxel in [Voxel::Scalar, Voxel::Gradient] {
        let has_gradients = voxel == Voxel::Gradient;
        let source = scalars(&context, has_gradients);
        let packed = packed(&context, &source, voxel, &unlit, 30.0);
        let volume = read_volume(&context, &packed);
        let slopes = Slopes::of_cells(1.0);
        for (place, point) in places(packed.packing) {
            let words = voxel_words(packed.packing, &volume, place);
            let scalar = shown_scalar(point);
            if !has_gradients {
                assert_eq!(words[0], scalar.to_bits(), "{point:?}");
                continue;
            }
            let beside = |axis: usize, step: u32| (point[axis] + step).clamp(1, DIMS[axis]) - 1;
            let around: Vec<f32> =
                (0..27).map(|i| shown_scalar([beside(0, i % 3), beside(1, i / 3 % 3), beside(2, i / 9)])).collect();
            let [x, y, z] = slopes.gradient(&around, 13, 3);
            for (got, expected) in halves(words).into_iter().zip([x, y, z, scalar].map(f64::from)) {
                let expected = expected * packed.scale;
                // 11 bits, and the rounding of the f32 before them.
                let allowed = expected.abs() * (0.5 / 1024.0) + 1e-4 * packed.scale;
                assert!((got - expected).abs() <= allowed, "{point:?}: {got} for {expected}");
            }
        }
        ORDERS.iter().for_each(|axes| assert_marks(&context, &packed, packing(&context, &source, *axes, voxel)));
    }
}

// ---------------------------------------------------------------------------------------------------------------------
// skip

/// Returns the runs of each tile.
fn runs(context: &Context, packed: &Packed, uniforms: &layout::Rays, perspective: bool) -> Vec<Vec<[u32; 2]>> {
    let skip = skip(context, &[("PERSPECTIVE", perspective.into())]);
    let rays = context.upload("test.rays", bytemuck::bytes_of(uniforms), wgpu::BufferUsages::UNIFORM).unwrap();
    let mut recorder = Recorder::untimed(context);
    let runs = find_runs(&mut recorder, &skip, packed, uniforms, &rays).unwrap();
    let runs = recorder.read_back("test.runs", &runs, runs.size()).unwrap();
    recorder.submit();
    let runs: Vec<[u32; 2]> = runs.values(context, "test").unwrap();
    let of_tile = |slots: &[[u32; 2]]| slots.iter().copied().take_while(|run| run[1] > 0).collect::<Vec<_>>();
    runs.chunks(uniforms.run_slots as usize).map(of_tile).collect()
}

/// Returns the map from a plane to the point where a ray meets it, both from the first of the packed volume; `None` if
/// the ray is not marched along this axis.
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

#[test]
fn rays_meet_no_voxel_between_runs() {
    let context = context();
    let grid = Grid::axis_parallel(DIMS, [1.0; 3]).unwrap();
    let kernel = Kernel::default();
    let footprint = &Footprint::new(&kernel).unwrap();
    let settings = Settings { antialiasing: false, ..Settings::default() };
    let (source, shown) = (voxels(&context, false, words_of), points());
    let packed = packed(&context, &source, PLAIN, &light(0, false, false), 3.0);
    let size = [90, 70];
    let region = Region { x: 0, y: 0, width: size[0], height: size[1] };
    let (mut planes_in_runs, mut planes_of_tiles) = (0, 0);
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
            let job = Job {
                context: &context,
                pipelines: &Cache::default(),
                kept: &Cache::default(),
                view: &view,
                settings: &settings,
                voxels: None,
                lists: &[],
                scalars: None,
                is_outgrown: false,
                weights: Weights { max: 0.1, unit: 1.0, brightest: [1.0; 3] },
                post: None,
                magnification: None,
                padding: 0,
                depths: Depths::default(),
                most_fragments: f64::INFINITY,
            };
            let packing = packing(&context, &source, axis.axes, PLAIN);
            let uniforms = RaySetup { job: &job, axis, packing, kernel, footprint }.rays(region, region);
            let voxels: Vec<[u32; 3]> = places(packing).filter(|(_, p)| shown.contains(p)).map(|(at, _)| at).collect();
            let last = packing.dims[2] - 1;
            let [across, _] = uniforms.tiles;
            for (tile, runs) in (0..).zip(runs(&context, &packed, &uniforms, perspective)) {
                planes_of_tiles += u64::from(last + 1);
                planes_in_runs += runs.iter().map(|[first, end]| u64::from(end - first)).sum::<u64>();
                for ray in 0..TILE * TILE {
                    let [x, y] = [tile % across * TILE + ray % TILE, tile / across * TILE + ray / TILE];
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
    // The stage does skip: here three quarters of the planes.
    assert!(2 * planes_in_runs < planes_of_tiles, "{planes_in_runs} of {planes_of_tiles}");
}
