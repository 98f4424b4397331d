use std::error::Error;
use voxsplat::camera::{Camera, View};
use voxsplat::reference;
use voxsplat::renderer::{Renderer, RendererOptions};
use voxsplat::settings::{Interslice, Settings, Shading};
use voxsplat::volume::{LoadOptions, demo_transfer, load};
fn main() -> Result<(), Box<dyn Error>> {
    let r = Renderer::new(&RendererOptions::default())?;
    let size: u32 = std::env::args().nth(1).unwrap().parse()?;
    let px: u32 = std::env::args().nth(2).unwrap().parse()?;
    let light = std::env::args().nth(3).is_some();
    let volume = load(&format!("demo:shell:{size}"), &LoadOptions::default())?;
    let transfer = demo_transfer("shell").unwrap();
    let base = Settings {
        size: [px, px],
        shading: Shading::Post,
        termination: 0.0,
        lighting: light.then(Default::default),
        ..Settings::default()
    };
    let view = View {
        azimuth: 30.0,
        elevation: 20.0,
        up: glam::DVec3::Y,
        view_height: Some(1.5 * f64::from(size)),
        ..View::default()
    };
    let camera = Camera::new(&view, volume.grid(), base.size)?;
    let t = std::time::Instant::now();
    let truth = reference::Scene::new(&volume, &transfer, &base)?.render(&camera, base.size, &|_| ())?;
    println!("truth {:.1} s", t.elapsed().as_secs_f64());
    for i in [Interslice::Mean, Interslice::Parabola] {
        for d in [0.25, 0.5, 1.0, 2.0, 4.0] {
            let s = Settings { sheet_thickness: d, interslice: i, ..base.clone() };
            let scene = r.prepare(&volume, &transfer, &s, &|_| ())?;
            let t = std::time::Instant::now();
            let got = r.render(&scene, &camera, &s)?;
            let dt = t.elapsed().as_secs_f64();
            let (mut sum, mut n, mut worst) = (0.0, 0u32, 0.0_f64);
            for (a, b) in got.image.pixels().iter().zip(truth.pixels()) {
                if b[3] > 0.0 || a[3] > 0.0 {
                    for c in 0..3 {
                        let e = f64::from(a[c] - b[c]) * 255.0;
                        sum += e * e;
                        worst = worst.max(e.abs());
                    }
                    n += 3;
                }
            }
            println!(
                "{i:?} {d}: rms {:.4} max {worst:.3} of 255 over {} px, {dt:.2} s, kept {}",
                (sum / f64::from(n)).sqrt(),
                n / 3,
                got.stats.splats_kept
            );
        }
    }
    Ok(())
}
