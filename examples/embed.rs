//! Draws into a texture of the caller's own device, and compares it with the picture of [`Renderer::render`]:
//! `cargo run --release --example embed`

#![allow(clippy::print_stdout, reason = "the comparison is the result of the example")]

use voxsplat::wgpu::{self, BufferUsages, TextureFormat, TextureUsages};
use voxsplat::{Camera, Frame, Renderer, RendererOptions, Settings, View, demos};

/// Pixels across and down. A row of 256 texels of 16 bytes is aligned as copies from textures need it.
const SIDE: u32 = 256;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // The program's own device, with the features of its adapter that the renderer uses.
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.request_adapter(&Default::default()))?;
    let (required_features, required_limits) = (adapter.features() & Renderer::FEATURES, adapter.limits());
    let description = wgpu::DeviceDescriptor { required_features, required_limits, ..Default::default() };
    let (device, queue) = pollster::block_on(adapter.request_device(&description))?;
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("picture"),
        size: wgpu::Extent3d { width: SIDE, height: SIDE, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: TextureFormat::Rgba32Float,
        usage: TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC,
        view_formats: &[],
    });

    let volume = demos::volume("vessels", 64)?;
    let transfer = demos::demo_transfer("vessels").ok_or("no such volume")?;
    let (settings, camera) = (Settings::default(), Camera::new(&View::default(), volume.grid(), [SIDE; 2])?);
    let renderer = Renderer::from_device(device.clone(), queue.clone(), &adapter, &RendererOptions::default());
    let scene = renderer.prepare(&volume, &transfer, &settings)?;
    renderer.render_into(&scene, &Frame::new(&camera, &settings), &texture)?;

    let (size, usage) = (u64::from(16 * SIDE * SIDE), BufferUsages::COPY_DST | BufferUsages::MAP_READ);
    let buffer = device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false });
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(16 * SIDE), rows_per_image: None };
    let mut encoder = device.create_command_encoder(&Default::default());
    let copy = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
    encoder.copy_texture_to_buffer(texture.as_image_copy(), copy, texture.size());
    queue.submit([encoder.finish()]);
    buffer.map_async(wgpu::MapMode::Read, .., |_| ());
    device.poll(wgpu::PollType::wait_indefinitely())?;
    let drawn = buffer.get_mapped_range(..)?;

    let returned = renderer.render(&scene, &Frame::new(&camera, &settings))?.image;
    let pairs = bytemuck::cast_slice::<u8, [f32; 4]>(&drawn).iter().zip(returned.pixels());
    println!("{} of {} pixels differ", pairs.filter(|(a, b)| a != b).count(), SIDE * SIDE);
    Ok(())
}
