//! Rendering on the caller's device, and into the caller's texture.

use voxsplat::Frame;
use voxsplat::camera::{ProjectionKind, View};
use voxsplat::error::Error;
use voxsplat::image::Image;
use voxsplat::renderer::{Renderer, RendererOptions};
use voxsplat::settings::{Settings, Shading};
use voxsplat::wgpu;

use crate::adapter::adapter;
use crate::support::{demo, exact_quads, headlight, look, with_quads};

/// A device that this test opens itself.
pub(crate) struct Host {
    device: wgpu::Device,
    queue: wgpu::Queue,
    pub(crate) renderer: Renderer,
}

pub(crate) fn host(features: wgpu::Features) -> Host {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    let named = |a: &wgpu::Adapter| a.get_info().name.to_lowercase().contains(&adapter().to_lowercase());
    let own = adapters.into_iter().find(named).unwrap();
    let (device, queue) = pollster::block_on(own.request_device(&wgpu::DeviceDescriptor {
        required_features: own.features() & features,
        ..Default::default()
    }))
    .unwrap();
    let renderer = Renderer::from_device(device.clone(), queue.clone(), &own, &RendererOptions::default());
    Host { device, queue, renderer }
}

impl Host {
    pub(crate) fn texture(&self, [width, height]: [u32; 2], format: wgpu::TextureFormat) -> wgpu::Texture {
        self.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("host.target"),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        })
    }

    /// The bytes of the texels, row by row. The width must make rows of a multiple of 256 bytes.
    fn read(&self, texture: &wgpu::Texture) -> Vec<u8> {
        let size = texture.size();
        let row = size.width * texture.format().block_copy_size(None).unwrap();
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("host.staging"),
            size: u64::from(row * size.height),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None };
        let target = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
        encoder.copy_texture_to_buffer(texture.as_image_copy(), target, size);
        self.queue.submit([encoder.finish()]);
        buffer.map_async(wgpu::MapMode::Read, .., |result| result.unwrap());
        self.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
        buffer.get_mapped_range(..).unwrap().to_vec()
    }
}

/// The largest difference of a picture from values of its texels.
fn difference(image: &Image, values: impl Iterator<Item = f32>) -> f32 {
    let pairs = image.pixels().as_flattened().iter().zip(values);
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn a_texture_of_the_caller_gets_the_picture() {
    let Host { renderer, .. } = &host(Renderer::FEATURES);
    let host = host(Renderer::FEATURES);
    let (volume, transfer) = demo("vessels", 24);
    // Post-shaded and lit, sheets hold gradients beside the scalars: the limits of this device permit half floats only.
    let lit = Settings { shading: Shading::Post, lighting: headlight(), ..exact_quads() };
    let lit = with_quads(&lit, |q| q.precision = None);
    for settings in [Settings::default(), exact_quads(), lit] {
        let view = View { azimuth: 30.0, projection: ProjectionKind::Perspective { fov: 40.0 }, ..View::default() };
        let camera = look(&view, &volume, [64, 48]);
        let scene = host.renderer.prepare(&volume, &transfer, &settings).unwrap();
        let image = host.renderer.render(&scene, &Frame::new(&camera, &settings)).unwrap().image;
        let render_into = |format| {
            let texture = host.texture(camera.size, format);
            let stats = host.renderer.render_into(&scene, &Frame::new(&camera, &settings), &texture).unwrap();
            assert!(stats.pixels_covered > 0);
            host.read(&texture)
        };
        let floats = render_into(wgpu::TextureFormat::Rgba32Float);
        let floats = floats.chunks_exact(4).map(|v| f32::from_ne_bytes([v[0], v[1], v[2], v[3]]));
        assert_eq!(difference(&image, floats), 0.0);
        for format in [wgpu::TextureFormat::Rgba8Unorm, wgpu::TextureFormat::Rgba8UnormSrgb] {
            let bytes = render_into(format);
            // Half a step of rounding, and another half for the encoding of sRGB formats, to which Vulkan allows 0.6
            // steps.
            let error = difference(&image, bytes.iter().map(|&b| f32::from(b) / 255.0));
            assert!(error < 1.2 / 255.0, "{format:?}: {error}");
        }
        // A scene of another device is refused, and so is a texture of another size.
        let other = renderer.render(&scene, &Frame::new(&camera, &settings));
        assert!(matches!(other, Err(Error::Setting { name: "scene", .. })));
        let small = host.texture([64, 47], wgpu::TextureFormat::Rgba8Unorm);
        let refused = host.renderer.render_into(&scene, &Frame::new(&camera, &settings), &small);
        assert!(matches!(refused, Err(Error::Setting { name: "target", .. })));
    }
}

#[test]
fn a_device_without_features_draws_all_the_same() {
    let host = host(wgpu::Features::empty());
    let (volume, transfer) = demo("sphere", 16);
    let settings = Settings::default();
    let camera = look(&View::default(), &volume, [32; 2]);
    let scene = host.renderer.prepare(&volume, &transfer, &settings).unwrap();
    let rendered = host.renderer.render(&scene, &Frame::new(&camera, &settings)).unwrap();
    assert!(rendered.image.pixels().iter().any(|p| p[3] > 0.5));
    let quads = host.renderer.render(&scene, &Frame::new(&camera, &with_quads(&settings, |_| ()))).unwrap().stats;
    assert!(quads.painter_reason.contains("half floats"), "{}", quads.painter_reason);
    let f32_sheets = with_quads(&settings, |q| q.precision = Some(voxsplat::settings::Precision::F32));
    assert!(matches!(host.renderer.render(&scene, &Frame::new(&camera, &f32_sheets)), Err(Error::Unsupported { .. })));
}

#[test]
fn a_camera_that_is_not_finite_is_refused() {
    let (volume, transfer) = demo("sphere", 8);
    let settings = exact_quads();
    let scene = crate::support::prepare(&volume, &transfer, &settings);
    let mut camera = look(&View::default(), &volume, [8; 2]);
    camera.target.x = f64::NAN;
    let refused = crate::support::draw_on(&crate::support::renderer(), &scene, &camera, &settings);
    assert!(matches!(refused, Err(Error::Camera(_))));
}
