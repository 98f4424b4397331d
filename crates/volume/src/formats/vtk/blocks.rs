//! Compressed arrays of VTK's XML: blocks of equal size, each compressed on its own.

use std::io::{self, BufRead, Read};

use flate2::bufread::ZlibDecoder;

use crate::error::{Damage, Result, refuse, refuse_if};
use crate::formats::input::{Input, MAX_EXPANSION, buffered};

/// The codec of compressed blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum BlockCodec {
    Zlib,
    Lz4,
}

/// The largest number of blocks of an array. VTK writes blocks of 32 KiB and more: this is half a terabyte.
const MAX_BLOCKS: u64 = 1 << 24;

/// Reads the table of blocks at the start of `input`, of numbers that `number` reads. The rest of `input` is
/// decompressed.
pub(super) fn decompressed(
    mut input: Input,
    codec: BlockCodec,
    mut number: impl FnMut(&mut Input) -> Result<u64>,
) -> Result<Input> {
    let (count, size, last) = (number(&mut input)?, number(&mut input)?, number(&mut input)?);
    refuse_if!(count > MAX_BLOCKS, input, "claims {count} compressed blocks, expected at most {MAX_BLOCKS}");
    let packed = (0..count).map(|_| number(&mut input)).collect::<Result<Vec<u64>>>()?;
    let mut sizes: Vec<[u64; 2]> = packed.into_iter().map(|packed| [packed, size]).collect();
    if let Some([_, size]) = sizes.last_mut()
        && last > 0
    {
        *size = last;
    }
    // No codec expands more, so a block of few bytes cannot claim all memory.
    if let Some([packed, size]) = sizes.iter().find(|[packed, size]| *size / MAX_EXPANSION > *packed) {
        refuse!(input, "claims that {packed} bytes decompress to {size}");
    }
    let blocks = |packed| Blocks { packed, codec, sizes: sizes.into_iter(), block: io::Cursor::default() };
    input.decompress(MAX_EXPANSION, |packed| buffered(blocks(packed)));
    Ok(input)
}

/// A reader of the bytes of compressed blocks.
struct Blocks {
    packed: Box<dyn BufRead>,
    codec: BlockCodec,
    /// The numbers of compressed and of decompressed bytes of each block to come.
    sizes: std::vec::IntoIter<[u64; 2]>,
    block: io::Cursor<Vec<u8>>,
}

impl Blocks {
    fn next(&mut self, [packed, size]: [u64; 2]) -> io::Result<()> {
        // Vectors grow with the bytes in the file, not with the claimed size.
        let mut bytes = Vec::new();
        (&mut self.packed).take(packed).read_to_end(&mut bytes)?;
        if (bytes.len() as u64) < packed {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let mut block = std::mem::take(&mut self.block).into_inner();
        block.clear();
        match self.codec {
            BlockCodec::Zlib => {
                // One byte more shows a block that is too long.
                ZlibDecoder::new(bytes.as_slice()).take(size.saturating_add(1)).read_to_end(&mut block)?;
            }
            BlockCodec::Lz4 => {
                let length = usize::try_from(size).map_err(|_| Damage.error(format!("a block of {size} bytes")))?;
                block.try_reserve_exact(length).map_err(|_| io::ErrorKind::OutOfMemory)?;
                block.resize(length, 0);
                let length = lz4_flex::block::decompress_into(&bytes, &mut block)
                    .map_err(|error| Damage.error(format!("LZ4: {error}")))?;
                block.truncate(length);
            }
        }
        refuse_if!(block.len() as u64 != size, Damage, "a block of {} bytes, expected {size}", block.len());
        self.block = io::Cursor::new(block);
        Ok(())
    }
}

impl Read for Blocks {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        loop {
            let n = self.block.read(out)?;
            if n > 0 || out.is_empty() {
                return Ok(n);
            }
            match self.sizes.next() {
                Some(sizes) => self.next(sizes)?,
                None => return Ok(0),
            }
        }
    }
}
