//! The device: chosen, opened, and watched for errors.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use super::savings::Savings;
use crate::error::{Error, Result};
use crate::stats::adapter::{AdapterInfo, AdapterKind};
use voxsplat_volume::memory;

impl From<&wgpu::AdapterInfo> for AdapterInfo {
    fn from(info: &wgpu::AdapterInfo) -> Self {
        let kind = match info.device_type {
            wgpu::DeviceType::DiscreteGpu => AdapterKind::Discrete,
            wgpu::DeviceType::IntegratedGpu => AdapterKind::Integrated,
            wgpu::DeviceType::VirtualGpu => AdapterKind::Virtual,
            wgpu::DeviceType::Cpu => AdapterKind::Cpu,
            wgpu::DeviceType::Other => AdapterKind::Other,
        };
        Self {
            name: info.name.clone(),
            backend: info.backend.to_str().to_owned(),
            kind,
            driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
        }
    }
}

/// The instance of wgpu for the whole program: without any the drivers are unloaded, and NVIDIA's loads no more than
/// some 30 times (580.159: "cannot allocate memory in static TLS block").
static INSTANCE: LazyLock<wgpu::Instance> = LazyLock::new(|| {
    wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN | wgpu::Backends::METAL | wgpu::Backends::DX12,
        flags: wgpu::InstanceFlags::empty().with_env(),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    })
});

async fn enumerate() -> Vec<(AdapterInfo, wgpu::Adapter)> {
    let adapters = INSTANCE.enumerate_adapters(wgpu::Backends::all()).await;
    let mut found: Vec<_> = adapters.into_iter().map(|a| (AdapterInfo::from(&a.get_info()), a)).collect();
    // Of equals, the order of the driver.
    found.sort_by_key(|(info, _)| info.kind);
    found
}

/// Returns the adapters of this machine, best first; none if there is no memory for a driver.
pub(crate) fn adapters() -> Vec<AdapterInfo> {
    if check_memory(DRIVER_BYTES).is_err() {
        return Vec::new();
    }
    pollster::block_on(enumerate()).into_iter().map(|(info, _)| info).collect()
}

/// The number of bytes of addresses without which drivers crash or fail in words about anything but memory. Mesa's
/// software driver, the largest, opens in limits (`ulimit -v`) of 750 to 900 MB, of which the program has 100.
const DRIVER_BYTES: u64 = 640 << 20;

/// Refuses to open a driver if there are fewer than `bytes` of memory.
pub(crate) fn check_memory(bytes: u64) -> Result<()> {
    memory::check(bytes, String::new).map_err(|_| {
        Error::NoAdapter(format!(
            "there is no memory for a driver, which may take {} MiB: free memory, or raise the limit of the process \
             (ulimit -v)",
            DRIVER_BYTES >> 20
        ))
    })
}

/// Returns the index of the adapter that `wanted` names among names, best first: a part of the name, letter case
/// ignored, or the index behind `#`. `None` is the best.
fn chosen(wanted: Option<&str>, names: &[&str]) -> Result<usize> {
    if names.is_empty() {
        return Err(Error::NoAdapter(
            "no Vulkan, Metal or DX12 driver found; on Debian and Ubuntu `apt-get install mesa-vulkan-drivers \
             libvulkan1` gives a software one"
                .to_owned(),
        ));
    }
    let Some(wanted) = wanted else { return Ok(0) };
    let part = wanted.to_lowercase();
    let found = match wanted.strip_prefix('#') {
        Some(index) => index.parse().ok().filter(|index| *index < names.len()),
        None => names.iter().position(|name| name.to_lowercase().contains(&part)),
    };
    found.ok_or_else(|| {
        let known: Vec<String> = names.iter().enumerate().map(|(index, name)| format!("#{index} {name}")).collect();
        Error::NoAdapter(format!("none is {wanted:?}; there are: {}", known.join(", ")))
    })
}

/// Devices opened so far.
static OPENED: AtomicU64 = AtomicU64::new(0);

/// The number of bytes of a pixel: premultiplied RGBA, f32.
pub(crate) const PIXEL_BYTES: u64 = 16;

/// The time within which another thread must report that a buffer is mapped.
const MAP_TIMEOUT: std::time::Duration = std::time::Duration::from_secs(60);

/// An open device with its queue and its errors.
pub(crate) struct Context {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    pub(crate) info: AdapterInfo,
    pub(crate) limits: wgpu::Limits,
    pub(crate) features: wgpu::Features,
    /// The first report of the device outside error scopes: the reason of its loss, or an error.
    failure: Arc<Mutex<Option<String>>>,
    traffic: Mutex<Traffic>,
    /// Buffers that the host read from.
    staging: Mutex<Vec<wgpu::Buffer>>,
    /// The number that distinguishes this device from others of the program.
    pub(crate) id: u64,
    /// The savings of work without effect: all of them, except in tests.
    pub(crate) savings: Savings,
}

/// The ledger of a device: everything made on it and sent to it since it was opened.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Traffic {
    /// The number of bytes of buffers and textures.
    pub(crate) allocated: u64,
    /// The number of bytes that the host sent into buffers and textures.
    pub(crate) sent: u64,
    pub(crate) pipelines: u32,
    /// Dispatches of compute shaders, and draws.
    pub(crate) dispatches: u64,
    /// Submissions of commands.
    pub(crate) submissions: u64,
    /// Waits of the host for the device.
    pub(crate) waits: u64,
}

/// Returns the error of a buffer that the host cannot read or write.
fn unmapped(stage: &str, e: &dyn std::fmt::Display) -> Error {
    let reason = format!("memory of the device cannot be read or written: {}", one_line(&e.to_string()));
    Error::Device { stage: stage.to_owned(), reason }
}

impl Context {
    /// The features that are used if the device has them.
    pub(crate) const FEATURES: wgpu::Features =
        wgpu::Features::TIMESTAMP_QUERY.union(wgpu::Features::FLOAT32_BLENDABLE);

    /// Makes the context of a device that is open already. Its error callbacks stay the owner's.
    pub(crate) fn of_device(device: wgpu::Device, queue: wgpu::Queue, info: AdapterInfo) -> Self {
        let (limits, features) = (device.limits(), device.features() & Self::FEATURES);
        Self {
            device,
            queue,
            info,
            limits,
            features,
            failure: Arc::default(),
            traffic: Mutex::default(),
            staging: Mutex::default(),
            id: OPENED.fetch_add(1, Ordering::Relaxed),
            savings: Savings::default(),
        }
    }

    /// Opens the adapter that `wanted` names.
    pub(crate) fn new(wanted: Option<&str>) -> Result<Self> {
        check_memory(DRIVER_BYTES)?;
        let mut found = pollster::block_on(enumerate());
        let names: Vec<&str> = found.iter().map(|(info, _)| info.name.as_str()).collect();
        let (info, adapter) = found.swap_remove(chosen(wanted, &names)?);
        let features = adapter.features() & Self::FEATURES;
        let limits = adapter.limits();
        let request = adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("voxsplat"),
            required_features: features,
            required_limits: limits,
            ..Default::default()
        });
        let (device, queue) = pollster::block_on(request).map_err(|e| {
            let failed = || Error::NoAdapter(format!("{} cannot be opened: {}", info.name, one_line(&e.to_string())));
            // Other threads may have taken the memory meanwhile.
            check_memory(DRIVER_BYTES).err().unwrap_or_else(failed)
        })?;
        let context = Self::of_device(device, queue, info);
        context.watch();
        Ok(context)
    }

    /// Notes reports of the device outside error scopes.
    fn watch(&self) {
        let note = |failure: &Mutex<Option<String>>, what: String| {
            let mut failure = failure.lock().unwrap_or_else(PoisonError::into_inner);
            failure.get_or_insert(what);
        };
        let lost = Arc::clone(&self.failure);
        self.device.set_device_lost_callback(move |reason, message| {
            // Dropping the device at the end of the program is no failure.
            if reason != wgpu::DeviceLostReason::Destroyed {
                note(&lost, format!("device lost: {}", one_line(&message)));
            }
        });
        let uncaptured = Arc::clone(&self.failure);
        self.device.on_uncaptured_error(Arc::new(move |e: wgpu::Error| note(&uncaptured, one_line(&e.to_string()))));
    }

    /// Runs `work` and turns errors of the device into an error that names `stage`.
    pub(crate) fn guarded<T>(&self, stage: &str, work: impl FnOnce() -> Result<T>) -> Result<T> {
        let out_of_memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let internal = self.device.push_error_scope(wgpu::ErrorFilter::Internal);
        let validation = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let result = work();
        let validation = pollster::block_on(validation.pop());
        let internal = pollster::block_on(internal.pop());
        if pollster::block_on(out_of_memory.pop()).is_some() {
            return Err(Error::OutOfMemory(stage.to_owned()));
        }
        if let Some(e) = internal.or(validation) {
            return Err(Error::Device { stage: stage.to_owned(), reason: one_line(&e.to_string()) });
        }
        let failure = self.failure.lock().unwrap_or_else(PoisonError::into_inner).clone();
        if let Some(reason) = failure {
            return Err(Error::Device { stage: stage.to_owned(), reason });
        }
        result
    }

    /// Returns whether the device can blend f32, so that sheets can be f32.
    pub(crate) fn blends_f32(&self) -> bool {
        self.features.contains(wgpu::Features::FLOAT32_BLENDABLE)
    }

    /// Submits commands to the device.
    pub(crate) fn submit(&self, commands: Option<wgpu::CommandBuffer>) {
        self.count(|traffic| traffic.submissions += 1);
        self.queue.submit(commands);
    }

    /// Counts a dispatch or a draw that was recorded.
    pub(crate) fn dispatched(&self) {
        self.count(|traffic| traffic.dispatches += 1);
    }

    /// Returns the bytes of memory of all buffers and textures of the device, staging buffers of wgpu included; 0 on
    /// Metal.
    pub(crate) fn resident(&self) -> u64 {
        let counters = self.device.get_internal_counters().hal;
        (counters.buffer_memory.read() + counters.texture_memory.read()).max(0) as u64
    }

    /// Waits until the device has done all submitted work.
    pub(crate) fn wait(&self, stage: &str) -> Result<()> {
        self.count(|traffic| traffic.waits += 1);
        self.poll(stage, wgpu::PollType::wait_indefinitely())
    }

    fn poll(&self, stage: &str, how: wgpu::PollType) -> Result<()> {
        self.device
            .poll(how)
            .map(|_| ())
            .map_err(|e| Error::Device { stage: stage.to_owned(), reason: one_line(&e.to_string()) })
    }

    /// Makes a buffer of `size` bytes, rounded up to the alignment of copies.
    pub(crate) fn buffer(&self, label: &str, size: u64, usage: wgpu::BufferUsages) -> Result<wgpu::Buffer> {
        self.new_buffer(label, size, usage, false)
    }

    fn new_buffer(&self, label: &str, size: u64, usage: wgpu::BufferUsages, is_mapped: bool) -> Result<wgpu::Buffer> {
        let size = size.max(16).next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT);
        if size > self.limits.max_buffer_size {
            return Err(self.unsupported(format!(
                "holds buffers of at most {} bytes, {label} needs {size}: render fewer pixels or a smaller volume",
                self.limits.max_buffer_size
            )));
        }
        self.count(|traffic| traffic.allocated += size);
        Ok(self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size,
            usage,
            mapped_at_creation: is_mapped,
        }))
    }

    /// Makes a buffer that holds `data`.
    pub(crate) fn upload(&self, label: &str, data: &[u8], usage: wgpu::BufferUsages) -> Result<wgpu::Buffer> {
        let buffer = self.buffer(label, data.len() as u64, usage | wgpu::BufferUsages::COPY_DST)?;
        self.write(&buffer, 0, data);
        Ok(buffer)
    }

    /// Sends `data` into a buffer, from byte `at` on, a multiple of 4.
    pub(crate) fn write(&self, buffer: &wgpu::Buffer, at: u64, data: &[u8]) {
        self.count(|traffic| traffic.sent += data.len() as u64);
        // Copies take whole words: the bytes past the last word go in a word of their own.
        let (words, rest) = data.split_at(data.len() / 4 * 4);
        self.queue.write_buffer(buffer, at, words);
        if !rest.is_empty() {
            let mut last = [0; 4];
            last[..rest.len()].copy_from_slice(rest);
            self.queue.write_buffer(buffer, at + words.len() as u64, &last);
        }
    }

    /// Makes a buffer of the pixels of a picture, four f32 each, that shaders write.
    pub(crate) fn pixels(&self, label: &str, [width, height]: [u32; 2]) -> Result<wgpu::Buffer> {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        self.buffer(label, u64::from(width) * u64::from(height) * PIXEL_BYTES, usage)
    }

    /// Returns the most bytes of a buffer that shaders read as a whole.
    pub(crate) fn largest_buffer(&self) -> u64 {
        self.limits.max_storage_buffer_binding_size.min(self.limits.max_buffer_size)
    }

    /// Makes a texture of one level, whose bytes are counted.
    pub(crate) fn texture(
        &self,
        label: &str,
        format: wgpu::TextureFormat,
        [width, height, depth_or_array_layers]: [u32; 3],
        dimension: wgpu::TextureDimension,
        usage: wgpu::TextureUsages,
    ) -> wgpu::Texture {
        let texel = u64::from(format.block_copy_size(None).unwrap_or(16));
        let texels = u64::from(width) * u64::from(height) * u64::from(depth_or_array_layers);
        self.count(|traffic| traffic.allocated += texel * texels);
        self.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d { width, height, depth_or_array_layers },
            mip_level_count: 1,
            sample_count: 1,
            dimension,
            format,
            usage,
            view_formats: &[],
        })
    }

    /// Makes a storage texture of f32 in RGBA, row by row.
    pub(crate) fn float_texture(&self, label: &str, [width, height]: [u32; 2], values: &[f32]) -> wgpu::TextureView {
        let usage = wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::COPY_DST;
        let (format, flat) = (wgpu::TextureFormat::Rgba32Float, wgpu::TextureDimension::D2);
        let texture = self.texture(label, format, [width, height, 1], flat, usage);
        self.write_texels(&texture, [0; 3], bytemuck::cast_slice(values), [width, height, 1]);
        texture.create_view(&Default::default())
    }

    /// Makes a storage texture of f32 in RGBA whose rows begin with these texels; all other texels are 0.
    pub(crate) fn float_rows(&self, label: &str, rows: &[Vec<[f32; 4]>]) -> wgpu::TextureView {
        let usage = wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::COPY_DST;
        let (format, flat) = (wgpu::TextureFormat::Rgba32Float, wgpu::TextureDimension::D2);
        let width = rows.iter().map(Vec::len).max().unwrap_or(0).max(1) as u32;
        let texture = self.texture(label, format, [width, rows.len() as u32, 1], flat, usage);
        for (y, row) in (0..).zip(rows).filter(|(_, row)| !row.is_empty()) {
            self.write_texels(&texture, [0, y, 0], bytemuck::cast_slice(row), [row.len() as u32, 1, 1]);
        }
        texture.create_view(&Default::default())
    }

    /// Sends bytes into a texture, from texel `[x, y, z]` on.
    pub(crate) fn write_texels(
        &self,
        texture: &wgpu::Texture,
        [x, y, z]: [u32; 3],
        bytes: &[u8],
        [width, height, depth_or_array_layers]: [u32; 3],
    ) {
        self.count(|traffic| traffic.sent += bytes.len() as u64);
        let row = bytes.len() / (height * depth_or_array_layers) as usize;
        self.queue.write_texture(
            wgpu::TexelCopyTextureInfo { origin: wgpu::Origin3d { x, y, z }, ..texture.as_image_copy() },
            bytes,
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row as u32), rows_per_image: Some(height) },
            wgpu::Extent3d { width, height, depth_or_array_layers },
        );
    }

    /// Returns the resources made since the device was opened.
    pub(crate) fn traffic(&self) -> Traffic {
        *self.traffic.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn count(&self, add: impl FnOnce(&mut Traffic)) {
        add(&mut self.traffic.lock().unwrap_or_else(PoisonError::into_inner));
    }

    /// Counts a pipeline that was made.
    pub(crate) fn made_pipeline(&self) {
        self.count(|traffic| traffic.pipelines += 1);
    }

    /// Returns a buffer of at least `bytes` bytes for copies that the host reads: one that [`Self::read_done`] kept, if
    /// there is one. The driver takes longer to allocate such memory than to copy to it.
    pub(crate) fn staging(&self, label: &str, bytes: u64) -> Result<wgpu::Buffer> {
        let mut kept = self.staging.lock().unwrap_or_else(PoisonError::into_inner);
        match kept.iter().position(|buffer| (bytes..=4 * bytes).contains(&buffer.size())) {
            Some(fit) => Ok(kept.swap_remove(fit)),
            None => self.buffer(label, bytes, wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST),
        }
    }

    /// Keeps a buffer of [`Self::staging`] for the next copies.
    fn keep_staging(&self, buffer: wgpu::Buffer) {
        /// The range of bytes of kept buffers: smaller ones cost nothing, ones larger than the pixels of a large
        /// picture are not worth their memory.
        const KEPT: std::ops::RangeInclusive<u64> = 1 << 20..=256 << 20;
        /// The number of kept buffers: the pixels of a picture and of the next one.
        const MOST: usize = 2;
        let mut kept = self.staging.lock().unwrap_or_else(PoisonError::into_inner);
        if KEPT.contains(&buffer.size()) {
            kept.push(buffer);
        }
        if kept.len() > MOST {
            kept.remove(0);
        }
    }

    /// Calls `read` with the first `bytes` of a buffer of [`Self::staging`]. The host has waited for the commands that
    /// write it.
    pub(crate) fn read_done<T>(
        &self,
        stage: &str,
        buffer: wgpu::Buffer,
        bytes: u64,
        read: impl FnOnce(&[u8]) -> T,
    ) -> Result<T> {
        let all = ..bytes.next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT).min(buffer.size());
        self.map(stage, &buffer, wgpu::MapMode::Read, all.end)?;
        let view = buffer.get_mapped_range(all).map_err(|e| unmapped(stage, &e))?;
        let result = read(&view[..bytes as usize]);
        drop(view);
        buffer.unmap();
        self.keep_staging(buffer);
        Ok(result)
    }

    /// Maps the first `bytes` of a buffer. The host has waited for the commands that use it.
    pub(crate) fn map(&self, stage: &str, buffer: &wgpu::Buffer, mode: wgpu::MapMode, bytes: u64) -> Result<()> {
        let (done, outcome) = std::sync::mpsc::channel();
        buffer.map_async(mode, ..bytes, move |result| {
            // If the wait has failed, nobody receives.
            let _ = done.send(result);
        });
        self.poll(stage, wgpu::PollType::Poll)?;
        // If several threads wait, another thread may be the one that learns that the buffer is mapped: by now it is
        // about to pass that on.
        match outcome.recv_timeout(MAP_TIMEOUT) {
            Ok(Ok(())) => Ok(()),
            Ok(Err(e)) => Err(unmapped(stage, &e)),
            Err(_) => Err(unmapped(stage, &"the driver never finished")),
        }
    }

    /// Makes a buffer that the host writes first, and that is copied from.
    pub(crate) fn mapped(&self, label: &str, bytes: u64) -> Result<wgpu::Buffer> {
        self.new_buffer(label, bytes, wgpu::BufferUsages::MAP_WRITE | wgpu::BufferUsages::COPY_SRC, true)
    }

    /// Writes bytes into a mapped buffer, from byte `at` on, a multiple of 8.
    pub(crate) fn write_mapped(&self, stage: &str, buffer: &wgpu::Buffer, at: u64, bytes: &[u8]) -> Result<()> {
        self.count(|traffic| traffic.sent += bytes.len() as u64);
        if bytes.is_empty() {
            return Ok(());
        }
        let mut view = buffer.get_mapped_range_mut(at..at + bytes.len() as u64).map_err(|e| unmapped(stage, &e))?;
        view.copy_from_slice(bytes);
        Ok(())
    }

    /// Returns an error that names this adapter.
    pub(crate) fn unsupported(&self, reason: String) -> Error {
        Error::Unsupported { adapter: self.info.name.clone(), reason }
    }

    /// Returns the error of a volume whose samples the device has no room for.
    pub(crate) fn outgrown(&self) -> Error {
        let reason = "has no room for the samples: draw bricks (voxsplat plan), or use --painter cpu";
        self.unsupported(reason.to_owned())
    }

    /// Returns the workgroups of `size` invocations for `count` invocations, folded into rows if they exceed the
    /// adapter's limit.
    pub(crate) fn workgroups(&self, count: u64, size: u64) -> (u32, u32) {
        let groups = count.div_ceil(size);
        let row = u64::from(self.limits.max_compute_workgroups_per_dimension);
        if groups <= row { (groups as u32, 1) } else { (row as u32, groups.div_ceil(row) as u32) }
    }
}

/// Joins the lines of a driver's message, because an error of this library is one line.
fn one_line(message: &str) -> String {
    message.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn adapters_are_chosen_by_a_part_of_their_name_or_by_index() {
        let names = ["Card A", "Card B", "llvmpipe"];
        let index = |wanted: &str| chosen(Some(wanted), &names);
        assert_eq!(chosen(None, &names).unwrap(), 0);
        assert_eq!(["b", "LLVM", "card", "#0", "#2"].map(|wanted| index(wanted).unwrap()), [1, 2, 0, 0, 2]);
        for wanted in ["#3", "#-1", "#", "#b", "nvidia"] {
            let error = index(wanted).unwrap_err().to_string();
            let expected = format!("none is {wanted:?}; there are: #0 Card A, #1 Card B, #2 llvmpipe");
            assert!(error.contains(&expected), "{error}");
        }
        assert!(chosen(None, &[]).unwrap_err().to_string().contains("mesa-vulkan-drivers"));
    }

    #[test]
    fn a_driver_without_memory_is_no_missing_driver() {
        assert!(check_memory(1).is_ok());
        let short = check_memory(1 << 60).unwrap_err().to_string();
        assert!(short.contains("no memory for a driver") && short.contains("ulimit -v"), "{short}");
    }
}
