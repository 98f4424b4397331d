//! Blosc's container (<https://github.com/Blosc/c-blosc/blob/main/README_CHUNK_FORMAT.rst>): blocks, each shuffled and
//! compressed on its own.

use std::io::{self, Read};

use flate2::bufread::ZlibDecoder;

use super::content::zstd;
use crate::error::{Damage, refuse, refuse_if};

/// The number of bytes of the header.
const HEADER: usize = 16;

/// The largest number of parts of a block, and the least number of bytes of a part.
const MAX_SPLITS: usize = 16;
const MIN_PART: usize = 128;

/// Decompresses the content of a container, at most `most` bytes.
pub(super) fn decompressed(bytes: &[u8], most: usize) -> io::Result<Vec<u8>> {
    let cut = || Damage.error("Blosc: cut short");
    let number = |at: usize| {
        let four = bytes.get(at..).and_then(<[u8]>::first_chunk::<4>);
        four.map(|four| u32::from_le_bytes(*four) as usize).ok_or_else(cut)
    };
    let (size, block_size, packed) = (number(4)?, number(8)?, number(12)?);
    let (flags, element) = (bytes[2], usize::from(bytes[3]).max(1));
    if size > most || packed > bytes.len() {
        refuse!(Damage, "Blosc: {packed} bytes that hold {size}, expected at most {most}");
    }
    if flags & 2 != 0 {
        return bytes.get(HEADER..HEADER + size).map(<[u8]>::to_vec).ok_or_else(cut);
    }
    refuse_if!(block_size == 0 && size > 0, Damage, "Blosc: blocks of 0 bytes");
    let blocks = size.div_ceil(block_size.max(1));
    let mut content = Vec::new();
    for block in 0..blocks {
        let length = block_size.min(size - block * block_size);
        let splits = flags & 0x10 == 0
            && element <= MAX_SPLITS
            && block_size / element >= MIN_PART
            && length == block_size
            && block_size % element == 0;
        let parts = if splits { element } else { 1 };
        let mut at = number(HEADER + 4 * block)?;
        let mut whole = Vec::new();
        for _ in 0..parts {
            let packed = number(at)?;
            let Some(part) = bytes.get(at + 4..).and_then(|rest| rest.get(..packed)) else {
                refuse!(Damage, "Blosc: a block that ends behind its container");
            };
            at += 4 + packed;
            let (before, wanted) = (whole.len(), length / parts);
            if packed == wanted {
                whole.extend_from_slice(part);
            } else {
                append(flags >> 5, part, wanted, &mut whole)?;
            }
            let found = whole.len() - before;
            refuse_if!(found != wanted, Damage, "Blosc: a block of {found} bytes, expected {wanted}");
        }
        if flags & 1 != 0 && element > 1 {
            whole = unshuffled(&whole, element);
        } else if flags & 4 != 0 && length >= element {
            whole = bits_unshuffled(whole, element);
        }
        content.extend_from_slice(&whole);
    }
    Ok(content)
}

/// Appends the content of a part, at most `most` bytes, by the compressor of this number.
fn append(compressor: u8, part: &[u8], most: usize, out: &mut Vec<u8>) -> io::Result<()> {
    match compressor {
        0 => blosclz(part, most, out)?,
        1 => {
            let content = lz4_flex::block::decompress(part, most);
            out.extend(content.map_err(|error| Damage.error(format!("Blosc: {error}")))?);
        }
        2 => refuse!(Damage, "Blosc: compressed by Snappy, which is not read"),
        3 => drop(ZlibDecoder::new(part).take(most as u64 + 1).read_to_end(out)?),
        4 => out.extend(zstd(part, most)?),
        other => refuse!(Damage, "Blosc: the compressor {other} is unknown"),
    }
    Ok(())
}

/// Decompresses BloscLZ, a kind of FastLZ: runs of literals, and matches up to 8191 + 65535 bytes back.
fn blosclz(packed: &[u8], most: usize, out: &mut Vec<u8>) -> io::Result<()> {
    const NEAR: usize = 8191;
    let start = out.len();
    let mut bytes = packed.iter().map(|byte| usize::from(*byte));
    let mut next = || bytes.next();
    let cut = || Damage.error("BloscLZ: cut short");
    // The first token is one of literals.
    let mut token = next().map(|first| first & 31);
    while let Some(control) = token {
        if control < 32 {
            for _ in 0..=control {
                out.push(next().ok_or_else(cut)? as u8);
            }
        } else {
            let mut length = (control >> 5) - 1;
            if length == 6 {
                loop {
                    let more = next().ok_or_else(cut)?;
                    length += more;
                    if more != 255 || length > most {
                        break;
                    }
                }
            }
            let low = next().ok_or_else(cut)?;
            let mut back = ((control & 31) << 8) + low;
            if back == NEAR {
                back += next().ok_or_else(cut)? << 8;
                back += next().ok_or_else(cut)?;
            }
            let from = out.len().checked_sub(back + 1).filter(|from| *from >= start);
            let from = from.ok_or_else(|| Damage.error("BloscLZ: a match before the first byte"))?;
            refuse_if!(out.len() - start + length + 3 > most, Damage, "BloscLZ: more bytes than expected");
            // A match may reach into what it makes.
            for at in from..from + length + 3 {
                out.push(out[at]);
            }
        }
        refuse_if!(out.len() - start > most, Damage, "BloscLZ: more bytes than expected");
        token = next();
    }
    Ok(())
}

/// Returns bytes by elements, from all first bytes of elements, then all second bytes, and so on. Bytes behind the last
/// whole element stay.
pub(super) fn unshuffled(bytes: &[u8], element: usize) -> Vec<u8> {
    let count = bytes.len() / element;
    let mut out = bytes.to_vec();
    for (byte, row) in bytes[..count * element].chunks_exact(count.max(1)).enumerate() {
        row.iter().zip(out[byte..].iter_mut().step_by(element)).for_each(|(from, to)| *to = *from);
    }
    out
}

/// Returns bytes by elements, from the lowest bits of all elements, then the next bits, and so on. A number of elements
/// that is no multiple of 8 is returned unchanged.
fn bits_unshuffled(bytes: Vec<u8>, element: usize) -> Vec<u8> {
    let count = bytes.len() / element;
    if count == 0 || !count.is_multiple_of(8) {
        return bytes;
    }
    let mut out = bytes.clone();
    out[..count * element].fill(0);
    for (bit, row) in bytes[..count * element].chunks_exact(count / 8).enumerate() {
        let (byte, bit) = (bit / 8, bit % 8);
        for (n, eight) in row.iter().enumerate() {
            for k in 0..8 {
                out[(8 * n + k) * element + byte] |= (eight >> k & 1) << bit;
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matches_reach_back_and_into_themselves() {
        let decoded = |packed: &[u8], most: usize| {
            let mut out = vec![7];
            blosclz(packed, most, &mut out).map(|()| out[1..].to_vec()).map_err(|error| error.to_string())
        };
        // Two literals, three bytes from one back, a literal.
        assert_eq!(decoded(&[1, b'a', b'b', 32, 0, 0, b'c'], 6).unwrap(), b"abbbbc");
        // A long match: 6 + 2 + 3 bytes from two back.
        assert_eq!(decoded(&[1, b'a', b'b', 7 << 5, 2, 1], 13).unwrap(), b"ababababababa");
        assert!(decoded(&[1, b'a', b'b', 7 << 5, 2, 1], 12).unwrap_err().contains("more bytes"));
        assert!(decoded(&[0, b'a', 32, 1], 9).unwrap_err().contains("before the first"));
        assert!(decoded(&[3, b'a'], 9).unwrap_err().contains("cut short"));
        assert_eq!(decoded(&[], 9).unwrap(), b"");
    }

    #[test]
    fn shuffles_are_undone() {
        assert_eq!(unshuffled(&[1, 3, 5, 2, 4, 6, 9], 2), [1, 2, 3, 4, 5, 6, 9]);
        let rows: Vec<u8> = (0..16).map(|bit| if bit % 5 == 0 { 0b1000_0001 } else { 0 }).collect();
        let set = [0b0010_0001, 0b1000_0100];
        let mut expected = [0; 16];
        expected[..2].copy_from_slice(&set);
        expected[14..].copy_from_slice(&set);
        assert_eq!(bits_unshuffled(rows, 2), expected);
        assert_eq!(bits_unshuffled(vec![1, 2, 3], 1), [1, 2, 3]);
    }
}
