//! A file at a url, read by ranges.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use super::client::{Client, FilePiece, RequestPart, client};
use crate::error::Damage;

/// A file at a url of which ranges are fetched. Its beginning or end, and the whole of a file whose server ignores
/// requests of ranges, are fetched once.
pub(crate) struct RemoteFile {
    path: PathBuf,
    client: Arc<Client>,
    held: Mutex<HeldPiece>,
}

enum HeldPiece {
    Nothing,
    /// There is no such file.
    Absent,
    Piece(FilePiece),
}

impl RemoteFile {
    pub(crate) fn new(path: &Path) -> io::Result<Self> {
        Ok(Self { path: path.to_owned(), client: client(path)?, held: Mutex::new(HeldPiece::Nothing) })
    }

    /// Fetches the whole file, of at most `most` bytes; the kind of the error is `NotFound` if there is none.
    pub(crate) fn all(&self, most: u64) -> io::Result<Vec<u8>> {
        self.client.get(&self.path, RequestPart::All, most)?.map(|piece| piece.bytes).ok_or_else(absent)
    }

    /// Returns the first or the last `length` bytes, or fewer if the file is shorter, and the length of the file. The
    /// kind of the error is `NotFound` if there is no such file.
    pub(crate) fn edge(&self, first: bool, length: u64) -> io::Result<(Vec<u8>, u64)> {
        // Whoever needs the same bytes waits for them.
        let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        if matches!(*held, HeldPiece::Nothing) {
            let part = if first { RequestPart::At(0, length) } else { RequestPart::Last(length) };
            *held = self.client.get(&self.path, part, length)?.map_or(HeldPiece::Absent, HeldPiece::Piece);
        }
        let HeldPiece::Piece(piece) = &*held else { return Err(absent()) };
        let length = length.min(piece.total);
        let bytes = piece.part(if first { 0 } else { piece.total - length }, length);
        Ok((bytes.ok_or_else(|| Damage.error("cut short"))?, piece.total))
    }

    /// Returns the `length` bytes at an offset.
    pub(crate) fn range(&self, offset: u64, length: u64) -> io::Result<Vec<u8>> {
        if length == 0 {
            return Ok(Vec::new());
        }
        let held = || match &*self.held.lock().unwrap_or_else(PoisonError::into_inner) {
            HeldPiece::Piece(piece) => piece.part(offset, length),
            _ => None,
        };
        if let Some(bytes) = held() {
            return Ok(bytes);
        }
        let piece = self.client.get(&self.path, RequestPart::At(offset, length), length)?.ok_or_else(absent)?;
        let bytes = piece.part(offset, length).ok_or_else(|| Damage.error("cut short"))?;
        if piece.start == 0 && piece.bytes.len() as u64 == piece.total {
            *self.held.lock().unwrap_or_else(PoisonError::into_inner) = HeldPiece::Piece(piece);
        }
        Ok(bytes)
    }
}

/// Returns the error about a file that is not there.
fn absent() -> io::Error {
    io::ErrorKind::NotFound.into()
}

impl FilePiece {
    /// Returns the `length` bytes at an offset of the file, if they are there.
    fn part(&self, offset: u64, length: u64) -> Option<Vec<u8>> {
        let from = usize::try_from(offset.checked_sub(self.start)?).ok()?;
        let end = from.checked_add(usize::try_from(length).ok()?)?;
        self.bytes.get(from..end).map(<[u8]>::to_vec)
    }
}
