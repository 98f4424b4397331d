//! A file of TIFF in which some entries of directories have other values: the crate `tiff` then decodes pages that it
//! refuses or changes.

use std::collections::{BTreeMap, HashSet};
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};

use crate::volume::Endian;

/// The largest number of entries of a directory that the count of classic TIFF can state.
const MAX_ENTRIES: u64 = 65_535;

/// The tag of the width of pages. This and the next ones are the tags of pages that are volumes.
const WIDTH: u16 = 256;
const LENGTH: u16 = 257;
const ROWS_PER_STRIP: u16 = 278;
const TILE_WIDTH: u16 = 322;
const TILE_LENGTH: u16 = 323;
/// The tag of SGI with the number of sections of a page; the next one has that of a tile.
const IMAGE_DEPTH: u16 = 32997;
const TILE_DEPTH: u16 = 32998;

/// A page that is a volume, whose sections the crate sees as rows below each other.
#[derive(Debug, Clone, Copy)]
pub(super) struct Folded {
    /// The numbers of columns, rows and sections.
    pub(super) size: [u32; 3],
    /// The size of a tile, and the number of tiles along each axis, unless the page is in strips. The crate sees a tile
    /// with several sections as a higher one.
    pub(super) tiles: Option<[[u32; 3]; 2]>,
}

/// An entry of a directory of TIFF.
struct Entry {
    tag: u16,
    /// The place in the file where the type of the entry begins.
    place: u64,
    /// The number of the entry, if it is a single whole one.
    value: Option<u32>,
}

/// A file of TIFF, and the bytes that replace its own.
pub(super) struct PatchedFile {
    file: BufReader<File>,
    endian: Endian,
    /// Whether the file is BigTIFF, whose numbers are wider.
    big: bool,
    at: u64,
    /// The replacing bytes by their places. They do not overlap.
    replaced: BTreeMap<u64, Vec<u8>>,
    /// The pages that are volumes, by the places of their directories.
    folded: BTreeMap<u64, Folded>,
}

impl PatchedFile {
    pub(super) fn new(file: File) -> io::Result<Self> {
        let file = BufReader::new(file);
        let (replaced, folded) = (BTreeMap::new(), BTreeMap::new());
        let mut view = Self { file, endian: Endian::Little, big: false, at: 0, replaced, folded };
        view.seek(SeekFrom::Start(0))?;
        // A file that ends within a directory is refused by the crate.
        view.unfold().ok();
        view.seek(SeekFrom::Start(0))?;
        Ok(view)
    }

    pub(super) fn endian(&self) -> Endian {
        self.endian
    }

    /// Returns the page of the directory at a place, if the page is a volume.
    pub(super) fn folded(&self, directory: u64) -> Option<Folded> {
        self.folded.get(&directory).copied()
    }

    /// Finds the pages that are volumes.
    fn unfold(&mut self) -> io::Result<()> {
        let mut head = [0; 4];
        self.read_exact(&mut head)?;
        self.endian = if head.starts_with(b"MM") { Endian::Big } else { Endian::Little };
        self.big = self.endian.number(&head[2..]) == 43;
        if self.big {
            self.seek(SeekFrom::Start(8))?;
        }
        let wide = if self.big { 8 } else { 4 };
        let (mut directory, mut seen) = (self.number(wide)?, HashSet::new());
        while directory > 0 && seen.insert(directory) {
            let entries = self.entries(directory)?;
            if let Some((folded, values)) = folded(&entries) {
                self.folded.insert(directory, folded);
                self.replace_in(&entries, &values);
            }
            directory = self.number(wide)?;
        }
        Ok(())
    }

    /// Reads the entries of the directory at a place. The file is left behind them.
    fn entries(&mut self, directory: u64) -> io::Result<Vec<Entry>> {
        let (count_size, wide) = if self.big { (8, 8) } else { (2, 4) };
        self.seek(SeekFrom::Start(directory))?;
        let count = self.number(count_size)?.min(MAX_ENTRIES);
        let mut entries = Vec::new();
        for _ in 0..count {
            let tag = self.number(2)? as u16;
            let place = self.at;
            let (kind, values) = (self.number(2)?, self.number(wide)?);
            let mut field = [0; 8];
            self.read_exact(&mut field[..wide])?;
            let size = match kind {
                1 => Some(1),
                3 => Some(2),
                4 => Some(4),
                _ => None,
            };
            let value = size.filter(|_| values == 1).map(|size| self.endian.number(&field[..size]) as u32);
            entries.push(Entry { tag, place, value });
        }
        Ok(entries)
    }

    /// Replaces the numbers of tags in the directory at a place, as far as it has these tags.
    pub(super) fn replace(&mut self, directory: u64, values: &[(u16, u32)]) -> io::Result<()> {
        let before = self.at;
        let entries = self.entries(directory)?;
        self.seek(SeekFrom::Start(before))?;
        self.replace_in(&entries, values);
        Ok(())
    }

    fn replace_in(&mut self, entries: &[Entry], values: &[(u16, u32)]) {
        let wide = if self.big { 8 } else { 4 };
        for Entry { tag, place, .. } in entries {
            if let Some((_, value)) = values.iter().find(|(known, _)| known == tag) {
                // One number of the type LONG, at the left of its field.
                let mut entry = self.written(4, 2);
                entry.extend(self.written(1, wide));
                entry.extend(self.written(*value, 4));
                entry.resize(2 + 2 * wide, 0);
                self.replaced.insert(*place, entry);
            }
        }
    }

    fn number(&mut self, size: usize) -> io::Result<u64> {
        let mut bytes = [0; 8];
        self.read_exact(&mut bytes[..size])?;
        Ok(self.endian.number(&bytes[..size]))
    }

    /// Returns a number in `size` bytes, in the byte order of the file.
    fn written(&self, number: u32, size: usize) -> Vec<u8> {
        let mut bytes = u64::from(number).to_le_bytes()[..size].to_vec();
        if self.endian == Endian::Big {
            bytes.reverse();
        }
        bytes
    }
}

impl Read for PatchedFile {
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

impl Seek for PatchedFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.at = self.file.seek(to)?;
        Ok(self.at)
    }
}

/// Returns the volume that a page is, and the numbers of its tags with which the crate sees the sections as rows.
/// `None` if it is a page of one section, or no whole number of strips has a section.
fn folded(entries: &[Entry]) -> Option<(Folded, Vec<(u16, u32)>)> {
    let get = |tag: u16| entries.iter().find(|entry| entry.tag == tag).and_then(|entry| entry.value);
    let depth = get(IMAGE_DEPTH).filter(|depth| *depth > 1)?;
    let [width, length] = [get(WIDTH)?, get(LENGTH)?];
    let size = [width, length, depth];
    let Some(tile_width) = get(TILE_WIDTH) else {
        let rows = get(ROWS_PER_STRIP).unwrap_or(length).min(length);
        let values = vec![(ROWS_PER_STRIP, rows), (LENGTH, length.checked_mul(depth)?)];
        return length.is_multiple_of(rows).then_some((Folded { size, tiles: None }, values));
    };
    let tile = [tile_width, get(TILE_LENGTH)?, get(TILE_DEPTH).unwrap_or(1)];
    if tile.contains(&0) {
        return None;
    }
    let counts: [u32; 3] = std::array::from_fn(|axis| size[axis].div_ceil(tile[axis]));
    let tall = tile[1].checked_mul(tile[2])?;
    let rows = tall.checked_mul(counts[1])?.checked_mul(counts[2])?;
    let values = vec![(WIDTH, tile[0].checked_mul(counts[0])?), (LENGTH, rows), (TILE_LENGTH, tall)];
    Some((Folded { size, tiles: Some([tile, counts]) }, values))
}
