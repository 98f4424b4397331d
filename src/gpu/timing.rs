//! Time per stage: timestamps of the device, or the host's clock if the device has none.

use std::time::Instant;

use super::context::Context;
use crate::error::Result;

/// Queries of one set: the least that WebGPU promises.
const SET: u32 = 4096;

/// Records begin and end of passes by stage.
pub(crate) struct Timing {
    sets: Vec<wgpu::QuerySet>,
    /// The stage of each pair of queries.
    stages: Vec<&'static str>,
    enabled: bool,
}

impl Timing {
    pub(crate) fn new(context: &Context) -> Self {
        let enabled = context.features.contains(wgpu::Features::TIMESTAMP_QUERY);
        Self { sets: Vec::new(), stages: Vec::new(), enabled }
    }

    /// Records nothing.
    pub(crate) fn off() -> Self {
        Self { sets: Vec::new(), stages: Vec::new(), enabled: false }
    }

    fn next(&mut self, context: &Context, stage: &'static str) -> Option<(usize, u32)> {
        if !self.enabled {
            return None;
        }
        let index = 2 * self.stages.len() as u32;
        if index.is_multiple_of(SET) {
            self.sets.push(context.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("timing"),
                ty: wgpu::QueryType::Timestamp,
                count: SET,
            }));
        }
        self.stages.push(stage);
        Some((self.sets.len() - 1, index % SET))
    }

    /// Timestamps for a compute pass of `stage`.
    pub(crate) fn compute(
        &mut self,
        context: &Context,
        stage: &'static str,
    ) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        let (set, index) = self.next(context, stage)?;
        Some(wgpu::ComputePassTimestampWrites {
            query_set: &self.sets[set],
            beginning_of_pass_write_index: Some(index),
            end_of_pass_write_index: Some(index + 1),
        })
    }

    /// Timestamps for a render pass of `stage`.
    pub(crate) fn render(
        &mut self,
        context: &Context,
        stage: &'static str,
    ) -> Option<wgpu::RenderPassTimestampWrites<'_>> {
        let (set, index) = self.next(context, stage)?;
        Some(wgpu::RenderPassTimestampWrites {
            query_set: &self.sets[set],
            beginning_of_pass_write_index: Some(index),
            end_of_pass_write_index: Some(index + 1),
        })
    }

    /// Seconds per stage, in the order in which the stages first ran; `None` without timestamps.
    pub(crate) fn finish(self, context: &Context) -> Result<Option<Vec<(&'static str, f64)>>> {
        if !self.enabled || self.stages.is_empty() {
            return Ok(None);
        }
        let count = 2 * self.stages.len() as u32;
        let bytes = u64::from(count) * 8;
        let resolved = context.buffer(
            "timing.resolved",
            bytes,
            wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
        )?;
        let staging =
            context.buffer("timing.staging", bytes, wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST)?;
        let mut encoder = context.device.create_command_encoder(&Default::default());
        for (set, first) in self.sets.iter().zip((0..count).step_by(SET as usize)) {
            encoder.resolve_query_set(set, 0..SET.min(count - first), &resolved, u64::from(first) * 8);
        }
        encoder.copy_buffer_to_buffer(&resolved, 0, &staging, 0, bytes);
        context.queue.submit([encoder.finish()]);
        let data = context.read("reading timestamps", &staging)?;
        let ticks: Vec<u64> = data[..bytes as usize].chunks_exact(8).map(bytemuck::pod_read_unaligned).collect();
        let second = f64::from(context.queue.get_timestamp_period()) * 1e-9;
        let mut sums: Vec<(&'static str, f64)> = Vec::new();
        for (stage, pair) in self.stages.iter().zip(ticks.chunks_exact(2)) {
            let seconds = pair[1].saturating_sub(pair[0]) as f64 * second;
            match sums.iter_mut().find(|(name, _)| name == stage) {
                Some((_, sum)) => *sum += seconds,
                None => sums.push((stage, seconds)),
            }
        }
        Ok(Some(sums))
    }
}

/// Runs `work` and returns what it gave with the seconds it took on the host.
pub(crate) fn on_host<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = work();
    (result, start.elapsed().as_secs_f64())
}
