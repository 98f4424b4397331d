//! A stream of bytes, plain or compressed, with the path of its file and a bound on the bytes left.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use bzip2::bufread::MultiBzDecoder;
use flate2::bufread::{MultiGzDecoder, ZlibDecoder};

use crate::error::{Damage, Error, Result, Subject, refuse, refuse_if};
use crate::files;
use crate::memory::{reserved, samples_in};

/// The first bytes of every gzip stream (RFC 1952).
const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];

/// The largest expansion of deflate: 1032 to 1 (zlib's technical notes, <https://zlib.net/zlib_tech.html>). It bounds
/// what a compressed file can hold, so a header that claims more is refused before memory is reserved.
pub(super) const MAX_EXPANSION: u64 = 1032;

/// The largest expansion of bzip2: a block of 900 kB, in which 5 bytes stand for 259, has 32 bytes or more.
const MAX_BZIP2_EXPANSION: u64 = 1 << 21;

/// The bytes behind the version of bzip2: the mark of a block, or the mark of the end.
const BZIP2_MARKS: [[u8; 6]; 2] = [[0x31, 0x41, 0x59, 0x26, 0x53, 0x59], [0x17, 0x72, 0x45, 0x38, 0x50, 0x90]];

/// The longest header line that is read, in bytes: a longer line is not text.
const MAX_LINE: u64 = 1 << 20;

/// The largest number of bytes of all lines of a header and the names after it: 65 535 names of 400 characters.
const MAX_HEADER: u64 = 32 << 20;

/// The bytes that a line costs besides its characters: lines are kept in strings, and strings in tables.
const LINE_OVERHEAD: u64 = 64;

/// A file, and the offset in it at which a stream begins.
type Place = (PathBuf, u64);

/// Decompressed streams in files without names, for source files that are read more than once.
#[derive(Debug, Default)]
pub(super) struct Unpacked {
    /// Files by the places of their streams; `None` if a stream cannot be decompressed, or there is no room for it.
    streams: Mutex<HashMap<Place, Option<Arc<File>>>>,
}

impl Unpacked {
    /// Returns the file of a stream of at most `most` bytes. If it does not exist yet, `reader` opens the stream to
    /// fill it.
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

/// A stream of bytes with the file to which it belongs.
pub(super) struct Input {
    path: PathBuf,
    reader: Box<dyn BufRead>,
    /// The file, if it holds the bytes left as they are.
    plain: Option<Arc<File>>,
    /// An upper bound on the bytes left; `None` for streams.
    left: Option<u64>,
    /// The bytes of `plain` behind the stream.
    behind: u64,
    /// The bytes that further header lines may have.
    header_left: u64,
    /// The decompressed streams that are kept for the next reading.
    unpacked: Option<Arc<Unpacked>>,
}

impl Input {
    /// Opens a file and decompresses it if it begins as gzip or bzip2 does. The decompressed stream is kept in
    /// `unpacked`, if that is given, or taken from there.
    pub(super) fn open(path: &Path, unpacked: Option<Arc<Unpacked>>) -> Result<Self> {
        Self { unpacked, ..Self::open_plain(path)? }.unpacked_if_marked()
    }

    /// Returns the decompressed streams that are kept, for other files of the same volume.
    pub(super) fn unpacked(&self) -> Option<Arc<Unpacked>> {
        self.unpacked.clone()
    }

    /// Opens a data file that a header names, without decompression; `unpacked` is used as by [`Self::open`]. Standard
    /// input is refused unless it is a regular file.
    pub(super) fn open_data(path: &Path, unpacked: Option<Arc<Unpacked>>) -> Result<Self> {
        let input = Self { unpacked, ..Self::open_plain(path)? };
        refuse_if!(input.left.is_none(), input, "is not a regular file, as a data file must be");
        Ok(input)
    }

    /// Opens a file without decompression.
    fn open_plain(path: &Path) -> Result<Self> {
        let (file, left) = files::open(path)?;
        let file = Arc::new(file);
        Ok(Self {
            path: path.to_owned(),
            reader: buffered(Arc::clone(&file)),
            plain: left.is_some().then_some(file),
            left,
            behind: 0,
            header_left: MAX_HEADER,
            unpacked: None,
        })
    }

    /// Opens the `size` bytes from byte `at` of an uncompressed file, as a file of the name `path`. Clones of `file`
    /// share one place to read at, so only the last part is read.
    pub(super) fn part(path: PathBuf, file: &File, at: u64, size: u64) -> Result<Self> {
        let opened = || -> io::Result<(File, u64)> {
            let mut file = file.try_clone()?;
            file.seek(SeekFrom::Start(at))?;
            let length = file.metadata()?.len();
            Ok((file, length))
        };
        let (file, length) = opened().map_err(Error::read(&path))?;
        let Some(behind) = length.checked_sub(at).and_then(|left| left.checked_sub(size)) else {
            refuse!(path, "is cut short: it should end at byte {}", at.saturating_add(size));
        };
        let file = Arc::new(file);
        Ok(Self {
            reader: buffered(Arc::clone(&file).take(size)),
            plain: Some(file),
            left: Some(size),
            behind,
            path,
            header_left: MAX_HEADER,
            unpacked: None,
        })
    }

    /// Makes the stream of bytes in memory, as a file of the name `path`.
    #[cfg(feature = "remote")]
    pub(super) fn of_bytes(path: &Path, bytes: Vec<u8>) -> Self {
        let left = Some(bytes.len() as u64);
        let reader = Box::new(io::Cursor::new(bytes));
        Self { path: path.to_owned(), reader, plain: None, left, behind: 0, header_left: MAX_HEADER, unpacked: None }
    }

    /// Returns the stream, with the decompressed streams of `unpacked`.
    pub(super) fn keeping(self, unpacked: Option<Arc<Unpacked>>) -> Self {
        Self { unpacked, ..self }
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Makes an [`Error::Format`] about this file.
    pub(super) fn error(&self, reason: impl Into<String>) -> Error {
        Error::format(&self.path, reason)
    }

    /// Returns an upper bound on the bytes left; `None` if there is none.
    pub(super) fn at_most(&self) -> Option<u64> {
        self.left
    }

    /// Returns the number of bytes left; `None` if it is unknown, for example in a compressed file.
    pub(super) fn exactly_left(&self) -> Option<u64> {
        self.left.filter(|_| self.plain.is_some())
    }

    /// Returns the file and the offset in it at which the remaining bytes begin; `None` if they are not stored as they
    /// are.
    pub(super) fn plain_file(&self) -> Result<Option<(File, u64)>> {
        let (Some(file), Some(left)) = (&self.plain, self.left) else { return Ok(None) };
        let length = file.metadata().map_err(Error::read(&self.path))?.len();
        // A file that has shrunk meanwhile is read as a stream, which reports the missing bytes.
        let Some(offset) = length.checked_sub(left.saturating_add(self.behind)) else { return Ok(None) };
        Ok(Some((file.try_clone().map_err(Error::read(&self.path))?, offset)))
    }

    /// Returns the next `n` bytes, or fewer at the end of the file, without consuming them.
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

    /// Returns the stream, whose bytes are not found in its file again.
    pub(super) fn streamed(self) -> Self {
        Self { plain: None, ..self }
    }

    /// Lowers the bound on the bytes left, if their number is unknown.
    pub(super) fn limit(&mut self, most: u64) {
        if self.plain.is_none() {
            self.left = self.left.map(|left| left.min(most));
        }
    }

    /// Decompresses the zlib stream that begins here, or gzip, which MetaIO accepts as well.
    pub(super) fn inflate(mut self) -> Result<Self> {
        if self.peek(2)? == GZIP_MAGIC {
            return Ok(self.gunzip());
        }
        Ok(self.decompressed_once(MAX_EXPANSION, |reader| buffered(ZlibDecoder::new(reader))))
    }

    /// Decompresses the stream that begins here, or opens the file that keeps its content. A damaged stream is read up
    /// to its damage.
    pub(super) fn decompressed_once(
        mut self,
        expansion: u64,
        f: impl Fn(Box<dyn BufRead>) -> Box<dyn BufRead>,
    ) -> Self {
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
                (self.plain, self.left, self.behind) = (Some(held), Some(meta.len()), 0);
                return self;
            }
            // The file and its clones have one place to read at.
            if file.seek(SeekFrom::Start(at)).is_ok() {
                self.reader = buffered(file);
            }
        }
        self.decompress(expansion, f);
        self
    }

    /// Decodes digits of 4 bits, which are hexadecimal, or of 6 bits, which are base64 (RFC 4648). Blanks between
    /// digits are skipped, and digits behind padding are decoded as well.
    pub(super) fn decode_digits(&mut self, width: u32) {
        self.left = self.left.map(|n| n.saturating_mul(width.into()) / 8);
        self.plain = None;
        let digits = std::mem::replace(&mut self.reader, Box::new(io::empty()));
        self.reader = buffered(Digits { digits, width, bits: 0, held: 0 });
    }

    /// Decompresses the stream that begins here by a codec that makes at most `expansion` bytes of one.
    pub(super) fn decompress(&mut self, expansion: u64, f: impl FnOnce(Box<dyn BufRead>) -> Box<dyn BufRead>) {
        self.left = self.left.map(|_| expanded(self.left, expansion));
        self.plain = None;
        self.reader = f(std::mem::replace(&mut self.reader, Box::new(io::empty())));
    }

    /// Skips `n` bytes.
    pub(super) fn skip(&mut self, n: u64) -> Result<()> {
        refuse_if!(!self.skipped(n)?, self, "ends before byte {n}, where its samples should begin");
        Ok(())
    }

    /// Skips `n` bytes and returns whether they are there.
    pub(super) fn skipped(&mut self, n: u64) -> Result<bool> {
        if self.left.is_some_and(|left| n > left) {
            return Ok(false);
        }
        // A header can name an offset of terabytes in a file of holes.
        if n > BUFFER as u64
            && let Some((mut file, offset)) = self.plain_file()?
        {
            file.seek(SeekFrom::Start(offset + n)).map_err(|e| self.io_error(e))?;
            let left = self.left.map_or(u64::MAX, |left| left - n);
            self.reader = buffered(file.take(left));
        } else if io::copy(&mut (&mut self.reader).take(n), &mut io::sink()).map_err(|e| self.io_error(e))? < n {
            return Ok(false);
        }
        self.passed(n);
        Ok(true)
    }

    /// Lowers the bytes left by `n` bytes that have been read.
    fn passed(&mut self, n: u64) {
        self.left = self.left.map(|left| left.saturating_sub(n));
    }

    /// Returns whether no bytes are left.
    pub(super) fn is_at_end(&mut self) -> Result<bool> {
        self.reader.fill_buf().map(<[u8]>::is_empty).map_err(|e| self.io_error(e))
    }

    /// Skips all but the last `n` bytes, and refuses to skip more than `most`.
    pub(super) fn skip_to_last(mut self, n: u64, most: u64) -> Result<Self> {
        let too_few = |found: u64| format!("is cut short: its samples need {n} bytes, {found} are there");
        if let Some(left) = self.exactly_left() {
            let before = left.checked_sub(n).ok_or_else(|| self.error(too_few(left)))?;
            self.skip(before)?;
            return Ok(self);
        }
        // The length of a stream is known at its end.
        if let Some(left) = self.left.filter(|left| *left < n) {
            refuse!(self, "{} at most", too_few(left));
        }
        let mut all: Vec<u8> = reserved(n, || samples_in(&self.path))?;
        self.append(n.saturating_add(most).saturating_add(1), &mut all)?;
        let Some(skipped) = (all.len() as u64).checked_sub(n) else { refuse!(self, "{}", too_few(all.len() as u64)) };
        refuse_if!(skipped > most, self, "has over {most} bytes before its samples");
        self.left = Some(n);
        let mut last = io::Cursor::new(all);
        last.set_position(skipped);
        self.reader = Box::new(last);
        Ok(self)
    }

    /// Skips `n` lines of any length.
    pub(super) fn skip_lines(&mut self, n: u64) -> Result<()> {
        for _ in 0..n {
            refuse_if!(self.skip_past(b'\n')? == 0, self, "ends before line {n}, where its samples should begin");
        }
        Ok(())
    }

    /// Reads the next line without LF or CRLF; `None` at the end of the file. Bytes that are not UTF-8 become U+FFFD.
    pub(super) fn line(&mut self) -> Result<Option<String>> {
        let mut line = Vec::new();
        (&mut self.reader).take(MAX_LINE).read_until(b'\n', &mut line).map_err(|e| self.io_error(e))?;
        if line.is_empty() {
            return Ok(None);
        }
        let length = line.len() as u64;
        self.passed(length);
        match self.header_left.checked_sub(length + LINE_OVERHEAD) {
            Some(left) => self.header_left = left,
            None => refuse!(self, "has a header of over {} MiB", MAX_HEADER >> 20),
        }
        if line.pop_if(|c| *c == b'\n').is_none() && length == MAX_LINE {
            refuse!(self, "has a header line of over {MAX_LINE} bytes");
        }
        line.pop_if(|c| *c == b'\r');
        Ok(Some(String::from_utf8_lossy(&line).into_owned()))
    }

    /// Skips all up to and including the next byte of this value, and returns the number of bytes.
    pub(super) fn skip_past(&mut self, byte: u8) -> Result<usize> {
        let passed = self.reader.skip_until(byte).map_err(|e| self.io_error(e))?;
        self.passed(passed as u64);
        Ok(passed)
    }

    /// Reads the text between the next `<` and the `>` after it; `None` at the end of the file. A comment ends with its
    /// own mark.
    pub(super) fn tag(&mut self) -> Result<Option<String>> {
        self.skip_past(b'<')?;
        let mut tag = Vec::new();
        loop {
            let before = tag.len();
            let room = MAX_LINE.saturating_sub(before as u64);
            (&mut self.reader).take(room).read_until(b'>', &mut tag).map_err(|e| self.io_error(e))?;
            self.passed((tag.len() - before) as u64);
            match tag.pop_if(|c| *c == b'>') {
                Some(_) if tag.starts_with(b"!--") && !tag.ends_with(b"--") => tag.push(b'>'),
                Some(_) => return Ok(Some(String::from_utf8_lossy(&tag).into_owned())),
                None if tag.len() as u64 == MAX_LINE => {
                    refuse!(self, "has an XML tag of over {MAX_LINE} bytes");
                }
                None => return Ok(None),
            }
        }
    }

    /// Reads the next `n` bytes; an error if there are fewer.
    pub(super) fn bytes(&mut self, n: usize) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.append(n as u64, &mut bytes)?;
        refuse_if!(bytes.len() < n, self, "is cut short: its header has {} of {n} bytes", bytes.len());
        Ok(bytes)
    }

    /// Appends the next `n` bytes to `bytes`, or fewer at the end of the file. The vector grows with the bytes that
    /// exist.
    pub(super) fn append(&mut self, n: u64, bytes: &mut Vec<u8>) -> Result<()> {
        let before = bytes.len();
        match (&mut self.reader).take(n).read_to_end(bytes) {
            // Decompressors report a truncated stream this way; the caller reports the missing bytes.
            Err(e) if e.kind() != io::ErrorKind::UnexpectedEof => return Err(self.io_error(e)),
            _ => {}
        }
        self.passed((bytes.len() - before) as u64);
        Ok(())
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
        self.passed(done as u64);
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

    /// Reads the next token between blanks and commas; returns false at the end of the file. Tokens are cut at 64
    /// bytes: no number of a sample type needs more.
    pub(super) fn token(&mut self, token: &mut String) -> Result<bool> {
        let is_blank = |c: &u8| c.is_ascii_whitespace() || *c == b',';
        token.clear();
        loop {
            let available = self.reader.fill_buf();
            let available = match available {
                Ok(bytes) => bytes,
                Err(e) => return Err(self.io_error(e)),
            };
            if available.is_empty() {
                return Ok(!token.is_empty());
            }
            let blanks = if token.is_empty() { available.iter().take_while(|c| is_blank(c)).count() } else { 0 };
            let word: usize = available[blanks..].iter().take_while(|c| !is_blank(c)).count();
            let kept = word.min(64_usize.saturating_sub(token.len()));
            token.extend(available[blanks..blanks + kept].iter().map(|c| char::from(*c)));
            let used = blanks + word;
            let is_done = used < available.len();
            // The blank behind a token goes with it.
            self.reader.consume(used + usize::from(is_done));
            if is_done {
                return Ok(true);
            }
        }
    }

    fn io_error(&self, source: io::Error) -> Error {
        Error::of_content(&self.path, source)
    }
}

/// Returns the largest number of bytes to which `packed` bytes expand. 64 KiB are added for the headers of short
/// streams.
fn expanded(packed: Option<u64>, expansion: u64) -> u64 {
    packed.map_or(u64::MAX, |n| n.saturating_mul(expansion).saturating_add(1 << 16))
}

/// The number of bytes that a reader reads at a time.
const BUFFER: usize = 1 << 16;

/// Adds a buffer to a reader.
pub(super) fn buffered(reader: impl Read + 'static) -> Box<dyn BufRead> {
    Box::new(BufReader::with_capacity(BUFFER, reader))
}

/// A reader of bytes from digits of 4 bits, which are hexadecimal, or of 6 bits, which are base64.
struct Digits {
    digits: Box<dyn BufRead>,
    width: u32,
    /// The bits of digits that are no byte yet; `count` is their number.
    bits: u32,
    held: u32,
}

impl Read for Digits {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        for (n, byte) in out.iter_mut().enumerate() {
            while self.held < 8 {
                let mut c = [0];
                // An end within a byte leaves it out: whoever needs it reports it.
                if self.digits.read(&mut c)? == 0 {
                    return Ok(n);
                }
                let c = char::from(c[0]);
                let digit = match (self.width, c) {
                    _ if c.is_ascii_whitespace() => continue,
                    (4, _) => c.to_digit(16),
                    (_, 'A'..='Z') => Some(u32::from(c) - u32::from('A')),
                    (_, 'a'..='z') => Some(u32::from(c) - u32::from('a') + 26),
                    (_, '0'..='9') => Some(u32::from(c) - u32::from('0') + 52),
                    (_, '+') => Some(62),
                    (_, '/') => Some(63),
                    (_, '=') => {
                        self.held = 0;
                        continue;
                    }
                    // The tag after the text.
                    (_, '<') => {
                        self.digits = Box::new(io::empty());
                        return Ok(n);
                    }
                    _ => None,
                };
                let name = if self.width == 4 { "hexadecimal" } else { "base64" };
                let Some(digit) = digit else { refuse!(Damage, "{c:?} is no digit of {name}") };
                self.bits = self.bits << self.width | digit;
                self.held += self.width;
            }
            self.held -= 8;
            *byte = (self.bits >> self.held) as u8;
        }
        Ok(out.len())
    }
}
