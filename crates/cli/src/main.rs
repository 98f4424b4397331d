//! The program `voxsplat`: see the library of this package.

use std::ffi::OsString;
use std::process::ExitCode;

fn main() -> ExitCode {
    let words: Vec<OsString> = std::env::args_os().collect();
    ExitCode::from(voxsplat_cli::command(&words))
}
