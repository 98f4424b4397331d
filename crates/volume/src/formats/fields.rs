//! Binary headers of a fixed layout.

use crate::volume::Endian;

/// The bytes of a header, read as numbers at byte offsets. Bytes past its end read as 0.
pub(super) struct Fields<'a> {
    pub(super) bytes: &'a [u8],
    pub(super) endian: Endian,
}

impl Fields<'_> {
    /// Returns the unsigned whole number of 1 to 8 bytes at an offset.
    pub(super) fn uint(&self, offset: usize, size: usize) -> u64 {
        self.bytes.get(offset..offset + size).map_or(0, |bytes| self.endian.number(bytes))
    }

    /// Returns the whole number of 1 to 8 bytes at an offset.
    pub(super) fn int(&self, offset: usize, size: usize) -> i64 {
        let above = 64 - 8 * size;
        (self.uint(offset, size) << above).cast_signed() >> above
    }

    /// Returns the text of up to `size` bytes at an offset, which a zero byte may end.
    pub(super) fn text(&self, offset: usize, size: usize) -> String {
        let bytes = self.bytes.get(offset..offset + size).unwrap_or_default();
        let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(size);
        bytes.get(..end).map(String::from_utf8_lossy).unwrap_or_default().trim().to_owned()
    }

    /// Returns the number of floating point of 4 or 8 bytes at an offset.
    pub(super) fn float(&self, offset: usize, size: usize) -> f64 {
        match size {
            4 => f32::from_bits(self.uint(offset, 4) as u32).into(),
            _ => f64::from_bits(self.uint(offset, 8)),
        }
    }
}
