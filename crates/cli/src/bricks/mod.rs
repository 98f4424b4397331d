//! Pictures in bricks: `voxsplat plan`, `voxsplat brick` and `voxsplat merge`.

mod brick;
mod document;
mod merge;
mod plan;

use std::path::Path;

use voxsplat::image::check_writable;

use crate::failure::Failure;

pub(crate) use brick::run as brick;
pub(crate) use merge::run as merge;
pub(crate) use plan::run as plan;

/// Refuses a file of another extension than the format has, and a place that cannot be written.
fn check_output(path: &Path, extension: &str) -> Result<(), Failure> {
    let has = path.extension().is_some_and(|own| own.eq_ignore_ascii_case(extension));
    if !has {
        return Err(Failure::usage(format!("--output: {}: expected the extension .{extension}", path.display())));
    }
    check_writable(path).map_err(|e| Failure::usage(format!("--output: {e:#}")))
}
