//! tmp
use glam::*;
use voxsplat::camera::*;
use voxsplat::kernel::*;
use voxsplat::reference;
use voxsplat::renderer::*;
use voxsplat::settings::*;
use voxsplat::transfer::*;
use voxsplat::volume::*;
fn main() {
    let n = std::env::args().nth(1).map_or(32, |s| s.parse().unwrap());
    let px = std::env::args().nth(2).map_or(64, |s| s.parse().unwrap());
    let mut v = Vec::new();
    for z in 0..n {
        for y in 0..n {
            for x in 0..n {
                let f = |i: u32| (i as f64 + 0.5) / n as f64 * 2.0 - 1.0;
                let (x, y, z) = (f(x), f(y), f(z));
                let r = (x * x + y * y).sqrt();
                let pr = (2.0 * std::f64::consts::PI * 6.0 * (std::f64::consts::PI * r / 2.0).cos()).cos();
                v.push(((1.0 - (std::f64::consts::PI * z / 2.0).sin() + 0.25 * (1.0 + pr)) / 2.5) as f32);
            }
        }
    }
    let aniso = std::env::var("ANISO").is_ok();
    let grid = if aniso {
        Grid::new(
            [n; 3],
            DAffine3::from_mat3(DMat3::from_cols(DVec3::X, DVec3::new(0.3, 1.0, 0.1), DVec3::new(0.2, -0.4, 4.0))),
        )
        .unwrap()
    } else {
        Grid::axis_parallel([n; 3], [1.0; 3]).unwrap()
    };
    let volume = Volume::new(grid, Samples::F32(v)).unwrap();
    let p = |value, color, opacity| ControlPoint { value, color, opacity };
    let tf = TransferFunction::new(
        vec![
            p(0.15, [0.1, 0.2, 0.8], 0.0),
            p(0.35, [0.1, 0.5, 0.9], 0.02),
            p(0.55, [0.9, 0.8, 0.2], 0.06),
            p(0.8, [1.0, 0.3, 0.1], 0.15),
            p(1.0, [1.0; 3], 0.3),
        ],
        None,
    )
    .unwrap();
    let renderer = Renderer::new(&RendererOptions::default()).unwrap();
    let scene = renderer.prepare(&volume, &tf, &|_| ()).unwrap();
    for kernel in [Kernel::default(), Kernel::KAISER_BESSEL] {
        let truth = reference::Scene::new(&volume, &tf, &kernel, Normalization::Unit).unwrap();
        for projection in [ProjectionKind::Orthographic, ProjectionKind::Perspective { fov: 40.0 }] {
            let view = View { azimuth: 33.0, elevation: 21.0, projection, ..View::default() };
            let camera = Camera::new(&view, volume.grid(), [px, px]).unwrap();
            let t = std::time::Instant::now();
            let want = truth.render(&camera, [px, px], &|_| ()).unwrap();
            println!("{kernel:?} {projection:?} reference {:.2?}", t.elapsed());
            for precision in [Precision::F16, Precision::F32] {
                for thickness in [0.5, 1.0, 2.0] {
                    for k in [1, 2, 4, 8] {
                        let settings = Settings {
                            size: [px, px],
                            precision: Some(precision),
                            kernel,
                            sheet_thickness: thickness,
                            sheets_per_pass: Some(k),
                            ..Settings::default()
                        };
                        let t = std::time::Instant::now();
                        let got = renderer.render(&scene, &camera, &settings).unwrap();
                        let (mut a, mut c, mut worst) = (0.0_f32, 0.0_f32, 0);
                        for (i, (x, y)) in got.image.pixels().iter().zip(want.pixels()).enumerate() {
                            if (x[3] - y[3]).abs() > a {
                                worst = i;
                            }
                            a = a.max((x[3] - y[3]).abs());
                            for j in 0..3 {
                                c = c.max((x[j] - y[j]).abs());
                            }
                        }
                        println!(
                            "{precision:?} D {thickness} x{k} alpha {a:.1e} colour {c:.1e} q/s {:.2} {:.0?} worst {} {} {:?} {:?}",
                            got.stats.quads_per_splat,
                            t.elapsed(),
                            worst as u32 % px,
                            worst as u32 / px,
                            got.image.pixels()[worst][3],
                            want.pixels()[worst][3]
                        );
                        if std::env::var("STATS").is_ok() {
                            println!("{}", got.stats);
                        }
                    }
                }
            }
        }
    }
}
