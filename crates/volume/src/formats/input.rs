//! A stream of bytes, plain or compressed, with the path of its file and a bound on the bytes left.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use bzip2::bufread::MultiBzDecoder;
use flate2::bufread::{MultiGzDecoder, ZlibDecoder};

use crate::error::{Error, Result};
use crate::files;
use crate::memory::{reserved, samples_in};

/// The first bytes of every gzip stream (RFC 1952).
const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];

/// Deflate expands at most 1032 to 1 (zlib's technical notes, <https://zlib.net/zlib_tech.html>). It bounds what a
/// compressed file can hold, so a header that claims more is refused before memory is reserved.
pub(super) const MAX_EXPANSION: u64 = 1032;

/// Bzip2 expands at most so much: a block of 900 kB, in which 5 bytes stand for 259, takes 32 bytes or more.
const MAX_BZIP2_EXPANSION: u64 = 1 << 21;

/// What may stand between the version of bzip2 and its first bits: the mark of a block, or of the end.
const BZIP2_MARKS: [[u8; 6]; 2] = [[0x31, 0x41, 0x59, 0x26, 0x53, 0x59], [0x17, 0x72, 0x45, 0x38, 0x50, 0x90]];

/// The longest header line that is read, in bytes: a longer line is not text.
const MAX_LINE: u64 = 1 << 20;

/// What all lines of a header and the names after it may take together, in bytes: 65 535 names of 400 characters.
const MAX_HEADER: u64 = 32 << 20;

/// What a line takes besides its characters, in bytes: lines are kept in strings, and strings in tables.
const LINE_OVERHEAD: u64 = 64;

/// A file, and the offset in it at which a stream begins.
type Place = (PathBuf, u64);

/// Compressed streams as files without names that hold what they decompress to, for source files that are read more
/// than once.
#[derive(Debug, Default)]
pub(super) struct Unpacked {
    /// By their places; `None` if it cannot be decompressed, or there is no room for it.
    streams: Mutex<HashMap<Place, Option<Arc<File>>>>,
}

impl Unpacked {
    /// The file of a stream, which `reader` makes if it is not there yet, of at most so many bytes.
    fn file(&self, path: &Path, at: u64, most: u64, reader: impl FnOnce() -> Option<Box<dyn BufRead>>) -> Option<File> {
        let mut streams = self.streams.lock().unwrap_or_else(PoisonError::into_inner);
        let held = streams.entry((path.to_owned(), at)).or_insert_with(|| {
            let mut file = tempfile::tempfile().ok()?;
            let copied = io::copy(&mut reader()?.take(most.saturating_add(1)), &mut file).ok()?;
            if copied > most {
                return None;
            }
            Some(Arc::new(file))
        });
        let mut file = held.as_ref()?.try_clone().ok()?;
        file.rewind().ok()?;
        Some(file)
    }
}

/// A stream of bytes with the file it belongs to.
pub(super) struct Input {
    path: PathBuf,
    reader: Box<dyn BufRead>,
    /// The file, if the bytes left are its last ones as they are stored.
    plain: Option<Arc<File>>,
    /// Upper bound on the bytes left; `None` for streams.
    left: Option<u64>,
    /// What the lines to come may take, in bytes.
    header_left: u64,
    /// Where what is compressed is kept for the next reading.
    unpacked: Option<Arc<Unpacked>>,
}

impl Input {
    /// Opens a file and decompresses it if it begins as gzip does.
    pub(super) fn open(path: &Path) -> Result<Self> {
        Self::open_kept(path, None)
    }

    /// As [`Self::open`]; what it decompresses is kept in `unpacked`, if that is given, or taken from there.
    pub(super) fn open_kept(path: &Path, unpacked: Option<Arc<Unpacked>>) -> Result<Self> {
        let plain = Self { unpacked, ..Self::open_plain(path)? };
        plain.unpacked_if_marked()
    }

    /// Where what is compressed is kept, for other files of the same volume.
    pub(super) fn unpacked(&self) -> Option<Arc<Unpacked>> {
        self.unpacked.clone()
    }

    /// Opens a data file that a header names, as it is. Not even standard input is read unless it is a regular file.
    pub(super) fn open_data(path: &Path) -> Result<Self> {
        Self::open_data_kept(path, None)
    }

    /// As [`Self::open_data`], with `unpacked` as for [`Self::open_kept`].
    pub(super) fn open_data_kept(path: &Path, unpacked: Option<Arc<Unpacked>>) -> Result<Self> {
        let input = Self { unpacked, ..Self::open_plain(path)? };
        if input.left.is_none() {
            return Err(input.error("is not a regular file, as a data file must be"));
        }
        Ok(input)
    }

    /// Opens a file as it is.
    fn open_plain(path: &Path) -> Result<Self> {
        let (file, left) = files::open(path)?;
        let file = Arc::new(file);
        Ok(Self {
            path: path.to_owned(),
            reader: buffered(Arc::clone(&file)),
            plain: left.is_some().then_some(file),
            left,
            header_left: MAX_HEADER,
            unpacked: None,
        })
    }

    /// The bytes left.
    pub(super) fn into_reader(self) -> Box<dyn BufRead> {
        self.reader
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// An [`Error::Format`] about this file.
    pub(super) fn error(&self, reason: impl Into<String>) -> Error {
        Error::format(&self.path, reason)
    }

    /// Upper bound on the bytes left; `None` if there is none.
    pub(super) fn at_most(&self) -> Option<u64> {
        self.left
    }

    /// The number of bytes left; `None` if it is not known, as in a compressed file.
    pub(super) fn exactly_left(&self) -> Option<u64> {
        self.left.filter(|_| self.plain.is_some())
    }

    /// The file and the offset in it at which the remaining bytes begin; `None` if they are not stored as they are.
    pub(super) fn plain_file(&self) -> Result<Option<(File, u64)>> {
        let (Some(file), Some(left)) = (&self.plain, self.left) else { return Ok(None) };
        let read_error = |source| Error::Read { path: self.path.clone(), source };
        let length = file.metadata().map_err(read_error)?.len();
        // A file that has shrunk meanwhile is read as a stream, which reports the missing bytes.
        length.checked_sub(left).map(|offset| Ok((file.try_clone().map_err(read_error)?, offset))).transpose()
    }

    /// The next `n` bytes, or fewer at the end of the file, without consuming them.
    pub(super) fn peek(&mut self, n: usize) -> Result<Vec<u8>> {
        let mut head = Vec::new();
        (&mut self.reader).take(n as u64).read_to_end(&mut head).map_err(|e| self.io_error(e))?;
        let rest = std::mem::replace(&mut self.reader, Box::new(io::empty()));
        self.reader = Box::new(io::Cursor::new(head.clone()).chain(rest));
        Ok(head)
    }

    /// Decompresses the stream if it begins as gzip or bzip2 does.
    pub(super) fn unpacked_if_marked(mut self) -> Result<Self> {
        let head = self.peek(10)?;
        let is_bzip2 = matches!(head.get(..4), Some([b'B', b'Z', b'h', b'1'..=b'9']));
        Ok(match head.get(4..) {
            _ if head.starts_with(&GZIP_MAGIC) => self.gunzip(),
            Some(mark) if is_bzip2 && BZIP2_MARKS.iter().any(|known| known == mark) => self.bunzip2(),
            _ => self,
        })
    }

    /// Decompresses the gzip stream that begins here. Several members count as one stream, as bgzip writes them.
    pub(super) fn gunzip(self) -> Self {
        self.decompressed_once(MAX_EXPANSION, |reader| buffered(MultiGzDecoder::new(reader)))
    }

    /// Decompresses the bzip2 stream that begins here. Several streams count as one, as pbzip2 writes them.
    pub(super) fn bunzip2(self) -> Self {
        self.decompressed_once(MAX_BZIP2_EXPANSION, |reader| buffered(MultiBzDecoder::new(reader)))
    }

    /// Decompresses the zlib stream that begins here, or gzip, which MetaIO accepts as well.
    pub(super) fn inflate(mut self) -> Result<Self> {
        if self.peek(2)? == GZIP_MAGIC {
            return Ok(self.gunzip());
        }
        Ok(self.decompressed_once(MAX_EXPANSION, |reader| buffered(ZlibDecoder::new(reader))))
    }

    /// Decompresses the stream that begins here, or takes what it was decompressed to before. A damaged stream is read
    /// as far as it goes.
    fn decompressed_once(mut self, expansion: u64, f: fn(Box<dyn BufRead>) -> Box<dyn BufRead>) -> Self {
        if let Some(unpacked) = self.unpacked.clone()
            && let Ok(Some((mut file, at))) = self.plain_file()
        {
            let reader = || {
                file.seek(SeekFrom::Start(at)).ok()?;
                Some(f(buffered(file.try_clone().ok()?)))
            };
            if let Some(held) = unpacked.file(&self.path, at, expanded(self.left, MAX_EXPANSION), reader)
                && let Ok(meta) = held.metadata()
            {
                let held = Arc::new(held);
                self.reader = buffered(Arc::clone(&held));
                (self.plain, self.left) = (Some(held), Some(meta.len()));
                return self;
            }
            // The file and its clones have one place to read at.
            if file.seek(SeekFrom::Start(at)).is_ok() {
                self.reader = buffered(file);
            }
        }
        self.decompressed_by(expansion, f)
    }

    /// Decodes pairs of hexadecimal digits; blanks between digits are skipped.
    pub(super) fn unhex(mut self) -> Self {
        self.left = self.left.map(|n| n / 2);
        self.plain = None;
        self.reader = Box::new(BufReader::new(Unhex { digits: self.reader }));
        self
    }

    /// Decodes base64 (RFC 4648); blanks between digits are skipped, and what follows padding is decoded as well.
    pub(super) fn unbase64(mut self) -> Self {
        self.left = self.left.map(|n| n / 4 * 3 + 3);
        self.plain = None;
        self.reader = Box::new(BufReader::new(Unbase64 { digits: self.reader }));
        self
    }

    /// Decompresses the stream that begins here.
    pub(super) fn decompressed(self, f: impl FnOnce(Box<dyn BufRead>) -> Box<dyn BufRead>) -> Self {
        self.decompressed_by(MAX_EXPANSION, f)
    }

    fn decompressed_by(mut self, expansion: u64, f: impl FnOnce(Box<dyn BufRead>) -> Box<dyn BufRead>) -> Self {
        self.left = self.left.map(|_| expanded(self.left, expansion));
        self.plain = None;
        self.reader = f(self.reader);
        self
    }

    /// Skips `n` bytes.
    pub(super) fn skip(&mut self, n: u64) -> Result<()> {
        let passed = match (self.left, self.plain_file()?) {
            (Some(left), _) if n > left => 0,
            // A header can name an offset of terabytes in a file of holes.
            (_, Some((mut file, offset))) => {
                file.seek(SeekFrom::Start(offset + n)).map_err(|e| self.io_error(e))?;
                self.reader = buffered(file);
                n
            }
            _ => io::copy(&mut (&mut self.reader).take(n), &mut io::sink()).map_err(|e| self.io_error(e))?,
        };
        if passed < n {
            return Err(self.error(format!("ends before byte {n}, where its samples should begin")));
        }
        self.left = self.left.map(|left| left - n);
        Ok(())
    }

    /// Skips all but the last `n` bytes, and refuses to skip more than `most`.
    pub(super) fn skip_to_last(mut self, n: u64, most: u64) -> Result<Self> {
        let too_few = |found: u64| format!("is cut short: its samples need {n} bytes, {found} are there");
        if let Some(left) = self.exactly_left() {
            let before = left.checked_sub(n).ok_or_else(|| self.error(too_few(left)))?;
            self.skip(before)?;
            return Ok(self);
        }
        // The length of a stream is known at its end: the last bytes go round in a buffer.
        if let Some(left) = self.left.filter(|left| *left < n) {
            return Err(self.error(format!("{} at most", too_few(left))));
        }
        let mut last: Vec<u8> = reserved(n, || samples_in(&self.path))?;
        (&mut self.reader).take(n).read_to_end(&mut last).map_err(|e| self.io_error(e))?;
        if (last.len() as u64) < n {
            return Err(self.error(too_few(last.len() as u64)));
        }
        let (mut at, mut skipped, mut block) = (0, 0_u64, [0; 1 << 12]);
        loop {
            let got = self.fill(&mut block)?;
            if got == 0 || n == 0 {
                break;
            }
            skipped += got as u64;
            if skipped > most {
                return Err(self.error(format!("has over {most} bytes before its samples")));
            }
            for &byte in block.iter().take(got) {
                last[at] = byte;
                at = if at + 1 == last.len() { 0 } else { at + 1 };
            }
        }
        last.rotate_left(at);
        self.left = Some(n);
        self.reader = Box::new(io::Cursor::new(last));
        Ok(self)
    }

    /// Skips `n` lines of any length.
    pub(super) fn skip_lines(&mut self, n: u64) -> Result<()> {
        for _ in 0..n {
            let passed = self.reader.skip_until(b'\n').map_err(|e| self.io_error(e))?;
            if passed == 0 {
                return Err(self.error(format!("ends before line {n}, where its samples should begin")));
            }
            self.left = self.left.map(|left| left.saturating_sub(passed as u64));
        }
        Ok(())
    }

    /// The next line without LF or CRLF; `None` at the end of the file. Bytes that are not UTF-8 become U+FFFD.
    pub(super) fn line(&mut self) -> Result<Option<String>> {
        let mut line = Vec::new();
        (&mut self.reader).take(MAX_LINE).read_until(b'\n', &mut line).map_err(|e| self.io_error(e))?;
        if line.is_empty() {
            return Ok(None);
        }
        let length = line.len() as u64;
        self.left = self.left.map(|left| left.saturating_sub(length));
        match self.header_left.checked_sub(length + LINE_OVERHEAD) {
            Some(left) => self.header_left = left,
            None => return Err(self.error(format!("has a header of over {} MiB", MAX_HEADER >> 20))),
        }
        if line.pop_if(|c| *c == b'\n').is_none() && length == MAX_LINE {
            return Err(self.error(format!("has a header line of over {MAX_LINE} bytes")));
        }
        line.pop_if(|c| *c == b'\r');
        Ok(Some(String::from_utf8_lossy(&line).into_owned()))
    }

    /// Skips all up to and including the next byte of this value.
    pub(super) fn skip_past(&mut self, byte: u8) -> Result<()> {
        let passed = self.reader.skip_until(byte).map_err(|e| self.io_error(e))?;
        self.left = self.left.map(|left| left.saturating_sub(passed as u64));
        Ok(())
    }

    /// What is between the next `<` and the `>` after it; `None` at the end of the file. A comment ends with its own
    /// mark.
    pub(super) fn tag(&mut self) -> Result<Option<String>> {
        self.skip_past(b'<')?;
        let mut tag = Vec::new();
        loop {
            let before = tag.len();
            let room = MAX_LINE.saturating_sub(before as u64);
            (&mut self.reader).take(room).read_until(b'>', &mut tag).map_err(|e| self.io_error(e))?;
            self.left = self.left.map(|left| left.saturating_sub((tag.len() - before) as u64));
            match tag.pop_if(|c| *c == b'>') {
                Some(_) if tag.starts_with(b"!--") && !tag.ends_with(b"--") => tag.push(b'>'),
                Some(_) => return Ok(Some(String::from_utf8_lossy(&tag).into_owned())),
                None if tag.len() as u64 == MAX_LINE => {
                    return Err(self.error(format!("has an XML tag of over {MAX_LINE} bytes")));
                }
                None => return Ok(None),
            }
        }
    }

    /// The next `n` bytes; an error if there are fewer.
    pub(super) fn bytes(&mut self, n: usize) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        (&mut self.reader).take(n as u64).read_to_end(&mut bytes).map_err(|e| self.io_error(e))?;
        if bytes.len() < n {
            return Err(self.error(format!("is cut short: its header has {} of {n} bytes", bytes.len())));
        }
        self.left = self.left.map(|left| left.saturating_sub(n as u64));
        Ok(bytes)
    }

    /// Fills `out` as far as there are bytes, and returns their number.
    pub(super) fn fill(&mut self, out: &mut [u8]) -> Result<usize> {
        let mut done = 0;
        while done < out.len() {
            match self.reader.read(&mut out[done..]) {
                Ok(0) => break,
                Ok(n) => done += n,
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                // Decompressors report a truncated stream this way; the caller reports the missing bytes.
                Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => break,
                Err(e) => return Err(self.io_error(e)),
            }
        }
        self.left = self.left.map(|left| left.saturating_sub(done as u64));
        Ok(done)
    }

    /// Verifies the checksum of a compressed stream if the samples were its last bytes.
    ///
    /// Reading one byte past the samples makes the decompressor check. If more data follows, it is not part of the
    /// volume and is ignored.
    pub(super) fn verify_checksum(&mut self) -> Result<()> {
        match self.reader.read(&mut [0]) {
            // Bzip2 has one error for all that is wrong.
            Err(e) if ["checksum", "bz2", "bzip2"].iter().any(|word| e.to_string().contains(word)) => {
                Err(self.io_error(e))
            }
            _ => Ok(()),
        }
    }

    /// Reads the next token between blanks and commas; false at the end of the file. Tokens are cut at 64 bytes: no
    /// number of a sample type needs more.
    pub(super) fn token(&mut self, token: &mut String) -> Result<bool> {
        token.clear();
        loop {
            let (used, done) = {
                let available = match self.reader.fill_buf() {
                    Ok(bytes) => bytes,
                    Err(e) => return Err(self.io_error(e)),
                };
                if available.is_empty() {
                    return Ok(!token.is_empty());
                }
                let mut used = 0;
                let mut done = false;
                for &c in available {
                    used += 1;
                    if c.is_ascii_whitespace() || c == b',' {
                        done = !token.is_empty();
                        if done {
                            break;
                        }
                    } else if token.len() < 64 {
                        token.push(char::from(c));
                    }
                }
                (used, done)
            };
            self.reader.consume(used);
            if done {
                return Ok(true);
            }
        }
    }

    /// A failed read as [`Error::Format`] if the content is at fault, otherwise as [`Error::Read`].
    fn io_error(&self, source: io::Error) -> Error {
        match source.kind() {
            io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput | io::ErrorKind::UnexpectedEof => {
                self.error(format!("is damaged: {source}"))
            }
            _ => Error::Read { path: self.path.clone(), source },
        }
    }
}

/// The most bytes that so many stand for. Short streams have room for what surrounds them.
fn expanded(packed: Option<u64>, expansion: u64) -> u64 {
    packed.map_or(u64::MAX, |n| n.saturating_mul(expansion).saturating_add(1 << 16))
}

/// A reader with a buffer of 64 KiB.
fn buffered(reader: impl Read + 'static) -> Box<dyn BufRead> {
    Box::new(BufReader::with_capacity(1 << 16, reader))
}

/// Reads bytes from base64.
struct Unbase64 {
    digits: Box<dyn BufRead>,
}

impl Unbase64 {
    /// The next four digits, as up to three bytes.
    fn next(&mut self) -> io::Result<([u8; 3], usize)> {
        let (mut bits, mut digits, mut padding) = (0_u32, 0, 0);
        let mut c = [0];
        while digits < 4 {
            if self.digits.read(&mut c)? == 0 {
                // An end within four digits leaves their bytes out: whoever needs them reports it.
                return Ok(([0; 3], 0));
            }
            let digit = match c[0] {
                b'A'..=b'Z' if padding == 0 => c[0] - b'A',
                b'a'..=b'z' if padding == 0 => c[0] - b'a' + 26,
                b'0'..=b'9' if padding == 0 => c[0] - b'0' + 52,
                b'+' if padding == 0 => 62,
                b'/' if padding == 0 => 63,
                b'=' if digits >= 2 => {
                    padding += 1;
                    0
                }
                c if c.is_ascii_whitespace() => continue,
                // The tag after the text.
                b'<' if digits == 0 => return Ok(([0; 3], 0)),
                c => {
                    let reason = format!("{:?} is no digit of base64", char::from(c));
                    return Err(io::Error::new(io::ErrorKind::InvalidData, reason));
                }
            };
            bits = bits << 6 | u32::from(digit);
            digits += 1;
        }
        let [_, bytes @ ..] = bits.to_be_bytes();
        Ok((bytes, 3 - padding))
    }
}

impl Read for Unbase64 {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let mut done = 0;
        // Whole groups alone; the buffer around this reader has room for many.
        while out.len() - done >= 3 {
            let (bytes, n) = self.next()?;
            out[done..done + n].copy_from_slice(&bytes[..n]);
            done += n;
            if n < 3 {
                break;
            }
        }
        Ok(done)
    }
}

/// Reads bytes from pairs of hexadecimal digits.
struct Unhex {
    digits: Box<dyn BufRead>,
}

impl Read for Unhex {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let mut digit = || -> io::Result<Option<u8>> {
            let mut c = [0];
            loop {
                match self.digits.read(&mut c)? {
                    0 => return Ok(None),
                    _ if c[0].is_ascii_whitespace() => {}
                    _ => {
                        let digit = char::from(c[0]).to_digit(16).map(|d| d as u8);
                        return digit.map(Some).ok_or_else(|| {
                            io::Error::new(
                                io::ErrorKind::InvalidData,
                                format!("{:?} is no hex digit", char::from(c[0])),
                            )
                        });
                    }
                }
            }
        };
        for (n, byte) in out.iter_mut().enumerate() {
            match (digit()?, digit()?) {
                (Some(high), Some(low)) => *byte = high << 4 | low,
                _ => return Ok(n),
            }
        }
        Ok(out.len())
    }
}
