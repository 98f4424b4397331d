//! Pictures with a tolerance against exact ones, and rays that skip invisible parts against rays that do not.

use super::*;

fn demo(name: &str, size: u32) -> (Volume, TransferFunction) {
    let source = format!("demo:{name}:{size}");
    let volume = crate::formats::load(&source, &crate::formats::LoadOptions::default()).unwrap();
    (volume, crate::appearance::demos::demo_transfer(name).unwrap())
}

/// Returns the transfer function with the same opacities for slabs `times` times thinner.
fn denser(transfer: &TransferFunction, volume: &Volume, times: f64) -> TransferFunction {
    let unit = transfer.unit_or(volume.grid().min_spacing());
    TransferFunction::new(transfer.points().to_vec(), Some(unit / times)).unwrap()
}

fn lit() -> Option<Lighting> {
    let lights = vec![Light::HEADLIGHT, Light::directional(DVec3::new(0.2, -1.0, 0.5))];
    Some(Lighting { lights, ambient: 0.4, ..Lighting::default() })
}

/// Returns a view whose kernels have their own size, or with `grown` one of so few pixels that they grow.
fn camera(volume: &Volume, projection: ProjectionKind, grown: bool) -> Camera {
    let size = if grown { 16 } else { 200 };
    let view = View { azimuth: 33.0, elevation: 21.0, projection, ..View::default() };
    Camera::new(&view, volume.grid(), [size; 2]).unwrap()
}

/// Returns `count` pixels of a camera's picture, spread all over it.
fn pixels(camera: &Camera, count: u32) -> Vec<[u32; 2]> {
    let [width, height] = camera.size;
    // The golden section scatters them.
    (0..count.min(width * height))
        .map(|i| (f64::from(i) * 0.618_034).fract() * f64::from(width * height))
        .map(|at| at as u32)
        .map(|i| [i % width, i / width])
        .collect()
}

const PERSPECTIVE: ProjectionKind = ProjectionKind::Perspective { fov: 40.0 };

#[test]
fn a_tolerance_holds() {
    let models = [
        (Model::Composite, Shading::Pre, None),
        (Model::Composite, Shading::Pre, lit()),
        (Model::Composite, Shading::Post, None),
        (Model::Composite, Shading::Post, lit()),
        (Model::Mip, Shading::Post, None),
        (Model::Xray, Shading::Pre, None),
    ];
    let scenes = [("marschner-lobb", 24), ("shell", 40), ("vessels", 40)];
    let mut combination = 0;
    for (name, size) in scenes {
        let (volume, transfer) = demo(name, size);
        for (model, shading, lighting) in models.clone() {
            // Every kernel, density, projection and growth with every model, in turn.
            combination += 1;
            let kernel = if combination % 3 == 0 { Kernel::KAISER_BESSEL } else { Kernel::default() };
            let density = [1.0, 0.1, 20.0, 1000.0][combination % 4];
            let projection = if combination % 2 == 0 { PERSPECTIVE } else { ProjectionKind::Orthographic };
            let grown = combination % 5 == 0;
            let transfer = denser(&transfer, &volume, density);
            let how = Settings { lighting, ..settings(kernel, model, shading) };
            let camera = camera(&volume, projection, grown);
            let render = |tolerance: f64| {
                let scene = Reference::new(&volume, &transfer, &how).unwrap().with_tolerance(tolerance);
                scene.pixels(&camera, &pixels(&camera, 101)).unwrap()
            };
            let exact = render(0.0);
            assert!(exact.iter().any(|p| p[3] > 1e-3), "{name} {model:?} {shading:?} {grown}");
            for tolerance in [1e-3, 1e-5, 1e-6] {
                let picture = render(tolerance);
                let differences = picture.iter().flatten().zip(exact.iter().flatten()).map(|(a, b)| (a - b).abs());
                let worst = differences.fold(0.0, f64::max);
                let what = format!("{name} {model:?} {shading:?} x {density} {projection:?} {kernel:?} {grown}");
                assert!(worst <= tolerance, "{what}: {worst:e}");
            }
        }
    }
}

#[test]
fn what_cannot_show_is_left_out_and_nothing_else() {
    // Things far apart, and values on both sides of what shows.
    let grid = Grid::axis_parallel([40, 36, 44], [1.0; 3]).unwrap();
    let bump = |p: DVec3, at: DVec3| (-(p - at).length_squared() / 9.0).exp();
    let volume = floats(grid, |p| {
        bump(p, DVec3::new(4.0, 5.0, 6.0)) + bump(p, DVec3::new(33.0, 30.0, 36.0))
            - bump(p, DVec3::new(20.0, 15.0, 20.0))
    });
    let transfer = ramp(&[(-0.5, 0.2), (-0.3, 0.0), (0.3, 0.0), (0.4, 0.5), (0.6, 0.0), (0.8, 0.0), (0.9, 0.7)], 1.0);
    for (model, shading) in [
        (Model::Composite, Shading::Pre),
        (Model::Composite, Shading::Post),
        (Model::Mip, Shading::Post),
        (Model::Xray, Shading::Pre),
    ] {
        for kernel in [Kernel::default(), Kernel::KAISER_BESSEL] {
            let scene = Reference::new(&volume, &transfer, &settings(kernel, model, shading)).unwrap();
            for projection in [ProjectionKind::Orthographic, PERSPECTIVE] {
                let camera = camera(&volume, projection, false);
                let pixels = pixels(&camera, 601);
                let mut seen = 0;
                for (got, pixel) in scene.pixels(&camera, &pixels).unwrap().iter().zip(pixels) {
                    // A ray alone leaves nothing out.
                    let (sx, sy) = camera.image_coordinates(pixel);
                    let (origin, direction) = camera.ray(sx, sy);
                    let expected = scene.ray(origin, direction, camera.eye().is_none()).rgba();
                    assert_close(*got, expected, 1e-11, &format!("{model:?} {shading:?} {pixel:?}"));
                    seen += u32::from(expected[3] > 1e-3);
                }
                assert!(seen > 2, "{model:?} {shading:?}");
            }
        }
    }
}

#[test]
fn rays_end_in_the_densest_material() {
    let (volume, _) = demo("marschner-lobb", 12);
    let points = vec![point(0.2, [0.1, 0.2, 0.9], 0.0), point(0.4, [0.8, 0.1, 0.1], 0.9), point(1.0, [1.0; 3], 1.0)];
    let camera = Camera::new(&View { azimuth: 30.0, ..View::default() }, volume.grid(), [12; 2]).unwrap();
    for shading in [Shading::Pre, Shading::Post] {
        for tolerance in [0.0, Reference::TOLERANCE] {
            let how = settings(Kernel::default(), Model::Composite, shading);
            let [dense, denser] = [1e-14, 1e-30].map(|unit| {
                let transfer = TransferFunction::new(points.clone(), Some(unit)).unwrap();
                let scene = Reference::new(&volume, &transfer, &how).unwrap().with_tolerance(tolerance);
                scene.pixels(&camera, &pixels(&camera, 144)).unwrap()
            });
            for (a, b) in dense.iter().flatten().zip(denser.iter().flatten()) {
                assert!((a - b).abs() < 1e-5 + tolerance, "{shading:?} {tolerance}: {a} {b}");
            }
        }
    }
}
