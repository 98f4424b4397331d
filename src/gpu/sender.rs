//! Sends large data to the device: through two mapped buffers in turn, of which the host fills one while the device
//! copies from the other one. The driver takes longer to allocate such memory than to copy it.

use std::ops::Range;

use rayon::prelude::*;

use super::context::Context;
use super::recorder::Recorder;
use crate::error::Result;

/// The largest number of bytes of bricks that are sent at a time.
const TOGETHER: u64 = 32 << 20;
/// The work in words that complete errors: "while ...".
const SENDING: &str = "sending voxels";

/// Two buffers in memory that the host writes.
pub(crate) struct Sender<'a> {
    context: &'a Context,
    /// The work in words that complete errors: "while ...".
    doing: &'static str,
    buffers: [wgpu::Buffer; 2],
    /// Number of parts sent so far.
    sent: usize,
}

impl<'a> Sender<'a> {
    /// Makes buffers of `bytes` each for `parts` parts: one buffer, if there is one part.
    pub(crate) fn new(context: &'a Context, doing: &'static str, bytes: u64, parts: usize) -> Result<Self> {
        let buffer = || context.mapped("sender.buffer", bytes);
        let first = buffer()?;
        let second = if parts > 1 { buffer()? } else { first.clone() };
        Ok(Self { context, doing, buffers: [first, second], sent: 0 })
    }

    /// Sends a part, which `fill` writes by [`Context::write_mapped`] and `copy` copies.
    pub(crate) fn send(
        &mut self,
        recorder: &mut Recorder<'_>,
        fill: impl FnOnce(&wgpu::Buffer) -> Result<()>,
        copy: impl FnOnce(&mut Recorder<'_>, &wgpu::Buffer),
    ) -> Result<()> {
        let buffer = &self.buffers[self.sent % 2];
        if self.sent > 1 {
            // The last part but one has arrived: the host waited for it before it sent the last one.
            self.context.map(self.doing, buffer, wgpu::MapMode::Write, buffer.size())?;
        }
        fill(buffer)?;
        if self.sent > 0 {
            self.context.wait(self.doing)?;
        }
        buffer.unmap();
        copy(recorder, buffer);
        recorder.submit();
        self.sent += 1;
        Ok(())
    }
}

/// Sends bricks into a new buffer, one after the other, given the bytes of each. `words` makes a brick, in parallel.
pub(super) fn send_bricks(
    context: &Context,
    (label, usage): (&str, wgpu::BufferUsages),
    bytes: &[u64],
    words: &(dyn Fn(usize) -> Result<Vec<u32>> + Sync),
) -> Result<wgpu::Buffer> {
    let buffer = context.buffer(label, bytes.iter().sum(), usage | wgpu::BufferUsages::COPY_DST)?;
    // Parts of whole bricks. The first byte of each brick, and the end.
    let mut places = vec![0];
    places.extend(bytes.iter().scan(0, |end, of_brick| {
        *end += of_brick;
        Some(*end)
    }));
    let bytes = |part: &Range<usize>| places[part.end] - places[part.start];
    let mut parts: Vec<Range<usize>> = Vec::new();
    for brick in 0..places.len() - 1 {
        match parts.last_mut() {
            Some(part) if bytes(&(part.start..brick + 1)) <= TOGETHER => part.end = brick + 1,
            _ => parts.push(brick..brick + 1),
        }
    }
    let most = parts.iter().map(bytes).max().unwrap_or_default();
    let mut sender = Sender::new(context, SENDING, most, parts.len())?;
    let mut recorder = Recorder::untimed(context);
    for part in parts {
        let (first, bytes) = (places[part.start], bytes(&part));
        let fill = |staging: &wgpu::Buffer| {
            part.into_par_iter().try_for_each(|brick| {
                context.write_mapped(SENDING, staging, places[brick] - first, bytemuck::cast_slice(&words(brick)?))
            })
        };
        sender.send(&mut recorder, fill, |recorder, staging| recorder.copy(staging, &buffer, first, bytes))?;
    }
    Ok(buffer)
}
