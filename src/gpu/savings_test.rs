//! Tests that savings of invisible work change no picture, bit by bit.

use glam::DVec3;

use super::adapter_test::adapter;
use super::savings::Savings;
use crate::camera::{Camera, ProjectionKind, View};
use crate::frame::Frame;
use crate::lighting::{Light, Lighting};
use crate::renderer::{Rendered, Renderer, RendererOptions, Scene};
use crate::settings::{Level, Model, Painter, Precision, QuadsSettings, Settings, Shading};
use crate::transfer::{Classification, ControlPoint, TransferFunction};
use crate::volume::Volume;

/// Makes two balls that fade outwards, over a background that falls away from them: the dropped splats are not 0.
fn balls() -> (Volume, TransferFunction) {
    let dims = [110, 26, 26];
    let value = |[x, y, z]: [u32; 3]| {
        let distance = |cx: f64| {
            let d = [f64::from(x) - cx, f64::from(y) - 13.0, f64::from(z) - 12.0];
            d.iter().map(|c| c * c).sum::<f64>().sqrt()
        };
        let noise = f64::from((x * 7 + y * 13 + z * 29) % 5);
        (40.0 - 4.0 * distance(50.0).min(distance(103.0)) + noise) as f32
    };
    let points = (0..dims.iter().product()).map(|i| [i % dims[0], i / dims[0] % dims[1], i / (dims[0] * dims[1])]);
    let volume = Volume::from_slice(dims, [1.0; 3], &points.map(value).collect::<Vec<f32>>()).unwrap();
    let point = |value, opacity, color| ControlPoint { value, color, opacity };
    let points = vec![point(20.0, 0.0, [1.0, 0.2, 0.1]), point(40.0, 0.4, [0.2, 0.9, 1.0])];
    (volume, TransferFunction::new(points, None).unwrap())
}

/// Returns quads with sheets of this thickness, and tiles.
fn painters(sheet_thickness: f64) -> [Painter; 2] {
    let quads = QuadsSettings { sheet_thickness, precision: Some(Precision::F32), ..QuadsSettings::default() };
    [Painter::Quads(quads), Painter::Auto]
}

#[test]
fn device_nothing_that_is_left_out_of_two_scenes_changes_a_pixel() {
    leave_out(4, 1);
}

#[test]
#[ignore = "slow: 140 pictures by five devices"]
fn device_nothing_that_is_left_out_changes_a_pixel() {
    leave_out(1, 2);
}

/// Compares every `step`th kind of picture through the first `eyes` of two projections.
fn leave_out(step: usize, eyes: usize) {
    let (volume, transfer) = balls();
    let renderer = |savings| {
        let options = RendererOptions { adapter: Some(adapter()), ..RendererOptions::default() };
        let mut renderer = Renderer::new(&options).unwrap();
        renderer.context.savings = savings;
        renderer
    };
    let all = Savings::default();
    let whole = renderer(all);
    let without = [
        ("bricks", renderer(Savings { bricks: false, ..all })),
        ("voxels", renderer(Savings { voxels: false, ..all })),
        ("view", renderer(Savings { view: false, ..all })),
        ("pixels", renderer(Savings { pixels: false, ..all })),
    ];
    let lighting = Some(Lighting { lights: vec![Light::HEADLIGHT], ..Lighting::default() });
    let scenes = [
        ("pre-shaded", Model::Composite, Shading::Pre, None, 1.0),
        ("lit", Model::Composite, Shading::Pre, lighting.clone(), 1.0),
        ("X-ray", Model::Xray, Shading::Pre, None, 1.0),
        ("post-shaded", Model::Composite, Shading::Post, None, 1.0),
        ("post-shaded and lit", Model::Composite, Shading::Post, lighting, 1.0),
        ("thick sheets", Model::Composite, Shading::Post, None, 1.5),
        ("maximum", Model::Mip, Shading::Pre, None, 1.0),
    ];
    let projections = [(ProjectionKind::Orthographic, 3.0), (ProjectionKind::Perspective { fov: 40.0 }, 1.6)];
    for (name, model, shading, lighting, thickness) in scenes.into_iter().step_by(step) {
        for ((projection, zoom), painter) in
            projections.into_iter().take(eyes).flat_map(|p| painters(thickness).map(|q| (p, q)))
        {
            let settings = Settings { model, shading, lighting: lighting.clone(), painter, ..Settings::default() };
            let view = View { azimuth: 25.0, elevation: 15.0, zoom, projection, ..View::default() };
            let camera = Camera::new(&view, volume.grid(), [56; 2]).unwrap();
            let render = |renderer: &Renderer| {
                let scene = renderer.prepare(&volume, &transfer, &settings).unwrap();
                renderer.render(&scene, &Frame::new(&camera, &settings)).unwrap()
            };
            let expected = render(&whole);
            assert!(expected.image.pixels().iter().any(|p| p[3] > 0.1), "{name}: nothing to see");
            for (saving, renderer) in &without {
                let got = render(renderer);
                check(&format!("{name}, zoom {zoom}, {projection:?}, {painter:?}"), saving, &got, &expected, &settings);
            }
        }
    }
}

/// Compares a picture without a saving with a picture with all savings.
fn check(what: &str, saving: &str, got: &Rendered, all: &Rendered, settings: &Settings) {
    let in_view = |r: &Rendered| r.stats.quads().map_or(0, |q| q.splats_in_view);
    let quads = got.stats.quads().is_some();
    // Without a saving, tiles may keep other splats.
    let allowed = if quads || saving != "voxels" { 0.0 } else { tiles_noise(settings) };
    let difference = got.image.pixels().as_flattened().iter().zip(all.image.pixels().as_flattened());
    let largest = difference.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(largest <= allowed, "{what}, without {saving}: {largest:e}");
    // Scalars that tiles packs are held as samples of all bricks, in a box.
    let is_listed = quads || !settings.is_post_shaded();
    match saving {
        "bricks" | "voxels" if !is_listed => {}
        "bricks" => {
            // Post-shading asks for the neighbours of what shows too: all bricks of this volume, but for those of a
            // layer that other layers show.
            let [nearest, farthest] = all.stats.levels;
            let fewer = !settings.is_post_shaded() || nearest < farthest;
            assert_eq!(all.stats.bricks_uploaded < got.stats.bricks_uploaded, fewer, "{what}");
            assert_eq!(got.stats.bricks_uploaded, got.stats.bricks);
        }
        "voxels" => assert!(got.stats.splats_kept > 2 * all.stats.splats_kept, "{}", got.stats.splats_kept),
        // Zoomed less, everything is in view.
        "view" => assert!(in_view(got) >= in_view(all) + u64::from(quads && what.contains("zoom 3"))),
        "pixels" => assert_eq!(in_view(got), in_view(all)),
        other => panic!("{other}"),
    }
}

/// Returns the largest difference of pictures by tiles that keep other splats. Tiles packs the box around the splats:
/// another box rounds coordinates differently, by 1.0e-6 here, and lit pictures differ by 3.7e-6. Parts of kernels in
/// slabs are fitted, and fits fade later than their kernels: post-shaded, voxels farther than kernels reach change a
/// place by 1.6e-3 here, a maximum by 9.6e-3.
fn tiles_noise(settings: &Settings) -> f32 {
    match (settings.model, settings.is_post_shaded()) {
        (_, false) => {
            if settings.lighting.is_some() {
                1e-5
            } else {
                2e-6
            }
        }
        (Model::Mip, _) => 1.2e-2,
        _ => 2e-3,
    }
}

/// Makes a tube from corner to corner.
fn tube() -> (Volume, TransferFunction) {
    const SIDE: u32 = 100;
    let value = |[x, y, z]: [u32; 3]| {
        let [x, y, z] = [x, y, z].map(f64::from);
        let middle = (x + y + z) / 3.0;
        let distance = [x, y, z].map(|c| (c - middle).powi(2)).iter().sum::<f64>().sqrt();
        (20.0 - 3.0 * distance + (7.0 * x + 13.0 * y + 29.0 * z) % 5.0) as f32
    };
    let points = (0..SIDE.pow(3)).map(|i| [i % SIDE, i / SIDE % SIDE, i / (SIDE * SIDE)]);
    let volume = Volume::from_slice([SIDE; 3], [1.0, 1.0, 1.3], &points.map(value).collect::<Vec<f32>>()).unwrap();
    let point = |value, opacity, color| ControlPoint { value, color, opacity };
    let points = vec![point(8.0, 0.0, [1.0, 0.2, 0.1]), point(20.0, 0.4, [0.2, 0.9, 1.0])];
    (volume, TransferFunction::new(points, None).unwrap())
}

#[test]
fn device_pages_of_a_box_draw_what_the_box_draws() {
    draw_pages(1);
}

#[test]
#[ignore = "slow: 48 pictures by two devices"]
fn device_pages_of_every_box_draw_what_the_box_draws() {
    draw_pages(4);
}

/// Compares the first `kinds` of pictures.
fn draw_pages(kinds: usize) {
    let (volume, transfer) = tube();
    let renderer = |paged_bytes| {
        let options = RendererOptions { adapter: Some(adapter()), ..RendererOptions::default() };
        let mut renderer = Renderer::new(&options).unwrap();
        renderer.context.savings = Savings { paged_bytes, ..Savings::default() };
        renderer
    };
    let renderers = [renderer(0), renderer(u64::MAX)];
    let lit = |light| Some(Lighting { lights: vec![light], ..Lighting::default() });
    let turned = Light::directional(DVec3::new(1.0, -2.0, 1.0));
    let shadows = Lighting::studio(DVec3::X, DVec3::Z);
    for (shading, lighting, level) in [
        (Shading::Pre, None, Level::At(0)),
        (Shading::Pre, lit(Light::HEADLIGHT), Level::At(0)),
        (Shading::Pre, Some(shadows), Level::At(1)),
        (Shading::Post, None, Level::At(0)),
    ]
    .into_iter()
    .take(kinds)
    {
        let antialiasing = level != Level::At(0);
        let settings = Settings { shading, lighting, level, antialiasing, ..Settings::default() };
        for projection in [ProjectionKind::Orthographic, ProjectionKind::Perspective { fov: 40.0 }] {
            let mut scenes = renderers.each_ref().map(|on| on.prepare(&volume, &transfer, &settings).unwrap());
            let compare = |scenes: &[Scene; 2], azimuth, settings: &Settings| {
                let view = View { azimuth, elevation: 15.0, projection, ..View::default() };
                let camera = Camera::new(&view, volume.grid(), [100; 2]).unwrap();
                let [paged, whole] =
                    [0, 1].map(|i| renderers[i].render(&scenes[i], &Frame::new(&camera, settings)).unwrap());
                let what = format!("{shading:?}, {projection:?}, {level:?}, {azimuth}");
                assert!(whole.image.pixels().iter().any(|p| p[3] > 0.1), "{what}: nothing to see");
                assert!(paged.image == whole.image, "{what}");
                [paged, whole].map(|rendered| rendered.stats.tiles().map_or(0, |tiles| tiles.packed_bytes))
            };
            let [paged, whole] = compare(&scenes, 25.0, &settings);
            println!("{shading:?}, {projection:?}, {level:?}: {paged} bytes, whole {whole}");
            // Marks of a word for each macrocell, or pages of 8^3 voxels, would be over a 24th of the box.
            let least = if shading == Shading::Pre && level == Level::At(0) { 24 } else { 8 };
            assert!(least * paged < whole, "{paged} bytes, whole {whole}: {shading:?}, {projection:?}, {level:?}");
            // Other axes, and another light on the same voxels.
            compare(&scenes, 120.0, &settings);
            let moved = settings.lighting.as_ref().map(|_| lit(turned)).unwrap_or_default();
            compare(&scenes, 120.0, &Settings { lighting: moved, ..settings.clone() });
            let point = |p: &ControlPoint| ControlPoint { value: p.value + 3.0, ..*p };
            let less = TransferFunction::new(transfer.points().iter().map(point).collect(), None).unwrap();
            for (on, scene) in renderers.iter().zip(&mut scenes) {
                on.set_transfer(scene, &less).unwrap();
            }
            let [paged, whole] = compare(&scenes, 25.0, &settings);
            // Now from samples, which scalars fill the box with.
            assert!(shading == Shading::Post || 2 * paged < whole, "{paged} bytes, whole {whole}: {projection:?}");
        }
    }
}

/// Three bricks in a row that may show, of 64: a box without empty pages. Voxels that are hidden leave the box, because
/// their bricks stay on the device.
#[test]
fn device_boxes_of_few_bricks_draw_what_boxes_of_all_draw() {
    const SIDE: u32 = 128;
    // Not in the outermost layers of bricks, by which the range of a brick has no value of its neighbours.
    let is_inside = |place: u32| (1..31).contains(&(place % 32));
    let value = |[x, y, z]: [u32; 3]| match (x / 32, y / 32, z / 32) {
        (brick @ 0..3, 0, 0) if [x, y, z].into_iter().all(is_inside) => {
            (10 + 20 * brick + (7 * x + 3 * y + 5 * z) % 8) as u8
        }
        _ => 0,
    };
    let points = (0..SIDE.pow(3)).map(|i| value([i % SIDE, i / SIDE % SIDE, i / (SIDE * SIDE)]));
    let volume = Volume::from_slice([SIDE; 3], [1.0; 3], &points.collect::<Vec<u8>>()).unwrap();
    // From which value to which one there is matter.
    let showing = |ranges: &[[f64; 2]]| {
        let point = |value, opacity| ControlPoint { value, color: [0.9, value / 100.0, 0.2], opacity };
        let of = |&[low, high]: &[f64; 2]| {
            [point(low - 1.0, 0.0), point(low, 0.02), point(high, 0.03), point(high + 1.0, 0.0)]
        };
        let transfer = TransferFunction::new(ranges.iter().flat_map(of).collect(), None).unwrap();
        transfer.with_classification(Classification::Point)
    };
    let [left, middle, right, nothing] = [[10.0, 18.0], [30.0, 38.0], [50.0, 58.0], [90.0, 98.0]];
    let renderers = [0, u64::MAX].map(|paged_bytes| {
        let options = RendererOptions { adapter: Some(adapter()), ..RendererOptions::default() };
        let mut renderer = Renderer::new(&options).unwrap();
        renderer.context.savings = Savings { paged_bytes, ..Savings::default() };
        renderer
    });
    let lighting = Some(Lighting { lights: vec![Light::HEADLIGHT], ..Lighting::default() });
    for lighting in [None, lighting] {
        let settings = Settings { lighting, level: Level::At(0), antialiasing: false, ..Settings::default() };
        let first = showing(&[left, middle, right]);
        let mut scenes = renderers.each_ref().map(|on| on.prepare(&volume, &first, &settings).unwrap());
        let camera = Camera::new(&View { azimuth: 25.0, ..View::default() }, volume.grid(), [100; 2]).unwrap();
        let mut before = None;
        let edits = [vec![left, right], vec![left, middle, right], vec![middle, right], vec![nothing], vec![right]];
        for shown in std::iter::once(None).chain(edits.into_iter().map(Some)) {
            if let Some(shown) = &shown {
                for (on, scene) in renderers.iter().zip(&mut scenes) {
                    on.set_transfer(scene, &showing(shown)).unwrap();
                }
            }
            let [few, all] = [0, 1].map(|i| renderers[i].render(&scenes[i], &Frame::new(&camera, &settings)).unwrap());
            let bytes = [&few, &all].map(|rendered| rendered.stats.bytes_sent);
            println!("{shown:?}: {bytes:?} bytes sent");
            // At most the three bricks of 38^3 samples, once.
            assert!(bytes[0] < 256 << 10, "{shown:?}");
            assert!(few.image == all.image, "{shown:?}, {:?}", settings.lighting);
            assert!(before.as_ref() != Some(&few.image));
            before = Some(few.image);
        }
    }
}
