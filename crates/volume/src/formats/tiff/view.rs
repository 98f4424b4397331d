//! A file of TIFF in which some entries of directories have other values: the crate `tiff` then decodes pages that it
//! refuses or changes.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};

use crate::volume::Endian;

/// The most entries of a directory: what the count of classic TIFF can state.
const MAX_ENTRIES: u64 = 65_535;

/// A file, and the bytes that replace its own.
pub(super) struct View {
    file: BufReader<File>,
    endian: Endian,
    /// Whether it is BigTIFF, whose numbers are wider.
    big: bool,
    at: u64,
    /// Bytes by their places. None overlap.
    replaced: BTreeMap<u64, Vec<u8>>,
}

impl View {
    pub(super) fn new(file: File) -> io::Result<Self> {
        let mut view =
            Self { file: BufReader::new(file), endian: Endian::Little, big: false, at: 0, replaced: BTreeMap::new() };
        let mut head = [0; 4];
        view.seek(SeekFrom::Start(0))?;
        // A file that ends here is refused by the crate.
        if view.read_exact(&mut head).is_ok() {
            view.endian = if head.starts_with(b"MM") { Endian::Big } else { Endian::Little };
            view.big = view.endian.number(&head[2..]) == 43;
        }
        view.seek(SeekFrom::Start(0))?;
        Ok(view)
    }

    pub(super) fn endian(&self) -> Endian {
        self.endian
    }

    /// Replaces the numbers of tags in the directory at a place, as far as it has these tags.
    pub(super) fn replace(&mut self, directory: u64, values: &[(u16, u32)]) -> io::Result<()> {
        let before = self.at;
        let (count_size, wide) = if self.big { (8, 8) } else { (2, 4) };
        self.seek(SeekFrom::Start(directory))?;
        let count = self.number(count_size)?.min(MAX_ENTRIES);
        for _ in 0..count {
            let tag = self.number(2)?;
            let place = self.at;
            self.seek(SeekFrom::Start(place + 2 + 2 * wide))?;
            if let Some((_, value)) = values.iter().find(|(known, _)| u64::from(*known) == tag) {
                // One number of the type LONG, at the left of its field.
                let mut entry = self.written(4, 2);
                entry.extend(self.written(1, wide as usize));
                entry.extend(self.written(*value, 4));
                entry.resize(2 + 2 * wide as usize, 0);
                self.replaced.insert(place, entry);
            }
        }
        self.seek(SeekFrom::Start(before))?;
        Ok(())
    }

    fn number(&mut self, size: usize) -> io::Result<u64> {
        let mut bytes = [0; 8];
        self.read_exact(&mut bytes[..size])?;
        Ok(self.endian.number(&bytes[..size]))
    }

    /// A number in `size` bytes.
    fn written(&self, number: u32, size: usize) -> Vec<u8> {
        let mut bytes = u64::from(number).to_le_bytes()[..size].to_vec();
        if self.endian == Endian::Big {
            bytes.reverse();
        }
        bytes
    }
}

impl Read for View {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let read = self.file.read(out)?;
        let (start, end) = (self.at, self.at + read as u64);
        // An entry has less than 20 bytes.
        for (place, bytes) in self.replaced.range(start.saturating_sub(20)..end) {
            for (at, byte) in (*place..).zip(bytes).filter(|(at, _)| (start..end).contains(at)) {
                out[(at - start) as usize] = *byte;
            }
        }
        self.at = end;
        Ok(read)
    }
}

impl Seek for View {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.at = self.file.seek(to)?;
        Ok(self.at)
    }
}
