//! The destination of a picture: a file, or standard output.

use std::io::{IsTerminal, stdout};
use std::path::{Path, PathBuf};

use voxsplat::image::{Background, DepthMap, Image, Note};

use super::failure::{Failure, refuse};
use super::output;

/// The name of standard input and standard output in place of a file.
pub(crate) const STREAM: &str = "-";

/// The destination of a picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Destination {
    /// Standard output, which gets a PNG.
    Stdout,
    /// A file, in the format of its extension.
    File(PathBuf),
}

impl Destination {
    /// Returns a destination that can be written to, as far as can be checked before the work.
    pub(crate) fn checked(path: PathBuf) -> Result<Self, Failure> {
        if path == Path::new(STREAM) {
            return Self::stdout().map(|()| Self::Stdout);
        }
        Image::check_output(&path).map_err(|e| Failure::usage(format!("{e:#}")))?;
        Ok(Self::File(path))
    }

    /// Refuses a terminal, which shows no bytes.
    pub(crate) fn stdout() -> Result<(), Failure> {
        if output::is_json() {
            return refuse("--json: standard output takes the picture, give -o FILE");
        }
        if stdout().is_terminal() {
            return refuse("--output -: standard output is a terminal, expected a pipe or a file");
        }
        Ok(())
    }

    /// Returns whether the destination keeps the values of a picture, not only the colours that a screen shows.
    pub(crate) fn keeps_values(&self) -> bool {
        match self {
            Self::Stdout => false,
            Self::File(path) => path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr")),
        }
    }

    /// Writes a picture. A file appears whole or not at all.
    ///
    /// `depths` are for an .exr, if there are any.
    pub(crate) fn write(
        &self,
        image: &Image,
        depths: Option<&DepthMap>,
        background: Background,
        notes: &[Note],
    ) -> Result<(), Failure> {
        match (self, depths) {
            (Self::Stdout, _) => output::print_bytes(&image.to_png_with_notes(background, notes)?),
            (Self::File(path), Some(depths)) => Ok(image.save_with_depths(path, depths, notes)?),
            (Self::File(path), None) => Ok(image.save_with_notes(path, background, notes)?),
        }
    }
}
