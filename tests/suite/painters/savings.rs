//! Counts of skipped work. `src/gpu/savings_test.rs` compares pictures with and without it.

use voxsplat::camera::View;
use voxsplat::kernel::Kernel;
use voxsplat::lighting::{Light, Lighting};
use voxsplat::renderer::{Renderer, Scene};
use voxsplat::settings::{Model, Settings, Shading};
use voxsplat::stats::Stats;
use voxsplat::transfer::{ControlPoint, TransferFunction};
use voxsplat::volume::{Grid, Samples, Volume};

use crate::support::{
    draw_on, exact_quads, headlight, look, new_renderer, picture, prepare_on, thick, transfer, with_quads,
};

/// Two balls that fade outwards, one in the middle, over a background that falls away from them: dropped values are
/// not 0.
fn balls() -> (Volume, TransferFunction) {
    let dims = [110, 26, 26];
    let value = |[x, y, z]: [u32; 3]| {
        let ball = |cx: f64| {
            let d = [f64::from(x) - cx, f64::from(y) - 13.0, f64::from(z) - 12.0];
            40.0 - 4.0 * d.iter().map(|c| c * c).sum::<f64>().sqrt()
        };
        ball(50.0).max(ball(103.0)) as f32 + ((x * 7 + y * 13 + z * 29) % 5) as f32
    };
    let points = (0..dims.iter().product()).map(|i| [i % dims[0], i / dims[0] % dims[1], i / (dims[0] * dims[1])]);
    let grid = Grid::axis_parallel(dims, [1.0; 3]).unwrap();
    let volume = Volume::new(grid, Samples::F32(points.map(value).collect())).unwrap();
    (volume, transfer(&[(20.0, [1.0, 0.2, 0.1], 0.0), (40.0, [0.2, 0.9, 1.0], 0.4)], None))
}

/// The lattice points whose scalars are above 20, and those within `reach` of one.
fn counted(volume: &Volume, reach: f64) -> [u64; 2] {
    let [nx, ny, nz] = volume.grid().dims().map(|d| d as i64);
    let values = volume.in_memory().unwrap();
    let at = |[x, y, z]: [i64; 3]| values.value((x + nx * (y + ny * z)) as usize);
    let far = reach.floor() as i64;
    let near: Vec<[i64; 3]> = (-far..=far)
        .flat_map(|z| (-far..=far).flat_map(move |y| (-far..=far).map(move |x| [x, y, z])))
        .filter(|d| d.iter().map(|c| c * c).sum::<i64>() as f64 <= reach * reach)
        .collect();
    let inside = |p: &[i64; 3]| p.iter().zip([nx, ny, nz]).all(|(&c, n)| (0..n).contains(&c));
    let points = (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])));
    points.fold([0, 0], |[shown, reached], p| {
        let around = near.iter().map(|d| [p[0] + d[0], p[1] + d[1], p[2] + d[2]]).filter(inside);
        [shown + u64::from(at(p) > 20.0), reached + u64::from(around.into_iter().any(|q| at(q) > 20.0))]
    })
}

#[test]
fn post_shading_keeps_exactly_the_scalars_that_can_take_part() {
    let (volume, transfer) = balls();
    // Two voxels meet in a pixel if each is within a kernel radius of its three sheets.
    for (sheet_thickness, reach) in [(1.0, 2.0 * 2.0 + 3.0), (0.25, 2.0 * 2.0 + 0.75)] {
        let settings = Settings { shading: Shading::Post, antialiasing: false, ..exact_quads() };
        let settings = thick(&settings, sheet_thickness);
        let camera = look(&View::default(), &volume, [48; 2]);
        let stats = picture(&volume, &transfer, &camera, &settings).stats;
        let [shown, expected] = counted(&volume, reach);
        // A scalar of 20, the base, weighs nothing and is no splat.
        let zeros = volume.in_memory().unwrap();
        let zeros = (0..volume.grid().len() as usize).filter(|&i| zeros.value(i) == 20.0).count() as u64;
        assert!(stats.splats_kept <= expected && stats.splats_kept + zeros >= expected, "{}", stats.splats_kept);
        assert!(shown * 2 < expected && expected * 3 < 2 * volume.grid().len(), "{shown} {expected}");
    }
}

fn turn(renderer: &Renderer, scene: &Scene, volume: &Volume, settings: &Settings, azimuth: f64) -> Stats {
    let view = View { azimuth, elevation: 20.0, ..View::default() };
    draw_on(renderer, scene, &look(&view, volume, [128; 2]), settings).unwrap().stats
}

#[test]
fn only_what_a_scene_needs_is_made_and_sent() {
    let (volume, transfer) = balls();
    let pre = exact_quads();
    let post = Settings { shading: Shading::Post, ..pre.clone() };
    // Pipelines: three of classification, with light a fourth of normals, two of the scan, three of the sort; one of
    // splats and one that wipes sheets, one that composites or shades, one that resolves, and two of termination.
    let scenes = [
        (pre.clone(), 12),
        (Settings { termination: 0.01, ..pre.clone() }, 14),
        (Settings { model: Model::Xray, ..pre.clone() }, 12),
        (Settings { lighting: headlight(), ..pre.clone() }, 13),
        (post.clone(), 8),
        (Settings { model: Model::Mip, ..pre.clone() }, 8),
        (Settings { model: Model::Average, ..pre.clone() }, 8),
    ];
    for (settings, pipelines) in scenes {
        let renderer = new_renderer();
        let scene = prepare_on(&renderer, &volume, &transfer, &settings).unwrap();
        let first = turn(&renderer, &scene, &volume, &settings, 0.0);
        assert_eq!(first.pipelines, pipelines, "{settings:?}");
        let quads = *first.quads().unwrap();
        let splats = first.splats_kept + first.splats_padding;
        let bytes = if settings.is_post_shaded() { 8 } else { 16 };
        let bricks = u64::from(first.bricks_uploaded);
        // Voxels that are classified have samples, 8 bytes for each row of a brick, and normals if there is light.
        let normals = if settings.lighting.is_some() { 4 * splats } else { 0 };
        let voxels = if settings.is_post_shaded() { 0 } else { first.bytes_uploaded + 8 * 1024 * bricks + normals };
        // Also the places of bricks, and their numbers in the volume.
        let places = first.scene_bytes - bytes * splats - voxels;
        let most = 16 * bricks + 8 * u64::from(first.bricks) + 16;
        assert!((16..=most).contains(&places), "{settings:?}: {places}");
        assert!(quads.passes <= u64::from(quads.batches));
        if settings.model == Model::Xray {
            assert_eq!((quads.sheets, quads.passes, quads.quads), (1, 1, splats));
        }
        // A turned camera sends as much as a picture without splats, and the list of the bricks' places in the sort.
        for azimuth in [40.0, 200.0] {
            let next = turn(&renderer, &scene, &volume, &settings, azimuth);
            assert_eq!((next.pipelines, next.scene_bytes), (pipelines, first.scene_bytes));
            assert!(next.bytes_sent < 40_000, "{} bytes", next.bytes_sent);
        }
    }
}

#[test]
fn a_change_redoes_only_the_stages_that_depend_on_it() {
    let (volume, transfer) = balls();
    let renderer = new_renderer();
    let post = Settings { shading: Shading::Post, lighting: headlight(), ..exact_quads() };
    let post = with_quads(&post, |q| q.table_error = Some(1e-2));
    let pre = Settings { shading: Shading::Pre, ..post.clone() };
    for settings in [pre, post] {
        let scene = prepare_on(&renderer, &volume, &transfer, &settings).unwrap();
        let first = turn(&renderer, &scene, &volume, &settings, 10.0);
        // Another light sends parameters.
        let lighting = Lighting { lights: vec![Light::directional(glam::DVec3::X)], ..Lighting::default() };
        let light = Settings { lighting: Some(lighting), ..settings.clone() };
        let stats = turn(&renderer, &scene, &volume, &light, 10.0);
        assert_eq!(stats.pipelines, first.pipelines);
        assert!(stats.bytes_sent < 40_000, "light: {} bytes", stats.bytes_sent);
        // A narrower kernel with the same truncation sends another table.
        let kernel = Kernel::Gaussian { sigma: 0.8, radius: 2.0 };
        let stats = turn(&renderer, &scene, &volume, &Settings { kernel, ..settings.clone() }, 10.0);
        assert_eq!(stats.pipelines, first.pipelines);
        // Scalars are divided by the kernel's sum before they are sent.
        let scalars = if settings.is_post_shaded() { stats.scene_bytes } else { 0 };
        let sent = scalars..scalars + 40_000;
        assert!(sent.contains(&stats.bytes_sent), "kernel: {} bytes, scalars {scalars}", stats.bytes_sent);
        // Another transfer function makes no pipelines.
        let points = transfer.points().iter().map(|p| ControlPoint { value: p.value + 10.0, ..*p }).collect();
        let other = TransferFunction::new(points, None).unwrap();
        let scene = prepare_on(&renderer, &volume, &other, &settings).unwrap();
        let stats = turn(&renderer, &scene, &volume, &settings, 10.0);
        assert!(stats.splats_kept < first.splats_kept && stats.bricks_uploaded <= first.bricks_uploaded);
    }
}
