//! Cost against the size of a dense volume, and against the pixels of its picture.
//!
//! ```text
//! cargo bench --bench size -- [--work DIR] [--edges 64,128,256,512,1024] [--frames N] [--write]
//! ```
//!
//! Volumes are the signal of Marschner and Lobb ("An evaluation of reconstruction filters for volume rendering", 1994)
//! in u8, 83 % of it visible, as bare samples in a folder of their own: 1 GiB at 1024^3. The folder is temporary unless
//! --work names it. All sizes show the same body from the same side, so larger volumes have more voxels to a pixel.
//!
//! The first table has pictures of 512 x 512 pixels. `command` is the wall time of the command line that makes one from
//! a cold start, and `memory` its peak resident memory. The rest comes from a turntable of 10-degree steps in a process
//! of its own: `classify` and `pack` of its first picture, the median of the frames after the first, and the peak
//! resident memory. The second table has larger pictures of 256^3 voxels.

#![allow(clippy::disallowed_methods, reason = "measurements allow more than the last bit")]
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "printing its table is what this program is for")]

#[path = "../../../benches/common/mod.rs"]
mod common;

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use common::{Arguments, Outcome, Report, measured, median};
use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use voxsplat::camera::ProjectionKind;
use voxsplat::lighting::Lighting;
use voxsplat::renderer::adapters;
use voxsplat::transfer::ControlPoint;
use voxsplat::volume::SampleType;
use voxsplat::{Camera, Frame, LoadOptions, Renderer, RendererOptions, Settings, TransferFunction, View, load};

/// Value, colour and opacity over a 64th of the volume's edge.
const CURVE: [(f64, [f64; 3], f64); 6] = [
    (0.00, [0.0, 0.0, 0.0], 0.00),
    (0.15, [0.1, 0.2, 0.8], 0.00),
    (0.35, [0.1, 0.5, 0.9], 0.02),
    (0.55, [0.9, 0.8, 0.2], 0.06),
    (0.80, [1.0, 0.3, 0.1], 0.15),
    (1.00, [1.0, 1.0, 1.0], 0.30),
];

const AZIMUTH: f64 = 30.0;
const ELEVATION: f64 = 20.0;
/// Height of the view, in edges of the volume.
const HEIGHT: f64 = 1.5;

/// A picture of a volume.
#[derive(Serialize, Deserialize, Clone)]
struct Scene {
    folder: PathBuf,
    edge: u32,
    size: [u32; 2],
    lit: bool,
    perspective: bool,
    frames: usize,
}

/// The seconds and the statistics of a turntable.
#[derive(Serialize, Deserialize)]
struct Took {
    load: f64,
    classify: f64,
    pack: f64,
    frame: f64,
    level: f32,
    splats: u64,
    covered: u64,
}

impl Scene {
    fn file(&self) -> PathBuf {
        self.folder.join(format!("dense{}.raw", self.edge))
    }

    fn transfer_file(&self) -> PathBuf {
        self.folder.join(format!("dense{}.json", self.edge))
    }

    fn transfer(&self) -> Outcome<TransferFunction> {
        let points = CURVE.map(|(value, color, opacity)| ControlPoint { value: 255.0 * value, color, opacity });
        Ok(TransferFunction::new(points.to_vec(), Some(f64::from(self.edge) / 64.0))?)
    }

    fn view_height(&self) -> f64 {
        HEIGHT * f64::from(self.edge)
    }

    /// Writes the volume and the transfer function, unless they are there.
    fn write(&self) -> Outcome {
        std::fs::write(self.transfer_file(), self.transfer()?.to_json())?;
        let size = u64::from(self.edge).pow(3);
        if std::fs::metadata(self.file()).is_ok_and(|file| file.len() == size) {
            return Ok(());
        }
        eprintln!("{0}^3 voxels are made", self.edge);
        let edge = self.edge as usize;
        let place = |i: usize| (i as f64 + 0.5) / edge as f64 * 2.0 - 1.0;
        // The signal is a sum of a term of z and one of x and y.
        let ripples: Vec<f64> = (0..edge * edge)
            .into_par_iter()
            .map(|i| {
                let radius = place(i % edge).hypot(place(i / edge));
                let phase = 12.0 * std::f64::consts::PI * (std::f64::consts::FRAC_PI_2 * radius).cos();
                0.25 * (1.0 + phase.cos())
            })
            .collect();
        let mut plane = vec![0_u8; edge * edge];
        let mut out = std::fs::File::create(self.file())?;
        for z in 0..edge {
            let slope = 1.0 - (std::f64::consts::FRAC_PI_2 * place(z)).sin();
            let sample = |ripple: &f64| (255.0 * (slope + ripple) / 2.5).round() as u8;
            plane.par_iter_mut().zip(&ripples).for_each(|(voxel, ripple)| *voxel = sample(ripple));
            out.write_all(&plane)?;
        }
        Ok(())
    }

    /// The wall time of a command that makes the picture, and its peak memory in MiB.
    fn command(&self) -> Outcome<[f64; 2]> {
        let text = |path: &Path| path.to_string_lossy().into_owned();
        let (edge, [width, height]) = (self.edge, self.size);
        let arguments = format!(
            "render {} -o {} --dims {edge},{edge},{edge} --type u8 --transfer {} --size {width}x{height} --up 0,1,0 \
             --azimuth {AZIMUTH} --elevation {ELEVATION} --view-height {}",
            text(&self.file()),
            text(&self.folder.join("size.png")),
            text(&self.transfer_file()),
            self.view_height(),
        );
        let mut command = Command::new(env!("CARGO_BIN_EXE_voxsplat"));
        command.args(arguments.split_whitespace());
        if self.lit {
            command.args(["--light", "headlight"]);
        }
        if self.perspective {
            command.args(["--projection", "perspective"]);
        }
        let (wall, memory, _) = measured(&mut command)?;
        Ok([wall, memory])
    }

    /// Runs a turntable in a process of its own. Returns its times, and its peak memory in MiB.
    fn turntable(&self) -> Outcome<(Took, f64)> {
        let mut turn = Command::new(std::env::current_exe()?);
        turn.args(["--bench", "--child", &serde_json::to_string(self)?]);
        let (_, memory, took) = measured(&mut turn)?;
        Ok((serde_json::from_value(took)?, memory))
    }

    /// A turntable in this process.
    fn turn(&self) -> Outcome<Took> {
        let start = Instant::now();
        let options =
            LoadOptions { dims: Some([self.edge; 3]), sample_type: Some(SampleType::U8), ..LoadOptions::default() };
        let volume = load(self.file(), &options)?;
        let load = start.elapsed().as_secs_f64();
        let settings = Settings { lighting: self.lit.then(Lighting::default), ..Settings::default() };
        let renderer = Renderer::new(&RendererOptions::default())?;
        let scene = renderer.prepare(&volume, &self.transfer()?, &settings)?;
        let mut times = Vec::new();
        let mut first = None;
        for frame in 0..self.frames {
            let projection = match self.perspective {
                true => ProjectionKind::Perspective { fov: 30.0 },
                false => ProjectionKind::Orthographic,
            };
            let view = View {
                azimuth: AZIMUTH + 10.0 * frame as f64,
                elevation: ELEVATION,
                up: DVec3::Y,
                view_height: Some(self.view_height()),
                projection,
                ..View::default()
            };
            let camera = Camera::new(&view, volume.grid(), self.size)?;
            let start = Instant::now();
            let stats = renderer.render(&scene, &Frame::new(&camera, &settings))?.stats;
            times.push(start.elapsed().as_secs_f64());
            first.get_or_insert(stats);
        }
        let stats = first.ok_or("no frames")?;
        let seconds = |stage| stats.seconds(stage).unwrap_or(0.0);
        Ok(Took {
            load,
            classify: seconds("classify"),
            pack: seconds("pack"),
            frame: median(times.split_off(1)),
            level: stats.levels[0],
            splats: stats.splats_kept,
            covered: stats.pixels_covered,
        })
    }
}

fn main() -> Outcome {
    let mut arguments = Arguments::of_process();
    if let Some(scene) = arguments.option::<String>("--child")? {
        println!("{}", serde_json::to_string(&serde_json::from_str::<Scene>(&scene)?.turn()?)?);
        return Ok(());
    }
    let work: Option<PathBuf> = arguments.option("--work")?;
    let edges = arguments.option("--edges")?.unwrap_or_else(|| "64,128,256,512,1024".to_owned());
    let edges = edges.split(',').map(str::parse).collect::<Result<Vec<u32>, _>>()?;
    let frames = arguments.option("--frames")?.unwrap_or(9);
    let [] = arguments.positional()? else { return Err("unknown arguments".into()) };
    let mut report = Report::new("size", &arguments);
    let temporary = tempfile::tempdir()?;
    let folder = work.unwrap_or_else(|| temporary.path().to_owned());
    let scene =
        Scene { folder, edge: 256, size: [512; 2], lit: false, perspective: false, frames: usize::max(frames, 2) };

    report.line(
        "| voxels | light | level | splats | load, s | classify, s | pack, s | frame, s | command, s \
         | memory of it, MiB | memory turning, MiB |",
    );
    report.line("|---|---|---|---|---|---|---|---|---|---|---|");
    for edge in edges {
        for lit in [false, true] {
            let scene = Scene { edge, lit, ..scene.clone() };
            scene.write()?;
            let [command, memory] = scene.command()?;
            let (took, turning) = scene.turntable()?;
            let Took { load, classify, pack, frame, level, splats, .. } = took;
            report.line(format_args!(
                "| {edge}^3 | {} | {level} | {:.1} M | {load:.3} | {classify:.2} | {pack:.3} | {frame:.3} \
                 | {command:.2} | {memory:.0} | {turning:.0} |",
                if lit { "headlight" } else { "none" },
                splats as f64 / 1e6,
            ));
        }
    }

    report.line("\n| pixels | covered | picture | pack, s | frame, s | ns a covered pixel | memory turning, MiB |");
    report.line("|---|---|---|---|---|---|---|");
    scene.write()?;
    for (lit, perspective, name) in [(false, false, "unlit"), (true, false, "lit"), (false, true, "perspective")] {
        for size in [[512, 512], [1920, 1080], [3840, 2160]] {
            let (took, turning) = Scene { size, lit, perspective, ..scene.clone() }.turntable()?;
            let Took { pack, frame, covered, .. } = took;
            report.line(format_args!(
                "| {} x {} | {:.2} M | {name} | {pack:.3} | {frame:.3} | {:.0} | {turning:.0} |",
                size[0],
                size[1],
                covered as f64 / 1e6,
                frame / covered as f64 * 1e9,
            ));
        }
    }
    report.finish(adapters().first().ok_or("no adapter")?)
}
