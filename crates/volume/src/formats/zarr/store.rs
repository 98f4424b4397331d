//! The files of a Zarr: in a folder, at a url, or in a ZIP archive, as .zarr.zip and .ozx
//! (<https://ngff.openmicroscopy.org/rfc/9>).

use std::borrow::Cow;
use std::collections::{BTreeSet, HashMap};
use std::io;
use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use crate::error::{Damage, Error, Result, Subject, refuse, refuse_if};
use crate::files;
#[cfg(feature = "remote")]
use crate::files::remote::{self, RemoteFile};
use crate::formats::folder::METADATA;
use crate::formats::origin::FileOrigin;
use crate::formats::zip::Archive;

/// The largest length of a file of metadata that is read, in bytes.
pub(super) const MAX_METADATA: u64 = 16 << 20;

/// The place of the files of a Zarr. Paths into an archive begin with its own path.
pub(super) enum Store {
    Folder,
    Archive(ZarrArchive),
    #[cfg(feature = "remote")]
    Url(Fetched),
}

/// An archive and the numbers of its members by their names.
pub(super) struct ZarrArchive {
    path: PathBuf,
    archive: Archive,
    members: HashMap<String, usize>,
    /// Held while a compressed member is read: a file on this machine has one place to read at.
    reading: Mutex<()>,
}

/// The files at a url that were opened last: the indexes of shards are fetched once.
#[cfg(feature = "remote")]
#[derive(Default)]
pub(super) struct Fetched(Mutex<std::collections::VecDeque<(PathBuf, Arc<RemoteFile>)>>);

/// The number of shards at a url whose indexes are kept: each thread reads one, and they are read in order.
#[cfg(feature = "remote")]
const MAX_SHARDS: usize = 4 * remote::CONNECTIONS;

#[cfg(feature = "remote")]
impl Fetched {
    fn file(&self, path: &Path) -> io::Result<Arc<RemoteFile>> {
        let mut files = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, file)) = files.iter().find(|(of, _)| of == path) {
            return Ok(Arc::clone(file));
        }
        let file = Arc::new(RemoteFile::new(path)?);
        files.push_back((path.to_owned(), Arc::clone(&file)));
        if files.len() > MAX_SHARDS {
            files.pop_front();
        }
        Ok(file)
    }
}

impl Store {
    /// Returns the store of a folder, which may be at a url.
    pub(super) fn of_folder(folder: &Path) -> Self {
        #[cfg(feature = "remote")]
        if remote::is_url(folder) {
            return Self::Url(Fetched::default());
        }
        let _ = folder;
        Self::Folder
    }

    /// Returns whether files are fetched from a url.
    pub(super) fn is_fetched(&self) -> bool {
        match self {
            Self::Folder => false,
            Self::Archive(packed) => packed.archive.origin.is_fetched(),
            #[cfg(feature = "remote")]
            Self::Url(_) => true,
        }
    }

    /// Reports how many chunks are read of all, and how many of them were there.
    ///
    /// # Errors
    /// [`Error::Read`] if all are missing because a server denies access to them.
    pub(super) fn report(&self, folder: &Path, [done, found, total]: [usize; 3]) -> Result<()> {
        #[cfg(feature = "remote")]
        if self.is_fetched() {
            remote::report(folder, done as f64 / total as f64);
            if found == 0 && done == total && remote::is_denied(folder) {
                let reason = "HTTP 403 Forbidden, for every chunk";
                return Err(Error::read(folder)(io::Error::new(io::ErrorKind::PermissionDenied, reason)));
            }
        }
        let _ = (folder, done, found, total);
        Ok(())
    }

    /// Returns the length of a file, 0 if there is none; `None` if it is unknown.
    #[cfg(feature = "remote")]
    pub(super) fn size(&self, file: &Path) -> Result<Option<u64>> {
        match self {
            Self::Archive(packed) => {
                Ok(Some(packed.number(file).map_or(0, |number| packed.archive.members[number].packed)))
            }
            _ => remote::size(file).map_err(Error::read(file)),
        }
    }

    /// Returns the store of an archive, and returns the folders in it that may be the Zarr: the top, or all folders
    /// there.
    pub(super) fn archive(path: &Path, archive: Archive) -> Result<(Self, Vec<PathBuf>)> {
        let path = path.to_owned();
        let members = archive.members.iter().enumerate().map(|(n, member)| (member.name.clone(), n)).collect();
        let store = Self::Archive(ZarrArchive { path: path.clone(), archive, members, reading: Mutex::default() });
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
            #[cfg(feature = "remote")]
            Self::Url(_) => self.open(file, MAX_METADATA).is_ok_and(|bytes| bytes.is_some()),
        }
    }

    /// Returns the folders in a folder that have the metadata of Zarr, in the order of their names.
    pub(super) fn folders(&self, folder: &Path) -> Vec<PathBuf> {
        let mut folders: Vec<PathBuf> = match self {
            Self::Folder => {
                std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect()
            }
            // A server lists no folders.
            #[cfg(feature = "remote")]
            Self::Url(_) => self.consolidated(folder),
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
                    Ok((file, Some(length))) => Ok(Some(Bytes::At(FileOrigin::File(Arc::new(file)), 0, length))),
                };
            }
            #[cfg(feature = "remote")]
            Self::Url(fetched) => {
                let file = fetched.file(path).map_err(Error::read(path))?;
                if !is_metadata(path) {
                    return Ok(Some(Bytes::Url(file)));
                }
                // A missing chunk is found when it is read, metadata at once.
                return match file.all(most) {
                    Ok(bytes) => Ok(Some(Bytes::Memory(Cow::Owned(bytes)))),
                    Err(source) if source.kind() == io::ErrorKind::NotFound => Ok(None),
                    Err(source) => Err(Error::of_content(path, source)),
                };
            }
        };
        let Some(number) = packed.number(path) else { return Ok(None) };
        let archive = &packed.archive;
        let Some(member) = archive.members.get(number) else { return Ok(None) };
        if let Some((at, length)) = archive.stored(member, path)? {
            return Ok(Some(Bytes::At(archive.origin.clone(), at, length)));
        }
        let (mut content, size) = (Vec::new(), member.size);
        refuse_if!(size > most, path, "is of {size} bytes that are compressed: expected at most {most}");
        let lock = || packed.reading.lock().unwrap_or_else(PoisonError::into_inner);
        let _reading = (!archive.origin.is_fetched()).then(lock);
        archive.member(member, None)?.append(size, &mut content)?;
        refuse_if!(content.len() as u64 != size, path, "is cut short: {} of {size} bytes", content.len());
        Ok(Some(Bytes::Memory(Cow::Owned(content))))
    }

    /// Returns the folders in a folder that its consolidated metadata lists, of Zarr 3 or 2.
    #[cfg(feature = "remote")]
    fn consolidated(&self, folder: &Path) -> Vec<PathBuf> {
        let json = |name: &str| {
            let bytes = self.open(&folder.join(name), MAX_METADATA).ok()??.all(MAX_METADATA).ok()?;
            serde_json::from_slice::<serde_json::Value>(&bytes).ok()
        };
        let names = |value: &serde_json::Value| -> BTreeSet<String> {
            let names = value.as_object().into_iter().flatten().map(|(name, _)| name.split('/').next());
            names.flatten().filter(|name| !name.starts_with('.')).map(str::to_owned).collect()
        };
        let listed = json("zarr.json").map(|value| names(&value["consolidated_metadata"]["metadata"]));
        let listed = listed.or_else(|| json(".zmetadata").map(|value| names(&value["metadata"])));
        listed.unwrap_or_default().into_iter().map(|name| folder.join(name)).collect()
    }
}

/// Returns whether a path is one of a file of metadata.
#[cfg(feature = "remote")]
fn is_metadata(path: &Path) -> bool {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    METADATA.contains(&name) || [".zattrs", ".zmetadata"].contains(&name)
}

impl ZarrArchive {
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

/// The bytes of a file: a part of a file, at a url, or in memory.
pub(super) enum Bytes<'a> {
    /// A file, the offset of the bytes in it, and their number.
    At(FileOrigin, u64, u64),
    /// The kind of an error of reading is `NotFound` if there is no such file.
    #[cfg(feature = "remote")]
    Url(Arc<RemoteFile>),
    Memory(Cow<'a, [u8]>),
}

impl Bytes<'_> {
    /// Returns the number of bytes that are known to be there.
    fn len(&self) -> u64 {
        match self {
            Self::At(_, _, length) => *length,
            Self::Memory(bytes) => bytes.len() as u64,
            #[cfg(feature = "remote")]
            Self::Url(_) => u64::MAX,
        }
    }

    /// Reads all bytes, at most `most`.
    pub(super) fn all(&self, most: u64) -> io::Result<Vec<u8>> {
        #[cfg(feature = "remote")]
        if let Self::Url(file) = self {
            return file.all(most);
        }
        let length = self.len();
        refuse_if!(length > most, Damage, "{length} bytes, expected at most {most}");
        self.range(0, length)
    }

    /// Reads the first or the last `length` bytes.
    pub(super) fn edge(&self, first: bool, length: u64) -> io::Result<Vec<u8>> {
        let short = || Damage.error("a shard without an index");
        #[cfg(feature = "remote")]
        if let Self::Url(file) = self {
            return Ok(file.edge(first, length)?.0).and_then(|bytes| match bytes.len() as u64 == length {
                true => Ok(bytes),
                false => Err(short()),
            });
        }
        let start = self.len().checked_sub(length).ok_or_else(short)?;
        self.range(if first { 0 } else { start }, length)
    }

    /// Reads the `length` bytes at an offset.
    pub(super) fn range(&self, offset: u64, length: u64) -> io::Result<Vec<u8>> {
        let end = offset.checked_add(length).filter(|end| *end <= self.len());
        let end = end.ok_or_else(|| Damage.error(format!("{length} bytes at {offset}, behind the end")))?;
        match self {
            Self::Memory(bytes) => Ok(bytes[offset as usize..end as usize].to_vec()),
            Self::At(origin, at, _) => origin.range(at.saturating_add(offset), length),
            #[cfg(feature = "remote")]
            Self::Url(file) => file.range(offset, length),
        }
    }
}
