//! Time per stage: timestamps of the device, or the host's clock if the device has none.

use super::context::Context;
use crate::error::Result;

/// Number of queries of one set: the least that WebGPU promises.
const SET: u32 = 4096;

/// A record of the begin and the end of passes by stage; by default, nothing is recorded.
#[derive(Default)]
pub(crate) struct Timing {
    sets: Vec<wgpu::QuerySet>,
    /// The stage of each pair of queries that is not resolved yet.
    stages: Vec<&'static str>,
    /// Resolved queries, and the stages of their pairs.
    resolved: Vec<(wgpu::Buffer, Vec<&'static str>)>,
    enabled: bool,
}

impl Timing {
    pub(crate) fn new(context: &Context) -> Self {
        Self { enabled: context.features.contains(wgpu::Features::TIMESTAMP_QUERY), ..Self::default() }
    }

    /// Returns the set of queries, and the pair of queries in it for the begin and the end of a pass of a stage.
    fn next(&mut self, context: &Context, stage: &'static str) -> Option<(&wgpu::QuerySet, [Option<u32>; 2])> {
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
        Some((self.sets.last()?, [Some(index % SET), Some(index % SET + 1)]))
    }

    /// Returns the timestamps for a compute pass of `stage`.
    pub(crate) fn compute(
        &mut self,
        context: &Context,
        stage: &'static str,
    ) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        let (query_set, [beginning_of_pass_write_index, end_of_pass_write_index]) = self.next(context, stage)?;
        Some(wgpu::ComputePassTimestampWrites { query_set, beginning_of_pass_write_index, end_of_pass_write_index })
    }

    /// Returns the timestamps for a render pass of `stage`.
    pub(crate) fn render(
        &mut self,
        context: &Context,
        stage: &'static str,
    ) -> Option<wgpu::RenderPassTimestampWrites<'_>> {
        let (query_set, [beginning_of_pass_write_index, end_of_pass_write_index]) = self.next(context, stage)?;
        Some(wgpu::RenderPassTimestampWrites { query_set, beginning_of_pass_write_index, end_of_pass_write_index })
    }

    /// Records that the timestamps so far become readable by the host.
    pub(crate) fn resolve(&mut self, context: &Context, encoder: &mut wgpu::CommandEncoder) -> Result<()> {
        if self.stages.is_empty() {
            return Ok(());
        }
        let count = 2 * self.stages.len() as u32;
        let bytes = u64::from(count) * 8;
        use wgpu::BufferUsages as Usages;
        let resolved = context.buffer("timing.resolved", bytes, Usages::QUERY_RESOLVE | Usages::COPY_SRC)?;
        let staging = context.staging("timing.staging", bytes)?;
        for (set, first) in self.sets.iter().zip((0..count).step_by(SET as usize)) {
            encoder.resolve_query_set(set, 0..SET.min(count - first), &resolved, u64::from(first) * 8);
        }
        encoder.copy_buffer_to_buffer(&resolved, 0, &staging, 0, bytes);
        self.sets.clear();
        self.resolved.push((staging, std::mem::take(&mut self.stages)));
        Ok(())
    }

    /// Returns the seconds of each stage, in the order in which the stages first ran; none without timestamps. The host
    /// has waited for the submission of the last [`Self::resolve`].
    pub(crate) fn finish(self, context: &Context) -> Result<Vec<(&'static str, f64)>> {
        let second = f64::from(context.queue.get_timestamp_period()) * 1e-9;
        let mut sums: Vec<(&'static str, f64)> = Vec::new();
        for (staging, stages) in self.resolved {
            let bytes = 16 * stages.len() as u64;
            let read = |bytes: &[u8]| bytemuck::pod_collect_to_vec(bytes);
            let ticks: Vec<u64> = context.read_done("reading timestamps", staging, bytes, read)?;
            for (stage, pair) in stages.iter().zip(ticks.chunks_exact(2)) {
                let seconds = pair[1].saturating_sub(pair[0]) as f64 * second;
                add(&mut sums, stage, seconds);
            }
        }
        Ok(sums)
    }
}

/// Adds seconds to the sum of a stage.
pub(crate) fn add(sums: &mut Vec<(&'static str, f64)>, stage: &'static str, seconds: f64) {
    match sums.iter_mut().find(|(name, _)| *name == stage) {
        Some((_, sum)) => *sum += seconds,
        None => sums.push((stage, seconds)),
    }
}
