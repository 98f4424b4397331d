//! The work that a picture gives to the device: counts, which any adapter gives as a GPU does, and times.
//!
//! ```text
//! cargo bench --bench plumbing -- --work DIR [--json] [--scenes NAME,..] [--pictures NAME,..] [--size N]
//!     [--times N] [--write]
//! ```
//!
//! DIR is the folder of the bench `race` (`crates/cli/benches/race.json`): its `vol` holds head512.raw, ml256.npy and
//! phantom181.npy. Each scene is drawn in twelve
//! pictures: pre- and post-shaded, unlit, lit by a headlight and in studio light with shadows, along parallel rays and
//! in perspective. A picture has events:
//!
//! - `first`: the volume is prepared and drawn
//! - `next`: the camera turns by 10 degrees
//! - `light`: a light in a direction replaces another one, or studio light turns (lit pictures)
//! - `transfer`: the visible values begin lower (`Renderer::set_transfer`, after another change that is not counted)
//! - `clip`: a clipping plane moves
//!
//! Frames of N pixels squared (512) are drawn into a texture (`Renderer::render_into`). Columns: milliseconds until the
//! device is done, dispatches and draws, submissions, waits of the host, bytes sent to the device, bytes of memory of
//! the device after the event, and voxels or cells drawn. `--times` draws N further turns, and the time of `next` is
//! their median; all other times are of one event. `--json` prints an object a line with `scene`, `picture`, `event`,
//! `milliseconds`, `dispatches`, `submissions`, `waits`, `uploaded`, `resident` and `visible`. `--write` keeps the
//! table in docs/measurements.

#![allow(clippy::disallowed_methods, reason = "measurements allow more than the last bit")]
#![allow(clippy::print_stdout, reason = "printing its table is what this program is for")]

mod common;

use std::path::{Path, PathBuf};
use std::time::Instant;

use common::{Arguments, Outcome, Report, median};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use voxsplat::clip::{Clip, Plane};
use voxsplat::lighting::{Light, Lighting};
use voxsplat::renderer::adapters;
use voxsplat::settings::Shading;
use voxsplat::stats::Counts;
use voxsplat::transfer::ControlPoint;
use voxsplat::volume::SampleType;
use voxsplat::{
    Camera, Frame, LoadOptions, ProjectionKind, Renderer, RendererOptions, Scene, Settings, TransferFunction, View,
    Volume, load, wgpu,
};

/// The scenes of the bench `race` that are drawn.
const SCENES: [&str; 3] = ["head512", "ml256", "phantom181"];
/// The view of pictures of the bench `race`.
const AZIMUTH: f64 = 30.0;
const ELEVATION: f64 = 20.0;

/// The scenes of the bench `race`, and their transfer function.
#[derive(Deserialize)]
struct Race {
    scenes: Vec<RaceScene>,
    transfer: Vec<[f64; 5]>,
}

#[derive(Deserialize)]
struct RaceScene {
    name: String,
    dims: [u32; 3],
    file: String,
    r#type: Option<String>,
    /// The value that is 1 in the transfer function.
    one: f64,
    /// The unit of opacities, in voxels.
    unit: f64,
}

impl RaceScene {
    fn volume(&self, work: &Path) -> Outcome<Volume> {
        let file = work.join("vol").join(&self.file);
        if !file.exists() {
            return Err(format!(
                "{} is missing: make it with make_volumes.py of the race's scripts, `PEERS_WORK={} python3 \
                 make_volumes.py`, and with `--head` for head512",
                file.display(),
                work.display()
            )
            .into());
        }
        let raw = match &self.r#type {
            Some(name) => LoadOptions {
                dims: Some(self.dims),
                sample_type: Some(name.parse::<SampleType>()?),
                ..LoadOptions::default()
            },
            None => LoadOptions::default(),
        };
        Ok(load(file, &raw)?)
    }

    /// The curve of the race with values moved by a share of the range.
    fn transfer(&self, curve: &[[f64; 5]], moved: f64) -> Outcome<TransferFunction> {
        let point = |&[value, r, g, b, opacity]: &[f64; 5]| ControlPoint {
            value: self.one * (value + moved),
            color: [r, g, b],
            opacity,
        };
        Ok(TransferFunction::new(curve.iter().map(point).collect(), Some(self.unit))?)
    }
}

/// The light of a picture.
#[derive(Clone, Copy, PartialEq)]
enum Lit {
    Unlit,
    Headlight,
    /// With shadows and occlusion.
    Studio,
}

/// A kind of picture.
#[derive(Clone, Copy)]
struct Kind {
    post: bool,
    lit: Lit,
    perspective: bool,
}

impl Kind {
    fn all() -> impl Iterator<Item = Self> {
        let lights = [Lit::Unlit, Lit::Headlight, Lit::Studio];
        (0..12).map(move |n| Self { post: n >= 6, lit: lights[n % 6 / 2], perspective: n % 2 == 1 })
    }

    fn name(self) -> String {
        let pick = |yes, a: &'static str, b: &'static str| if yes { a } else { b };
        let shading = pick(self.post, "post", "pre");
        let light = match self.lit {
            Lit::Unlit => "unlit",
            Lit::Headlight => "lit",
            Lit::Studio => "studio",
        };
        format!("{shading}-{light}-{}", pick(self.perspective, "perspective", "parallel"))
    }

    fn settings(self) -> Settings {
        let shading = if self.post { Shading::Post } else { Shading::Pre };
        let lighting = match self.lit {
            Lit::Unlit => None,
            Lit::Headlight => Some(lights(Light::HEADLIGHT)),
            Lit::Studio => Some(studio(0.0)),
        };
        Settings { shading, lighting, ..Settings::default() }
    }

    /// The light of a number.
    fn other_light(self, number: u32) -> Lighting {
        match self.lit {
            Lit::Studio => studio(0.1 * f64::from(number)),
            _ => lights(Light::directional(DVec3::new(1.0, 1.0, f64::from(number).recip()))),
        }
    }
}

fn lights(light: Light) -> Lighting {
    Lighting { lights: vec![light], ..Lighting::default() }
}

/// Studio light, turned about the vertical axis by an angle in radians.
fn studio(angle: f64) -> Lighting {
    Lighting::studio(DVec3::new(angle.sin(), -0.2, angle.cos()), DVec3::Y)
}

/// What an event takes.
struct Taken {
    milliseconds: f64,
    counts: Counts,
    visible: u64,
}

/// An event of a picture.
#[derive(Serialize)]
struct Row {
    scene: String,
    picture: String,
    event: &'static str,
    milliseconds: f64,
    dispatches: u64,
    submissions: u64,
    waits: u64,
    uploaded: u64,
    resident: u64,
    visible: u64,
}

/// A device with a texture to draw into.
struct Host {
    device: wgpu::Device,
    renderer: Renderer,
    texture: wgpu::Texture,
}

impl Host {
    /// A device of its own for a picture, so that no other scene is in its memory.
    fn new(size: u32) -> Outcome<Self> {
        let best = adapters().into_iter().next().ok_or("no adapter")?;
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
            backends: wgpu::Backends::VULKAN | wgpu::Backends::METAL | wgpu::Backends::DX12,
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        });
        let found = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
        let adapter = found.into_iter().find(|a| a.get_info().name == best.name).ok_or("no adapter")?;
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            required_features: adapter.features() & Renderer::FEATURES,
            required_limits: adapter.limits(),
            ..Default::default()
        }))?;
        let renderer = Renderer::from_device(device.clone(), queue, &adapter, &RendererOptions::default());
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("plumbing.target"),
            size: wgpu::Extent3d { width: size, height: size, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba8Unorm,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
            view_formats: &[],
        });
        Ok(Self { device, renderer, texture })
    }

    /// What `work` takes, which returns the number of voxels drawn. The waits for the device are no counts: before it,
    /// so that earlier pictures take none of its time, and at its end.
    fn measured(&self, work: impl FnOnce() -> Outcome<u64>) -> Outcome<Taken> {
        self.device.poll(wgpu::PollType::wait_indefinitely())?;
        let before = self.renderer.counts();
        let start = Instant::now();
        let visible = work()?;
        self.device.poll(wgpu::PollType::wait_indefinitely())?;
        let milliseconds = start.elapsed().as_secs_f64() * 1e3;
        let mut counts = self.renderer.counts();
        counts.dispatches -= before.dispatches;
        counts.submissions -= before.submissions;
        counts.waits -= before.waits;
        counts.uploaded -= before.uploaded;
        Ok(Taken { milliseconds, counts, visible })
    }

    fn draw(&self, scene: &Scene, camera: &Camera, settings: &Settings) -> Outcome<u64> {
        let stats = self.renderer.render_into(scene, &Frame::new(camera, settings), &self.texture)?;
        Ok(stats.splats_kept)
    }
}

/// Draws the events of a picture, and passes each to `take`.
fn events(
    host: &Host,
    of: &RaceScene,
    volume: &Volume,
    curve: &[[f64; 5]],
    kind: Kind,
    turns: usize,
    take: &mut dyn FnMut(&'static str, Taken) -> Outcome,
) -> Outcome {
    let renderer = &host.renderer;
    let height = 1.5 * f64::from(of.dims.into_iter().max().unwrap_or(1));
    let camera = |azimuth| {
        let projection = match kind.perspective {
            true => ProjectionKind::Perspective { fov: 30.0 },
            false => ProjectionKind::Orthographic,
        };
        let up = DVec3::Y;
        let view = View { azimuth, elevation: ELEVATION, up, view_height: Some(height), projection, ..View::default() };
        Camera::new(&view, volume.grid(), [host.texture.width(); 2])
    };
    let settings = kind.settings();
    let transfer = of.transfer(curve, 0.0)?;
    let at = camera(AZIMUTH)?;
    let mut made = None;
    let first = host.measured(|| {
        let scene = made.insert(renderer.prepare(volume, &transfer, &settings)?);
        host.draw(scene, &at, &settings)
    })?;
    take("first", first)?;
    let mut scene = made.ok_or("no scene")?;
    let turned = camera(AZIMUTH + 10.0)?;
    let mut next = host.measured(|| host.draw(&scene, &turned, &settings))?;
    let mut times = Vec::new();
    for turn in 0..turns {
        let turned = camera(AZIMUTH + 10.0 * (2 + turn) as f64)?;
        times.push(host.measured(|| host.draw(&scene, &turned, &settings))?.milliseconds);
    }
    if turns > 0 {
        next.milliseconds = median(times);
    }
    take("next", next)?;
    if kind.lit != Lit::Unlit {
        let lit_by = |number| Settings { lighting: Some(kind.other_light(number)), ..settings.clone() };
        host.draw(&scene, &at, &lit_by(1))?;
        take("light", host.measured(|| host.draw(&scene, &at, &lit_by(2)))?)?;
    }
    let clipped = |share: f64| -> Outcome<Settings> {
        let plane = Plane::new(DVec3::X, share * f64::from(of.dims[0]))?;
        Ok(Settings { clip: Clip::new(vec![plane])?, ..settings.clone() })
    };
    host.draw(&scene, &at, &clipped(0.0)?)?;
    let moved = clipped(0.1)?;
    take("clip", host.measured(|| host.draw(&scene, &at, &moved))?)?;
    host.draw(&scene, &at, &settings)?;
    let mut change = |moved| -> Outcome<Taken> {
        let other = of.transfer(curve, moved)?;
        host.measured(|| {
            renderer.set_transfer(&mut scene, &other)?;
            host.draw(&scene, &at, &settings)
        })
    };
    change(0.02)?;
    take("transfer", change(-0.03)?)
}

fn main() -> Outcome {
    let mut arguments = Arguments::of_process();
    let work: PathBuf = arguments.option("--work")?.unwrap_or_else(|| PathBuf::from("target/race"));
    let json = arguments.flag("--json");
    let [scenes, pictures] = ["--scenes", "--pictures"].map(|name| arguments.option::<String>(name));
    let (scenes, pictures) = (scenes?, pictures?);
    let (size, turns) = (arguments.option("--size")?.unwrap_or(512), arguments.option("--times")?.unwrap_or(0));
    if let [unknown, ..] = arguments.positional()? {
        return Err(format!("unknown argument {unknown}").into());
    }
    let Race { scenes: of_race, transfer } = serde_json::from_str(include_str!("../crates/cli/benches/race.json"))?;
    let is_listed = |list: &Option<String>, name: &str| list.as_ref().is_none_or(|l| l.split(',').any(|n| n == name));
    let mut report = Report::new("plumbing", &arguments);
    if !json {
        report.line(
            "| scene | picture | event | ms | dispatches | submissions | waits | uploaded | resident | visible |",
        );
        report.line("|---|---|---|---|---|---|---|---|---|---|");
    }
    for name in SCENES.into_iter().filter(|name| is_listed(&scenes, name)) {
        let scene = of_race.iter().find(|scene| scene.name == name).ok_or_else(|| format!("the race has no {name}"))?;
        let volume = scene.volume(&work)?;
        for kind in Kind::all().filter(|kind| is_listed(&pictures, &kind.name())) {
            let host = Host::new(size)?;
            // Each row as soon as its event is done.
            events(&host, scene, &volume, &transfer, kind, turns, &mut |event, taken| {
                let Taken { milliseconds, counts, visible } = taken;
                let Counts { dispatches, submissions, waits, uploaded, resident, .. } = counts;
                let picture = kind.name();
                if json {
                    let row = Row {
                        scene: name.to_owned(),
                        picture,
                        event,
                        milliseconds,
                        dispatches,
                        submissions,
                        waits,
                        uploaded,
                        resident,
                        visible,
                    };
                    println!("{}", serde_json::to_string(&row)?);
                    return Ok(());
                }
                let counts = format!("{dispatches} | {submissions} | {waits} | {uploaded} | {resident} | {visible}");
                report.line(format!("| {name} | {picture} | {event} | {milliseconds:.1} | {counts} |"));
                Ok(())
            })?;
        }
    }
    let best = adapters().into_iter().next().ok_or("no adapter")?;
    report.finish(&best)
}
