//! Sends large data to the device: through two mapped buffers in turn, of which the host fills one while the device
//! copies from the other one. The driver takes longer to allocate such memory than to copy it.

use super::context::Context;
use super::recorder::Recorder;
use crate::error::Result;

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
