//! Archives of ZIP: the members that the central directory lists, stored or deflated
//! (<https://pkware.cachefly.net/webdocs/casestudies/APPNOTE.TXT>).
//!
//! The crate `zip` is not used: its readers borrow the archive, so a stored member could not stay in its file.

use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use flate2::Crc;
use flate2::bufread::DeflateDecoder;

use super::fields::Fields;
use super::input::{Input, MAX_EXPANSION, Unpacked, buffered};
use super::origin::FileOrigin;
use super::placement::plain_name;
use crate::error::{Damage, Error, Result, Subject, refuse, refuse_if};
use crate::volume::Endian;

/// The first bytes of an archive: the header of its first member.
pub(super) const MAGIC: &[u8] = b"PK\x03\x04";

/// The number of bytes of the record at the end of an archive, without its comment of at most 65 535 bytes.
const END: usize = 22;

/// The number of bytes of the locator that precedes `END` in ZIP64.
const LOCATOR: u64 = 20;

/// The number of bytes of the header before the name of a member.
const LOCAL: usize = 30;

/// The number of bytes of an entry of the directory before its name.
const ENTRY: usize = 46;

/// The largest directory that is read, in bytes: 65 535 members with names of 200 characters.
const MAX_DIRECTORY: u64 = 16 << 20;

/// An archive with its directory.
pub(super) struct Archive {
    path: PathBuf,
    pub(super) origin: FileOrigin,
    pub(super) members: Vec<Member>,
}

/// A member as the directory states it.
pub(super) struct Member {
    pub(super) name: String,
    flags: i64,
    method: i64,
    crc: u32,
    /// The number of bytes in the archive; `size` is the number of bytes that they expand to.
    pub(super) packed: u64,
    pub(super) size: u64,
    /// The place in the archive of the header before the bytes.
    at: u64,
}

impl Archive {
    /// Opens the archive at the start of `input` and reads its directory.
    pub(super) fn open(input: &Input) -> Result<Self> {
        let path = input.path().to_owned();
        let Some((file, _)) = input.plain_file()? else {
            refuse!(input, "is an archive in a stream or in gzip: write it to a file, decompressed");
        };
        Self::at(path, FileOrigin::File(Arc::new(file)))
    }

    /// Reads the directory of an archive.
    pub(super) fn at(path: PathBuf, origin: FileOrigin) -> Result<Self> {
        let (count, at, size) = directory(&path, &origin)?;
        refuse_if!(size > MAX_DIRECTORY, path, "has a directory of {size} bytes, expected at most {MAX_DIRECTORY}");
        let bytes = read_at(&path, &origin, at, size)?;
        let members = members(&bytes).filter(|members| members.len() as u64 == count);
        let members = members.ok_or_else(|| path.error("is damaged: its directory does not list its members"))?;
        Ok(Self { path, origin, members })
    }

    /// Opens a member, decompressed. Its bytes end in an error if their checksum is wrong, unless they are stored.
    /// Decompressed bytes are kept in `unpacked`, if that is given.
    pub(super) fn member(&self, member: &Member, unpacked: Option<Arc<Unpacked>>) -> Result<Input> {
        let Member { name, packed, size, .. } = member;
        let mut path = self.path.clone().into_os_string();
        path.push(format!(":{}", plain_name(name.strip_suffix(".npy").unwrap_or(name)).unwrap_or_default()));
        let path = PathBuf::from(path);
        let at = self.place(member, &path)?;
        let input = match &self.origin {
            FileOrigin::File(file) => Input::part(path, file, at, *packed)?.keeping(unpacked),
            #[cfg(feature = "remote")]
            FileOrigin::Url(_) => Input::of_bytes(&path, read_at(&path, &self.origin, at, *packed)?),
        };
        match member.method {
            0 if packed == size => Ok(input),
            0 => refuse!(input, "is damaged: {packed} stored bytes cannot be {size}"),
            8 => {
                let (size, crc) = (*size, member.crc);
                let mut input = input.decompressed_once(MAX_EXPANSION, move |reader| {
                    let checked = Checked { reader: DeflateDecoder::new(reader), left: size, sum: Crc::new(), crc };
                    buffered(checked)
                });
                input.limit(size);
                Ok(input)
            }
            other => refuse!(input, "is compressed by method {other} of ZIP, expected 0 (stored) or 8 (deflated)"),
        }
    }

    /// Returns the place of the bytes of a member, behind its header.
    fn place(&self, member: &Member, path: &Path) -> Result<u64> {
        let at = member.at;
        let header = read_at(path, &self.origin, at, LOCAL as u64)?;
        refuse_if!(!header.starts_with(MAGIC), path, "is damaged: the directory leads to no member at byte {at}");
        refuse_if!(member.flags & 1 != 0, path, "is encrypted");
        let fields = Fields { bytes: &header, endian: Endian::Little };
        Ok(at.saturating_add(LOCAL as u64 + fields.uint(26, 2) + fields.uint(28, 2)))
    }

    /// Returns the place and the number of the bytes of a member; `None` if they are compressed.
    #[cfg_attr(not(feature = "zarr"), expect(dead_code, reason = "for chunks of Zarr"))]
    pub(super) fn stored(&self, member: &Member, path: &Path) -> Result<Option<(u64, u64)>> {
        let is_stored = member.method == 0 && member.packed == member.size;
        is_stored.then(|| Ok((self.place(member, path)?, member.size))).transpose()
    }
}

/// Returns the number of members, and the place and the size of the directory.
fn directory(path: &Path, origin: &FileOrigin) -> Result<(u64, u64, u64)> {
    let tail = origin.edge(false, (END + usize::from(u16::MAX)) as u64);
    let (tail, length) = tail.map_err(|source| Error::of_content(path, source))?;
    let ends = |at: &usize| {
        let fields = Fields { bytes: &tail[*at..], endian: Endian::Little };
        tail[*at..].starts_with(b"PK\x05\x06") && at + END + fields.uint(20, 2) as usize == tail.len()
    };
    let Some(end) = (0..=tail.len().saturating_sub(END)).rev().find(ends) else {
        refuse!(path, "is cut short, or no archive of ZIP: it has no directory at its end");
    };
    let fields = Fields { bytes: &tail[end..], endian: Endian::Little };
    let (mut count, mut size, mut at) = (fields.uint(10, 2), fields.uint(12, 4), fields.uint(16, 4));
    let mut ends_at = length - tail.len() as u64 + end as u64;
    if count == 0xffff || size == 0xffff_ffff || at == 0xffff_ffff {
        let locator = match ends_at.checked_sub(LOCATOR) {
            Some(before) => read_at(path, origin, before, LOCATOR)?,
            None => Vec::new(),
        };
        if locator.starts_with(b"PK\x06\x07") {
            ends_at = Fields { bytes: &locator, endian: Endian::Little }.uint(8, 8);
            let record = read_at(path, origin, ends_at, 56)?;
            refuse_if!(!record.starts_with(b"PK\x06\x06"), path, "is damaged: its record of ZIP64 is missing");
            let fields = Fields { bytes: &record, endian: Endian::Little };
            (count, size, at) = (fields.uint(32, 8), fields.uint(40, 8), fields.uint(48, 8));
        }
    }
    let is_inside = at.checked_add(size).is_some_and(|behind| behind <= ends_at);
    refuse_if!(!is_inside, path, "is damaged: its directory of {size} bytes at byte {at} does not precede its end");
    Ok((count, at, size))
}

/// Returns the members that a directory lists; `None` if it is damaged.
fn members(mut bytes: &[u8]) -> Option<Vec<Member>> {
    let mut members = Vec::new();
    while !bytes.is_empty() {
        let fields = Fields { bytes, endian: Endian::Little };
        if !bytes.starts_with(b"PK\x01\x02") {
            return None;
        }
        let [name, extra, comment] = [28, 30, 32].map(|at| fields.uint(at, 2) as usize);
        let (entry, rest) = bytes.split_at_checked(ENTRY + name + extra + comment)?;
        let (mut size, mut packed, mut at) = (fields.uint(24, 4), fields.uint(20, 4), fields.uint(42, 4));
        // ZIP64 has the numbers that do not fit, in this order.
        let mut wide = zip64(&entry[ENTRY + name..ENTRY + name + extra]).chunks_exact(8);
        for number in [&mut size, &mut packed, &mut at] {
            if *number == 0xffff_ffff {
                *number = Endian::Little.number(wide.next()?);
            }
        }
        let name = String::from_utf8_lossy(&entry[ENTRY..ENTRY + name]).into_owned();
        let (flags, method, crc) = (fields.int(8, 2), fields.int(10, 2), fields.uint(16, 4) as u32);
        members.push(Member { name, flags, method, crc, packed, size, at });
        bytes = rest;
    }
    Some(members)
}

/// Returns the extra field of ZIP64; empty if there is none.
fn zip64(mut extra: &[u8]) -> &[u8] {
    while let Some((head, rest)) = extra.split_first_chunk::<4>() {
        let [id, size] = [&head[..2], &head[2..]].map(|bytes| Endian::Little.number(bytes));
        let Some((field, behind)) = rest.split_at_checked(size as usize) else { break };
        if id == 1 {
            return field;
        }
        extra = behind;
    }
    &[]
}

/// Reads the `size` bytes from byte `at` of an archive.
fn read_at(path: &Path, origin: &FileOrigin, at: u64, size: u64) -> Result<Vec<u8>> {
    origin.range(at, size).map_err(|source| match source.kind() {
        io::ErrorKind::InvalidData => path.error(format!("is cut short: {size} bytes from byte {at} are not there")),
        _ => Error::read(path)(source),
    })
}

/// A reader of a decompressed member that ends in an error if the checksum is not `crc`.
struct Checked<R> {
    reader: R,
    /// The number of bytes that are not read yet.
    left: u64,
    sum: Crc,
    crc: u32,
}

impl<R: Read> Read for Checked<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let room = out.len().min(usize::try_from(self.left).unwrap_or(usize::MAX));
        let read = self.reader.read(&mut out[..room])?;
        self.sum.update(&out[..read]);
        self.left -= read as u64;
        // A member that ends early has no right sum either.
        if (self.left == 0 && self.sum.sum() != self.crc) || (read == 0 && room > 0) {
            refuse!(Damage, "the checksum is wrong");
        }
        Ok(read)
    }
}
