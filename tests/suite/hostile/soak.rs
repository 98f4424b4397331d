//! Long turntables: each turn gives the bytes of the first and adds no memory. Mesa 22.3.6 leaks a copy of a
//! shader, 0.2 MB and more, in each dispatch of a shader with a branch that depends on uniforms alone.

use std::process::Command;

use voxsplat::camera::{ProjectionKind, View};
use voxsplat::settings::{Level, Model, Response, Settings, Shading};

use crate::support::{
    PERSPECTIVE, demo, draw_on, exact_quads, headlight, look, new_renderer, own_name, prepare_on, with_tiles,
};

/// The environment variable with the number of frames, in a process that makes a turntable.
const FRAMES: &str = "VOXSPLAT_SOAK_FRAMES";

/// Resident bytes of the process; `None` if the system does not report them.
fn resident() -> Option<u64> {
    let statm = std::fs::read_to_string("/proc/self/statm").ok()?;
    // Pages of 4096 bytes on the systems that tests run on.
    statm.split_whitespace().nth(1)?.parse::<u64>().ok().map(|pages| 4096 * pages)
}

/// Some turns of each kind of scene with each painter, with a separate device in a separate process.
#[test]
fn turns() {
    let Some(frames) = std::env::var(FRAMES).ok().and_then(|n| n.parse::<u32>().ok()) else { return };
    let renderer = new_renderer();
    let base = exact_quads();
    let scenes = [
        ("pre, lit", "vessels", Settings { lighting: headlight(), ..base.clone() }),
        ("cells", "vessels", Settings { lighting: headlight(), level: Level::At(1), ..base.clone() }),
        ("post", "sphere", Settings { shading: Shading::Post, ..base.clone() }),
        ("xray", "shepp-logan", Settings { model: Model::Xray, ..base.clone() }),
        ("mip", "marschner-lobb", Settings { model: Model::Mip, ..base.clone() }),
        ("depth", "vessels", Settings { model: Model::Mip, depth_coded: true, ..base.clone() }),
        ("film", "shepp-logan", Settings { model: Model::Xray, response: Response::FILM, ..base.clone() }),
        ("average", "marschner-lobb", Settings { model: Model::Average, ..base.clone() }),
        ("layers", "marschner-lobb", Settings { lighting: headlight(), level: Level::Auto, ..base.clone() }),
        (
            "post layers",
            "marschner-lobb",
            Settings { shading: Shading::Post, lighting: headlight(), level: Level::Auto, ..base },
        ),
    ];
    for (name, demo_name, quads) in scenes {
        let (volume, transfer) = demo(demo_name, 24);
        // In so few pixels kernels have grown, the more the farther they are from the eye, and cells replace voxels.
        let is_layered = name.ends_with("layers");
        let (projection, size) = if is_layered { (PERSPECTIVE, 22) } else { (ProjectionKind::Orthographic, 48) };
        for settings in [with_tiles(&quads), quads] {
            let scene = prepare_on(&renderer, &volume, &transfer, &settings).unwrap();
            let mut painter = "";
            let mut turn = || -> Vec<u8> {
                let mut bytes = Vec::new();
                for frame in 0..frames / 2 {
                    let azimuth = 360.0 * f64::from(frame) / f64::from(frames / 2);
                    let view = View { azimuth, elevation: 20.0, projection, ..View::default() };
                    let rendered = draw_on(&renderer, &scene, &look(&view, &volume, [size; 2]), &settings).unwrap();
                    painter = rendered.stats.painter.name();
                    let [nearest, farthest] = rendered.stats.levels;
                    assert!(!is_layered || painter != "tiles" || nearest < farthest, "{name}: no layers of cells");
                    // The hash of a picture, so that a turn keeps little memory.
                    let pixels = rendered.image.pixels().as_flattened();
                    let hash = pixels.iter().fold(0xcbf2_9ce4_8422_2325_u64, |hash, value| {
                        (hash ^ u64::from(value.to_bits())).wrapping_mul(0x100_0000_01b3)
                    });
                    bytes.extend(hash.to_le_bytes());
                }
                bytes
            };
            // Two turns to warm up: drivers free memory some frames later.
            let first = turn();
            assert!(first == turn(), "{name}: the second turn differs");
            // A leak adds to each turn. Beside other processes, threads of drivers may take memory in some of them.
            let mut least = u64::MAX;
            for _ in 0..4 {
                let before = resident();
                assert!(first == turn(), "{name}: a later turn differs");
                let grown = before.zip(resident()).map_or(0, |(before, after)| after.saturating_sub(before));
                least = least.min(grown);
                if least < 1 << 20 {
                    break;
                }
            }
            println!("{name:<9} {painter:<5} {} frames a turn: {} kB more at the end", frames / 2, least >> 10);
            assert!(least < 1 << 20, "{name}, {painter}: each turn adds {least} bytes or more");
        }
    }
    println!("soaked");
}

/// Runs `turns` in a separate process, because other tests also take memory.
fn soak(frames: u32) {
    let own = std::env::current_exe().unwrap();
    let name = own_name(module_path!(), "turns");
    let output =
        Command::new(own).args(["--exact", &name, "--nocapture"]).env(FRAMES, frames.to_string()).output().unwrap();
    let (said, failed) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    println!("{said}");
    assert!(output.status.success() && said.contains("soaked"), "{said}\n{failed}");
}

#[test]
fn a_turntable_keeps_its_bytes() {
    soak(4);
}

#[test]
#[ignore = "slow: 1440 frames"]
fn long_turntables_keep_their_bytes() {
    soak(120);
}
