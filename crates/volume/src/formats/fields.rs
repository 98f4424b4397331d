//! Binary headers of a fixed layout.

use crate::volume::Endian;

/// Numbers at byte offsets of a header. Bytes past its end read as 0.
pub(super) struct Fields<'a> {
    pub(super) bytes: &'a [u8],
    pub(super) endian: Endian,
}

impl Fields<'_> {
    fn at<const N: usize>(&self, offset: usize) -> [u8; N] {
        let mut bytes = self.bytes.get(offset..).and_then(|b| b.first_chunk::<N>()).copied().unwrap_or([0; N]);
        if self.endian == Endian::Big {
            bytes.reverse();
        }
        bytes
    }

    pub(super) fn u8(&self, offset: usize) -> u8 {
        self.at::<1>(offset)[0]
    }

    pub(super) fn i16(&self, offset: usize) -> i16 {
        i16::from_le_bytes(self.at(offset))
    }

    pub(super) fn i32(&self, offset: usize) -> i32 {
        i32::from_le_bytes(self.at(offset))
    }

    pub(super) fn i64(&self, offset: usize) -> i64 {
        i64::from_le_bytes(self.at(offset))
    }

    pub(super) fn f32(&self, offset: usize) -> f64 {
        f32::from_le_bytes(self.at(offset)).into()
    }

    pub(super) fn f64(&self, offset: usize) -> f64 {
        f64::from_le_bytes(self.at(offset))
    }
}
