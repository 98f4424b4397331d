//! The files of a Zarr: in a folder, or in a ZIP archive, as .zarr.zip and .ozx
//! (<https://ngff.openmicroscopy.org/rfc/9>).

use std::borrow::Cow;
use std::collections::{BTreeSet, HashMap};
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Component, Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::error::{Damage, Error, Result, Subject, refuse, refuse_if};
use crate::files;
use crate::formats::folder::METADATA;
use crate::formats::input::Input;
use crate::formats::zip::Archive;

/// The place of the files of a Zarr. Paths into an archive begin with its own path.
pub(super) enum Store {
    Folder,
    Archive(Packed),
}

/// An archive and the numbers of its members by their names.
pub(super) struct Packed {
    path: PathBuf,
    archive: Mutex<Archive>,
    members: HashMap<String, usize>,
}

impl Store {
    /// Opens the store of an archive, and returns the folders in it that may be the Zarr: the top, or all folders
    /// there.
    pub(super) fn archive(input: &Input) -> Result<(Self, Vec<PathBuf>)> {
        let (archive, path) = (Archive::open(input)?, input.path().to_owned());
        let members = archive.members.iter().enumerate().map(|(n, member)| (member.name.clone(), n)).collect();
        let store = Self::Archive(Packed { path: path.clone(), archive: Mutex::new(archive), members });
        let folders = if store.is_zarr(&path) { vec![path] } else { store.folders(&path) };
        Ok((store, folders))
    }

    /// Returns whether a folder has the metadata of Zarr.
    pub(super) fn is_zarr(&self, folder: &Path) -> bool {
        METADATA.iter().any(|name| self.has(&folder.join(name)))
    }

    pub(super) fn has(&self, file: &Path) -> bool {
        match self {
            Self::Folder => file.is_file(),
            Self::Archive(packed) => packed.number(file).is_some(),
        }
    }

    /// Returns the folders in a folder that have the metadata of Zarr, in the order of their names.
    pub(super) fn folders(&self, folder: &Path) -> Vec<PathBuf> {
        let mut folders: Vec<PathBuf> = match self {
            Self::Folder => {
                std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect()
            }
            Self::Archive(packed) => {
                let outer = packed.name(folder).map(|name| if name.is_empty() { name } else { name + "/" });
                let inside = |name: &String| {
                    let name = name.strip_prefix(outer.as_deref()?)?.split_once('/')?.0;
                    Some(folder.join(name))
                };
                packed.members.keys().filter_map(inside).collect::<BTreeSet<_>>().into_iter().collect()
            }
        };
        folders.retain(|folder| self.is_zarr(folder));
        folders.sort();
        folders
    }

    /// Opens a file, of which at most `most` bytes may be compressed; `None` if there is no such file.
    pub(super) fn open(&self, path: &Path, most: u64) -> Result<Option<Bytes<'_>>> {
        let packed = match self {
            Self::Archive(packed) => packed,
            Self::Folder => {
                return match files::open(path) {
                    Err(Error::Read { source, .. }) if source.kind() == io::ErrorKind::NotFound => Ok(None),
                    Err(error) => Err(error),
                    Ok((_, None)) => refuse!(path, "is not a regular file"),
                    Ok((file, Some(length))) => Ok(Some(Bytes::File(file, length))),
                };
            }
        };
        let Some(number) = packed.number(path) else { return Ok(None) };
        let archive = packed.lock();
        let Some(member) = archive.members.get(number) else { return Ok(None) };
        if let Some((at, length)) = archive.stored(member, path)? {
            return Ok(Some(Bytes::Member(packed, at, length)));
        }
        let (mut content, size) = (Vec::new(), member.size);
        refuse_if!(size > most, path, "is of {size} bytes that are compressed: expected at most {most}");
        archive.member(member, None)?.append(size, &mut content)?;
        refuse_if!(content.len() as u64 != size, path, "is cut short: {} of {size} bytes", content.len());
        Ok(Some(Bytes::Memory(Cow::Owned(content))))
    }
}

impl Packed {
    /// Locks the archive, which has one place to read at.
    fn lock(&self) -> MutexGuard<'_, Archive> {
        self.archive.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the name in the archive of a path; empty for the archive itself, `None` if it is elsewhere.
    fn name(&self, path: &Path) -> Option<String> {
        let parts = path.strip_prefix(&self.path).ok()?.components().map(|part| match part {
            Component::Normal(name) => name.to_str(),
            _ => None,
        });
        Some(parts.collect::<Option<Vec<_>>>()?.join("/"))
    }

    fn number(&self, path: &Path) -> Option<usize> {
        self.members.get(&self.name(path)?).copied()
    }
}

/// The bytes of a file: in a file, in an archive, or in memory.
pub(super) enum Bytes<'a> {
    File(File, u64),
    /// An archive, the place of a member in it, and the length of the member.
    Member(&'a Packed, u64, u64),
    Memory(Cow<'a, [u8]>),
}

impl Bytes<'_> {
    pub(super) fn len(&self) -> u64 {
        match self {
            Self::File(_, length) | Self::Member(_, _, length) => *length,
            Self::Memory(bytes) => bytes.len() as u64,
        }
    }

    /// Reads the `length` bytes at an offset.
    pub(super) fn range(&self, offset: u64, length: u64) -> io::Result<Vec<u8>> {
        let end = offset.checked_add(length).filter(|end| *end <= self.len());
        let end = end.ok_or_else(|| Damage.error(format!("{length} bytes at {offset}, behind the end")))?;
        match self {
            Self::Memory(bytes) => Ok(bytes[offset as usize..end as usize].to_vec()),
            Self::File(file, _) => part(file, offset, length),
            Self::Member(packed, at, _) => part(packed.lock().file(), at.saturating_add(offset), length),
        }
    }
}

/// Reads the `length` bytes at an offset of a file.
fn part(mut file: &File, offset: u64, length: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    file.seek(SeekFrom::Start(offset))?;
    file.take(length).read_to_end(&mut bytes)?;
    if bytes.len() as u64 == length { Ok(bytes) } else { Err(Damage.error("cut short")) }
}
