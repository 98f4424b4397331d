//! Shared parts of the tests: one device, volumes, and the only calls of the library that make cameras and pictures.

use std::sync::{Arc, Mutex, PoisonError, Weak};
use voxsplat::Frame;

use glam::DVec3;
use voxsplat::camera::{Camera, ProjectionKind, View};
use voxsplat::demos::demo_transfer;
use voxsplat::engine::Engine;
use voxsplat::error::Result;
use voxsplat::formats::{LoadOptions, load};
use voxsplat::image::{Image, compare};
use voxsplat::lighting::{Light, Lighting};
use voxsplat::renderer::{Rendered, Renderer, RendererOptions, Scene};
use voxsplat::settings::{Level, Painter, Precision, QuadsSettings, Settings};
use voxsplat::stats::{QuadsStats, TilesStats};
use voxsplat::transfer::{ControlPoint, TransferFunction};
use voxsplat::volume::Volume;

use crate::adapter::adapter;

/// Tests that share a device, one after the other. Pipelines stay on a device: for all tests of this binary they took
/// 9 GB on Mesa's software driver.
const TESTS_OF_A_DEVICE: u32 = 12;

/// The devices of running tests, and the newest device with the number of its tests.
struct Devices {
    running: Vec<(Weak<()>, Arc<Renderer>)>,
    newest: Option<(Arc<Renderer>, u32)>,
}

/// Returns the device of the running test, which it shares with a few other tests: making a device for each takes time.
pub(crate) fn renderer() -> Arc<Renderer> {
    static DEVICES: Mutex<Devices> = Mutex::new(Devices { running: Vec::new(), newest: None });
    // Each test has a thread, and this lives as long.
    thread_local! {
        static TEST: Arc<()> = Arc::default();
    }
    let test = TEST.with(Arc::downgrade);
    let mut devices = DEVICES.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, renderer)) = devices.running.iter().find(|(other, _)| other.ptr_eq(&test)) {
        return renderer.clone();
    }
    // Devices of ended tests are freed here: at the end of a thread, thread-locals of wgpu may be gone.
    devices.running.retain(|(test, _)| test.strong_count() > 0);
    let (renderer, tests) = match devices.newest.take() {
        Some((renderer, tests)) if tests < TESTS_OF_A_DEVICE => (renderer, tests + 1),
        _ => (Arc::new(new_renderer()), 1),
    };
    devices.newest = Some((renderer.clone(), tests));
    devices.running.push((test, renderer.clone()));
    renderer
}

/// A separate device, for tests that count its objects.
pub(crate) fn new_renderer() -> Renderer {
    Renderer::new(&RendererOptions { adapter: Some(adapter()), ..RendererOptions::default() })
        .unwrap_or_else(|e| panic!("{e}; VOXSPLAT_TEST_ADAPTER can name another adapter"))
}

/// A separate device, and the processor.
pub(crate) fn engines() -> [Engine; 2] {
    let cpu = Settings { painter: Painter::Cpu, ..Settings::default() };
    let host = Engine::open(&RendererOptions::default(), &cpu).unwrap();
    [Engine::Device(Arc::new(new_renderer())), host]
}

pub(crate) fn demo(name: &str, size: u32) -> (Volume, TransferFunction) {
    let volume = load(format!("demo:{name}:{size}"), &LoadOptions::default()).unwrap();
    (volume, demo_transfer(name).unwrap())
}

pub(crate) fn transfer(points: &[(f64, [f64; 3], f64)], unit: Option<f64>) -> TransferFunction {
    let points = points.iter().map(|&(value, color, opacity)| ControlPoint { value, color, opacity }).collect();
    TransferFunction::new(points, unit).unwrap()
}

pub(crate) fn headlight() -> Option<Lighting> {
    Some(Lighting { lights: vec![Light::HEADLIGHT], ..Lighting::default() })
}

pub(crate) fn two_lights() -> Option<Lighting> {
    let lights = vec![Light::HEADLIGHT, Light::directional(DVec3::new(1.0, -0.3, 0.8))];
    Some(Lighting { ambient: 0.2, diffuse: 0.5, specular: 0.3, shininess: 12.0, lights, ..Lighting::default() })
}

/// Quads without techniques that may change a picture.
pub(crate) fn exact_quads() -> Settings {
    with_quads(&Settings { termination: 0.0, level: Level::At(0), ..Settings::default() }, |q| {
        q.precision = Some(Precision::F32)
    })
}

/// The painter quads, with some of its settings changed.
pub(crate) fn with_quads(settings: &Settings, change: impl FnOnce(&mut QuadsSettings)) -> Settings {
    let mut quads = if let Painter::Quads(quads) = settings.painter { quads } else { QuadsSettings::default() };
    change(&mut quads);
    Settings { painter: Painter::Quads(quads), ..settings.clone() }
}

/// The painter tiles.
pub(crate) fn with_tiles(settings: &Settings) -> Settings {
    Settings { painter: Painter::Tiles, ..settings.clone() }
}

/// The painter of the processor, with cells where kernels have grown beyond its filters.
pub(crate) fn with_cpu(settings: &Settings) -> Settings {
    Settings { painter: Painter::Cpu, level: Level::Auto, ..settings.clone() }
}

/// Quads with sheets of another thickness.
pub(crate) fn thick(settings: &Settings, sheet_thickness: f64) -> Settings {
    with_quads(settings, |q| q.sheet_thickness = sheet_thickness)
}

pub(crate) const PERSPECTIVE: ProjectionKind = ProjectionKind::Perspective { fov: 40.0 };
pub(crate) const PROJECTIONS: [ProjectionKind; 2] = [ProjectionKind::Orthographic, PERSPECTIVE];

/// A view of a volume.
pub(crate) fn look(view: &View, volume: &Volume, size: [u32; 2]) -> Camera {
    Camera::new(view, volume.grid(), size).unwrap()
}

/// A view of a volume from 25 degrees above.
pub(crate) fn camera(azimuth: f64, projection: ProjectionKind, volume: &Volume, size: u32) -> Camera {
    look(&View { azimuth, elevation: 25.0, projection, ..View::default() }, volume, [size; 2])
}

/// The image coordinates of a pixel, by its number; see `Camera::image_coordinates`.
pub(crate) fn coordinates(index: usize, camera: &Camera) -> (f64, f64) {
    let (index, width) = (index as u32, camera.size[0]);
    camera.image_coordinates([index % width, index / width])
}

pub(crate) fn prepare(volume: &Volume, transfer: &TransferFunction, settings: &Settings) -> Scene {
    prepare_on(&renderer(), volume, transfer, settings).unwrap()
}

pub(crate) fn prepare_on(
    renderer: &Renderer,
    volume: &Volume,
    transfer: &TransferFunction,
    settings: &Settings,
) -> Result<Scene> {
    renderer.prepare(volume, transfer, settings)
}

pub(crate) fn draw(scene: &Scene, camera: &Camera, settings: &Settings) -> Rendered {
    draw_on(&renderer(), scene, camera, settings).unwrap()
}

pub(crate) fn draw_on(renderer: &Renderer, scene: &Scene, camera: &Camera, settings: &Settings) -> Result<Rendered> {
    renderer.render(scene, &Frame::new(camera, settings))
}

/// Prepares a volume and renders it.
pub(crate) fn picture(volume: &Volume, transfer: &TransferFunction, camera: &Camera, settings: &Settings) -> Rendered {
    draw(&prepare(volume, transfer, settings), camera, settings)
}

pub(crate) fn render(volume: &Volume, transfer: &TransferFunction, camera: &Camera, settings: &Settings) -> Image {
    picture(volume, transfer, camera, settings).image
}

/// The largest error of any colour, and of alpha.
pub(crate) fn errors(a: &Image, b: &Image) -> (f64, f64) {
    let [r, g, b, alpha] = compare(a, b, 0.0).unwrap().max_channel;
    (r.max(g).max(b), alpha)
}

/// Root mean square over all channels of the pixels that either picture covers.
pub(crate) fn rms_covered(a: &Image, b: &Image) -> f64 {
    compare(a, b, 0.0).unwrap().rms_covered
}

/// Root mean square over all channels of all pixels.
pub(crate) fn rms_of_all(a: &Image, b: &Image) -> f64 {
    compare(a, b, 0.0).unwrap().rms
}

/// Root mean square over the colours of pixels that are visible in 8 bits, in steps of 8 bits.
pub(crate) fn rms_in_steps(a: &Image, b: &Image) -> f64 {
    let shown = |p: &[f32; 4]| p[..3].iter().any(|&c| c > 1.0 / 255.0);
    let pixels: Vec<_> = a.pixels().iter().zip(b.pixels()).filter(|(p, q)| shown(p) || shown(q)).collect();
    let squares = pixels.iter().flat_map(|(p, q)| p[..3].iter().zip(&q[..3])).map(|(p, q)| f64::from(p - q).powi(2));
    255.0 * (squares.sum::<f64>() / (3 * pixels.len()) as f64).sqrt()
}

/// The statistics of quads; fails if another painter drew.
pub(crate) fn by_quads(rendered: &Rendered) -> QuadsStats {
    *rendered
        .stats
        .quads()
        .unwrap_or_else(|| panic!("{}: {}", rendered.stats.painter.name(), rendered.stats.painter_reason))
}

/// The statistics of tiles; fails if another painter drew.
pub(crate) fn by_tiles(rendered: &Rendered) -> TilesStats {
    *rendered
        .stats
        .tiles()
        .unwrap_or_else(|| panic!("{}: {}", rendered.stats.painter.name(), rendered.stats.painter_reason))
}

/// Tiles without techniques that may change a picture.
pub(crate) fn full() -> Settings {
    let exact = Settings { termination: 0.0, antialiasing: false, level: Level::At(0), ..Settings::default() };
    with_tiles(&exact)
}

/// The name of a test on the command line of the test binary, given the path of its module.
pub(crate) fn own_name(module: &str, test: &str) -> String {
    let (_, path) = module.split_once("::").unwrap();
    format!("{path}::{test}")
}
